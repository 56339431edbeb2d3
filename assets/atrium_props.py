"""What stands and hangs in the atrium: fountain, lanterns, banners, pots, trees, ivy, each about its own origin."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from assets.atrium_building import Detail
from assets.noise import Float64
from assets.shapes import Mesh, arc, box, join, lathe, normalized, quad, rotation_y, sphere, surface, tube

BANNER = (0.95, 2.35)  # width and height in metres
LANTERN_HEIGHT = 0.62


# -- fountain ----------------------------------------------------------------------------------------------------


def basin() -> tuple[Mesh, Mesh]:
    """Return the octagonal basin: stone (rim and plinth) and mosaic (outside and inside walls, floor)."""
    rim = [
        [(1.00, 0.50), (1.22, 0.50)],
        [(1.22, 0.50), (1.22, 0.43)],
        [(1.22, 0.43), (1.14, 0.38)],
    ]
    foot = [[(1.14, 0.10), (1.22, 0.10)], [(1.22, 0.10), (1.22, 0.0)]]
    stone = join(*(lathe(profile, 8, (6.0, 1.0), faceted=True) for profile in (rim, foot)))
    walls = [[[(1.14, 0.38), (1.14, 0.10)]], [[(1.00, 0.12), (1.00, 0.50)]], [[(0.0, 0.12), (1.00, 0.12)]]]
    mosaic = join(*(lathe(profile, 8, (14.0, 2.0), faceted=True) for profile in walls))
    return stone, mosaic


def bowls(detail: Detail) -> Mesh:
    """Return the fountain's pillar with two bowls, turned from one stone, above the basin's floor."""
    n = detail.curve_steps
    profile = [
        arc((0.0, 1.30), 0.06, 90, 0, n + 1),
        [(0.06, 1.30), (0.05, 1.17)],
        [(0.05, 1.17), (0.27, 1.22), (0.31, 1.26)],
        arc((0.32, 1.26), 0.018, 180, -60, n + 1),
        [(0.33, 1.24), (0.24, 1.14), (0.10, 1.08), (0.06, 1.02)],
        [(0.06, 1.02), (0.075, 0.90), (0.055, 0.80)],
        [(0.055, 0.80), (0.50, 0.86), (0.56, 0.91)],
        arc((0.575, 0.91), 0.022, 180, -60, n + 1),
        [(0.58, 0.88), (0.42, 0.74), (0.18, 0.66), (0.10, 0.58)],
        [(0.10, 0.58), (0.14, 0.42), (0.12, 0.30), (0.20, 0.20), (0.24, 0.12)],
    ]
    return lathe(profile, detail.round_segments, (2.0, 1.0))


def disc(radius: float, segments: int) -> Mesh:
    """Return a flat disc facing up; uv in metres."""
    mesh = lathe([[(0.0, 0.0), (radius, 0.0)]], segments)
    return replace(
        mesh, uv0=mesh.positions[:, [0, 2]], tangents=np.tile([1.0, 0, 0, 1.0], (len(mesh.positions), 1))
    )


def hoop(radius: float, thickness: float, detail: Detail) -> Mesh:
    """Return a ring about the y axis."""
    angle = np.linspace(0, 2 * np.pi, 2 * detail.round_segments, endpoint=False)
    path = radius * np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], -1)
    return tube(path, thickness, max(4, detail.round_segments // 4), closed=True)


def paper_boat() -> Mesh:
    """Return a folded boat about 20 cm long that floats at y = 0; its paper has two sides."""
    deck, peak = 0.05, 0.11
    parts = []
    for side in (1.0, -1.0):
        along = [1, -1][:: int(side)]  # seen from this side, left to right
        gunwale = [
            (-0.13 * along[0], deck + 0.02, 0.0),
            (0.0, deck, 0.055 * side),
            (0.13 * along[0], deck + 0.02, 0.0),
        ]
        keel = [(-0.075 * along[0], -0.015, 0.0), (0.0, -0.02, 0.03 * side), (0.075 * along[0], -0.015, 0.0)]
        sail = [
            [(-0.001 * along[0], peak, 0.0), (0.001 * along[0], peak, 0.0)],
            [(-0.06 * along[0], deck - 0.02, 0.04 * side), (0.06 * along[0], deck - 0.02, 0.04 * side)],
        ]
        for grid in (np.array([gunwale, keel]), np.array(sail)):
            parts.append(surface(grid, grid[..., :2]))
    return join(*parts)


# -- lanterns ----------------------------------------------------------------------------------------------------


def lantern_body(detail: Detail) -> Mesh:
    """Return a six-sided lantern's metal, hanging from the origin: ring, roof, posts and cup."""
    ring = hoop(0.035, 0.007, replace(detail, round_segments=max(4, detail.round_segments // 3)))
    ring = ring.turned(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])).moved((0, -0.035, 0))
    top = -0.07
    roof = [
        [(0.012, top), (0.035, top - 0.03), (0.05, top - 0.07)],
        [(0.05, top - 0.07), (0.10, top - 0.10), (0.175, top - 0.17)],
        [(0.175, top - 0.17), (0.175, top - 0.19)],
        [(0.175, top - 0.19), (0.13, top - 0.19)],
    ]
    low = -0.48
    cup = [
        [(0.13, low), (0.165, low)],
        [(0.165, low), (0.165, low - 0.02)],
        [(0.165, low - 0.02), (0.09, low - 0.08), (0.02, low - 0.11)],
        [(0.02, low - 0.11), (0.0, low - 0.14)],
    ]
    parts = [lathe(roof, 6, faceted=True), lathe(cup, 6, faceted=True)]
    if detail.curve_steps:
        post = box((-0.009, low, 0.142), (0.009, top - 0.19, 0.160), "xXZ")
        parts += [ring, *(post.turned(rotation_y(60.0 * k)) for k in range(6))]
    return join(*parts).with_uv(2.5)


def lantern_panes() -> Mesh:
    """Return the lantern's six panes; each shows the whole picture of the pierced metal."""
    height = 0.22
    return lathe(
        [[(0.148, -0.26), (0.148, -0.26 - height)]], 6, (6.0, 1 / height), faceted=True
    ).without_tangents()


def flame(detail: Detail) -> Mesh:
    """Return the light inside a lantern, a drop about 10 cm high."""
    profile = [
        [(0.0, -0.31), (0.012, -0.34), (0.028, -0.385), (0.030, -0.41), (0.018, -0.435), (0.0, -0.445)]
    ]
    return lathe(profile, max(6, detail.round_segments // 2))


def chain(length: float, detail: Detail) -> Mesh:
    """Return links, each a thin double cone turned against the next, from the origin down."""
    count = round(length / 0.05) if detail.curve_steps else 1
    parts = []
    for k in range(count):
        y = -k * length / count
        half = length / count * 0.62
        link = lathe([[(0.0, y), (0.008, y - half), (0.0, y - 2 * half)]], 4)
        parts.append(link.turned(rotation_y(45.0 * (k % 2))))
    return join(*parts)


# -- cloth -------------------------------------------------------------------------------------------------------


def banner(detail: Detail) -> tuple[Mesh, dict[str, Any]]:
    """Return a hanging cloth and what a simulation must know of it.

    Vertices form rows from the pinned top edge down, each from left to right, without seams, so that a vertex is a
    particle; rest lengths are those of the modelled shape.
    """
    columns, rows = detail.cloth
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    width, height = BANNER
    fold = 0.018 + 0.050 * np.sqrt(v)
    z = fold * np.sin(2 * np.pi * (2.5 * u + 0.18 * v)) + 0.02 * np.sin(5.0 * v + 2 * u) * v
    narrowed = 1.0 - 0.07 * np.sqrt(v)
    x = (u - 0.5) * width * narrowed
    y = -v * height - 0.03 * v * np.cos(2 * np.pi * u)
    mesh = surface(np.stack([x, y, z], -1), np.stack([u * width / 0.6, v * height / 0.6], -1))
    every = max(1, columns // 7)
    cloth = {
        "columns": columns + 1,
        "rows": rows + 1,
        "pins": [k for k in range(columns + 1) if k % every == 0 or k == columns],
        "kg_per_m2": 0.25,
        "stretch_n_per_m": 400,
        "shear_n_per_m": 60,
        "bend_n_per_m": 4,
        "damping_per_s": 1.5,
    }
    return mesh.without_tangents(), cloth


# -- plants ------------------------------------------------------------------------------------------------------


def pot(detail: Detail) -> tuple[Mesh, Mesh]:
    """Return a clay pot 0.5 m high and the soil in it."""
    n = detail.curve_steps
    profile = [
        [(0.20, 0.44), (0.215, 0.50)],
        [(0.215, 0.50), (0.26, 0.50)],
        arc((0.255, 0.465), 0.03, 80, -80, n + 1),
        [(0.24, 0.43), (0.235, 0.32), (0.205, 0.16), (0.165, 0.04)],
        [(0.165, 0.04), (0.18, 0.03), (0.18, 0.0)],
    ]
    return lathe(profile, detail.round_segments), disc(0.21, detail.round_segments).moved((0, 0.46, 0))


Twig = tuple[Float64, Float64, float, float]
"""Foot, direction, length, and by how much of its length the tip bends down."""


def twigs(wanted: Sequence[Twig], bends: int = 1) -> Mesh:
    """Return one card with a picture of a twig for each of `wanted`, each of `bends` + 1 rows of vertices."""
    foot, direction = (np.array([twig[k] for twig in wanted])[:, None, None] for k in (0, 1))
    length, droop = (np.array([twig[k] for twig in wanted])[:, None, None, None] for k in (2, 3))
    forward = normalized(direction)
    side = np.cross(forward, [0.0, 1.0, 0.0])
    upright = np.linalg.norm(side, axis=-1, keepdims=True) <= 1e-3
    side = np.where(upright, [1.0, 0.0, 0.0], normalized(side))
    t = np.linspace(1.0, 0.0, bends + 1)[:, None, None]  # the picture's top is the tip
    u = np.array([-0.5, 0.5])[None, :, None]
    down = np.array([0.0, 1.0, 0.0]) * (droop * length)
    points = foot + forward * (t * length) - down * t**2 + side * (u * length * 0.9)
    uv = np.stack(np.broadcast_arrays(u[..., 0] + 0.5, 1 - t[..., 0]), -1)
    return surface(points, np.broadcast_to(uv, (*points.shape[:-1], 2))).without_tangents()


def bush(detail: Detail, seed: int) -> Mesh:
    """Return the leaves of a potted plant: twigs that rise from the pot and bend outwards."""
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(max(8, round(26 * detail.plenty))):
        around, rise = 2.399963 * k + rng.uniform(-0.3, 0.3), rng.uniform(0.35, 1.35)
        direction = np.array(
            [math.cos(around) * math.cos(rise), math.sin(rise), math.sin(around) * math.cos(rise)]
        )
        foot = np.array([0.0, 0.45, 0.0]) + 0.07 * direction
        parts.append((foot, direction, rng.uniform(0.42, 0.68), rng.uniform(0.15, 0.45)))
    return twigs(parts, bends=2)


def tree(detail: Detail) -> tuple[Mesh, Mesh, Mesh]:
    """Return trunk, crown and fruit of an orange tree 2.6 m high."""
    rng = np.random.default_rng(401)
    sides = max(5, detail.round_segments // 3)
    trunk = np.array([[0.0, 0.0, 0.0], [0.03, 0.5, 0.02], [-0.02, 1.0, 0.0], [0.02, 1.45, -0.02]])
    wood = [tube(trunk, 0.055, sides)]
    for around in (0.3, 2.3, 4.4):
        out = np.array([math.cos(around), 0.0, math.sin(around)])
        limb = (
            trunk[-1]
            + np.array([[0.0, -0.08, 0.0], [0.0, 0.22, 0.0], [0.0, 0.5, 0.0]])
            + out * [[0.0], [0.16], [0.34]]
        )
        wood.append(tube(limb, 0.028, max(4, sides - 1)))
    center = np.array([0.0, 1.95, 0.0])
    leaves, fruit = [], []
    count = round(170 * detail.plenty)
    for k in range(count):
        # Points spread evenly over a sphere (golden angle), pulled in at random to fill the crown.
        height = 1 - 2 * (k + 0.5) / count
        around = 2.399963 * k
        out = np.array(
            [
                math.cos(around) * math.sqrt(1 - height * height),
                height,
                math.sin(around) * math.sqrt(1 - height * height),
            ]
        )
        foot = center + out * np.array([0.52, 0.46, 0.52]) * rng.uniform(0.25, 0.85)
        lean = normalized(out + rng.normal(0.0, 0.35, 3) + [0.0, 0.25, 0.0])
        leaves.append((foot, lean, rng.uniform(0.30, 0.46), 0.25))
    ball = sphere(0.042, max(5, detail.round_segments // 2), max(3, detail.round_segments // 4))
    for k in range(min(11, round(11 * detail.plenty))):
        around, height = 2.399963 * k, rng.uniform(-0.75, 0.45)
        ring = math.sqrt(1 - height * height)
        fruit.append(
            ball.moved(
                center
                + np.array([math.cos(around) * ring * 0.66, height * 0.58, math.sin(around) * ring * 0.66])
            )
        )
    return join(*wood), twigs(leaves), join(*fruit)


def ivy(detail: Detail, seed: int) -> Mesh:
    """Return ivy that hangs from the origin over a wall in the plane z = 0, 1.4 m wide and as long."""
    rng = np.random.default_rng(seed)
    parts = []
    for _ in range(max(12, round(46 * detail.plenty))):
        x = rng.normal(0.0, 0.32)
        reach = 1.35 * math.exp(-((x / 0.45) ** 2)) * rng.uniform(0.2, 1.0)
        foot = np.array([x, -reach + 0.1, rng.uniform(0.03, 0.10)])
        direction = np.array([rng.uniform(-0.8, 0.8), rng.uniform(-1.0, 0.15), rng.uniform(0.15, 0.7)])
        parts.append((foot, direction, rng.uniform(0.26, 0.40), 0.25))
    return twigs(parts)


def pebble() -> Mesh:
    """Return a pebble of radius one, with 20 faces and smooth normals."""
    golden = (1 + math.sqrt(5.0)) / 2
    corners = [(s * a, t * b, 0.0) for s in (-1, 1) for t in (-1, 1) for a, b in ((1.0, golden),)]
    points = np.array([p for x, y, z in corners for p in ((x, y, z), (z, x, y), (y, z, x))]) / math.hypot(
        1, golden
    )
    faces = []
    edge = np.linalg.norm(points[:, None] - points[None], axis=-1)
    near = (edge > 0.1) & (edge < 1.2)
    for a in range(12):
        for b in range(a + 1, 12):
            for c in range(b + 1, 12):
                if near[a, b] and near[b, c] and near[a, c]:
                    outward = np.dot(np.cross(points[b] - points[a], points[c] - points[a]), points[a]) > 0
                    faces.append((a, b, c) if outward else (a, c, b))
    return Mesh(points, points, np.array(faces))


def planter() -> tuple[Mesh, Mesh]:
    """Return a square bed's kerb (1.3 m) and its soil."""
    half, inner, top = 0.65, 0.53, 0.16
    kerb = [
        box((-half, 0, inner), (half, top, half), "xXYzZ"),
        box((-half, 0, -half), (half, top, -inner), "xXYzZ"),
        box((-half, 0, -inner), (-inner, top, inner), "xXY"),
        box((inner, 0, -inner), (half, top, inner), "xXY"),
    ]
    return join(*kerb).with_uv(1 / 1.2), quad((-inner, 0.09, -inner), (2 * inner, 0, 0), (0, 0, 2 * inner))
