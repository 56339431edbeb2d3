"""The named views of the city: sixteen at eye height in its streets, some from above, and its plan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assets.city_plan import BLOCK, KERB, PAVEMENT, Block, Plan
from assets.gltf_writer import GltfBuilder
from assets.noise import Float64

EYE = 1.7
"""Metres from the ground to the eye of a walker."""

EV100 = 14.2
Point = tuple[float, float, float]


@dataclass(frozen=True)
class View:
    """A camera: its name, where it stands, what it looks at, and its vertical field of view in degrees."""

    name: str
    eye: Point
    target: Point
    yfov: float = 58.0


def _ahead(eye: Point, direction: tuple[float, float], rise: float = 0.06) -> Point:
    """Return a point 20 m ahead in a direction (x, z), which need not have length 1."""
    x, z = np.array(direction) / np.hypot(*direction)
    return eye[0] + 20 * float(x), eye[1] + 20 * rise, eye[2] + 20 * float(z)


def _along(
    name: str,
    at: tuple[float, float],
    direction: tuple[float, float],
    rise: float = 0.06,
    base: float = 0.0,
    yfov: float = 58.0,
) -> View:
    eye = (at[0], base + EYE, at[1])
    return View(name, eye, _ahead(eye, direction, rise), yfov)


def _crossing(plan: Plan) -> tuple[int, int]:
    """Return a crossing with a block towards +x and +z, and houses on all sides if there is one, near the middle."""
    kinds = {(block.column, block.row): block.kind for block in plan.blocks}

    def rank(place: tuple[int, int]) -> tuple[int, float]:
        i, j = place
        houses = [kinds.get((i - di, j - dj)) == "houses" for di in (0, 1) for dj in (0, 1)]
        return -sum(houses), abs(i - plan.columns / 2) + abs(j - plan.rows / 2)

    return min(((i, j) for j in range(plan.rows) for i in range(plan.columns)), key=rank)


def street_views(plan: Plan) -> list[View]:
    """Return the views at street level, in any plan: on carriageways and pavements, outside of all buildings."""
    xs, zs = [x for x, _ in plan.road_x], [z for z, _ in plan.road_z]
    a, b = _crossing(plan)
    x, z, wide_x, wide_z = xs[a], zs[b], plan.road_x[a][1] / 2, plan.road_z[b][1] / 2
    next_x, last_x, last_z = xs[a + 1], xs[-1], zs[-1]
    up = -0.9 if b else 0.45  # towards the other side of the street, if there is one
    inner = 1.2  # metres from a kerb to where people walk
    views = [
        _along("street-1", (next_x - plan.road_x[a + 1][1] / 2 - 5.0, z + 0.4), (-1.0, 0.1), 0.12),
        _along("street-2", (x, z + wide_z + 6.0), (0.05, 1.0), 0.1),
        _along("street-3", (x + wide_x + 5.0, z), (1.0, -0.04), 0.1),
        _along("street-4", (x - 0.5 * wide_x, z - wide_z - 1.5), (0.3, 1.0), 0.14),
        _along("street-5", (x + wide_x + inner, z + wide_z + 9.0), (0.3, 1.0), 0.5, KERB, 70.0),
        _along("street-6", (x + wide_x + 9.0, z + wide_z + inner), (1.0, up), 0.45, KERB, 70.0),
        _along("street-7", (last_x - plan.road_x[-1][1] / 2 - 2.0, last_z - 0.5), (-1.0, 0.0), 0.1),
        _along("street-8", (xs[0] + 0.5, zs[0] + 3.0), (0.1, 1.0), 0.12),
        _along("street-9", (x + 0.5, last_z + 0.5), (0.3, -1.0), 0.12),
        _along("street-10", (xs[0] - 0.5, z + 0.5), (1.0, 0.28), 0.12),
        _along("street-11", (xs[1], zs[0] + plan.road_z[0][1] / 2 + 2.0), (-1.0, 0.75), 0.22),
        _along("street-12", (xs[-2] + 0.3, last_z - 14.0), (0.12, -1.0), 0.08),
    ]
    shop = (x + wide_x + PAVEMENT + 16.0, z - wide_z + 1.2)
    return [*views, *_places(plan, a, b), _along("street-16", shop, (0.35, 1.0), 0.08)]


def _places(plan: Plan, a: int, b: int) -> list[View]:
    """Return street-13 to street-15: the church, a tower, a park; or corners of streets where there are none."""
    squares, towers, parks = (plan.of_kind(kind) for kind in ("square", "tower", "park"))

    def corner(name: str, i: int, j: int, direction: tuple[float, float]) -> View:
        return _along(name, (plan.road_x[i][0] + 0.6, plan.road_z[j][0] + 0.8), direction, 0.3)

    def inside(block: Block, x: float, z: float) -> Point:
        return block.x + x, KERB + EYE, block.z + z

    views = [
        corner("street-13", a, b, (1.0, 0.9)),
        corner("street-14", a + 1, b + 1, (-1.0, -0.9)),
        corner("street-15", 0, b, (0.9, -1.0 if b else 1.0)),
    ]
    if squares:  # from the far side of the carriageway before the church
        square = squares[0]
        eye = square.x - PAVEMENT - plan.road_x[square.column][1] + 1.0, EYE, square.z + 34.0
        views[0] = View("street-13", eye, (eye[0] + 28.0, eye[1] + 9.5, eye[2] - 11.0), 72.0)
    if towers:
        eye = inside(towers[0], 5.0, 37.0)
        views[1] = View("street-14", eye, (eye[0] + 14.0, eye[1] + 15.0, eye[2] - 11.0), 74.0)
    if parks:
        views[2] = View("street-15", inside(parks[0], 12.0, 22.0), inside(parks[0], 30.0, 21.0))
    return views


def high_views(plan: Plan) -> list[View]:
    """Return the views from above: two over roofs, and two of the whole."""
    hx, hz = plan.half
    houses = plan.of_kind("houses")
    first, last = houses[0], houses[-1]
    views = []
    for name, block, way in (("roof-1", first, (1.0, 0.55)), ("roof-2", last, (-1.0, -0.8))):
        top = max(lot.eave for lot in block.lots)
        eye = (block.x + BLOCK[0] / 2, top + 7.0, block.z + BLOCK[1] / 2)
        views.append(View(name, eye, _ahead(eye, way, -0.22), 60.0))
    views.append(View("bird-1", (hx * 0.95, 26 + 0.45 * hx, hz * 1.05), (0.0, 0.0, -0.1 * hz), 50.0))
    views.append(View("bird-2", (-hx * 0.9, 14 + 0.28 * hx, hz * 0.4), (0.0, 8.0, -0.1 * hz), 55.0))
    return views


def eyes(plan: Plan) -> Float64:
    """Return where the cameras stand, (N, 3)."""
    return np.array([view.eye for view in (*street_views(plan), *high_views(plan))])


def add_views(scene: GltfBuilder, plan: Plan) -> None:
    """Add all views as cameras; the first is the one that is shown when none is asked for."""
    group = scene.add_node("cameras")
    for view in (*street_views(plan), *high_views(plan)):
        scene.add_camera(view.name, view.eye, view.target, view.yfov, EV100, parent=group)
    half = float(max(plan.half[1], plan.half[0] * 9 / 16)) + 6.0
    scene.add_plan_camera("plan", (0.0, 90.0, 0.0), half, 100.0, EV100, parent=group)
