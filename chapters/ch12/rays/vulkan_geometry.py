"""What acceleration structures of meshes are built from: triangles, or boxes with surfaces of another kind inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk

_FAST = vk.VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR
_COMPACTS = vk.VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_COMPACTION_BIT_KHR
_UPDATES = vk.VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR


class _Source:
    refits: bool

    @property
    def flags(self) -> int:
        """The flags of its builds."""
        return int(_FAST | (_UPDATES if self.refits else _COMPACTS))


@dataclass(frozen=True)
class MeshGeometry(_Source):
    """The triangles of a mesh: addresses of its vertices (three floats each) and of its indices, and their numbers.

    One that `refits` is updated when its vertices have moved; the others are compacted.
    """

    vertices: int
    vertex_count: int
    indices: int
    count: int
    name: str
    refits: bool = False

    def info(self, vertices: int | None = None) -> dict[str, Any]:
        """Return the VkAccelerationStructureGeometryKHR, with other vertices if they are given."""
        triangles = {
            "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
            "vertexFormat": vk.VK_FORMAT_R32G32B32_SFLOAT,
            "vertexData": {"deviceAddress": self.vertices if vertices is None else vertices},
            "vertexStride": 12,
            "maxVertex": max(self.vertex_count - 1, 0),
            "indexType": vk.VK_INDEX_TYPE_UINT32,
            "indexData": {"deviceAddress": self.indices},
        }
        # Whether a surface is opaque is a matter of the instance's material, so the flags of instances decide it.
        return {
            "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            "geometryType": vk.VK_GEOMETRY_TYPE_TRIANGLES_KHR,
            "geometry": {"triangles": triangles},
        }


@dataclass(frozen=True)
class BoxGeometry(_Source):
    """Boxes, in which intersection shaders look for surfaces: the address of six floats each, low and high corners."""

    boxes: int
    count: int
    name: str
    refits: bool = False

    def info(self, boxes: int | None = None) -> dict[str, Any]:
        """Return the VkAccelerationStructureGeometryKHR, with other boxes if they are given."""
        data = {
            "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_AABBS_DATA_KHR,
            "data": {"deviceAddress": self.boxes if boxes is None else boxes},
            "stride": 24,
        }
        return {
            "sType": vk.VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            "geometryType": vk.VK_GEOMETRY_TYPE_AABBS_KHR,
            "geometry": {"aabbs": data},
        }


Geometry = MeshGeometry | BoxGeometry
