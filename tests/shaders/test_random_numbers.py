"""Random streams and scrambled Sobol points: bits against whole numbers in Python, and their statistics."""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics.statistics import chi_square
from tests.support.either import evaluate
from tests.twins import random_numbers as twin

streams = pytest.mark.feature("path-tracer/random-streams")

EDGES = [0, 1, 2, 3, 42, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF]


def whole_numbers(count, seed):
    """Return (count,) uint32 with the ends of the range first."""
    drawn = np.random.default_rng(seed).integers(0, 2**32, count - len(EDGES), dtype=np.uint32)
    return np.concatenate([np.uint32(EDGES), drawn])


def pixels(width, height):
    """Return (height * width, 2) uint32 places, row by row."""
    return (
        np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(np.uint32)
    )


def distinct(values):
    """Return how many different values (N,) has."""
    ordered = np.sort(values)
    return int(np.count_nonzero(ordered[1:] != ordered[:-1])) + 1


def evenly(values, across=16):
    """Return the probability that values (N,) or pairs (N, 2) in [0, 1) are at least this uneven by chance."""
    cell = np.int64(np.float64(values) * across)
    cells = across if cell.ndim == 1 else across**2
    cell = cell if cell.ndim == 1 else cell[:, 0] * across + cell[:, 1]
    return chi_square(np.bincount(cell, minlength=cells), np.full(cells, len(cell) / cells)).p


@streams
def test_state_42_gives_the_known_numbers(either_device):
    """They are those of the catalogue of the literature."""
    body = "uint s = state; got = uvec4(pcg(s), pcg(s), pcg(s), pcg(s));"
    got = evaluate(either_device, ["pcg.glsl"], body, {"state": np.uint32([42])}, {"got": "uvec4"})["got"]
    assert got.tolist() == [[2522215345, 1223963391, 1180595976, 2715732808]]


@streams
def test_bits_are_those_of_whole_numbers(either_device):
    state, x, y, frame = (whole_numbers(4096, seed) for seed in range(4))
    body = """
        uint s = state;
        drawn = pcg(s);
        after = s;
        hashed = pcg_hash(state);
        begun = seed_of(uvec2(x, y), 1921u, frame);
    """
    outputs = dict.fromkeys(("drawn", "after", "hashed", "begun"), "uint")
    got = evaluate(
        either_device, ["pcg.glsl"], body, {"state": state, "x": x, "y": y, "frame": frame}, outputs
    )
    assert np.array_equal(got["drawn"], twin.permuted(state))
    assert np.array_equal(got["after"], twin.stepped(state))
    assert np.array_equal(got["hashed"], twin.pcg_hash(state))
    assert np.array_equal(got["begun"], twin.seed_of(x, y, 1921, frame))


@streams
def test_all_pixels_have_streams_of_their_own(vulkan_device):
    """And so have 64 pixels in 1024 frames. A seed of x + y x, as once printed, has 625,000 values for all."""
    p = pixels(1920, 1080)
    body = "seed = seed_of(p, 1920u, 7u); printed = p.y * p.x + p.x;"
    got = evaluate(vulkan_device, ["pcg.glsl"], body, {"p": p}, {"seed": "uint", "printed": "uint"})
    assert distinct(got["seed"]) == len(p)
    assert distinct(got["printed"]) == 624_889
    few, frames = pixels(8, 8).repeat(1024, axis=0), np.tile(np.arange(1024, dtype=np.uint32), 64)
    body = "seed = seed_of(p, 1920u, frame);"
    got = evaluate(vulkan_device, ["pcg.glsl"], body, {"p": few, "frame": frames}, {"seed": "uint"})
    assert distinct(got["seed"]) == len(few)


@streams
def test_the_next_frame_is_not_this_one_shifted():
    """Seeds of two frames coincide as often as random numbers do, n^2 / 2^32 times, at many distances of pixels."""
    p = pixels(1000, 400)
    now, later = (np.int64(twin.seed_of(p[:, 0], p[:, 1], 1000, frame)) for frame in (3, 4))
    _, first, second = np.intersect1d(now, later, return_indices=True)
    expected = len(p) ** 2 / 2**32
    assert abs(len(first) - expected) < 5 * np.sqrt(expected)
    assert distinct(second - first) > 0.9 * len(first)


@streams
def test_numbers_stay_below_1_and_fall_evenly(either_device):
    state = np.arange(65_536, dtype=np.uint32)
    body = """
        uint s = seed_of(uvec2(state & 255u, state >> 8u), 256u, 0u);
        pair = vec2(pcg_float(s), pcg_float(s));
        uint next = seed_of(uvec2(state & 255u, state >> 8u), 256u, 1u);
        later = vec2(pair.x, pcg_float(next));
        uint one = seed_of(uvec2(5u, 5u), 256u, state);
        frames = pcg_float(one);
        uint large = 0xFFFFFFFFu - (state & 255u);
        top = vec2(unit_float(large), float(large) * (1.0 / 4294967296.0));
    """
    outputs = {"pair": "vec2", "later": "vec2", "frames": "float", "top": "vec2"}
    got = evaluate(either_device, ["pcg.glsl"], body, {"state": state}, outputs)
    assert got["top"][:, 0].max() == 1 - 2.0**-24 and got["top"][:, 1].max() == 1.0
    assert got["pair"].min() >= 0
    assert evenly(got["pair"][:, 0], 256) > 1e-3
    assert evenly(got["pair"]) > 1e-3, "two numbers of a stream"
    assert evenly(got["later"]) > 1e-3, "a pixel in two frames"
    assert evenly(got["frames"], 256) > 1e-3, "a pixel in all frames"
    beside = got["pair"][:, 0].reshape(256, 256)
    for neighbours in ((beside[:, ::2], beside[:, 1::2]), (beside[::2], beside[1::2])):
        assert evenly(np.stack([n.reshape(-1) for n in neighbours], axis=-1)) > 1e-3
    # The literature's linear seed is noticed: its neighbours' numbers are not independent.
    p = pixels(256, 256)
    linear = twin.permuted(19 * p[:, 0] + 47 * p[:, 1] + 101) / 2.0**32
    moved = twin.permuted(19 * (p[:, 0] + 1) + 47 * p[:, 1] + 101 - 19) / 2.0**32
    assert evenly(np.stack([linear, moved], axis=-1)) < 1e-6, "frame + 19 is the pixel beside"


# --- Sobol ---


def points(device, index, pair=0, seed=0):
    """Return (N, 2) uint32 of the shader, and the same as floats."""
    count = max(np.size(x) for x in (index, pair, seed))
    given = {
        name: np.uint32(np.broadcast_to(x, count))
        for name, x in (("index", index), ("pair", pair), ("seed", seed))
    }
    body = "bits = sobol_bits(index, pair, seed); point = sobol_2d(index, pair, seed);"
    got = evaluate(device, ["sobol.glsl"], body, given, {"bits": "uvec2", "point": "vec2"})
    return got["bits"], got["point"]


def is_a_net(bits):
    """Whether (2^m, 2) points of 32 bits have one in each of the rectangles of area 2^-m, for all their shapes."""
    m = (len(bits) - 1).bit_length()
    wide = np.uint64(bits)
    for across in range(m + 1):
        cell = (wide[:, 0] >> np.uint64(32 - across)) << np.uint64(m - across)
        cell |= wide[:, 1] >> np.uint64(32 - m + across)
        if len(np.unique(cell)) < len(bits):
            return False
    return True


@streams
def test_sobol_bits_are_those_of_direction_numbers(either_device):
    index, pair, seed = (whole_numbers(4096, n) for n in (5, 6, 7))
    bits, point = points(either_device, index, pair, seed)
    assert np.array_equal(bits, twin.sobol_bits(index, pair, seed))
    assert np.array_equal(point, np.float32((bits >> np.uint32(8)) * 2.0**-24))
    assert point.max() < 1


def test_the_table_s_sequence_is_sobol_s():
    """The first points, as printed in many places, and a net at each power of two."""
    x, y = twin.sobol_plain(np.arange(8))
    assert (x * 8 / 2**32).tolist() == [0, 4, 2, 6, 1, 5, 3, 7]
    assert (y * 8 / 2**32).tolist() == [0, 4, 6, 2, 5, 1, 3, 7]
    for m in range(12):
        x, y = twin.sobol_plain(np.arange(2**m))
        assert is_a_net(np.stack([x, y], axis=-1))


@pytest.mark.parametrize("m", [1, 4, 8, 11])
def test_each_block_of_a_power_of_two_is_a_net(either_device, m):
    size = 2**m
    for block, pair, seed in (
        (0, 0, 0),
        (0, 1, 0),
        (1, 0, 9),
        (5, 7, 123),
        (2 ** (32 - m) - 1, 3, 0xFFFFFFFF),
    ):
        bits, _ = points(either_device, block * size + np.arange(size), pair, seed)
        assert is_a_net(bits)
    bits, _ = points(either_device, size // 2 + np.arange(size), 0, 0)
    drawn = np.random.default_rng(3).integers(0, 2**32, (size, 2))
    assert not is_a_net(drawn) or m == 1, "random points are none"


def test_scrambling_is_nested(either_device):
    """Numbers that agree in their first k bits agree in as many afterwards; seeds flip each bit half of the time."""
    rng = np.random.default_rng(12)
    first = whole_numbers(8192, 1)
    place = rng.integers(0, 32, 8192)
    tail = rng.integers(0, 2**32, 8192, dtype=np.uint64) & ((np.uint64(1) << np.uint64(place)) - np.uint64(1))
    second = np.uint32(
        np.uint64(first) ^ (np.uint64(1) << np.uint64(place)) ^ tail
    )  # highest other bit: `place`
    body = """
        a = bitfieldReverse(scrambled_from_below(bitfieldReverse(first), seed));
        b = bitfieldReverse(scrambled_from_below(bitfieldReverse(second), seed));
    """
    seed = rng.integers(0, 2**32, 8192, dtype=np.uint32)
    inputs = {"first": first, "second": second, "seed": seed}
    got = evaluate(either_device, ["sobol.glsl"], body, inputs, {"a": "uint", "b": "uint"})
    assert np.array_equal(np.floor(np.log2(np.float64(got["a"] ^ got["b"]))), place)
    flipped = (got["a"] ^ first)[:, None] >> np.uint32(np.arange(32)) & np.uint32(1)
    assert np.abs(flipped.mean(axis=0) - 0.5).max() < 5 * 0.5 / np.sqrt(8192)


def test_seeds_and_pairs_are_independent(vulkan_device):
    count = 65_536
    _, point = points(vulkan_device, 0, 0, np.arange(count))
    assert evenly(point) > 1e-3, "one point under all seeds"
    _, moved = points(vulkan_device, 1, 0, np.arange(count))
    assert evenly(np.stack([point[:, 0], moved[:, 1]], axis=-1)) > 1e-3
    _, other = points(vulkan_device, 0, 1, np.arange(count))
    assert evenly(np.stack([point[:, 0], other[:, 0]], axis=-1)) > 1e-3
    _, one = points(vulkan_device, np.arange(count), 0, 5)
    _, two = points(vulkan_device, np.arange(count), 1, 5)
    for a in range(2):
        for b in range(2):
            assert evenly(np.stack([one[:, a], two[:, b]], axis=-1)) > 1e-3, "two pairs of one stream"
    assert evenly(np.stack([one[:, 0], one[:, 0]], axis=-1)) < 1e-6


def test_errors_fall_with_the_known_slopes(either_device):
    """Scrambled nets: N^-1.5 for smooth integrands (Owen 1997); random numbers: N^-0.5, as for any integrand."""
    seeds, most = 64, 1024
    index, seed = np.tile(np.arange(most), seeds), np.arange(seeds).repeat(most)
    body = """
        net = sobol_2d(index, 0u, seed);
        uint s = seed_of(uvec2(seed, 0u), 64u, index);
        plain = vec2(pcg_float(s), pcg_float(s));
    """
    inputs = {"index": np.uint32(index), "seed": np.uint32(seed)}
    got = evaluate(either_device, ["sobol.glsl"], body, inputs, {"net": "vec2", "plain": "vec2"})
    counts = 2 ** np.arange(4, 11)

    def slope(p, integrand, truth):
        values = integrand(*np.float64(p).T).reshape(seeds, most)
        means = np.stack([values[:, :n].mean(axis=1) for n in counts])
        errors = np.sqrt(((means - truth) ** 2).mean(axis=1))
        assert np.abs(means[-1].mean() - truth) < 5 * errors[-1] / np.sqrt(seeds), "without bias"
        return np.polyfit(np.log(counts), np.log(errors), 1)[0]

    def smooth(x, y):
        return np.exp(x) * np.sin(np.pi * y)

    def disc(x, y):
        return np.float64(x * x + y * y < 1)

    smooth_truth, disc_truth = (np.e - 1) * 2 / np.pi, np.pi / 4
    assert slope(got["net"], smooth, smooth_truth) < -1.3
    assert slope(got["net"], disc, disc_truth) < -0.65
    assert slope(got["plain"], smooth, smooth_truth) == pytest.approx(-0.5, abs=0.06)
    assert slope(got["plain"], disc, disc_truth) == pytest.approx(-0.5, abs=0.06)
