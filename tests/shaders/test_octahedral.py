"""Unit vectors as two numbers: the error of a round trip in each storage, and where it has to be none."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import gl_functions, gpu_functions

COUNT = 200_000


@pytest.fixture(params=["vulkan", "gl"])
def evaluate(request):
    """Return what runs functions on a backend."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    module = gpu_functions if vulkan else gl_functions
    return lambda *arguments: module.evaluate(device, *arguments)


STORED = {
    "float": ("code", 1e-6),
    "half": ("unpackHalf2x16(packHalf2x16(code))", np.radians(0.06)),
    "snorm16": ("unpackSnorm2x16(packSnorm2x16(code))", np.radians(0.004)),
}
"""How a code is kept, and the angle in radians by which it may turn a vector (the ledger states them)."""


def vectors():
    """Return (N, 3) float32 unit vectors: everywhere, and close to the folds of the octahedron."""
    rng = np.random.default_rng(11)
    n = rng.normal(size=(COUNT, 3))
    n[::5, 2] *= 1e-4  # the fold between the halves
    n[1::5, 0] *= 1e-5  # those between the triangles of a half
    n[2::5, :2] *= 1e-4  # the poles
    return (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)


def decoded(evaluate, n, stored):
    body = f"vec2 code = octahedral_from_unit(n); code = {stored}; back = unit_from_octahedral(code); kept = code;"
    got = evaluate(["octahedral.glsl"], body, {"n": n}, {"back": "vec3", "kept": "vec2"})
    return got["back"].astype(np.float64), got["kept"]


@pytest.mark.feature("gbuffer/octahedral-normals")
@pytest.mark.parametrize("name", STORED)
def test_a_round_trip_turns_a_vector_by_little(evaluate, name):
    stored, bound = STORED[name]
    n = vectors()
    back, code = decoded(evaluate, n, stored)
    exact = n.astype(np.float64)
    angle = np.arctan2(np.linalg.norm(np.cross(exact, back), axis=1), (exact * back).sum(axis=1))
    assert angle.max() <= bound
    assert (name == "float") == (angle.max() < 1e-6), "the storage is what loses"
    assert np.abs(code).max() <= 1.0


@pytest.mark.feature("gbuffer/octahedral-normals")
@pytest.mark.parametrize("name", STORED)
def test_axes_come_back_exactly_and_so_does_the_equator(evaluate, name):
    axes = np.float32([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
    axes = np.concatenate([axes, np.where(axes == 0, np.float32(-0.0), axes)])
    back, _ = decoded(evaluate, axes, STORED[name][0])
    assert np.array_equal(back, axes)
    angles = np.linspace(0, 2 * np.pi, 720, dtype=np.float64)
    around = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1).astype(np.float32)
    back, _ = decoded(evaluate, around, STORED["float"][0])
    # Two quotients below 1 are off by 2^-25 each, the sum that divides by 2^-24; the norm divides by at least 0.7.
    assert np.abs(back[:, 2]).max() <= (2 * 2**-25 + 2**-24) / 0.7


def test_a_vector_without_length_becomes_one(evaluate):
    back, code = decoded(evaluate, np.zeros((4, 3), np.float32), STORED["float"][0])
    assert np.array_equal(back, np.tile((0.0, 0.0, 1.0), (4, 1))) and not code.any()


@pytest.mark.feature("gbuffer/octahedral-normals")
def test_the_printed_fold_is_another_one(evaluate):
    """With sign(0) = 0 in place of 1, a vector straight down would decode to one straight up: the code is (0, 0)."""
    body = "vec2 p = (1.0 - abs(n.yx)) * sign(n.xy); back = unit_from_octahedral(p);"
    down = np.float32([(0, 0, -1)])
    got = evaluate(["octahedral.glsl"], body, {"n": down}, {"back": "vec3"})
    assert not np.array_equal(got["back"], down)
