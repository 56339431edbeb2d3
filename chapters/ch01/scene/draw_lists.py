"""The scene's draws, sorted into lists that passes record: solid objects by state, transparent ones apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from common.scene import Scene

from .packing import Variant


class Range(NamedTuple):
    """The indices of one draw: how many, and where the first index and the first vertex lie in the shared buffer."""

    instance: int
    index_count: int
    first_index: int
    first_vertex: int


@dataclass(frozen=True)
class Batch:
    """Draws that share material and handedness; `draws` are as the backend's commands take them."""

    material: int
    mirrored: bool
    draws: Sequence[Any]


@dataclass
class DrawLists:
    """`solid` batches are drawn in any order; `transparent` ones, one per object, farthest first."""

    solid: list[Batch]
    solid_instances: list[np.ndarray]  # for each batch (G,) the instances of its draws
    transparent: list[Batch]
    transparent_instances: np.ndarray  # (B,) the instances of `transparent`

    def nearest_first(self, depth: np.ndarray) -> DrawLists:
        """Return the lists with the draws of each solid batch sorted by `depth` (I,), which grows away from the eye.

        What is hidden then fails its depth test before it is shaded. Batches keep their order: a change of state costs
        more than what sorting across them would save.
        """
        batches, instances = [], []
        for batch, members in zip(self.solid, self.solid_instances, strict=True):
            if len(members) > 1:
                order = np.argsort(depth[members], kind="stable")
                members = members[order]
                batch = replace(batch, draws=[batch.draws[place] for place in order.tolist()])
            batches.append(batch)
            instances.append(members)
        return replace(self, solid=batches, solid_instances=instances)


NOTHING = DrawLists([], [], [], np.zeros(0, np.int64))


def build_draw_lists(
    scene: Scene, variants: Sequence[Variant], mirrored: np.ndarray, make_draw: Callable[[Range], Any]
) -> DrawLists:
    """Return the lists of the visible instances.

    `mirrored` (I,) bool says whose front faces wind the other way; `make_draw` returns a draw for a backend's commands.
    """
    meshes = scene.meshes
    solid: dict[tuple[Any, ...], list[int]] = {}
    transparent: list[int] = []
    for instance in np.flatnonzero(scene.instances.visible).tolist():
        mesh = meshes[scene.instances.mesh[instance]]
        if not mesh["index_count"]:
            continue
        material = int(mesh["material"])
        variant = variants[material]
        if variant.alpha_mode == "blend":
            transparent.append(instance)
        else:
            # Masked objects after opaque ones: what is hidden by then needs no texture fetch to be discarded.
            order = (variant.alpha_mode == "mask", variant.defines, material, bool(mirrored[instance]))
            solid.setdefault(order, []).append(instance)

    def batch(instances: list[int], material: int, mirror: bool) -> Batch:
        drawn = meshes[scene.instances.mesh[instances]]
        columns = (drawn[name].tolist() for name in ("index_count", "first_index", "first_vertex"))
        ranges = (Range(*row) for row in zip(instances, *columns, strict=True))
        return Batch(material, mirror, [make_draw(each) for each in ranges])

    ordered = sorted(solid.items())
    batches = [batch(instances, order[2], order[3]) for order, instances in ordered]
    single = [
        batch([i], int(meshes["material"][scene.instances.mesh[i]]), bool(mirrored[i])) for i in transparent
    ]
    members = [np.array(instances, np.int64) for _, instances in ordered]
    return DrawLists(batches, members, single, np.array(transparent, np.int64))
