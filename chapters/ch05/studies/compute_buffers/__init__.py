"""Study: the CPU uploads numbers, a kernel computes with them, and a draw and the CPU read the results.

A kernel is a function that runs once for each *invocation*. Invocations come in work groups of a size that the shader
declares, here 64. A dispatch starts whole groups: 65 numbers take two, and 63 invocations have nothing to do.

The GPU runs behind the CPU, so every reader of the results must wait, and for the right write. The draw needs a
barrier; the CPU needs *two* things. A barrier from compute to the host makes the results visible to the CPU, and the
end of the frame gives the moment. Waiting for the whole device would do both, but leave the GPU idle meanwhile. This
study never does that: the CPU reads the results of a frame when it uses the slot of that frame again.
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
    idea="Upload, kernel, download: y = a x + b for any count of numbers, and a barrier for each reader.",
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
    """What a frame did. The CPU compares the results of the slot's last frame: `wrong` counts differences."""

    dispatches: int = 0
    checked: int = 0
    wrong: int = 0


KERNEL = "studies/compute_buffers/affine.comp"
SHADERS = ("post/fullscreen.vert", "studies/compute_buffers/bars.frag")
HIGHEST = 1000
"""The largest x."""


def defines(settings: Settings) -> tuple[tuple[str, int], ...]:
    """Return the macros of the picture's shader: the count of numbers, and the value at the upper edge."""
    return (("COUNT", settings.count), ("TOP", HIGHEST * max(settings.a, 1) + settings.b))


def numbers(settings: Settings, time: float) -> np.ndarray:
    """Return x, (count,) uint32: two periods of a wave that passes by once in eight seconds."""
    phase = np.arange(settings.count) * (2.0 / settings.count) + time / 8.0 % 1.0
    return np.rint(0.5 * HIGHEST * (1.0 + np.sin(math.tau * phase))).astype(np.uint32)


def push(settings: Settings) -> np.ndarray:
    """Return the push constants of the kernel, (4,) uint32: a, b and the count."""
    return np.array([settings.a, settings.b, settings.count, 0], np.uint32)


def expected(x: np.ndarray, settings: Settings) -> np.ndarray:
    """Return y, (count,) uint32, from the CPU: sums that are too large wrap around, as on the GPU."""
    y: np.ndarray = np.uint32(settings.a) * x + np.uint32(settings.b)
    return y
