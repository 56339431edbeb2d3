"""The study textured-quads: exact rectangles, exact texels, and depth that is a distance again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch01.studies.textured_quads import (
    CAPACITY,
    NEAR,
    RECORD,
    Quad,
    Settings,
    depth_texels,
    quads_for,
)
from common.errors import UserError
from common.view.camera import Perspective, View
from tests.support import gl_functions, gpu_functions
from tests.support.bounds import codes_off

INCLUDE = "../chapters/ch01/studies/textured_quads/linear.glsl"
SIZE = (48, 40)
BACKGROUND = np.rint(255 * np.array([0.05, 0.05, 0.06])).astype(int)
VIEW = View(np.eye(4), Perspective())


def noise(width: int, height: int) -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (height, width, 4), dtype=np.uint8)


def drawn(stage, monkeypatch, quads, picture, depth=None, **more):
    """Return the picture (H, W, 3) of the given quads, which show the given textures."""
    from chapters import renderer_module

    depth = np.zeros((1, 1, 1), np.float32) if depth is None else depth
    module = renderer_module("1/textured-quads", stage.backend)
    monkeypatch.setattr(module.Renderer, "texels", staticmethod(lambda: (picture, depth)))
    monkeypatch.setattr(module.Renderer, "quads_for", staticmethod(lambda size: quads))
    return stage.draw("textured-quads", SIZE, 0.0, VIEW, **more)["color"].astype(int)


@pytest.mark.feature("debug-draw/textured-quads")
@pytest.mark.parametrize("place", [(0, 0), (5, 7), (48 - 17, 40 - 11)])
def test_a_quad_covers_its_rectangle_and_shows_each_texel_in_one_pixel(stage, monkeypatch, place):
    texels = noise(17, 11)
    picture = drawn(stage, monkeypatch, [Quad(*place, 17, 11, "picture")], texels)
    expected = np.tile(BACKGROUND, (SIZE[1], SIZE[0], 1))
    expected[place[1] : place[1] + 11, place[0] : place[0] + 17] = texels[..., :3]
    assert (picture == expected).all()


@pytest.mark.feature("debug-draw/textured-quads")
def test_a_larger_quad_repeats_texels_and_a_later_one_lies_on_top(stage, monkeypatch):
    texels = noise(5, 4)
    quads = [Quad(2, 3, 15, 12, "picture"), Quad(10, 8, 5, 4, "picture"), Quad(40, 30, 20, 20, "picture")]
    picture = drawn(stage, monkeypatch, quads, texels)
    expected = np.tile(BACKGROUND, (60, 60, 1))
    expected[3:15, 2:17] = texels[..., :3].repeat(3, axis=0).repeat(3, axis=1)
    expected[8:12, 10:15] = texels[..., :3]
    expected[30:50, 40:60] = texels[..., :3].repeat(5, axis=0).repeat(4, axis=1)
    assert (picture == expected[: SIZE[1], : SIZE[0]]).all()


@pytest.mark.feature("debug-draw/textured-quads")
def test_depth_is_shown_as_the_distance_it_was_made_of(stage, monkeypatch):
    far = 8.0
    distance = np.random.default_rng(4).uniform(NEAR, 1.3 * far, (9, 12))
    distance[0, :3] = NEAR, far, np.inf
    # Depth by the projection matrix, not by a formula of the study.
    finite = np.where(np.isinf(distance), 1.0, distance)
    zero = np.zeros_like(finite)
    seen = np.stack([zero, zero, -finite, zero + 1])
    clip = np.einsum("ij,jhw->ihw", Perspective(0.8, NEAR).clip_from_view(1.0), seen)
    depth = np.where(np.isinf(distance), 0.0, clip[2] / clip[3]).astype(np.float32)[..., None]
    quads = [Quad(3, 2, 12, 9, "depth"), Quad(20, 2, 12, 9, "picture")]
    texels = noise(12, 9)
    picture = drawn(stage, monkeypatch, quads, texels, depth, settings=Settings(far=far))
    expected = 255 * np.minimum(distance / far, 1.0)
    assert np.abs(picture[2:11, 3:15] - expected[..., None]).max() <= codes_off(stage.device) + 0.01
    assert (picture[2, 4:6] == 255).all() and picture[2, 3, 0] == round(255 * NEAR / far)
    assert (picture[2:11, 20:32] == texels[..., :3]).all()


@pytest.mark.feature("debug-draw/textured-quads")
def test_the_formula_in_double_precision(stage):
    rng = np.random.default_rng(5)
    near, far = rng.uniform(0.01, 1, 200), rng.uniform(1, 1000, 200)
    depth = np.concatenate([[0.0, 1.0], 10 ** rng.uniform(-6, 0, 198)])
    inputs = {name: values.astype(np.float32) for name, values in (("d", depth), ("n", near), ("f", far))}
    evaluate = gpu_functions.evaluate if stage.backend == "vulkan" else gl_functions.evaluate
    got = evaluate(stage.device, [INCLUDE], "s = shown_depth(d, n, f);", inputs, {"s": "float"})["s"]
    d, n, f = (values.astype(np.float64) for values in inputs.values())
    with np.errstate(divide="ignore"):
        truth = np.minimum(n / d / f, 1.0)
    assert np.abs(got / truth - 1).max() < 1e-6 and 0.1 < (got == 1).mean() < 0.9


def test_what_is_shown_by_itself_is_a_floor_a_ball_and_sky():
    depth = depth_texels()[..., 0].astype(np.float64)
    assert (depth[0] == 0).all()  # the sky
    assert np.isclose(NEAR / depth[48, 48], 2.3, atol=2e-3)  # 3 m less its radius
    assert np.isclose(NEAR / depth[-1, 0], 0.5 / math.tan(math.radians(25)) / (1 - 1 / 96), rtol=1e-6)


@pytest.mark.feature("debug-draw/textured-quads")
def test_no_quads_are_no_draw_and_too_many_are_refused(stage, monkeypatch):
    assert RECORD.itemsize == 32
    assert (drawn(stage, monkeypatch, [], noise(2, 2)) == BACKGROUND).all()
    many = [Quad(0, 0, 2, 2, "picture")] * (CAPACITY + 1)
    with pytest.raises(UserError, match="256 quads at most, not 257"):
        drawn(stage, monkeypatch, many, noise(2, 2))
    assert (drawn(stage, monkeypatch, many[1:], noise(2, 2))[2:, 2:] == BACKGROUND).all()


@pytest.mark.parametrize(
    "size", [(640, 360), (1920, 1080), (256, 400), (300, 300), (400, 220), (220, 1000), (3840, 2160)]
)
def test_the_quads_of_a_picture_lie_within_it_and_apart(size):
    """Each pixel is counted once for each quad over it; both textures are there by the texel and larger."""
    covered = np.zeros((size[1], size[0]), int)
    quads = quads_for(size)
    for quad in quads:
        assert quad.x >= 0 and quad.y >= 0 and quad.width > 0 and quad.height > 0
        assert quad.x + quad.width <= size[0] and quad.y + quad.height <= size[1]
        covered[quad.y : quad.y + quad.height, quad.x : quad.x + quad.width] += 1
    assert covered.max() == 1
    assert sorted(quad.shows for quad in quads) == ["depth", "depth", "picture", "picture"]
    assert [(quad.width, quad.height) for quad in quads[::2]] == [(96, 96)] * 2
