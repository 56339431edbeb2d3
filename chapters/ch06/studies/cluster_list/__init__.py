"""Study: a kernel culls meshlets and lists the survivors, and mesh shaders without a task stage draw the list.

A task shader culls where it launches mesh shaders: its survivors stay in a payload of at most 16 KiB, and no memory
holds a list of them. A kernel can do the same work before the draw. It writes (instance, meshlet) of each survivor to
a buffer, in the order of the scene, and the arguments of the draw beside it. Each mesh shader then finds its meshlet by
the number of its work group, and of the draw: a draw has at most 65,535 of them along an axis, so a long list takes
several draws, and one indirect call makes them all.

The list costs memory and a pass, with a barrier behind it. In return culling runs once, however many passes draw, here
two; other kernels can read or sort the list; and devices whose task stage is slow do without it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.settings import knob

from ..meshlet_field import MOST_INSTANCES, Field, defines

STUDY = Study(
    title="cluster list",
    idea="A kernel lists the meshlets that culling leaves, and a plain grid of mesh shaders draws the list.",
    order=5,
    features=("meshlets/mesh-shader-output",),
    outputs=("color", "depth", "instance_id"),
)

GROUP = 64
"""Invocations of a work group of the kernels and of the mesh shaders."""

IN_TASK = 32
"""Meshlets that a work group of task shaders tests."""

ROW = 65_535
"""Work groups along the x axis of a draw: the most that every device takes."""

MOST_TRIANGLES = 256
"""The most that the builder of meshlets allows; devices allow as many or more."""

LIST = "studies/cluster_list/list.comp"
TASK, MESH = "studies/cluster_list/select.task", "studies/cluster_list/field.mesh"


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    instances: int = knob(150, "objects of the field", minimum=1, maximum=MOST_INSTANCES)
    way: str = knob(
        "list", "what selects meshlets: a kernel that lists them, or task shaders", choices=("list", "tasks")
    )
    vertices: int = knob(64, "most vertices of a meshlet", choices=(32, 64, 128))
    triangles: int = knob(
        124,
        "most triangles of a meshlet; 0: as many as the device draws, up to 256",
        minimum=0,
        maximum=MOST_TRIANGLES,
    )
    at_once: int = knob(
        0,
        "most meshlets of a draw, way=list only, since a longer list takes several draws; 0: 65535, or 64 in software",
        minimum=0,
        maximum=ROW,
    )
    culling: bool = knob(True, "leave meshlets out that are outside of the view or face away")
    turned: float = knob(
        0.0,
        "how far the camera of the picture is turned around the field; culling keeps its own",
        unit="deg",
        minimum=-360.0,
        maximum=360.0,
    )


def macros_of(settings: Settings, triangles: int, at_once: int) -> tuple[tuple[str, int], ...]:
    """Return the macros of all shaders."""
    return (
        *defines(settings.culling, GROUP),
        ("MAX_VERTICES", settings.vertices),
        ("MAX_TRIANGLES", triangles),
        ("LISTED", int(settings.way == "list")),
        ("AT_ONCE", at_once),
    )


def blocks_of(field: Field) -> np.ndarray:
    """Return (B, 2) uint32, what each work group of task shaders tests: an instance, and its first meshlet there."""
    counts = -(-field.instances["meshlets"].astype(np.int64) // IN_TASK)
    instance = np.repeat(np.arange(len(counts)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    first = field.instances["first_meshlet"][instance] + IN_TASK * within
    return np.stack([instance, first], axis=-1).astype(np.uint32)


def folded(groups: int) -> tuple[int, int]:
    """Return a grid of at least so many work groups, in rows of `ROW`."""
    return min(groups, ROW), -(-groups // ROW)
