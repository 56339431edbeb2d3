"""Runs many mutated files through a child process, and says what became of each: `run` gives a `Summary`.

A file that takes longer than `LIMIT_S` or more memory than `LIMIT_BYTES`, or that ends the process, costs the child;
the next child goes on behind that file.
"""

from __future__ import annotations

import json
import os
import queue
import subprocess
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.errors import UnsupportedError
from common.paths import ROOT
from tests.support.mutation_worker import RESULTS, SAID
from tests.support.mutations import Case

LIMIT_S = 20.0
LIMIT_BYTES = 4 * 2**30
START_S = 180.0
"""How long a child may take to import, to open a device and to draw a whole file: no bound on speed."""

_STEP_S = 0.05
"""How often the memory of the child is looked at: it grows by about a gigabyte a second."""


@dataclass
class Result:
    """What became of one file: "loaded", "refused", "fault", "opened", "hang", "memory" or "crash"."""

    case: Case
    outcome: str
    text: str = ""
    """The sentence of a refusal, or what shows the fault."""
    seconds: float = 0.0
    peak: int = 0
    """Bytes resident at most."""
    parsed: bool | None = None
    """Whether it is JSON that follows the schema; None for a file that is no glTF, or one that ended the child."""
    changes: list[str] = field(default_factory=list)

    @property
    def signature(self) -> str:
        """What faults of one cause have in common: the last lines of a traceback, without numbers of the case."""
        if self.outcome == "fault":
            lines = [line.strip() for line in self.text.strip().splitlines()]
            places = [line for line in lines if line.startswith("File ")]
            return f"{lines[-1]:.100} at {places[-1] if places else '?'}"
        return (
            f"{self.outcome}: {self.text}".splitlines()[0][:200] if self.outcome == "opened" else self.outcome
        )


@dataclass
class Summary:
    """All results of a run."""

    results: list[Result] = field(default_factory=list)
    device: str = ""
    """What the work drew with, and its driver; "" where it opened no device by itself."""

    def count(self, outcome: str) -> int:
        """Return how many files ended so."""
        return sum(result.outcome == outcome for result in self.results)

    @property
    def parsed(self) -> float:
        """The share of glTF files that are JSON and follow the schema."""
        known = [result.parsed for result in self.results if result.parsed is not None]
        return sum(known) / len(known) if known else 0.0

    @property
    def faults(self) -> list[Result]:
        """What was neither loaded nor refused by a sentence."""
        return [result for result in self.results if result.outcome not in ("loaded", "refused")]

    def figures(self) -> str:
        """Return the counts, the slowest file and the one that took most memory."""
        slowest = max(self.results, key=lambda result: result.seconds)
        largest = max(self.results, key=lambda result: result.peak)
        counts = Counter(result.outcome for result in self.results)
        return (
            f"{len(self.results)} files, {self.parsed:.1%} of the glTF files parse, "
            f"{', '.join(f'{count} {outcome}' for outcome, count in sorted(counts.items()))}; at most "
            f"{slowest.seconds:.2f} s ({slowest.case}) and {largest.peak / 2**20:.0f} MiB ({largest.case})"
        )

    def report(self) -> str:
        """Return the figures, and the faults by what they have in common, each with a case to look at."""
        groups = defaultdict(list)
        for result in self.faults:
            groups[result.signature].append(result)
        told = [self.figures()]
        for signature, found in sorted(groups.items(), key=lambda group: -len(group[1])):
            first = min(found, key=lambda result: len(result.changes))
            told += [
                f"\n{len(found)} times: {signature}",
                f"cases {', '.join(str(result.case) for result in found[:6])}",
                f"python -m tests.support.mutations {first.case} FOLDER  # {'; '.join(first.changes)}",
                first.text[-3000:],
            ]
        return "\n".join(told)


def run(
    work: str,
    cases: Sequence[Case],
    folder: Path,
    options: Any = None,
    limit_s: float = LIMIT_S,
    limit_bytes: int = LIMIT_BYTES,
) -> Summary:
    """Do `work`, "module:class", on every case in child processes that write to `folder` alone.

    Raises UnsupportedError where the work needs a device that is not here.
    """
    summary = Summary()
    left = list(cases)
    while left:
        with closing(_Child(work, options, folder, limit_s)) as child:
            summary.device = child.wait_until_ready()
            for result in child.results(left, limit_s, limit_bytes):
                summary.results.append(result)
                left = left[1:]
                if result.outcome in ("hang", "memory", "crash"):
                    break
    return summary


class _Child:
    """A worker process, and a thread that reads its lines."""

    def __init__(self, work: str, options: Any, folder: Path, limit_s: float) -> None:
        results = folder / RESULTS
        results.mkdir(exist_ok=True)
        self._said = folder / SAID
        self._said.write_bytes(b"")
        (folder / "cache").mkdir(exist_ok=True)
        environment = os.environ | {
            "STRATA_CACHE": str(folder / "cache"),
            "PYTHONPATH": str(ROOT),
            "PYTHONIOENCODING": "utf-8:strict",
        }
        for display in ("DISPLAY", "WAYLAND_DISPLAY"):
            environment.pop(display, None)
        # The parent ends it a little later than its own clock tells what it does.
        words = [str(folder), work, json.dumps(options), str(limit_s)]
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "tests.support.mutation_worker", *words],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            cwd=results,
        )
        self._lines: queue.Queue[dict[str, Any] | None] = queue.Queue()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(json.loads(line))
        self._lines.put(None)

    def wait_until_ready(self) -> str:
        """Wait for the imports and the device, and return its name; raises UnsupportedError where it is not here."""
        said = self._lines.get(timeout=START_S)
        assert said is not None, f"the child did not start:\n{self.said()}"
        if "missing" in said:
            raise UnsupportedError(said["missing"])
        device: str = said["device"]
        return device

    def results(self, cases: Sequence[Case], limit_s: float, limit_bytes: int) -> Iterator[Result]:
        """Yield the result of each case; behind one that ended the child there is none."""
        for case in cases:
            assert self._process.stdin is not None
            self._process.stdin.write(f"{case}\n".encode())
            self._process.stdin.flush()
            yield self._result(case, limit_s, limit_bytes)

    def _result(self, case: Case, limit_s: float, limit_bytes: int) -> Result:
        began, opened, peak = time.monotonic(), list[str](), 0
        while True:
            seconds = time.monotonic() - began
            peak = max(peak, self._resident())
            if peak > limit_bytes:
                return self._ended(case, "memory", opened, seconds, peak)
            if seconds > limit_s + 1.0:  # by then the child has written where it is
                return self._ended(case, "hang", opened, seconds, peak)
            try:
                said = self._lines.get(timeout=_STEP_S)
            except queue.Empty:
                continue
            if said is None:
                code = self._process.wait()
                return self._ended(case, "crash", [*opened, f"exit code {code}"], seconds, peak)
            if "opened" in said:
                opened.append(said["opened"])
                continue
            result = Result(case, **said)
            if result.peak > limit_bytes:
                result.outcome = "memory"
            elif opened:
                result.outcome, result.text = "opened", "\n".join([*opened, result.text])
            return result

    def _ended(self, case: Case, outcome: str, opened: list[str], seconds: float, peak: int) -> Result:
        self._process.kill()
        return Result(case, outcome, "\n".join([*opened, self.said()]), seconds, peak)

    def _resident(self) -> int:
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):  # another system, or it has just ended
            return 0
        return pages * os.sysconf("SC_PAGE_SIZE")

    def said(self) -> str:
        """Return the end of what the child has said on stderr."""
        return self._said.read_bytes()[-6000:].decode("utf-8", "backslashreplace")

    def close(self) -> None:
        """End the process and the thread."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.close()
            self._process.wait(timeout=20)
        except (OSError, subprocess.TimeoutExpired):
            self._process.kill()
            self._process.wait()
        self._thread.join(timeout=20)
        self._process.stdout.close()
