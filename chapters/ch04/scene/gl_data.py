"""The scene on the GPU: geometry and textures uploaded once, and the small buffers that are written for every frame.

The layout is that of scene/vulkan_data.py: pages of words from which shaders fetch, layers of array textures, only
what some material reads, and whatever the CPU writes from frame to frame once per slot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from backends.gl.context import Context
from backends.gl.draws import create_vertex_array
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
    write_image,
)
from common.scene import Change, Pose, Sampler, Scene
from common.view.camera import View

from ..environment import model
from ..environment.gl import EnvironmentMaps, create_environment
from ..environment.model import Sizes
from ..frames.frame import SLOTS
from ..frames.gl_commands import Textures
from ..loading import placeholders
from ..loading.array_arrivals import ArrayArrivals, array_name
from ..loading.gl import Loader
from ..loading.importance import material_sizes
from ..loading.loading import Loading, Request, report_failures
from ..settings import Settings
from ..shading import views
from . import geometry, packing, pages, records
from .draw_lists import COMMAND
from .packing import Variant
from .records import Records
from .textures import texels
from .textures.arrays import ArrayTexture
from .textures.reads import image_roles, uses

ENVIRONMENT_UNIT, ARRAY_UNIT = 0, 3
"""The first texture units of the environment's three maps, and of the arrays of textures (scene, textures.glsl)."""


@dataclass(kw_only=True)
class _Slot(records.Slot):
    """The buffers of one frame in flight."""

    commands: Buffer


class SceneData:
    """Everything that draws read: buffers, textures, samplers and vertex arrays."""

    def __init__(
        self, context: Context, scene: Scene, settings: Settings, anisotropy: float, loading: Loading
    ) -> None:
        self._context, self._scene, self._settings, self._anisotropy = context, scene, settings, anisotropy
        self.records = Records(scene, settings.light_cutoff)
        self._images: dict[ArrayTexture, Image] = {}
        self._numbered: dict[int, Image] = {}  # the same by the numbers that OpenGL gave them
        self._loading = loading
        self._seen_from: View | None = None
        self._arrivals = ArrayArrivals(scene, views.mends_texels(settings), loading.streams, context.features)
        self._loader = Loader(context, self, loading)
        self._samplers: dict[tuple[Sampler, float], int] = {}
        self._energy = settings.energy if model.needed(scene, settings) else None
        # These two refuse what cannot be drawn, before anything is made that would be left behind.
        self._choose_variants()
        self._plan_geometry()
        self._upload_geometry()
        self.empty_vertex_array = create_vertex_array(context, [], None, None, "no vertices")
        self._make_environment()
        self.slots = [self._make_slot(index) for index in range(SLOTS)]
        try:
            self._keep_textures()
        except BaseException:
            self.close()
            raise
        self._kinds: Any = self._material_kinds()
        self._materials_seen = scene.revision[Change.MATERIALS]

    # --- made once ---

    def _choose_variants(self) -> None:
        # First: an edit that cannot be followed says so until another one mends it.
        packing.check_materials(self._scene)
        texels.check_images(self._scene, self._context.limits["maxImageDimension2D"])
        self.variants = [
            views.variant_of(material, self._scene, self._settings, self._energy)
            for material in self._scene.materials
        ]
        self.lit = any(variant.has("LIT") for variant in self.variants)

    def _plan_geometry(self) -> None:
        """Choose streams and pages; where a mesh is too large for one, nothing has changed."""
        streams = geometry.used_streams(self.variants)
        largest = min(pages.PAGE_BYTES, self._context.limits["maxStorageBufferRange"])
        self.pages = pages.plan_pages(self._scene, streams, largest)
        self.streams = streams

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
        self.environment = model.NO_ENVIRONMENT
        """What every frame's constants hold of the environment."""
        self.prepared_ms: dict[str, float] = {}
        self._environment: EnvironmentMaps | None = None
        if self._energy is None or self._scene.environment is None:
            return
        maps = create_environment(self._context, self._scene.environment, Sizes.of(self._settings))
        self._environment = maps
        self.prepared_ms = {f"environment {name}": took for name, took in maps.made_ms.items()}
        self.environment = model.frame_values(self._settings, maps.scale, maps.last_level)

    def _free_geometry(self) -> None:
        for arrays in self._vertex_arrays:
            for vertex_array in arrays:
                self._context.destroy("vertex array", vertex_array)
        for buffer in [self._meshes, *(buffer for copy in self._geometry for buffer in copy)]:
            destroy_buffer(self._context, buffer)

    def _make_slot(self, index: int) -> _Slot:
        sizes = records.buffer_sizes(self._scene)
        made = {
            name: create_buffer(self._context, size, "upload", f"{name}, slot {index}")
            for name, size in sizes.items()
            if name != "lights" or self.lit
        }
        size = max(1, len(self._scene.instances)) * COMMAND.itemsize
        return _Slot(
            frame=made["frame"],
            instances=made["instances"],
            materials=made["materials"],
            lights=made.get("lights"),
            commands=create_buffer(self._context, size, "upload", f"draws, slot {index}"),
        )

    def _keep_textures(self) -> None:
        """Make the arrays that are new, give up those that no material reads, and note what each set binds."""
        context = self._context
        found = uses(self._scene, self.variants)
        self._plan = self._arrivals.plan(found, context.limits["maxImageArrayLayers"])
        for array in self._plan.arrays:
            if array not in self._images:
                self._images[array] = self._make(array)
        self._numbered = {image.handle: image for image in self._images.values()}
        ids = {array: image.handle for array, image in self._images.items()}
        self._loader.want(self._arrivals.wanted(self._plan, found, image_roles(found), ids))
        for array in self._images.keys() - set(self._plan.arrays):
            destroy_image(context, self._images.pop(array))  # OpenGL itself waits for the GPU's use
        self.records.maps = self._arrivals.begin(self._loading.resident)
        held = [
            (self._images[array].view, self.sampler(array.sampler, self._anisotropy))
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
            made = texels.texels_of(self._scene, "placeholder", key)
            write_image(self._context, image, made.pixels, layer=number)
        return image

    def place(self, request: Request) -> tuple[Image, int]:
        """Return the array and the layer that a request asks for."""
        number, layer = cast(tuple[int, int], request.key)
        return self._numbered[number], layer

    def update_textures(self, slot: int, view: View) -> None:
        """Go on loading, most of all what `view` shows, and name to the slot's materials what has arrived."""
        if self._loading.decoding and self._seen_from != view:
            self._loading.prioritise(material_sizes(self._scene, self.records.instances, view))
            self._seen_from = view
        before = self._loader.bytes
        for request in self._loader.advance(self._loading.budget):
            self._arrivals.arrive(request.key)
        self.texture_work = self._loading.counts(self.textures, self._loader.bytes - before)
        report_failures(self._loading, self._scene)
        self.records.write_maps(self.slots[slot], self._arrivals.revision)

    def load_textures(self) -> None:
        """Wait until all textures are there."""
        self._context.make_current()
        for request in self._loader.finish():
            self._arrivals.arrive(request.key)

    def sampler(self, described: Sampler, anisotropy: float) -> int:
        """Return the sampler of this description, made at its first use."""
        key = (described, anisotropy)
        if key not in self._samplers:
            filters = f"{described.min}/{described.mag}/{described.mipmap}"
            name = f"{filters} {described.wrap_u}/{described.wrap_v}"
            self._samplers[key] = create_sampler(self._context, described, anisotropy, name)
        return self._samplers[key]

    # --- made anew when a material becomes another kind ---

    def _material_kinds(self) -> Any:
        """Return all of the materials that is no number in their records: their variants, images and samplers."""
        return uses(self._scene, self.variants), list(self.variants)

    def follow_materials(self) -> bool:
        """Make what edited materials need, give up what none needs; return whether any became another kind."""
        revision = self._scene.revision[Change.MATERIALS]
        if revision == self._materials_seen:
            return False
        self._choose_variants()
        if self._material_kinds() == self._kinds:
            self._materials_seen = revision
            return False
        self._kinds = (
            None  # until `followed`: what is refused halfway is done anew by the next frame, from the start
        )
        if geometry.used_streams(self.variants) != self.streams:
            self._plan_geometry()
            self._free_geometry()
            self._upload_geometry()
            for slot in self.slots:
                slot.written.pop("deformed", None)
        for index, slot in enumerate(self.slots):
            if self.lit and slot.lights is None:
                size = records.buffer_sizes(self._scene)["lights"]
                slot.lights = create_buffer(self._context, size, "upload", f"lights, slot {index}")
        self._keep_textures()
        return True

    def followed(self) -> None:
        """Note that pipelines were made, too, for what `follow_materials` made: only then is an edit done with."""
        self._kinds, self._materials_seen = self._material_kinds(), self._scene.revision[Change.MATERIALS]

    # --- what passes read ---

    def texture_defines(
        self, needed: Variant, of: Callable[[Variant], Variant] = lambda whole: whole
    ) -> tuple[tuple[str, int | str], ...]:
        """Return what the shaders of `needed` are built with, which `of` makes of a material's variant."""
        if not needed.roles:
            return ()
        drawn = [number for number, one in enumerate(self.variants) if of(one).defines == needed.defines]
        return self._plan.defines(drawn)

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
        """Samplers that were made."""
        return len(self._samplers)

    # --- for every frame ---

    def write_frame(self, slot: int, constants: np.ndarray) -> None:
        """Write the frame's constants."""
        self.slots[slot].frame.view(constants.dtype)[0] = constants

    def write_commands(self, slot: int, commands: np.ndarray, first: int = 0) -> int:
        """Write records of draws into the slot's list, from number `first` on; return the bytes written."""
        if len(commands):
            self.slots[slot].commands.view(COMMAND)[first : first + len(commands)] = commands
        return int(commands.nbytes)

    def bind_frame(self, slot: int) -> None:
        """Bind what all draws of a frame read; the numbers are those of scene.glsl."""
        held, context = self.slots[slot], self._context
        bind_buffer(context, "uniform", 0, held.frame)  # type: ignore[arg-type]
        bind_buffer(context, "storage", 0, held.instances)  # type: ignore[arg-type]
        bind_buffer(context, "storage", 1, self._meshes)
        bind_buffer(context, "storage", 2, held.materials)  # type: ignore[arg-type]
        if held.lights is not None:
            bind_buffer(context, "storage", 3, held.lights)  # type: ignore[arg-type]
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
        context.destroy("vertex array", self.empty_vertex_array)
