"""The G-buffer: which targets it has, and that what is read back is the surface, exact within each format."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch04.settings import Settings
from chapters.ch04.shading.deferred import FORMATS, TARGETS
from common.images.color import encode_srgb
from common.scene import Image, Material
from common.settings import replaced
from common.view.camera import exposure
from tests.support.bounds import codes_off
from tests.support.scenes import facing, quad_scene, texture

SIZE = (16, 16)
DEFERRED = Settings(color_format="rgba32f", graph="deferred", gbuffer_format="half")
BASE, ROUGHNESS, METALLIC, EMISSIVE = (0.2, 0.5, 0.031), 0.37, 0.62, (3.0, 0.4, 0.01)
SURFACE = Material(base_color=(*BASE, 1.0), roughness=ROUGHNESS, metallic=METALLIC, emissive=EMISSIVE)


def tilted() -> tuple[np.ndarray, np.ndarray]:
    """Return the matrix of a large square that is turned about y and x, and its normal, which faces the camera."""
    a, b = 0.4, -0.3
    about_y = np.array([(np.cos(a), 0, np.sin(a)), (0, 1, 0), (-np.sin(a), 0, np.cos(a))])
    about_x = np.array([(1, 0, 0), (0, np.cos(b), -np.sin(b)), (0, np.sin(b), np.cos(b))])
    matrix = np.eye(4)
    matrix[:3, :3] = about_x @ about_y * 4.0
    return matrix, (about_x @ about_y)[:, 2]


def buffers(chapter, scene, settings, view=None):
    """Return what the G-buffer pass left in each target, by the target's name, as it is stored."""
    with chapter.open(scene, SIZE, settings, outputs={"depth"}, inspect=True) as renderer:
        frame = renderer.render(facing(4.0) if view is None else view)
        step = next(one for one in renderer.graph.steps if one.name == "gbuffer")
        names = [target.resource for target in (*step.colors, step.depth)]
        return {name: frame.image(f"gbuffer/{name}") for name in names}


@pytest.mark.feature("gbuffer/layout")
@pytest.mark.parametrize("kind", FORMATS)
def test_targets_stand_in_the_order_and_formats_of_the_table(chapter, kind):
    table = {
        "octahedral": ("rgba8_srgb", "r32ui", "rgba8", "rgba16f"),  # from chapter 7 on
        "compact": ("rgba8_srgb", "rgb10a2", "rgba8", "rgba16f"),
        "half": ("rgba8_srgb", "rgba16f", "rgba8", "rgba16f"),
        "full": ("rgba32f", "rgba32f", "rgba32f", "rgba32f"),
    }
    names = ("gbuffer_base_color", "gbuffer_normal", "gbuffer_material", "gbuffer_emissive")
    with chapter.open(quad_scene(SURFACE), SIZE, replaced(DEFERRED, gbuffer_format=kind)) as renderer:
        step = next(one for one in renderer.graph.steps if one.name == "gbuffer")
        made = [renderer.graph.resources[one.resource] for one in step.colors]
        assert tuple(one.name for one in made) == names
        assert tuple(one.format for one in made) == table[kind]
        assert step.depth is not None and step.depth.resource == "depth"
        assert not any("position" in name for name in renderer.graph.resources)


@pytest.mark.core
@pytest.mark.feature("gbuffer/layout")
def test_what_is_read_back_is_the_surface_to_half_a_step_of_each_format(chapter):
    """Codes of 8 bits are off by half a code, halves by 2^-12 of their value; and light arrives exposed."""
    matrix, normal = tilted()
    scene = quad_scene(SURFACE, matrices=(matrix,))
    view = facing(4.0, ev100=2.0)
    got = buffers(chapter, scene, DEFERRED, view)
    assert (got["depth"] > 0).all()
    half_code = codes_off(chapter.device) + 1e-3  # the shader's own rounding
    base = got["gbuffer_base_color"].astype(np.float64)
    # An encoder of colour may be an approximation: 0.6 of a code (tests/support/bounds.py); software was 0.516 off.
    assert np.abs(base[..., :3] - 255 * encode_srgb(BASE)).max() <= 0.6
    material = got["gbuffer_material"].astype(np.float64)
    truth = 255 * np.array((1.0, ROUGHNESS, METALLIC, 1.0))
    assert np.abs(material - truth).max() <= half_code
    step = 2.0**-11 if not chapter.device.capabilities.is_software else 2.0**-12 + 1e-6
    assert np.abs(got["gbuffer_normal"][..., :3].astype(np.float64) - normal).max() <= step
    sent = np.array(EMISSIVE) * exposure(2.0)
    assert (np.abs(got["gbuffer_emissive"][..., :3].astype(np.float64) - sent) <= 2 * step * sent).all()


@pytest.mark.feature("gbuffer/layout")
def test_a_normal_of_ten_bits_is_half_a_step_off_and_exact_where_it_is_upright(chapter):
    """Codes are 512 + 511 n, of 1023: half a step is 1/1022, and 0 and 1 are codes."""
    matrix, normal = tilted()
    for turned, truth, bound in (
        (matrix, normal, codes_off(chapter.device) / 511 + 1e-5),
        (np.eye(4), (0, 0, 1), 1e-6),
    ):
        scene = quad_scene(SURFACE, matrices=(turned,))
        stored = buffers(chapter, scene, replaced(DEFERRED, gbuffer_format="compact"), facing())[
            "gbuffer_normal"
        ]
        found = (stored[4:12, 4:12, :3].astype(np.float64) * 1023 - 512) / 511
        assert np.abs(found - truth).max() <= bound
        assert np.abs(found - np.roll(truth, 1)).max() > 0.1, "axes in another order are noticed"


def test_in_full_precision_it_is_the_surface_itself(chapter):
    matrix, normal = tilted()
    got = buffers(chapter, quad_scene(SURFACE, matrices=(matrix,)), replaced(DEFERRED, gbuffer_format="full"))
    assert (got["gbuffer_base_color"][..., :3] == np.float32(BASE)).all()
    assert (got["gbuffer_material"] == np.float32((1.0, ROUGHNESS, METALLIC, 1.0))).all()
    assert np.allclose(got["gbuffer_normal"][..., :3], normal, atol=3e-7)
    assert np.allclose(np.linalg.norm(got["gbuffer_normal"][..., :3], axis=-1), 1.0, atol=3e-7)


def test_textures_of_8_bits_arrive_as_they_are(chapter):
    """Colour is kept in the code that textures have it in: every texel comes out as the bytes that went in."""
    rng = np.random.default_rng(5)
    colour, factors = (rng.integers(0, 256, (16, 16, 4), np.uint8) for _ in range(2))
    material = Material(
        base_color_texture=texture(0),
        metallic_roughness_texture=texture(1),
        occlusion_texture=texture(1),
        metallic=1.0,
        roughness=1.0,
    )
    scene = quad_scene(material, images=(Image("colour", colour), Image("factors", factors)))
    got = buffers(chapter, scene, DEFERRED, facing())
    assert np.abs(got["gbuffer_base_color"][..., :3].astype(int) - colour[..., :3]).max() <= (
        0 if chapter.device.capabilities.is_software else 1
    )
    assert np.array_equal(got["gbuffer_material"][..., :3], factors[..., :3])


def test_an_unlit_surface_is_its_own_light_and_nothing_marks_the_background(chapter):
    scene = quad_scene(Material(unlit=True, base_color=(*BASE, 1.0)), matrices=(np.diag((0.5, 0.5, 1, 1)),))
    got = buffers(chapter, scene, replaced(DEFERRED, gbuffer_format="full"), facing())
    inside = got["depth"] > 0
    assert inside.sum() == 64
    assert (got["gbuffer_emissive"][inside][:, :3] == np.float32(BASE)).all()
    assert not got["gbuffer_material"][inside].any(), "its last number says that light does not count"
    assert not got["gbuffer_normal"][inside].any()
    assert not any(got[name][~inside].any() for name in TARGETS)


def test_the_back_of_a_double_sided_surface_has_a_normal_towards_the_eye(chapter):
    turned = np.diag((-1.0, 1.0, -1.0, 1.0))  # half a turn about y
    full = replaced(DEFERRED, gbuffer_format="full")
    got = buffers(chapter, quad_scene(Material(double_sided=True), matrices=(turned,)), full, facing())
    assert np.allclose(got["gbuffer_normal"][..., :3], (0.0, 0.0, 1.0), atol=1e-6)
