"""Frames with exact formats, and whether two runs of them show the same."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

import chapters
from common.scene import Scene
from common.settings import replaced
from common.view.camera import View

SIZE = (120, 72)
EXACT_KNOBS: dict[str, Any] = {
    "color_format": "rgba32f",
    "gbuffer_format": "full",
    "anisotropy": 1.0,
    "ambient": 0.3,
}
"""Knobs with which no format and no filter hides a difference."""
OUTPUTS = ("color_linear", "depth", "instance_id")

Frames = list[tuple[dict[str, np.ndarray], dict[str, int]]]


def frames(
    chapter: Any, scene: Scene, views: Iterable[View], size: tuple[int, int] = SIZE, **turned: Any
) -> Frames:
    """Return the outputs of a frame for each view, and its counters; `turned` replaces some of EXACT_KNOBS."""
    drawn = []
    settings = replaced(chapters.settings_class(chapter.which)(), **{**EXACT_KNOBS, **turned})
    with chapter.open(scene, size, settings, outputs=OUTPUTS) as renderer:
        for view in views:
            frame = renderer.render(view)
            drawn.append(({name: frame.image(name).copy() for name in OUTPUTS}, dict(frame.work)))
    return drawn


def assert_same(drawn: Frames, wanted: Frames) -> None:
    """Hold the outputs of frames to those of others, bit for bit."""
    for number, ((pictures, _), (others, _)) in enumerate(zip(drawn, wanted, strict=True)):
        for name in OUTPUTS:
            assert np.array_equal(pictures[name], others[name]), f"{name} of frame {number}"


def ways(chapter: Any) -> list[str]:
    """Return the geometries that the device has."""
    several, tasks = (chapter.device.has(name) for name in ("multi-draw", "mesh-shader"))
    return [way for way, there in (("classic", True), ("compute", several), ("mesh", tasks)) if there]
