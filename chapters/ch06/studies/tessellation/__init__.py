"""Study: the GPU cuts the triangles of a coarse terrain into smaller ones, the more of them the nearer they are.

Between the vertex shader and the rasterizer there are three more stages. The *control* shader gets the three corners of
a patch and sets four levels: one for each edge, and one for the inside. The fixed *tessellator* cuts a triangle by
these levels, without any positions. The *evaluation* shader gets barycentric coordinates from it and computes a vertex
of the surface, here one with a height.

The level of an edge depends on the mean distance of its own two vertices and on nothing else. So the patches on both
sides of an edge cut it in the same way, and the vertices on it have equal bits: `precise` weights, and a height that
depends on the position alone. If the level came from the middle of the patch, neighbours would differ, and cracks would
open between them. The inside takes the finest level of its edges.

A geometry shader gives each small triangle barycentric coordinates of its own, from which the fragment shader draws the
edges. Coordinates of the patch do not show them: the rings of small triangles are no regular grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.settings import knob
from common.view.camera import View

STUDY = Study(
    title="tessellation",
    idea="Each edge takes its level from its own two vertices, so neighbours cut it alike and no crack opens.",
    order=2,
    features=("geometry/tessellation",),
    outputs=("color", "depth"),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    cells: int = knob(10, "squares along a side of the terrain, of two patches each", minimum=1, maximum=128)
    scale: float = knob(
        0.3,
        "level 5 up to 7 times this distance, level 3 up to 10 times, then 1",
        unit="m",
        minimum=0.0,
        maximum=10.0,
    )
    level: int = knob(0, "level of all edges; 0: by distance", minimum=0, maximum=64)
    bumps: float = knob(0.2, "height of the hills", unit="m", minimum=0.0, maximum=1.0)
    edges: bool = knob(True, "draw the edges of the small triangles")
    recorded: bool = knob(False, "write the small triangles to a buffer, for `triangles()`")


@dataclass
class PatchWork(Work):
    """What a frame did: `triangles` by the rules of the tessellator. `generated` is the GPU's own count of them."""

    patches: int = 0


SIDE = 3.0
"""Length of the terrain's sides, metres."""

UNIFORM_BYTES = 2 * 64 + 2 * 16
STAGES = ("terrain.vert", "terrain.tesc", "terrain.tese", "edges.geom", "terrain.frag")


def shaders(settings: Settings) -> tuple[str, ...]:
    """Return the files of the stages. The geometry shader is left out if nothing needs it."""
    has_geometry = settings.edges or settings.recorded
    return tuple(f"studies/tessellation/{file}" for file in STAGES if has_geometry or file != "edges.geom")


def defines(settings: Settings) -> tuple[tuple[str, int | float], ...]:
    """Return the macros of the shaders."""
    return (
        ("CELLS", settings.cells),
        ("SIDE", SIDE),
        ("EDGES", int(settings.edges)),
        ("RECORDED", int(settings.recorded)),
    )


def uniforms(settings: Settings, view: View, aspect: float) -> np.ndarray:
    """Return what the shaders read, (40,) float32: both matrices, the eye, scale, height, fixed level."""
    both = np.stack([view.view_from_world().T, view.clip_from_view(aspect).T]).ravel()
    rest = [*view.eye, 0.0, settings.scale, settings.bumps, settings.level, 0.0]
    return np.concatenate([both, rest]).astype(np.float32)


def triangles_of(outer: np.ndarray, inner: np.ndarray) -> np.ndarray:
    """Return (N,) how many triangles patches give, for whole levels: `outer` (N, 3) of their edges, `inner` (N,).

    Between the edges, cut into `outer` pieces, and the next ring, cut into inner - 2 pieces a side, each piece of
    either is the base of one triangle. The rest is a triangle of level inner - 2 (OpenGL 4.6, section 11.2.2.1).
    """
    outer, inner = np.asarray(outer, np.int64), np.asarray(inner, np.int64)
    # A triangle that is cut at an edge has a vertex inside, whatever its inner level.
    inner = np.where((inner == 1) & (outer > 1).any(axis=-1), 2, inner)
    within = np.maximum(inner - 2, 0)
    uniform = np.where(within % 2 == 0, 3 * within**2 // 2, (3 * within**2 - 1) // 2)
    return np.where(inner == 1, 1, outer.sum(axis=-1) + 3 * within + uniform)


@lru_cache(4)
def patches(settings: Settings) -> np.ndarray:
    """Return the corners of the patches, (P, 3, 3) float64, as the vertex shader computes them: two for each square."""
    row, column = np.meshgrid(np.arange(settings.cells), np.arange(settings.cells), indexing="ij")
    first = np.stack([column.ravel(), row.ravel()], axis=-1)
    corners = first[:, None] + np.array([(0, 0), (0, 1), (1, 1), (0, 0), (1, 1), (1, 0)])
    flat = (corners / settings.cells - 0.5) * SIDE
    return np.stack([flat[..., 0], np.zeros(flat.shape[:2]), flat[..., 1]], axis=-1).reshape(-1, 3, 3)


def levels(settings: Settings, eye: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (P, 3) levels of the edges, of which edge i is opposite to corner i, and (P,) levels of the insides."""
    away = np.linalg.norm(patches(settings) - eye, axis=-1)
    mean = (np.roll(away, -1, axis=-1) + np.roll(away, 1, axis=-1)) / 2.0
    outer = np.where(mean <= 7.0 * settings.scale, 5, np.where(mean <= 10.0 * settings.scale, 3, 1))
    if settings.level:
        outer = np.full_like(outer, settings.level)
    return outer, outer.max(axis=-1)


def work_of(settings: Settings, view: View) -> PatchWork:
    """Return what a frame of this view does."""
    outer, inner = levels(settings, view.eye)
    return PatchWork(1, int(triangles_of(outer, inner).sum()), len(outer))


def record_bytes(settings: Settings) -> int:
    """Return the size of the buffer of triangles: 16 bytes for the count, 48 for each triangle there can be."""
    most = max(5, settings.level)
    return 16 + 48 * 2 * settings.cells**2 * int(triangles_of(np.full((1, 3), most), np.array([most]))[0])
