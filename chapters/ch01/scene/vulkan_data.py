"""The scene on the GPU: geometry and textures uploaded once, and the small buffers that are written for every frame.

All vertices and indices share one buffer, each stream at its own aligned offset, and only the streams and images that
some material reads are uploaded. What the CPU writes from frame to frame exists once per slot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.features import CORE
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader
from common.errors import UnsupportedError
from common.numerics.pools import Handle
from common.scene import Change, Pose, Sampler, Scene, TextureRef

from ..environment import model
from ..environment.model import Sizes
from ..environment.vulkan import create_environment
from ..frames.frame import SLOTS
from ..frames.vulkan_resources import Resources
from ..pipelines.vulkan_descriptors import Binding, Descriptors, Texture
from ..settings import Settings
from ..shading import views
from . import geometry, records
from .packing import ROLES, Variant
from .records import Records
from .textures import texels
from .textures.vulkan_images import Textures

GEOMETRY = (CORE, "geometryShader")
"""The feature with which fragment shaders may ask for gl_PrimitiveID."""

ENVIRONMENT_BINDING = 4
"""The first of the three bindings of the environment in the frame's set (forward.frag)."""


@dataclass(kw_only=True)
class _Slot(records.Slot):
    """The buffers of one frame in flight."""

    staging: Buffer | None
    geometry: Handle


class SceneData:
    """Everything that draws read: buffers, textures and descriptor sets."""

    def __init__(
        self,
        device: Device,
        scene: Scene,
        settings: Settings,
        anisotropy: float,
        resources: Resources,
        descriptors: Descriptors,
    ) -> None:
        self._device, self._scene, self._settings, self._anisotropy = device, scene, settings, anisotropy
        self._resources, self._descriptors = resources, descriptors
        self._energy = settings.energy if model.needed(scene, settings) else None
        self._choose_variants()
        self._textures = Textures(scene, resources, views.mends_texels(settings))
        with Uploader(device) as uploader:
            self._upload_geometry(uploader)
            self._textures.keep(uploader, self._used_textures())
        self.bytes_uploaded = uploader.bytes
        self._make_environment()
        self.slots = [self._make_slot(index) for index in range(SLOTS)]
        self._make_sets()
        self._kinds: Any = self._material_kinds()
        self._materials_seen = scene.revision[Change.MATERIALS]
        self.records = Records(scene, settings.light_cutoff)

    # --- made once ---

    def _choose_variants(self) -> None:
        # First: an edit that cannot be followed says so until another one mends it.
        texels.check_images(self._scene, int(self._device.limits.maxImageDimension2D))
        self.variants = [
            views.variant_of(material, self._scene, self._settings, self._energy)
            for material in self._scene.materials
        ]
        self.lit = any(variant.has("LIT") for variant in self.variants)
        if self._settings.view == "triangle-id" and GEOMETRY not in self._device.physical.bits:
            raise UnsupportedError(
                f"{self._device.capabilities.device} gives fragments no number of their triangle: choose another view."
            )

    def _upload_geometry(self, uploader: Uploader) -> None:
        scene = self._scene
        self.streams = geometry.used_streams(self.variants)
        arrays = geometry.arrays(scene, self.streams)
        self._offsets, size = geometry.stream_offsets({name: array.nbytes for name, array in arrays.items()})
        usage = (
            vk.VK_BUFFER_USAGE_VERTEX_BUFFER_BIT
            | vk.VK_BUFFER_USAGE_INDEX_BUFFER_BIT
            | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
        )
        # Deforming vertices are written for one frame while the GPU still draws the other: one copy per slot.
        copies = SLOTS if scene.deformations else 1
        self._geometry = [self._resources.buffer(size, usage, "device", "geometry") for _ in range(copies)]
        for handle in self._geometry:
            buffer = self._resources.buffers.get(handle)
            for name, array in arrays.items():
                uploader.buffer(buffer, array, self._offsets[name])

    def _make_environment(self) -> None:
        self.environment = model.NO_ENVIRONMENT
        """What every frame's constants hold of the environment."""
        self.prepared_ms: dict[str, float] = {}
        self._environment: list[Texture] = []
        if self._energy is None or self._scene.environment is None:
            return
        sizes = Sizes.of(self._settings)
        maps = create_environment(self._device, self._scene.environment, sizes)
        self.prepared_ms = {f"environment {name}": took for name, took in maps.made_ms.items()}
        for image in (maps.radiance, maps.irradiance, maps.table):
            self._resources.images.create(image)
        sampler = self._resources.sampler(model.SMOOTH, 1.0)
        views = (maps.radiance_view, maps.irradiance_view, maps.table.view)
        self._environment = [Texture(view, sampler) for view in views]
        self.environment = model.frame_values(self._settings, maps.scale, maps.last_level)

    def _used_textures(self) -> list[tuple[str, TextureRef | None]]:
        """Return (role, texture) of everything that some variant samples."""
        return [
            (role, material.textures().get(role))
            for material, variant in zip(self._scene.materials, self.variants, strict=True)
            for role in variant.roles
        ]

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
            staging=staging,
            geometry=self._geometry[index % len(self._geometry)],
        )

    def _make_upload(self, size: int, usage: int, name: str) -> Buffer:
        return self._resources.buffers.get(self._resources.buffer(size, usage, "upload", name))

    def _make_lights(self, slot: int) -> Buffer:
        size = records.buffer_sizes(self._scene)["lights"]
        return self._make_upload(size, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, f"lights, slot {slot}")

    def _make_sets(self) -> None:
        """Make all descriptor sets: one per slot for the frame, one per material for its textures."""
        bindings = [Binding(0, "uniform"), Binding(1, "storage"), Binding(2, "storage")]
        if self.lit:
            bindings.append(Binding(3, "storage", vk.VK_SHADER_STAGE_FRAGMENT_BIT))
        far = dict(enumerate(self._environment, start=ENVIRONMENT_BINDING))
        bindings += [Binding(number, "texture", vk.VK_SHADER_STAGE_FRAGMENT_BIT) for number in far]
        self.frame_layout = self._descriptors.layout(bindings)
        wanted: list[Any] = []
        for index, slot in enumerate(self.slots):
            held: dict[int, Any] = {0: slot.frame, 1: slot.instances, 2: slot.materials, **far}
            if self.lit:
                held[3] = slot.lights
            wanted.append((bindings, held, f"frame, slot {index}"))
        textured = [index for index, variant in enumerate(self.variants) if variant.roles]
        for index in textured:
            material, variant = self._scene.materials[index], self.variants[index]
            held = {}
            for role in variant.roles:
                texture = material.textures().get(role)
                sampler = texture.sampler if texture is not None else Sampler()
                held[ROLES.index(role)] = Texture(
                    self._textures.get(role, texture).view, self._resources.sampler(sampler, self._anisotropy)
                )
            wanted.append((self._material_bindings(variant), held, f"material {index} {material.name}"))
        self._sets = self._descriptors.create(wanted)
        sets = self._sets.handles
        self.frame_sets = [vk.array("VkDescriptorSet", [made]) for made in sets[:SLOTS]]
        self._material_sets = {
            index: vk.array("VkDescriptorSet", [made])
            for index, made in zip(textured, sets[SLOTS:], strict=True)
        }

    @staticmethod
    def _material_bindings(variant: Variant) -> list[Binding]:
        return [
            Binding(ROLES.index(role), "texture", vk.VK_SHADER_STAGE_FRAGMENT_BIT) for role in variant.roles
        ]

    # --- made anew when a material becomes another kind ---

    def _material_kinds(self) -> Any:
        """Return all of each material that is no number in its record: its variant, images and samplers."""
        kinds = []
        for material, variant in zip(self._scene.materials, self.variants, strict=True):
            textures = material.textures()
            used = [(role, textures[role]) for role in variant.roles if role in textures]
            kinds.append((variant, [(texels.key_of(role, one), one.sampler) for role, one in used]))
        return kinds

    def follow_materials(self) -> bool:
        """Make what edited materials need and give up what none needs any more; return whether any became another kind.

        Frames in flight still read the old sets, images and streams, which are therefore deleted later.
        """
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
        resources, sets = self._resources, self._sets
        with Uploader(self._device) as uploader:
            if geometry.used_streams(self.variants) != self.streams:
                for handle in self._geometry:
                    resources.destroy_buffer(handle)
                self._upload_geometry(uploader)
                for index, slot in enumerate(self.slots):
                    slot.geometry = self._geometry[index % len(self._geometry)]
                    slot.written.pop("deformed", None)
            self._textures.keep(uploader, self._used_textures())
        self.bytes_uploaded += uploader.bytes
        for index, slot in enumerate(self.slots):
            if self.lit and slot.lights is None:
                slot.lights = self._make_lights(index)
        resources.defer(lambda: self._descriptors.destroy(sets))
        self._make_sets()
        return True

    def followed(self) -> None:
        """Note that pipelines were made, too, for what `follow_materials` made: only then is an edit done with."""
        self._kinds, self._materials_seen = self._material_kinds(), self._scene.revision[Change.MATERIALS]

    # --- what passes read ---

    def set_layouts(self, variant: Variant) -> tuple[Any, ...]:
        """Return the set layouts of a pipeline for `variant`: the frame's, and the material's if it has textures."""
        if not variant.roles:
            return (self.frame_layout,)
        return (self.frame_layout, self._descriptors.layout(self._material_bindings(variant)))

    def material_set(self, material: int) -> Any:
        """Return the array of one descriptor set with the material's textures, None if it has none."""
        return self._material_sets.get(material)

    def vertex_streams(self, variant: Variant) -> tuple[tuple[int, int], ...]:
        """Return (location, floats) of the streams that `variant` reads."""
        return tuple(geometry.STREAMS[name] for name in geometry.used_streams([variant]))

    def bound_geometry(self, slot: int) -> tuple[list[tuple[int, Any, Any]], Any, int]:
        """Return ([(first binding, buffers, offsets)], index buffer, its offset) to bind for slot number `slot`."""
        buffer = self._resources.buffers.get(self.slots[slot].geometry)
        runs = [
            (
                geometry.STREAMS[name][0],
                vk.array("VkBuffer", [buffer.handle]),
                vk.ffi.new("VkDeviceSize[]", [self._offsets[name]]),
            )
            for name in self.streams
        ]
        return runs, buffer.handle, self._offsets["indices"]

    @property
    def textures(self) -> int:
        """Images that were uploaded."""
        return len(self._textures)

    # --- written for every frame ---

    def write_frame(self, slot: int, constants: np.ndarray) -> None:
        """Write the frame's constants."""
        self.slots[slot].frame.view(constants.dtype)[0] = constants

    def record_deformation(self, commands: Any, slot: int, pose: Pose) -> int:
        """Record the copies of deformed vertices into the slot's geometry; return the bytes copied."""
        held, scene = self.slots[slot], self._scene
        key = self.records.moving_key(pose)
        if held.staging is None or held.written.get("deformed") == key:
            return 0
        target = self._resources.buffers.get(held.geometry)
        regions = []
        end = 0
        for offset, raw in geometry.deformed(scene, pose, self.streams, self._offsets):
            held.staging.mapped[end : end + raw.size] = raw
            regions.append({"srcOffset": end, "dstOffset": offset, "size": raw.size})
            end += raw.size
        if not regions:
            return 0
        fn = self._device.fn
        copies = vk.array("VkBufferCopy", regions)
        fn.vkCmdCopyBuffer(commands, held.staging.handle, target.handle, len(regions), copies)
        write = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
        read = (vk.VK_PIPELINE_STAGE_2_VERTEX_INPUT_BIT, vk.VK_ACCESS_2_VERTEX_ATTRIBUTE_READ_BIT)
        fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*write, *read)))
        held.written["deformed"] = key
        return end
