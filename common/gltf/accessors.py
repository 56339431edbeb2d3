"""Accessors decoded with numpy: strides, normalised and sparse values, padded matrices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from common.gltf.document import Document, Object
from common.gltf.refusal import refuse
from common.scene import NUMBER_LIMIT, Float32, Float64, UInt32

COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
"""componentType -> dtype; glTF is little-endian."""

SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""type -> (columns, rows) as stored: matrices column by column."""


def within(values: Float32, limit: float) -> bool:
    """Return whether every number is finite and its size at most `limit` (up to 1e18).

    The sum of squares of non-negative terms is never below the largest of them, in whatever order floats are summed,
    and one product tells it in a fifth of the time; only where that is too large the sizes themselves are looked at.
    """
    flat = values.reshape(-1)
    with np.errstate(over="ignore", invalid="ignore"):
        if np.dot(flat, flat) <= limit * limit / 2:  # a NaN compares as false
            return True
    return bool(np.abs(values).max(initial=0.0) <= limit)


class Accessors:
    """The accessors of a document, each decoded once however often it is used."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._entries = document.items("accessors")
        self._raw: dict[int, np.ndarray] = {}
        self._floats: dict[int, Float32] = {}
        self._indices: dict[int, UInt32] = {}

    def count(self, index: int) -> int:
        """Return the number of elements, all of whose bytes are there.

        Raises:
            Refusal: bytes outside the buffer.
        """
        return len(self.raw(index))

    def floats(self, index: int, place: str, types: Sequence[str], finite: bool = True) -> Float32:
        """Return (N, C) float32: integers as they are, or scaled to [0, 1] or [-1, 1] where normalised.

        `place` is the property that refers to the accessor and `types` what it may be. With `finite` a NaN or
        an infinity is refused.

        Raises:
            Refusal: wrong type, a non-finite number, or bytes outside the buffer.
        """
        self._expect(index, place, types)
        values = self._floats.get(index)
        if values is None:
            values = self._floats[index] = _as_float(
                self.raw(index), self._entries[index].get("normalized", False)
            )
        if finite and not within(values, NUMBER_LIMIT):
            element = int(np.argmin((np.abs(values) <= NUMBER_LIMIT).all(axis=1)))
            finite = bool(np.isfinite(values[element]).all())
            what = "beyond 1e18" if finite else "that is not finite"
            refuse(place, f"(accessors[{index}]) has a number {what} in element {element}")
        return values

    def indices(self, index: int, place: str, vertex_count: int) -> UInt32:
        """Return (N,) uint32, each below `vertex_count`.

        Raises:
            Refusal: wrong type, or an index that is too large; the text names the first.
        """
        self._expect(index, place, ("SCALAR",))
        values = self._indices.get(index)
        if values is None:
            raw = self.raw(index)
            if raw.dtype.kind != "u":
                refuse(place, f"(accessors[{index}]) has indices that are not unsigned integers")
            values = self._indices[index] = np.ascontiguousarray(raw[:, 0], np.uint32)
        if int(values.max()) >= vertex_count:
            first = int(np.argmax(values >= vertex_count))
            refuse(
                place,
                f"has index {values[first]} at position {first}, but there are only {vertex_count} vertices",
            )
        return values

    def integers(self, index: int, place: str, types: Sequence[str]) -> np.ndarray:
        """Return (N, C) of the unsigned type that the file has (joints, for example).

        Raises:
            Refusal: wrong type, or signed or real numbers.
        """
        self._expect(index, place, types)
        raw = self.raw(index)
        if raw.dtype.kind != "u":
            refuse(place, f"(accessors[{index}]) must have unsigned integers")
        return raw

    def matrices(self, index: int, place: str) -> Float64:
        """Return (N, 4, 4) float64 mathematical matrices, translation in the last column.

        Raises:
            Refusal: wrong type, or a number that is not finite.
        """
        values = self.floats(index, place, ("MAT4",))
        return values.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)

    def raw(self, index: int) -> np.ndarray:
        """Return (N, C) in the component type of the file; a view of its bytes where nothing has to move."""
        if index not in self._raw:
            self._raw[index] = self._decode(index)
        return self._raw[index]

    def _expect(self, index: int, place: str, types: Sequence[str]) -> None:
        kind = self._entries[index]["type"]
        if kind not in types:
            refuse(place, f"(accessors[{index}]) is {kind} instead of {' or '.join(types)}")

    def _decode(self, index: int) -> np.ndarray:
        entry, place = self._entries[index], f"accessors[{index}]"
        dtype, shape, count = COMPONENTS[entry["componentType"]], SHAPES[entry["type"]], entry["count"]
        if "bufferView" in entry:
            values = self._elements(entry, count, dtype, shape, place)
        else:
            self._document.charge(count, f"{place}, which has no bufferView,")
            values = np.zeros((count, shape[0] * shape[1]), dtype)
        return self._patch(values, entry["sparse"], shape, place) if "sparse" in entry else values

    def _elements(
        self, entry: Object, count: int, dtype: np.dtype, shape: tuple[int, int], place: str
    ) -> np.ndarray:
        """Return `count` elements of a buffer view as (count, columns * rows)."""
        columns, rows = shape
        data = self._document.buffer_view(entry["bufferView"])
        offset = entry.get("byteOffset", 0)
        column = rows * dtype.itemsize
        if columns > 1:
            column = (column + 3) // 4 * 4  # columns of matrices start at multiples of four bytes (3.6.2.4)
        size = (columns - 1) * column + rows * dtype.itemsize
        stride = (
            self._document.items("bufferViews")[entry["bufferView"]].get("byteStride", 0) or columns * column
        )
        if stride < size:
            refuse(
                f"bufferViews[{entry['bufferView']}].byteStride",
                f"is {stride}, less than an element of {size} bytes",
            )
        end = offset + (count - 1) * stride + size
        if end > len(data):
            refuse(place, f"ends at byte {end} of a buffer view of {len(data)} bytes")
        view = np.ndarray((count, columns, rows), dtype, data, offset, (stride, column, dtype.itemsize))
        return view.reshape(count, columns * rows)

    def _patch(self, values: np.ndarray, sparse: Object, shape: tuple[int, int], place: str) -> np.ndarray:
        count = sparse["count"]
        if count > len(values):
            refuse(f"{place}.sparse.count", f"is {count}, more than the {len(values)} elements")
        index_type = COMPONENTS[sparse["indices"]["componentType"]]
        positions = self._elements(sparse["indices"], count, index_type, (1, 1), f"{place}.sparse.indices")[
            :, 0
        ]
        if int(positions.max()) >= len(values):
            refuse(
                f"{place}.sparse.indices",
                f"has index {positions.max()}, but there are only {len(values)} elements",
            )
        patched = values.copy()
        patched[positions] = self._elements(
            sparse["values"], count, values.dtype, shape, f"{place}.sparse.values"
        )
        return patched


def _as_float(raw: np.ndarray, normalized: bool) -> Float32:
    if raw.dtype.kind == "f" or not normalized:
        return np.asarray(raw, np.float32)
    scaled = raw.astype(np.float32)
    scaled /= np.iinfo(raw.dtype).max
    if raw.dtype.kind == "i":
        np.maximum(scaled, -1.0, out=scaled)  # both -128 and -127 mean -1 (glTF 2.0, 3.6.2.2)
    return scaled
