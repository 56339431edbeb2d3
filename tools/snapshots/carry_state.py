"""What a carry keeps while it waits for somebody to resolve a conflict: one file, and a lock while one is at work.

`.strata/carry.json` beside `chapters/` is git-ignored and is gone when the carry is over.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bootstrap.environment import try_lock
from common.errors import UserError
from common.paths import write_whole
from tools.snapshots.trees import Tree

FORMAT = 1


@dataclass(frozen=True)
class Fix:
    """A change of some files of one chapter: each as it was and as it is now; a file that is missing is not there."""

    base: Tree
    theirs: Tree


@dataclass
class State:
    """A carry that is not finished.

    `number` is the chapter of the fix, `stopped` the one with the conflict, or None while files are being written.
    `originals` are the files of all chapters that the carry concerns as they were before it, `written` as it left
    them, both by path below chapters/ (None: no file). `pending` is what the stopped chapter had already, and what
    later ones may still need.
    """

    number: int
    stopped: int | None
    originals: dict[str, bytes | None] = field(default_factory=dict)
    written: dict[str, bytes | None] = field(default_factory=dict)
    pending: Fix = field(default_factory=lambda: Fix({}, {}))


def place(root: Path) -> Path:
    """Return where the state of a carry in the chapters of `root` is kept."""
    return root.parent / ".strata" / "carry.json"


def save(root: Path, state: State | None) -> None:
    """Keep a state, or remove it when all is done."""
    path = place(root)
    if state is None:
        path.unlink(missing_ok=True)
        return
    record = {
        "format": FORMAT,
        "number": state.number,
        "stopped": state.stopped,
        "originals": _coded(state.originals),
        "written": _coded(state.written),
        "base": _coded(state.pending.base),
        "theirs": _coded(state.pending.theirs),
    }
    write_whole(path, (json.dumps(record, indent=1) + "\n").encode())


def load(root: Path) -> State | None:
    """Return the carry that is not finished, or None; raise UserError if the file cannot be read."""
    path = place(root)
    if not path.is_file():
        return None
    try:
        record: dict[str, Any] = json.loads(path.read_text("utf-8"))
        if record["format"] != FORMAT:
            raise ValueError
        files = {name: _decoded(record[name]) for name in ("originals", "written", "base", "theirs")}
        present = [
            {name: data for name, data in files[key].items() if data is not None}
            for key in ("base", "theirs")
        ]
        return State(
            int(record["number"]), record["stopped"], files["originals"], files["written"], Fix(*present)
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise UserError(
            f"{path} cannot be read, so the carry that it is about cannot go on: remove it, "
            "and `git diff chapters` shows what that carry has written."
        ) from None


@contextmanager
def alone(root: Path) -> Iterator[None]:
    """Hold the lock of all carries in `root`; raise UserError if another one is at work."""
    path = place(root).with_suffix(".lock")
    path.parent.mkdir(exist_ok=True)
    with open(path, "ab") as stream:
        if not try_lock(stream.fileno()):
            raise UserError("Another `strata carry` is at work in this clone: wait for it.")
        yield


def _coded(files: Mapping[str, bytes | None]) -> dict[str, str | None]:
    return {
        name: None if data is None else base64.b64encode(data).decode("ascii") for name, data in files.items()
    }


def _decoded(files: Mapping[str, str | None]) -> dict[str, bytes | None]:
    return {name: None if data is None else base64.b64decode(data) for name, data in files.items()}
