"""The input of the cloth kernels in a frame, and the order of their dispatches.

Three executions simulate the same bits:

    thread      one invocation for each cloth, one particle after the other; the oracle
    group       one work group for each cloth, with barriers between its invocations
    dispatch    one dispatch for every stage of every substep, over all cloths, with barriers between them

The buffer `frame` has the number of steps of each cloth. So a recording of `thread` or `group` is valid for any number,
0 included; one of `dispatch` is valid up to the `count` that it was recorded for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from .layout import CLOTH_FRAME, COLLIDER, GLOBALS, NOWHERE, RESET, SHAPES, STATS, THREADS, WRITE, Packed
from .types import Collider, Float64, Forces, State, Steps

Execution = Literal["thread", "group", "dispatch"]

LARGEST_GROUP = 1024
"""Particles of the largest cloth that one work group simulates by default."""

_SIMULATION = (
    *("table", "frame", "colliders", "positions", "velocities", "scratch"),
    *("particles", "springs", "lengths", "incidence", "triangles", "lambdas"),
)
_READ_ONLY = (
    "table",
    "frame",
    "colliders",
    "particles",
    "springs",
    "lengths",
    "incidence",
    "triangles",
    "surface",
)


@dataclass(frozen=True)
class Kernel:
    """A compute shader of this folder, the macros it is built with, and the buffers of its bindings, in order."""

    file: str
    buffers: tuple[str, ...]
    own: tuple[tuple[str, int], ...] = ()

    @property
    def defines(self) -> dict[str, int | str]:
        """The macros of the shader: its own, and the numbers that Python and the shaders share."""
        flags: dict[str, int | str] = {"RESET": f"{RESET}u", "WRITE": f"{WRITE}u", "NOWHERE": NOWHERE}
        return {"THREADS": THREADS, **flags, **dict(self.own)}

    @property
    def written(self) -> frozenset[str]:
        """The buffers that the kernel may write."""
        named = {"normals": {"normals"}, "stats": {"stats"}, "vertices": {"words"}}
        stem = self.file.removeprefix("cloth/").removesuffix(".comp")
        return frozenset(named.get(stem) or set(self.buffers) - {*_READ_ONLY})


@dataclass(frozen=True)
class Dispatch:
    """One dispatch: `push` are the four words of its push constants, `page` is that of "words" if it binds it.

    `after` is whether it reads results of the dispatches before it, and needs a barrier.
    """

    kernel: Kernel
    groups: tuple[int, int, int]
    push: tuple[int, int, int, int] = (0, 0, 0, 0)
    page: int = -1
    after: bool = True


@dataclass
class Moment:
    """The input of a frame for each of N cloths.

    `steps` (N,) are the steps to simulate, 0 for a cloth at rest. `begin` (N,) is whether it starts anew at rest,
    `write` (N,) whether its vertices are written. `before` and `after` (N, 4, 4) are the motion of its node before and
    after these steps, as `motion_between` returns it.
    """

    steps: NDArray[np.integer[Any]]
    begin: NDArray[np.bool_]
    write: NDArray[np.bool_]
    before: Float64
    after: Float64

    @classmethod
    def still(cls, cloths: int, steps: int = 1, begin: bool = False, write: bool = True) -> Moment:
        """Return the input of a frame in which all cloths make `steps`, and no node moves."""
        eye = np.broadcast_to(np.eye(4), (cloths, 4, 4))
        return cls(np.full(cloths, steps), np.full(cloths, begin), np.full(cloths, write), eye, eye)


def choose_execution(packed: Packed, wanted: str = "auto") -> Execution:
    """Return the execution of these cloths; "auto" takes a work group for each unless one of them is large."""
    if wanted != "auto":
        return cast(Execution, wanted)
    largest = max(len(model.positions) for model in packed.models)
    return "group" if largest <= LARGEST_GROUP else "dispatch"


def frame_arrays(
    packed: Packed, steps: Steps, forces: Forces, moment: Moment, colliders: Sequence[Collider] = ()
) -> dict[str, NDArray[np.uint8]]:
    """Return the bytes of the buffers "frame" and "colliders".

    Raises ValueError for more colliders than the buffers have room for.
    """
    if len(colliders) > packed.colliders:
        raise ValueError(f"{len(colliders)} colliders, and the buffers were made for {packed.colliders}")
    cloths = [model.cloth for model in packed.models]
    h = steps.h
    head = np.zeros(1, GLOBALS)
    head["gravity"][0, :3], head["wind"][0, :3] = forces.gravity, forces.wind
    head["times"] = (h, 1.0 / h, h / 2, 1.0 / (h * h))
    head["cut"] = (
        steps.substeps,
        steps.iterations,
        steps.method == "springs" and steps.integrator == "verlet",
        steps.method == "xpbd",
    )
    rows = np.zeros(len(cloths), CLOTH_FRAME)
    numbers = np.arange(len(cloths))
    flags = np.where(moment.begin, RESET, 0) | np.where(moment.write, WRITE, 0)
    rows["run"] = np.stack(
        [moment.steps, flags, numbers * packed.colliders, np.full(len(cloths), len(colliders))], axis=1
    )
    damping, drag = (np.array([getattr(cloth, name) for cloth in cloths]) for name in ("damping", "drag"))
    rows["factors"][:, 0], rows["factors"][:, 1] = np.exp(-damping * h), np.exp(-damping * (h / 2))
    rows["factors"][:, 2], rows["factors"][:, 3] = forces.air_density * drag / 12, moment.steps * steps.dt
    rows["before"], rows["after"] = moment.before[:, :3], moment.after[:, :3]
    table = np.zeros((len(cloths), packed.colliders), COLLIDER)
    for place, collider in enumerate(colliders):
        _write_collider(table[:, place], collider, np.array([cloth.anchor for cloth in cloths]))
    frame = np.concatenate([head.view(np.uint8), rows.view(np.uint8)])
    return {"frame": frame, "colliders": table.reshape(-1).view(np.uint8)}


def _write_collider(records: NDArray[Any], collider: Collider, anchors: Float64) -> None:
    """Fill the records (N,) of one collider, relative to the anchors (N, 3) of the cloths."""
    axes, lengths = collider_axes(collider)
    records["rows"][..., :3] = axes
    records["rows"][..., 3] = collider.world_from_collider[:3, 3] - anchors
    records["size"][:, :3] = lengths
    records["size"][:, 3] = SHAPES.index(collider.shape)
    records["velocity"][:, :3], records["spin"][:, :3] = collider.velocity, collider.spin
    records["velocity"][:, 3] = any((*collider.velocity, *collider.spin))


def collider_axes(collider: Collider) -> tuple[Float64, Float64]:
    """Return the (3, 3) rotation into a collider's axes, and its scaled half or radius (3,)."""
    linear = np.asarray(collider.world_from_collider, np.float64)[:3, :3]
    scale = np.linalg.norm(linear, axis=0)
    axes = (linear / np.where(scale > 0, scale, 1.0)).T
    if collider.shape == "box":
        return axes, np.asarray(collider.half, np.float64) * scale
    return axes, np.full(3, collider.radius * float(scale.max()))


@cache
def _loop(group_size: int) -> Kernel:
    return Kernel("cloth/loop.comp", _SIMULATION, (("GROUP", group_size),))


@cache
def _stage(name: str) -> Kernel:
    return Kernel("cloth/stage.comp", _SIMULATION, ((name, 1),))


NORMALS = Kernel("cloth/normals.comp", ("table", "frame", "positions", "normals", "incidence", "triangles"))
VERTICES = Kernel(
    "cloth/vertices.comp", ("table", "frame", "positions", "normals", "triangles", "surface", "words")
)


@cache
def _stats(group_size: int) -> Kernel:
    return Kernel(
        "cloth/stats.comp", ("table", "frame", "positions", "velocities", "stats"), (("GROUP", group_size),)
    )


def dispatches(packed: Packed, steps: Steps, count: int, execution: Execution) -> list[Dispatch]:
    """Return the dispatches that move all cloths, in order; the buffer "frame" has their steps, up to `count`.

    The first one reads the last state that was written; each other one reads the results of the one before it.
    """
    cloths = len(packed.models)
    xpbd = steps.method == "xpbd"
    verlet = not xpbd and steps.integrator == "verlet"
    if execution == "thread":
        return [Dispatch(_loop(0), (-(-cloths // THREADS), 1, 1))]
    if execution == "group":
        return [Dispatch(_loop(packed.group_size), (cloths, 1, 1))]
    particles = (math.ceil(packed.particles / THREADS), 1, 1)
    ordered = [Dispatch(_stage("RESET_STAGE"), particles)]

    def over_particles(
        name: str, step: int, substep: int = 0, half: bool = False, at_end: bool = False
    ) -> None:
        ordered.append(Dispatch(_stage(name), particles, (step, substep, int(half), int(at_end))))

    for step in range(count):
        for substep in range(steps.substeps):
            over_particles("BEGIN_STAGE", step, substep, verlet and substep == 0)
            for iteration in range(steps.iterations if xpbd else 0):
                for color, springs in enumerate(packed.color_counts):
                    groups = (math.ceil(springs / THREADS), 1, 1)
                    ordered.append(
                        Dispatch(_stage("CONSTRAIN_STAGE"), groups, (step, substep, color, iteration))
                    )
            over_particles("END_STAGE", step, substep)
        if verlet:
            over_particles("BEGIN_STAGE", step, steps.substeps - 1, True, True)
            over_particles("END_STAGE", step, steps.substeps - 1, True, True)
    return ordered


def surface_dispatches(packed: Packed, stats: bool = True) -> list[Dispatch]:
    """Return the dispatches that write normals, vertices and tangents into the pages, and measure each cloth."""
    ordered = [Dispatch(NORMALS, (math.ceil(packed.particles / THREADS), 1, 1))]
    if stats:
        ordered.append(Dispatch(_stats(packed.group_size), (len(packed.models), 1, 1), after=False))
    for number, (page, first, count) in enumerate(packed.vertex_runs):
        groups = (math.ceil(count / THREADS), 1, 1)
        ordered.append(Dispatch(VERTICES, groups, (first, count, 0, 0), page, after=number == 0))
    return ordered


def states_of(packed: Packed, positions: NDArray[np.float32], velocities: NDArray[np.float32]) -> list[State]:
    """Return the state of each cloth from the contents of the two buffers, (P, 3) float32 each."""
    firsts = packed.first_particles[1:-1]
    parts = (np.split(array.reshape(-1, 3), firsts) for array in (positions, velocities))
    return [State(*pair) for pair in zip(*parts, strict=True)]


def stats_of(raw: NDArray[np.uint8]) -> NDArray[Any]:
    """Return the (N,) records of the buffer "stats": low, high, speed_squared, not_finite (1 if a particle is not)."""
    return raw.view(STATS)
