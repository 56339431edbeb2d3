"""What the self-tests of ray tracing look at: four triangles, drawn twice, and where rays hit them.

The triangles lie side by side along x, and so do the two instances: that is Morton order, in which acceleration
structures are always built.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.resources import Buffer, buffer_address, create_buffer, destroy_buffer
from backends.vulkan.selftests.bench import BUFFER_USAGE, EVERYTHING, Bench
from backends.vulkan.selftests.bindings import Acceleration

RAYS = 1024

CORNERS = np.array(
    [[(0, 0, z), (1, 0, z + 0.25), (0, 1, z)] for z in (0.0, 0.5, -0.25, 1.0)], np.float64
) + np.array([(x, 0, 0) for x in range(4)])[:, None]  # fmt: skip
"""(4, 3, 3): triangle, corner, coordinate."""

OFFSETS = np.array([(0.0, 0.0, 0.0), (4.0, 0.0, -2.0)])
"""Where the two instances are."""

_BUILD_INPUT = vk.VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR


def rays() -> np.ndarray:
    """Return (RAYS, 8) float32: origins (w unused) and directions (w unused), over and beside the triangles."""
    random = np.random.default_rng(12)
    rays = np.zeros((RAYS, 8), np.float32)
    rays[:, 0:3] = random.uniform((-0.5, -0.5, 4.0), (8.5, 1.5, 6.0), (RAYS, 3))
    rays[:, 4:7] = random.normal((0.0, 0.0, -1.0), (0.1, 0.1, 0.05), (RAYS, 3))
    return rays


def expected(rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what rays hit: 0 or 1 + 4 instance + triangle, the distance, and whether that is beyond doubt.

    In float64, by Möller and Trumbore's "Fast, Minimum Storage Ray/Triangle Intersection" (1997). A ray within 1e-4 of
    an edge is in doubt.
    """
    origins, directions = rays[:, 0:3].astype(np.float64), rays[:, 4:7].astype(np.float64)
    corners = (CORNERS[None] + OFFSETS[:, None, None]).reshape(8, 3, 3)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(directions[:, None], second)
    determinant = np.einsum("ijk,jk->ij", p, first)
    t = origins[:, None] - corners[:, 0]
    u = np.einsum("ijk,ijk->ij", t, p) / determinant
    q = np.cross(t, first)
    v = np.einsum("ik,ijk->ij", directions, q) / determinant
    distance = np.einsum("ijk,jk->ij", q, second) / determinant
    margin = np.minimum(np.minimum(u, v), 1.0 - u - v)
    distance = np.where((margin >= 0) & (distance > 0), distance, np.inf)
    nearest = distance.argmin(axis=1)
    reached = distance[np.arange(len(rays)), nearest]
    hit = np.where(np.isfinite(reached), nearest + 1, 0)
    return hit, reached, (np.abs(margin) > 1e-4).all(axis=1)


def compare(words: np.ndarray, rays: np.ndarray) -> str:
    """Return "" if (RAYS, 2) uint32 words, hit and distance as float bits, are right, else what is wrong."""
    hit, reached, sure = expected(rays)
    wrong = (words[:, 0] != hit) & sure
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        return (
            f"{wrong.sum()} of {RAYS} rays hit another triangle, the first ({first}) hits "
            f"{words[first, 0]} and should hit {hit[first]}"
        )
    both = (hit > 0) & sure
    distance = words[:, 1].copy().view(np.float32)[both]
    error = np.max(np.abs(distance - reached[both]) / reached[both])
    return "" if error < 1e-5 else f"the relative error of the distance is {error:.1e}"


def build(bench: Bench) -> Acceleration:
    """Return the top-level acceleration structure of both instances."""
    vertices = bench.input(CORNERS.astype(np.float32), _BUILD_INPUT)
    triangles = {
        "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
        "vertexFormat": vk.VK_FORMAT_R32G32B32_SFLOAT,
        "vertexData": {"deviceAddress": buffer_address(bench.device, vertices)},
        "vertexStride": 12,
        "maxVertex": 11,
        "indexType": vk.VK_INDEX_TYPE_NONE_KHR,
    }
    bottom = _structure(
        bench,
        vk.VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        {
            "geometryType": vk.VK_GEOMETRY_TYPE_TRIANGLES_KHR,
            "geometry": {"triangles": triangles},
            "flags": vk.VK_GEOMETRY_OPAQUE_BIT_KHR,
        },
        len(CORNERS),
    )
    info = vk.new("VkAccelerationStructureDeviceAddressInfoKHR", accelerationStructure=bottom)
    address = bench.fn.vkGetAccelerationStructureDeviceAddressKHR(bench.device.handle, info)
    # VkAccelerationStructureInstanceKHR: 3x4 matrix, index and mask, offset and flags, address.
    record = np.dtype(
        [("matrix", "<f4", (3, 4)), ("index_mask", "<u4"), ("flags", "<u4"), ("address", "<u8")]
    )
    instances = np.zeros(len(OFFSETS), record)
    instances["matrix"][:, :, :3] = np.eye(3)
    instances["matrix"][:, :, 3] = OFFSETS
    instances["index_mask"] = np.arange(len(OFFSETS)) | 0xFF << 24
    instances["address"] = address
    list_ = bench.input(instances, _BUILD_INPUT)
    data = {
        "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
        "data": {"deviceAddress": buffer_address(bench.device, list_)},
    }
    top = _structure(
        bench,
        vk.VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
        {"geometryType": vk.VK_GEOMETRY_TYPE_INSTANCES_KHR, "geometry": {"instances": data}},
        len(OFFSETS),
    )
    return Acceleration(top)


def _buffer(bench: Bench, size: int, usage: int) -> Buffer:
    buffer = create_buffer(bench.device, size, BUFFER_USAGE | usage, "device", "acceleration structure")
    bench.at_end(destroy_buffer, bench.device, buffer)
    return buffer


def _structure(bench: Bench, kind: int, geometry: dict[str, Any], count: int) -> Any:
    """Return an acceleration structure of `count` triangles or instances, built."""
    fn, device = bench.fn, bench.device
    info = vk.new(
        "VkAccelerationStructureBuildGeometryInfoKHR",
        type=kind,
        mode=vk.VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        pGeometries=[geometry],
        geometryCount=1,
    )
    sizes = vk.new("VkAccelerationStructureBuildSizesInfoKHR")
    by_device = vk.VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR
    counts = vk.array("uint32_t", [count])
    fn.vkGetAccelerationStructureBuildSizesKHR(device.handle, by_device, info, counts, sizes)
    size = int(sizes.accelerationStructureSize)
    storage = _buffer(bench, size, vk.VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR)
    structure = bench.make(
        "vkCreateAccelerationStructureKHR",
        "VkAccelerationStructureCreateInfoKHR",
        buffer=storage.handle,
        size=size,
        type=kind,
    )
    # No driver aligns scratch memory to more than 256 bytes.
    scratch = _buffer(bench, int(sizes.buildScratchSize) + 256, 0)
    info.dstAccelerationStructure = structure
    info.scratchData.deviceAddress = (buffer_address(device, scratch) + 255) & ~255
    ranges = vk.new("VkAccelerationStructureBuildRangeInfoKHR", primitiveCount=count)
    pointers = vk.array("VkAccelerationStructureBuildRangeInfoKHR *", [ranges])
    with bench.submit() as commands:
        fn.vkCmdBuildAccelerationStructuresKHR(commands, 1, info, pointers)
        fn.vkCmdPipelineBarrier2(commands, barriers(memory=EVERYTHING))
    return structure
