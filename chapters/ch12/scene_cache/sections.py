"""Files of sections: numpy arrays one behind the other, used where they lie in the mapped file.

    header       64 bytes, always the same: what kind of file this is
    sections     the arrays, each at a multiple of 64 bytes, with zeros up to the next
    directory    a blob (`common.files.blobs`): place, shape, type and checksum of each section, what the writer adds
    trailer      40 bytes: where the directory is, how long the file is, and the checksums of directory and trailer

The directory stands behind the arrays because its checksums are known only when they are written, and each is written
when it is there: nothing is held back in memory. Every byte is under some checksum (CRC-32: 3 GB/s on one core, and it
finds every change within 4 adjacent bytes). That of a section is compared at its first use, by the thread that uses
it: textures are by far most of a scene, and their bytes are read then anyway.
"""

from __future__ import annotations

import mmap
import os
import struct
import threading
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.files.blobs import ALIGNMENT, BlobError, read_blob, write_blob
from common.paths import WholeFile

VERSION = 1
"""Of the layout above; the writer's own version stands in what it adds."""

MAX_SECTIONS = 2**24
MAX_SIDES = 4
"""Axes that an array may have."""

HEADER = b"STRATA sections of a scene, version 1\n".ljust(ALIGNMENT, b"\0")
_TRAILER = struct.Struct("<QQQII8s")  # directory's place and size, file's size, two checksums, end mark
_END = b"sections"
_TYPES = tuple(
    np.dtype(f"<{code}") for code in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8")
)


class DamagedError(Exception):
    """The file is not whole: the text says what is wrong with it, as the end of a sentence."""


class SectionWriter:
    """Writes a file of sections, from several threads if need be. It is there after `keep`, or not at all."""

    def __init__(self, path: Path) -> None:
        """Raises OSError, as all that writes does: no such folder, no right to write, no space left."""
        self._lock = threading.Lock()
        self._rows: list[tuple[int, int, int, int, list[int]]] = []  # place, size, checksum, type, shape
        self._file = WholeFile(path)
        self._file.stream.write(HEADER)
        self._end = len(HEADER)

    def add(self, array: np.ndarray[Any, Any]) -> int:
        """Write an array of numbers of up to four axes; return the number of its section."""
        array = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
        if array.ndim > MAX_SIDES or array.dtype not in _TYPES:
            raise TypeError(f"a section holds no {array.dtype} with {array.ndim} axes")
        data = array.reshape(-1).view(np.uint8).data
        padding = bytes(-len(data) % ALIGNMENT)
        checksum = zlib.crc32(padding, zlib.crc32(data))
        with self._lock:
            self._file.stream.write(data)
            self._file.stream.write(padding)
            self._rows.append((self._end, len(data), checksum, _TYPES.index(array.dtype), list(array.shape)))
            self._end += len(data) + len(padding)
            return len(self._rows) - 1

    def keep(self, about: dict[str, Any]) -> int:
        """Write what is `about` the sections (see `write_blob` for what that holds) and the end; return all bytes."""
        place, size, checksum, kind, shapes = zip(*self._rows, strict=True) if self._rows else ((),) * 5
        sides = [[*shape, *[1] * (MAX_SIDES - len(shape))] for shape in shapes]
        columns = {
            "place": np.array(place, np.uint64),
            "size": np.array(size, np.uint64),
            "checksum": np.array(checksum, np.uint32),
            "type": np.array(kind, np.uint8),
            "axes": np.array([len(shape) for shape in shapes], np.uint8),
            "shape": np.array(sides, np.uint64).reshape(-1, MAX_SIDES),
        }
        directory = write_blob({"about": about, "sections": columns}, VERSION)
        total = self._end + len(directory) + _TRAILER.size
        trailer = _trailer(self._end, len(directory), total, zlib.crc32(directory))
        self._file.stream.write(directory + trailer)
        self._file.keep()
        return total

    def drop(self) -> None:
        """Remove what was written, unless it was kept."""
        self._file.drop()


def _trailer(place: int, size: int, total: int, checksum: int) -> bytes:
    """Return the end of a file; its own checksum is that of itself with a zero in that place."""
    blank = _TRAILER.pack(place, size, total, checksum, 0, _END)
    return _TRAILER.pack(place, size, total, checksum, zlib.crc32(blank), _END)


class SectionFile:
    """A mapped file of sections: `array(number)` is a read-only view, compared with its checksum at the first use."""

    def __init__(self, path: Path) -> None:
        """Raises OSError where it cannot be read, DamagedError where its header, directory or end are not whole."""
        with path.open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size < len(HEADER) + _TRAILER.size:
                raise DamagedError(f"has {size} bytes, fewer than an empty one")
            self._bytes: NDArray[np.uint8] = np.frombuffer(
                mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ), np.uint8
            )
        self.size = len(self._bytes)
        if self._bytes[: len(HEADER)].tobytes() != HEADER:
            raise DamagedError("is of another kind or version")
        end = self._bytes[-_TRAILER.size :].tobytes()
        place, length, total, checksum, _, _ = _TRAILER.unpack(end)
        if end != _trailer(place, length, total, checksum) or total != self.size:
            raise DamagedError("has a damaged end, or was cut short")
        if place + length + _TRAILER.size != total:
            raise DamagedError("has its directory in another place than it says")
        directory = self._bytes[place : place + length]
        if zlib.crc32(directory.data) != checksum:
            raise DamagedError("has a damaged directory")
        try:
            value = read_blob(directory, VERSION)
        except BlobError as error:
            raise DamagedError(f"has a directory that cannot be read ({error})") from None
        self.about: dict[str, Any] = value["about"]
        self._columns: dict[str, list[Any]] = {
            name: column.tolist() for name, column in value["sections"].items()
        }
        self._check_places(value["sections"], place)
        self._whole: set[int] = set()

    def __len__(self) -> int:
        return len(self._columns["place"])

    def _check_places(self, columns: dict[str, np.ndarray[Any, Any]], end: int) -> None:
        """Raise DamagedError unless the sections lie behind each other up to `end`, each as long as its shape says."""
        place, size = columns["place"].astype(np.int64), columns["size"].astype(np.int64)
        starts = np.cumsum([len(HEADER), *(-(-size // ALIGNMENT) * ALIGNMENT)])
        if len(place) > MAX_SECTIONS or (place != starts[:-1]).any() or starts[-1] != end or (size < 0).any():
            raise DamagedError("has sections that do not lie behind each other")
        kinds = np.array([dtype.itemsize for dtype in _TYPES])[columns["type"]]
        if (columns["shape"].astype(np.float64).prod(axis=1) * kinds != size).any():
            raise DamagedError("has sections of another size than they say")

    def array(self, number: int) -> np.ndarray[Any, Any]:
        """Return a section. Raises DamagedError: its bytes are not those that were written."""
        columns = self._columns
        place, size = columns["place"][number], columns["size"][number]
        if number not in self._whole:
            written = self._bytes[place : place + -(-size // ALIGNMENT) * ALIGNMENT]
            if zlib.crc32(written.data) != columns["checksum"][number]:
                raise DamagedError(f"has a damaged section, number {number}")
            self._whole.add(number)
        shape = columns["shape"][number][: columns["axes"][number]]
        return self._bytes[place : place + size].view(_TYPES[columns["type"][number]]).reshape(shape)
