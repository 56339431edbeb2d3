"""The buffers of our BVH on the GPU; `vulkan.py` and `gl.py` create them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from common.scene import Pose, Scene
from common.scene.pose import evaluate_pose

from ...frames.commands import Commands, SceneBinding
from ...pipelines.description import Built
from ...scene.pass_parts import PassParts
from .. import model
from . import pack
from .model import NON_OPAQUE


class BvhMemory:
    """Nodes, triangles and instances. The buffers have the order of `passes.BUFFERS`."""

    buffers: Sequence[Any]

    def __init__(self, backend: Any, parts: PassParts) -> None:
        self._backend, self._scene, self._data = backend, parts.scene, parts.data
        scene = parts.scene
        self._trees = [_tree_of(scene, mesh) for mesh in range(len(scene.meshes))]
        packed = self._pack(evaluate_pose(scene, 0.0))
        self.sizes = [part.nbytes for part in packed]
        self.buffers = [
            self._create(part, f"rays {name}") for part, name in zip(packed, ("nodes", "triangles", "instances"), strict=True)
        ]

    def _pack(self, pose: Pose) -> list[np.ndarray]:
        scene = self._scene
        materials = scene.meshes["material"][scene.instances.mesh]
        modes = np.array([material.alpha_mode for material in scene.materials])[materials] if len(materials) else materials
        matrices = np.array(pose.world_from_object, np.float64)
        matrices[:, :3, 3] -= scene.origin
        mask = np.where(modes == "blend", model.BLENDED, model.ORDINARY) * scene.instances.visible
        packed = pack.buffers(
            self._trees, matrices, scene.instances.mesh, mask, flags=np.where(modes == "opaque", 0, NON_OPAQUE)
        )
        return [np.ascontiguousarray(part).view(np.uint8).reshape(-1) for part in (packed.nodes, packed.triangles, packed.instances)]

    def bind(self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any) -> None:
        """Bind a kernel with a scene's binding, a page, and a set of textures or None."""
        raise NotImplementedError

    def _create(self, content: np.ndarray, name: str) -> Any:
        """Return a buffer of the device with this content."""
        raise NotImplementedError

    def close(self) -> None:
        """Free everything."""


def _tree_of(scene: Scene, mesh: int) -> pack.MeshTree:
    """Return the hierarchy over the triangles of a mesh."""
    row = scene.meshes[mesh]
    first, count = int(row["first_vertex"]), int(row["vertex_count"])
    start, length = int(row["first_index"]), int(row["index_count"])
    return pack.mesh_tree(scene.positions[first : first + count], scene.indices[start : start + length])
