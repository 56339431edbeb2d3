"""The tables and pipelines of culling while a renderer is open: rebuilt when the scene's draw lists change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common import layouts

from ..frames.commands import Commands, Counted, MeshDraw
from ..meshlets.lods import SceneLevels
from ..meshlets.model import SceneMeshlets
from ..meshlets.unit_code import unit_defines
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from ..scene.draw_lists import DrawLists
from ..scene.pass_parts import PassParts
from .choice import Choice
from .freeze import CullingView, without_history
from .kernels import PYRAMIDS, Kernels, OverlayDraw, describe, first_words, sizes_of, tables_of
from .lists import COUNTER_WORDS, COUNTERS, GROUP, CullingLists, Levels, folded, plan_lists
from .pyramid import PyramidLayout
from .spheres import SPHERE, sphere_records


class CullingMemory:
    """What the passes of culling share."""

    def __init__(
        self,
        parts: PassParts,
        kernels: Kernels,
        choice: Choice,
        meshlets: SceneMeshlets | None,
        levels: SceneLevels | None,
        backend: Any,
    ) -> None:
        self._parts, self._kernels, self.choice, self._backend = parts, kernels, choice, backend
        self.meshlets, self._levels = meshlets, levels
        """The meshlets of the scene, if it is cut."""
        self._confused = kernels.counts_draws and backend.device.capabilities.is_software  # see `unlimited`
        self._lists_seen: DrawLists | None = None
        self._bound: Any = None  # the executor and the layout that the bindings were made for
        self._pipelines: dict[str, Built] = {}
        self.lists: CullingLists
        self.revision = 0
        """Grows with every change of the tables or the bindings."""
        self.depth = ""
        """The name of the depth that the pyramid is built from; "" without a pyramid."""
        self.samples = 1
        self.mesh_pipeline: Callable[[], Built | None] = lambda: None
        """Returns some pipeline with mesh shaders, if there are any."""
        self.overlay, self.level = "off", 1
        """What is shown over the picture, and the level of the pyramid."""
        self.overlay_pipeline: Callable[[], Built | None] = lambda: None
        """Returns some pipeline of the overlay, if there are any."""
        self.spheres = 0
        """The spheres that the overlay shows."""
        self.two_pyramids = False
        """Whether blended objects have a pyramid of their own."""
        self.view = CullingView()
        self.first_blended = self.blended = 0
        self._slot = 0
        self._layout = PyramidLayout.of((1, 1))
        always = np.zeros(len(parts.scene.meshes), bool)
        always[[deformation.mesh for deformation in parts.scene.deformations]] = True
        self._always = always

    @property
    def counts_draws(self) -> bool:
        """Whether the number of draws can be on the GPU."""
        return self._kernels.counts_draws

    # --- created, and again after changes ---

    def create(self) -> None:
        """Build the pipelines."""
        described: dict[str, Any] = dict(describe(self.choice, unit_defines(self._parts.settings)))
        described["transparent"] = ComputeDescription(
            "culling/transparent.comp", self.choice.defines, name="cull transparent"
        )
        if self.depth:
            many = (("SAMPLES", self.samples),) if self.samples > 1 else ()
            described["pyramid"] = ComputeDescription("culling/pyramid.comp", many, name="depth pyramid")
        self._pipelines = dict(zip(described, self._parts.pipelines.get([*described.values()]), strict=True))
        self._bound = None

    def prepare(self, slot: int, size: tuple[int, int], frozen: bool) -> int:
        """Follow the draw lists, the graph and the size; write the view of a slot, and return the bytes written."""
        self._slot = slot
        executor, lists = self._backend.executor, self._parts.draws.lists
        frame = self._parts.data.slots[slot].frame
        constants = frame.view(np.uint8)[: layouts.dtype("FrameConstants").itemsize]
        if (executor, size) != self._bound or lists is not self._lists_seen:
            self._follow(lists, size)
            self._bound, self._lists_seen = (executor, size), lists
            self.view.release()
            constants = without_history(constants)  # the flags of the last frame are gone with its buffers
        written = self.view.advance(slot, constants, frozen)
        if written is None:
            return 0
        self._kernels.write_view(slot, written)
        return int(written.nbytes)

    def _follow(self, lists: DrawLists, size: tuple[int, int]) -> None:
        parts, meshlets = self._parts, self.meshlets if self.choice.geometry != "classic" else None
        scene, data = parts.scene, parts.data
        two_sided = np.array([variant.double_sided for variant in data.variants], bool)
        mesh_shaders = self.choice.geometry == "mesh"
        levels = None
        if self._levels is not None:
            pixels = parts.settings.culling.lod_pixels
            levels = Levels(self._levels, data.first_index, data.page_of, pixels)
        largest = self._kernels.buffer_bytes
        self.lists = plan_lists(
            lists, scene, meshlets, self._always, two_sided, mesh_shaders, largest, levels
        )
        if self.lists.warning and self.lists.warning not in scene.warnings:
            scene.warnings.append(self.lists.warning)
        self._meshed = self.lists.meshed
        self._layout = PyramidLayout.of(size)
        self.blended = len(lists.transparent)
        self.first_blended = len(lists.commands) - self.blended
        copied = len(lists.commands) if self.blended else 0  # blended draws keep their places
        spheres = np.zeros(0, SPHERE)
        if self.overlay == "spheres":
            spheres = sphere_records(self.lists, meshlets)
        self.spheres = len(spheres)
        tables = tables_of(self.lists, meshlets, spheres)
        words, instances = self._layout.words, len(scene.instances)
        sizes = sizes_of(self.lists, tables, words, instances, copied, self.two_pyramids)
        self._kernels.make_buffers(sizes, tables | first_words(sizes, lists.transparent))
        kinds = {"lists": "scan draws", "transparent": "transparent", "pyramid": "pyramid"}
        kernels = {kind: self._pipelines[name] for kind, name in kinds.items() if name in self._pipelines}
        self._kernels.make_bindings(
            kernels, self.mesh_pipeline(), self.overlay_pipeline(), self._depth_name()
        )
        self._backend.frames.forget()
        self.revision += 1

    def _depth_name(self) -> str:
        """Return the name of the depth's resource in the graph."""
        names: Mapping[str, str] = self._backend.executor.graph.names
        return names[self.depth] if self.depth else ""

    # --- for draws ---

    def counted(self, batch: int, phase: int) -> Counted:
        """Return the commands of a batch in a phase, and where their number is."""
        state = self.lists.state
        return self._kernels.counted(state.counts + phase * state.batches + batch)

    def has_meshlets(self, batch: int) -> bool:
        """Whether any draw of a batch has meshlets."""
        return bool(self._meshed[batch])

    def mesh_draw(self, batch: int, phase: int, tells: bool) -> MeshDraw:
        """Return the draw of a batch's meshlets in a phase; `tells` says whether its task shaders count."""
        lists, state = self.lists, self.lists.state
        firsts = [*lists.batches["first_draw"].tolist(), len(lists.draws)]
        more = [phase, firsts[batch], len(self._parts.scene.instances), firsts[batch + 1]]
        constants = np.concatenate([state.pushed(tells), np.array([more], np.uint32)])
        return self._kernels.mesh_draw(
            self._slot, constants, state.tasks + 4 * (phase * state.batches + batch)
        )

    def region(self, batch: int, phase: int) -> tuple[int, int]:
        """Return (first command, capacity) of a batch in a phase."""
        row = self.lists.batches[batch]
        return phase * self.lists.commands + int(row["first_command"]), int(row["capacity"])

    def number_draws(self) -> None:
        """Give the draws of this frame that culling leaves as they are the number that they need."""
        if self._confused:
            draws = self._parts.draws
            draws.binding = draws.binding._replace(counted=self.unlimited(draws.binding.records))

    def unlimited(self, records: Any) -> Counted | None:
        """Return `records` with a number that is never reached; None where draws need no number.

        Mesa's software driver (25.0.7) takes the number of the last counted draw for later draws without one. So where
        solid draws are counted, blended ones have a number there, too.
        """
        if not self._confused:
            return None
        return self._kernels.counted(self.lists.state.words - 1)._replace(records=records)

    def target(self, slot: int) -> Any:
        """Return the draw commands of blended objects."""
        return self._kernels.target(slot)

    # --- recording ---

    def bind(self, commands: Commands, kind: str, name: str) -> None:
        """Bind the kernel `name` with the buffers of its kind."""
        self._kernels.bind(commands, kind, self._pipelines[name], commands.slot.index)  # type: ignore[attr-defined]

    def push(self, commands: Commands, name: str, constants: NDArray[np.uint32]) -> None:
        """Set the push constants of a kernel."""
        commands.push(self._pipelines[name], constants)

    def run(self, commands: Commands, name: str, phase: int, over: int = 1, word: int | None = None) -> None:
        """Record a kernel over a number of invocations, or over the arguments at a word of the phase's arguments."""
        lists, state = self.lists, self.lists.state
        self.bind(commands, "lists", name)
        commands.compute_barrier()
        instances = len(self._parts.scene.instances)
        more = np.array([[phase, lists.commands, instances, lists.units]], np.uint32)
        self.push(commands, name, np.concatenate([state.pushed(), more]))
        if word is None:
            commands.dispatch(*folded(-(-max(1, over) // GROUP)))
        else:
            self._kernels.dispatch(commands, state.arguments + phase * state.ARGUMENTS + word)

    def build_pyramid(self, commands: Commands, number: int) -> None:
        """Record the dispatches that build a pyramid."""
        self.bind(commands, PYRAMIDS[number], "pyramid")
        for number, reduction in enumerate(self._layout.reductions):
            if number:
                commands.compute_barrier()
            self.push(commands, "pyramid", self._layout.constants(reduction))
            commands.dispatch(*reduction.groups)

    def draw_overlay(self, commands: Commands, pipeline: Built, vertices: int, instances: int) -> None:
        """Record a draw of the overlay, with the level of the pyramid as constants."""
        constants = np.array([[self.level, 0, 0, 0]], np.uint32)
        draw = OverlayDraw(pipeline, vertices, instances, constants)
        self._kernels.draw_overlay(commands, self._slot, draw)

    def finish(self, commands: Commands) -> None:
        """Make results visible to the CPU, and bind again what the kernels replaced."""
        self._kernels.finish(commands, self._slot)

    # --- counters ---

    def told(self, slot: int) -> dict[str, int]:
        """Return the counters of a slot's last frame, by name."""
        words = self._kernels.told(slot).astype(int)
        early, late = (
            dict(zip(COUNTERS, words[first : first + len(COUNTERS)].tolist(), strict=True))
            for first in (0, COUNTER_WORDS)
        )
        final = late if self.choice.two_phases else early
        return {
            "instances_tested": final["draws_tested"],
            "instances_outside": final["draws_outside"],
            "instances_hidden": final["draws_hidden"],
            "instances_coarser": final["draws_coarser"],
            "meshlets_tested": final["units_tested"],
            "meshlets_outside": final["units_outside"],
            "meshlets_away": final["units_away"],
            "meshlets_hidden": final["units_hidden"],
            "meshlets_drawn": early["meshlets_drawn"] + late["meshlets_drawn"],
            "units_drawn": early["units_drawn"] + late["units_drawn"],
            "units_late": late["units_drawn"],
            "units_dropped": max(early["units_dropped"], late["units_dropped"]),
            "triangles_drawn": early["triangles_drawn"] + late["triangles_drawn"],
            "triangles_late": late["triangles_drawn"],
        }

    def close(self) -> None:
        """Free the buffers."""
        self._kernels.close()
