"""Devices that the tests of one chapter share: each kind is opened once, and what a module leaves alive is an error.

A module borrows a device and gives it back as it was: without objects, and with the attributes that it had. Objects
that a device keeps for itself (blocks of memory, the buffer of OpenGL's push constants) are not the module's. A device
that comes back otherwise is closed, which names what is left on it; the next module gets a new one.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from backends.gl.context import Context
from backends.vulkan.device import Device
from common.errors import DeviceError


def is_empty(device: Device | Context) -> bool:
    """Whether nothing is alive on a device but what it keeps for itself; its blocks of memory are freed."""
    if isinstance(device, Device):
        device.wait_idle()
        device.memory.close()  # the next allocation takes new blocks
        return not device.alive
    return device.alive.keys() <= {("buffer", device._push)}


def _attributes(device: Device | Context) -> dict[str, Any]:
    """Return what a test may replace for a while, and has to put back."""
    own = ("_push", "_closers")  # the buffer of push constants comes with the first of them
    return {
        **{name: value for name, value in vars(device).items() if name not in own},
        "fn._trace": vars(device.fn).get("_trace"),
        "sink.callbacks": [*device.sink.callbacks],
    }


class Opened:
    """The devices that are open: those of one place, which is a chapter or another folder of tests."""

    def __init__(self) -> None:
        self._place: Hashable = None
        self._idle: dict[Hashable, list[Any]] = {}

    @contextmanager
    def lent(self, place: Hashable, kind: Hashable, open_: Callable[[], Any]) -> Iterator[Any]:
        """Lend a device of a kind; `open_` makes one where none is idle.

        Raises DeviceError for objects that are left on the device, and for attributes that are others.
        """
        if place != self._place:
            self.close()
            self._place = place
        idle = self._idle.setdefault(kind, [])
        device = idle.pop() if idle else open_()
        before = _attributes(device)
        try:
            yield device
        finally:
            after = _attributes(device)
            changed = [name for name in after if name not in before or after[name] != before[name]]
            if place == self._place and is_empty(device) and not changed:
                idle.append(device)
            else:
                device.close()  # names what is left
            if changed:
                raise DeviceError(f"The tests of a file changed {', '.join(changed)} of a device for good.")

    def close(self) -> None:
        """Close all that are idle."""
        idle, self._idle = self._idle, {}
        with ExitStack() as stack:
            for devices in idle.values():
                for device in devices:
                    stack.callback(device.close)
