"""Study: fog behind the far end of the grid of froxels, by a march along the ray of each pixel.

A grid that reaches to the horizon would have slices of hundreds of metres. This one ends at `far`; from there on the
ray of a pixel is cut into `steps` steps in a constant ratio of depths. In each step

    extinction   is its mean over the step in closed form, so transmittance is exact, whatever the number of steps
    light        is that of the sun and the sky at the middle of the step, as far as the medium between lets it through

and each step is added as a slice is (`through_segment` of shaders/medium.glsl). The march begins with what the grid has
at its far end, on the same ray, so both meet there without a seam. It needs no memory, and its cost is that of pixels
behind the end. What it lacks are shadows and near lights: far away both are small.

The medium is constant fog, and fog that thins out with height over a plain; the sun is low. Light that the constant fog
takes on the way from the sun is taken off the sun's illuminance once; only height fog dims it by the place. `march=off`
shows what the grid alone does: fog that is no denser behind its end. With `depth`, all that is seen lies at one depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from backends.stage import Work
from common.lessons import OWN, Study
from common.numerics.transforms import pose_looking_at
from common.scene import Nodes, Scene, SceneCamera
from common.scene.primitive import nothing
from common.settings import knob
from common.view.camera import View

STUDY = Study(
    title="far march",
    idea="A march begins where the froxels end, with what they have, so no seam shows.",
    order=3,
    features=("fog/far-range-march",),
    scene=OWN,
)

NEAR = 0.5
"""Metres to the end of the first slice."""

REACH = 4000.0
"""Metres of depth at which the march ends: what is seen of the sky."""

SUN_COLOR = (1.0, 0.8, 0.55)
SKY_COLOR = (0.35, 0.5, 0.8)
FOLDER = "studies/far_march"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNELS = (f"{FOLDER}/grid.comp", f"{FOLDER}/fog.comp")
FROXEL_BYTES = 32


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    march: bool = knob(True, "whether fog goes on behind the grid")
    far: float = knob(40.0, "depth at which the grid ends", unit="m", minimum=1.0, maximum=2000.0)
    steps: int = knob(16, "steps of the march", minimum=1, maximum=1024)
    columns: int = knob(64, "froxels across", minimum=1, maximum=512)
    rows: int = knob(36, "froxels down", minimum=1, maximum=512)
    slices: int = knob(64, "froxels in depth", minimum=1, maximum=512)
    constant: float = knob(0.0003, "extinction of constant fog", unit="1/m", minimum=0.0, maximum=10.0)
    height: float = knob(0.02, "extinction of height fog on the plain", unit="1/m", minimum=0.0, maximum=10.0)
    falloff: float = knob(0.12, "how fast height fog thins out", unit="1/m", minimum=0.001, maximum=10.0)
    albedo: float = knob(0.95, "share of the extinction that scatters", minimum=0.0, maximum=1.0)
    anisotropy: float = knob(0.5, "mean cosine of the phase function", minimum=-0.99, maximum=0.99)
    elevation: float = knob(12.0, "of the sun", unit="degrees", minimum=1.0, maximum=90.0)
    sun: float = knob(1.8, "illuminance of the sun", minimum=0.0, maximum=1e4)
    sky: float = knob(0.4, "luminance of the sky, alike all around", minimum=0.0, maximum=1e4)
    depth: float = knob(0.0, "of all that is seen; 0: the plain", unit="m", minimum=0.0, maximum=REACH)


@dataclass
class MarchWork(Work):
    """What a frame did: froxels that were filled, and pixels whose fog was looked up."""

    dispatches: int = 0
    froxels: int = 0
    pixels: int = 0


def work(settings: Settings, size: tuple[int, int]) -> MarchWork:
    """Return the counters of a frame."""
    froxels = settings.columns * settings.rows * settings.slices
    return MarchWork(draws=1, triangles=1, dispatches=2, froxels=froxels, pixels=size[0] * size[1])


def froxel_bytes(settings: Settings) -> int:
    """Return the size of the grid's buffer."""
    return FROXEL_BYTES * settings.columns * settings.rows * settings.slices


def own_scene() -> Scene:
    """Return a camera 7 m above the plain, and nothing else: shaders know the plain and what lies on it."""
    pose = pose_looking_at((0.0, 7.0, 0.0), (0.0, 5.0, -20.0))[None]
    nodes = Nodes(
        parent=np.array([-1], np.int32),
        translation=np.zeros((1, 3)),
        rotation=np.array([(0.0, 0.0, 0.0, 1.0)]),
        scale=np.ones((1, 3)),
        matrix=pose,
        has_matrix=np.ones(1, bool),
        names=["camera"],
    )
    return replace(nothing("plain"), nodes=nodes, cameras=[SceneCamera("plain", 0, yfov=math.radians(50.0))])


def to_sun(settings: Settings) -> NDArray[np.float64]:
    """Return the direction to the sun, (3,): in front of the camera, to the left."""
    up, around = np.radians(settings.elevation), np.radians(-35.0)
    return np.array([np.cos(up) * np.sin(around), np.sin(up), -np.cos(up) * np.cos(around)])


def block(settings: Settings, view: View, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return what all shaders read (air.glsl), (60,) float32: two matrices by columns, and seven vectors of four."""
    s = settings
    rows = [
        (NEAR, math.log2(s.far / NEAR), s.far, s.anisotropy),
        (s.columns, s.rows, s.slices, s.steps),
        (s.constant, s.height, 0.0, s.falloff),
        (*to_sun(s), s.albedo),
        (*(s.sun * np.array(SUN_COLOR)), s.depth),
        (*(s.sky * np.array(SKY_COLOR)), float(s.march)),
        (*size, REACH, 0.0),
    ]
    matrices = view.clip_from_view(size[0] / size[1]), view.world_from_view
    return np.concatenate([*(matrix.T.ravel() for matrix in matrices), *rows]).astype(np.float32)


BLOCK_BYTES = 4 * 60
