"""Study: the phase function of Henyey and Greenstein, for eight anisotropies g, in two forms that are equal on paper.

A particle turns light that it scatters by an angle; g is the mean of the angle's cosine. Both forms are

    (1 - g^2) / (4 pi d^(3/2)),   d = 1 + g^2 - 2 g cos   (the usual form)
                                  d = (1 - g)^2 + 2 g (1 - cos)   (the stable form, shaders/phase.glsl)

The usual d is a difference of large numbers near the peak, where d is (1 - g)^2 and so 10^-4 for g = 0.99. A cosine
near 1 has lost the angle already: steps of 2^-24 of it are angles of 3.5e-4. The stable form takes 1 - cos, which is
half the squared distance of the two directions.

The left of the picture is polar: light comes from the left, and the radius is the logarithm of the light in a
direction; rings are powers of ten of what an isotropic particle scatters. On the right is a row for each g, from above,
over 1 - cos from 2^-31 (left) to 2. The height of bars is the relative error, 10^-8 to 1: red for the usual form, green
for the stable one. Truth is float64, for the directions as float32 holds them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

from .exact import NODES, OCTAVES, POINTS, directions, exact, nodes

STUDY = Study(
    title="phase functions",
    idea="A formula keeps its digits near the peak if it is a sum of small numbers.",
    order=2,
    features=("fog/henyey-greenstein",),
)

ANISOTROPIES = (-0.5, 0.0, 0.3, 0.6, 0.8, 0.9, 0.95)
"""g of the lobes, and of the rows from above, but for the last one, which is that of the settings."""

LOBES = len(ANISOTROPIES) + 1

FOLDER = "studies/phase_functions"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNEL = f"{FOLDER}/phases.comp"
VALUE_BYTES = 16 * POINTS * LOBES

ROW = np.dtype(
    [
        ("g", np.float32),
        ("integral", np.float64),
        ("mean_cosine", np.float64),
        ("stable", np.float64),
        ("usual", np.float64),
    ]
)
"""A row of the table: both integrals of the stable form, and the largest relative error of each form."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    anisotropy: float = knob(0.99, "mean cosine of the last lobe and row", minimum=0.0, maximum=0.99)


@dataclass
class PhaseWork(Work):
    """What a frame did."""

    dispatches: int = 0


def work() -> PhaseWork:
    """Return the counters of a frame that are known without the GPU."""
    return PhaseWork(draws=1, triangles=1, dispatches=1)


def defines() -> tuple[tuple[str, int | float], ...]:
    """Return the macros of the shaders."""
    return (("OCTAVES", OCTAVES), ("NODES", NODES), ("POINTS", POINTS), ("LOBES", LOBES))


def anisotropies(settings: Settings) -> NDArray[np.float32]:
    """Return g of each lobe, (LOBES,) float32."""
    return np.array([*ANISOTROPIES, settings.anisotropy], np.float32)


def given() -> NDArray[np.float32]:
    """Return what the kernel reads, (POINTS, 4) float32: the direction in which light leaves, 1 - cos of the node."""
    rows: NDArray[np.float32] = np.concatenate(
        [directions()[1], nodes()[0][:, None].astype(np.float32)], axis=1
    )
    return rows


def truth(settings: Settings) -> NDArray[np.float32]:
    """Return the exact values as (LOBES, POINTS, 2) float32: nearest, and what is left."""
    nearest = exact(anisotropies(settings)).astype(np.float32)
    return np.stack([nearest, (exact(anisotropies(settings)) - nearest).astype(np.float32)], axis=-1)


def push(settings: Settings, size: tuple[int, int]) -> NDArray[np.float32]:
    """Return the push constants, (12,) float32: the direction in which light arrives, the picture's size, all g."""
    return np.concatenate([directions()[0], [0.0], size, [0.0, 0.0], anisotropies(settings)]).astype(
        np.float32
    )


def table(settings: Settings, values: NDArray[np.float32]) -> NDArray[np.void]:
    """Return a ROW for each g, of values (LOBES, POINTS, 4): at nodes, then both forms between directions."""
    at, weights = nodes()
    rows = np.zeros(LOBES, ROW)
    lit = values[..., 0] * weights * 2 * np.pi
    off = np.abs(values[..., 1:3] / exact(anisotropies(settings))[..., None] - 1).max(axis=1)
    rows["g"], rows["integral"] = anisotropies(settings), lit.sum(axis=1)
    rows["mean_cosine"] = (lit * (1 - at)).sum(axis=1)
    rows["stable"], rows["usual"] = off[:, 0], off[:, 1]
    return rows


def told(settings: Settings, values: NDArray[np.float32]) -> dict[str, int]:
    """Return counters in parts of 10^9, by hundredths of g: how far the integral is from 1 and the mean cosine from g,
    and the largest relative errors of the stable and the usual form."""
    counters = {}
    for row in table(settings, values):
        g = round(100 * float(row["g"]))
        off = {"integral": row["integral"] - 1, "cosine": row["mean_cosine"] - row["g"]}
        for name, value in (off | {"stable": row["stable"], "usual": row["usual"]}).items():
            counters[f"{name}_{g}"] = round(1e9 * abs(float(value)))
    return counters
