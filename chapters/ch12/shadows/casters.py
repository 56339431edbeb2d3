"""What changes about casters from frame to frame: which have moved, and the tables for the kernels that cull."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.contract import FrameInfo, Pass
from common.scene import Change

from ..cloth.passes import ClothPass
from ..frames.backend.backend import Backend
from ..mesh_layers.layered import layered_casters
from ..movers.model import Movers, Moves
from ..scene.pass_parts import PassParts
from .lists import shadow_lists
from .memory import ShadowMemory
from .passes import ShadowsPass

LARGEST = 1 << 27
"""Bytes of the largest buffer of commands that is made."""


class Casters:
    """Follows the objects of a scene."""

    def __init__(self, parts: PassParts, backend: Backend, own: ShadowsPass, cloth: Pass) -> None:
        self._parts, self._backend, self._pass, self._cloth = parts, backend, own, cloth
        plan, capabilities = backend.plan, backend.device.capabilities
        self._culls = plan.native("multi-draw")
        own.counts_draws = plan.native("draw-indirect-count")
        # See `ShadowMemory.unlimited`.
        self._confused = own.counts_draws and capabilities.is_software
        self._buffer_bytes = min(int(capabilities.limits["maxStorageBufferRange"]), LARGEST)
        own.culls = self._culls
        own.layered = layered_casters(parts, backend) if self._culls else None
        self._lists_seen: Any = None
        self._seen: Any = None
        self._pose: Any = None
        deforming = np.zeros(len(parts.scene.meshes), bool)
        deforming[[deformation.mesh for deformation in parts.scene.deformations]] = True
        self.movers = Movers(deforming[parts.scene.instances.mesh])
        self._maps, self._masked = 0, True
        self._all_drawn: int | None = None

    def follow(self, frame: FrameInfo, memory: ShadowMemory, instances: int) -> Moves:
        """Follow edits and poses; return what has changed since the last frame.

        `instances` is the number of the places of all objects (`Versions`).
        """
        parts, draws = self._parts, self._parts.draws
        if self._culls and draws.lists is not self._lists_seen:
            self._follow_lists(memory)
        if self._confused and self._pass.lists is not None and draws.culled is None:
            numbered = memory.unlimited(draws.binding.records, self._pass.lists)
            draws.binding = draws.binding._replace(counted=numbered)
        revision = parts.scene.revision
        pose = parts.data.records.moving_key(frame.pose)[1] if parts.scene.deformations else None
        cloth = not self._cloth.resting
        deformed, self._pose = pose != self._pose or cloth, pose
        if self._all_drawn is not None:  # with the textures that were there when that frame was submitted
            self._maps = parts.data.slots[self._all_drawn].written.get("maps", 0)
        seen = revision[Change.VISIBILITY], revision[Change.MATERIALS]
        everything, self._seen = seen != self._seen or not self.resting, seen
        self._all_drawn = frame.slot if everything else None
        records = parts.data.slots[frame.slot].written["instance_records"]
        known = self._cloth_boxes() if cloth and deformed else {}
        return Moves(everything, *self.movers.follow(records, instances, deformed, known))

    def _cloth_boxes(self) -> dict[int, NDArray[np.float64]]:
        """Return the boxes of cloths, by instance, relative to the scene's origin."""
        boxes = self._cloth.boxes() if isinstance(self._cloth, ClothPass) else {}
        return {instance: box - self._parts.scene.origin for instance, box in boxes.items()}

    def _follow_lists(self, memory: ShadowMemory) -> None:
        """Make the tables of casters anew, since other objects are drawn."""
        parts, own = self._parts, self._pass
        self._lists_seen = parts.draws.lists
        meshlets = getattr(parts.draws.culled, "meshlets", None)
        variants = parts.data.variants
        self._masked = any(own.takes(variant) and variant.alpha_mode == "mask" for variant in variants)
        casts = [own.takes(variant) for variant in variants]
        own.lists = shadow_lists(
            parts.draws.lists,
            parts.scene,
            meshlets,
            variants,
            casts,
            self._buffer_bytes,
            None if own.layered is None else own.layered.most_layers,
        )
        memory.make_lists(own.lists)
        if own.layered is not None:
            memory.most_layers = own.layered.most_layers
            own.layered.follow(own.lists, memory)
        self._backend.frames.forget()

    @property
    def resting(self) -> bool:
        """Whether all faces have the holes of the textures that have arrived."""
        return not self._masked or all(
            slot.written.get("maps", 0) <= self._maps for slot in self._parts.data.slots
        )
