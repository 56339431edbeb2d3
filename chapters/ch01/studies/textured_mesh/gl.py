"""The study textured-mesh on OpenGL: vertices, indices and texels are uploaded once, and a draw names them."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.draws import Stream, create_vertex_array
from backends.gl.resources import (
    bind_buffer,
    bind_texture,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    write_buffer,
)
from backends.gl.upload import Uploader
from common.scene import Sampler, Scene
from common.scene.primitive import alone, primitive_of
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.gl import FrameSlot
from ...pipelines.description import PipelineDescription
from ...scene.geometry import stream_offsets
from ...scene.textures import texels
from ..stage_gl import Stage
from . import STREAMS, STUDY, UNIFORM_BYTES, Settings, uniforms


class Renderer(Stage):
    """One object of a scene, turning, with the picture of its base colour."""

    study = STUDY
    has_depth = True
    settings_class: type = Settings
    folder = "textured_mesh"
    streams = STREAMS
    uniform_bytes = UNIFORM_BYTES

    def choose(self, scene: Scene) -> Scene:
        """Return the one object that is drawn."""
        return alone(scene, self.settings.instance)

    def uniforms(self, view: View, time: float) -> np.ndarray:
        """Return what the shaders read in this frame."""
        return uniforms(self.scene, self._primitive, view, time, self.size[0] / self.size[1])

    def create(self) -> None:
        """Upload the object, and make what draws it."""
        self._buffers: list[Any] = []
        self._primitive = primitive_of(self.scene)
        self._upload_geometry()
        self._upload_texture()
        self._uniforms = [
            self._buffer(self.uniform_bytes, "upload", f"uniforms, slot {slot}") for slot in range(SLOTS)
        ]
        described = PipelineDescription(
            shaders=(f"studies/{self.folder}/mesh.vert", f"studies/{self.folder}/mesh.frag"),
            name=self.study.title,
        )
        self._pipeline = self.pipelines.get([described])[0]

    def _buffer(self, size: int, use: Any, name: str) -> Any:
        self._buffers.append(create_buffer(self.device, size, use, name))
        return self._buffers[-1]

    def _upload_geometry(self) -> None:
        """Put all streams and the indices into one buffer, each at its own offset."""
        arrays = {name: getattr(self._primitive, name) for name in (*self.streams, "indices")}
        offsets, size = stream_offsets({name: array.nbytes for name, array in arrays.items()})
        buffer = self._buffer(size, "device", "geometry")
        for name, array in arrays.items():
            write_buffer(self.device, buffer, array, offsets[name])
        # A vertex array remembers which stream lies where; on Vulkan half of that is in the pipeline, half in commands.
        streams = [Stream(*described, offsets[name]) for name, described in self.streams.items()]
        self._vertices = create_vertex_array(self.device, streams, buffer, buffer, "object")
        self._first_index = gl.ffi.cast("void *", offsets["indices"])

    def _upload_texture(self) -> None:
        """Upload the picture and let the GPU make its mip levels, each a quarter of the one before."""
        texture = self._primitive.material.base_color_texture
        chain = texels.texels_of(self.scene, "base_color", texels.key_of("base_color", texture))
        height, width = chain.pixels.shape[:2]
        self._image = create_image(
            self.device,
            chain.format,
            (width, height),
            chain.name,
            levels=chain.levels,
            view_format=chain.view_format,
        )
        with Uploader(self.device) as uploader:
            uploader.image(self._image, chain.pixels, srgb=chain.srgb)
        how = texture.sampler if texture is not None else Sampler()
        self._sampler = create_sampler(self.device, how, 1.0, chain.name)

    def draw(self, slot: FrameSlot, view: View, time: float) -> None:
        """Write this frame's uniforms, bind what was made, and draw by index."""
        fn, count = self.device.fn, len(self._primitive.indices)
        self._uniforms[slot.index].view(np.float32)[:] = self.uniforms(view, time)
        self.begin()
        self.pipelines.bind(self._pipeline, cull=False, front="counter_clockwise")
        bind_buffer(self.device, "uniform", 0, self._uniforms[slot.index])
        bind_texture(self.device, 0, self._image.view, self._sampler)
        fn.glBindVertexArray(self._vertices)
        # A vertex that six triangles share is in memory once, and often shaded once.
        fn.glDrawElementsBaseVertex(gl.GL_TRIANGLES, count, gl.GL_UNSIGNED_INT, self._first_index, 0)
        self.work.draws, self.work.triangles = 1, count // 3

    def destroy(self) -> None:
        """Free buffers, vertex array, image and sampler."""
        for buffer in getattr(self, "_buffers", ()):
            destroy_buffer(self.device, buffer)
        if hasattr(self, "_vertices"):
            self.device.destroy("vertex array", self._vertices)
        if hasattr(self, "_image"):
            destroy_image(self.device, self._image)
        if hasattr(self, "_sampler"):
            self.device.destroy("sampler", self._sampler)
