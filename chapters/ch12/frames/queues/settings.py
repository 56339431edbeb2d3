"""The knob of the queues."""

from __future__ import annotations

from dataclasses import dataclass

from common.settings import knob


@dataclass
class QueueSettings:
    """Which queues a frame uses."""

    async_compute: bool = knob(True, "whether compute work has a queue of its own, where the device has one")
