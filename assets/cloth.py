"""Four pieces of fabric and what is in their way: one falls over a ball, one over a box, a flag and a curtain hang.

Vertices form rows, each from left to right, without seams, so that a vertex is a particle; rest lengths are those of
the modelled shape. All four begin in the air, or as they were sewn: what hangs and what falls is simulated.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from assets.gltf_writer import GltfBuilder, look_at
from assets.shapes import Float64, Mesh, box, quad, sphere, surface, tube

DETAIL = {"medium": 24, "small": 8, "large": 96}
"""Cells along an edge of the sheet that falls over the ball; the others follow it."""

SHEET, THROW = 2.2, 1.3  # metres, edges of the two squares that fall
BALL, BOX = 0.55, 0.7  # metres: radius, edge
FLAG, CURTAIN = (1.35, 0.9), (1.7, 2.1)  # metres, width and height
POLE, RAIL = (-3.35, 2.6), 2.45  # metres: x and height of the flag's pole, height of the curtain's rail


def _sheet(edge: float, cells: int) -> Mesh:
    """Return a level square about the origin, seen from above."""
    return quad((-edge / 2, 0, -edge / 2), (edge, 0, 0), (0, 0, edge), cells)


def _hanging(size: tuple[float, float], columns: int, rows: int, folds: float, depth: float) -> Mesh:
    """Return an upright rectangle from its top left corner at the origin, in `folds` waves of `depth` metres."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points: Float64 = np.stack([u * size[0], -v * size[1], depth * np.sin(2 * np.pi * folds * u)], -1)
    return surface(points, np.stack([u * size[0], v * size[1]], -1))


def _cloth(columns: int, rows: int, pins: list[int], **more: float) -> dict[str, Any]:
    """Return what a node says of its cloth of so many cells."""
    fabric = {"kg_per_m2": 0.2, "stretch_n_per_m": 600, "shear_n_per_m": 60, "bend_n_per_m": 1}
    return {
        "strata": {
            "cloth": {"columns": columns + 1, "rows": rows + 1, "pins": pins, **fabric, "damping_per_s": 1}
            | more
        }
    }


def _collider(shape: str, **more: float) -> dict[str, Any]:
    return {"strata": {"collider": {"shape": shape, **more}}}


def build(size: str = "medium") -> GltfBuilder:
    """Return the scene at a size of DETAIL, ready to be written."""
    scene, cells = GltfBuilder("cloth"), DETAIL[size]
    colors = {
        "floor": (0.32, 0.30, 0.28),
        "stone": (0.55, 0.53, 0.50),
        "linen": (0.78, 0.70, 0.55),
        "teal": (0.05, 0.32, 0.35),
        "crimson": (0.50, 0.05, 0.07),
        "saffron": (0.75, 0.42, 0.06),
        "bronze": (0.40, 0.28, 0.15),
    }
    fabrics = {"linen", "teal", "crimson", "saffron"}
    material = {
        name: scene.add_material(name, color=color, roughness=0.85, double_sided=name in fabrics)
        for name, color in colors.items()
    }

    ground = quad((-8, 0, -6), (16, 0, 0), (0, 0, 12))
    scene.add_node(
        "floor", mesh=scene.add_mesh("floor", (ground, material["floor"])), extras=_collider("plane")
    )
    ball = scene.add_mesh("ball", (sphere(BALL, 36, 18), material["stone"]))
    scene.add_node("ball", translation=(0, BALL, 0), mesh=ball, extras=_collider("sphere", radius_m=BALL))
    block = scene.add_mesh(
        "block", (box((-BOX / 2, 0, -BOX / 2), (BOX / 2, BOX, BOX / 2)), material["stone"])
    )
    scene.add_node("block", translation=(-1.65, 0, 1.7), mesh=block, extras=_collider("box"))

    sheet = scene.add_mesh("sheet", (_sheet(SHEET, cells), material["teal"]))
    scene.add_node("sheet", translation=(0.06, 1.5, 0.03), mesh=sheet, extras=_cloth(cells, cells, []))
    throw = scene.add_mesh("throw", (_sheet(THROW, cells), material["saffron"]))
    scene.add_node(
        "throw", translation=(-1.6, 1.0, 1.72), mesh=throw, extras=_cloth(cells, cells, [], thickness_m=0.02)
    )

    x, height = POLE
    pole = tube(np.array([[0, 0, 0], [0, height + 0.1, 0]]), 0.03, 10)
    scene.add_node("pole", translation=(x, 0, 0), mesh=scene.add_mesh("pole", (pole, material["bronze"])))
    half = max(4, cells * 2 // 3)
    flag = scene.add_mesh("flag", (_hanging(FLAG, cells, half, 0, 0.0), material["crimson"]))
    corners = [0, half * (cells + 1)]
    scene.add_node(
        "flag", translation=(x + 0.03, height, 0), mesh=flag,
        extras=_cloth(cells, half, corners, kg_per_m2=0.12, damping_per_s=0.5),
    )  # fmt: skip

    left = 1.75
    rail = tube(np.array([[-0.1, 0, 0], [CURTAIN[0] + 0.1, 0, 0]]), 0.025, 10)
    at = (left, RAIL + 0.03, -0.6)
    scene.add_node("rail", translation=at, mesh=scene.add_mesh("rail", (rail, material["bronze"])))
    for k, end in enumerate((-0.08, CURTAIN[0] + 0.08)):
        post = tube(np.array([[0, 0, 0], [0, at[1], 0]]), 0.03, 10)
        mesh = scene.add_mesh(f"post_{k}", (post, material["bronze"]))
        scene.add_node(f"post_{k}", translation=(left + end, 0, at[2]), mesh=mesh)
    curtain = scene.add_mesh("curtain", (_hanging(CURTAIN, cells, cells, 4, 0.06), material["linen"]))
    rings = [k for k in range(cells + 1) if k % max(1, cells // 8) == 0]
    scene.add_node(
        "curtain", translation=(left, RAIL, at[2]), mesh=curtain,
        extras=_cloth(cells, cells, rings, kg_per_m2=0.3, damping_per_s=1.5),
    )  # fmt: skip

    scene.add_light(
        "sun", "directional", (1.0, 0.96, 0.9), 20000, rotation=look_at((0, 0, 0), (-0.55, -1.0, -0.6))
    )
    scene.add_light("window", "point", (0.6, 0.75, 1.0), 9000, translation=(3.5, 3.0, 4.5), reach=30.0)
    scene.add_camera("overview", (0.1, 2.6, 7.2), (0.0, 1.05, 0.0), yfov_degrees=38.0, ev100=12.5)
    scene.add_camera("ball", (1.2, 1.9, 3.4), (0.0, 0.7, 0.0), yfov_degrees=38.0, ev100=12.5)
    scene.add_camera("flag", (-2.6, 1.9, 3.4), (-2.6, 2.1, 0.0), yfov_degrees=38.0, ev100=12.5)
    scene.add_camera("curtain", (2.5, 1.5, 3.6), (2.6, 1.3, -0.6), yfov_degrees=38.0, ev100=12.5)
    scene.gltf.scenes[0].extras = {"strata": {"ambient": 900}}
    return scene
