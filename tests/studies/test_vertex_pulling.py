"""The study vertex-pulling: both ways of fetching vertices give the same bits, and those are the object's."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch01.studies.vertex_pulling import VERTEX, Settings, vertices_of
from common.scene import Material
from tests.support.bounds import codes_off
from tests.support.scenes import facing, quad_scene

SIZE = (56, 40)


@pytest.mark.feature("geometry/vertex-pulling")
@pytest.mark.parametrize("time", [0.0, 1.1, 4.0])
def test_pulled_and_fed_by_attributes_are_the_same_picture_to_the_bit(stage, time):
    pulled, fed = (
        stage.draw("vertex-pulling", SIZE, time, outputs=("color", "depth"), settings=Settings(feed=feed))
        for feed in ("pulled", "attributes")
    )
    assert (pulled["color"] == fed["color"]).all() and (pulled["depth"] == fed["depth"]).all()
    assert (pulled["depth"] > 0).mean() > 0.15 and len(np.unique(pulled["color"])) > 50


@pytest.mark.feature("geometry/vertex-pulling")
def test_a_vertex_is_20_bytes_without_a_gap():
    assert VERTEX.itemsize == 20
    assert [VERTEX.fields[name][1] for name in ("position", "uv")] == [0, 12]

    class Made:
        positions = np.arange(6, dtype=np.float32).reshape(2, 3)
        uv = 10 + np.arange(4, dtype=np.float32).reshape(2, 2)

    assert vertices_of(Made).view(np.float32).tolist() == [0, 1, 2, 10, 11, 3, 4, 5, 12, 13]  # type: ignore[arg-type]


@pytest.mark.feature("geometry/vertex-pulling")
@pytest.mark.parametrize("feed", ["pulled", "attributes"])
def test_a_square_seen_edge_to_edge_shows_its_uv(stage, feed):
    side = 32
    picture = stage.draw(
        "vertex-pulling",
        (side, side),
        0.0,
        facing(1.0),
        scene=quad_scene(Material()),
        settings=Settings(feed=feed),
    )["color"]
    at = (np.arange(side) + 0.5) / side
    u, v = np.meshgrid(at, at)
    dark = (np.floor(8 * u) + np.floor(8 * v)) % 2
    expected = np.stack([u, v, np.full_like(u, 0.5)], axis=-1) * (1 - 0.5 * dark[..., None])
    assert np.abs(picture - 255 * expected).max() <= codes_off(stage.device) + 0.1
    assert np.abs(picture - 255 * expected[..., [1, 0, 2]]).max() > 100, (
        "u and v in another order are noticed"
    )
