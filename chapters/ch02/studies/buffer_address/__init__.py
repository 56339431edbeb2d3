"""Study: a buffer by its address. The shader gets a number and reads what lies there, and no descriptor says what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import OWN, Study
from common.scene import Material, Scene
from common.scene.primitive import Primitive, cube, matrices
from common.settings import knob
from common.view.camera import View

STUDY = Study(
    title="buffer address",
    idea="An address is a number: it can be computed, stored in other buffers, and no layer checks where it leads.",
    order=3,
    outputs=("color", "depth"),
    scene=OWN,
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    feed: str = knob("address", "how the shader reaches vertices", choices=("address", "descriptor"))
    instance: int = knob(0, "number of the object that is drawn", minimum=0)


UNIFORM = np.dtype([("matrices", np.float32, (2, 4, 4)), ("address", np.uint64), ("_padding", np.uint64)])
"""What the shaders read of a frame, 144 bytes: both matrices, and where vertices begin; 0 where a set says so."""

SHADERS = ("studies/buffer_address/mesh.vert", "studies/buffer_address/mesh.frag")


def own_scene() -> Scene:
    """Return a cube of two metres."""
    return cube("cube", Material(), [])


def vertices_of(primitive: Primitive) -> np.ndarray:
    """Return (V, 5) float32: position and uv of each vertex, 20 bytes, as in the study of vertex pulling."""
    return np.hstack([primitive.positions, primitive.uv])


def uniforms(scene: Scene, view: View, time: float, aspect: float, address: int) -> np.ndarray:
    """Return what the shaders read, () UNIFORM; the object turns by half a radian a second."""
    record = np.zeros((), UNIFORM)
    record["matrices"] = matrices(scene, view, 0.5 * time % (2.0 * np.pi), aspect)
    record["address"] = address
    return record
