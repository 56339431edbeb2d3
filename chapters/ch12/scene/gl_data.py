"""The scene on the GPU: geometry and textures uploaded once, and the small buffers that are written for every frame.

The layout is that of scene/vulkan_data.py: pages of words from which shaders fetch, layers of array textures, only
what some material reads, and whatever the CPU writes from frame to frame once per slot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from backends.gl.context import Context
from backends.gl.draws import create_vertex_array
from backends.gl.resources import (
    Buffer,
    Image,
    bind_buffer,
    bind_storage_image,
    bind_texture,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    write_buffer,
    write_image,
)
from common.scene import Pose, Sampler, Scene

from ..environment import model
from ..environment.gl import EnvironmentMaps, create_environment
from ..environment.model import Sizes
from ..frames.commands import SceneBinding
from ..frames.frame import SLOTS
from ..frames.gl_commands import Textures
from ..loading import placeholders
from ..loading.array_arrivals import ArrayArrivals, array_name
from ..loading.gl import Loader
from ..loading.loading import Loading, Request
from ..settings import Settings
from ..shading import views
from ..visibility.model import SET
from . import pages, records
from .data import ARRAY_UNIT, ENVIRONMENT_UNIT, SceneData
from .draw_lists import COMMAND
from .textures import texels
from .textures.arrays import ArrayTexture
from .textures.reads import image_roles, uses

MORE_INSTANCES, LIGHT_LISTS = 12, 13
"""The storage blocks of the rest of the instances and of the light lists (scene.glsl)."""


@dataclass(kw_only=True)
class _Slot(records.Slot):
    """The buffers of one frame in flight."""

    commands: Buffer


class GlSceneData(SceneData):
    """Everything that draws read: buffers, textures, samplers and vertex arrays."""

    def __init__(
        self, context: Context, scene: Scene, settings: Settings, anisotropy: float, loading: Loading
    ) -> None:
        self._context = context
        limits = context.limits["maxImageDimension2D"], context.limits["maxStorageBufferRange"]
        super().__init__(scene, settings, anisotropy, limits, loading)
        self._images: dict[ArrayTexture, Image] = {}
        self._numbered: dict[int, Image] = {}  # the same by the numbers that OpenGL gave them
        self._arrivals = ArrayArrivals(scene, views.mends_texels(settings), loading.streams, context.features)
        self._loader = Loader(context, self, loading)
        self._samplers: dict[tuple[Sampler, float], int] = {}
        self._upload_geometry()
        self._make_environment()
        self.slots: list[_Slot] = [self._make_slot(index) for index in range(SLOTS)]
        try:
            self._keep_textures()
        except BaseException:
            self.close()
            raise
        self.followed()

    # --- created once ---

    def _upload_geometry(self) -> None:
        scene, context = self._scene, self._context
        meshes, self.page_of, self.first_index = pages.mesh_records(scene, self.pages)
        # Deforming vertices are written for one frame while the GPU still draws the other: one copy per slot.
        copies = SLOTS if scene.deformations else 1
        self._geometry = [
            [
                create_buffer(context, page.size, "device", f"page {number}")
                for number, page in enumerate(self.pages)
            ]
            for _ in range(copies)
        ]
        self._vertex_arrays = []
        for copy in self._geometry:
            for page, buffer in zip(self.pages, copy, strict=True):
                for offset, array in pages.page_arrays(scene, page):
                    write_buffer(context, buffer, array, offset)
            self._vertex_arrays.append(
                [create_vertex_array(context, [], None, buffer, buffer.name) for buffer in copy]
            )
        self._meshes = create_buffer(context, meshes.nbytes, "device", "meshes")
        write_buffer(context, self._meshes, meshes)

    def _make_environment(self) -> None:
        self._environment: EnvironmentMaps | None = None
        if self.has_environment:
            assert self._scene.environment is not None
            sizes = Sizes.of(self._settings.environment)
            self._environment = create_environment(self._context, self._scene.environment, sizes)
            self._tell_environment(self._environment)

    def _free_geometry(self) -> None:
        for arrays in self._vertex_arrays:
            for vertex_array in arrays:
                self._context.destroy("vertex array", vertex_array)
        for buffer in [self._meshes, *(buffer for copy in self._geometry for buffer in copy)]:
            destroy_buffer(self._context, buffer)

    def _make_slot(self, index: int) -> _Slot:
        sizes = records.buffer_sizes(self._scene)
        buffers = {
            name: create_buffer(self._context, size, "upload", f"{name}, slot {index}")
            for name, size in sizes.items()
            if name != "lights" or self.lit
        }
        size = max(1, len(self._scene.instances)) * COMMAND.itemsize
        return _Slot(
            frame=buffers["frame"],
            instances=buffers["instances"],
            materials=buffers["materials"],
            lights=buffers.get("lights"),
            commands=create_buffer(self._context, size, "upload", f"draws, slot {index}"),
        )

    def _keep_textures(self) -> None:
        """Make the arrays that are new, give up those that no material reads, and note what each set binds."""
        context = self._context
        sampled = uses(self._scene, self.variants)
        self._plan = self._arrivals.plan(sampled, context.limits["maxImageArrayLayers"])
        for array in self._plan.arrays:
            if array not in self._images:
                self._images[array] = self._make(array)
        self._numbered = {image.handle: image for image in self._images.values()}
        ids = {array: image.handle for array, image in self._images.items()}
        self._loader.want(self._arrivals.wanted(self._plan, sampled, image_roles(sampled), ids))
        for array in self._images.keys() - set(self._plan.arrays):
            destroy_image(context, self._images.pop(array))  # OpenGL itself waits for the GPU's use
        self.records.maps = self._arrivals.begin(self._loading.resident)
        self.records.maps[:, SET] = self.textures_of
        held = [
            (self._images[array].view, self.sampler(array.sampler, self.anisotropy))
            for array in self._plan.arrays
        ]
        self._bound: list[Textures] = [
            tuple((ARRAY_UNIT + unit, *held[array]) for unit, array in enumerate(chosen))
            for chosen in self._plan.sets
        ]

    def _make(self, array: ArrayTexture) -> Image:
        shape = array.shape
        image = create_image(
            self._context,
            shape.format,
            (shape.width, shape.height),
            array_name(self._scene, array),
            shape="array",
            levels=shape.levels,
            layers=len(array.layers),
            view_format=shape.view_format,
            swizzle=shape.swizzle,
        )
        for number, key in enumerate(array.layers if array == placeholders.ARRAY else ()):
            neutral = texels.texels_of(self._scene, "placeholder", key)
            write_image(self._context, image, neutral.pixels, layer=number)
        return image

    def place(self, request: Request) -> tuple[Image, int]:
        """Return the array and the layer that a request asks for."""
        number, layer = cast(tuple[int, int], request.key)
        return self._numbered[number], layer

    def _load_textures(self, budget: int | None) -> int:
        before = self._loader.bytes
        for request in self._loader.finish() if budget is None else self._loader.advance(budget):
            self._arrivals.arrive(request.key)
        return self._loader.bytes - before

    @property
    def _maps_revision(self) -> int:
        return self._arrivals.revision

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
            for slot in self.slots:
                slot.written.pop("deformed", None)
        for index, slot in enumerate(self.slots):
            if self.lit and slot.lights is None:
                size = records.buffer_sizes(self._scene)["lights"]
                slot.lights = create_buffer(self._context, size, "upload", f"lights, slot {index}")
        self._keep_textures()

    # --- what passes read ---

    def _defines_of(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        return self._plan.defines(materials)

    @property
    def textures_of(self) -> np.ndarray:
        """(M,) number of the set that holds each material's textures."""
        return self._plan.set_of

    def texture_set(self, number: int) -> Textures:
        """Return what a set of textures binds."""
        return self._bound[number]

    def bound_page(self, slot: int, page: int) -> tuple[Buffer, int]:
        """Return (buffer, vertex array with its indices) of a page for slot number `slot`."""
        copy = slot % len(self._geometry)
        return self._geometry[copy][page], self._vertex_arrays[copy][page]

    @property
    def textures(self) -> int:
        """Images that were uploaded."""
        return sum(len(array.layers) for array in self._images)

    @property
    def samplers(self) -> int:
        """The number of samplers."""
        return len(self._samplers)

    # --- for every frame ---

    def binding(self, slot: int) -> SceneBinding:
        """Return the slot's list of draws; what else draws read is bound once, when the frame begins."""
        return SceneBinding(None, self.slots[slot].commands)

    def bind_frame(self, slot: int) -> None:
        """Bind what all draws of a frame read; the numbers are those of scene.glsl."""
        held, context = self.slots[slot], self._context
        bind_buffer(context, "uniform", 0, held.frame)  # type: ignore[arg-type]
        self.bind_instances(slot, MORE_INSTANCES)
        bind_buffer(context, "storage", 1, self._meshes)
        bind_buffer(context, "storage", 2, held.materials)  # type: ignore[arg-type]
        if held.lights is not None:
            bind_buffer(context, "storage", 3, held.lights)  # type: ignore[arg-type]
        if self.light_lists is not None:
            bind_buffer(context, "storage", LIGHT_LISTS, self.light_lists)
        if self.exposures is not None:
            bind_buffer(context, "uniform", 2, self.exposures.blocks[slot])
        if self.shadows is not None:
            bind_buffer(context, "storage", 14, self.shadows.blocks[slot])
            bind_storage_image(context, 7, self.shadows.pages, access="both")
        if self.fog is not None:
            bind_buffer(context, "uniform", 13, self.fog.blocks[slot])
            bind_buffer(context, "storage", 15, self.fog.store)
        if self._environment is not None:
            sampler = self.sampler(model.SMOOTH, 1.0)
            maps = self._environment
            for unit, image in enumerate(
                (maps.radiance, maps.irradiance, maps.table), start=ENVIRONMENT_UNIT
            ):
                bind_texture(context, unit, image.view, sampler)

    def bind_instances(self, slot: int, more: int) -> None:
        """Bind the records of instances of a slot to storage block 0, and to block `more` if there are two parts."""
        for binding, (offset, size) in zip((0, more), self.instance_parts, strict=False):
            bind_buffer(self._context, "storage", binding, self.slots[slot].instances, offset, size)  # type: ignore[arg-type]

    def page_buffer(self, slot: int, page: int) -> Buffer:
        """Return a page of geometry as slot number `slot` draws it."""
        return self._geometry[slot % len(self._geometry)][page]

    def write_deformation(self, slot: int, pose: Pose) -> int:
        """Write deformed vertices into the slot's geometry; return the bytes written."""
        held, scene = self.slots[slot], self._scene
        key = self.records.moving_key(pose)
        if not scene.deformations or held.written.get("deformed") == key:
            return 0
        total = 0
        copy = self._geometry[slot % len(self._geometry)]
        for page, offset, raw in pages.deformed(scene, pose, self.pages):
            write_buffer(self._context, copy[page], raw, offset)
            total += raw.size
        held.written["deformed"] = key
        return total

    def close(self) -> None:
        """Free everything."""
        context = self._context
        self._loader.stop()
        for slot in self.slots:
            for buffer in (slot.frame, slot.instances, slot.materials, slot.lights, slot.commands):
                if buffer is not None:
                    destroy_buffer(context, buffer)  # type: ignore[arg-type]
        self._free_geometry()
        for image in self._images.values():
            destroy_image(context, image)
        for sampler in self._samplers.values():
            context.destroy("sampler", sampler)
        if self._environment is not None:
            self._environment.close(context)
