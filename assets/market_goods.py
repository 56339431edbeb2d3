"""What stalls sell: fruit, spices, pots, glass, boxes, cloth, food and brass, on the counter, the step and the shelves.

Everything stands in the frame of its stall, on the heights that `market_stalls` gives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from assets.city_parts import OBJECT, Parts
from assets.market_stalls import COUNTER, COUNTER_TOP, SHELF, SHELVES, STEP, STEP_TOP
from assets.noise import Float64
from assets.shapes import Mesh, join, lathe, sphere

Rgb = tuple[float, float, float]
FRUIT: tuple[Rgb, ...] = (
    (0.72, 0.06, 0.03), (0.85, 0.36, 0.03), (0.82, 0.66, 0.06), (0.22, 0.46, 0.05), (0.36, 0.04, 0.18),
)  # fmt: skip
SPICES: tuple[Rgb, ...] = (
    (0.75, 0.3, 0.02), (0.5, 0.05, 0.02), (0.7, 0.52, 0.1), (0.2, 0.22, 0.05), (0.3, 0.14, 0.05), (0.62, 0.55, 0.4),
)  # fmt: skip
GLAZES: tuple[Rgb, ...] = (
    (0.06, 0.2, 0.42), (0.6, 0.52, 0.4), (0.35, 0.1, 0.04), (0.08, 0.32, 0.24), (0.7, 0.68, 0.62),
)  # fmt: skip
GLASS: tuple[Rgb, ...] = (
    (0.12, 0.75, 0.35), (0.95, 0.5, 0.08), (0.15, 0.4, 0.95), (0.9, 0.12, 0.16), (0.75, 0.3, 0.85), (0.8, 0.95, 0.95),
)  # fmt: skip
DYES: tuple[Rgb, ...] = (
    (0.55, 0.05, 0.08), (0.05, 0.14, 0.45), (0.7, 0.4, 0.06), (0.06, 0.3, 0.18), (0.38, 0.08, 0.35), (0.68, 0.6, 0.48),
)  # fmt: skip
WOOD: Rgb = (0.8, 0.72, 0.6)


def _put(parts: Parts, material: str, meshes: Sequence[Mesh], at: Float64, paints: Sequence[Rgb]) -> None:
    """Add meshes in turn at places (N, 3), painted in turn."""
    pieces = [
        meshes[k % len(meshes)].moved(place).painted(paints[k % len(paints)]) for k, place in enumerate(at)
    ]
    parts.add(material, join(*(Mesh(m.positions, m.normals, m.triangles, colors=m.colors) for m in pieces)))


def _row(
    count: int, y: float, ends: tuple[float, float], rng: np.random.Generator, half: float = 1.28
) -> Float64:
    """Return places (N, 3) along x on a board between two z, a little out of line."""
    x = np.linspace(-half, half, count) + rng.uniform(-0.02, 0.02, count)
    z = np.full(count, (ends[0] + ends[1]) / 2) + rng.uniform(-0.03, 0.03, count)
    return np.stack([x, np.full(count, y), z], -1)


def _boxes(
    parts: Parts, material: str, at: Float64, size: Float64, paints: Sequence[Rgb], faces: str = "xXYzZ"
) -> None:
    """Add boxes that stand at places (N, 3) with sizes (N, 3), painted in turn."""
    half = size * [0.5, 0.0, 0.5]
    colors = np.array([paints[k % len(paints)] for k in range(len(at))])
    parts.boxes(material, OBJECT, at - half, at - half + size, colors, faces)


def _ball(radius: float) -> Mesh:
    return sphere(radius, 5, 3)


def _crates(parts: Parts, at: Float64, size: Rgb) -> None:
    """Add crates without lids that stand at places (N, 3), filled to a third below their rim."""
    wide, tall, deep = size
    for x, y, z in at:
        x0, x1, z0, z1, t = x - wide / 2, x + wide / 2, z - deep / 2, z + deep / 2, 0.018
        low = np.array([(x0, y, z1 - t), (x0, y, z0), (x0, y, z0 + t), (x1 - t, y, z0 + t)])
        high = np.array(
            [(x1, y + tall, z1), (x1, y + tall, z0 + t), (x0 + t, y + tall, z1 - t), (x1, y + tall, z1 - t)]
        )
        parts.boxes("wood", OBJECT, low, high, WOOD, "xXYzZ")
        fill = np.array(
            [[(x0 + t, 0, z1 - t), (x1 - t, 0, z1 - t), (x1 - t, 0, z0 + t), (x0 + t, 0, z0 + t)]]
        )
        parts.quads("wood", OBJECT, fill + np.array([0, y + 0.5 * tall, 0]), (0.3, 0.26, 0.2))


def fruit(rng: np.random.Generator) -> Parts:
    """Return crates of fruit on the counter and the step."""
    parts = Parts()
    for y, ends, radius in ((COUNTER_TOP, COUNTER, 0.082), (STEP_TOP, STEP, 0.078)):
        crates = _row(5, y, ends, rng, 1.1) * [1, 1, 0] + [0, 0, (ends[0] + ends[1]) / 2]
        deep = 0.9 * (ends[1] - ends[0])
        _crates(parts, crates, (0.48, 0.14, min(deep, 0.5)))
        dx, dz = np.meshgrid(np.linspace(-0.16, 0.16, 3), np.linspace(-0.5, 0.5, 2))
        spots = np.stack([dx.ravel(), 0 * dx.ravel() + 0.1, dz.ravel() * (min(deep, 0.5) - 0.15)], -1)
        for crate in crates:
            paint = FRUIT[int(rng.integers(len(FRUIT)))]
            jitter = rng.uniform(-0.012, 0.03, spots.shape)
            _put(parts, "wares", [_ball(radius)], crate + spots + jitter, [paint])
    return parts


def spices(rng: np.random.Generator) -> Parts:
    """Return bowls with heaps of spice, and jars on the shelves."""
    parts = Parts()
    bowl = lathe([[(0.15, 0.1), (0.1, 0.0)]], 6)
    heap = lathe([[(0.0, 0.2), (0.05, 0.165), (0.14, 0.08)]], 6)
    for y, ends in ((COUNTER_TOP, COUNTER), (STEP_TOP, STEP)):
        at = _row(6, y, ends, rng, 1.18)
        _put(parts, "wares", [bowl], at, [(0.25, 0.13, 0.07)])
        order = [SPICES[k] for k in rng.permutation(len(SPICES))]
        _put(parts, "cloth", [heap], at, order)
    jar = lathe([[(0.0, 0.3), (0.06, 0.29)], [(0.075, 0.27), (0.085, 0.15), (0.07, 0.0)]], 6)
    for y in SHELVES[1:]:
        _put(parts, "wares", [jar], _row(8, y, SHELF, rng), [SPICES[k] for k in rng.permutation(6)])
    return parts


def pottery(rng: np.random.Generator) -> Parts:
    """Return vases, bowls and plates."""
    parts = Parts()
    vase = lathe([[(0.0, 0.34), (0.05, 0.36), (0.035, 0.29), (0.1, 0.17), (0.05, 0.0)]], 6)
    jug = lathe([[(0.0, 0.22), (0.06, 0.24), (0.045, 0.19), (0.09, 0.09), (0.06, 0.0)]], 6)
    bowl = lathe(
        [
            [(0.13, 0.09), (0.09, 0.02), (0.05, 0.0)],
            [(0.085, 0.025), (0.128, 0.09)],
            [(0.0, 0.025), (0.085, 0.026)],
        ],
        6,
    )
    for y, ends, count, meshes in (
        (COUNTER_TOP, COUNTER, 7, [bowl, jug]), (STEP_TOP, STEP, 8, [jug, vase]),
        (SHELVES[1], SHELF, 8, [vase, bowl]), (SHELVES[2], SHELF, 7, [vase]),
    ):  # fmt: skip
        paints = [GLAZES[int(k)] for k in rng.integers(len(GLAZES), size=count)]
        _put(parts, "wares", meshes, _row(count, y, ends, rng), paints)
    return parts


def glassware(rng: np.random.Generator) -> Parts:
    """Return bottles, goblets and bowls of coloured glass, and panes that hang above the counter."""
    parts = Parts()
    bottle = lathe([[(0.018, 0.33), (0.02, 0.23), (0.055, 0.17), (0.055, 0.0)]], 7)
    flask = lathe([[(0.02, 0.24), (0.018, 0.17), (0.085, 0.08), (0.05, 0.0)]], 7)
    goblet = lathe([[(0.05, 0.2), (0.045, 0.12), (0.009, 0.09), (0.009, 0.02), (0.045, 0.0)]], 7)
    for y, ends, count, meshes, front in (
        (COUNTER_TOP, COUNTER, 7, [flask, goblet, bottle], 0.16), (COUNTER_TOP, COUNTER, 7, [bottle, goblet], -0.18),
        (STEP_TOP, STEP, 8, [bottle, goblet, flask], 0.0), (SHELVES[0], SHELF, 6, [flask, bottle], 0.0),
        (SHELVES[1], SHELF, 9, [bottle, flask], 0.0), (SHELVES[2], SHELF, 9, [bottle, goblet, bottle], 0.0),
    ):  # fmt: skip
        paints = [GLASS[int(k)] for k in rng.integers(len(GLASS), size=count)]
        at = _row(count, y, ends, rng) + np.array([0.0, 0.0, front])
        _put(parts, "glass", meshes, at, paints)
        stopper = [lathe([[(0.0, 0.045), (0.02, 0.03), (0.016, 0.0)]], 4)]
        corked = np.array([k for k in range(count) if meshes[k % len(meshes)] is bottle], np.int64)
        if len(corked):
            _put(parts, "wares", stopper, at[corked] + [0.0, 0.33, 0.0], [(0.5, 0.36, 0.2)])
    hung = np.linspace(-1.15, 1.15, 6)
    for k, x in enumerate(hung):  # panes on threads below the front bar
        low, high, z = 1.6 - 0.08 * (k % 2), 1.98, 0.32 + 0.05 * (k % 3)
        corner = np.array(
            [[(x - 0.13, low, z), (x + 0.13, low, z), (x + 0.13, high, z), (x - 0.13, high, z)]]
        )
        parts.quads("pane", OBJECT, corner, GLASS[k % len(GLASS)])
        parts.boxes(
            "painted",
            OBJECT,
            [(x - 0.14, high, z - 0.008)],
            [(x + 0.14, high + 0.016, z + 0.008)],
            (0.05, 0.04, 0.03),
        )
        for thread in (x - 0.11, x + 0.11):
            low_end, high_end = (thread - 0.004, high + 0.016, z - 0.004), (thread + 0.004, 2.22, z + 0.004)
            parts.boxes("painted", OBJECT, [low_end], [high_end], (0.3, 0.28, 0.25), "xXzZ")
    return parts


def boxes(rng: np.random.Generator) -> Parts:
    """Return books and painted boxes."""
    parts = Parts()
    for y, ends, count in (
        (COUNTER_TOP, COUNTER, 9), (STEP_TOP, STEP, 12), (SHELVES[0], SHELF, 10),
        (SHELVES[1], SHELF, 16), (SHELVES[2], SHELF, 14),
    ):  # fmt: skip
        wide = 2.6 / count
        deep = min(0.8 * (ends[1] - ends[0]), 0.42)
        size = np.stack(
            [rng.uniform(0.6, 0.93, count) * wide, rng.uniform(0.1, 0.34, count), np.full(count, deep)], -1
        )
        paints = [DYES[int(k)] for k in rng.integers(len(DYES), size=count)]
        at = _row(count, y, ends, rng, 1.3 - wide / 2) * [1, 1, 0] + [0, 0, sum(ends) / 2]
        _boxes(parts, "painted", at, size, paints)
    return parts


def textiles(rng: np.random.Generator) -> Parts:
    """Return rolls and folded cloth, and lengths of it that hang from the beams."""
    parts = Parts()
    roll = lathe(
        [[(0.0, 0.001), (0.075, 0.0)], [(0.075, 0.0), (0.075, -0.5)], [(0.075, -0.5), (0.0, -0.501)]], 6
    )
    lying = roll.turned(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    count = 15
    at = np.stack(
        [np.linspace(-1.25, 1.25, count), np.full(count, COUNTER_TOP + 0.075), np.full(count, -0.17)], -1
    )
    _put(parts, "cloth", [lying], at, [DYES[int(k)] for k in rng.integers(len(DYES), size=count)])
    for y, ends in ((STEP_TOP, STEP), (SHELVES[0], SHELF), (SHELVES[1], SHELF), (SHELVES[2], SHELF)):
        size = np.stack([np.full(7, 0.33), rng.uniform(0.12, 0.36, 7), np.full(7, 0.26)], -1)
        row = _row(7, y, ends, rng, 1.18)
        _boxes(parts, "cloth", row, size, [DYES[int(k)] for k in rng.integers(len(DYES), size=7)])
    for k, x in enumerate((-1.22, -0.78, 0.8, 1.2)):
        xs = x + np.linspace(-0.2, 0.2, 7)
        z = -0.45 + 0.025 * np.cos(np.arange(7) * 2.1 + k)
        low = 1.3 + 0.06 * k
        top = np.stack([xs, 0 * xs + 2.165, 0.4 * z - 0.27], -1)
        foot = np.stack([xs, 0 * xs + low + 0.02 * np.sin(np.arange(7) * 1.7), z], -1)
        strips = np.stack([foot[:-1], foot[1:], top[1:], top[:-1]], 1)
        parts.quads("cloth", OBJECT, strips, DYES[(k + int(rng.integers(3))) % len(DYES)])
    return parts


def food(rng: np.random.Generator) -> Parts:
    """Return pots, pans and dishes behind a pane of glass."""
    parts = Parts()
    pot = lathe(
        [[(0.02, 0.27), (0.03, 0.24)], [(0.03, 0.24), (0.16, 0.2)], [(0.17, 0.2), (0.17, 0.02), (0.14, 0.0)]],
        7,
    )
    dish = lathe([[(0.13, 0.05), (0.07, 0.0)], [(0.0, 0.035), (0.12, 0.036)]], 6)
    _put(parts, "metal", [pot], _row(5, STEP_TOP, STEP, rng, 1.1), [(0.75, 0.72, 0.68), (0.7, 0.45, 0.28)])
    plates = _row(8, COUNTER_TOP, COUNTER, rng, 1.2) - [0.0, 0.0, 0.12]
    _put(parts, "wares", [dish], plates, [(0.72, 0.7, 0.64)])
    for k in range(2):
        turned = np.pi * k
        spots = plates + np.array([0.045 * np.cos(turned), 0.065, 0.045 * np.sin(turned)])
        _put(parts, "wares", [_ball(0.035)], spots, [(0.5, 0.22, 0.06), (0.6, 0.42, 0.14), (0.35, 0.4, 0.08)])
    _crates(parts, _row(4, SHELVES[1], SHELF, rng, 1.0) * [1, 1, 0] + [0, 0, -1.85], (0.5, 0.26, 0.3))
    _put(
        parts,
        "wares",
        [_ball(0.09)],
        _row(8, SHELVES[2] + 0.07, SHELF, rng),
        [(0.62, 0.4, 0.16), (0.55, 0.3, 0.1)],
    )
    low, high, z = COUNTER_TOP + 0.02, COUNTER_TOP + 0.48, COUNTER[1] - 0.07
    corner = np.array(
        [
            [(x - 0.65, low, z), (x + 0.65, low, z), (x + 0.65, high, z - 0.05), (x - 0.65, high, z - 0.05)]
            for x in (-0.68, 0.68)
        ]
    )
    parts.quads("pane", OBJECT, corner, (1.0, 1.0, 1.0))
    posts = [(x, COUNTER_TOP, z - 0.07) for x in (-1.36, -0.01, 1.34)]
    parts.boxes("metal", OBJECT, posts, np.add(posts, (0.02, 0.5, 0.08)), (0.6, 0.58, 0.55))
    return parts


def brass(rng: np.random.Generator) -> Parts:
    """Return ewers, trays and coloured glass globes."""
    parts, gold = Parts(), [(0.9, 0.6, 0.2), (0.82, 0.42, 0.22), (0.75, 0.73, 0.7)]
    ewer = lathe([[(0.02, 0.4), (0.03, 0.3), (0.1, 0.15), (0.04, 0.05), (0.07, 0.0)]], 6)
    cup = lathe([[(0.0, 0.12), (0.06, 0.14), (0.05, 0.05), (0.02, 0.04), (0.05, 0.0)]], 6)
    _put(parts, "metal", [ewer, cup], _row(7, COUNTER_TOP, COUNTER, rng), gold)
    _put(parts, "metal", [cup, ewer], _row(7, STEP_TOP, STEP, rng), gold)
    tray = lathe([[(0.0, 0.012), (0.15, 0.012), (0.17, 0.03)], [(0.17, 0.03), (0.15, 0.0)]], 7)
    upright = tray.turned(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]))
    for y in SHELVES[1:]:
        _put(
            parts,
            "metal",
            [upright],
            _row(4, y + 0.175, (-2.0, -1.99), rng) * [1, 1, 0] + [0, 0, -1.98],
            gold,
        )
    globe = lathe([[(0.02, 0.21), (0.08, 0.16), (0.1, 0.09), (0.06, 0.01), (0.03, 0.0)]], 6)
    at = _row(6, COUNTER_TOP, COUNTER, rng) + np.array([0.08, 0.0, -0.22])
    _put(parts, "glass", [globe], at, [GLASS[int(k)] for k in rng.integers(len(GLASS), size=6)])
    _put(
        parts,
        "glass",
        [globe],
        _row(6, SHELVES[0], SHELF, rng),
        [GLASS[int(k)] for k in rng.permutation(len(GLASS))],
    )
    return parts


GOODS: dict[str, Callable[[np.random.Generator], Parts]] = {
    "fruit": fruit, "spices": spices, "pottery": pottery, "glassware": glassware,
    "boxes": boxes, "textiles": textiles, "food": food, "brass": brass,
}  # fmt: skip


def stack() -> Parts:
    """Return crates and sacks that stand behind and beside stalls, about their middle."""
    parts = Parts()
    _crates(parts, np.array([(-0.3, 0.0, 0.0), (-0.27, 0.3, 0.02), (0.35, 0.0, 0.05)]), (0.55, 0.3, 0.4))
    sack = lathe([[(0.05, 0.52), (0.07, 0.46), (0.2, 0.3), (0.22, 0.1), (0.17, 0.0)]], 6)
    _put(parts, "cloth", [sack], np.array([(0.85, 0.0, 0.0), (0.38, 0.16, 0.05)]), [(0.42, 0.34, 0.22)])
    _put(
        parts,
        "wares",
        [_ball(0.07)],
        np.array([(-0.4, 0.5, 0.0), (-0.26, 0.51, 0.08), (-0.15, 0.5, -0.04)]),
        FRUIT,
    )
    return parts
