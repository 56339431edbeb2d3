"""What a history costs in Python: calls of a frame, and its time, against the chapter before; without one, nothing."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from chapters.ch11.motion.passes import MotionObjectsPass, MotionPass
from chapters.ch11.post.finish_passes import FxaaPass, MotionBlurPass, SharpenPass
from chapters.ch11.settings import Settings
from chapters.ch11.taa.passes import TaaPass
from common import layouts
from tests.support.frame_costs import (
    BUDGET_S,
    SIZE,
    VIEWS,
    calls_of,
    chapter_before,
    lit_yard,
    python_times,
    walk,
)
from tests.support.shadows import PLAIN

pytestmark = pytest.mark.until(11, "later lessons have a Python of their own")

PASSES = (MotionPass, MotionObjectsPass, TaaPass, MotionBlurPass, SharpenPass, FxaaPass)
HISTORY = {"taa": "full"}
FINISH = {"motion_blur": 1.0, "sharpen": 1.0, "fxaa": True, "dither": 1.0, "split": "columns"}
WITH = {"history": HISTORY, "blur": {"motion_blur": 1.0}, "all": {**HISTORY, **FINISH}}
"""Frames with a history, with motion vectors alone, and with every pass of the lesson."""

GRAPHS = ("forward", "deferred", "compute")
SAMPLE = ["deferred", *(pytest.param(graph, marks=pytest.mark.long) for graph in ("forward", "compute"))]
WITHOUT = {("deferred", "defaults"), ("forward", "finish")}
TARGETS = {"history_color", "motion_camera"}


@pytest.fixture
def walks(chapter, request):
    """Return walks: of the chapter before, of this one with its defaults, and with each of WITH."""
    scene, graph = lit_yard(), {"graph": request.param}
    with ExitStack() as stack:
        found = {
            "before": stack.enter_context(walk(chapter_before(chapter), scene, **graph)),
            "off": stack.enter_context(walk(chapter, scene, **graph)),
        }
        for name, values in WITH.items():
            found[name] = stack.enter_context(walk(chapter, scene, **graph, **values))
        yield found


@pytest.fixture
def without_draws(monkeypatch):
    """Leave the draws of the lesson out of what is recorded: a software driver runs them on the cores of the test.

    A frame submits what was recorded, so no Python runs for a draw.
    """
    for kind in PASSES:
        monkeypatch.setattr(kind, "record", lambda self, commands: None)


@pytest.mark.feature("taa/history")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("walks", SAMPLE, indirect=True)
def test_a_frame_calls_few_more_functions_than_one_of_the_chapter_before(chapter, walks):
    """Without a history each technique is asked for constants, and two more exist.

    With all of it there are up to six passes more. Vulkan submits what was recorded, so a pass costs its key. OpenGL
    replays a list, in which each full-screen pass has its calls of the driver.
    """
    most = 230 if chapter.backend == "gl" else 75
    counts = {name: calls_of(walk) for name, walk in walks.items()}
    assert counts["before"] > 100, "calls are counted"
    assert counts["off"] - counts["before"] <= 45, counts
    assert max(counts[name] for name in WITH) - counts["before"] <= most, counts


@pytest.mark.feature("taa/history")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize(
    ("graph", "values"),
    [
        pytest.param(
            graph, values, id=f"{graph}-{name}", marks=[pytest.mark.long] * ((graph, name) not in WITHOUT)
        )
        for graph in GRAPHS
        for name, values in (("defaults", {}), ("finish", {"sharpen": 1.0, "fxaa": True, "dither": 1.0}))
    ],
)
def test_without_history_blur_and_scale_there_is_no_target_and_no_jitter(chapter, graph, values):
    """The frame has no history of colour, no image of motion and no jitter. With them the same names are there."""

    def of_frame(**more):
        settings = Settings(**PLAIN, shadows="off", graph=graph, **values, **more)
        with chapter.open(lit_yard(), SIZE, settings) as renderer:
            for view in VIEWS[:2]:
                renderer.render(view)
            jitters = [
                slot.frame.view(layouts.dtype("FrameConstants"))[0][name].any()
                for slot in renderer._data.slots
                for name in ("jitter", "previous_jitter")
            ]
            passes = {gpu_pass.name for gpu_pass in renderer.passes}
            return (
                set(renderer.graph.resources) & TARGETS,
                passes & {"motion", "motion_objects", "taa"},
                jitters,
            )

    assert of_frame() == (set(), set(), [False] * 4)
    targets, passes, jitters = of_frame(taa="full")
    assert targets == TARGETS and passes == {"motion", "motion_objects", "taa"} and any(jitters)
    targets, passes, jitters = of_frame(motion_blur=1.0)
    assert "history_color" not in targets and "motion" in passes and not any(jitters)


@pytest.mark.alone
@pytest.mark.feature("taa/history")
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize(
    "walks", [pytest.param("deferred", marks=pytest.mark.long), "compute"], indirect=True
)
def test_a_frame_takes_little_more_time_of_its_thread(without_draws, walks, monkeypatch):
    """CPU time of the thread that renders, without that of the driver in calls that submit and wait.

    The camera moves in every frame, so nothing rests.
    """

    def holds(least):
        more = {name: took - least["before"] for name, took in least.items()}
        return max(more[name] for name in WITH) < BUDGET_S and more["off"] < BUDGET_S / 2

    least = python_times(walks, holds, monkeypatch, seconds=16.0)
    assert least["before"] > BUDGET_S and holds(least), least
