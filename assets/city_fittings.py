"""What stands on squares, in parks and on roofs: kiosks, tables, lanterns, a fountain, water tanks, coolers.

As in streets, every piece goes a little into the ground, and `n` is the number of steps around a turned piece.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from assets.city_facades import WHITE
from assets.city_furniture import GREEN, IRON, WOOD, Profile, turned
from assets.city_parts import OBJECT, Parts
from assets.shapes import Mesh, join, lathe, rotation_y, sphere, surface, tube

STONE = (0.5, 0.47, 0.42)


def column(n: int) -> Parts:
    """Return a round pillar for posters, with a roof."""
    parts = Parts()
    roof: Profile = [
        [(0.0, 3.7), (0.06, 3.6), (0.1, 3.5)],
        [(0.1, 3.5), (0.5, 3.3), (0.8, 2.95)],
        [(0.8, 2.95), (0.78, 2.9)],
        [(0.78, 2.9), (0.62, 2.86)],
    ]
    turned(parts, "painted", roof, 2 * n, GREEN)
    turned(
        parts,
        "painted",
        [[(0.62, 2.86), (0.62, 0.5)], [(0.62, 0.5), (0.72, 0.45), (0.75, 0.0), (0.75, -0.05)]],
        2 * n,
        (0.5, 0.47, 0.4),
    )
    rng = np.random.default_rng(831)
    angle = np.linspace(0, 2 * np.pi, 8)[:-1]
    for k, around in enumerate(angle):
        bend = around + np.linspace(-0.36, 0.36, 3 + n // 6)
        foot, top = 0.7 + 0.3 * (k % 2), 2.4 + 0.15 * (k % 3)
        rim = np.stack([0.635 * np.sin(bend), 0 * bend, 0.635 * np.cos(bend)], -1)
        points = np.stack([rim + np.array([0, top, 0]), rim + np.array([0, foot, 0])])
        parts.add("painted", surface(points, points[..., :2]).painted(tuple(rng.uniform(0.05, 0.6, 3))))
    return parts


def kiosk(n: int) -> Parts:
    """Return a newspaper stand with a hatch, goods and an awning."""
    parts = Parts()
    parts.boxes("painted", OBJECT, (-1.4, -0.05, -0.9), (1.4, 1.0, 0.9), GREEN, "xXzZ")
    parts.boxes("painted", OBJECT, (-1.4, 1.0, -0.9), (1.4, 2.5, -0.1), GREEN, "xXzZ")
    parts.boxes(
        "painted",
        OBJECT,
        [(-1.4, 1.0, -0.1), (1.25, 1.0, -0.1)],
        [(-1.25, 2.5, 0.9), (1.4, 2.5, 0.9)],
        GREEN,
        "xXZ",
    )
    parts.boxes("painted", OBJECT, (-1.25, 0.9, -0.1), (1.25, 1.003, 1.05), WOOD, "xXyYZ")
    parts.boxes("painted", OBJECT, (-1.7, 2.5, -1.2), (1.7, 2.68, 1.2), (0.1, 0.12, 0.1))
    parts.boxes("sign", OBJECT, (-1.2, 2.2, 0.2), (1.2, 2.46, 0.28), (0.9, 0.8, 0.5), "xXyYzZ")
    x = np.linspace(-1.1, 1.0, 4 + n // 2)
    low = np.stack([x, 0 * x + 1.003, 0 * x + 0.5], -1)
    tones = np.random.default_rng(841).uniform(0.05, 0.7, (len(x), 3))
    parts.boxes("painted", OBJECT, low, low + np.array([0.1, 0.3, 0.35]), tones, "xXYZ")
    return parts


def table(n: int) -> Parts:
    """Return a table of a café under a parasol, with two chairs."""
    parts = Parts()
    turned(
        parts,
        "painted",
        [
            [(0.0, 0.74), (0.38, 0.74)],
            [(0.38, 0.74), (0.38, 0.71)],
            [(0.38, 0.71), (0.03, 0.7)],
            [(0.03, 0.7), (0.03, 0.05), (0.25, -0.05)],
        ],
        n,
        (0.4, 0.4, 0.4),
    )
    turned(parts, "painted", [[(0.022, 2.5), (0.022, 0.74)]], max(4, n // 2), WOOD)
    gores = max(6, n // 2 * 2)
    angle = np.linspace(0, 2 * np.pi, gores + 1)
    rim = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], -1)
    rings = [
        rim * radius + np.array([0, y, 0])
        for radius, y in ((0.02, 2.62), (0.9, 2.3), (1.35, 2.02), (1.36, 1.86))
    ]
    faces = [np.stack([low[:-1], low[1:], top[1:], top[:-1]], 1) for top, low in pairwise(rings)]
    tone = np.where((np.arange(gores) % 2 == 0)[:, None], (0.65, 0.6, 0.5), (0.5, 0.06, 0.03))
    parts.quads("cloth", OBJECT, np.concatenate(faces), np.tile(tone, (len(faces), 1)))
    for side in (-1, 1):
        x = 0.72 * side
        parts.boxes("painted", OBJECT, (x - 0.2, 0.44, -0.2), (x + 0.2, 0.47, 0.2), WOOD)
        back = x + 0.2 * side
        parts.boxes(
            "painted",
            OBJECT,
            (min(back, back + 0.03 * side), 0.47, -0.19),
            (max(back, back + 0.03 * side), 0.88, 0.19),
            WOOD,
            "xXYzZ",
        )
        legs = np.array([(x + dx, -0.03, dz) for dx in (-0.18, 0.15) for dz in (-0.18, 0.15)])
        parts.boxes("painted", OBJECT, legs, legs + np.array([0.03, 0.47, 0.03]), IRON, "xXzZ")
    return parts


def lantern(n: int) -> Parts:
    """Return a low lamp of a park, with a globe."""
    parts = Parts()
    foot: Profile = [
        [(0.04, 3.2), (0.06, 0.7)],
        [(0.06, 0.7), (0.12, 0.6), (0.1, 0.3), (0.17, 0.1)],
        [(0.17, 0.1), (0.18, -0.05)],
    ]
    turned(parts, "painted", foot, n, IRON)
    turned(
        parts, "painted", [[(0.0, 3.78), (0.05, 3.72), (0.12, 3.66)], [(0.12, 3.66), (0.11, 3.64)]], n, IRON
    )
    parts.add("lamp", sphere(0.24, n, max(4, n // 2)).painted(WHITE).moved((0, 3.42, 0)))
    return parts


def hedge(n: int) -> Parts:
    """Return two metres of a clipped hedge."""
    parts = Parts()
    rng = np.random.default_rng(821)
    rows, columns = 5, 4 + n
    z = np.array([0.34, 0.36, 0.0, -0.36, -0.34])
    y = np.array([-0.05, 0.85, 1.0, 0.85, -0.05])
    x = np.linspace(-1, 1, columns)
    points = np.stack(np.broadcast_arrays(x, y[:, None], z[:, None]), -1) + 0.0
    points[1:-1, :, 1:] += rng.uniform(-0.05, 0.05, (rows - 2, columns, 2))
    tone = np.array([0.07, 0.15, 0.045]) * rng.uniform(0.7, 1.3, (rows * columns, 1))
    shell = surface(points[::-1], points[..., :2])
    rgba = np.concatenate([tone, np.ones((len(tone), 1))], 1)
    parts.add("foliage", Mesh(shell.positions, shell.normals, shell.triangles, colors=rgba))
    return parts


def fountain(n: int) -> Parts:
    """Return a fountain: a round basin, a bowl on a pillar, and water in both."""
    parts = Parts()
    rim: Profile = [
        [(2.5, 0.1), (2.5, 0.55)], [(2.5, 0.55), (2.95, 0.6)], [(2.95, 0.6), (3.0, 0.5), (2.85, 0.42)],
        [(2.85, 0.42), (2.85, 0.15)], [(2.85, 0.15), (3.1, 0.1), (3.1, -0.05)], [(0.0, 0.1), (2.5, 0.1)],
    ]  # fmt: skip
    turned(parts, "painted", rim, 3 * n, STONE)
    pillar: Profile = [
        [(0.0, 2.5), (0.12, 2.42), (0.16, 2.3), (0.08, 2.2)],
        [(0.08, 2.2), (0.14, 1.72)],
        [(0.14, 1.72), (0.9, 1.9)],
        [(0.9, 1.9), (1.05, 1.95), (1.06, 1.88)],
        [(1.06, 1.88), (0.8, 1.62), (0.3, 1.5), (0.2, 1.3)],
        [(0.2, 1.3), (0.28, 0.8), (0.5, 0.3), (0.6, 0.1)],
    ]
    turned(parts, "painted", pillar, 2 * n, STONE)
    for radius, y in ((2.5, 0.42), (0.85, 1.875)):
        turned(parts, "water", [[(0.0, y), (radius * 0.995, y)]], 2 * n, WHITE)
    return parts


def monument(n: int) -> Parts:
    """Return an obelisk on steps."""
    parts = Parts()
    for k in range(3):
        half, y = 2.2 - 0.5 * k, 0.25 * k
        parts.boxes(
            "ashlar", OBJECT, (-half, y - 0.05, -half), (half, y + 0.25, half), (0.62, 0.58, 0.5), "xXYzZ"
        )
    parts.boxes("ashlar", OBJECT, (-0.8, 0.75, -0.8), (0.8, 2.4, 0.8), (0.62, 0.58, 0.5), "xXYzZ")
    shaft = lathe([[(0.0, 9.6), (0.42, 8.9)], [(0.42, 8.9), (0.75, 2.4)]], 4, faceted=True).turned(
        rotation_y(45)
    )
    parts.add("painted", shaft.painted((0.5, 0.4, 0.35)))
    ball = sphere(0.28, 2 * n, n).painted((0.55, 0.4, 0.1)).moved((0, 9.75, 0))
    parts.add("painted", ball)
    return parts


def cooler(n: int) -> Parts:
    """Return an air conditioner for a roof, with two fans."""
    parts = Parts()
    grey = (0.5, 0.51, 0.5)
    parts.boxes("painted", OBJECT, (-1.2, 0.15, -0.55), (1.2, 1.15, 0.55), grey)
    parts.boxes(
        "painted",
        OBJECT,
        [(-1.1, -0.05, -0.5), (1.0, -0.05, -0.5)],
        [(-1.0, 0.15, 0.5), (1.1, 0.15, 0.5)],
        IRON,
        "xXzZ",
    )
    louvres = np.array([(-1.1, 0.25 + 0.12 * k, 0.55) for k in range(2 + n // 3)])
    parts.boxes("painted", OBJECT, louvres, louvres + np.array([2.2, 0.05, 0.04]), (0.3, 0.3, 0.3), "xXyYZ")
    for x in (-0.6, 0.6):
        turned(
            parts,
            "painted",
            [[(0.38, 1.14), (0.38, 1.3)], [(0.38, 1.3), (0.44, 1.3)], [(0.44, 1.3), (0.46, 1.14)]],
            n,
            grey,
            (x, 0, 0),
        )
        turned(parts, "painted", [[(0.0, 1.2), (0.38, 1.17)]], n, (0.03, 0.03, 0.03), (x, 0, 0))
    return parts


def water_tank(n: int) -> Parts:
    """Return a wooden tank on a steel frame, as on old roofs."""
    parts = Parts()
    staves: Profile = [
        [(0.0, 6.1), (0.1, 6.05)],
        [(0.1, 6.05), (1.75, 5.05)],
        [(1.75, 5.05), (1.7, 5.0)],
        [(1.7, 5.0), (1.6, 4.95)],
        [(1.6, 4.95), (1.7, 2.2)],
        [(1.7, 2.2), (0.0, 2.2)],
    ]
    turned(parts, "painted", staves, 2 * n, (0.24, 0.15, 0.09))
    for y in np.linspace(2.5, 4.7, 3 + n // 4):
        turned(
            parts,
            "painted",
            [[(1.71, y + 0.08), (1.74, y + 0.08)], [(1.74, y + 0.08), (1.75, y)], [(1.75, y), (1.71, y)]],
            2 * n,
            IRON,
        )
    legs = np.array([(x, -0.05, z) for x in (-1.1, 1.0) for z in (-1.1, 1.0)])
    parts.boxes("painted", OBJECT, legs, legs + np.array([0.1, 2.25, 0.1]), IRON, "xXzZ")
    parts.boxes(
        "painted",
        OBJECT,
        [(-1.3, 2.0, -1.05), (-1.3, 2.0, 0.95)],
        [(1.3, 2.18, -0.95), (1.3, 2.18, 1.05)],
        IRON,
    )
    for a, b in (
        ((-1.05, 0.1, 1.05), (1.05, 1.9, 1.05)),
        ((1.05, 0.1, 1.05), (1.05, 1.9, -1.05)),
        ((1.05, 0.1, -1.05), (-1.05, 1.9, -1.05)),
        ((-1.05, 0.1, -1.05), (-1.05, 1.9, 1.05)),
    ):
        parts.add("painted", tube(np.array([a, b]), 0.03, 4).painted(IRON))
    return parts


def vent(n: int) -> Parts:
    """Return a pipe with a hat, for a roof."""
    parts = Parts()
    turned(
        parts,
        "painted",
        [
            [(0.0, 1.1), (0.3, 0.95)],
            [(0.3, 0.95), (0.28, 0.92)],
            [(0.28, 0.92), (0.15, 0.9)],
            [(0.15, 0.9), (0.15, 0.1)],
            [(0.15, 0.1), (0.22, -0.05)],
        ],
        n,
        (0.42, 0.43, 0.44),
    )
    return parts


def antenna(n: int) -> Parts:
    """Return a mast with cross bars and a dish."""
    parts = Parts()
    mast = [tube(np.array([(0, -0.05, 0), (0, 4.2, 0)]), 0.03, max(4, n // 3))]
    mast += [
        tube(np.array([(-w, y, 0.03), (w, y, 0.03)]), 0.012, 4)
        for w, y in ((0.6, 4.0), (0.5, 3.7), (0.42, 3.4), (0.36, 3.1))
    ]
    parts.add("painted", join(*mast).painted((0.3, 0.3, 0.3)))
    turn = np.array([[1.0, 0, 0], [0, 0.5, -0.8660254], [0, 0.8660254, 0.5]])
    dish = lathe([[(0.0, 0.0), (0.3, 0.06), (0.5, 0.18)]], 2 * n).turned(turn)
    parts.add("cloth", dish.painted((0.6, 0.6, 0.58)).moved((0, 1.9, 0.15)))
    return parts


OUTDOORS = {
    "column": column,
    "kiosk": kiosk,
    "table": table,
    "lantern": lantern,
    "hedge": hedge,
    "fountain": fountain,
    "monument": monument,
}
ROOF = {"cooler": cooler, "tank": water_tank, "vent": vent, "antenna": antenna}
