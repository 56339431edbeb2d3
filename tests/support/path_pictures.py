"""Pictures of tests that a chapter traces by paths, and how far their means are from a truth, in standard errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import chapters
from backends.contract import Renderer
from common.scene import Scene
from common.view.camera import View
from tests.support.chapter import Chapter
from tests.support.shadows import PLAIN
from tests.support.traced_pictures import ways_of

Float64 = NDArray[np.float64]

SIZE = (16, 12)

PATHS: dict[str, Any] = {**PLAIN, "path_tracer": True, "path_lights": "all", "environment_size": 32}
"""Settings of a picture in 32 bits that is traced by paths."""


def way_of(chapter: Any) -> str:
    """Return the way that compiles soonest: the first one that the device of a chapter has."""
    return ways_of(chapter)[0]


@contextmanager
def opened(chapter: Chapter, scene: Scene, size: tuple[int, int] = SIZE, **turned: Any) -> Iterator[Renderer]:
    """Yield a renderer of a scene with PATHS and other settings, and the output "color_linear"."""
    settings = chapters.settings_class(chapter.which)(**{**PATHS, "ray_way": way_of(chapter), **turned})
    with chapter.on_new_device() as it, it.open(scene, size, settings, outputs={"color_linear"}) as renderer:
        yield renderer


def light(renderer: Any, view: View, frames: int = 1) -> Float64:
    """Return (H, W, 3) the light of the last of some frames, in nits."""
    for _ in range(frames):
        frame = renderer.render(view, 0.0)
    return np.asarray(frame.image("color_linear"), np.float64)


@contextmanager
def turned(renderer: Any, **knobs: Any) -> Iterator[None]:
    """Set live knobs of `settings.paths` for a while; the sums begin anew before and behind it."""
    paths = renderer.settings.paths
    before = {name: getattr(paths, name) for name in knobs}
    renderer.reset_history("test")
    for name, value in knobs.items():
        setattr(paths, name, value)
    try:
        yield
    finally:
        for name, value in before.items():
            setattr(paths, name, value)
        renderer.reset_history("test")


def runs_of(
    renderer: Any, view: View, count: int = 16, each: Iterable[dict[str, Any]] = ({},), **knobs: Any
) -> list[Float64]:
    """Return (count, H, W, 3) independent pictures for each of some live knobs, besides those for all of them."""
    pictures = []
    for seed, changed in enumerate(each):
        with turned(renderer, **{"path_average": False, "path_seed": seed, **knobs, **changed}):
            pictures.append(np.stack([light(renderer, view) for _ in range(count)]))
    return pictures


def runs(
    chapter: Any,
    scene: Scene,
    view: View,
    count: int = 16,
    size: tuple[int, int] = SIZE,
    each: Iterable[dict[str, Any]] = ({},),
    **settings: Any,
) -> list[Float64]:
    """Return `runs_of` a new renderer with some settings."""
    with opened(chapter, scene, size, **settings) as renderer:
        return runs_of(renderer, view, count, each)


def z_scores(pictures: Float64, truth: ArrayLike = 0.0, block: int = 4) -> Float64:
    """Return the mean of runs minus a truth, (H, W, 3) or a number, over its standard error, by blocks of pixels.

    The error follows from how the runs differ. A block that does not vary has z = 0 where it is right to 1e-5.
    """
    count, height, width, _ = pictures.shape
    wanted = np.broadcast_to(np.asarray(truth, np.float64), pictures.shape[1:])

    def blocks(values: Float64) -> Float64:
        cut = values[..., : height // block * block, : width // block * block, :]
        parts = cut.reshape(*cut.shape[:-3], height // block, block, width // block, block, 3)
        return np.asarray(parts.mean(axis=(-4, -2)))

    sampled, expected = blocks(pictures), blocks(wanted)
    mean, error = sampled.mean(axis=0), sampled.std(axis=0, ddof=1) / np.sqrt(count)
    floor = 1e-5 * np.maximum(np.abs(expected), np.abs(mean)) + 1e-30
    away = np.maximum(np.abs(mean - expected) - floor, 0.0)
    return np.asarray(np.sign(mean - expected) * away / np.maximum(error, 0.01 * floor))


def assert_agrees(z: Float64) -> None:
    """Hold scores (..., 3) to those of independent errors: none far away, and their mean square near 1 at most.

    They are Student's t with 15 degrees of freedom or more. So their squares have the mean 1.15 and the standard
    deviation 1.9 at most, and a score beyond 7 has the probability 4e-6. The three colours of a block are one score,
    nearly. With five standard deviations of the mean, another device, whose roundings lead to other paths, passes, too.
    """
    assert np.isfinite(z).all()
    assert np.abs(z).max() < 7.0, np.abs(z).max()
    most = 1.15 + 5.0 * 1.9 / np.sqrt(z.size / 3)
    assert (z**2).mean() < most, ((z**2).mean(), most)


def assert_mean(pictures: Float64, truth: ArrayLike, most: float) -> None:
    """Hold the mean over pixels and runs to that of a truth, by its standard error; relative, that is below `most`."""
    means = pictures.mean(axis=(1, 2, 3))
    wanted = float(np.mean(truth))
    error = float(means.std(ddof=1)) / np.sqrt(len(means))
    assert error < most * wanted, error / wanted
    assert abs(means.mean() - wanted) < 5.0 * error + 1e-5 * wanted, (means.mean() / wanted, error / wanted)
