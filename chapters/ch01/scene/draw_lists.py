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


MakeGroup = Callable[[Sequence[Range], int, bool], Any]
"""Makes a backend's group (a dataclass with a list `draws`, one for each range) of a material; bool: mirrored."""


@dataclass
class DrawLists:
    """`solid` groups are drawn in any order; `transparent` ones, one per object, farthest first."""

    solid: list[Any]
    solid_instances: list[np.ndarray]  # for each group (G,) the instances of its draws
    transparent: list[Any]
    transparent_instances: np.ndarray  # (B,) the instances of `transparent`

    def nearest_first(self, depth: np.ndarray) -> DrawLists:
        """Return the lists with the draws of each solid group sorted by `depth` (I,), which grows away from the eye.

        What is hidden then fails its depth test before it is shaded. Groups keep their order: a change of state costs
        more than what sorting across them would save.
        """
        groups, instances = [], []
        for group, members in zip(self.solid, self.solid_instances, strict=True):
            if len(members) > 1:
                order = np.argsort(depth[members], kind="stable")
                members = members[order]
                group = replace(group, draws=[group.draws[place] for place in order.tolist()])
            groups.append(group)
            instances.append(members)
        return replace(self, solid=groups, solid_instances=instances)


NOTHING = DrawLists([], [], [], np.zeros(0, np.int64))


def build_draw_lists(
    scene: Scene, variants: Sequence[Variant], mirrored: np.ndarray, make_group: MakeGroup
) -> DrawLists:
    """Return the lists of what is visible; `mirrored` (I,) bool says whose front faces wind the other way."""
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

    def ranges(instances: list[int]) -> list[Range]:
        found = meshes[scene.instances.mesh[instances]]
        columns = (found[name].tolist() for name in ("index_count", "first_index", "first_vertex"))
        return [Range(*row) for row in zip(instances, *columns, strict=True)]

    ordered = sorted(solid.items())
    groups = [make_group(ranges(instances), order[2], order[3]) for order, instances in ordered]
    single = [
        make_group(ranges([i]), int(meshes["material"][scene.instances.mesh[i]]), bool(mirrored[i]))
        for i in transparent
    ]
    members = [np.array(instances, np.int64) for _, instances in ordered]
    return DrawLists(groups, members, single, np.array(transparent, np.int64))
