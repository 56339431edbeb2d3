"""Study: what a bias does to a plane that is tilted from 0 to 85 degrees, and to the shadow of a sheet close above it.

A shadow map holds one depth for each texel, that of the surface at the texel's centre. A tilted surface is nearer to
the light on one side of the centre and farther on the other, so half of it would be in its own shadow: acne. A bias
moves the surface towards the light before the comparison. What is closer above the surface than the bias casts no
shadow: that is the contact gap. Both failures are measured here, for each tilt and each of five ways:

    none      no bias
    constant  `constant` r, where r is one step of the map's depth: it answers to rounding, and to no slope
    slope     `slope` m, where m is the larger one of the depth's two slopes, for each texel
    both      the sum, which is the depth bias of both APIs (Vulkan specification, "Depth Bias")
    plane     `constant` r, and each texel is compared with the depth of the plane at that texel's centre

All lengths are in texels. The light is directional, and the map's depth is of 32 bits over a range of 1,024 texels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="bias explorer",
    idea="Too little bias puts a slope into its own shadow; too much detaches shadows from what casts them.",
    order=2,
    features=("shadows/depth-bias",),
)

BIASES = ("none", "constant", "slope", "both", "plane")
"""The rows of the picture, from above."""

TILTS = np.arange(0.0, 86.0, 5.0)
"""Degrees between the plane and one that faces the light; the columns of the picture."""

SIDE = 16
"""Texels along an edge of a cell. Over its right half is a sheet."""

MARGIN = 4
"""Texels around a cell that only filters reach."""

HEIGHT = 4.0
"""Texels between plane and sheet at the upper edge of a cell, perpendicular to the plane; 0 at the lower edge."""

MIDDLE = 512.37
"""Texels from the light to the middle of each plane."""

RANGE = 1024.0
"""Texels from depth 0 to depth 1. It is a power of two, so a depth in texels has the bits of a depth from 0 to 1."""

SAMPLES = 64
"""Points along each edge of a cell that are counted: four for each texel."""

FOLDER = "studies/bias_explorer"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNELS = (f"{FOLDER}/record.comp", f"{FOLDER}/count.comp")

COUNTS = np.dtype([("acne", np.uint32), ("gap", np.uint32)])
"""Of a cell: points of the bare half that are in shadow, and the highest row of the other half that is lit, from 1."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    constant: float = knob(4.0, "steps of the depth that are always subtracted", minimum=0.0, maximum=1e8)
    slope: float = knob(1.5, "slopes of the depth that are subtracted", minimum=0.0, maximum=64.0)
    radius: int = knob(
        0, "texels around the one at a point that the filter reads", minimum=0, maximum=MARGIN - 1
    )
    turn: float = knob(
        0.0, "degrees from the rows of texels to the direction of the tilt", minimum=0.0, maximum=90.0
    )


@dataclass
class BiasWork(Work):
    """What a frame did: points of all cells that were `compared`."""

    dispatches: int = 0
    compared: int = 0


def work_of(settings: Settings) -> BiasWork:
    """Return the counters of a frame that are known without the GPU."""
    return BiasWork(draws=1, triangles=1, dispatches=2, compared=SAMPLES**2 * len(BIASES) * len(TILTS))


def defines(settings: Settings) -> tuple[tuple[str, int | float], ...]:
    """Return the macros of the shaders."""
    return (
        ("SIDE", SIDE),
        ("MARGIN", MARGIN),
        ("HEIGHT", HEIGHT),
        ("MIDDLE", MIDDLE),
        ("SAMPLES", SAMPLES),
        ("RADIUS", settings.radius),
        ("TILTS", len(TILTS)),
        ("BIASES", len(BIASES)),
    )


def planes(settings: Settings) -> np.ndarray:
    """Return (T, 2, 4) float32 for each tilt: its cosine, sine and tangent, the constant bias; the direction of the
    tilt along rows and columns of texels, the slope bias, and 0.

    One step r of a float's depth is 2^-23 of the power of two below the largest depth of the plane.
    """
    tilt, turn = np.radians(TILTS), np.radians(settings.turn)
    along, down = np.cos(turn), np.sin(turn)
    reach = (0.5 * SIDE + MARGIN) * (along + down)
    deepest = (MIDDLE + reach * np.tan(tilt)) / RANGE
    step = 2.0 ** (np.floor(np.log2(deepest)) - 23) * RANGE
    slope = settings.slope * np.tan(tilt) * max(along, down)
    same = np.ones(len(TILTS))
    rows = [np.cos(tilt), np.sin(tilt), np.tan(tilt), settings.constant * step]
    rows += [along * same, down * same, slope, 0.0 * same]
    return np.stack(rows, axis=-1).reshape(-1, 2, 4).astype(np.float32)


def heights() -> np.ndarray:
    """Return (SAMPLES,) texels between plane and sheet at the counted points, from the lowest row on."""
    return (np.arange(SAMPLES) + 0.5) / SAMPLES * HEIGHT


def table(counts: np.ndarray) -> dict[str, np.ndarray]:
    """Return from COUNTS (B, T) of all cells the points with `acne`, and the `gap` in texels."""
    gap = np.concatenate([[0.0], heights()])[counts["gap"]]
    return {"acne": counts["acne"].astype(int), "gap": gap}


def told(counts: np.ndarray) -> dict[str, int]:
    """Return counters of a frame: for each bias the points with acne, and its widest gap in thousandths of a texel."""
    failures = table(counts)
    acne = {f"acne_{bias}": int(row.sum()) for bias, row in zip(BIASES, failures["acne"], strict=True)}
    gaps = {f"gap_{bias}": round(1000 * row.max()) for bias, row in zip(BIASES, failures["gap"], strict=True)}
    return acne | gaps


def cells(content: np.ndarray) -> np.ndarray:
    """Return COUNTS (B, T) from the bytes of the buffer that count.comp fills."""
    return content.view(COUNTS).reshape(len(BIASES), len(TILTS))
