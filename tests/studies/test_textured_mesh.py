"""The study textured-mesh against texels that are known one by one, and against the chapter's own renderer."""

from __future__ import annotations

import math

import numpy as np
import pytest

import chapters
from chapters import studies
from chapters.ch01.settings import Settings as ChapterSettings
from chapters.ch01.studies.textured_mesh import Settings
from common.errors import UserError
from common.images.color import decode_srgb, encode_srgb
from common.numerics.transforms import rotation
from common.scene import Image, Material, Sampler, TextureRef
from common.view.camera import View
from tests.support.bounds import codes_off
from tests.support.drivers import needs_whole_quads
from tests.support.scenes import NEAREST, facing, quad_scene, translated

SIDE = 16
BACKGROUND = 255 * np.array([0.05, 0.05, 0.06])


def noise(side: int, seed: int = 1) -> np.ndarray:
    codes = np.random.default_rng(seed).integers(0, 256, (side, side, 4), dtype=np.uint8)
    codes[..., 3] = 255
    return codes


def pictured(pixels: np.ndarray, sampler: Sampler = NEAREST, **more):
    """Return the unit square with a picture, which `facing(1.0)` sees edge to edge."""
    material = Material(base_color_texture=TextureRef(0, sampler, **more))
    return quad_scene(material, images=(Image("noise", pixels),))


def box_level(pixels: np.ndarray, level: int) -> np.ndarray:
    """Return a mip level as light (h, w, 3), float64: means of squares of 2^level texels."""
    light = decode_srgb(pixels[..., :3] / 255.0)
    step = 1 << level
    height, width = light.shape[0] // step, light.shape[1] // step
    return light.reshape(height, step, width, step, 3).mean(axis=(1, 3))


@pytest.mark.feature("intro/textured-mesh")
def test_one_texel_a_pixel_is_the_texel_itself(stage):
    pixels = noise(SIDE)
    picture = stage.draw("textured-mesh", (SIDE, SIDE), 0.0, facing(1.0), scene=pictured(pixels))["color"]
    assert np.abs(picture.astype(int) - pixels[..., :3]).max() <= 1  # decoded and encoded again
    assert (picture == pixels[..., :3]).mean() > 0.99


@pytest.mark.feature("intro/textured-mesh")
@pytest.mark.parametrize("level", [1, 2, 3])
def test_a_smaller_picture_reads_the_mip_level_in_which_light_was_averaged(stage, level):
    pixels = noise(SIDE)
    side = SIDE >> level
    trilinear = Sampler("linear", "linear", "linear", "clamp", "clamp")
    picture = stage.draw("textured-mesh", (side, side), 0.0, facing(1.0), scene=pictured(pixels, trilinear))[
        "color"
    ]
    expected = 255 * encode_srgb(box_level(pixels, level))
    # Each level is kept in 8 bits, so every one of them rounds once more.
    assert np.abs(picture - expected).max() <= codes_off(stage.device) * (1 + level) + 0.5
    wrong = pixels[..., :3].reshape(side, 1 << level, side, 1 << level, 3).mean(axis=(1, 3))
    assert np.abs(picture - wrong).mean() > 5, "codes were averaged, not light"


def test_without_mip_levels_one_texel_of_many_is_shown(stage):
    pixels = noise(SIDE)
    picture = stage.draw("textured-mesh", (4, 4), 0.0, facing(1.0), scene=pictured(pixels))["color"]
    # A pixel's centre falls between texels 1 and 2 of its four: either may be taken.
    near = [pixels[y::4, x::4, :3].astype(int) for y in (1, 2) for x in (1, 2)]
    assert np.min([np.abs(picture - one).max(axis=-1) for one in near], axis=0).max() <= 1


def test_a_texture_transform_moves_the_picture(stage):
    pixels = noise(SIDE)
    scene = pictured(pixels, offset=(0.25, 0.0), scale=(0.5, 1.0))
    picture = stage.draw("textured-mesh", (SIDE, SIDE), 0.0, facing(1.0), scene=scene)["color"]
    columns = np.floor(0.25 * SIDE + 0.5 * (np.arange(SIDE) + 0.5)).astype(int)
    assert np.abs(picture.astype(int) - pixels[:, columns, :3]).max() <= 1


@pytest.mark.feature("intro/textured-mesh")
def test_equal_times_give_equal_frames_and_a_quarter_turn_shows_the_edge(stage):
    with stage.open("textured-mesh", (24, 24), pictured(noise(SIDE)), outputs=("color", "depth")) as renderer:
        frames = [renderer.render(facing(1.0), t) for t in (0.3, 0.3)]
        first, second = (frame.image("color") for frame in frames)
        edge_on = renderer.render(facing(1.0), math.pi / 2).image("depth")
        turned = renderer.render(facing(1.0), math.pi).image("color")
    assert (first == second).all()
    assert (edge_on > 0).mean() < 0.1  # a square from the side is a line at most
    expected = noise(SIDE)[:, ::-1, :3]  # from behind, mirrored
    columns = np.arange(24) * SIDE // 24
    centre = np.abs((np.arange(24) + 0.5) / 24 * SIDE % 1 - 0.5) < 0.4  # not at the border between texels
    shown = turned[centre][:, centre].astype(int)
    assert np.abs(shown - expected[columns][:, columns][centre][:, centre]).max() <= 1


@pytest.mark.feature("intro/textured-mesh")
@pytest.mark.parametrize("time", [0.0, 0.7, math.pi / 2])
def test_the_chapters_mesh_layer_gives_the_same_image(stage, time):
    """Two programs, one picture: pipelines, buffers, sets and matrices of the chapter are not those of the study."""
    needs_whole_quads(stage.device)  # which the chapter's coordinates suffer from, and the study's do not
    size = (40, 32)
    own = studies.load("1/textured-mesh", None)
    with stage.open("textured-mesh", size, own, outputs=("color", "depth")) as renderer:
        view = chapters.view_of(renderer)
        frame = renderer.render(view, time)
        color, depth = frame.image("color"), frame.image("depth")
    same = studies.load("1/textured-mesh", None)
    texture = same.materials[0].base_color_texture
    with same.edit() as change:
        change.set_transform(0, matrix=rotation((0.0, 1.0, 0.0), time))
        change.set_material(0, Material(base_color_texture=texture, unlit=True))
    settings = ChapterSettings(anisotropy=1.0, tone_curve="none", background=0.0)
    module = chapters.renderer_module(1, stage.backend)
    with module.Renderer(same, size, settings, device=stage.device, outputs=("color", "depth")) as chapter:
        frame = chapter.render(View(view.world_from_view, view.projection), 0.0)
        reference, reference_depth = frame.image("color"), frame.image("depth")
    covered = (depth > 0) & (reference_depth > 0)
    assert covered.mean() > 0.2
    assert ((depth > 0) != (reference_depth > 0)).sum() <= 2
    assert np.abs(depth - reference_depth)[covered].max() < 1e-6
    error = np.abs(color.astype(int) - reference)[covered].max(axis=-1)
    assert (error <= 1).mean() > 0.99 and error.max() <= 3  # other roundings of uv, over 64 edges of tiles


@pytest.mark.feature("intro/textured-mesh")
@pytest.mark.parametrize(("name", "time"), [("textured-mesh", 0.0), ("textured-mesh-quarter", math.pi / 2)])
def test_it_looks_as_it_did(stage, golden, name, time):
    frame = stage.draw("textured-mesh", (64, 48), time, outputs=("color", "depth"))
    covered = float((frame["depth"] > 0).mean())
    if stage.backend == "vulkan":
        golden(name, frame["color"], stage.device.capabilities, coverage=covered)
    assert 0.1 < covered < 0.5


def test_far_from_the_origin_the_picture_is_the_same(stage):
    at = np.array([1e5, -3e4, 7e4])
    pixels = noise(SIDE)
    scene, view = pictured(pixels), facing(1.0)
    there = View(translated(*at) @ view.world_from_view, view.projection)
    moved = quad_scene(scene.materials[0], matrices=(translated(*at),), images=(Image("noise", pixels),))
    here = stage.draw("textured-mesh", (SIDE, SIDE), 0.0, view, scene=scene)["color"]
    assert (stage.draw("textured-mesh", (SIDE, SIDE), 0.0, there, scene=moved)["color"] == here).all()


def test_the_first_object_with_a_picture_is_drawn_or_the_one_that_was_named(stage):
    plain, picture = (
        Material(base_color=(0.0, 0.5, 0.0, 1.0)),
        Material(base_color_texture=TextureRef(0, NEAREST)),
    )
    scene = quad_scene(
        matrices=(np.eye(4), np.eye(4)),
        materials=(plain, picture),
        instance_materials=(0, 1),
        images=(Image("noise", noise(4)),),
    )
    chosen = stage.draw("textured-mesh", (4, 4), 0.0, facing(1.0), scene=scene)["color"]
    assert np.abs(chosen.astype(int) - noise(4)[..., :3]).max() <= 1
    named = stage.draw("textured-mesh", (4, 4), 0.0, facing(1.0), scene=scene, settings=Settings(instance=0))
    assert (named["color"] == [0, round(255 * encode_srgb(0.5)), 0]).all()
    with pytest.raises(UserError, match="objects are 0 to 1"):
        stage.open("textured-mesh", (4, 4), scene, settings=Settings(instance=2))
