"""The passes of culling: the lists of each phase, the depth pyramid, and the draws of blended objects.

    cull -> draws_early -> gbuffer -> depth_early -> depth_pyramid -> cull_late -> draws_late -> gbuffer_late -> depth

What the passes write are buffers of culling's own memory. The graph knows them as externals, so it orders their uses
and sets the barriers between them, in a frame and from frame to frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.commands import Commands
from ..graph.types import External, Touch
from .lists import EARLY, GROUP
from .memory import CullingMemory

DRAWS = ("draws_early", "draws_late")
"""The resource of each phase: its draw commands."""

PYRAMIDS = ("depth_pyramid", "depth_pyramid_last")
"""The names of the pyramid: of what the early phase drew, and of everything solid."""

TRANSPARENT = "draws_transparent"

STATE = "culling_state"
"""What the frame sees, for the next one, and the counters."""

SHOWN = ("vertex", "fragment")
"""The stages in which the overlay reads what the kernels found out."""

_READ = Touch("", frozenset({"indirect", "compute"}), frozenset({"indirect", "storage_read"}))
_STORED = Touch("", frozenset({"compute"}), frozenset({"storage_read", "storage_write"}), writes=True)


def _left(touch: Touch, memory: CullingMemory) -> Touch:
    """Return the last touch of the frame before, also by task shaders and the overlay if there are any."""
    tasks = {"task"} if memory.choice.geometry == "mesh" else set()
    shown = {*SHOWN} if memory.overlay != "off" else set()
    return replace(touch, stages=touch.stages | tasks | shown)


class CullingPass(Pass):
    """The common base: a pass of dispatches on culling's memory."""

    def __init__(self, memory: CullingMemory, needed: bool) -> None:
        self._memory, self._needed = memory, needed

    def needed(self, scene: Scene, settings: Any) -> bool:  # type: ignore[override]
        """Whether the renderer was opened with a scene, settings and a device that take this pass."""
        return self._needed

    def create(self) -> None:
        """Build the pipelines; all passes of culling share them."""
        self._memory.create()

    def key(self, slot: int) -> Any:
        """Return the revision of the tables."""
        return self._memory.revision


class CullPass(CullingPass):
    """Fills the lists of a phase: tests draws, then their units, and writes the commands of those that are left."""

    def __init__(self, memory: CullingMemory, phase: int, needed: bool) -> None:
        super().__init__(memory, needed)
        self.phase = phase
        self.name = ("cull", "cull_late")[phase]
        self.writes = (Access(DRAWS[phase], "storage", bytes=4),)
        self.externals = {DRAWS[phase]: External(None, None, _left(_READ, memory), bytes=4)}
        if phase == EARLY:
            self.externals |= {STATE: External(None, None, _left(_STORED, memory), bytes=4)}
        else:
            self.reads = (Access(PYRAMIDS[0], "storage"), Access(DRAWS[EARLY], "storage"))

    def record(self, commands: Commands) -> None:
        """Record the kernels of the phase, with a barrier before each that reads results of an earlier one."""
        memory = self._memory
        if self.phase == EARLY:
            memory.run(commands, "begin", self.phase)
        memory.run(commands, f"draws {self.phase}", self.phase, over=len(memory.lists.draws))
        memory.run(commands, "scan draws", self.phase)
        memory.run(commands, f"units {self.phase}", self.phase, word=0)
        memory.run(commands, "scan units", self.phase)
        if not memory.counts_draws:
            memory.run(commands, "clear", self.phase, over=memory.lists.commands)
        memory.run(commands, "commands", self.phase, word=4)
        memory.finish(commands)


class CullCountersPass(CullingPass):
    """Copies the counters of the frame to the CPU, after the last pass that counts."""

    name = "cull_counters"

    def record(self, commands: Commands) -> None:
        """Record one work group."""
        self._memory.run(commands, "tell", EARLY)
        self._memory.finish(commands)


def in_turn(passes: Sequence[tuple[Pass, tuple[str, ...]]], overlay: Pass) -> None:
    """Let these passes write the state of culling in this order, each by its shader stages.

    The state is what the frame sees, and its counters. Task shaders write it while they draw. The overlay reads it
    before the last of the passes, which tells the counters.
    """
    name = before = ""
    for number, (gpu_pass, stages) in enumerate(passes):
        before, name = name, f"{STATE}_{number}" if number else STATE
        access = Access(name, "storage", bytes=4, of=before, stages=stages)
        gpu_pass.writes = (*gpu_pass.writes, access)
    overlay.reads = (*overlay.reads, Access(before, "storage", stages=SHOWN))


class DepthPyramidPass(CullingPass):
    """Builds the levels of the pyramid from a depth; each texel is the farthest depth of its pixels."""

    def __init__(self, memory: CullingMemory, number: int, depth: str, needed: bool) -> None:
        super().__init__(memory, needed)
        self._number, self.name = number, ("depth_pyramid", "depth_pyramid_last")[number]
        self.reads = (Access(depth, "sampled"),)
        self.writes = (Access(PYRAMIDS[number], "storage", bytes=4),)
        self.externals = {PYRAMIDS[number]: External(None, None, _left(_STORED, memory), bytes=4)}

    def record(self, commands: Commands) -> None:
        """Record one dispatch for every six levels.

        A frozen pyramid stays what it was: the depth is that of another camera. It is frozen by the user and not by the
        frame, so that recording the pass anew costs less than a test in the kernel of every frame.
        """
        if not self._memory.view.is_frozen:
            self._memory.build_pyramid(commands, self._number)
        self._memory.finish(commands)

    def key(self, slot: int) -> Any:
        """Return the revision of the tables, and whether the pyramid is frozen."""
        return self._memory.revision, self._memory.view.is_frozen


class CullTransparentPass(CullingPass):
    """Leaves out blended objects that are outside of the view, or hidden behind everything solid."""

    name = "cull_transparent"

    def __init__(self, memory: CullingMemory, pyramid: str, two_phases: bool, needed: bool) -> None:
        super().__init__(memory, needed)
        self.reads = (Access(pyramid, "storage"),) if two_phases else ()
        self.writes = (Access(TRANSPARENT, "storage", bytes=4),)
        self.externals = {TRANSPARENT: External(None, None, _READ, bytes=4)}

    def record(self, commands: Commands) -> None:
        """Record one invocation for each blended object."""
        memory = self._memory
        if memory.blended:
            memory.bind(commands, "transparent", "transparent")
            memory.push(
                commands, "transparent", np.array([[memory.first_blended, memory.blended, 0, 0]], np.uint32)
            )
            commands.dispatch(-(-memory.blended // GROUP))
        memory.finish(commands)
