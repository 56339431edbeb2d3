"""Study: one kernel whose loop has N steps, with N as a constant of the pipeline and as a number that is pushed.

Each element is the mean of N neighbours of a row of noise, weighted by a parabola. [`sum.comp`](sum.comp) declares N as
the specialization constant LENGTH. Its default 0 stands for the pushed number. So one compiled module gives a pipeline
for each N, and one more for all of them. Where N is a constant, the driver may unroll the loop and compute the weights
itself; it takes longer to compile the pipeline. Both ways add the same numbers in the same order: they differ by
rounding alone.

The picture has a column for each N, 1 to 1,024 from left to right: the pushed number on the left of a column, the
constant on its right. Elements that differ by more than rounding would be red. `timings` of a frame has the
milliseconds of each dispatch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

from ...pipelines.compute_description import ComputeDescription

STUDY = Study(
    title="constant loop",
    idea="A loop whose length the driver knows runs faster, and takes longer to compile.",
    order=2,
    features=("specialization/pipeline-constants",),
)

TAPS = tuple(1 << power for power in range(11))
"""N of each column."""

LONGEST = TAPS[-1]
FOLDER = "studies/constant_loop"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNEL = f"{FOLDER}/sum.comp"


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    elements: int = knob(4096, "means of each column", minimum=64, maximum=1 << 20)
    constant: str = knob(
        "specialization",
        "how N becomes a constant: of a pipeline, or by a define of the text, which is compiled for each N",
        choices=("specialization", "define"),
    )


@dataclass
class LoopWork(Work):
    """What a frame did."""

    dispatches: int = 0


def noise(settings: Settings) -> np.ndarray:
    """Return (elements + LONGEST,) float32 numbers from 0 to 1, the same in every run."""
    return np.random.default_rng(9).random(settings.elements + LONGEST, np.float32)


def dispatches() -> list[tuple[str, int, int]]:
    """Return (name, N, LENGTH) of each dispatch, in the order of their results; LENGTH 0 takes N from the push."""
    return [
        (f"{way} {taps}", taps, taps * (way == "constant")) for taps in TAPS for way in ("pushed", "constant")
    ]


def kernel(settings: Settings, length: int) -> ComputeDescription:
    """Return the kernel with a constant LENGTH; with 0 the length is pushed."""
    if settings.constant == "define" and length:
        return ComputeDescription(KERNEL, (("LENGTH", f"{length}u"),))
    return ComputeDescription(KERNEL, specialization=(("LENGTH", length),))


def push(settings: Settings, number: int, taps: int) -> np.ndarray:
    """Return the push constants of a dispatch, (4,) uint32: elements, the first place of its results, N, and 0."""
    return np.array([settings.elements, number * settings.elements, taps, 0], np.uint32)
