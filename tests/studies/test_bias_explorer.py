"""The study bias-explorer: its maps, acne and gaps against comparisons in float64, and the bounds that follow."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch08.studies.bias_explorer import Settings

pytestmark = pytest.mark.feature("shadows/depth-bias")
WHICH = "8/bias-explorer"
NONE, CONSTANT, SLOPE, BOTH, PLANE = range(5)
TILTS = np.arange(0, 90, 5)
SIDE, MARGIN, MIDDLE, HEIGHT, SAMPLES = 16, 4, 512.37, 4.0, 64
STEP = 2.0**-24 * 1024
"""Texels of a step of depth: a float between 1/2 and 1, over a range of 1,024 texels."""

ROUNDED = 12 * STEP
"""Texels that the depths of map and receiver may be off: some roundings each, of numbers up to 1,024."""

CELLS = [(column, row) for row in range(5) for column in range(18)]


def measured(stage, size=(36, 20), **knobs):
    """Return the table of a frame, its maps, its picture and its counters."""
    with stage.open(WHICH, size, settings=Settings(**knobs)) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        work = frame.work
        return renderer.failures(), renderer.maps().astype(np.float64), frame.image("color"), work


def slopes(degrees, turn):
    """Return the slopes of the plane's depth along rows and columns of texels."""
    return np.tan(np.radians(degrees)) * np.array([np.cos(np.radians(turn)), np.sin(np.radians(turn))])


def map_of(degrees, turn):
    """Return (24, 24) depths at the centres of texels, in texels from the light."""
    y, x = np.mgrid[-MARGIN : SIDE + MARGIN, -MARGIN : SIDE + MARGIN] + 0.5
    gx, gy = slopes(degrees, turn)
    plane = MIDDLE + gx * (x - SIDE / 2) + gy * (y - SIDE / 2)
    lifted = np.maximum(y, 0.0) * HEIGHT / SIDE / np.cos(np.radians(degrees))
    return np.where(x >= SIDE / 2, plane - lifted, plane)


def expected(degrees, turn, radius, constant, slope, bias):
    """Return (least, most) of acne and of the gap in a cell; between them is what rounding decides."""
    stored, (gx, gy) = map_of(degrees, turn), slopes(degrees, turn)
    y, x = (np.mgrid[:SAMPLES, :SAMPLES] + 0.5) * SIDE / SAMPLES
    depth = MIDDLE + gx * (x - SIDE / 2) + gy * (y - SIDE / 2)
    less = (bias in (CONSTANT, BOTH, PLANE)) * constant * STEP
    less += (bias in (SLOPE, BOTH)) * slope * max(abs(gx), abs(gy))
    some_hidden, some_lit = np.zeros((2, SAMPLES, SAMPLES), bool), np.zeros((2, SAMPLES, SAMPLES), bool)
    for dy in range(-radius, radius + 1):
        for dx in range(-radius, radius + 1):
            column, row = np.floor(x).astype(int) + dx, np.floor(y).astype(int) + dy
            compared = depth - less
            if bias == PLANE:
                compared = compared + gx * (column + 0.5 - x) + gy * (row + 0.5 - y)
            ahead = compared - stored[row + MARGIN, column + MARGIN]
            some_hidden |= [ahead > ROUNDED, ahead > -ROUNDED]
            some_lit |= [ahead < -ROUNDED, ahead < ROUNDED]
    bare, below = np.floor(x) + radius < SIDE / 2, np.floor(x) - radius >= SIDE / 2
    acne = [(hidden & bare).sum() for hidden in some_hidden]
    heights = (np.arange(SAMPLES) + 0.5) / SAMPLES * HEIGHT
    gap = [max(heights[(lit & below).any(1)], default=0.0) for lit in some_lit]
    return acne, gap


@pytest.mark.parametrize("turn", [0.0, 20.0])
def test_a_map_has_the_depth_of_the_nearest_surface_at_each_centre(stage, turn):
    _, maps, _, _ = measured(stage, turn=turn)
    for degrees, found in zip(TILTS, maps, strict=True):
        assert np.abs(found - map_of(degrees, turn)).max() < ROUNDED, degrees


@pytest.mark.parametrize(
    ("turn", "radius", "slope"), [(0.0, 0, 1.5), (45.0, 0, 1.5), (30.0, 1, 1.5), (10.0, 3, 4.0)]
)
def test_the_table_is_that_of_comparisons_in_float64(stage, turn, radius, slope):
    found, _, _, work = measured(stage, turn=turn, radius=radius, slope=slope)
    for column, row in CELLS:
        acne, gap = expected(TILTS[column], turn, radius, 4.0, slope, row)
        assert acne[0] <= found["acne"][row, column] <= acne[1], (column, row)
        assert gap[0] <= found["gap"][row, column] <= gap[1], (column, row)
    names = ("none", "constant", "slope", "both", "plane")
    assert [work[f"acne_{name}"] for name in names] == found["acne"].sum(axis=1).tolist()
    assert [work[f"gap_{name}"] for name in names] == np.round(1000 * found["gap"].max(axis=1)).tolist()


@pytest.mark.parametrize("turn", [0.0, 20.0, 45.0, 90.0])
def test_constant_4_and_slope_1_5_leave_no_acne_and_a_gap_below_two_texels(stage, turn):
    """From the centre of a texel to its edge, depth changes by half of both slopes: 1.5 of the larger one is more. A
    sheet casts its shadow once it is farther above the plane than the bias and that half, both times the cosine."""
    found, _, _, _ = measured(stage, turn=turn)
    assert (found["acne"][[BOTH, PLANE]] == 0).all()
    across = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    most = (1.5 * max(across) + 0.5 * sum(across)) * np.sin(np.radians(TILTS))
    # The height at the centre of a row of texels stands for the row; heights are sampled in steps of a sixteenth.
    assert (found["gap"][BOTH] <= most + 0.5 * HEIGHT / SIDE + HEIGHT / SAMPLES + 1e-6).all()
    assert found["gap"][BOTH].max() < 2.0 < most.max() + 0.25 and found["gap"][BOTH].max() > 1.0
    assert found["gap"][PLANE].max() <= 0.5 * HEIGHT / SIDE, "the plane alone needs no such gap"
    assert (found["acne"][NONE, 1:] > 500).all(), (
        "without bias, about half of all points are in their own shadow"
    )


def test_a_filter_needs_more_slope_than_the_literature_s(stage):
    """With a radius of 1 a tap may be 1.5 texels away along both axes. The plane's depth at each tap needs no more."""
    less, _, _, _ = measured(stage, turn=45.0, radius=1)
    enough, _, _, _ = measured(stage, turn=45.0, radius=1, slope=3.01)
    assert (less["acne"][BOTH, 1:] > 0).all() and not less["acne"][PLANE].any()
    assert not enough["acne"][BOTH].any()
    assert enough["gap"][BOTH].max() > less["gap"][BOTH].max() > less["gap"][PLANE].max()
    assert less["gap"][PLANE].max() < 2.0 + 1.0, "two texels and the radius"


def test_a_constant_answers_to_rounding_and_to_no_slope(stage):
    """A plane that is compared with itself at each texel still has acne: map and receiver round its depth differently.
    Four steps of depth end that, and change nothing on a slope that is not followed."""
    without, _, _, _ = measured(stage, turn=45.0, constant=0.0)
    found, _, _, _ = measured(stage, turn=45.0)
    assert without["acne"][PLANE].any() and not found["acne"][PLANE].any()
    assert found["acne"][CONSTANT, 0] == 0 and (found["acne"][CONSTANT, 1:] > 500).all()
    large, _, _, _ = measured(stage, turn=45.0, constant=2e4)
    assert large["acne"][CONSTANT].sum() < found["acne"][CONSTANT].sum()
    assert large["gap"][CONSTANT, 0] > 1.0, (
        "where it is enough for slopes, it detaches shadows on planes that need none"
    )


def test_the_picture_shows_both_failures_and_none_for_the_plane(stage):
    """Red in the left halves of the upper rows, yellow bars in the right halves as high as the table says."""
    found, _, picture, _ = measured(stage, size=(18 * 32, 5 * 64), turn=45.0)
    cells = picture[..., :3].reshape(5, 64, 18, 32, 3).transpose(0, 2, 1, 3, 4).astype(int)
    red = (cells[..., 0] > 200) & (cells[..., 1] < 60)
    yellow = (cells[..., 0] > 230) & (cells[..., 2] < 110)
    assert red[NONE, 1:].any(axis=(1, 2)).all() and not red[BOTH].any() and not red[PLANE].any()
    assert not red[..., 16:].any() and not yellow[..., :16].any()
    bars = yellow[BOTH].any(axis=2).sum(axis=1) / 64 * HEIGHT
    shown = (found["gap"][BOTH] > 0.3) & (found["gap"][BOTH] < 3.5)
    assert shown.sum() > 10
    assert (np.abs(bars - found["gap"][BOTH])[shown] < 0.3).all()
    assert yellow[PLANE].sum() < 0.02 * yellow[BOTH].sum() + 20
