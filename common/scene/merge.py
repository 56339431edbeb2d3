"""Several scenes made one, below a new root: their nodes, geometry, materials, pictures, lights, cameras and clips."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.errors import UserError
from common.scene import Float32, Float64, Instances, Nodes, Scene
from common.scene.parts import Attached, Place, attached, by_node, same_places, with_images
from common.scene.pose import local_matrices

Value = TypeVar("Value")

MAX_ELEMENTS = 2**32 - 1
"""Vertices or indices of one scene: what its tables can number."""


def merge_scenes(
    scenes: Sequence[Scene], transforms: Sequence[ArrayLike] | None = None, name: str = "merged"
) -> tuple[Scene, list[Place]]:
    """Return all scenes below one new root, node 0, and for each the `place` (N,) of its nodes.

    `transforms` are (4, 4) matrices, one for each scene, that multiply all its world matrices from the left.
    Roots take them into their own matrices; where a clip drives a root, that would be lost, and one more node
    between it and the new root carries the transform. Lights keep their intensities and ranges.

    A scene that is in the list more than once shares its materials and pictures, and its geometry unless some of
    it deforms, as `scenes=[tree] * 100` should. All clips play together. Of environments, ambient light and
    exposures, of which a scene has one, the first that is given counts. Instances come in the order of scenes.

    Raises:
        UserError: no scenes, or together more than `MAX_ELEMENTS` vertices or indices.
    """
    if not scenes:
        raise UserError("There are no scenes to merge: give at least one.")
    pools = _Pools()
    parts: list[Attached] = []
    places: list[Place] = []
    nodes, instances = _Nodes(name), []
    for number, scene in enumerate(scenes):
        mesh_place = pools.add(scene)
        place = nodes.add(scene, None if transforms is None else np.asarray(transforms[number], np.float64))
        drawn = scene.instances
        instances.append(Instances(place[drawn.node], mesh_place[drawn.mesh], drawn.local, drawn.visible))
        parts.append(attached(scene, place, mesh_place))
        places.append(place)
    merged = Scene(
        name=name,
        path=None,
        positions=pools.joined(lambda scene: scene.positions),
        normals=pools.joined(lambda scene: scene.normals),
        tangents=pools.joined(lambda scene: scene.tangents),
        uv0=pools.joined(lambda scene: scene.uv0),
        uv1=pools.joined_if_any(lambda scene: scene.uv1, (0.0, 0.0)),
        colors=pools.joined_if_any(lambda scene: scene.colors, (1.0, 1.0, 1.0, 1.0)),
        indices=np.concatenate([scene.indices for scene in pools.scenes]),
        meshes=np.concatenate(pools.meshes),
        mesh_names=[text for scene in pools.scenes for text in scene.mesh_names],
        materials=[
            with_images(material, pools.image_places[id(scene)])
            for scene in pools.looks
            for material in scene.materials
        ],
        images=[image for scene in pools.looks for image in scene.images],
        nodes=nodes.joined(),
        instances=_joined(instances),
        lights=[light for part in parts for light in part["lights"]],
        cameras=[camera for part in parts for camera in part["cameras"]],
        animations=[animation for part in parts for animation in part["animations"]],
        deformations=[deformation for part in parts for deformation in part["deformations"]],
        ambient=_first(scene.ambient for scene in scenes),
        medium=_first(scene.medium for scene in scenes),
        environment=_first(scene.environment for scene in scenes),
        ev100=_first(scene.ev100 for scene in scenes),
        warnings=list(dict.fromkeys(text for scene in scenes for text in scene.warnings)),
    )
    return merged, places


class _Pools:
    """Where the meshes, materials and images of each scene come; each list of owners is stored in this order."""

    def __init__(self) -> None:
        self.scenes: list[Scene] = []  # owners of geometry
        self.looks: list[Scene] = []  # owners of materials and images
        self.meshes: list[np.ndarray] = []
        self.image_places: dict[int, Place] = {}  # of a look's images, by id of the scene
        self._material_first: dict[int, int] = {}
        self._mesh_places: dict[int, Place] = {}
        self._vertices = self._indices = self._mesh_count = self._materials = self._images = 0

    def add(self, scene: Scene) -> Place:
        """Make room for a scene and return the places of its meshes."""
        key = id(scene)  # the caller's list keeps the scene alive, and with it the meaning of its id
        if key not in self._material_first:
            self.looks.append(scene)
            self._material_first[key] = self._materials
            self.image_places[key] = same_places(len(scene.images), self._images)
            self._materials += len(scene.materials)
            self._images += len(scene.images)
        if key in self._mesh_places and not scene.deformations:
            return self._mesh_places[key]
        meshes = scene.meshes.copy()
        if max(self._vertices + len(scene.positions), self._indices + len(scene.indices)) > MAX_ELEMENTS:
            raise UserError(
                f"With {scene.name!r} the merged scene has more than {MAX_ELEMENTS} vertices or indices: leave it out."
            )
        meshes["first_vertex"] += np.uint32(self._vertices)
        meshes["first_index"] += np.uint32(self._indices)
        meshes["material"] += np.uint32(self._material_first[key])
        self.scenes.append(scene)
        self.meshes.append(meshes)
        self._mesh_places[key] = place = same_places(len(meshes), self._mesh_count)
        self._vertices += len(scene.positions)
        self._indices += len(scene.indices)
        self._mesh_count += len(meshes)
        return place

    def joined(self, of: Callable[[Scene], Float32]) -> Float32:
        """Return an array of all vertices."""
        return np.concatenate([of(scene) for scene in self.scenes])

    def joined_if_any(
        self, of: Callable[[Scene], Float32 | None], default: tuple[float, ...]
    ) -> Float32 | None:
        """Return an array of all vertices, with `default` where a scene has none, or None if none has."""
        values_by_scene = [of(scene) for scene in self.scenes]
        if all(values is None for values in values_by_scene):
            return None
        return np.concatenate(
            [
                np.tile(np.array(default, np.float32), (len(scene.positions), 1))
                if values is None
                else values
                for scene, values in zip(self.scenes, values_by_scene, strict=True)
            ]
        )


class _Nodes:
    """The nodes of all scenes as they are collected, the new root first; parents under their new numbers."""

    def __init__(self, root: str) -> None:
        self._blocks: list[Nodes] = []
        self._parents: list[NDArray[np.int32]] = []
        self._count = 0
        self._append(_single(np.eye(4), root), -1)

    def add(self, scene: Scene, transform: Float64 | None) -> Place:
        """Append the nodes of a scene below the root and return their places."""
        old, above = scene.nodes, 0
        roots = old.parent < 0
        matrix, has_matrix = old.matrix.copy(), old.has_matrix.copy()
        if transform is not None and not np.array_equal(transform, np.eye(4)):
            driven = {channel.node for clip in scene.animations for channel in clip.channels}
            if driven & set(np.flatnonzero(roots).tolist()):
                above = self._count
                self._append(_single(transform, scene.name), 0)
            else:
                matrix[roots] = transform @ local_matrices(old, np.flatnonzero(roots))
                has_matrix[roots] = True
        place = same_places(len(old), self._count)
        weights, extras = by_node(old.weights, place), by_node(old.extras, place)
        self._append(
            replace(old, matrix=matrix, has_matrix=has_matrix, weights=weights, extras=extras), above
        )
        return place

    def _append(self, nodes: Nodes, above: int) -> None:
        self._parents.append(np.where(nodes.parent < 0, above, nodes.parent + self._count).astype(np.int32))
        self._blocks.append(nodes)
        self._count += len(nodes)

    def joined(self) -> Nodes:
        """Return all nodes."""
        blocks = self._blocks
        return Nodes(
            parent=np.concatenate(self._parents),
            translation=np.concatenate([block.translation for block in blocks]),
            rotation=np.concatenate([block.rotation for block in blocks]),
            scale=np.concatenate([block.scale for block in blocks]),
            matrix=np.concatenate([block.matrix for block in blocks]),
            has_matrix=np.concatenate([block.has_matrix for block in blocks]),
            names=[text for block in blocks for text in block.names],
            weights={node: value for block in blocks for node, value in block.weights.items()},
            extras={node: value for block in blocks for node, value in block.extras.items()},
        )


def _single(matrix: Float64, name: str) -> Nodes:
    return Nodes(
        np.array([-1], np.int32),
        np.zeros((1, 3)),
        np.array([(0.0, 0.0, 0.0, 1.0)]),
        np.ones((1, 3)),
        matrix[None],
        np.ones(1, bool),
        [name],
    )


def _joined(parts: list[Instances]) -> Instances:
    local = None
    if any(part.local is not None for part in parts):
        local = np.concatenate(
            [np.tile(np.eye(4), (len(part), 1, 1)) if part.local is None else part.local for part in parts]
        )
    return Instances(
        np.concatenate([part.node for part in parts]),
        np.concatenate([part.mesh for part in parts]),
        local,
        np.concatenate([part.visible for part in parts]),
    )


def _first(values: Iterable[Value | None]) -> Value | None:
    return next((value for value in values if value is not None), None)
