"""Study: materials as callable shaders. A hit runs the shader of its material by a number, as by a function pointer.

A shader binding table has four regions; the fourth holds callable shaders. `executeCallableEXT(n, 0)` runs the shader
of record n, which gets and gives the variable of location 0: here the place of a hit comes in, and a colour goes out.
The closest-hit shader knows nothing of materials but their numbers, so another material is a file and a record, and
no shader that exists is compiled again. A call costs what a shader call costs: the compiler cannot see into it, and
rays that are traced together may call different shaders.

--set shading=inline has all materials in the closest-hit shader, by a `switch`. The functions are the same
(materials.glsl), so pictures are, too. --set linked=true compiles each group as a library by itself, and links the
pipeline from them (VK_KHR_pipeline_library): pixels stay the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.lessons import OWN, Study
from common.scene import Scene
from common.settings import knob

from ..seen import camera_scene

STUDY = Study(
    title="callables",
    idea="A hit calls the shader of its material by a number of the binding table.",
    order=3,
    features=("ray-tracing/callable-and-libraries",),
    scene=OWN,
)

FOLDER = "studies/callables"
RAYGEN, MISS, CLOSEST = f"{FOLDER}/start.rgen", f"{FOLDER}/sky.rmiss", f"{FOLDER}/shade.rchit"

MATERIALS = ("checks", "rings", "stripes", "spots")
"""The materials, in the order of their records."""

CALLABLES = tuple(f"{FOLDER}/{name}.rcall" for name in MATERIALS)

BLOCKS = 9
"""Blocks in a row, of which there are as many; the ground is one more."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    shading: str = knob(
        "callable",
        "where materials are: callable shaders, or all in the closest-hit shader",
        choices=("callable", "inline"),
    )
    linked: bool = knob(False, "whether the pipeline is linked from libraries, one for each group")
    first: int = knob(0, "number of the material of the first block", minimum=0, maximum=len(MATERIALS) - 1)


def own_scene() -> Scene:
    """Return a camera before the blocks; the study knows them."""
    return camera_scene("blocks", (3.4, 4.2, 6.4), (0.0, 0.1, 0.0), math.radians(40.0))


def boxes() -> NDArray[np.float64]:
    """Return (N, 2, 3) the corners of all blocks by lot of heights, and of the ground last."""
    places = (np.arange(BLOCKS) - (BLOCKS - 1) / 2) * 0.6
    x, z = (it.reshape(-1) for it in np.meshgrid(places, places))
    heights = np.random.default_rng(5).uniform(0.15, 0.9, len(x))
    low = np.stack([x - 0.24, np.zeros(len(x)), z - 0.24], axis=1)
    high = np.stack([x + 0.24, heights, z + 0.24], axis=1)
    ground = np.array([[(-3.4, -0.2, -3.4), (3.4, 0.0, 3.4)]])
    return np.concatenate([np.stack([low, high], axis=1), ground])


def triangles() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return positions (V, 3) and indices (T, 3) of all blocks, 12 triangles each, counter-clockwise from outside."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    block = boxes()
    positions = np.where(corners[None] == 1, block[:, None, 1], block[:, None, 0])
    faces = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    own = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]], axis=1).reshape(-1, 3)
    indices = 8 * np.arange(len(block))[:, None, None] + own[None]
    return positions.reshape(-1, 3).astype(np.float32), indices.reshape(-1, 3).astype(np.uint32)


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return the macros of the shaders."""
    return (("INLINE", 1),) if settings.shading == "inline" else ()


def faces(settings: Settings) -> NDArray[np.float32]:
    """Return (T, 4) the normal of each triangle, and the number of its material; the next block has the next one."""
    positions, indices = triangles()
    corners = positions.astype(np.float64)[indices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    material = (np.arange(len(indices)) // 12 + settings.first) % len(MATERIALS)
    return np.concatenate([normal, material[:, None]], axis=1).astype(np.float32)
