"""The contract of a renderer, held to by chapter 1: outputs, frames, sizes, history, and the work that is counted."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch01.logic.frame import OUTPUTS
from chapters.ch01.settings import Settings
from common.camera import View, exposure
from common.errors import StaleFrameError, UnsupportedError, UserError
from common.scene import Light, Material
from tests.support.scenes import facing, quad_scene, translated

SIZE = (32, 32)
SUN = Light("directional", node=0, intensity=np.pi)


def lit_quad(**more):
    return quad_scene(Material(metallic=0.0, roughness=1.0), lights=(SUN,), **more)


@pytest.fixture(scope="module")
def renderer(chapter):
    with chapter.open(lit_quad(), SIZE, outputs=OUTPUTS) as made:
        yield made


def test_outputs_have_their_shapes_and_types(renderer):
    frame = renderer.render(facing())
    shapes = {name: (frame.image(name).shape, frame.image(name).dtype) for name in OUTPUTS}
    assert shapes == {
        "color": ((32, 32, 3), np.uint8),
        "color_linear": ((32, 32, 3), np.float32),
        "depth": ((32, 32), np.float32),
        "instance_id": ((32, 32), np.uint32),
    }


def test_depth_is_that_of_the_projection(renderer):
    """Orthographic, reversed: (far - distance) / (far - near), for a square 2 m ahead, near 0.1, far 4."""
    depth = renderer.render(facing()).image("depth")
    assert np.allclose(depth, (4.0 - 2.0) / (4.0 - 0.1), atol=1e-6)


def test_instance_ids_are_places_in_the_scene_plus_one(chapter):
    scene = quad_scene(matrices=(translated(-1.0), translated(1.0)))
    scene.instances.visible[0] = True
    with chapter.open(scene, SIZE, outputs={"instance_id"}) as made:
        ids = made.render(facing(ymag=2.0)).image("instance_id")
    assert set(np.unique(ids)) == {0, 1, 2}
    assert (ids[8:24, :16] == 1).all()
    assert (ids[8:24, 16:] == 2).all()


@pytest.mark.feature("device/frames-in-flight")
def test_an_image_is_readable_for_two_frames_and_then_refused(renderer):
    first = renderer.render(facing())
    renderer.render(facing())
    assert first.image("color").shape == (32, 32, 3)
    renderer.render(facing())
    with pytest.raises(StaleFrameError, match="before 2 more"):
        first.image("color")


def test_an_output_that_was_not_asked_for_is_refused_by_name(chapter):
    with chapter.open(lit_quad(), SIZE) as made:
        frame = made.render(facing())
        with pytest.raises(StaleFrameError, match=r"outputs=\{'color', 'depth'\}"):
            frame.image("depth")
    with pytest.raises(UserError, match="no output 'colour'"):
        chapter.open(lit_quad(), SIZE, outputs={"colour"})


def test_timings_name_the_passes_in_order(renderer):
    frame = renderer.render(facing())
    assert list(frame.timings) == ["forward", "instance_id", "tonemap"]
    assert all(milliseconds >= 0.0 for milliseconds in frame.timings.values())


def test_the_same_calls_after_a_reset_give_the_same_pixels(renderer):
    views = [facing(), facing(distance=1.5), facing(distance=3.0)]
    renderer.reset_history("test")
    before = [renderer.render(view, time).image("color_linear") for time, view in enumerate(views)]
    renderer.reset_history("test")
    after = [renderer.render(view, time).image("color_linear") for time, view in enumerate(views)]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert renderer.render(facing()).index == 3


@pytest.mark.feature("device/viewport-resize")
def test_resize_gives_the_picture_that_a_new_renderer_gives(chapter):
    with chapter.open(lit_quad(), SIZE, outputs={"color", "depth"}) as made:
        made.render(facing())
        made.resize((48, 20))
        resized = made.render(facing())
        assert resized.index == 0
        picture, depth = resized.image("color"), resized.image("depth")
    with chapter.open(lit_quad(), (48, 20), outputs={"color", "depth"}) as made:
        frame = made.render(facing())
        assert np.array_equal(frame.image("color"), picture)
        assert np.array_equal(frame.image("depth"), depth)


def test_impossible_sizes_are_refused(chapter):
    for size in ((0, 5), (5, 0), (-1, 5), (100_000, 5)):
        with pytest.raises(UserError, match="cannot be made"):
            chapter.open(lit_quad(), size)


def test_idle_means_that_nothing_would_change(chapter):
    scene = lit_quad()
    with chapter.open(scene, SIZE) as made:
        assert not made.idle(facing())
        made.render(facing())
        assert made.idle(facing())
        assert made.idle(facing(), time=5.0), "nothing in the scene moves by itself"
        assert not made.idle(facing(distance=1.0))
        with scene.edit() as edit:
            edit.set_transform(0, matrix=translated(0.1))
        assert not made.idle(facing())


def test_an_edit_is_seen_in_the_next_frame_and_costs_what_it_touched(chapter):
    scene = quad_scene(Material(unlit=True), matrices=(np.eye(4), translated(10.0)))
    with chapter.open(scene, SIZE) as made:
        made.render(facing())
        quiet = made.render(facing())
        quiet = made.render(facing())
        constants = quiet.work["bytes_written"]
        with scene.edit() as edit:
            edit.set_material(0, Material(unlit=True, base_color=(1.0, 0.0, 0.0, 1.0)))
        red = made.render(facing())
        assert (red.image("color") == (255, 0, 0)).all() or red.image("color")[..., 1].max() < 60
        assert red.work["bytes_written"] > constants
        made.render(facing())
        assert made.render(facing()).work["bytes_written"] == constants
        with scene.edit() as edit:
            edit.set_visible(0, False)
        hidden = made.render(facing())
        assert hidden.work["draws"] == 2  # the other square and the tone-mapping triangle
        assert len(np.unique(hidden.image("color"))) == 1


def test_two_renderers_share_a_scene(chapter):
    scene = lit_quad()
    with chapter.open(scene, SIZE) as a, chapter.open(scene, SIZE) as b:
        with scene.edit() as edit:
            edit.set_transform(0, matrix=translated(0.5))
        assert np.array_equal(a.render(facing()).image("color"), b.render(facing()).image("color"))


def test_exposure_scales_the_picture_and_not_the_light(chapter):
    """`color_linear` is luminance: one stop of exposure changes `color_hdr` by two, and what is read not at all."""
    settings = Settings(color_format="rgba32f", background=0.0)
    with chapter.open(lit_quad(), SIZE, settings, outputs={"color_linear", "color"}) as made:
        bright = made.render(facing(ev100=0.0))
        dark = made.render(facing(ev100=3.0))
        assert np.allclose(bright.image("color_linear"), dark.image("color_linear"), rtol=1e-6)
        assert bright.image("color").mean() > dark.image("color").mean()
    assert exposure(3.0) == exposure(0.0) / 8.0


def test_without_a_feature_the_plan_says_so(chapter):
    with chapter.open(lit_quad(), SIZE, without={"anisotropy"}) as made:
        (choice,) = made.plan.choices
        assert (choice.feature, choice.native, choice.path) == ("anisotropy", False, "trilinear filtering")
    with pytest.raises(UserError, match=r"no feature 'anisotropi'.*did you mean 'anisotropy'"):
        chapter.open(lit_quad(), SIZE, without={"anisotropi"})


def test_a_required_feature_that_is_missing_is_named(chapter):
    from backends.contract import resolve

    with pytest.raises(UnsupportedError, match="mesh-shader"):
        resolve({"mesh-shader"}, set(), chapter.device.capabilities, {"mesh-shader"})


def test_an_empty_scene_is_its_background(chapter):
    scene = quad_scene()
    scene.instances.visible[:] = False
    with chapter.open(scene, SIZE, outputs={"color_linear", "instance_id"}) as made:
        frame = made.render(View(facing().world_from_view))
        expected = Settings().background / exposure(View(facing().world_from_view).ev100)
        assert np.allclose(frame.image("color_linear"), expected, rtol=1e-3)
        assert (frame.image("instance_id") == 0).all()


def test_closing_twice_is_closing_once(chapter):
    made = chapter.open(lit_quad(), SIZE)
    alive = len(chapter.device.alive)
    made.close()
    made.close()
    assert len(chapter.device.alive) < alive
