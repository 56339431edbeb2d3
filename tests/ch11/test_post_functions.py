"""Functions of the finished picture against float64, on both backends."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.either import evaluate
from tests.twins import finish as twin


@pytest.mark.feature("taa/sharpening")
def test_sharpening_is_the_books_formula_within_its_bounds(either_device):
    rng = np.random.default_rng(1)
    light = np.float32(10.0 ** rng.uniform(-30, 4.8, 4000))
    mean = np.float32(light * 10.0 ** rng.uniform(-1, 1, 4000))
    amount = np.float32(rng.uniform(0, 2, 4000))
    light[:50], mean[:20], amount[50:90] = 0.0, 0.0, 0.0
    got = evaluate(
        either_device,
        ["sharpen.glsl"],
        "factor = sharpening(light, mean, amount);",
        {"light": light, "mean": mean, "amount": amount},
        {"factor": "float"},
    )["factor"].astype(np.float64)
    L, m, a = (array.astype(np.float64) for array in (light, mean, amount))
    assert (got[:50] == 1).all() and (got[50:90] == 1).all()
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = np.where(L > 0, np.maximum(L + (L - m) * a, L / (1 + a)) / L, 1.0)
        printed = (L + (L - m) * a) / L
    np.testing.assert_allclose(got, wanted, rtol=2e-6)
    within = printed >= 1 / (1 + a)
    assert 0.3 < within[90:].mean() < 0.95
    np.testing.assert_allclose(got[within], printed[within], rtol=2e-6)


@pytest.mark.feature("taa/dithering")
def test_noise_is_that_of_whole_numbers_to_the_bit_and_follows_pixel_and_frame_alone(either_device):
    rng = np.random.default_rng(2)
    pixels = rng.integers(0, 16384, (2000, 2)).astype(np.uint32)
    frames = rng.integers(0, 10_000, 2000).astype(np.uint32)
    got = evaluate(
        either_device,
        ["dither.glsl"],
        "even = interleaved_gradient(pixel, number);",
        {"pixel": pixels, "number": frames},
        {"even": "float"},
    )["even"].astype(np.float64)
    wanted = [
        twin.interleaved_gradient(int(x), int(y), int(n)) for (x, y), n in zip(pixels, frames, strict=True)
    ]
    assert np.array_equal(got, wanted)
    # What is published, in fractions of 1: whole numbers over 2^32 are off by 53 * 16384 of them at most.
    x, y, n = pixels[:, 0], pixels[:, 1], frames % 64
    inner = np.mod(0.06711056 * (x + 5.588238 * n) + 0.00583715 * (y + 5.588238 * n), 1)
    apart = np.abs(got - np.mod(52.9829189 * inner, 1))
    assert np.minimum(apart, 1 - apart).max() < 53 * 16384 * 1.5 / 2**32


def dithered(either_device, code, even, steps):
    """Return (N, 3) dithered codes of 0 to 255 in float64; green is half of the code."""
    found = evaluate(
        either_device,
        ["dither.glsl"],
        f"shown = dithered_code(vec3(code, 0.5 * code, code), even, {steps});",
        {"code": np.float32(code), "even": np.float32(even)},
        {"shown": "vec3"},
    )
    return 255 * found["shown"].astype(np.float64)


@pytest.mark.feature("taa/dithering")
@pytest.mark.parametrize("steps", [1.0, 2.0])
def test_rounding_of_dithered_codes_has_the_code_as_its_mean(either_device, steps):
    """Also near black and white; over even numbers the mean is exact to their spacing.

    Results are whole codes, so no device rounds them to others: the twin's, but where its sum is a half within 32 bits.
    """
    even = np.float32((np.arange(4096) + 0.5) / 4096)
    values = np.array([0.0, 0.2, 0.5, 0.93, 1.4, 2.7, 100.25, 128.5, 200.1, 252.6, 253.9, 254.6, 255.0])
    code = np.float32(np.repeat(values / 255, len(even)))
    even = np.tile(even, len(values))
    got = dithered(either_device, code, even, steps)
    assert np.abs(got - np.rint(got)).max() < 1e-4
    wanted = twin.with_noise(np.stack([code, code / 2, code], -1), even, steps)
    assert np.abs(np.rint(got) - wanted).max() < 0.5 + 5e-5 * steps
    means = np.rint(got[:, 0]).reshape(len(values), -1).mean(1)
    assert np.abs(means - values).max() < 2 / 4096 * steps
    assert means[0] == 0 and means[-1] == 255


@pytest.mark.feature("taa/dithering")
@pytest.mark.parametrize("steps", [0.5, 1.0, 4.0])
def test_noise_leaves_the_ends_and_what_is_rounded_to_them(either_device, steps):
    """With the smallest and the largest noise, and codes that a transfer function may give instead of 0 and 1.

    A device may convert by up to 0.6 of a step instead of a half, so 0.4 from a whole code has to be enough.
    """
    even = np.float32([2.0**-24, 1e-5, 0.25, 0.5, 0.75, 1 - 1e-5, 1 - 2.0**-24])
    low = np.float32([0.0, 1e-9, 1e-7, 3e-6])
    code = np.repeat(np.concatenate([low, 1 - low]), len(even))
    got = dithered(either_device, code, np.tile(even, 2 * len(low)), steps).reshape(2, -1, 3)
    assert np.abs(got[0]).max() < 1e-4 and np.abs(got[1, :, ::2] - 255).max() < 1e-4
    beyond = dithered(either_device, np.full(len(even), 1 - 0.2 / 255), even, steps)[:, 0]
    assert set(np.rint(beyond)) == ({255.0} if steps < 0.9 else {254.0, 255.0})


@pytest.mark.feature("postprocess/fxaa")
def test_fxaa_of_3x3_lumas(either_device):
    """Contrast, bends and details of random lumas; a mirrored and a transposed square gives the same bits."""
    rng = np.random.default_rng(3)
    lumas = np.float32(rng.random((3000, 9)))
    lumas[:300] = np.round(lumas[:300] * 3) / 3
    body = """
    float around[9] = float[9](a.x, a.y, a.z, a.w, b.x, b.y, b.z, b.w, c);
    contrast = fxaa_contrast(around, 0.125, 0.04);
    bends = fxaa_bends(around);
    detail = fxaa_detail(around, max(contrast, 0.04), 0.75);
    """

    def run(square):
        square = np.ascontiguousarray(square.reshape(-1, 9))
        found = evaluate(
            either_device,
            ["fxaa.glsl"],
            body,
            {"a": square[:, :4].copy(), "b": square[:, 4:8].copy(), "c": square[:, 8].copy()},
            {"contrast": "float", "bends": "vec2", "detail": "float"},
        )
        return found["contrast"], found["bends"], found["detail"]

    squares = lumas.reshape(-1, 3, 3)
    contrast, bends, detail = run(squares)
    s = squares.astype(np.float64)
    five = np.stack([s[:, 1, 1], s[:, 0, 1], s[:, 2, 1], s[:, 1, 0], s[:, 1, 2]])
    most, range_ = five.max(0), five.max(0) - five.min(0)
    is_edge = range_ >= np.maximum(0.04, 0.125 * most)
    assert np.abs(contrast - np.where(is_edge, range_, 0)).max() < 1e-6 and not is_edge.all()
    second = [np.abs(np.diff(s, 2, axis=axis)).reshape(-1, 3) @ [1, 2, 1] for axis in (1, 2)]
    assert np.abs(bends - np.stack(second, -1)).max() < 2e-6
    tent = (s * np.outer([1, 2, 1], [1, 2, 1])).sum((1, 2)) - 4 * s[:, 1, 1]
    part = np.clip(np.abs(tent / 12 - s[:, 1, 1]) / np.maximum(np.where(is_edge, range_, 0), 0.04), 0, 1)
    assert np.abs(detail - 0.75 * (3 * part**2 - 2 * part**3) ** 2).max() < 1e-5
    for other in (squares[:, ::-1], squares[:, :, ::-1]):
        for old, new in zip((contrast, bends, detail), run(other), strict=True):
            assert np.array_equal(old, new)
    turned = run(squares.transpose(0, 2, 1))
    assert np.array_equal(bends[:, ::-1], turned[1])
    assert np.array_equal(contrast, turned[0]) and np.array_equal(detail, turned[2])


@pytest.mark.feature("postprocess/fxaa")
def test_fxaa_shifts_to_the_line_between_the_ends(either_device):
    """A step of an edge is a pixel high and n pixels long: the line through the middles covers 1/2 - (k - 1/2) / n."""
    ends = np.float32([[k, n + 1 - k] for n in range(1, 12) for k in range(1, n + 1)])
    found = evaluate(
        either_device,
        ["fxaa.glsl"],
        "both = fxaa_shift(ends, bvec2(true)); none = fxaa_shift(ends, bvec2(false));"
        "first = fxaa_shift(ends, bvec2(true, false));",
        {"ends": ends},
        {"both": "float", "none": "float", "first": "float"},
    )
    k, n = ends.min(1).astype(np.float64), ends.sum(1) - 1
    wanted = np.maximum(0.5 - (k - 0.5) / n, 0)
    assert np.abs(found["both"] - wanted).max() < 1e-6
    assert not found["none"].any()
    assert np.abs(found["first"] - np.where(ends[:, 0] < ends[:, 1], wanted, 0)).max() < 1e-6
