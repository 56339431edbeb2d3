"""How a surface shares an environment's light: `shaders/ibl.glsl` against float64, and float64 against quadrature."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from common.environment import ENERGIES
from tests.support.either import evaluate
from tests.twins import shading_environment as ibl
from tests.twins.shading import metallic_roughness

integrate = pytest.importorskip("scipy.integrate", reason="scipy is in the extra reference")

NODES = np.polynomial.legendre.leggauss(200)
COOKBOOK = np.array(
    # roughness, n.v, A, B with Schlick's approximation of the masking, k = alpha / 2 (2^18 samples)
    [
        (0.05, 0.5, 0.96631, 0.03119),
        (0.25, 0.25, 0.65729, 0.17335),
        (0.25, 1.0, 0.99433, 0.00000),
        (0.5, 0.1, 0.59017, 0.09837),
        (0.5, 0.5, 0.72853, 0.01855),
        (0.5, 1.0, 0.89504, 0.00002),
        (0.75, 0.5, 0.57301, 0.00697),
        (1.0, 0.25, 0.48348, 0.00748),
        (1.0, 1.0, 0.30682, 0.00003),
    ]
)


def plain_albedo(n_dot_v, alpha, base, metallic):
    """Return the albedo of the printed BRDF by plain quadrature over the hemisphere of light: for wide lobes only."""
    x, weight = NODES
    cosine, phi = ((x + 1) / 2)[:, None], ((x + 1) * np.pi / 2)[None, :]
    sine = np.sqrt(1 - cosine**2)
    l = np.stack(np.broadcast_arrays(sine * np.cos(phi), sine * np.sin(phi), cosine), axis=-1)  # noqa: E741
    v = np.array([np.sqrt(1 - n_dot_v**2), 0, n_dot_v])
    f = metallic_roughness([0, 0, 1.0], l, v, np.full(3, base), metallic, alpha)[..., 0]
    return (f * np.outer(weight, weight)).sum() * np.pi / 2


@cache
def quadrature(roughness, n_dot_v):
    """Return A, B and W of tuples of roughness and cosine, once."""
    return ibl.albedo_table(np.array(n_dot_v), np.array(roughness))


def uniform_light(base, metallic, roughness, n_dot_v, energy):
    """Return the share of a uniform environment's light that leaves, by quadrature and the formulas in float64."""
    roughness, n_dot_v = (np.atleast_1d(x).tolist() for x in (roughness, n_dot_v))
    table = quadrature(tuple(roughness), tuple(n_dot_v))
    on_radiance, on_irradiance = ibl.weights(np.full(3, base), metallic, table, energy)
    return (on_radiance + on_irradiance)[..., 0]


@pytest.mark.parametrize("alpha", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("n_dot_v", [0.05, 0.4, 1.0])
@pytest.mark.parametrize(("base", "metallic"), [(1.0, 1.0), (0.3, 1.0), (1.0, 0.0), (0.0, 0.0), (0.6, 0.5)])
def test_the_split_is_the_printed_brdf(alpha, n_dot_v, base, metallic):
    """F0 A + B and 0.96 (1 - W) base are the whole of glTF's formula, which knows nothing of tables."""
    split = uniform_light(base, metallic, np.sqrt(alpha), n_dot_v, "gltf")
    assert np.isclose(split, plain_albedo(n_dot_v, alpha, base, metallic), rtol=2e-4, atol=2e-5)


def test_quadrature_of_w_by_another():
    for n_dot_v in (0.1, 0.7, 1.0):
        sine = np.sqrt(1 - n_dot_v**2)

        def integrand(phi, c, s=sine, n=n_dot_v):
            v_dot_l = s * np.sqrt(1 - c * c) * np.cos(phi) + n * c
            return (1 - np.sqrt((1 + v_dot_l) / 2)) ** 5 * c * 2 / np.pi

        truth = integrate.dblquad(integrand, 0, 1, 0, np.pi, epsabs=1e-7)[0]
        assert np.isclose(ibl.fresnel_share(n_dot_v), truth, atol=2e-6)


def test_smooth_surfaces_are_analytic():
    n_dot_v = np.array([0.02, 0.3, 0.5, 1.0])
    a, b = ibl.specular_albedo(n_dot_v, 1e-5)
    assert np.allclose(b, (1 - n_dot_v) ** 5, atol=2e-4)
    assert np.allclose(a, 1 - (1 - n_dot_v) ** 5, atol=2e-4)


def test_what_the_printed_formula_does_with_white_light(record_property):
    """A white dielectric sends out more than it gets at grazing angles, a white rough metal much less than it gets."""
    grazing = float(uniform_light(1.0, 0.0, 0.2, 0.05, "gltf")[0])
    rough = float(uniform_light(1.0, 1.0, 1.0, 1.0, "gltf")[0])
    print(
        f"glTF as printed: dielectric {grazing:.3f} at n.v = 0.05, roughness 0.2; metal {rough:.3f} at roughness 1"
    )
    record_property("dielectric at grazing angles", grazing)
    record_property("metal at roughness 1", rough)
    assert 1.4 < grazing < 1.6
    assert np.isclose(rough, 0.3069, atol=1e-4)


def test_compensated_metal_is_white_and_the_conserving_sum_stays_below_one():
    roughness, n_dot_v = (x.ravel() for x in np.meshgrid(np.linspace(0.05, 1, 5), (0.02, 0.1, 0.4, 1.0)))
    for energy in ("compensated", "conserving"):
        assert np.allclose(uniform_light(1.0, 1.0, roughness, n_dot_v, energy), 1.0, atol=1e-12)
    for base in (0.0, 0.2, 1.0):
        for metallic in (0.0, 0.5, 1.0):
            share = uniform_light(base, metallic, roughness, n_dot_v, "conserving")
            assert share.max() <= 1 + 1e-12
            assert share.min() > 0
    # A white dielectric that conserves energy shows nothing of itself in a white furnace; as printed it does.
    assert np.allclose(uniform_light(1.0, 0.0, roughness, n_dot_v, "conserving"), 1.0, atol=1e-12)
    printed = uniform_light(1.0, 0.0, roughness, n_dot_v, "gltf")
    assert printed.max() > 1.3
    assert printed.min() < 0.98


@pytest.mark.parametrize("energy", ENERGIES)
def test_the_shader_is_the_float64_function(vulkan_device, energy):
    rng = np.random.default_rng(8)
    count = 20_000
    base = np.float32(rng.random((count, 3)))
    base[0], base[1] = 0, 1
    a = rng.random(count)
    table = np.float32(np.stack([a, (1 - a) * rng.random(count), rng.random(count) * 0.03], axis=1))
    metallic = np.float32(rng.choice([0, 0.3, 1], count))
    body = f"environment_weights(base, metallic, table, {ENERGIES.index(energy)}, mirrored, spread);"
    outputs = {"mirrored": "vec3", "spread": "vec3"}
    got = evaluate(
        vulkan_device, ["ibl.glsl"], body, {"base": base, "metallic": metallic, "table": table}, outputs
    )
    mirrored, spread = ibl.weights(base, metallic, table, energy)
    assert np.abs(got["mirrored"] - mirrored).max() < 1e-6
    assert np.abs(got["spread"] - spread).max() < 2e-6


def test_table_places(vulkan_device):
    """A texel's centre is where its point is looked up, in every texel of tables of several sizes."""
    size = np.repeat(np.uint32([2, 16, 64]), 4096)
    texel = np.stack([np.arange(len(size)) % 64 % size, np.arange(len(size)) % 4096 // 64 % size], axis=1)
    body = """
        point = table_point(texel, size);
        uv = table_uv(point.x, point.y, float(size));
    """
    inputs = {"texel": np.uint32(texel), "size": size}
    got = evaluate(vulkan_device, ["ibl.glsl"], body, inputs, {"point": "vec2", "uv": "vec2"})
    assert np.abs(got["uv"] - (texel + 0.5) / size[:, None]).max() < 1e-6
    assert got["point"][:, 0].min() > 0
    assert got["point"][:, 1].min() == 0
    assert got["point"][:, 1].max() == 1


def split_sum(device, roughness, n_dot_v, masking, samples=2**14):
    """Return A and B (P, 2) of points by the table kernel's estimator with the given masking of light and view."""
    point = np.float32(np.stack([roughness, n_dot_v], axis=1))
    body = f"""
        float alpha = point.x * point.x;
        vec3 v = vec3(sqrt(1.0 - point.y * point.y), 0.0, point.y);
        vec2 sum = vec2(0.0);
        for (uint i = 0u; i < {samples}u; ++i) {{
            vec2 u = hammersley(i, 1.0 / {samples}.0) + 0.5 / {samples}.0;
            vec3 h = sample_ggx(u, v, alpha);
            float v_dot_h = max(dot(v, h), 0.0);
            float n_dot_l = 2.0 * v_dot_h * h.z - v.z;
            if (n_dot_l > 0.0) {{
                float w = schlick_weight(v_dot_h);
                float k = 0.5 * alpha;
                float masking = {masking};
                sum += masking * vec2(1.0 - w, w);
            }}
        }}
        ab = sum / {samples}.0;
    """
    files = ["sampling.glsl", "ggx_sampling.glsl"]
    return evaluate(device, files, body, {"point": point}, {"ab": "vec2"})["ab"]


@pytest.mark.feature("pbr/brdf-lut")
def test_the_rows_of_the_cookbook(either_device):
    """The rows were made with Schlick's masking x / (x (1 - k) + k): the same estimator meets them with it."""

    def schlick(x):
        return f"({x} / ({x} * (1.0 - k) + k))"

    masking = f"{schlick('n_dot_l')} * {schlick('v.z')} / masking_ggx(v.z, alpha)"
    got = split_sum(either_device, COOKBOOK[:, 0], COOKBOOK[:, 1], masking)
    assert np.abs(got - COOKBOOK[:, 2:]).max() < 5e-3
    assert (got.sum(axis=1) <= 1).all()
    # The fit without a table, against what it was fitted to; and the masking that glTF prints is another one.
    rows = np.float32(COOKBOOK[:, :2])
    body, inputs = "ab = split_sum_fit(p.y, p.x);", {"p": rows}
    fit = evaluate(either_device, ["ibl.glsl"], body, inputs, {"ab": "vec2"})["ab"]
    assert np.abs(fit - np.stack(ibl.split_sum_fit(rows[:, 1], rows[:, 0]), axis=1)).max() < 1e-5
    assert np.abs(fit - COOKBOOK[:, 2:]).max() < 0.21
    assert fit.min() >= 0
    ours = split_sum(either_device, COOKBOOK[:, 0], COOKBOOK[:, 1], "masking_ggx(n_dot_l, alpha)")
    truth = np.stack(ibl.specular_albedo(COOKBOOK[:, 1], COOKBOOK[:, 0] ** 2), axis=1)
    assert np.abs(ours - truth).max() < 5e-4
    assert np.abs(truth - COOKBOOK[:, 2:]).max() > 0.05
