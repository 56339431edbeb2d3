"""PNG pictures of 16 bits in two, three or four channels, of which Pillow keeps the upper byte alone.

The format is that of the W3C recommendation "Portable Network Graphics", second edition (2003).
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

UInt16 = NDArray[np.uint16]
Bytes = NDArray[np.uint8]

SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_PIXELS = 1 << 28
_COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # channels -> colour type
_CHANNELS = {color_type: channels for channels, color_type in _COLOR_TYPES.items()}


def is_deep_color(head: bytes) -> bool:
    """Return whether a file that begins with `head` (26 bytes or more) is a PNG this module is needed for."""
    return head.startswith(SIGNATURE) and len(head) >= 26 and head[24] == 16 and head[25] in (2, 4, 6)


def encode_png16(pixels: UInt16) -> bytes:
    """Return a PNG file of pixels (H, W, 1..4) uint16: grey, grey with alpha, RGB, RGBA."""
    height, width, channels = pixels.shape
    rows = np.ascontiguousarray(pixels.astype(">u2")).view(np.uint8).reshape(height, -1)
    above = np.concatenate([np.zeros_like(rows[:1]), rows[:-1]])
    filtered = np.empty((height, rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = 2  # each byte as its difference to the byte above: smooth pictures become small numbers
    filtered[:, 1:] = rows - above
    header = struct.pack(">IIBBBBB", width, height, 16, _COLOR_TYPES[channels], 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(filtered.tobytes(), 6)), (b"IEND", b""))
    return SIGNATURE + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def decode_png16(data: bytes) -> UInt16:
    """Return the pixels (H, W, C) of a 16-bit PNG without interlacing; raises ValueError if it is broken."""
    width, height, channels, packed = 0, 0, 0, []
    for kind, body in _chunks(data):
        if kind == b"IHDR":
            if len(body) != 13:
                raise ValueError("its header has the wrong length")
            width, height, depth, color_type, compression, filtering, interlaced = struct.unpack(
                ">IIBBBBB", body
            )
            if depth != 16 or color_type not in _CHANNELS or compression or filtering:
                raise ValueError("its header names a coding that does not exist")
            if interlaced:
                raise ValueError("it is interlaced, which is not read at 16 bits: save it without")
            if not width or not height or width * height > MAX_PIXELS:
                raise ValueError(f"it claims {width} x {height} pixels")
            channels = _CHANNELS[color_type]
        elif kind == b"IDAT":
            packed.append(body)
    row_bytes = 2 * channels * width
    size = height * (row_bytes + 1)
    if not size:
        raise ValueError("it has no header")
    try:
        raw = zlib.decompressobj().decompress(b"".join(packed), size)  # no more than this, whatever it claims
    except zlib.error:
        raise ValueError("its compressed data is broken") from None
    if len(raw) < size:
        raise ValueError("it ends before its last line")
    lines = np.frombuffer(raw, np.uint8).reshape(height, row_bytes + 1)
    rows = _unfilter(lines[:, 0], lines[:, 1:].reshape(height, width, 2 * channels))
    return np.ascontiguousarray(rows).view(">u2").astype(np.uint16)


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    if not data.startswith(SIGNATURE):
        raise ValueError("it is no PNG")
    chunks, at = [], len(SIGNATURE)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        check = data[at + 8 + length : at + 12 + length]
        if len(check) < 4:
            raise ValueError("it is cut off")
        if check != struct.pack(">I", zlib.crc32(kind + body)):
            raise ValueError(f"its part {kind.decode('latin-1')} fails the checksum")
        chunks.append((kind, body))
        at += 12 + length
    return chunks


def _unfilter(filters: Bytes, pixels: Bytes) -> Bytes:
    """Undo the filters (H,) of pixels (H, W, B).

    Each byte was stored less a prediction from its left, upper and corner neighbour, so the pixels of one
    anti-diagonal do not need each other: W + H steps of whole diagonals in place of W * H single ones.
    """
    height, width, size = pixels.shape
    if filters.max() > 4:
        raise ValueError("a line has a filter that does not exist")
    done = np.zeros(
        (height + 1, width + 1, size), np.int16
    )  # with a zero row above and a zero column at the left
    kind = filters.astype(np.intp)
    for step in range(height + width - 1):
        y = np.arange(max(0, step - width + 1), min(height, step + 1))
        x = step - y
        left, above, corner = done[y + 1, x], done[y, x + 1], done[y, x]
        to_left, to_above = (
            np.abs(above - corner),
            np.abs(left - corner),
        )  # Paeth: which is nearest to l + a - c
        to_corner = np.abs(left + above - 2 * corner)
        paeth = np.where(
            (to_left <= to_above) & (to_left <= to_corner),
            left,
            np.where(to_above <= to_corner, above, corner),
        )
        predictions = np.stack([np.zeros_like(left), left, above, (left + above) >> 1, paeth])
        prediction = predictions[kind[y], np.arange(len(y))]
        done[y + 1, x + 1] = (pixels[y, x] + prediction) & 255
    return done[1:, 1:].astype(np.uint8)
