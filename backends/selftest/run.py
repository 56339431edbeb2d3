"""Tries each use of a driver once, in a child process: `python -m backends.selftest.run BACKEND NUMBER USE...`.

Drivers crash and hang, and a process that did so cannot say so. Hence one child tries all uses in turn, and tells
before and after each which one that is. Where the child dies or takes too long, that use has its verdict, and another
child goes on behind it. The parent never loads a driver. Each use computes something small whose result is known.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Sequence

from backends.features import MAIN_USES, OTHER_USES, REQUIRED_USES
from backends.selftest import verdicts
from backends.selftest.verdicts import OK, UNCHECKED, Identity, Verdicts
from common.errors import StrataError, UnsupportedError
from common.paths import ROOT

TIMEOUT_S = 20.0
"""A use takes a tenth of a second; on a busy machine where everything is compiled for the first time, a few."""

CHILD = (sys.executable, "-P", "-m", "backends.selftest.run")
WATCHED = "STRATA_ENDS_WITH"
"""The variable that tells a child that its standard input ends when its parent does."""

OPENED = "open"
"""The "use" of which a child tells first: the device is there."""

Told = Callable[[str, str], None]
"""Called with a use and "" before it is tried, and with its verdict after."""


def uses_of(backend: str, features: Iterable[str]) -> list[str]:
    """Return the "feature/use" names to try on a device with `features`: what chapters rely on comes first."""
    relied = [feature for feature in REQUIRED_USES if backend == "vulkan" or feature != "timeline-semaphore"]
    optional = sorted(set(features) - REQUIRED_USES.keys())
    return [
        f"{feature}/{use}"
        for feature in (*relied, *optional)
        for uses in (REQUIRED_USES, MAIN_USES, OTHER_USES)
        for use in uses.get(feature, ())
        if f"{feature}/{use}" not in NOT_BY_GL or backend == "vulkan"
    ]


NOT_BY_GL = {"pipeline-statistics/after-push-constants"}
"""Uses of features that OpenGL has, but in another way: it has no push constants."""


def module_of(backend: str, use: str) -> str:
    """Return the module that tries `use`: "sparse/cube-array" is `selftests.sparse_cube_array`."""
    name = use.replace("/", "_").replace("-", "_")
    return f"backends.{backend}.selftests.{name}"


# --- the parent -------------------------------------------------------------------------------------------------------


def child_environment() -> dict[str, str]:
    """Return the environment for a child process that imports from this clone, from whatever folder it starts in."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def judge_all(
    backend: str,
    number: int,
    uses: Sequence[str],
    told: Told = lambda use, verdict: None,
    *,
    timeout_s: float = TIMEOUT_S,
    child: Sequence[str] = CHILD,
) -> Verdicts:
    """Return the verdicts on `uses` of device `number` of the loader's list (0 on OpenGL).

    A use whose child crashed is tried once more alone: what came before it, or chance, may have done it.
    """
    command = (*child, backend, str(number))
    judged: Verdicts = {}

    def note(use: str, verdict: str) -> None:
        feature, _, what = use.partition("/")
        judged.setdefault(feature, {})[what] = verdict
        told(use, verdict)

    left = list(uses)
    while left:
        tried, verdict = _run(command, left, note, told, timeout_s)
        if verdict.startswith("crashed"):
            again, verdict = _run(command, left[max(tried, 0) :][:1], note, told, timeout_s)
            tried = -1 if again < 0 else max(tried, 0) + again
        if tried < 0:  # no device could be opened, whatever the use
            for use in left:
                note(use, verdict)
            break
        if verdict:
            note(left[tried], verdict)
            tried += 1
        left = left[tried:]
    return judged


def _run(
    command: Sequence[str], uses: Sequence[str], note: Told, told: Told, timeout_s: float
) -> tuple[int, str]:
    """Let one child try `uses`; return how many have a verdict, and "" or how the child ended at the next one.

    -1 stands for a child that could not open the device.
    """
    try:
        process = subprocess.Popen(
            [*command, *uses],
            stdin=subprocess.PIPE,  # it ends when this process does, however that is: see `begin_child`
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**child_environment(), WATCHED: "stdin"},
            start_new_session=True,  # Ctrl-C is for this process, which ends the child
        )
    except OSError as error:
        return -1, f"{UNCHECKED}: no process could be started ({error})"
    tried = -1
    with process:
        lines = _lines(process)
        try:
            opened = _verdict_in(lines, OPENED, timeout_s)
            if opened != OK:
                return tried, opened or crash(process.wait())
            for tried, use in enumerate(uses):
                told(use, "")
                verdict = _verdict_in(lines, use, timeout_s)
                if verdict is None:
                    return tried, crash(process.wait())
                note(use, verdict)
        except queue.Empty:
            return tried, f"hung (stopped after {timeout_s:g} s)"
        finally:
            process.kill()
    return len(uses), ""


def _lines(process: subprocess.Popen[bytes]) -> queue.Queue[bytes]:
    """Return a queue that gets each line that a process prints, and b"" at its end."""
    lines: queue.Queue[bytes] = queue.Queue()
    stream = process.stdout
    assert stream is not None

    def read() -> None:
        with contextlib.suppress(ValueError):  # the stream is closed when the process has been killed
            for line in stream:
                lines.put(line)
        lines.put(b"")

    threading.Thread(target=read, daemon=True).start()
    return lines


def _verdict_in(lines: queue.Queue[bytes], use: str, timeout_s: float) -> str | None:
    """Return the verdict on `use`, None where the output ends before it; raise queue.Empty where nothing comes."""
    while line := lines.get(timeout=timeout_s):
        with contextlib.suppress(ValueError, TypeError, KeyError):  # a driver that prints to stdout
            answer = json.loads(line)
            if answer["use"] == use:
                return str(answer["verdict"])
    return None


STOPPING = {
    int(getattr(signal, name))
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGKILL")
    if hasattr(signal, name)
}


def crash(code: int) -> str:
    """Return how a process ended whose exit code is `code`; Windows has large ones for what are signals elsewhere.

    A signal that people and systems send, and drivers do not, says nothing about the driver.
    """
    if -code in STOPPING:
        return f"{UNCHECKED}: the process that tried it was stopped (signal {-code})"
    if code >= 0:
        return f"crashed (exit code {code if code < 256 else hex(code)})"
    name = ""
    with contextlib.suppress(ValueError):
        name = f", {signal.Signals(-code).name}"
    return f"crashed (signal {-code}{name})"


def untried(backend: str, identity: Identity, advertised: Iterable[str]) -> list[str]:
    """Return the uses of a device of which no verdict is kept for its driver."""
    kept = verdicts.read(identity) or {}
    return [use for use in uses_of(backend, advertised) if _verdict(kept, use).startswith(UNCHECKED)]


def judge_device(
    backend: str,
    identity: Identity,
    number: int,
    advertised: Iterable[str],
    told: Told = lambda use, verdict: None,
    *,
    again: bool = False,
    timeout_s: float = TIMEOUT_S,
    child: Sequence[str] = CHILD,
) -> Verdicts:
    """Return the verdicts on a device: those kept for its driver, else (or with `again`) new ones, which are kept.

    Uses that could not be checked are kept as such and tried at the next call.
    """
    judged: Verdicts = {} if again else verdicts.read(identity) or {}
    missing = uses_of(backend, advertised) if again else untried(backend, identity, advertised)

    def note(use: str, verdict: str) -> None:
        told(use, verdict)
        if verdict:  # kept at once: whatever waits for this process may stop it
            feature, _, what = use.partition("/")
            judged.setdefault(feature, {})[what] = verdict
            verdicts.write(identity, judged)

    judge_all(backend, number, missing, note, timeout_s=timeout_s, child=child)
    return judged


def _verdict(judged: Verdicts, use: str) -> str:
    feature, _, what = use.partition("/")
    return judged.get(feature, {}).get(what, UNCHECKED)


# --- the child --------------------------------------------------------------------------------------------------------


def attempt(work: Callable[[], str]) -> str:
    """Return the verdict on a use by trying it in this process, which may end here; `work` says what was wrong."""
    try:
        wrong = work()
    except UnsupportedError as error:
        return f"{UNCHECKED}: {error}"
    except StrataError as error:  # a call that the driver refused
        return f"failed: {error}"
    except Exception as error:  # ours, not the driver's: a self-test with an error says nothing about it
        traceback.print_exc()
        return f"{UNCHECKED}: the self-test has an error, {type(error).__name__}: {error}"
    return f"wrong: {wrong}" if wrong else OK


def main(arguments: Sequence[str]) -> int:
    """Print the verdict on each use that `arguments` name, behind the backend and the number of the device."""
    backend, number, *uses = arguments
    begin_child()
    # As the driver says: a use that failed before is tried again here.
    with contextlib.ExitStack() as stack:
        opened = importlib.import_module(f"backends.{backend}.selftests.bench").Session
        try:
            session = stack.enter_context(opened(int(number)))
        except StrataError as error:
            tell(OPENED, f"{UNCHECKED}: {error}")
            return 0
        tell(OPENED, OK)
        for use in uses:

            def work(use: str = use) -> str:
                with session.bench() as bench:
                    wrong: str = importlib.import_module(module_of(backend, use)).run(bench)
                    return wrong

            verdict = attempt(work)
            tell(use, verdict)
            if verdict.startswith("failed"):
                os._exit(0)  # a device that was lost refuses the next use too: another child goes on
    return 0


def tell(use: str, verdict: str) -> None:
    """Print what the parent reads."""
    sys.stdout.write(json.dumps({"use": use, "verdict": verdict}) + "\n")
    sys.stdout.flush()


def begin_child() -> None:
    """Prepare a process that may crash or hang: it leaves no memory image on the disk, and ends with its parent."""
    if sys.platform != "win32":
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if os.environ.pop(WATCHED, "") == "stdin":
        threading.Thread(target=_end_with_stdin, daemon=True).start()


def _end_with_stdin() -> None:
    """End this process at the end of its standard input, also where its main thread hangs in a driver."""
    while os.read(0, 4096):
        pass
    os._exit(1)


if __name__ == "__main__":
    main(sys.argv[1:])
    os._exit(0)  # past the clean-up of libraries at exit, which says nothing about the use
