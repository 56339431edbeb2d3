"""The bokeh pass: every point that is out of focus becomes a disc."""

from __future__ import annotations

from backends.contract import Access
from common.scene import Scene

from ..pipelines.gl import GraphicsPipeline
from ..settings import Settings
from . import lens
from .gl_fullscreen import FullscreenPass


class BokehPass(FullscreenPass):
    """The second of the lens's three passes, at half the size: what is behind the focus, and what is before it."""

    name = "bokeh"
    reads = (Access("dof_half", "sampled"), Access("dof_part", "sampled"))
    writes = (
        Access("dof_blurred", "color", format=lens.FORMAT, scale=0.5),
        Access("dof_near", "color", format=lens.FORMAT, scale=0.5),
    )

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the lens has an opening, and there is anything before it."""
        return lens.needed(scene, settings)

    def describe(self) -> GraphicsPipeline:
        """Return the pipeline."""
        return GraphicsPipeline(
            shaders=("post/fullscreen.vert", "post/bokeh.frag"),
            defines=lens.bokeh_defines(self._settings),
            depth=None,
            name="bokeh",
        )
