"""The queues that the frame graph names, and what it takes to share with both of them what one family owns.

"graphics" is the device's main queue, "compute" one of a family that can do nothing else, where the device has it and
it is wanted; else both names mean the same queue, and all that is said here about families falls away.
"""

from __future__ import annotations

from collections.abc import Callable

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue

from ...graph.types import Barrier


class Queues:
    """Each queue by its name in the graph; with `own` compute has one of its own, if the device does."""

    def __init__(self, device: Device, own: bool = False) -> None:
        self.device = device
        beside = device.compute_queue if own else None
        self.of: dict[str, Queue] = {"graphics": device.queue, "compute": beside or device.queue}

    @property
    def families(self) -> tuple[int, ...]:
        """The families that share every buffer which both queues use; () where there is one, and nothing to share."""
        found = dict.fromkeys(queue.family for queue in self.of.values())
        return tuple(found) if len(found) > 1 else ()

    def taking(self, barrier: Barrier, masks: dict[str, int]) -> dict[str, int]:
        """Return the fields of a barrier in front of a step, of which `masks` are the stages and accesses.

        Of what another queue hands over, only what this one will do is named; between the two is a semaphore. The
        barrier waits for the stages in which the step goes on, since these are what waited for the semaphore: the
        change of layout comes behind them. Stages of the other queue, which this one may not even have, mean nothing
        to it, and all that they wrote the semaphore has made available.
        """
        if barrier.hand_over is not None and len({*barrier.hand_over}) > 1:
            masks = masks | {"srcStageMask": masks["dstStageMask"], "srcAccessMask": 0}
        return masks | self._owners(barrier)

    def giving(self, barrier: Barrier, masks: dict[str, int]) -> dict[str, int]:
        """Return the fields of the other half, behind the last step of who hands it over: what was done there."""
        return (
            masks | {"dstStageMask": vk.VK_PIPELINE_STAGE_2_NONE, "dstAccessMask": 0} | self._owners(barrier)
        )

    def _owners(self, barrier: Barrier) -> dict[str, int]:
        ends = [self.of[name].family for name in barrier.hand_over or ()]
        if len({*ends}) < 2:
            ends = [vk.VK_QUEUE_FAMILY_IGNORED] * 2
        return {"srcQueueFamilyIndex": ends[0], "dstQueueFamilyIndex": ends[1]}


Fields = Callable[[Barrier, dict[str, int]], dict[str, int]]
"""`Queues.taking` or `Queues.giving`."""
