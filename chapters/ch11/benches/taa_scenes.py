"""What the bench of temporal anti-aliasing draws: small scenes in which one thing moves, and walks through large ones.

Lengths follow from the size of the picture: what moves by three pixels a frame does so at every size. The wall of small
scenes is the plane z = 0, and the picture shows 2 units of its height.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.transforms import compose, pose_looking_at, quaternion_from_axis_angle, translation
from common.reports.benches import Subject
from common.scene import (
    MESH_DTYPE,
    Animation,
    AnimationChannel,
    Image,
    Instances,
    Light,
    Material,
    Nodes,
    Sampler,
    Scene,
    TextureRef,
)
from common.settings import knobs, preset, replaced
from common.view.camera import Perspective, View

Float64 = NDArray[np.float64]

STEP_S = 1 / 32
"""Seconds from one frame to the next. It is a power of two, so that times are exact."""

EYE_Z = 2.0
LENS = Perspective(2 * math.atan(0.5), 0.05)
"""The camera before the wall: it shows 2 units of the wall's height."""

PASSING_PX, PAN_PX, SLOW_PX = 3.0, 1.37, 0.35
"""Pixels a frame: of what passes before the wall, of a pan, and of the pan over wires."""

TURN = math.radians(3.0)
"""By which the turning cube turns in a frame."""

BLINK_FRAMES = 6
"""Frames for which the flickering lamp is on, and off."""

EDGE_ANGLE = math.radians(5.0)
"""Of the slanted edge, from the vertical; further down it goes to the right."""

AWAY = 1e4
"""Metres to which a lamp goes that is off: it then has 1e-8 of its light on the wall."""


@dataclass(frozen=True, eq=False)
class Case:
    """A sequence of frames of a scene: what moves in it, and which of its numbers count."""

    name: str
    scene: Scene
    view: Callable[[View, int], View]
    """The view of a frame, from the first view of the scene."""
    moves: bool = True
    """Whether anything moves. What does not is drawn until it rests."""
    passing: int | None = None
    """The instance whose ghost is measured."""
    edge: float | None = None
    """The angle of the edge whose sharpness is measured, if the scene shows one."""

    def time(self, frame: int) -> float:
        """Return the seconds of a frame."""
        return frame * STEP_S if self.scene.animations else 0.0


class Part(NamedTuple):
    """One object: corners of quads (Q, 4, 3), counter-clockwise as they are seen, its material and matrix."""

    quads: Float64
    material: Material
    matrix: Float64


# --- parts ------------------------------------------------------------------------------------------------------------


def quad(left: float, bottom: float, right: float, top: float) -> Float64:
    """Return a rectangle (1, 4, 3) of the plane z = 0 that faces +z."""
    return np.array([[(left, bottom, 0), (right, bottom, 0), (right, top, 0), (left, top, 0)]], np.float64)


def box(x: float, y: float, z: float) -> Float64:
    """Return the sides (6, 4, 3) of a box by half its edges."""
    front = quad(-1, -1, 1, 1)[0] + (0, 0, 1)
    sides = [np.roll(front, axis, axis=1) for axis in range(3)]
    return np.stack([side * sign for side in sides for sign in (1, -1)]) * (x, y, z)


def unlit(red: float, green: float, blue: float) -> Material:
    """Return a material whose colour is what is seen, from both sides."""
    return Material(base_color=(red, green, blue, 1.0), unlit=True, double_sided=True)


def lit(red: float, green: float, blue: float, texture: TextureRef | None = None) -> Material:
    """Return a rough material, seen from both sides."""
    made = Material(base_color=(red, green, blue, 1.0), metallic=0.0, roughness=1.0, double_sided=True)
    return replace(made, base_color_texture=texture)


def checks(cells: int = 8, dark: int = 60, bright: int = 220) -> Image:
    """Return a picture of checks, 8 texels wide each."""
    row, column = np.indices((8 * cells, 8 * cells)) // 8
    codes = np.where((row + column) % 2, dark, bright).astype(np.uint8)
    return Image("checks", np.dstack([codes] * 3 + [np.full_like(codes, 255)]))


CHECKS = TextureRef(0, Sampler())


def scene_of(
    name: str,
    parts: Sequence[Part],
    lights: Sequence[tuple[Light, ArrayLike]] = (),
    animations: Iterable[Animation] = (),
) -> Scene:
    """Return a scene of parts, whose nodes come first, and lights with their places, whose nodes follow."""
    positions: list[Float64] = []
    normals: list[Float64] = []
    uv: list[Float64] = []
    meshes = np.zeros(len(parts), MESH_DTYPE)
    indices: list[NDArray[np.intp]] = []
    for number, part in enumerate(parts):
        count = len(part.quads)
        flat = np.cross(part.quads[:, 1] - part.quads[:, 0], part.quads[:, 2] - part.quads[:, 0])
        flat = flat / np.linalg.norm(flat, axis=1)[:, None]
        outward = np.where(((flat * part.quads.mean(axis=1)).sum(axis=1) < 0.0) & (count > 1), -1.0, 1.0)
        row = meshes[number]
        row["first_vertex"], row["vertex_count"] = sum(len(one) for one in positions), 4 * count
        row["first_index"], row["index_count"] = sum(len(one) for one in indices), 6 * count
        row["material"] = number
        corners = part.quads.reshape(-1, 3)
        row["bounds_min"], row["bounds_max"] = corners.min(axis=0), corners.max(axis=0)
        positions.append(corners)
        normals.append(np.repeat(flat * outward[:, None], 4, axis=0))
        uv.append(np.tile([(0, 1), (1, 1), (1, 0), (0, 0)], (count, 1)))
        indices.append((4 * np.arange(count)[:, None] + np.array([0, 1, 2, 0, 2, 3])).ravel())
    placed = [part.matrix for part in parts] + [translation(place) for _, place in lights]
    count = len(placed)
    nodes = Nodes(
        parent=np.full(count, -1, np.int32),
        translation=np.array([matrix[:3, 3] for matrix in placed]),
        rotation=np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)),
        scale=np.ones((count, 3)),
        matrix=np.array(placed),
        has_matrix=np.ones(count, bool),
        names=[f"node {number}" for number in range(count)],
    )
    animations = list(animations)
    for channel in (channel for one in animations for channel in one.channels):
        nodes.has_matrix[channel.node] = False
    own = np.arange(len(parts), dtype=np.int32)
    return Scene(
        name=name,
        path=None,
        positions=np.concatenate(positions).astype(np.float32),
        normals=np.concatenate(normals).astype(np.float32),
        tangents=np.tile(np.array((1, 0, 0, 1), np.float32), (sum(len(one) for one in positions), 1)),
        uv0=np.concatenate(uv).astype(np.float32),
        uv1=None,
        colors=None,
        indices=np.concatenate(indices).astype(np.uint32),
        meshes=meshes,
        mesh_names=[part.material.name for part in parts],
        materials=[part.material for part in parts],
        images=[checks()],
        nodes=nodes,
        instances=Instances(own, own.copy()),
        lights=[replace(light, node=len(parts) + at) for at, (light, _) in enumerate(lights)],
        cameras=[],
        animations=animations,
        deformations=[],
        ambient=0.05,
    )


def clip(
    node: int, path: Any, frames: ArrayLike, values: ArrayLike, interpolation: Any = "linear"
) -> Animation:
    """Return a clip with keys (K,) at frames."""
    times = np.asarray(frames, np.float64) * STEP_S
    channel = AnimationChannel(node, path, times, np.asarray(values, np.float64), interpolation)
    return Animation(path, (channel,), float(times[-1]))


LAMP = Light("point", 0, intensity=16.0)
LAMP_AT = (0.8, 1.2, 1.8)
WALL = quad(-6, -4, 6, 4)


def wall(material: Material) -> Part:
    """Return the wall."""
    return Part(WALL, material, np.eye(4))


def checked_wall() -> Part:
    """Return a wall of squares, 16 to the height of the picture."""
    return wall(lit(0.7, 0.7, 0.7, texture=replace(CHECKS, scale=(12.0, 8.0))))


# --- cases ------------------------------------------------------------------------------------------------------------


def before_wall(first: View | None = None, frame: int = 0, step: float = 0.0) -> View:
    """Return the view of the wall's middle, moved to the right by `step` units a frame."""
    x = step * frame
    return View(pose_looking_at((x, 0.0, EYE_Z), (x, 0.0, 0.0)), LENS)


def panned(step: float) -> Callable[[View, int], View]:
    """Return the views of a pan over the wall by `step` units a frame."""
    return lambda first, frame: before_wall(first, frame, step)


def pixel(size: tuple[int, int], z: float = 0.0) -> float:
    """Return the units of a pixel of the plane at z."""
    return 2.0 / size[1] * (EYE_Z - z) / EYE_Z


def still() -> Case:
    """Return a view at rest of a box before a checked wall."""
    turned = compose((0.3, 0.0, 0.4), quaternion_from_axis_angle((0.3, 1.0, 0.2), 0.7), (1, 1, 1))
    parts = [checked_wall(), Part(box(0.3, 0.3, 0.3), lit(0.8, 0.3, 0.2), turned)]
    return Case("still", scene_of("still", parts, [(LAMP, LAMP_AT)]), before_wall, moves=False)


def rotating(size: tuple[int, int], frames: int) -> Case:
    """Return a checked cube that turns before a checked wall."""
    angles = TURN * np.arange(frames + 1)
    turns = quaternion_from_axis_angle(np.array((0.1, 1.0, 0.2)), angles)
    cube = Part(box(0.4, 0.4, 0.4), lit(0.9, 0.6, 0.3, texture=CHECKS), translation((0.0, 0.0, 0.6)))
    moves = [clip(1, "rotation", np.arange(frames + 1), turns)]
    scene = scene_of("rotating", [checked_wall(), cube], [(LAMP, LAMP_AT)], moves)
    return Case("rotating", scene, before_wall)


def disocclusion(size: tuple[int, int], frames: int, checked: bool = False) -> Case:
    """Return a box that passes before a wall, either of one colour under a lamp or checked."""
    z, name = 0.5, "disocclusion, checks" if checked else "disocclusion"
    way = PASSING_PX * pixel(size, z) * frames
    from_to = [(-way / 2, 0.0, z), (way / 2, 0.0, z)]
    passing = Part(box(0.15, 0.4, 0.05), unlit(0.95, 0.3, 0.05), translation(from_to[0]))
    parts = [checked_wall() if checked else wall(lit(0.35, 0.4, 0.5)), passing]
    scene = scene_of(name, parts, [(LAMP, LAMP_AT)], [clip(1, "translation", (0, frames), from_to)])
    return Case(name, scene, before_wall, passing=1)


def wires(size: tuple[int, int]) -> Case:
    """Return wires, from a quarter of a pixel to one pixel thick, before a wall under a slow pan."""
    parts = [wall(lit(0.35, 0.4, 0.5))]
    z = 0.4
    for number, width in enumerate(np.linspace(0.25, 1.0, 12)):
        half = width * pixel(size, z) / 2
        angle = math.radians(-75 + 13.7 * number)
        turned = quaternion_from_axis_angle((0.0, 0.0, 1.0), angle)
        matrix = compose((0.22 * (number - 5.5), 0.0, z), turned, (1.0, 1.0, 1.0))
        color = (0.02, 0.02, 0.02) if number % 2 else (0.9, 0.9, 0.8)
        parts.append(Part(quad(-half, -2, half, 2), unlit(*color), matrix))
    return Case("wires", scene_of("wires", parts, [(LAMP, LAMP_AT)]), panned(SLOW_PX * pixel(size)))


def flickering(frames: int) -> Case:
    """Return a box before a checked wall under two lamps, one of which flickers."""
    base = still().scene
    parts = [Part(WALL, base.materials[0], np.eye(4))]
    parts.append(Part(box(0.3, 0.3, 0.3), base.materials[1], base.nodes.matrix[1]))
    blinks = -(-frames // BLINK_FRAMES) + 1
    keys = BLINK_FRAMES * np.arange(blinks)
    places = [(-0.8, 0.6, 1.6 + AWAY * (blink % 2)) for blink in range(blinks)]
    lamps: list[tuple[Light, ArrayLike]] = [(replace(LAMP, intensity=4.0), LAMP_AT), (LAMP, places[0])]
    scene = scene_of("flickering", parts, lamps, [clip(3, "translation", keys, places, "step")])
    return Case("flickering", scene, before_wall)


def edge(size: tuple[int, int]) -> Case:
    """Return a slanted edge of two colours under a pan."""
    far = 8.0
    lean = 4.0 * math.tan(EDGE_ANGLE)
    corners = np.array([[(lean, -4, 0.01), (far, -4, 0.01), (far, 4, 0.01), (-lean, 4, 0.01)]], np.float64)
    parts = [wall(unlit(0.15, 0.15, 0.15)), Part(corners, unlit(0.6, 0.6, 0.6), np.eye(4))]
    return Case("edge", scene_of("edge", parts), panned(PAN_PX * pixel(size)), edge=EDGE_ANGLE)


def large(subject: Subject, name: str, pan: bool) -> Case:
    """Return one of the project's scenes from its camera, at rest or with a pan."""
    scene = replace(subject.load(name), animations=[])
    if not pan:
        return Case(f"{name}, still", scene, lambda first, frame: first, moves=False)

    def view(first: View, frame: int) -> View:
        angle = 2 * math.atan(math.tan(LENS.yfov / 2)) / subject.size[1] * PAN_PX * frame
        turned = compose((0, 0, 0), quaternion_from_axis_angle((0.0, 1.0, 0.0), angle), (1, 1, 1))
        moved = translation(first.world_from_view[:3, 0] * 5e-4 * scene.length_scale * frame)
        return replace(first, world_from_view=moved @ first.world_from_view @ turned)

    return Case(f"{name}, pan", scene, view)


def settings_of(subject: Subject, **values: Any) -> Any:
    """Return the settings of the pictures: those of `medium` without what depends on the number of pixels."""
    exact = {
        "msaa": 1,
        "lod_pixels": 0.0,
        "cloth": False,
        "ssao": "off",
        "shadows": "off",
        "color_format": "rgba32f",
        **values,
    }
    known = knobs(subject.settings_class)
    settings = preset(subject.settings_class, "medium")
    return replaced(settings, **{name: value for name, value in exact.items() if name in known})
