"""ETC2 blocks in numpy: what each bit of the RGB8 format stands for, in all of its five modes.

A block is 64 bits, read as one big-endian number, for 4x4 texels without alpha. GPUs of phones read it, those of
desktops mostly do not. The older format ETC1 has the first two modes; the other three are told apart by differences
that leave the range of colours, which ETC1 forbade (Khronos Data Format Specification 1.3, chapter 21).
`common.images.blocks.encode` makes such blocks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Int = NDArray[np.int64]

BLOCK = 4
"""Texels of a block's side."""

INDIVIDUAL, DIFFERENTIAL, T, H, PLANAR = range(5)
"""What `modes` returns."""

MODIFIERS = np.array([(2, 8), (5, 17), (9, 29), (13, 42), (18, 60), (24, 80), (33, 106), (47, 183)], np.int64)
"""How far the nearer and the further colours of a half block lie from its base, in each of 8 tables."""

DISTANCES = np.array([3, 6, 11, 16, 23, 32, 41, 64], np.int64)
"""How far the colours of the modes T and H lie from the base that they belong to."""

# A texel's number counts along columns: its column and its row are
_X, _Y = np.divmod(np.arange(16), 4)


def decode(blocks: Bytes, width: int, height: int) -> Bytes:
    """Return (height, width, 4) uint8 of (rows of blocks, bytes of a row); alpha is 255.

    ValueError for bytes of another shape than such a picture has.
    """
    rows, row = -(-height // BLOCK), -(-width // BLOCK) * 8
    if blocks.shape != (rows, row) or blocks.dtype != np.uint8:
        raise ValueError(
            f"{width}x{height} texels are {(rows, row)} uint8, not {blocks.shape} {blocks.dtype}."
        )
    words = np.ascontiguousarray(blocks).view(">u8").astype(np.uint64).reshape(-1)
    texels = _texels(words).reshape(
        rows, row // 8, 4, 4, 3
    )  # by row and column of blocks, then x, y, channel
    picture = np.full((rows * BLOCK, row // 8 * BLOCK, 4), 255, np.uint8)
    picture[..., :3] = texels.transpose(0, 3, 1, 2, 4).reshape(*picture.shape[:2], 3)
    return picture[:height, :width]


def modes(blocks: Bytes) -> NDArray[np.uint8]:
    """Return the mode of each block of (rows of blocks, bytes of a row)."""
    words = np.ascontiguousarray(blocks).view(">u8").astype(np.uint64)
    return _modes(words)


def with_constants(blocks: Bytes, pixels: Bytes) -> Bytes:
    """Return (N, 8) blocks of (N, 16, 4) pixels, those of a single colour as a plane that does not rise.

    Encoders write such a block with 5 bits a channel and a step of 2 added: etcpak is off by up to 9 codes. A plane has
    6, 7 and 6 bits, and is off by 2.
    """
    constant = (pixels[..., :3] == pixels[:, :1, :3]).all(axis=(1, 2))
    colors = pixels[constant, 0, :3].astype(np.int64)
    red, green, blue = ((2 * colors[:, n] * top + 255) // 510 for n, top in enumerate((63, 127, 63)))
    plain = blocks.copy()
    plain[constant] = _plane(red, green, blue).astype(">u8").view(np.uint8).reshape(-1, 8)
    return plain


def _plane(red: Int, green: Int, blue: Int) -> NDArray[np.uint64]:
    """Return planar blocks whose three colours are one, of 6, 7 and 6 bits."""
    word = red << 57 | green >> 6 << 56 | (green & 63) << 49
    word |= blue >> 5 << 48 | (blue >> 3 & 3) << 43 | (blue & 7) << 39
    word |= (
        red >> 1 << 34 | 1 << 33 | (red & 1) << 32 | green << 25 | blue << 19 | red << 13 | green << 6 | blue
    )
    # Read as a differential block, red and green must stay in their range and blue must leave it. The free bits see to
    # that: the upper end of a base whose step falls, and for blue the side to which its fixed bits lean.
    word |= (word >> 50 & 1) << 55
    above = (word >> 43 & 3) + (word >> 40 & 3) >= 4
    word |= np.where(above, 7 << 45, 1 << 42)
    return word.astype(np.uint64) | (word >> 58 & 1).astype(np.uint64) << np.uint64(63)


def _bits(words: NDArray[np.uint64], high: int, low: int) -> Int:
    """Return the bits `high` to `low` of each word as a number."""
    return (words >> np.uint64(low) & np.uint64((1 << high - low + 1) - 1)).astype(np.int64)


def _modes(words: NDArray[np.uint64]) -> NDArray[np.uint8]:
    over = []
    for high in (63, 55, 47):
        base, step = _bits(words, high, high - 4), _bits(words, high - 5, high - 7)
        ends = base + ((step ^ 4) - 4)  # three bits with a sign
        over.append((ends < 0) | (ends > 31))
    differential = _bits(words, 33, 33) == 1
    modes = np.select([~differential, *over], [INDIVIDUAL, T, H, PLANAR], DIFFERENTIAL)
    return modes.astype(np.uint8)


def _texels(words: NDArray[np.uint64]) -> Bytes:
    """Return the colours (N, 16, 3) of N blocks, texels by their number."""
    texels = np.empty((len(words), 16, 3), np.uint8)
    mode = _modes(words)
    for kinds, unpack in (
        ((INDIVIDUAL, DIFFERENTIAL), _halves),
        ((T,), _t),
        ((H,), _h),
        ((PLANAR,), _planar),
    ):
        chosen = np.isin(mode, kinds)
        if chosen.any():
            texels[chosen] = np.clip(unpack(words[chosen]), 0, 255)
    return texels


def _codes(words: NDArray[np.uint64]) -> Int:
    """Return the two bits (N, 16) of each texel: the upper ones lie 16 bits above the lower ones."""
    places = np.arange(16, dtype=np.uint64)
    low = words[:, None] >> places & np.uint64(1)
    high = words[:, None] >> places + np.uint64(16) & np.uint64(1)
    return (high << np.uint64(1) | low).astype(np.int64)


def _widened(values: Int, bits: int) -> Int:
    """Return values of `bits` bits as 8 bits: the upper bits again below the others, so that the largest is 255."""
    return values << 8 - bits | values >> 2 * bits - 8


def _color(words: NDArray[np.uint64], *places: tuple[int, int]) -> Int:
    """Return (N, 3) of the bit ranges of three channels."""
    return np.stack([_bits(words, *place) for place in places], axis=-1)


def _halves(words: NDArray[np.uint64]) -> Int:
    """Two halves, beside or above each other, each with a base colour and a table of steps from it, equal in RGB."""
    differential = _bits(words, 33, 33)[:, None]
    first = _color(words, (63, 59), (55, 51), (47, 43))
    step = (_color(words, (58, 56), (50, 48), (42, 40)) ^ 4) - 4
    bases = np.where(
        np.stack([differential, differential], axis=1) == 1,
        _widened(np.stack([first, first + step], axis=1), 5),
        _widened(
            np.stack(
                [
                    _color(words, (63, 60), (55, 52), (47, 44)),
                    _color(words, (59, 56), (51, 48), (43, 40)),
                ],
                axis=1,
            ),
            4,
        ),
    )  # (N, 2, 3)
    tables = np.stack([_bits(words, 39, 37), _bits(words, 36, 34)], axis=-1)
    half = np.where(_bits(words, 32, 32)[:, None] == 1, _Y >= 2, _X >= 2).astype(np.int64)
    block, code = np.arange(len(words))[:, None], _codes(words)
    size = MODIFIERS[tables[block, half], code & 1]
    return bases[block, half] + np.where(code & 2, -size, size)[..., None]


def _t(words: NDArray[np.uint64]) -> Int:
    """One colour alone, and three on a line: the upper stroke and the stem of a T."""
    red = _bits(words, 60, 59) << 2 | _bits(words, 57, 56)
    first = np.stack([red, _bits(words, 55, 52), _bits(words, 51, 48)], axis=-1) * 17
    two = _color(words, (47, 44), (43, 40), (39, 36)) * 17
    distance = DISTANCES[_bits(words, 35, 34) << 1 | _bits(words, 32, 32)][:, None]
    return _painted(words, first, two + distance, two, two - distance)


def _h(words: NDArray[np.uint64]) -> Int:
    """Two colours on each of two parallel lines, as the strokes of an H."""
    green = _bits(words, 58, 56) << 1 | _bits(words, 52, 52)
    blue = _bits(words, 51, 51) << 3 | _bits(words, 49, 47)
    first = np.stack([_bits(words, 62, 59), green, blue], axis=-1) * 17
    two = _color(words, (46, 43), (42, 39), (38, 35)) * 17
    # One more bit is saved: it is the order in which the two colours stand.
    weights = np.array([1 << 16, 1 << 8, 1])
    order = (first @ weights >= two @ weights).astype(np.int64)
    distance = DISTANCES[_bits(words, 34, 34) << 2 | _bits(words, 32, 32) << 1 | order][:, None]
    return _painted(words, first + distance, first - distance, two + distance, two - distance)


def _painted(words: NDArray[np.uint64], *paints: Int) -> Int:
    """Return the colours (N, 16, 3) that the texels choose out of four (N, 3)."""
    return np.stack(paints, axis=1)[np.arange(len(words))[:, None], _codes(words)]


def _planar(words: NDArray[np.uint64]) -> Int:
    """A plane through three colours: at the first texel, and 4 texels to its right and below it."""
    green = _bits(words, 56, 56) << 6 | _bits(words, 54, 49)
    blue = _bits(words, 48, 48) << 5 | _bits(words, 44, 43) << 3 | _bits(words, 41, 39)
    red = _bits(words, 38, 34) << 1 | _bits(words, 32, 32)
    origin, right, below = (
        np.stack([_widened(r, 6), _widened(g, 7), _widened(b, 6)], axis=-1)[:, None]
        for r, g, b in (
            (_bits(words, 62, 57), green, blue),
            (red, _bits(words, 31, 25), _bits(words, 24, 19)),
            (_bits(words, 18, 13), _bits(words, 12, 6), _bits(words, 5, 0)),
        )
    )
    x, y = _X[:, None], _Y[:, None]
    return x * (right - origin) + y * (below - origin) + 4 * origin + 2 >> 2
