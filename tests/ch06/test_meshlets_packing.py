"""Packed meshlets and vertices: layouts byte by byte, and the errors of what is rounded."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch06.meshlets.model import MESHLET
from chapters.ch06.meshlets.packing import (
    pack_cones,
    pack_counts,
    pack_normal,
    pack_uv,
    pack_words,
    unpack_cones,
    unpack_counts,
    unpack_normal,
    unpack_uv,
    unpack_words,
)

packing = pytest.mark.feature("meshlets/packing")


@packing
def test_the_record_is_that_of_std430():
    assert MESHLET.itemsize == 48
    offsets = {name: MESHLET.fields[name][1] for name in MESHLET.names}
    assert offsets == {
        "centre": 0,
        "radius": 12,
        "extent": 16,
        "cone": 28,
        "first_index": 32,
        "counts": 36,
        "data": 40,
        "mesh": 44,
    }


@packing
def test_words_of_two_meshlets_byte_by_byte():
    corners = np.array([7, 3, 9, 9, 3, 8, 5, 5, 5], np.uint32)
    words, data, vertices = pack_words(corners, np.array([0, 2]))
    # 4 vertices and two words of local indices 0 1 2 2 | 1 3; then 1 vertex and one word of 0 0 0
    assert words.tolist() == [7, 3, 9, 8, 0x02020100, 0x0301, 5, 0]
    assert data.tolist() == [0, 6] and vertices.tolist() == [4, 1]


@packing
def test_pack_and_unpack_are_exact():
    rng = np.random.default_rng(0)
    for most in (3, 64, 255):
        counts = rng.integers(1, 257, 50)
        # Each meshlet has vertices of its own choice, from anywhere in 32 bits.
        corners = np.concatenate(
            [rng.choice(rng.integers(0, 2**32, most, np.uint32), 3 * count) for count in counts]
        )
        starts = np.cumsum(counts) - counts
        words, data, vertices = pack_words(corners, starts)
        records = np.zeros(50, MESHLET)
        records["data"], records["counts"] = data, pack_counts(vertices, counts)
        assert (unpack_words(records, words) == corners).all()
        back = unpack_counts(records["counts"])
        assert (back[0] == vertices).all() and (back[1] == counts).all()
        assert vertices.max() <= most and len(words) == (vertices + -(-3 * counts // 4)).sum()
        some = np.sort(rng.choice(50, 9, replace=False))
        parts = [corners[3 * starts[row] : 3 * (starts[row] + counts[row])] for row in some]
        assert (unpack_words(records[some], words) == np.concatenate(parts)).all()
    assert [len(part) for part in pack_words(np.zeros(0, np.uint32), np.zeros(0, np.int64))] == [0, 0, 0]


@packing
def test_cones_are_signed_bytes_with_x_in_the_low_ones():
    (cone,) = pack_cones(np.array([[0.6, -0.8, 0.0]]), np.array([0.25])).tolist()
    assert list(cone.to_bytes(4, "little", signed=False)[:3]) == [76, 256 - 102, 0]  # 76.2, -101.6
    rounding = np.hypot(76 / 127 - 0.6, 102 / 127 - 0.8)
    assert cone >> 24 == np.ceil(127 * (0.25 + rounding)) == 33
    axes, cutoffs = unpack_cones(np.array([cone], np.uint32))
    assert axes.tolist() == [[76 / 127, -102 / 127, 0.0]] and cutoffs.tolist() == [33 / 127]


def sphere_points(count):
    """Return unit vectors (N, 3) spread evenly (a Fibonacci spiral)."""
    step = np.arange(count) + 0.5
    z, angle = 1 - 2 * step / count, step * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def degrees_off(normals, packed):
    """Return the largest angle between unit vectors and what packed ones decode to, by the formula, in degrees."""
    decoded = packed.astype(np.float64) / 127 - 1
    sines = np.linalg.norm(np.cross(normals, decoded), axis=1) / np.linalg.norm(decoded, axis=1)
    return np.degrees(np.arcsin(sines)).max()


@packing
def test_normals_of_three_bytes_are_within_four_tenths_of_a_degree():
    normals = sphere_points(400_000)
    packed = pack_normal(normals)
    assert packed.max() == 254
    assert 0.35 < degrees_off(normals, packed) < 0.4
    truncated = ((normals + 1) * 127).astype(np.uint8)
    assert degrees_off(normals, truncated) > 0.7, "rounding makes no difference"
    decoded = unpack_normal(packed)
    assert decoded.dtype == np.float32 and np.abs(np.linalg.norm(decoded, axis=1) - 1).max() < 1e-6
    sines = np.linalg.norm(np.cross(normals, decoded), axis=1)
    assert np.degrees(np.arcsin(sines)).max() < 0.4
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    assert (unpack_normal(pack_normal(axes)) == axes).all()


def half_table():
    """Return the value of each of the 2^16 numbers of half precision, by the text of IEEE 754."""
    bits = np.arange(2**16)
    sign, exponent, fraction = 1 - 2.0 * (bits >> 15), bits >> 10 & 31, bits & 1023
    values = np.where(exponent == 0, fraction * 2.0**-24, (1 + fraction / 1024) * 2.0 ** (exponent - 15.0))
    values[exponent == 31] = np.where(fraction[exponent == 31] == 0, np.inf, np.nan)
    return sign * values


@packing
def test_texture_coordinates_are_those_of_the_table():
    table = half_table()
    bits = np.arange(2**16, dtype=np.uint16)
    assert np.array_equal(unpack_uv(bits), table.astype(np.float32), equal_nan=True)
    numbers = ~np.isnan(table)
    assert (pack_uv(table[numbers].astype(np.float32)) == bits[numbers]).all()


@packing
def test_texture_coordinates_are_rounded_to_the_nearest_and_ties_to_even():
    table = half_table()
    places = np.sort(np.unique(table[np.isfinite(table)]))
    rng = np.random.default_rng(6)
    uv = (rng.normal(size=3000) * 10.0 ** rng.uniform(-9, 4, 3000)).astype(np.float32)
    uv = uv[np.abs(uv) < 65000].astype(np.float64)
    above = np.searchsorted(places, uv)
    nearest = np.minimum(places[above] - uv, uv - places[above - 1])
    decoded = unpack_uv(pack_uv(uv.astype(np.float32)))
    assert (np.abs(decoded - uv) == nearest).all()
    assert unpack_uv(pack_uv(np.float32([1 + 2.0**-11, 1 + 3 * 2.0**-11, 65520.0]))).tolist() == [
        1.0,
        1 + 2.0**-9,
        np.inf,
    ]
