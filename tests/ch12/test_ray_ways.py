"""The way that finds hits: what settings and features of a device choose, and what is refused in a sentence."""

from __future__ import annotations

import pytest

from chapters import ch12
from chapters.ch12.rays.picture import chosen_way
from chapters.ch12.settings import Settings
from common.errors import UserError

pytestmark = pytest.mark.feature("ray-tracing/capability-gate")


class Having:
    """A plan in which some features are native."""

    def __init__(self, *features: str) -> None:
        self.features = features

    def native(self, feature: str) -> bool:
        return feature in self.features


@pytest.mark.parametrize(
    ("features", "wanted", "way"),
    [
        (("ray-tracing", "ray-query"), "auto", "pipeline"),
        (("ray-query",), "auto", "query"),
        ((), "auto", "bvh"),
        (("ray-tracing", "ray-query"), "query", "query"),
        (("ray-tracing", "ray-query"), "bvh", "bvh"),
    ],
)
def test_the_first_way_that_the_device_has(features, wanted, way):
    assert {"ray-tracing", "ray-query"} <= ch12.LESSON.needs.optional
    assert chosen_way(Settings(ray_way=wanted), Having(*features)) == way


@pytest.mark.parametrize("way", ["pipeline", "query"])
def test_a_way_that_is_not_there_is_refused(way):
    with pytest.raises(UserError, match=f"ray_way={way} needs ray-.*: set ray_way=bvh, or auto"):
        chosen_way(Settings(ray_way=way), Having())


def test_steps_are_those_of_our_own_traversal():
    """A driver does not tell how many steps its traversal takes."""
    everything = Having("ray-tracing", "ray-query")
    for way in ("auto", "bvh"):
        assert chosen_way(Settings(ray_way=way, ray_view="steps"), everything) == "bvh"
    for way in ("pipeline", "query"):
        with pytest.raises(UserError, match="ray_view=steps shows the steps of our own BVH"):
            chosen_way(Settings(ray_way=way, ray_view="steps"), everything)
