"""Scenes made to grow: any number of small squares, materials and textures, for measuring what each of them costs.

Every square covers few pixels, so that what is measured is the price of an object and not of its pixels. They lie in
one plane without touching one another: in whatever order they are drawn, the picture is the same to the bit.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from common.scene import (
    MESH_DTYPE,
    Image,
    Instances,
    Light,
    Material,
    Nodes,
    Scene,
    SceneCamera,
    TextureRef,
)
from common.transforms import pose_looking_at, rotation

TEXTURE_SIZES = ((8, 8), (16, 8), (16, 16))
"""(width, height) of the textures, in turn: a renderer that groups them by size has several groups."""

GAP = 0.2
"""What lies between two squares, as a part of their distance."""


def crowd(draws: int, materials: int) -> Scene:
    """Return `draws` squares on a grid that share `materials`, of which each has a texture of its own.

    Neighbours have different materials: whoever draws in the scene's order binds another one for every square. With
    fewer squares than materials, each square has its own and the rest is left out.

    Raises ValueError for fewer than one of either.
    """
    if min(draws, materials) < 1:
        raise ValueError(f"a crowd has at least one square and one material, not {draws} and {materials}")
    materials = min(draws, materials)
    images = _images(materials)
    made = [
        Material(name=f"material {number}", metallic=0.0, base_color_texture=TextureRef(number))
        for number in range(materials)
    ]
    return _grid(f"{draws} squares of {materials} materials", np.arange(draws) % materials, made, images)


def kinds() -> Scene:
    """Return one square for each of some kinds of material, for which renderers build different pipelines.

    They have no texture, one, and all five, and then these are masked and transparent too. It is not every kind there
    is: drivers in software compile each for most of a second.
    """
    images = _images(len(TEXTURE_SIZES))
    roles = [field.name for field in fields(Material) if field.name.endswith("_texture")]
    made = []
    for count in (0, 1, len(roles)):
        used: dict[str, Any] = {role: TextureRef(one % len(images)) for one, role in enumerate(roles[:count])}
        made.append(Material(f"{count} textures", emissive=(0.1, 0.1, 0.1), **used))
    made += [replace(made[-1], name="masked", alpha_mode="mask")]
    made += [replace(made[-1], name="transparent", alpha_mode="blend")]
    return _grid("kinds of materials", np.arange(len(made)), made, images)


def _images(count: int) -> list[Image]:
    """Return pictures of noise in the sizes of `TEXTURE_SIZES`, all of them different."""
    random = np.random.default_rng(1)
    pools = [
        random.integers(32, 256, (-(-count // len(TEXTURE_SIZES)), height, width, 4), np.uint8)
        for width, height in TEXTURE_SIZES
    ]
    for pool in pools:
        pool[..., 3] = 255
    return [
        Image(f"texture {number}", pools[number % len(pools)][number // len(pools)])
        for number in range(count)
    ]


def _grid(name: str, material: np.ndarray, materials: list[Material], images: list[Image]) -> Scene:
    """Return squares of `material` (I,) on a grid from -1 to 1 in x and y, lit and seen from the front."""
    count = len(material)
    side = int(np.ceil(np.sqrt(count)))
    column, row = np.arange(count) % side, np.arange(count) // side
    local = np.zeros((count, 4, 4))
    local[:, 0, 0] = local[:, 1, 1] = (1 - GAP) / side
    local[:, 2, 2] = local[:, 3, 3] = 1.0
    local[:, 0, 3] = (2 * column + 1) / side - 1
    local[:, 1, 3] = (2 * row + 1) / side - 1
    meshes = np.zeros(len(materials), MESH_DTYPE)  # all of the same square, each in its material
    meshes["index_count"], meshes["vertex_count"] = 6, 4
    meshes["material"] = np.arange(len(materials))
    meshes["bounds_min"], meshes["bounds_max"] = (-1, -1, 0), (1, 1, 0)
    places = np.stack([np.eye(4), rotation((1, 1, 0), -0.6), pose_looking_at((0.5, -0.3, 2.1), (0, 0, 0))])
    return Scene(
        name=name,
        path=None,
        positions=np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32),
        normals=np.array([(0, 0, 1)] * 4, np.float32),
        tangents=np.array([(1, 0, 0, 1)] * 4, np.float32),
        uv0=np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32),
        uv1=None,
        colors=None,
        indices=np.array([0, 1, 2, 0, 2, 3], np.uint32),
        meshes=meshes,
        mesh_names=[one.name for one in materials],
        materials=materials,
        images=images,
        nodes=Nodes(
            parent=np.full(3, -1, np.int32),
            translation=np.zeros((3, 3)),
            rotation=np.tile((0.0, 0.0, 0.0, 1.0), (3, 1)),
            scale=np.ones((3, 3)),
            matrix=places,
            has_matrix=np.ones(3, bool),
            names=["squares", "sun", "camera"],
        ),
        instances=Instances(np.zeros(count, np.int32), material.astype(np.int32), local),
        lights=[Light("directional", node=1, name="sun", intensity=3.0)],
        cameras=[SceneCamera("front", node=2)],
        animations=[],
        deformations=[],
    )
