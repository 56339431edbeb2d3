"""Study: the same frames paced by two timeline semaphores, and by fences and binary semaphores.

A kernel writes a field of numbers on the compute queue, and a shader shows it on the graphics queue. The field exists
once, so there are three waits. The shader waits for the kernel of its frame. The kernel waits for the shader of the
frame before. The CPU, which records into slots that take turns, waits for the last frame of the slot.

[`fences.py`](fences.py) does it as before Vulkan 1.2. A binary semaphore is signalled by one submission and waited for
by one other, so each pair of submissions needs its own, in each slot. The CPU can wait only for a fence, which has to
be reset. [`timelines.py`](timelines.py) has one counter for each queue: every wait is for a value of it, and the number
of waits and their times make no difference. Another reader of the field, a third queue for example, costs nothing more.
With binary semaphores the kernel would have to signal one more, and some submission to wait for it in each frame.

All ways draw the same bits. `strata run -v` shows the costs of each: objects, waits, and the CPU's nanoseconds for
waiting and for submitting. Speed is no argument for either. On Mesa's software driver a wait that is over takes 6 us by
a fence and 12 us by a timeline, most of it Python. Both submissions of a frame take 110 us in either way (220 us with
`way=timelines-1.2`, the older call, whose structs are made again for each). The gain is that less can go wrong. Devices
without timelines could pace their frames by fences like this. Those with Vulkan 1.2 all have timelines, so the
chapter's renderer has no other way.
"""

from __future__ import annotations

from dataclasses import dataclass

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="timeline or fences",
    idea="One counter per queue takes the place of a fence for each slot and a semaphore for each pair: same bits.",
    order=6,
    features=("timeline/support-fallback", "timeline/gpu-submit"),
)

CELLS = 64
"""Numbers along an edge of the field."""

WAYS = ("timelines", "timelines-1.2", "fences")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    way: str = knob("timelines", "what the frames are paced by", choices=WAYS)


@dataclass
class PaceWork(Work):
    """The costs of pacing: `wait_ns` and `submit_ns` of the CPU, the first including the time that the GPU still
    needed.

    `objects` are existing semaphores and fences. `cpu_waits` and `queue_waits` are the waits of the CPU and of the
    queues in this frame, `calls` the calls for pacing and submission.
    """

    wait_ns: int = 0
    submit_ns: int = 0
    objects: int = 0
    cpu_waits: int = 0
    queue_waits: int = 0
    calls: int = 0
