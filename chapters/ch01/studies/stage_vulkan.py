"""The stage of this chapter's studies on Vulkan: what all studies share, with this chapter's graphics layer."""

from __future__ import annotations

from backends.vulkan.stage import Graphics
from backends.vulkan.stage import Stage as AnyStage

from ..frames import frame
from ..frames.vulkan import Frames
from ..frames.vulkan_commands import Commands, Rendering
from ..frames.vulkan_profiler import Profiler
from ..frames.vulkan_resources import target_usage
from ..pipelines.vulkan import Pipelines
from ..pipelines.vulkan_descriptors import Descriptors


class Stage(AnyStage):
    """A study of this chapter on Vulkan."""

    frame_logic = frame
    graphics = Graphics(Frames, Commands, Rendering, Descriptors, Pipelines, Profiler, target_usage)
    pipelines: Pipelines
    descriptors: Descriptors

    def make_pipelines(self) -> Pipelines:
        """Return what builds pipelines, from the layouts of the study's descriptor sets."""
        return Pipelines(self.device, self.descriptors)
