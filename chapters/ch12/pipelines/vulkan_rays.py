"""Ray-tracing pipelines on Vulkan: stages in groups, libraries, and the shader binding table.

A ray-tracing pipeline has many shaders of one stage, and the GPU chooses among them while it traces. So a pipeline is a
list of *groups*: one shader of generation, miss or call, or the two or three shaders of a kind of surface. The driver
has a handle for each group, a few opaque bytes. The *shader binding table* is a buffer of these handles in four regions
(generation, miss, hit, callable); `vkCmdTraceRaysKHR` gets the address, stride and size of each region. The record of a
hit is chosen by the offset of the instance and by the arguments of `traceRayEXT`, that of a miss by its argument.

Three numbers of the device decide about the layout (VkPhysicalDeviceRayTracingPipelinePropertiesKHR): a record takes
the size of a handle, rounded up to the alignment of handles; a region begins at a multiple of the base alignment. The
region of generation has one record, whose stride equals its size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Buffer, buffer_address, create_buffer, destroy_buffer
from common.errors import UnsupportedError

from .ray_description import HitGroup, RayDescription
from .vulkan_cache import PipelineCache
from .vulkan_reflection import STAGES, Stage

LIBRARY = "VK_KHR_pipeline_library"
"""The extension by which pipelines are linked from libraries."""

_MISSING = "This device has no ray-tracing pipelines, or is used without them: trace by another way."


@dataclass(frozen=True)
class RayLimits:
    """The numbers of a device that ray pipelines depend on; sizes and alignments in bytes."""

    handle_size: int
    handle_alignment: int
    base_alignment: int
    deepest: int
    """The recursion that the device has."""
    most_rays: int
    """Rays in one trace."""
    most_stride: int
    """Bytes between two records."""

    @classmethod
    def of(cls, device: Device) -> RayLimits:
        """Return the numbers of a device."""
        limits = vk.new("VkPhysicalDeviceRayTracingPipelinePropertiesKHR")
        properties = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
        device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
        return cls(
            int(limits.shaderGroupHandleSize),
            int(limits.shaderGroupHandleAlignment),
            int(limits.shaderGroupBaseAlignment),
            int(limits.maxRayRecursionDepth),
            int(limits.maxRayDispatchInvocationCount),
            int(limits.maxShaderGroupStride),
        )


# --- the layout of the table ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Region:
    """A region of the table, in bytes: where it begins, the distance between its records, and its size."""

    offset: int = 0
    stride: int = 0
    size: int = 0


def table_layout(counts: Sequence[int], limits: RayLimits) -> tuple[tuple[Region, ...], int]:
    """Return the regions of a table with `counts` of generation, miss, hit and callable records, and its bytes.

    Offsets are multiples of the base alignment. An empty region is all zeros, which Vulkan takes for "none".
    """
    stride = _up(limits.handle_size, limits.handle_alignment)
    regions, end = [], 0
    for number, count in enumerate(counts):
        if not count:
            regions.append(Region())
            continue
        own = _up(stride, limits.base_alignment) if number == 0 else stride
        offset = _up(end, limits.base_alignment)
        regions.append(Region(offset, own, own * count))
        end = offset + own * count
    return tuple(regions), end


def _up(size: int, alignment: int) -> int:
    return -(-size // alignment) * alignment


class BindingTable:
    """The shader binding table of a pipeline: a buffer, and the four regions that a trace gets.

    It keeps the `libraries` of a linked pipeline: a driver may take the code of its groups from there.
    """

    def __init__(
        self, device: Device, described: RayDescription, pipeline: Any, libraries: Sequence[Any] = ()
    ) -> None:
        self._device, self.limits = device, RayLimits.of(device)
        limits, self._libraries = self.limits, libraries
        counts = (1, len(described.miss), len(described.hits), len(described.callables))
        self.handles = group_handles(device, pipeline, sum(counts), limits.handle_size)
        """(groups, handle size) uint8, in the order of the table."""
        self.regions, size = table_layout(counts, limits)
        self._buffer = self._filled(size, counts, described.title)
        address = buffer_address(device, self._buffer)
        self._start = -address % limits.base_alignment  # the buffer's own address may be no multiple
        self.write(self.handles)
        self.arguments = [
            vk.new(
                "VkStridedDeviceAddressRegionKHR",
                deviceAddress=(address + self._start + region.offset) if region.size else 0,
                stride=region.stride,
                size=region.size,
            )
            for region in self.regions
        ]

    def _filled(self, size: int, counts: Sequence[int], name: str) -> Buffer:
        self._counts = counts
        usage = vk.VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR | vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
        size += self.limits.base_alignment
        return create_buffer(self._device, size, usage, "upload", f"binding table of {name}")

    def write(self, handles: np.ndarray) -> None:
        """Write handles (groups, handle size) into the records, in the order of the table."""
        first = 0
        for region, count in zip(self.regions, self._counts, strict=True):
            for number in range(count):
                at = self._start + region.offset + number * region.stride
                self._buffer.mapped[at : at + handles.shape[1]] = handles[first + number]
            first += count

    def close(self) -> None:
        """Free the buffer and the libraries; no frame in flight uses them."""
        destroy_buffer(self._device, self._buffer)
        for library in self._libraries:
            self._device.destroy("VkPipeline", library)


def group_handles(device: Device, pipeline: Any, count: int, size: int) -> np.ndarray:
    """Return (count, size) uint8: the handles of a pipeline's groups."""
    handles = np.zeros((count, size), np.uint8)
    code = device.fn.vkGetRayTracingShaderGroupHandlesKHR(
        device.handle, pipeline, 0, count, handles.nbytes, vk.ffi.from_buffer(handles)
    )
    vk.check(code, "vkGetRayTracingShaderGroupHandlesKHR")
    return handles


# --- pipelines --------------------------------------------------------------------------------------------------------

_GENERAL = vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR
_TRIANGLES = vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR
_PROCEDURAL = vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_PROCEDURAL_HIT_GROUP_KHR
_NONE = dict.fromkeys(
    ("generalShader", "closestHitShader", "anyHitShader", "intersectionShader"), vk.VK_SHADER_UNUSED_KHR
)


def groups_of(described: RayDescription) -> list[str | HitGroup]:
    """Return the groups of a pipeline in the order of its table: a file of a general shader, or a hit group."""
    return [described.raygen, *described.miss, *described.hits, *described.callables]


def links(device: Device, stages: Sequence[Stage]) -> bool:
    """Whether a device links these stages from libraries; without, the pipeline is built as one.

    Some drivers give a linked pipeline no push constants.
    """
    if LIBRARY not in device.extensions:
        return False
    return device.capabilities.use("ray-tracing", "libraries") or not any(it.module.push for it in stages)


def build_rays(
    device: Device,
    described: RayDescription,
    stages: Sequence[Stage],
    special: Sequence[Any],
    layout: Any,
    cache: PipelineCache | None,
) -> tuple[Any, BindingTable]:
    """Return the VkPipeline of `stages`, those of `described.shaders` in their order, and its table.

    `special` are their VkSpecializationInfo, or None. Raises UnsupportedError on a device without ray pipelines, and
    ShaderError for a recursion that it does not have.
    """
    if not device.has("ray-tracing"):
        raise UnsupportedError(_MISSING)
    described.check(RayLimits.of(device).deepest)
    modules: list[Any] = []
    created: list[Any] = []  # with `linked` first the library of each group
    try:
        for file, stage in zip(described.shaders, stages, strict=True):
            info = vk.new("VkShaderModuleCreateInfo", codeSize=len(stage.code), pCode=stage.code)
            modules.append(device.create("vkCreateShaderModule", info, file))
        infos = {
            file: vk.new(
                "VkPipelineShaderStageCreateInfo",
                stage=STAGES[stage.name],
                module=module,
                pName="main",
                pSpecializationInfo=values,
            )
            for file, stage, module, values in zip(described.shaders, stages, modules, special, strict=True)
        }
        if described.linked and links(device, stages):
            for group in groups_of(described):
                created.append(_create(device, described, [group], infos, layout, cache, library=True))
            created.append(_create(device, described, [], {}, layout, cache, created))
        else:
            created.append(_create(device, described, groups_of(described), infos, layout, cache))
        return created[-1], BindingTable(device, described, created[-1], created[:-1])
    except BaseException:
        for pipeline in created:
            device.destroy("VkPipeline", pipeline)
        raise
    finally:
        for module in modules:
            device.destroy("VkShaderModule", module)


def _create(
    device: Device,
    described: RayDescription,
    groups: Sequence[str | HitGroup],
    infos: dict[str, Any],
    layout: Any,
    cache: PipelineCache | None,
    libraries: Sequence[Any] = (),
    library: bool = False,
) -> Any:
    files = dict.fromkeys(file for group in groups for file in _files(group))
    place = {file: number for number, file in enumerate(files)}
    interface = {
        "maxPipelineRayPayloadSize": described.payload_bytes,
        "maxPipelineRayHitAttributeSize": described.attribute_bytes,
    }
    info = vk.new(
        "VkRayTracingPipelineCreateInfoKHR",
        flags=vk.VK_PIPELINE_CREATE_LIBRARY_BIT_KHR if library else 0,
        pStages=[infos[file] for file in files] or None,
        pGroups=[_group(group, place) for group in groups] or None,
        maxPipelineRayRecursionDepth=described.recursion,
        pLibraryInfo={"pLibraries": list(libraries), "libraryCount": len(libraries)} if libraries else None,
        pLibraryInterface=interface if library or libraries else None,
        layout=layout,
    )
    out = vk.ffi.new("VkPipeline[1]")
    kept = cache.handle if cache else vk.NULL
    code = device.fn.vkCreateRayTracingPipelinesKHR(
        device.handle, vk.NULL, kept, 1, vk.array("VkRayTracingPipelineCreateInfoKHR", [info]), vk.NULL, out
    )
    vk.check(code, "vkCreateRayTracingPipelinesKHR", info)
    device.adopt("VkPipeline", out[0], described.title)
    return out[0]


def _files(group: str | HitGroup) -> tuple[str, ...]:
    return (group,) if isinstance(group, str) else group.shaders


def _group(group: str | HitGroup, place: dict[str, int]) -> dict[str, Any]:
    """Return the VkRayTracingShaderGroupCreateInfoKHR of a group; `place` has the number of each stage."""
    if isinstance(group, str):
        return {**_NONE, "sType": _GROUP, "type": _GENERAL, "generalShader": place[group]}
    unused = vk.VK_SHADER_UNUSED_KHR
    return {
        "sType": _GROUP,
        "type": _PROCEDURAL if group.intersection else _TRIANGLES,
        "generalShader": unused,
        "closestHitShader": place[group.closest] if group.closest else unused,
        "anyHitShader": place[group.any] if group.any else unused,
        "intersectionShader": place[group.intersection] if group.intersection else unused,
    }


_GROUP = vk.VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR
