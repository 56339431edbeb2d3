"""Damage to bytes: anywhere, to numbers in buffers, to the frame of a .glb, to pictures."""

from __future__ import annotations

import io
import random
import struct
import zlib
from functools import cache

import numpy as np
from PIL import Image

PICTURES = (".png", ".jpg", ".jpeg")
WORDS = (
    *(0, 1, 0xFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF),  # integers
    *(
        0x7FC00000,
        0x7F800000,
        0xFF800000,
        0x7F7FFFFF,
        0xFF7FFFFF,
        0x00000001,
        0x5D5E0B6B,
        0x49742400,
    ),  # floats
)
"""Words of four bytes: ends of integers; NaN, infinities, the largest and least floats, 1e18 and 1e6."""


def damage(data: bytes, rng: random.Random, changes: list[str]) -> bytes:
    """Return `data` with one to eight changes anywhere: bits, bytes, words, cuts, insertions, copies."""
    damaged = bytearray(data or b"\0")
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(damaged) or 1)
        if not damaged:
            break
        match rng.randrange(7):
            case 0:
                damaged[at] ^= 1 << rng.randrange(8)
            case 1:
                damaged[at] = rng.randrange(256)
            case 2:
                damaged[at & ~3 : (at & ~3) + 4] = struct.pack("<I", rng.choice(WORDS))
            case 3:
                del damaged[at : at + rng.choice((1, 4, 64, 4096))]
            case 4:
                damaged[at:at] = rng.randbytes(rng.choice((1, 4, 64)))
            case 5:
                damaged[at:at] = damaged[at : at + rng.choice((16, 256, 4096))]
            case _:
                if rng.random() < 0.3:
                    del damaged[at:]
    changes.append(f"bytes of a file of {len(data)}")
    return bytes(damaged)


def damage_words(data: bytes, begin: int, rng: random.Random, changes: list[str]) -> bytes:
    """Return `data` with some words of four bytes behind `begin` replaced by ends of what they may be; or cut short."""
    damaged = bytearray(data)
    count = (len(damaged) - begin) // 4
    if count < 1:
        return data
    if rng.random() < 0.1 and not begin:
        changes.append("a buffer is cut short")
        return bytes(damaged[: rng.randrange(len(damaged))])
    for _ in range(rng.choice((1, 4, 64))):
        at, run = begin + 4 * rng.randrange(count), rng.choice((1, 1, 3, 16))
        word = struct.pack("<I", rng.choice(WORDS))
        damaged[at : at + 4 * run] = (word * run)[: len(damaged) - at]
    changes.append("numbers of a buffer")
    return bytes(damaged)


def damage_container(data: bytes, rng: random.Random, changes: list[str]) -> bytes:
    """Return a .glb with one of its lengths, types, its version or its order of chunks changed."""
    damaged = bytearray(data)
    size = int.from_bytes(data[12:16], "little")
    places = [4, 8, 12, 16] + ([20 + size, 24 + size] if len(data) >= 28 + size else [])
    match rng.randrange(4):
        case 0 | 1:
            struct.pack_into("<I", damaged, rng.choice(places), rng.choice((*WORDS, 2, size, len(data) - 1)))
        case 2:
            chunk = struct.pack("<I4s", 8, rng.choice((b"JSON", b"BIN\0", b"XXXX"))) + b"{}      "
            at = rng.choice((12, 20 + size, len(damaged)))
            damaged[at:at] = chunk
            struct.pack_into("<I", damaged, 8, len(damaged))
        case _:
            del damaged[rng.randrange(len(damaged)) :]
    changes.append("the frame of the .glb")
    return bytes(damaged)


def damage_picture(data: bytes, alone: bool, rng: random.Random, changes: list[str]) -> bytes:
    """Return `data` with a picture in it damaged; a file that is a picture `alone` may become another one."""
    if alone and rng.random() < 0.4:
        name = rng.choice(sorted(_others()))
        changes.append(f"a picture is {name}")
        return _others()[name]
    begin = data.find(b"\x89PNG\r\n\x1a\n")
    if begin >= 0 and rng.random() < 0.5:
        damaged = bytearray(data)
        at = begin + rng.choice((16, 20))  # width, height
        struct.pack_into(
            ">I", damaged, at, rng.choice((0, 1, 3, 5, 8192, 16384, 16385, 65536, 0x7FFFFFFF, 0xFFFFFFFF))
        )
        if rng.random() < 0.3:
            damaged[begin + 24 + rng.randrange(5)] = rng.choice((0, 1, 2, 3, 4, 6, 8, 16, 255))
        struct.pack_into(">I", damaged, begin + 29, zlib.crc32(damaged[begin + 12 : begin + 29]))
        changes.append("the header of a PNG")
        return bytes(damaged)
    begin = max(begin, data.find(b"\xff\xd8\xff"))
    if begin < 0:
        return data
    head, tail = data[:begin], bytearray(data[begin:])
    for _ in range(rng.choice((1, 4, 32))):  # lengths stay, or a .glb would end elsewhere
        tail[rng.randrange(min(len(tail), 4096))] = rng.randrange(256)
    changes.append("bytes of a picture")
    return head + bytes(tail)


@cache
def _others() -> dict[str, bytes]:
    """Pictures of other kinds and sizes, by what they are."""
    rng = np.random.default_rng(2)
    small = Image.fromarray(rng.integers(0, 256, (8, 8, 3), np.uint8))
    exif = b"Exif\0\0MM\0\x2a\0\0\0\x08\xff\xff\x01\x12\0\x03\xff\xff\xff\xff\0\x06\0\0\x87\x69\0\4\0\0\0\1\0\0\0\x08"
    found = {
        "empty": b"",
        "text": b"not a picture",
        "of 4096 pixels a side": _coded(Image.new("L", (4096, 4096)), "PNG"),
        "of 8192 pixels a side": _coded(Image.new("1", (8192, 8192)), "PNG"),
        "of 16384 x 1 pixels": _coded(Image.new("RGB", (16384, 1)), "PNG"),
        "of 16 bits": _coded(Image.fromarray(rng.integers(0, 65536, (8, 8), np.uint16)), "PNG"),
        "with a palette": _coded(small.convert("P"), "PNG", transparency=3),
        "in CMYK": _coded(small.convert("CMYK"), "JPEG"),
        "a JPEG with damaged EXIF": _coded(small, "JPEG", exif=exif),
        "a PNG with damaged EXIF": _coded(small, "PNG", exif=exif),
    }
    for kind in ("GIF", "BMP", "TIFF", "WEBP", "PPM", "ICO"):
        found[kind] = _coded(small, kind)
    return found


def _coded(picture: Image.Image, form: str, **more: object) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, form, **more)
    return stream.getvalue()
