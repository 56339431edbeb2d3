"""Study: a mesh from buffers, with a picture on it. Vertices, indices, texels, mip levels, and light against codes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.camera import View
from common.lessons import OWN, Study
from common.primitive import Primitive, scene_of
from common.scene import Image, Material, Scene, TextureRef
from common.settings import knob
from common.transforms import rotation, translation

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


def matrices(scene: Scene, view: View, turn: float, aspect: float) -> np.ndarray:
    """Return view_from_object and clip_from_view, columns first (2, 4, 4) float32; `turn` is about the vertical.

    The object is given relative to its centre, and turns about that.
    """
    world_from_object = translation(scene.origin) @ rotation((0.0, 1.0, 0.0), turn)
    view_from_object = view.view_from_world() @ world_from_object
    return np.stack([view_from_object.T, view.clip_from_view(aspect).T]).astype(np.float32)


def uniforms(scene: Scene, primitive: Primitive, view: View, time: float, aspect: float) -> np.ndarray:
    """Return what the shaders read, (36,) float32: both matrices, and the material's base colour."""
    turns = matrices(scene, view, time % (2.0 * np.pi), aspect)  # one radian a second
    return np.concatenate([turns.ravel(), np.array(primitive.material.base_color, np.float32)])


UNIFORM_BYTES = 36 * 4


def own_scene() -> Scene:
    """Return a cube of two metres, each face with the whole picture: 24 vertices, since faces share no uv."""
    corner = np.array([(-1, 1), (-1, -1), (1, -1), (1, 1)], np.float64)  # top left first, then around
    positions, normals = [], []
    for axis in range(3):
        for side in (1.0, -1.0):
            normal = np.roll((side, 0.0, 0.0), axis)
            up = np.array((0.0, 1.0, 0.0)) if axis != 1 else np.array((0.0, 0.0, -side))
            right = np.cross(up, normal)
            positions.append(normal + corner[:, :1] * right + corner[:, 1:] * up)
            normals.append(np.tile(normal, (4, 1)))
    # On each face the picture is turned by another quarter: the faces can be told apart.
    uv = np.concatenate([np.roll([(0, 0), (0, 1), (1, 1), (1, 0)], face, axis=0) for face in range(6)])
    indices = (4 * np.arange(6)[:, None] + np.array([0, 1, 2, 0, 2, 3])).ravel()
    material = Material(name="tiles", metallic=0.0, base_color_texture=TextureRef(0))
    image = Image("tiles", tiles())
    return scene_of(
        "tiles", np.concatenate(positions), np.concatenate(normals), uv, indices, material, [image]
    )


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
