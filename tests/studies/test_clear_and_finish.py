"""The study clear-and-finish: after the first layer every pixel is known, after the last one the layout is."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl.readback import read_image
from backends.vulkan import api as vk
from chapters.ch04.studies.clear_and_finish import Settings
from tests.support.bounds import codes_off, snapping
from tests.support.frame_calls import barriers_of, calls_of_a_frame, labels_of, not_waited_for, views_made

finishing = pytest.mark.feature("composition/clear-and-finish")
WHICH = "4/clear-and-finish"
CLEARED = 255 * np.array([0.96, 0.9, 0.8])
BOTH = ("color", "depth")
LAYOUTS = {
    "copy_source": vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
    "sampled": vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL,
    "color": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
}
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")


@finishing
@pytest.mark.parametrize("size", [(40, 30), (7, 61), (1, 1)])
def test_after_clear_every_pixel_has_the_colour_and_the_depth_of_what_is_infinitely_far(stage, size):
    """The ledger says depth 1, as books do: reversed, that is 0."""
    images = stage.draw(WHICH, size, settings=Settings(panels=False), outputs=BOTH)
    assert np.abs(images["color"] - CLEARED).max() <= codes_off(stage.device) + 1e-3
    assert (images["depth"] == 0.0).all()


def panel_depth(size, time):
    """Return (H, W) float64: the nearer of the two panels, 0 beside both; and whether a centre is away from edges."""
    width, height = size
    x, y = np.meshgrid((np.arange(width) + 0.5) / width * 2 - 1, (np.arange(height) + 0.5) / height * 2 - 1)
    depth, clear = np.zeros(x.shape), np.ones(x.shape, bool)
    for turned in (1.0, -1.0):
        u, v = (x - 0.25 * np.sin(time)) / 0.6, (y - turned * 0.15) / 0.5
        inside = (np.abs(u) < 1) & (np.abs(v) < 1)
        depth = np.maximum(depth, np.where(inside, 0.4 + 0.2 * turned * u, 0.0))
        clear &= (np.abs(np.abs(u) - 1) > 0.01) & (np.abs(np.abs(v) - 1) > 0.01)
    return depth, clear


@finishing
@pytest.mark.parametrize("time", [0.0, 0.9])
def test_what_is_drawn_later_changes_no_pixel_that_it_does_not_touch(stage, time):
    size = (61, 47)
    images = stage.draw(WHICH, size, time, outputs=BOTH)
    depth, clear = panel_depth(size, time)
    # A slope of 0.2 over 0.3 of the width, and the rounding of depth near 1.
    bound = 2 * np.finfo(np.float32).eps + snapping(stage.device) * 0.2 / 0.3 / size[0]
    assert np.abs(images["depth"] - depth)[clear].max() <= bound
    touched = depth > 0
    off = np.abs(images["color"] - CLEARED).max(axis=-1)
    assert off[clear & ~touched].max() <= codes_off(stage.device) + 1e-3 and off[clear & touched].min() > 30


@finishing
def test_nothing_of_a_frame_before_is_left(stage):
    with stage.open(WHICH, (48, 32), outputs=BOTH) as renderer:
        view = chapters.view_of(renderer)
        for time in (0.0, 1.5, 4.0):
            renderer.render(view, time)
        frame = renderer.render(view, 2.0)
        fresh = stage.draw(WHICH, (48, 32), 2.0, outputs=BOTH)
        for name in BOTH:
            assert (frame.image(name) == fresh[name]).all()


@only_vulkan
@finishing
@pytest.mark.parametrize("finish", LAYOUTS)
def test_the_layout_is_declared_by_the_last_layer_and_each_layer_is_recorded_once(stage, finish):
    """Replayed from the calls: who reads the picture next, the stage that copies it, begins from there."""
    with stage.open(WHICH, (16, 16), settings=Settings(finish=finish)) as renderer:
        renderer.render(chapters.view_of(renderer)).image("color")
        calls = calls_of_a_frame(stage.device, renderer)
        layout, left = None, {}
        for label, barrier in barriers_of(calls, renderer.picture.handle):
            assert barrier.oldLayout in (vk.VK_IMAGE_LAYOUT_UNDEFINED, layout)
            layout = left[label] = barrier.newLayout
        assert labels_of(calls) == ["clear and finish", "clear", "panels", "finish"]
        assert left["finish"] == LAYOUTS[finish]
        assert left["clear"] == left["panels"] == LAYOUTS["color"]


@only_vulkan
@finishing
def test_what_is_drawn_on_the_clear_waits_for_it(stage):
    with views_made(stage.device) as images, stage.open(WHICH, (16, 16)) as renderer:
        calls = calls_of_a_frame(stage.device, renderer)
    assert not_waited_for(calls, images) == []


@only_vulkan
@finishing
def test_a_last_layer_that_does_not_do_what_it_declares_is_reported(stage, monkeypatch):
    if not stage.device.instance.validates:
        pytest.skip("nobody looks: there are no validation layers here")
    module = chapters.renderer_module(WHICH, "vulkan")
    monkeypatch.setattr(module.Renderer, "finish", lambda self, commands: None)
    stage.draw(WHICH, (8, 8), settings=Settings(finish="sampled"))
    messages = stage.device.sink.report()
    stage.device.sink.messages.clear()
    assert any("layout" in message.lower() for message in messages)


@pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
@finishing
def test_on_opengl_the_picture_can_be_read_at_once(stage):
    with stage.open(WHICH, (24, 18)) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        found = read_image(stage.device, renderer.picture)
        assert (found[..., :3] == frame.image("color")).all() and len(np.unique(found)) > 3
