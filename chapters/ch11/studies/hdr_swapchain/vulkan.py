"""The study hdr-swapchain on Vulkan: a scene in linear light, the last pass, and a picture of what it wrote."""

from __future__ import annotations

from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.resources import Image
from common.view.camera import View

from ...frames.vulkan_commands import Commands, Rendering
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Texture
from ..stage_vulkan import Stage
from . import FORMATS, PASSES, STUDY, TEXELS, TRIANGLE, Settings, check, decide, defines
from .vulkan_surface import HdrDisplay

DISPLAY = HdrDisplay
"""The window of this study takes other pictures than those of 8 bits, where its display does."""


class Renderer(Stage):
    """Three triangles: the scene, its signal, and the picture. `encoding` is what the last pass writes."""

    study = STUDY
    settings_class: type = Settings
    moves = False

    def create(self) -> None:
        """Choose the encoding, and make the pipelines."""
        check(self.settings)
        surface = self.device.display.surface if isinstance(self.device.display, HdrDisplay) else None
        offered = surface.encoding if surface is not None else "srgb" if self.presents else None
        self.encoding = decide(self.settings.encoding, offered)
        self.matches = offered == self.encoding
        if surface is not None and surface.sentence not in self.scene.warnings:
            self.scene.warnings.append(surface.sentence)
        formats = {"ramp": "rgba16f", "encode": FORMATS[self.encoding], "show": "rgba8"}
        macros = defines(self.settings, self.encoding)
        self._ramp, self._encode, self._show = self.pipelines.get(
            [
                PipelineDescription((TRIANGLE, file), macros, color=formats[name], depth=None, name=name)
                for name, file in PASSES.items()
            ]
        )
        self._nearest = self.sampler(TEXELS, "texels")

    def create_sized(self) -> None:
        """Make the image of light and the encoded one, and the barriers between the passes."""
        light = self.target("light", "rgba16f")
        self.encoded = self.target("encoded", FORMATS[self.encoding], "encoded", "sampled")
        self._held = [
            self.set_of(pipeline, {0: Texture(image.view, self._nearest)}, image.name, sized=True)
            for pipeline, image in ((self._encode, light), (self._show, self.encoded))
        ]
        background = (0.0, 0.0, 0.0, 0.0)
        self._to_light, self._to_encoded = (
            Rendering(self.size, image, None, background) for image in (light, self.encoded)
        )
        aspect = light.aspect
        # The last frame has read the light in a shader, and copied the encoded image to a file or a window.
        self._before = barriers(
            image_barrier(light.handle, aspect, "sampled", "color", discard=True),
            self._start(self.encoded, "color"),
        )
        self._lit = barriers(image_barrier(light.handle, aspect, "color", "sampled"))
        self._coded = barriers(image_barrier(self.encoded.handle, aspect, "color", "sampled"))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the scene, encode it, and show what was written."""
        commands.barrier(self._before)
        commands.begin_rendering(self._to_light)
        commands.bind_pipeline(self._ramp)
        commands.draw_triangle()
        commands.end_rendering()
        commands.barrier(self._lit)
        commands.begin_rendering(self._to_encoded)
        commands.bind_pipeline(self._encode)
        commands.bind_set(self._encode, 0, self._held[0])
        commands.draw_triangle()
        commands.end_rendering()
        commands.barrier(self._coded)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._held[1])
        commands.draw_triangle()
        self.end(commands)
        self.work.draws = self.work.triangles = 3

    @property
    def present_source(self) -> Image:
        """The picture of 8 bits: of sRGB in a window the encoded image, else the one that explains it."""
        return self.encoded if self.matches and self.encoding == "srgb" else super().present_source

    @property
    def displayed(self) -> Image:
        """The image for a window: the encoded one if the surface takes it as it is, else the picture."""
        return self.encoded if self.matches else self.present_source
