"""The scene's draws as the GPU reads them: one record each, in lists whose draws share all state.

A record of 20 bytes says what one draw is; a list of them is one call, however many objects it draws. The records
change when objects appear, vanish or turn into their mirror image. The camera changes only the order of what is
transparent, so a frame costs the CPU the same for ten objects and for a hundred thousand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from common.scene import Scene

from .packing import Variant

COMMAND = np.dtype(
    [
        ("index_count", np.uint32),
        ("instance_count", np.uint32),
        ("first_index", np.uint32),
        ("vertex_offset", np.int32),
        ("first_instance", np.uint32),
    ]
)
"""VkDrawIndexedIndirectCommand, which is OpenGL's DrawElementsIndirectCommand too."""


@dataclass(frozen=True)
class Batch:
    """Draws [first, first + count) of the list of records, which share all state: they are one call.

    `material` is one of their materials, and stands for the variant of all of them. `textures` is the number of the
    set of textures that they sample.
    """

    material: int
    mirrored: bool
    page: int
    textures: int
    first: int
    count: int
    triangles: int


@dataclass(frozen=True)
class DrawLists:
    """`commands` (D,) COMMAND: first those of the `solid` batches, then one for each transparent instance.

    Transparent ones stand in the order of the scene; `in_order` returns them in that of a frame. Rows of `states`
    (B, 4) are material, mirrored, page and textures of each, as in a `Batch`.
    """

    commands: np.ndarray
    solid: tuple[Batch, ...]
    transparent: np.ndarray  # (B,) instances
    states: np.ndarray

    def in_order(self, order: np.ndarray) -> tuple[np.ndarray, list[Batch]]:
        """Return the transparent instances' records in `order` (B,), and their batches: runs of equal state."""
        first = len(self.commands) - len(self.transparent)
        ordered = self.commands[first:][order]
        return ordered, _batches(ordered, self.states[order], first)


NOTHING = DrawLists(np.zeros(0, COMMAND), (), np.zeros(0, np.int64), np.zeros((0, 4), np.int64))


def build_draw_lists(
    scene: Scene,
    variants: Sequence[Variant],
    mirrored: np.ndarray,
    page_of: np.ndarray,
    first_index: np.ndarray,
    textures_of: np.ndarray,
) -> DrawLists:
    """Return the lists of the visible instances.

    `mirrored` (I,) bool says whose front faces wind the other way, `page_of` and `first_index` (M,) where a mesh's
    indices lie, `textures_of` (materials,) which set of textures a material samples.
    """
    meshes = scene.meshes
    mesh = scene.instances.mesh
    drawn = np.flatnonzero(scene.instances.visible & (meshes["index_count"][mesh] > 0))
    mesh = mesh[drawn]
    material = meshes["material"][mesh].astype(np.int64)
    # Materials that are drawn alike share a rank, in the order in which they are drawn: masked ones after opaque ones,
    # since what is hidden by then needs no texture fetch to be discarded.
    first_of: dict[_Alike, int] = {}
    for number, variant in enumerate(variants):
        first_of.setdefault(_alike(variant), number)
    ranks = {key: rank for rank, key in enumerate(sorted(first_of))}
    rank = np.array([ranks[_alike(variant)] for variant in variants], np.int64)[material]
    named = np.array([first_of[_alike(variant)] for variant in variants], np.int64)[material]
    states = np.stack([named, mirrored[drawn], page_of[mesh], textures_of[material]], axis=1).astype(np.int64)
    commands = np.zeros(len(drawn), COMMAND)
    commands["index_count"] = meshes["index_count"][mesh]
    commands["instance_count"] = 1
    commands["first_index"] = first_index[mesh]
    commands["first_instance"] = drawn

    through = np.array([variant.alpha_mode == "blend" for variant in variants], bool)[material]
    solid, clear = np.flatnonzero(~through), np.flatnonzero(through)
    # The last key is the first to sort by. The sort is stable, and so the scene's order stays within a batch.
    solid = solid[np.lexsort((*states[solid, 1:].T, rank[solid]))]
    batches = _batches(commands[solid], states[solid], 0)
    return DrawLists(commands[np.r_[solid, clear]], tuple(batches), drawn[clear], states[clear])


_Alike = tuple[bool, tuple[tuple[str, int], ...], bool, bool]


def _alike(variant: Variant) -> _Alike:
    # Under a view, what is transparent may be drawn as what is opaque is, and yet be left out of a pass.
    return variant.alpha_mode == "mask", variant.defines, variant.double_sided, variant.alpha_mode == "blend"


def _batches(commands: np.ndarray, states: np.ndarray, offset: int) -> list[Batch]:
    """Return the runs of equal rows of `states`; `offset` is the first draw's place in the list."""
    if not len(commands):
        return []
    starts = np.flatnonzero(np.r_[True, (states[1:] != states[:-1]).any(axis=1)])
    counts = np.diff(np.r_[starts, len(commands)])
    triangles = np.add.reduceat(commands["index_count"].astype(np.int64), starts) // 3
    columns = (starts.tolist(), counts.tolist(), triangles.tolist())
    return [
        Batch(material, bool(mirror), page, textures, offset + first, count, total)
        for (material, mirror, page, textures), first, count, total in zip(
            states[starts].tolist(), *columns, strict=True
        )
    ]
