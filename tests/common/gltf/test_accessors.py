"""Accessor decoding against bytes taken apart with struct."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from common.gltf.accessors import Accessors, within
from common.gltf.container import Container
from common.gltf.document import Document
from common.gltf.refusal import Refusal
from tests.common.gltf.builder import Gltf

TYPES = [(5120, "b"), (5121, "B"), (5122, "h"), (5123, "H"), (5125, "I"), (5126, "f")]
WIDTHS = [("SCALAR", 1), ("VEC2", 2), ("VEC3", 3), ("VEC4", 4)]


def accessors(gltf):
    data = np.frombuffer(bytes(gltf.data), np.uint8)
    root = {**gltf.json, "buffers": [{"byteLength": max(len(data), 1)}]}
    return Accessors(Document(root, Container(None, None, data)))


@pytest.mark.parametrize("count", [1, 2, 3, 1000])
@pytest.mark.parametrize("largest", [0.0, 0.4, 0.7, 0.71, 0.99, 1.0, 1.01, 1.2, 1.42, 3.0, np.inf, np.nan])
def test_numbers_are_within_a_limit_where_the_largest_is(count, largest):
    """However many there are beside it, and of whatever size below it."""
    for others in (0.0, 0.5, 1.0):
        values = np.full((count, 3), others * 1e18 if others <= largest else 0.0, np.float32)
        values[count // 2, 1] = -largest * 1e18
        assert within(values, 1e18) == (largest <= 1.0)


@pytest.mark.feature("scene/gltf-loader")
@pytest.mark.parametrize(("code", "letter"), TYPES)
@pytest.mark.parametrize(("kind", "width"), WIDTHS)
@pytest.mark.parametrize("gap", [0, 4])
def test_every_type_with_and_without_stride(code, letter, kind, width, gap):
    rng = np.random.default_rng(code + width + gap)
    item = struct.calcsize("<" + letter) * width
    stride = (item + 3) // 4 * 4 + gap
    offset, count = 8, 5
    data = rng.integers(0, 256, offset + stride * count, np.uint8).tobytes()
    gltf = Gltf()
    gltf.view(b"before__")
    entry = {"byteStride": stride} if gap or stride != item else {}
    view = gltf.view(data, **entry)
    number = gltf.add(
        "accessors",
        {"bufferView": view, "byteOffset": offset, "componentType": code, "count": count, "type": kind},
    )
    expected = [struct.unpack_from(f"<{width}{letter}", data, offset + i * stride) for i in range(count)]
    raw = accessors(gltf).raw(number)
    assert raw.shape == (count, width)
    assert np.array_equal(raw, np.array(expected, raw.dtype), equal_nan=letter == "f")
    assert raw.base is not None  # a view of the file's bytes, not a copy


@pytest.mark.parametrize(
    ("code", "letter", "top"), [(5120, "b", 127), (5121, "B", 255), (5122, "h", 32767), (5123, "H", 65535)]
)
def test_normalised_integers(code, letter, top):
    values = [-top - 1, -top, -1, 0, 1, top] if letter.islower() else [0, 1, top // 2, top]
    gltf = Gltf()
    view = gltf.view(struct.pack(f"<{len(values)}{letter}", *values))
    entry = {"bufferView": view, "componentType": code, "count": len(values), "type": "SCALAR"}
    scaled, plain = gltf.add("accessors", {**entry, "normalized": True}), gltf.add("accessors", entry)
    read = accessors(gltf)
    expected = [max(value / top, -1.0) for value in values]
    assert np.array_equal(read.floats(scaled, "", ("SCALAR",))[:, 0], np.array(expected, np.float32))
    assert np.array_equal(read.floats(plain, "", ("SCALAR",))[:, 0], np.array(values, np.float32))


@pytest.mark.parametrize("has_base", [True, False])
@pytest.mark.parametrize(("code", "letter"), [(5121, "B"), (5123, "H"), (5125, "I")])
def test_sparse(has_base, code, letter):
    base = np.arange(30, dtype="<f4").reshape(10, 3)
    gltf = Gltf()
    entry = {"componentType": 5126, "count": 10, "type": "VEC3"}
    if has_base:
        entry["bufferView"] = gltf.view(base.tobytes())
    entry["sparse"] = {
        "count": 2,
        "indices": {
            "bufferView": gltf.view(b"\xff" * 4 + struct.pack(f"<2{letter}", 3, 9)),
            "componentType": code,
            "byteOffset": 4,
        },
        "values": {"bufferView": gltf.view(struct.pack("<6f", 1, 2, 3, 4, 5, 6))},
    }
    expected = base.copy() if has_base else np.zeros((10, 3))
    expected[3], expected[9] = (1, 2, 3), (4, 5, 6)
    number = gltf.add("accessors", entry)
    read = accessors(gltf)
    assert np.array_equal(read.floats(number, "", ("VEC3",)), expected)
    if has_base:
        assert np.array_equal(
            np.frombuffer(bytes(gltf.data[:120]), "<f4").reshape(10, 3), base
        )  # file unchanged


@pytest.mark.parametrize(
    ("kind", "code", "letter", "rows", "column"),
    [
        ("MAT2", 5121, "B", 2, 4),
        ("MAT3", 5121, "B", 3, 4),
        ("MAT3", 5123, "H", 3, 8),
        ("MAT4", 5126, "f", 4, 16),
        ("MAT2", 5126, "f", 2, 8),
    ],
)
def test_columns_of_matrices_are_padded(kind, code, letter, rows, column):
    data = np.random.default_rng(1).integers(0, 120, 3 * rows * column, np.uint8).tobytes()
    gltf = Gltf()
    entry = {"bufferView": gltf.view(data), "componentType": code, "count": 3, "type": kind}
    number = gltf.add("accessors", entry)
    expected = [
        sum((struct.unpack_from(f"<{rows}{letter}", data, (i * rows + c) * column) for c in range(rows)), ())
        for i in range(3)
    ]
    assert np.array_equal(accessors(gltf).raw(number), np.array(expected))


def test_matrices_are_mathematical():
    gltf = Gltf()
    number = gltf.accessor([[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]], "f4")
    matrix = accessors(gltf).matrices(number, "")[0]
    assert np.array_equal(matrix @ (0, 0, 0, 1), (7, 8, 9, 1))


@pytest.mark.feature("scene/gltf-loader")
@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"byteOffset": 4}, "ends at byte 40"),
        ({"count": 4}, "ends at byte 48"),
        ({"count": 2**52}, "ends at byte"),
        ({"byteOffset": 2**52}, "ends at byte"),
    ],
)
def test_elements_outside_their_view_are_refused(change, fault):
    gltf = Gltf()
    number = gltf.accessor(np.zeros((3, 3)), "f4", **change)
    with pytest.raises(Refusal, match=rf"accessors\[0\] {fault}"):
        accessors(gltf).raw(number)


def test_a_bare_accessor_is_zero_and_bounded():
    gltf = Gltf()
    small = gltf.add("accessors", {"componentType": 5126, "count": 4, "type": "VEC2"})
    large = gltf.add("accessors", {"componentType": 5126, "count": 2**40, "type": "VEC2"})
    read = accessors(gltf)
    assert np.array_equal(read.raw(small), np.zeros((4, 2)))
    with pytest.raises(Refusal, match="which has no bufferView"):
        read.raw(large)


@pytest.mark.parametrize("value", [np.nan, np.inf, 2e18])
def test_numbers_that_cannot_be_drawn_are_refused(value):
    gltf = Gltf()
    number = gltf.accessor([[0, 0, 0], [0, value, 0]], "f4")
    with pytest.raises(Refusal, match="element 1"):
        accessors(gltf).floats(number, "somewhere", ("VEC3",))
