"""Ask Strata itself what this machine draws with: the program's own probe, in the clone's `.venv`."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
QUESTION = ("-P", "-m", "backends.answer")
TIMEOUT_S = 180.0  # the program asks each driver in a child process, with shorter limits
PATIENCE_S = 2.0  # after that the user is told what takes so long
ADVICE = ": ./strata doctor says what to install"


@dataclass(frozen=True)
class Device:
    """What one backend draws with; `kind` is "" where it cannot, and `problem` says why in a sentence."""

    kind: str = ""  # "discrete", "integrated", "virtual", "software", "other"
    name: str = ""
    problem: str = ""
    libraries: tuple[str, ...] = ()  # those that the dynamic loader does not find


@dataclass(frozen=True)
class Graphics:
    """The program's answer, as plain values; a test writes one down for a machine that it has not got."""

    vulkan: Device = Device(problem="No Vulkan 1.3 device was found.")
    gl: Device = Device(problem="No OpenGL 4.5 was found.")
    auto: str = ""  # the backend that is taken, "vulkan" or "gl"; "" where nothing can draw
    layers: frozenset[str] = frozenset()  # Vulkan layers that the loader lists
    unanswered: str = ""  # why there is no answer, to stand after a colon

    @property
    def in_hardware(self) -> bool:
        """Whether a graphics card draws."""
        chosen = {"vulkan": self.vulkan, "gl": self.gl}.get(self.auto, Device())
        return chosen.kind not in ("", "software")


def ask(
    python: Path | str,
    say: Callable[[str], None] = lambda text: None,
    question: Sequence[str] = QUESTION,
    timeout_s: float = TIMEOUT_S,
    patience_s: float = PATIENCE_S,
) -> Graphics:
    """Return the answer of the program that `python` runs; `say` is told where that takes long."""
    # STRATA_DEVICE picks one device; here the question is whether there is any.
    variables = {name: value for name, value in os.environ.items() if name != "STRATA_DEVICE"}
    variables["PYTHONPATH"] = str(ROOT)
    command = [str(python), *question]
    try:
        with subprocess.Popen(
            command,
            env=variables,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:
            try:
                output, errors = _communicate(process, say, timeout_s, patience_s)
            except BaseException:
                process.kill()
                raise
    except subprocess.TimeoutExpired:
        return Graphics(unanswered=f"no answer came within {timeout_s:g} s")
    except OSError as error:
        return Graphics(unanswered=f"{python} did not start ({error.strerror})")
    try:
        return read(json.loads(output.decode("utf-8", "replace").splitlines()[-1]))
    except (ValueError, IndexError, KeyError, TypeError, AttributeError):
        last = (errors.decode("utf-8", "replace").strip().splitlines() or ["no word of why"])[-1]
        return Graphics(unanswered=f"the question ended with exit code {process.returncode} and {last}")


def _communicate(
    process: subprocess.Popen[bytes], say: Callable[[str], None], timeout_s: float, patience_s: float
) -> tuple[bytes, bytes]:
    try:
        return process.communicate(timeout=min(patience_s, timeout_s))
    except subprocess.TimeoutExpired:
        say("Waiting for the answers of the graphics drivers.")
        return process.communicate(timeout=max(timeout_s - patience_s, 0.0))


def read(answer: dict[str, Any]) -> Graphics:
    """Return the record of an answer of `backends.answer`; raises KeyError or TypeError for anything else."""
    return Graphics(
        vulkan=_device(answer["vulkan"]),
        gl=_device(answer["gl"]),
        auto=str(answer["auto"].get("backend", "")),
        layers=frozenset(map(str, answer["layers"])),
    )


def why_not(device: Device, what: str) -> str:
    """Return why there is no `what` ("Vulkan 1.3 device"), without a full stop; missing libraries are named."""
    if device.libraries:
        are = "is" if len(device.libraries) == 1 else "are"
        return f"No {what} was found ({' and '.join(device.libraries)} {are} missing)"
    return device.problem.removesuffix(".").removesuffix(ADVICE)


def _device(found: dict[str, Any]) -> Device:
    return Device(
        kind=str(found.get("kind", "")),
        name=str(found.get("name", "")),
        problem=str(found.get("problem", "")),
        libraries=tuple(map(str, found.get("libraries", ()))),
    )
