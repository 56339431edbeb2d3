"""The scene on the GPU: geometry and textures uploaded once, and the small buffers that are written for every frame.

All vertices and indices share a few pages, from which shaders fetch by themselves; textures are known by number. Only
the streams and images that some material reads are uploaded. What the CPU writes from frame to frame exists once per
slot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.driver.features import CORE
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader
from common.errors import UnsupportedError
from common.scene import Pose, Scene

from ..environment import model
from ..environment.model import Sizes
from ..environment.vulkan import create_environment
from ..frames.commands import SceneBinding
from ..frames.frame import SLOTS
from ..frames.vulkan_resources import Resources
from ..loading.loading import Loading
from ..loading.vulkan_geometry import GeometryCopies
from ..pipelines.vulkan_descriptors import Descriptors, Held, Part, Texture
from ..pipelines.vulkan_layouts import SetLayout
from ..settings import Settings
from ..shading import views
from ..visibility.model import NO_TRIANGLES, SET, in_use
from . import geometry, pages, records
from .data import SceneData
from .draw_lists import COMMAND
from .textures.vulkan_materials import ArrayTextures, BindlessTextures, MaterialTextures, slots_for

GEOMETRY = (CORE, "geometryShader")
"""The feature with which fragment shaders may ask for gl_PrimitiveID."""

_READ_BEFORE = (
    vk.VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT,
    vk.VK_ACCESS_2_NONE,
    vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
    vk.VK_ACCESS_2_TRANSFER_WRITE_BIT,
)
"""The frame before reads a slot's vertices as its previous ones, and may still do so."""

RAY_INPUT = (
    vk.VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR
    | vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
)
"""The usage of vertices that acceleration structures are built from."""

RAY_READ = vk.VK_ACCESS_2_SHADER_READ_BIT
"""How the builds read them."""

FRAME, PAGE, TEXTURES = 0, 1, 2
"""Numbers of the sets: what a frame reads, a page of geometry, the textures (scene, vertices and textures.glsl)."""

ENVIRONMENT_BINDING, MORE_INSTANCES, LIGHT_LISTS = 5, 8, 9
"""In the frame's set (scene.glsl): the first of three bindings of the environment, more instances, light lists."""


@dataclass(kw_only=True)
class _Slot(records.Slot):
    """The buffers of one frame in flight."""

    frame: Buffer
    instances: Buffer
    materials: Buffer
    lights: Buffer | None
    commands: Buffer
    staging: Buffer | None


class VulkanSceneData(SceneData):
    """Everything that draws read: buffers, textures and descriptor sets."""

    def __init__(
        self,
        device: Device,
        scene: Scene,
        settings: Settings,
        anisotropy: float,
        resources: Resources,
        descriptors: Descriptors,
        bindless: bool,
        loading: Loading,
    ) -> None:
        self._device, self._resources, self._descriptors = device, resources, descriptors
        self._traced = device.has("ray-tracing") or device.has("ray-query")
        limits = int(device.limits.maxImageDimension2D), int(device.limits.maxStorageBufferRange)
        super().__init__(scene, settings, anisotropy, limits, loading)
        mended = views.mends_texels(settings)
        self._textures: MaterialTextures
        if bindless:
            self.slot_count = slots_for(scene, self.variants)
            self._textures = BindlessTextures(
                device, scene, resources, anisotropy, mended, self.slot_count, loading
            )
        else:
            self.slot_count = 0
            self._textures = ArrayTextures(device, scene, resources, descriptors, anisotropy, mended, loading)
        with GeometryCopies(device, resources, self._textures.close, loading.streams) as uploader:
            self._upload_geometry(uploader)
            self._textures.keep(uploader, self.variants)
        self.records.maps = self._textures.maps
        self.records.maps[:, SET] = self.textures_of
        self.bytes_uploaded = uploader.bytes
        self._make_environment()
        self.slots: list[_Slot] = [self._make_slot(index) for index in range(SLOTS)]
        self._sets: list[Any] = []
        self._frame_sets: list[Any] = []
        self.followed()

    # --- made once ---

    def _choose_variants(self) -> None:
        super()._choose_variants()
        if in_use(self._settings) and GEOMETRY not in self._device.physical.bits:
            raise UnsupportedError(NO_TRIANGLES.format(self._device.capabilities.device))
        if self._settings.shading.view == "triangle-id" and GEOMETRY not in self._device.physical.bits:
            raise UnsupportedError(
                f"{self._device.capabilities.device} gives fragments no number of their triangle: choose another view."
            )

    def _upload_geometry(self, uploader: Uploader) -> None:
        scene = self._scene
        meshes, self.page_of, self.first_index = pages.mesh_records(scene, self.pages)
        copied = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        storage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | copied
        # Deforming vertices are written for one frame while the GPU still draws the other: one copy per slot.
        copies = SLOTS if scene.deformations else 1
        index = vk.VK_BUFFER_USAGE_INDEX_BUFFER_BIT
        if self._traced:
            index |= RAY_INPUT
        self._geometry = [
            [
                self._resources.buffer(
                    page.size, storage | index, "device", f"page {number}", shared=copies > 1
                )
                for number, page in enumerate(self.pages)
            ]
            for _ in range(copies)
        ]
        for copy in self._geometry:
            for page, handle in zip(self.pages, copy, strict=True):
                for offset, array in pages.page_arrays(scene, page):
                    uploader.buffer(self._resources.buffers.get(handle), array, offset)
        self._meshes = self._resources.buffer(meshes.nbytes, storage, "device", "meshes")
        uploader.buffer(self._resources.buffers.get(self._meshes), meshes)

    def _make_environment(self) -> None:
        self._environment: list[Texture] = []
        if not self.has_environment:
            return
        assert self._scene.environment is not None
        maps = create_environment(self._device, self._scene.environment, Sizes.of(self._settings.environment))
        self._tell_environment(maps)
        for image in (maps.radiance, maps.irradiance, maps.table):
            self._resources.images.create(image)
        sampler = self._resources.sampler(model.SMOOTH, 1.0)
        views = (maps.radiance_view, maps.irradiance_view, maps.table.view)
        self._environment = [Texture(view, sampler) for view in views]

    def _make_slot(self, index: int) -> _Slot:
        scene = self._scene

        def make(size: int, usage: int, name: str) -> Buffer:
            return self._make_upload(size, usage, f"{name}, slot {index}")

        sizes = records.buffer_sizes(scene)
        storage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        staging = None
        if scene.deformations:
            size = geometry.deformed_bytes(scene)
            staging = make(size, vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT, "deformed vertices")
        return _Slot(
            frame=make(sizes["frame"], vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, "frame"),
            instances=make(sizes["instances"], storage, "instances"),
            materials=make(sizes["materials"], storage, "materials"),
            lights=self._make_lights(index) if self.lit else None,
            commands=make(
                len(scene.instances) * COMMAND.itemsize,
                vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT | storage,  # culling reads those of blended objects
                "draws",
            ),
            staging=staging,
        )

    def _make_upload(self, size: int, usage: int, name: str) -> Buffer:
        return self._resources.buffers.get(self._resources.buffer(size, usage, "upload", name))

    def _make_lights(self, slot: int) -> Buffer:
        size = records.buffer_sizes(self._scene)["lights"]
        return self._make_upload(size, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, f"lights, slot {slot}")

    def make_sets(self, layouts: dict[int, SetLayout]) -> None:
        """Make all descriptor sets, by the layouts that the shaders of the scene told for each number of a set.

        There is one per slot for the frame and one per page of geometry; those of the textures are their own.
        """
        if not self._loading.streams:  # threads have decoded while pipelines were made
            self._load_textures(None)
        for old in self._sets:
            self._resources.defer(partial(self._descriptors.destroy, old))
        self._sets = []
        self._textures.make_sets(layouts.get(TEXTURES))
        far = dict(enumerate(self._environment, start=ENVIRONMENT_BINDING))
        buffers = self._resources.buffers
        frames: list[Any] = []
        if FRAME in layouts:
            for index, slot in enumerate(self.slots):
                held: dict[int, Held] = {
                    0: slot.frame,
                    **self.held_instances(index, 1, MORE_INSTANCES),
                    2: buffers.get(self._meshes),
                    3: slot.materials,
                    **far,
                }
                if slot.lights is not None:
                    held[4] = slot.lights
                if self.light_lists is not None:
                    held[LIGHT_LISTS] = buffers.get(self.light_lists)
                if self.exposures is not None:
                    held[10] = self.exposures.blocks[index]
                if self.shadows is not None:
                    held |= {11: self.shadows.blocks[index], 12: self.shadows.held_pages}
                if self.fog is not None:
                    held |= {13: self.fog.blocks[index], 14: self.fog.store}
                frames.append((layouts[FRAME], held, f"frame, slot {index}"))
        paged = [
            (layouts[PAGE], self._held_page(copy, number), f"page {number}")
            for copy in range(len(self._geometry) if PAGE in layouts else 0)
            for number in range(len(self.pages))
        ]
        if frames or paged:
            self._sets.append(self._descriptors.create([*frames, *paged]))
            sets = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets[0].handles]
            self._frame_sets = sets[: len(frames)]
            self._page_sets = sets[len(frames) :]

    def _held_page(self, copy: int, number: int) -> dict[int, Held]:
        """Return a page of geometry, and behind it the same page of the other slot if vertices deform."""
        turned = (*self._geometry[copy:], *self._geometry[:copy])
        return {place: self._resources.buffers.get(pages[number]) for place, pages in enumerate(turned)}

    # --- created again when a material changes its variant ---

    def _replace(self, streams_changed: bool) -> None:
        """Upload anew; frames in flight still read the old images and streams, which are therefore deleted later."""
        with Uploader(self._device) as uploader:
            if streams_changed:
                for handle in [self._meshes, *(handle for copy in self._geometry for handle in copy)]:
                    self._resources.destroy_buffer(handle)
                self._upload_geometry(uploader)
                for slot in self.slots:
                    slot.written.pop("deformed", None)
            self._textures.keep(uploader, self.variants)
        self.records.maps = self._textures.maps
        self.records.maps[:, SET] = self.textures_of
        self.bytes_uploaded += uploader.bytes
        for index, slot in enumerate(self.slots):
            if self.lit and slot.lights is None:
                slot.lights = self._make_lights(index)

    # --- what passes read ---

    def _defines_of(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        return self._textures.defines(materials)

    @property
    def textures_of(self) -> np.ndarray:
        """(M,) number of the set that holds each material's textures."""
        return self._textures.set_of

    def held_instances(self, slot: int, first: int, more: int) -> dict[int, Held]:
        """Return the records of instances of a slot for binding `first`, and for binding `more` if there are two."""
        buffer = self.slots[slot].instances
        parts = [Part(buffer, *part) for part in self.instance_parts]
        return dict(zip((first, more), parts, strict=False))

    def binding(self, slot: int) -> SceneBinding:
        """Return the slot's descriptor set, None where nothing of the scene is drawn, and its list of draws."""
        frame = self._frame_sets[slot] if self._frame_sets else None
        return SceneBinding(frame, self.slots[slot].commands)

    def texture_set(self, number: int) -> Any:
        """Return the array of one descriptor set with textures."""
        return self._textures.sets[number]

    def bound_page(self, slot: int, page: int) -> tuple[Any, Any]:
        """Return (array of the page's descriptor set, its buffer of indices) for slot number `slot`."""
        copy = slot % len(self._geometry)
        handle = self._resources.buffers.get(self._geometry[copy][page]).handle
        return self._page_sets[copy * len(self.pages) + page], handle

    def page_buffer(self, slot: int, page: int) -> Buffer:
        """Return a page of geometry as slot number `slot` draws it."""
        return self._resources.buffers.get(self._geometry[slot % len(self._geometry)][page])

    def _load_textures(self, budget: int | None) -> int:
        before = self._textures.loader.bytes
        self._textures.update(budget)
        return self._textures.loader.bytes - before

    @property
    def _maps_revision(self) -> int:
        return self._textures.revision

    @property
    def bindless_sets(self) -> int:
        """Sets that hold all textures: one, or none where nothing is textured or without bindless."""
        return len(self._textures.sets) if self.slot_count else 0

    @property
    def textures(self) -> int:
        """Images that were uploaded."""
        return len(self._textures)

    # --- written for every frame ---

    def record_deformation(self, commands: Any, slot: int, pose: Pose) -> int:
        """Record the copies of deformed vertices into the slot's geometry; return the bytes copied."""
        held, scene = self.slots[slot], self._scene
        key = self.records.moving_key(pose)
        if held.staging is None or held.written.get("deformed") == key:
            return 0
        copy = self._geometry[slot % len(self._geometry)]
        regions: dict[int, list[Any]] = {}
        end = 0
        for page, offset, raw in pages.deformed(scene, pose, self.pages):
            held.staging.mapped[end : end + raw.size] = raw
            regions.setdefault(page, []).append({"srcOffset": end, "dstOffset": offset, "size": raw.size})
            end += raw.size
        if not regions:
            return 0
        fn = self._device.fn
        if self.vertices_read_twice:
            fn.vkCmdPipelineBarrier2(commands, barriers(memory=_READ_BEFORE))
        for page, copies in regions.items():
            target = self._resources.buffers.get(copy[page]).handle
            fn.vkCmdCopyBuffer(
                commands, held.staging.handle, target, len(copies), vk.array("VkBufferCopy", copies)
            )
        write = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
        # Indices are in the same buffer, and an indirect draw may read any of its bytes.
        read = (
            vk.VK_PIPELINE_STAGE_2_ALL_GRAPHICS_BIT | vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT,
            vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_INDEX_READ_BIT,
        )
        if self._traced:  # acceleration structures are refitted to them
            read = read[0] | vk.VK_PIPELINE_STAGE_2_ACCELERATION_STRUCTURE_BUILD_BIT_KHR, read[1] | RAY_READ
        fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*write, *read)))
        held.written["deformed"] = key
        return end

    def close(self) -> None:
        """Free the set of all textures; everything else belongs to the resources and the descriptors."""
        self._textures.close()
