"""From object to clip space, `shaders/transform.glsl`, against float64 and against itself."""

from __future__ import annotations

import numpy as np

from backends.shader_text import build_text
from backends.vulkan.shaders.compiler import compile_shader
from tests.support.gpu_functions import evaluate

COUNT = 5000
EPSILON = 2.0**-24
"""Half a unit in the last place of 1: what one rounding may cost."""

POINT = "result = transform_point(mat3x4(row0, row1, row2), point);"
VECTOR = "result = transform_vector(mat3x4(row0, row1, row2), point);"
CLIP = """
    mat4 clip_from_view = mat4(c0, c1, c2, c3);
    mat4 view_from_world = mat4(v0, v1, v2, v3);
    clip = clip_position(clip_from_view, view_from_world, point);
"""


def affine_inputs(seed=1, scale=10.0):
    """Return rows (N, 4) of affine matrices and points (N, 3), of both signs and many sizes."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-3, 3, (COUNT, 1))
    rows = {f"row{i}": np.float32(rng.normal(size=(COUNT, 4)) * sizes) for i in range(3)}
    return {**rows, "point": np.float32(rng.normal(size=(COUNT, 3)) * scale)}


def test_points_are_within_the_roundings_of_a_dot_product(vulkan_device):
    inputs = affine_inputs()
    got = evaluate(vulkan_device, ["transform.glsl"], POINT, inputs, {"result": "vec3"})["result"]
    matrix = np.stack([inputs[f"row{i}"] for i in range(3)], axis=1).astype(np.float64)
    homogeneous = np.concatenate([inputs["point"], np.ones((COUNT, 1))], axis=1)
    truth = np.einsum("nij,nj->ni", matrix, homogeneous)
    size = np.einsum("nij,nj->ni", np.abs(matrix), np.abs(homogeneous))
    assert (np.abs(got - truth) <= 4 * EPSILON * size).all()


def test_vectors_do_not_move(vulkan_device):
    """The translation, whatever it is, does not enter: a huge one changes no bit."""
    near, far = affine_inputs(), affine_inputs()
    for row in ("row0", "row1", "row2"):
        far[row][:, 3] = 1e30
    turned = [
        evaluate(vulkan_device, ["transform.glsl"], VECTOR, i, {"result": "vec3"})["result"]
        for i in (near, far)
    ]
    assert np.array_equal(*turned)
    matrix = np.stack([near[f"row{i}"][:, :3] for i in range(3)], axis=1).astype(np.float64)
    truth = np.einsum("nij,nj->ni", matrix, near["point"])
    size = np.einsum("nij,nj->ni", np.abs(matrix), np.abs(near["point"]))
    assert (np.abs(turned[0] - truth) <= 4 * EPSILON * size).all()


def test_the_identity_is_exact(vulkan_device):
    inputs = affine_inputs()
    for i in range(3):
        inputs[f"row{i}"] = np.tile(np.eye(4, dtype=np.float32)[i], (COUNT, 1))
    got = evaluate(vulkan_device, ["transform.glsl"], POINT, inputs, {"result": "vec3"})["result"]
    assert np.array_equal(got, inputs["point"])


def clip_inputs():
    """Return columns of projections and rigid views, and points."""
    rng = np.random.default_rng(5)
    q, _ = np.linalg.qr(rng.normal(size=(COUNT, 3, 3)))
    view = np.tile(np.eye(4), (COUNT, 1, 1))
    view[:, :3, :3] = q
    view[:, :3, 3] = rng.normal(size=(COUNT, 3)) * 100
    clip = np.zeros((COUNT, 4, 4))
    clip[:, 0, 0], clip[:, 1, 1] = rng.uniform(0.5, 3, COUNT), -rng.uniform(0.5, 3, COUNT)
    clip[:, 2, 3], clip[:, 3, 2] = 10.0 ** rng.uniform(-3, 0, COUNT), -1.0
    columns = {f"c{j}": np.float32(clip[:, :, j]) for j in range(4)}
    columns |= {f"v{j}": np.float32(view[:, :, j]) for j in range(4)}
    return {**columns, "point": np.float32(rng.normal(size=(COUNT, 3)) * 50)}


def test_clip_positions_are_within_the_roundings_of_two_products(vulkan_device):
    inputs = clip_inputs()
    got = evaluate(vulkan_device, ["transform.glsl"], CLIP, inputs, {"clip": "vec4"})["clip"]
    clip, view = (np.stack([inputs[f"{m}{j}"] for j in range(4)], axis=2).astype(np.float64) for m in "cv")
    homogeneous = np.concatenate([inputs["point"], np.ones((COUNT, 1))], axis=1)
    truth = np.einsum("nij,njk,nk->ni", clip, view, homogeneous)
    size = np.einsum("nij,njk,nk->ni", np.abs(clip), np.abs(view), np.abs(homogeneous))
    assert (np.abs(got - truth) <= 10 * EPSILON * size).all()


def test_the_same_point_gets_the_same_bits_whatever_surrounds_it(vulkan_device):
    """`precise` forbids what a compiler likes to do: reuse and fuse with the code around. Depth tests for equality
    between two passes rest on that."""
    inputs = clip_inputs()
    alone = evaluate(vulkan_device, ["transform.glsl"], CLIP, inputs, {"clip": "vec4"})["clip"]
    other = """
        vec4 view = view_from_world * vec4(point, 1.0);
        other = clip_from_view * view * 3.0 + view.zwxy * clip.w;
        other += (clip_from_view * view_from_world) * vec4(point, 1.0);
    """
    with_more = evaluate(
        vulkan_device, ["transform.glsl"], CLIP + other, inputs, {"clip": "vec4", "other": "vec4"}
    )
    assert np.array_equal(alone, with_more["clip"])


def test_no_product_of_a_position_may_be_fused_or_reordered():
    """What `precise` becomes: each product and each sum is decorated NoContraction (SPIR-V, 3.20).

    None is left to a product of matrix and vector, in whose order of sums compilers differ.

    The software driver fuses nothing anyway, so that its pictures alone would not show a missing `precise`.
    """
    text = """#include "transform.glsl"
        layout(local_size_x = 1) in;
        layout(BIND(0, 0, 0), std430) buffer Data_ { mat3x4 affine; mat4 a; mat4 b; vec4 clip; };
        void main() { clip = clip_position(a, b, transform_point(affine, clip.xyz)); }
    """
    words = np.frombuffer(compile_shader(build_text(text, "comp", "vulkan")), np.uint32)
    decorated, products = set(), set()
    at = 5  # behind the module's header
    while at < len(words):
        opcode, length = int(words[at]) & 0xFFFF, int(words[at]) >> 16
        if opcode == 71 and words[at + 2] == 42:  # OpDecorate, NoContraction
            decorated.add(int(words[at + 1]))
        assert opcode not in (144, 145)  # OpVectorTimesMatrix, OpMatrixTimesVector
        if opcode in (129, 133, 142):  # OpFAdd, OpFMul, OpVectorTimesScalar
            products.add(int(words[at + 2]))
        at += length
    assert len(products) >= 3 + 3 + 4 + 3  # of an affine point, and of a 4x4 matrix
    assert products <= decorated


def test_broken_matrices_spoil_no_other_point(vulkan_device):
    inputs = affine_inputs()
    whole = evaluate(vulkan_device, ["transform.glsl"], POINT, inputs, {"result": "vec3"})["result"]
    inputs["row1"][17] = np.nan
    inputs["point"][23] = np.inf
    spoiled = evaluate(vulkan_device, ["transform.glsl"], POINT, inputs, {"result": "vec3"})["result"]
    same = np.ones(COUNT, bool)
    same[[17, 23]] = False
    assert np.array_equal(spoiled[same], whole[same])
    assert np.isnan(spoiled[17, 1])
    assert np.array_equal(spoiled[17, [0, 2]], whole[17, [0, 2]])
