"""Tries each use of what a device advertises in a child process: `python -m backends.vulkan.selftest USE NUMBER`.

Drivers crash and hang, and a process that did so cannot say so: hence one child per use, whose end is the verdict.
The parent never loads a driver. A child computes something small whose result is known, and prints one line of JSON.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

from backends import verdicts
from backends.contract import MAIN_USES, OTHER_USES
from backends.verdicts import OK, UNCHECKED, Identity, Verdicts
from common.errors import StrataError, UnsupportedError
from common.paths import ROOT

TIMEOUT_S = 30.0
"""A use takes a third of a second; a busy machine on which everything is compiled for the first time, a few."""

CHILD = (sys.executable, "-P", "-m", "backends.vulkan.selftest")


def uses_of(features: Iterable[str]) -> list[str]:
    """Return the "feature/use" names to try on a device with `features`, and what every device must have."""
    return [
        f"{feature}/{use}"
        for feature in sorted({*features, "timeline-semaphore"})
        for use in (*MAIN_USES.get(feature, ()), *OTHER_USES.get(feature, ()))
    ]


def module_of(use: str) -> str:
    """Return the module that tries `use`: "sparse/cube-array" is `selftests.sparse_cube_array`."""
    name = use.replace("/", "_").replace("-", "_")
    return f"backends.vulkan.selftests.{name}"


# --- the parent -------------------------------------------------------------------------------------------------------


def child_environment() -> dict[str, str]:
    """Return the environment for a child process that imports from this clone, from whatever folder it starts in."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def judge(use: str, number: int, timeout_s: float = TIMEOUT_S, child: Sequence[str] = CHILD) -> str:
    """Return the verdict on `use` on device `number` of the loader's list, by a child process."""
    try:
        done = subprocess.run(
            [*child, use, str(number)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            env=child_environment(),
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"hung (stopped after {timeout_s:g} s)"
    except OSError as error:
        return f"{UNCHECKED}: no process could be started ({error})"
    try:
        verdict = json.loads(done.stdout.decode("utf-8", "replace").splitlines()[-1])["verdict"]
    except (ValueError, IndexError, KeyError, TypeError):
        verdict = None
    if done.returncode == 0 and isinstance(verdict, str):
        return verdict
    return crash(done.returncode)


def crash(code: int) -> str:
    """Return how a process ended whose exit code is `code`; Windows has large ones for what are signals elsewhere."""
    if code >= 0:
        return f"crashed (exit code {code if code < 256 else hex(code)})"
    name = ""
    with contextlib.suppress(ValueError):
        name = f", {signal.Signals(-code).name}"
    return f"crashed (signal {-code}{name})"


def judge_all(
    uses: Sequence[str],
    number: int,
    progress: Callable[[str, str], None] = lambda use, verdict: None,
    *,
    at_once: int = 1,
    timeout_s: float = TIMEOUT_S,
    child: Sequence[str] = CHILD,
) -> Verdicts:
    """Return the verdicts on `uses`; `progress(use, verdict)` is called after each, from this thread.

    `at_once` children run beside each other: more than one only on a software driver, since a use that hangs a GPU
    takes the device away from its neighbours too.
    """
    found: Verdicts = {}
    with ThreadPoolExecutor(max(at_once, 1), thread_name_prefix="selftest") as pool:
        for use, verdict in zip(
            uses, pool.map(lambda use: judge(use, number, timeout_s, child), uses), strict=True
        ):
            feature, _, what = use.partition("/")
            found.setdefault(feature, {})[what] = verdict
            progress(use, verdict)
    return found


def judge_device(
    identity: Identity,
    number: int,
    advertised: Iterable[str],
    software: bool,
    progress: Callable[[str, str], None] = lambda use, verdict: None,
    *,
    again: bool = False,
    timeout_s: float = TIMEOUT_S,
    child: Sequence[str] = CHILD,
) -> Verdicts:
    """Return the verdicts on a device: those kept for its driver, else (or with `again`) new ones, which are kept.

    Uses that could not be checked are kept as such and tried at the next call.
    """
    wanted = uses_of(advertised)
    found: Verdicts = {} if again else verdicts.read(identity) or {}
    missing = [use for use in wanted if _verdict(found, use).startswith(UNCHECKED)]
    if missing:
        at_once = min(os.cpu_count() or 1, 4) if software else 1
        new = judge_all(missing, number, progress, at_once=at_once, timeout_s=timeout_s, child=child)
        for feature, uses in new.items():
            found.setdefault(feature, {}).update(uses)
        verdicts.write(identity, found)
    return found


def _verdict(found: Verdicts, use: str) -> str:
    feature, _, what = use.partition("/")
    return found.get(feature, {}).get(what, UNCHECKED)


# --- the child --------------------------------------------------------------------------------------------------------


def run(use: str, number: int) -> str:
    """Return the verdict on `use` by trying it in this process, which may end here."""
    from backends.vulkan.device import Device
    from backends.vulkan.instance import Instance
    from backends.vulkan.selftests.bench import Bench

    work = importlib.import_module(module_of(use))
    with Instance() as instance:
        physical = instance.devices()[number]
        # As the driver says: a use that failed before is tried again here.
        with Device(instance, physical, believe=True) as device, Bench(device) as bench:
            wrong = work.run(bench)
    return f"wrong: {wrong}" if wrong else OK


def main(arguments: Sequence[str]) -> int:
    """Print the verdict on the use and device that `arguments` name."""
    use, number = arguments[0], int(arguments[1])
    _leave_no_core()
    try:
        verdict = run(use, number)
    except UnsupportedError as error:
        verdict = f"{UNCHECKED}: {error}"
    except StrataError as error:  # a call that the driver refused
        verdict = f"failed: {error}"
    except Exception as error:  # ours, not the driver's: a self-test with an error says nothing about it
        traceback.print_exc()
        verdict = f"{UNCHECKED}: the self-test has an error, {type(error).__name__}: {error}"
    sys.stdout.write(json.dumps({"use": use, "verdict": verdict}) + "\n")
    sys.stdout.flush()
    return 0


def _leave_no_core() -> None:
    """A crash is expected here; its memory image would fill the user's disk."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    code = main(sys.argv[1:])
    os._exit(code)  # past the clean-up of libraries at exit, which says nothing about the use
