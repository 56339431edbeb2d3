"""Asks an OpenGL driver what it is: `python -m backends.gl.driver.probe` prints one line of JSON.

A driver can crash when a context is created. So a child process creates it, and nothing is loaded into the caller.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from backends.gl.context import NO_CONTEXT, Context
from backends.gl.driver import capabilities as gc
from backends.selftest.verdicts import Identity
from common.errors import StrataError, UnsupportedError
from common.paths import ROOT

TIMEOUT_S = 30.0
CHILD = (sys.executable, "-P", "-m", "backends.gl.driver.probe")


@dataclass(frozen=True)
class Found:
    """The device behind OpenGL 4.5, and the features of which its driver says that it has them."""

    kind: str
    identity: Identity
    advertised: tuple[str, ...]


def ask(child: Sequence[str] = CHILD, timeout_s: float = TIMEOUT_S) -> Found:
    """Return the device behind OpenGL 4.5; raise UnsupportedError with one sentence if there is none.

    A driver that crashes or hangs counts as none. What self-tests say about it is not asked here.
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
        device_found = None
        if not problem:
            device = Identity(*(str(answer[name]) for name in ("device", "driver", "build")))
            device_found = Found(str(answer["kind"]), device, tuple(map(str, answer["advertised"])))
    except (ValueError, IndexError, KeyError, AttributeError):
        problem, device_found = NO_CONTEXT.format(f"its driver crashed, exit code {done.returncode}"), None
    if device_found is None:
        raise UnsupportedError(str(problem))
    return device_found


def main() -> None:
    """Print what a context says of itself, or the sentence on why there is none."""
    answer: dict[str, Any]
    try:
        with Context(believe=True) as context:
            capabilities = context.capabilities
            answer = {
                "kind": capabilities.kind,
                **asdict(gc.identity(capabilities)),
                "advertised": sorted(capabilities.features),
            }
    except StrataError as error:
        answer = {"problem": str(error)}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
    os._exit(0)  # past the clean-up of libraries at exit, which may crash after the answer is out
