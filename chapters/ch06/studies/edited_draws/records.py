"""What the GPU reads about the draws: commands, draw records, objects and materials, and which objects are visible."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.errors import UserError

from ...scene.draw_lists import COMMAND
from .shapes import Mesh, Meshes

LIMIT = 1 << 16
"""Materials, and objects, that a draw record can name."""

MATERIALS = np.array(
    [
        (0.42, 0.42, 0.42, 1.0),
        (0.86, 0.36, 0.24, 1.0),
        (0.93, 0.70, 0.24, 1.0),
        (0.52, 0.72, 0.30, 1.0),
        (0.20, 0.62, 0.58, 1.0),
        (0.28, 0.48, 0.80, 1.0),
        (0.56, 0.40, 0.76, 1.0),
        (0.84, 0.46, 0.64, 1.0),
    ],
    np.float32,
)
"""Colours as they are displayed. Entry 0 is the default, which no object asks for."""

OPEN_SHARE = 0.4
SPREAD = 1.3
"""Radius of the disc on which the objects are, metres: it fills the view of a camera with default settings."""


class DrawnScene(NamedTuple):
    """The draws of the scene, those of closed meshes first.

    `commands` (D,) COMMAND; `objects` (D, 3, 4) float32, the rows of world_from_object; `parts` (first, count) of the
    draws of each part, `triangles` those of its meshes.
    """

    commands: NDArray[np.void]
    objects: NDArray[np.float32]
    parts: list[tuple[int, int]]
    triangles: list[int]


def pack(material: ArrayLike, number: ArrayLike) -> NDArray[np.uint32]:
    """Return draw records, uint32: the material in the lower 16 bits, the number of the object in the upper ones.

    Raises UserError for a number that has more than 16 bits, or is negative.
    """
    fields = []
    for name, values in (("material", material), ("object", number)):
        field = np.asarray(values, np.int64)
        if field.size and not 0 <= field.min() <= field.max() < LIMIT:
            wrong = field[(field < 0) | (field >= LIMIT)].flat[0]
            raise UserError(
                f"A draw record has 16 bits for a {name}, and {wrong} is not in 0 to {LIMIT - 1}."
            )
        fields.append(field.astype(np.uint32))
    return fields[0] | fields[1] << np.uint32(16)


def unpack(record: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Return the materials and the numbers of the objects of draw records."""
    return record & np.uint32(0xFFFF), record >> np.uint32(16)


def scene_of(count: int, meshes: Meshes) -> DrawnScene:
    """Return `count` objects, spread evenly over a disc, each with a mesh, a material and a direction."""
    random = np.random.default_rng(6)
    number = np.arange(count)
    away, turn = SPREAD * np.sqrt((number + 0.5) / count), np.pi * (3.0 - np.sqrt(5.0)) * number
    places = np.stack([away * np.cos(turn), np.zeros(count), away * np.sin(turn)], axis=-1)
    opened = random.uniform(size=count) < OPEN_SHARE
    places = np.concatenate([places[~opened], places[opened]])
    closed = count - int(opened.sum())
    chosen: list[Mesh] = [meshes.closed[i] for i in random.integers(len(meshes.closed), size=closed)]
    chosen += [meshes.open[i] for i in random.integers(len(meshes.open), size=count - closed)]
    commands = np.zeros(count, COMMAND)
    commands["index_count"], commands["first_index"], commands["vertex_offset"] = np.array(chosen).T
    commands["instance_count"] = 1
    commands["first_instance"] = pack(1 + random.integers(len(MATERIALS) - 1, size=count), number)
    parts = [(0, closed), (closed, count - closed)]
    triangles = [triangles_of(commands[first : first + size]) for first, size in parts]
    return DrawnScene(commands, _placed(places, random), parts, triangles)


def triangles_of(commands: NDArray[np.void]) -> int:
    """Return how many triangles the meshes of some commands have together."""
    return int(commands["index_count"].sum()) // 3


def _placed(places: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float32]:
    """Return (D, 3, 4) float32: objects at these places, each turned around the vertical and then tilted."""
    count = len(places)
    size = SPREAD * min(0.8 / np.sqrt(count), 0.35) * random.uniform(0.7, 1.2, count)
    (c, s), (tilt_c, tilt_s) = (
        (np.cos(angle), np.sin(angle))
        for angle in (random.uniform(0.0, 2.0 * np.pi, count), random.uniform(-1.2, 1.2, count))
    )
    zero, unit = np.zeros(count), np.ones(count)
    around_y = np.array([[c, zero, s], [zero, unit, zero], [-s, zero, c]])
    around_x = np.array([[unit, zero, zero], [zero, tilt_c, -tilt_s], [zero, tilt_s, tilt_c]])
    rows = np.einsum("ijn,jkn->nik", around_y, around_x) * size[:, None, None]
    return np.concatenate([rows, places[:, :, None]], axis=-1).astype(np.float32)


def inside(objects: NDArray[np.float32], circle: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Return (D,) bool: which objects the kernels take for inside, by the same operations in single precision."""
    away = objects[:, (0, 2), 3] - circle[:2]
    squares = away * away
    return np.asarray(squares[:, 0] + squares[:, 1] <= circle[3])
