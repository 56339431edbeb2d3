"""Study: the same frames paced by two timelines, and by fences and semaphores that know only yes and no.

A kernel writes a field of numbers on the compute queue, and a shader shows it on the graphics queue. The field exists
once, so three things must be waited for: the shader for the kernel of its frame, the kernel for the shader of the frame
before, and the CPU, which records into slots that take turns, for the frame that had the slot last.

[`fences.py`](fences.py) does it as before Vulkan 1.2. A binary semaphore is signalled by one submission and waited for
by one other, so each pair of submissions needs one for itself, in each slot; a fence is all that the CPU can wait for,
and has to be reset. [`timelines.py`](timelines.py) has one counter for each queue: everybody waits for a value of it,
and how many do, or how late, makes no difference. Who else needs the field, a third queue say, costs nothing more; with
binary semaphores the kernel would have to signal one more, and somebody to wait for it in each frame.

All ways draw the same bits. `strata run -v` shows what each of them takes: objects, waits, and the CPU's nanoseconds
for waiting and for submitting. Speed is no argument for either: on Mesa's software driver a wait that is over takes
6 us by a fence and 12 us by a timeline, most of it Python, and both submissions of a frame 110 us in either way (220 us
with `way=timelines-1.2`, the older call, whose structs are made anew for each). What is gained is that there is less to
get wrong. Devices without timelines could pace their frames by fences like this; those with Vulkan 1.2 all have them,
which is why the chapter's renderer has no other way.
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
    """What pacing took: `wait_ns` and `submit_ns` of the CPU, the first with the time that the GPU still needed.

    `objects` are semaphores and fences that exist. `cpu_waits` and `queue_waits` are what the CPU and the queues waited
    for in this frame, `calls` those with which it was paced and submitted.
    """

    wait_ns: int = 0
    submit_ns: int = 0
    objects: int = 0
    cpu_waits: int = 0
    queue_waits: int = 0
    calls: int = 0
