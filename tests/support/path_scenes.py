"""Scenes that tests trace by paths, and the light of a square by quadrature."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.environment import Environment
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material, Scene
from common.view.camera import Orthographic, Perspective, View
from tests.support.path_pictures import SIZE
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import box, placed, point, spot, sun, yard
from tests.twins.shading import metallic_roughness

Float64 = NDArray[np.float64]

MATTE = Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=1.0, metallic=0.0, double_sided=True)
ABOVE = View(pose_looking_at((0.0, 3.0, 0.0), (0.0, 0.0, 0.0), (0, 0, -1)), Orthographic(1.0, 0.1, 9.0))
AROUND = View(pose_looking_at((2.5, 2.5, 3.5), (0.0, 0.6, 0.0)), Orthographic(2.0, 0.1, 20.0))
CORNER = View(pose_looking_at((2.6, 1.9, 3.2), (0.0, 0.5, 0.0)), Perspective(0.8, 0.05))


def lit_yard(*more: tuple[Light, Float64]) -> Scene:
    """Return a ground with a floating cube, and lights of all kinds."""
    lamps = (
        point((-1.5, 2.5, 0.8)),
        spot((1.5, 3.0, 1.0), (0.0, 0.5, 0.0)),
        sun((-0.3, -1.0, -0.5), lux=2.0),
    )
    return yard(*lamps, *more, material=MATTE)


def places(view: View, size: tuple[int, int] = SIZE) -> Float64:
    """Return (H, W, 2) x and z of the pixels' centres on the ground, for ABOVE."""
    width, height = size
    rows, columns = np.mgrid[:height, :width] + 0.5
    assert isinstance(view.projection, Orthographic), "it looks straight down"
    half = view.projection.ymag
    return np.stack(
        [(2 * columns / width - 1) * half * width / height, (2 * rows / height - 1) * half], axis=-1
    )


def floor_under(lamp: Material, half: float = 0.4, height: float = 1.0) -> Scene:
    """Return a ground of 8x8 metres, and above it a square of edge 2 `half` that faces down, of material `lamp`."""
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((0, height, 0), (2 * half, 2 * half), (0, -1, 0)))
    return quad_scene(materials=(MATTE, lamp), matrices=squares, instance_materials=(0, 1))


def light_of_square(
    emission: Callable[[Float64, Float64], Float64], half: float = 0.4, height: float = 1.0, nodes: int = 24
) -> Float64:
    """Return (H, W, 3) what the ground of `floor_under` reflects to ABOVE: a quadrature over the square.

    `emission` returns the light (..., 3) that points (..., 3) of the square send against the directions (..., 3).
    """
    at, weight = np.polynomial.legendre.leggauss(nodes)
    x, z = np.meshgrid(half * at, half * at)
    area = (half * half * np.outer(weight, weight)).reshape(-1)
    lamp = np.stack([x, np.full_like(x, height), z], axis=-1).reshape(-1, 3)
    ground = np.insert(places(ABOVE), 1, 0.0, axis=-1)
    towards = lamp - ground[..., None, :]
    distance = np.linalg.norm(towards, axis=-1)
    direction = towards / distance[..., None]
    up = np.broadcast_to((0.0, 1.0, 0.0), direction.shape)
    base = np.broadcast_to(MATTE.base_color[:3], direction.shape)
    value = metallic_roughness(up, direction, up, base, np.zeros(distance.shape), np.ones(distance.shape))
    arrives = emission(lamp, direction) * (direction[..., 1] / distance**2 * area)[..., None]
    return np.asarray((value * arrives).sum(axis=-2))


def sky() -> Environment:
    """Return an environment with a bright spot, and light that differs by direction."""
    rows, columns = np.mgrid[:16, :32]
    texels = np.stack([rows / 16.0, 0.5 + 0.4 * np.sin(columns / 5.0), np.full((16, 32), 0.3)], axis=-1)
    texels[4, 9] = (45.0, 40.0, 30.0)
    return Environment("sky", (0.3 * texels).astype(np.float32))


def room() -> Scene:
    """Return a ground, a cube of smooth metal, a pane that lets light through, an emissive square, and two lights."""
    grey = Material(base_color=(0.7, 0.6, 0.5, 1.0), roughness=0.9, metallic=0.0, double_sided=True)
    metal = Material(base_color=(0.9, 0.7, 0.4, 1.0), roughness=0.4, metallic=1.0)
    pane = Material(
        base_color=(0.2, 0.5, 0.9, 0.4), roughness=0.6, metallic=0.0, alpha_mode="blend", double_sided=True
    )
    glow = Material(base_color=(0.1, 0.1, 0.1, 1.0), emissive=(6.0, 4.0, 2.0), roughness=0.8, metallic=0.0)
    squares = [
        placed((0, 0, 0), (5, 5), (0, 1, 0)),
        *box((-0.4, 0.5, -0.3), 0.9),
        placed((0.9, 0.6, 0.4), (0.9, 1.1), (0.6, 0, 1)),
        placed((0.6, 1.9, -0.6), (0.7, 0.7), (-0.2, -1.0, 0.3)),
    ]
    kinds = (0, *(1,) * 6, 2, 3)
    scene = quad_scene(materials=(grey, metal, pane, glow), matrices=tuple(squares), instance_materials=kinds)
    lamps = [point((-1.2, 1.6, 1.2), candela=4.0), sun((0.4, -1.0, -0.3), lux=1.5)]
    nodes = nodes_at(*squares, *(pose for _, pose in lamps))
    lights = [replace(lamp, node=len(squares) + place) for place, (lamp, _) in enumerate(lamps)]
    return replace(scene, nodes=nodes, lights=lights, environment=sky())
