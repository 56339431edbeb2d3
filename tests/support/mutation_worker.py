"""The child process in which mutated files are opened: one after the other, watched, with a line of JSON for each.

    python -m tests.support.mutation_worker FOLDER MODULE:WORK OPTIONS LIMIT_S

Cases are read from stdin, one a line. What the work prints goes to files in FOLDER/results. When a file takes longer
than LIMIT_S, the traceback of every thread goes there as well, and `mutation_run` ends the process.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import shutil
import sys
import time
import traceback
import unicodedata
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

from common.errors import UnsupportedError, UserError
from tests.support import mutation_sources
from tests.support.mutation_guard import Guard
from tests.support.mutations import Case, Mutant, follows_schema, mutate, write

RESULTS = "results"
"""The folder in that of a run where commands may write."""

PRINTED, SAID = f"{RESULTS}/printed.txt", f"{RESULTS}/said.txt"
"""What went to stdout, and to stderr."""


class Channel:
    """Sends lines of JSON to the parent over what was stdout; all else that is printed goes to files."""

    def __init__(self, folder: Path) -> None:
        self._stream = os.fdopen(os.dup(1), "w", encoding="ascii")
        for number, name in ((1, PRINTED), (2, SAID)):
            file = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
            os.dup2(file, number)
            os.close(file)

    def send(self, **values: Any) -> None:
        """Send one line, at once: the process may be ended before it can say more."""
        self._stream.write(json.dumps(values) + "\n")
        self._stream.flush()


def main(words: list[str]) -> None:
    """Do the work on each case until stdin ends."""
    folder, (module, _, name), limit_s = Path(words[0]), words[1].partition(":"), float(words[3])
    channel = Channel(folder)
    try:
        work = getattr(import_module(module), name)(json.loads(words[2]), folder)
    except UnsupportedError as error:
        channel.send(missing=str(error))
        return
    guard = Guard(lambda what: channel.send(opened=what), folder / RESULTS)
    guard.install()
    channel.send(device=work.device)
    for line in sys.stdin:
        case = Case.named(line.strip())
        place = folder / "case" / "scene"
        shutil.rmtree(place.parent, ignore_errors=True)
        mutant = mutate(case)
        path = write(mutant, place)
        forget_peak()
        faulthandler.dump_traceback_later(limit_s, file=sys.stderr)
        began = time.perf_counter()
        with guard.watching(place):
            outcome, text = attempt(work, path, case)
        seconds = time.perf_counter() - began
        faulthandler.cancel_dump_traceback_later()
        channel.send(
            outcome=outcome,
            text=text,
            seconds=seconds,
            peak=peak_bytes(),
            parsed=parses(mutant),
            changes=[ascii(change) for change in mutant.changes],
        )
        work.tidy()


def attempt(work: Any, path: Path, case: Case) -> tuple[str, str]:
    """Return what became of a file, "loaded", "refused" or "fault", and the sentence or the traceback."""
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            warnings.simplefilter("ignore", DeprecationWarning)
            work(path, case)
    except UserError as error:
        return ("fault", f"odd sentence: {error!a}") if is_odd(str(error)) else ("refused", str(error))
    except BaseException as error:
        return "fault", "".join(traceback.format_exception(error))
    if said:
        return "fault", "\n".join(f"{one.filename}:{one.lineno}: {one.message!a}" for one in said)
    return "loaded", ""


STEERING = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}
"""Bidirectional classes of characters that turn round what follows them."""


def is_hidden(letter: str) -> bool:
    """Whether a character begins a line, steers a terminal, turns text round, or is half a character."""
    return (
        unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp")
        or unicodedata.bidirectional(letter) in STEERING
    )


def is_odd(sentence: str) -> bool:
    """Whether a sentence is none, is longer than a screen, or has characters that are not to be seen."""
    return not sentence or len(sentence) > 1000 or any(map(is_hidden, sentence))


def parses(mutant: Mutant) -> bool | None:
    """Whether a glTF file is JSON of the right schema; None for other files."""
    if not mutation_sources.is_gltf(mutant.case.source):
        return None
    try:
        document, _ = mutation_sources.split(mutant.files[mutant.main])
    except Exception:
        return False
    return follows_schema(document)


def forget_peak() -> None:
    """Let the peak of memory count from now on, where the system can."""
    with contextlib.suppress(OSError), open("/proc/self/clear_refs", "w") as file:
        file.write("5")


def peak_bytes() -> int:
    """Return the most memory that was resident since `forget_peak`, in bytes; 0 where the system does not say."""
    with contextlib.suppress(OSError), open("/proc/self/status") as file:
        for line in file:
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return 0


if __name__ == "__main__":
    main(sys.argv[1:])
