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
from backends.vulkan.driver.features import CORE
from backends.vulkan.resources import Buffer
from backends.vulkan.upload import Uploader
from common.errors import UnsupportedError
from common.numerics.pools import Handle
from common.scene import Pose, Sampler, Scene

from ..environment import model
from ..environment.model import Sizes
from ..environment.vulkan import create_environment
from ..frames.commands import SceneBinding
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Draw
from ..frames.vulkan_resources import Resources
from ..pipelines.vulkan_descriptors import Descriptors, Texture
from ..settings import Settings
from ..shading import views
from . import geometry, records
from .data import ENVIRONMENT_BINDING, SceneData
from .draw_lists import Range
from .packing import PUSH_SIZE, ROLES
from .textures.vulkan_images import Textures

GEOMETRY = (CORE, "geometryShader")
"""The feature with which fragment shaders may ask for gl_PrimitiveID."""


@dataclass(kw_only=True)
class _Slot(records.Slot):
    """The buffers of one frame in flight."""

    staging: Buffer | None
    geometry: Handle


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
    ) -> None:
        self._device, self._resources, self._descriptors = device, resources, descriptors
        super().__init__(scene, settings, anisotropy, int(device.limits.maxImageDimension2D))
        self._textures = Textures(scene, resources, views.mends_texels(settings))
        self._push = self._push_constants()
        with Uploader(device) as uploader:
            self._upload_geometry(uploader)
            self._textures.keep(uploader, self._used_textures())
        self.bytes_uploaded = uploader.bytes
        self._make_environment()
        self.slots: list[_Slot] = [self._make_slot(index) for index in range(SLOTS)]
        self._make_sets()
        self.followed()

    # --- made once ---

    def _choose_variants(self) -> None:
        super()._choose_variants()
        if self._settings.shading.view == "triangle-id" and GEOMETRY not in self._device.physical.bits:
            raise UnsupportedError(
                f"{self._device.capabilities.device} gives fragments no number of their triangle: choose another view."
            )

    def _push_constants(self) -> list[Any]:
        """Write all push constants that there will ever be: draw number i pushes 16 bytes from address i."""
        self._rows = np.zeros((len(self._scene.instances), PUSH_SIZE // 4), np.uint32)
        self._rows[:, 0] = np.arange(len(self._rows))
        if not len(self._rows):
            return []
        base = vk.ffi.cast("char *", vk.ffi.from_buffer(self._rows))
        return [base + PUSH_SIZE * index for index in range(len(self._rows))]

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
        bindings = self.frame_bindings
        far = dict(enumerate(self._environment, start=ENVIRONMENT_BINDING))
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
            wanted.append((self.material_bindings(variant), held, f"material {index} {material.name}"))
        self._sets = self._descriptors.create(wanted)
        sets = self._sets.handles
        self.frame_sets = [vk.array("VkDescriptorSet", [handle]) for handle in sets[:SLOTS]]
        self._material_sets = {
            index: vk.array("VkDescriptorSet", [handle])
            for index, handle in zip(textured, sets[SLOTS:], strict=True)
        }

    # --- created again when a material changes its variant ---

    def _replace(self, streams_changed: bool) -> None:
        """Upload and make sets anew; frames in flight still read the old ones, which are therefore deleted later."""
        resources, sets = self._resources, self._sets
        with Uploader(self._device) as uploader:
            if streams_changed:
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

    # --- what passes read ---

    def textures_of(self, material: int) -> Any:
        """Return the array of one descriptor set with the material's textures, None if it has none."""
        return self._material_sets.get(material)

    def draw(self, indices: Range) -> Draw:
        """Return a draw as the commands take it."""
        return Draw(self._push[indices.instance], *indices[1:])

    def binding(self, slot: int) -> SceneBinding:
        """Return the slot's set, and ([(first binding, buffers, offsets)], index buffer, its offset)."""
        buffer = self._resources.buffers.get(self.slots[slot].geometry)
        runs = [
            (
                geometry.STREAMS[name][0],
                vk.array("VkBuffer", [buffer.handle]),
                vk.ffi.new("VkDeviceSize[]", [self._offsets[name]]),
            )
            for name in self.streams
        ]
        return SceneBinding(self.frame_sets[slot], (runs, buffer.handle, self._offsets["indices"]))

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
