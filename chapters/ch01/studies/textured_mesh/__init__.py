"""Study: a mesh from buffers, with a picture on it. Vertices, indices, texels, mip levels, and light against codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import OWN, Study
from common.scene import Image, Material, Scene, TextureRef
from common.scene.primitive import Primitive, cube, matrices
from common.settings import knob
from common.view.camera import View

STUDY = Study(
    title="textured mesh",
    idea="A mesh is a list of vertices and one of triangles; a picture on it is read through its mip levels.",
    order=4,
    features=("intro/textured-mesh",),
    outputs=("color", "depth"),
    scene=OWN,
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    instance: int = knob(-1, "number of the object that is drawn; -1: the first with a picture", minimum=-1)


STREAMS = {"positions": (0, 3), "uv": (1, 2)}
"""What each vertex has: (location in the shader, floats)."""


def uniforms(scene: Scene, primitive: Primitive, view: View, time: float, aspect: float) -> np.ndarray:
    """Return what the shaders read, (36,) float32: both matrices, and the material's base colour."""
    turns = matrices(scene, view, time % (2.0 * np.pi), aspect)  # one radian a second
    return np.concatenate([turns.ravel(), np.array(primitive.material.base_color, np.float32)])


UNIFORM_BYTES = 36 * 4


def own_scene() -> Scene:
    """Return a cube of two metres, each face with the whole picture."""
    material = Material(name="tiles", metallic=0.0, base_color_texture=TextureRef(0))
    return cube("tiles", material, [Image("tiles", tiles())])


def tiles(size: int = 256) -> np.ndarray:
    """Return a picture (size, size, 4) uint8 on which every direction can be told, and every mip level."""
    y, x = np.mgrid[:size, :size] / size
    tile = (np.floor(x * 8) + np.floor(y * 8)) % 2
    red, green, blue = 60 + 180 * x, 60 + 150 * (1 - y), 90 + 0 * x
    codes = np.stack([red, green, blue], axis=-1) * (0.45 + 0.55 * tile[..., None])
    fine = (np.floor(x * 64) + np.floor(y * 64)) % 2  # too small for most distances: these become one grey
    corner = (x < 0.5) & (y < 0.5) & (tile == 1)
    codes[corner] = np.stack([255 * fine] * 3, axis=-1)[corner]
    return np.concatenate([np.rint(codes), np.full((size, size, 1), 255)], axis=-1).astype(np.uint8)
