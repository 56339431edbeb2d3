"""Study: the same frame with classic render passes, made ahead, and with dynamic rendering and barriers by hand.

Before Vulkan 1.3 drawing needed two kinds of objects. A VkRenderPass describes each attachment: its load operation, its
store operation, its layouts before, during and after the pass, and the dependencies of the pass. A VkFramebuffer names
the images. So each set of images needs a framebuffer, and a new size needs new ones. Each pipeline is created for a
render pass, or for one with the same formats.

Dynamic rendering states the attachments where a pass begins, and leaves layouts and waits to barriers. Nothing is
created ahead, and a pipeline depends on formats alone. So a pass can be disabled or inserted without new objects. A
frame graph does this all the time, which is why the chapter's graph uses dynamic rendering. Classic passes keep one
advantage: subpasses, which tell a tile-based GPU which pixels never leave the chip.

Both ways draw the same bits. `strata run -v` shows the costs on the CPU: nanoseconds around the draws of a frame, the
number of objects, and microseconds for objects that are created once or for each size. Neither is faster by much: on
Mesa's software driver three passes begin and end in 12 us both ways, and a new size takes 0.2 ms for two framebuffers
and 0.5 ms for barriers and attachments, nearly all of it Python that fills in structs.
"""

from __future__ import annotations

from dataclasses import dataclass

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

from .flags import Flag

STUDY = Study(
    title="render passes",
    idea="What a render pass fixes ahead, load, store, layouts, waiting, can be said when drawing begins: same bits.",
    order=8,
    features=("device/render-pass-flags",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    way: str = knob("classic", "how drawing begins and ends", choices=("classic", "dynamic"))


@dataclass
class PassWork(Work):
    """What a frame did, and the CPU's time for it: `begin_end_ns` in all passes together, without their draws.

    `objects` are render passes and framebuffers that exist. `made_us` is what it took to make what lasts, `sized_us`
    what depends on the picture's size, images aside; at a program's first time Python also learns the structs.
    """

    begin_end_ns: int = 0
    objects: int = 0
    made_us: int = 0
    sized_us: int = 0


SQUARES = 24
"""Squares that lie over one another; half of them are drawn in a pass, half in the next."""

SCENE, GOES_ON, SHOWN = range(3)
"""The passes: squares to a target, more squares to the same, and the target to the picture."""

FLAGS = (
    Flag.FIRST | Flag.OFFSCREEN | Flag.CLEAR_COLOR | Flag.CLEAR_DEPTH,
    Flag.OFFSCREEN | Flag.INTERNAL,
    Flag.FIRST | Flag.LAST,
)
"""What each of them is among the passes of its target."""

FORMATS = (("rgba8", "d32f"), ("rgba8", "d32f"), ("rgba8", None))
"""Colour and depth of each."""

CLEAR_COLOR = (0.05, 0.05, 0.06, 1.0)
CLEAR_DEPTH = 0.0
