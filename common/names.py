"""Names: hashes that are the same in every run, near matches, and what of a name is fit to be shown."""

from __future__ import annotations

import difflib
import hashlib
import re
from collections.abc import Iterable

_UNSEEN = re.compile(
    "["
    "\x00-\x1f\x7f-\x9f"  # control characters of ASCII and of Latin 1, among them what begins a terminal's escape codes
    "\xad\u200b\u2060-\u2064\ufeff"  # invisible: two names would look alike
    "\u061c\u200e\u200f\u202a-\u202e\u2066-\u206f"  # change the direction of what follows
    "\u2028\u2029"  # line and paragraph separators
    "\ufff9-\ufffb\U000e0000-\U000e007f"  # annotations and tags
    "\ud800-\udfff"  # halves of a character, which no encoding takes
    "]"
)


def is_visible(text: str) -> bool:
    """Whether `visible` returns `text` as it is."""
    return _UNSEEN.search(text) is None


def visible(text: str, keep: str = "") -> str:
    """Return `text` with every character that is not to be seen as an escape, such as \\x1b.

    All text that comes from a file goes through here before it is a name in a scene or stands in a sentence: what comes
    out can be encoded, is one line, and steers no terminal. A byte of a file's name that is no UTF-8, which Python has
    as U+DC80 to U+DCFF, becomes \\x80 to \\xff. `keep` are characters that stay.
    """
    return _UNSEEN.sub(lambda match: match[0] if match[0] in keep else _escaped(match[0]), text)


def shortened(text: str, most: int = 600) -> str:
    """Return `text`, or its begin and an ellipsis where it has more than `most` characters."""
    return text if len(text) <= most else text[: most - 3] + "..."


def _escaped(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")


def stable_hash(text: str) -> int:
    """Return a 64-bit hash of `text` that never changes: for names in files, caches and GPU buffers.

    Python's own `hash` differs from process to process. Among n names the chance that any two share a value
    is about n^2 / 2^65: 3e-10 for 100,000.
    """
    return int.from_bytes(
        hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=8).digest(), "little"
    )


def suggest(word: str, words: Iterable[str], shown: int = 8) -> str:
    """Return how a sentence about the unknown `word` goes on: the near match, else what there is.

    "; did you mean 'medium'?", for what begins alike "; did you mean 'ray-query' or 'ray-tracing'?", or "; known are
    'high', 'low'" (the first `shown` names), or "" without words.
    """
    known = sorted(set(words))
    by_lower = {name.lower(): name for name in reversed(known)}
    near = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    begin = word.lower().rstrip("s")  # "rays" begins as "ray-query" does
    near = near or [name for name in sorted(by_lower) if len(begin) > 2 and name.startswith(begin)][:2]
    if near:
        return f"; did you mean {' or '.join(repr(by_lower[name]) for name in near)}?"
    if not known:
        return ""
    more = ", ..." if len(known) > shown else ""
    return "; known are " + ", ".join(repr(name) for name in known[:shown]) + more
