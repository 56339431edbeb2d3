"""Sub-pixel shifts: the sequences against their definitions, and how far the projection moves a point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch11.taa.jitter import SEQUENCES, offset, offsets, raw
from common import layouts
from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, Perspective, View
from tests.twins import taa as twin

PERIODS = (1, 2, 3, 4, 5, 8, 16, 61, 64, 1000)


def gradient(x, y):
    """Return Jimenez's noise at a place."""
    return math.fmod(52.9829189 * math.fmod(0.06711056 * x + 0.00583715 * y, 1.0), 1.0)


REFERENCE = {
    "halton": lambda n, period: (twin.digits_mirrored(n + 1, 2), twin.digits_mirrored(n + 1, 3)),
    "r2": lambda n, period: tuple((0.5 + n * step) % 1.0 for step in twin.lattice_step()),
    "hammersley": lambda n, period: (n / period, twin.digits_mirrored(n, 2)),
    "interleaved-gradient": lambda n, period: (gradient(n, 0), gradient(0, n)),
}


@pytest.mark.feature("taa/jitter-sequences")
@pytest.mark.parametrize("sequence", SEQUENCES)
def test_values_are_those_of_the_definition(sequence):
    for period in (4, 16, 1000):
        found = raw(sequence, np.arange(period), period)
        assert found.shape == (period, 2) and found.dtype == np.float64
        truth = np.array([[float(part) for part in REFERENCE[sequence](n, period)] for n in range(period)])
        assert np.abs(found - truth).max() < 1e-11  # steps of R2 by numpy's root, times 1000
        assert found.min() >= 0.0 and found.max() < 1.0


@pytest.mark.feature("taa/jitter-sequences")
def test_the_first_values_are_those_of_the_tables():
    table = {
        "halton": [(1 / 2, 1 / 3), (1 / 4, 2 / 3), (3 / 4, 1 / 9), (1 / 8, 4 / 9)],
        "r2": [(0.5, 0.5), (0.25487767, 0.06984029), (0.00975533, 0.63968058), (0.764633, 0.20952087)],
        "hammersley": [(0, 0), (1 / 4, 1 / 2), (1 / 2, 1 / 4), (3 / 4, 3 / 4)],
    }
    for sequence, values in table.items():
        assert np.abs(raw(sequence, [0, 1, 2, 3], 4) - values).max() < 1e-8, sequence
    assert np.abs(raw("r2", 3, 4) - table["r2"][3]).max() < 1e-8, "a single index has a single point"


@pytest.mark.feature("taa/jitter-sequences")
@pytest.mark.parametrize("sequence", SEQUENCES)
def test_a_period_has_a_mean_of_zero_and_the_distances_of_its_points(sequence):
    for period in PERIODS:
        found = offsets(sequence, period)
        mean = [math.fsum(axis) / period for axis in found.T]
        assert np.abs(mean).max() < 1e-16, period
        points = raw(sequence, np.arange(period), period)
        assert np.abs((found - found[0]) - (points - points[0])).max() < 1e-15
        assert np.abs(found).max() < 1.0
        assert len(np.unique(found, axis=0)) == period
        with pytest.raises(ValueError):
            found[0] = 0.0
    assert offsets(sequence, 1).tolist() == [[0.0, 0.0]]
    # The window's size is one pixel, and a period of four stays within it.
    assert np.abs(offsets(sequence, 4)).max() < 0.5


@pytest.mark.feature("taa/jitter-sequences")
@pytest.mark.parametrize("sequence", SEQUENCES)
def test_frames_wrap_at_the_period(sequence):
    one = offsets(sequence, 4)
    for frame in (0, 1, 3, 4, 5, 4 * 10**9 + 2):
        assert offset(sequence, 4, frame) == tuple(one[frame % 4])
    assert all(type(part) is float for part in offset(sequence, 4, 2))


@pytest.mark.feature("taa/jitter-sequences")
def test_points_are_spread_over_the_pixel():
    """Of 64 points, each sixteenth of the window has between a quarter and four times its share."""
    for sequence in SEQUENCES:
        points = raw(sequence, np.arange(64), 64)
        counts, *_ = np.histogram2d(*points.T, bins=4, range=((0, 1), (0, 1)))
        assert counts.min() >= 1 and counts.max() <= 16, sequence


@pytest.mark.feature("taa/jitter-sequences")
def test_other_names_and_periods_are_refused():
    with pytest.raises(ValueError, match="'sobol' is no sequence; there are halton, r2, hammersley, interl"):
        offsets("sobol", 4)
    for period in (0, -3):
        with pytest.raises(ValueError, match=f"at least one frame, not {period}"):
            offset("halton", period, 0)


# --- the projection ---------------------------------------------------------------------------------------------------

SIZE = (640, 360)
EYE = pose_looking_at((1.0, 2.0, 6.0), (0.0, 0.5, 0.0))
LENSES = {"perspective": Perspective(0.9, 0.05), "orthographic": Orthographic(3.0, 0.1, 40.0)}


def pixels_of(matrix, points, size=SIZE):
    """Return (N, 2): where a record's matrix, stored by columns, draws points: pixels right and down."""
    clip = np.column_stack([points, np.ones(len(points))]) @ matrix.astype(np.float64)
    return (clip[:, :2] / clip[:, 3:] * 0.5 + 0.5) * size


@pytest.fixture(params=LENSES)
def lens(request):
    return LENSES[request.param]


def record_of(lens, **more):
    record = np.zeros((), layouts.dtype("FrameConstants"))
    view = View(EYE, lens)
    layouts.fill_frame_constants(record, view, view, SIZE, origin=(0, 0, 0), length_scale=1.0, **more)
    return record


@pytest.mark.feature("taa/projection-jitter")
@pytest.mark.parametrize("jitter", [(0.25, 0.0), (0.0, 0.5), (-0.375, 0.125), (0.5, -0.5)])
def test_a_point_moves_by_the_shift_right_and_down(lens, jitter):
    """In the view to 1e-6; through the view's matrix, too, as far as float32 elements of both products differ."""
    points = np.random.default_rng(3).uniform(-1.5, 1.5, (200, 3))
    record = record_of(lens, jitter_px=jitter, previous_jitter_px=(0.125, -0.25))
    viewed = points + np.array((0, 0, -4))
    moved = pixels_of(record["clip_from_view"], viewed) - pixels_of(record["steady_clip_from_view"], viewed)
    assert np.abs(moved - jitter).max() < 1e-6
    before = pixels_of(record["steady_clip_from_world"], points)
    assert np.abs(pixels_of(record["clip_from_world"], points) - before - jitter).max() < 3e-4
    assert (
        np.abs(pixels_of(record["previous_clip_from_world"], points) - before - (0.125, -0.25)).max() < 3e-4
    )
    # Right and down as seen: what lies to the right in the view is further right, what lies above is less far down.
    right, up = EYE[:3, 0], EYE[:3, 1]
    middle, towards_right, above = pixels_of(
        record["steady_clip_from_world"],
        np.array([[0, 0.5, 0], 0.1 * right + (0, 0.5, 0), 0.1 * up + (0, 0.5, 0)]),
    )
    assert towards_right[0] > middle[0] + 1 and above[1] < middle[1] - 1


@pytest.mark.feature("taa/projection-jitter", "taa/jitter-sequences")
def test_the_record_holds_the_shifts_of_both_frames(lens):
    now, before = offset("halton", 4, 6), offset("halton", 4, 5)
    record = record_of(lens, jitter_px=now, previous_jitter_px=before)
    assert np.allclose(record["jitter"], np.array(now) * 2 / SIZE, rtol=1e-7, atol=0)
    assert np.allclose(record["previous_jitter"], np.array(before) * 2 / SIZE, rtol=1e-7, atol=0)


@pytest.mark.feature("taa/projection-jitter")
def test_steady_matrices_and_depth_know_nothing_of_the_shift(lens):
    still, shifted = record_of(lens), record_of(lens, jitter_px=(0.3, -0.4))
    for name in (
        "steady_clip_from_view",
        "steady_clip_from_world",
        "steady_world_from_clip",
        "view_from_world",
    ):
        assert np.array_equal(still[name], shifted[name])
    assert np.array_equal(still["clip_from_world"], still["steady_clip_from_world"])
    assert np.array_equal(shifted["clip_from_world"][:, 2:], still["clip_from_world"][:, 2:])
    assert not np.array_equal(shifted["clip_from_world"], still["clip_from_world"])
