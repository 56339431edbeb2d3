"""Binary blobs: what JSON holds, and numpy arrays, baked into bytes that load without parsing text.

A blob is a header and one value. Every value is a tag byte and its content, little-endian: numbers as they are in
memory, texts and arrays with their length before them, arrays of numpy aligned so that they can be used where they
lie (a memory-mapped file included). The header has the version of whatever is stored; a reader that expects another
one refuses, since guessing at an old layout is how caches show wrong pictures.
"""

from __future__ import annotations

import math
import struct
from typing import Any, cast

import numpy as np

from common.errors import UserError

ALIGNMENT = 64
"""Bytes; a cache line, and a multiple of every alignment that numpy and graphics interfaces ask for."""
MAX_DEPTH = 200
"""Lists and objects inside each other; enough for any sensible file, and below Python's own limit."""

_MAGIC = b"STRATABL"
_HEADER = struct.Struct(
    "<8sIIQ"
)  # magic, version of the layout of blobs, version of the content, bytes that follow
_LAYOUT = 1
_COUNT = struct.Struct("<Q")
_INT, _FLOAT = struct.Struct("<q"), struct.Struct("<d")
_DTYPES = {
    np.dtype(code).newbyteorder("<").str: np.dtype(code).newbyteorder("<")
    for code in ("?", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f2", "f4", "f8", "c8", "c16")
}
"""Numbers that arrays hold, by numpy's name; its parser of names is not for bytes from a file."""


class BlobError(UserError):
    """The bytes are no blob of the expected version, or are damaged."""


def write_blob(value: Any, version: int) -> bytes:
    """Return the blob of a value made of None, bool, int, float, str, list, dict with str keys, and numpy arrays.

    Equal values give equal bytes. Tuples and other types would come back changed and are refused.

    Raises:
        TypeError: a type that a blob does not hold.
        ValueError: nested more deeply than `MAX_DEPTH`.
    """
    out = bytearray(_HEADER.size)
    _write(out, value, 0)
    _HEADER.pack_into(out, 0, _MAGIC, _LAYOUT, version, len(out) - _HEADER.size)
    return bytes(out)


def read_blob(data: bytes | memoryview | np.ndarray[Any, Any], version: int, name: str = "the blob") -> Any:
    """Return the value of a blob. Arrays are read-only views of `data`; `name` begins the sentence of an error.

    Raises:
        BlobError: no blob, one of another version, or bytes that are cut short or damaged.
    """
    view = memoryview(cast(bytes, data)).cast("B")
    if len(view) < _HEADER.size:
        raise BlobError(f"{name} is cut short: {len(view)} bytes, fewer than its header has; make it again")
    magic, layout, own_version, size = _HEADER.unpack_from(view)
    if magic != _MAGIC:
        raise BlobError(f"{name} is no blob of Strata: name another file, or make it again")
    if (layout, own_version) != (_LAYOUT, version):
        raise BlobError(
            f"{name} has version {layout}.{own_version}, and {_LAYOUT}.{version} is needed: make it again"
        )
    if size != len(view) - _HEADER.size:
        raise BlobError(
            f"{name} has {len(view) - _HEADER.size} bytes after its header instead of {size}: make it again"
        )
    reader = _Reader(view)
    try:
        value = reader.value(0)
    except (struct.error, UnicodeDecodeError, ValueError, LookupError):
        raise BlobError(f"{name} is damaged at byte {reader.offset}: make it again") from None
    if reader.offset != len(view):
        raise BlobError(f"{name} is damaged at byte {reader.offset}: make it again")
    return value


def _write(out: bytearray, value: Any, depth: int) -> None:
    if depth > MAX_DEPTH:
        raise ValueError(f"lists and objects are nested more than {MAX_DEPTH} deep")
    kind = type(value)
    if value is None:
        out += b"N"
    elif kind is bool:
        out += b"T" if value else b"F"
    elif kind is int:
        if -(2**63) <= value < 2**63:
            out += b"i" + _INT.pack(value)
        else:
            _write_bytes(out, b"I", value.to_bytes(value.bit_length() // 8 + 1, "little", signed=True))
    elif kind is float:
        out += b"f" + _FLOAT.pack(value)
    elif kind is str:
        _write_bytes(out, b"s", value.encode("utf-8", "surrogatepass"))
    elif kind is list:
        out += b"l" + _COUNT.pack(len(value))
        for element in value:
            _write(out, element, depth + 1)
    elif kind is dict:
        out += b"d" + _COUNT.pack(len(value))
        for key, element in value.items():
            if type(key) is not str:
                raise TypeError(f"a key of an object in a blob is a str, not {type(key).__name__}")
            _write_bytes(out, b"s", key.encode("utf-8", "surrogatepass"))
            _write(out, element, depth + 1)
    elif kind is np.ndarray and value.dtype.newbyteorder("<").str in _DTYPES:
        values = value.astype(value.dtype.newbyteorder("<"), order="C", copy=False)
        _write_bytes(out, b"a", values.dtype.str.encode())
        out += bytes([value.ndim]) + b"".join(_COUNT.pack(side) for side in value.shape)
        out += bytes(-len(out) % ALIGNMENT)
        out += values.tobytes()
    else:
        raise TypeError(f"a blob holds no {kind.__name__}")


def _write_bytes(out: bytearray, tag: bytes, data: bytes) -> None:
    out += tag + _COUNT.pack(len(data)) + data


class _Reader:
    """Reads values from `view`, never beyond its end; any exception of the unpacking calls means damage."""

    def __init__(self, view: memoryview) -> None:
        self.view = view
        self.offset = _HEADER.size

    def value(self, depth: int) -> Any:
        if depth > MAX_DEPTH:
            raise ValueError
        tag = bytes(self._take(1))
        if tag == b"N":
            return None
        if tag in (b"T", b"F"):
            return tag == b"T"
        if tag == b"i":
            return _INT.unpack(self._take(8))[0]
        if tag == b"I":
            return int.from_bytes(self._take(self._count()), "little", signed=True)
        if tag == b"f":
            return _FLOAT.unpack(self._take(8))[0]
        if tag == b"s":
            return str(self._take(self._count()), "utf-8", "surrogatepass")
        if tag == b"l":
            return [self.value(depth + 1) for _ in range(self._count())]
        if tag == b"d":
            return {self._key(): self.value(depth + 1) for _ in range(self._count())}
        if tag == b"a":
            return self._array()
        raise ValueError

    def _key(self) -> str:
        if bytes(self._take(1)) != b"s":
            raise ValueError
        return str(self._take(self._count()), "utf-8", "surrogatepass")

    def _array(self) -> np.ndarray[Any, Any]:
        dtype = _DTYPES[str(self._take(self._count()), "ascii")]
        shape = [_COUNT.unpack(self._take(8))[0] for _ in range(self._take(1)[0])]
        self._take(-self.offset % ALIGNMENT)
        data = self._take(dtype.itemsize * math.prod(shape))
        array = np.frombuffer(data, dtype).reshape(shape)
        array.flags.writeable = False
        return array

    def _count(self) -> int:
        """Return a length. One that is longer than the file would only fail later, and slowly."""
        count: int = _COUNT.unpack(self._take(8))[0]
        if count > len(self.view):
            raise ValueError
        return count

    def _take(self, size: int) -> memoryview:
        end = self.offset + size
        if end > len(self.view):
            raise IndexError
        part = self.view[self.offset : end]
        self.offset = end
        return part
