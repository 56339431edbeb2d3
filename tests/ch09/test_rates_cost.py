"""What shading rates cost in Python: calls of a frame, and its time, against the chapter before."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from tests.support.frame_costs import BUDGET_S, calls_of, chapter_before, lit_yard, python_times, walk

pytestmark = pytest.mark.until(9, "later lessons have a Python of their own")

PATHS = {
    "compute": {"graph": "compute"},
    "deferred": {"graph": "deferred", "rate_fragments": "passes"},
}
POLICIES = ("none", "radial", "sobel")


@pytest.fixture
def walks(chapter, request):
    """Return walks: of the chapter before, and of this one with each policy."""
    scene, knobs = lit_yard(), PATHS[request.param]
    with ExitStack() as stack:
        before = walk(chapter_before(chapter), scene, graph=knobs["graph"])
        found = {"before": stack.enter_context(before)}
        for policy in POLICIES:
            found[policy] = stack.enter_context(walk(chapter, scene, rate_policy=policy, **knobs))
        yield found


@pytest.mark.feature("vrs/software")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("walks", PATHS, indirect=True)
def test_a_frame_calls_few_more_functions_than_one_of_the_chapter_before(chapter, walks):
    """Without a policy one more technique is asked, by three calls.

    With one there are two passes more, or five where fragments light. Vulkan submits what was recorded, so a pass costs
    its place in the timings. OpenGL replays a list, in which a pass has some 25 calls of the driver.
    """
    most = 165 if chapter.backend == "gl" else 52
    counts = {name: calls_of(walk) for name, walk in walks.items()}
    assert counts["before"] > 100, "calls are counted"
    assert counts["none"] - counts["before"] <= 5, counts
    assert max(counts[policy] for policy in POLICIES) - counts["before"] <= most, counts


@pytest.mark.alone
@pytest.mark.feature("vrs/software")
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("walks", PATHS, indirect=True)
def test_a_frame_takes_no_more_time_of_its_thread(walks, monkeypatch):
    def holds(least):
        return all(least[policy] - least["before"] < BUDGET_S for policy in POLICIES)

    least = python_times(walks, holds, monkeypatch)
    assert least["before"] > BUDGET_S and holds(least), least
