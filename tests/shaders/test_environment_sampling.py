"""Drawing directions of an environment by aliases: frequencies, densities, and the radiance that a direction has."""

from __future__ import annotations

import numpy as np
import pytest

from common.environment.directions import cube_directions, cube_solid_angles, cube_uv
from common.environment.importance import cube_weights
from common.numerics.alias_table import alias_table
from common.numerics.statistics import chi_square
from tests.support.either import evaluate

feature = pytest.mark.feature("path-tracer/environment-alias-table")

SIZE = 8
COUNT = 100_000


def sky():
    """Return radiance (6, SIZE, SIZE, 3): a gradient, a dark face and a sun 5,000 times as bright."""
    d = cube_directions(SIZE)
    radiance = np.repeat((1.2 + d[..., 1])[..., None], 3, axis=-1)
    radiance[1] = 0.0
    radiance[4, 2, 5] = 5000.0
    return radiance


def table_of(radiance):
    return alias_table(cube_weights(radiance).reshape(-1))


def picked(device, table, bits):
    """Return the numbers and their probabilities that the shader picks with bits (N, 2) uint32."""
    entries = np.full(len(bits), len(table.threshold), np.uint32)
    body = "entry = alias_entry(bits.x, entries);"
    entry = evaluate(device, ["alias.glsl"], body, {"bits": bits, "entries": entries}, {"entry": "uint"})[
        "entry"
    ]
    body = "number = alias_pick(entry, words, bits.y, probability);"
    inputs = {"bits": bits, "entry": entry, "words": table.words()[entry]}
    got = evaluate(device, ["alias.glsl"], body, inputs, {"number": "uint", "probability": "float"})
    return got["number"], got["probability"]


def directions(device, numbers, u, size=SIZE):
    """Return the shader's directions through points u (N, 2) of texels, and the texels that they meet."""
    body = "d = cube_texel_direction(number, size, u); met = cube_texel_at(d, size);"
    inputs = {
        "number": np.uint32(numbers),
        "u": np.float32(u),
        "size": np.full(len(u), size, np.uint32),
    }
    got = evaluate(device, ["environment_sampling.glsl"], body, inputs, {"d": "vec3", "met": "uint"})
    return got["d"], got["met"]


def densities(device, probability, d, size=SIZE):
    body = "pdf = cube_texel_pdf(probability, d, size);"
    inputs = {
        "probability": np.float32(probability),
        "d": np.float32(d),
        "size": np.full(len(d), size, np.uint32),
    }
    return evaluate(device, ["environment_sampling.glsl"], body, inputs, {"pdf": "float"})["pdf"]


@feature
@pytest.mark.parametrize("count", [1, 2, 5, 16, 21])
def test_each_number_is_picked_for_its_part_of_all_bits(either_device, count):
    """The bits that draw entries and those that choose lie on a grid: counts are exact to one per entry."""
    table = alias_table(np.random.default_rng(count).random(count) ** 4)
    entries, steps = len(table.threshold), 2048
    first = (np.arange(entries, dtype=np.uint64) << np.uint64(32)) // np.uint64(entries) + np.uint64(5)
    second = np.arange(steps, dtype=np.uint64) * np.uint64(2**32 // steps) + np.uint64(2**32 // steps // 2)
    bits = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2).astype(np.uint32)
    number, probability = picked(either_device, table, bits)
    counts = np.bincount(number, minlength=count)
    assert len(counts) == count
    assert np.abs(counts - table.probability * len(bits)).max() <= entries
    assert np.array_equal(probability, np.float32(table.probability)[number])


@feature
def test_thresholds_are_kept_to_the_bit(either_device):
    """An entry stands for itself below its threshold, and at it no more: one without units is never drawn."""
    table = alias_table([1.0, 3.0, 4.0])
    entries = len(table.threshold)
    first = (np.arange(entries, dtype=np.uint64) << np.uint64(32)) // np.uint64(entries)
    for bits, expected in (
        (0, [0, 1, 2, 2]),
        (2**31 - 1, [0, 1, 2, 2]),
        (2**31, [1, 1, 2, 2]),
        (2**32 - 1, [1, 1, 2, 2]),
    ):
        both = np.stack([first, np.full(entries, bits, np.uint64)], axis=1).astype(np.uint32)
        number, _ = picked(either_device, table, both)
        assert number.tolist() == expected
        both[:, 0] += np.uint32(2**32 // entries - 1)
        number, _ = picked(either_device, table, both)
        assert number.tolist() == expected


@feature
def test_frequencies_are_the_texels_probabilities(either_device):
    radiance = sky()
    table = table_of(radiance)
    bits = np.random.default_rng(3).integers(0, 2**32, (COUNT, 2), dtype=np.uint32)
    number, _ = picked(either_device, table, bits)
    counts = np.bincount(number, minlength=table.count)
    weights = cube_weights(radiance).reshape(-1)
    expected = weights / weights.sum() * COUNT
    assert chi_square(counts, expected).p > 1e-3
    assert not counts[weights == 0].any() and (weights == 0).any()
    plain = radiance[..., 0].reshape(-1) + 1e-9
    assert chi_square(counts, plain / plain.sum() * COUNT).p < 1e-6, "without solid angles it is noticed"


@feature
@pytest.mark.parametrize("size", [1, 8, 256])
def test_a_direction_meets_the_texel_that_it_was_drawn_for(either_device, size):
    rng = np.random.default_rng(7)
    number, u = rng.integers(0, 6 * size * size, 40_000), np.float32(rng.random((40_000, 2)))
    d, met = directions(either_device, number, u, size)
    assert np.abs(np.linalg.norm(d, axis=1) - 1).max() < 1e-6
    face, uv = cube_uv(d.astype(np.float64))
    place = np.minimum((uv * size).astype(int), size - 1)
    truth = (face * size + place[:, 1]) * size + place[:, 0]
    inner = (np.abs(u - 0.5) < 0.499).all(axis=1)  # on a rim rounding decides
    assert np.array_equal(met[inner], number[inner]) and np.array_equal(truth[inner], number[inner])
    assert (met != number).mean() < 1e-3


@feature
def test_a_direction_looks_up_its_own_radiance(either_device):
    """And half a turn away, where a wrong azimuth would look, there is another."""
    radiance = sky()
    table = table_of(radiance)
    rng = np.random.default_rng(9)
    number, _ = picked(either_device, table, rng.integers(0, 2**32, (4000, 2), dtype=np.uint32))
    d, _ = directions(either_device, number, 0.002 + 0.996 * rng.random((4000, 2)))
    own = radiance.reshape(-1, 3)[number]

    def looked_up(d):
        face, uv = cube_uv(d.astype(np.float64))
        place = np.minimum((uv * SIZE).astype(int), SIZE - 1)
        return radiance[face, place[:, 1], place[:, 0]]

    assert np.array_equal(looked_up(d), own)
    assert (looked_up(d * np.array([-1, 1, -1])) != own).any(axis=1).mean() > 0.5


@feature
def test_the_density_is_probability_per_solid_angle(either_device):
    """Probability of a 32nd of a texel, over its exact solid angle, is the density in its middle."""
    part = 32
    fine = SIZE * part
    probability = table_of(sky()).probability.reshape(6, SIZE, SIZE)
    d = cube_directions(fine).reshape(6, fine, fine, 3)[:, ::7, ::7].reshape(-1, 3)
    each = np.repeat(np.repeat(probability, part, axis=1), part, axis=2)[:, ::7, ::7].reshape(-1)
    got = densities(either_device, each, d)
    angle = np.broadcast_to(cube_solid_angles(fine), (6, fine, fine))[:, ::7, ::7].reshape(-1)
    assert np.allclose(got, each / part**2 / angle, rtol=5e-5)


@feature
def test_estimates_of_the_light_have_no_bias(vulkan_device):
    """The whole sky's light and the irradiance from above: means of radiance over density against sums by texels."""
    radiance = sky()
    table = table_of(radiance)
    rng = np.random.default_rng(21)
    number, probability = picked(vulkan_device, table, rng.integers(0, 2**32, (COUNT, 2), dtype=np.uint32))
    d, _ = directions(vulkan_device, number, rng.random((COUNT, 2)))
    pdf = densities(vulkan_device, probability, d).astype(np.float64)
    light = radiance.reshape(-1, 3)[number, 0]
    part = 32  # the cosine changes inside a texel
    fine = cube_directions(SIZE * part)[..., 1].reshape(6, SIZE, part, SIZE, part)
    angle = cube_solid_angles(SIZE * part).reshape(SIZE, part, SIZE, part)
    from_above = (np.maximum(fine, 0) * angle).sum(axis=(2, 4))
    for seen, truth in (
        (light / pdf, (radiance[..., 0] * cube_solid_angles(SIZE)).sum()),
        (light * np.maximum(d[:, 1], 0) / pdf, (radiance[..., 0] * from_above).sum()),
    ):
        error = seen.std() / np.sqrt(COUNT)
        assert error < 0.01 * truth
        assert abs(seen.mean() - truth) < 4 * error
