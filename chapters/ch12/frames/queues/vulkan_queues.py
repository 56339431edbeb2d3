"""The queues that the frame graph names, and the fields of barriers for queue family ownership transfers.

"graphics" is the device's main queue. "compute" is a queue of another family, without graphics, if the device has one
and the settings use it. Otherwise both names mean the same queue, and there are no transfers.
"""

from __future__ import annotations

from collections.abc import Callable

from backends.vulkan import api as vk
from backends.vulkan.device import Device, Queue

from ...graph.types import Barrier


class Queues:
    """The queues by their names in the graph; with `own`, compute has its own queue if the device has one."""

    def __init__(self, device: Device, own: bool = False) -> None:
        self.device = device
        compute = device.compute_queue if own else None
        self.of: dict[str, Queue] = {"graphics": device.queue, "compute": compute or device.queue}

    @property
    def families(self) -> tuple[int, ...]:
        """The families that share the buffers of both queues; () if there is only one family."""
        distinct_families = dict.fromkeys(queue.family for queue in self.of.values())
        return tuple(distinct_families) if len(distinct_families) > 1 else ()

    def taking(self, barrier: Barrier, masks: dict[str, int]) -> dict[str, int]:
        """Return the fields of a barrier before a step; `masks` are the stages and accesses.

        If another queue hands the resource over, this is the acquire half of the transfer. A semaphore orders the two
        queues, and makes the writes of the other queue available. The source stages are those of the step: they waited
        for the semaphore, so the layout transition comes after it. Stages of the other queue are not named, since this
        queue may not have them.
        """
        if barrier.hand_over is not None and len({*barrier.hand_over}) > 1:
            masks = masks | {"srcStageMask": masks["dstStageMask"], "srcAccessMask": 0}
        return masks | self._owners(barrier)

    def giving(self, barrier: Barrier, masks: dict[str, int]) -> dict[str, int]:
        """Return the fields of the release half, after the last step of the queue that hands the resource over."""
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
