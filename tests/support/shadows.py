"""Scenes with shadows, and the faces and pages of a renderer, read back."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene import Animation, AnimationChannel, Deformation, Light, Material, Scene
from tests.support.scenes import nodes_at, quad_scene, translated

TILE = 128

PLAIN: dict[str, Any] = {
    "anisotropy": 1.0,
    "color_format": "rgba32f",
    "gbuffer_format": "full",
    "default_light": False,
    "ambient": 0.0,
    "background": 0.0,
    "tone_curve": "none",
}
"""Settings in which a picture is the light of the lights alone, in 32 bits."""


def placed(
    at: tuple[float, float, float], size: tuple[float, float], normal: tuple[float, float, float]
) -> np.ndarray:
    """Return the matrix of a square of `size` in metres around `at` that faces along `normal`."""
    back = np.array(normal, np.float64) / np.linalg.norm(normal)
    up = np.array((0.0, 1.0, 0.0)) if abs(back[1]) < 0.9 else np.array((0.0, 0.0, -1.0))
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = right * size[0] / 2, np.cross(back, right) * size[1] / 2
    matrix[:3, 2], matrix[:3, 3] = back, at
    return matrix


def box(at: tuple[float, float, float], edge: float) -> list[np.ndarray]:
    """Return the matrices of the six squares of a cube."""
    sides = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    return [placed(tuple(np.array(at) + np.array(n) * edge / 2), (edge, edge), n) for n in sides]


def yard(
    *lights: tuple[Light, np.ndarray], extra: tuple[np.ndarray, ...] = (), material: Material | None = None
) -> Scene:
    """Return a ground of 8x8 metres at height 0, a cube of 1 metre that floats 0.5 above it, and lights with poses."""
    squares = [placed((0, 0, 0), (8, 8), (0, 1, 0)), *box((0.0, 1.0, 0.0), 1.0), *extra]
    material = material or Material(roughness=1.0, metallic=0.0, double_sided=True)
    scene = quad_scene(material, matrices=tuple(squares))
    nodes = nodes_at(*squares, *(pose for _, pose in lights))
    for number in range(len(squares), len(nodes.parent)):  # lights that are not turned can be moved
        pose = nodes.matrix[number]
        if np.array_equal(pose[:3, :3], np.eye(3)):
            nodes.has_matrix[number], nodes.translation[number] = False, pose[:3, 3]
    shown = [replace(light, node=len(squares) + number) for number, (light, _) in enumerate(lights)]
    made = replace(scene, lights=shown, nodes=nodes)
    made.bounds, made.origin = _bounds(squares)
    return made


def _bounds(squares: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array([(-1, -1, 0, 1), (1, -1, 0, 1), (1, 1, 0, 1), (-1, 1, 0, 1)], np.float64)
    points = np.concatenate([corners @ matrix.T for matrix in squares])[:, :3]
    bounds = np.stack([points.min(axis=0), points.max(axis=0)])
    return bounds, bounds.mean(axis=0)


def sun(direction: tuple[float, float, float], lux: float = 3.0) -> tuple[Light, np.ndarray]:
    """Return a directional light that shines along `direction`, and its pose."""
    up = (0, 1, 0) if abs(direction[1]) < 0.99 * np.linalg.norm(direction) else (0, 0, 1)
    return Light("directional", 0, intensity=lux), pose_looking_at((0, 0, 0), direction, up)


def spot(eye, target, outer: float = math.radians(40), candela: float = 60.0, reach: float = math.inf):
    """Return a spot light and its pose."""
    up = (
        (0, 1, 0)
        if abs(np.subtract(target, eye)[1]) < 0.99 * np.linalg.norm(np.subtract(target, eye))
        else (0, 0, 1)
    )
    light = Light("spot", 0, intensity=candela, inner_cone=0.8 * outer, outer_cone=outer, range=reach)
    return light, pose_looking_at(eye, target, up)


def point(eye, candela: float = 60.0, reach: float = math.inf) -> tuple[Light, np.ndarray]:
    """Return a point light and its pose."""
    return Light("point", 0, intensity=candela, range=reach), translated(*eye)


def bending() -> Scene:
    """Return a square in x and y whose upper edge leans back by 60 degrees in a second, before a point light."""
    scene = quad_scene(Material(roughness=1.0, metallic=0.0, double_sided=True))
    nodes = nodes_at(*(np.eye(4) for _ in range(4)))
    nodes.has_matrix[:] = False
    nodes.translation[3] = (0.3, 0.2, 2.5)
    top = (scene.positions[:, 1] > 0).astype(np.float64)
    skin = Deformation(
        mesh=0,
        node=0,
        joints=np.array([1, 2], np.int32),
        inverse_bind=np.stack([np.eye(4), np.eye(4)]),
        vertex_joints=np.tile(np.array((0, 1, 0, 0), np.int32), (4, 1)),
        vertex_weights=np.stack([1 - top, top, 0 * top, 0 * top], axis=1),
    )
    half = -math.pi / 6
    keys = np.array([(0.0, 0.0, 0.0, 1.0), (math.sin(half), 0.0, 0.0, math.cos(half))])
    channel = AnimationChannel(2, "rotation", np.array((0.0, 1.0)), keys, "linear")
    lamp = Light("point", 3, intensity=20.0)
    return replace(
        scene,
        nodes=nodes,
        deformations=[skin],
        animations=[Animation("lean", (channel,), 1.0)],
        lights=[lamp],
    )


def bent(time: float) -> np.ndarray:
    """Return the (2, 3, 3) triangles of that square at a time."""
    angle = -(time % 1.0) * math.pi / 3
    y, z = math.cos(angle), math.sin(angle)
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, y, z), (-1, y, z)], np.float64)
    return corners[[0, 1, 2, 0, 2, 3]].reshape(2, 3, 3)


def faces_of(renderer: Any) -> np.ndarray:
    """Return the FACE records of the last frame."""
    faces: np.ndarray = renderer.techniques["shadows"].faces
    return faces[: int(np.flatnonzero(faces["light"] != 0xFFFFFFFF)[-1]) + 1]


def read_pages(renderer: Any) -> np.ndarray:
    """Return all pages (rows, columns) of a renderer; all frames must be over."""
    technique = renderer.techniques["shadows"]
    image, device = technique.memory.pages, renderer.device
    for slot in renderer._frames.slots:
        renderer._frames.wait(slot)
    if renderer.capabilities.backend == "gl":
        from backends.gl import api as gl
        from backends.gl.readback import read_image

        device.make_current()
        device.fn.glMemoryBarrier(gl.GL_ALL_BARRIER_BITS)
        return np.asarray(read_image(device, image)).reshape(image.height, image.width)
    from backends.vulkan.readback import read_image as read

    device.wait_idle()
    return np.asarray(read(device, image, "storage")).reshape(image.height, image.width)


def read_face(renderer: Any, number: int, pages: np.ndarray | None = None) -> np.ndarray:
    """Return (size, size) metres that the pages hold for a face, put together by the table."""
    technique, face = renderer.techniques["shadows"], faces_of(renderer)[number]
    pages = read_pages(renderer) if pages is None else pages
    tiles, first, size = int(face["tiles"]), int(face["first"]), int(face["size"])
    if not size:
        return np.zeros((0, 0), np.float32)
    words = technique.table[first : first + tiles * tiles].reshape(tiles, tiles)
    whole = np.zeros((tiles * TILE, tiles * TILE), np.float32)
    for (row, column), word in np.ndenumerate(words):
        if word == 0xFFFFFFFF:
            continue
        x, y = (int(word) & 0xFF) * TILE, (int(word) >> 8 & 0xFF) * TILE
        whole[row * TILE : (row + 1) * TILE, column * TILE : (column + 1) * TILE] = pages[
            y : y + TILE, x : x + TILE
        ]
    left, top = face["offset"].astype(int)
    return whole[top : top + size, left : left + size]


def all_faces(renderer: Any) -> np.ndarray:
    """Return the metres that the pages hold for all faces, one after another."""
    pages = read_pages(renderer)
    return np.concatenate([read_face(renderer, n, pages).reshape(-1) for n in range(len(faces_of(renderer)))])


def lit_taps(factors: np.ndarray, kernel: int, device: Any) -> np.ndarray:
    """Return how many taps of a kernel each factor of one light lets through, int64.

    A factor is read as the light that arrives over all of it: taps / kernel^2 is rounded, multiplied by the light, and
    divided by it. That is exact for one tap; else it is three roundings where quotients are rounded as IEEE 754 says,
    as software drivers do. Vulkan allows 2.5 units in the last place for a quotient: 5.5 with the product's half.
    """
    software, taps = device.capabilities.is_software, factors.astype(np.float64) * kernel**2
    off = 0.0 if software and kernel == 1 else 3 * 2.0**-24 if software else 5.5 * 2.0**-23
    assert (np.abs(taps - np.round(taps)) <= off * taps).all(), np.abs(taps - np.round(taps)).max()
    return np.round(taps).astype(np.int64)


def words(renderer: Any, name: str) -> np.ndarray:
    """Return the words of a buffer that the kernels of the last round read or wrote; all frames must be over."""
    from tests.support.buffers import read_words

    for slot in renderer._frames.slots:
        renderer._frames.wait(slot)
    return read_words(renderer.device, renderer.techniques["shadows"].memory._table(name))


def listed(renderer: Any) -> list[np.ndarray]:
    """Return for each list of the last round its entries (N, 3): draw, unit, faces as bits."""
    lists, numbers = _lists(renderer), words(renderer, "numbers")
    entries = words(renderer, "lists").reshape(-1, 2)
    found = []
    for number in list_numbers(renderer):
        parts = []
        for batch, row in enumerate(lists.tables.batches):
            first = number * lists.places + int(row["first_command"])
            count = int(numbers[(lists.layers + number) * lists.batches + batch])
            parts.append(entries[first : first + count])
        rows = np.concatenate([*parts, np.zeros((0, 2), np.uint32)])
        found.append(np.stack([rows[:, 0], rows[:, 1] & 0xFFFFFF, rows[:, 1] >> 24], axis=1))
    return found


def commanded(renderer: Any) -> list[np.ndarray]:
    """Return for each face of the last round its draw commands (N, 5)."""
    lists, numbers = _lists(renderer), words(renderer, "numbers")
    commands = words(renderer, "commands").reshape(-1, 5)
    found = []
    schedule = _shadows(renderer).schedule
    for layer in range(int((schedule.places >= schedule.rounds[-1].first).sum())):
        parts = []
        for batch, row in enumerate(lists.tables.batches):
            first = layer * lists.places + int(row["first_command"])
            parts.append(commands[first : first + int(numbers[layer * lists.batches + batch])])
        found.append(np.concatenate([*parts, np.zeros((0, 5), np.uint32)]))
    return found


def list_numbers(renderer: Any) -> list[int]:
    """Return the numbers of the lists of the last round that are in use."""
    schedule = _shadows(renderer).schedule
    numbers: list[int] = np.flatnonzero(schedule.lists[schedule.rounds[-1].first :]).tolist()
    return numbers


def _shadows(renderer: Any) -> Any:
    return renderer.techniques["shadows"].passes["shadows"]


def _lists(renderer: Any) -> Any:
    return _shadows(renderer).lists
