"""The study screen-space-reflections: places of mirrored points, the march and the box in float64, skips, odd views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters.ch07.settings import Settings as ChapterSettings
from chapters.ch07.studies.screen_space_reflections import Settings
from chapters.ch07.studies.screen_space_reflections.hall import hall
from chapters.ch07.studies.screen_space_reflections.model import box_size, mask
from common.environment import constant
from common.errors import SettingError, UserError
from common.numerics.transforms import pose_looking_at, rotation
from common.scene import Image, Material, TextureRef
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.mirrors import (
    DIM,
    FLAT,
    FLOOR,
    LEVEL,
    MIRROR,
    ODD,
    PITCHED,
    emitting,
    mirror_and_wall,
    mirror_of,
    on_wall,
)
from tests.support.scenes import facing, quad_scene, scaled, translated
from tests.twins import screen_reflections as twin

march = pytest.mark.feature("ssr/ray-march")
blur = pytest.mark.feature("ssr/roughness-blur")
WHICH = "7/screen-space-reflections"
SIZE = (80, 54)
HITS, LIT, REFLECTED = "reflection_trace/reflection_hits", "lighting/color_lit", "reflections/color_reflected"
EXACT = {
    "gbuffer_format": "full",
    "color_format": "rgba32f",
    "culling": "off",
    "ambient": 0.0,
    "default_light": False,
    "environment_size": 16,
    "irradiance_source": 4,
    "table_samples": 256,
}
"""Nothing is rounded to fewer than 32 bits, and nothing is lit but by the scene."""


def settings_of(**more):
    """Return settings by the names of the study's knobs, or of the chapter's."""
    known = ("strength", "steps", "refinements", "thickness", "roughest", "blur", "edge")
    return Settings(**EXACT | {f"reflection_{k}" if k in known else k: v for k, v in more.items()})


def images_of(stage, scene, views, settings, names=(HITS,), size=SIZE):
    """Yield images by name, float64, of a frame of each view, by one renderer."""
    with stage.open(WHICH, size, scene=scene, settings=settings, inspect=True) as renderer:
        for view in views:
            frame = renderer.render(view)
            yield {name: frame.image(name).astype(np.float64) for name in names}


def images(stage, scene, view, settings, names=(HITS,)):
    """Return images of one frame by name, float64."""
    return next(iter([*images_of(stage, scene, [view], settings, names)]))


def chapter_color(stage, scene, view, settings, size=SIZE):
    """Return the chapter's own picture, linear, with the same knobs."""
    more = {"scene": scene, "size": size, "device": stage.device, "outputs": ("color_linear",)}
    with chapters.open(7, stage.backend, settings=ChapterSettings(**settings), **more) as renderer:
        return renderer.render(view).image("color_linear")


def study_color(stage, scene, view, size=SIZE, **more):
    """Return the study's picture, linear, the names of its passes, and its work."""
    outputs = ("color_linear",)
    with stage.open(WHICH, size, scene=scene, settings=settings_of(**more), outputs=outputs) as renderer:
        frame = renderer.render(view)
        return frame.image("color_linear"), [each.name for each in renderer.passes], frame.work


@march
@pytest.mark.parametrize(("turn", "steps", "refinements"), [(0.0, 12, 0), (0.5, 40, 4), (-0.4, 200, 8)])
def test_a_mirrored_point_is_found_within_a_part_of_a_step(stage, turn, steps, refinements):
    """The ledger's bound: a step on the screen / 2^refinements, along the ray, and not before the analytic place.

    Rounding adds 0.02 pixels: of a depth, 2^-24 of it, over the angle between ray and wall.
    """
    scene, place = mirror_and_wall(turn)
    settings = settings_of(steps=steps, refinements=refinements, edge=0.0)
    views = (LEVEL, PITCHED, FLAT)
    for view, found in zip(
        views, images_of(stage, scene, views, settings, (HITS, "gbuffer/depth")), strict=True
    ):
        _hold_to_the_mirror(found, view, place, steps, refinements)


def _hold_to_the_mirror(found, view, place, steps, refinements):
    pixels, rays, expected, wall = mirror_of(view, SIZE, place)
    hits = found[HITS][pixels[:, 1], pixels[:, 0]]
    shown = found["gbuffer/depth"][pixels[:, 1], pixels[:, 0]]
    floor = np.abs(shown / rays.first[:, 2] - 1.0) < 1e-3  # the wall is not before it
    step = rays.length / steps
    along = (rays.last - rays.first)[:, :2] / np.maximum(rays.length, 1e-9)[:, None]
    # What a step that has passed the wall's outline shows is behind the wall: such rays may go on. So the place, and
    # the one a step later, have to be on the wall, a pixel or two within its outline.
    points = expected + along * step[:, None]
    column = np.linalg.norm(place[:3, 0]), np.linalg.norm(place[:3, 1])
    texel = 2.0 * 8.0 / SIZE[1]  # more than the size of two pixels at the wall, metres
    inner = [np.abs(wall[:, i]) < 1.0 - texel / column[i] for i in (0, 1)]
    later = np.zeros(len(points), bool)
    usable = np.isfinite(points).all(axis=1) & (rays.length > 1.0)
    inside = (
        np.isfinite(points).all(axis=1) & (points > 1).all(axis=1) & (points < np.array(SIZE) - 1).all(axis=1)
    )
    surface = found["gbuffer/depth"]
    for i in np.flatnonzero(usable & inside):
        u, v = points[i].astype(int)
        around = surface[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
        later[i] = on_wall(around, u, v, view, SIZE, place).all()
    tested = floor & inner[0] & inner[1] & usable & inside & later
    assert tested.sum() > 60
    assert (hits[tested, 3] == 1).all() and (hits[tested, 2] == 1).all(), "every ray ends"
    off = np.sum((hits[tested, :2] - expected[tested]) * along[tested], axis=1)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    beside = np.abs(np.sum((hits[tested, :2] - expected[tested]) * across[tested], axis=1))
    assert beside.max() < 0.02
    assert off.min() > -0.02 and (off - step[tested] / 2**refinements).max() < 0.02
    assert off.max() > 0.4 * step[tested].max() / 2**refinements - 0.02, "the bound is not far off"


@march
@pytest.mark.parametrize("thickness", [0.01, 0.3])
def test_the_march_is_that_of_float64(stage, thickness):
    """On the hall, with its outlines, curved columns and rays behind columns: all but a few rays at equal depths."""
    scene = replace(hall(), environment=None)
    settings = settings_of(steps=48, refinements=5, thickness=thickness, edge=0.0)
    names = (HITS, "gbuffer/depth", "gbuffer/gbuffer_normal", "gbuffer/gbuffer_material")
    with stage.open(WHICH, SIZE, scene=scene) as renderer:
        front = chapters.view_of(renderer)
    # Rolled, or all of its rays would go along columns of pixels. Some end at its far plane.
    flat = View(
        pose_looking_at((0.6, 2.5, 5.0), (0.0, 0.5, -1.0), (0.2, 1.0, 0.0)), Orthographic(2.4, 0.1, 9.0)
    )
    for view, found in zip(
        (front, flat), images_of(stage, scene, (front, flat), settings, names), strict=True
    ):
        _hold_to_the_twin([found[name] for name in names], view, thickness)


def _hold_to_the_twin(found, view, thickness):
    hits, depth, normals, material = found
    smooth = hits[..., 3] > 0
    assert (smooth == ((depth > 0) & (material[..., 1] < 0.6))).all()
    rows, columns = np.nonzero(smooth)
    places = np.column_stack([columns, rows]) + 0.5
    rays = twin.mirrored(places, depth[smooth], normals[smooth][:, :3], view, SIZE)
    knobs = {"steps": 48, "refinements": 5, "thickness": thickness}
    expected = twin.march(rays, depth, normals[..., :3], material[..., 3] > 0.5, view, **knobs)
    met, ends = hits[smooth, 2] > 0, np.isfinite(expected[:, 0])
    same = (met == ends) & (~ends | (np.abs(hits[smooth, :2] - expected) < 0.01).all(axis=1))
    assert met.sum() > 300 and (~met).sum() > 300
    assert (~same).mean() < 0.005


@march
def test_a_miss_is_the_environment_and_a_hit_takes_its_place(stage):
    """Without a wall the picture has the chapter's bits: the mirror shows the environment, here 0.5 from everywhere.

    An unlit wall of the same light changes nothing either, for any material: what a hit adds is what it removes.
    Unlit colours are not exposed; here the exposure is a half. The
    bound is the table's: 64 x 64 halves, in which a mirror's A + B is 1 within 2^-10.
    """
    uniform = constant(0.5)
    floor_alone = replace(quad_scene(MIRROR, matrices=(FLOOR,)), environment=uniform)
    shown, passes, _ = study_color(stage, floor_alone, DIM)
    assert "reflections" in passes
    assert (shown == chapter_color(stage, floor_alone, DIM, EXACT)).all()
    assert np.abs(shown[..., :3] - 0.5).max() < 0.5 * 2**-9
    same_light = Material("wall", (0.25, 0.25, 0.25, 1.0), unlit=True)
    for roughness, metallic, color in (
        (0.0, 1.0, (0.9, 0.5, 0.2)),
        (0.2, 0.0, (0.3, 0.5, 0.7)),
        (0.4, 0.5, (1, 1, 1)),
    ):
        floor = Material("floor", (*color, 1.0), metallic, roughness, occlusion_strength=1.0)
        scene, _ = mirror_and_wall(0.2, floor, same_light, uniform)
        before = chapter_color(stage, scene, DIM, EXACT)
        after, _, _ = study_color(stage, scene, DIM)
        assert np.abs(after - before).max() < 1e-5
        dark = replace(scene, materials=[floor, replace(same_light, base_color=(0.0, 0.0, 0.0, 1.0))])
        found = images(stage, dark, DIM, settings_of(), (HITS, LIT, REFLECTED))
        darker = (found[REFLECTED] < found[LIT] - 0.01).any(axis=-1)
        assert darker.sum() > 200 and (found[HITS][darker, 3] == 1).all(), "the floor shows a black wall"
        unlit = (found[LIT][..., :3] == 0.0).all(axis=-1)
        assert unlit.sum() > 100 and not found[HITS][unlit].any(), "what is unlit reflects nothing"


@march
def test_occlusion_dims_what_comes_from_afar_and_not_what_is_met(stage):
    """A mirror whose material hides half of the environment shows half of it, and all of the wall's light."""
    texel = np.full((1, 1, 4), 127.5 / 255.0, np.float32)
    floor = replace(MIRROR, occlusion_texture=TextureRef(0))
    wall = Material("wall", (0.5, 0.5, 0.5, 1.0), unlit=True)
    scene, _ = mirror_and_wall(0.0, floor, wall, constant(0.5))
    scene = replace(scene, images=[Image("half", texel)])
    for ssao in ("off", "normals"):
        found = images(stage, scene, PITCHED, settings_of(edge=0.0, ssao=ssao), (HITS, LIT, REFLECTED))
        met, missed = found[HITS][..., 2] == 1, (found[HITS][..., 2] == 0) & (found[HITS][..., 3] == 1)
        assert met.sum() > 200 and missed.sum() > 200
        assert np.abs(found[REFLECTED][met][:, :3] - 0.5).max() < 0.5 * 2**-9
        if ssao == "off":
            assert np.abs(found[REFLECTED][missed][:, :3] - 0.25).max() < 0.5 * 2**-8
        else:
            assert found[LIT][met][:, :3].min() < 0.24, "the wall hides some of what comes from afar"


@march
def test_a_metal_without_environment_reflects_by_schlick(stage):
    """The mirror adds f0 + (1 - f0) (1 - n.v)^5 times the wall's light, and no ambient light is left where it does."""
    color = np.array((0.9, 0.5, 0.2))
    light = np.array((0.5, 0.25, 0.75))
    scene, _ = mirror_and_wall(0.0, Material("gold", (*color, 1.0), roughness=0.0))
    settings = replaced(settings_of(edge=0.0), ambient=0.7)
    found = images(stage, scene, DIM, settings, (HITS, REFLECTED, "gbuffer/depth"))
    rows, columns = np.nonzero(found[HITS][..., 2] > 0)
    depth = found["gbuffer/depth"][rows, columns]
    points = twin.world_at(np.column_stack([columns, rows]) + 0.5, depth, DIM, SIZE)
    seen = np.asarray(DIM.world_from_view)[:3, 3] - points
    cosine = (seen[:, 1] / np.linalg.norm(seen, axis=1))[:, None]
    # Exposure is a half. The wall has a base colour of 0: of ambient light it gives 0.04 as much.
    expected = (color + (1 - color) * (1 - cosine) ** 5) * (light + 0.04 * 0.7) / 2
    assert len(rows) > 200
    assert np.abs(found[REFLECTED][rows, columns, :3] - expected).max() < 2e-6


@march
def test_strength_0_and_rough_surfaces_cost_no_pass_and_change_no_bit(stage):
    """Nothing to reflect: no pass, and the chapter's bits. Rough pixels keep them where another surface reflects."""
    rough = Material("rough", (0.7, 0.7, 0.7, 1.0), roughness=0.6)
    scene, _ = mirror_and_wall(floor=rough, environment=constant(0.3))
    plain = chapter_color(stage, scene, PITCHED, EXACT)
    shown, passes, _ = study_color(stage, scene, PITCHED)
    assert (shown == plain).all() and "reflection_trace" not in passes and "reflections" not in passes
    mirror, _ = mirror_and_wall(environment=constant(0.3))
    unchanged, passes, skipped = study_color(stage, mirror, PITCHED, strength=0.0)
    assert (unchanged == chapter_color(stage, mirror, PITCHED, EXACT)).all() and "reflections" not in passes
    _, passes, done = study_color(stage, mirror, PITCHED)
    assert done["passes"] == skipped["passes"] + 2 and done["pipelines"] == skipped["pipelines"] + 2
    assert done["transient_bytes"] - skipped["transient_bytes"] <= 2 * 16 * SIZE[0] * SIZE[1] * 1.5
    # Both floors at once, side by side: the passes run, and the rough half keeps the chapter's bits.
    half = [FLOOR @ translated(x, 0, 0) @ np.diag((0.5, 1, 1, 1)) for x in (-0.5, 0.5)]
    wall = translated(0.2, 0.8, -1.0) @ np.diag((1.5, 0.8, 1.0, 1.0))
    both = quad_scene(
        materials=(rough, MIRROR, emitting()), matrices=(*half, wall), instance_materials=(0, 1, 2)
    )
    both = replace(both, environment=constant(0.3))
    found = images(stage, both, PITCHED, settings_of(), (HITS, LIT, REFLECTED))
    masked = found[HITS][..., 3] == 0
    assert 200 < masked.sum() < masked.size - 200
    assert (found[LIT] == found[REFLECTED])[masked].all()
    assert (found[LIT] != found[REFLECTED])[found[HITS][..., 2] > 0].any()


@march
def test_reflections_are_drawn_before_what_is_transparent(stage):
    glass = Material("glass", (0.2, 0.2, 1.0, 0.5), 0.0, 0.9, alpha_mode="blend")
    wall = translated(0.2, 0.8, -1.0) @ np.diag((1.5, 0.8, 1.0, 1.0))
    pane = translated(0.0, 0.5, 2.0)
    scene = quad_scene(
        materials=(MIRROR, emitting(), glass), matrices=(FLOOR, wall, pane), instance_materials=(0, 1, 2)
    )
    for mode, last in (("sorted", "transparent"), ("lists", "transparent_resolve")):
        shown, passes, _ = study_color(stage, scene, PITCHED, transparency=mode)
        drawn = [passes.index(name) for name in ("lighting", "reflections", last)]
        assert drawn == sorted(drawn)
        without, _, _ = study_color(stage, scene, PITCHED, transparency=mode, strength=0.0)
        assert (shown != without).any()


@blur
def test_boxes_grow_with_roughness_as_tabulated(stage):
    table = {
        0.0: 1,
        0.04: 1,
        0.05: 3,
        0.06: 3,
        0.12: 3,
        0.15: 5,
        0.25: 7,
        0.3: 7,
        0.35: 9,
        0.45: 11,
        0.59: 13,
    }
    assert {roughness: box_size(roughness, 10.0) for roughness in table} == table
    assert [round(mask(r, Settings()), 3) for r in (0.0, 0.45, 0.525, 0.6, 1.0)] == [1, 1, 0.5, 0, 0]
    for roughness in (0.0, 0.06, 0.25):
        scene, _ = mirror_and_wall(0.3, replace(MIRROR, roughness=roughness))
        found = images(stage, scene, PITCHED, settings_of(blur=10.0), (HITS, LIT, REFLECTED))
        lit, change = found[LIT], found[REFLECTED][..., :3] - found[LIT][..., :3]
        for wider in (0, 2) if roughness else (0,):
            sizes = np.full(lit.shape[:2], table[roughness] + wider)
            mean = twin.boxed(found[HITS], lit, sizes)
            # A white metal in the dark: all of the light is reflected, and nothing is taken away.
            worst = np.abs(change - mean[..., :3]).max()
            assert worst < 1e-6 if wider == 0 else worst > 0.01, (roughness, wider)
        assert change.max() > 0.2


@blur
def test_roughness_0_is_the_identity_whatever_the_blur(stage):
    scene, _ = mirror_and_wall(0.3)
    sharp, _, _ = study_color(stage, scene, PITCHED, blur=0.0)
    assert (sharp == study_color(stage, scene, PITCHED, blur=64.0)[0]).all()
    found = images(stage, scene, PITCHED, settings_of(edge=0.0), (HITS, LIT, REFLECTED))
    rows, columns = np.nonzero(found[HITS][..., 2] > 0)
    at = found[HITS][rows, columns, :2].astype(int)
    assert np.abs(found[REFLECTED][rows, columns] - found[LIT][at[:, 1], at[:, 0]])[:, :3].max() < 1e-6
    rough, _ = mirror_and_wall(0.3, replace(MIRROR, roughness=0.3))
    assert (study_color(stage, rough, PITCHED, blur=0.0)[0] != study_color(stage, rough, PITCHED)[0]).any()


@march
def test_both_backends_march_alike(vulkan_device, gl_context):
    """Of the hall's rays at most one in a thousand decides otherwise, at an outline; all others end alike."""
    hits = {}
    for backend, device in (("vulkan", vulkan_device), ("gl", gl_context)):
        more = {"scene": hall(), "size": (160, 90), "device": device, "inspect": True}
        with chapters.open(WHICH, backend, **more) as renderer:
            hits[backend] = renderer.render(chapters.view_of(renderer)).image(HITS).astype(np.float64)
    assert (hits["vulkan"][..., 3] == hits["gl"][..., 3]).all()
    off = np.abs(hits["vulkan"] - hits["gl"]).max(axis=-1)
    assert (off > 1e-3).mean() < 1e-3 and (hits["vulkan"][..., 2] > 0).sum() > 2000


@march
@pytest.mark.parametrize("kept", ["compact", "octahedral"])
def test_odd_views_are_finite_and_a_plane_does_not_mirror_itself(stage, kept):
    views = [View(pose_looking_at(*places), Perspective(0.9, 0.05)) for places in ODD.values()]
    formats = {"gbuffer_format": kept, "color_format": "rgba16f"}
    double = replace(MIRROR, double_sided=True)
    tilted = FLOOR @ rotation((1, 0.3, 0), 0.05)  # normals that the G-buffer rounds
    alone = replace(quad_scene(double, matrices=(tilted,)), environment=constant(1.0))
    names = (HITS, REFLECTED)
    for found in images_of(stage, alone, views, settings_of(**formats), names):
        assert all(np.isfinite(image).all() for image in found.values())
        assert not found[HITS][..., 2].any(), "a plane met itself"
    # Normals that look away from the eye, as interpolated ones may at an outline.
    bent = replace(alone, normals=np.tile(np.float32((0.0, 0.6, 0.8)), (4, 1)))
    for found in images_of(stage, bent, views[:1], settings_of(**formats), names):
        assert found[HITS][..., 3].any() and not found[HITS][..., 2].any()
    scene, _ = mirror_and_wall(0.2, double, replace(double, roughness=0.3), constant(1.0))
    for found in images_of(stage, scene, views, settings_of(**formats), names):
        assert all(np.isfinite(image).all() and image.min() >= 0.0 for image in found.values())


@march
@pytest.mark.parametrize("factor", [1e-3, 1e3])
def test_scale_changes_no_place(stage, factor):
    """Every length of the march is a part of a distance: a scaled world has the same picture, up to roundings."""
    scene, _ = mirror_and_wall(0.3)
    view = PITCHED
    found = images(stage, scene, view, settings_of())
    large, far = scaled(scene, view, factor)
    far = replace(far, projection=Perspective(0.9, 0.05 * factor))
    other = images(stage, large, far, settings_of())
    off = np.abs(other[HITS] - found[HITS]).max(axis=-1)
    assert (off > 0.01).mean() < 2e-3 and (found[HITS][..., 2] > 0).sum() > 300


@march
def test_any_size_and_what_has_no_g_buffer(stage):
    scene, _ = mirror_and_wall()
    for size in ((1, 1), (3, 2)):
        shown, _, _ = study_color(stage, scene, PITCHED, size)
        assert np.isfinite(shown).all()
    with stage.open(WHICH, SIZE, scene=scene, settings=settings_of(view="normal")) as renderer:
        renderer.render(PITCHED)
        assert "reflections" not in [each.name for each in renderer.passes]
    with pytest.raises(SettingError, match="reflection_strength"):
        Settings(reflection_strenght=1.0)
    with pytest.raises(UserError, match="are not this chapter's"):
        stage.open(WHICH, SIZE, scene=scene, settings=ChapterSettings())
    with stage.open(WHICH, SIZE, scene=scene) as renderer:
        for edited in (0.0, 0.9):
            with scene.edit() as edit:
                edit.set_material(0, replace(MIRROR, roughness=edited))
            renderer.render(facing())
            assert ("reflections" in [each.name for each in renderer.passes]) == (edited == 0.0)
