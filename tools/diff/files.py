"""The files that `strata diff` compares: which of a folder belong to a chapter, and what each of them holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath

from tools.diff.sentences import SHADERS, sentence_of

LEFT_OUT = frozenset({"studies", "benches", "out", "__pycache__", "fork.json"})
"""What is no part of a chapter's frame: studies and benches stay with their chapter, a fork's record is about the fork,
and the rest is made by running."""


@dataclass(frozen=True)
class Source:
    """One file: its path inside its chapter with "/" between the folders, and its bytes."""

    path: str
    data: bytes = field(repr=False)

    @cached_property
    def text(self) -> str | None:
        """What it says with line ends of "\\n", or None where it is no text of UTF-8."""
        if b"\0" in self.data:
            return None
        try:
            return self.data.decode("utf-8").replace("\r\n", "\n")
        except UnicodeDecodeError:
            return None

    @cached_property
    def lines(self) -> list[str]:
        """Its lines without their ends; what follows the last line end counts only if there is something."""
        found = (self.text or "").split("\n")
        return found[:-1] if not found[-1] else found

    @property
    def suffix(self) -> str:
        """The end of the name that says which kind of file it is: ".py"."""
        return PurePosixPath(self.path).suffix

    @property
    def is_code(self) -> bool:
        """Whether it is Python or GLSL: what counts as the size of a lesson."""
        return self.suffix == ".py" or self.suffix in SHADERS

    @property
    def sentence(self) -> str:
        """The sentence with which it says what it is, or ""."""
        return sentence_of(self.path, self.text or "")


def sources(folder: Path) -> dict[str, Source]:
    """Return the files of a chapter's folder by their path in it; hidden ones and `LEFT_OUT` are no part of it.

    Raises OSError where one cannot be read.
    """
    found = {}
    for path in sorted(folder.rglob("*")):
        inside = path.relative_to(folder)
        if any(part in LEFT_OUT or part.startswith(".") for part in inside.parts):
            continue
        if path.is_file() and path.suffix != ".pyc":
            found[inside.as_posix()] = Source(inside.as_posix(), path.read_bytes())
    return found


def renamed(old: Mapping[str, Source], new: Mapping[str, Source]) -> dict[str, str]:
    """Return which file of `new` (its keys) is which of `old` under another name: most of its lines are the same.

    Both hold only files that the other one does not know.
    """
    pairs = [(_likeness(one, other), a, b) for a, one in old.items() for b, other in new.items()]
    found: dict[str, str] = {}
    for score, a, b in sorted(pairs, key=lambda pair: (-pair[0], pair[1:])):
        if score >= RENAMED and b not in found and a not in found.values():
            found[b] = a
    return found


RENAMED = 0.6
"""The part of lines in common from which on two files are one that was renamed; git takes half of the bytes."""


def _likeness(a: Source, b: Source) -> float:
    """Return which part of the lines of both is common to them, from 0 to 1; few lines say nothing."""
    if a.suffix != b.suffix:
        return 0.0
    if a.data == b.data:
        return 1.0 if a.data.strip() else 0.0
    lines, others = ([line.strip() for line in one.lines if line.strip()] for one in (a, b))
    if min(len(lines), len(others)) < 5:
        return 0.0
    common = Counter(lines) & Counter(others)
    return 2 * common.total() / (len(lines) + len(others))
