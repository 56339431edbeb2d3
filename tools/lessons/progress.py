"""What a reader has solved and read: a file in the folder of the user's state, which commands add to."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from bootstrap.environment import try_lock
from common.errors import UserError
from common.paths import user_state, write_whole

FORMAT = 1
PATIENCE_S = 5.0
"""How long a command waits for another one that writes."""


@dataclass(frozen=True)
class Progress:
    """The exercises that were solved ("4/no-new-layout"), the sections that were read ("4/Barriers"), and a chapter.

    The reader is in the first open section from chapter `chapter` on.
    """

    solved: frozenset[str] = field(default_factory=frozenset)
    read: frozenset[str] = field(default_factory=frozenset)
    chapter: int = 1


def file() -> Path:
    """Return the file that keeps it."""
    return user_state() / "progress.json"


def load() -> Progress:
    """Return what was kept; raise UserError for a file that cannot be read."""
    path = file()
    try:
        kept: Any = json.loads(path.read_text("utf-8"))
        if kept["format"] != FORMAT:
            raise UserError(
                f"{path} is of another version of Strata: move it away, and progress begins anew."
            )
        return Progress(
            frozenset(map(str, kept["solved"])), frozenset(map(str, kept["read"])), int(kept["chapter"])
        )
    except (FileNotFoundError, NotADirectoryError):
        return Progress()
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(f"{path} cannot be read: move it away, and progress begins anew.") from None


def save(progress: Progress) -> None:
    """Keep it; raise UserError where nothing can be written."""
    kept = {
        "format": FORMAT,
        "chapter": progress.chapter,
        "solved": sorted(progress.solved),
        "read": sorted(progress.read),
    }
    path = file()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, (json.dumps(kept, indent=1) + "\n").encode())
    except OSError as error:
        raise UserError(f"{path} cannot be written ({error.strerror}), so progress is not kept.") from None


def forget() -> None:
    """Delete what is kept; raise UserError where that fails."""
    path = file()
    try:
        path.unlink(missing_ok=True)
    except NotADirectoryError:
        return  # then nothing is kept there
    except OSError as error:
        raise UserError(f"{path} cannot be deleted ({error.strerror}), so progress stays.") from None


def add(solved: Iterable[str] = (), read: Iterable[str] = (), chapter: int | None = None) -> Progress:
    """Add to what is kept, and return all of it; raise UserError where that fails.

    Two commands at once both add what they have: the second one waits for the first.
    """
    with _alone():
        progress = load()
        progress = replace(
            progress,
            solved=progress.solved | {*solved},
            read=progress.read | {*read},
            chapter=progress.chapter if chapter is None else chapter,
        )
        save(progress)
    return progress


@contextmanager
def _alone() -> Iterator[None]:
    """Hold the lock of the folder, which the system ends with its holder; without one where none can be made."""
    with ExitStack() as stack:
        with suppress(OSError):  # `save` says why nothing can be kept
            file().parent.mkdir(parents=True, exist_ok=True)
            stream = stack.enter_context(open(file().parent / ".lock", "ab"))
            ends = time.monotonic() + PATIENCE_S
            while not try_lock(stream.fileno()) and time.monotonic() < ends:
                time.sleep(0.01)
        yield
