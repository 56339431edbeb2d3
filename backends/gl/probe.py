"""Asks an OpenGL driver what it is, in a process of its own: `python -m backends.gl.probe` prints one line of JSON.

Drivers can crash where a context is made, and a process that did so cannot say so. Nothing is loaded into the caller.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence

from backends.gl.context import NO_CONTEXT, Context
from common.errors import StrataError, UnsupportedError
from common.paths import ROOT

TIMEOUT_S = 30.0
CHILD = (sys.executable, "-P", "-m", "backends.gl.probe")


def ask(child: Sequence[str] = CHILD, timeout_s: float = TIMEOUT_S) -> tuple[str, str]:
    """Return (kind, name) of the device behind OpenGL 4.5; raise UnsupportedError with one sentence if there is none.

    A driver that crashes or hangs counts as none.
    """
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    try:
        done = subprocess.run(
            child,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise UnsupportedError(NO_CONTEXT.format(f"its driver hung for {timeout_s:g} s")) from None
    except OSError as error:
        raise UnsupportedError(NO_CONTEXT.format(f"no process could be started to ask: {error}")) from None
    lines = done.stdout.decode("utf-8", "replace").splitlines()
    try:
        answer = json.loads(lines[-1])
        problem = answer.get("problem")
        found = None if problem else (str(answer["kind"]), str(answer["device"]))
    except (ValueError, IndexError, KeyError, AttributeError):
        problem, found = NO_CONTEXT.format(f"its driver crashed, exit code {done.returncode}"), None
    if found is None:
        raise UnsupportedError(str(problem))
    return found


def main() -> None:
    """Print what a context says of itself, or the sentence on why there is none."""
    try:
        with Context() as context:
            answer = {"kind": context.capabilities.kind, "device": context.capabilities.device}
    except StrataError as error:
        answer = {"problem": str(error)}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
    os._exit(0)  # past the clean-up of libraries at exit, which may crash after the answer is out
