"""The study compute-buffers: exact numbers at every size, and a barrier for each who reads them."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch05.studies.compute_buffers import HIGHEST, Settings
from tests.support.frame_calls import calls_of_a_frame
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, owed, use, without_each

runs = pytest.mark.feature("compute/pipelines-and-buffers")
waits = pytest.mark.feature("compute/barriers")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "5/compute-buffers"
SIZES = (1, 63, 64, 65, 1_000_000)
SIZE = (16, 8)


def given(stage, monkeypatch, x):
    """Let the study compute with these numbers."""
    module = chapters.renderer_module(WHICH, stage.backend)
    monkeypatch.setattr(module.Renderer, "numbers", staticmethod(lambda settings, time: x))


def computed(stage, monkeypatch, x, a, b):
    """Return what came back of numbers that went up."""
    given(stage, monkeypatch, x)
    with stage.open(WHICH, SIZE, settings=Settings(len(x), a, b)) as renderer:
        renderer.render(chapters.view_of(renderer)).image(
            "color"
        )  # waits for this frame, and for nothing else
        return renderer.downloaded(0).copy()


@runs
@pytest.mark.parametrize("count", SIZES)
def test_an_affine_map_is_exact(stage, monkeypatch, count):
    x = np.random.default_rng(count).integers(0, 4_000_000, count, dtype=np.uint32)
    y = computed(stage, monkeypatch, x, 997, 12_345)
    assert (
        y.astype(np.int64) == 997 * x.astype(np.int64) + 12_345
    ).all()  # below 2^32: nothing begins again at 0


@runs
@pytest.mark.parametrize("count", SIZES)
def test_random_bits_go_up_and_come_back(stage, monkeypatch, count):
    x = np.random.default_rng(count).integers(0, 2**32, count, dtype=np.uint32)
    assert (computed(stage, monkeypatch, x, 1, 0) == x).all()


@runs
def test_invocations_beyond_the_count_write_nothing(stage):
    with stage.open(WHICH, SIZE, settings=Settings(100)) as renderer:
        renderer._push[2] = 65  # of 100 numbers that there is room for; two groups are 128 invocations
        renderer.downloaded(0)[:] = 77
        renderer.render(chapters.view_of(renderer)).image("color")
        y = renderer.downloaded(0)
        assert (y[65:] == 77).all() and (y[:65] != 77).all()


@runs
def test_the_cpu_compares_what_comes_back_of_each_frame(stage, monkeypatch):
    module = chapters.renderer_module(WHICH, stage.backend)
    with stage.open(WHICH, SIZE) as renderer:
        view = chapters.view_of(renderer)
        work = [renderer.render(view, 0.3 * index).work for index in range(5)]
        assert [one["checked"] for one in work] == [0, 0, 1000, 1000, 1000]
        assert [one["wrong"] for one in work] == [0] * 5
        right = module.expected
        monkeypatch.setattr(module, "expected", lambda x, settings: right(x, settings) + (x == x.max()))
        work = [renderer.render(view, 2.0).work for _ in range(3)]
        assert 0 < work[-1]["wrong"] < 100


@runs
def test_the_picture_shows_a_bar_for_each_number(stage, monkeypatch):
    x = np.arange(SIZE[0], dtype=np.uint32) * 60
    given(stage, monkeypatch, x)
    settings = Settings(SIZE[0], 2, 300)
    with stage.open(WHICH, SIZE, settings=settings) as renderer:
        picture = renderer.render(chapters.view_of(renderer)).image("color")
    height = (1 - (np.arange(SIZE[1]) + 0.5) / SIZE[1])[:, None] * (2 * HIGHEST + 300)
    colors = np.array([(0.05, 0.05, 0.06), (0.1, 0.45, 0.55), (0.95, 0.75, 0.3)])
    expected = colors[(height < 2 * x + 300).astype(int) + (height < x)]
    assert np.abs(picture / 255.0 - expected).max() <= 0.6 / 255


# --- who waits ---

USES = {
    "kernel": [
        use("kernel", "x#", "compute storage_read"),
        use("kernel", "y#", "compute storage_write", fresh=True),
    ],
    "bars": [use("bars", "x#", "fragment storage_read"), use("bars", "y#", "fragment storage_read")],
}


def frames_of(renderer):
    view = chapters.view_of(renderer)
    return lambda number: renderer.render(view, 0.1 * number)


@waits
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    """Against the specification's memory model: the CPU among those who must see what was written."""
    with stage.open(WHICH, SIZE) as renderer:
        events = events_of(renderer, frames_of(renderer), USES, uploaded=["x#"], downloaded=["y#"])
    assert find_hazards(events, {}) == []
    found = [" ".join(map(str, hazards)) for _, hazards in without_each(events)]
    assert sum("fragment" in text for text in found) == 1 and sum("host_read" in text for text in found) == 1


@waits
@only_vulkan
def test_nobody_waits_for_the_whole_device(stage):
    with stage.open(WHICH, SIZE) as renderer:
        for number in range(3):
            names = {call.name for call in calls_of_a_frame(stage.device, renderer, 0.1 * number)}
            assert "vkCmdDispatch" in names and not names & {"vkDeviceWaitIdle", "vkQueueWaitIdle"}


@waits
@only_vulkan
def test_synchronization_validation_misses_the_barrier_before_the_draw(stage):
    if not stage.device.instance.validates:
        pytest.skip("nobody looks: there are no validation layers here")
    with stage.open(WHICH, SIZE) as renderer:
        renderer._for_bars = renderer._for_cpu
        renderer.render(chapters.view_of(renderer)).image("color")
    messages = stage.device.sink.report()
    stage.device.sink.messages.clear()
    assert any("READ_AFTER_WRITE" in message for message in messages), messages


READS = {"glDrawArrays": gl.GL_SHADER_STORAGE_BARRIER_BIT, "begin": gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT}


@waits
@only_gl
def test_opengl_is_told_how_each_reads_what_was_stored(stage):
    with stage.open(WHICH, SIZE, outputs=()) as renderer:  # copies of pictures have barriers of their own
        calls = gl_calls(stage.device, renderer, frames_of(renderer))
    assert [name for name, _ in calls].count("glDispatchCompute") == 5
    assert owed(calls, READS) == []
    for reader, bit in READS.items():
        left = [one for one in calls if one != ("glMemoryBarrier", bit)]
        assert {*owed(left, READS)} == {reader}
