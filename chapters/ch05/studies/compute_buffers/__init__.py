"""Study: numbers go up, a kernel computes with them, and what comes out is drawn and read by the CPU.

A kernel is a function that runs once for each *invocation*. Invocations come in work groups of a size that the shader
says, here 64; a dispatch starts whole groups, so for 65 numbers there are two, and 63 invocations find nothing to do.

Three things follow from the GPU's running behind the CPU. Whoever reads what a kernel wrote must be told to wait, and
by what: for the draw a barrier says so, for the CPU *two* things do. A barrier from compute to the host makes what was
written visible to the CPU, and the frame's own end says when. Waiting for the whole device would do both, and the GPU
would have nothing to do meanwhile. Nothing here does: the CPU reads what a frame computed when it takes up its slot
again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="compute buffers",
    idea="Upload, kernel, download: y = a x + b for any count of numbers, and a barrier before they are read.",
    order=1,
    features=("compute/pipelines-and-buffers", "compute/barriers"),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    count: int = knob(1000, "numbers to compute with", minimum=1, maximum=4_000_000)
    a: int = knob(3, "factor", minimum=0, maximum=1000)
    b: int = knob(500, "what is added", minimum=0, maximum=1_000_000)


@dataclass
class KernelWork(Work):
    """What a frame did. The CPU compares what came back from the slot's last frame: `wrong` counts differences."""

    dispatches: int = 0
    checked: int = 0
    wrong: int = 0


KERNEL = "studies/compute_buffers/affine.comp"
SHADERS = ("post/fullscreen.vert", "studies/compute_buffers/bars.frag")
HIGHEST = 1000
"""No x is larger."""


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return what the picture's shader is told: how many numbers there are, and what reaches the upper edge."""
    return (("COUNT", settings.count), ("TOP", HIGHEST * max(settings.a, 1) + settings.b))


def numbers(settings: Settings, time: float) -> np.ndarray:
    """Return x, (count,) uint32: two periods of a wave that passes by once in eight seconds."""
    phase = np.arange(settings.count) * (2.0 / settings.count) + time / 8.0 % 1.0
    return np.rint(0.5 * HIGHEST * (1.0 + np.sin(math.tau * phase))).astype(np.uint32)


def push(settings: Settings) -> np.ndarray:
    """Return the push constants of the kernel, (4,) uint32: a, b and the count."""
    return np.array([settings.a, settings.b, settings.count, 0], np.uint32)


def expected(x: np.ndarray, settings: Settings) -> np.ndarray:
    """Return y, (count,) uint32, by the CPU: sums that are too large begin again at 0, as the GPU's do."""
    y: np.ndarray = np.uint32(settings.a) * x + np.uint32(settings.b)
    return y
