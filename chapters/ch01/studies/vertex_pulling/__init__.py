"""Study: the vertex shader fetches its vertex itself, from a storage buffer. The same bytes, the same picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import OWN, Study
from common.scene import Scene
from common.scene.primitive import Primitive, matrices
from common.settings import knob
from common.view.camera import View

from ..drawing import Attribute, Drawn
from ..textured_mesh import own_scene

__all__ = ["STUDY", "own_scene"]

STUDY = Study(
    title="vertex pulling",
    idea="A vertex buffer is memory like any other: the shader can read it itself, and then decide what to read.",
    order=34,
    features=("geometry/vertex-pulling",),
    outputs=("color", "depth"),
    scene=OWN,
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    feed: str = knob("pulled", "what fetches vertices", choices=("pulled", "attributes"))
    instance: int = knob(0, "number of the object that is drawn", minimum=0)


VERTEX = np.dtype([("position", np.float32, 3), ("uv", np.float32, 2)])
"""20 bytes without a gap, which is how `float x, y, z, u, v` lie in std430; a vec3 there would begin at every 16th."""

UNIFORM_BYTES = 2 * 64


def drawn(settings: Settings) -> Drawn:
    """Return the draw: with a table of attributes for the GPU's own fetch, or without one."""
    shaders = ("mesh.vert", "mesh.frag")
    if settings.feed == "pulled":
        return Drawn(shaders, defines=(("PULLED", 1),))
    attributes = (Attribute(0, 3, 0), Attribute(1, 2, 12))
    return Drawn(shaders, attributes=attributes, stride=VERTEX.itemsize, defines=(("PULLED", 0),))


def vertices_of(primitive: Primitive) -> np.ndarray:
    """Return (V,) VERTEX: all that a vertex has, side by side."""
    vertices = np.zeros(len(primitive.positions), VERTEX)
    vertices["position"], vertices["uv"] = primitive.positions, primitive.uv
    return vertices


def uniforms(scene: Scene, view: View, time: float, aspect: float) -> np.ndarray:
    """Return what the shaders read, (2, 4, 4) float32: both matrices."""
    return matrices(scene, view, 0.5 * time % (2.0 * np.pi), aspect)
