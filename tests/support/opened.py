"""Devices that the tests of one chapter share: each kind is opened once, and what a module leaves alive is an error.

A module borrows a device and gives it back as it got it. Objects that a device keeps for itself (blocks of memory, the
buffer of OpenGL's push constants) are not the module's. A device on which something is left is not lent again.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any

from backends.gl.context import Context
from backends.vulkan.device import Device
from common.errors import DeviceError


def left_on(device: Device | Context) -> list[str]:
    """Return the names of what is alive on a device, without what it keeps for itself."""
    own: set[Any] = set()
    if isinstance(device, Device):
        device.wait_idle()
        device.memory.close()  # the next allocation takes new blocks
    else:
        own.add(("buffer", device._push))
    return [f"{key[0]} '{name}'" if name else key[0] for key, name in device.alive.items() if key not in own]


class Opened:
    """The devices that are open: those of one place, which is a chapter or another folder of tests."""

    def __init__(self) -> None:
        self._place: Hashable = None
        self._idle: dict[Hashable, list[Any]] = {}

    @contextmanager
    def lent(self, place: Hashable, kind: Hashable, open_: Callable[[], Any]) -> Iterator[Any]:
        """Lend a device of a kind; `open_` makes one where none is idle. Raises DeviceError for what is left on it."""
        if place != self._place:
            self.close()
            self._place = place
        idle = self._idle.setdefault(kind, [])
        device = idle.pop() if idle else open_()
        try:
            yield device
        finally:
            if left := left_on(device):
                raise DeviceError(f"{len(left)} objects outlived the tests of a file: {', '.join(left[:8])}.")
            idle.append(device)

    def close(self) -> None:
        """Close all that are idle."""
        idle, self._idle = self._idle, {}
        for devices in idle.values():
            for device in devices:
                device.close()
