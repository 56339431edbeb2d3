"""What fog costs in Python: calls of a frame, and its time, against the chapter before."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import pytest

from chapters.ch10.fog.passes import FOG_PASSES
from common.scene import FogBox, Medium
from tests.support.frame_costs import BUDGET_S, calls_of, chapter_before, lit_yard, python_times, walk

pytestmark = pytest.mark.until(10, "later lessons have a Python of their own")

PATHS = {"compute": {}, "deferred": {"fog_half": True}}
"""What is set on each path, if there is fog."""

AIR = Medium(extinction=0.02, height_extinction=0.3, height_falloff=1.5, albedo=(0.9, 0.8, 0.7))
BEHIND, AHEAD = FogBox((0.0, 0.5, 40.0), (1.0, 1.0, 1.0), 0.5), FogBox((1.0, 0.8, 1.5), (0.8, 0.7, 0.9), 0.6)
GRID = {"fog_columns": 4, "fog_rows": 4, "fog_slices": 4}
FOGS = {
    "air": (AIR, {"fog_noise": 0.5, "fog_noise_size": 32}),
    "boxes": (Medium(boxes=(BEHIND, AHEAD)), {}),
    "no filters": (AIR, {"fog_spatial": False, "fog_temporal": False}),
}
"""A medium with noise, one that can be out of view, and one without filters."""

WITHOUT = ("no medium", "off")
"""Frames without fog."""


@pytest.fixture
def walks(chapter, request):
    """Return walks: of the chapter before, of this one without fog, and with each of FOGS."""
    scene, graph = lit_yard(), {"graph": request.param}
    with ExitStack() as stack:

        def walked(it, medium, **turned):
            return stack.enter_context(walk(it, replace(scene, medium=medium), **graph, **turned))

        found = {
            "before": walked(chapter_before(chapter), None),
            "no medium": walked(chapter, None),
            "off": walked(chapter, AIR, fog=False),
        }
        for name, (medium, knobs) in FOGS.items():
            found[name] = walked(chapter, medium, **GRID, **knobs, **PATHS[request.param])
        yield found


@pytest.fixture
def without_kernels(monkeypatch):
    """Leave kernels of fog out of what is recorded: a software driver runs them on the cores and caches of the test.

    A frame submits what was recorded, so no Python runs for a kernel.
    """
    for kind in FOG_PASSES:
        monkeypatch.setattr(kind, "record", lambda self, commands: None)


@pytest.mark.feature("fog/medium", "fog/froxel-volume")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize(
    "walks", [pytest.param("compute", marks=pytest.mark.long), "deferred"], indirect=True
)
def test_a_frame_calls_few_more_functions_than_one_of_the_chapter_before(chapter, walks):
    """Without fog one more technique is asked, by three calls.

    With it there are up to six passes more, the block of the frame, and boxes that are compared with the view. Vulkan
    submits what was recorded, so a pass costs its key. OpenGL replays a list, in which a dispatch has 13 calls of the
    driver, and some of its functions are wrapped for tests.
    """
    most = 150 if chapter.backend == "gl" else 45
    counts = {name: calls_of(walk) for name, walk in walks.items()}
    assert counts["before"] > 100, "calls are counted"
    assert max(counts[name] for name in WITHOUT) - counts["before"] <= 5, counts
    assert max(counts[name] for name in FOGS) - counts["before"] <= most, counts


@pytest.mark.alone
@pytest.mark.feature("fog/medium", "fog/froxel-volume")
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize(
    "walks", ["compute", pytest.param("deferred", marks=pytest.mark.long)], indirect=True
)
def test_a_frame_takes_little_more_time_of_its_thread(without_kernels, walks, monkeypatch):
    """CPU time of the thread that renders, without that of the driver in calls that submit and wait.

    The camera moves in every frame, so nothing rests.
    """

    def holds(least):
        fog = max(least[name] for name in FOGS) - least["before"]
        return fog < BUDGET_S and max(least[name] for name in WITHOUT) - least["before"] < BUDGET_S / 2

    least = python_times(walks, holds, monkeypatch, seconds=16.0)
    assert least["before"] > BUDGET_S and holds(least), least
