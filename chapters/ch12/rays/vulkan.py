"""The acceleration structures of a scene on Vulkan: one for each mesh, and one over all instances.

    structures = RayStructures(backend, scene)
    structures.make_sets(pipelines, number)        # of pipelines that trace
    structures.prepare(slot, pose)                 # each frame, after the records of instances are written
    structures.record(commands, slot)              # in the pass before those that trace; `key` says when anew
    structures.bind(commands, pipeline)            # after `bind_compute` of a pipeline that traces

Meshes that deform are refitted to the vertices of the slot when those change, and built anew where a report says that
their shape is another one (vulkan_quality.py); the upper level is built anew when an instance has moved, was shown or
hidden. Otherwise nothing is recorded. A mesh whose triangles get another order (see `SceneData.reordered`) is built
anew with all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.resources import Buffer, buffer_address, create_buffer, destroy_buffer
from backends.vulkan.upload import Uploader
from common.errors import SceneError
from common.scene import Change, Pose, Scene

from ..frames.backend.vulkan import VulkanBackend
from ..frames.commands import SceneBinding
from ..frames.frame import SLOTS
from ..frames.vulkan_commands import Commands
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from ..pipelines.vulkan_descriptors import Held, Sets, Structure
from ..scene.pages import mesh_records
from ..scene.pass_parts import PassParts
from ..visibility.vulkan import Bindings
from .bvh.morton import order as morton_order
from .model import check_count, instance_table, order_words
from .settings import RaySettings
from .triangles import build_order, mesh_triangles
from .vulkan_build import DEFAULT, INPUT, Bottoms, Budget, StructureLimits
from .vulkan_geometry import MeshGeometry
from .vulkan_quality import Shape, figure_of, shape_reports
from .vulkan_top import TopLevel, Waits

RECORDS = ComputeDescription("rays/vulkan_records.comp", name="ray records")

SORT_EVERY = 64
"""Moved frames until instances are put into Morton order again: the software driver's hierarchy follows their order."""

STRUCTURES_SET = 4

_STORAGE = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT


class RayStructures:
    """The structures of a scene, from opening to closing. `work` has the counters of the last frame."""

    def __init__(
        self,
        backend: VulkanBackend,
        scene: Scene,
        budget: Budget = DEFAULT,
        settings: RaySettings | None = None,
    ) -> None:
        """Build all. The settings say when a structure that is refitted is built anew: without them never."""
        self._backend, self._settings = backend, settings
        self._reports: Any = None
        self._device, self._data = backend.device, backend.data
        self._resources, self._descriptors = backend.resources, backend.descriptors
        self._surfaces = Bindings(backend)
        self._scene, self._budget, self._limits = scene, budget, StructureLimits.of(backend.device)
        check_count(len(scene.instances), self._limits.most_instances)
        self._kernel = backend.pipelines.get([RECORDS])[0]
        self._waits = Waits(backend.device)
        self._deforming = frozenset(deformation.mesh for deformation in scene.deformations)
        self.work: dict[str, int] = {}
        self.revision = 0
        """Counts how often all was made anew."""
        self.builds_top = self.refits = False
        self.rebuilds: tuple[int, ...] = ()
        """What the frame builds, from `prepare` on."""
        self._sets: Sets | None = None
        self._traced: tuple[Sequence[Built], int] = ((), 0)
        self._trace_sets: dict[Any, Any] = {}
        self._order: NDArray[np.int64] = np.arange(len(scene.instances))
        self._sorted_ago = SORT_EVERY
        self._seen: Any = None
        self._table = np.zeros((0, 4), np.uint32)
        self._table_key: Any = None
        self._written: list[Any] = [None] * SLOTS
        self._make()

    # --- made once, and anew with the geometry ---

    def _make(self) -> None:
        scene = self._scene
        self._pages = self._page_buffers()
        records, page_of, _ = mesh_records(scene, self._data.pages)
        used = np.unique(scene.instances.mesh).tolist()
        orders: dict[int, NDArray[np.uint32]] = {}
        lists: list[NDArray[np.uint32]] = []
        figures: dict[int, float] = {}
        for mesh in used:
            indices, positions = mesh_triangles(scene, mesh)
            kept = build_order(indices, positions, mesh in self._deforming)
            if len(kept) > self._limits.most_triangles:
                raise SceneError(
                    f"Mesh {mesh} has {len(kept)} triangles, and structures of this device hold "
                    f"{self._limits.most_triangles}: split it into several."
                )
            if len(kept):
                orders[mesh] = kept
                lists.append(np.ascontiguousarray(indices[kept]))
                if mesh in self._deforming:
                    figures[mesh] = figure_of(positions[indices[kept]])
        self._offset = {mesh: (int(page_of[mesh]), 4 * int(records["streams"][mesh, 0])) for mesh in orders}
        self._orders = self._filled(order_words(scene, orders), _STORAGE, "order of triangles")
        sizes = [array.nbytes for array in lists]
        every = np.concatenate(lists) if lists else np.zeros(1, np.uint32)
        self._indices = self._filled(every, INPUT | _STORAGE, "indices of structures")
        offsets = np.cumsum([0, *sizes])
        begins = buffer_address(self._device, self._indices) + offsets
        geometries = [
            MeshGeometry(
                self._vertices(mesh, 0),
                int(scene.meshes["vertex_count"][mesh]),
                int(begin),
                len(kept),
                f"mesh {mesh}",
                mesh in self._deforming,
            )
            for (mesh, kept), begin in zip(orders.items(), begins, strict=False)
        ]
        rebuilds = self._settings is not None and self._settings.ray_rebuild > 0
        self._bottoms = Bottoms(self._device, geometries, self._budget, rebuilds)
        self._moving = list(figures)
        shapes = [
            Shape(int(offset) // 4, len(kept), page, first // 4, figures[mesh])
            for (mesh, kept), offset in zip(orders.items(), offsets, strict=False)
            if mesh in figures
            for page, first in (self._offset[mesh],)
        ]
        self._reports = shape_reports(self._backend, shapes, self._indices, self._settings)
        self._addresses = {mesh: it.address for mesh, it in zip(orders, self._bottoms.all, strict=True)}
        self._top = TopLevel(self._device, len(scene.instances))
        self._make_kernel_sets()
        self._counts = self._bottoms.counts | {"ray_instances": len(scene.instances)}
        self._counts["ray_structure_bytes"] += self._top.bytes + self._orders.size + self._indices.size

    def _filled(self, array: NDArray[np.uint32], usage: int, name: str) -> Buffer:
        buffer = create_buffer(self._device, max(array.nbytes, 4), usage, "device", f"rays: {name}")
        with Uploader(self._device) as uploader:
            uploader.buffer(buffer, array)
        return buffer

    def _page_buffers(self) -> tuple[Buffer, ...]:
        pages = range(len(self._data.pages))
        return tuple(self._data.page_buffer(slot, page) for slot in range(SLOTS) for page in pages)

    def _vertices(self, mesh: int, slot: int) -> int:
        page, offset = self._offset[mesh]
        return buffer_address(self._device, self._data.page_buffer(slot, page)) + offset

    def _make_kernel_sets(self) -> None:
        layout = self._kernel.sets[0]
        assert layout is not None, "the kernel has buffers"
        described = []
        for slot in range(SLOTS):
            held: dict[int, Held] = self._data.held_instances(slot, 0, 3)
            held |= {1: self._top.tables[slot], 2: self._top.records}
            described.append((layout, held, f"ray records, slot {slot}"))
        self._sets = self._descriptors.create(described)
        self._kernel_sets = [vk.array("VkDescriptorSet", [handle]) for handle in self._sets.handles]

    # --- sets of the pipelines that trace ---

    def make_sets(self, pipelines: Sequence[Built], number: int) -> None:
        """Make the set `number` of pipelines that trace: the structure, and behind it the order of triangles.

        Their bindings are RAYS_BINDING and the next (rays/world.glsl), by the names `ray_world` and `Ray_order_`.
        """
        self._free_traced()
        self._traced = pipelines, number
        layouts = {}
        for pipeline in pipelines:
            layout = pipeline.sets[number]
            assert layout is not None, f"{pipeline.described.title} has no set {number}"
            layouts[layout.handle] = layout
        if not layouts:
            return
        described = []
        for layout in layouts.values():
            held: dict[int, Held] = {}
            for binding in layout.bindings:
                if binding.kind == "acceleration structure":
                    held |= {binding.number: Structure(self._top.handle), binding.number + 1: self._orders}
            described.append((layout, held, f"rays, set {number}"))
        sets = self._descriptors.create(described)
        self._trace_sets = {
            handle: (sets, vk.array("VkDescriptorSet", [bound]))
            for handle, bound in zip(layouts, sets.handles, strict=True)
        }

    def _free_traced(self) -> None:
        for sets in {id(sets): sets for sets, _ in self._trace_sets.values()}.values():
            self._resources.defer(partial(self._descriptors.destroy, sets))
        self._trace_sets = {}

    def bind(self, commands: Commands, pipeline: Built) -> None:
        """Bind the set of a pipeline that traces, after the pipeline."""
        number = self._traced[1]
        layout = pipeline.sets[number]
        assert layout is not None, "`make_sets` had this pipeline"
        commands.bind_compute_set(pipeline, number, self._trace_sets[layout.handle][1])

    # --- every frame ---

    def prepare(self, slot: int, pose: Pose, deformed: bool = False) -> int:
        """Find out what a frame builds, after the records of instances were written; return the bytes written.

        `deformed` says that a pass of the frame moves vertices, as cloth does.
        """
        scene, data = self._scene, self._data
        if self._pages and data.page_buffer(slot, 0) is not self._pages[slot * len(data.pages)]:
            self._make_anew()  # all pages are uploaded together
        moving = data.records.moving_key(pose)
        key = (moving, scene.revision[Change.VISIBILITY], scene.revision[Change.MATERIALS], self.revision)
        changed = key != self._seen
        posed = self._seen is None or moving != self._seen[0]
        self.refits = bool(self._moving) and (deformed or posed)
        self.rebuilds = self._reports.follow(slot) if self._reports else ()
        self.refits |= bool(self.rebuilds)
        if self.refits and self._reports:
            self._reports.ask(slot)
        self._sorted_ago += changed
        if self._sorted_ago > SORT_EVERY:
            self._order = morton_order(data.records.instances["bounds_centre"][:, :3])
            self._sorted_ago, self._table_key = 0, None
        if self._table_key != key[1:]:
            self._table = instance_table(scene, self._addresses, self._order)
            self._table_key = key[1:]
        self.builds_top = changed or self.refits
        self._seen = key
        written = 0
        if self._written[slot] is not self._table:
            written = self._top.write_table(slot, self._table)
            self._written[slot] = self._table
        self.work = self._counts | {
            "ray_refits": len(self._moving) * self.refits,
            "ray_rebuilds": len(self.rebuilds),
            "ray_quality_percent": self._reports.percent if self._reports else 100,
            "ray_top_builds": int(self.builds_top),
        }
        return written

    def key(self) -> Any:
        """Return what the recording of `record` depends on."""
        return self.revision, self.builds_top, self.refits, self.rebuilds

    def record(self, commands: Commands, slot: int) -> None:
        """Record the refits and the build of the upper level that the frame needs, and the barriers around them."""
        if not self.builds_top:
            return
        commands.barrier(self._waits.before)
        if self.refits:
            addresses = [self._vertices(mesh, slot) for mesh in self._moving]
            self._bottoms.record_refits(commands.handle, addresses, self.rebuilds)
        if self._top.count:
            commands.bind_compute(self._kernel)
            commands.bind_compute_set(self._kernel, 0, self._kernel_sets[slot])
            commands.push(self._kernel, np.array([self._top.count, 0, 0, 0], np.uint32))
            commands.dispatch_over(self._kernel, (self._top.count,))
        commands.barrier(self._waits.between)
        self._top.record(commands.handle)
        commands.barrier(self._waits.after)
        if self.refits and self._reports:
            self._reports.record(commands, slot)

    # --- life ---

    def _make_anew(self) -> None:
        self._resources.defer(self._taken())
        self._make()
        self.revision += 1
        self._table_key, self._written = None, [None] * SLOTS
        self.make_sets(*self._traced)

    def _taken(self) -> Any:
        """Return a function that frees what `_make` made."""
        bottoms, top, sets, reports = self._bottoms, self._top, self._sets, self._reports
        buffers = (self._orders, self._indices)

        def free() -> None:
            if sets is not None:
                self._descriptors.destroy(sets)
            if reports is not None:
                reports.close()
            top.close()
            bottoms.close()
            for buffer in buffers:
                destroy_buffer(self._device, buffer)

        return free

    @property
    def sizes(self) -> dict[str, int]:
        """The buffers of the frame graph: none, for builds own what they write."""
        return {}

    def trace_by(self, pipelines: Sequence[Built]) -> None:
        """Let several pipelines of one pass trace, which have one layout; for a single one `bind_pass` is enough."""
        self.make_sets(pipelines, STRUCTURES_SET)

    def bind_pass(
        self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None:
        """Bind a pass that traces: the scene, a page, a set of textures or None, and the structures."""
        if pipeline not in self._traced[0]:
            self.make_sets([pipeline], STRUCTURES_SET)
        self._surfaces.bind(commands, pipeline, scene, page, textures)
        self.bind(commands, pipeline)

    def close(self) -> None:
        """Free everything; no frame is in flight."""
        for sets in {id(sets): sets for sets, _ in self._trace_sets.values()}.values():
            self._descriptors.destroy(sets)
        self._trace_sets = {}
        self._taken()()


def open_structures(backend: VulkanBackend, parts: PassParts) -> RayStructures:
    """Return the structures of the scene that is drawn."""
    return RayStructures(backend, parts.scene, settings=parts.settings.rays)
