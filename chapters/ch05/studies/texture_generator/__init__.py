"""Study: a kernel writes a texture, texel by texel, and runs shaders that were written for another host.

A fragment shader can fill a texture as well; it needs a target, a triangle and a pipeline that rasterizes. A kernel
needs only the texel of each invocation: work groups of 16x16 stand side by side, `ceil(width / 16)` of them in a row.
If the size is no multiple of 16, the last groups reach over the edge, and the kernel checks before it writes.

The host ([`toy.glsl`](toy.glsl)) gives a shader the interface of Shadertoy: `mainImage`, `iTime` and `iResolution`,
which it reads from the image itself, so that it is always right. Most shaders from there run here as they are. Put
yours beside the others, as `mine.comp` with `#include "toy.glsl"` as its first line, and choose it:
`--set shader=mine`.

The texture is computed again only if its input changes: while time stands still, nothing is dispatched.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backends.contract import check_size
from backends.stage import Work
from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="texture generator",
    idea="A kernel can write a texture: groups of 16x16 cover it, and those over the edge ask before they write.",
    order=2,
    features=("compute/texture-generator",),
    outputs=("color", "texture"),
)

FOLDER = Path(__file__).resolve().parent
SHADERS = ("post/fullscreen.vert", "studies/texture_generator/show.frag")
TEXELS = Sampler("nearest", "nearest", None, "clamp", "clamp")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    shader: str = knob(
        "rings",
        "what is computed for each texel",
        choices=tuple(sorted(path.stem for path in FOLDER.glob("*.comp"))),
    )
    width: int = knob(0, "width of the texture; 0: the picture's", minimum=0, maximum=16384)
    height: int = knob(0, "height of the texture; 0: the picture's", minimum=0, maximum=16384)


@dataclass
class KernelWork(Work):
    """What a frame did: `dispatches` is 0 if the texture was still valid."""

    dispatches: int = 0


def kernel(settings: Settings) -> str:
    """Return the file of a shader for pipelines, which also take an absolute path."""
    return f"studies/texture_generator/{settings.shader}.comp"


def texture_size(settings: Settings, picture: tuple[int, int], limit: int) -> tuple[int, int]:
    """Return (width, height) of the texture. Raises UserError for a size beyond the device's limit."""
    return check_size((settings.width or picture[0], settings.height or picture[1]), limit)


def push(time: float) -> np.ndarray:
    """Return the push constants of a kernel, (4,) float32: the time, in seconds."""
    return np.array([time, 0.0, 0.0, 0.0], np.float32)
