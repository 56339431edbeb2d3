"""Barycentrics, their derivatives, levels of textures and frames without tangents, against double precision."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch07.pipelines.vulkan import CHAPTER
from tests.support.gpu_functions import evaluate
from tests.twins.visibility import barycentrics, differences, level

COUNT = 4000
PICTURE = (640, 360)
BARYCENTRICS, COTANGENT = (
    str(CHAPTER / "visibility" / name) for name in ("barycentrics.glsl", "cotangent.glsl")
)

WEIGHTS = """
    Barycentrics here = barycentrics_of(a, b, c, ndc, vec2(SIZE_X, SIZE_Y));
    at = here.at;
    dx = here.dx;
    dy = here.dy;
"""
FRAME = """
    Frame3 found = cotangent_frame(n, dp_x, dp_y, duv.xy, duv.zw);
    tangent = found.tangent;
    bitangent = found.bitangent;
"""


def weights_of(device, clip, ndc):
    """Return at, dx and dy (N, 3) of triangles (N, 3, 4) at places (N, 2), both float32."""
    inputs = {name: np.ascontiguousarray(clip[:, corner]) for corner, name in enumerate("abc")}
    defines = {"SIZE_X": 2.0 / PICTURE[0], "SIZE_Y": 2.0 / PICTURE[1]}
    outputs = dict.fromkeys(("at", "dx", "dy"), "vec3")
    got = evaluate(device, [BARYCENTRICS], WEIGHTS, {**inputs, "ndc": ndc}, outputs, defines)
    return got["at"], got["dx"], got["dy"]


def triangles(seed, pixels, count=COUNT, behind=False):
    """Return clip positions (N, 3, 4) float32 and a pixel in each: about `pixels` wide, with vertices at 1 to 100 m."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-0.9, 0.9, (count, 1, 2))
    angle = (
        rng.uniform(0, 2 * np.pi, (count, 1)) + np.array([0, 2.1, 4.2]) + rng.uniform(-0.5, 0.5, (count, 3))
    )
    around = np.stack([np.cos(angle), np.sin(angle)], axis=2) * np.asarray(pixels).reshape(-1, 1, 1)
    w = 10 ** rng.uniform(0, 2, (count, 1)) * rng.uniform(1, 3, (count, 3))
    places = middle + around / PICTURE
    clip = np.concatenate([places * w[..., None], np.full((count, 3, 1), 0.1), w[..., None]], axis=2)
    if behind:  # the line from the first vertex through the second, continued behind the eye
        clip[:, 2] = clip[:, 0] * 1.5 - clip[:, 1] * rng.uniform(1.2, 3.0, (count, 1)) + clip[:, 2] * 0.2
    clip = clip.astype(np.float32)
    weights = rng.dirichlet((2, 2, 2), count)
    place = np.einsum("ni,nij->nj", weights, clip[:, :, [0, 1, 3]].astype(float))
    return clip, (place[:, :2] / place[:, 2:]).astype(np.float32), place[:, 2]


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
@pytest.mark.parametrize("pixels", [2.0, 30.0, 400.0])
def test_weights_and_their_changes_are_those_of_finite_differences(vulkan_device, pixels):
    """A clip position is rounded to 2^-24 of w, a pixel is 2/640 of it: a weight in a triangle of 2 pixels is off by
    about 2^-24 * 320, and the 1e-4 of the ledger leaves room for a few of those."""
    clip, ndc, _ = triangles(1, pixels)
    found = weights_of(vulkan_device, clip, ndc)
    wide, place = clip.astype(float), ndc.astype(float)
    np.testing.assert_allclose(found[0], barycentrics(wide, place), atol=1e-4)
    for got, wanted in zip(found[1:], differences(wide, place, PICTURE), strict=True):
        assert np.abs(wanted).max() > 0.5 / pixels
        np.testing.assert_allclose(got, wanted, atol=1e-4, rtol=1e-4)


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
def test_a_vertex_behind_the_eye_is_as_good_as_any(vulkan_device):
    clip, ndc, w = triangles(2, 200.0, behind=True)
    wide = clip.astype(float)
    usable = (clip[:, 2, 3] < 0) & (w > 0.5) & (np.abs(ndc) < 1).all(axis=1)
    # Those that are not nearly edge-on: their weights would change by their whole range within a few pixels.
    usable &= np.linalg.cond(wide[:, :, [0, 1, 3]]) < 1e4
    assert usable.sum() > 100
    found = weights_of(vulkan_device, clip[usable], ndc[usable])
    np.testing.assert_allclose(found[0], barycentrics(wide[usable], ndc[usable].astype(float)), atol=1e-4)


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
def test_uv_and_position_change_as_finite_differences_say(vulkan_device):
    """Attributes are sums over the three vertices, so their changes are the same sums with the changes of weights."""
    clip, ndc, _ = triangles(3, np.random.default_rng(3).uniform(3.0, 300.0, COUNT))
    values = np.random.default_rng(4).uniform(-1, 1, (COUNT, 3, 5))  # uv and a position
    _, *changes = weights_of(vulkan_device, clip, ndc)
    for got, wanted in zip(changes, differences(clip.astype(float), ndc.astype(float), PICTURE), strict=True):
        mixed = [np.einsum("ni,nij->nj", of.astype(float), values) for of in (got, wanted)]
        np.testing.assert_allclose(*mixed, atol=1e-4)


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
def test_triangles_without_area_give_numbers(vulkan_device):
    """Points, lines, triangles seen from the edge, vertices on the eye, and those as far as floats go."""
    clip, ndc, _ = triangles(5, 20.0, 64)
    clip[0:8, 1] = clip[0:8, 0]
    clip[8:16] = clip[8:16, :1]
    clip[16:24, 2] = 0.5 * (clip[16:24, 0] + clip[16:24, 1])
    clip[24:32] = 0.0
    clip[32:40, :, 3] = 0.0
    clip[40:48] *= np.float32(1e-30)
    clip[48:56] *= np.float32(1e30)
    clip[56:64, 1] = clip[56:64, 0] * np.float32(1.0000001)
    for found in weights_of(vulkan_device, clip, ndc):
        assert np.isfinite(found).all()
    at = weights_of(vulkan_device, clip, ndc)[0]
    np.testing.assert_allclose(at.sum(axis=1), 1.0, atol=1e-3)
    assert (at >= -1.001).all() and (at <= 3.001).all(), "a sliver stands for its nearest point"


def planes(seed, count=COUNT):
    """Return normals and the gradients of u and v (N, 3) in the planes across them, skewed and mirrored."""
    rng = np.random.default_rng(seed)
    n, u, v = rng.normal(size=(3, count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    u, v = (it - n * (n * it).sum(axis=1, keepdims=True) for it in (u, v))
    return n, u, v, rng


@pytest.mark.feature("visibility-buffer/cotangent-frame")
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_a_frame_without_tangents_follows_the_gradients_of_a_known_mapping(vulkan_device, scale):
    """uv = (u . p, v . p): the tangent is along u, and the other vector on the side of v, from either face."""
    n, u, v, rng = planes(6)
    x, y = rng.normal(size=(2, COUNT, 3))
    x, y = (scale * (it - n * (n * it).sum(axis=1, keepdims=True)) for it in (x, y))
    # Seen nearly along the plane, x and y are nearly parallel, and the tangent is a small difference.
    area = np.abs((np.cross(x, y) * n).sum(axis=1)) / (np.linalg.norm(x, axis=1) * np.linalg.norm(y, axis=1))
    kept = area > 0.1
    n, u, v, x, y = (it[kept] for it in (n, u, v, x, y))
    duv = np.stack([(u * x).sum(1), (v * x).sum(1), (u * y).sum(1), (v * y).sum(1)], axis=1)
    inputs = {"n": n, "dp_x": x, "dp_y": y, "duv": duv}
    inputs = {name: np.float32(array) for name, array in inputs.items()}
    found = evaluate(vulkan_device, [COTANGENT], FRAME, inputs, {"tangent": "vec3", "bitangent": "vec3"})
    t, b = (found[name].astype(float) for name in ("tangent", "bitangent"))
    unit = u / np.linalg.norm(u, axis=1, keepdims=True)
    np.testing.assert_allclose(t, unit, atol=1e-4)
    for one, other, product in ((t, t, 1), (b, b, 1), (t, b, 0), (t, n, 0), (b, n, 0)):
        np.testing.assert_allclose((one * other).sum(axis=1), product, atol=2e-5)
    across = np.abs((b * v).sum(axis=1)) > 1e-3
    assert ((b * v).sum(axis=1)[across] > 0).all()


@pytest.mark.feature("visibility-buffer/cotangent-frame")
def test_a_uv_that_stands_still_has_no_frame(vulkan_device):
    n, _, _, rng = planes(7, 16)
    inputs = {
        "n": n,
        "dp_x": rng.normal(size=(16, 3)),
        "dp_y": rng.normal(size=(16, 3)),
        "duv": np.zeros((16, 4)),
    }
    inputs = {name: np.float32(array) for name, array in inputs.items()}
    found = evaluate(vulkan_device, [COTANGENT], FRAME, inputs, {"tangent": "vec3", "bitangent": "vec3"})
    assert not found["tangent"].any() and not found["bitangent"].any()


def test_the_level_of_the_twin_is_that_of_closed_forms():
    """A texel a pixel is level 0, two of them level 1; the longer of both gradients counts."""
    still = np.zeros(2)
    assert level(np.array([1 / 64, 0.0]), still, (64, 32)) == pytest.approx(0.0)
    assert level(still, np.array([0.0, 1 / 16]), (64, 32)) == pytest.approx(1.0)
    assert level(np.array([3 / 64, 4 / 32]), np.array([1 / 64, 0.0]), (64, 32)) == pytest.approx(np.log2(5.0))
