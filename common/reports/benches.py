"""What the bench of a lesson is given and computes with: how much to measure, what is measured, and errors of pictures.

The benches of a lesson are in its chapter, `benches/`. `tools.bench` loads them by name and hands each a `Subject`: a
bench measures later chapters and forks as well as its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from common.errors import UserError
from common.numerics.transforms import translation
from common.reports import metrics
from common.scene import Scene
from common.settings import knobs, replaced
from common.view.camera import View

Array = np.ndarray


@dataclass(frozen=True)
class Effort:
    """How much is measured: frames before and in each of several rounds, samples per axis of the reference, starts.

    Without `everything`, only the presets, and of stability the first case.
    """

    warm_up: int
    frames: int
    rounds: int
    samples: int
    starts: int
    everything: bool


class Subject(Protocol):
    """One chapter or fork on one scene and size, opened with one setting after the other on one device."""

    backend: str
    scene: Scene
    size: tuple[int, int]
    device: Any

    @property
    def settings_class(self) -> Any:
        """The class of the chapter's settings."""

    def module(self, name: str) -> Any:
        """Return a module of the chapter by its name in it: "graph.types"."""

    def load(self, name: str, around: str = "none") -> Scene:
        """Return one of the project's scenes by name, in the environment `around`."""

    def on(self, scene: Scene, size: tuple[int, int] | None = None) -> Subject:
        """Return the same chapter on another scene, and if given, in another size."""

    def study(self, name: str, size: tuple[int, int]) -> Subject:
        """Return a study, as "5/timeline-or-fences", on its own scene and the same device."""

    def open(
        self,
        settings: Any,
        outputs: set[str],
        size: tuple[int, int] | None = None,
        without: Iterable[str] = (),
        inspect: bool = False,
    ) -> AbstractContextManager[Any]:
        """Return a renderer to be entered, without some features; the size is the subject's, if no other is given.

        With `inspect`, what each pass writes can be read: `frame.image("pass/resource")`.
        """

    def view(self, renderer: Any) -> View:
        """Return the first view of a renderer's scene."""

    def settled_picture(self, renderer: Any) -> tuple[Array, Array]:
        """Return what is seen when another frame would be the same, as `errors` takes it."""

    def measure(self, settings: Any, effort: Effort) -> tuple[list[dict[str, float]], dict[str, int]]:
        """Return one round: per frame the passes' GPU milliseconds with "gpu", "cpu" and "wall", and the work."""


STEP = 1e-3
"""How far the camera moves from one frame to the next, in length scales of the scene."""


def moved_view(view: View, scene: Scene, turn: float) -> View:
    """Return the view of frame number `turn`; no two frames should have one, since matrices of a view are kept."""
    moved = translation((STEP * scene.length_scale * turn, 0.0, 0.0))
    return replace(view, world_from_view=moved @ view.world_from_view)


def errors(got: tuple[Array, Array], truth: tuple[Array, Array]) -> dict[str, float | None]:
    """Return relative MSE of linear light, and the largest difference and FLIP of what is shown."""
    try:
        flip: float | None = metrics.flip_mean(got[1], truth[1])
    except UserError:  # the package is an extra; the others need none
        flip = None
    return {
        "relative_mse": metrics.relative_mse(got[0], truth[0]),
        "max_abs": metrics.max_abs(got[1], truth[1]),
        "flip": flip,
    }


def difference(image: Array, other: Array) -> dict[str, float]:
    """Return how far two pictures of linear light (H, W, 3) float32 are apart, which should be the same to the bit."""
    differ = (image.view(np.uint32) != other.view(np.uint32)).any(axis=-1)
    return {"max_abs": metrics.max_abs(image, other), "pixels_differ": int(differ.sum())}


def recorded_anew(settings: Any) -> Any:
    """Return settings with which every frame is recorded, in chapters that can send one again, too."""
    return replaced(settings, resubmit=False) if "resubmit" in knobs(settings) else settings


def middle(values: Sequence[float]) -> tuple[float, float]:
    """Return the median, and half the distance of the quartiles; NaN where there are no values."""
    if not values:
        return float("nan"), float("nan")
    low, median, high = np.percentile(values, (25, 50, 75))
    return float(median), float(high - low) / 2
