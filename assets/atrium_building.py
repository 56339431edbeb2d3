"""The building of the atrium: four sides of arcade on two storeys around a court, made of few shared meshes.

The court measures 12 x 7.2 m between the axes of its columns: five and three bays of 2.4 m. Every side is modelled in
its own frame (x along the side, z = 0 on the column axis, +z towards the court) and turned into place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from assets.noise import Bytes, Float64, bytes_of
from assets.shapes import Mesh, arc, box, join, lathe, quad, rotation_y, surface

BAY = 2.4
GALLERY = 2.4  # from the column axis to the back wall
HALF_X, HALF_Z = 6.0, 3.6  # column axes
WALL = 0.4  # thickness of outer walls and ground arches
UPPER_WALL = 0.24
STEP = 0.15  # the gallery's floor above the court's
SPRING, CEILING = 2.55, 3.85  # of the ground storey
UPPER_FLOOR, UPPER_SPRING, UPPER_CEILING = 4.15, 6.05, 6.85
EAVE, RIDGE = 7.05, 8.2  # heights of the roof's lower and upper edge
OVERHANG = 0.45
STONE, MOSAIC, PLASTER, PLANKS, PAVING, TILES = (
    1 / 1.2,
    2.0,
    1 / 3,
    1.25,
    1 / 2.4,
    1 / 1.2,
)  # repeats per metre

# Turn about y, position, length and number of bays of each side; north is -z.
SIDES = {
    "north": (0.0, (0.0, 0.0, -HALF_Z), 5),
    "east": (-90.0, (HALF_X, 0.0, 0.0), 3),
    "south": (180.0, (0.0, 0.0, HALF_Z), 5),
    "west": (90.0, (-HALF_X, 0.0, 0.0), 3),
}


@dataclass(frozen=True)
class Detail:
    """How finely the atrium is made."""

    texture_px: int  # of the finest textures
    column_segments: int
    curve_steps: int  # of each moulding; 0 leaves the smallest ornament out
    voussoirs: int  # of a ground arch
    arch_steps: int  # per voussoir
    cloth: tuple[int, int]  # cells across and down a banner
    plenty: float  # share of twigs, fruit and pebbles
    round_segments: int  # of pots, bowls, hoops
    carved: bool  # tiles of the roof and blocks under the cornice are modelled


DETAILS = {
    "small": Detail(256, 5, 0, 5, 1, (4, 6), 0.25, 6, False),
    "medium": Detail(512, 12, 2, 13, 1, (12, 20), 1.0, 12, False),
    "large": Detail(512, 40, 7, 17, 4, (48, 72), 5.0, 44, True),
}


def side_frame(side: str) -> tuple[Float64, Float64]:
    """Return rotation (3, 3) and position (3,) of a side's frame in the building."""
    degrees, position, _ = SIDES[side]
    return rotation_y(degrees), np.array(position)


def placed(mesh: Mesh, side: str) -> Mesh:
    """Return a mesh of a side's frame in the building's frame."""
    rotation, position = side_frame(side)
    return mesh.turned(rotation).moved(position)


# -- occlusion over the plan -------------------------------------------------------------------------------------


def plan_uv(mesh: Mesh) -> Mesh:
    """Return the mesh with a second uv set that looks down on the building's plan."""
    reach = np.array([HALF_X, HALF_Z]) + GALLERY + 0.3
    return replace(mesh, uv1=(mesh.positions[:, [0, 2]] / reach + 1) / 2)


def plan_occlusion(px: int) -> Bytes:
    """Return (5/8 px, px) how open the plan is: light in the court, dark at the back of the galleries and near columns.

    A stand-in for an occlusion bake, by a formula: openness falls with the distance from the court's edge, which
    approximates the share of the sky that an arcade lets through.
    """
    reach = np.array([HALF_X, HALF_Z]) + GALLERY + 0.3
    x = ((np.arange(px) + 0.5) / px * 2 - 1) * reach[0]
    z = ((np.arange(px * 5 // 8) + 0.5)[:, None] / (px * 5 // 8) * 2 - 1) * reach[1]
    outside = np.hypot(np.maximum(np.abs(x) - HALF_X, 0), np.maximum(np.abs(z) - HALF_Z, 0))
    inside = np.maximum(np.minimum(HALF_X - np.abs(x), HALF_Z - np.abs(z)), 0)
    openness = np.where(
        outside > 0, 0.34 + 0.42 / (1 + (outside * 0.9) ** 2), 1.0 - 0.30 * np.exp(-inside / 0.9)
    )
    for cx, cz in column_places():
        openness = openness * (1 - 0.45 * np.exp(-(((x - cx) ** 2 + (z - cz) ** 2) / 0.34**2)))
    openness = openness * (
        1 - 0.5 * np.exp(-np.maximum(np.hypot(x, z) - 1.2, 0) / 0.25) * (np.hypot(x, z) > 1.1)
    )
    return bytes_of(openness)


def column_places() -> list[tuple[float, float]]:
    """Return (x, z) of the ground storey's columns and corner piers."""
    long = [((k - 2.5) * BAY, s * HALF_Z) for s in (-1, 1) for k in range(6)]
    short = [(s * HALF_X, (k - 1.5) * BAY) for s in (-1, 1) for k in (1, 2)]
    return long + short


# -- shared meshes, each about its own origin --------------------------------------------------------------------


def column(detail: Detail, height: float, radius: float, plinth: float) -> Mesh:
    """Return a column standing on the origin: square plinth, base, tapering shaft, capital and abacus."""
    n, top, half = detail.curve_steps, height - 0.5 * plinth, plinth / 2
    low, neck, wide, narrow = 0.28 * plinth, height - 1.15 * plinth, 0.98 * plinth / 2, 0.90 * radius
    bend = np.radians(np.linspace(0, 90, 2 * n + 1))
    bell = np.stack([wide - (wide - narrow) * np.sin(bend), top - (top - neck) * (1 - np.cos(bend))], -1)
    profile = [
        [tuple(point) for point in bell],
        arc((narrow, neck - 0.12 * radius), 0.13 * radius, 90, -90, n + 1),
        [(narrow, neck - 0.24 * radius), (radius * 0.98, 0.5 * (neck + low)), (radius, low + 0.5 * half)],
        arc((radius, low + 0.39 * half), 0.11 * half, 90, -90, n + 1),
        arc((radius * 1.04, low + 0.14 * half), 0.14 * half, 90, -90, n + 1),
    ]
    if n == 0:
        profile = [[(wide, top), (narrow, neck)], [(narrow, neck), (radius, low)]]
    around = max(1.0, round(2 * np.pi * radius * STONE))
    shaft = lathe(profile, detail.column_segments, (around, STONE))
    foot = box((-half, 0, -half), (half, low, half), "xXYzZ").with_uv(STONE)
    abacus = box((-half, top, -half), (half, height, half), "xXyzZ").with_uv(STONE)
    return join(shaft, foot, abacus)


def spandrel(radius: float, half: float, top: float, thickness: float, steps: int) -> Mesh:
    """Return the wall of one bay above the springing, outside the ring of an arch of `radius`; `top` is its height."""
    angle = np.linspace(np.pi, 0.0, steps + 1)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    y[0] = y[-1] = 0.0
    if radius < half:
        x, y = np.concatenate([[-half], x, [half]]), np.concatenate([[0.0], y, [0.0]])
    z = np.full_like(x, thickness / 2)
    front = np.stack([np.stack([x, np.full_like(x, top), z], -1), np.stack([x, y, z], -1)])
    uv = np.stack([front[..., 0], -front[..., 1]], -1) * STONE
    face = surface(front, uv)
    return join(face, face.turned(rotation_y(180)))


def arch_ring(radius: float, depth: float, thickness: float, count: int, steps: int) -> Mesh:
    """Return an arch of wedges, red and cream in turn by vertex colour, standing out of the wall on both faces."""
    red, cream = (0.62, 0.24, 0.16), (1.0, 0.95, 0.86)
    edges = np.linspace(np.pi, 0.0, count + 1)
    parts = []
    for k in range(count):
        angle = np.linspace(edges[k], edges[k + 1], steps + 1)
        out = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
        inner, outer = out * radius, out * (radius + depth)
        z = np.array([0.0, 0.0, thickness / 2])
        arc_uv = np.stack([angle * -radius, np.zeros_like(angle)], -1) * STONE
        down = np.array([0.0, 1.0]) * STONE
        front = surface(np.stack([outer + z, inner + z]), np.stack([arc_uv, arc_uv + down * depth]))
        soffit = surface(np.stack([inner + z, inner - z]), np.stack([arc_uv, arc_uv + down * thickness]))
        back_edge = surface(np.stack([outer - z, outer + z]), np.stack([arc_uv, arc_uv + down * thickness]))
        wedge = join(front, front.turned(rotation_y(180)), soffit, back_edge)
        parts.append(wedge.painted(red if k % 2 else cream))
    return join(*parts)


def ceiling_bay(width: float, beams: int) -> Mesh:
    """Return planks and beams over one bay of a gallery, seen from below, the planks' face at y = 0."""
    near, far = -UPPER_WALL / 2, -GALLERY
    planks = quad((-width / 2, 0, near), (width, 0, 0), (0, 0, far - near))
    parts = [planks.with_uv(PLANKS)]
    for k in range(beams):
        x = (k + 0.5) * width / beams - width / 2
        sides = box((x - 0.06, -0.17, far), (x + 0.06, 0.0, near), "xX").with_turned_uv()
        beam = join(sides, box((x - 0.06, -0.17, far), (x + 0.06, 0.0, near), "y"))  # the grain runs along v
        parts.append(beam.with_uv(PLANKS))
    return join(*parts)


def railing() -> tuple[Mesh, Mesh]:
    """Return rails (stone) and lattice (iron) of half a bay between two upper columns, standing on the origin."""
    rails = join(
        box((-0.6, 0, -0.06), (0.6, 0.12, 0.06), "yYzZ"), box((-0.6, 0.90, -0.07), (0.6, 1.0, 0.07), "yYzZ")
    )
    panel = quad((-0.6, 0.90, 0), (1.2, 0, 0), (0, -0.78, 0)).with_uv((1 / 1.2, 1 / 0.78))
    return rails.with_uv(STONE), panel


def door(panelled: bool) -> tuple[Mesh, Mesh]:
    """Return frame (stone) and leaves (wood) of a double door standing on the origin before a wall at z = 0."""
    frame = join(
        box((-0.72, 0, 0), (-0.55, 2.25, 0.10), "xXYZ"),
        box((0.55, 0, 0), (0.72, 2.25, 0.10), "xXYZ"),
        box((-0.80, 2.25, 0), (0.80, 2.48, 0.15), "xXyYZ"),
    )
    panels = [quad((-0.55, 2.25, 0.055), (1.10, 0, 0), (0, -2.25, 0))]
    for x in (-0.28, 0.28) if panelled else ():
        for y, height in ((0.12, 0.62), (0.86, 1.25)):
            panels.append(box((x - 0.19, y, 0.055), (x + 0.19, y + height, 0.08), "xXyYZ"))
    return frame.with_uv(STONE), join(*panels).with_uv(PLANKS)
