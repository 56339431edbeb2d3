"""Frames with shading rates: what a mask holds, which pixels are lit by it, and what a frame without one has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch09.rates.model import EDGE_TILE, KEPT, LAST, TEXEL, WHOLE
from chapters.ch09.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Image, Light, Material
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.scenes import facing, quad_scene, texture
from tests.support.shadows import PLAIN, point, spot, yard
from tests.twins import rates as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (151, 93)  # no multiple of a texel, a block or a work group
BASE = Settings(**PLAIN, graph="compute", shadows="off", rate_policy="sobel", rate_texel=TEXEL)
LAMPS = (spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8)))
VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
MASK, EDGES, LIT = "rate_mask/rates", "rate_edges/history_rates", "lighting_compute/color_lit"


def opened(chapter, scene, size=SIZE, inspect=True, **turned):
    return chapter.open(
        scene, size, replaced(BASE, **turned), outputs={"color", "color_linear"}, inspect=inspect
    )


def codes(frame, name=MASK):
    """Return the codes of a mask, (rows, columns)."""
    image = frame.image(name)
    return image.reshape(image.shape[:2]).astype(np.int64)


def frames(chapter, scene, count=3, **turned):
    """Return the light, the mask and the edges of some frames of a view that stands still."""
    found = []
    with opened(chapter, scene, **turned) as renderer:
        for _ in range(count):
            frame = renderer.render(VIEW)
            found.append((frame.image("color_linear"), codes(frame), codes(frame, EDGES)))
    return found


@pytest.fixture(scope="module")
def scene():
    return yard(*LAMPS)


def by_pixel(mask, size=SIZE, texel=TEXEL):
    """Return (H, W) the code of each pixel."""
    return np.kron(mask, np.ones((texel, texel), np.int64))[: size[1], : size[0]]


# --- what is lit ---


@pytest.mark.feature("vrs/software")
@pytest.mark.parametrize(
    ("coarse", "texel"),
    [("2x2", 16), pytest.param("4x4", 16, marks=pytest.mark.core), ("2x2", 2), ("4x4", 8)],
)
def test_blocks_have_the_light_of_one_pixel_and_all_others_their_own(chapter, scene, coarse, texel):
    """Bit for bit, against a frame in which each pixel is lit."""
    full = opened(chapter, scene, rate_policy="none", inspect=False)
    with full as renderer:
        whole = renderer.render(VIEW).image("color_linear")
    knobs = {"rate_coarse": coarse, "rate_texel": texel, "rate_threshold": 2.0, "rate_surface": 0.5}
    found, mask, _ = frames(chapter, scene, **knobs)[-1]
    block = int(coarse[0])
    assert set(np.unique(mask)) == {0, 5 if block == 2 else 10}
    rate = by_pixel(mask, texel=texel)
    y, x = np.indices(rate.shape)
    rows, columns = (
        np.where(rate > 0, np.minimum(at // block * block + block // 2, most - 1), at)
        for at, most in ((y, SIZE[1]), (x, SIZE[0]))
    )
    assert np.array_equal(found, whole[rows, columns])
    assert not np.array_equal(found, whole)


@pytest.mark.feature("vrs/texel-size-reduction")
@pytest.mark.parametrize("size", [(151, 93), (64, 48), (16, 16), (5, 3), (17, 1)])
def test_a_mask_covers_the_picture(chapter, scene, size):
    with opened(chapter, scene, size=size) as renderer:
        mask = codes(renderer.render(VIEW))
    assert mask.shape == (-(-size[1] // TEXEL), -(-size[0] // TEXEL))
    assert (mask == 0).all()  # of a first frame: no picture came before it


@pytest.mark.feature("vrs/detection-and-fallback")
def test_without_a_policy_there_is_no_mask(chapter, scene):
    with opened(chapter, scene, rate_policy="none") as renderer:
        frame = renderer.render(VIEW)
        assert not [name for name in renderer.inspection.names if "rate" in name]
        assert not [name for name in renderer.graph.resources if "rates" in name]
        bare = frame.image("color_linear")
    with opened(chapter, scene, graph="compute", rate_threshold=0.0, rate_surface=0.0) as renderer:
        for _ in range(2):
            frame = renderer.render(VIEW)
        assert np.array_equal(frame.image("color_linear"), bare) or (codes(frame) > 0).any()


def test_views_and_multisampling_have_no_mask(chapter, scene):
    for turned in ({"view": "normal"}, {"msaa": 4}):
        with opened(chapter, scene, inspect=False, **turned, graph="auto") as renderer:
            renderer.render(VIEW).image("color")
            assert not [name for name in renderer.graph.resources if "rates" in name]


# --- what the mask follows ---


@pytest.mark.feature("vrs/sobel-mask")
def test_edges_are_those_of_a_gradient_in_float64(chapter, scene):
    """In texels with no gradient within 1e-5 of the threshold: codes of luminance are right to some units of 2^-24."""
    with opened(chapter, scene) as renderer:
        frame = renderer.render(VIEW)
        light, edges = frame.image("color_linear").astype(np.float64), codes(frame, EDGES)
    squared = twin.squared_gradient(twin.luminance_code(light))
    most = twin.most_of_texels(squared, TEXEL)
    sure = twin.most_of_texels(-abs(squared - 0.1), TEXEL) < -1e-5
    assert sure.mean() > 0.8 and (edges == 0)[sure].any() and (edges == 5)[sure].any()
    assert np.array_equal((edges == 0)[sure], (most > 0.1)[sure])


@pytest.mark.feature("vrs/sobel-mask")
def test_a_tile_shows_no_seam(chapter, scene):
    """Gradients at the borders of a work group's tile are those of the whole picture, as thresholds tell.

    With tiles that end with their own pixels some texels would have another gradient.
    """
    with opened(chapter, scene) as renderer:
        code = twin.luminance_code(renderer.render(VIEW).image("color_linear").astype(np.float64))
    whole, apart = twin.squared_gradient(code), np.zeros_like(code)
    tile, texel = EDGE_TILE, 4
    for row, column in np.ndindex(-(-code.shape[0] // tile), -(-code.shape[1] // tile)):
        own = np.s_[row * tile : (row + 1) * tile, column * tile : (column + 1) * tile]
        apart[own] = twin.squared_gradient(code[own])
    most, of_tiles = (twin.most_of_texels(squared, texel) for squared in (whole, apart))
    seams = (most > 1.5 * of_tiles) & (most > 1e-3)
    assert seams.sum() > 3, "the greatest gradient of some texels lies at a border"
    for threshold in np.sort(np.sqrt(most * of_tiles)[seams])[::2]:
        sure = abs(most - threshold) > 1e-5
        with opened(chapter, scene, rate_texel=texel, rate_threshold=float(threshold)) as renderer:
            edges = codes(renderer.render(VIEW), EDGES) == 0
        assert np.array_equal(edges[sure], (most > threshold)[sure])
        assert not np.array_equal(edges, of_tiles > threshold)


@pytest.mark.feature("vrs/sobel-mask")
def test_each_texel_is_lit_in_full_within_eight_frames(chapter, scene):
    """And in no frame are all of those texels of which nothing else asks it."""
    masks = [mask for _, mask, _ in frames(chapter, scene, 9, rate_threshold=32.0, rate_surface=1.0)][1:]
    turns = np.stack([mask == 0 for mask in masks])
    assert (turns.sum(axis=0) >= 1).all() and (turns.mean(axis=(1, 2)) < 0.9).all()


@pytest.mark.feature("vrs/sobel-mask")
@pytest.mark.parametrize("texel", [0, 16])
def test_a_mask_is_kept_while_nothing_changes(chapter, scene, texel):
    """It is that of the edges of a whole picture. All frames from then on are equal, and a step of the view ends it."""
    with opened(chapter, scene, rate_texel=texel, rate_surface=1.0) as renderer:
        side = texel or 2
        for count in range(KEPT + 4):
            frame = renderer.render(VIEW)
            mask, picture = codes(frame), frame.image("color_linear")
            assert renderer.idle(VIEW) == (count >= KEPT)
            if count == WHOLE:
                assert (mask == 0).all()
                squared = twin.squared_gradient(twin.luminance_code(picture.astype(np.float64)))
            elif count == LAST:
                kept = mask, picture
            elif count > LAST:
                assert np.array_equal(mask, kept[0]) and np.array_equal(picture, kept[1])
        most = twin.most_of_texels(squared, side)
        assert (mask == 0)[most > 0.1 + 1e-5].all() and (mask > 0).mean() > 0.3
        moved = View(pose_looking_at((3.0, 2.5, 4.1), (0.0, 0.4, 0.0)), VIEW.projection)
        renderer.render(moved)
        assert not renderer.idle(moved)
        mask = codes(renderer.render(moved))
        assert (mask == 0).mean() > (most > 0.1).mean()  # some texels have their turn again


@pytest.mark.feature("vrs/sobel-mask")
@pytest.mark.parametrize(("dark_s", "frames"), [(0.0, 40), (0.3, 400)])
def test_a_mask_is_kept_once_an_exposure_has_adapted(chapter, dark_s, frames):
    """Both come to rest, and the mask is kept only when the picture stays as it is."""
    scene, step = yard(*LAMPS), 1 / 30
    knobs = {"exposure": "histogram", "adapt_dark_s": dark_s, "adapt_bright_s": dark_s}
    with opened(chapter, scene, size=(48, 32), inspect=False, **knobs) as renderer:
        technique, kept = renderer.techniques["rates"], []
        for number in range(frames):
            renderer.render(VIEW, number * step)
            kept.append(technique.resting(0.0))
            if renderer.idle(VIEW, (number + 1) * step):
                break
        assert renderer.idle(VIEW, frames * step), "the picture rests"
        adapted = next(number for number in range(frames) if number * step >= dark_s)
        assert kept[-1] and not any(kept[:adapted]), "a mask is not kept while the exposure changes"


@pytest.mark.feature("vrs/rate-policies")
@pytest.mark.parametrize("radius", [0.0, pytest.param(0.3, marks=pytest.mark.core), 4.0])
def test_a_radial_mask_lights_each_pixel_near_the_middle(chapter, scene, radius):
    with opened(chapter, scene, rate_policy="radial", rate_radius=radius) as renderer:
        frame = renderer.render(VIEW)
        mask = codes(frame)
        assert EDGES not in renderer.inspection.names
    y, x = np.indices((SIZE[1], SIZE[0])) + 0.5
    away = np.hypot(x - SIZE[0] / 2, y - SIZE[1] / 2) / SIZE[1]
    wanted = twin.most_of_texels(-away, TEXEL) >= -radius
    assert np.array_equal(mask == 0, wanted)


@pytest.mark.feature("vrs/rate-policies")
def test_another_policy_changes_the_kernel_of_the_mask_and_nothing_else(chapter, scene):
    """All other passes, images and pipelines are the same. Edges are found for the policy that reads them."""
    found = {}
    for policy in ("sobel", "radial"):
        with opened(chapter, scene, inspect=False, rate_policy=policy) as renderer:
            renderer.render(VIEW).image("color")
            images = {
                (name, kept.format, kept.size)
                for name, kept in renderer.graph.resources.items()
                if "history" not in name
            }
            pipelines = {built.described for it in renderer.passes for built in it.pipelines}
            found[policy] = [step.name for step in renderer.graph.steps], images, pipelines
    (steps, images, pipelines), (of_radial, *others) = found["sobel"], found["radial"]
    assert sorted(steps) == sorted([*of_radial, "rate_edges"]) and images == others[0]
    differ = pipelines ^ others[1]
    assert sorted(described.name for described in differ) == ["rate_edges", "rate_mask", "rate_mask"]
    masks = [described for described in differ if described.name == "rate_mask"]
    assert masks[0].shader == masks[1].shader and masks[0].defines != masks[1].defines


@pytest.mark.feature("vrs/sobel-mask")
def test_a_texture_that_fades_in_is_found_within_eight_frames(chapter):
    """A pattern of two pixels shows each block the same, so no coarse picture has an edge of it.

    The G-buffer is not asked here. In its turn a texel is lit in full, its edges are found, and it stays so.
    """
    side = 64
    codes_ = np.zeros((side, side, 4), np.uint8)
    codes_[..., 3], codes_[:, ::2, :3] = 255, 255
    material = Material(roughness=1.0, metallic=0.0, base_color_texture=texture(0))
    scene = quad_scene(
        material, lights=(Light("directional", 0, intensity=0.0),), images=(Image("lines", codes_),)
    )
    view, knobs = facing(), {"rate_surface": 1.0}
    with opened(chapter, scene, size=(side, side), **knobs) as renderer:
        for _ in range(3):
            before = codes(renderer.render(view))
        assert (before == 5).mean() > 0.5  # it is dark
        with scene.edit() as edit:
            edit.set_light(0, replace(scene.lights[0], intensity=3.0))
        masks = []
        for _ in range(10):
            frame = renderer.render(view)
            masks.append(codes(frame) == 0)
        found = frame.image("color_linear")
    stays = np.logical_and.accumulate(np.stack(masks)[::-1])[::-1]
    assert stays[8].all() and not stays[0].all()
    with opened(chapter, scene, size=(side, side), rate_policy="none", inspect=False) as renderer:
        assert np.array_equal(renderer.render(view).image("color_linear"), found) and found.std() > 0.1
