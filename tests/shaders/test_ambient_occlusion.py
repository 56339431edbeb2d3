"""The functions of `shaders/ambient_occlusion.glsl` against closed forms and their float64 twins."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.gpu_functions import evaluate, ulps
from tests.twins import ambient_occlusion as twin

FILE = ["ambient_occlusion.glsl"]


def pixels(width, height, first=0):
    y, x = np.divmod(np.arange(width * height), width)
    return np.stack([x, y], axis=1).astype(np.uint32) + np.uint32(first)


@pytest.mark.feature("ssao/rotation-pattern")
@pytest.mark.parametrize("first", [0, 4093])
def test_every_block_of_4x4_pixels_uses_all_sixteen_unit_vectors(vulkan_device, first):
    got = evaluate(
        vulkan_device,
        FILE,
        "vector = rotation_vector(pixel); index = pattern_index(pixel);",
        {"pixel": pixels(23, 19, first)},
        {"vector": "vec3", "index": "uint"},
    )
    vectors = got["vector"].reshape(19, 23, 3).astype(np.float64)
    # Three squares and their sum in floats of sine, cosine and root, each within 4 ulps: 2^-20 is above ten of them.
    assert np.abs(np.linalg.norm(vectors, axis=-1) - 1).max() < 2.0**-20
    truth = twin.rotation_vectors()
    index = got["index"].reshape(19, 23)
    assert np.abs(vectors - truth[index]).max() < 2.0**-18
    if first == 0:
        assert np.array_equal(index[:4, :4], twin.bayer(4))
    for y in range(16):
        for x in range(20):
            assert sorted(index[y : y + 4, x : x + 4].ravel().tolist()) == list(range(16))
    apart = np.linalg.norm(truth[:, None] - truth[None], axis=-1)
    assert apart[~np.eye(16, dtype=bool)].min() > 0.3, "sixteen vectors, not one several times"
    assert np.abs(truth.mean(axis=0)).max() < 0.1, "they have no direction in common"


@pytest.mark.feature("ssao/rotation-pattern")
def test_an_offset_is_a_corner_of_the_cube_mirrored_with_its_length(vulkan_device):
    about = np.repeat(twin.rotation_vectors(), 8, axis=0).astype(np.float32)
    number = np.tile(np.arange(8, dtype=np.uint32), 16)
    got = evaluate(
        vulkan_device,
        FILE,
        "offset = sample_offset(number, about);",
        {"number": number, "about": about},
        {"offset": "vec3"},
    )["offset"].astype(np.float64)
    truth = np.concatenate([twin.offsets(vector) for vector in twin.rotation_vectors()])
    assert np.abs(got - truth).max() < 1e-6
    assert np.abs(np.linalg.norm(got, axis=1) - np.sqrt(0.75)).max() < 1e-6


@pytest.mark.feature("ssao/depth-only")
def test_so_many_hidden_samples_leave_so_much_light(vulkan_device):
    """Zero to eight samples at the distance that hides most: the values are the ledger's."""
    hidden = np.arange(9, dtype=np.float32)
    body = """
    float sum = 0.0;
    for (int i = 0; i < 8; ++i) {
        sum += sample_visibility(float(i) < hidden ? 1.0 : 0.0);
    }
    light = visibility_of_sum(sum);
    """
    got = evaluate(vulkan_device, FILE, body, {"hidden": hidden}, {"light": "float"})["light"]
    assert got[:3].tolist() == [1.0, 1.0, 1.0]
    assert np.abs(got - (1, 1, 1, 0.8427, 0.7022, 0.5927, 0.5142, 0.4666, 0.4500)).max() < 5e-5
    cases = np.array([[1.0] * k + [0.0] * (8 - k) for k in range(9)])
    assert ulps(got, twin.visibility(cases)).max() <= 4


@pytest.mark.feature("ssao/depth-only")
def test_what_is_behind_or_two_radii_before_the_point_hides_nothing(vulkan_device):
    nearer = np.float32([-np.inf, -1e30, -1.0, -0.0, 0.0, 2.0, 2.5, 1e20, np.inf, 0.5, 1.0, 1.5, 1e-30])
    got = evaluate(
        vulkan_device, FILE, "light = sample_visibility(nearer);", {"nearer": nearer}, {"light": "float"}
    )
    light = got["light"].astype(np.float64)
    assert light[:9].tolist() == [1.0] * 9
    half = 1 / (1 + (15 * 0.75) ** 2)
    assert np.abs(light[9:] - (half, 1 / 226, half, 1.0)).max() < 1e-6


@pytest.mark.feature("ssao/depth-only")
def test_rays_are_of_the_hemisphere_and_distributed_as_the_cosine(vulkan_device):
    """Around any normal: unit length, above the plane, and the mean cosine of its density, 2/3; of eight within 1 %."""
    rng = np.random.default_rng(3)
    n = rng.normal(size=(500, 3))
    n = np.concatenate([n / np.linalg.norm(n, axis=1, keepdims=True), np.eye(3), -np.eye(3)])
    normals = np.repeat(n, 8, axis=0).astype(np.float32)
    got = evaluate(
        vulkan_device,
        FILE,
        "ray = around_normal(hemisphere_direction(number, turn), n);",
        {
            "n": normals,
            "number": np.tile(np.arange(8, dtype=np.uint32), len(n)),
            "turn": np.repeat(rng.uniform(0, 2 * np.pi, len(n)), 8).astype(np.float32),
        },
        {"ray": "vec3"},
    )["ray"].astype(np.float64)
    assert np.abs(np.linalg.norm(got, axis=1) - 1).max() < 1e-5
    cosines = (got * normals).sum(axis=1).reshape(-1, 8)
    assert np.abs(cosines - np.sqrt(1 - (np.arange(8) + 0.5) / 8)).max() < 1e-5
    assert abs(cosines.mean() - 2 / 3) < 0.01
    assert np.abs(got.reshape(-1, 8, 3).mean(axis=1) - n * cosines.mean()).max() < 0.1, "no side is preferred"


@pytest.mark.feature("ssao/depth-only")
def test_a_surface_in_the_plane_of_a_point_hides_none_of_its_rays(vulkan_device):
    offset = np.float32([(0, 0, 0), (1, 0, 0), (1, 0, 0.04), (1, 0, 0.06), (0, 0, 1), (0, 0, -1), (0, 0, 1)])
    behind = np.float32([0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0])
    got = evaluate(
        vulkan_device,
        FILE,
        "found = hides(behind, offset, vec3(0.0, 0.0, 1.0)) ? 1u : 0u;",
        {"offset": offset, "behind": behind},
        {"found": "uint"},
    )
    assert got["found"].tolist() == [0, 0, 0, 1, 1, 0, 0]


@pytest.mark.feature("ssao/combine")
def test_scale_0_and_visibility_1_change_nothing_and_the_default_leaves_0_65(vulkan_device):
    rng = np.random.default_rng(5)
    count = 2000
    visible, bias, scale = rng.uniform(0, 1, (3, count)).astype(np.float32)
    scale[:500], visible[500:1000] = 0.0, 1.0
    visible[1000], bias[1000], scale[1000] = 0.45, 0.2, 1.0
    got = evaluate(
        vulkan_device,
        FILE,
        "light = ambient_factor(visible, bias, scale);",
        {"visible": visible, "bias": bias, "scale": scale},
        {"light": "float"},
    )["light"]
    assert (got[:1000] == 1.0).all()
    assert abs(got[1000] - 0.650) < 1e-6
    truth = (1 - scale.astype(np.float64)) + scale * np.clip(visible.astype(np.float64) + bias, 0, 1)
    assert np.abs(got - truth).max() < 2.0**-22


@pytest.mark.feature("postprocess/separable-blur")
def test_weights_are_of_133_with_the_variance_of_the_ledger(vulkan_device):
    offset = np.arange(-5, 6, dtype=np.int32)
    got = evaluate(
        vulkan_device, FILE, "weight = blur_weight(offset);", {"offset": offset}, {"weight": "float"}
    )
    weights = got["weight"].astype(np.float64)
    assert weights.tolist() == [3, 6, 10, 15, 20, 25, 20, 15, 10, 6, 3] and weights.sum() == 133
    assert abs((weights * offset**2).sum() / 133 - 5.128) < 5e-4
