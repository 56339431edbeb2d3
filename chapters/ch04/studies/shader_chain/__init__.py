"""Study: effects in a row. Each is one fragment shader over the whole picture, and reads what the one before it wrote.

No pass may read the target that it writes, and two targets are enough for a chain of any length: passes write them in
turn, and read the other ("ping-pong"). What is written is rounded to the targets' format in every pass; a pass that
only copies changes nothing, however often it is repeated, since a code that is read back is stored as the same code.

A new effect is a new file. Which textures it wants, it says by declaring them: `source` is what the pass before wrote,
`original` what the chain began with, and other names are those of `textures()`. The pipeline, the layout of its
set and the set follow from that by reflection.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.errors import UserError
from common.lessons import Study
from common.names import suggest
from common.scene import Sampler
from common.settings import knob

STUDY = Study(
    title="shader chain",
    idea="Effects are passes in a row that write two targets in turn, and a new effect is one shader and no more code.",
    order=7,
    features=("composition/composite-processor",),
    outputs=("color", "result"),
)


@dataclass(frozen=True)
class Pass:
    """A full-screen pass: its fragment shader, a file beside this one, and what it is told."""

    fragment: str
    defines: tuple[tuple[str, int], ...] = ()


COPY = Pass("copy.frag")
BLUR = (Pass("blur.frag", (("DOWN", 0),)), Pass("blur.frag", (("DOWN", 1),)))
EFFECTS = {
    "none": (),
    "blur": BLUR * 4,
    "sharpen": (*BLUR, Pass("sharpen.frag")),
    "duotone": (Pass("duotone.frag"),),
}
"""Chains by name, to be seen one by one or put behind one another."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    effect: str = knob("sharpen", "what the passes do", choices=tuple(EFFECTS))
    copies: int = knob(1, "passes before it that only copy", minimum=1, maximum=256)
    format: str = knob("rgba16f", "format of the two targets", choices=("rgba8", "rgba16f", "rgba32f"))


TEXELS = Sampler("nearest", "nearest", None, "clamp", "clamp")
EMPTY = (0.0, 0.0, 0.0, 0.0)


def chain(settings: Settings) -> list[Pass]:
    """Return the chain."""
    return [COPY] * settings.copies + list(EFFECTS[settings.effect])


def shaders(described: Pass) -> tuple[str, str]:
    """Return the files of a pass, as pipelines take them; a path of yours that begins at the root stays as it is."""
    return "post/fullscreen.vert", Path("studies", "shader_chain", described.fragment).as_posix()


def original(size: tuple[int, int]) -> np.ndarray:
    """Return what the chain begins with, (H, W, 4) from 0 to 1: rings that become finer, behind coloured tiles."""
    width, height = size
    x, y = np.meshgrid((np.arange(width) + 0.5) / height, (np.arange(height) + 0.5) / height)
    rings = 0.5 + 0.5 * np.cos(60.0 * ((x - 0.9) ** 2 + (y - 0.5) ** 2))
    tile = (np.floor(8.0 * x) + np.floor(8.0 * y)) % 2
    pixels = np.stack([rings, 0.7 * rings + 0.2 * tile, 0.2 + 0.6 * tile * y, np.ones_like(x)], axis=-1)
    return np.clip(pixels, 0.0, 1.0)


def textures() -> dict[str, np.ndarray]:
    """Return what passes may read beside pictures, (H, W, 4) uint8 each: the ramp of 256 colours of duotone.frag."""
    level = np.linspace(0.0, 1.0, 256)[None, :, None]
    ramp = np.array([0.1, 0.05, 0.3]) * (1.0 - level) + np.array([1.0, 0.85, 0.5]) * level
    return {"ramp": stored(np.concatenate([ramp, np.ones((1, 256, 1))], axis=-1), "rgba8")}


def stored(values: np.ndarray, format: str) -> np.ndarray:
    """Return numbers as texels of a format: codes of 8 bits, or floats of 16 or 32."""
    if format == "rgba8":
        return np.rint(255.0 * values).astype(np.uint8)
    return values.astype(np.float16 if format == "rgba16f" else np.float32)


def check(reader: Pass, wanted: Collection[str], known: Collection[str]) -> None:
    """Raise UserError for a pass whose shader reads a texture that the chain does not have."""
    for name in wanted:
        if name not in known:
            near = suggest(name, known)
            end = "" if near.endswith("?") else "."
            raise UserError(
                f"{reader.fragment} reads a texture {name!r}, which this chain does not have{near}{end}"
            )
