"""What materials do beyond one lit square: layers of glass, mirrors of mapped normals, second uv sets, emission."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.settings import Settings
from common.images.color import decode_srgb
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material
from common.settings import replaced
from common.view.camera import Orthographic, View, exposure
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated
from tests.twins import shading

pytestmark = [pytest.mark.newest, pytest.mark.variants("vulkan", "without-all")]
everywhere = pytest.mark.variants("vulkan", "without-all", "gl")
"""What shaders compute is the same text on OpenGL, held to these pictures by test_agreement.py; state is not."""

SIZE = (16, 16)
EXACT = Settings(color_format="rgba32f", background=0.0, default_light=False, tone_curve="none")
UNLIT = Material(unlit=True)
MATTE = Material(metallic=0.0, roughness=1.0)


def draw(chapter, scene, view=None, settings=EXACT, size=SIZE, output="color_linear"):
    """Return one output of one frame."""
    with chapter.open(scene, size, settings, outputs={output}) as made:
        return made.render(view or facing()).image(output)


# --- transparency ---

GLASS = {
    "red": ((1.0, 0.0, 0.0, 0.5), (-0.4, 0.3)),
    "green": ((0.0, 1.0, 0.0, 0.25), (0.4, 0.2)),
    "blue": ((0.0, 0.0, 1.0, 0.75), (0.0, -0.3)),
}
"""Colour and alpha, and the centre of a square of half size, of three panes that overlap in every combination."""


@pytest.mark.parametrize("behind", [False, True], ids=["from the front", "from behind"])
@pytest.mark.parametrize("order", list(itertools.permutations(GLASS)), ids="-".join)
@everywhere
def test_three_panes_of_glass_blend_from_back_to_front(chapter, order, behind):
    """Whatever their order in the file, seen from either side: the over operator in float64, pixel by pixel."""
    depths = {"red": -0.5, "green": 0.0, "blue": 0.5}
    materials = tuple(
        replace(UNLIT, base_color=GLASS[n][0], alpha_mode="blend", double_sided=True) for n in order
    )
    places = [(*GLASS[name][1], depths[name]) for name in order]
    half = np.diag((0.5, 0.5, 1.0, 1.0))
    scene = quad_scene(
        materials=materials,
        matrices=tuple(translated(*place) @ half for place in places),
        instance_materials=(0, 1, 2),
    )
    view = View(pose_looking_at((0, 0, -2.0 if behind else 2.0), (0, 0, 0)), Orthographic(1.0, 0.1, 4.0))
    picture = draw(chapter, scene, view) * exposure(view.ev100)
    x = (np.arange(16) + 0.5) / 8 - 1
    x, y = np.meshgrid(-x if behind else x, -x)
    expected = np.zeros((16, 16, 3))
    for name in sorted(depths, key=depths.get, reverse=behind):
        color, (cx, cy) = np.array(GLASS[name][0]), GLASS[name][1]
        inside = ((np.abs(x - cx) < 0.5) & (np.abs(y - cy) < 0.5))[..., None]
        expected = np.where(inside, color[3] * color[:3] + (1 - color[3]) * expected, expected)
    assert len(np.unique(expected.reshape(-1, 3), axis=0)) == 8, "every combination is seen"
    assert np.allclose(picture, expected, atol=1e-6)


@everywhere
def test_glass_is_hidden_by_what_is_before_it_and_hides_nothing_itself(chapter):
    wall, pane = (
        replace(UNLIT, base_color=(0, 0, 1, 1)),
        replace(UNLIT, base_color=(1, 0, 0, 0.5), alpha_mode="blend"),
    )
    for z, expected in ((-0.5, (0, 0, 1)), (0.5, (0.5, 0, 0.5))):
        scene = quad_scene(
            materials=(pane, wall), matrices=(translated(z=z), np.eye(4)), instance_materials=(0, 1)
        )
        view = facing()
        assert np.allclose(draw(chapter, scene, view) * exposure(view.ev100), expected, atol=1e-6)
        assert (draw(chapter, scene, view, output="instance_id") == 2).all(), "glass has no id"
        assert np.allclose(draw(chapter, scene, view, output="depth"), 2 / 3.9, atol=1e-6), "and no depth"


def test_alpha_of_a_blended_material_is_factor_times_texture_times_vertex(chapter):
    images = (Image("half", np.full((2, 2, 4), (255, 255, 255, 128), np.uint8)),)
    colors = np.tile(np.float32((1, 1, 1, 0.5)), (4, 1))
    material = replace(UNLIT, base_color=(1, 1, 1, 0.8), alpha_mode="blend", base_color_texture=texture())
    view = facing()
    picture = draw(chapter, quad_scene(material, images=images, colors=colors), view) * exposure(view.ev100)
    assert np.allclose(picture, 0.8 * 0.5 * 128 / 255, atol=1e-6)


def test_an_opaque_material_ignores_its_alpha(chapter):
    view = facing()
    picture = draw(chapter, quad_scene(replace(UNLIT, base_color=(1, 1, 1, 0.1))), view)
    assert np.allclose(picture * exposure(view.ev100), 1.0, atol=1e-6)


@pytest.mark.parametrize("cutoff", [0.0, 0.3, 1.0, 1.5])
def test_a_mask_keeps_what_reaches_the_cutoff(chapter, cutoff):
    """Four columns of alpha 0, 0.3, 0.6 and 1: equal to the cutoff is kept (glTF 2.0, 3.9.4), above 1 nothing is."""
    alpha = np.ones((1, 4, 4), np.float32)
    alpha[0, :, 3] = np.float16((0.0, 0.3, 0.6, 1.0))
    cutoff = float(np.float16(cutoff))
    material = replace(UNLIT, alpha_mode="mask", alpha_cutoff=cutoff, base_color_texture=texture())
    ids = draw(chapter, quad_scene(material, images=(Image("columns", alpha),)), output="instance_id")
    assert ((ids > 0)[8, 2::4] == (alpha[0, :, 3] >= cutoff)).all()


@pytest.mark.core
@everywhere
def test_a_mask_is_cut_alike_in_colour_and_ids_by_all_that_alpha_is_made_of(chapter):
    """Factor times texture times vertex alpha, falling from left to right, against a cutoff between: one edge.

    On a wall at the very same depth, so that depth alone cannot tell what was cut away.
    """
    images = (Image("most", np.full((2, 2, 4), (255, 255, 255, 204), np.uint8)),)
    colors = np.ones((4, 4), np.float32)
    colors[1:3, 3] = 0.0
    material = replace(
        UNLIT, base_color=(1, 1, 1, 0.9), alpha_mode="mask", alpha_cutoff=0.4, base_color_texture=texture()
    )
    scene = quad_scene(
        materials=(replace(UNLIT, base_color=(0, 0, 1, 1)), material),
        matrices=(np.eye(4), np.eye(4)),
        instance_materials=(0, 1),
        images=images,
        colors=colors,
    )
    ids, picture = (draw(chapter, scene, output=output) for output in ("instance_id", "color_linear"))
    alpha = 0.9 * 0.8 * (1 - (np.arange(16) + 0.5) / 16)
    assert np.array_equal(ids, np.broadcast_to(np.where(alpha >= 0.4, 2, 1), (16, 16)))
    assert np.array_equal(ids == 2, picture[..., 0] > 0)


@everywhere
def test_each_mask_is_cut_by_its_own_texture_in_the_ids_too(chapter):
    """Two squares side by side: one keeps its right half, the other its left, whichever was bound last."""
    left, right = np.ones((1, 2, 4), np.float32), np.ones((1, 2, 4), np.float32)
    left[0, 1, 3] = right[0, 0, 3] = 0.0
    mask = replace(UNLIT, alpha_mode="mask")
    scene = quad_scene(
        materials=tuple(replace(mask, base_color_texture=texture(image)) for image in (0, 1)),
        matrices=(translated(-1.0), translated(1.0)),
        instance_materials=(1, 0),
        images=(Image("left", left), Image("right", right)),
    )
    ids = draw(chapter, scene, facing(ymag=2.0), output="instance_id")
    assert (ids[8] == np.repeat((0, 1, 2, 0), 4)).all()


# --- normals ---


def tilted_map(degrees_x, degrees_y):
    """Return an image of one normal that leans towards +x and +y of the texture."""
    normal = np.array((math.tan(math.radians(degrees_x)), math.tan(math.radians(degrees_y)), 1.0))
    normal /= np.linalg.norm(normal)
    return Image("tilted", np.full((2, 2, 4), (*(normal / 2 + 0.5), 1.0), np.float32))


@pytest.mark.feature("pbr/normal-mapping")
@pytest.mark.parametrize("mirror", [(-1, 1, 1), (1, -1, 1), (-1, -1, 1), (-1, 1, -1)], ids=str)
@everywhere
def test_a_mirrored_world_is_the_mirrored_picture(chapter, mirror):
    """Reflect object and lights alike: mapped normals, too, must come out as in a mirror, whatever axis is turned."""
    material = replace(MATTE, normal_texture=texture(), double_sided=True)
    lights = (Light("directional", node=1, intensity=3.0), Light("point", node=2, intensity=2.0))
    sun, lamp = pose_looking_at((1.0, 2.0, 3.0), (0, 0, 0)), translated(0.4, -0.6, 1.2)

    def shown(reflection):
        nodes = [reflection, reflection @ sun, reflection @ lamp]
        scene = quad_scene(material, lights=lights, images=(tilted_map(25, 40),))
        eye = reflection @ np.array((0.0, 0.0, 2.0, 1.0))
        view = View(pose_looking_at(eye[:3], (0, 0, 0)), Orthographic(1.0, 0.1, 4.0))
        return draw(chapter, replace(scene, nodes=nodes_at(*nodes)), view)

    plain, reflected = shown(np.eye(4)), shown(np.diag((*map(float, mirror), 1.0)))
    x, y, z = mirror
    # Seen from behind (z turned, the camera with it), left and right change places once more.
    expected = plain[:, ::-1] if x * z < 0 else plain
    expected = expected[::-1] if y < 0 else expected
    assert np.allclose(reflected, expected, rtol=1e-5, atol=1e-6)
    assert np.ptp(plain) > 0.1, "the picture has sides to change"


def test_the_back_of_a_mapped_surface_is_lit_by_the_mapped_normal_turned_over(chapter):
    """A normal that leans to the world's +x sees, from behind, a light from -x: minus the mapped normal."""
    material = replace(MATTE, normal_texture=texture(), double_sided=True)
    tilt = np.array((math.tan(math.radians(30)), 0.0, 1.0)) / math.hypot(1, math.tan(math.radians(30)))
    light_from = np.array((-0.5, 0.0, -1.0)) / math.hypot(0.5, 1.0)
    sun = pose_looking_at(light_from, (0, 0, 0))
    scene = quad_scene(
        material, lights=(Light("directional", node=1, intensity=math.pi),), images=(tilted_map(30, 0),)
    )
    view = View(pose_looking_at((0, 0, -2.0), (0, 0, 0)), Orthographic(1.0, 0.1, 4.0))
    picture = draw(chapter, replace(scene, nodes=nodes_at(np.eye(4), sun)), view)
    to_eye = np.array((0.0, 0.0, -1.0))
    expected = shading.metallic_roughness(-tilt, light_from, to_eye, np.ones(3), 0.0, 1.0) * math.pi
    assert np.allclose(picture, expected, rtol=2e-3)


def test_squeezed_objects_keep_their_normals_upright(chapter):
    """A square leaned by 45 degrees and squeezed to half its depth: the normal is the inverse transpose's."""
    c = math.sqrt(0.5)
    lean = np.array([(1, 0, 0, 0), (0, c, -c, 0), (0, c, c, 0), (0, 0, 0, 1)], np.float64)
    squeeze = np.diag((1.0, 1.0, 0.5, 1.0))
    scene = quad_scene(MATTE, lights=(Light("directional", node=1, intensity=math.pi),))
    picture = draw(chapter, replace(scene, nodes=nodes_at(squeeze @ lean, np.eye(4))))
    normal = np.array((0.0, -c, 2 * c)) / np.linalg.norm((0.0, -c, 2 * c))
    up = np.array((0.0, 0.0, 1.0))
    expected = shading.metallic_roughness(normal, up, up, np.ones(3), 0.0, 1.0) * math.pi
    assert np.allclose(picture[8, 8], expected, rtol=2e-5)


# --- textures ---


def two_sided_uv():
    """Return a scene with a texture of four colours whose second uv set is turned by half a turn."""
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[..., :3] = [[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 0)]]
    scene = quad_scene(UNLIT, images=(Image("four", pixels),))
    scene.uv1 = 1 - scene.uv0
    return scene, decode_srgb(pixels[..., :3] / 255.0)


@everywhere
def test_the_second_uv_set_is_where_the_texture_says(chapter):
    scene, colors = two_sided_uv()
    view = facing()
    for uv_set, expected in ((0, colors), (1, colors[::-1, ::-1])):
        scene.materials[0] = replace(UNLIT, base_color_texture=texture(uv_set=uv_set))
        picture = draw(chapter, scene, view) * exposure(view.ev100)
        assert np.allclose(picture[4::8, 4::8], expected, atol=1e-6)


@pytest.mark.feature("pbr/texture-roles")
def test_every_role_has_a_transform_of_its_own(chapter):
    """Base colour and emission read the same image at different places: each by its own offset."""
    pixels = np.full((1, 2, 4), 255, np.uint8)
    pixels[0, :, :3] = (255, 0, 0), (0, 255, 0)
    material = Material(
        metallic=0.0,
        emissive=(1.0, 1.0, 1.0),
        base_color_texture=texture(offset=(0.0, 0.0), scale=(0.5, 1.0)),
        emissive_texture=texture(offset=(0.5, 0.0), scale=(0.5, 1.0)),
    )
    scene = quad_scene(material, images=(Image("two", pixels),))
    picture = draw(chapter, scene, settings=replaced(EXACT, ambient=1.0))
    assert np.allclose(picture, (0.96 + 0.04, 0.04 + 1.0, 0.04), atol=1e-5)
    assert not np.allclose(picture, (0.04 + 1.0, 0.96 + 0.04, 0.04), atol=1e-2), (
        "with both transforms exchanged"
    )


@pytest.mark.feature("pbr/texture-roles")
@everywhere
def test_a_neutral_texture_is_none(chapter):
    """White, (1, 1, 1) roughness and metal, a flat normal, no occlusion: the same bits as without any map."""
    white = Image("white", np.full((2, 2, 4), 255, np.uint8))
    flat = Image("flat", np.full((2, 2, 4), (0.5, 0.5, 1.0, 1.0), np.float32))
    plain = Material(base_color=(0.7, 0.4, 0.2, 1.0), metallic=0.3, roughness=0.5, emissive=(0.1, 0.2, 0.3))
    mapped = replace(
        plain,
        base_color_texture=texture(0),
        metallic_roughness_texture=texture(0),
        occlusion_texture=texture(0),
        emissive_texture=texture(0),
        normal_texture=texture(1),
    )
    lamp = Light("point", node=1, intensity=3.0)
    nodes = nodes_at(np.eye(4), translated(0.2, 0.4, 1.0))
    settings = replaced(EXACT, ambient=0.3)
    a, b = (
        draw(
            chapter,
            replace(quad_scene(m, lights=(lamp,), images=(white, flat)), nodes=nodes),
            settings=settings,
        )
        for m in (plain, mapped)
    )
    assert np.allclose(a, b, rtol=1e-6)


def test_emission_is_nits_whatever_the_exposure(chapter):
    material = Material(base_color=(0, 0, 0, 1), metallic=1.0, emissive=(12.0, 3.0, 0.5))
    for ev100 in (-2.0, 0.0, 5.0, 14.0):
        picture = draw(chapter, quad_scene(material), facing(ev100=ev100))
        assert np.allclose(picture, (12.0, 3.0, 0.5), rtol=1e-6)
