"""The study textured-quads on Vulkan: two textures, a list of quads in mapped memory, one draw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import create_image, create_sampler, destroy_image
from backends.vulkan.upload import Uploader
from common.scene import Sampler
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.description import Binding
from ...pipelines.vulkan_descriptors import Texture
from ..drawing_vulkan import Drawing
from . import (
    CAPACITY,
    DRAWN,
    RECORD,
    STUDY,
    UNIFORM_BYTES,
    Settings,
    depth_texels,
    picture_texels,
    quads_for,
    records_of,
    uniforms,
)

BINDINGS = (
    Binding(0, "uniform"),
    Binding(1, "storage"),
    Binding(2, "texture", "fragment"),
    Binding(3, "texture", "fragment"),
)


class Renderer(Drawing):
    """Rectangles of pixels that show textures."""

    study = STUDY
    settings_class: type = Settings
    folder = Path(__file__).parent
    moves = False
    quads_for = staticmethod(quads_for)  # yours may stand here
    texels = staticmethod(lambda: (picture_texels(), depth_texels()))

    def create(self) -> None:
        """Upload both textures, and make what draws them."""
        self._images: list[Any] = []
        # "nearest": a texel is shown, never a mixture of two. "rgba8": codes go in and come out, nothing is decoded.
        self._sampler = create_sampler(
            self.device, Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0, ""
        )
        picture, depth = self.texels()
        textures = {2: self._texture("rgba8", picture), 3: self._texture("r32f", depth)}
        self._quads = self.per_slot(CAPACITY * RECORD.itemsize, "storage", "quads")
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "sizes")
        held = zip(self._uniforms, self._quads, strict=True)
        self._sets = self.sets(BINDINGS, [{0: frame, 1: quads, **textures} for frame, quads in held])
        self._pipeline = self.build(BINDINGS, DRAWN)

    def _texture(self, format: str, pixels: np.ndarray) -> Texture:
        usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        size = pixels.shape[1], pixels.shape[0]
        self._images.append(create_image(self.device, format, size, usage, f"shown {format}"))
        with Uploader(self.device) as uploader:
            uploader.image(self._images[-1], pixels)
        return Texture(self._images[-1].view, self._sampler)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Write this frame's quads and draw all at once; without quads there is no draw."""
        slot, records = commands.slot.index, records_of(self.quads_for(self.size))
        self.begin(commands)
        if len(records):
            self._quads[slot].view(RECORD)[: len(records)] = records
            self._uniforms[slot].view(np.float32)[:] = uniforms(self.settings, self.size)
            self.bind(commands, self._pipeline, self._sets[slot])
            self.device.fn.vkCmdDraw(commands.handle, 6 * len(records), 1, 0, 0)
        self.end(commands)
        self.work.draws, self.work.triangles = int(len(records) > 0), 2 * len(records)

    def destroy(self) -> None:
        """Free images and sampler, and the rest."""
        super().destroy()
        for image in getattr(self, "_images", ()):
            destroy_image(self.device, image)
        if hasattr(self, "_sampler"):
            self.device.destroy("VkSampler", self._sampler)
