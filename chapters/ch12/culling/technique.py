"""The culling technique: it chooses what a frame tests and draws, and lets the passes that draw use the lists."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import Access, FrameInfo, Pass, Technique
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..frames.commands import DrawGroup, SceneBinding
from ..graph.file import graph_path, read_graph
from ..graph.plan import graph_name
from ..meshlets.groups import spans
from ..meshlets.model import SceneMeshlets
from ..meshlets.scene import levels_of, meshlets_of
from ..pipelines.description import PipelineDescription
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading.depth_prepass import DepthPrepass
from ..shading.forward import ForwardPass
from ..shading.gbuffer import GBufferPass
from ..shading.objects import ObjectsPass
from ..visibility.passes import VisibilityPass
from .choice import Choice, choose, overlay_of, wants_meshlets
from .freeze import CUTS
from .lists import EARLY, LATE, PHASES
from .memory import CullingMemory
from .overlay import OverlayPass
from .passes import (
    DRAWS,
    PYRAMIDS,
    TRANSPARENT,
    CullCountersPass,
    CullPass,
    CullTransparentPass,
    DepthPyramidPass,
    in_turn,
)

FIRST: dict[str, type[ObjectsPass]] = {
    "depth_prepass": DepthPrepass,
    "gbuffer": GBufferPass,
    "visibility": VisibilityPass,
    "forward": ForwardPass,
}
"""The passes that may draw solid objects first. In a frame with two phases, another pass of the class follows it."""


class CulledDraws:
    """The draw commands that culling fills; see `scene_draws.CulledDraws`."""

    def __init__(
        self, memory: CullingMemory, meshlets: SceneMeshlets | None, phases: int, blended: bool
    ) -> None:
        self._memory, self._meshlets, self._phases, self._blended = memory, meshlets, phases, blended

    def groups(self, groups: Sequence[DrawGroup], phase: int, tells: bool) -> Sequence[DrawGroup]:
        """Return the groups of all solid batches, in their order, with the commands of a phase."""
        if phase >= self._phases:
            return []
        drawn = []
        memory = self._memory
        for number, group in enumerate(groups):
            pipeline = group.with_meshlets[phase]
            if pipeline is not None and memory.has_meshlets(number):
                drawn.append(
                    replace(group, pipeline=pipeline, meshlets=memory.mesh_draw(number, phase, tells))
                )
            first, capacity = memory.region(number, phase)
            if capacity:
                batch = replace(group.batch, first=first, count=capacity, triangles=0)
                drawn.append(replace(group, batch=batch, counted=memory.counted(number, phase)))
        return drawn

    def with_meshlets(self, described: PipelineDescription, phase: int) -> PipelineDescription | None:
        """Return a pipeline with task and mesh shaders in place of its vertex shader; None if these are not used."""
        if self._memory.choice.geometry != "mesh" or self._meshlets is None:
            return None
        vertices, triangles = self._meshlets.limits
        defines = (
            *self._memory.choice.defines,
            ("PHASE", phase),
            ("MAX_VERTICES", vertices),
            ("MAX_TRIANGLES", triangles),
        )
        return replace(
            described,
            shaders=("meshlets/select.task", "meshlets/objects.mesh", *described.shaders[1:]),
            defines=(*described.defines, *defines),
            name=f"{described.name} meshlets, phase {phase}",
        )

    @property
    def mesh_shaders(self) -> bool:
        """Whether mesh shaders draw the meshlets."""
        return self._memory.choice.geometry == "mesh" and self._meshlets is not None

    @property
    def meshlets(self) -> SceneMeshlets | None:
        """The meshlets that the scene's indices are in the order of."""
        return self._memory.meshlets

    def transparent(self, slot: int, binding: SceneBinding) -> SceneBinding:
        """Return the bindings of transparent draws, from those without culling."""
        records = self._memory.target(slot) if self._blended else binding.records
        return binding._replace(records=records, counted=self._memory.unlimited(records))


class CullingTechnique(Technique):
    """Meshlets, their tests, and the lists that the passes of a frame draw."""

    name = "culling"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._settings = settings  # the user's object: culling may be frozen in any frame
        levels = levels_of(scene) if settings.culling.lod_pixels > 0 else None
        self.levels = levels if levels is not None and levels.coarser else None
        geometry = scene if self.levels is None else self.levels.scene
        self.meshlets = meshlets_of(geometry) if wants_meshlets(scene, settings) else None
        if self.meshlets is not None or self.levels is not None:
            indices = geometry.indices if self.meshlets is None else self.meshlets.indices
            meshes, names = geometry.meshes, geometry.mesh_names
            self.scene = replace(scene, indices=indices, meshes=meshes, mesh_names=names)
            self.scene.revision, self.scene.bounds = scene.revision, scene.bounds
            self.scene.origin = scene.origin
        self.choice = Choice("off", "classic")
        """What a frame does, from `create` on."""
        self.memory: CullingMemory | None = None
        """Tables and pipelines, from `create` on."""
        self._prepared = self._live
        self._in_order = geometry.indices
        self._restore_order()

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Choose the path of the device, make the passes, and let the passes that draw objects read the lists."""
        scene, settings = parts.scene, parts.settings
        choice = choose(self.scene, settings, backend.plan, backend.device.capabilities)
        self.choice = choice = replace(choice, levels=self.levels is not None)
        kernels = backend.part(__package__).CullingKernels(backend)
        self.memory = memory = CullingMemory(parts, kernels, choice, self.meshlets, self.levels, backend)
        parts.data.reordered = lambda: self._restore_order(parts.scene)
        memory.samples, memory.overlay = settings.shading.msaa, overlay_of(settings)
        file = {*read_graph(graph_path(graph_name(settings))).passes.values()}
        drawn = [name for name in FIRST if name in file]
        late: dict[str, ObjectsPass] = {name: FIRST[name](parts) for name in drawn}
        first = next((name for name in drawn if passes[name].needed(scene, settings)), "")
        if first:
            passes[first].tells = True  # type: ignore[attr-defined]
        two_phases = choice.two_phases and bool(first)
        depths = ("depth", "depth")
        if two_phases:
            before = passes[first]
            assert isinstance(before, ObjectsPass), first
            depths = before.split(late[first]), depths[1]
            memory.depth = depths[0]
            late[first].tells = True
        blended = choice.mode != "off" and backend.plan.native("multi-draw") and _is_blended(scene)
        # The forward pass draws blended objects right after the last solid ones: no pyramid of all of these is there.
        last = memory.two_pyramids = two_phases and blended and first != "forward"
        ordered: list[Pass] = [
            CullPass(memory, EARLY, choice.runs),
            DepthPyramidPass(memory, 0, depths[0], two_phases),
            CullPass(memory, LATE, two_phases),
            DepthPyramidPass(memory, 1, depths[1], last),
            CullTransparentPass(memory, PYRAMIDS[last], two_phases, blended),
            CullCountersPass(memory, choice.runs),
        ]
        for name, late_pass in late.items():
            late_pass.name = f"{name}_late"
            if name != first or not two_phases:
                late_pass.needed = _unneeded  # type: ignore[method-assign]
            ordered.append(late_pass)
        drawn_last = late[first] if two_phases and first == "forward" else passes["forward"]
        overlay = OverlayPass(parts, memory, drawn_last, two_phases)
        ordered.append(overlay)
        if choice.runs:
            tasks = choice.geometry == "mesh" and bool(first)
            drawing: list[tuple[Pass, tuple[str, ...]]] = [(passes[first], ("task",))] if tasks else []
            transparent: list[tuple[Pass, tuple[str, ...]]] = [(ordered[4], ())] if blended else []
            writers: list[tuple[Pass, tuple[str, ...]]] = [(ordered[0], ())]
            if two_phases:
                writers += [*drawing, (ordered[2], ())]
                drawing = [(late[first], ("task",))] if tasks else []
            # What is blended is tested before the pass that draws it, and that may be the one with these tasks.
            writers += [*drawing, *transparent] if last else [*transparent, *drawing]
            in_turn([*writers, (ordered[5], ())], overlay)
            parts.draws.culled = CulledDraws(memory, self.meshlets, PHASES if two_phases else 1, blended)
            _read_lists([*passes.values(), *late.values()], PHASES if two_phases else 1, blended, tasks)
        objects = [it for it in (*passes.values(), *late.values()) if isinstance(it, ObjectsPass)]
        memory.mesh_pipeline = lambda: next((built for it in objects for built in it.mesh_pipelines), None)
        self.passes = {it.name: it for it in ordered if it.name in file or it.needed(scene, settings)}

    def _restore_order(self, *scenes: Scene) -> bool:
        """Put the triangles of meshes that became blended back into the order of the file.

        These meshes have no meshlets from then on. Returns whether there are any. `scenes` are views of `scene`.
        """
        if self.meshlets is None:
            return False
        meshes, ranges = self.scene.meshes, self.meshlets.ranges
        blended = np.array([material.alpha_mode == "blend" for material in self.scene.materials], bool)
        cut = ranges[:, 1] > 0
        back = cut & np.isin(meshes["first_index"], meshes["first_index"][cut & blended[meshes["material"]]])
        if not back.any():
            return False
        rows, indices = meshes[back], self.scene.indices.copy()
        moved = spans(rows["first_index"], rows["index_count"])
        indices[moved] = self._in_order[moved]
        self.meshlets = replace(self.meshlets, indices=indices, ranges=np.where(back[:, None], 0, ranges))
        for view in (self.scene, *scenes):
            view.indices = indices
        if self.memory is not None:
            self.memory.meshlets = self.meshlets
        return True

    def prepare(self, frame: FrameInfo) -> int:
        """Write the view of culling; return the bytes written."""
        memory, knobs = self.memory, self._settings.culling
        self._prepared = self._live
        if memory is None or not (self.choice.runs or memory.overlay != "off"):
            return 0
        memory.level = knobs.level
        written = memory.prepare(frame.slot, frame.size, knobs.frozen)
        memory.number_draws()
        return written

    @property
    def _live(self) -> tuple[bool, int]:
        """The knobs that may change from frame to frame."""
        return self._settings.culling.frozen, self._settings.culling.level

    def resting(self, time: float) -> bool:
        """Whether the knobs are as they were in the last frame."""
        return self._prepared == self._live

    def reset(self, reason: str) -> None:
        """Let go of a frozen view, unless only the camera jumped: it may look at what is frozen from anywhere."""
        if self.memory is not None and reason not in CUTS:
            self.memory.view.release()

    @property
    def tells(self) -> bool:
        """Whether any kernel counts."""
        return self.memory is not None and self.choice.runs

    def told(self, slot: int) -> dict[str, int]:
        """Return the counters that the GPU wrote in the last frame of a slot."""
        assert self.memory is not None, "it tells"
        return self.memory.told(slot)

    def close(self) -> None:
        """Free the buffers."""
        if self.memory is not None:
            self.memory.close()


def _unneeded(scene: Scene, settings: Any) -> bool:
    return False


def _is_blended(scene: Scene) -> bool:
    """Whether any object is transparent."""
    return any(
        scene.materials[material].alpha_mode == "blend"
        for material in set(scene.meshes["material"][scene.instances.mesh].tolist())
    )


def _read_lists(passes: Collection[Pass], phases: int, blended: bool, tasks: bool) -> None:
    """Declare in the passes that draw objects which lists they read."""
    for gpu_pass in passes:
        if not isinstance(gpu_pass, ObjectsPass):
            continue
        names = [DRAWS[phase] for phase in gpu_pass.phases if phase < phases and gpu_pass.draws_solid]
        if blended and gpu_pass.draws_blended:
            names.append(TRANSPARENT)
        gpu_pass.reads = (*gpu_pass.reads, *(Access(name, "indirect") for name in names))
        if tasks and gpu_pass.draws_solid:  # task shaders read the lists, too
            solid = [name for name in names if name != TRANSPARENT]
            gpu_pass.reads = (*gpu_pass.reads, *(Access(name, "storage", stages=("task",)) for name in solid))
