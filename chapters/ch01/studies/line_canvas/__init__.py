"""Study: lines for looking at what has no surface: planes, boxes, what another camera sees. Collected in each frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from backends.stage import Work
from common.lessons import Study
from common.numerics.transforms import pose_looking_at, rotation, translation
from common.settings import knob
from common.view.camera import Perspective, View

from ..drawing import Drawn
from .canvas import CAPACITY, VERTEX, Canvas

STUDY = Study(
    title="line canvas",
    idea="What has no surface is drawn as lines: add them from anywhere in the frame, draw them in one call.",
    order=32,
    features=("debug-draw/line-canvas",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    boxes: int = knob(6, "boxes in the ring; above 5,458 the canvas overflows", minimum=0, maximum=100_000)
    width: float = knob(1.5, "of a line", unit="px", minimum=1.0, maximum=20.0)


@dataclass
class LineWork(Work):
    """What a frame did, with the lines that it drew and those that did not fit."""

    lines: int = 0
    lines_dropped: int = 0


UNIFORM_BYTES = 64 + 16
CANVAS_BYTES = CAPACITY * 2 * VERTEX.itemsize
DRAWN = Drawn(("line.vert", "line.frag"))


def fill(canvas: Canvas, settings: Settings, time: float) -> None:
    """Add what is drawn at a time: a ground plane, a ring of boxes, and a camera that looks around among them."""
    canvas.plane((0, -0.4, 0), (2, 0, 0), (0, 0, 2), 10, 10, (0.3, 0.3, 0.33), (0.6, 0.6, 0.65))
    turn = rotation((0.0, 1.0, 0.0), 0.4 * time % math.tau)
    for number in range(settings.boxes):
        place = rotation((0.0, 1.0, 0.0), number / settings.boxes * math.tau) @ translation(
            (0.75, -0.27, 0.0)
        )
        canvas.box(place @ turn @ np.diag((0.12, 0.12, 0.12, 1.0)), (0.95, 0.75, 0.2))
    angle = 0.7 * time % math.tau
    eye = np.array((0.0, 0.15, 0.0))
    camera = View(
        pose_looking_at(eye, (math.sin(angle), -0.2, math.cos(angle))), Perspective(math.radians(40), 0.06)
    )
    canvas.frustum(np.linalg.inv(camera.clip_from_world(1.5)), 0.1, (0.3, 0.85, 1.0))


def uniforms(settings: Settings, view: View, size: tuple[int, int]) -> np.ndarray:
    """Return what the shaders read, (20,) float32: clip_from_world, half of the picture's size, half a line's width."""
    clip = view.clip_from_world(size[0] / size[1])
    rest = [0.5 * size[0], 0.5 * size[1], 0.5 * settings.width, 0.0]
    return np.concatenate([clip.T.ravel(), rest]).astype(np.float32)
