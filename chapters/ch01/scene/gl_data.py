"""The scene on the GPU: geometry and textures uploaded once, and the small buffers that are written for every frame.

The layout is that of scene/vulkan_data.py: one buffer for all streams and indices, only what some material reads,
and whatever the CPU writes from frame to frame once per slot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.draws import PushTable, Stream, create_vertex_array
from backends.gl.resources import (
    Buffer,
    Image,
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
from common.scene import Pose, Sampler, Scene

from ..environment import model
from ..environment.gl import EnvironmentMaps, create_environment
from ..environment.model import Sizes
from ..frames.commands import SceneBinding
from ..frames.frame import SLOTS
from ..frames.gl_commands import Draw, Textures
from ..settings import Settings
from ..shading import views
from . import geometry, records
from .data import ENVIRONMENT_UNIT, SceneData
from .draw_lists import Range
from .packing import PUSH_SIZE, ROLES
from .textures import texels


@dataclass(kw_only=True)
class _Slot(records.Slot):
    """The buffers of one frame in flight."""

    geometry: Buffer
    vertex_array: int


class GlSceneData(SceneData):
    """Everything that draws read: buffers, textures, samplers and vertex arrays."""

    def __init__(self, context: Context, scene: Scene, settings: Settings, anisotropy: float) -> None:
        self._context = context
        # It refuses what cannot be drawn, before it creates anything that would be left behind.
        super().__init__(scene, settings, anisotropy, context.limits["maxImageDimension2D"])
        self._images: dict[texels.Key, Image] = {}
        self._samplers: dict[tuple[Sampler, float], int] = {}
        rows = np.zeros((max(1, len(scene.instances)), PUSH_SIZE // 4), np.uint32)
        rows[:, 0] = np.arange(len(rows))
        self.push = PushTable(context, rows, "push constants")
        self._upload_geometry()
        self._make_environment()
        self.slots: list[_Slot] = [self._make_slot(index) for index in range(SLOTS)]
        self._keep_textures()
        self.followed()

    # --- created once ---

    def _upload_geometry(self) -> None:
        scene, context = self._scene, self._context
        self.streams = geometry.used_streams(self.variants)
        arrays = geometry.arrays(scene, self.streams)
        self._offsets, size = geometry.stream_offsets({name: array.nbytes for name, array in arrays.items()})
        # Deforming vertices are written for one frame while the GPU still draws the other: one copy per slot.
        copies = SLOTS if scene.deformations else 1
        self._geometry = [create_buffer(context, size, "device", "geometry") for _ in range(copies)]
        streams = [Stream(*geometry.STREAMS[name], self._offsets[name]) for name in self.streams]
        self._vertex_arrays = []
        for buffer in self._geometry:
            for name, array in arrays.items():
                write_buffer(context, buffer, array, self._offsets[name])
            self._vertex_arrays.append(create_vertex_array(context, streams, buffer, buffer, "geometry"))

    def _make_environment(self) -> None:
        self._environment: EnvironmentMaps | None = None
        if self.has_environment:
            assert self._scene.environment is not None
            sizes = Sizes.of(self._settings.environment)
            self._environment = create_environment(self._context, self._scene.environment, sizes)
            self._tell_environment(self._environment)

    def _free_geometry(self) -> None:
        for vertex_array in self._vertex_arrays:
            self._context.destroy("vertex array", vertex_array)
        for buffer in self._geometry:
            destroy_buffer(self._context, buffer)

    def _make_slot(self, index: int) -> _Slot:
        sizes = records.buffer_sizes(self._scene)
        buffers = {
            name: create_buffer(self._context, size, "upload", f"{name}, slot {index}")
            for name, size in sizes.items()
            if name != "lights" or self.lit
        }
        copy = index % len(self._geometry)
        return _Slot(
            frame=buffers["frame"],
            instances=buffers["instances"],
            materials=buffers["materials"],
            lights=buffers.get("lights"),
            geometry=self._geometry[copy],
            vertex_array=self._vertex_arrays[copy],
        )

    def _keep_textures(self) -> None:
        """Upload what is missing, give up what no material reads any more, and note what each material binds."""
        context = self._context
        wanted: dict[texels.Key, str] = {}
        for role, texture in self._used_textures():
            wanted.setdefault(texels.key_of(role, texture), role)
        mended = views.mends_texels(self._settings)
        with Uploader(context) as uploader:
            for key, role in wanted.items():
                if key not in self._images:
                    loaded = texels.texels_of(self._scene, role, key, mended)
                    self._images[key] = self._upload(uploader, loaded)
        for key in self._images.keys() - wanted.keys():
            destroy_image(context, self._images.pop(key))  # OpenGL itself waits for the GPU's use
        self._bound: list[Textures] = []
        for material, variant in zip(self._scene.materials, self.variants, strict=True):
            bound = []
            for role in variant.roles:
                texture = material.textures().get(role)
                image = self._images[texels.key_of(role, texture)]
                sampler = self.sampler(
                    texture.sampler if texture is not None else Sampler(), self._anisotropy
                )
                bound.append((ROLES.index(role), image.view, sampler))
            self._bound.append(tuple(bound))

    def _upload(self, uploader: Uploader, loaded: texels.Texels) -> Image:
        height, width = loaded.pixels.shape[:2]
        image = create_image(
            self._context,
            loaded.format,
            (width, height),
            loaded.name,
            levels=loaded.levels,
            view_format=loaded.view_format,
        )
        uploader.image(image, loaded.pixels, srgb=loaded.srgb)
        return image

    def sampler(self, described: Sampler, anisotropy: float) -> int:
        """Return the sampler of this description, created at its first use."""
        key = (described, anisotropy)
        if key not in self._samplers:
            filters = f"{described.min}/{described.mag}/{described.mipmap}"
            name = f"{filters} {described.wrap_u}/{described.wrap_v}"
            self._samplers[key] = create_sampler(self._context, described, anisotropy, name)
        return self._samplers[key]

    # --- created again when a material changes its variant ---

    def _replace(self, streams_changed: bool) -> None:
        """Upload what the materials need now, and give up what they no longer need."""
        if streams_changed:
            self._free_geometry()
            self._upload_geometry()
            for index, slot in enumerate(self.slots):
                copy = index % len(self._geometry)
                slot.geometry, slot.vertex_array = self._geometry[copy], self._vertex_arrays[copy]
                slot.written.pop("deformed", None)
        for index, slot in enumerate(self.slots):
            if self.lit and slot.lights is None:
                size = records.buffer_sizes(self._scene)["lights"]
                slot.lights = create_buffer(self._context, size, "upload", f"lights, slot {index}")
        self._keep_textures()

    # --- what passes read ---

    def textures_of(self, material: int) -> Textures:
        """Return what the material binds."""
        return self._bound[material]

    def draw(self, indices: Range) -> Draw:
        """Return a draw as the commands take it."""
        first = self._offsets["indices"] + 4 * indices.first_index
        return Draw(
            indices.instance * self.push.stride,
            indices.index_count,
            gl.ffi.cast("void *", first),
            indices.first_vertex,
        )

    def binding(self, slot: int) -> SceneBinding:
        """Return the slot's vertex array; what else draws read is bound once, when the frame begins."""
        return SceneBinding(None, self.slots[slot].vertex_array)

    @property
    def textures(self) -> int:
        """Images that were uploaded."""
        return len(self._images)

    @property
    def samplers(self) -> int:
        """The number of samplers."""
        return len(self._samplers)

    # --- for every frame ---

    def bind_frame(self, slot: int) -> None:
        """Bind what all draws of a frame read; the numbers are those of scene.glsl, material.glsl and forward.frag."""
        held, context = self.slots[slot], self._context
        bind_buffer(context, "uniform", 0, held.frame)  # type: ignore[arg-type]
        bind_buffer(context, "storage", 0, held.instances)  # type: ignore[arg-type]
        bind_buffer(context, "storage", 1, held.materials)  # type: ignore[arg-type]
        if held.lights is not None:
            bind_buffer(context, "storage", 2, held.lights)  # type: ignore[arg-type]
        if self._environment is not None:
            sampler = self.sampler(model.SMOOTH, 1.0)
            maps = self._environment
            for unit, image in enumerate(
                (maps.radiance, maps.irradiance, maps.table), start=ENVIRONMENT_UNIT
            ):
                bind_texture(context, unit, image.view, sampler)

    def write_deformation(self, slot: int, pose: Pose) -> int:
        """Write deformed vertices into the slot's geometry; return the bytes written."""
        held, scene = self.slots[slot], self._scene
        key = self.records.moving_key(pose)
        if not scene.deformations or held.written.get("deformed") == key:
            return 0
        total = 0
        for offset, raw in geometry.deformed(scene, pose, self.streams, self._offsets):
            write_buffer(self._context, held.geometry, raw, offset)
            total += raw.size
        held.written["deformed"] = key
        return total

    def close(self) -> None:
        """Free everything."""
        context = self._context
        for slot in self.slots:
            for buffer in (slot.frame, slot.instances, slot.materials, slot.lights):
                if buffer is not None:
                    destroy_buffer(context, buffer)  # type: ignore[arg-type]
        self._free_geometry()
        for image in self._images.values():
            destroy_image(context, image)
        for sampler in self._samplers.values():
            context.destroy("sampler", sampler)
        if self._environment is not None:
            self._environment.close(context)
        self.push.close()
