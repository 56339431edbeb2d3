"""Images of a history and of what finishes the picture in shared memory: the layers find no hazard."""

from __future__ import annotations

import pytest

from chapters.ch11.settings import Settings
from tests.support.frame_costs import VIEWS, lit_yard
from tests.support.shadows import PLAIN

pytestmark = pytest.mark.variants("vulkan")

SIZES = ((100, 60), (33, 21))
"""Sizes of which images end with padding."""

KNOBS = (
    {"graph": "forward", "taa": "full"},
    {"graph": "deferred", "taa": "full", "exposure": "histogram"},
    {"graph": "compute", "exposure": "mips"},
)


@pytest.mark.feature("frame-graph/resource-aliasing")
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("knobs", KNOBS, ids=lambda knobs: knobs["graph"])
def test_images_that_share_memory_wait_for_each_other(chapter, size, knobs):
    """Any message of synchronization validation fails a test. Frames share memory with those before."""
    settings = Settings(
        **{**PLAIN, "shadows": "off", "bloom": 0.2, "aperture": 0.1, "motion_blur": 1.0, **knobs}
    )
    with chapter.open(lit_yard(), size, settings) as renderer:
        for view in VIEWS[:3]:
            frame = renderer.render(view)
        assert frame.image("color").any()
        memory = renderer.graph.memory
        assert memory.size < memory.alone
        assert any(place.padding for place in memory.places.values()), "no image has padding"
