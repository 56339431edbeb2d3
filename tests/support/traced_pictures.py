"""Pictures of tests that a chapter traces, by each way that finds hits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import chapters
from backends.contract import Renderer
from common.scene import Scene
from common.view.camera import View
from tests.support.chapter import Chapter
from tests.support.ray_traces import WAYS
from tests.support.shadows import PLAIN

SIZE = (40, 30)
BVH = "bvh"
EVERY_WAY = (*WAYS, BVH)

TRACED: dict[str, Any] = {**PLAIN, "shadows": "off", "rays": "whole"}
"""Settings of a picture in 32 bits that is traced as a whole."""


def need(chapter: Any, way: str) -> None:
    """Skip a test of a way that the device of a chapter does not have."""
    if way != BVH and not (chapter.backend == "vulkan" and chapter.device.has(WAYS[way])):
        pytest.skip(f"the device has no {WAYS[way]}")


def ways_of(chapter: Any) -> list[str]:
    """Return the ways that the device of a chapter has."""
    return [
        way
        for way in EVERY_WAY
        if way == BVH or (chapter.backend == "vulkan" and chapter.device.has(WAYS[way]))
    ]


def few_ways(chapter: Any) -> list[str]:
    """Return the first and the last of `ways_of`: a structure of the driver's and our own."""
    ways = ways_of(chapter)
    return list(dict.fromkeys((ways[0], ways[-1])))


@contextmanager
def opened(chapter: Chapter, scene: Scene, size: tuple[int, int] = SIZE, **turned: Any) -> Iterator[Renderer]:
    """Yield a renderer of a scene with TRACED and other settings, and the output "color_linear"."""
    settings = chapters.settings_class(chapter.which)(**{**TRACED, **turned})
    with chapter.on_new_device() as it, it.open(scene, size, settings, outputs={"color_linear"}) as renderer:
        yield renderer


def light(renderer: Any, view: View, time: float = 0.0) -> NDArray[np.float64]:
    """Return (H, W, 3) the light of a frame."""
    pixels: NDArray[np.float64] = renderer.render(view, time).image("color_linear").astype(np.float64)
    return pixels


def picture(
    chapter: Any, scene: Scene, view: View, size: tuple[int, int] = SIZE, time: float = 0.0, **turned: Any
) -> NDArray[np.float64]:
    """Return (H, W, 3) the light of one frame of a new renderer."""
    with opened(chapter, scene, size, **turned) as renderer:
        return light(renderer, view, time)


def primary_rays(view: View, size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N, 3) origins and unit directions of the rays through the centres of all pixels, row by row."""
    width, height = size
    rows, columns = np.mgrid[:height, :width].reshape(2, -1) + 0.5
    x, y = 2.0 * columns / width - 1.0, 1.0 - 2.0 * rows / height
    pose, lens = view.world_from_view, view.projection
    if hasattr(lens, "ymag"):
        near = np.column_stack([x * lens.ymag * width / height, y * lens.ymag, np.full(len(x), -lens.near)])
        return near @ pose[:3, :3].T + pose[:3, 3], np.tile(-pose[:3, 2], (len(x), 1))
    tangent = np.tan(lens.yfov / 2.0)
    towards = np.column_stack([x * tangent * width / height, y * tangent, np.full(len(x), -1.0)])
    towards = towards @ pose[:3, :3].T
    return np.tile(pose[:3, 3], (len(x), 1)), towards / np.linalg.norm(towards, axis=1, keepdims=True)


def off_edges(image: NDArray[Any], step: float = 1e-3) -> NDArray[np.bool_]:
    """Return (H, W) which pixels have no neighbour that differs by more than `step`."""
    flat, rows = np.ones(image.shape[:2], bool), image.reshape(*image.shape[:2], -1)
    for axis in (0, 1):
        jump = (np.abs(np.diff(rows, axis=axis)) > step).any(axis=-1)
        first = [slice(None)] * 2
        first[axis] = slice(None, -1)
        flat[tuple(first)] &= ~jump
        first[axis] = slice(1, None)
        flat[tuple(first)] &= ~jump
    return flat
