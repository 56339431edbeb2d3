"""The records that shaders read, written to a slot when they changed since that slot was used last."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from common import layouts
from common.errors import SceneError
from common.scene import Change, Pose, Scene

from ..clusters.lights import LightRecords
from . import packing


class Mapped(Protocol):
    """A buffer that the CPU writes: its bytes, and the same as an array of some type."""

    @property
    def mapped(self) -> np.ndarray:
        """(size,) uint8."""

    def view(self, dtype: Any) -> np.ndarray:
        """The bytes as an array of `dtype`."""


@dataclass
class Slot:
    """The buffers of one frame in flight, and what was written to them last. Unlit scenes have no `lights`."""

    frame: Mapped
    instances: Mapped
    materials: Mapped
    lights: Mapped | None
    commands: Mapped
    written: dict[str, Any] = field(default_factory=dict)


RECORD_BYTES = layouts.dtype("Instance").itemsize


def instance_parts(count: int, most: int) -> list[tuple[int, int]]:
    """Return (offset, bytes) of each part of the records of `count` instances, for bindings of at most `most` bytes.

    There are one or two. Parts begin at multiples of 256 bytes, as any device allows. Raises SceneError for more.
    """
    size, whole = max(1, count) * RECORD_BYTES, most // (4 * RECORD_BYTES) * 4 * RECORD_BYTES
    if size <= whole:
        return [(0, size)]
    if size > 2 * whole:
        raise SceneError(
            f"This scene has {count} instances, and shaders of this device see {2 * whole // RECORD_BYTES}: merge "
            "some of its meshes."
        )
    return [(0, whole), (whole, size - whole)]


def buffer_sizes(scene: Scene) -> dict[str, int]:
    """Return the bytes of each of a slot's buffers."""
    return {
        "frame": layouts.dtype("FrameConstants").itemsize,
        "instances": max(1, len(scene.instances)) * layouts.dtype("Instance").itemsize,
        "materials": max(1, len(scene.materials)) * packing.MATERIAL.itemsize,
        "lights": 16 + max(1, len(scene.lights)) * packing.LIGHT.itemsize,  # also if fewer are kept
    }


class Records:
    """Packs the scene at a pose and writes it into slots. `light_cutoff` and `most_lights` are settings."""

    def __init__(self, scene: Scene, light_cutoff: float, most_lights: int) -> None:
        self._scene, self._lights = scene, LightRecords(scene, light_cutoff, most_lights)
        self._previous_pose: Pose | None = None
        self.instances = np.zeros(0, layouts.dtype("Instance"))
        """The records that were written last."""
        self.revision = 0
        """Counts changes of `instances`, so that derived data need not compare all of them."""
        self.maps = np.zeros((len(scene.materials), 8), np.uint32)
        """Which texture each role of each material samples."""

    def forget_pose(self) -> None:
        """Let the next frame be the first: nothing has a previous transform."""
        self._previous_pose = None

    def moving_key(self, pose: Pose) -> tuple[int, float | None]:
        """Return what the places of nodes and vertices follow from."""
        return self._scene.revision[Change.TRANSFORMS], pose.time if self._scene.animations else None

    def write(self, slot: Slot, pose: Pose) -> int:
        """Write what changed since this slot was used last; return the bytes written."""
        scene, written = self._scene, 0
        revisions = scene.revision
        key = self.moving_key(pose), revisions[Change.VISIBILITY]  # a record says whether it is shown
        if slot.written.get("instances") != (key, "settled"):
            records = packing.pack_instances(scene, pose, self._previous_pose)
            slot.instances.view(records.dtype)[: len(records)] = records
            written += records.nbytes
            # An object that stops is written once more, so that its previous transform is its present one.
            moved = bool((records["flags"] & layouts.INSTANCE_MOVED).any())
            slot.written["instances"] = (key, "moving" if moved else "settled")
            self.instances = slot.written["instance_records"] = records
            self.revision += 1
        self._previous_pose = pose
        if slot.written.get("materials") != revisions[Change.MATERIALS]:
            records = packing.pack_materials(scene.materials, self.maps)
            slot.materials.view(records.dtype)[: len(records)] = records
            written += records.nbytes
            slot.written["materials"] = revisions[Change.MATERIALS]
        self._lights.follow()
        # The default light moves with the camera, so its place says more than the revision of transforms.
        places = pose.world_from_node[self._lights.nodes].tobytes()
        light_key = (places, revisions[Change.LIGHTS])
        if slot.lights is not None and slot.written.get("lights") != light_key:
            records = self._lights.at(pose)
            slot.lights.view(np.uint32)[:4] = (len(records), self._lights.directional, 0, 0)
            slot.lights.mapped[16:].view(packing.LIGHT)[: len(records)] = records
            written += records.nbytes + 16
            slot.written["light_records"] = records
            slot.written["lights"] = light_key
        return written

    def darken(self, nodes: NDArray[np.bool_]) -> None:
        """Let the lights at `nodes` (N,) give no light; call it before the first frame."""
        self._lights.dark = nodes if nodes.any() else None

    def write_maps(self, slot: Slot, revision: int) -> None:
        """Write the textures of the materials alone, if `revision` of `maps` is another one than the slot's."""
        if slot.written.get("maps", 0) != revision:
            slot.materials.view(packing.MATERIAL)["maps"][: len(self.maps)] = self.maps
            slot.written["maps"] = revision
