"""The contract of a renderer, held to by chapter 1: outputs, frames, sizes, history, and the work that is counted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.frames.frame import OUTPUTS
from chapters.ch01.settings import Settings
from common.errors import StaleFrameError, UnsupportedError, UserError
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material, Sampler
from common.view.camera import UNIT_EV100, Orthographic, View, exposure
from tests.support.chapter import building
from tests.support.scenes import facing, quad_scene, texture, translated

pytestmark = pytest.mark.newest

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
    expected = {
        "color": ((32, 32, 3), np.uint8),
        "color_linear": ((32, 32, 3), np.float32),
        "depth": ((32, 32), np.float32),
        "instance_id": ((32, 32), np.uint32),
        "motion": ((32, 32, 2), np.float32),  # from the lesson on that draws it
    }
    assert shapes == {name: expected[name] for name in OUTPUTS} and len(shapes) >= 4


@pytest.mark.feature("device/depth-format")
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


WRONG = {
    "scene": ({"scene": None}, "scene=None is no scene: chapters.scenes.load"),
    "scene's name": ({"scene": "atrium"}, "scene='atrium' is no scene"),
    "settings": ({"settings": {}}, "settings={} are not this chapter's"),
    "output": ({"outputs": "colour"}, "no output 'colour'; did you mean 'color'"),
    "outputs": ({"outputs": 5}, "outputs=5 holds no names"),
    "feature": ({"without": "anisotrophy"}, "did you mean 'anisotropy'"),
    "features": ({"without": [1]}, "without=[1] holds no names"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_argument_is_one_sentence(chapter, name):
    arguments, said = WRONG[name]
    with pytest.raises(UserError) as error:
        chapter.open(**{"scene": lit_quad(), "size": SIZE, **arguments})
    assert said in str(error.value) and "\n" not in str(error.value)


def test_one_name_needs_no_set(chapter):
    with chapter.open(lit_quad(), SIZE, outputs="depth", without="anisotropy") as made:
        assert made.outputs == ("depth",)
        assert not made.plan.native("anisotropy")


@pytest.mark.parametrize("time", [math.nan, math.inf, -1e308, 2e9, "1", None])
def test_a_time_that_is_none_is_refused_and_the_next_frame_is_drawn(renderer, time):
    with pytest.raises(UserError, match="is no time: give seconds between"):
        renderer.render(facing(), time)
    assert renderer.render(facing(), 1e9).image("color").any()


def test_a_view_that_is_none_is_refused(renderer):
    with pytest.raises(UserError, match="None is no view"):
        renderer.render(None)


def test_a_frame_says_why_it_starts_without_history(chapter):
    with chapter.open(lit_quad(), SIZE, outputs=()) as made:
        frames = [made.render(facing(), 1.0), made.render(facing(), 2.0)]
        frames += [made.render(replace(facing(), cut=True), 3.0), made.render(facing(), 2.5)]
        made.resize((20, 20))
        frames += [made.render(facing(), 2.5), made.render(facing(), 2.5)]
        made.reset_history("another lesson")
        frames += [made.render(facing(), 0.0), made.render(facing(), 0.0)]
    reasons = ["first frame", "", "camera cut", "time ran backwards", "resize", "", "another lesson", ""]
    assert [frame.reset for frame in frames] == reasons
    assert [frame.work["history_resets"] for frame in frames] == [int(reason != "") for reason in reasons]


def test_timings_name_the_passes_in_order(renderer):
    frame = renderer.render(facing())
    motion = ["motion", "motion_objects"] if "motion" in OUTPUTS else []
    assert list(frame.timings) == ["forward", "instance_id", *motion, "tonemap"]
    assert all(milliseconds >= 0.0 for milliseconds in frame.timings.values())


def test_the_same_calls_after_a_reset_give_the_same_pixels(renderer):
    views = [facing(), facing(distance=1.5), facing(distance=3.0)]
    renderer.reset_history("test")
    before = [renderer.render(view, time).image("color_linear") for time, view in enumerate(views)]
    renderer.reset_history("test")
    after = [renderer.render(view, time).image("color_linear") for time, view in enumerate(views)]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
    assert renderer.render(facing()).index == 3


@pytest.mark.core
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


@pytest.mark.feature("device/viewport-resize")
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


@pytest.mark.core
def test_an_edit_is_seen_in_the_next_frame_and_costs_what_it_touched(chapter):
    scene = quad_scene(Material(unlit=True), matrices=(np.eye(4), translated(10.0)))
    with chapter.open(scene, SIZE) as made:
        made.render(facing())
        quiet = made.render(facing())
        quiet = made.render(facing())
        constants = quiet.work["bytes_written"]
        with scene.edit() as edit:
            edit.set_material(0, Material(unlit=True, base_color=(1.0, 0.0, 0.0, 1.0)))
        with chapter.calls() as calls:
            red = made.render(facing())
        assert calls and not building(calls), "the pipelines and sets of its kind are there"
        assert (red.image("color") == (255, 0, 0)).all() or red.image("color")[..., 1].max() < 60
        assert red.work["bytes_written"] > constants
        made.render(facing())
        assert made.render(facing()).work["bytes_written"] == constants
        with scene.edit() as edit:
            edit.set_visible(0, False)
        hidden = made.render(facing())
        assert hidden.work["draws"] == 2  # the other square and the tone-mapping triangle
        assert hidden.work["triangles"] == 2 + 1
        assert hidden.work.get("draw_calls", 2) == 2
        assert len(np.unique(hidden.image("color"))) == 1


def test_a_light_that_changes_is_written_beside_the_number_of_lights(chapter):
    """A record of a light has 64 bytes, the number 16 with its padding (std430 aligns the array to 16)."""
    scene = lit_quad()
    with chapter.open(scene, SIZE) as made:
        for _ in range(4):
            quiet = made.render(facing()).work["bytes_written"]
        with scene.edit() as edit:
            edit.set_light(0, replace(SUN, intensity=1.0))
        assert made.render(facing()).work["bytes_written"] - quiet == 16 + 64


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
    """Of each feature that the chapter uses where it is there; and of the others what was said before."""
    with chapter.open(lit_quad(), SIZE) as made:
        usual = {choice.feature: choice for choice in made.plan.choices}
    assert "anisotropy" in usual
    for feature in usual:
        with chapter.open(lit_quad(), SIZE, without={feature}) as made:
            (choice,) = (one for one in made.plan.choices if one.feature == feature)
            assert not choice.native and choice.path and choice.path != feature
            assert choice.path == "trilinear filtering" or feature != "anisotropy"
            others = {one.feature: one for one in made.plan.choices if one.feature != feature}
            assert others == {name: one for name, one in usual.items() if name != feature}
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
        expected = Settings().shading.background / exposure(View(facing().world_from_view).ev100)
        assert np.allclose(frame.image("color_linear"), expected, rtol=1e-3)
        assert (frame.image("instance_id") == 0).all()


@pytest.mark.parametrize("color_format", ["rgba16f", "rgba32f"])
def test_the_colour_target_has_the_format_of_the_setting(chapter, color_format):
    """An unlit 1/3 is kept to the last place of the format, and no further."""
    scene = quad_scene(Material(unlit=True, base_color=(1 / 3, 1e-3, 0.7, 1.0)))
    settings = Settings(color_format=color_format)
    view = View(facing().world_from_view, facing().projection, ev100=UNIT_EV100)
    with chapter.open(scene, (4, 4), settings, outputs={"color_linear"}) as made:
        picture = made.render(view).image("color_linear")
    exact = np.array((1 / 3, 1e-3, 0.7))
    step = {"rgba16f": 2.0**-10, "rgba32f": 2.0**-23}[color_format]  # a driver may cut off what does not fit
    error = np.abs(picture / exact - 1).max()
    assert error <= 1.01 * step
    assert error > 2.0**-13 or color_format == "rgba32f", "half precision is half precision"


def test_anisotropy_keeps_what_lies_along_the_view_apart(chapter):
    """Stripes that run away from the eye on a plane seen at a slant: grey, unless they are filtered along.

    A pixel covers half a texel across them and five along them: the third level, or the first, ten times.
    """
    texels = np.zeros((64, 64, 4), np.uint8)
    texels[:, ::2] = 255
    texels[..., 3] = 255
    material = Material(unlit=True, double_sided=True, base_color_texture=texture(0, Sampler()))
    scene = quad_scene(material, images=(Image("stripes", texels),))
    slant = View(pose_looking_at((0.0, -1.0, 0.1), (0, 0, 0)), Orthographic(0.5, 0.01, 4.0))
    contrast = {}
    for anisotropy, without in ((1.0, ()), (16.0, ()), (16.0, ("anisotropy",))):
        settings = Settings(anisotropy=anisotropy)
        with chapter.open(scene, (64, 64), settings, outputs={"color_linear"}, without=without) as made:
            contrast[anisotropy, without] = made.render(slant).image("color_linear")[30:34].std()
            native = made.plan.native("anisotropy")
            assert native == (chapter.device.has("anisotropy") and not without)
    plain, filtered, refused = contrast.values()
    assert refused == plain, "without the feature, a sampler is that of a device which lacks it"
    if chapter.device.has("anisotropy"):
        assert filtered > 3 * plain
    else:
        assert filtered == plain


def test_closing_twice_is_closing_once(chapter):
    made = chapter.open(lit_quad(), SIZE)
    alive = len(chapter.device.alive)
    made.close()
    made.close()
    assert len(chapter.device.alive) < alive
