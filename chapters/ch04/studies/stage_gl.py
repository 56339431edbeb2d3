"""The stage of this chapter's studies on OpenGL: what all studies share, with this chapter's frames and pipelines."""

from __future__ import annotations

from backends.gl.stage import Graphics
from backends.gl.stage import Stage as AnyStage

from ..frames import frame
from ..frames.gl import Frames
from ..pipelines.gl import Pipelines


class Stage(AnyStage):
    """A study of this chapter on OpenGL."""

    frame_logic = frame
    graphics = Graphics(Frames, Pipelines)
    pipelines: Pipelines
