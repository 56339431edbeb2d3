"""Every view of chapter 1 against what a square with known materials must show, on both backends."""

from __future__ import annotations

import re

import numpy as np
import pytest

import chapters
from chapters import scenes
from chapters.ch01.scene.packing import material_variant
from chapters.ch01.settings import Settings
from chapters.ch01.shading.views import NAMES, VIEWS, number_of
from common.environment.sky import sky
from common.images import palette
from common.images.color import decode_srgb, encode_srgb
from common.numerics.transforms import rotation
from common.paths import ROOT
from common.scene import Image, Light, Material, Sampler
from common.scene.pose import evaluate_pose
from common.view.camera import view_of_scene
from tests.support.bounds import codes_off, decoded_srgb, snapping
from tests.support.chapter import Chapter
from tests.support.drivers import needs_whole_quads
from tests.support.scenes import facing, quad_scene, texture, translated
from tools.run.views import views_of

SIZE = (16, 16)
OUTPUTS = {"color", "color_linear", "depth", "instance_id"}


@pytest.fixture(params=["vulkan", "gl"])
def chapter(request, vulkan_device, gl_context) -> Chapter:
    """Chapter 1 on each backend; the devices are shared by the tests of this module."""
    return Chapter(1, request.param, vulkan_device if request.param == "vulkan" else gl_context)


def look(chapter, scene, view, camera=None, size=SIZE, **settings):
    """Return (shown codes (H, W, 3), stored values (H, W, 3) float32) of one frame under `view`."""
    chosen = Settings(view=view, color_format="rgba32f", **{"anisotropy": 1.0, **settings})
    with chapter.open(scene, size, chosen, outputs=OUTPUTS) as renderer:
        frame = renderer.render(camera or facing())
        return frame.image("color"), frame.image("color_linear")


def picture(seed: int = 1, side: int = 16) -> Image:
    """Return an image of random bytes."""
    return Image("noise", np.random.default_rng(seed).integers(0, 256, (side, side, 4), np.uint8))


def centres() -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (H, W) of the pixels' centres in the square's own coordinates."""
    x = (np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 - 1
    return tuple(np.meshgrid(x, -x))  # type: ignore[return-value]


def test_base_color_is_the_texture_itself(chapter):
    image = picture()
    material = Material(base_color_texture=texture())
    codes, stored = look(chapter, quad_scene(material, images=(image,)), "base-color")
    truth = image.pixels[..., :3]
    assert np.abs(codes.astype(int) - truth).max() <= (0 if chapter.device.capabilities.is_software else 1)
    if chapter.device.capabilities.is_software:
        assert np.allclose(stored, decode_srgb(truth / 255.0), atol=3e-3)
    else:
        low, high = decoded_srgb(truth)
        assert ((low - 1e-6 <= stored) & (stored <= high + 1e-6)).all()


def test_base_color_is_multiplied_by_factor_and_vertex_color(chapter):
    colors = np.tile(np.float32((0.5, 1.0, 0.25, 1.0)), (4, 1))
    scene = quad_scene(Material(base_color=(0.5, 0.25, 1.0, 1.0)), colors=colors)
    stored = look(chapter, scene, "base-color")[1]
    assert np.allclose(stored, (0.25, 0.25, 0.25), atol=1e-6)


def test_normal_is_the_mapped_one_in_the_world(chapter):
    """The square is turned by a quarter about z, and with it the directions in which its map leans."""
    image = picture(2)
    turn = rotation((0, 0, 1), np.pi / 2)
    material = Material(normal_texture=texture(), normal_scale=0.5)
    codes, stored = look(chapter, quad_scene(material, images=(image,), matrices=(turn,)), "normal")
    mapped = np.rot90(image.pixels[..., :3], 1) / 255.0 * 2 - 1
    mapped[..., :2] *= 0.5
    mapped /= np.linalg.norm(mapped, axis=-1, keepdims=True)
    world = mapped @ turn[:3, :3].T
    assert np.abs(stored - (0.5 + 0.5 * world)).max() < 2e-3
    assert np.abs(codes - 255 * (0.5 + 0.5 * world)).max() <= 1.0


def test_normal_of_a_back_face_points_to_the_eye(chapter):
    turn = rotation((0, 1, 0), np.pi)
    stored = look(chapter, quad_scene(Material(double_sided=True), matrices=(turn,)), "normal")[1]
    assert np.allclose(stored, (0.5, 0.5, 1.0), atol=1e-6)


@pytest.mark.parametrize(
    ("view", "channel", "truth"),
    [
        ("roughness", 1, lambda t: 0.5 * t),
        ("metalness", 2, lambda t: 0.25 * t),
        ("occlusion", 0, lambda t: 1 + 0.75 * (t - 1)),
    ],
)
def test_factors_are_multiplied_by_their_channel(chapter, view, channel, truth):
    image = picture(3)
    material = Material(
        roughness=0.5,
        metallic=0.25,
        metallic_roughness_texture=texture(),
        occlusion_texture=texture(),
        occlusion_strength=0.75,
    )
    codes, stored = look(chapter, quad_scene(material, images=(image,)), view)
    expected = truth(image.pixels[..., channel] / 255.0)
    assert np.allclose(stored, expected[..., None], atol=1e-5)
    assert np.abs(codes - 255 * expected[..., None]).max() <= codes_off(chapter.device) + 0.01


def test_what_unlit_materials_have_not_is_black(chapter):
    scene = quad_scene(Material(unlit=True, roughness=1.0, emissive=(1.0, 1.0, 1.0)))
    for view in ("roughness", "metalness", "emissive", "light-count"):
        assert not look(chapter, scene, view)[1].any()


def test_emission_keeps_its_hue_when_it_is_bright(chapter):
    stored = look(chapter, quad_scene(Material(emissive=(0.5, 0.25, 0.0))), "emissive")[1]
    assert np.allclose(stored, (0.5, 0.25, 0.0), atol=1e-6)
    codes, stored = look(chapter, quad_scene(Material(emissive=(400.0, 200.0, 100.0))), "emissive")
    assert np.allclose(stored, (1.0, 0.5, 0.25), atol=1e-6)
    assert (
        np.abs(codes - 255 * encode_srgb(np.array((1.0, 0.5, 0.25)))).max()
        <= codes_off(chapter.device) + 0.01
    )


def test_depth_is_the_distance_of_a_leaning_square(chapter):
    lean = rotation((0, 1, 0), 0.6)
    scene = quad_scene(matrices=(lean,))
    codes, stored = look(chapter, scene, "depth")
    x, _ = centres()
    distance = 2.0 + x * np.tan(0.6)
    scale = 0.25 * scene.length_scale
    covered = np.abs(x) < np.cos(0.6)
    truth = np.where(covered, scale / (scale + distance), 0.0)
    # A pixel is 2 / 16 wide; corners that move take the slope of the square with them.
    moved = snapping(chapter.device) * 2 / SIZE[0] * np.tan(0.6) * truth**2 / scale
    assert (np.abs(stored - truth[..., None]) <= 1e-6 + 1e-5 * truth[..., None] + moved[..., None]).all()
    assert codes[8, 3, 0] > codes[8, 12, 0] > 0 and not codes[8, 0].any()


def test_uv_are_fractions(chapter):
    stored = look(chapter, quad_scene(uv_scale=3.0), "uv")[1]
    x, y = centres()
    truth = np.stack([(x + 1) * 1.5, (1 - y) * 1.5, np.zeros_like(x)], axis=-1) % 1.0
    assert np.allclose(stored, truth, atol=1e-5)


@pytest.mark.parametrize(("uv_scale", "level"), [(0.25, 0.0), (1.0, 2.0), (2.0, 3.0), (1.41421356, 2.5)])
def test_mip_level_follows_from_texels_a_pixel(chapter, uv_scale, level):
    """A texture of 64 texels over 16 pixels: 4 texels a pixel are level 2."""
    needs_whole_quads(chapter.device)
    smooth = Sampler("linear", "linear", "linear")
    scene = quad_scene(
        Material(base_color_texture=texture(0, smooth)), images=(picture(4, 64),), uv_scale=uv_scale
    )
    codes, stored = look(chapter, scene, "mip-level")
    assert np.abs(stored - level).max() < 0.05
    assert np.abs(codes / 255.0 - palette.heat(level / 12)).max() < 0.04


def test_mip_level_without_a_texture_is_grey(chapter):
    assert (look(chapter, quad_scene(), "mip-level")[0] == 51).all()


def test_triangles_have_colors_of_their_own_that_stay(chapter):
    scene = quad_scene(matrices=(translated(-1.0), translated(1.0, 0.0, 0.3)), instance_materials=(0, 0))
    wide = facing(ymag=2.0)
    codes, stored = look(chapter, scene, "triangle-id", wide)
    # Each square is 8 pixels wide, its first triangle below its diagonal.
    for instance, left in ((0, 0), (1, 8)):
        for triangle, (row, column) in ((0, (10, left + 5)), (1, (5, left + 2))):
            truth = palette.id_color(palette.part_id(instance, triangle))
            assert np.allclose(stored[row, column], truth, atol=1e-5)
            assert np.abs(codes[row, column] - 255 * truth).max() <= codes_off(chapter.device) + 0.01
    again = look(chapter, scene, "triangle-id", facing(distance=3.0, ymag=2.0))[1]
    assert np.array_equal(again, stored)


def test_overdraw_counts_every_layer(chapter):
    """Three squares behind one another, one of them transparent; a fourth whose mask lets nothing through."""
    scene = quad_scene(
        materials=(
            Material(),
            Material(base_color=(1, 1, 1, 0.5), alpha_mode="blend"),
            Material(base_color=(1, 1, 1, 0.1), alpha_mode="mask"),
        ),
        matrices=(translated(z=0.5), translated(), translated(z=-0.5), translated(z=0.7)),
        instance_materials=(0, 1, 0, 2),
    )
    codes, stored = look(chapter, scene, "overdraw")
    assert (stored == 3.0).all()
    assert np.abs(codes - 255 * palette.heat(3 / 12)).max() <= codes_off(chapter.device) + 0.01


def test_lights_are_counted_where_range_and_cone_reach(chapter):
    """A sun, a lamp of range 1.2 at height 0.5, and a spot at height 1 whose cone is 0.5 rad wide to each side."""
    scene = quad_scene(
        matrices=(np.eye(4), translated(z=0.5), translated(x=0.5, z=1.0)),
        instance_materials=(0,),
        lights=(
            Light("directional", node=0, intensity=3.0),
            Light("point", node=1, intensity=5.0, range=1.2),
            Light("spot", node=2, intensity=5.0, inner_cone=0.1, outer_cone=0.5),
        ),
    )
    codes, stored = look(chapter, scene, "light-count", facing(ev100=0.0))
    x, y = centres()
    in_range = np.sqrt(x**2 + y**2 + 0.25) < 1.2
    in_cone = np.arctan2(np.hypot(x - 0.5, y), 1.0) < 0.5
    truth = 1.0 + in_range + in_cone
    assert {1.0, 2.0, 3.0} <= set(np.unique(truth))
    assert np.array_equal(stored[..., 0], truth)
    assert np.abs(codes - 255 * palette.heat(truth / 12)).max() <= codes_off(chapter.device) + 0.01


def test_a_light_below_the_cutoff_is_not_counted(chapter):
    scene = quad_scene(matrices=(np.eye(4), translated(z=0.5)), instance_materials=(0,), lights=(LAMP,))
    stored = look(chapter, scene, "light-count", facing(ev100=0.0), light_cutoff=1.0)[1]
    exposed = 4.0 / 1.2  # EV100 0 is a factor of 1 / 1.2
    x, y = centres()
    distance = np.sqrt(x**2 + y**2 + 0.25)
    assert np.array_equal(stored[..., 0], (exposed / distance**2 > 1.0).astype(np.float32))


LAMP = Light("point", node=1, intensity=4.0)


def test_what_is_no_number_is_magenta(chapter):
    pixels = np.full((16, 16, 4), 0.5, np.float32)
    pixels[3, 5, 1], pixels[12, 2, 0] = np.nan, np.inf
    scene = quad_scene(Material(unlit=True, base_color_texture=texture()), images=(Image("holes", pixels),))
    codes, stored = look(chapter, scene, "non-finite")
    truth = np.full((16, 16, 3), 0.125)
    truth[3, 5] = truth[12, 2] = palette.MAGENTA
    assert np.allclose(stored, truth, atol=1e-6)
    assert (codes[3, 5] == (255, 0, 255)).all()


def test_roughness_that_is_no_number_is_magenta_though_shading_hides_it(chapter):
    scene = quad_scene(Material(roughness=float("nan")), lights=(Light("directional", node=0),))
    assert (look(chapter, scene, "non-finite")[0] == (255, 0, 255)).all()


def test_every_number_in_the_shader_is_that_of_its_name():
    text = (ROOT / "chapters" / "ch01" / "shading/views.glsl").read_text("utf-8")
    found = re.findall(r"#define VIEW_([A-Z_]+) (\d+)", text)
    assert {name.lower().replace("_", "-"): int(number) for name, number in found} == {
        name: number_of(name) for name in NAMES
    }
    assert list(views_of(1)) == list(NAMES)
    assert all(view.sentence.endswith(".") and len(view.sentence) <= 120 for view in VIEWS)


def test_without_a_view_nothing_of_it_exists(chapter):
    """No define, no pipeline more; and a view makes and uploads no more than it reads."""
    scene = scenes.load("cornell")
    work = {}
    for view in ("picture", "depth", "normal", "base-color"):
        with chapter.open(scene, (16, 16), Settings(view=view)) as renderer:
            variants = renderer._data.variants
            assert [variant.has("VIEW") for variant in variants] == [view != "picture"] * len(variants)
            if view == "picture":
                assert variants == [material_variant(material, scene) for material in scene.materials]
            work[view] = renderer.render(chapters.view_of(renderer)).work
    assert work["depth"]["textures"] == 0
    assert work["depth"]["pipelines"] == 2 <= work["picture"]["pipelines"]
    assert work["depth"]["draws"] == work["picture"]["draws"]


def test_a_view_has_one_sample_a_pixel_and_a_black_sky(chapter):
    scene = quad_scene(matrices=(np.diag((0.5, 0.5, 0.5, 1.0)),))
    scene.environment = sky()
    settings = Settings(view="base-color", msaa=4)
    with chapter.open(scene, SIZE, settings) as renderer:
        frame = renderer.render(facing())
        assert frame.work["samples"] == 1
        assert any(choice.feature == "msaa" for choice in renderer.plan.choices)
        assert renderer.prepared_ms == {}  # an environment that nothing is lit by is not prepared
        codes = frame.image("color")
    assert not codes[0, 0].any() and (codes[8, 8] == 255).all()


def test_an_edited_material_is_seen(chapter):
    scene = quad_scene(Material(roughness=0.25), images=(picture(5),))
    with chapter.open(scene, SIZE, Settings(view="roughness"), outputs=OUTPUTS) as renderer:
        assert np.allclose(renderer.render(facing()).image("color_linear"), 0.25, atol=1e-3)
        with scene.edit() as edit:
            edit.set_material(0, Material(roughness=1.0, metallic_roughness_texture=texture()))
        stored = renderer.render(facing()).image("color_linear")
    assert np.allclose(stored[..., 0], scene.images[0].pixels[..., 1] / 255.0, atol=1e-3)


@pytest.mark.parametrize("view", NAMES)
def test_both_backends_show_the_same(view, vulkan_device, gl_context):
    scene = scenes.load("cornell")
    camera = view_of_scene(scene, evaluate_pose(scene, 0.0), None, 4 / 3)
    both = [
        look(Chapter(1, backend, device), scene, view, camera, (48, 36))
        for backend, device in (("vulkan", vulkan_device), ("gl", gl_context))
    ]
    codes = [each[0].astype(int) for each in both]
    if view not in ("metalness", "mip-level", "uv"):  # of which that scene has one value alone
        assert len(np.unique(codes[0])) > 1
    away = np.abs(codes[0] - codes[1]).max(axis=-1) > 1
    software = vulkan_device.capabilities.is_software and gl_context.capabilities.is_software
    assert away.mean() <= (0.001 if software else 0.01)


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("msaa", [1, 4])
def test_depth_and_ids_are_the_same_under_every_view(chapter, number, msaa):
    """Where a pixel counts what is shaded no depth is written: whoever asks for it must still get the picture's."""
    scene = scenes.load("cornell")
    chapter = Chapter(number, chapter.backend, chapter.device)
    found = {}
    for view in ("picture", "normal", "overdraw"):
        settings = chapters.settings_class(number)(view=view, msaa=msaa)
        with chapter.open(scene, SIZE, settings, outputs={"depth", "instance_id"}) as renderer:
            frame = renderer.render(chapters.view_of(renderer))
            found[view] = frame.image("depth"), frame.image("instance_id")
    depth, ids = found.pop("picture")
    assert (depth > 0).any() and len(np.unique(ids)) > 4
    for view, (same_depth, same_ids) in found.items():
        assert np.array_equal(depth, same_depth) and np.array_equal(ids, same_ids), view
