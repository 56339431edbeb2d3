"""The study dynamic-resolution: a load that steps, the scale that follows, and the time that a frame then takes."""

from __future__ import annotations

from chapters.ch11.studies.dynamic_resolution.controller import SCALES, Controller
from chapters.ch11.studies.dynamic_resolution.loads import frame_ms
from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, curves

FRAMES, LATE = 240, 2
"""Frames, and those that are drawn before the time of one is known."""


def scales() -> list[float]:
    """Return the scale of each frame under the load `step`."""
    controller = Controller(1.0)
    found: list[float] = []
    for frame in range(FRAMES):
        if frame >= LATE:
            controller.next(frame_ms("step", frame - LATE, found[frame - LATE], 1.0))
        found.append(SCALES[controller.number])
    return found


def time_that_is_held() -> Canvas:
    """The time of each frame with all pixels, and with those that the controller chooses."""
    chosen = scales()
    frames = range(FRAMES)
    whole = [(float(n), frame_ms("step", n, 1.0, 1.0)) for n in frames]
    held = [(float(n), frame_ms("step", n, chosen[n], 1.0)) for n in frames]
    return curves(
        "Time of a frame under a load that steps, and the scale that holds it",
        Axis("frame"),
        Axis("time in targets; scale"),
        (
            Curve("all pixels", whole, dashed=True, marks=False),
            Curve("held", held, marks=False),
            Curve("scale", [*zip(map(float, frames), chosen, strict=True)], marks=False),
        ),
        "the median of 23 frames decides, so a step is followed after twelve frames and two in flight",
    )
