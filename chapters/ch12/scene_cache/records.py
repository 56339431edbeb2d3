"""A scene taken apart into arrays and one text of JSON, and put together again: what a scene cache holds but pictures.

What there is one of for each vertex, node or key of an animation is an array, which the cache maps. What is small and
irregular (names, materials, lights, extras) is JSON, whose parser is the fastest thing in Python that makes objects.
JSON names an array by its number. Floats come back with every bit: Python writes the shortest text that does.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from common.environment.medium import medium_of
from common.scene import (
    MESH_DTYPE,
    Animation,
    AnimationChannel,
    Deformation,
    Image,
    Instances,
    Light,
    Material,
    Nodes,
    Sampler,
    Scene,
    SceneCamera,
    TextureRef,
)

Add = Callable[[np.ndarray[Any, Any]], int]
"""Stores an array and returns its number."""
Get = Callable[[int], Any]
"""Returns the array of a number."""

_VERTICES = ("positions", "normals", "tangents", "uv0", "uv1", "colors", "indices")
_NODES = ("parent", "translation", "rotation", "scale", "matrix", "has_matrix")
_DEFORMING = (
    "joints",
    "inverse_bind",
    "vertex_joints",
    "vertex_weights",
    "morph_positions",
    "morph_normals",
    "morph_tangents",
)


def take_apart(scene: Scene, add: Add) -> str:
    """Return the JSON of a scene without its images, after every array of it went to `add`.

    An environment and an exposure that were set after loading are not part of it.
    """

    def stored(array: np.ndarray[Any, Any] | None) -> int | None:
        if array is None:
            return None
        if array.dtype == np.bool_:
            return add(array.view(np.uint8))
        return add(array)

    samplers: dict[Sampler, int] = {}
    textures: dict[TextureRef, int] = {}
    for material in scene.materials:
        for texture in material.textures().values():
            samplers.setdefault(texture.sampler, len(samplers))
            textures.setdefault(texture, len(textures))
    nodes, instances = scene.nodes, scene.instances
    value = {
        "name": scene.name,
        "vertices": [stored(getattr(scene, name)) for name in _VERTICES],
        "meshes": stored(np.ascontiguousarray(scene.meshes).view(np.uint8)),
        "mesh_names": scene.mesh_names,
        "samplers": [list(vars(sampler).values()) for sampler in samplers],
        "textures": [list((vars(it) | {"sampler": samplers[it.sampler]}).values()) for it in textures],
        "materials": [
            [textures[field] if isinstance(field, TextureRef) else field for field in vars(material).values()]
            for material in scene.materials
        ],
        "nodes": [stored(getattr(nodes, name)) for name in _NODES],
        "node_names": nodes.names,
        "weights": [[node, stored(weights)] for node, weights in nodes.weights.items()],
        "extras": list(nodes.extras.items()),
        "instances": [
            stored(array) for array in (instances.node, instances.mesh, instances.local, instances.visible)
        ],
        "lights": [list(vars(light).values()) for light in scene.lights],
        "cameras": [list(vars(camera).values()) for camera in scene.cameras],
        "animations": [
            [
                clip.name,
                clip.duration,
                [[c.node, c.path, stored(c.times), stored(c.values), c.interpolation] for c in clip.channels],
            ]
            for clip in scene.animations
        ],
        "deformations": [
            [it.mesh, it.node, it.flat, [stored(getattr(it, name)) for name in _DEFORMING]]
            for it in scene.deformations
        ],
        "ambient": scene.ambient,
        "medium": None if scene.medium is None else asdict(scene.medium),
        "ev100": scene.ev100,
        "warnings": scene.warnings,
    }
    return json.dumps(value, separators=(",", ":"), default=_number)


def _number(value: Any) -> Any:
    """Return a number of numpy's as Python's own."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a scene cache holds no {type(value).__name__}")


def put_together(text: str, get: Get, images: list[Image], path: Path) -> Scene:
    """Return the scene of which `take_apart` returned `text`; `get` returns the arrays that it stored."""
    value = json.loads(text)

    def stored(number: int | None) -> Any:
        return None if number is None else get(number)

    def flags(number: int) -> Any:
        return get(number).view(np.bool_)

    samplers = [Sampler(*row) for row in value["samplers"]]
    textures = [
        TextureRef(image, samplers[sampler], uv_set, tuple(offset), rotation, tuple(scale))
        for image, sampler, uv_set, offset, rotation, scale in value["textures"]
    ]
    parent, translation, rotation, scale, matrix, has_matrix = value["nodes"]
    node, mesh, local, visible = value["instances"]
    vertices = dict(zip(_VERTICES, map(stored, value["vertices"]), strict=True))
    return Scene(
        name=value["name"],
        path=path,
        **vertices,
        meshes=get(value["meshes"]).view(MESH_DTYPE),
        mesh_names=value["mesh_names"],
        materials=[_made(Material, row, textures) for row in value["materials"]],
        images=images,
        nodes=Nodes(
            parent=get(parent),
            translation=get(translation).copy(),  # as the others below: edits write to it
            rotation=get(rotation).copy(),
            scale=get(scale).copy(),
            matrix=get(matrix).copy(),
            has_matrix=flags(has_matrix).copy(),
            names=value["node_names"],
            weights={owner: get(number) for owner, number in value["weights"]},
            extras=dict(value["extras"]),
        ),
        instances=Instances(get(node), get(mesh), stored(local), flags(visible).copy()),
        lights=[_made(Light, row) for row in value["lights"]],
        cameras=[SceneCamera(*row) for row in value["cameras"]],
        animations=[
            Animation(
                name,
                tuple(
                    AnimationChannel(owner, kind, get(times), get(values), interpolation)
                    for owner, kind, times, values, interpolation in channels
                ),
                duration,
            )
            for name, duration, channels in value["animations"]
        ],
        deformations=[
            Deformation(of, owner, **dict(zip(_DEFORMING, map(stored, arrays), strict=True)), flat=flat)
            for of, owner, flat, arrays in value["deformations"]
        ],
        ambient=value["ambient"],
        medium=medium_of({"fog": value["medium"]}),
        ev100=value["ev100"],
        warnings=value["warnings"],
    )


def _made(kind: Any, row: list[Any], textures: list[TextureRef] | None = None) -> Any:
    """Return an object from its fields; the last five of a material, its textures, are numbers or None."""
    fields: list[Any] = [tuple(field) if isinstance(field, list) else field for field in row]
    if textures is not None:
        fields[-5:] = [None if number is None else textures[number] for number in fields[-5:]]
    return kind(*fields)
