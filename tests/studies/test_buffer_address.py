"""The study buffer-address: the same bits through an address and through a descriptor, and at any multiple of 4."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.vulkan.resources import buffer_address
from chapters.ch02.studies.buffer_address import UNIFORM, Settings
from common.scene import Material
from tests.support.bounds import codes_off
from tests.support.scenes import facing, quad_scene

SIZE = (56, 40)


pytestmark = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
"""OpenGL has no addresses of buffers."""


@pytest.mark.parametrize("time", [0.0, 1.1, 4.0])
def test_by_address_and_by_descriptor_are_the_same_picture_to_the_bit(stage, time):
    by_address, by_set = (
        stage.draw("2/buffer-address", SIZE, time, outputs=("color", "depth"), settings=Settings(feed=feed))
        for feed in ("address", "descriptor")
    )
    assert (by_address["color"] == by_set["color"]).all() and (by_address["depth"] == by_set["depth"]).all()
    assert (by_set["depth"] > 0).mean() > 0.15 and len(np.unique(by_set["color"])) > 50


@pytest.mark.parametrize("time", [0.0, 2.3])
def test_depth_is_that_of_vertex_pulling_to_the_bit(stage, time):
    """Of another study, with shaders and a buffer of its own: vertices lie in a set there, in either case."""
    here = stage.draw("2/buffer-address", SIZE, time, outputs=("depth",))["depth"]
    there = stage.draw("vertex-pulling", SIZE, time, outputs=("depth",))["depth"]
    assert (here == there).all()


def test_a_square_seen_edge_to_edge_shows_its_rings(stage):
    side = 32
    view, scene = facing(1.0), quad_scene(Material())
    picture = stage.draw("2/buffer-address", (side, side), 0.0, view, scene=scene)["color"]
    at = (np.arange(side) + 0.5) / side
    u, v = np.meshgrid(at, at)
    rings = 6 * np.hypot(u - 0.5, v - 0.5)
    colors = np.where(
        (rings % 1 >= 0.5)[..., None], (0.1, 0.1, 0.2), np.stack([u, v, np.full_like(u, 0.6)], axis=-1)
    )
    sure = np.abs(rings * 2 - np.round(rings * 2)) > 1e-3  # elsewhere rounding decides for a ring
    assert sure.mean() > 0.95
    assert np.abs(picture - 255 * colors)[sure].max() <= codes_off(stage.device) + 0.1


def test_the_address_is_the_buffers_and_the_bytes_of_the_indices_behind_it(stage):
    with stage.open("2/buffer-address", SIZE) as renderer:
        indices = 36 * 4
        assert renderer._address == buffer_address(stage.device, renderer._indices) + indices
        renderer.render(chapters.view_of(renderer)).image("color")
        assert renderer._uniforms[0].view(UNIFORM)["address"][0] == renderer._address
    assert (
        indices % stage.device.limits.minStorageBufferOffsetAlignment or indices % 64
    )  # no place for a descriptor
    assert UNIFORM.itemsize == 144 and UNIFORM.fields["address"][1] == 128
