"""Names: hashes that are the same in every run, and the near match for a word that does not exist."""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Iterable


def stable_hash(text: str) -> int:
    """Return a 64-bit hash of `text` that never changes: for names in files, caches and GPU buffers.

    Python's own `hash` differs from process to process. Among n names the chance that any two share a value
    is about n^2 / 2^65: 3e-10 for 100,000.
    """
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def suggest(word: str, words: Iterable[str], shown: int = 8) -> str:
    """Return how a sentence about the unknown `word` goes on: the near match, else what there is.

    "; did you mean 'medium'?", or "; known are 'high', 'low'" (the first `shown` names), or "" without words.
    """
    known = sorted(set(words))
    by_lower = {name.lower(): name for name in reversed(known)}
    near = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {by_lower[near[0]]!r}?"
    if not known:
        return ""
    more = ", ..." if len(known) > shown else ""
    return "; known are " + ", ".join(repr(name) for name in known[:shown]) + more
