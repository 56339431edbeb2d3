"""Trees: trunks and limbs, crowns of cards with a picture of a twig, or of single leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assets.city_parts import Parts
from assets.noise import Float64
from assets.shapes import Mesh, join, lathe, normalized, tube


@dataclass(frozen=True)
class Kind:
    """The form of a tree: height of the whole and of the bare trunk, radius of the crown, in metres; its green."""

    name: str
    height: float
    trunk: float
    radius: float
    green: tuple[float, float, float]


LEAF = np.array([0.22, 0.29, 0.10])
"""Linear colour of a single leaf, which the green of a kind tints."""

KINDS = (
    Kind("plane", 10.5, 3.4, 2.8, (0.75, 0.82, 0.55)),
    Kind("lime", 9.0, 2.9, 2.4, (0.62, 0.85, 0.48)),
    Kind("maple", 7.5, 2.5, 2.3, (0.95, 0.68, 0.34)),
    Kind("poplar", 13.0, 2.2, 1.4, (0.55, 0.72, 0.42)),
    Kind("cherry", 5.5, 2.0, 1.9, (0.9, 0.62, 0.62)),
)


def wood(kind: Kind, sides: int, limbs: int, rng: np.random.Generator) -> Mesh:
    """Return the trunk, which begins below the ground, and limbs that rise into the crown."""
    lean = rng.uniform(-0.25, 0.25, 2)
    top = kind.trunk + 0.45 * (kind.height - kind.trunk)
    heights = np.array([-0.1, 0.35, 0.5 * kind.trunk, kind.trunk, top])
    bend = np.array([0.0, 0.0, 0.4, 0.8, 1.0])
    path = np.stack([lean[0] * bend, heights, lean[1] * bend], -1)
    thick = 0.022 * kind.height
    parts = [_tapered(path, thick * np.array([1.6, 1.1, 0.9, 0.75, 0.25]), sides)]
    for k in range(limbs):
        around = 2.4 * k + rng.uniform(-0.3, 0.3)
        start = kind.trunk * (0.85 + 0.12 * (k % 3))
        out = np.array([np.cos(around), 0.0, np.sin(around)])
        reach, rise = kind.radius * rng.uniform(0.5, 0.75), (top - start) * rng.uniform(0.5, 0.9)
        foot = np.array([lean[0] * 0.75, start, lean[1] * 0.75])
        limb = foot + out * (np.array([0.0, 0.4, 1.0]) * reach)[:, None]
        limb[:, 1] += np.array([0.0, 0.55, 1.0]) * rise
        parts.append(_tapered(limb, thick * np.array([0.55, 0.4, 0.12]), max(4, sides - 2)))
    return join(*parts).painted((0.16, 0.12, 0.09))


def _tapered(path: Float64, radii: Float64, sides: int) -> Mesh:
    """Return a tube along `path` (N, 3) whose radius is `radii` (N,) at its points."""
    mesh = tube(path, 1.0, sides)
    points = mesh.positions.reshape(len(path), sides + 1, 3)
    middle = path[:, None]
    positions = (points - middle) * radii[:, None, None] + middle
    return Mesh(positions.reshape(-1, 3), mesh.normals, mesh.triangles, mesh.uv0)


def _spots(
    kind: Kind, count: int, rng: np.random.Generator, inner: float
) -> tuple[Float64, Float64, Float64]:
    """Return places (N, 3) in a crown, their directions from its middle, and how far out they are in 0..1."""
    out = normalized(rng.normal(size=(count, 3)))
    lobes = 1.0 + 0.18 * np.sin(5.0 * out[:, 0] + 3.0 * out[:, 1]) * np.cos(4.0 * out[:, 2] + 1.7)
    far = (inner**3 + (1 - inner**3) * rng.random(count)) ** (1 / 3)
    half = (kind.height - kind.trunk) / 2
    middle = np.array([0.0, kind.trunk + half, 0.0])
    size = np.array([kind.radius, half, kind.radius])
    return middle + out * size * (far * lobes)[:, None], normalized(out / size), far


def _tones(kind: Kind, out: Float64, far: Float64, rng: np.random.Generator) -> Float64:
    """Return colours (N, 3): darker inside the crown and below, each leaf a little different."""
    light = (0.35 + 0.65 * far**2) * (0.8 + 0.2 * out[:, 1])
    return np.array(kind.green) * (light * rng.uniform(0.8, 1.15, len(far)))[:, None]


def card_crown(kind: Kind, count: int, rng: np.random.Generator) -> Mesh:
    """Return a crown of `count` cards that show a twig; their normals point out of the crown, as for a soft whole."""
    at, out, far = _spots(kind, count, rng, 0.45)
    facing = normalized(out + 0.55 * rng.normal(size=out.shape))
    facing *= np.where((facing * out).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    up = normalized(rng.normal(size=out.shape) + out + [0.0, 0.5, 0.0])
    right = normalized(np.cross(up, facing))
    up = np.cross(facing, right)
    size = (rng.uniform(0.8, 1.2, (count, 1)) * 2.9 * kind.radius / np.sqrt(count) ** 0.62).clip(0.4, 2.6)
    up *= size
    return _cards(
        at - up / 2, right * size / 2, up, normalized(0.7 * out + facing), _tones(kind, out, far, rng)
    )


def leaf_crown(kind: Kind, triangles: int, size: float, rng: np.random.Generator) -> Mesh:
    """Return a crown of leaves, `size` metres long, of exactly so many triangles: two a leaf, the last may have one."""
    count = (triangles + 1) // 2
    at, out, far = _spots(kind, count, rng, 0.3)
    facing = normalized(out + 0.8 * rng.normal(size=out.shape) + [0, 0.4, 0])
    facing *= np.where((facing * out).sum(-1, keepdims=True) < 0, -1.0, 1.0)
    along = normalized(np.cross(facing, rng.normal(size=out.shape)))
    right = np.cross(along, facing)
    long = rng.uniform(0.75, 1.2, (count, 1)) * size
    tones = _tones(kind, out, far, rng) * LEAF
    mesh = _cards(at, right * long * 0.3, along * long, normalized(0.7 * out + facing), tones, kite=True)
    return Mesh(mesh.positions, mesh.normals, mesh.triangles[:triangles], mesh.uv0, colors=mesh.colors)


def _cards(
    at: Float64, half: Float64, up: Float64, normals: Float64, colors: Float64, kite: bool = False
) -> Mesh:
    """Return rectangles that stand on their places, or kites: `half` is half of the width, `up` the height."""
    if kite:
        corners = [at, at + half + 0.45 * up, at + up, at - half + 0.45 * up]
    else:
        corners = [at - half, at + half, at + half + up, at - half + up]
    positions = np.stack(corners, 1).reshape(-1, 3)
    first = 4 * np.arange(len(at))[:, None]
    triangles = np.stack([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])], 1).reshape(-1, 3)
    uv = np.tile([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)], (len(at), 1))
    rgba = np.concatenate([np.clip(colors, 0, 1), np.ones((len(at), 1))], 1)
    return Mesh(positions, np.repeat(normals, 4, 0), triangles, uv, colors=np.repeat(rgba, 4, 0))


def tree(kind: Kind, sides: int, cards: int, rng: np.random.Generator) -> Parts:
    """Return a tree with a crown of cards."""
    parts = Parts()
    parts.add("bark", wood(kind, sides, 3 + sides // 3, rng))
    parts.add("leaves", card_crown(kind, cards, rng))
    return parts


def leafy_tree(kind: Kind, triangles: int, rng: np.random.Generator) -> Parts:
    """Return a tree of exactly so many triangles, at least 400, with single leaves."""
    parts = Parts()
    parts.add("bark", wood(kind, 6 if triangles < 3000 else 10, 5, rng))
    rest = triangles - parts.triangles
    size = min(0.55, 0.9 * kind.radius * (16 / rest) ** 0.4)
    parts.add("foliage", leaf_crown(kind, rest, size, rng))
    return parts


def conifer(sides: int, tiers: int, rng: np.random.Generator) -> Parts:
    """Return a fir: cones over one another, each with a ragged edge."""
    parts = Parts()
    height, foot = 8.5, 1.1
    parts.add(
        "bark",
        lathe([[(0.09, height * 0.6), (rng.uniform(0.17, 0.23), -0.1)]], max(5, sides // 2)).painted(
            (0.13, 0.09, 0.06)
        ),
    )
    for k in range(tiers):
        t = k / tiers
        low, tall = foot + (height - foot) * t * 0.92, (height - foot) * (1.6 / tiers)
        radius = 2.1 * (1 - t) + 0.3
        cone = lathe([[(0.02, low + tall), (0.55 * radius, low + 0.35 * tall), (radius, low)]], sides)
        points = cone.positions.reshape(3, sides + 1, 3).copy()
        ragged = rng.uniform(0.8, 1.12, sides + 1)
        ragged[-1] = ragged[0]
        points[2, :, [0, 2]] *= ragged
        tone = np.array([0.10, 0.17, 0.07]) * rng.uniform(0.85, 1.15)
        shade = np.repeat([1.0, 0.7, 1.0], sides + 1)[:, None] * tone
        rgba = np.concatenate([shade, np.ones((len(shade), 1))], 1)
        parts.add("foliage", Mesh(points.reshape(-1, 3), cone.normals, cone.triangles, cone.uv0, colors=rgba))
    return parts
