"""The study render-passes: the table of its flags, what objects are made of it, and the same bits without objects."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from chapters.ch04.studies.render_passes import FLAGS, SQUARES, Settings
from chapters.ch04.studies.render_passes.flags import Flag, Use, uses
from chapters.ch04.studies.render_passes.objects import create_render_pass
from tests.support.frame_calls import calls_of_a_frame, not_waited_for, views_made

flagged = pytest.mark.feature("device/render-pass-flags")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
WHICH = "4/render-passes"
SIDE = 48
WAYS = ("classic", "dynamic")

# First, Last, Offscreen, Internal: colour's load without and with a clear, its states before and after; then depth's
# load likewise, and whether it is stored. Of the sixteen, the other eight contradict themselves.
TABLE = {
    "....": ("load", "clear", "color", "color", "load", "clear", "store"),
    "F...": ("dont_care", "clear", "undefined", "color", "dont_care", "clear", "store"),
    ".L..": ("load", "clear", "color", "copy_source", "load", "clear", "dont_care"),
    "FL..": ("dont_care", "clear", "undefined", "copy_source", "dont_care", "clear", "dont_care"),
    "..O.": ("load", "clear", "color", "sampled", "load", "clear", "store"),
    "F.O.": ("dont_care", "clear", "undefined", "sampled", "dont_care", "clear", "store"),
    "...I": ("load", "load", "sampled", "color", "load", "load", "store"),
    "..OI": ("load", "load", "sampled", "sampled", "load", "load", "store"),
}
REFUSED = ("F..I", "F.OI", ".L.I", ".LO.", ".LOI", "FL.I", "FLO.", "FLOI")
NAMES = dict(zip("FLOI", (Flag.FIRST, Flag.LAST, Flag.OFFSCREEN, Flag.INTERNAL), strict=True))
CLEARS = list(itertools.product((False, True), repeat=2))


def flags_of(row, clear_color, clear_depth):
    made = Flag.CLEAR_COLOR if clear_color else Flag.NONE
    made |= Flag.CLEAR_DEPTH if clear_depth else Flag.NONE
    for letter in row.replace(".", ""):
        made |= NAMES[letter]
    return made


def tabulated(row, clear_color, clear_depth):
    loads = TABLE[row][0:2]
    depth_loads = TABLE[row][4:6]
    depth_load = depth_loads[clear_depth]
    return (
        Use(loads[clear_color], "store", *TABLE[row][2:4]),
        Use(depth_load, TABLE[row][6], "depth" if depth_load == "load" else "undefined", "depth"),
    )


@flagged
def test_every_combination_of_flags_is_in_the_table_or_refused():
    assert len({*TABLE, *REFUSED}) == 16
    for row, clears in itertools.product(TABLE, CLEARS):
        assert uses(flags_of(row, *clears)) == tabulated(row, *clears), row
    for row, clears in itertools.product(REFUSED, CLEARS):
        with pytest.raises(ValueError, match=r"nothing to go on from|not for both"):
            uses(flags_of(row, *clears))


@flagged
def test_each_pass_of_the_study_begins_as_the_one_before_it_has_left_the_target():
    """On a software driver nothing is lost that nobody asked to load, so pictures would not tell."""
    first, then = (uses(flags) for flags in FLAGS[:2])
    for ended, begun in zip(first, then, strict=True):
        assert (ended.initial, ended.load) == ("undefined", "clear")
        assert (begun.initial, begun.load, ended.store) == (ended.final, "load", "store")
    assert then[0].final == "sampled" and uses(FLAGS[2])[0].final == "copy_source"


LAYOUTS = {
    "undefined": "UNDEFINED",
    "color": "COLOR_ATTACHMENT_OPTIMAL",
    "depth": "DEPTH_STENCIL_ATTACHMENT_OPTIMAL",
    "sampled": "SHADER_READ_ONLY_OPTIMAL",
    "copy_source": "TRANSFER_SRC_OPTIMAL",
}


@flagged
@only_vulkan
@pytest.mark.parametrize("depth", ["d32f", None])
def test_the_objects_say_what_the_table_says(stage, depth):
    """Of each combination one is made, which the validation layers find nothing wrong with."""
    log: list = []
    for row, clears in itertools.product(TABLE, CLEARS):
        stage.device.fn.trace(log)
        try:
            made = create_render_pass(stage.device, ("rgba8", depth), flags_of(row, *clears), row)
        finally:
            stage.device.fn.trace(None)
        stage.device.destroy("VkRenderPass", made)
        info = next(arguments[1] for name, arguments in log if name == "vkCreateRenderPass2")
        log.clear()
        expected = tabulated(row, *clears)
        assert info.attachmentCount == (2 if depth else 1)
        for number in range(info.attachmentCount):
            found, use = info.pAttachments[number], expected[number]
            assert found.loadOp == getattr(vk, f"VK_ATTACHMENT_LOAD_OP_{use.load.upper()}")
            assert found.storeOp == getattr(vk, f"VK_ATTACHMENT_STORE_OP_{use.store.upper()}")
            assert found.initialLayout == getattr(vk, f"VK_IMAGE_LAYOUT_{LAYOUTS[use.initial]}")
            assert found.finalLayout == getattr(vk, f"VK_IMAGE_LAYOUT_{LAYOUTS[use.final]}")


def picture(order=range(SQUARES)):
    """Return (SIDE, SIDE, 3) codes: of each pixel's squares the one of the greatest depth, darker towards corners."""
    found, nearest = np.full((SIDE, SIDE, 3), (0.05, 0.05, 0.06)), np.zeros((SIDE, SIDE))
    for number in order:
        x, y, depth = number * 5 % 24 + 4, number * 7 % 24 + 4, (number * 11 % 24 + 1) / 25
        part = (slice(y, y + 18), slice(x, x + 18))
        seen = nearest[part] <= depth
        nearest[part][seen] = depth
        found[part][seen] = np.array([number * 5 % 8, number * 3 % 8, number % 8]) / 7
    away = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    return 255 * found * (1 - 0.3 * (away[:, None] ** 2 + away[None] ** 2))[..., None]


@only_vulkan
@flagged
@pytest.mark.parametrize("way", WAYS)
def test_the_picture_is_that_of_all_squares_by_depth_in_every_frame(stage, way):
    with stage.open(WHICH, (SIDE, SIDE), settings=Settings(way)) as renderer:
        for _ in range(3):
            found = renderer.render(chapters.view_of(renderer)).image("color")
            assert np.abs(found - picture()).max() <= 1.1  # stored twice in eight bits


@only_vulkan
@pytest.mark.feature("device/render-pass-flags", "gbuffer/dynamic-rendering")
@pytest.mark.parametrize("size", [(SIDE, SIDE), (61, 37), (1, 1)])
def test_both_ways_draw_the_same_bits_also_after_a_resize(stage, size):
    pictures = []
    for way in WAYS:
        with stage.open(WHICH, (20, 30), settings=Settings(way)) as renderer:
            view = chapters.view_of(renderer)
            renderer.render(view)
            renderer.resize(size)
            pictures += [renderer.render(view).image("color") for _ in range(3)]
    assert all((one == pictures[0]).all() for one in pictures)


@only_vulkan
@pytest.mark.feature("device/render-pass-flags", "gbuffer/dynamic-rendering")
@pytest.mark.parametrize("way", WAYS)
def test_a_second_pass_that_clears_loses_what_the_first_has_drawn(stage, monkeypatch, way):
    """So loading is what keeps it, and the squares of both passes are told apart by depth only if that is loaded."""
    module = chapters.renderer_module(WHICH, "vulkan")
    cleared = Flag.FIRST | Flag.OFFSCREEN | Flag.CLEAR_COLOR | Flag.CLEAR_DEPTH
    monkeypatch.setattr(module, "FLAGS", (FLAGS[0], cleared, FLAGS[2]))
    if way == "dynamic":  # where layouts are said by barriers, flags decide on load and store alone
        cleared = Flag.OFFSCREEN | Flag.CLEAR_COLOR | Flag.CLEAR_DEPTH
        monkeypatch.setattr(module, "FLAGS", (FLAGS[0], cleared, FLAGS[2]))
    found = stage.draw(WHICH, (SIDE, SIDE), settings=Settings(way))["color"]
    assert np.abs(found - picture(range(SQUARES // 2, SQUARES))).max() <= 1.1
    assert np.abs(found - picture()).max() > 50


@only_vulkan
@flagged
def test_objects_need_no_barriers_and_barriers_no_objects(stage):
    found = {}
    for way in WAYS:
        with stage.open(WHICH, (SIDE, SIDE), settings=Settings(way)) as renderer:
            alive = [kind for kind, _ in stage.device.alive]
            objects = [alive.count("VkRenderPass"), alive.count("VkFramebuffer")]
            calls = [
                one.name for one in calls_of_a_frame(stage.device, renderer) if one.label == "render passes"
            ]
            work = renderer.render(chapters.view_of(renderer)).work
            assert sum(objects) == work["objects"] and work["begin_end_ns"] > 0
            begun = calls.count("vkCmdBeginRenderPass2"), calls.count("vkCmdBeginRendering")
            found[way] = (*objects, *begun, calls.count("vkCmdPipelineBarrier2"))
    assert found == {"classic": (3, 2, 3, 0, 0), "dynamic": (0, 0, 0, 3, 4)}


@only_vulkan
@flagged
def test_by_hand_no_barrier_is_forgotten(stage):
    with (
        views_made(stage.device) as images,
        stage.open(WHICH, (SIDE, SIDE), settings=Settings("dynamic")) as renderer,
    ):
        calls = calls_of_a_frame(stage.device, renderer)
    assert not_waited_for(calls, images) == []


def test_there_is_no_opengl_version_since_it_has_neither():
    from common.errors import UnsupportedError

    with pytest.raises(UnsupportedError, match="no OpenGL version"):
        chapters.renderer_module(WHICH, "gl")
