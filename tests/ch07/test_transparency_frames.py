"""Frames with layers: what is off creates nothing, a pool that is too small, and what changes between frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backends.vulkan.driver.features import CORE
from chapters.ch07.settings import Settings
from common.errors import SettingError, UnsupportedError
from common.numerics.transforms import translation
from common.scene import Material
from common.settings import replaced
from tests.support.chapter import building
from tests.support.panes import BEHIND, panes, stack, tilted, view
from tests.support.scenes import facing, quad_scene

SIZE = (24, 16)
SETTINGS = Settings(color_format="rgba32f", background=BEHIND, graph="deferred")
MODES = ("sorted", "lists", "weighted")
OUTPUTS = {"color_linear", "depth"}
LAYER_PASSES = ("clear", "count", "sums", "fill", "resolve")

pytestmark = pytest.mark.feature("oit/per-pixel-lists")


@pytest.fixture
def open_(chapter):
    """Return a function that opens a renderer, closed at the end."""
    opened = []

    def open_one(scene, mode="lists", size=SIZE, **turned):
        settings = replaced(SETTINGS, transparency=mode, **turned)
        opened.append(chapter.open(scene, size, settings, outputs=OUTPUTS))
        return opened[-1]

    yield open_one
    for renderer in opened:
        renderer.close()


@pytest.fixture(scope="module")
def crossing():
    return panes(*tilted(4, 9))


def color(frame):
    return frame.image("color_linear").copy()


def layer_passes(renderer):
    return [name for name in (it.name for it in renderer.passes) if name.startswith("transparent")]


# --- off -------------------------------------------------------------------------------------------------------------


def test_a_scene_without_blended_material_creates_nothing_and_is_the_same_picture(open_):
    scene = quad_scene(Material(base_color=(0.5, 0.25, 0.5, 1.0), unlit=True))
    pictures, works = [], []
    for mode in MODES:
        renderer = open_(scene, mode)
        frames = [renderer.render(view()) for _ in range(3)]
        pictures.append(color(frames[-1]))
        works.append(frames[-1].work)
        memory = renderer.techniques["transparency"].memory
        assert layer_passes(renderer) == [] and (memory is None or not memory.is_made)
        assert not [name for name in renderer.graph.resources if name.startswith("layer")]
    assert np.array_equal(pictures[0], pictures[1]) and np.array_equal(pictures[0], pictures[2])
    assert works[0] == works[1] == works[2]


def test_sorted_creates_nothing_of_layers(open_, crossing):
    renderer = open_(crossing, "sorted")
    work = renderer.render(view()).work
    assert layer_passes(renderer) == ["transparent"] and renderer.techniques["transparency"].memory is None
    assert not [name for name in renderer.graph.resources if name.startswith("layer")]
    assert work["dispatches"] == 0 and not [name for name in work if name.startswith("transparent")]


def test_weighted_has_no_lists(open_, crossing):
    renderer = open_(crossing, "weighted")
    work = renderer.render(view()).work
    assert layer_passes(renderer) == ["transparent_fill", "transparent_resolve"]
    assert not [name for name in renderer.graph.resources if name in ("layer_words", "layer_nodes")]
    assert work["dispatches"] == 1 and not [name for name in work if name.startswith("transparent")]


def test_blended_objects_out_of_view_leave_the_picture_as_it_is_and_are_no_layers(open_):
    scene = panes(stack(np.zeros(2)), np.full((2, 4), 0.5))
    renderer = open_(scene)
    aside = replace(facing(), world_from_view=translation((50.0, 0.0, 4.0)))
    frame = renderer.render(aside)
    assert frame.work["transparent_fragments"] == 0 and np.ptp(color(frame)) == 0.0


@pytest.mark.variants("vulkan", "gl")
def test_a_view_shows_surfaces_as_they_are_drawn(open_, crossing):
    shown = [color(open_(crossing, mode, view="overdraw").render(view())) for mode in MODES]
    assert np.array_equal(shown[0], shown[1]) and np.array_equal(shown[0], shown[2]) and np.ptp(shown[0]) > 1


# --- a pool that is too small ----------------------------------------------------------------------------------------


def test_a_pool_that_is_too_small_gives_the_weighted_frame_and_reports_the_demand(open_, crossing):
    plenty, few = open_(crossing, transparency_nodes=16), open_(crossing, transparency_nodes=0.5)
    weighted = open_(crossing, "weighted")
    works = [renderer.render(view()).work for renderer in (plenty, few)]
    demand, pixels = works[0]["transparent_fragments"], SIZE[0] * SIZE[1]
    assert demand > pixels // 2
    assert [work["transparent_fragments"] for work in works] == [demand, demand]
    assert [work["transparent_capacity"] for work in works] == [16 * pixels, pixels // 2]
    assert [work["transparent_overflow"] for work in works] == [0, 1]
    sorted_layers, fallback, wanted = (color(it.render(view())) for it in (plenty, few, weighted))
    if (
        few.capabilities.is_software
    ):  # what compilers make of one function in two shaders is each device's own
        assert np.array_equal(fallback, wanted)
    np.testing.assert_allclose(fallback, wanted, rtol=1e-5, atol=1e-6)
    assert np.abs(fallback - sorted_layers).max() > 0.01


@pytest.mark.parametrize(("nodes", "overflow"), [(3.0, 0), (3.0 - 1 / (24 * 16), 1)])
def test_the_pool_is_too_small_from_one_layer_more_than_it_holds(open_, nodes, overflow):
    scene = panes(stack(np.linspace(-1, 1, 3)), np.full((3, 4), 0.5))
    work = open_(scene, transparency_nodes=nodes).render(view()).work
    assert work["transparent_fragments"] == 3 * SIZE[0] * SIZE[1]
    assert work["transparent_overflow"] == overflow


def test_the_gpu_decides_and_the_recording_stays(chapter, open_, crossing):
    """The camera moves from where the pool holds all layers to where it does not, and back."""
    renderer = open_(crossing, transparency_nodes=0.3)
    near, far = view(), replace(view(), projection=replace(view().projection, ymag=8.0))
    for camera in (near, near, near, near):
        renderer.render(camera)
    overflows, pictures = [], []
    for camera in (far, near, far, near):
        with chapter.calls() as calls:
            frame = renderer.render(camera)
        assert frame.work["recorded"] == 0 and building(calls) == []
        overflows.append(frame.work["transparent_overflow"])
        pictures.append(color(frame))
    assert overflows == [0, 1, 0, 1]
    assert np.array_equal(pictures[0], pictures[2]) and np.array_equal(pictures[1], pictures[3])
    assert np.array_equal(pictures[0], color(open_(crossing).render(far)))


# --- what changes between frames -------------------------------------------------------------------------------------


def test_the_pool_follows_the_size_of_the_picture(open_, crossing):
    renderer = open_(crossing, transparency_nodes=12)
    for size in ((7, 5), (50, 41), SIZE):
        renderer.resize(size)
        for _ in range(2):
            frame = renderer.render(view())
        assert frame.work["transparent_capacity"] == 12 * size[0] * size[1]
        fresh = open_(crossing, size=size, transparency_nodes=12).render(view())
        assert np.array_equal(color(frame), color(fresh))


def test_a_material_that_becomes_blended_is_followed(open_):
    blended = Material(base_color=(1.0, 0.5, 0.0, 0.5), alpha_mode="blend", unlit=True)
    scene = quad_scene(replace(blended, alpha_mode="opaque"))
    renderer = open_(scene)
    solid = color(renderer.render(facing()))
    for _ in range(2):
        with scene.edit() as edit:
            edit.set_material(0, blended)
        frame = [renderer.render(facing()) for _ in range(3)][-1]
        wanted = open_(quad_scene(blended)).render(facing())
        assert np.array_equal(color(frame), color(wanted)) and frame.work["transparent_fragments"] > 0
        with scene.edit() as edit:
            edit.set_material(0, replace(blended, alpha_mode="opaque"))
        assert np.array_equal(color(renderer.render(facing())), solid)
        assert not renderer.techniques["transparency"].memory.is_made


@pytest.mark.long
@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_culling_threads_and_poison_change_no_bit(open_, crossing, graph):
    nodes = {"transparency_nodes": 12, "graph": graph}
    wanted = color(open_(crossing, **nodes).render(view()))
    for turned in (
        {"culling": "occlusion"},
        {"recording_threads": 2, "draws_per_secondary": 1},
        {"poison": "depth 1"},
        {"depth_prepass": True},
    ):
        renderer = open_(crossing, **nodes, **turned)
        for _ in range(3):
            assert np.array_equal(color(renderer.render(view())), wanted), turned


@pytest.mark.variants("vulkan", "gl")
def test_several_samples_a_pixel_are_refused_in_a_sentence(open_, crossing):
    with pytest.raises(
        SettingError, match=r"transparency=lists composites one sample a pixel, and msaa is 4: set"
    ):
        open_(crossing, msaa=4, graph="forward")


@pytest.mark.variants("vulkan")
@pytest.mark.parametrize(
    ("bit", "why"),
    [
        ("fragmentStoresAndAtomics", "lets fragments store nothing"),
        ("geometryShader", "gives fragments no number of their triangle"),
    ],
)
def test_a_device_that_lacks_what_lists_need_says_so_and_can_take_weights(
    chapter, open_, crossing, bit, why, monkeypatch
):
    physical = chapter.device.physical
    lacking = replace(physical, bits=physical.bits - {(CORE, bit)})
    monkeypatch.setattr(chapter.device, "physical", lacking)
    with pytest.raises(UnsupportedError, match=f"{why}: set transparency=weighted or sorted"):
        open_(crossing)
    assert np.ptp(color(open_(crossing, "weighted").render(view()))) > 0
