"""Our BVH of a scene on the GPU; `vulkan.py` and `gl.py` create its buffers and bind its kernels.

The trees of meshes are built when the renderer is opened. Afterwards kernels refit them: those of meshes that deform to
the vertices of the slot, and the upper level to the records of instances that draws read. Behind the refits the costs
of these trees are measured, and a tree whose cost has risen too much is built anew (quality.py). A frame in which
nothing has moved records nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.scene import Change, Pose, Scene
from common.scene.pose import evaluate_pose

from ...frames.commands import Commands
from ...pipelines.description import Built
from ...scene.pages import mesh_records
from ...scene.pass_parts import PassParts
from ..model import check_count, masks, opaque_materials, two_sided
from ..passes import BUFFERS
from ..triangles import mesh_triangles
from . import build, pack
from .fast import Rebuilt, Step
from .kernels import (
    BOUND,
    COST,
    EVERY_FRAME,
    INSTANCES,
    NODES,
    QUALITY,
    TRIANGLES,
    rebuild_kernels,
    title,
)
from .model import LEAF_LARGEST, NON_OPAQUE, TWO_SIDED
from .quality import Watch

TABLES = ("meshes", "list", "slots")
"""The buffers that only the kernels read: records of meshes, nodes by levels, and what is known of each instance."""

SCRATCH = ("pairs", "other", "counts", "halves")
"""Those of rebuilds. The pairs stay what they are: refits of trees that the GPU built follow their order."""

Levels = list[list[tuple[int, int]]]
"""Ranges (first, count) of the list of nodes, of each level."""


class BvhMemory:
    """The trees of a scene, from opening to closing. `work` has the counters of the last frame."""

    def __init__(self, backend: Any, parts: PassParts) -> None:
        self._backend, self._scene = backend, parts.scene
        self._data: Any = parts.data  # that of the backend
        scene = parts.scene
        check_count(len(scene.instances))
        self._deforming = sorted({deformation.mesh for deformation in scene.deformations})
        self._settings = parts.settings.rays
        self._seen: Any = None
        self._current: tuple[str, int] | None = None
        self._revision = 0
        self.moves = self.refits = False
        self.rebuilds: tuple[int, ...] = ()
        """What the frame does, from `prepare` on; `rebuilds` are places among the deforming meshes, or behind them."""
        content = self._content()
        self._make_kernels(parts.pipelines)
        self.sizes: Mapping[str, int] = {name: content[name].nbytes for name in BUFFERS}
        self.buffers = self._create(content)
        self.told = self._create_told(len(self._trees)) if self._watch else []
        self.bind_pass = self.surfaces(backend).bind
        for resources in backend.copies.also:
            resources |= {name: self.buffers[name] for name in BUFFERS}
        self._make_bindings()
        self.work: dict[str, int] = {}

    def trace_by(self, pipelines: Sequence[Built]) -> None:
        """Let several pipelines of one pass trace; the frame graph binds the buffers for any."""

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
        self._pages, self._indices = self._data.pages, scene.indices
        records, self._page_of, _ = mesh_records(scene, self._pages)
        own = [trees[mesh].levels for mesh in self._deforming]
        below = pack.refit_lists([
            (int(packed.roots[mesh]), levels) for mesh, levels in zip(self._deforming, own, strict=True)
        ])  # fmt: skip
        top = [
            np.arange(first, end, dtype=np.uint32)
            for first, end in zip(packed.levels[-2::-1], packed.levels[:0:-1], strict=True)
        ]
        self._own_levels, end = _ranges(own), sum(map(len, below))
        self._top_levels: Levels = []
        for level in top:
            self._top_levels.append([(end, len(level))])
            end += len(level)
        lists = np.concatenate([*below, *top, np.zeros(1, np.uint32)])
        self._begin(trees, packed)
        parts = (packed.nodes, packed.triangles, packed.instances, records, lists, packed.slots)
        content = {
            name: np.frombuffer(part.tobytes() or bytes(64), np.uint8)
            for name, part in zip((*BUFFERS, *TABLES), parts, strict=True)
        }
        return content | self._scratch()

    # --- what may be built anew ---

    def _begin(self, trees: Sequence[pack.MeshTree], packed: pack.Buffers) -> None:
        """Begin to watch the trees that kernels refit, which are as they were built."""
        self._trees, pair = [], 0
        top = int(packed.levels[0])
        own = self._deforming
        columns = packed.roots[own], packed.firsts[own], [len(trees[mesh].triangles) for mesh in own]
        places = np.column_stack([*columns, self._page_of[own]]).astype(np.int64).tolist()
        costs = [build.cost(trees[mesh].nodes) for mesh in own]
        sizes = [*(place[2] for place in places), self._instances]
        self._by_gpu: frozenset[int] = frozenset()
        self._before = self._by_gpu
        self._levels = _without(self._own_levels, self._by_gpu)
        self._watch = None
        if self._settings.ray_rebuild > 0:
            least = [LEAF_LARGEST] * len(places) + [2]
            costs.append(build.cost(packed.nodes[top:]))
            budget = int(self._settings.ray_rebuild_budget)
            watch = Watch(sizes, costs, least, self._settings.ray_rebuild, budget)
            self._watch = watch if watch.watched else None
        for number, place in enumerate((*places, (top, 0, self._instances, 0))):
            root, first, count, page = place
            self._trees.append(Rebuilt(root, first, count, page, pair, upper=number == len(places)))
            pair += sizes[number] * bool(self._watch and number in self._watch.watched)
        self._watched = self._watch.watched if self._watch else ()

    def _scratch(self) -> dict[str, NDArray[np.uint8]]:
        sizes = [self._trees[number].sizes for number in self._watched]
        if not sizes:
            return {}
        pairs = sum(it["pairs"] for it in sizes)
        most = [max(it[name] for it in sizes) for name in SCRATCH[2:]]
        return {
            name: np.zeros(size, np.uint8) for name, size in zip(SCRATCH, (pairs, pairs, *most), strict=True)
        }

    def _make_kernels(self, pipelines: Any) -> None:
        described, self._bound = rebuild_kernels(
            step for number in self._watched for step in self._trees[number].rebuild()
        )
        described |= EVERY_FRAME | (COST if self._watch else {})
        self._bound |= {name: BOUND[name] for name in described if name in BOUND}
        self._built = dict(zip(described, pipelines.get(list(described.values())), strict=True))

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
        self._follow_costs(slot)
        self.work = {
            "ray_structure_bytes": sum(self.sizes.values()),
            "ray_triangles_left_out": self._left_out,
            "ray_refits": len(self._deforming) * self.refits,
            "ray_rebuilds": len(self.rebuilds),
            "ray_quality_percent": self._watch.worst_percent if self._watch else 100,
            "ray_top_builds": int(self.moves),
            "ray_instances": self._instances,
        }
        return 0

    def _follow_costs(self, slot: int) -> None:
        """Read what the last frame of the slot has measured, and find out what this frame builds and measures."""
        watch = self._watch
        if watch is None:
            return
        if watch.asks(slot):
            watch.take(slot, self._read_told(slot))
        if self._before is not self._by_gpu:
            self._before = self._by_gpu
            self._levels = _without(self._own_levels, self._before)
        self.rebuilds = watch.due()
        if self.rebuilds:
            self._by_gpu = self._before | {*self.rebuilds}
            self.refits |= self.rebuilds[0] < len(self._deforming) or len(self.rebuilds) > 1
            self.moves = True
        if self.moves:
            watch.ask(slot, self.refits)

    def key(self) -> Any:
        """Return what the recording of `record` depends on."""
        return self._revision, self.moves, self.refits, self.rebuilds, self._before

    def record(self, commands: Commands, slot: int) -> None:
        """Record the kernels of the frame; each level of nodes waits for the one below."""
        if not self.moves or not self._instances:
            return
        self._current = None
        top = len(self._deforming)
        if self.refits:
            for number, tree in enumerate(self._trees[:top]):
                if number not in self._before:
                    push = (tree.first, tree.triangles, tree.page, 0)
                    self._run(commands, TRIANGLES, slot, push, tree.page)
            self._fit(commands, slot, self._levels, 0)
            for number, tree in enumerate(self._trees[:top]):
                self._follow(commands, slot, number, tree)
            commands.compute_barrier()
        self._run(commands, INSTANCES, slot, (0, self._instances, 0, 0))
        if top not in self._before:
            self._fit(commands, slot, self._top_levels, 1)
        self._follow(commands, slot, top, self._trees[top])
        if self._watch:
            self._measure(commands, slot)
        self._end(slot)

    def _follow(self, commands: Commands, slot: int, number: int, tree: Rebuilt) -> None:
        """Refit a tree that the GPU has built, and build one anew, which has been refitted."""
        if number in self._before:
            self._walk(commands, slot, tree.refit())
        if number in self.rebuilds:
            self._walk(commands, slot, tree.rebuild())

    def _measure(self, commands: Commands, slot: int) -> None:
        """Measure what was refitted, for the CPU."""
        numbers = [it for it in self._watched if self.refits or it == len(self._deforming)]
        if not numbers:
            return
        commands.compute_barrier()
        pipeline = self._built[QUALITY]
        self._bind_kernel(commands, QUALITY, pipeline, slot, 0)
        for number in numbers:
            tree = self._trees[number]
            commands.push(pipeline, np.array((tree.root, tree.nodes, number, 0), np.uint32))
            commands.dispatch(1)
        self._finish_told(commands)

    def _fit(self, commands: Commands, slot: int, levels: Levels, upper: int) -> None:
        for level in levels:
            commands.compute_barrier()
            for first, count in level:
                self._run(commands, NODES, slot, (first, count, upper, 0))

    def _walk(self, commands: Commands, slot: int, steps: Iterable[Step]) -> None:
        for step in steps:
            commands.compute_barrier()
            page = step.push[2] if step.file == "refit.comp" else 0
            self._run(commands, title(step), slot, step.push, page, step.invocations)

    def _run(
        self,
        commands: Commands,
        kernel: str,
        slot: int,
        numbers: tuple[int, ...],
        page: int = 0,
        invocations: int | None = None,
    ) -> None:
        """Run a kernel with push constants; it has as many invocations as the second of them, or as are given."""
        pipeline = self._built[kernel]
        if self._current != (kernel, page):  # the levels of a tree follow one another
            self._bind_kernel(commands, kernel, pipeline, slot, page)
            self._current = kernel, page
        commands.push(pipeline, np.array(numbers, np.uint32))
        commands.dispatch_over(pipeline, (numbers[1] if invocations is None else invocations,))

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

    def _create_told(self, count: int) -> list[Any]:
        """Return a buffer of so many floats for each slot that kernels write and the CPU reads."""
        raise NotImplementedError

    def _read_told(self, slot: int) -> NDArray[np.float32]:
        """Return the costs that the last frame of a slot has measured."""
        raise NotImplementedError

    def _finish_told(self, commands: Any) -> None:
        """Make the costs visible to the CPU."""
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


def _ranges(trees: Sequence[Sequence[int]]) -> list[list[tuple[int, int, int]]]:
    """Return (tree, first, count) in the lists of `pack.refit_lists`, of all trees in each level, deepest first."""
    ranges: list[list[tuple[int, int, int]]] = []
    begun = 0
    for at in range(max((len(levels) - 1 for levels in trees), default=0) - 1, -1, -1):
        ranges.append([])
        for tree, levels in enumerate(trees):
            if at < len(levels) - 1:
                count = levels[at + 1] - levels[at]
                ranges[-1].append((tree, begun, count))
                begun += count
    return ranges


def _without(ranges: Sequence[Sequence[tuple[int, int, int]]], trees: frozenset[int]) -> Levels:
    """Return the ranges of each level without those of some trees; neighbours are one range."""
    levels: Levels = []
    for level in ranges:
        left: list[tuple[int, int]] = []
        for tree, first, count in level:
            if tree in trees:
                continue
            if left and sum(left[-1]) == first:
                left[-1] = (left[-1][0], left[-1][1] + count)
            else:
                left.append((first, count))
        if left:
            levels.append(left)
    return levels
