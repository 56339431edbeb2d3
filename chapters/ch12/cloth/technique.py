"""The cloth technique: it finds the cloths of a scene, anchors them, and prepares their pass for each frame."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Pose, Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .passes import ClothPass
from .scene import cloth_scene


class ClothTechnique(Technique):
    """The cloths of a scene. The drawn scene is a view of it, in which each cloth has vertices of its own."""

    name = "cloth"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._settings = settings  # the user's object: the wind may change in each frame
        self._cloth_scene = cloth_scene(scene, settings.cloth.enabled)
        self.scene = self._cloth_scene.scene
        self._reset = ""
        self.cloth: ClothPass | None = None
        """The pass, after `create`."""

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass, and declare in the passes that draw objects that they read its vertices."""
        kernels = backend.part(__package__).ClothKernels(backend)
        self.cloth = ClothPass(self._cloth_scene, self._settings.cloth, parts, kernels)
        self.cloth.add_to(passes)
        self.passes = {self.cloth.name: self.cloth}

    def pose(self, pose: Pose) -> Pose:
        """Return the pose of the view: cloths stay at their anchors, whatever their nodes do."""
        return self._cloth_scene.pose(pose)

    def prepare(self, frame: FrameInfo) -> int:
        """Find the steps that are due, and write their input; return the bytes written."""
        assert self.cloth is not None, "frames come after `create`"
        reset, self._reset = self._reset, ""
        written = self.cloth.prepare(
            frame.slot, frame.pose, frame.view, frame.picture, frame.time, reset, frame.passes
        )
        self.work = self.cloth.work
        return written

    def resting(self, time: float) -> bool:
        """Whether no cloth would move in a frame at `time`."""
        return self.cloth is None or not self.cloth.busy(time)

    def reset(self, reason: str) -> None:
        """Note why the next frame has no history; cloth starts anew for most reasons (`steps.KEEPS_ON`)."""
        self._reset = reason

    def close(self) -> None:
        """Free the buffers."""
        if self.cloth is not None:
            self.cloth.close()
