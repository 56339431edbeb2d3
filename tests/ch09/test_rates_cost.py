"""What shading rates cost in Python: calls of a frame, and its time, against the chapter before."""

from __future__ import annotations

import sys
from contextlib import ExitStack

import pytest

import chapters
from common.numerics.transforms import pose_looking_at
from common.view.camera import Perspective, View
from tests.support.chapter import Chapter
from tests.support.shadows import PLAIN, point, spot, yard
from tests.support.timing import least_times, timed

pytestmark = pytest.mark.until(9, "later lessons have a Python of their own")

SIZE = (32, 24)
BUDGET_S = 3e-5
"""Seconds of Python that this lesson may add to a frame."""
PATHS = {
    "compute": {"graph": "compute"},
    "deferred": {"graph": "deferred", "rate_fragments": "passes"},
}
POLICIES = ("none", "radial", "sobel")


@pytest.fixture
def draws(chapter, request):
    """Return functions that draw the next frame of a walk: of the chapter before, and of this one with each policy.

    A walk changes the camera in every frame. Everything was recorded before, as in a window.
    """
    scene = yard(spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8)))
    views = [
        View(pose_looking_at((3.0 + 0.01 * step, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
        for step in range(8)
    ]
    before = Chapter(chapter.which - 1, chapter.backend, chapter.device)
    knobs = PATHS[request.param]

    def walk(it, **turned):
        kind = chapters.settings_class(it.which)
        renderer = stack.enter_context(it.open(scene, SIZE, kind(**PLAIN, shadows="off", **turned)))
        count = iter(range(1 << 30))

        def draw():
            number = next(count)
            return renderer.render(views[number % len(views)], number / 60)

        for _ in range(24):
            frame = draw()
        assert frame.work["recorded"] == 0
        return draw

    with ExitStack() as stack:
        found = {"before": walk(before, graph=knobs["graph"])}
        for policy in POLICIES:
            found[policy] = walk(chapter, rate_policy=policy, **knobs)
        yield found


def calls_of(draw, frames=8):
    """Return how many functions Python calls in some frames: its own, and those of C."""
    count = 0

    def note(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(note)
    try:
        for _ in range(frames):
            draw()
    finally:
        sys.setprofile(None)
    return count / frames


@pytest.mark.feature("vrs/software")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("draws", PATHS, indirect=True)
def test_a_frame_calls_few_more_functions_than_one_of_the_chapter_before(chapter, draws):
    """Without a policy one more technique is asked, by three calls.

    With one there are two passes more, or five where fragments light. Vulkan submits what was recorded, so a pass costs
    its place in the timings. OpenGL replays a list, in which a pass has some 25 calls of the driver.
    """
    most = 165 if chapter.backend == "gl" else 52
    counts = {name: calls_of(draw) for name, draw in draws.items()}
    assert counts["before"] > 100, "calls are counted"
    assert counts["none"] - counts["before"] <= 5, counts
    assert max(counts[policy] for policy in POLICIES) - counts["before"] <= most, counts


@pytest.mark.alone
@pytest.mark.feature("vrs/software")
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("draws", PATHS, indirect=True)
def test_a_frame_takes_no_more_time_of_its_thread(draws):
    """CPU time of the thread that renders: the least of many means of eight frames, in turns."""

    def holds(least):
        return all(least[policy] - least["before"] < BUDGET_S for policy in POLICIES)

    least = least_times({name: timed(draw, calls=8) for name, draw in draws.items()}, holds, fewest=10, seconds=8.0)
    assert least["before"] > BUDGET_S and holds(least), least
