"""Tiling gradient noise of `shaders/gradient_noise.glsl` against float64 and against what makes it gradient noise."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.either import evaluate
from tests.twins import noise

NOISE = ["gradient_noise.glsl"]
ULP = 2.0**-24
"""Half a step of float32 at 1: what rounding may add to a result near 1."""

ONE = 512 * ULP
"""Bound of one octave. The fade's sum t (6 t - 15) + 10 has terms of up to 15, each rounded: 40 ULP. It multiplies the
difference of two products of up to 2 in size: a step between corners adds up to 160 ULP, and there are three."""


def pcg3d(x, y, z):
    """Return the three words of a hash in Python's own whole numbers."""
    word = 2**32
    x, y, z = ((one * 1664525 + 1013904223) % word for one in (x, y, z))
    x = (x + y * z) % word
    y = (y + z * x) % word
    z = (z + x * y) % word
    x, y, z = (one ^ one >> 16 for one in (x, y, z))
    x = (x + y * z) % word
    y = (y + z * x) % word
    z = (z + x * y) % word
    return [x, y, z]


def test_the_hash_is_that_of_whole_numbers(either_device):
    words = np.random.default_rng(1).integers(0, 2**32, (300, 3), dtype=np.uint32)
    words[:4] = [[0, 0, 0], [1, 2, 3], [2**32 - 1] * 3, [4, 0, 2**31]]
    exact = [pcg3d(*map(int, row)) for row in words]
    got = evaluate(either_device, NOISE, "hashed = pcg3d(words);", {"words": words}, {"hashed": "uvec3"})
    assert np.array_equal(got["hashed"], exact)
    assert np.array_equal(noise.pcg3d(words), exact)


@pytest.mark.parametrize("period", [4, 32, 256])
def test_noise_is_that_of_float64(either_device, period):
    rng = np.random.default_rng(period)
    # Multiples of 2^-12: the part within a cell is exact in float32, so the texts get the same points.
    points = np.float32(np.round(rng.uniform(-period, 2 * period, (4000, 3)) * 4096) / 4096)
    body = f"value = gradient_noise(point, {period}u, 11u);"
    got = evaluate(either_device, NOISE, body, {"point": points}, {"value": "float"})["value"]
    assert np.abs(got - noise.gradient_noise(points, period, 11)).max() < ONE
    assert np.abs(got).max() > 0.5 and got.std() > 0.15


def test_noise_is_zero_at_corners_and_has_the_lattice_s_gradients_there(either_device):
    """Just beside a corner the value is gradient times offset, to the square of the offset's length."""
    corners = np.indices((4, 4, 4)).reshape(3, -1).T.astype(np.float32)
    steps = np.float32([(0, 0, 0), (2**-10, 0, 0), (0, 2**-10, 0), (0, 0, 2**-10)])
    points = (corners[:, None] + steps).reshape(-1, 3)
    body = "value = gradient_noise(point, 4u, 3u);"
    got = evaluate(either_device, NOISE, body, {"point": points}, {"value": "float"})["value"].reshape(-1, 4)
    assert not got[:, 0].any()
    slopes = got[:, 1:] * 1024
    assert np.abs(slopes - noise.gradients(corners, 4, 3)).max() < 1e-2
    assert {tuple(row) for row in np.round(np.abs(slopes))} == {(1, 1, 0), (1, 0, 1), (0, 1, 1)}


def texels(size):
    """Return the coordinates (size^3, 3) of the centres of a volume's texels."""
    z, y, x = np.indices((size, size, size)).reshape(3, -1)
    return np.float32((np.stack([x, y, z], axis=1) + 0.5) / size)


def volume(device, uvw, octaves=7, frequency=4):
    body = f"value = octaves_of_noise(uvw, {frequency}u, {octaves}, 5u);"
    return evaluate(device, NOISE, body, {"uvw": np.float32(uvw)}, {"value": "float"})["value"]


def test_seven_octaves_tile_across_all_faces(either_device):
    """The same bits one volume on, in each axis and all at once, also before zero; not half a volume on."""
    uvw = texels(16)[::3]
    here = volume(either_device, uvw)
    for step in np.vstack([np.eye(3), -np.eye(3), [(1, 1, 1), (-1, 2, 0)]]):
        assert np.array_equal(volume(either_device, uvw + np.float32(step)), here)
    for step in 0.5 * np.eye(3):
        assert np.abs(volume(either_device, uvw + np.float32(step)) - here).max() > 0.2


def test_seven_octaves_are_those_of_float64(either_device):
    """Octaves err as one does: they are averaged. Sum, division and mapping round a few times more."""
    uvw = np.concatenate(
        [texels(64)[::61], np.float32(np.random.default_rng(2).integers(0, 4096, (2000, 3)) / 4096)]
    )
    got = volume(either_device, uvw)
    assert np.abs(got - noise.octaves_of_noise(uvw, 4, 7, 5)).max() < ONE / 2 + 8 * ULP
    assert got.min() >= 0.0 and got.max() <= 1.0
    assert got.mean() == pytest.approx(0.5, abs=0.02)


def test_a_face_goes_on_in_the_opposite_one(either_device):
    """Steps from the last layer of texels to the first are as those within: without tiling they are larger."""
    size = 32
    values = volume(either_device, texels(size), octaves=3).reshape(size, size, size)
    for axis in range(3):
        steps = np.abs(np.diff(values, axis=axis, append=np.take(values, [0], axis)))
        inner, seam = np.split(np.moveaxis(steps, axis, 0), [size - 1])
        assert seam.mean() < 1.5 * inner.mean()
        cut = np.take(values, range(size * 3 // 8), axis)
        jump = np.abs(np.take(cut, 0, axis) - np.take(cut, -1, axis))
        assert jump.mean() > 1.5 * inner.mean(), "a part of the volume does not tile"


def test_octaves_are_independent_and_seeds_differ(either_device):
    uvw = texels(16)
    parts = []
    for seed in (5, 6, 7):
        body = f"value = gradient_noise(uvw * 4.0, 4u, {seed}u);"
        parts.append(evaluate(either_device, NOISE, body, {"uvw": uvw}, {"value": "float"})["value"])
    # 64 gradients of each lattice are independent: correlations deviate by about 1 / sqrt(64).
    assert np.abs(np.corrcoef(parts) - np.eye(3)).max() < 0.5
