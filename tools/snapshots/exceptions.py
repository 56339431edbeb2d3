"""What is excused from the rules that keep chapters in step: `chapters/exceptions.toml`, read and checked.

[[snapshot]]           # at most three in all chapters
chapter = "ch07"       # the later one of the two
rule = "deletions"     # see tools/snapshots/rules.py
reason = "the forward pass becomes a G-buffer pass, and that is the lesson"

[[not_carried]]        # a repair that a later chapter does without
commit = "1a2b3c4d"    # at least eight digits
file = "shading/sky.py"
chapter = "ch09"
reason = "chapter 9 draws the sky in compute"
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

from common.errors import UserError

NAME = "exceptions.toml"
MOST = 3
"""How many exceptions from the rules of snapshots there may be."""


@dataclass(frozen=True)
class Snapshot:
    """One rule that one chapter need not keep."""

    chapter: str
    rule: str
    reason: str


@dataclass(frozen=True)
class NotCarried:
    """One repair that one chapter does without."""

    commit: str
    file: str
    chapter: str
    reason: str

    def covers(self, sha: str, file: str, chapter: str) -> bool:
        """Whether this is about a file of a chapter and what the commit `sha` did."""
        return sha.startswith(self.commit) and (file, chapter) == (self.file, self.chapter)


@dataclass(frozen=True)
class Exceptions:
    """All of the file."""

    snapshot: tuple[Snapshot, ...] = ()
    not_carried: tuple[NotCarried, ...] = ()


Entry = TypeVar("Entry", Snapshot, NotCarried)


def read_exceptions(root: Path) -> Exceptions:
    """Return what `root` excuses, nothing where it has no such file; raise UserError for a wrong entry."""
    path = root / NAME
    if not path.is_file():
        return Exceptions()
    try:
        record = tomllib.loads(path.read_text("utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise UserError(f"{path} is no TOML: {error}.") from None
    wrong = set(record) - {"snapshot", "not_carried"}
    if wrong:
        raise UserError(f"{path}: {sorted(wrong)[0]!r} is neither [[snapshot]] nor [[not_carried]].")
    made = Exceptions(
        tuple(_entry(path, Snapshot, one) for one in record.get("snapshot", [])),
        tuple(_entry(path, NotCarried, one) for one in record.get("not_carried", [])),
    )
    if len(made.snapshot) > MOST:
        raise UserError(
            f"{path} has {len(made.snapshot)} exceptions from the rules of snapshots; {MOST} may be."
        )
    return made


def _entry(path: Path, kind: type[Entry], values: object) -> Entry:
    """Return one entry of the file; each field is a text, none is empty, and a commit is a hash."""
    names = [field.name for field in fields(kind)]
    if not isinstance(values, dict) or sorted(values) != sorted(names):
        raise UserError(f"{path}: each entry has {', '.join(names)}, and this one is {values!r}.")
    for name, text in values.items():
        if not (isinstance(text, str) and text.strip()):
            raise UserError(f"{path}: {name} = {text!r} is no text; say something.")
    if not re.fullmatch(r"[0-9a-f]{8,40}", values.get("commit", "0" * 8)):
        raise UserError(f"{path}: commit = {values['commit']!r} is no hash of at least eight digits.")
    return kind(**values)
