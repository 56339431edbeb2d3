"""Which backend draws on this machine: what was asked for, else hardware before software and Vulkan before OpenGL."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from backends.contract import BACKENDS
from backends.selftest import run, verdicts
from backends.selftest.verdicts import Identity
from common.errors import StrataError, UnsupportedError, UserError
from common.names import suggest
from common.reports import waiting

NOTHING = (
    "This machine has neither Vulkan 1.3 nor OpenGL 4.5: install the driver of its graphics card, or Mesa's software "
    "drivers (on Debian and Ubuntu: apt install mesa-vulkan-drivers libvulkan1 libegl1 libgl1), then ask "
    "./strata doctor."
)

NAMES = {"vulkan": "Vulkan", "gl": "OpenGL"}

Probe = Callable[[str], tuple[str, str]]
"""Given "vulkan" or "gl", returns (kind, name) of the device that would be used, or raises UnsupportedError."""


@dataclass(frozen=True)
class Choice:
    """The backend to use, and why, in a few words."""

    backend: str
    reason: str


identities: dict[str, Identity] = {}
"""Backend -> the driver of the device that `probe` found, under which verdicts are kept."""


@functools.cache
def probe(backend: str) -> tuple[str, str]:
    """Ask a backend for its device, and try that device where it was not tried yet.

    OpenGL is asked in a child process, which costs a third of a second. Vulkan is asked here: its loader only lists
    devices, as the renderer does next anyway. A driver's first trial takes seconds, and its verdicts are kept.
    """
    if backend == "gl":
        from backends.gl.driver.probe import ask

        probed = ask()
        _try_out("gl", probed.identity, 0, probed.advertised)
        reason = verdicts.unfit(verdicts.broken(probed.identity.driver, verdicts.read(probed.identity)))
        if reason:
            raise UnsupportedError(f"OpenGL on {probed.identity.device} cannot be used: {reason}.")
        identities["gl"] = probed.identity
        return probed.kind, probed.identity.device
    from backends.vulkan.device import capabilities
    from backends.vulkan.instance import Instance, choose

    with Instance() as instance:
        devices = instance.devices()
        tried: set[int] = set()
        while True:
            device = choose(devices)
            number = devices.index(device)
            if number in tried:
                identities["vulkan"] = device.identity
                return device.kind, device.name
            tried.add(number)  # where it is found unfit, `choose` takes the next one
            _try_out("vulkan", device.identity, number, capabilities(device, believe=True).features)


def _try_out(backend: str, identity: Identity, number: int, advertised: Collection[str]) -> None:
    """Try a device by self-tests where no verdicts are kept for its driver; say so if that takes long."""
    if not run.untried(backend, identity, advertised):
        return

    def sentence() -> str:
        kept = "once for this driver"
        if not verdicts.is_kept(identity):
            kept = f"at each start, since nothing can be kept in {verdicts.folder()}"
        return (
            f"trying what {NAMES[backend]} on {identity.device} can do, {kept}; a use that takes longer than "
            f"{run.TIMEOUT_S:g} s is stopped and counts as missing."
        )

    with waiting.told(sentence):
        run.judge_device(backend, identity, number, advertised)


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
        with suppress(StrataError):  # opening it says what is missing; its loader does not crash
            ask("vulkan")
        return Choice("vulkan", "asked for")
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
