"""The counters of casters: what the frame of each slot can draw at most, and what the kernel has counted of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...frames.commands import Commands
from ...frames.frame import SLOTS
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built
from ..lists import Round, Schedule, ShadowLists

WORDS = 4


class ShadowCounts:
    """Counts units in the lists of lights, draws and triangles; `vulkan.py` and `gl.py` have the buffers.

    A frame without draws has no counters, and asking for them does not wait for it.
    """

    def __init__(self, backend: Any) -> None:
        self._backend = backend
        self._units = [0] * SLOTS
        self._draws = [False] * SLOTS
        self._kernel: Built
        self._create()

    def _create(self) -> None:
        """Create the buffer of each slot."""
        raise NotImplementedError

    def build(self, pipelines: Any) -> None:
        """Build the kernel."""
        described = ComputeDescription(
            "shadows/counts/counts.comp", (("TESTS_NOTHING", 1),), name="count shadow draws"
        )
        (self._kernel,) = pipelines.get([described])

    # --- every frame ---

    def follow(self, slot: int, schedule: Schedule, lists: ShadowLists | None) -> None:
        """Note what the frame of a slot can list at most: all units for each list of its rounds."""
        self._draws[slot] = len(schedule.faces) > 0
        if self._draws[slot] and lists is not None:
            of_all = int(lists.tables.draws["units"].sum(dtype=np.int64))
            self._units[slot] = of_all * int((schedule.lists > 0).sum())

    @property
    def tells(self) -> bool:
        """Whether the last frame of any slot has drawn."""
        return any(self._draws)

    def told(self, slot: int) -> dict[str, int]:
        """Return the counters of the last frame of a slot, which is over."""
        units, draws, low, high = self._read(slot).tolist() if self._draws[slot] else (0,) * WORDS
        listed = self._units[slot] if self._draws[slot] else 0
        return {
            "shadow_units": units,
            "shadow_units_culled": listed - units,
            "shadow_draws": draws,
            "shadow_triangles": low + (high << 32),
        }

    def _read(self, slot: int) -> NDArray[np.uint32]:
        """Return the words of a slot's counters."""
        raise NotImplementedError

    # --- recording ---

    def begin(self, commands: Commands, memory: Any) -> None:
        """Let the counters of the slot be 0."""
        self._run(commands, memory, np.zeros((2, 4)), (1, 1))

    def add(self, commands: Commands, memory: Any, lists: ShadowLists, turn: Round) -> None:
        """Count what the kernels have left of a round."""
        constants = np.array(
            [
                [turn.first, turn.layers, lists.places, lists.layers],
                [len(lists.tables.draws), lists.batches, 0, 0],
            ]
        )
        self._run(commands, memory, constants, (lists.batches, turn.layers))

    def _run(self, commands: Commands, memory: Any, constants: np.ndarray, groups: tuple[int, int]) -> None:
        self._bind(commands, memory)
        commands.push(self._kernel, constants.astype(np.uint32))
        commands.dispatch(*groups)
        commands.compute_barrier()

    def _bind(self, commands: Any, memory: Any) -> None:
        """Bind the kernel with the tables of `memory` and the counters of the slot."""
        raise NotImplementedError

    def finish(self, commands: Any) -> None:
        """Make the counters visible to the CPU."""
        raise NotImplementedError

    def close(self) -> None:
        """Free the buffers."""
        raise NotImplementedError
