"""GGX and cosine samplers: each against its density by histograms, and the GLSL against float64."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.either import evaluate
from tests.twins import ggx_sampling
from tests.twins.shading import distribution_ggx

integrate = pytest.importorskip("scipy.integrate", reason="scipy is in the extra reference")
stats = pytest.importorskip("scipy.stats", reason="scipy is in the extra reference")

COUNT = 200_000
VIEWS = (1.0, 0.6, 0.05)


def view(cosine):
    """Return the unit vector in the x-z plane at an angle from +z."""
    return np.array([np.sqrt(1 - cosine**2), 0.0, cosine])


def sampled(device, body, outputs, **inputs):
    """Return what `body` made of COUNT uniform numbers `u`; other inputs are the same for all."""
    u = np.float32(np.random.default_rng(11).random((COUNT, 2)))
    same = {
        name: np.float32(np.broadcast_to(value, (COUNT, *np.shape(value)))) for name, value in inputs.items()
    }
    return u, evaluate(device, ["ggx_sampling.glsl"], body, {"u": u, **same}, outputs)


@pytest.mark.feature("pbr/ggx-importance-sampling")
@pytest.mark.parametrize("alpha", [0.04, 0.25, 1.0])
def test_cosines_seen_from_above_follow_d_cos(either_device, alpha):
    _, got = sampled(either_device, "h = sample_ggx(u, v, alpha);", {"h": "vec3"}, v=view(1.0), alpha=alpha)
    # Bins of equal probability: the integral of D cos from the pole to cos t is tan^2 / (tan^2 + alpha^2).
    part = np.linspace(0, 1, 41)[1:-1]
    edges = 1 / np.sqrt(1 + alpha**2 * part / (1 - part))
    counted = np.histogram(got["h"][:, 2], np.concatenate([[0], edges[::-1], [1.01]]))[0]
    check, _ = integrate.quad(lambda c: 2 * np.pi * distribution_ggx(c, alpha) * c, edges[9], 1.0)
    assert np.isclose(check, 0.25, atol=1e-7)  # the closed form is that of D as shaders use it
    expected = COUNT / 40
    assert np.abs(counted - expected).max() < 3 * np.sqrt(expected * (1 - 1 / 40))
    assert stats.chisquare(counted).pvalue > 1e-3
    rougher = 1 / np.sqrt(1 + (1.1 * alpha) ** 2 * part / (1 - part))
    counted = np.histogram(got["h"][:, 2], np.concatenate([[0], rougher[::-1], [1.01]]))[0]
    assert np.abs(counted - expected).max() > 10 * np.sqrt(expected), "a tenth more of roughness is noticed"


@pytest.mark.parametrize("cosine", VIEWS)
@pytest.mark.parametrize("alpha", [0.1, 0.5, 1.0])
def test_reflected_directions_follow_their_density(vulkan_device, cosine, alpha):
    body = """
        h = sample_ggx(u, v, alpha);
        vec3 l = 2.0 * dot(v, h) * h - v;
        got_l = l;
        density = pdf_ggx(distribution_ggx(vec3(0, 0, 1), h, alpha), v.z, alpha);
    """
    v = view(cosine)
    outputs = {"h": "vec3", "got_l": "vec3", "density": "float"}
    _, got = sampled(vulkan_device, body, outputs, v=v, alpha=alpha)
    # Bins of the sphere by height and azimuth; the truth is the density integrated over each by Gauss and Legendre.
    z_edges, turns = np.linspace(-1, 1, 17), np.linspace(-np.pi, np.pi, 17)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    z = (z_edges[:-1, None] + z_edges[1:, None]) / 2 + nodes * np.diff(z_edges)[:, None] / 2
    phi = (turns[:-1, None] + turns[1:, None]) / 2 + nodes * np.diff(turns)[:, None] / 2
    zz, pp = z[:, None, :, None], phi[None, :, None, :]
    r = np.sqrt(1 - zz**2)
    l = np.stack(np.broadcast_arrays(r * np.cos(pp), r * np.sin(pp), zz), axis=-1)  # noqa: E741
    h = l + v
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    density = np.where(h[..., 2] > 0, ggx_sampling.pdf_ggx(h[..., 2], cosine, alpha), 0)
    area = np.diff(z_edges)[0] * np.diff(turns)[0] / 4
    expected = np.einsum("ijkl,k,l->ij", density, weights, weights) * area * COUNT
    assert np.isclose(expected.sum(), COUNT, rtol=5e-3)  # it is a density, up to its cut
    found = np.histogram2d(
        got["got_l"][:, 2], np.arctan2(got["got_l"][:, 1], got["got_l"][:, 0]), [z_edges, turns]
    )[0]
    used = expected > 20
    rest = [found[~used].sum()], [expected[~used].sum()]
    found, expected = np.append(found[used], rest[0]), np.append(expected[used], rest[1])
    keep = expected > 0
    expected = expected[keep] * found[keep].sum() / expected[keep].sum()
    assert stats.chisquare(found[keep], expected).pvalue > 1e-3
    truth = ggx_sampling.pdf_ggx(got["h"][:, 2].astype(np.float64), cosine, alpha)
    assert np.allclose(got["density"], truth, rtol=2e-3)


def test_cosine_directions_follow_the_cosine(vulkan_device):
    u, got = sampled(vulkan_device, "d = sample_cosine(u);", {"d": "vec3"})
    counted = np.histogram(got["d"][:, 2] ** 2, 40, (0, 1))[
        0
    ]  # cos^2 is uniform where the cosine is the density
    assert stats.chisquare(counted).pvalue > 1e-3
    turns = np.histogram(np.arctan2(got["d"][:, 1], got["d"][:, 0]), 40, (-np.pi, np.pi))[0]
    assert stats.chisquare(turns).pvalue > 1e-3
    assert np.abs(got["d"] - ggx_sampling.sample_cosine(u)).max() < 2e-6


def test_the_shader_is_the_float64_function(vulkan_device):
    rng = np.random.default_rng(5)
    alpha = np.float32(np.concatenate([10 ** rng.uniform(-4, 0, COUNT - 2), [0.0, 1.0]]))
    cosine = np.concatenate([rng.random(COUNT - 4), [0, 0, 1, 1]])
    v = np.float32(np.stack([view(c) for c in cosine[:64]])[np.arange(COUNT) % 64])
    v[-4:] = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 1)]
    u = np.float32(rng.random((COUNT, 2)))
    u[-4:] = [(0, 0), (0.5, 0.5), (0.25, 0.75), (0, 0.999)]
    body = "h = sample_ggx(u, v, alpha); g = masking_ggx(v.z, alpha);"
    inputs = {"u": u, "v": v, "alpha": alpha}
    got = evaluate(vulkan_device, ["ggx_sampling.glsl"], body, inputs, {"h": "vec3", "g": "float"})
    assert np.isfinite(got["h"]).all()
    truth = ggx_sampling.sample_ggx(u, v, alpha)
    assert np.quantile(np.linalg.norm(got["h"] - truth, axis=1), 0.999) < 1e-5
    assert np.abs(got["h"] - truth).max() < 1e-3  # where nearly nothing is left of the cap's rim
    assert np.allclose(got["g"], ggx_sampling.masking_ggx(v[:, 2], alpha), atol=1e-6)


def test_frames_are_rotations_at_the_poles_too(vulkan_device):
    rng = np.random.default_rng(2)
    n = rng.normal(size=(20_000, 3))
    n[:5000, :2] *= 1e-5
    n = np.float32(n / np.linalg.norm(n, axis=1, keepdims=True))
    n[:2] = [(0, 0, -1), (0, 0, 1)]
    body = "mat3 f = frame_around(n); x = f[0]; y = f[1]; z = f[2];"
    outputs = {"x": "vec3", "y": "vec3", "z": "vec3"}
    got = evaluate(vulkan_device, ["ggx_sampling.glsl"], body, {"n": n}, outputs)
    frame = np.stack([got["x"], got["y"], got["z"]], axis=-1)
    assert np.abs(np.swapaxes(frame, -1, -2) @ frame - np.eye(3)).max() < 2e-6
    assert np.abs(np.linalg.det(frame) - 1).max() < 2e-6
    assert np.array_equal(got["z"], n)
    assert np.abs(frame - ggx_sampling.frame_around(n)).max() < 1e-5
