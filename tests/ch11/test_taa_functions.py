"""The functions of temporal anti-aliasing on both backends, against float64: over ordinary and extreme values.

Errors are in units of 2^-24 of the largest number that takes part, which is half a unit of its last place.
"""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.pipelines.vulkan import CHAPTER
from tests.support.either import evaluate
from tests.twins import taa as twin

UNIT = 2.0**-24
LARGEST = 65504.0
SLACK = 2e-6
"""Of constraint.glsl, relative to the largest channel of a box."""
NINE = tuple(f"s{i}" for i in range(9))
GATHER = f"vec3 nine[9] = vec3[9]({', '.join(NINE)}); Neighbourhood n = gathered(nine, jitter); "
BOX = "Neighbourhood n = Neighbourhood(low, high, mean, deviation, mean); "


def file(name):
    return str(CHAPTER / "taa" / name)


def run(device, name, body, inputs, outputs, **defines):
    given = {key: np.float32(values) for key, values in inputs.items()}
    return evaluate(device, [file(name)], body, given, outputs, defines)


def double(values):
    return np.float32(values).astype(np.float64)


def units(got, truth, scale):
    """Return the largest error in units of 2^-24 of `scale`, which is at least the smallest normal number."""
    floor = np.maximum(np.asarray(scale, np.float64), 2.0**-126)
    return (np.abs(got.astype(np.float64) - truth) / (UNIT * floor)).max()


def colors(count=3000, seed=5, lowest=0.0):
    """Return (N, 3) colours from 1e-8 to the largest half, every eighth grey, some channels `lowest`, and extremes."""
    rng = np.random.default_rng(seed)
    found = 10.0 ** rng.uniform(-8, np.log10(LARGEST), (count, 1)) * rng.random((count, 3))
    found[::8] = found[::8, :1]
    found[rng.random((count, 3)) < 0.05] = lowest
    extremes = [(0, 0, 0), (1e-8,) * 3, (LARGEST,) * 3, (LARGEST, 0, 0), (0, LARGEST, 0), (0, 1e-8, LARGEST)]
    return np.float32(np.concatenate([found, extremes]))


# --- colour -----------------------------------------------------------------------------------------------------------


@pytest.mark.feature("taa/ycocg")
def test_ycocg_is_the_matrix_and_comes_back(either_device):
    rgb = colors()
    body = "there = ycocg_from_rgb(color); back = rgb_from_ycocg(there); other = rgb_from_ycocg(signed);"
    signed = rgb * np.random.default_rng(1).choice(np.float32([-1, 1]), rgb.shape)
    outputs = dict.fromkeys(("there", "back", "other"), "vec3")
    got = run(either_device, "color.glsl", body, {"color": rgb, "signed": signed}, outputs)
    peak = rgb.max(axis=1, keepdims=True)
    assert units(got["there"], double(rgb) @ twin.YCOCG.T, peak) <= 2.5
    assert units(got["back"], double(rgb), peak) <= 6
    assert np.abs(got["back"] - rgb)[peak[:, 0] <= 1].max() < 1e-6
    inverse = np.linalg.inv(twin.YCOCG)
    assert units(got["other"], double(signed) @ inverse.T, 3 * peak) <= 2.5
    grey = (rgb == rgb[:, :1]).all(axis=1)
    assert grey.sum() > 300 and (got["there"][~grey, 1:] != 0).any(axis=1).all()
    assert (got["there"][grey, 1:] == 0).all() and np.array_equal(got["back"][grey], rgb[grey])


# --- filters ----------------------------------------------------------------------------------------------------------


@pytest.mark.feature("taa/neighbourhood-statistics")
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_weights_are_those_of_the_filters(either_device, number):
    name = list(twin.LINES)[number - 1]
    rng = np.random.default_rng(number)
    offset = np.concatenate(
        [rng.uniform(-2.5, 2.5, (4000, 2)), rng.integers(-5, 6, (200, 2)) / 2, [(1e-8, 0)]]
    )
    body = f"named = {name}(offset); chosen = sample_weight(offset);"
    outputs = {"named": "float", "chosen": "float"}
    got = run(either_device, "filters.glsl", body, {"offset": offset}, outputs, FILTER=number)
    assert np.array_equal(got["named"], got["chosen"])
    # Blackman-Harris has a cosine, which a GPU may have wrong by 2^-11; software drivers by 2^-22.
    bound = 16 if name != "blackman_harris" else 64
    assert units(got["named"], twin.weight(name, double(offset)), 1.0) <= bound
    outside = np.abs(offset).max(axis=1) >= {1: 1.0, 2: 2.0, 3: 1.5, 4: 2.0}[number]
    assert outside.sum() > 100 and (got["named"][outside] == 0).all()


@pytest.mark.feature("taa/neighbourhood-statistics")
def test_weights_of_whole_pixels_sum_to_one_except_for_the_window():
    """Cubic filters and the tent are partitions of one: it is what makes Mitchell's weights need no division."""
    for name, exact in (
        ("tent", 1e-14),
        ("mitchell", 1e-14),
        ("catmull_rom_weight", 1e-14),
        ("blackman_harris", 0.2),
    ):
        at = np.arange(-3, 4) + np.linspace(-0.5, 0.5, 101)[:, None]
        assert np.abs(twin.LINES[name](at).sum(axis=1) / (1.0 if exact < 0.1 else 1.075) - 1).max() < exact, (
            name
        )


@pytest.mark.feature("taa/neighbourhood-statistics")
def test_the_box_holds_one_sample_of_nine(either_device):
    """Half-open: of samples with whole distances exactly one has weight 1, also with a shift of half a pixel."""
    shift = np.float32(
        np.concatenate([np.random.default_rng(4).uniform(-0.99, 0.99, (500, 2)), [(0.5, -0.5), (0, 0)]])
    )
    body = (
        "count = 0.0; for (int i = 0; i < 9; ++i) count += sample_weight(vec2(i % 3 - 1, i / 3 - 1) - shift);"
    )
    got = run(either_device, "filters.glsl", body, {"shift": shift}, {"count": "float"}, FILTER=0)["count"]
    assert (got == 1).all()


# --- neighbourhoods ---------------------------------------------------------------------------------------------------


def gathered(device, samples, jitter, number=2):
    """Return the members of neighbourhoods of samples (N, 9, 3) with shifts (N, 2)."""
    inputs = {**{name: samples[:, i] for i, name in enumerate(NINE)}, "jitter": jitter}
    found = {}
    for members in (("low", "high"), ("mean", "deviation"), ("filtered",)):  # a stage may have 12 buffers
        body = GATHER + " ".join(f"{name} = n.{name};" for name in members)
        outputs = dict.fromkeys(members, "vec3")
        found |= run(device, "neighbourhood.glsl", body, inputs, outputs, FILTER=number)
    return found


def neighbourhoods(count=1500, seed=9):
    """Return samples (N, 9, 3), smooth ones on a large base among them, and shifts within half a pixel."""
    rng = np.random.default_rng(seed)
    samples = 10.0 ** rng.uniform(-8, 4.8, (count, 1, 3)) * rng.random((count, 9, 3))
    samples[::4] = samples[::4, :1] * (1 + 1e-3 * rng.random((len(samples[::4]), 9, 3)))
    samples[1::4] *= rng.choice([-1, 1], samples[1::4].shape)  # as differences of colours are
    samples[2::64, :, :] = 0.0
    samples[3::64, 5] = LARGEST
    return np.float32(samples.clip(-LARGEST, LARGEST)), np.float32(rng.uniform(-0.5, 0.5, (count, 2)))


@pytest.mark.feature("taa/neighbourhood-statistics")
@pytest.mark.parametrize("number", [0, 1, 2, 3, 4])
def test_statistics_are_those_of_numpy(either_device, number):
    samples, jitter = neighbourhoods()
    got = gathered(either_device, samples, jitter, number)
    exact, scale = double(samples), np.abs(samples).max(axis=1)
    assert np.array_equal(got["low"], samples.min(axis=1))
    assert np.array_equal(got["high"], samples.max(axis=1))
    assert units(got["mean"], exact.mean(axis=1), scale) <= 8
    # Two passes: the error is that of the differences, also where they are a thousandth of the mean.
    assert units(got["deviation"], exact.std(axis=1), scale) <= 8
    assert (got["deviation"] >= 0).all()
    if number == 0:
        assert np.array_equal(got["filtered"], samples[:, 4])
    else:
        truth = twin.filtered(exact, double(jitter), list(twin.LINES)[number - 1])
        assert units(got["filtered"], truth, scale) <= (40 if number != 3 else 80)


@pytest.mark.feature("taa/neighbourhood-statistics")
@pytest.mark.parametrize("number", [0, 1, 2, 3, 4])
def test_a_constant_stays_a_constant_to_the_bit(either_device, number):
    values = np.concatenate([colors(1500), -colors(100, seed=6)])
    jitter = np.random.default_rng(2).uniform(-0.7, 0.7, (len(values), 2))
    got = gathered(either_device, np.repeat(values[:, None], 9, axis=1), jitter, number)
    for name in ("low", "high", "mean", "filtered"):
        assert np.array_equal(got[name], values), name
    assert (got["deviation"] == 0).all()


@pytest.mark.feature("taa/neighbourhood-statistics", "taa/projection-jitter")
def test_a_ramp_that_is_moved_is_filtered_to_what_it_was(either_device):
    """A picture shifted by j has, at pixel p, the steady value of p - j: with the shift the middle is found again.

    The tent does so exactly, from the four samples around the middle. Cubic filters reproduce linear functions with all
    of their 16 weights, and with the nine that lie in the 3x3 within some per cent of the slope.
    """
    jitter = np.random.default_rng(3).uniform(-0.5, 0.5, (500, 2))
    slope = np.array([(0.25, 0.5), (1.0, 0.0), (0.0, -2.0)])  # of three channels, right and down
    at = np.array([twin.positions(one) for one in double(jitter)])
    samples = 7.0 + at @ slope.T
    for number, bound in ((1, 1e-5), (2, 0.15), (4, 0.15)):
        got = gathered(either_device, samples, jitter, number)["filtered"]
        assert np.abs((got - 7.0) / np.abs(slope).sum(axis=1)).max() < bound
        turned = gathered(either_device, samples, -jitter, number)["filtered"]
        assert np.abs(turned - 7.0).max() > 0.5, "the other sign would be seen"
    alone = gathered(either_device, samples, jitter, 0)["filtered"]
    assert np.abs(alone - 7.0).max() > 0.4


# --- constraints ------------------------------------------------------------------------------------------------------


def boxes(count=4000, seed=12):
    """Return histories and boxes with low <= high, (N, 3) each: thin and flat ones, and signed ones, among them."""
    rng = np.random.default_rng(seed)
    size = 10.0 ** rng.uniform(-8, 4, (count, 1))
    a, b, history = (size * rng.uniform(-0.2, 1, (count, 3)) for _ in range(3))
    history[::3] *= 10.0 ** rng.uniform(0, 4, (len(history[::3]), 1))
    b[rng.random((count, 3)) < 0.1] = 0.0
    flat = rng.random((count, 3)) < 0.1
    b[flat] = a[flat]
    b[::16] = a[::16]
    history[1::16] = (a[1::16] + b[1::16]) / 2
    low, high = np.minimum(a, b), np.maximum(a, b)
    low[-3:], high[-3:] = 0, ((0, 0, 0), (1e-8,) * 3, (LARGEST,) * 3)
    history[-3:] = LARGEST
    return np.float32(history), np.float32(low), np.float32(high)


@pytest.mark.feature("taa/rgb-clamp-and-clip")
def test_a_clipped_history_is_in_the_box_and_on_the_way_to_its_middle(either_device):
    history, low, high = boxes()
    inputs = {"history": history, "low": low, "high": high}
    body = "kept = clipped(history, low, high);"
    kept = run(either_device, "constraint.glsl", body, inputs, {"kept": "vec3"}, FILTER=0)["kept"]
    assert (kept >= low).all() and (kept <= high).all()
    inside = ((history >= low) & (history <= high)).all(axis=1)
    assert inside.sum() > 100 and np.array_equal(kept[inside], history[inside])
    # Boxes thinner than the slack on an axis are left at another place, but by no more than that beside the way.
    scale = np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True).astype(np.float64)
    slack = SLACK * scale + 1e-8
    way = double(history) - (double(low) + double(high)) / 2
    taken = kept - (double(low) + double(high)) / 2
    share = (way * taken).sum(axis=1, keepdims=True) / np.maximum(
        (way * way).sum(axis=1, keepdims=True), 1e-300
    )
    assert (np.abs(taken - share * way) <= 1.01 * np.sqrt(3) * slack + 4 * UNIT * scale).all()
    sure = ((double(high) - double(low)) / 2 > slack).all(axis=1)
    assert sure.sum() > 1000 and (~sure).sum() > 300
    truth = twin.clipped(double(history), double(low), double(high))
    stiff = stiffness(double(low), double(high), (double(low) + double(high)) / 2)
    assert (np.abs(kept - truth) <= 8 * UNIT * scale * stiff)[sure].all()
    # The other pixels agree in a channel, and a history that is off by its rounding there keeps what it has elsewhere.
    flat = np.float32([[0.5, 0.25, 0.3]]), np.float32([[0.5, 0.75, 0.9]])
    near = np.float32([[np.nextafter(np.float32(0.5), np.float32(1)), 0.7, 0.35]])
    inputs = {"history": near, "low": flat[0], "high": flat[1]}
    kept = run(either_device, "constraint.glsl", body, inputs, {"kept": "vec3"}, FILTER=0)["kept"]
    assert np.array_equal(kept, np.float32([[0.5, 0.7, 0.35]]))


def stiffness(low, high, middle):
    """Return (N, 1): how far an error of a plane moves the other channels, from the way to the sides of boxes."""
    edges = 2 * np.minimum(high - middle, middle - low)
    shortest = np.maximum(edges.min(axis=1, keepdims=True), 1e-300)
    return np.maximum(np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True) / shortest, 1.0)


def constrained(device, number, history, low, high, mean, deviation, **defines):
    inputs = {"history": history, "low": low, "high": high, "mean": mean, "deviation": deviation}
    body = BOX + "kept = constrained(history, n);"
    given = {"CONSTRAINT": number, "FILTER": 0, **defines}
    return run(device, "constraint.glsl", body, inputs, {"kept": "vec3"}, **given)["kept"]


@pytest.mark.feature("taa/rgb-clamp-and-clip", "taa/variance-clip", "taa/variance-clip-clamped")
@pytest.mark.parametrize("gamma", [1.0, 0.75])
def test_each_constraint_is_its_box(either_device, gamma):
    samples, _ = neighbourhoods(2000, seed=21)
    exact = double(samples)
    low, high, mean, deviation = exact.min(1), exact.max(1), double(exact.mean(1)), double(exact.std(1))
    rng = np.random.default_rng(22)
    history = double(mean + (high - low) * rng.uniform(-3, 3, mean.shape))
    given = (history, low, high, mean, deviation)
    scale = np.abs(np.stack([history, low, high])).max(axis=(0, 2))[:, None]
    assert np.array_equal(constrained(either_device, 0, *given), history)
    clamped = history.clip(low, high)
    assert np.array_equal(constrained(either_device, 1, *given), clamped)
    reach = gamma * deviation
    both = np.maximum(low, mean - reach), np.minimum(high, mean + reach)
    boxes = {2: (low, high), 3: (mean - reach, mean + reach), 4: both}
    truth = {
        2: twin.clipped(history, low, high),
        3: twin.clipped(history, mean - reach, mean + reach),
        4: twin.clipped(history, *both, middle=mean),
    }
    for number, wanted in truth.items():
        kept = constrained(either_device, number, *given, GAMMA=gamma)
        at = boxes[number]
        slack = SLACK * np.abs(at).max(axis=(0, 2))[:, None] + 1e-8
        middle = mean if number == 4 else (at[0] + at[1]) / 2
        sure = (np.minimum(at[1] - middle, middle - at[0]) > 1.001 * slack).all(axis=1)
        assert sure.sum() > 400
        assert (np.abs(kept - wanted) <= 16 * UNIT * scale * stiffness(*at, middle))[sure].all(), number
        if number != 2:
            slack = 2 * UNIT * scale
            assert (kept >= mean - reach - slack).all() and (kept <= mean + reach + slack).all()
    far = np.abs(truth[3] - truth[4]).max(axis=1) > 1e-3 * scale[:, 0]
    assert far.sum() > 10, "the smaller box is another thing"
    away = [np.abs(truth[number] - mean) for number in (3, 4)]
    assert (away[1] <= away[0] + 1e-12 * scale).all(), "never further from the mean than with its box alone"


@pytest.mark.feature("taa/variance-clip")
def test_without_variance_only_the_mean_is_left(either_device):
    color = colors(500)
    still = np.zeros_like(color)
    for number in (3, 4):
        kept = constrained(either_device, number, color[::-1], color, color, color, still)
        assert np.array_equal(kept, color)
        wide = constrained(either_device, number, color[::-1], 0 * color, color + 1, color, color + 1)
        assert not np.array_equal(wide, color)


# --- weights ----------------------------------------------------------------------------------------------------------


def weighed(device, number, current, history, low, high, share, **defines):
    """Return (N, 2): weights of the current colour and of the history."""
    inputs = {"current": current, "history": history, "low": low, "high": high, "share": share}
    body = "vec3 mean = low, deviation = low; " + BOX + "found = weights(current, history, n, share);"
    given = {"WEIGHT": number, "FILTER": 0, **defines}
    return run(device, "weights.glsl", body, inputs, {"found": "vec2"}, **given)["found"]


def grey(values):
    return np.repeat(np.float32(values)[:, None], 3, axis=1)


def luminance(values, ycocg):
    return np.maximum(double(values)[:, 0] if ycocg else double(values) @ twin.BT709, 0.0)


def test_the_base_weights_are_the_share_and_the_rest(either_device):
    color = colors(10)
    share = np.full(len(color), np.float32(0.1))
    got = weighed(either_device, 0, color, color, color, color, share)
    assert (got == np.float32((0.1, 0.9))).all()


SPACES = pytest.mark.parametrize("space", [{}, {"YCOCG": 1}], ids=["rgb", "ycocg"])


@pytest.mark.feature("taa/temporal-filter")
@SPACES
def test_the_weight_by_contrast_is_between_its_bounds(either_device, space):
    current, other, history = colors(2000, 1, -1.0), colors(2000, 2), colors(2000, 3)
    low, high = np.minimum(current, other), np.maximum(current, other)
    share = np.random.default_rng(7).choice(np.float32([0.01, 0.1, 0.25, 0.5, 1.0]), len(current))
    got = weighed(either_device, 1, current, history, low, high, share, **space)
    assert np.isfinite(got).all()
    now, least, most = (luminance(one, "YCOCG" in space) for one in (current, low, high))
    truth = twin.by_contrast(now, least, most) * twin.young(share)
    # The quotient is exact to some units of the two luminances that are subtracted.
    bound = 8 * UNIT * (1 + most / np.maximum(now, 1e-4)) + 8 * UNIT
    assert (np.abs(got[:, 1] - truth) <= bound).all()
    usual = share <= 0.1
    assert got[usual, 1].min() >= np.float32(0.25) and got[usual, 1].max() <= np.float32(0.85)
    assert np.abs(got.sum(axis=1) - 1).max() <= 2 * UNIT and (got[share == 1] == (1, 0)).all()
    black = grey(np.zeros(1))
    assert np.allclose(weighed(either_device, 1, black, black, black, black, np.float32([0.1])), (0.75, 0.25))


@pytest.mark.feature("taa/inverse-luminance-filter")
@SPACES
def test_one_bright_pixel_counts_by_its_inverse_luminance(either_device, space):
    bright, dark = colors(2000, 4, -1.0), colors(2000, 5)
    share = np.full(len(bright), np.float32(0.1))
    got = weighed(either_device, 2, bright, dark, dark, dark, share, **space)
    inverse = [1 / (1 + luminance(one, "YCOCG" in space)) for one in (bright, dark)]
    truth = np.stack([double(0.1) * inverse[0], (1 - double(0.1)) * inverse[1]], axis=1)
    assert (np.abs(got - truth) <= 12 * UNIT * truth).all()
    level = np.float32([0.0, 1.0, 3.0, 99.0, LARGEST])
    one = weighed(either_device, 2, grey(level), grey(0 * level), grey(level), grey(level), share[:5])[:, 0]
    assert np.allclose(one * (1 + level), one[0], rtol=1e-6)
    assert not np.allclose(
        weighed(either_device, 0, *(grey(level),) * 4, share[:5]) * (1 + level[:, None]), one[0]
    )


@pytest.mark.feature("taa/luminance-difference-filter")
@SPACES
def test_the_weight_by_difference_is_largest_where_nothing_differs(either_device, space):
    current, history = colors(3000, 6, -1.0), colors(3000, 7)
    history[::5] = current[::5]
    share = np.random.default_rng(8).choice(np.float32([0.01, 0.1, 0.25, 0.5, 1.0]), len(current))
    got = weighed(either_device, 3, current, history, current, current, share, **space)
    now, before = (luminance(one, "YCOCG" in space) for one in (current, history))
    truth = twin.by_difference(now, before) * twin.young(share)
    assert np.abs(got[:, 1] - truth).max() <= 8 * UNIT
    usual = share <= 0.1
    assert got[usual, 1].min() >= np.float32(0.88) and got[usual, 1].max() <= np.float32(0.97)
    equal = usual.copy()
    equal[np.arange(len(equal)) % 5 != 0] = False
    assert equal.sum() > 100 and (got[equal, 1] == np.float32(0.97)).all()
    assert (got[share == 1] == (1, 0)).all()


@pytest.mark.feature("taa/luminance-difference-filter")
def test_a_larger_difference_never_weighs_the_history_more(either_device):
    for level in (0.0, 1e-8, 0.1, 0.2, 1.0, 700.0):
        for other in (
            np.linspace(level, LARGEST, 1000),
            np.geomspace(level + 1e-8, LARGEST, 1000),
            np.linspace(level, 0, 1000),
        ):
            now, before = grey(np.full(1000, level)), grey(other)
            for pair in ((now, before), (before, now)):
                weight = weighed(either_device, 3, *pair, now, now, np.full(1000, 0.1))[:, 1]
                assert (np.diff(weight.astype(np.float64)) <= 2 * UNIT).all()
                assert weight[0] >= 0.97 - 1e-6
                # The printed form has the two weights exchanged: its history would weigh least where nothing differs.
                assert weight[0] > weight[-1] or np.ptp(other) < 1e-7
    odd = weighed(
        either_device, 3, grey([1.0]), grey([0.0]), grey([1.0]), grey([1.0]), [0.1], HISTORY_LEAST=0.5
    )
    assert odd[0, 1] == 0.5
