"""Scenes made to grow: any number of squares, materials and textures, for measuring what each of them costs.

The squares of a crowd cover few pixels, so that what is measured is the price of an object and not of its pixels. They
lie in one plane without touching one another: in whatever order they are drawn, the picture is the same to the bit.
Those of `layers` are the opposite: few, and each of them covers every pixel.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at, rotation
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

TEXTURE_SIZES = ((8, 8), (16, 8), (16, 16))
"""(width, height) of the textures, in turn: a renderer that groups them by size has several groups."""

GAP = 0.2
"""What lies between two squares, as a part of their distance."""

DISTANCE = 2.0
"""Metres from the camera to the nearest of the layers."""


def crowd(draws: int, materials: int) -> Scene:
    """Return `draws` squares on a grid that share `materials`, of which each has a texture of its own.

    Neighbours have different materials: drawing in the scene's order binds another material for every square. With
    fewer squares than materials, each square has its own and the rest is left out.

    Raises ValueError for fewer than one of either.
    """
    if min(draws, materials) < 1:
        raise ValueError(f"a crowd has at least one square and one material, not {draws} and {materials}")
    materials = min(draws, materials)
    images = _images(materials)
    grid_materials = [
        Material(name=f"material {number}", metallic=0.0, base_color_texture=TextureRef(number))
        for number in range(materials)
    ]
    return _grid(
        f"{draws} squares of {materials} materials", np.arange(draws) % materials, grid_materials, images
    )


def kinds() -> Scene:
    """Return one square for each of some kinds of material, for which renderers build different pipelines.

    They have no texture, one, and all five, and then these are masked and transparent too. It is not every kind there
    is: drivers in software compile each for most of a second.
    """
    images = _images(len(TEXTURE_SIZES))
    roles = [field.name for field in fields(Material) if field.name.endswith("_texture")]
    kinds = []
    for count in (0, 1, len(roles)):
        used: dict[str, Any] = {
            role: TextureRef(number % len(images)) for number, role in enumerate(roles[:count])
        }
        kinds.append(Material(f"{count} textures", emissive=(0.1, 0.1, 0.1), **used))
    kinds += [replace(kinds[-1], name="masked", alpha_mode="mask")]
    kinds += [replace(kinds[-1], name="transparent", alpha_mode="blend")]
    return _grid("kinds of materials", np.arange(len(kinds)), kinds, images)


def layers(count: int, lights: int = 32) -> Scene:
    """Return `count` squares one behind the other, the farthest first, of which each covers the whole picture.

    Drawn in the scene's order every one of them is nearer than all before it, and so is shaded in vain but for the
    last: `count` times as many fragments as pixels, each lit by `lights` lamps that stand before them.

    Raises ValueError for less than one layer.
    """
    if count < 1:
        raise ValueError(f"there is at least one layer, not {count}")
    images = _images(2)
    layers = [
        Material(
            name=f"layer {number}",
            metallic=0.0,
            roughness=0.5,
            base_color_texture=TextureRef(number, scale=(9, 9)),
        )
        for number in range(2)
    ]
    depth = np.arange(count)[::-1] * 0.25  # m behind the nearest
    local = np.zeros((count, 4, 4))
    local[:, 0, 0] = local[:, 1, 1] = 4 * (DISTANCE + depth)  # more than any picture's shape needs
    local[:, 2, 2] = local[:, 3, 3] = 1.0
    local[:, 2, 3] = -depth
    lamps = np.tile(np.eye(4), (lights, 1, 1))
    turn = np.arange(lights) * np.pi * (3 - np.sqrt(5))  # a sunflower's seeds: evenly over a disc
    radius = DISTANCE * np.sqrt((np.arange(lights) + 0.5) / max(lights, 1))
    lamps[:, :3, 3] = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.ones(lights)], axis=1)
    colours = np.random.default_rng(2).uniform(0.3, 1.0, (lights, 3)).tolist()
    places = np.stack([np.eye(4), pose_looking_at((0, 0, DISTANCE), (0, 0, 0)), *lamps])
    return _squares(
        f"{count} layers under {lights} lamps",
        local,
        np.arange(count)[::-1] % 2,
        layers,
        images,
        places,
        [
            Light("point", 2 + number, f"lamp {number}", tuple(colour), 4.0 / max(lights, 1))
            for number, colour in enumerate(colours)
        ],
        SceneCamera("front", node=1),
    )


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
    places = np.stack([np.eye(4), rotation((1, 1, 0), -0.6), pose_looking_at((0.5, -0.3, 2.1), (0, 0, 0))])
    sun = Light("directional", node=1, name="sun", intensity=3.0)
    return _squares(name, local, material, materials, images, places, [sun], SceneCamera("front", node=2))


def _squares(
    name: str,
    local: np.ndarray,
    material: np.ndarray,
    materials: list[Material],
    images: list[Image],
    places: np.ndarray,
    lights: list[Light],
    camera: SceneCamera,
) -> Scene:
    """Return squares from -1 to 1 at `local` (I, 4, 4), of `material` (I,).

    `places` (N, 4, 4) are those of the nodes: the squares', then those of lights and camera.
    """
    count, nodes = len(material), len(places)
    named = {camera.node: "camera"} | {light.node: light.name for light in lights}
    meshes = np.zeros(len(materials), MESH_DTYPE)  # all of the same square, each in its material
    meshes["index_count"], meshes["vertex_count"] = 6, 4
    meshes["material"] = np.arange(len(materials))
    meshes["bounds_min"], meshes["bounds_max"] = (-1, -1, 0), (1, 1, 0)
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
        mesh_names=[material.name for material in materials],
        materials=materials,
        images=images,
        nodes=Nodes(
            parent=np.full(nodes, -1, np.int32),
            translation=np.zeros((nodes, 3)),
            rotation=np.tile((0.0, 0.0, 0.0, 1.0), (nodes, 1)),
            scale=np.ones((nodes, 3)),
            matrix=places,
            has_matrix=np.ones(nodes, bool),
            names=[named.get(node, "squares") for node in range(nodes)],
        ),
        instances=Instances(np.zeros(count, np.int32), material.astype(np.int32), local),
        lights=lights,
        cameras=[camera],
        animations=[],
        deformations=[],
    )
