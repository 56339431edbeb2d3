"""A cloth from a mesh: particles at the vertices, springs between them, masses from the areas around them.

Springs follow Provot ("Deformation constraints in a mass-spring model to describe rigid cloth behavior", 1995). In a
grid of columns and rows each particle has twelve springs. Four run along the threads (stretch) and four across the
meshes (shear). Four lead to the particles two columns or rows away (bend); a fold shortens them. Without a grid,
springs come from the triangles. Their edges resist stretch, the two diagonals of a quad resist shear, and a spring
between the two corners opposite any other inner edge resists bending.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError

from .fields import brief
from .types import KINDS, Cloth, Float64

STIFFNESS = (1.0, 1e6)
"""Least and greatest stiffness of a spring, in newtons a metre."""

LEAST_MASS = 0.01
"""Least mass of a particle, as a part of the mean of particles with area; a lighter one would need shorter steps."""

MOST = 1e9
"""The largest value of a property: 32 bits hold it, and the numbers computed from it."""

LEAST_DENSITY = 1e-6
"""Least density of a cloth in kilograms a square metre: a milligram."""

LEAST_PARTICLE = 1e-20
"""Least mass of any particle in kilograms, so that 1 / mass is a number of 32 bits."""

MOST_METRES = 1e6
"""Largest size of a cloth in metres: squares and their products are then numbers of 32 bits."""

MASS_WITHOUT_AREA = 0.001
"""Mass of each particle of a cloth without any area, in kilograms."""

_DIAGONAL = 1.01
"""An edge is the diagonal of a quad if it is this much longer than the other edges of both its triangles."""

_NEIGHBOURS = ((0, 1, 0), (0, 0, 1), (1, 1, 1), (1, -1, 1), (2, 2, 0), (2, 0, 2))
"""(kind, columns, rows) to half of Provot's twelve neighbours; the springs to the other half begin there."""

Int32 = NDArray[np.int32]


def build_cloth(
    positions: Float64,
    triangles: NDArray[np.integer[Any]],
    properties: Mapping[str, Any],
    *,
    mesh: int = 0,
    node: int = 0,
    anchor: Sequence[float] | Float64 = (0.0, 0.0, 0.0),
    name: str = "cloth",
) -> Cloth:
    """Return the cloth of a mesh with these vertices (V, 3) and triangles (T, 3).

    `positions` are metres relative to `anchor`, along the world's axes. `properties` are those of the node (see
    `number_of` for their ranges): columns and rows (both or neither; vertices then are rows of columns), pins (numbers
    of vertices), kg_per_m2, stretch_n_per_m, shear_n_per_m, bend_n_per_m, damping_per_s, drag, thickness_m, friction.

    Vertices at one place share a particle; a vertex without a triangle has none. Particles are in the order of their
    first vertices. `Cloth.warnings` has a sentence for each property that was adapted.

    Raises SceneError for positions that are not finite, triangles and pins that name no vertex, a grid that does not
    fit the vertices, and a cloth larger than MOST_METRES. It also refuses a mass, stiffness, damping, drag, thickness
    or friction that is negative, not a number, or larger than MOST.
    """
    positions = np.ascontiguousarray(positions, np.float64).reshape(-1, 3)
    faces = np.ascontiguousarray(triangles, np.int64).reshape(-1, 3)
    count = len(positions)
    if not np.isfinite(positions).all():
        raise SceneError(f"The cloth {name} has a vertex that is not finite: repair its mesh.")
    if len(faces) == 0:
        raise SceneError(f"The cloth {name} has no triangle: give it one, or take the property off its node.")
    if faces.min() < 0 or faces.max() >= count:
        raise SceneError(
            f"A triangle of the cloth {name} names a vertex beyond its {count}: repair its mesh."
        )
    extent = float(np.ptp(positions, axis=0).max())
    if extent > MOST_METRES:
        raise SceneError(
            f"The cloth {name} is {extent:.3g} m large, and at most {MOST_METRES:g} m can be simulated: scale it down."
        )
    density = number_of(properties, "kg_per_m2", 0.2, name)
    if density < LEAST_DENSITY:
        raise SceneError(
            f"The cloth {name} has kg_per_m2 = {density:g}: give the mass of a square metre, at least "
            f"{LEAST_DENSITY:g}."
        )
    warnings: list[str] = []
    stiffness = _stiffness(properties, name, warnings)
    particle_of, first = _weld(positions, faces)
    corners = particle_of[faces].astype(np.int32)
    particles = positions[first]
    held = _held(properties, particle_of, len(particles), name, warnings)
    masses = _masses(particles, corners, density, name, warnings)
    masses[held] = 0.0
    grid = _grid(properties, count, name)
    pairs, kinds = _grid_springs(particle_of, *grid) if grid else _triangle_springs(particles, corners)
    rest = np.linalg.norm(particles[pairs[:, 0]] - particles[pairs[:, 1]], axis=1)
    return Cloth(
        mesh=mesh,
        node=node,
        anchor=np.asarray(anchor, np.float64),
        positions=particles,
        masses=masses,
        springs=pairs,
        kinds=kinds,
        rest=rest,
        stiffness=stiffness,
        triangles=corners,
        particle_of=particle_of,
        kg_per_m2=density,
        damping=number_of(properties, "damping_per_s", 1.5, name),
        drag=number_of(properties, "drag", 1.2, name),
        thickness=number_of(properties, "thickness_m", 0.005, name),
        friction=number_of(properties, "friction", 0.4, name),
        name=name,
        warnings=tuple(warnings),
    )


def number_of(properties: Mapping[str, Any], key: str, default: float, name: str) -> float:
    """Return a property that is a number from 0 to MOST. Raises SceneError for any other value."""
    value = properties.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= MOST:
        raise SceneError(
            f"The cloth {name} has {key} = {brief(value)}: give a finite number of at least 0 and at most {MOST:g}."
        )
    return float(value)


def _whole(value: Any) -> TypeGuard[int]:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _stiffness(properties: Mapping[str, Any], name: str, warnings: list[str]) -> Float64:
    """Return (3,) newtons a metre by kind, within STIFFNESS."""
    least, most = STIFFNESS
    stiffness = []
    for kind, default in zip(KINDS, (400.0, 60.0, 4.0), strict=True):
        value = number_of(properties, f"{kind}_n_per_m", default, name)
        stiffness.append(min(max(value, least), most))
        if stiffness[-1] != value:
            warnings.append(
                f"The cloth {name} has {kind}_n_per_m = {value:g}, which is taken as {stiffness[-1]:g}: "
                f"what can be simulated is {least:g} to {most:g}."
            )
    return np.array(stiffness)


def _weld(positions: Float64, faces: NDArray[np.int64]) -> tuple[Int32, NDArray[np.int64]]:
    """Return (V,) the particle of each vertex, -1 without a triangle, and (P,) the first vertex of each particle."""
    used = np.zeros(len(positions), bool)
    used[faces] = True
    vertices = np.flatnonzero(used)
    places = positions[vertices] + 0.0  # turns -0 into 0, which is the same place
    order = np.lexsort((vertices, places[:, 2], places[:, 1], places[:, 0]))
    along = places[order]
    new = np.ones(len(order), bool)
    new[1:] = (along[1:] != along[:-1]).any(axis=1)
    cluster = np.cumsum(new) - 1
    firsts = vertices[order[new]]
    rank = np.empty(len(firsts), np.int64)
    rank[np.argsort(firsts)] = np.arange(len(firsts))
    particle_of = np.full(len(positions), -1, np.int32)
    particle_of[vertices[order]] = rank[cluster]
    return particle_of, np.sort(firsts)


def _held(
    properties: Mapping[str, Any], particle_of: Int32, count: int, name: str, warnings: list[str]
) -> NDArray[np.bool_]:
    """Return (P,) whether a pin holds each particle."""
    pins = properties.get("pins", ())
    if not isinstance(pins, Sequence | np.ndarray) or isinstance(pins, str) or not all(map(_whole, pins)):
        raise SceneError(f"The cloth {name} has pins = {brief(pins)}: give a list of numbers of vertices.")
    wrong = [pin for pin in pins if not 0 <= pin < len(particle_of)]
    if wrong:
        raise SceneError(
            f"The cloth {name} is pinned at vertex {brief(wrong[0])}, and its mesh has {len(particle_of)}: "
            "pins are numbers of vertices from 0."
        )
    chosen = np.asarray(pins, np.int64).reshape(-1)
    own = particle_of[chosen]
    if (own < 0).any():
        warnings.append(
            f"The cloth {name} is pinned at vertex {chosen[own < 0][0]}, which is of no triangle: "
            "that pin holds nothing."
        )
    held = np.zeros(count, bool)
    held[own[own >= 0]] = True
    if not held.any():
        warnings.append(f"The cloth {name} has no pins: it falls.")
    return held


def areas(positions: Float64, triangles: NDArray[np.integer[Any]]) -> Float64:
    """Return (T,) square metres of each triangle."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    area: Float64 = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    return area


def _masses(positions: Float64, corners: Int32, density: float, name: str, warnings: list[str]) -> Float64:
    """Return (P,) kilograms: a third of each adjacent triangle, and at least LEAST_MASS of the mean."""
    shares = np.repeat(areas(positions, corners) * (density / 3), 3)
    masses = np.bincount(corners.reshape(-1), shares, len(positions))
    positive = masses[masses > 0]
    least = max(LEAST_MASS * float(positive.mean()), LEAST_PARTICLE) if len(positive) else MASS_WITHOUT_AREA
    light = int((masses < least).sum())
    if light:
        warnings.append(
            f"{light} of {len(masses)} particles of the cloth {name} have next to no area around them, "
            f"and get {least * 1e3:.3g} g each."
        )
    return np.maximum(masses, least)


def _grid(properties: Mapping[str, Any], vertices: int, name: str) -> tuple[int, int] | None:
    """Return (columns, rows), or None where the properties have neither."""
    columns, rows = properties.get("columns"), properties.get("rows")
    if columns is None and rows is None:
        return None
    sizes = [int(size) for size in (columns, rows) if _whole(size) and size > 0]
    if len(sizes) != 2 or sizes[0] * sizes[1] != vertices:
        raise SceneError(
            f"The cloth {name} has columns = {brief(columns)} and rows = {brief(rows)}, and its mesh {vertices} "
            "vertices: give two whole numbers whose product that is, or leave both out."
        )
    return sizes[0], sizes[1]


def _grid_springs(particle_of: Int32, columns: int, rows: int) -> tuple[Int32, NDArray[np.uint8]]:
    grid = particle_of.reshape(rows, columns)
    pairs, kinds = [], []
    for kind, across, down in _NEIGHBOURS:
        left, right = max(0, -across), columns - max(0, across)
        if right <= left or rows <= down:
            continue
        here = grid[: rows - down, left:right]
        there = grid[down:, left + across : right + across]
        pairs.append(np.stack([here, there], axis=-1).reshape(-1, 2))
        kinds.append(np.full(len(pairs[-1]), kind, np.uint8))
    return _distinct(pairs, kinds)


def _triangle_springs(positions: Float64, corners: Int32) -> tuple[Int32, NDArray[np.uint8]]:
    """Return springs along the edges, and across each inner edge between the two corners opposite it."""
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]).astype(np.int64)
    facing = np.concatenate([corners[:, 2], corners[:, 0], corners[:, 1]]).astype(np.int64)
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((np.arange(len(edges)), high, low))
    low, high, facing = low[order], high[order], facing[order]
    inner = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))

    def length(a: NDArray[np.int64], b: NDArray[np.int64]) -> Float64:
        lengths: Float64 = np.linalg.norm(positions[a] - positions[b], axis=1)
        return lengths

    own = length(low, high)
    others = np.maximum(length(low, facing), length(high, facing))
    longest = own > _DIAGONAL * others
    diagonal = longest[inner] & longest[inner + 1]
    edge_kinds = np.zeros(len(low), np.uint8)
    edge_kinds[inner[diagonal]] = 1
    edge_kinds[inner[diagonal] + 1] = 1
    over = np.stack([facing[inner], facing[inner + 1]], axis=1)
    return _distinct(
        [np.stack([low, high], axis=1), over], [edge_kinds, np.where(diagonal, 1, 2).astype(np.uint8)]
    )


def _distinct(
    pairs: Sequence[NDArray[Any]], kinds: Sequence[NDArray[np.uint8]]
) -> tuple[Int32, NDArray[np.uint8]]:
    """Return the springs sorted by kind, then in the given order, each pair of two different particles once."""
    if not pairs:
        return np.zeros((0, 2), np.int32), np.zeros(0, np.uint8)
    ends, kind = np.concatenate(pairs).astype(np.int64), np.concatenate(kinds)
    fit = (ends >= 0).all(axis=1) & (ends[:, 0] != ends[:, 1])
    ends, kind = ends[fit], kind[fit]
    order = np.argsort(kind, kind="stable")
    ends, kind = ends[order], kind[order]
    keys = ends.min(axis=1) << 32 | ends.max(axis=1)
    first = np.sort(np.unique(keys, return_index=True)[1])
    return ends[first].astype(np.int32), kind[first]
