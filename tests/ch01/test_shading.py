"""What the forward pass draws, against closed forms: lights, materials, textures, transparency."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.settings import Settings
from common.images.color import decode_srgb, encode_srgb
from common.scene import Image, Light, Material, Sampler
from common.settings import replaced
from common.view.camera import exposure
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated
from tests.twins import shading

pytestmark = [pytest.mark.newest, pytest.mark.variants("vulkan", "without-all")]
everywhere = pytest.mark.variants("vulkan", "without-all", "gl")
"""What shaders compute is the same text on OpenGL, held to these pictures by test_agreement.py; state is not."""

SIZE = (16, 16)
EXACT = Settings(color_format="rgba32f", background=0.0, default_light=False, tone_curve="none")
UNLIT = Material(unlit=True)
MATTE = Material(metallic=0.0, roughness=1.0)


def draw(chapter, scene, *outputs, view=None, settings=EXACT, size=SIZE):
    """Return one output of one frame, or a tuple of several."""
    outputs = outputs or ("color_linear",)
    with chapter.open(scene, size, settings, outputs=set(outputs)) as made:
        frame = made.render(view or facing())
        images = tuple(frame.image(name) for name in outputs)
    return images if len(images) > 1 else images[0]


def pixel_centres(size=SIZE):
    """Return x and y in the world of every pixel of `facing()`, row 0 on top."""
    x = (np.arange(size[0]) + 0.5) / size[0] * 2 - 1
    y = 1 - (np.arange(size[1]) + 0.5) / size[1] * 2
    return np.meshgrid(x, y)


def grey(value):
    """Return an 8 x 8 image of one colour (4 floats)."""
    return Image("grey", np.full((8, 8, 4), value, np.float32))


def checker(cells=4):
    """Return an image with a different colour in every texel, and the colours as floats."""
    rng = np.random.default_rng(5)
    pixels = rng.integers(0, 256, (cells, cells, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    return Image("checker", pixels)


@pytest.mark.core
@everywhere
@pytest.mark.feature("pbr/forward-ggx")
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
def test_a_lit_square_equals_the_float64_twin(chapter, metallic, roughness):
    """A point light of 5 cd at (0.4, 0.3, 0.8), seen along -z: every pixel by the definition."""
    material = Material(base_color=(0.8, 0.4, 0.2, 1.0), metallic=metallic, roughness=roughness)
    light = Light("point", node=1, intensity=5.0, color=(1.0, 0.9, 0.8))
    where = (0.4, 0.3, 0.8)
    scene = quad_scene(material, matrices=(np.eye(4),), lights=(light,))
    scene = replace(scene, nodes=nodes_at(np.eye(4), translated(*where)))
    picture = draw(chapter, scene)
    x, y = pixel_centres()
    to_light = np.stack([where[0] - x, where[1] - y, np.full_like(x, where[2])], axis=-1)
    distance = np.linalg.norm(to_light, axis=-1, keepdims=True)
    up = np.broadcast_to((0.0, 0.0, 1.0), to_light.shape)
    brdf = shading.metallic_roughness(
        up,
        to_light / distance,
        up,
        (0.8, 0.4, 0.2),
        np.full(x.shape, metallic),
        np.full(x.shape, roughness**2),
    )
    expected = brdf * np.array(light.color) * 5.0 / distance**2
    assert np.allclose(picture, expected, rtol=2e-5, atol=1e-6 * expected.max())


@everywhere
@pytest.mark.feature("lighting/punctual-lights")
def test_a_directional_light_has_no_falloff_and_pi_lux_on_white_is_one_nit(chapter):
    light = Light("directional", node=0, intensity=math.pi)
    near = draw(chapter, quad_scene(MATTE, lights=(light,)))
    up = np.array((0.0, 0.0, 1.0))
    expected = shading.metallic_roughness(up, up, up, np.ones(3), 0.0, 1.0) * math.pi
    assert np.allclose(near, expected, rtol=1e-5)
    assert np.allclose(expected, 0.96 + 0.04 / 4, rtol=1e-12), (
        "0.96 of the light diffuse, F0 D/4 pi of it specular"
    )


def test_range_takes_a_point_light_to_zero_and_cone_angles_bound_a_spot(chapter):
    """glTF's window (1 - (d/range)^4) and squared cosine ramp, pixel by pixel."""
    reach, inner, outer = 1.4, 0.3, 0.7
    x, y = pixel_centres()
    to_light = np.stack([-x, -y, np.ones_like(x)], axis=-1)
    distance = np.linalg.norm(to_light, axis=-1)
    up = np.broadcast_to((0.0, 0.0, 1.0), to_light.shape)
    flat = np.zeros_like(x)
    brdf = shading.metallic_roughness(up, to_light / distance[..., None], up, np.ones(3), flat, flat + 1.0)
    falloff = shading.range_window(distance, reach) / distance**2
    for kind, factor in (
        ("point", falloff),
        ("spot", falloff * shading.spot_cone(1 / distance, inner, outer)),
    ):
        light = Light(kind, node=1, intensity=2.0, range=reach, inner_cone=inner, outer_cone=outer)
        scene = replace(quad_scene(MATTE, lights=(light,)), nodes=nodes_at(np.eye(4), translated(z=1.0)))
        picture = draw(chapter, scene)
        expected = brdf * 2.0 * factor[..., None]
        assert np.allclose(picture, expected, rtol=1e-4, atol=1e-6)
        assert (picture[0, 0] == 0.0).all() == (expected[0, 0].max() == 0.0)


def test_light_cutoff_ends_a_light_where_its_exposed_illuminance_falls_below(chapter):
    light = Light("point", node=1, intensity=2.0)
    scene = replace(quad_scene(MATTE, lights=(light,)), nodes=nodes_at(np.eye(4), translated(z=1.0)))
    view = facing()
    cutoff = 2.0 * exposure(view.ev100) / 1.3  # reached at a squared distance of 1.3
    picture = draw(chapter, scene, settings=replaced(EXACT, light_cutoff=cutoff))
    whole = draw(chapter, scene)
    x, y = pixel_centres()
    inside = x**2 + y**2 + 1.0 < 1.3
    assert inside.any()
    assert (~inside).any()
    assert np.array_equal(picture[inside], whole[inside])
    assert (picture[~inside] == 0.0).all()
    assert (whole[~inside] > 0.0).all()


@everywhere
def test_lights_add_up(chapter):
    lights = (Light("point", node=1, intensity=3.0), Light("directional", node=0, color=(0.2, 0.5, 1.0)))
    nodes = nodes_at(np.eye(4), translated(0.3, -0.2, 1.5))

    def shown(*some):
        return draw(chapter, replace(quad_scene(MATTE, lights=some), nodes=nodes))

    assert np.allclose(shown(*lights), shown(lights[0]) + shown(lights[1]), rtol=1e-6)


@pytest.mark.feature("device/textures")
@everywhere
def test_a_texel_per_pixel_is_the_texel_itself(chapter):
    """16 pixels on 16 texels with nearest filtering: base colour decoded from sRGB, bit for bit after coding again."""
    rng = np.random.default_rng(3)
    pixels = rng.integers(0, 256, (16, 16, 4), dtype=np.uint8)
    pixels[..., 3] = 255
    material = replace(UNLIT, base_color_texture=texture())
    picture = draw(chapter, quad_scene(material, images=(Image("texels", pixels),)), "color")
    view = facing()
    coded = pixels[..., :3].astype(np.float64) / 255.0
    light = decode_srgb(coded)
    # An unlit colour is what the eye sees: `color` shows it as it is, whatever the exposure.
    expected = np.round(255 * encode_srgb(light))
    assert np.abs(picture - expected).max() <= 1
    assert exposure(view.ev100) > 0


def test_metal_and_roughness_come_from_blue_and_green(chapter):
    light = Light("directional", node=0, intensity=math.pi)
    base = Material(base_color=(0.9, 0.6, 0.3, 1.0))
    packed = grey((0.9, 0.25, 0.75, 1.0))  # red is not theirs
    textured = replace(base, metallic_roughness_texture=texture(), roughness=0.8, metallic=0.5)
    plain = replace(base, roughness=0.2, metallic=0.375)
    a = draw(chapter, quad_scene(textured, lights=(light,), images=(packed,)))
    b = draw(chapter, quad_scene(plain, lights=(light,)))
    assert np.allclose(a, b, rtol=1e-4)


@pytest.mark.feature("pbr/texture-roles")
def test_occlusion_dims_ambient_light_alone(chapter):
    light = Light("directional", node=0, intensity=1.0)
    settings = replaced(EXACT, ambient=0.7)
    half = replace(MATTE, occlusion_texture=texture(), occlusion_strength=0.5)
    images = (grey((0.2, 0.9, 0.9, 1.0)),)

    def shown(material, lights):
        return draw(chapter, quad_scene(material, lights=lights, images=images), settings=settings)

    direct = shown(MATTE, (light,)) - shown(MATTE, ())
    assert np.allclose(shown(half, (light,)) - shown(half, ()), direct, atol=1e-6)
    assert np.allclose(shown(half, ()), 0.6 * shown(MATTE, ()), rtol=1e-3)  # 1 + 0.5 (0.2 - 1)
    assert np.allclose(shown(MATTE, ()), 0.7, rtol=1e-5), "a white surface reflects all of it"


@pytest.mark.feature("pbr/normal-mapping")
def test_a_tilted_normal_map_tilts_the_normal(chapter):
    """A normal of 30 degrees towards +x sees a light straight ahead as cos 30; a flat map changes nothing."""
    light = Light("directional", node=0, intensity=math.pi)
    tilt = np.array((math.sin(math.pi / 6), 0.0, math.cos(math.pi / 6)))
    tilted = grey((*(tilt / 2 + 0.5), 1.0))
    flat = grey((0.5, 0.5, 1.0, 1.0))
    material = replace(MATTE, normal_texture=texture())
    v = np.array((0.0, 0.0, 1.0))
    picture = draw(chapter, quad_scene(material, lights=(light,), images=(tilted,)))
    expected = shading.metallic_roughness(tilt, v, v, np.ones(3), 0.0, 1.0) * math.pi
    assert np.allclose(picture, expected, rtol=2e-3)  # half-precision texels
    plain = draw(chapter, quad_scene(MATTE, lights=(light,)))
    assert np.array_equal(draw(chapter, quad_scene(material, lights=(light,), images=(flat,))), plain)
    # Scale 0 leaves the geometric normal, whatever the map says.
    unscaled = replace(material, normal_scale=0.0)
    assert np.allclose(
        draw(chapter, quad_scene(unscaled, lights=(light,), images=(tilted,))), plain, rtol=1e-6
    )


@pytest.mark.feature("pbr/normal-mapping")
def test_the_green_of_a_normal_map_is_up(chapter):
    """uv v grows downwards and the bitangent is cross(n, t) w: +y of the map leans towards smaller v, the top."""
    lights = tuple(Light("directional", node=index, intensity=1.0) for index in (1, 2))
    up_light = np.eye(4)
    up_light[:3, 2] = (0.0, 0.8, 0.6)  # shines along -z of its node: it comes from above
    down_light = np.eye(4)
    down_light[:3, 2] = (0.0, -0.8, 0.6)
    material = replace(MATTE, normal_texture=texture())
    images = (grey((0.5, 0.75, 0.933, 1.0)),)
    seen = []
    for light in lights:
        scene = replace(
            quad_scene(material, lights=(light,), images=images),
            nodes=nodes_at(np.eye(4), up_light, down_light),
        )
        seen.append(draw(chapter, scene).mean())
    assert seen[0] > 2 * seen[1]


def test_emission_is_in_nits_and_its_texture_multiplies(chapter):
    material = Material(
        base_color=(0, 0, 0, 1), emissive=(3.0, 2.0, 1.0), emissive_texture=texture(), metallic=1.0
    )
    picture = draw(chapter, quad_scene(material, images=(grey((0.5, 0.25, 1.0, 1.0)),)))
    assert np.allclose(picture, (1.5, 0.5, 1.0), rtol=1e-5)


@everywhere
def test_double_sided_surfaces_are_lit_from_behind_and_others_are_not_drawn(chapter):
    behind = np.diag((-1.0, 1.0, -1.0, 1.0))  # half a turn about y: its back is seen
    sun = Light("directional", node=1, intensity=math.pi)

    def shown(material, matrix):
        scene = quad_scene(material, lights=(sun,))
        return draw(chapter, replace(scene, nodes=nodes_at(matrix, np.eye(4))))

    front = shown(MATTE, np.eye(4))
    assert (shown(MATTE, behind) == 0.0).all()
    assert np.allclose(shown(replace(MATTE, double_sided=True), behind), front, rtol=1e-6)


@everywhere
def test_a_mirrored_object_shows_its_front(chapter):
    sun = Light("directional", node=1, intensity=math.pi)
    scene = quad_scene(MATTE, lights=(sun,))
    plain = draw(chapter, replace(scene, nodes=nodes_at(np.eye(4), np.eye(4))))
    mirrored = draw(chapter, replace(scene, nodes=nodes_at(np.diag((-1.0, 1, 1, 1)), np.eye(4))))
    assert np.allclose(mirrored, plain, rtol=1e-6)
    assert plain.max() > 0.9


@everywhere
def test_alpha_mask_cuts_at_the_cutoff(chapter):
    alpha = np.ones((16, 16, 4), np.float32)
    alpha[..., 3] = np.linspace(0.0, 1.0, 16)
    material = replace(UNLIT, alpha_mode="mask", alpha_cutoff=0.5, base_color_texture=texture())
    picture, ids = draw(
        chapter, quad_scene(material, images=(Image("ramp", alpha),)), "color_linear", "instance_id"
    )
    kept = np.float16(np.linspace(0.0, 1.0, 16)) >= 0.5
    assert np.array_equal(picture[..., 0] > 0, np.broadcast_to(kept, (16, 16)))
    assert np.array_equal(ids > 0, np.broadcast_to(kept, (16, 16)))


@everywhere
def test_transparent_squares_are_blended_from_back_to_front(chapter):
    """Half red over half green over blue, whichever order the file has them in."""
    red = replace(UNLIT, base_color=(1, 0, 0, 0.5), alpha_mode="blend")
    green = replace(UNLIT, base_color=(0, 1, 0, 0.5), alpha_mode="blend")
    blue = replace(UNLIT, base_color=(0, 0, 1, 1))
    view = facing()
    for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0)):
        depths = {0: 0.2, 1: 0.1, 2: 0.0}
        scene = quad_scene(
            materials=(red, green, blue),
            matrices=tuple(translated(z=depths[kind]) for kind in order),
            instance_materials=order,
        )
        picture = draw(chapter, scene, view=view) * exposure(view.ev100)
        assert np.allclose(picture, (0.5, 0.25, 0.25), atol=1e-6)


@everywhere
def test_vertex_colours_multiply_the_base_colour(chapter):
    colors = np.array([(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1), (1, 1, 1, 1)], np.float32)
    view = facing()
    picture = draw(chapter, quad_scene(replace(UNLIT, base_color=(0.5, 1, 1, 1)), colors=colors), view=view)
    picture = picture * exposure(view.ev100)
    x, y = pixel_centres()
    # Two triangles: (a, b, c) below the diagonal, (a, c, d) above it; interpolation is linear in each.
    u, v = (x + 1) / 2, (y + 1) / 2
    a, b, c, d = colors[:, :3]
    below = a + (b - a) * u[..., None] + (c - b) * v[..., None]
    above = a + (d - a) * v[..., None] + (c - d) * u[..., None]
    expected = np.where((u >= v)[..., None], below, above) * (0.5, 1, 1)
    assert np.allclose(picture, expected, atol=1e-5)


@everywhere
def test_texture_transform_moves_turns_and_scales(chapter):
    """KHR_texture_transform: uv' = T R S uv, seen by a checker of which every texel has its own colour."""
    image = checker()
    transform = {"offset": (0.25, 0.5), "rotation": math.pi / 2, "scale": (0.5, 1.0)}
    material = replace(UNLIT, base_color_texture=texture(0, Sampler("nearest", "nearest", None), **transform))
    picture = draw(chapter, quad_scene(material, images=(image,)), "color")
    x, y = pixel_centres()
    u, v = (x + 1) / 2 * 0.5, (1 - y) / 2 * 1.0
    turned = np.stack([v + 0.25, -u + 0.5])  # a quarter turn takes (u, v) to (v, -u)
    texel = (np.floor(turned * 4).astype(int)) % 4
    assert np.abs(picture.astype(int) - image.pixels[texel[1], texel[0], :3]).max() <= 1


@pytest.mark.feature("device/push-constants")
@everywhere
def test_every_draw_has_its_own_transform(chapter):
    small = [np.diag((0.25, 0.25, 1.0, 1.0)) for _ in range(4)]
    for matrix, (x, y) in zip(small, ((-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)), strict=True):
        matrix[:2, 3] = x, y
    ids = draw(chapter, quad_scene(UNLIT, matrices=tuple(small), instance_materials=(0,) * 4), "instance_id")
    assert ids[4, 4] == 1
    assert ids[4, 12] == 2
    assert ids[12, 4] == 3
    assert ids[12, 12] == 4
    assert (ids > 0).sum() == 4 * 16
