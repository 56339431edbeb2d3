"""Study: a kernel makes the vertices of a mesh, and makes them again while the mesh changes its shape.

Four numbers are all that is stored of two torus knots. A grid of invocations computes a vertex each, straight into the
buffer that the draw reads. Triangles join neighbours in the grid: they never change, and the CPU makes them once.

The mesh is one buffer, and frames follow each other on one queue. So there is a barrier on either side of the kernel.
The kernel may write only after the frame before has read, and the draw may read only after the kernel has written.
While the shape stands still the kernel does not run, and needs no barrier: the mesh turns by a matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.errors import UserError
from common.lessons import Study
from common.numerics.transforms import rotation
from common.settings import knob
from common.view.camera import View

from .knot import REACH

STUDY = Study(
    title="torus knot",
    idea="A kernel writes vertices where the draw finds them; a barrier before it, and one behind.",
    order=3,
    features=("compute/mesh-generator",),
    outputs=("color", "depth"),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    p1: int = knob(2, "turns of the first knot around the axis", minimum=1, maximum=32)
    q1: int = knob(3, "turns of the first knot through the hole", minimum=1, maximum=32)
    p2: int = knob(5, "turns of the second knot around the axis", minimum=1, maximum=32)
    q2: int = knob(8, "turns of the second knot through the hole", minimum=1, maximum=32)
    along: int = knob(512, "vertices along the knot", minimum=4, maximum=2048)
    around: int = knob(24, "vertices around it", minimum=4, maximum=1024)
    morph: float = knob(0.0, "how much of the second knot there is at time 0", minimum=0.0, maximum=1.0)
    speed: float = knob(
        0.1, "ways from one knot to the other in a second; 0: it stays", minimum=0.0, maximum=10.0
    )


@dataclass
class KernelWork(Work):
    """What a frame did: `dispatches` is 0 if the mesh was still valid."""

    dispatches: int = 0


KERNEL = "studies/torus_knot/knot.comp"
SHADERS = ("studies/torus_knot/knot.vert", "studies/torus_knot/knot.frag")
VERTEX_BYTES = 32
UNIFORM_BYTES = 2 * 64


def check(settings: Settings) -> None:
    """Raise UserError for numbers that are no knot."""
    for p, q in (("p1", "q1"), ("p2", "q2")):
        p_turns, q_turns = getattr(settings, p), getattr(settings, q)
        common = math.gcd(p_turns, q_turns)
        if common > 1:
            raise UserError(
                f"{p}={p_turns} and {q}={q_turns} are no knot: {common} divides both, and the curve closes too early; "
                f"try {p}={p_turns // common} and {q}={q_turns // common}."
            )


def coefficient(settings: Settings, time: float) -> float:
    """Return the part of the second knot: there and back again, from `morph` on."""
    way = (settings.morph + settings.speed * time) % 2.0
    return min(way, 2.0 - way)


def push(settings: Settings, morph: float) -> np.ndarray:
    """Return the push constants of the kernel, (12,) uint32: the grid, the knots, and the bits of the coefficient."""
    grid = [settings.along, settings.around, 0, 0]
    knots = [settings.p1, settings.q1, settings.p2, settings.q2]
    mixed = np.array([morph, 0.0, 0.0, 0.0], np.float32).view(np.uint32)
    return np.concatenate([np.array([*grid, *knots], np.uint32), mixed])


def matrices(view: View, time: float, aspect: float) -> np.ndarray:
    """Return the uniforms of the draw, (2, 4, 4) float32: view_from_object and clip_from_view, columns first."""
    turn = (0.5 * time) % math.tau
    place = rotation(np.array([0.0, 1.0, 0.0]), turn) @ rotation(np.array([0.0, 0.0, 1.0]), turn)
    place[:3, :3] *= 1.0 / REACH  # metres: it fits the view of a camera with default settings
    return np.stack([(view.view_from_world() @ place).T, view.clip_from_view(aspect).T]).astype(np.float32)
