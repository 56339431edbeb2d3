"""Motion vectors without a device: their format, their names, and what must be known to draw them.

A motion vector is the current position in the picture minus the previous one, in uv units (0 to 1, row 0 on top) and
without jitter. It is exactly zero where nothing moves under a camera that stands still. A previous position that no
picture can show, behind the camera, gives FARTHEST in both components.
"""

from __future__ import annotations

from collections.abc import Collection

from ..post.finish import has_motion_blur
from ..settings import Settings
from ..taa import model as taa

FORMAT = "rg16f"
"""Half floats: a vector is rounded by at most 2^-11 of its length, and by 2^-25 where it is nearly zero."""

CAMERA, MOTION = "motion_camera", "motion"
"""The motion of the camera alone, and with that of objects: the output."""

OBJECTS = "motion_objects"
"""The name of the pass that draws objects that move, and of the counter of such objects."""

FARTHEST = 64.0
"""The largest component of a vector, in widths and heights of the picture. It points far outside of the picture."""


def in_use(settings: Settings, outputs: Collection[str]) -> bool:
    """Whether a frame has motion vectors. Subjects that read them state their condition here.

    The answer decides the synchronization of deforming vertices: with motion vectors the frame after reads them, too.
    """
    return MOTION in outputs or taa.in_use(settings) or has_motion_blur(settings)
