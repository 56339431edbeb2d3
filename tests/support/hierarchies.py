"""Scenes for rays, and a tracer that runs a chapter's own traversal over arrays of rays on either backend.

The chapter's packages are given: tests import them from the chapter that is tested.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

NO_HIT = 0xFFFFFFFF

TRACE = """
layout(local_size_x = 64) in;
#define RAYS_SET 0
#define RAYS_BINDING 0
#ifdef NON_OPAQUE
#include "rays/ray.glsl"
bool accept(Hit hit) { return ((hit.primitive ^ hit.instance) & 1u) == 0u && hit.at.x < 0.5; }
#endif
#include "rays/bvh/traverse.glsl"
struct Push { uvec4 numbers; };  // rays, mask, 1: any hit, sides that rays skip
PUSH(Push, push)
layout(BIND(0, 3, 3), std430) readonly buffer Rays_ { vec4 rays[]; };
layout(BIND(0, 4, 4), std430) writeonly buffer Hits_ { uvec4 hits[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= push.numbers.x) {
        return;
    }
    Ray ray = Ray(rays[2u * i].xyz, rays[2u * i].w, rays[2u * i + 1u].xyz, rays[2u * i + 1u].w);
    if (push.numbers.z != 0u) {
        hits[2u * i] = uvec4(occluded(ray, push.numbers.y, push.numbers.w) ? 1u : 0u);
        return;
    }
    Hit hit = trace(ray, push.numbers.y, push.numbers.w);
    hits[2u * i] = uvec4(hit.instance, hit.primitive, floatBitsToUint(hit.t), hit.flags);
    uint steps = 0u;
#ifdef STEPS
    steps = bvh_steps;
#endif
    hits[2u * i + 1u] = uvec4(floatBitsToUint(hit.at), steps, 0u);
}
"""


@dataclass
class Hits:
    """What rays hit, (R,) each: instance and primitive are -1 for none; `at` is (R, 2)."""

    instance: np.ndarray
    primitive: np.ndarray
    t: np.ndarray
    at: np.ndarray
    back: np.ndarray
    steps: np.ndarray

    @property
    def hit(self) -> np.ndarray:
        """Which rays hit something."""
        return self.instance >= 0


class Tracer:
    """Traces rays against `Buffers` of the chapter's rays/bvh by `kernels`; `model` is its module of that name."""

    sides = 0
    """Sides of surfaces with one side that rays skip: bits of rays/ray.glsl."""

    def __init__(self, kernels: Any, model: Any, folder: Path) -> None:
        self.kernels, self.constants = kernels, tuple(model.CONSTANTS.items())
        self._file = folder / "trace.comp"
        self._file.write_text(TRACE, "utf-8")

    def _run(
        self, buffers: Any, rays: np.ndarray, mask: int, any_: bool, defines: tuple[Any, ...]
    ) -> np.ndarray:
        pipeline = self.kernels.pipeline(self._file, defines=(*self.constants, *defines))
        arrays = [buffers.nodes.view(np.uint32), buffers.triangles.view(np.uint32), buffers.instances, rays]
        push = np.array([len(rays), mask, any_, self.sides], np.uint32)
        words: np.ndarray = self.kernels.run(
            pipeline, [*arrays, np.zeros((len(rays), 8), np.uint32)], (len(rays),), push
        )[4]
        return words

    def trace(self, buffers: Any, rays: np.ndarray, mask: int = 0xFF, *defines: Any) -> Hits:
        """Return the nearest hits of rays (R, 8) float32: origin, t_min, direction, t_max."""
        words = self._run(buffers, rays, mask, False, defines)
        hit = words[:, 0] != NO_HIT
        return Hits(
            np.where(hit, words[:, 0].astype(np.int64), -1),
            np.where(hit, words[:, 1].astype(np.int64), -1),
            words[:, 2].copy().view(np.float32),
            words[:, 4:6].copy().view(np.float32),
            words[:, 3] & 1 == 1,
            words[:, 6],
        )

    def occluded(self, buffers: Any, rays: np.ndarray, mask: int = 0xFF, *defines: Any) -> np.ndarray:
        """Return whether each ray hits anything."""
        occluded: np.ndarray = self._run(buffers, rays, mask, True, defines)[:, 0] == 1
        return occluded


def rays_of(origins: Any, directions: Any, t_min: float = 0.0, t_max: float = 1e30) -> np.ndarray:
    """Return rays (R, 8) as the tracer takes them."""
    rays = np.zeros((len(origins), 8), np.float32)
    rays[:, :3], rays[:, 3], rays[:, 4:7], rays[:, 7] = origins, t_min, directions, t_max
    return rays


def soup(count: int, seed: int, size: float = 0.15) -> np.ndarray:
    """Return random triangles (count, 3, 3) in a box of -1 to 1, some thin."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (count, 1, 3)) + rng.normal(0, size, (count, 3, 3))
    thin = rng.random(count) < 0.1
    corners[thin, 2] = corners[thin, 1] + rng.normal(0, size * 0.02, (int(thin.sum()), 3))
    return np.float32(corners)


def random_rays(count: int, seed: int, size: float = 2.0) -> tuple[np.ndarray, np.ndarray]:
    """Return origins around and in such a box, and directions of several lengths towards places in it."""
    rng = np.random.default_rng(seed)
    origins = np.float32(rng.uniform(-size, size, (count, 3)))
    directions = rng.uniform(-1, 1, (count, 3)) - origins
    return origins, np.float32(directions * 10.0 ** rng.uniform(-1, 1, (count, 1)))


def indexed(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (3 T, 3) and indices (3 T,) of triangles that share nothing."""
    return np.float32(corners).reshape(-1, 3), np.arange(3 * len(corners), dtype=np.uint32)


def icosphere(levels: int) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (V, 3) and triangles (T, 3) of a closed sphere, 20 * 4^levels triangles, seen from outside."""
    golden = (1 + 5**0.5) / 2
    corners = [(0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    positions = np.array([p[i:] + p[:i] for p in corners for i in range(3)], np.float64)
    far = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    near = np.abs(far - 2) < 1e-9
    triangles = np.array([
        (i, j, k)
        for i in range(12) for j in range(i + 1, 12) for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ])  # fmt: skip
    for _ in range(levels):
        edges = np.sort(
            np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
        )
        edges, which = np.unique(edges, axis=0, return_inverse=True)
        x, y, z = which.reshape(3, -1) + len(positions)
        a, b, c = triangles.T
        positions = np.concatenate([positions, positions[edges].mean(axis=1)])
        triangles = np.stack([(a, x, z), (x, b, y), (z, y, c), (x, y, z)]).transpose(0, 2, 1).reshape(-1, 3)
    positions /= np.linalg.norm(positions, axis=1, keepdims=True)
    p = positions[triangles]
    inwards = (np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]) * p[:, 0]).sum(axis=1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return np.float32(positions), triangles


def torus(around: int, across: int, thickness: float = 0.35) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and triangles of a closed torus, 2 * around * across triangles."""
    u, v = np.meshgrid(
        np.arange(around) / around * 2 * np.pi, np.arange(across) / across * 2 * np.pi, indexing="ij"
    )
    radius = 1 + thickness * np.cos(v)
    positions = np.stack([radius * np.cos(u), radius * np.sin(u), thickness * np.sin(v)], axis=-1).reshape(
        -1, 3
    )
    i, j = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = i * across + j, (i + 1) % around * across + j
    c, d = i * across + (j + 1) % across, (i + 1) % around * across + (j + 1) % across
    triangles = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
    return np.float32(positions), triangles
