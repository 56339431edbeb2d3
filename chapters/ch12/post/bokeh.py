"""The bokeh pass: every point that is out of focus becomes a disc."""

from __future__ import annotations

from backends.contract import Access, Sources

from ..pipelines.description import PipelineDescription
from ..scene.data import ARRAY_UNIT
from . import lens


class BokehPass(lens.LensPass):
    """The second of the lens's three passes, at half the size: what is behind the focus, and what is before it."""

    name = "bokeh"
    reads = (Access("dof_half", "sampled"), Access("dof_part", "sampled"))
    writes = (
        Access("dof_blurred", "color", format=lens.FORMAT, scale=0.5),
        Access("dof_near", "color", format=lens.FORMAT, scale=0.5),
    )
    sources = Sources(first={"texture": ARRAY_UNIT})

    def describe(self) -> PipelineDescription:
        """Return the pipeline."""
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "post/bokeh.frag"),
            defines=lens.bokeh_defines(self._settings),
            color=(lens.FORMAT, lens.FORMAT),
            depth=None,
            name="bokeh",
        )
