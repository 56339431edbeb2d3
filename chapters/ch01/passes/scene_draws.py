"""The scene's draws, sorted into lists that passes record: solid objects by state, transparent ones apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from common.scene import Scene

from ..graphics.commands import Draw, DrawGroup
from ..graphics.pipelines import PUSH_SIZE, Built
from ..graphics.scene_data import SceneData
from ..logic.packing import Variant


@dataclass
class DrawLists:
    """`solid` groups are drawn in any order; `transparent` ones, one per object, farthest first."""

    solid: list[DrawGroup]
    solid_instances: list[np.ndarray]  # for each group (G,) the instances of its draws
    transparent: list[DrawGroup]
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


class DrawListBuilder:
    """Makes the draw lists of a scene, anew only when visibility or the handedness of an object changed."""

    def __init__(self, scene: Scene, data: SceneData) -> None:
        self._scene, self._data = scene, data
        # All push constants there will ever be, written once: draw number i pushes 16 bytes from row i.
        rows = np.zeros((len(scene.instances), PUSH_SIZE // 4), np.uint32)
        rows[:, 0] = np.arange(len(rows))
        self._rows = rows
        base = vk.ffi.cast("char *", vk.ffi.from_buffer(rows)) if len(rows) else vk.NULL
        self._push = [base + PUSH_SIZE * index for index in range(len(rows))]

    def build(self, mirrored: np.ndarray, pipeline_of: Callable[[Variant], Built]) -> DrawLists:
        """Return the lists of what is visible; `mirrored` (I,) bool says whose front faces wind the other way."""
        scene, meshes = self._scene, self._scene.meshes
        solid: dict[tuple[Any, ...], list[int]] = {}
        transparent: list[int] = []
        for instance in np.flatnonzero(scene.instances.visible).tolist():
            mesh = meshes[scene.instances.mesh[instance]]
            if not mesh["index_count"]:
                continue
            material = int(mesh["material"])
            variant = self._data.variants[material]
            if variant.alpha_mode == "blend":
                transparent.append(instance)
            else:
                # Masked objects after opaque ones: what is hidden by then needs no texture fetch to be discarded.
                order = (variant.alpha_mode == "mask", variant.defines, material, bool(mirrored[instance]))
                solid.setdefault(order, []).append(instance)
        ordered = sorted(solid.items())
        groups = [self._group(instances, order[2], order[3], pipeline_of) for order, instances in ordered]
        single = [
            self._group([i], int(meshes["material"][scene.instances.mesh[i]]), bool(mirrored[i]), pipeline_of)
            for i in transparent
        ]
        members = [np.array(instances, np.int64) for _, instances in ordered]
        return DrawLists(groups, members, single, np.array(transparent, np.int64))

    def _group(
        self, instances: list[int], material: int, mirrored: bool, pipeline_of: Callable[[Variant], Built]
    ) -> DrawGroup:
        variant = self._data.variants[material]
        draws = []
        for instance in instances:
            mesh = self._scene.meshes[self._scene.instances.mesh[instance]]
            count, first, vertex = (
                int(mesh["index_count"]),
                int(mesh["first_index"]),
                int(mesh["first_vertex"]),
            )
            draws.append(Draw(self._push[instance], count, first, vertex))
        return DrawGroup(
            pipeline=pipeline_of(variant),
            cull=vk.VK_CULL_MODE_NONE if variant.double_sided else vk.VK_CULL_MODE_BACK_BIT,
            front=vk.VK_FRONT_FACE_CLOCKWISE if mirrored else vk.VK_FRONT_FACE_COUNTER_CLOCKWISE,
            material=material,
            material_set=self._data.material_set(material),
            draws=draws,
        )
