"""The stage of this chapter's studies on Vulkan: what all studies share, with this chapter's graphics layer."""

from __future__ import annotations

from backends.vulkan.stage import Graphics
from backends.vulkan.stage import Stage as AnyStage

from ..graphics.commands import Commands, Rendering
from ..graphics.descriptors import Descriptors
from ..graphics.frames import Frames
from ..graphics.pipelines import Pipelines
from ..graphics.profiler import Profiler
from ..graphics.resources import target_usage
from ..logic import frame


class Stage(AnyStage):
    """A study of this chapter on Vulkan."""

    frame_logic = frame
    graphics = Graphics(Frames, Commands, Rendering, Descriptors, Pipelines, Profiler, target_usage)
    pipelines: Pipelines
    descriptors: Descriptors
