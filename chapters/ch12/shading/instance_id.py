"""The instance-id pass: which object is nearest at each pixel, drawn only if it is an output."""

from __future__ import annotations

from typing import Literal

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..scene.packing import Variant, shape_alone
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..taa import model as taa
from . import views
from .objects import ObjectsPass


class InstanceIdPass(ObjectsPass):
    """Draws the solid objects again where their depth equals that of the forward pass: those are the visible ones.

    Transparent objects are left out: at their pixels the id is that of what shines through. Where the forward pass has
    several samples a pixel, none of them in its centre, or no depth since it counts, this pass finds out by a depth of
    its own which object is the nearest there, of all objects: culling looked at the samples. So ids and depth are the
    same to the bit, whatever the picture is.
    """

    name = "instance_id"
    shape_only = True

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        depth_of_frame = views.depth_target(parts.settings) == "depth"
        self._steady = (("STEADY_VIEW", 1),) * taa.in_use(parts.settings)
        """Ids are those of the view without jitter, with a depth that no other pass reads."""
        own_depth = not depth_of_frame or bool(self._steady)
        ids = Access("instance_id", "color", format="r32ui", clear=(0, 0, 0, 0))
        depth = Access("depth_of_ids" if self._steady else "depth", "depth", format="d32f", clear=(0.0,))
        self.reads = () if own_depth else (Access("depth", "depth"),)
        self.writes = (ids, depth) if own_depth else (ids,)
        self._depth: Literal["write", "equal"] = "write" if own_depth else "equal"
        self.phases = () if own_depth else self.phases

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the scene has instances; the outputs decide whether the pass is used."""
        return len(scene.instances) > 0

    def describe(self, variant: Variant) -> PipelineDescription:
        """Return the pipeline: one for all opaque materials."""
        shape = shape_alone(variant)
        return PipelineDescription(
            shaders=("shading/forward.vert", "shading/instance_id.frag"),
            defines=(*shape.defines, *self._data.texture_defines(shape, shape_alone), *self._steady),
            color="r32ui",
            depth=self._depth,
            name="instance id",
        )


class CentreDepthPass(InstanceIdPass):
    """Draws the depth in the centres of pixels with the jitter, where the forward pass has several samples a pixel.

    Motion vectors and the history need that depth, and ids have another one, without jitter.
    """

    name = "centre_depth"

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self._steady = ()
        ids = Access("ids_of_centres", "color", format="r32ui", clear=(0, 0, 0, 0))
        self.writes = (ids, Access("depth", "depth", format="d32f", clear=(0.0,)))

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is a jitter, and no other pass draws that depth."""
        alone = taa.in_use(settings) and views.depth_target(settings) != "depth"
        return alone and InstanceIdPass.needed(scene, settings)
