"""What fog costs in Python: calls of a frame, and its time, against the chapter before."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import replace

import pytest

from common.scene import FogBox, Medium
from tests.support.frame_costs import BUDGET_S, calls_of, chapter_before, lit_yard, python_times, walk

pytestmark = pytest.mark.until(10, "later lessons have a Python of their own")

PATHS = {"compute": {}, "deferred": {"fog_half": True}}
"""What is set on each path, if there is fog."""

AIR = Medium(extinction=0.02, height_extinction=0.3, height_falloff=1.5, albedo=(0.9, 0.8, 0.7))
BOXES = Medium(
    boxes=(
        FogBox((0.0, 0.5, 40.0), (1.0, 1.0, 1.0), 0.5),  # behind the camera
        FogBox((1.0, 0.8, 1.5), (0.8, 0.7, 0.9), 0.6),
    )
)
GRID = {"fog_columns": 4, "fog_rows": 4, "fog_slices": 4}
"""Few froxels: what they cost is not Python's."""

FOGS = {
    "air": (AIR, {"fog_noise": 0.5, "fog_noise_size": 32}),
    "boxes": (BOXES, {}),
    "few passes": (AIR, {"fog_spatial": False, "fog_temporal": False}),
}
"""A medium with noise, one that may be out of view, and one without filters."""


@pytest.fixture
def walks(chapter, request):
    """Return functions that draw the next frame of a walk: of the chapter before, and of this one.

    "no medium" and "off" have no fog; the others are those of FOGS.
    """
    scene, graph = lit_yard(), {"graph": request.param}
    hazy = replace(scene, medium=AIR)
    with ExitStack() as stack:
        found = {
            "before": stack.enter_context(walk(chapter_before(chapter), scene, **graph)),
            "no medium": stack.enter_context(walk(chapter, scene, **graph)),
            "off": stack.enter_context(walk(chapter, hazy, fog=False, **graph)),
        }
        for name, (medium, knobs) in FOGS.items():
            knobs = {**graph, **PATHS[request.param], **GRID, **knobs}
            found[name] = stack.enter_context(walk(chapter, replace(scene, medium=medium), **knobs))
        yield found


@pytest.mark.feature("fog/medium", "fog/froxel-volume")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("walks", PATHS, indirect=True)
def test_a_frame_calls_few_more_functions_than_one_of_the_chapter_before(chapter, walks):
    counts = {name: calls_of(walk) for name, walk in walks.items()}
    print(counts)
    raise SystemExit if False else AssertionError


@pytest.mark.alone
@pytest.mark.feature("fog/medium", "fog/froxel-volume")
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("walks", PATHS, indirect=True)
def test_a_frame_takes_no_more_time_of_its_thread(walks, monkeypatch):
    def holds(least):
        return all(least[name] - least["before"] < BUDGET_S for name in FOGS)

    least = python_times(walks, lambda _: False, monkeypatch)
    print({k: round(v * 1e6) for k, v in least.items()})
    assert least["before"] > BUDGET_S and holds(least), least
    assert 0
