"""The layout of all cloths of a scene in buffers, the same for both backends.

Every array is an array of `float` or `uint` on the GPU, with three numbers in a row for a vector. In a storage block a
`vec3[]` has a stride of 16 bytes, which does not fit numpy's data. Each quantity has an array of its own (structure of
arrays), since no kernel needs all of them.

    table       constants: counts, offsets, a record for each cloth
    frame       input of a frame: time, gravity, wind, and for each cloth its steps and the motion of its node
    colliders   colliders of each cloth in a frame, along its axes and about its anchor
    positions, velocities, scratch, lambdas      state of the simulation
    particles   position at rest, and 1 / mass
    springs, lengths                             pairs of particles; length at rest, its square, stiffness
    incidence   springs and triangles by particle, and the first spring of each colour and cloth
    triangles   three particles and a third of the mass
    normals     one for each particle
    surface     particle and triangles by vertex, and by triangle how u runs along its edges
    stats       bounds and greatest speed of each cloth
    words       the page of geometry that passes draw from
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError

from .model import Model, incidence, model_of
from .types import Cloth, Float32, UInt32

NOWHERE = 0xFFFFFFFF
"""A stream that a page does not have, or a vertex without a particle."""

RESET, WRITE = 1, 2
"""Flags of a cloth in a frame: it starts anew at rest; its normals and vertices are written."""

HEADER = np.dtype([("counts", "<u4", 4), ("places", "<u4", 4), ("surface", "<u4", 4)])
CLOTH = np.dtype(
    [
        ("particles", "<u4", 2),
        ("vertices", "<u4", 2),
        ("streams", "<u4", 4),
        ("thickness", "<f4"),
        ("friction", "<f4"),
        ("unused", "<f4", 2),
    ]
)
"""Of a cloth: first particle and count, first vertex and count, words of positions, normals, tangents; contact."""

GLOBALS = np.dtype([("gravity", "<f4", 4), ("wind", "<f4", 4), ("times", "<f4", 4), ("cut", "<u4", 4)])
"""`times` are h, 1/h, h/2, 1/h^2; `cut` is substeps, iterations, 1 for verlet, 1 for XPBD."""

CLOTH_FRAME = np.dtype(
    [("run", "<u4", 4), ("factors", "<f4", 4), ("before", "<f4", (3, 4)), ("after", "<f4", (3, 4))]
)
"""`run` is steps, flags, first collider, count; `factors` are the damping of h and of h/2, air density * drag / 12, and
the seconds of all these steps."""

COLLIDER = np.dtype([("rows", "<f4", (3, 4)), ("size", "<f4", 4), ("velocity", "<f4", 4), ("spin", "<f4", 4)])
"""`rows` rotate into the collider's axes, with the centre in the fourth column. `size` is half or radius, and shape.
`velocity` is that of the centre, `spin` about it; the fourth number of `velocity` is 1 if one of the two is not 0."""

STATS = np.dtype([("low", "<f4", 3), ("speed_squared", "<f4"), ("high", "<f4", 3), ("not_finite", "<f4")])

SHAPES = ("sphere", "plane", "box")
"""The shapes of colliders by their numbers."""

THREADS = 64
"""Invocations of a work group in kernels with an invocation for each particle, spring or vertex."""


@dataclass(frozen=True)
class Drawn:
    """The place of a cloth's drawn vertices: `page`, and the first word of each of its mesh's streams there.

    `triangles` (T, 3) are vertices of the mesh, in the order of `Cloth.triangles`; `uv` (V, 2) is needed if `tangents`
    is a place.
    """

    page: int
    triangles: NDArray[np.integer[Any]]
    positions: int
    normals: int = NOWHERE
    tangents: int = NOWHERE
    uv: Float32 | None = None


@dataclass(frozen=True)
class Limits:
    """Limits of a device; the defaults are the least values of any device."""

    storage_bytes: int = 1 << 27
    groups: int = 65535
    invocations: int = 128
    shared_bytes: int = 16384


@dataclass(frozen=True)
class Packed:
    """All cloths of a scene: `arrays` are the first contents of the buffers by name, without those of a frame."""

    models: tuple[Model, ...]
    arrays: dict[str, NDArray[Any]]
    group_size: int
    color_counts: tuple[int, ...]
    """Springs of each colour, of all cloths together."""
    vertex_runs: tuple[tuple[int, int, int], ...]
    """(page, first vertex, count) of cloths side by side in one page."""
    colliders: int
    limits: Limits = field(default_factory=Limits)

    @property
    def particles(self) -> int:
        """Particles of all cloths."""
        return int(self.arrays["table"][: HEADER.itemsize].view(HEADER)["counts"][0, 1])

    @property
    def first_particles(self) -> NDArray[np.int64]:
        """(N + 1,) the first particle of each cloth, and the end."""
        return _starts([len(model.positions) for model in self.models])

    def sizes(self) -> dict[str, int]:
        """Return the bytes of every buffer, including the input and the stats of a frame."""
        cloths = len(self.models)
        return {
            **{name: array.nbytes for name, array in self.arrays.items()},
            "frame": GLOBALS.itemsize + cloths * CLOTH_FRAME.itemsize,
            "colliders": cloths * max(1, self.colliders) * COLLIDER.itemsize,
            "stats": cloths * STATS.itemsize,
        }


def pack(
    cloths: Sequence[Cloth],
    drawn: Sequence[Drawn | None] | None = None,
    colliders: int = 0,
    limits: Limits | None = None,
) -> Packed:
    """Return the buffers of these cloths, for at most `colliders` colliders; cloths with a `drawn` write vertices.

    Raises UserError for cloths that a device with these limits cannot hold or dispatch.
    """
    limits = limits or Limits()
    drawn = drawn or [None] * len(cloths)
    models = tuple(model_of(cloth) for cloth in cloths)
    group_size = 1 << (min(256, limits.invocations, limits.shared_bytes // STATS.itemsize).bit_length() - 1)
    firsts = _starts([len(model.positions) for model in models])
    spring_firsts = _starts([len(model.springs) for model in models])
    triangle_firsts = _starts([len(model.triangles) for model in models])
    place_of, color_starts = _by_color(models)
    springs = np.empty((spring_firsts[-1], 2), np.uint32)
    lengths = np.empty((spring_firsts[-1], 3), np.float32)
    springs[place_of] = _joined([model.springs + first for model, first in zip(models, firsts, strict=False)])
    lengths[place_of] = _joined(
        [np.stack([model.rest, model.rest_squared, model.stiffness], axis=1) for model in models]
    )
    triangles = np.empty((triangle_firsts[-1], 4), np.uint32)
    triangles[:, :3] = _joined([model.triangles + at for model, at in zip(models, firsts, strict=False)])
    triangles[:, 3] = _joined([model.third_masses for model in models]).view(np.uint32)
    parts = [
        _joined([m.springs_of.starts[:-1] + 2 * at for m, at in zip(models, spring_firsts, strict=False)]),
        spring_firsts[-1:] * 2,
        place_of[_joined([m.springs_of.entries + at for m, at in zip(models, spring_firsts, strict=False)])],
        _joined(
            [m.triangles_of.starts[:-1] + 3 * at for m, at in zip(models, triangle_firsts, strict=False)]
        ),
        triangle_firsts[-1:] * 3,
        _joined([m.triangles_of.entries + at for m, at in zip(models, triangle_firsts, strict=False)]),
        color_starts,
    ]
    ends = np.cumsum([len(part) for part in parts])
    rest = _joined([model.positions for model in models])
    header = np.zeros(1, HEADER)
    cloth_count, colors = len(models), (len(color_starts) - 1) // max(1, len(models))
    header["counts"] = (cloth_count, firsts[-1], spring_firsts[-1], colors)
    header["places"] = (ends[1], ends[2], ends[4], ends[5])
    surface, places, vertex_firsts = _surface(models, drawn, firsts, triangle_firsts)
    header["surface"] = places
    table = _records(models, drawn, firsts, vertex_firsts)
    particles = np.empty((len(rest), 4), np.float32)
    particles[:, :3], particles[:, 3] = rest, _joined([model.inverse_masses for model in models])
    arrays: dict[str, NDArray[Any]] = {
        "table": np.concatenate([header.view(np.uint8), table.view(np.uint8)]),
        "positions": rest.reshape(-1),
        "velocities": np.zeros(rest.size, np.float32),
        "scratch": np.zeros(rest.size, np.float32),
        "lambdas": np.zeros(max(1, len(springs)), np.float32),
        "particles": particles.reshape(-1),
        "springs": _filled(springs),
        "lengths": _filled(lengths),
        "incidence": np.concatenate(parts).astype(np.uint32),
        "triangles": _filled(triangles),
        "normals": np.zeros(rest.size, np.float32),
        "surface": _filled(surface),
    }
    counts = tuple(np.diff(color_starts[:: max(1, cloth_count)]).tolist())
    packed = Packed(models, arrays, group_size, counts, _runs(drawn, vertex_firsts), colliders, limits)
    _check(packed)
    return packed


def _starts(counts: Sequence[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int64)


def _joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    return np.concatenate(parts)


def _filled(array: NDArray[Any]) -> NDArray[Any]:
    """Return the numbers in a row, with at least one, since a buffer cannot be empty."""
    flat = np.ascontiguousarray(array).reshape(-1)
    return flat if flat.size else np.zeros(1, array.dtype)


def _by_color(models: Sequence[Model]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the place of each spring, and (C N + 1,) the first spring of each colour and cloth.

    Springs of one colour lie side by side, cloth by cloth: a dispatch takes all of them, a work group those of its
    cloth.
    """
    colors = max(model.colors for model in models)
    counts = np.zeros((colors, len(models)), np.int64)
    for number, model in enumerate(models):
        counts[: model.colors, number] = np.diff(model.color_starts)
    starts = _starts(counts.reshape(-1).tolist())
    places = []
    for number, model in enumerate(models):
        own = np.diff(model.color_starts)
        begins = starts[:-1].reshape(counts.shape)[: model.colors, number]
        places.append(np.repeat(begins - model.color_starts[:-1], own) + np.arange(len(model.springs)))
    return _joined(places).astype(np.int64), starts


def _surface(
    models: Sequence[Model],
    drawn: Sequence[Drawn | None],
    firsts: NDArray[np.int64],
    triangle_firsts: NDArray[np.int64],
) -> tuple[UInt32, tuple[int, int, int, int], NDArray[np.int64]]:
    """Return the array of words, the places of its parts, and (N + 1,) the first vertex of each cloth."""
    sizes = [len(m.cloth.particle_of) if d else 0 for m, d in zip(models, drawn, strict=True)]
    vertex_firsts = _starts(sizes)
    particle_of, starts, entries = [], [], []
    factors = np.zeros((triangle_firsts[-1], 2), np.float32)
    entry_count = 0
    for number, (model, place) in enumerate(zip(models, drawn, strict=True)):
        if place is None:
            continue
        own = model.cloth.particle_of.astype(np.int64)
        particle_of.append(np.where(own < 0, NOWHERE, own + firsts[number]))
        corners = np.asarray(place.triangles, np.int64)
        incident = incidence(corners, len(own))
        starts.append(incident.starts[:-1] + entry_count)
        entries.append(incident.entries + triangle_firsts[number])
        entry_count += len(incident.entries)
        if place.uv is not None and place.tangents != NOWHERE:
            at = slice(triangle_firsts[number], triangle_firsts[number + 1])
            factors[at] = _tangent_factors(place.uv, corners)
    parts = [*particle_of, *starts, np.array([entry_count]), *entries]
    words = np.concatenate([np.concatenate(parts).astype(np.uint32), factors.reshape(-1).view(np.uint32)])
    vertices = int(vertex_firsts[-1])
    return words, (0, vertices, 2 * vertices + 1, 2 * vertices + 1 + entry_count), vertex_firsts


def _tangent_factors(uv: Float32, corners: NDArray[np.int64]) -> Float32:
    """Return (T, 2) the weights of a triangle's first two edges in the direction in which u rises.

    From e1 = du1 T + dv1 B and e2 = du2 T + dv2 B follows T (du1 dv2 - du2 dv1) = dv2 e1 - dv1 e2. The sign of the
    determinant is kept and its size is not: so the weight of a triangle is its area in the texture.
    """
    at = np.asarray(uv, np.float64)[corners]
    (du1, dv1), (du2, dv2) = (at[:, 1] - at[:, 0]).T, (at[:, 2] - at[:, 0]).T
    turned = np.sign(du1 * dv2 - du2 * dv1)
    return np.stack([dv2 * turned, -dv1 * turned], axis=1).astype(np.float32)


def _records(
    models: Sequence[Model],
    drawn: Sequence[Drawn | None],
    firsts: NDArray[np.int64],
    vertex_firsts: NDArray[np.int64],
) -> NDArray[Any]:
    table = np.zeros(len(models), CLOTH)
    table["particles"] = np.stack([firsts[:-1], np.diff(firsts)], axis=1)
    table["vertices"] = np.stack([vertex_firsts[:-1], np.diff(vertex_firsts)], axis=1)
    table["streams"] = NOWHERE
    for number, (model, place) in enumerate(zip(models, drawn, strict=True)):
        table["thickness"][number] = model.cloth.thickness
        table["friction"][number] = model.cloth.friction
        if place is not None:
            table["streams"][number, :3] = (place.positions, place.normals, place.tangents)
    return table


def _runs(
    drawn: Sequence[Drawn | None], vertex_firsts: NDArray[np.int64]
) -> tuple[tuple[int, int, int], ...]:
    runs: list[tuple[int, int, int]] = []
    for number, place in enumerate(drawn):
        if place is None:
            continue
        first, last = int(vertex_firsts[number]), int(vertex_firsts[number + 1])
        if runs and runs[-1][0] == place.page:
            first = runs.pop()[1]
        runs.append((place.page, first, last - first))
    return tuple(runs)


def _check(packed: Packed) -> None:
    """Raise UserError for buffers and dispatches beyond the limits of the device."""
    limits = packed.limits
    for name, size in packed.sizes().items():
        if size > limits.storage_bytes:
            raise UserError(
                f"The {name} of {packed.particles} cloth particles take {size / 2**20:.4g} MiB, and this device lets a "
                f"shader see {limits.storage_bytes / 2**20:.4g} MiB of a buffer (its maxStorageBufferRange): give the "
                "cloths fewer columns and rows."
            )
    widest = max(packed.particles, *packed.color_counts, *(run[2] for run in packed.vertex_runs), 1)
    groups = max(-(-widest // THREADS), len(packed.models))
    if groups > limits.groups:
        raise UserError(
            f"Cloth of {packed.particles} particles in {len(packed.models)} pieces takes a dispatch of {groups} work "
            f"groups, and this device allows {limits.groups} (its maxComputeWorkGroupCount): give the cloths fewer "
            "columns and rows."
        )
