"""The tables that the culling kernels read, and the places of what they write.

    draws      one record for each visible solid instance, in the order of `scene.draw_lists`: batch after batch
    units      what is tested and drawn: the meshlets of an instance, or its whole mesh
    batches    runs of draws that share all state; each has its own region of draw commands

The kernels of a phase count the units of the visible draws, test each unit, and write a command for each unit that is
left. Places follow from prefix sums, so commands have the order of the scene in every frame and on every device. An
append by atomics would be shorter, but its order changes from run to run, and with it the winner of equal depths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene

from ..meshlets.lods import SceneLevels
from ..meshlets.model import SceneMeshlets
from ..scene.draw_lists import COMMAND, DrawLists

EARLY, LATE = 0, 1
"""The phases: what the last frame saw, and what is visible although the last frame did not see it."""
PHASES = 2

GROUP = 256
"""Invocations of a work group of every kernel, and elements of a block of a prefix sum."""

DRAW = np.dtype(
    [
        ("instance", np.uint32),
        ("first_meshlet", np.uint32),
        ("units", np.uint32),
        ("batch", np.uint32),
        ("first_index", np.uint32),
        ("index_count", np.uint32),
        ("first_bit", np.uint32),
        ("flags", np.uint32),
    ]
)
"""The record of a draw (`lists.glsl`). `first_bit` is the place of its units among the bits of visibility.

The records of coarser levels of detail follow those of the draws. Of these `first_meshlet`, `units`, `first_index`,
`index_count` and the flag WHOLE take the place of the draw's own; `first_bit` has the bits of a float, the error.
"""

WHOLE, ALWAYS, TWO_SIDED = 1, 2, 4
"""Flags of a draw: its only unit is the whole mesh; it is never culled; its back faces are seen."""

LEVELS_SHIFT, LEVELS_FIRST = 4, 8
"""Flags from here on: the number of coarser levels (4 bits), and the number of the first one's record (24 bits)."""

MOST_TASKS = 64 * 65535
"""The most task work groups of a draw, each of 32 meshlets: devices have at least 2^22, in rows of 65535."""

MOST_LEVELS = 1 << 24
"""The most records of levels."""

BATCH = np.dtype(
    [
        ("first_draw", np.uint32),
        ("first_command", np.uint32),
        ("capacity", np.uint32),
        ("unused", np.uint32),
    ]
)
"""The record of a batch. Its commands have the places [first_command, first_command + capacity) of a phase."""

COUNTERS = (
    "draws_tested",
    "draws_outside",
    "draws_hidden",
    "units_tested",
    "units_outside",
    "units_away",
    "units_hidden",
    "units_drawn",
    "triangles_drawn",
    "units_dropped",
    "meshlets_drawn",
    "draws_coarser",
)
"""The counters of a phase, in the order of their words."""

COUNTER_WORDS = 16
"""Words of the counters of a phase."""

MOST_UNITS = 1 << 24
"""The most units of a scene that get a place: 2^24 commands take 320 MiB for each phase."""

PLACE_BYTES = 8
"""Bytes of the place of a unit (`lists.glsl`)."""


@dataclass(frozen=True)
class StateLayout:
    """The words of the buffer `state`: counters, arguments of dispatches and draws, counts, and sums of blocks.

    Everything exists once for each phase, since draws of the early phase may run beside kernels of the late one.
    """

    draws: int
    batches: int
    units: int

    ARGUMENTS = 16
    """Words of the arguments of a phase (`words.glsl`)."""

    @property
    def draw_blocks(self) -> int:
        """The number of blocks of draws."""
        return max(1, -(-self.draws // GROUP))

    @property
    def unit_blocks(self) -> int:
        """The most blocks of units."""
        return max(1, -(-self.units // GROUP))

    @property
    def arguments(self) -> int:
        """The first word of the arguments of the early phase."""
        return PHASES * COUNTER_WORDS

    @property
    def counts(self) -> int:
        """The first word of the numbers of commands, one for each batch and phase."""
        return self.arguments + PHASES * self.ARGUMENTS

    @property
    def tasks(self) -> int:
        """The first word of the arguments of mesh draws, 4 words for each batch and phase."""
        return self.counts + PHASES * self.batches

    @property
    def draw_sums(self) -> int:
        """The first word of the sums of blocks of draws, 2 words for each block and phase."""
        return self.tasks + 4 * PHASES * self.batches

    @property
    def unit_sums(self) -> int:
        """The first word of the sums of blocks of units, for both phases."""
        return self.draw_sums + 2 * PHASES * self.draw_blocks

    @property
    def words(self) -> int:
        """The words of the buffer. The last one is a number of draws that is never reached."""
        return self.unit_sums + 2 * self.unit_blocks + 1

    def pushed(self, tells: bool = True) -> NDArray[np.uint32]:
        """Return (2, 4) the constants that all kernels have in common; see `records.glsl`."""
        return np.array(
            [
                [self.draws, self.batches, int(tells), self.counts],
                [self.tasks, self.draw_sums, self.unit_sums, self.draw_blocks],
            ],
            np.uint32,
        )


@dataclass(frozen=True, eq=False)
class Levels:
    """The levels of detail that a scene may be drawn with.

    `first_index` (M,) and `page_of` (M,) are those of the view's meshes in their pages; `pixels` is how far a level may
    be off in the picture.
    """

    of_scene: SceneLevels
    first_index: NDArray[np.integer]
    page_of: NDArray[np.integer]
    pixels: float

    @property
    def counts(self) -> NDArray[np.int64]:
        """(M,) The coarser levels of each mesh that lie in its page: the batch of a draw has one page."""
        meshes, counts = self.of_scene.meshes, self.of_scene.counts
        near = self.page_of[meshes] == self.page_of[meshes[:, :1]]
        within = np.minimum.accumulate(near, axis=1).sum(axis=1)
        usable: NDArray[np.int64] = np.minimum(within, counts).astype(np.int64) - 1
        return usable if usable.sum() <= MOST_LEVELS else np.zeros_like(usable)


@dataclass(frozen=True)
class CullingLists:
    """What the kernels read of a scene's draw lists.

    `draws` (D,) DRAW, `levels` (L,) DRAW of coarser levels, `batches` (B,) BATCH in the order of `DrawLists.solid`.
    `commands` is the number of commands of a phase, `units` that of the units. `bits` is the number of bits of
    visibility of the whole scene.
    """

    draws: np.ndarray
    levels: np.ndarray
    batches: np.ndarray
    units: int
    commands: int
    bits: int
    dropped: int
    """Units that would not be drawn if all of them were visible, for lack of places."""

    @property
    def warning(self) -> str:
        """A sentence about units without places, or ""."""
        if not self.dropped:
            return ""
        return (
            f"Culling has no places for {self.dropped:,} of the meshlets and small meshes of this scene. Where more "
            "have to be tested than there are places, some are not drawn (units_dropped): take fewer instances, or "
            "larger meshes."
        )

    @property
    def meshed(self) -> NDArray[np.bool_]:
        """(B,) Whether any draw of a batch has meshlets, at any of its levels."""
        flags = self.draws["flags"].astype(np.int64)
        cut = np.r_[0, np.cumsum((self.levels["flags"] & WHOLE) == 0)]
        first, further = flags >> LEVELS_FIRST, flags >> LEVELS_SHIFT & 15
        cut_levels = cut[np.where(further > 0, first + further, 0)] > cut[np.where(further > 0, first, 0)]
        meshed = np.zeros(len(self.batches), bool)
        meshed[self.draws["batch"][((flags & WHOLE) == 0) | cut_levels]] = True
        return meshed

    @property
    def state(self) -> StateLayout:
        """The layout of the buffer `state`."""
        return StateLayout(len(self.draws), len(self.batches), self.units)


def plan_lists(
    lists: DrawLists,
    scene: Scene,
    meshlets: SceneMeshlets | None,
    always: NDArray[np.bool_],
    two_sided: NDArray[np.bool_],
    mesh_shaders: bool = False,
    buffer_bytes: int = 1 << 30,
    levels: Levels | None = None,
) -> CullingLists:
    """Return the tables for the solid draws of `lists`.

    Args:
        meshlets: None draws whole meshes.
        always: (M,) meshes without valid bounds, which are never culled.
        two_sided: (materials,) materials whose back faces are seen.
        mesh_shaders: draw meshlets, so that only whole meshes need commands.
        buffer_bytes: the largest buffer that shaders see; with more units than places each batch gets its share.
        levels: None draws every mesh in full.
    """
    count = sum(batch.count for batch in lists.solid)
    commands = lists.commands[:count]
    instance = commands["first_instance"]
    mesh = scene.instances.mesh[instance]
    first, number = _ranges(scene, meshlets)
    further, first_level, records = _levels(scene, levels, first, number)
    # A mesh has places for that one of its levels which has the most units, and commands.
    units_of_mesh = _most(np.maximum(number, 1), further, records["units"])
    by_kernels = np.maximum(number, 1) if not mesh_shaders else (number == 0).astype(np.int64)
    whole = (records["flags"] & WHOLE) != 0
    listed_of_mesh = _most(by_kernels, further, np.where(whole | (not mesh_shaders), records["units"], 0))
    draws = np.zeros(count, DRAW)
    draws["instance"], draws["index_count"] = instance, commands["index_count"]
    draws["first_index"], draws["first_meshlet"] = commands["first_index"], first[mesh]
    draws["units"] = np.maximum(number, 1)[mesh]
    counts = [batch.count for batch in lists.solid]
    draws["batch"] = np.repeat(np.arange(len(counts)), counts)
    # By instance, so that bits stay where they are when instances are hidden or shown.
    ends = np.cumsum(units_of_mesh[scene.instances.mesh], dtype=np.int64)
    bits = int(ends[-1]) if len(ends) else 0
    starts = np.r_[0, ends[:-1]] if len(ends) else ends
    draws["first_bit"] = starts[instance]
    draws["flags"] = (
        WHOLE * (number[mesh] == 0)
        + ALWAYS * always[mesh]
        + TWO_SIDED * two_sided[scene.meshes["material"][mesh]]
        + (further[mesh] << LEVELS_SHIFT)
        + (first_level[mesh] << LEVELS_FIRST)
    )
    listed = listed_of_mesh[mesh]
    batches, room = _batches(listed, counts, min(MOST_UNITS, buffer_bytes // (PHASES * COMMAND.itemsize)))
    total = int(listed.sum())
    units = min(total, MOST_UNITS, buffer_bytes // PLACE_BYTES)
    dropped = max(0, total - min(units, room))
    if mesh_shaders:
        cut = _most(number, further, np.where(whole, 0, records["units"]))[mesh]
        tasks = np.bincount(draws["batch"], cut, len(counts)).astype(np.int64)
        dropped += int(np.maximum(tasks - 32 * MOST_TASKS, 0).sum())
    return CullingLists(draws, records, batches, units, room, bits, dropped)


def _levels(
    scene: Scene, levels: Levels | None, first: NDArray[np.int64], number: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], np.ndarray]:
    """Return (M,) how many coarser levels each mesh has, (M,) the first one's record, and (L,) the records.

    Errors are divided by the pixels that they may have, so that 1 is what is allowed.
    """
    further = np.zeros(len(scene.meshes), np.int64)
    if levels is None:
        return further, further, np.zeros(0, DRAW)
    of_scene, usable = levels.of_scene, levels.counts
    further[: len(usable)] = usable
    mesh = np.repeat(np.arange(len(usable)), usable)
    level = np.arange(len(mesh)) - np.repeat(np.cumsum(usable) - usable, usable) + 1
    coarser = of_scene.meshes[mesh, level]
    records = np.zeros(len(mesh), DRAW)
    records["first_meshlet"], records["units"] = first[coarser], np.maximum(number[coarser], 1)
    records["first_index"] = levels.first_index[coarser]
    records["index_count"] = scene.meshes["index_count"][coarser]
    records["flags"] = WHOLE * (number[coarser] == 0)
    records["first_bit"] = (of_scene.errors[mesh, level] / np.float32(levels.pixels)).view(np.uint32)
    return further, np.cumsum(further) - further, records


def _most(own: NDArray[np.int64], further: NDArray[np.int64], of_levels: np.ndarray) -> NDArray[np.int64]:
    """Return (M,) the largest of each mesh's own number and those of its levels, which are in the order of meshes."""
    most = own.copy()
    np.maximum.at(most, np.repeat(np.arange(len(own)), further), of_levels.astype(np.int64))
    return most


def _ranges(scene: Scene, meshlets: SceneMeshlets | None) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (M,) the first meshlet and the number of meshlets of each mesh; views of a scene may add meshes."""
    ranges = np.zeros((len(scene.meshes), 2), np.int64)
    if meshlets is not None:
        ranges[: len(meshlets.ranges)] = meshlets.ranges
    return ranges[:, 0], ranges[:, 1]


def _batches(units: NDArray[np.int64], counts: list[int], most: int) -> tuple[np.ndarray, int]:
    """Return the batches, and the number of commands of a phase; `units` (D,) are those of each draw with a command."""
    batches = np.zeros(len(counts), BATCH)
    if not counts:
        return batches, 0
    batches["first_draw"] = np.r_[0, np.cumsum(counts)[:-1]]
    wanted = np.add.reduceat(units, batches["first_draw"].astype(np.intp))
    total = int(wanted.sum())
    capacity = wanted if total <= most else np.minimum(wanted, np.maximum(1, wanted * most // total))
    batches["capacity"] = capacity
    batches["first_command"] = np.r_[0, np.cumsum(capacity)[:-1]]
    return batches, int(capacity.sum())


def folded(groups: int) -> tuple[int, int]:
    """Return a dispatch of at least `groups` work groups, with at most 65535 along an axis; see `words.glsl`."""
    rows = -(-groups // 65535)
    return (groups, 1) if rows <= 1 else (65535, rows)


def command_bytes(lists: CullingLists) -> int:
    """Return the bytes of the commands of both phases."""
    return PHASES * max(1, lists.commands) * COMMAND.itemsize
