"""Cars, vans and buses: curved shells lofted over cross-sections, with windows, wheels and lights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from assets.city_parts import OBJECT, Parts
from assets.noise import Float64
from assets.shapes import Mesh, lathe, surface

COLORS = (
    (0.42, 0.44, 0.46), (0.45, 0.02, 0.02), (0.02, 0.06, 0.25), (0.7, 0.7, 0.68), (0.03, 0.03, 0.035),
    (0.05, 0.2, 0.12), (0.35, 0.5, 0.6), (0.5, 0.16, 0.03), (0.16, 0.02, 0.06), (0.6, 0.55, 0.4),
)  # fmt: skip
TAXI = (0.85, 0.5, 0.02)
RUBBER, CHROME, DARK = (0.018, 0.018, 0.02), (0.55, 0.56, 0.58), (0.02, 0.022, 0.025)


@dataclass(frozen=True)
class Model:
    """The side view of a car: its size, and lines over its length as (place from rear 0 to front 1, height) in metres.

    `belt` is the top of the body below the windows, `roof` the top of the cabin; the cabin lies where the roof is above
    the belt.
    """

    name: str
    length: float
    width: float
    belt: tuple[tuple[float, float], ...]
    roof: tuple[tuple[float, float], ...]
    wheel: float = 0.32
    axles: tuple[float, ...] = (0.19, 0.8)
    pillars: tuple[float, ...] = (0.28, 0.46)


MODELS = (
    Model("saloon", 4.6, 1.8, ((0, 0.86), (0.2, 0.94), (0.7, 0.92), (0.97, 0.74), (1, 0.66)),
          ((0.12, 0.92), (0.3, 1.38), (0.52, 1.42), (0.73, 0.92)), pillars=(0.34, 0.5)),
    Model("hatch", 3.9, 1.7, ((0, 0.88), (0.1, 0.94), (0.72, 0.94), (0.97, 0.76), (1, 0.68)),
          ((0.02, 0.94), (0.12, 1.42), (0.5, 1.48), (0.76, 0.94)), pillars=(0.22, 0.46)),
    Model("estate", 4.7, 1.8, ((0, 0.9), (0.1, 0.95), (0.7, 0.93), (0.97, 0.76), (1, 0.68)),
          ((0.02, 0.95), (0.09, 1.45), (0.54, 1.47), (0.74, 0.93)), pillars=(0.2, 0.38, 0.54)),
    Model("van", 5.2, 2.0, ((0, 1.15), (0.1, 1.18), (0.76, 1.16), (0.95, 0.98), (1, 0.85)),
          ((0.0, 1.2), (0.02, 2.2), (0.66, 2.25), (0.86, 1.1)), wheel=0.35, pillars=(0.3, 0.58)),
    Model("bus", 11.2, 2.5, ((0, 1.15), (0.02, 1.2), (0.98, 1.2), (1, 1.1)),
          ((0.0, 1.25), (0.01, 2.95), (0.96, 3.0), (0.999, 1.2)), wheel=0.48, axles=(0.22, 0.78),
          pillars=(0.1, 0.22, 0.34, 0.46, 0.58, 0.7, 0.82)),
)  # fmt: skip


def _shell(
    points: Float64, cells: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], colors: Float64
) -> Mesh | None:
    """Return the cells of a grid of points (R, C, 3) that are true, with the normals of the whole grid."""
    whole = surface(points, points[..., :2])
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1)[cells]
    triangles = np.stack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], 1).reshape(-1, 3)
    corner = np.round(whole.positions * 4096).astype(np.int64)[triangles]
    triangles = triangles[~(corner == np.roll(corner, 1, axis=1)).all(-1).any(-1)]
    if not len(triangles):
        return None
    # Rows that shrink to a point close the shell at its ends: there it faces along the car.
    pole = np.linalg.norm(whole.normals, axis=1) < 0.5
    normals = np.where(pole[:, None], np.sign(whole.positions[:, 2:]) * [0.0, 0.0, 1.0], whole.normals)
    used, place = np.unique(triangles, return_inverse=True)
    rgba = np.concatenate([colors.reshape(-1, 3), np.ones((len(whole.positions), 1))], 1)
    return Mesh(whole.positions[used], normals[used], place.reshape(-1, 3), colors=np.clip(rgba[used], 0, 1))


def car(model: Model, color: tuple[float, float, float], fine: int, taxi: bool = False) -> Parts:
    """Return a car that stands on the origin and looks along +z; `fine` is about a quarter of its stations."""
    parts = Parts()
    _body(parts, model, np.array(color), fine)
    _cabin(parts, model, np.array(color), fine)
    half, length = model.width / 2, model.length
    for axle in model.axles:
        for side in (-1.0, 1.0):
            wheel = _wheel(model.wheel, 6 + 4 * fine, side)
            parts.add(
                "car_paint", wheel.moved((side * (half - 0.13), model.wheel - 0.01, (axle - 0.5) * length))
            )
    y = 0.78 * model.belt[-1][1]
    front, back = length / 2 - 0.12, -length / 2 + 0.12
    for side in (-1.0, 1.0):
        x = side * (half - 0.38)
        parts.boxes("car_paint", OBJECT, (x - 0.17, y - 0.07, front - 0.2), (x + 0.17, y + 0.07, front + 0.1),
                    (0.9, 0.9, 0.85), "xXyYZ")  # fmt: skip
        parts.boxes("car_paint", OBJECT, (x - 0.14, y - 0.05, back - 0.1), (x + 0.14, y + 0.12, back + 0.2),
                    (0.4, 0.01, 0.01), "xXyYz")  # fmt: skip
    parts.boxes(
        "car_paint", OBJECT, (-0.26, 0.4, front), (0.26, 0.52, front + 0.13), (0.7, 0.7, 0.66), "xXyYZ"
    )
    if taxi:
        top = max(height for _, height in model.roof)
        low, high = (-0.19 * model.width, top - 0.03, -0.12), (0.19 * model.width, top + 0.17, 0.08)
        parts.boxes("sign", OBJECT, low, high, (1.0, 0.85, 0.4), "xXYzZ")
    return parts


def _body(parts: Parts, model: Model, color: Float64, fine: int) -> None:
    """Add the closed lower shell: rounded sections along the length, with darkness around the wheels."""
    stations = np.concatenate([[0.0, 0.0, 0.01], np.linspace(0.04, 0.96, 4 * fine), [0.99, 1.0, 1.0]])
    shrink = np.concatenate([[0.0, 0.75, 0.92], np.ones(4 * fine), [0.92, 0.75, 0.0]])
    shrink[3 : 3 + fine] = np.linspace(0.95, 1.0, fine)
    shrink[3 + 3 * fine : 3 + 4 * fine] = np.linspace(1.0, 0.94, fine)
    around = np.linspace(0, 2 * np.pi, 4 * fine + 5)
    c, s = np.cos(around), np.sin(around)
    power = 0.42
    top = np.interp(stations, *np.array(model.belt).T)
    low = 0.55 * model.wheel
    middle, tall = (top + low) / 2, (top - low) / 2
    x = -np.sign(c) * np.abs(c) ** power * (shrink * model.width / 2)[:, None]
    y = (
        middle[:, None]
        + np.sign(s) * np.abs(s) ** power * (tall * np.minimum(1, shrink + 0.04 * (shrink > 0)))[:, None]
    )
    z = np.broadcast_to(((stations - 0.5) * model.length)[:, None], x.shape)
    x[:, -1], y[:, -1] = x[:, 0], y[:, 0]
    points = np.stack([x, y, z], -1)
    near = np.min(
        [
            np.hypot(points[..., 2] - (axle - 0.5) * model.length, points[..., 1] - model.wheel)
            for axle in model.axles
        ],
        axis=0,
    )
    arch = (near < model.wheel * 1.25) & (np.abs(points[..., 0]) > 0.3 * model.width)
    sill = points[..., 1] < low + 0.12
    tones = np.where((arch | sill)[..., None], DARK, color)
    shell = _shell(points, np.ones((len(points) - 1, points.shape[1] - 1), bool), tones)
    assert shell is not None
    parts.add("car_paint", shell)


def _cabin(parts: Parts, model: Model, color: Float64, fine: int) -> None:
    """Add the shell above the belt, with windows between pillars and under the roof."""
    first, last = model.roof[0][0], model.roof[-1][0]
    breaks = [
        first,
        last,
        *(place for place, _ in model.roof),
        *model.pillars,
        *(p + 0.025 for p in model.pillars),
    ]
    stations = np.unique(np.round([*breaks, *np.linspace(first, last, 2 * fine)], 6))
    roof = np.interp(stations, *np.array(model.roof).T)
    belt = np.interp(stations, *np.array(model.belt).T) - 0.03
    up = np.array([0.0, 0.12, 0.5, 0.86, 0.96, 1.0, 1.0, 1.0, 0.96, 0.86, 0.5, 0.12, 0.0])
    out = np.array([1.0, 0.985, 0.93, 0.86, 0.8, 0.6, 0.0, -0.6, -0.8, -0.86, -0.93, -0.985, -1.0])
    rise = np.maximum(roof - belt, 0.005)[:, None]
    lean = 1 - 0.05 * rise * up  # the sides lean inwards
    x = -0.94 * model.width / 2 * out * lean
    points = np.stack(
        [x, belt[:, None] + rise * up, np.broadcast_to(((stations - 0.5) * model.length)[:, None], x.shape)],
        -1,
    )
    rows, places = len(stations) - 1, (stations[1:] + stations[:-1]) / 2
    crest = model.roof[1][0], model.roof[-2][0]
    glazed = np.zeros((rows, 12), bool)
    glazed[:, [1, 2, 9, 10]] = True  # the sides
    pillar = np.zeros(rows, bool)
    for start in (*model.pillars, crest[0] - 0.012, crest[1] - 0.012):
        pillar |= (places > start) & (places < start + 0.025)
    glazed[pillar] = False
    slope = (places > crest[1]) | (places < crest[0])
    glazed[slope, 3:9] = True  # windscreen and rear window
    glazed[slope] &= ~np.isin(np.arange(12), (0, 1, 10, 11))
    tones = np.broadcast_to(color, points.shape)
    for material, cells, colors in (
        ("car_paint", ~glazed, tones),
        ("window", glazed, np.broadcast_to(0.45 + 0.3 * color, points.shape)),
    ):
        shell = _shell(points, cells, colors)
        if shell is not None:
            _, y, z = shell.positions.T  # a dark pane of the picture, over the whole car
            uv = np.stack([0.63 + 0.2 * z / model.length, 0.48 - 0.07 * y], -1)
            parts.add(
                material, Mesh(shell.positions, shell.normals, shell.triangles, uv, colors=shell.colors)
            )


def _wheel(radius: float, sides: int, side: float) -> Mesh:
    """Return a wheel about its middle, turned outwards to +x or -x."""
    tyre = lathe([[(0.62 * radius, 0.1), (0.94 * radius, 0.12), (radius, 0.06), (radius, -0.08)]], sides)
    rim = lathe([[(0.0, 0.1), (0.2 * radius, 0.1), (0.62 * radius, 0.07), (0.62 * radius, 0.1)]], sides)
    turn = np.array([[0, side, 0], [0, 0, 1], [side, 0, 0]], np.float64)
    both = [tyre.painted(RUBBER), rim.painted(CHROME)]
    count = len(tyre.positions)
    points = np.concatenate([mesh.positions for mesh in both]) @ turn.T
    normals = np.concatenate([mesh.normals for mesh in both]) @ turn.T
    triangles = np.concatenate([tyre.triangles, rim.triangles + count])
    if np.linalg.det(turn) < 0:
        triangles = triangles[:, ::-1]
    colors = np.concatenate([mesh.colors for mesh in both if mesh.colors is not None])
    return Mesh(points, normals, triangles, colors=colors)
