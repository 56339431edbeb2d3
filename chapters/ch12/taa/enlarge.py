"""The passes that enlarge what is drawn at a scale, for outputs and for passes behind `taa` (scale.py)."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.description import PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .scale import DRAWN, ENLARGE, ENLARGED

KINDS = {"depth": 0, "motion": 1}


class EnlargePass(FullscreenPass):
    """Writes at each pixel of the picture the nearest one of those that were drawn."""

    def __init__(self, parts: PassParts, image: str) -> None:
        super().__init__(parts)
        self.name, self._image, self._format = ENLARGE + image, image, ENLARGED[image]
        self.reads = (Access(image + DRAWN, "sampled"),)
        if image == "depth":
            self.writes = (Access(image, "depth", format=self._format, clear=(0.0,)),)
        else:
            self.writes = (Access(image, "color", format=self._format),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the scene has instances; the readers of the image decide whether the pass is used."""
        return model.scale(settings) < 1.0 and len(scene.instances) > 0

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        depth = self._image == "depth"
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "taa/enlarge.frag"),
            defines=(("IMAGE", KINDS[self._image]),),
            color=None if depth else self._format,
            depth="write" if depth else None,
            name=self.name.replace("_", " "),
        )
