"""A grid of spheres, rough to the right and more metallic downwards: one look tells whether a BRDF is sane."""

from __future__ import annotations

import numpy as np

from assets.gltf_writer import GltfBuilder, look_at
from assets.shapes import quad, sphere

COLUMNS, ROWS = 7, 5
RADIUS, SPACING = 0.42, 1.0  # metres
COLOR = (0.91, 0.48, 0.31)  # copper-like, so that metals tint their highlights and dielectrics do not


def build() -> GltfBuilder:
    """Return the scene, ready to be written: one shared sphere, one material per node's own mesh."""
    scene = GltfBuilder("spheres")
    grid = scene.add_node("grid")
    ball = None
    for row in range(ROWS):
        metallic = row / (ROWS - 1)
        line = scene.add_node(
            f"metallic_{metallic:.2f}", grid, translation=(0, (ROWS - 1 - row) * SPACING + 0.5, 0)
        )
        for column in range(COLUMNS):
            # 0.05 rather than 0: a mirror shows nothing at all under punctual lights.
            roughness = 0.05 + 0.95 * column / (COLUMNS - 1)
            name = f"metallic_{metallic:.2f}_roughness_{roughness:.2f}"
            material = scene.add_material(name, color=COLOR, metallic=metallic, roughness=roughness)
            ball = ball or scene.add_geometry(sphere(RADIUS, 36, 18), material)
            x = (column - (COLUMNS - 1) / 2) * SPACING
            scene.add_node(name, line, translation=(x, 0, 0), mesh=scene.add_mesh_of(name, (ball, material)))
    grey = scene.add_material("backdrop", color=(0.18, 0.18, 0.18), roughness=0.9)
    width, height = 40.0, 24.0
    wall = quad((-width / 2, height, -2.5), (width, 0, 0), (0, -height, 0))
    floor = quad((-width / 2, 0, -2.5), (width, 0, 0), (0, 0, 20.0))
    scene.add_node("wall", mesh=scene.add_mesh("wall", (wall, grey)))
    scene.add_node("floor", mesh=scene.add_mesh("floor", (floor, grey)))

    scene.add_light(
        "key", "directional", (1.0, 0.96, 0.9), 2000, rotation=look_at((0, 0, 0), (0.5, -0.75, -0.8))
    )
    scene.add_light("fill", "point", (0.6, 0.75, 1.0), 9000, translation=(-6.0, 4.0, 5.0), reach=40.0)
    rim = (4.5, 6.5, 4.0)
    scene.add_light(
        "rim", "spot", (1.0, 0.7, 0.5), 16000, translation=rim, rotation=look_at(rim, (1.5, 2.5, 0)),
        reach=40.0, cone_degrees=(18.0, 30.0),
    )  # fmt: skip
    middle = (0.0, ROWS * SPACING / 2, 0.0)
    scene.add_camera("overview", np.add(middle, (0, 0.25, 9.6)), middle, yfov_degrees=34.0, ev100=9.0)
    scene.gltf.scenes[0].extras = {"strata": {"ambient": 60}}
    return scene
