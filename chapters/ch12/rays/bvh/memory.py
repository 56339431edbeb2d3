"""Our BVH of a scene on the GPU; `vulkan.py` and `gl.py` create its buffers and bind its kernels.

The trees of meshes are built when the renderer is opened. Afterwards kernels refit them: those of meshes that deform to
the vertices of the slot, and the upper level to the records of instances that draws read. A frame in which nothing has
moved records nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.scene import Change, Pose, Scene
from common.scene.pose import evaluate_pose

from ...frames.commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built
from ...scene.pages import mesh_records
from ...scene.pass_parts import PassParts
from ..model import check_count, masks, opaque_materials, two_sided
from ..passes import BUFFERS
from ..triangles import mesh_triangles
from . import pack
from .model import CONSTANTS, NON_OPAQUE, TWO_SIDED

TRIANGLES, NODES, INSTANCES = "triangles", "nodes", "instances"
"""The kernels: corners of triangles that deform, boxes of nodes, and records of instances."""

_SHARED = tuple(CONSTANTS.items())
KERNELS = {
    TRIANGLES: ComputeDescription("rays/bvh/refit.comp", (*_SHARED, ("TRIANGLES", 1)), name="ray triangles"),
    NODES: ComputeDescription("rays/bvh/refit.comp", _SHARED, name="ray nodes"),
    INSTANCES: ComputeDescription("rays/bvh/instances.comp", _SHARED, name="ray instances"),
}

TABLES = ("meshes", "list", "slots")
"""The buffers that only the kernels read: records of meshes, nodes by levels, and what is known of each instance."""


class BvhMemory:
    """The trees of a scene, from opening to closing. `work` has the counters of the last frame."""

    def __init__(self, backend: Any, parts: PassParts) -> None:
        self._backend, self._scene = backend, parts.scene
        self._data: Any = parts.data  # that of the backend
        scene = parts.scene
        check_count(len(scene.instances))
        self._deforming = sorted({deformation.mesh for deformation in scene.deformations})
        self._built = dict(zip(KERNELS, parts.pipelines.get(list(KERNELS.values())), strict=True))
        self._seen: Any = None
        self._revision = 0
        self.moves = self.refits = False
        """What the frame does, from `prepare` on."""
        content = self._content()
        self.sizes: Mapping[str, int] = {name: content[name].nbytes for name in BUFFERS}
        self.buffers = self._create(content)
        self.bind_pass = self.surfaces(backend).bind
        for resources in backend.copies.also:
            resources |= {name: self.buffers[name] for name in BUFFERS}
        self._make_bindings()
        self.work: dict[str, int] = {}

    def _content(self) -> dict[str, NDArray[np.uint8]]:
        """Build the trees, and return the content of all buffers as bytes, by name."""
        scene = self._scene
        meshes = [_turned(mesh_triangles(scene, mesh)) for mesh in range(len(scene.meshes))]
        trees = pack.mesh_trees(meshes, deforming=self._deforming)
        matrices = np.array(evaluate_pose(scene, 0.0).world_from_object, np.float64)
        matrices[:, :3, 3] -= scene.origin
        try:
            packed = pack.buffers(
                trees, matrices, scene.instances.mesh, masks(scene, hidden=True), flags=_flags(scene)
            )
        except ValueError as error:
            raise SceneError(f"This scene cannot be traced: {error}.") from error
        self._left_out, self._instances, self._slots = packed.left_out, len(scene.instances), packed.slots
        self._runs = [
            (mesh, int(packed.firsts[mesh]), len(trees[mesh].triangles)) for mesh in self._deforming
        ]
        own = [(int(packed.roots[mesh]), trees[mesh].levels) for mesh in self._deforming]
        below = pack.refit_lists(own)
        top = [
            np.arange(first, end, dtype=np.uint32)
            for first, end in zip(packed.levels[-2::-1], packed.levels[:0:-1], strict=True)
        ]
        self._levels, self._top_levels = _places([*below], 0), _places(top, sum(map(len, below)))
        lists = np.concatenate([*below, *top, np.zeros(1, np.uint32)])
        self._pages, self._indices = self._data.pages, scene.indices
        records, self._page_of, _ = mesh_records(scene, self._pages)
        parts = (packed.nodes, packed.triangles, packed.instances, records, lists, packed.slots)
        return {
            name: np.frombuffer(part.tobytes() or bytes(64), np.uint8)
            for name, part in zip((*BUFFERS, *TABLES), parts, strict=True)
        }

    # --- every frame ---

    def prepare(self, slot: int, pose: Pose, deformed: bool = False) -> int:
        """Find out what a frame refits; return the bytes written. `deformed` says that a pass moves vertices."""
        scene, data = self._scene, self._data
        materials = scene.revision[Change.MATERIALS]
        if data.pages is not self._pages:
            self._make_anew()
        elif self._seen is not None and materials != self._seen[2]:
            self._follow_kinds()
        moving = data.records.moving_key(pose)
        key = (moving, scene.revision[Change.VISIBILITY], materials, self._revision)
        posed = self._seen is None or moving != self._seen[0]
        self.refits = bool(self._deforming) and (deformed or posed)
        self.moves = self.refits or key != self._seen
        self._seen = key
        self.work = {
            "ray_structure_bytes": sum(self.sizes.values()),
            "ray_triangles_left_out": self._left_out,
            "ray_refits": len(self._deforming) * self.refits,
            "ray_top_builds": int(self.moves),
            "ray_instances": self._instances,
        }
        return 0

    def key(self) -> Any:
        """Return what the recording of `record` depends on."""
        return self._revision, self.moves, self.refits

    def record(self, commands: Commands, slot: int) -> None:
        """Record the kernels of the frame; each level of nodes waits for the one below."""
        if not self.moves or not self._instances:
            return
        if self.refits:
            for mesh, first, count in self._runs:
                page = int(self._page_of[mesh])
                self._run(commands, TRIANGLES, slot, (first, count, page, 0), page)
            self._fit(commands, slot, self._levels, 0)
            commands.compute_barrier()
        self._run(commands, INSTANCES, slot, (0, self._instances, 0, 0))
        self._fit(commands, slot, self._top_levels, 1)
        self._end(slot)

    def _fit(self, commands: Commands, slot: int, levels: Sequence[tuple[int, int]], upper: int) -> None:
        for first, count in levels:
            commands.compute_barrier()
            self._run(commands, NODES, slot, (first, count, upper, 0))

    def _run(
        self, commands: Commands, kernel: str, slot: int, numbers: tuple[int, ...], page: int = 0
    ) -> None:
        pipeline = self._built[kernel]
        self._bind_kernel(commands, kernel, pipeline, slot, page)
        commands.push(pipeline, np.array(numbers, np.uint32))
        commands.dispatch_over(pipeline, (numbers[1],))

    # --- after an edit of materials ---

    def _follow_kinds(self) -> None:
        """Tell the kernel which instances are opaque and which let light through, if that has changed."""
        slots, known = self._slots, self._slots.copy()
        slots["mask"] = masks(self._scene, hidden=True)[slots["instance"]]
        slots["flags"] = _flags(self._scene)[slots["instance"]]
        if (slots != known).any():
            self._revision += 1
            self._replace({"slots": np.frombuffer(slots.tobytes(), np.uint8)})

    def _make_anew(self) -> None:
        before = self.sizes
        content = self._content()
        self._revision += 1
        self._replace(content)
        if {name: content[name].nbytes for name in BUFFERS} != before:
            raise SceneError(
                "An edit of materials changed what rays traverse: open the renderer again to trace this scene."
            )

    # --- by backend ---

    surfaces: Callable[[Any], Any]
    """Makes what binds a scene's binding, a page, and a set of textures or None."""

    def _create(self, content: Mapping[str, NDArray[np.uint8]]) -> dict[str, Any]:
        """Return buffers of the device with this content, by name."""
        raise NotImplementedError

    def _replace(self, content: Mapping[str, NDArray[np.uint8]]) -> None:
        """Write other content to the buffers, after frames in flight, and follow other pages of geometry."""
        raise NotImplementedError

    def _make_bindings(self) -> None:
        """Make what `_bind_kernel` binds."""

    def _bind_kernel(self, commands: Any, kernel: str, pipeline: Built, slot: int, page: int) -> None:
        """Bind a kernel with the buffers of a slot; the kernel of triangles with a page of geometry."""
        raise NotImplementedError

    def _end(self, slot: int) -> None:
        """Bind again what the kernels replaced."""

    def close(self) -> None:
        """Free everything; no frame is in flight."""
        raise NotImplementedError


def _flags(scene: Scene) -> NDArray[np.uint32]:
    """Return (I,) the flags of records."""
    flags = np.where(opaque_materials(scene), 0, NON_OPAQUE) + np.where(two_sided(scene), TWO_SIDED, 0)
    of_instance: NDArray[np.uint32] = flags.astype(np.uint32)[scene.meshes["material"][scene.instances.mesh]]
    return of_instance


def _turned(triangles: tuple[NDArray[np.uint32], NDArray[np.float32]]) -> tuple[Any, Any]:
    indices, positions = triangles
    return positions, indices


def _places(lists: Sequence[NDArray[np.uint32]], first: int) -> list[tuple[int, int]]:
    """Return (first, count) of each list, when all stand behind one another from `first` on."""
    places = []
    for part in lists:
        places.append((first, len(part)))
        first += len(part)
    return places
