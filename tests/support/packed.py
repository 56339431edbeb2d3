"""Formats whose channels share a word, bit by bit: the truth for what unpacks them."""

from __future__ import annotations

import numpy as np


def channels_of(words: np.ndarray, bits: tuple[int, ...] = (10, 10, 10, 2)) -> np.ndarray:
    """Return unsigned normalised channels (..., C) of words, the first one in the lowest bits."""
    found, shift = [], 0
    for count in bits:
        found.append((words.astype(np.int64) // 2**shift % 2**count) / (2**count - 1))
        shift += count
    return np.stack(found, axis=-1).astype(np.float32)
