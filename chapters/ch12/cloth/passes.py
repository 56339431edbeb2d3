"""The cloth pass: it simulates the steps that are due, and writes the vertices of all cloths.

These vertices lie in the pages of geometry that later passes draw from, so those passes declare to read them. The
vertices exist once per slot, and the CPU waits for the last frame of a slot before it uses the slot again. So no frame
waits for the draws of another one, and on its own queue the simulation overlaps them.

If the pass is switched off, cloth keeps its state. The same vertices are written to all slots once, and later passes
draw them without a pass before them. If it is switched on again, the cloth goes on from there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from backends.contract import Access, Pass
from common.scene import Pose, Scene
from common.view.camera import View

from ..frames.commands import Commands
from ..frames.frame import SLOTS
from ..graph.execute.bindings import OWNED
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..visibility.model import RESOLVE
from .dispatches import Dispatch, Kernel, states_of
from .frames import ClothFrames, Plan, drawn_from
from .layout import Limits, Packed
from .scene import ClothScene
from .settings import ClothSettings
from .types import State

VERTICES = "cloth_vertices"
"""The name of the pass's resource in the graph: the vertices of all cloths."""

READERS = (
    "depth_prepass",
    "gbuffer",
    "forward",
    "transparent",
    "instance_id",
    "centre_depth",
    "visibility",
    "motion_objects",
    RESOLVE,
)
"""The passes that draw objects."""

STATE = ("positions", "velocities")
"""The buffers of the simulation's state; all others can be made again."""

FRAME: Mapping[str, Literal["upload", "readback"]] = {
    "frame": "upload",
    "colliders": "upload",
    "stats": "readback",
}
"""The buffers that exist once per slot: the input of a frame, and its stats."""

_FREE = Touch("", frozenset(), frozenset())
"""The slot's copy is unused: its last frame has ended."""

NOTHING = Plan(True, 0, {}, {})


def title(kernel: Kernel) -> str:
    """Return the name of a kernel's pipeline."""
    stage = " ".join(name.removesuffix("_STAGE").lower() for name, value in kernel.own if value)
    return f"{kernel.file.removesuffix('.comp').replace('/', ' ')} {stage}".strip()


class Memory(Protocol):
    """The buffers of all cloths on a backend; see `make_memory`."""

    def stats(self, slot: int) -> NDArray[np.uint8]:
        """Return the bytes that the last frame of a slot wrote about each cloth."""

    def read(self, name: str) -> NDArray[np.float32]:
        """Return the contents of one of the buffers STATE; all frames must be over."""

    def write(self, slot: int, arrays: Mapping[str, NDArray[np.uint8]]) -> None:
        """Write the input of a frame, by the names of the buffers."""

    def close(self) -> None:
        """Free the buffers."""


class Kernels(Protocol):
    """The kernels and buffers of all cloths on a backend: see `vulkan.py` and `gl.py`."""

    limits: Limits

    def make_memory(self, packed: Packed, before: Any) -> Memory:
        """Return the buffers of `packed`, with the simulation's state from `before`, if there is one."""

    def make_kernels(self, kernels: Mapping[Kernel, Built], pages: Collection[int]) -> None:
        """Make the bindings of these kernels; the vertices lie in these `pages` of geometry."""

    def bind(self, commands: Commands, kernel: Kernel, slot: int, page: int) -> None:
        """Bind the buffers of a kernel, after its pipeline; `page` is the page that it writes vertices to."""

    def finish(self, commands: Commands, slot: int) -> None:
        """Make the results of a slot's dispatches visible to the CPU and to the draws."""

    def at_once(self, slot: int) -> AbstractContextManager[Commands]:
        """Yield commands for a slot outside of frames, while none is in flight; they have run on leaving."""


class ClothPass(Pass):
    """Simulation, normals and vertices of all cloths, on the compute queue where there is one."""

    name = "cloth"
    queue = "compute"

    def __init__(
        self, cloth_scene: ClothScene, settings: ClothSettings, parts: PassParts, kernels: Kernels
    ) -> None:
        data = parts.data
        self._pipelines, self._kernels = parts.pipelines, kernels
        self._built: dict[Kernel, Built] = {}
        self._data, self._planned = data, data.pages
        self._cloth_scene = cloth_scene
        self.frames: ClothFrames | None = None
        if cloth_scene.cloths:
            self.frames = ClothFrames(
                cloth_scene, settings, drawn_from(cloth_scene, data.pages), kernels.limits
            )
        # The vertices lie in pages of geometry, which the scene binds: the resource orders passes alone.
        self.writes = (Access(VERTICES, "storage", bytes=OWNED),)
        self.externals = {VERTICES: External(None, None, _FREE, bytes=OWNED)} if cloth_scene.cloths else {}
        self._memory: Memory | None = None
        self._plans = [NOTHING] * SLOTS
        self._slot = -1
        self.resting = self._runs = True
        self.work: dict[str, int] = {}
        """Counts of the steps and cloths that the last frame simulated and left out."""

    def boxes(self) -> dict[int, NDArray[np.float64]]:
        """Return the boxes (2, 3) of cloths in the world by instance, NaN where they are unknown."""
        instances = self._cloth_scene.instances.tolist()
        return dict(zip(instances, self.frames.boxes(), strict=True)) if self.frames else {}

    def known(self) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Return the instances of cloths, and for which of them another slot has the vertices of the frame before."""
        assert self.frames is not None, "the scene has cloth"
        return self._cloth_scene.instances, self.frames.known

    def needed(self, scene: Scene, settings: Settings) -> bool:  # type: ignore[override]
        """Whether the scene had cloth when the renderer was opened."""
        return bool(self._cloth_scene.cloths)

    def add_to(self, passes: Mapping[str, Pass]) -> None:
        """Let the passes that draw objects read the vertices; without cloth, none of them does."""
        for name in READERS if self.externals else ():
            reader = passes[name]
            reader.reads = (
                *reader.reads,
                Access(VERTICES, "storage", stages=("compute" if name == RESOLVE else "vertex",)),
            )

    # --- created once ---

    def create(self) -> None:
        """Make pipelines and buffers; again after the pages of geometry were replaced."""
        frames = self.frames
        if frames is None:
            return
        before = self._memory
        if before is None or self._data.pages is not self._planned:
            self._planned = self._data.pages
            frames.draw_from(drawn_from(self._cloth_scene, self._planned))
            frames.forget_vertices()
            self._memory = self._kernels.make_memory(frames.packed, before)
        kernels = list(dict.fromkeys(dispatch.kernel for dispatch in frames.dispatches(1)))
        described = [
            ComputeDescription(kernel.file, tuple(kernel.defines.items()), name=title(kernel))
            for kernel in kernels
        ]
        self._built = dict(zip(kernels, self._pipelines.get(described), strict=True))
        self._kernels.make_kernels(self._built, sorted({page for page, *_ in frames.packed.vertex_runs}))

    def prepare(
        self,
        slot: int,
        pose: Pose,
        view: View,
        size: tuple[int, int],
        time: float,
        reset: str,
        passes: Collection[Pass],
    ) -> int:
        """Plan the frame of a slot, and write its input; return the bytes written.

        `pose` is that of the scene with all its nodes, `size` the picture's; `reset` is why earlier frames do not
        count, or "". `passes` are those of the frame, with or without this one. Slots take turns. A second frame of one
        slot in a row means that the first was never submitted, since something in it failed. Its steps are due again.
        """
        self._runs = runs = self in passes
        frames, memory = self.frames, self._memory
        if frames is not None and slot == self._slot and SLOTS > 1:
            frames.undo()
        self._slot = slot if runs else -1
        if frames is not None and not runs:
            self._pause(frames, pose, time, reset)
        if frames is None or memory is None or not runs:
            return 0
        frames.told(slot, memory.stats(slot))
        plan = frames.begin(slot, pose, view, size[0] / size[1], time, reset)
        memory.write(slot, plan.arrays)
        self._plans[slot] = plan
        self.resting, self.work = plan.idle, plan.work
        return sum(array.nbytes for array in plan.arrays.values())

    def _pause(self, frames: ClothFrames, pose: Pose, time: float, reset: str) -> None:
        """Leave cloth as it hangs; if slots have other vertices, write these to all slots, and wait."""
        if self._memory is not None and self._data.pages is not self._planned:
            self.create()
        plan, memory = frames.pause(pose, time, reset), self._memory
        self._plans, self.work = [NOTHING] * SLOTS, {}
        # Before its first frame cloth is as it was modelled.
        for slot in range(SLOTS) if plan and memory else ():
            with self._kernels.at_once(slot) as commands:
                assert plan is not None and memory is not None
                memory.write(slot, plan.arrays)
                self._plans[slot] = plan
                self._record(commands, slot)
            self._plans[slot] = NOTHING

    def key(self, slot: int) -> Any:
        """Return the key of the recording: see `ClothFrames.recorded`."""
        return self.frames.recorded(self._plans[slot]) if self.frames else None

    def record(self, commands: Any) -> None:
        """Record the dispatches of this frame, with a barrier before each that reads results of earlier ones."""
        self._record(commands, commands.slot.index)

    def _record(self, commands: Commands, slot: int) -> None:
        bound: Dispatch | None = None
        for dispatch in self.dispatched(slot):
            pipeline = self._built[dispatch.kernel]
            if bound is None or dispatch.kernel != bound.kernel:
                commands.bind_compute(pipeline)
            if bound is None or (dispatch.kernel, dispatch.page) != (bound.kernel, bound.page):
                self._kernels.bind(commands, dispatch.kernel, slot, dispatch.page)
            bound = dispatch
            if dispatch.after:
                commands.compute_barrier()
            commands.push(pipeline, np.array(dispatch.push, np.uint32))
            commands.dispatch(*dispatch.groups)
        if bound is not None:
            self._kernels.finish(commands, slot)

    def dispatched(self, slot: int) -> Iterator[Dispatch]:
        """Yield the dispatches of a slot's frame, none if it is idle."""
        plan = self._plans[slot]
        if self.frames is not None and not plan.idle:
            yield from self.frames.dispatches(max(plan.count, 1))

    def states(self) -> list[State]:
        """Return positions and velocities of each cloth's particles, read from the GPU; all frames must be over."""
        if self.frames is None or self._memory is None:
            return []
        positions, velocities = (self._memory.read(name) for name in STATE)
        return states_of(self.frames.packed, positions, velocities)

    def close(self) -> None:
        """Free the buffers."""
        if self._memory is not None:
            self._memory.close()

    def busy(self, time: float) -> bool:
        """Whether a frame at `time` would show another picture than the last one."""
        return self._runs and self.frames is not None and self.frames.busy(time)
