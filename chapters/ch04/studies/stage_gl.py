"""The stage of this chapter's studies on OpenGL: what all studies share, with this chapter's frames and pipelines."""

from __future__ import annotations

from backends.gl.stage import Graphics
from backends.gl.stage import Stage as AnyStage

from ..gl.frames import Frames
from ..gl.pipelines import Pipelines
from ..logic import frame


class Stage(AnyStage):
    """A study of this chapter on OpenGL."""

    frame_logic = frame
    graphics = Graphics(Frames, Pipelines)
    pipelines: Pipelines
