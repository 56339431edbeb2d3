"""Copies of the clone in which mutants are tried: each has its own files, packages by links, and its own caches.

A run of pytest there has a limit. At its end every process that it started is ended too.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.errors import StrataError, UserError
from tools.snapshots.history import git

PLUGIN = Path(__file__).with_name("mutant_watch.py")
UNKNOWN = re.compile(r"^ERROR: not found: (.+)$", re.M)
MARK = "STRATA_MUTANT"
"""A variable that the processes of one run have, to find those that left its process group."""


@dataclass(frozen=True)
class Ran:
    """What a run of pytest came to; `tests` are the entries of the tests that ended (mutant_watch.py)."""

    code: int | None
    """The exit code of pytest, negative for a signal; None where the limit was reached."""
    seconds: float
    tests: tuple[dict[str, Any], ...] = ()
    last: str = ""
    """The test that had begun last."""
    broken: str = ""
    """The first file of tests that could not be imported."""
    devices: Mapping[str, str] = field(default_factory=dict)
    unknown: tuple[str, ...] = ()
    """The ids among the arguments that pytest does not know."""
    output: str = ""

    @property
    def failed(self) -> list[str]:
        """The tests that failed."""
        return [one["id"] for one in self.tests if one["outcome"] == "failed"]


class Tree:
    """A copy of the clone `source` in `folder`, at one commit."""

    def __init__(self, source: Path, folder: Path, commit: str) -> None:
        """Make the copy, or bring the one that is there to this commit."""
        self.root = folder
        if not (folder / ".git").is_dir():
            shutil.rmtree(folder, ignore_errors=True)
            folder.parent.mkdir(parents=True, exist_ok=True)
            git("clone", "--quiet", "--shared", "--no-checkout", source, folder, folder=source)
        git("checkout", "--quiet", "--force", "--detach", commit, folder=folder)
        git("clean", "--quiet", "--force", "-d", folder=folder)
        self._link_packages(Path(sys.prefix))
        self._plugin = folder.parent / f"{folder.name}-plugin"
        shutil.rmtree(self._plugin, ignore_errors=True)
        self._plugin.mkdir()
        shutil.copy(PLUGIN, self._plugin)
        self._mark = uuid.uuid4().hex
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def stop(self) -> None:
        """End the run that is under way in another thread, if there is one, and let no other begin."""
        self._stopped = True
        if self._process is not None:
            end(self._process, self._mark)

    @property
    def python(self) -> Path:
        return self.root / ".venv" / "bin" / "python"

    def _link_packages(self, real: Path) -> None:
        """Make a virtual environment whose packages are those of `real`, and whose clone is this one.

        The one .pth file that leads to the clone does so by a relative path, and thus leads here.
        """
        made = self.root / ".venv"
        shutil.rmtree(made, ignore_errors=True)
        inside = Path("lib", f"python{sys.version_info.major}.{sys.version_info.minor}", "site-packages")
        for part in (Path("bin"), inside):
            (made / part).mkdir(parents=True)
            for entry in (real / part).iterdir():
                if part == inside or not entry.name.startswith("python"):
                    (made / part / entry.name).symlink_to(entry)
        for name in ("python", "python3"):
            (made / "bin" / name).symlink_to(os.path.realpath(sys.executable))
        for entry in real.iterdir():
            if entry.is_file():
                shutil.copy(entry, made)
        stamp = made / "strata.stamp"
        if stamp.is_file():
            stamp.write_text(f"{self.root}\n" + stamp.read_text().partition("\n")[2])

    @contextmanager
    def changed(self, file: str, text: str) -> Iterator[None]:
        """Have a file with another text; at the end it is as it was, its time included, so that bytecode fits."""
        path = self.root / file
        before, state = path.read_bytes(), path.stat()
        path.write_text(text, "utf-8", newline="")
        try:
            yield
        finally:
            path.write_bytes(before)
            os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))

    def run(
        self,
        arguments: Sequence[str],
        limit_s: float,
        cache: Path,
        *,
        cover: Sequence[str] = (),
        environment: Mapping[str, str] | None = None,
    ) -> Ran:
        """Run pytest; `cover` are folders whose lines are measured.

        It begins with a copy of `cache`, so that what a mutant leaves there is gone with it. Results that the product
        keeps on disk are not among it: a line that makes one would run in the first of all runs alone.
        """
        if self._stopped:
            raise StrataError("The run was stopped.")
        own = self.root.with_name(f"{self.root.name}-cache")
        link_copy(cache, own)
        log, words, output = (self._plugin / name for name in ("log.jsonl", "arguments", "output"))
        log.unlink(missing_ok=True)
        words.write_text("".join(f"{one}\n" for one in arguments), "utf-8")
        more = {
            "MUTANTS_LOG": str(log),
            "STRATA_CACHE": str(own),
            "PYTHONPATH": str(self._plugin),
            MARK: self._mark,
        }
        if cover:
            more |= {"MUTANTS_COVER": str(self.root), "MUTANTS_PARTS": " ".join(cover)}
        else:
            more["PYTHONDONTWRITEBYTECODE"] = "1"  # what a mutant compiles to is of use to no other run
        kept = {name: value for name, value in os.environ.items() if name not in ("CI", "STRATA_VERDICTS")}
        command = [self.python, "-P", "-m", "pytest", "-q", "--tb=line", "-p", "no:cacheprovider"]
        began = time.perf_counter()
        with output.open("wb") as stream:
            self._process = subprocess.Popen(
                [*command, "-p", PLUGIN.stem, *([] if cover else ["-x"]), f"@{words}"],
                cwd=self.root,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env={**kept, **(environment or {}), **more},
                start_new_session=True,
            )
            if self._stopped:
                self.stop()
            code = wait(self._process, limit_s, self._mark)
        seconds = time.perf_counter() - began
        return _read(log, code, seconds, output.read_text("utf-8", "replace"), self.root)


def wait(process: subprocess.Popen[bytes], limit_s: float, mark: str) -> int | None:
    """Return the exit code, None where the limit was reached; then nothing is left of what the process started."""
    try:
        return process.wait(limit_s)
    except subprocess.TimeoutExpired:
        return None
    finally:
        end(process, mark)


def end(process: subprocess.Popen[bytes], mark: str) -> None:
    """End a process, its group, and what it started outside of that."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for number in marked(mark):
        with suppress(ProcessLookupError, PermissionError):
            os.kill(number, signal.SIGKILL)


def marked(mark: str) -> list[int]:
    """Return the numbers of the processes that have this mark; [] on a system that shows no environments."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if f"{MARK}={mark}".encode() in path.read_bytes():
                found.append(int(path.parent.name))
    return found


def _read(log: Path, code: int | None, seconds: float, output: str, root: Path) -> Ran:
    lines = log.read_text("utf-8").splitlines() if log.is_file() else []
    entries: list[dict[str, Any]] = []
    for line in lines:
        with suppress(ValueError):  # the last one, of a process that was ended
            entries.append(json.loads(line))
    return Ran(
        code,
        seconds,
        tuple(one for one in entries if "id" in one),
        next((one["begin"] for one in reversed(entries) if "begin" in one), ""),
        next((one["broken"] for one in entries if "broken" in one), ""),
        next((one["devices"] for one in entries if "devices" in one), {}),
        tuple(os.path.relpath(one, root) for one in UNKNOWN.findall(output)),
        output,
    )


def require() -> None:
    """Raise UserError where mutants cannot be tried."""
    if os.name != "posix":
        raise UserError("--mutants needs process groups, which Windows has not: run it on Linux or macOS.")
    try:
        import coverage  # noqa: F401
    except ImportError:
        raise UserError(
            "--mutants needs the package coverage, which is not installed: ./strata --extras test brings it."
        ) from None


def link_copy(folder: Path, copy: Path) -> None:
    """Copy a folder, if there is one, by links to its files: they are written whole, never changed in place."""
    shutil.rmtree(copy, ignore_errors=True)
    if not folder.is_dir():
        return
    shutil.copytree(folder, copy, copy_function=os.link)
