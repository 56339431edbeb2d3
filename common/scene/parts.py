"""What a scene keeps by number of node, mesh, material or image, carried over to new numbers.

Deleting, merging and converting scenes differ in how they renumber; that every reference follows is one task. A table
of places says it: `place[old]` is the new number, or -1 where the thing is gone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypedDict, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.scene import Animation, Change, Deformation, Light, Material, Nodes, Scene, SceneCamera

Place = NDArray[np.int32]
Value = TypeVar("Value")


class Attached(TypedDict):
    """The parts of a scene that hang on nodes, by the names of their fields."""

    lights: list[Light]
    cameras: list[SceneCamera]
    animations: list[Animation]
    deformations: list[Deformation]


def attached(scene: Scene, place: Place, mesh_place: Place) -> Attached:
    """Return what hangs on the nodes of a scene after they and its meshes moved; what hung on lost nodes is gone.

    A clip without any channel left is gone too; others keep their duration, so that they loop as before.

    Raises:
        UserError: a mesh that stays loses a joint of its skin.
    """
    animations = []
    for clip in scene.animations:
        channels = tuple(
            replace(channel, node=int(place[channel.node]))
            for channel in clip.channels
            if place[channel.node] >= 0
        )
        if channels:
            animations.append(replace(clip, channels=channels))
    return {
        "lights": [
            replace(light, node=int(place[light.node])) for light in scene.lights if place[light.node] >= 0
        ],
        "cameras": [
            replace(camera, node=int(place[camera.node]))
            for camera in scene.cameras
            if place[camera.node] >= 0
        ],
        "animations": animations,
        "deformations": [
            _deformation(scene, deformation, place, mesh_place)
            for deformation in scene.deformations
            if place[deformation.node] >= 0 and mesh_place[deformation.mesh] >= 0
        ],
    }


def _deformation(scene: Scene, skin: Deformation, place: Place, mesh_place: Place) -> Deformation:
    joints = skin.joints
    if joints is not None:
        joints = place[joints]
        if (joints < 0).any():
            assert skin.joints is not None
            lost = int(skin.joints[joints < 0][0])
            raise UserError(
                f"Node {lost} ({scene.nodes.names[lost]!r}) cannot be deleted alone, since it is a joint of mesh "
                f"{scene.mesh_names[skin.mesh]!r}: delete node {skin.node} ({scene.nodes.names[skin.node]!r}) too."
            )
    return replace(skin, node=int(place[skin.node]), mesh=int(mesh_place[skin.mesh]), joints=joints)


def kept_nodes(nodes: Nodes, kept: NDArray[np.bool_]) -> Nodes:
    """Return the nodes where `kept` (N,) is true, in arrays of their own; none of them may lose its parent."""
    place = places_of(kept)
    above = nodes.parent[kept]
    return Nodes(
        parent=np.where(above < 0, -1, place[above]).astype(np.int32),
        translation=nodes.translation[kept],
        rotation=nodes.rotation[kept],
        scale=nodes.scale[kept],
        matrix=nodes.matrix[kept],
        has_matrix=nodes.has_matrix[kept],
        names=[name for name, stays in zip(nodes.names, kept, strict=True) if stays],
        weights=by_node(nodes.weights, place),
        extras=by_node(nodes.extras, place),
    )


def changed(scene: Scene, **fields: Any) -> Scene:
    """Return a scene with other `fields`. It shares geometry and pictures with the old one, but nothing that
    `edit` writes, as long as `fields` has nodes, instances and lights.
    """
    own = {"materials": list(scene.materials), "warnings": list(scene.warnings)}
    return replace(scene, **{**own, **fields}, revision=dict.fromkeys(Change, 0))


def by_node(component: Mapping[int, Value], place: Place) -> dict[int, Value]:
    """Return a map from nodes with its keys renumbered, without those that are gone."""
    return {int(place[node]): value for node, value in component.items() if place[node] >= 0}


def with_images(material: Material, place: Place) -> Material:
    """Return a material whose textures are the same images under new numbers."""
    moved: dict[str, Any] = {
        f"{role}_texture": replace(texture, image=int(place[texture.image]))
        for role, texture in material.textures().items()
    }
    return replace(material, **moved) if moved else material


def same_places(count: int, first: int = 0) -> Place:
    """Return the places of `count` things that move together to `first` and after."""
    return np.arange(first, first + count, dtype=np.int32)


def places_of(kept: NDArray[np.bool_]) -> Place:
    """Return the places after those where `kept` (N,) is false are taken out and the others close up."""
    return np.where(kept, np.cumsum(kept) - 1, -1).astype(np.int32)
