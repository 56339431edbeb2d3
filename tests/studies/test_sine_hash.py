"""The study sine-hash: repeatable on one driver, exact nowhere; beside it whole numbers, exact everywhere."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch01.studies.sine_hash import Settings
from tests.support.bounds import codes_off

FILE = "sine_hash/noise.glsl"
SIZE = (48, 32)


def places(side: int = 64) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)


def sine_hash(place: np.ndarray, kind: type) -> np.ndarray:
    """Return the formula in float32 or float64 of numpy."""
    x, y = place.astype(kind).T
    angle = np.mod(kind(12.9898) * x + kind(78.233) * y, kind(3.14159265))
    value = np.sin(angle) * kind(43758.5453)
    return np.asarray(value - np.floor(value), np.float64)


def pcg(value: np.ndarray) -> np.ndarray:
    """Return PCG's hash in 64 bits, cut to 32 after each product."""
    cut = np.uint64(0xFFFFFFFF)
    state = (value.astype(np.uint64) * np.uint64(747796405) + np.uint64(2891336453)) & cut
    word = ((state >> ((state >> np.uint64(28)) + np.uint64(4))) ^ state) * np.uint64(277803737) & cut
    return (word >> np.uint64(22)) ^ word


def integer_hash(place: np.ndarray) -> np.ndarray:
    x, y = place.astype(np.uint64).T
    return (pcg((pcg(x) + y) & np.uint64(0xFFFFFFFF)) >> np.uint64(8)) / 2.0**24


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return how far two values of `fract` are from each other on the circle; 0.25 in the mean if unrelated."""
    difference = np.abs(a - b)
    return np.minimum(difference, 1 - difference)


def on_gpu(stage, place: np.ndarray) -> np.ndarray:
    inputs = {"place": place.astype(np.float32)}
    return stage.evaluate(FILE, "value = sine_hash(place);", inputs, {"value": "float"})["value"]


@pytest.mark.feature("noise/sin-hash")
def test_the_same_place_has_the_same_value_on_one_backend(stage):
    place = places()
    once, again, backwards = on_gpu(stage, place), on_gpu(stage, place), on_gpu(stage, place[::-1])
    assert (once.view(np.uint32) == again.view(np.uint32)).all()
    assert (once.view(np.uint32) == backwards[::-1].view(np.uint32)).all(), "the neighbours have no say"
    assert once.min() >= 0 and once.max() < 1 and abs(once.mean() - 0.5) < 0.02
    # Floats near 43758 are 1/256 apart: most places share their value with others, though it is a float.
    assert 250 < len(np.unique(once)) < 0.5 * len(once)


@pytest.mark.feature("noise/sin-hash")
def test_how_far_a_driver_is_from_the_formula_is_measured(stage):
    """Not portable: single precision alone, before any driver has its say, leaves other numbers than double."""
    place = places()
    exact, single = sine_hash(place, np.float64), sine_hash(place, np.float32)
    got = on_gpu(stage, place).astype(np.float64)
    for name, other in (("float64", exact), ("numpy's float32", single)):
        far = apart(got, other)
        print(f"{stage.backend}, {stage.device.capabilities.driver}, against {name}:", end=" ")
        print(
            f"mean {far.mean():.4f}, worst {far.max():.4f}, {np.mean(far > 1 / 255):.1%} off by a code or more"
        )
    assert apart(single, exact).max() > 0.1
    assert np.mean(apart(got, exact) > 1 / 255) > 0.5, (
        "this sine is exact to 30 bits: the README is to say so"
    )


@pytest.mark.feature("noise/sin-hash")
@pytest.mark.parametrize("way", [(1.0, 0.0), (0.0, 1.0)], ids=["x", "y"])
def test_near_the_origin_the_constants_are_those_of_the_formula(stage, way):
    """Places whose angle stays below three half turns: there single precision still has the digits that count."""
    angle = np.linspace(0.01, 3 * np.pi, 4001)
    place = ((angle / np.dot(way, (12.9898, 78.233)))[:, None] * way).astype(np.float32)
    got, exact = on_gpu(stage, place).astype(np.float64), sine_hash(place, np.float64)
    # Unrelated values have 0.25 in the mean. Lavapipe and llvmpipe have 0.004: half a unit in the last place of an
    # angle is 2^-22, and the factor makes 0.01 of it. Hardware sines that are exact to 20 bits add up to 0.04.
    bound = 0.01 if stage.device.capabilities.is_software else 0.1
    assert apart(got, exact).mean() < bound


def test_whole_numbers_are_the_same_everywhere(stage):
    place = np.concatenate([places(), np.array([(2**32 - 1, 0), (0, 2**32 - 1), (2**31, 2**31)])])
    inputs = {"place": place.astype(np.uint32)}
    got = stage.evaluate(FILE, "value = integer_hash(place);", inputs, {"value": "float"})["value"]
    assert (got == integer_hash(place)).all()
    assert abs(got.mean() - 0.5) < 0.02


def test_the_picture_shows_one_beside_the_other(stage):
    picture = stage.draw("sine-hash", SIZE, settings=Settings(cells=16))["color"]
    assert (picture == stage.draw("sine-hash", SIZE, settings=Settings(cells=16))["color"]).all()
    cells = picture[::2, ::2]
    assert (np.repeat(np.repeat(cells, 2, axis=0), 2, axis=1) == picture).all(), "cells of 2 x 2 pixels"
    row, column = np.mgrid[:16, :24]
    place = np.stack([column.ravel(), row.ravel()], axis=-1)
    whole = integer_hash(place).reshape(16, 24)[:, 12:]
    assert np.abs(cells[:, 12:, 0] - 255 * whole).max() <= codes_off(stage.device) + 0.01
    if (
        stage.device.capabilities.is_software
    ):  # elsewhere a fragment shader may have another sine than a compute shader
        sine = on_gpu(stage, place).reshape(16, 24)[:, :12]
        assert np.abs(cells[:, :12, 0] - 255 * sine).max() <= codes_off(stage.device) + 0.01
