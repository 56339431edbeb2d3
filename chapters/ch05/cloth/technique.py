"""Cloth outside its pass: it is found in the scene, anchored where its nodes hold it, and prepared for each frame."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import Pass, Technique
from common.scene import Pose, Scene

from ..frames.backend import Backend, FrameInfo
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .passes import ClothPass
from .scene import cloth_scene


class ClothTechnique(Technique):
    """The cloths of a scene, which is drawn as a view of it: each cloth has vertices of its own there."""

    name = "cloth"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._settings = settings  # the user's own: wind changes while frames are drawn
        self._found = cloth_scene(scene, settings.cloth)
        self.scene = self._found.scene
        self._reset = ""
        self.cloth: ClothPass | None = None
        """The pass, once it was made."""

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass, and let those that draw objects read what it writes."""
        kernels = backend.part(__package__).ClothKernels(backend)
        self.cloth = ClothPass(self._found, self._settings, parts, kernels)
        self.cloth.add_to(passes)
        self.passes = {self.cloth.name: self.cloth}

    def pose(self, pose: Pose) -> Pose:
        """Return the pose of the view: cloths stay where they are anchored, whatever their nodes do."""
        return self._found.pose(pose)

    def prepare(self, frame: FrameInfo) -> int:
        """Find out which steps have become due, and write what they need; return the bytes written."""
        assert self.cloth is not None, "frames come after `create`"
        reset, self._reset = self._reset, ""
        written = self.cloth.prepare(
            frame.slot, frame.pose, frame.view, frame.size, frame.time, reset, frame.passes
        )
        self.work = self.cloth.work
        return written

    def resting(self, time: float) -> bool:
        """Whether no cloth would be elsewhere at `time`."""
        return self.cloth is None or not self.cloth.busy(time)

    def reset(self, reason: str) -> None:
        """Let the next frame begin with cloth as it was modelled."""
        self._reset = reason

    def close(self) -> None:
        """Free the buffers."""
        if self.cloth is not None:
            self.cloth.close()
