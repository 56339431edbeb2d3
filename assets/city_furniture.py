"""What stands in streets: lamps, benches, bins, hydrants, shelters, signals, bicycles, pigeons.

Every piece stands on the origin and looks along +z, to the street. What meets the ground goes a little into it and has
no lower face, so that no two faces share a plane. `n` is the number of steps around a turned piece.
"""

from __future__ import annotations

import numpy as np

from assets.city_facades import WHITE
from assets.city_parts import OBJECT, Parts
from assets.city_trees import Kind, card_crown
from assets.shapes import Mesh, arc, lathe, sphere, tube

IRON, STEEL, WOOD = (0.035, 0.045, 0.04), (0.6, 0.6, 0.6), (0.3, 0.16, 0.07)
RED, GREEN, DARK = (0.5, 0.025, 0.02), (0.03, 0.14, 0.07), (0.12, 0.13, 0.14)
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Turns a lathe so that its upper side faces +z."""

Profile = list[list[tuple[float, float]]]


def turned(
    parts: Parts,
    material: str,
    profile: Profile,
    sides: int,
    color: tuple[float, ...],
    at: tuple[float, float, float] = (0, 0, 0),
) -> None:
    """Add a lathe of one colour, shifted to `at`."""
    parts.add(material, lathe(profile, sides).painted(color).moved(at))


def lamp(n: int) -> Parts:
    """Return a street lamp 5.4 m high with an arm over the road."""
    parts = Parts()
    foot: Profile = [
        [(0.05, 4.6), (0.075, 0.9)], [(0.075, 0.9), (0.13, 0.82), (0.13, 0.74), (0.1, 0.66)],
        [(0.1, 0.66), (0.12, 0.3), (0.2, 0.12)], [(0.2, 0.12), (0.22, -0.05)],
    ]  # fmt: skip
    turned(parts, "painted", foot, n, IRON)
    bow = np.array(
        [
            (0.0, 4.6 + 0.75 * np.sin(t), 0.75 * (1 - np.cos(t)))
            for t in np.linspace(0, np.pi * 0.5, 3 + n // 3)
        ]
    )
    bow = np.concatenate([bow, bow[-1:] + np.array([[0.0, -0.02, 0.35]])])
    parts.add("painted", tube(bow, 0.04, max(4, n // 2)).painted(IRON))
    shade: Profile = [
        [(0.0, 5.42), (0.09, 5.42)],
        [(0.09, 5.42), (0.14, 5.32), (0.3, 5.22)],
        [(0.3, 5.22), (0.27, 5.2)],
    ]
    turned(parts, "painted", shade, n, IRON, (0, 0, 1.1))
    glow: Profile = [[(0.26, 5.215), (0.22, 5.12), (0.12, 5.06), (0.0, 5.04)]]
    turned(parts, "lamp", glow, n, WHITE, (0, 0, 1.1))
    return parts


def bench(n: int) -> Parts:
    """Return a bench of wooden slats between iron ends."""
    parts = Parts()
    slats = [(0.45, -0.16 + 0.105 * k, 0.035, 0.085) for k in range(4)] + [
        (0.58 + 0.115 * k, -0.27 - 0.035 * k, 0.085, 0.03) for k in range(3)
    ]
    low = np.array([(-0.9, y, z) for y, z, _, _ in slats])
    high = low + np.array([(1.8, dy, dz) for _, _, dy, dz in slats])
    parts.boxes("painted", OBJECT, low, high, WOOD)
    for x in (-0.75, 0.75):
        legs = [[(x, -0.05, 0.28), (x, 0.43, 0.2)], [(x, -0.05, -0.36), (x, 0.43, -0.14)]]
        rails = [[(x, 0.43, 0.2), (x, 0.43, -0.16)], [(x, 0.42, -0.15), (x, 0.52, -0.27), (x, 0.92, -0.39)]]
        for path in (*legs, *rails):
            parts.add("painted", tube(np.array(path), 0.025, max(4, n // 3)).painted(IRON))
    return parts


def waste_bin(n: int) -> Parts:
    """Return a round bin with a lid."""
    parts = Parts()
    body: Profile = [
        [(0.0, 0.98), (0.12, 0.97), (0.24, 0.9)], [(0.24, 0.9), (0.26, 0.86), (0.24, 0.84)],
        [(0.24, 0.84), (0.24, 0.7), (0.2, 0.06)], [(0.2, 0.06), (0.22, -0.05)],
    ]  # fmt: skip
    turned(parts, "painted", body, n, GREEN)
    return parts


def hydrant(n: int) -> Parts:
    """Return a hydrant with two outlets and a bonnet."""
    parts = Parts()
    body: Profile = [
        [(0.0, 0.82), (0.03, 0.82), (0.035, 0.76)], [*arc((0.0, 0.62), 0.14, 80, 0, max(2, n // 3))],
        [(0.14, 0.62), (0.17, 0.62)], [(0.17, 0.62), (0.17, 0.57)], [(0.17, 0.57), (0.12, 0.56), (0.11, 0.12)],
        [(0.11, 0.12), (0.18, 0.1)], [(0.18, 0.1), (0.18, -0.05)],
    ]  # fmt: skip
    turned(parts, "painted", body, n, RED)
    cap = lathe([[(0.0, 0.2), (0.06, 0.2)], [(0.06, 0.2), (0.075, 0.16), (0.055, 0.05)]], n)
    for turn in (np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]), np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])):
        parts.add("painted", cap.turned(turn.astype(np.float64)).painted((0.6, 0.5, 0.1)).moved((0, 0.4, 0)))
    return parts


def bollard(n: int) -> Parts:
    """Return a post that keeps cars from the pavement."""
    parts = Parts()
    turned(
        parts,
        "painted",
        [[(0.0, 0.95), (0.05, 0.93), (0.075, 0.87)], [(0.075, 0.87), (0.085, 0.0), (0.085, -0.05)]],
        n,
        IRON,
    )
    return parts


def planter(n: int) -> Parts:
    """Return a tub with a clipped shrub."""
    parts = Parts()
    tub: Profile = [
        [(0.3, 0.5), (0.36, 0.5)],
        [(0.36, 0.5), (0.38, 0.44), (0.34, 0.4), (0.26, 0.0), (0.26, -0.05)],
        [(0.0, 0.44), (0.3, 0.44)],
    ]
    turned(parts, "painted", tub, n, (0.45, 0.2, 0.12))
    bush = Kind("bush", 1.5, 0.42, 0.5, (0.5, 0.72, 0.4))
    parts.add("leaves", card_crown(bush, 6 + 2 * n, np.random.default_rng(811)))
    return parts


def shelter(n: int) -> Parts:
    """Return the shelter of a bus stop: a steel frame, panes of glass, a bench and a lit panel."""
    parts = Parts()
    posts = np.array([(x, -0.05, z) for x in (-1.9, 1.84) for z in (-0.7, 0.54)])
    parts.boxes("painted", OBJECT, posts, posts + np.array([0.06, 2.45, 0.06]), DARK, "xXzZ")
    parts.boxes("painted", OBJECT, (-2.05, 2.4, -0.85), (2.05, 2.5, 0.85), DARK)
    panes = np.array([[(-1.8, 0.3, -0.67), (1.8, 0.3, -0.67), (1.8, 2.2, -0.67), (-1.8, 2.2, -0.67)],
                      [(-1.87, 0.3, -0.6), (-1.87, 0.3, 0.5), (-1.87, 2.2, 0.5), (-1.87, 2.2, -0.6)]])  # fmt: skip
    back = panes[:, ::-1]
    parts.quads(
        "glass", OBJECT, np.concatenate([panes, back + np.array([[[0, 0, -0.012]], [[-0.012, 0, 0]]])]), WHITE
    )
    parts.boxes("painted", OBJECT, (-1.2, 0.45, -0.6), (0.8, 0.5, -0.2), WOOD)
    parts.boxes(
        "painted",
        OBJECT,
        [(-1.0, -0.05, -0.45), (0.5, -0.05, -0.45)],
        [(-0.92, 0.45, -0.37), (0.58, 0.45, -0.37)],
        IRON,
        "xXzZ",
    )
    parts.boxes("painted", OBJECT, (1.8, 0.25, -0.5), (1.94, 2.25, 0.5), DARK, "yYzZ")
    sides = np.array([[(1.94, 0.25, 0.5), (1.94, 0.25, -0.5), (1.94, 2.25, -0.5), (1.94, 2.25, 0.5)],
                      [(1.8, 0.25, -0.5), (1.8, 0.25, 0.5), (1.8, 2.25, 0.5), (1.8, 2.25, -0.5)]])  # fmt: skip
    parts.quads("sign", OBJECT, sides, (0.5, 0.75, 0.9))
    return parts


def signal(n: int) -> Parts:
    """Return a traffic light."""
    parts = Parts()
    turned(parts, "painted", [[(0.06, 2.5), (0.06, 0.4)], [(0.06, 0.4), (0.1, 0.35), (0.1, -0.05)]], n, STEEL)
    parts.boxes("painted", OBJECT, (-0.16, 2.35, -0.1), (0.16, 3.25, 0.14), (0.02, 0.02, 0.022))
    for k, tone in enumerate(((0.02, 0.25, 0.06), (0.3, 0.17, 0.01), (1.0, 0.05, 0.02))):
        lens = (
            lathe([[(0.0, 0.035), (0.06, 0.025), (0.1, 0.0)]], n)
            .turned(UPRIGHT)
            .moved((0, 2.52 + 0.28 * k, 0.14))
        )
        parts.add("sign" if k == 2 else "painted", lens.painted(tone))
        hood = lathe([[(0.12, 0.16), (0.12, 0.0)]], n).turned(UPRIGHT).moved((0, 2.52 + 0.28 * k, 0.14))
        parts.add("cloth", hood.painted((0.02, 0.02, 0.022)))
    return parts


def sign_post(n: int) -> Parts:
    """Return a round traffic sign on a post."""
    parts = Parts()
    turned(parts, "painted", [[(0.03, 2.7), (0.03, -0.05)]], max(5, n // 2), STEEL)
    disc: Profile = [[(0.0, 0.05), (0.23, 0.05)], [(0.3, 0.045), (0.3, 0.03)], [(0.3, 0.03), (0.0, 0.03)]]
    parts.add("painted", lathe(disc, n).turned(UPRIGHT).painted((0.75, 0.75, 0.75)).moved((0, 2.4, 0)))
    parts.add(
        "painted",
        lathe([[(0.23, 0.05), (0.3, 0.045)]], n)
        .turned(UPRIGHT)
        .painted((0.6, 0.02, 0.02))
        .moved((0, 2.4, 0)),
    )
    return parts


def bicycle(n: int) -> Parts:
    """Return a bicycle that leans on its stand."""
    parts = Parts()
    turn = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    angle = np.linspace(0, 2 * np.pi, 2 * n, endpoint=False)
    ring = np.stack([0 * angle, 0.33 * np.sin(angle), 0.33 * np.cos(angle)], -1)
    sides = max(4, n // 4)
    for z in (-0.52, 0.52):
        parts.add(
            "painted",
            tube(ring + np.array([0, 0.33, z]), 0.018, sides, closed=True).painted((0.03, 0.03, 0.03)),
        )
        hub = lathe(
            [[(0.0, 0.05), (0.03, 0.05)], [(0.03, 0.05), (0.03, -0.05)], [(0.03, -0.05), (0.0, -0.05)]],
            sides + 2,
        )
        parts.add("painted", hub.turned(turn).painted(STEEL).moved((0, 0.33, z)))
    crank, seat, head = (0, 0.3, -0.06), (0, 0.82, -0.2), (0, 0.8, 0.34)
    rear, front, stem = (0, 0.33, -0.52), (0, 0.33, 0.52), (0, 0.98, 0.3)
    frame = [
        (crank, seat),
        (crank, head),
        (seat, head),
        (rear, crank),
        (rear, (0, 0.7, -0.17)),
        (front, head, stem),
    ]
    for path in (*frame, ((-0.26, 1.0, 0.22), stem, (0.26, 1.0, 0.22))):
        parts.add("painted", tube(np.array(path), 0.017, sides).painted((0.25, 0.04, 0.05)))
    parts.boxes("painted", OBJECT, (-0.07, 0.84, -0.34), (0.07, 0.9, -0.08), (0.03, 0.03, 0.03))
    return parts


def grate(n: int) -> Parts:
    """Return the lid of a manhole, which stands a finger's breadth out of the road."""
    parts = Parts()
    turned(
        parts,
        "painted",
        [
            [(0.0, 0.012), (0.12, 0.012), (0.12, 0.008), (0.22, 0.008)],
            [(0.22, 0.012), (0.34, 0.012)],
            [(0.34, 0.012), (0.36, -0.04)],
        ],
        2 * n,
        (0.09, 0.085, 0.08),
    )
    return parts


def pigeon(n: int) -> Parts:
    """Return a pigeon."""
    parts = Parts()
    body = sphere(1.0, n, max(4, n // 2))
    size = np.array([0.055, 0.06, 0.12])
    normals = body.normals / size
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    shape = Mesh(body.positions * size, normals, body.triangles).painted((0.2, 0.22, 0.27))
    parts.add("painted", shape.moved((0, 0.12, 0)))
    parts.add("painted", sphere(0.035, max(5, n // 2), 4).painted((0.08, 0.12, 0.13)).moved((0, 0.21, 0.1)))
    parts.boxes(
        "painted",
        OBJECT,
        [(-0.025, -0.01, 0), (0.015, -0.01, 0)],
        [(-0.015, 0.08, 0.01), (0.025, 0.08, 0.01)],
        (0.5, 0.15, 0.1),
        "xXzZ",
    )
    parts.boxes("painted", OBJECT, (-0.03, 0.11, -0.22), (0.03, 0.13, -0.08), (0.1, 0.11, 0.14))
    return parts


STREET = {
    "lamp": lamp,
    "bench": bench,
    "bin": waste_bin,
    "hydrant": hydrant,
    "bollard": bollard,
    "planter": planter,
    "shelter": shelter,
    "signal": signal,
    "sign": sign_post,
    "bicycle": bicycle,
    "grate": grate,
    "pigeon": pigeon,
}
