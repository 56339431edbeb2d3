"""Commands in one child process: what stands in the environment before a driver is loaded needs a new process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from common.paths import ROOT

CHILD = """
import json, os, sys
from chapters.__main__ import run
for words, changes in json.loads(sys.argv[1]):
    for name, value in changes.items():
        os.environ.pop(name, None) if value is None else os.environ.update({name: value})
    code = run(words)
    for stream in (sys.stdout, sys.stderr):
        print(code, end="\\0", file=stream, flush=True)
"""


@dataclass(frozen=True)
class Done:
    """A command's exit code, and what it printed."""

    returncode: int
    stdout: str
    stderr: str


def commands(
    *commands: tuple[tuple[str, ...], Mapping[str, str | None]], cwd: Path, **variables: str
) -> list[Done]:
    """Run commands one after the other in one child, without a display and outside the clone.

    Each has its words and what changes in the environment before it; None takes a variable away.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        environment.pop(name, None)
    child = [sys.executable, "-P", "-c", CHILD, json.dumps(commands)]
    ran = subprocess.run(
        child, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert ran.returncode == 0, ran.stderr
    printed = [stream.split("\0")[:-1] for stream in (ran.stdout, ran.stderr)]
    return [_done(out, err) for out, err in zip(*printed, strict=True)]


def _done(out: str, err: str) -> Done:
    """Take the exit code, which is the last line, off what was printed."""
    lines, said = out.rpartition("\n"), err.rpartition("\n")
    return Done(int(lines[2]), lines[0] + lines[1], said[0] + said[1])
