"""Frames of scenes with cloth: rendered at given times, and the state of the simulation read back."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from common.numerics.transforms import pose_looking_at
from common.scene.pose import evaluate_pose
from common.view.camera import Perspective, View

VIEW = View(pose_looking_at((0.3, -0.3, 2.2), (0, -0.5, 0)), Perspective(np.radians(50), 0.1))
AWAY = View(pose_looking_at((0.3, -0.3, 2.2), (0.3, -0.3, 9)), Perspective(np.radians(50), 0.1))


def posed(found: Any, time: float) -> Any:
    """Return the pose of the view of a scene with cloth (`ClothScene`) at a time."""
    return found.pose(evaluate_pose(found.source, time))


def at_rate(rate: float, last: int, first: int = 0) -> list[float]:
    """Return the times of frames number `first` to `last` at `rate` a second."""
    return [number / rate for number in range(first, last + 1)]


def run(renderer: Any, times: Iterable[float], view: View = VIEW) -> Any:
    """Render frames at `times`; return the last one."""
    frame = None
    for time in times:
        frame = renderer.render(view, time)
    return frame


def picture(renderer: Any, times: Iterable[float], view: View = VIEW) -> np.ndarray:
    """Return the picture of the last frame."""
    return np.array(run(renderer, times, view).image("color"))


def state(renderer: Any, name: str = "positions") -> np.ndarray:
    """Return the (P, 3) float32 of a buffer of the simulation, after all frames that were rendered."""
    renderer.device.wait_idle()
    return renderer.techniques["cloth"].cloth._memory.read(name).reshape(-1, 3)
