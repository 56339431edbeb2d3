"""The study ordered-layers against painter-order compositing in double precision, and against its list of items."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import chapters
from chapters.ch04.studies.ordered_layers import CLEAR, Item, Settings, items, passes_of
from tests.support.frame_calls import calls_of_a_frame, labels_of, not_waited_for, views_made

layers = pytest.mark.feature("composition/ordered-layers")
WHICH = "4/ordered-layers"
SIZE = (64, 36)
KNOBS = ("sky", "sun", "hills", "mist", "inset")


def cover(inside, soft):
    return np.clip(inside / soft, 0, 1)


def layer(name, size, target):
    """Return (H, W, 4) float64, colour and alpha, of a layer as the docstrings and knobs describe it."""
    width, height = size
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height)
    made = np.zeros((height, width, 4))

    def painted(color, alpha):
        made[..., :3], made[..., 3] = color, alpha
        return made

    def mixed(one, other, k):
        return np.array(one) * (1 - k[..., None]) + np.array(other) * k[..., None]

    if name == "sky":
        return painted(mixed((0.2, 0.4, 0.75), (0.95, 0.8, 0.6), v), 1.0)
    if name == "sun":
        away = np.hypot((u - 0.7) * 16 / 9, v - 0.45)
        return painted((1.0, 0.9, 0.3), cover(0.22 - away, 0.02))
    if name == "hills":
        return painted((0.2, 0.4, 0.25), cover(v - 0.68 - 0.1 * np.sin(7 * u), 0.02))
    if name == "mist":
        return painted((0.9, 0.9, 0.95), 0.7 * cover(0.2 - np.abs(v - 0.66), 0.2))
    if name == "map":
        away = np.hypot((u - 0.4) * 16 / 9, v - 0.6)
        return painted(mixed((0.3, 0.2, 0.1), (0.9, 0.85, 0.7), 0.5 + 0.5 * np.cos(40 * away)), 1.0)
    assert name == "inset"
    x, y = width // 16, height // 16
    small = target[::4, ::4]
    rows, columns = min(small.shape[0], height - y), min(small.shape[1], width - x)
    made[y : y + rows, x : x + columns, :3] = small[:rows, :columns]
    made[y : y + rows, x : x + columns, 3] = 0.85
    return made


def painted(listed, size=SIZE):
    """Return the screen (H, W, 3) in codes: sheets laid on one another in order, each on its own target."""
    targets = {}
    for output in {"", *(item.output for item in listed)}:
        targets[output] = np.tile(np.array(CLEAR[:3]), (size[1], size[0], 1))
    for item in listed:
        if item.enabled:
            sheet = layer(item.name, size, targets.get(item.reads))
            alpha = sheet[..., 3:]
            targets[item.output] = sheet[..., :3] * alpha + targets[item.output] * (1 - alpha)
    return 255 * targets[""]


def drawn(stage, monkeypatch, listed, merge=False, size=SIZE):
    module = chapters.renderer_module(WHICH, stage.backend)
    monkeypatch.setattr(module.Renderer, "items", staticmethod(lambda settings: listed))
    return stage.draw(WHICH, size, settings=Settings(merge=merge))["color"]


CODES = 3.5
"""Each of up to six sheets may round its colour and what it is laid on by half a code."""


@layers
@pytest.mark.parametrize("off", [(), *((knob,) for knob in KNOBS), ("sky", "mist"), KNOBS])
def test_the_picture_is_that_of_the_enabled_items_laid_on_one_another(stage, off):
    settings = Settings(**dict.fromkeys(off, False))
    found = stage.draw(WHICH, SIZE, settings=settings)["color"]
    truth = painted(items(settings))
    assert np.abs(found - truth).max() <= CODES
    if off:
        assert np.abs(found - painted(items(Settings()))).max() > 10


@layers
def test_the_order_of_the_list_is_the_order_of_the_sheets(stage, monkeypatch):
    sheets = [one for one in items(Settings()) if one.name in ("sky", "sun", "hills")]
    truths = []
    for listed in itertools.permutations(sheets):
        truths.append(painted(listed))
        for merge in (False, True):
            found = drawn(stage, monkeypatch, list(listed), merge)
            assert np.abs(found - truths[-1]).max() <= CODES
    assert len(np.unique(np.array(truths), axis=0)) > 3


@layers
@pytest.mark.parametrize("size", [(61, 37), (16, 16), (5, 3)])
def test_passes_that_are_shared_draw_the_same_bits(stage, size):
    pictures = [stage.draw(WHICH, size, settings=Settings(merge=merge))["color"] for merge in (False, True)]
    assert (pictures[0] == pictures[1]).all()
    assert np.abs(pictures[0] - painted(items(Settings()), size)).max() <= CODES


@layers
def test_a_list_becomes_passes_and_an_item_without_output_falls_back_to_the_screen():
    def shown(settings):
        return [
            (output, [one.name for one in drawn])
            for output, drawn in passes_of(items(settings), settings.merge)
        ]

    assert shown(Settings()) == [
        ("", []),
        ("", ["sky"]),
        ("", ["sun"]),
        ("map", ["map"]),
        ("", ["hills"]),
        ("", ["mist"]),
        ("", ["inset"]),
    ]
    assert shown(Settings(merge=True)) == [
        ("", ["sky", "sun"]),
        ("map", ["map"]),
        ("", ["hills", "mist", "inset"]),
    ]
    assert shown(Settings(merge=True, inset=False)) == [("", ["sky", "sun", "hills", "mist"])]
    assert shown(Settings(*[False] * 5)) == [("", [])]


@layers
@pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
@pytest.mark.parametrize("off", [(), ("sun", "hills"), ("inset",), KNOBS])
def test_what_is_recorded_is_the_list_of_enabled_items_each_in_a_pass_to_its_target(stage, off):
    settings = Settings(**dict.fromkeys(off, False))
    with stage.open(WHICH, (16, 16), settings=settings) as renderer:
        calls = calls_of_a_frame(stage.device, renderer)
        enabled = [one for one in items(settings) if one.enabled]
        assert labels_of(calls)[1:] == [one.name for one in enabled]
        views = [
            call.arguments[1].pColorAttachments[0].imageView
            for call in calls
            if call.name == "vkCmdBeginRendering"
        ]
        on_screen = [view == renderer.picture.view for view in views]
        assert on_screen == [True, *(one.output == "" for one in enabled)]
        assert len([call for call in calls if call.name == "vkCmdDraw"]) == len(enabled)
        work = renderer.render(chapters.view_of(renderer)).work
        assert (work["draws"], work["passes"]) == (len(enabled), len(enabled) + 1)


@layers
@pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
@pytest.mark.parametrize("merge", [False, True])
def test_no_barrier_between_passes_is_forgotten(stage, merge):
    with (
        views_made(stage.device) as images,
        stage.open(WHICH, (16, 16), settings=Settings(merge=merge)) as renderer,
    ):
        calls = calls_of_a_frame(stage.device, renderer)
    assert not_waited_for(calls, images) == []


@layers
@pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
@pytest.mark.parametrize("off", [(), ("sun", "inset"), KNOBS])
def test_opengl_goes_through_the_same_list(stage, monkeypatch, off):
    module = chapters.renderer_module(WHICH, "gl")
    settings, done = Settings(**dict.fromkeys(off, False)), []
    begin, label = module.begin, stage.device.begin_label
    monkeypatch.setattr(
        module,
        "begin",
        lambda context, target, clear: (done.append(target.name), begin(context, target, clear)),
    )
    monkeypatch.setattr(stage.device, "begin_label", lambda name: (done.append(f"> {name}"), label(name)))
    with stage.open(WHICH, (16, 16), settings=settings) as renderer:
        renderer.render(chapters.view_of(renderer))
    expected = ["> ordered layers", "picture"]
    for one in items(settings):
        if one.enabled:
            expected += [one.output or "picture", f"> {one.name}"]
    assert done == expected


@layers
def test_an_output_may_be_drawn_by_several_items_and_be_read_twice(stage, monkeypatch):
    """The first pass to a target clears it, a later one draws on what is there."""
    listed = [
        Item("sky", 0, output="own"),
        Item("hills", 2),
        Item("sun", 1, output="own"),
        Item("inset", 5, reads="own"),
        Item("mist", 3, output="own"),
        Item("inset", 5, reads="own"),
    ]
    truth = painted(listed)
    for merge in (False, True):
        assert np.abs(drawn(stage, monkeypatch, listed, merge) - truth).max() <= CODES


def test_another_size_and_later_frames_are_the_same_picture(stage):
    with stage.open(WHICH, (20, 11)) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view)
        renderer.resize(SIZE)
        pictures = [renderer.render(view).image("color") for _ in range(3)]
        fresh = stage.draw(WHICH, SIZE)["color"]
        assert all((one == fresh).all() for one in pictures)
