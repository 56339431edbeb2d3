"""The sky: the environment as it is seen where nothing was drawn."""

from __future__ import annotations

from common.scene import Scene

from ..environment import model
from ..fog import model as fog
from ..frames.commands import Commands
from ..pipelines.description import Built, PipelineDescription
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .views import PICTURE


class Sky:
    """One triangle at infinity. It is a part of the forward pass: behind what is solid, before what is transparent."""

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._draws, self._pipelines = parts.settings, parts.draws, parts.pipelines
        grey = ("BACKGROUND", parts.settings.shading.background)
        self._defines = () if self.needed(parts.scene, parts.settings) else (grey,)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is an environment, and it is to be seen: a view shows surfaces alone."""
        return settings.shading.sky and settings.shading.view == PICTURE and model.needed(scene, settings)

    @staticmethod
    def drawn(scene: Scene, settings: Settings) -> bool:
        """Whether the forward pass draws what is behind everything: the sky, or a grey that is seen through fog."""
        picture = settings.shading.view == PICTURE
        return Sky.needed(scene, settings) or (picture and fog.needed(scene, settings))

    def create(self) -> Built:
        """Build the pipeline and return it."""
        described = PipelineDescription(
            shaders=("post/fullscreen.vert", "shading/sky.frag"),
            defines=self._defines,
            color=self._settings.shading.color_format,
            depth="test",
            samples=self._settings.shading.msaa,
            name="sky",
        )
        self._pipeline = self._pipelines.get([described])[0]
        return self._pipeline

    def record(self, commands: Commands) -> None:
        """Record the triangle."""
        commands.draw_fullscreen(self._pipeline, self._draws.binding)
