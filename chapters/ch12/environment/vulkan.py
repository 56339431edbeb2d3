"""The environment on the GPU: three images made once by compute before the first frame, or read from the disk's cache.

    radiance    a cube map; level l is blurred for roughness l / (levels - 1), level 0 is the environment itself
    irradiance  a cube map of irradiance / pi
    table       the BRDF in light that is the same from everywhere

The kernels are in `environment/*.comp`, what both backends know about them in `environment/model.py`.
"""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier, transition
from backends.vulkan.compute import Kernel, Sampled
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import (
    FORMATS,
    Buffer,
    Image,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.shaders.compiler import compile_shader
from backends.vulkan.upload import Uploader
from common.environment import Environment
from common.errors import UserError
from common.scene import Sampler

from ..pipelines.spirv.parser import parse
from . import model as logic
from .model import PANORAMA, SMOOTH, Maps, MapsOnGpu, Sizes

_USAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT
    | vk.VK_IMAGE_USAGE_STORAGE_BIT
    | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
    | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
)


@dataclass(eq=False)
class EnvironmentMaps(MapsOnGpu):
    """The sampled images, all in the state 'sampled'; views of the cubes are cube views. `close` frees it."""

    irradiance: Image
    table: Image
    radiance_view: Any
    irradiance_view: Any

    def close(self, device: Device) -> None:
        """Free the images; no frame in flight may use them."""
        for image in (self.radiance, self.irradiance, self.table):
            destroy_image(device, image)


def create_environment(device: Device, environment: Environment, sizes: Sizes) -> EnvironmentMaps:
    """Return the maps of an environment: from the disk where they are kept, else made, and kept. Waits for the GPU."""
    with ExitStack() as failed:

        def image(edge: int, name: str, levels: int = 1, layers: int = 6) -> Image:
            flags = vk.VK_IMAGE_CREATE_CUBE_COMPATIBLE_BIT if layers == 6 else 0
            image = create_image(
                device, logic.FORMAT, (edge, edge), _USAGE, name, levels=levels, layers=layers, flags=flags
            )
            failed.callback(destroy_image, device, image)
            return image

        radiance = image(sizes.face, "environment radiance", sizes.levels)
        irradiance = image(sizes.irradiance_face, "environment irradiance")
        table = image(sizes.table, "environment table", layers=1)
        made_ms = {}
        key = logic.maps_key(environment, sizes)
        maps = logic.read_maps(key, sizes)
        if maps is None:
            maps, made_ms["maps"] = _make_maps(device, environment, sizes, radiance, irradiance)
            logic.write_maps(key, maps)
        else:
            fill(device, radiance, maps.radiance)
            fill(device, irradiance, [maps.irradiance])
        key = logic.table_key(sizes)
        texels = logic.read_table(key, sizes)
        if texels is None:
            texels, made_ms["table"] = _make_table(device, sizes, table)
            logic.write_table(key, texels)
        else:
            fill(device, table, [texels[None]])
        seen, lit = cube_view(device, radiance), cube_view(device, irradiance)
        failed.pop_all()
        return EnvironmentMaps(radiance, maps.scale, made_ms, irradiance, table, seen, lit)


def cube_view(device: Device, image: Image, level: int = 0, levels: int | None = None) -> Any:
    """Return a view of the six layers of an image as a cube; it is freed with its image."""
    info = vk.new(
        "VkImageViewCreateInfo",
        image=image.handle,
        viewType=vk.VK_IMAGE_VIEW_TYPE_CUBE,
        format=FORMATS[image.format][0],
        subresourceRange={
            "aspectMask": image.aspect,
            "baseMipLevel": level,
            "levelCount": image.levels - level if levels is None else levels,
            "layerCount": 6,
        },
    )
    view = device.create("vkCreateImageView", info, f"{image.name} cube")
    image.views.append(view)
    return view


# --- made by compute ---


def _kernel(device: Device, name: str, dispatches: int = 1) -> Kernel:
    """Return a kernel; what is bound to it, and how many bytes are pushed, its shader says itself."""
    path = logic.SHADERS / f"{name}.comp"
    source = shader_text.build(path, "vulkan", defines={"FORMAT": logic.FORMAT})
    declared = parse(compile_shader(source))
    kinds: Any = [it.kind for it in sorted(declared.resources, key=lambda it: it.binding)]
    return Kernel(device, source, kinds, declared.push.size if declared.push else 0, dispatches)


def _make_maps(
    device: Device, environment: Environment, sizes: Sizes, radiance: Image, irradiance: Image
) -> tuple[Maps, float]:
    """Run the kernels; return what they wrote and their milliseconds. The images end in the state 'sampled'."""
    height, width = environment.radiance.shape[:2]
    largest = int(device.limits.maxImageDimension2D)
    if width > largest:
        raise UserError(
            f"The environment {environment.name} is {width} pixels wide, and {device.capabilities.device} takes "
            f"{largest}: scale it down"
        )
    scale = logic.storage_scale(environment)
    with ExitStack() as stack:

        def image(size: tuple[int, int], name: str, **more: Any) -> Image:
            image = create_image(device, logic.FORMAT, size, _USAGE, name, **more)
            stack.callback(destroy_image, device, image)
            return image

        def sampler(described: Sampler, name: str) -> Any:
            handle = create_sampler(device, described, 1.0, name)
            stack.callback(device.destroy, "VkSampler", handle)
            return handle

        def kernel(name: str, dispatches: int) -> Kernel:
            kernel = _kernel(device, name, dispatches)
            stack.callback(kernel.close)
            return kernel

        panorama = image((width, height), "panorama")
        source = image(
            (sizes.face, sizes.face),
            "environment source",
            levels=sizes.source_levels,
            layers=6,
            flags=vk.VK_IMAGE_CREATE_CUBE_COMPATIBLE_BIT,
        )
        with Uploader(device) as uploader:
            uploader.image(panorama, logic.panorama_texels(environment, scale))
        seen = Sampled(panorama.view, sampler(PANORAMA, "panorama"))
        whole = Sampled(cube_view(device, source), sampler(SMOOTH, "environment source"))
        to_cube = kernel("cube", 2)
        to_mips = kernel("mips", sizes.source_levels)
        to_irradiance = kernel("irradiance", 1)
        to_radiance = kernel("prefilter", sizes.levels)

        def level_of(cube: Image, level: int) -> Sampled:
            return Sampled(cube_view(device, cube, level, 1))

        began = clock.perf_counter()  # all of it is one submission that is waited for
        with submit_once(device) as commands:
            for cube in (source, radiance, irradiance):
                transition(device, commands, cube, "undefined", "storage")
            points = logic.points_per_edge(environment, sizes)
            for cube in (source, radiance):  # level 0 is the environment itself
                first = logic.push((sizes.face, points))
                to_cube.record(commands, (seen, level_of(cube, 0)), logic.groups(sizes.face), first)
            _finish_level(device, commands, source, 0)
            for level in range(1, sizes.source_levels):
                edge = sizes.face >> level
                held = (
                    Sampled(cube_view(device, source, level - 1, 1), whole.sampler),
                    level_of(source, level),
                )
                to_mips.record(commands, held, logic.groups(edge), logic.push((edge,)))
                _finish_level(device, commands, source, level)
            edge = sizes.irradiance_face
            counts = logic.push((edge, sizes.irradiance_source, sizes.irradiance_level))
            to_irradiance.record(commands, (whole, level_of(irradiance, 0)), logic.groups(edge), counts)
            for level in range(1, sizes.levels):
                edge = sizes.face >> level
                roughness = logic.level_roughness(level, sizes.levels)
                last = sizes.source_levels - 1
                lobe = logic.push((edge, last), roughness * roughness, logic.level_part(sizes, level))
                to_radiance.record(commands, (whole, level_of(radiance, level)), logic.groups(edge), lobe)
            for cube in (radiance, irradiance):
                transition(device, commands, cube, "storage", "sampled")
        made_ms = (clock.perf_counter() - began) * 1e3
        return Maps(read_levels(device, radiance), read_levels(device, irradiance)[0], scale), made_ms


def _make_table(device: Device, sizes: Sizes, table: Image) -> tuple[np.ndarray, float]:
    """Run the table's kernel; return what it wrote and its milliseconds. The image ends in the state 'sampled'."""
    kernel = _kernel(device, logic.TABLE_KERNEL)
    try:
        began = clock.perf_counter()
        with submit_once(device) as commands:
            transition(device, commands, table, "undefined", "storage")
            counts = logic.push((sizes.table, sizes.table_samples))
            kernel.record(commands, (Sampled(table.view),), logic.groups(sizes.table, 1), counts)
            transition(device, commands, table, "storage", "sampled")
        made_ms = (clock.perf_counter() - began) * 1e3
    finally:
        kernel.close()
    return read_levels(device, table)[0][0], made_ms


def _finish_level(device: Device, commands: Any, image: Image, level: int) -> None:
    dependency = barriers(image_barrier(image.handle, image.aspect, "storage", "sampled", level, 1))
    device.fn.vkCmdPipelineBarrier2(commands, dependency)


# --- to and from arrays ---


def _regions(image: Image) -> tuple[list[Any], list[tuple[int, ...]], int]:
    """Return the copies of all levels between an image and a buffer, the levels' shapes, and the buffer's bytes."""
    _, texel, _, channels = FORMATS[image.format]
    regions: list[Any] = []
    shapes: list[tuple[int, ...]] = []
    offset = 0
    for level in range(image.levels):
        width, height = max(1, image.width >> level), max(1, image.height >> level)
        regions.append(
            {
                "bufferOffset": offset,
                "imageSubresource": {
                    "aspectMask": image.aspect,
                    "mipLevel": level,
                    "layerCount": image.layers,
                },
                "imageExtent": {"width": width, "height": height, "depth": 1},
            }
        )
        shapes.append((image.layers, height, width, channels))
        offset += image.layers * width * height * texel
    return regions, shapes, offset


def fill(device: Device, image: Image, levels: Sequence[np.ndarray]) -> None:
    """Copy arrays (layers, H, W, C), one per level, into an image, which ends in the state 'sampled'."""
    regions, _, size = _regions(image)
    buffer = create_buffer(device, size, vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT, "upload", f"for {image.name}")
    try:
        data = np.concatenate([np.ascontiguousarray(level).view(np.uint8).reshape(-1) for level in levels])
        buffer.mapped[:] = data
        with submit_once(device) as commands:
            transition(device, commands, image, "undefined", "copy_target")
            layout = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
            copies = vk.array("VkBufferImageCopy", regions)
            device.fn.vkCmdCopyBufferToImage(
                commands, buffer.handle, image.handle, layout, len(regions), copies
            )
            transition(device, commands, image, "copy_target", "sampled")
    finally:
        destroy_buffer(device, buffer)


def read_levels(device: Device, image: Image) -> list[np.ndarray]:
    """Return all levels of an image in the state 'sampled', as arrays (layers, H, W, C); waits for the GPU."""
    regions, shapes, size = _regions(image)
    use = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    buffer: Buffer = create_buffer(device, size, use, "readback", f"from {image.name}")
    try:
        with submit_once(device) as commands:
            transition(device, commands, image, "sampled", "copy_source")
            layout = vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL
            copies = vk.array("VkBufferImageCopy", regions)
            device.fn.vkCmdCopyImageToBuffer(
                commands, image.handle, layout, buffer.handle, len(regions), copies
            )
            device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
            transition(device, commands, image, "copy_source", "sampled")
        device.memory.invalidate(buffer.allocation)
        flat = buffer.view(FORMATS[image.format][2])
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
        return [
            flat[end - int(np.prod(shape)) : end].reshape(shape).copy()
            for end, shape in zip(ends, shapes, strict=True)
        ]
    finally:
        destroy_buffer(device, buffer)
