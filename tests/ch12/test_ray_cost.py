"""What rays cost in Python: CPU time and calls of a frame against the chapter before; without rays, nothing."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import pytest

from chapters.ch12.rays.passes import RayPicturePass, StructuresPass
from common.scene import Animation, AnimationChannel
from tests.support.frame_costs import calls_of, chapter_before, lit_yard, python_times, walk
from tests.support.traced_pictures import ways_of

pytestmark = pytest.mark.until(12, "later lessons have a Python of their own")

BUDGET_S = 5e-5
"""Seconds of Python that rays may add to a frame in which instances move."""


def moving_yard():
    """Return the yard with lamps, in which one square goes to and fro."""
    scene = lit_yard()
    scene.nodes.has_matrix[1] = False
    scene.nodes.translation[1] = (0.0, 1.5, 0.0)
    keys = np.array([(0.0, 1.5, 0.0), (0.5, 2.0, 0.0), (0.0, 1.5, 0.0)])
    channel = AnimationChannel(1, "translation", np.array((0.0, 0.5, 1.0)), keys, "linear")
    scene.animations.append(Animation("to and fro", (channel,), 1.0))
    return scene


@pytest.fixture
def walks(chapter):
    """Return walks: of the chapter before, of this one with its defaults, and with each way of tracing."""
    scene = moving_yard()
    with ExitStack() as stack:
        found = {
            "before": stack.enter_context(walk(chapter_before(chapter), scene, graph="deferred")),
            "off": stack.enter_context(walk(chapter, scene, graph="deferred")),
        }
        for way in ways_of(chapter):
            found[way] = stack.enter_context(
                walk(chapter, scene, graph="deferred", rays="whole", ray_way=way)
            )
        yield found


@pytest.mark.variants("vulkan", "gl")
def test_a_frame_calls_few_more_functions_than_one_of_the_chapter_before(chapter, walks):
    """Without rays two more techniques are asked for constants, work and rest. OpenGL replays kernels of a refit."""
    counts = {name: calls_of(walk) for name, walk in walks.items()}
    most = 160 if chapter.backend == "gl" else 60
    assert counts["off"] - counts["before"] <= 12, counts
    assert max(counts[way] for way in ways_of(chapter)) - counts["before"] <= most, counts
    assert all(walks[way].draw().work["ray_top_builds"] == 1 for way in ways_of(chapter))


@pytest.mark.alone
@pytest.mark.variants("vulkan")
def test_a_frame_takes_little_more_time_of_its_thread(chapter, monkeypatch, request):
    """CPU time of the thread that renders, without that of the driver in calls that submit and wait. A software driver
    traces on the cores of the test, so the rays are left out of what was recorded: no Python runs for them again."""
    for kind in (RayPicturePass, StructuresPass):
        monkeypatch.setattr(kind, "record", lambda self, commands: None)
    walks = request.getfixturevalue("walks")

    def holds(least):
        more = {name: took - least["before"] for name, took in least.items()}
        within = all(more[way] < BUDGET_S for way in ways_of(chapter))
        return within and more["off"] < 5e-6

    least = python_times(walks, holds, monkeypatch, seconds=16.0)
    assert least["before"] > BUDGET_S and holds(least), least
