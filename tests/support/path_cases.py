"""Scenes whose materials, lights and media our path tracer and Mitsuba 3 have alike (see `mitsuba_paths`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.environment import Environment, constant
from common.environment.directions import panorama_directions
from common.numerics.transforms import pose_looking_at
from common.scene import FogBox, Light, Material, Medium, Scene
from common.view.camera import Orthographic, Perspective, View
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import box, placed, point, sun

Float64 = NDArray[np.float64]
Square = tuple[Float64, Material]

YFOV = 0.8
EDGE = math.radians(28.0)


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, a view, settings of our renderer, and what of them `mitsuba_paths.scene_parts` must be told."""

    name: str
    scene: Callable[[], Scene]
    view: View
    bounces: int
    ours: dict[str, Any] = field(default_factory=dict)
    theirs: dict[str, Any] = field(default_factory=dict)


def metal(red: float, green: float, blue: float, roughness: float, **more: Any) -> Material:
    """Return a metal that both of its sides show."""
    return Material(
        base_color=(red, green, blue, 1.0), metallic=1.0, roughness=roughness, double_sided=True, **more
    )


def glow(red: float, green: float, blue: float, both: bool = False) -> Material:
    """Return a surface that emits from its front, or from both of its sides, and reflects as rough white metal."""
    return replace(metal(1.0, 1.0, 1.0, 0.7), emissive=(red, green, blue), double_sided=both)


def scene_of(
    squares: Sequence[Square],
    lights: Sequence[tuple[Light, Float64]] = (),
    environment: Environment | None = None,
    medium: Medium | None = None,
) -> Scene:
    """Return squares with their materials, and lights with their poses."""
    matrices = tuple(matrix for matrix, _ in squares)
    scene = quad_scene(
        materials=tuple(material for _, material in squares),
        matrices=matrices,
        instance_materials=tuple(range(len(squares))),
    )
    nodes = nodes_at(*matrices, *(pose for _, pose in lights))
    shown = [replace(light, node=len(squares) + number) for number, (light, _) in enumerate(lights)]
    return replace(scene, nodes=nodes, lights=shown, environment=environment, medium=medium)


def cube(at: tuple[float, float, float], edge: float, material: Material) -> list[Square]:
    """Return the six sides of a cube."""
    return [(matrix, material) for matrix in box(at, edge)]


def ground(material: Material) -> Square:
    """Return a square of 6 metres at height 0."""
    return placed((0, 0, 0), (6, 6), (0, 1, 0)), material


def chamber(
    floor: Material, wall: Material, left: Material, right: Material, block: Material
) -> list[Square]:
    """Return a room of 2 metres with its floor at height 0, open to the front, with a cube in it."""
    size = (2.0, 2.0)
    return [
        (placed((0, 0, 0), size, (0, 1, 0)), floor),
        (placed((0, 2, 0), size, (0, -1, 0)), wall),
        (placed((0, 1, -1), size, (0, 0, 1)), wall),
        (placed((-1, 1, 0), size, (1, 0, 0)), left),
        (placed((1, 1, 0), size, (-1, 0, 0)), right),
        *cube((0.3, 0.35, -0.2), 0.7, block),
    ]


def lamp(
    edge: float, nits: tuple[float, float, float], at: tuple[float, float, float] = (0, 1.98, 0)
) -> Square:
    """Return an emissive square that faces down."""
    return placed(at, (edge, edge), (0, -1, 0)), glow(*nits)


def sky(peak: float = 20.0, width: float = 12.0) -> Environment:
    """Return a smooth environment: light that differs by direction, and a wide sun."""
    d = panorama_directions(256)
    towards = np.array((0.5, 0.6, 0.4)) / np.linalg.norm((0.5, 0.6, 0.4))
    light = peak * np.exp(width * (d @ towards - 1.0))[..., None] * (1.0, 0.8, 0.5)
    return Environment("sky", (0.4 + 0.25 * d * (1.0, 1.0, -1.0) + light).astype(np.float32))


def edged_spot(eye: tuple[float, float, float], target: tuple[float, float, float], candela: float) -> Any:
    """Return a spot light without a soft edge, and its pose."""
    light = Light("spot", 0, intensity=candela, inner_cone=EDGE - 5e-4, outer_cone=EDGE)
    return light, pose_looking_at(eye, target)


AROUND = View(pose_looking_at((2.4, 2.0, 3.4), (0.0, 0.4, 0.0)), Perspective(YFOV, 0.05))
WITHIN = View(pose_looking_at((0.0, 1.0, 3.6), (0.0, 1.0, 0.0)), Perspective(0.72, 0.05))
PARALLEL = View(pose_looking_at((2.4, 2.0, 3.4), (0.0, 0.4, 0.0)), Orthographic(1.6, 0.1, 20.0))

GOLD, COPPER, STEEL = (0.95, 0.7, 0.3), (0.9, 0.45, 0.3), (0.5, 0.55, 0.6)
ROSE, GREEN, GREY = (0.8, 0.15, 0.12), (0.15, 0.6, 0.2), (0.75, 0.75, 0.75)


def _yard(*roughness: float, environment: Environment | None = None, **more: Any) -> Scene:
    first, second = roughness
    squares = [ground(metal(*STEEL, first)), *cube((0.0, 0.6, 0.0), 0.8, metal(*GOLD, second))]
    squares.append((placed((-1.2, 0.7, -0.6), (1.2, 1.4), (0.8, 0.1, 0.6)), metal(*COPPER, first)))
    return scene_of(squares, environment=environment, **more)


def _white() -> Scene:
    """Facets that reflect all light, in even light of one colour: what is missing is masked, or left after 4 times."""
    white = metal(1.0, 1.0, 1.0, 0.8)
    squares = [ground(white), *cube((0.0, 0.5, 0.0), 1.0, replace(white, roughness=0.4))]
    return scene_of(squares, environment=constant((0.5, 1.0, 2.0)))


def _room(roughness: float, edge: float, nits: float, *others: Square, **more: Any) -> Scene:
    squares = chamber(
        metal(*GREY, roughness), metal(*GREY, 0.9), metal(*ROSE, 0.9), metal(*GREEN, 0.9), metal(*GOLD, 0.5)
    )
    return scene_of([*squares, lamp(edge, (nits, 0.8 * nits, 0.6 * nits)), *others], **more)


def _lit() -> Scene:
    """Lights without size, of each kind."""
    lights = [
        point((-1.2, 1.6, 1.0), candela=6.0),
        edged_spot((1.5, 2.4, 1.2), (0.0, 0.3, 0.0), 20.0),
        sun((-0.4, -1.0, -0.5), lux=3.0),
        sun((0.9, -0.5, 0.1), lux=1.0),
    ]
    lights[0] = replace(lights[0][0], color=(1.0, 0.6, 0.3)), lights[0][1]
    return _yard(0.5, 0.35, lights=lights)


def _lamps() -> Scene:
    """Emissive squares of many sizes and powers, some of them sheared and mirrored, below a sky."""
    rng = np.random.default_rng(5)
    squares = [ground(metal(*STEEL, 0.6)), *cube((0.0, 0.5, 0.0), 0.7, metal(*GOLD, 0.4))]
    for number in range(12):
        angle = 2.0 * np.pi * number / 12
        at = (1.6 * np.cos(angle), 0.5 + 0.9 * rng.random(), 1.6 * np.sin(angle))
        matrix = placed(at, tuple(0.1 + 0.5 * rng.random(2)), (-np.cos(angle), -0.4, -np.sin(angle)))
        matrix[:3, 0] += 0.4 * rng.random() * matrix[:3, 1]
        if number % 3 == 0:
            matrix[:3, 1] *= -1.0
        red, green, blue = 8.0 ** (2.0 * rng.random() - 0.5) * rng.uniform(0.3, 1.0, 3)
        squares.append((matrix, glow(red, green, blue, both=True)))
    return scene_of(squares, environment=sky(4.0))


def _focus() -> Scene:
    squares = [ground(metal(*STEEL, 0.5)), *cube((0.5, 0.4, 0.6), 0.6, metal(*GOLD, 0.4))]
    squares += [
        (placed((x, 0.5 + 0.3 * x, -1.0 - x), (0.4, 0.4), (0.3, 0, 1)), glow(4.0, 3.0 + x, 2.0))
        for x in (-0.9, 0.0, 0.8)
    ]
    return scene_of(squares, environment=sky())


BANK = FogBox((0.1, 0.72, 0.23), (0.9, 0.45, 0.8), 1.5, (0.9, 0.8, 0.6))
HAZE = Medium(extinction=0.3, albedo=(0.7, 0.85, 0.95))
SPECKS = [
    (placed(at, (1e-3, 1e-3), (0, 0, 1)), metal(*GREY, 0.5)) for at in ((-1.7, -0.6, -1.6), (1.8, 2.9, 3.9))
]
"""They set the bounds of the scene, which a constant medium fills, with the eye of WITHIN."""


def _painted() -> Scene:
    """glTF's dielectrics, for which Mitsuba gets a material that is made for this test."""
    paint = [
        Material(base_color=(*color, 1.0), metallic=0.0, roughness=roughness, double_sided=True)
        for color, roughness in ((GREY, 0.3), (GREY, 0.8), (ROSE, 0.6), (GREEN, 0.6), (GOLD, 0.4))
    ]
    return scene_of([*chamber(*paint), lamp(0.7, (8.0, 7.0, 6.0))])


PAINTED = Case("dielectrics in a room", _painted, WITHIN, 4)


def _fog() -> Scene:
    """Light that has no bound near its source, as a point has, comes from outside of the bank of fog."""
    lights = [sun((-0.4, -1.0, -0.5), lux=3.0), edged_spot((1.5, 2.6, 1.2), (0.0, 0.3, 0.0), 20.0)]
    return _yard(0.6, 0.4, lights=lights, environment=sky(4.0), medium=Medium(boxes=(BANK,)))


def _haze() -> Scene:
    return _room(0.6, 0.7, 8.0, *SPECKS, medium=HAZE, environment=sky(2.0))


TURNED = {"environment_turn": 40.0}, {"turn": 40.0}
LENS = {"aperture": 0.4, "focus_distance": 3.0}, {"aperture": 0.4, "focus": 3.0}
SOBOL = {"path_roulette": 1, "path_sequence": "sobol"}

CASES = [
    Case("white facets in even light", _white, AROUND, 4),
    Case("sky", lambda: _yard(0.6, 0.3, environment=sky()), AROUND, 4, *TURNED),
    Case("smooth under a sky", lambda: _yard(0.2, 0.1, environment=sky()), PARALLEL, 3),
    Case("room", lambda: _room(0.8, 0.7, 8.0), WITHIN, 7),
    Case("room with roulette and Sobol's points", lambda: _room(0.5, 0.5, 12.0), WITHIN, 12, SOBOL),
    Case("smooth room", lambda: _room(0.15, 0.3, 30.0), WITHIN, 4),
    Case("lights", _lit, AROUND, 3, {"path_lights": "one"}),
    Case("many lamps", _lamps, AROUND, 3),
    Case("out of focus", _focus, AROUND, 3, *LENS),
    Case("bank of fog", _fog, AROUND, 5, {"fog_anisotropy": 0.6}, {"anisotropy": 0.6}),
    Case("haze in a room", _haze, WITHIN, 6, {"fog_anisotropy": -0.3}, {"anisotropy": -0.3}),
]
