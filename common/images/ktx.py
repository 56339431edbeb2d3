"""Textures in KTX files: a header, and the mip levels as the GPU takes them, compressed or not.

Version 1 of the container of the Khronos group ("KTX File Format Specification", 2013). It names formats by OpenGL's
numbers, on Vulkan as well. Read and written are 2D textures, arrays and cubes of the formats in `FORMATS`, in either
order of bytes; rows of texels are padded to 4 bytes in the file and nowhere else.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.files.regular_files import read_regular
from common.images.blocks import stored_shape
from common.paths import write_whole

Bytes = NDArray[np.uint8]

IDENTIFIER = b"\xabKTX 11\xbb\r\n\x1a\n"
ENDIANNESS = 0x04030201
MAX_SIDE = 1 << 16
MAX_LAYERS = 1 << 12
ROWS_FROM_THE_TOP = {"KTXorientation": b"S=r,T=d\0"}
"""What says that row 0 is on top; a file that says nothing leaves it open."""

_BYTE, _HALF, _FLOAT = 0x1401, 0x140B, 0x1406
_R, _RG, _RGB, _RGBA = 0x1903, 0x8227, 0x1907, 0x1908


@dataclass(frozen=True)
class KtxFormat:
    """The numbers by which a file names a format, and the bytes of its texels and of the words in these."""

    internal: int
    base: int
    pixels: int = 0  # a compressed format has neither of these two
    component: int = 0
    texel: int = 0
    word: int = 1


FORMATS: dict[str, KtxFormat] = {
    "r8": KtxFormat(0x8229, _R, _R, _BYTE, 1),
    "rg8": KtxFormat(0x822B, _RG, _RG, _BYTE, 2),
    "rgba8": KtxFormat(0x8058, _RGBA, _RGBA, _BYTE, 4),
    "rgba8_srgb": KtxFormat(0x8C43, _RGBA, _RGBA, _BYTE, 4),
    "rgba16f": KtxFormat(0x881A, _RGBA, _RGBA, _HALF, 8, 2),
    "rgba32f": KtxFormat(0x8814, _RGBA, _RGBA, _FLOAT, 16, 4),
    "bc4": KtxFormat(0x8DBB, _R),
    "bc5": KtxFormat(0x8DBD, _RG),
    "bc7": KtxFormat(0x8E8C, _RGBA),
    "bc7_srgb": KtxFormat(0x8E8D, _RGBA),
    "etc2": KtxFormat(0x9274, _RGB),
    "etc2_srgb": KtxFormat(0x9275, _RGB),
}
"""The formats of the backends that a file may hold, by their names there."""

_NAMES = {described.internal: name for name, described in FORMATS.items()}


@dataclass(frozen=True, eq=False)
class Ktx:
    """A texture of a file. `layers` holds all mip levels of each layer, level 0 first, as `Uploader.chain` takes them.

    A level is (rows, bytes of a row) uint8, in the machine's order of bytes. The six faces of a cube are layers,
    those of one cube after another: +X, -X, +Y, -Y, +Z, -Z. `array` says that even one layer is an array.
    """

    format: str
    width: int
    height: int
    layers: tuple[tuple[Bytes, ...], ...]
    cube: bool = False
    array: bool = False
    metadata: Mapping[str, bytes] = field(default_factory=lambda: dict(ROWS_FROM_THE_TOP))

    @property
    def levels(self) -> int:
        """Mip levels."""
        return len(self.layers[0])

    @property
    def elements(self) -> int:
        """Elements of an array as the header counts them: 0 for what is none."""
        count = len(self.layers) // (6 if self.cube else 1)
        return count if self.array or count > 1 else 0


def write_ktx(path: str | Path, texture: Ktx, big_endian: bool = False) -> None:
    """Write a texture; UserError for a path that cannot be written, ValueError for levels of a wrong shape."""
    path = Path(path)
    data = encode_ktx(texture, big_endian)
    try:
        write_whole(path, data)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}") from None


def read_ktx(path: str | Path) -> Ktx:
    """Return the texture of a file; raises UserError with one sentence if it cannot be read."""
    path = Path(path)
    if path.is_dir():
        raise UserError(f"{path} is a folder, not a texture")
    try:
        data = read_regular(path)
    except FileNotFoundError:
        raise UserError(f"there is no file {path}") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}") from None
    try:
        return decode_ktx(data)
    except ValueError as error:
        raise UserError(f"{path} cannot be read: {error}") from None


def encode_ktx(texture: Ktx, big_endian: bool = False) -> bytes:
    """Return the bytes of a file; ValueError for levels of a wrong shape."""
    described, order = FORMATS[texture.format], ">" if big_endian else "<"
    faces = 6 if texture.cube else 1
    if not texture.layers or len(texture.layers) % faces:
        raise ValueError(f"{len(texture.layers)} layers are no whole number of textures of {faces}")
    for levels in texture.layers:
        shapes = [_shape(texture.format, texture.width, texture.height, n) for n in range(texture.levels)]
        if [rows.shape for rows in levels] != shapes:
            raise ValueError(f"the levels of a layer are {shapes}, not {[rows.shape for rows in levels]}")
    pairs = b"".join(_pair(key, value, order) for key, value in texture.metadata.items())
    parts = [
        IDENTIFIER,
        struct.pack(
            f"{order}13I",
            ENDIANNESS,
            described.component,
            described.word,
            described.pixels,
            described.internal,
            described.base,
            *(texture.width, texture.height, 0),
            *(texture.elements, faces, texture.levels, len(pairs)),
        ),
        pairs,
    ]
    swapped = big_endian != (np.dtype("=u2") == np.dtype(">u2"))
    for level in range(texture.levels):
        stored = [_stored(levels[level], described, swapped) for levels in texture.layers]
        single_cube = texture.cube and not texture.elements
        parts.append(struct.pack(f"{order}I", len(stored[0]) if single_cube else sum(map(len, stored))))
        parts += stored
    return b"".join(parts)


def decode_ktx(data: bytes) -> Ktx:
    """Return the texture of a file's bytes; raises ValueError saying what is wrong with them."""
    if not data.startswith(IDENTIFIER):
        raise ValueError(
            "it is KTX 2, and only KTX 1 is read" if data.startswith(b"\xabKTX 20") else "it is no KTX file"
        )
    if len(data) < 64:
        raise ValueError("it ends within its header")
    orders = {struct.pack("<I", ENDIANNESS): "<", struct.pack(">I", ENDIANNESS): ">"}
    order = orders.get(data[12:16], "")
    if not order:
        raise ValueError("its header names no order of bytes")
    component, word, pixels, internal, _, width, height, depth, elements, faces, levels, pair_bytes = (
        struct.unpack_from(f"{order}12I", data, 16)
    )
    name = _NAMES.get(internal, "")
    if not name:
        raise ValueError(f"its format {internal:#x} is none of {', '.join(FORMATS)}")
    described = FORMATS[name]
    if (component, pixels) != (described.component, described.pixels) or word != described.word:
        raise ValueError(f"its header contradicts itself about the texels of {name}")
    if depth or not height:
        raise ValueError("it holds no 2D texture")
    if not 1 <= width <= MAX_SIDE or height > MAX_SIDE or elements > MAX_LAYERS:
        raise ValueError(f"it claims {width}x{height} texels in {max(1, elements)} layers")
    if faces not in (1, 6) or (faces == 6 and width != height):
        raise ValueError(f"it claims {faces} faces of {width}x{height} texels")
    if not 1 <= levels <= max(width, height).bit_length():
        raise ValueError(
            f"it claims {levels} mip levels of {width}x{height} texels"
            if levels
            else "it holds no mip levels but asks for them to be made"
        )
    if pair_bytes > len(data) - 64:
        raise ValueError("it ends within its metadata")
    metadata = _pairs(data[64 : 64 + pair_bytes], order)
    count, at = max(1, elements) * faces, 64 + pair_bytes
    layers: list[list[Bytes]] = [[] for _ in range(count)]
    swapped = (order == ">") != (np.dtype("=u2") == np.dtype(">u2"))
    for level in range(levels):
        rows, row = _shape(name, width, height, level)
        padded = _padded(row)
        size = rows * padded
        told = size if faces == 6 and not elements else size * count
        if len(data) < at + 4 + size * count:
            raise ValueError(f"it ends within mip level {level}")
        if struct.unpack_from(f"{order}I", data, at)[0] != told:
            raise ValueError(f"its mip level {level} has another size than {width}x{height} texels give")
        at += 4
        for levels_of_layer in layers:
            stored = np.frombuffer(data, np.uint8, size, at).reshape(rows, padded)[:, :row]
            levels_of_layer.append(_ordered(stored, described.word, swapped))
            at += size
    level_pixels = tuple(tuple(layer) for layer in layers)
    return Ktx(name, width, height, level_pixels, faces == 6, elements > 0, metadata)


def _shape(format: str, width: int, height: int, level: int) -> tuple[int, int]:
    """Return (rows, bytes of a row) of a level."""
    return stored_shape(format, max(1, width >> level), max(1, height >> level), FORMATS[format].texel)


def _padded(row: int) -> int:
    return (row + 3) // 4 * 4


def _ordered(rows: Bytes, word: int, swapped: bool) -> Bytes:
    """Return rows with the bytes of each word in the other order if `swapped`, contiguous."""
    turned = rows.reshape(len(rows), -1, word)[..., ::-1].reshape(rows.shape) if swapped else rows
    return np.ascontiguousarray(turned)


def _stored(rows: Bytes, described: KtxFormat, swapped: bool) -> bytes:
    """Return a level of a layer as the file has it."""
    pad = _padded(rows.shape[1]) - rows.shape[1]
    return np.pad(_ordered(rows, described.word, swapped), ((0, 0), (0, pad))).tobytes()


def _pair(key: str, value: bytes, order: str) -> bytes:
    both = key.encode() + b"\0" + value
    return struct.pack(f"{order}I", len(both)) + both + bytes(-len(both) % 4)


def _pairs(data: bytes, order: str) -> dict[str, bytes]:
    pairs, at = {}, 0
    while at + 4 <= len(data):
        (size,) = struct.unpack_from(f"{order}I", data, at)
        key, zero, value = data[at + 4 : at + 4 + size].partition(b"\0")
        if size > len(data) - at - 4 or not zero:
            raise ValueError("its metadata is broken")
        pairs[key.decode("utf-8", "replace")] = value
        at += 4 + (size + 3) // 4 * 4
    return pairs
