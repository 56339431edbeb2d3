"""The sky: the environment as it is seen where nothing was drawn."""

from __future__ import annotations

from common.scene import Scene

from ..environment import model
from ..frames.gl_commands import Commands
from ..pipelines.gl import GraphicsPipeline, Pipelines
from ..scene.gl_data import SceneData
from ..settings import Settings
from .views import PICTURE


class Sky:
    """One triangle at infinity. It is a part of the forward pass: behind what is solid, before what is transparent."""

    def __init__(self, settings: Settings, data: SceneData, pipelines: Pipelines) -> None:
        self._data, self._pipelines = data, pipelines

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is an environment, and it is to be seen: a view shows surfaces alone."""
        return settings.sky and settings.view == PICTURE and model.needed(scene, settings)

    def create(self) -> None:
        """Build the pipeline."""
        described = GraphicsPipeline(
            shaders=("post/fullscreen.vert", "shading/sky.frag"), depth="test", name="sky"
        )
        self._pipeline = self._pipelines.get([described])[0]

    def record(self, commands: Commands) -> None:
        """Draw the triangle; its texture is bound with what all draws of the frame read."""
        commands.bind_pipeline(self._pipeline, cull=False, front="counter_clockwise")
        commands.draw_fullscreen(self._data.empty_vertex_array)
