"""What is really submitted: replayed by a simulated GPU over several frames, with every barrier and wait tried out."""

from __future__ import annotations

import pytest

from chapters.ch04.settings import Settings
from common.settings import flat
from tests.ch04.test_graph_frames import OUTPUTS, SETTINGS, SIZE, scene
from tests.support.hazards import Barriers, Signal, Wait, find_hazards
from tests.support.scenes import facing
from tests.support.traced_frames import Trace, hazards_without

__all__ = ["scene"]

PATHS = {
    "surfaces first": {"graph": "deferred"},
    "forward": {"graph": "forward"},
    "pre-pass": {"graph": "deferred", "depth_prepass": True},
    "alone": {"graph": "deferred", "alias": False},
    "samples": {"graph": "forward", "msaa": 4},
    "anew": {"graph": "deferred", "resubmit": False},
}


@pytest.fixture(params=PATHS)
def traced(chapter, scene, request):
    """Return the events of four frames with a moving camera, and where the transients lie."""
    settings = Settings(**flat(SETTINGS) | PATHS[request.param])  # of the chapter that is tested
    with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
        renderer.render(facing())
        trace = Trace(renderer)
        return trace.events(lambda: renderer.render(facing())), trace.places


@pytest.mark.variants("vulkan")
@pytest.mark.feature("frame-graph/barriers")
def test_no_frame_has_a_hazard_and_each_barrier_and_wait_is_needed(traced):
    events, places = traced
    assert not find_hazards(events, places)
    barriers = {(event, one) for event in events if isinstance(event, Barriers) for one in event.dependencies}
    assert len(barriers) > 5
    for event, one in barriers:
        found = hazards_without(events, places, lambda e, d, event=event, one=one: e == event and d == one)
        # A barrier of all memory is written here as one of each resource, of which most have nothing to wait for.
        assert found or not (one.old or one.new), f"nobody misses the barrier of {one.resource}"
    for waited in {event for event in events if isinstance(event, (Wait, Signal))}:
        assert hazards_without(events, places, lambda e, d, waited=waited: e == waited), waited
