"""Study: the edges of all triangles, drawn over their faces. Polygon mode and offset, or barycentric coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.contract import Plan, resolve
from common.lessons import OWN, Study
from common.scene import Material, Scene
from common.scene.primitive import Primitive, matrices, scene_of
from common.settings import knob
from common.view.camera import View

from ..drawing import Attribute, Drawn

STUDY = Study(
    title="wireframe",
    idea="Edges lie in their faces: one of the two must be moved, or each pixel must know how far its edges are.",
    order=30,
    features=("debug-draw/wireframe",),
    scene=OWN,
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    way: str = knob("barycentric", "how edges are found", choices=("barycentric", "line"))
    thickness: float = knob(
        1.5, "pixels from an edge to full face colour; barycentric only", minimum=0.5, maximum=20.0
    )
    push_back: float = knob(
        1.0, "how far faces are moved behind their edges, in depth steps of one pixel; line only", minimum=0.0
    )
    instance: int = knob(0, "number of the object that is drawn", minimum=0)


FACE, EDGE = (0.55, 0.68, 0.80), (0.05, 0.05, 0.06)
"""Codes of a display: nothing here is light."""

UNIFORM_BYTES = 2 * 64 + 2 * 16
FACES_ONLY, EDGES_ONLY, BOTH = 0, 1, 2


def plan_of(stage_plan: Plan, capabilities: object, without: set[str], settings: Settings) -> Plan:
    """Return the stage's plan with the path that edges take: only the way "line" asks the device for anything."""
    if settings.way != "line":
        return stage_plan
    return resolve((), ("wireframe",), capabilities, without)  # type: ignore[arg-type]


def draws_of(native: bool, settings: Settings) -> list[Drawn]:
    """Return what is drawn, in order: faces and then their edges as lines, or both at once."""

    def drawn(shows: int, filled: bool, push_back: float) -> Drawn:
        return Drawn(
            ("mesh.vert", "mesh.frag"),
            filled=filled,
            push_back=push_back,
            attributes=(Attribute(0, 3, 0),),
            stride=12,
            defines=(("SHOWS", shows),),
        )

    if native and settings.way == "line":
        return [drawn(FACES_ONLY, True, settings.push_back), drawn(EDGES_ONLY, False, 0.0)]
    return [drawn(BOTH, True, 0.0)]


def corners_of(primitive: Primitive) -> np.ndarray:
    """Return (T * 3, 3) float32: the corners of each triangle by itself, so that a vertex's number says which it is."""
    return np.ascontiguousarray(primitive.positions[primitive.indices])


def uniforms(scene: Scene, settings: Settings, view: View, time: float, aspect: float) -> np.ndarray:
    """Return what the shaders read, (40,) float32: both matrices, both colours, the thickness."""
    still = matrices(scene, view, 0.3 * time % (2.0 * np.pi), aspect).ravel()
    return np.concatenate([still, FACE, [1.0], EDGE, [settings.thickness]]).astype(np.float32)


def own_scene() -> Scene:
    """Return a ring of 20 by 9 four-sided faces: some hide others."""
    around, about = np.meshgrid(np.arange(20) * 2 * np.pi / 20, np.arange(9) * 2 * np.pi / 9, indexing="ij")
    radial = np.stack([np.cos(around), np.zeros_like(around), np.sin(around)], axis=-1)
    normals = radial * np.cos(about)[..., None] + np.array((0.0, 1.0, 0.0)) * np.sin(about)[..., None]
    positions = radial + 0.45 * normals
    i, j = np.meshgrid(np.arange(20), np.arange(9), indexing="ij")
    a, b = 9 * i + j, 9 * ((i + 1) % 20) + j
    c, d = 9 * ((i + 1) % 20) + (j + 1) % 9, 9 * i + (j + 1) % 9
    indices = np.stack([a, d, c, a, c, b], axis=-1).ravel()
    uv = np.zeros((180, 2))
    return scene_of("ring", positions.reshape(-1, 3), normals.reshape(-1, 3), uv, indices, Material(), [])
