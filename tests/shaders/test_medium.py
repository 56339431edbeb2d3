"""Media of `shaders/medium.glsl`: densities, optical depth of segments, and light along a ray, on both backends.

Truths are the float64 twin, which tests/shaders/test_fog_twin.py holds to decimals of 60 digits and to quadrature.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from tests.support.either import evaluate
from tests.twins import fog

MEDIUM = ["medium.glsl"]
ULP = 2.0**-24

SERIES = 2.0**-26 / 0.78 + 9 * ULP
"""What the series is off by at most: its next term against 0.787, and rounding of the outermost steps (a step within
has at most a quarter of the weight of the one around it: 3 + 3/4 + ... of x / 2, then the last sum)."""


def exp_error(x):
    """Return the relative error that Vulkan allows exp(-x): 3 + 2 |x| units in the last place."""
    return (3 + 2 * np.abs(x)) * 2 * ULP


@pytest.mark.feature("fog/integration")
def test_mean_transmittance_at_every_optical_depth(either_device):
    """From 1e-30 to 1e30: below one half the series, above it a difference that is 0.39 or more."""
    x = np.float32(np.concatenate([[0.0, 0.49999997, 0.5, 88.0, 104.0], np.geomspace(1e-30, 1e30, 6000)]))
    x = np.concatenate([x, np.float32(np.linspace(0, 1, 3000))])
    got = evaluate(either_device, MEDIUM, "mean = mean_transmittance(x);", {"x": x}, {"mean": "float"})[
        "mean"
    ]
    exact = x.astype(np.float64)
    truth = fog.phi(exact)
    with np.errstate(under="ignore"):
        difference = exp_error(exact) * np.exp(-exact) / -np.expm1(-np.maximum(exact, 0.4)) + 7 * ULP
    bound = np.where(exact < 0.5, SERIES, difference)
    assert (np.abs(got - truth) <= bound * truth).all()
    assert bound.max() < 3e-6
    assert got[0] == 1.0


def closed_form(depths, albedo):
    """Return light and transmittance (N,) behind slabs of optical depths (N,), from decimals of 60 digits.

    A slab scatters `albedo` of what it attenuates, lit by a radiance of 1 from everywhere: light is
    albedo (1 - exp(-depth)).
    """
    with localcontext() as context:
        context.prec = 60
        seen = [(-Decimal(float(depth))).exp() for depth in depths]
        return np.array([float(Decimal(albedo) * (1 - t)) for t in seen]), np.array([float(t) for t in seen])


SLAB = """
    vec4 fog = vec4(0.0, 0.0, 0.0, 1.0);
    for (int slice = 0; slice < count; slice++) fog = through_segment(fog, vec3(albedo, 1.0, 0.0) * beta, beta, metres);
    light = fog.r;
    all_of_it = fog.g;
    none_of_it = fog.b;
    seen = fog.a;
"""

OUTPUTS = dict.fromkeys(("light", "all_of_it", "none_of_it", "seen"), "float")


@pytest.mark.feature("fog/integration", "fog/medium")
@pytest.mark.parametrize("metres", [1e-3, 1.0, 50.0])
@pytest.mark.parametrize("count", [1, 16, 128])
def test_a_slab_of_slices_is_the_closed_form(either_device, count, metres):
    """Optical depths of a slice from 1e-9 to 1e4: light and transmittance within 1e-4, relative for light.

    Each slice multiplies transmittance by 1 - depth * mean, which is off by `SERIES` of its second term and rounds, or
    by an exp that is off by `exp_error`; the product rounds, too. Over the slices these add up.
    """
    depth = np.geomspace(1e-9, 1e4, 300)
    beta = np.float32(depth / metres)
    given = {
        "beta": beta,
        "metres": np.full_like(beta, metres),
        "albedo": np.full_like(beta, 0.5),
        "count": np.full(len(beta), count, np.int32),
    }
    got = evaluate(either_device, MEDIUM, SLAB, given, OUTPUTS)
    exact = beta.astype(np.float64) * np.float64(np.float32(metres))
    light, seen = closed_form(count * exact, 0.5)
    assert np.isfinite([*got.values()]).all()
    assert (np.abs(got["light"] - light) <= 1e-4 * light).all()
    assert np.abs(got["seen"] - seen).max() <= 1e-5
    each = np.where(exact < 0.5, 2 * exact * (SERIES + 2 * ULP) + ULP, exp_error(exact))
    off = count * (each + ULP) + ULP
    assert (np.abs(got["seen"] - seen) <= off * seen + 1e-37).all()
    # Energy: what is let through and what an albedo of 1 scatters is all light there was; smaller albedos leave less.
    assert np.abs(got["all_of_it"] + got["seen"] - 1).max() <= 1e-5
    assert (got["light"] + got["seen"] <= 1 + 1e-5).all()
    assert not got["none_of_it"].any()


@pytest.mark.feature("fog/medium")
def test_a_slab_that_scatters_more_than_it_attenuates_is_seen(either_device):
    """Albedos of 1 and below keep light and transmittance at 1 or less, at any depth; 1.01 goes beyond it."""
    albedo = np.float32([0.0, 0.5, 1.0, 1.01])
    shape = dict.fromkeys(("beta", "metres"), np.float32([3.0] * 4)) | {"count": np.full(4, 8, np.int32)}
    got = evaluate(either_device, MEDIUM, SLAB, {**shape, "albedo": albedo}, OUTPUTS)
    total = got["light"] + got["seen"]
    assert (total[:3] <= 1 + 1e-5).all()
    assert np.abs(total[3] - 1) > 5e-3


@pytest.mark.feature("fog/integration")
def test_a_division_by_the_extinction_would_lose_light(either_device):
    """The form with a floor of 1e-5 under the extinction, at 1e-7 per metre: it has a hundredth of the light."""
    beta = np.float32([1e-7, 1e-6, 1e-2])
    body = """
        float seen = exp(-beta * 80.0);
        floored = (beta - beta * seen) / max(beta, 1e-5);
        stable = through_segment(vec4(0.0, 0.0, 0.0, 1.0), vec3(beta), beta, 80.0).r;
    """
    got = evaluate(either_device, MEDIUM, body, {"beta": beta}, {"floored": "float", "stable": "float"})
    truth = -np.expm1(-80.0 * beta.astype(np.float64))
    assert (np.abs(got["stable"] / truth - 1) < 1e-6).all()
    lost = 1 - got["floored"] / truth
    assert lost[0] > 0.98 and lost[1] > 0.89
    assert got["floored"][2] == pytest.approx(truth[2], rel=1e-4)


@pytest.mark.feature("fog/integration")
def test_slices_that_differ_are_those_of_float64(either_device):
    """Random media of eight slices: each step adds a few units in the last place to what came before."""
    rng = np.random.default_rng(7)
    rows = 2000
    scattered, extinction = 10.0 ** rng.uniform(-6, 2, (rows, 8)), 10.0 ** rng.uniform(-6, 1, (rows, 8))
    metres = 10.0 ** rng.uniform(-2, 1, (rows, 8))
    given = {}
    for name, values in (("s", scattered), ("e", extinction), ("m", metres)):
        given[name + "0"], given[name + "1"] = (np.float32(values[:, part : part + 4]) for part in (0, 4))
    body = """
        fog = vec4(0.0, 0.0, 0.0, 1.0);
        for (int i = 0; i < 4; i++) fog = through_segment(fog, vec3(s0[i], 2.0 * s0[i], 0.0), e0[i], m0[i]);
        for (int i = 0; i < 4; i++) fog = through_segment(fog, vec3(s1[i], 2.0 * s1[i], 0.0), e1[i], m1[i]);
    """
    got = evaluate(either_device, MEDIUM, body, given, {"fog": "vec4"})["fog"]
    s, e, m = (np.hstack([given[name + "0"], given[name + "1"]]).astype(np.float64) for name in "sem")
    light, seen = fog.integrate(s[..., None] * (1, 2, 0), e, m)
    depth = np.minimum(e * m, 90).sum(axis=1)
    relative = 8 * 20 * ULP + exp_error(depth)
    assert (np.abs(got[:, :3] - light[:, -1]) <= relative[:, None] * light[:, -1]).all()
    assert (np.abs(got[:, 3] - seen[:, -1]) <= relative * seen[:, -1] + 1e-37).all()


# --- densities and means ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("falloff", [0.0, 0.01, 0.7, 20.0])
def test_height_fog_is_its_exponential(either_device, falloff):
    y = np.float32(np.concatenate([np.linspace(-5, 60, 3000), [1.25, 1.2499999, -1e6, 1e6]]))
    body = f"density = height_density(y, 1.25, {falloff!r});"
    got = evaluate(either_device, MEDIUM, body, {"y": y}, {"density": "float"})["density"]
    k = np.float64(np.float32(falloff))
    above = np.maximum(y.astype(np.float64) - 1.25, 0)
    truth = np.exp(-k * above)
    # y - base rounds to half a unit of itself, and the product once: 2 ULP of the exponent.
    assert (np.abs(got - truth) <= (exp_error(k * above) + 2 * ULP * k * above) * truth + 1e-37).all()
    assert (got[y <= 1.25] == 1.0).all()
    if falloff == 0.7:
        assert got[np.searchsorted(y[:3000], 2.25)] == pytest.approx(np.exp(-0.7), abs=0.02)


@pytest.mark.parametrize("falloff", [0.0, 0.01, 0.7, 20.0])
def test_the_mean_of_height_fog_is_its_integral(either_device, falloff):
    """Segments above, below and across the base, level ones and near level ones."""
    rng = np.random.default_rng(8)
    y0, y1 = np.float32(rng.uniform(-4, 8, (2, 4000)))
    y1[:500] = y0[:500]
    y1[500:1000] = y0[500:1000] + np.float32(1e-4)
    y0[1000:1010], y1[1000:1010] = 1.25, np.float32(np.linspace(-3, 3, 10))
    body = f"mean = height_mean(y0, y1, 1.25, {falloff!r});"
    got = evaluate(either_device, MEDIUM, body, {"y0": y0, "y1": y1}, {"mean": "float"})["mean"]
    place, weight = np.polynomial.legendre.leggauss(40)
    k = np.float64(np.float32(falloff))
    low = np.minimum(y0, y1).astype(np.float64) - 1.25
    high = np.maximum(y0, y1).astype(np.float64) - 1.25
    # Quadrature in four panels on the part above the base; the part below is 1.
    start, width = np.maximum(low, 0), np.maximum(high, 0) - np.maximum(low, 0)
    points = (np.arange(4)[:, None] + (place + 1) / 2) / 4
    above = (np.exp(-k * (start[:, None, None] + width[:, None, None] * points)) * weight / 8).sum(
        axis=(1, 2)
    )
    share = np.where(high > low, np.clip(-low / np.where(high > low, high - low, 1), 0, 1), low < 0)
    truth = share + (1 - share) * above
    # Heights round to ULP of 8 m, which the falloff multiplies; the series, an exp and four products.
    reach = np.minimum(k * np.maximum(high, 0), 100)
    bound = SERIES + exp_error(reach) + 8 * k * 2 * ULP + 8 * ULP
    assert (np.abs(got - truth) <= bound * np.maximum(truth, 1e-30) + 4 * ULP * share).all()


def test_a_box_is_its_inside_and_its_faces(either_device):
    center, half = np.float32((1.0, -2.0, 0.5)), np.float32((0.5, 2.0, 0.25))
    steps = np.array(np.meshgrid(*[(-1.5, -1.0, -0.3, 0.0, 1.0, 1.0001)] * 3)).reshape(3, -1).T
    points = np.float32(center + steps * half)
    body = "inside = box_density(point, vec3(1.0, -2.0, 0.5), vec3(0.5, 2.0, 0.25));"
    got = evaluate(either_device, MEDIUM, body, {"point": points}, {"inside": "float"})["inside"]
    truth = (np.abs(points.astype(np.float64) - center) <= half).all(axis=1)
    assert np.array_equal(got, truth.astype(np.float32))
    assert 0 < truth.sum() < len(truth) and truth.sum() >= 4**3 - 4


def test_the_part_of_a_segment_in_a_box_is_that_of_many_points(either_device):
    """And of float64; segments along axes and faces among them."""
    rng = np.random.default_rng(9)
    start, end = np.float32(rng.uniform(-3, 3, (2, 2000, 3)))
    end[:300, 0] = start[:300, 0]
    end[300:400] = start[300:400] * (1, 1, -1)
    end[400:410] = start[400:410]  # of no length, inside and outside
    start[400:405] *= 0.2
    end[400:405] = start[400:405]
    body = "part = box_mean(start, end, vec3(0.25, 0.0, -0.5), vec3(1.0, 0.75, 2.0));"
    got = evaluate(either_device, MEDIUM, body, {"start": start, "end": end}, {"part": "float"})["part"]
    box = fog.Box((0.25, 0.0, -0.5), (1.0, 0.75, 2.0), 1.0)
    first, last = fog.crossing(start.astype(np.float64), end.astype(np.float64) - start, box)
    truth = np.maximum(last - first, 0)
    way = np.abs(end.astype(np.float64) - start)
    # Each plane is met at (face - start) / way: differences of numbers up to 5.25 round, then the division.
    shortest = np.where(way > 0, way, np.inf).min(axis=1)
    assert (np.abs(got - truth) <= 2 * (6 * ULP / np.minimum(shortest, 6) + 6 * ULP)).all()
    t = (np.arange(1000) + 0.5) / 1000
    points = start[:, None] + t[:, None] * (end - start)[:, None].astype(np.float64)
    counted = (np.abs(points - box.center) <= box.half).all(axis=-1).mean(axis=1)
    assert np.abs(got - counted).max() <= 1.01e-3
    assert set(got[400:410]) == {0.0, 1.0}
    assert (got == 0).sum() > 300 and (got > 0.2).sum() > 300


# --- what is done with it ---------------------------------------------------------------------------------------------


def test_a_surface_behind_fog(either_device):
    color = np.float32([(1.0, 2.0, 3.0), (0.0, 0.0, 0.0)])
    veil = np.float32([(0.5, 0.25, 0.0, 0.5), (1.0, 2.0, 4.0, 0.0)])
    body = "shown = behind_fog(color, veil);"
    got = evaluate(either_device, MEDIUM, body, {"color": color, "veil": veil}, {"shown": "vec3"})["shown"]
    assert got.tolist() == [[1.0, 1.25, 1.5], [1.0, 2.0, 4.0]]


def test_a_history_is_blended_rests_and_what_is_not_finite_leaves(either_device):
    bad = np.float32([(np.nan, 1, 1, 1), (1, np.inf, 1, 1), (1, 1, -np.inf, 1), (1, 1, 1, np.nan)])
    history = np.concatenate([bad, np.float32(np.random.default_rng(3).uniform(0, 9, (500, 4)))])
    current = np.float32(np.random.default_rng(4).uniform(0, 9, history.shape))
    body = """
        after = blended_history(history, current, 0.125);
        resting = blended_history(current, current, 0.125);
    """
    given = {"history": history, "current": current}
    got = evaluate(either_device, MEDIUM, body, given, {"after": "vec4", "resting": "vec4"})
    assert np.array_equal(got["after"][:4], current[:4])
    truth = fog.blended(history[4:].astype(np.float64), current[4:].astype(np.float64), 0.125)
    assert (np.abs(got["after"][4:] - truth) <= 3 * ULP * 9).all()
    # mix may be x (1 - a) + y a, which rounds: a resting value moves by a unit in the last place at most.
    assert (np.abs(got["resting"] - current) <= 2 * ULP * current).all()
