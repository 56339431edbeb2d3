"""Blobs give back what JSON gives, refuse other versions, and survive any damage."""

from __future__ import annotations

import json
import math
import random

import numpy as np
import pytest

from common.errors import UserError
from common.files.blobs import ALIGNMENT, BlobError, read_blob, write_blob

JSON = """
{"name": "atrium – Ünïcode \\ud83d\\ude00 \\u0000", "empty": {}, "none": [], "": null, "yes": true, "no": false,
 "numbers": [0, -1, 9223372036854775807, -9223372036854775808, 123456789012345678901234567890, -1e400,
             0.1, -0.0, 1e-320, 1.7976931348623157e308, 3.0],
 "deep": [[[[{"a": [1, {"b": [2]}]}]]]], "lone": "\\ud800"}
"""


def same(a: object, b: object) -> bool:
    """Equal, of the same types and in the same order: 3 is not 3.0, -0.0 not 0.0, and NaN is NaN."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if isinstance(a, float):
        return math.copysign(1, a) == math.copysign(1, b) and (a == b or (a != a and b != b))
    return a == b


@pytest.mark.feature("core/blob-serialization")
def test_json_to_binary_to_object_equals_the_direct_parse():
    value = json.loads(JSON)
    assert same(read_blob(write_blob(value, 1), 1), value)
    assert write_blob(value, 1) == write_blob(json.loads(JSON), 1)


@pytest.mark.feature("core/blob-serialization")
@pytest.mark.parametrize("sign", [1, -1])
def test_whole_numbers_of_any_size(sign):
    for bits in (7, 8, 62, 63, 64, 65, 71, 72, 200):
        for value in (sign * 2**bits - 1, sign * 2**bits, sign * 2**bits + 1):
            assert same(read_blob(write_blob(value, 1), 1), value)


@pytest.mark.feature("core/blob-serialization")
def test_the_json_of_real_files(models):
    for path in sorted(models.rglob("*.gltf")):
        value = json.loads(path.read_text())
        assert same(read_blob(write_blob(value, 1), 1), value)


@pytest.mark.feature("core/blob-serialization")
def test_another_version_is_rejected():
    blob = write_blob([1, 2], 7)
    assert read_blob(blob, 7) == [1, 2]
    for version in (6, 8):
        with pytest.raises(BlobError, match=rf"^scene\.cache has version 1\.7, and 1\.{version} is needed"):
            read_blob(blob, version, "scene.cache")
    with pytest.raises(UserError, match=r"version 2\.7"):
        read_blob(blob[:8] + b"\2" + blob[9:], 7)


@pytest.mark.parametrize("dtype", ["u1", "<i2", ">u4", "f2", "<f4", ">f8", "c8", "?"])
def test_arrays_are_aligned_views(dtype):
    values = np.arange(24).astype(dtype).reshape(2, 3, 4)[:, ::2]
    blob = np.frombuffer(b"x" + write_blob(["pad", values, np.zeros((0, 3), dtype)], 1), np.uint8)[1:]
    _, got, empty = read_blob(blob, 1)
    assert got.tolist() == values.tolist() and got.dtype == values.dtype.newbyteorder("<")
    assert empty.shape == (0, 3)
    assert np.shares_memory(got, blob) and not got.flags.writeable
    place = got.__array_interface__["data"][0] - blob.__array_interface__["data"][0]
    assert place % ALIGNMENT == 0


def test_a_scalar_array_and_nan():
    value = [np.array(3, np.float32), math.nan, math.inf]
    assert same(read_blob(write_blob(value, 1), 1), [np.array(3, "<f4"), math.nan, math.inf])


def test_what_is_refused():
    for value in ((1, 2), {1: "a"}, b"bytes", np.array(["a"]), np.array([object()]), 1j):
        with pytest.raises(TypeError, match="blob"):
            write_blob(value, 1)
    deep: list = []
    for _ in range(300):
        deep = [deep]
    with pytest.raises(ValueError, match="nested"):
        write_blob(deep, 1)


def test_every_cut_is_one_sentence():
    blob = write_blob({"a": [1, "text", np.ones((3, 2), np.float32)], "b": None}, 3)
    for cut in range(len(blob)):
        with pytest.raises(BlobError, match=r"^cache .* make it again$"):
            read_blob(blob[:cut], 3, "cache")
    with pytest.raises(BlobError, match="instead of"):
        read_blob(blob + b"x", 3)


def test_damaged_bytes_never_get_through_as_another_exception():
    rng = random.Random(6)
    blob = write_blob(
        {"a": [1, 2**70, "text", 0.5, np.ones((3, 2), np.float32)], "b": [None, True, {"c": []}]}, 3
    )
    refused = 0
    for _ in range(5_000):
        damaged = bytearray(blob)
        for _ in range(rng.randrange(1, 4)):
            damaged[rng.randrange(len(damaged))] = rng.randrange(256)
        try:
            read_blob(bytes(damaged), 3)
        except BlobError:
            refused += 1
    assert refused > 1_000


def test_a_long_list_that_is_not_there_costs_nothing():
    blob = bytearray(write_blob([None], 1))
    blob[25:33] = (2**62).to_bytes(8, "little")
    with pytest.raises(BlobError, match="damaged at byte 33"):
        read_blob(bytes(blob), 1)
