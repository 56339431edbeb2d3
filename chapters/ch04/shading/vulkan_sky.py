"""The sky: the environment as it is seen where nothing was drawn."""

from __future__ import annotations

from backends.vulkan import api as vk
from common.scene import Scene

from ..environment import model
from ..frames.vulkan_commands import Commands
from ..pipelines.vulkan import Built, GraphicsPipeline, Pipelines
from ..settings import Settings
from .views import PICTURE


class Sky:
    """One triangle at infinity. It is a part of the forward pass: behind what is solid, before what is transparent."""

    def __init__(self, settings: Settings, pipelines: Pipelines) -> None:
        self._settings, self._pipelines = settings, pipelines

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is an environment, and it is to be seen: a view shows surfaces alone."""
        return settings.sky and settings.view == PICTURE and model.needed(scene, settings)

    def create(self) -> Built:
        """Build the pipeline and return it."""
        described = GraphicsPipeline(
            shaders=("post/fullscreen.vert", "shading/sky.frag"),
            color=self._settings.color_format,
            depth="test",
            samples=self._settings.msaa,
            name="sky",
        )
        self._pipeline = self._pipelines.get([described])[0]
        return self._pipeline

    def record(self, commands: Commands, frame_set: object) -> None:
        """Record the triangle."""
        commands.bind_pipeline(self._pipeline, vk.VK_CULL_MODE_NONE, vk.VK_FRONT_FACE_COUNTER_CLOCKWISE)
        commands.bind_set(self._pipeline, 0, frame_set)
        commands.draw_fullscreen()
