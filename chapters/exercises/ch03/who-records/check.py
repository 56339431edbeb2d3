"""A thousand squares recorded by one thread and by four: parts, pools, and what each part says anew."""

from __future__ import annotations

from typing import Any

import numpy as np

import chapters
from common.scene import Material, Scene
from tests.support.scenes import facing, quad_scene
from tools.exercises import Answer
from tools.exercises.checking import Given

WORKERS, LEAST = 3, 150


def measure(given: Given) -> dict[str, Answer]:
    """Draw the squares with a call for each, and once with one call for all."""
    alone, shared = _drawn(given, 1000, 0), _drawn(given, 1000, WORKERS)
    few, merged = _drawn(given, 299, WORKERS), _drawn(given, 1000, WORKERS, multi_draw=True)
    given.silent()
    return {
        "parts": shared["recorded_parts"],
        "parts_of_299": few["recorded_parts"],
        "pools": shared["pools"],
        "viewports_alone": alone["viewports"],
        "viewports": shared["viewports"],
        "parts_multi_draw": merged["recorded_parts"],
    }


def _drawn(given: Given, count: int, workers: int, multi_draw: bool = False) -> dict[str, int]:
    """Return the counters of the last of some frames, its calls that set a viewport, and how many pools there are."""
    settings = given.settings(recording_threads=workers, draws_per_secondary=LEAST)
    module = chapters.renderer_module(given.which, given.backend)
    log: list[tuple[str, tuple[Any, ...]]] = []
    with module.Renderer(
        _scene(count),
        (16, 16),
        settings,
        outputs={"color"},
        device=given.device,
        without=() if multi_draw else ("multi-draw",),
    ) as opened:
        for _ in range(4):
            opened.render(facing())
        given.device.fn.trace(log)
        try:
            work = dict(opened.render(facing()).work)
        finally:
            given.device.fn.trace(None)
        pools = len(opened._commands._pools.pools) if workers else 0
    viewports = sum(name == "vkCmdSetViewport" for name, _ in log)
    return work | {"viewports": viewports, "pools": pools}


def _scene(count: int) -> Scene:
    places = np.tile(np.diag([0.02, 0.02, 1.0, 1.0]), (count, 1, 1))
    places[:, :3, 3] = np.random.default_rng(1).uniform(-0.9, 0.9, (count, 3)) * (1, 1, 0.1)
    return quad_scene(Material(unlit=True), matrices=tuple(places))
