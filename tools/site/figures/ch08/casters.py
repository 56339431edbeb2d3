"""A lamp and casters from above: which of them it reaches, and which of its faces may see them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tools.site.figures.canvas import Canvas, Point
from tools.site.figures.ch08.faces import NAMES, lamp_faces

Float64 = NDArray[np.float64]

REACH = 4.0
CASTERS = np.array(
    [
        [(2.2, 0.5), (0.5, 0.4)],
        [(1.4, -1.6), (0.45, 0.45)],
        [(-0.2, -2.8), (0.7, 0.35)],
        [(-2.6, 0.2), (0.4, 0.8)],
        [(-1.5, 1.9), (0.5, 0.4)],
        [(0.4, 2.4), (0.35, 0.35)],
        [(4.4, 2.2), (0.5, 0.5)],
        [(-3.9, -2.6), (0.5, 0.4)],
        [(3.5, -1.9), (0.4, 0.5)],
    ]
)
"""Middles and half sizes along x and z, in metres from the lamp; all are 0.6 m high."""
HEIGHT = 0.3
FACES = (0, 1, 4, 5)
"""Those that lie in the plane of the drawing."""


def boxes() -> tuple[Float64, Float64]:
    """Return centres and half sizes (N, 3)."""
    centre, extent = np.zeros((2, len(CASTERS), 3))
    centre[:, (0, 2)], extent[:, (0, 2)], extent[:, 1] = CASTERS[:, 0], CASTERS[:, 1], HEIGHT
    return centre, extent


def reached() -> list[bool]:
    """Return whether the sphere around each caster meets that of the lamp."""
    centre, extent = boxes()
    met: list[bool] = (np.linalg.norm(centre, axis=1) <= REACH + np.linalg.norm(extent, axis=1)).tolist()
    return met


def may_see(face: np.ndarray, centre: Float64, extent: Float64) -> bool:
    """Whether a box is not outside of any of the four sides of a face: the test of shadows/cull.glsl."""
    widest = 0.5 * float(face["size"]) / float(face["scale_x"])
    right, down, ahead = (face[name].astype(np.float64) for name in ("right", "down", "ahead"))
    for axis in (right, down):
        for sign in (-1, 1):
            inwards = ahead * widest + sign * axis
            if inwards @ centre + np.abs(inwards) @ extent < 0:
                return False
    return bool(ahead @ centre + np.abs(ahead) @ extent > 0)


def bits() -> list[str]:
    """Return the six bits of each caster, +x first; "" for one that the lamp does not reach."""
    faces = lamp_faces()
    centre, extent = boxes()
    return [
        "".join("1" if may_see(face, *box) else "0" for face in faces) if near else ""
        for near, *box in zip(reached(), centre, extent, strict=True)
    ]


def casters_of_a_lamp() -> Canvas:
    """The lamp from above, its reach and its faces; and the list of its casters."""
    c = Canvas(
        760,
        374,
        "A lamp from above with its reach and four of its faces; casters with a bit for each face that may see them",
    )
    x, y, scale = 220.0, 186.0, 42.0

    def at(px: float, pz: float) -> Point:
        return x + scale * px, y + scale * pz

    c.circle(x, y, REACH * scale, "b", "line")
    wide = REACH / 2**0.5
    for sx in (-1, 1):
        for sz in (-1, 1):
            c.line([at(0, 0), at(sx * wide, sz * wide)], "line", 1.5, dashed=True)
    found = bits()
    centre, extent = boxes()
    for number, (where, half) in enumerate(zip(centre, extent, strict=True)):
        px, py = at(where[0] - half[0], where[2] - half[2])
        wide_box, high = 2 * scale * half[0], 2 * scale * half[2]
        two = found[number].count("1") > 1
        fill = "paper" if not found[number] else "d" if two else "a"
        c.box(px, py, wide_box, high, str(number), fill, 13, dashed=not found[number], round=0)
    c.circle(x, y, 5, "mark", "ink")
    for face in FACES:
        ahead = lamp_faces()[face]["ahead"]
        px, py = at(1.15 * float(ahead[0]), 1.15 * float(ahead[2]))
        c.text(px, py + 4, NAMES[face], 12, "middle", "soft")
    left, top = 470.0, 62.0
    c.text(left, 26, "the list of the lamp", 13, bold=True)
    c.text(left, top - 8, "caster", 11, role="soft")
    for place, name in enumerate(NAMES):
        c.text(left + 70 + 30 * place, top - 8, name, 11, "middle", "soft")
    row = 0
    for number, word in enumerate(found):
        if not word:
            continue
        py = top + 27 * row
        c.text(left + 14, py + 17, str(number), 13, "middle")
        for place, bit in enumerate(word):
            c.box(
                left + 57 + 30 * place,
                py,
                26,
                22,
                bit,
                ("d" if word.count("1") > 1 else "a") if bit == "1" else "paper",
                12,
                round=0,
            )
        row += 1
    left_out = [str(number) for number, word in enumerate(found) if not word]
    total = sum(word.count("1") for word in found)
    c.note(left, top + 27 * row + 22, f"left out: {', '.join(left_out)}, beyond the reach")
    c.note(left, top + 27 * row + 40, "7 is kept: the two spheres meet")
    c.note(left, top + 27 * row + 58, f"draws: {total} in place of {6 * len(found)}")
    return c
