"""The study dispatch-size: who reached which place, counted by the GPU, against the same groups walked through here."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch05.studies.dispatch_size import (
    LOCALS,
    Settings,
    groups_of,
    launched,
    local_size,
    room,
    work_of,
)
from common.images.palette import id_color
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, owed, use, without_each

sizing = pytest.mark.feature("compute/dispatch-sizing")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "5/dispatch-size"
SIZES = [(61, 37), (1, 1), (65, 8)]


def reached(settings):
    """Return how often each place is reached, row after row, and what is written behind the last one."""
    columns, rows = launched(settings)
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    inside = (x < settings.width) & (y < settings.height)
    places = (y * settings.width + x)[inside if settings.guard else inside | True]
    return np.bincount(places.ravel(), minlength=room(settings))


def counted(stage, settings, size=(8, 8)):
    with stage.open(WHICH, size, settings=settings) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        return renderer.counters(), frame.image("color"), frame.work


@sizing
@pytest.mark.parametrize("local", LOCALS)
def test_rounded_up_every_place_is_reached_exactly_once(stage, local):
    for width, height in SIZES:
        counters, _, work = counted(stage, Settings(width, height, local))
        assert len(counters) >= width * height
        assert (counters[: width * height] == 1).all() and (counters[width * height :] == 0).all()
        assert work["invocations"] - work["idle"] == width * height


@sizing
def test_the_numbers_of_groups():
    assert groups_of(Settings(1280, 720)) == (160, 90)
    assert groups_of(Settings(1281, 719)) == (161, 90)
    assert groups_of(Settings(17, 9, "16x16")) == (2, 1)
    assert groups_of(Settings(17, 9, "16x16", "down")) == (1, 0)
    assert groups_of(Settings(17, 9, "16x16", "size")) == (17, 9)
    work = work_of(Settings(61, 37))
    assert (work.groups, work.invocations, work.idle) == (40, 2560, 2560 - 61 * 37)
    assert work_of(Settings(61, 37, groups="size")).idle == 61 * 8 * 37 * 8 - 61 * 37
    assert [local_size(Settings(local=local)) for local in LOCALS[:3]] == [(1, 1), (8, 1), (64, 1)]


@sizing
@pytest.mark.parametrize("groups", ["up", "down", "size"])
@pytest.mark.parametrize("size", [(61, 37), (17, 9), (16, 16)])
def test_without_a_guard_what_is_right_of_a_row_lands_in_the_next_one(stage, groups, size):
    for guard in (True, False):
        settings = Settings(*size, "8x8", groups, guard)
        counters, _, _ = counted(stage, settings)
        assert (counters == reached(settings)).all()
    if groups == "up" and size[0] % 8:
        spilled = (counters.reshape(-1)[: size[0] * size[1]].reshape(size[1], size[0]) == 2).any(axis=0)
        assert spilled.sum() == -size[0] % 8 and spilled[: -size[0] % 8].all()
        assert counters[size[0] * size[1] :].sum() > 0  # the last row has no next one
    if groups == "down" and size[0] % 8:
        missed = counters[: size[0] * size[1]].reshape(size[1], size[0]) == 0
        assert missed[:, -(size[0] % 8) :].all() and missed[-(size[1] % 8) :].all()


@sizing
@pytest.mark.parametrize("groups", ["up", "down"])
@pytest.mark.parametrize("guard", [True, False])
def test_the_picture_shows_what_was_counted(stage, groups, guard):
    settings = Settings(17, 9, "8x8", groups, guard)
    counters, picture, _ = counted(stage, settings, (48, 32))  # two pixels for each place of 3x2 groups
    x, y = np.meshgrid(np.arange(24), np.arange(16))
    once = id_color(y // 8 * 4096 + x // 8) * 0.85 * (0.9 + 0.1 * ((x ^ y) & 1))[..., None]
    expected = np.full((16, 24, 3), (0.05, 0.05, 0.06))
    columns, rows = launched(settings)
    expected[:rows, :columns] = 0.35
    place = counters[: 17 * 9].reshape(9, 17)[..., None]
    expected[:9, :17] = np.where(place == 1, once[:9, :17], place > 1)
    assert np.abs(picture[::2, ::2] / 255 - expected).max() <= 0.6 / 255
    assert (picture[::2, ::2] == picture[1::2, 1::2]).all()


@sizing
@pytest.mark.parametrize("local", ["1x1", "16x16"])
def test_repeated_dispatches_count_again_and_are_timed_together(stage, local):
    settings = Settings(61, 37, local, repeat=5)
    counters, picture, _ = counted(stage, settings, (64, 48))
    assert (counters[: 61 * 37] == 5).all()
    assert (picture == counted(stage, Settings(61, 37, local), (64, 48))[1]).all()
    with stage.open(WHICH, (8, 8), settings=settings) as renderer:
        timings = renderer.render(chapters.view_of(renderer)).timings
    assert [*timings] == ["dispatch size"] and timings["dispatch size"] > 0


# --- who waits ---


@sizing
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    uses = {
        "clear": [use("clear", "counters", "copy copy_write", fresh=True)],
        "kernel": [use("kernel", "counters", "compute storage_read", "compute storage_write")],
        "show": [use("show", "counters", "fragment storage_read")],
    }
    with stage.open(WHICH, (8, 8)) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view), uses)
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "host" not in str(one)]
    assert len(own) == 3 and all(own)


@sizing
@only_gl
def test_opengl_is_told_before_the_counters_are_cleared_and_before_they_are_shown(stage):
    store, update = gl.GL_SHADER_STORAGE_BARRIER_BIT, gl.GL_BUFFER_UPDATE_BARRIER_BIT
    with stage.open(WHICH, (8, 8)) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view))
    reads = {"glDrawArrays": store, "glNamedBufferSubData": update}
    # The first upload of a frame clears the counters; the second one is of push constants, which no shader stores to.
    uploads = [place for place, (name, _) in enumerate(calls) if name == "glNamedBufferSubData"]
    calls = [one for place, one in enumerate(calls) if place not in uploads[1::2]]
    assert owed(calls, reads) == []
    for bit, name in ((store, "glDrawArrays"), (update, "glNamedBufferSubData")):
        assert {*owed([one for one in calls if one != ("glMemoryBarrier", bit)], reads)} == {name}


@pytest.mark.parametrize(
    ("set_", "said"),
    [
        ("local=8x9", "local cannot be '8x9'"),
    ],
)
def test_what_cannot_be_is_one_sentence(strata, set_, said):
    words = [word for one in set_.split() for word in ("--set", one)]
    code, _, err = strata("run", WHICH, "--size", "8x8", "--headless", *words)
    assert code == 2 and said in err and err.count("\n") == 1, err
