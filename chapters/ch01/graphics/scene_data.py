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
from backends.vulkan.resources import Buffer, mip_levels
from backends.vulkan.upload import Uploader
from common import layouts
from common.color import decode_srgb
from common.pools import Handle
from common.scene import Change, Pose, Sampler, Scene

from ..logic import packing
from ..logic.packing import ROLES, Variant
from ..settings import Settings
from .descriptors import Binding, Descriptors, Texture
from .frames import SLOTS
from .resources import Resources

STREAMS: dict[str, tuple[int, int]] = {
    # name: (shader location, floats per vertex)
    "positions": (0, 3),
    "normals": (1, 3),
    "tangents": (2, 4),
    "uv0": (3, 2),
    "uv1": (4, 2),
    "colors": (5, 4),
}

DEFORMED = ("positions", "normals", "tangents")
"""Streams that a skin or morph targets change."""

ALIGNMENT = 256
"""Offset of every stream: a multiple of what any device asks of any use of a buffer."""

_NEUTRAL = {
    # What a role without a texture would have to sample for the picture to stay the same.
    "base_color": (1.0, 1.0, 1.0, 1.0),
    "metallic_roughness": (1.0, 1.0, 1.0, 1.0),
    "normal": (0.5, 0.5, 1.0, 1.0),
    "occlusion": (1.0, 1.0, 1.0, 1.0),
    "emissive": (1.0, 1.0, 1.0, 1.0),
}


@dataclass
class _Slot:
    """The buffers of one frame in flight, and what was written to them last."""

    frame: Buffer
    instances: Buffer
    materials: Buffer
    lights: Buffer | None
    staging: Buffer | None
    geometry: Handle
    written: dict[str, Any]


def used_streams(variants: list[Variant]) -> list[str]:
    """Return the vertex streams that some variant reads, in the order of their locations."""
    needed = {"positions"}
    for variant in variants:
        for define, stream in (
            ("SHADED", "normals"),
            ("NORMAL_MAP", "tangents"),
            ("TEXTURED", "uv0"),
            ("UV1", "uv1"),
            ("VERTEX_COLOR", "colors"),
        ):
            if variant.has(define):
                needed.add(stream)
    return [name for name in STREAMS if name in needed]


def stream_offsets(sizes: dict[str, int], alignment: int = ALIGNMENT) -> tuple[dict[str, int], int]:
    """Return the aligned byte offset of each stream in a shared buffer, and the buffer's size."""
    offsets: dict[str, int] = {}
    end = 0
    for name, size in sizes.items():
        offsets[name] = (end + alignment - 1) // alignment * alignment
        end = offsets[name] + size
    return offsets, end


def half_texels(pixels: np.ndarray, srgb: bool) -> np.ndarray:
    """Return (H, W, 4) uint16 or float texels as float16 light; sRGB codes of integers are decoded.

    What is not finite is made so here: a filter would spread one NaN over every smaller mip level.
    """
    if pixels.dtype == np.uint16:
        value = pixels.astype(np.float32) / np.float32(65535.0)
        if srgb:
            value[..., :3] = decode_srgb(value[..., :3])
    else:
        value = np.nan_to_num(pixels.astype(np.float32), nan=0.0, posinf=65504.0, neginf=-65504.0)
    return np.clip(value, -65504.0, 65504.0).astype(np.float16)


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
        everything = not settings.skip_unused
        self.variants = [
            packing.material_variant(material, scene, everything) for material in scene.materials
        ]
        self.lit = any(variant.has("LIT") for variant in self.variants)
        self.bytes_uploaded = 0
        self._images: dict[Any, Handle] = {}
        with Uploader(device) as uploader:
            self._upload_geometry(uploader)
            self._upload_images(uploader)
        self.bytes_uploaded = uploader.bytes
        self.slots = [self._make_slot(index) for index in range(SLOTS)]
        self._make_sets()
        self._previous_pose: Pose | None = None
        self.instances = np.zeros(0, layouts.dtype("Instance"))
        """The records that were written last."""

    # --- made once ---

    def _upload_geometry(self, uploader: Uploader) -> None:
        scene = self._scene
        self.streams = used_streams(self.variants)
        arrays = {name: getattr(scene, name) for name in self.streams}
        arrays["indices"] = scene.indices
        self._offsets, size = stream_offsets({name: array.nbytes for name, array in arrays.items()})
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

    def _upload_images(self, uploader: Uploader) -> None:
        """Upload every image that a role reads, once as colour and once as data if it serves as both."""
        for material, variant in zip(self._scene.materials, self.variants, strict=True):
            for role in variant.roles:
                texture = material.textures().get(role)
                key = self._image_key(role, texture)
                if key not in self._images:
                    self._images[key] = self._upload_image(uploader, role, key)

    @staticmethod
    def _image_key(role: str, texture: Any) -> tuple[Any, ...]:
        if texture is None:
            return ("neutral", _NEUTRAL[role])
        return (
            "image",
            texture.image,
            role in ("base_color", "emissive"),
            texture.sampler.mipmap is not None,
        )

    def _upload_image(self, uploader: Uploader, role: str, key: tuple[Any, ...]) -> Handle:
        usage = (
            vk.VK_IMAGE_USAGE_SAMPLED_BIT
            | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
            | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        )
        if key[0] == "neutral":
            handle = self._resources.image("rgba16f", (1, 1), usage, f"neutral {role}")
            pixels = np.array(key[1], np.float16).reshape(1, 1, 4)
            uploader.image(self._resources.images.get(handle), pixels)
            return handle
        _, number, srgb, mipmapped = key
        image = self._scene.images[number]
        height, width = image.pixels.shape[:2]
        levels = mip_levels(width, height) if mipmapped else 1
        if levels > 1:
            usage |= vk.VK_IMAGE_USAGE_STORAGE_BIT
        pixels = image.pixels
        if pixels.dtype != np.uint8:
            # Sixteen bits do not fit into eight; half precision keeps eleven of them and is filtered everywhere.
            value = half_texels(pixels, srgb)
            handle = self._resources.image("rgba16f", (width, height), usage, image.name, levels=levels)
            uploader.image(self._resources.images.get(handle), value)
            return handle
        handle = self._resources.image(
            "rgba8",
            (width, height),
            usage,
            image.name,
            levels=levels,
            view_format="rgba8_srgb" if srgb else None,
        )
        uploader.image(self._resources.images.get(handle), pixels, srgb=srgb)
        return handle

    def _make_slot(self, index: int) -> _Slot:
        scene = self._scene

        def make(size: int, usage: int, name: str) -> Buffer:
            handle = self._resources.buffer(size, usage, "upload", f"{name}, slot {index}")
            return self._resources.buffers.get(handle)

        storage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        lights = None
        if self.lit:
            lights = make(16 + max(1, len(scene.lights)) * packing.LIGHT.itemsize, storage, "lights")
        staging = None
        if scene.deformations:
            vertices = sum(int(scene.meshes["vertex_count"][d.mesh]) for d in scene.deformations)
            staging = make(
                vertices * 4 * (3 + 3 + 4), vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT, "deformed vertices"
            )
        return _Slot(
            frame=make(
                layouts.dtype("FrameConstants").itemsize, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT, "frame"
            ),
            instances=make(
                max(1, len(scene.instances)) * layouts.dtype("Instance").itemsize, storage, "instances"
            ),
            materials=make(max(1, len(scene.materials)) * packing.MATERIAL.itemsize, storage, "materials"),
            lights=lights,
            staging=staging,
            geometry=self._geometry[index % len(self._geometry)],
            written={},
        )

    def _make_sets(self) -> None:
        """Make all descriptor sets: one per slot for the frame, one per material for its textures."""
        bindings = [Binding(0, "uniform"), Binding(1, "storage"), Binding(2, "storage")]
        if self.lit:
            bindings.append(Binding(3, "storage", vk.VK_SHADER_STAGE_FRAGMENT_BIT))
        self.frame_layout = self._descriptors.layout(bindings)
        wanted: list[Any] = []
        for index, slot in enumerate(self.slots):
            held: dict[int, Any] = {0: slot.frame, 1: slot.instances, 2: slot.materials}
            if slot.lights is not None:
                held[3] = slot.lights
            wanted.append((bindings, held, f"frame, slot {index}"))
        textured = [index for index, variant in enumerate(self.variants) if variant.roles]
        for index in textured:
            material, variant = self._scene.materials[index], self.variants[index]
            held = {}
            for role in variant.roles:
                texture = material.textures().get(role)
                image = self._resources.images.get(self._images[self._image_key(role, texture)])
                sampler = texture.sampler if texture is not None else Sampler()
                held[ROLES.index(role)] = Texture(
                    image.view, self._resources.sampler(sampler, self._anisotropy)
                )
            wanted.append((self._material_bindings(variant), held, f"material {index} {material.name}"))
        sets = self._descriptors.create(wanted)
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
        return tuple(STREAMS[name] for name in used_streams([variant]))

    def geometry(self, slot: int) -> tuple[list[tuple[int, Any, Any]], Any, int]:
        """Return ([(first binding, buffers, offsets)], index buffer, its offset) to bind for slot number `slot`."""
        buffer = self._resources.buffers.get(self.slots[slot].geometry)
        runs = [
            (
                STREAMS[name][0],
                vk.array("VkBuffer", [buffer.handle]),
                vk.ffi.new("VkDeviceSize[]", [self._offsets[name]]),
            )
            for name in self.streams
        ]
        return runs, buffer.handle, self._offsets["indices"]

    @property
    def textures(self) -> int:
        """Images that were uploaded."""
        return len(self._images)

    # --- written for every frame ---

    def write_frame(self, slot: int, constants: np.ndarray) -> None:
        """Write the frame's constants."""
        self.slots[slot].frame.view(constants.dtype)[0] = constants

    def write_scene(self, slot: int, pose: Pose, exposure: float) -> int:
        """Write what changed since this slot was used last; return the bytes written."""
        held, scene = self.slots[slot], self._scene
        written = 0
        revisions = scene.revision
        key = (revisions[Change.TRANSFORMS], pose.time if scene.animations else None)
        if held.written.get("instances") != (key, "settled"):
            records = packing.pack_instances(scene, pose, self._previous_pose)
            held.instances.view(records.dtype)[: len(records)] = records
            written += records.nbytes
            # An object that stops is written once more, so that its previous transform is its present one.
            moved = bool((records["flags"] & layouts.INSTANCE_MOVED).any())
            held.written["instances"] = (key, "moving" if moved else "settled")
            self.instances = records
        self._previous_pose = pose
        if held.written.get("materials") != revisions[Change.MATERIALS]:
            records = packing.pack_materials(scene.materials)
            held.materials.view(records.dtype)[: len(records)] = records
            written += records.nbytes
            held.written["materials"] = revisions[Change.MATERIALS]
        light_key = (key, revisions[Change.LIGHTS], exposure)
        if held.lights is not None and held.written.get("lights") != light_key:
            records = packing.pack_lights(scene, pose, exposure, self._settings.light_cutoff)
            held.lights.view(np.uint32)[:4] = (len(records), 0, 0, 0)
            held.lights.mapped[16:].view(packing.LIGHT)[: len(records)] = records
            written += records.nbytes + 16
            held.written["lights"] = light_key
        return written

    def record_deformation(self, commands: Any, slot: int, pose: Pose) -> int:
        """Record the copies of deformed vertices into the slot's geometry; return the bytes copied."""
        held, scene = self.slots[slot], self._scene
        if held.staging is None or held.written.get("deformed") == pose.time:
            return 0
        target = self._resources.buffers.get(held.geometry)
        regions = []
        end = 0
        for mesh, arrays in pose.vertices.items():
            first = int(scene.meshes["first_vertex"][mesh])
            for name, array in zip(DEFORMED, arrays, strict=True):
                if name not in self.streams:
                    continue
                raw = np.ascontiguousarray(array, np.float32).view(np.uint8).reshape(-1)
                held.staging.mapped[end : end + raw.size] = raw
                offset = self._offsets[name] + first * 4 * STREAMS[name][1]
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
        held.written["deformed"] = pose.time
        return end
