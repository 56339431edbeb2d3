"""Which backend draws on this machine: what was asked for, else hardware before software and Vulkan before OpenGL."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from backends.contract import BACKENDS
from common.errors import UnsupportedError, UserError
from common.names import suggest

NOTHING = (
    "This machine has neither Vulkan 1.3 nor OpenGL 4.5: install the driver of its graphics card, or Mesa's software "
    "drivers (on Debian and Ubuntu: apt install mesa-vulkan-drivers libvulkan1 libegl1), then ask ./strata doctor."
)

Probe = Callable[[str], tuple[str, str]]
"""Given "vulkan" or "gl", returns (kind, name) of the device that would be used, or raises UnsupportedError."""


@dataclass(frozen=True)
class Choice:
    """The backend to use, and why, in a few words."""

    backend: str
    reason: str


@functools.cache
def probe(backend: str) -> tuple[str, str]:
    """Ask a backend for its device. OpenGL is asked in a child process, which costs a third of a second.

    Vulkan is asked here: its loader only lists devices, as the renderer does next anyway.
    """
    if backend == "gl":
        from backends.gl.probe import ask

        return ask()
    from backends.vulkan.instance import Instance, choose

    with Instance() as instance:
        device = choose(instance.devices())
        return device.kind, device.name


def gpu_possible() -> bool:
    """Whether there may be a GPU at all, cheaply: on Linux every driver of one leaves a device file."""
    if not sys.platform.startswith("linux"):
        return True
    patterns = ("dri/renderD*", "nvidiactl", "nvidia[0-9]*", "dxg", "mali*", "kgsl*")
    return any(True for pattern in patterns for _ in Path("/dev").glob(pattern))


def decide(wanted: str = "auto", ask: Probe = probe, gpu: Callable[[], bool] = gpu_possible) -> Choice:
    """Choose a backend and say why; no OpenGL context is made where Vulkan has hardware, or where no GPU can be.

    Raises UserError for an unknown name, UnsupportedError with one sentence for a backend that is not there.
    """
    if wanted not in ("auto", *BACKENDS):
        near = suggest(str(wanted), ["auto", *BACKENDS])
        raise UserError(f"There is no backend {wanted!r}{near}" + ("" if near.endswith("?") else "."))
    if wanted == "vulkan":
        return Choice("vulkan", "asked for")  # opening it says what is missing; its loader does not crash
    if wanted == "gl":
        return Choice("gl", f"asked for, on {ask('gl')[1]}")
    vulkan, why_no_vulkan = _asked(ask, "vulkan")
    if vulkan and vulkan[0] != "software":
        return Choice("vulkan", f"Vulkan on {vulkan[1]}")
    if vulkan and not gpu():
        return Choice("vulkan", f"Vulkan's software driver, since there is no GPU ({vulkan[1]})")
    gl, why_no_gl = _asked(ask, "gl")
    if gl and gl[0] != "software":
        return Choice(
            "gl", f"OpenGL on {gl[1]}, since " + (why_no_vulkan or "Vulkan has a software driver only")
        )
    if vulkan:
        reason = f"Vulkan's software driver, since no GPU was found ({vulkan[1]})"
        return Choice("vulkan", f"{reason}, and {why_no_gl}" if why_no_gl else reason)
    if gl:
        return Choice("gl", f"OpenGL's software driver ({gl[1]}), since {why_no_vulkan}")
    raise UnsupportedError(NOTHING)


def choose(wanted: str = "auto", ask: Probe = probe, gpu: Callable[[], bool] = gpu_possible) -> str:
    """Return the backend to use, "vulkan" or "gl"; see `decide`."""
    return decide(wanted, ask, gpu).backend


def _asked(ask: Probe, backend: str) -> tuple[tuple[str, str] | None, str]:
    """Return a backend's device and "", or None and why there is none, to stand after "since"."""
    try:
        return ask(backend), ""
    except UnsupportedError as error:
        reason = str(error).rstrip(".")
        reason = reason.removesuffix(": ./strata doctor says what to install")
        return None, reason[0].lower() + reason[1:]
