"""Casters drawn to all layers of a target at once: a round's lists become task groups, and one call draws a batch.

    layers.comp   for each batch: task groups of its lists, and the layer of each face of a light
    layers.task   32 entries of a list: a mesh shader for each meshlet and each of its faces that the round draws
    layers.mesh   the vertices of a meshlet in the clip space of a face, and the number of its layer

A whole mesh that is no larger than a meshlet is drawn as one. Larger meshes without meshlets, and those that deform,
are drawn by commands over it, face by face. A device draws to at most as many layers at once as it says, so a round has
no more faces than that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..frames.backend.backend import Backend
from ..frames.commands import Commands, DrawGroup, SceneBinding
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built, PipelineDescription, Pipelines
from ..scene.packing import Variant
from ..scene.pass_parts import PassParts
from ..shadows.lists import Round, ShadowLists
from ..shadows.memory import ShadowMemory

ROW_BYTES = 16
"""Bytes of the arguments of a batch, and of the element of each list behind them (rows.glsl)."""


def layered_casters(parts: PassParts, backend: Backend) -> LayeredCasters | None:
    """Return what draws to layers, if mesh shaders draw the solid objects of the picture, too (culling/choice.py)."""
    culled: Any = parts.draws.culled
    if not getattr(culled, "mesh_shaders", False):
        return None
    memory = backend.part(__package__).LayerMemory(backend)
    return LayeredCasters(memory, culled.meshlets.limits) if memory.most_layers > 1 else None


class LayeredCasters:
    """The draws of meshlets in a round."""

    def __init__(self, memory: Any, limits: tuple[int, int]) -> None:
        self._memory, self._limits = memory, limits
        self.most_layers: int = memory.most_layers
        """The faces that a round may have."""
        self._kernel: Built
        self._built: dict[Variant, Built] = {}

    def create(self, pipelines: Pipelines, described: Mapping[Variant, PipelineDescription]) -> list[Built]:
        """Return the pipelines in place of those that are `described`."""
        most = ("MAX_VERTICES", self._limits[0]), ("MAX_TRIANGLES", self._limits[1])
        built = pipelines.get(
            [
                replace(
                    it,
                    shaders=("mesh_layers/layers.task", "mesh_layers/layers.mesh", *it.shaders[1:]),
                    defines=(*it.defines, *most),
                    name=f"{it.name} in layers",
                )
                for it in described.values()
            ]
        )
        self._built = dict(zip(described, built, strict=True))
        kernel = ComputeDescription("mesh_layers/layers.comp", name="layers of shadow faces")
        self._kernel = pipelines.get([kernel])[0]
        return built

    def follow(self, lists: ShadowLists, memory: ShadowMemory) -> None:
        """Make the buffers for other lists."""
        words = np.zeros(0, np.uint32) if lists.meshlets is None else lists.meshlets.words
        self._memory.make(memory, words, max(1, lists.batches) * (1 + lists.layers) * ROW_BYTES)

    def wait(self, commands: Commands) -> None:
        """Let kernels write lists that task shaders have read."""
        self._memory.wait(commands)

    def cull(self, commands: Commands, lists: ShadowLists, turn: Round) -> None:
        """Record the kernel that counts the task groups of a round, behind the one that writes its lists."""
        if not lists.by_mesh_shaders.any():
            return
        rows = [[turn.first, turn.first, turn.layers, lists.layers], [turn.layers, lists.batches, 0, 0]]
        self._memory.bind(commands, self._kernel)
        commands.push(self._kernel, np.array(rows, np.uint32))
        commands.dispatch(lists.batches)
        self._memory.wait_for_rows(commands)

    def draw(
        self,
        commands: Any,
        lists: ShadowLists,
        turn: Round,
        casters: Sequence[tuple[DrawGroup, Variant] | None],
        binding: SceneBinding,
    ) -> None:
        """Clear the layers of a round, and record the draws of meshlets to all of them.

        `casters` are the group of each batch and the variant of its material, None where it casts no shadows.
        """
        groups = []
        for number, (caster, row) in enumerate(zip(casters, lists.tables.batches.tolist(), strict=True)):
            if caster is None or not lists.by_mesh_shaders[number]:
                continue
            group, variant = caster
            pipeline = self._built[variant]
            constants = [
                [turn.first, lists.layers, lists.places, turn.layers],
                [number, lists.batches, row[1], 0],
            ]
            offset = number * (1 + lists.layers) * ROW_BYTES
            meshlets = self._memory.mesh_draw(pipeline, np.array(constants, np.uint32), offset)
            groups.append(replace(group, pipeline=pipeline, meshlets=meshlets))
        self._memory.begin_layers(commands, turn.size, turn.layers)
        commands.draw_groups(groups, binding)
        self._memory.end_layers(commands)
