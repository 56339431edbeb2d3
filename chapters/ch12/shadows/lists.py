"""What is culled for shadows: the rounds of a frame with their lists, and the tables that the kernels read. No device.

    lists.comp     for each light of a round and each batch of draws: the units in its reach, with the faces they touch
    commands.comp  for each face of the round and each batch: draw commands for those of its light's list

A round is what is drawn before it is copied into the pages: as many faces of one size as the target has layers. Lists
and commands have the same places in every round, so their memory follows from the layers and not from the lights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene

from ..culling.lists import ALWAYS, WHOLE, CullingLists, plan_lists
from ..meshlets.model import MESHLET, SceneMeshlets
from ..scene.draw_lists import COMMAND, DrawLists
from ..scene.packing import Variant
from .layout import NO_FACE

MOST_LAYERS = 64
TARGET_TEXELS = 1 << 23
"""Texels of the layers of a target together: 32 MiB of depth, or one layer if that has more."""

COMMAND_BYTES = 1 << 25
"""Bytes of the commands of all layers, or of one layer if that has more."""

BY_MESH_SHADERS = 8
"""Flag of a draw that mesh shaders draw. If it is a whole mesh, its `first_bit` is the number of its vertices."""

KEPT_LAYERS = 16
"""The most layers of a round that is kept while nothing is due for it."""

ENTRY_BYTES = 8
"""Bytes of an entry of a list."""


class Round(NamedTuple):
    """Faces that are drawn together: their size, the first word of their layers in `shadow_drawn` and of their lists in
    `shadow_lists`, and the number of layers and of lists, of which the last ones may be unused. What is drawn are
    `movers`, or all other casters."""

    size: int
    first: int
    layers: int
    movers: bool = False


@dataclass(frozen=True, eq=False)
class Schedule:
    """The rounds of a frame, and the words of `shadow_drawn` and `shadow_lists` (layout.py).

    `faces` (N,) are drawn at `places` (N,) among all layers, in ascending order.
    """

    rounds: tuple[Round, ...]
    drawn: NDArray[np.uint32]
    lists: NDArray[np.uint32]
    faces: NDArray[np.intp]
    places: NDArray[np.intp]


_NO_WORDS, _NO_FACES = np.zeros(0, np.uint32), np.zeros(0, np.intp)
NO_ROUNDS = Schedule((), _NO_WORDS, _NO_WORDS, _NO_FACES, _NO_FACES)


def target_size(size: int) -> int:
    """Return the texels along the target for faces of a size, as records.glsl says: a power of two."""
    return 1 << (size - 1).bit_length()


def layers_of(size: int, most: int = MOST_LAYERS) -> int:
    """Return how many faces of a size are drawn before they are copied into their pages, at most `most`."""
    return min(most, MOST_LAYERS, max(1, TARGET_TEXELS // (size * size)))


def schedule(
    faces: np.ndarray,
    due: NDArray[np.intp],
    most: int = MOST_LAYERS,
    padded: bool = True,
    movers: bool = False,
    begin: int = 0,
    least: Mapping[int, int] | None = None,
) -> Schedule:
    """Return the rounds for the faces `due` (N,), those of one size together and those of one light one by one.

    Layers are numbered from `begin` on; the words of these alone are returned. `least` are sizes with the layers that
    their first round has, even if no face is due.

    The six faces of a light have one list. Each cascade has its own: it sees another part of the scene. A round that is
    `padded` has a power of two of layers, so that few different recordings serve all frames; nothing is drawn to the
    layers behind the last face.
    """
    wanted = dict(least or {})
    if not len(due) and not wanted:
        return NO_ROUNDS
    base, counts = _lights_of(faces)
    rounds: list[Round] = []
    places = np.zeros(len(due), np.intp)
    sizes, first, total = faces["size"][due].astype(np.int64), 0, begin
    for size in sorted({*sizes.tolist(), *wanted}, reverse=True):
        end = first + int((sizes == size).sum())
        while first < end or size in wanted:
            faces_in = min(end - first, layers_of(size, most))
            layers = 1 << (max(faces_in, 1) - 1).bit_length() if padded else faces_in
            layers = min(max(layers, wanted.pop(size, 1)), layers_of(size, most))
            rounds.append(Round(size, total, layers, movers))
            places[first : first + faces_in] = total + np.arange(faces_in)
            first, total = first + faces_in, total + layers
    drawn, lists = np.full(total - begin, NO_FACE, np.uint32), np.zeros(total - begin, np.uint32)
    begins = np.isin(places, [turn.first for turn in rounds])
    new = begins | np.r_[True, base[due][1:] != base[due][:-1]]
    # A list has the number of the first layer of its light.
    number = places[np.maximum.accumulate(np.where(new, np.arange(len(due)), 0))]
    drawn[places - begin] = due | (due - base[due]) << 12 | number << 16
    lists[places[new] - begin] = base[due][new] | counts[base[due][new]] << 24
    return Schedule(tuple(rounds), drawn, lists, due, places)


class Pattern:
    """The rounds of frames in which something moves: they stay, whichever faces are due, and so do their recordings.

    A round of the pattern without any face costs the GPU its clears, and the CPU nothing.
    """

    def __init__(self) -> None:
        self._layers: dict[bool, dict[int, int]] = {False: {}, True: {}}

    def least(self, movers: bool) -> dict[int, int]:
        """Return sizes with layers, of rounds with or without movers."""
        return self._layers[movers]

    def learn(self, rounds: Sequence[Round]) -> None:
        """Keep rounds that are small enough."""
        for turn in rounds:
            if turn.layers <= KEPT_LAYERS:
                layers = self._layers[turn.movers]
                layers[turn.size] = max(layers.get(turn.size, 0), turn.layers)

    def clear(self) -> None:
        """Keep none: nothing moves."""
        self._layers = {False: {}, True: {}}


def joined(first: Schedule, second: Schedule) -> Schedule:
    """Return two schedules one after the other, of which the second was made for layers behind the first."""
    if not second.rounds:
        return first
    parts = zip(_arrays(first), _arrays(second), strict=True)
    return Schedule(first.rounds + second.rounds, *(np.concatenate(each) for each in parts))


def _arrays(rounds: Schedule) -> tuple[NDArray[Any], ...]:
    """Return the arrays of a schedule."""
    return rounds.drawn, rounds.lists, rounds.faces, rounds.places


def _lights_of(faces: np.ndarray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return for each face the first one that shares its list, and for that one the number of all that do."""
    number = np.arange(len(faces))
    other = (faces["light"][1:] != faces["light"][:-1]) | (faces["size"][1:] != faces["size"][:-1])
    alone = faces["perspective"] == 0
    base = np.maximum.accumulate(np.where(np.r_[True, other] | alone, number, 0))
    base = np.where(alone, number, base)
    return base, np.bincount(base, minlength=len(faces))


@dataclass(frozen=True, eq=False)
class ShadowLists:
    """The tables of casters: draws, batches and meshlets as culling has them, of which only casters have units."""

    tables: CullingLists
    meshlets: SceneMeshlets | None
    most_layers: int | None = None
    """The layers that mesh shaders draw to at once; None if commands draw all casters."""

    @cached_property
    def by_commands(self) -> NDArray[np.bool_]:
        """(B,) Whether commands draw any caster of a batch."""
        return self._any_with(0)

    @cached_property
    def by_mesh_shaders(self) -> NDArray[np.bool_]:
        """(B,) Whether mesh shaders draw any caster of a batch."""
        return self._any_with(BY_MESH_SHADERS)

    def _any_with(self, flag: int) -> NDArray[np.bool_]:
        draws = self.tables.draws
        chosen = (draws["units"] > 0) & ((draws["flags"] & BY_MESH_SHADERS) == flag)
        held: NDArray[np.bool_] = np.bincount(draws["batch"][chosen], minlength=self.batches) > 0
        return held

    @property
    def places(self) -> int:
        """Entries of a list, and commands of a face."""
        return max(1, self.tables.commands)

    @property
    def batches(self) -> int:
        """The number of batches."""
        return len(self.tables.batches)

    @property
    def layers(self) -> int:
        """The most faces of a round."""
        places = COMMAND_BYTES // (self.places * COMMAND.itemsize)
        return max(1, min(MOST_LAYERS, self.most_layers or MOST_LAYERS, places))

    @property
    def contents(self) -> dict[str, np.ndarray]:
        """The buffers that never change while the draw lists stay the same."""
        return {
            "draws": self.tables.draws,
            "batches": self.tables.batches,
            "meshlets": np.zeros(0, MESHLET) if self.meshlets is None else self.meshlets.records,
        }

    @property
    def sizes(self) -> dict[str, int]:
        """Bytes of the buffers that the kernels write; the last number of commands is one that is never reached."""
        return {
            "lists": self.layers * self.places * ENTRY_BYTES,
            "numbers": 4 * (2 * self.layers * max(1, self.batches) + 1),
            "commands": bool(self.by_commands.any()) * self.layers * self.places * COMMAND.itemsize,
        }

    def bytes_of(self, name: str) -> int:
        """Return the bytes of a buffer; there are no empty ones."""
        contents = self.contents
        return max(16, contents[name].nbytes if name in contents else self.sizes[name])


def shadow_lists(
    lists: DrawLists,
    scene: Scene,
    meshlets: SceneMeshlets | None,
    variants: list[Variant],
    casts: list[bool],
    buffer_bytes: int,
    most_layers: int | None = None,
) -> ShadowLists:
    """Return the tables for the solid draws of `lists`; `casts` (materials,) says which materials cast shadows.

    `most_layers` is how many layers mesh shaders draw to at once, None if they draw no casters.
    """
    always = np.zeros(len(scene.meshes), bool)
    always[[deformation.mesh for deformation in scene.deformations]] = True
    two_sided = np.array([variant.double_sided for variant in variants], bool)
    tables = plan_lists(lists, scene, meshlets, always, two_sided, buffer_bytes=buffer_bytes)
    mesh = scene.instances.mesh[tables.draws["instance"]]
    tables.draws["units"][~np.array(casts, bool)[scene.meshes["material"][mesh]]] = 0
    if meshlets is not None and most_layers is not None:
        _give_to_mesh_shaders(tables.draws, scene.meshes[mesh], meshlets.limits)
    return ShadowLists(tables, meshlets, most_layers)


def _give_to_mesh_shaders(draws: np.ndarray, meshes: np.ndarray, limits: tuple[int, int]) -> None:
    """Flag the draws (D,) of `meshes` (D,) that have meshlets, or are no larger than one; none that deforms."""
    vertices, triangles = limits
    whole = (draws["flags"] & WHOLE) != 0
    small = (meshes["vertex_count"] <= vertices) & (meshes["index_count"] <= 3 * triangles)
    draws["flags"][((draws["flags"] & ALWAYS) == 0) & (small | ~whole)] |= BY_MESH_SHADERS
    draws["first_bit"][whole] = meshes["vertex_count"][whole]
