"""The passes of motion vectors, after the last pass that writes depth.

    motion          depth -> motion_camera: the camera's motion, at each pixel
    motion_objects  motion_camera, depth -> motion: over it, the objects that move or deform

The frame has them only if a pass reads motion, or it is an output. Transparent objects have no motion of their own: at
their pixels the vector is that of what shines through.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backends.contract import Access
from common.scene import Scene

from ..frames.commands import Commands, DrawGroup
from ..frames.frame import SLOTS
from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.draw_lists import Batch
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading import views
from ..shading.objects import ObjectsPass
from .model import CAMERA, FORMAT, MOTION, OBJECTS


class MotionPass(FullscreenPass):
    """Writes for each pixel how far the camera has moved its surface, as if all surfaces stood still."""

    name = "motion"
    reads = (Access("depth", "sampled"),)
    writes = (Access(CAMERA, "color", format=FORMAT),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is a depth: in a scene without instances, some paths have none (shading/instance_id.py)."""
        return len(scene.instances) > 0 or views.depth_target(settings) == "depth"

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        shaders = ("post/fullscreen.vert", "motion/camera.frag")
        return PipelineDescription(shaders, color=FORMAT, depth=None, name="motion of the camera")


class MotionObjectsPass(ObjectsPass):
    """Draws the solid objects that move or deform over the camera's motion, where their depth is that of the frame.

    It draws the lists of the frame. Vertices of objects that stand still are clipped; if nothing moves, nothing is
    drawn.
    """

    shape_only = True
    name, reads = OBJECTS, (Access("depth", "depth"),)
    writes = (Access(MOTION, "color", format=FORMAT, of=CAMERA),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._deforms = bool(parts.scene.deformations)
        self.active = False
        """Whether any object has moved since the frame before (motion/technique.py)."""
        if (
            views.depth_target(parts.settings) != "depth"
        ):  # the instance-id pass draws all objects into this depth
            self.phases = ()

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the scene has instances: any of them may be moved by an edit."""
        return len(scene.instances) > 0

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: one for all opaque materials, and masks are asked as in every other pass."""
        needed = shape_alone(variant)
        return PipelineDescription(
            name="motion of objects",
            shaders=("shading/forward.vert", "motion/objects.frag"),
            defines=(("MOTION", 1), *needed.defines, *self._data.texture_defines(needed, shape_alone)),
            depth="equal",
            color=FORMAT,
        )

    def _group(self, batch: Batch) -> DrawGroup:
        """Return the group of a batch, with the page of the frame before if vertices deform."""
        group = super()._group(batch)
        if not self._deforms:
            return group
        return replace(group, previous=self._data.page_buffer((self._draws.slot + 1) % SLOTS, batch.page))

    def record(self, commands: Commands) -> None:
        """Record the draws, if any object has moved."""
        if self.active:
            self.record_solid(commands)

    def key(self, slot: int) -> Any:
        """Return what the recording depends on: the lists only if they are drawn."""
        return super().key(slot) if self.active else False
