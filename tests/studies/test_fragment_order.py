"""The study fragment-order: every pixel once, no number left out, nothing behind the list's end."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from backends.gl.resources import write_buffer
from backends.vulkan.upload import Uploader
from chapters.ch05.studies.fragment_order import Settings, shown
from common.errors import UnsupportedError
from common.images.palette import heat
from tests.support.frame_calls import calls_of_a_frame, not_waited_for, views_made
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, use, without_each

orders = pytest.mark.feature("compute/fragment-order-atomics")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "5/fragment-order"
SIZES = [(61, 37), (64, 48), (1, 1), (130, 3)]


@orders
@pytest.mark.parametrize("shape", ["triangle", "quad"])
@pytest.mark.parametrize("size", SIZES)
def test_each_pixel_has_one_number_and_no_number_is_left_out(stage, shape, size):
    """In each frame anew, and of two triangles none takes the pixels of their diagonal twice."""
    every = {(x, y) for x in range(size[0]) for y in range(size[1])}
    with stage.open(WHICH, size, settings=Settings(shape)) as renderer:
        for _ in range(2):
            renderer.render(chapters.view_of(renderer))
            count, order = renderer.order()
            assert count == len(order) == len(every)
            assert {(int(x), int(y)) for x, y in order} == every


@orders
def test_a_list_that_is_too_short_takes_the_first_and_nothing_is_written_behind_its_end(stage):
    size, room = (61, 37), 500
    with stage.open(WHICH, size) as renderer:
        view = chapters.view_of(renderer)
        nobody = np.full(61 * 37, 0xFFFFFFFF, np.uint32)
        if stage.backend == "gl":
            write_buffer(stage.device, renderer._nodes, nobody)
        else:
            with Uploader(stage.device) as uploader:
                uploader.buffer(renderer._nodes, nobody)
        renderer.capacity = room
        for _ in range(3):
            renderer.render(view)
            count, order = renderer.order()
            assert count == 61 * 37  # all draw a number, also those who then find no room
            assert (order[room:] == 0xFFFF).all()
            assert len(np.unique(order[:room], axis=0)) == room and (order[:room] < size).all()


@orders
@pytest.mark.parametrize("percent", [0.0, 37.0, 100.0])
def test_the_first_ones_are_shown_in_the_colour_of_their_number(stage, percent):
    size = (61, 37)
    with stage.open(WHICH, size, settings=Settings(percent=percent, seconds=0.0)) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        order, picture = renderer.order()[1], frame.image("color")
    total = size[0] * size[1]
    count = int(percent / 100 * total)
    assert frame.work["points"] == count
    expected = np.full((size[1], size[0], 3), (0.05, 0.05, 0.06))
    first = order[:count].astype(int)
    expected[first[:, 1], first[:, 0]] = heat(0.15 + 0.85 * np.arange(count) / total)
    assert np.abs(picture - 255 * expected).max() <= 0.6


@orders
def test_they_appear_over_the_time_asked_for():
    half = Settings(percent=50.0, seconds=4.0)
    assert [shown(half, time, 1000) for time in (-1.0, 0.0, 1.0, 2.0, 4.0, 99.0)] == [
        0,
        0,
        125,
        250,
        500,
        500,
    ]
    assert shown(Settings(seconds=0.0), 0.0, 1000) == 1000


@orders
def test_another_size_has_a_list_of_its_own(stage):
    with stage.open(WHICH, (8, 5)) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view)
        renderer.resize((13, 7))
        renderer.render(view)
        count, order = renderer.order()
        assert count == 91 and len(np.unique(order, axis=0)) == 91 and order.max(axis=0).tolist() == [12, 6]


# --- who waits ---


@orders
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    uses = {
        "reset": [use("reset", "count", "copy copy_write", fresh=True)],
        "number": [
            use("number", "count", "fragment storage_read", "fragment storage_write"),
            use("number", "nodes", "fragment storage_write", fresh=True),
        ],
        "points": [use("points", "nodes", "vertex storage_read")],
    }
    with stage.open(WHICH, (9, 7)) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view, 0.5), uses)
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "host" not in str(one)]
    assert len(own) == 3 and all(own)
    with views_made(stage.device) as images, stage.open(WHICH, (9, 7)) as renderer:
        calls = calls_of_a_frame(stage.device, renderer, 0.5)
    assert not_waited_for(calls, images) == []


@orders
@only_gl
def test_opengl_is_told_before_the_reset_and_between_the_draws(stage):
    with stage.open(WHICH, (9, 7)) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view, 0.5), 2)
    store, update = gl.GL_SHADER_STORAGE_BARRIER_BIT, gl.GL_BUFFER_UPDATE_BARRIER_BIT
    counter = next(one for one in calls if one[0] == "glNamedBufferSubData")  # push constants go up later
    frame = [
        ("glMemoryBarrier", store | update),
        counter,
        ("glDrawArrays", gl.GL_TRIANGLES),
        ("glMemoryBarrier", store),
        ("glDrawArrays", gl.GL_TRIANGLES),
    ]
    assert [one for one in calls if one in frame] == frame * 2


@orders
@only_vulkan
def test_a_device_whose_fragments_cannot_write_is_told_in_a_sentence(stage, monkeypatch):
    monkeypatch.setattr(
        type(stage.device.physical), "lacks", lambda self, needed: "the driver lacks a feature"
    )
    with pytest.raises(UnsupportedError, match="the driver lacks a feature; try --backend gl"):
        stage.open(WHICH, (4, 4))


@pytest.mark.parametrize(
    ("set_", "said"), [("percent=101", "percent must be 0 to 100"), ("shape=quads", "did you mean 'quad'?")]
)
def test_what_cannot_be_is_one_sentence(strata, set_, said):
    code, _, err = strata("run", WHICH, "--set", set_)
    assert code == 2 and said in err and err.count("\n") == 1, err
