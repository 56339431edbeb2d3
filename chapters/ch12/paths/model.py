"""What paths need before the first frame: defines, and the tables by which rays are sent towards light. No device."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from common.environment import Environment
from common.environment.directions import (
    cube_solid_angles,
    cube_uv,
    panorama_direction,
    panorama_solid_angles,
)
from common.environment.importance import cube_weights
from common.images.color import LUMINANCE
from common.numerics.alias_table import alias_table
from common.scene import Scene
from common.scene.pose import evaluate_pose

from ..environment import model as environment
from ..post.lens import lens_defines
from ..scene.packing import LIGHT_KINDS
from ..shading.views import PICTURE
from . import light_tree
from .settings import PathSettings, Strategy

Defines = tuple[tuple[str, int | float | str], ...]

CELLS = 64
"""Texels along an edge of the cube map from which directions of the environment are drawn."""

NO_LIGHT = 0xFFFFFFFF

DIRECTIONAL = LIGHT_KINDS["directional"]

NOTHING = np.zeros((0, 4), np.uint32)


def in_use(scene: Scene, settings: Any) -> bool:
    """Whether the picture is traced by paths; a view of a quantity is rasterised, and so is a scene of nothing."""
    return bool(settings.paths.path_tracer and settings.shading.view == PICTURE and len(scene.indices))


def has_environment(scene: Scene, settings: Any) -> bool:
    """Whether rays are sent towards the environment."""
    return environment.needed(scene, settings)


def emits(scene: Scene) -> NDArray[np.bool_]:
    """Return (I,) whether the triangles of an instance are sent rays: its material emits, and it is shown."""
    materials = np.array([not it.unlit and max(it.emissive) > 0.0 for it in scene.materials], np.bool_)
    if not len(materials):
        return np.zeros(len(scene.instances), np.bool_)
    shown: NDArray[np.bool_] = (
        materials[scene.meshes["material"][scene.instances.mesh]] & scene.instances.visible
    )
    return shown


def stand_ins(scene: Scene) -> NDArray[np.bool_]:
    """Return (N,) the nodes whose light stands for a surface that emits (`extras.strata.stands_for`): paths find it."""
    nodes = scene.nodes
    emitting = {nodes.names[node] for node in scene.instances.node[emits(scene)].tolist()}
    standing = np.zeros(len(nodes.parent), np.bool_)
    for node, extras in nodes.extras.items():
        said = extras.get("strata")
        name = said.get("stands_for") if isinstance(said, dict) else None
        standing[node] = isinstance(name, str) and name in emitting
    return standing


def path_defines(scene: Scene, settings: Any) -> Defines:
    """Return the defines of paths.glsl besides those of rays/picture.py."""
    return (
        ("PATHS", 1),
        ("SHADOW_NEAR", f"{settings.shadows.shadow_near:.9e}"),
        *((("EMITTERS", 1),) * bool(emits(scene).any())),
        *((("LENS", 1), *lens_defines(settings)) if settings.post.aperture > 0.0 else ()),
    )


def knob_words(knobs: PathSettings) -> tuple[int, int, int, int]:
    """Return what shaders are told of the knobs (`path.knobs`); the bits are those of paths/frame.glsl."""
    bits = knobs.path_lights == "one", knobs.path_sequence == "sobol", knobs.path_filter == "box"
    strategy = get_args(Strategy).index(knobs.path_strategy)
    flags = sum(on << place for place, on in enumerate(bits))
    return int(knobs.path_bounces), int(knobs.path_roulette), strategy, flags


# --- tables ---


@dataclass(frozen=True, eq=False)
class Tables:
    """The records of paths/light_tables.glsl, (N, 4) uint32, and where they begin."""

    words: NDArray[np.uint32]
    environment: int
    """Entries of the environment's table."""
    emitters: int
    """Entries of the table of emissive triangles."""
    triangles: int
    """The first of the triangles in `words`."""
    instances: int
    """The first of the instances in `words`."""
    tree: int
    """The first record of the tree of lights in `words`."""
    leaves: int = 0
    """The leaves of that tree; 0 while there is none."""

    @property
    def places(self) -> tuple[int, int, int, int]:
        """What shaders are told of the records (`path.tables`)."""
        return self.environment, self.emitters, self.triangles, self.instances

    @property
    def tree_places(self) -> tuple[int, int, int, int]:
        """What shaders are told of the tree of lights (`path.tree`)."""
        return self.tree, self.leaves, self.tree + 2 * self.leaves * light_tree.NODE_RECORDS, 0

    def with_lights(self, records: np.ndarray) -> Tables:
        """Return these tables with the tree of LIGHT records, the first of which have no place.

        Lights for whose tree there is no room have none.
        """
        tree = light_tree.light_tree(records, int(np.count_nonzero(records["kind"] == DIRECTIONAL)))
        if not len(tree) or len(tree) > len(self.words) - self.tree:
            return replace(self, leaves=0) if self.leaves else self
        words = self.words.copy()
        words[self.tree : self.tree + len(tree)] = tree
        return replace(self, words=words, leaves=light_tree.leaves_of(tree))


def tables(scene: Scene, around: NDArray[np.uint32], most_bytes: int | None = None) -> Tables:
    """Return the tables of a scene whose environment has the entries `around` (`environment_entries`).

    Where they would take more than `most_bytes`, no rays are sent to triangles, and reflected rays alone find these.
    """
    triangles, weights, first = emissive_triangles(scene)
    entries = alias_table(weights).words() if weights.any() else NOTHING
    instances_bytes = 16 * -(-max(len(first), 1) // 4)
    tree = np.zeros((light_tree.room(len(scene.lights)), 4), np.uint32)
    wanted = around.nbytes + entries.nbytes + 16 * len(triangles) + instances_bytes + tree.nbytes
    if most_bytes is not None and wanted > most_bytes:
        triangles, entries = triangles[:0], NOTHING
    places = np.zeros((len(triangles), 4), np.uint32)
    places[:, :2] = triangles
    instances = np.full(-(-max(len(first), 1) // 4) * 4, NO_LIGHT, np.uint32)
    if len(entries):
        instances[: len(first)] = first
    parts = (around, entries, places, instances.reshape(-1, 4), tree)
    begins = np.cumsum([0, *(len(part) for part in parts)]).tolist()
    return Tables(np.concatenate(parts), len(around), len(entries), *begins[2:5])


def emissive_triangles(
    scene: Scene,
) -> tuple[NDArray[np.uint32], NDArray[np.float64], NDArray[np.uint32]]:
    """Return (T, 2) instance and number of each triangle, (T,) its weight, and (I,) the first one of each instance.

    The weight is luminance times area, as it is at time 0. What moves later keeps its weight: rays are weighted by the
    density with which they really are drawn, so any weight above 0 gives the same mean.
    """
    numbers, weights = [np.zeros((0, 2), np.uint32)], [np.zeros(0)]
    first = np.full(len(scene.instances), NO_LIGHT, np.uint32)
    emitting = np.flatnonzero(emits(scene))
    matrices = evaluate_pose(scene, 0.0).world_from_object if len(emitting) else None
    count = 0
    for instance in emitting.tolist():
        assert matrices is not None, "something emits"
        row = scene.meshes[scene.instances.mesh[instance]]
        begin, size, vertex = int(row["first_index"]), int(row["index_count"]), int(row["first_vertex"])
        indices = scene.indices[begin : begin + size].reshape(-1, 3)
        corners = scene.positions[vertex + indices].astype(np.float64) @ matrices[instance][:3, :3].T
        with np.errstate(invalid="ignore"):
            doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.nan_to_num(np.linalg.norm(doubled, axis=1), nan=0.0, posinf=0.0)
        emissive = np.asarray(scene.materials[int(row["material"])].emissive, np.float64)
        numbers.append(
            np.column_stack([np.full(len(indices), instance), np.arange(len(indices))]).astype(np.uint32)
        )
        weights.append(0.5 * areas * float(emissive @ np.asarray(LUMINANCE)))
        first[instance] = count
        count += len(indices)
    return np.concatenate(numbers), np.concatenate(weights), first


def environment_entries(panorama: Environment | None) -> NDArray[np.uint32]:
    """Return the entries of the table of a cube map of CELLS texels along an edge; none without an environment.

    The light of each pixel of the panorama falls into the texel that its direction meets, and part of it into the
    neighbours, since shaders look the environment up in a filtered cube map. Pixels are divided until they are smaller
    than texels. A hundredth of the rays goes everywhere alike.
    """
    if panorama is None:
        return NOTHING
    pixels = panorama.radiance.astype(np.float64) @ np.asarray(LUMINANCE)
    light = cell_radiance(pixels, CELLS)
    weights = cube_weights(np.repeat(light[..., None], 3, axis=-1), CELLS)
    even = cube_solid_angles(CELLS) / (4.0 * np.pi)
    return alias_table((0.99 * weights / weights.sum() + 0.01 * even).reshape(-1)).words()


def cell_radiance(pixels: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return (6, size, size) the mean of the pixels of a panorama (H, 2H) that fall in each texel of a cube."""
    enough = 8 * size
    parts = -(-enough // len(pixels))
    while len(pixels) >= 2 * enough and len(pixels) % 2 == 0:
        pixels = pixels.reshape(len(pixels) // 2, 2, -1, 2).mean(axis=(1, 3))
    pixels = pixels.repeat(parts, axis=0).repeat(parts, axis=1)
    rows, columns = pixels.shape
    uv = np.stack(np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows), axis=-1)
    face, place = cube_uv(panorama_direction(uv))
    texel = np.clip((place * size).astype(np.intp), 0, size - 1)
    number = (face * size + texel[..., 1]) * size + texel[..., 0]
    angles = np.broadcast_to(panorama_solid_angles(rows), pixels.shape).reshape(-1)
    cells = 6 * size * size
    power, whole = (
        np.bincount(number.reshape(-1), weight, cells) for weight in (pixels.reshape(-1) * angles, angles)
    )
    return np.asarray((power / whole).reshape(6, size, size))
