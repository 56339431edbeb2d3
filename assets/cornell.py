"""The Cornell box: the room in which every global-illumination method is first looked at.

Proportions and reflectances follow the measured data published by the Cornell University Program of Computer Graphics
(a room of about 555 units, two blocks, a red and a green wall). Here a unit is five millimetres, y is up and the camera
looks along -z, so that the red wall is on the left.
"""

from __future__ import annotations

import math

import numpy as np

from assets.gltf_writer import GltfBuilder
from assets.shapes import Mesh, box, join, quad, surface

UNIT = 0.005  # metres; the room is 2.775 m wide, high and deep
HALF, WALL = 277.5, 10.0  # half the room and the thickness of a wall, in units
LIGHT_NITS = 1500.0
LIGHT_CORNERS = ((213.0, 227.0), (343.0, 332.0))  # x and z of the original data

WHITE, RED, GREEN = (0.73, 0.73, 0.73), (0.61, 0.05, 0.05), (0.12, 0.45, 0.15)
SHORT_BLOCK = ((130, 65), (82, 225), (240, 272), (290, 114)), 165.0  # corners on the floor (x, z) and height
TALL_BLOCK = ((423, 247), (265, 296), (314, 456), (472, 406)), 330.0


def _ours(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a point of the original data in our axes: turned half around y, centred on the floor, in metres."""
    return ((HALF - x) * UNIT, y * UNIT, (HALF - z) * UNIT)


def _slab(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    return box([UNIT * v for v in low], [UNIT * v for v in high])


def _block(corners: tuple[tuple[float, float], ...], height: float) -> Mesh:
    """Return a block on the floor: four sides and a top; the open bottom lies on the floor."""
    foot = np.array([_ours(x, 0.0, z) for x, z in corners])
    outline = np.array([[p[0], p[2]] for p in foot])
    following = np.roll(outline, -1, axis=0)
    signed_area = (outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]).sum()
    if signed_area > 0:  # in (x, z) a positive area runs clockwise seen from above
        foot = foot[::-1]
    up = np.array([0.0, height * UNIT, 0.0])
    sides = [quad(a + up, b - a, -up) for a, b in zip(foot, np.roll(foot, -1, axis=0), strict=True)]
    top = np.array([[foot[3], foot[2]], [foot[0], foot[1]]]) + up
    return join(*sides, surface(top, np.array([[[0.0, 0.0], [1.0, 0.0]], [[0.0, 1.0], [1.0, 1.0]]])))


def build() -> GltfBuilder:
    """Return the scene, ready to be written."""
    scene = GltfBuilder("cornell")
    white, red, green = (
        scene.add_material(name, color=color, roughness=1.0)
        for name, color in (("white", WHITE), ("red", RED), ("green", GREEN))
    )
    glow = scene.add_material(
        "light", color=(0.0, 0.0, 0.0), emissive_nits=(LIGHT_NITS, LIGHT_NITS * 0.75, LIGHT_NITS * 0.4)
    )
    h, t, top = HALF, WALL, 2 * HALF
    room = scene.add_node("room")
    shell = join(
        _slab((-h - t, -t, -h - t), (h + t, 0, h)),  # floor
        _slab((-h - t, top, -h - t), (h + t, top + t, h)),  # ceiling
        _slab((-h - t, 0, -h - t), (h + t, top, -h)),  # back wall
    )
    scene.add_node("shell", room, mesh=scene.add_mesh("shell", (shell, white)))
    left = scene.add_mesh("left_wall", (_slab((-h - t, 0, -h), (-h, top, h)), red))
    right = scene.add_mesh("right_wall", (_slab((h, 0, -h), (h + t, top, h)), green))
    scene.add_node("left_wall", room, mesh=left)
    scene.add_node("right_wall", room, mesh=right)
    for name, block in (("short_block", SHORT_BLOCK), ("tall_block", TALL_BLOCK)):
        scene.add_node(name, mesh=scene.add_mesh(name, (_block(*block), white)))

    (x0, z0), (x1, z1) = LIGHT_CORNERS
    below_ceiling = top - 1.0
    corner = np.array(_ours(x1, below_ceiling, z0))
    width, depth = (x1 - x0) * UNIT, (z1 - z0) * UNIT
    lamp = quad(corner, (width, 0, 0), (0, 0, -depth))
    light = scene.add_node("light", mesh=scene.add_mesh("light", (lamp, glow)))
    centre = _ours((x0 + x1) / 2, below_ceiling - 1.0, (z0 + z1) / 2)
    # A forward renderer does not gather light from surfaces: this lamp has the intensity that the square has straight
    # down, luminance times area. A path tracer leaves it out, since it finds the square itself.
    scene.add_light(
        "stand_in_for_light",
        "spot",
        color=(1.0, 0.75, 0.4),
        intensity=LIGHT_NITS * width * depth,
        translation=centre,
        rotation=(-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)),
        cone_degrees=(0.0, 88.0),
    )
    scene.gltf.nodes[-1].extras = {"strata": {"stands_for": scene.gltf.nodes[light].name}}
    scene.add_camera("overview", _ours(278, 273, -800), _ours(278, 273, 0), yfov_degrees=39.3, ev100=4.5)
    scene.gltf.scenes[0].extras = {"strata": {"ambient": 4}}
    return scene
