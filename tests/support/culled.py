"""What the kernels of culling wrote, read back, and the same found by numpy in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.support.buffers import read_words


def words(renderer: Any, name: str, slot: int = 0) -> np.ndarray:
    """Return the words of a buffer of culling, after all frames."""
    kernels = renderer.techniques["culling"].memory._kernels
    buffer, device = kernels._buffer(name, slot), renderer.device
    return read_words(device, buffer)


def commands(renderer: Any, phase: int) -> list[np.ndarray]:
    """Return the draw commands (N, 5) of each batch in a phase."""
    memory = renderer.techniques["culling"].memory
    lists, listed, state = memory.lists, words(renderer, "commands").reshape(-1, 5), words(renderer, "state")
    counts = state[lists.state.counts + phase * len(lists.batches) :][: len(lists.batches)]
    firsts = phase * lists.commands + lists.batches["first_command"].astype(int)
    return [
        listed[first : first + count] for first, count in zip(firsts.tolist(), counts.tolist(), strict=True)
    ]


def box_margins(low: np.ndarray, high: np.ndarray, clip_from_world: np.ndarray) -> np.ndarray:
    """Return (N,) the least of the planes' largest distances of a corner, in clip units: below 0 is outside."""
    bits = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = np.where(bits[None], high[:, None], low[:, None])
    clip = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2) @ clip_from_world.T
    x, y, z, w = np.moveaxis(clip, 2, 0)
    planes = np.stack([w + x, w - x, w + y, w - y, w - z, z], axis=0)
    margins: np.ndarray = planes.max(axis=2).min(axis=0)
    return margins
