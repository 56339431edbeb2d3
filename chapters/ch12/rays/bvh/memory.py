"""The buffers of our BVH on the GPU; `vulkan.py` and `gl.py` create them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from common.scene import Change, Pose, Scene
from common.scene.pose import evaluate_pose

from ...frames.commands import Commands, SceneBinding
from ...pipelines.description import Built
from ...scene.pass_parts import PassParts
from ..model import masks, opaque_materials
from ..passes import BUFFERS
from . import pack
from .model import NON_OPAQUE


class BvhMemory:
    """Nodes, triangles and instances of a scene, one buffer each."""

    def __init__(self, backend: Any, parts: PassParts) -> None:
        self._backend, self._scene, self._data = backend, parts.scene, parts.data
        self._trees = [_tree_of(parts.scene, mesh) for mesh in range(len(parts.scene.meshes))]
        content = self._packed(evaluate_pose(parts.scene, 0.0))
        self.sizes: Mapping[str, int] = {name: part.nbytes for name, part in content.items()}
        self.buffers = {name: self._create(part, name) for name, part in content.items()}
        for resources in backend.copies.also:
            resources |= self.buffers
        self.work: dict[str, int] = {"ray_structure_bytes": sum(self.sizes.values())}

    def _packed(self, pose: Pose) -> dict[str, np.ndarray]:
        """Return the content of the buffers as bytes, by name."""
        scene = self._scene
        matrices = np.array(pose.world_from_object, np.float64)
        matrices[:, :3, 3] -= scene.origin
        opaque = opaque_materials(scene)[scene.meshes["material"][scene.instances.mesh]]
        packed = pack.buffers(
            self._trees, matrices, scene.instances.mesh, masks(scene), flags=np.where(opaque, 0, NON_OPAQUE)
        )
        parts = (packed.nodes, packed.triangles, packed.instances)
        return {
            name: np.ascontiguousarray(part).view(np.uint8).reshape(-1)
            for name, part in zip(BUFFERS, parts, strict=True)
        }

    def prepare(self, slot: int, pose: Pose, deformed: bool = False) -> int:
        """Find out what a frame builds; return the bytes written."""
        return 0

    def key(self) -> Any:
        """Return what the recording of `record` depends on."""
        return None

    def record(self, commands: Commands, slot: int) -> None:
        """Record what the frame builds."""

    def bind_pass(
        self, commands: Any, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None:
        """Bind a pass that traces: a scene's binding, a page, and a set of textures or None."""
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
