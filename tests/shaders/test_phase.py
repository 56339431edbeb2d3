"""The phase function of Henyey and Greenstein: its integrals in float64, and `shaders/phase.glsl` on both backends."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.either import evaluate
from tests.twins.fog import henyey_greenstein

PHASE = ["phase.glsl"]
phase = pytest.mark.feature("fog/henyey-greenstein")

ULP = 2.0**-24
ROUNDED = 28 * ULP
"""What Vulkan's precision of single steps lets the function be off by, relative.

1 - g rounds once, its square twice that and once more, 2 g (1 - cos) once, their sum once: 4 in d, and all terms are
positive. d sqrt(d) has that one and a half times, 2.5 + 2 units in the last place of the root (2 ULP each) and one of
the product: 16. Numerator 4, the constant 2, the division 2.5 units: 5. Together 27 or 28.
"""

EVERY_G = [-0.99, -0.9, -0.5, 0.0, 1e-3, 0.3, 0.7, 0.9, 0.99]


def textbook(cosine, g):
    """Return the function as it is usually printed."""
    return (1 - g**2) / (4 * np.pi * (1 + g**2 - 2 * g * cosine) ** 1.5)


def over_sphere(function, g, panels=64, nodes=16):
    """Return the integrals over all directions of function(1 - cos, g) times 1 and times cos, by Gauss-Legendre.

    Panels halve towards both poles, where the peak of an anisotropic function is.
    """
    place, weight = np.polynomial.legendre.leggauss(nodes)
    edges = 2.0 ** -np.arange(panels // 2)
    edges = np.concatenate([[0.0], np.sort(edges), 2 - edges[1:], [2.0]])
    low, width = edges[:-1, None], np.diff(edges)[:, None]
    x = (low + width * (place + 1) / 2).reshape(-1)
    weights = (width * weight / 2).reshape(-1)
    values = function(x, g) * weights * 2 * np.pi
    return values.sum(), (values * (1 - x)).sum()


@phase
@pytest.mark.parametrize("g", EVERY_G)
def test_it_integrates_to_1_and_its_mean_cosine_is_g(g):
    total, cosine = over_sphere(henyey_greenstein, g)
    assert total == pytest.approx(1.0, abs=1e-12)
    assert cosine == pytest.approx(g, abs=1e-12)


@phase
def test_the_stable_form_is_the_printed_one():
    cosine = np.linspace(-1, 1, 401)
    for g in EVERY_G:
        np.testing.assert_allclose(henyey_greenstein(1 - cosine, g), textbook(cosine, g), rtol=1e-11)
    assert henyey_greenstein(0.4, 0.0) == pytest.approx(1 / (4 * np.pi), rel=1e-15)
    # The peak (1 + g) / (4 pi (1 - g)^2).
    assert henyey_greenstein(0.0, 0.95) == pytest.approx(62.07, abs=0.01)


@phase
@pytest.mark.parametrize("g", EVERY_G)
def test_a_shader_has_it_within_its_steps_rounding(either_device, g):
    """At every distance from the peak, down to 1 - cos = 1e-12."""
    apart = np.float32(
        np.concatenate([[0.0, 2.0], np.geomspace(1e-12, 2, 3000), 2 - np.geomspace(1e-6, 2, 3000)])
    )
    size = np.full_like(apart, g)
    body = "density = henyey_greenstein(apart, g);"
    got = evaluate(either_device, PHASE, body, {"apart": apart, "g": size}, {"density": "float"})["density"]
    truth = henyey_greenstein(apart.astype(np.float64), size.astype(np.float64))
    assert (np.abs(got - truth) <= ROUNDED * truth).all()


@phase
@pytest.mark.parametrize("g", [g for g in EVERY_G if abs(g) <= 0.9])
def test_a_shader_s_function_integrates_to_1_with_mean_cosine_g(either_device, g):
    """Within 1e-6 and the rounding of its values, which all might have the same sign, at the float32 nearest to g."""

    def shader(x, g):
        given = {"apart": np.float32(x), "g": np.full(len(x), g, np.float32)}
        body = "density = henyey_greenstein(apart, g);"
        return evaluate(either_device, PHASE, body, given, {"density": "float"})["density"].astype(np.float64)

    total, cosine = over_sphere(shader, g)
    # The nodes are rounded to float32, too. d ln p / d ln x = 3/2 at most: 1.5 ULP of each value.
    assert total == pytest.approx(1.0, abs=1e-6 + 1.5 * ULP)
    assert cosine == pytest.approx(np.float32(g), abs=1e-6 + 1.5 * ULP)


@phase
@pytest.mark.parametrize("angle", [0.0, 1e-4, 1e-3, 0.1, 1.0, 3.0])
def test_directions_near_the_peak_keep_their_digits(either_device, angle):
    """1 - cos from the distance of two unit vectors: each component rounds to ULP / 2 or less, and so |apart|^2 / 2 is
    off by angle * 2 ULP and the square of that; 1 - dot would be off by ULP at every angle."""
    rng = np.random.default_rng(4)
    first = rng.normal(size=(2000, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    beside = np.cross(first, rng.normal(size=(2000, 3)))
    beside /= np.linalg.norm(beside, axis=1, keepdims=True)
    second = np.cos(angle) * first + np.sin(angle) * beside
    given = {"first": np.float32(first), "second": np.float32(second)}
    body = "apart = one_minus_cosine(first, second); naive = 1.0 - dot(first, second);"
    got = evaluate(either_device, PHASE, body, given, {"apart": "float", "naive": "float"})
    exact = 2 * np.sin(angle / 2) ** 2
    bound = (2 * np.sin(angle / 2) + 2 * ULP) * 2 * ULP + 4 * ULP * exact
    assert np.abs(got["apart"] - exact).max() <= bound
    if angle == 1e-4:
        assert np.abs(got["naive"] - exact).max() > 100 * bound, "the usual form loses all digits here"


@phase
def test_an_isotropic_medium_has_no_direction(either_device):
    apart = np.float32(np.linspace(0, 2, 100))
    body = "density = henyey_greenstein(apart, 0.0);"
    got = evaluate(either_device, PHASE, body, {"apart": apart}, {"density": "float"})["density"]
    assert len(np.unique(got)) == 1
    # d is 1: a constant that rounds, and a division of 2.5 units in the last place.
    assert got[0] == pytest.approx(1 / (4 * np.pi), rel=6 * ULP)
