"""The figures and the loop of chapter 10 are true: phase, slices, the medium, jitter, the series and lookups."""

from __future__ import annotations

import math

import numpy as np
import pytest

from common.numerics import blue_noise
from tests.twins import fog as twin
from tests.twins.fog_grid import Grid
from tools.site.figures.canvas import Canvas
from tools.site.figures.ch10 import froxels, jitter, lookup, medium, passes, phase, series


def words_of(canvas: Canvas) -> list[str]:
    return [text for text, _ in canvas.texts]


@pytest.mark.parametrize("g", [*phase.ANISOTROPIES, -0.4])
def test_phase_functions_are_those_of_the_twin_and_have_the_integral_one(g):
    cosines, weights = np.polynomial.legendre.leggauss(400)
    values = np.array([phase.phase(cosine, g) for cosine in cosines])
    np.testing.assert_allclose(values, twin.henyey_greenstein(1 - cosines, g), rtol=1e-12)
    assert abs(2 * math.pi * (weights @ values) - 1) < 1e-9
    assert (
        0 < phase.radius(phase.phase(-1, abs(g))) <= phase.radius(phase.phase(1, abs(g))) < 1.1 * phase.RADIUS
    )


def test_slices_end_where_those_of_the_grid_end():
    count, near, far = froxels.RULER, froxels.RULER_NEAR, froxels.RULER_FAR
    grid = Grid((1, 1, count), near, far, np.eye(4), np.eye(4))
    ends = [froxels.end_of(index, count, near, far) for index in range(-1, count)]
    np.testing.assert_allclose(ends, grid.edges(), rtol=1e-12)
    words = words_of(froxels.froxels_from_above())
    ratio = (froxels.FAR / froxels.NEAR) ** (1 / froxels.SLICES)
    assert any(f"{ratio:.2f} times" in word for word in words)


def test_parts_of_the_medium_are_those_of_the_twin_and_noise_has_the_mean_one():
    heights = np.linspace(0.0, medium.TOP, 401)
    points = np.stack([0 * heights, heights, 0 * heights], axis=-1)
    middle, half = sum(medium.BOX) / 2, (medium.BOX[1] - medium.BOX[0]) / 2
    parts = twin.Medium(
        medium.CONSTANT,
        (1.0, 1.0, 1.0),
        twin.Height(medium.HEIGHT, medium.FALLOFF, medium.BASE, (1.0, 1.0, 1.0)),
        (twin.Box((0.0, middle, 0.0), (1.0, half, 1.0), medium.DENSITY, (1.0, 1.0, 1.0)),),
    )
    extinction = parts.at(points)[:, 3]
    shown = [medium.constant(y) + medium.height(y) + medium.box(y) for y in heights]
    sure = np.abs(np.abs(heights - middle) - half) > 1e-6
    np.testing.assert_allclose(np.array(shown)[sure], extinction[sure], rtol=1e-12)
    factors = [medium.noise((i + 0.5) / 400) for i in range(400)]
    assert abs(np.mean(factors) - 1) < 1e-9 and min(factors) > 0
    assert max(medium.total(y) for y in heights) <= medium.MOST


def test_samples_are_turned_as_in_the_shader_and_their_mean_is_the_lit_part():
    for rank in (0, 5000, 16383):
        for frame in range(12):
            there = (rank + 0.5) / 2**14
            apart = jitter.part(there, frame, 0) - float(blue_noise.animated(rank, frame))
            assert min(abs(apart), 1 - abs(apart)) < 1e-6
    assert jitter.part(0.3, 4, 3) == jitter.part(0.3, 7, 0)
    first, last = jitter.means()[0], jitter.means()[-1]
    assert set(first) == {0.0, 1.0}
    # The golden ratio's count is off by at most 2 in a Fibonacci number of frames, and so by 3 here.
    assert np.abs(np.array(last) - jitter.EDGES).max() <= 3 / jitter.SHOWN


def test_the_series_keeps_what_the_quotient_loses():
    depths, quotient, kept = (np.array(values) for values in series.largest_errors())
    assert (quotient[depths < 1e-8] > 0.99).all(), "all light is gone"
    assert kept.max() < 1e-6 and (quotient[depths < 1e-4] > 100 * kept[depths < 1e-4]).all()


def test_a_lookup_by_record_is_exact_and_one_between_ends_is_not():
    far = froxels.end_of(lookup.SHOWN - 1, lookup.COUNT, lookup.NEAR, lookup.FAR)
    depths = [far * i / 100 for i in range(101)]
    right = np.array([lookup.exact(depth) for depth in depths])
    np.testing.assert_allclose([lookup.within_slice(depth) for depth in depths], right, rtol=1e-12)
    off = np.abs(np.array([lookup.between_ends(depth) for depth in depths]) - right)
    first = np.array(depths) < froxels.end_of(0, lookup.COUNT, lookup.NEAR, lookup.FAR)
    assert off[first].max() > 0.2 and 0.01 < off[~first].max() < off[first].max()


def test_passes_stand_in_the_order_of_the_chapter():
    from chapters.ch10.fog.passes import FOG_PASSES

    names = [kind.name for kind in FOG_PASSES if kind.name not in ("fog_noise", "fog_half")]
    assert [name for name, *_ in passes.PASSES] == names
    shown = words_of(passes.passes_of_fog())
    assert all(name in shown for name in names)
