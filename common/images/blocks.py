"""Block-compressed textures: blocks of 4x4 texels in 8 or 16 bytes, which the GPU reads without unpacking them.

A format has a name of the backends: "bc4" holds one channel, "bc5" two, "bc7" and "etc2" colour, the latter without
alpha. The work of encoding is etcpak's; what is here cuts pictures into blocks and says what is stored where.

Measured with etcpak 0.9.15 on one core of a 2-core machine, 256x256 texels, PSNR of a smooth picture and a normal map:

    bc4                  0.2 ms    48 and 50 dB
    bc5                  0.4 ms    49 and 49 dB
    bc7, effort fast       7 ms    48.2 and 43.3 dB
    bc7, effort medium    18 ms    49.0 and 45.9 dB
    bc7, effort best      55 ms    50.2 dB and, of another map, 50.7 (medium 49.8 there; noise: 230 ms)
    etc2                 1.1 ms    49 and 45 dB (noise: 14 ms)

BC1, half the bytes of BC7 in 0.3 ms, reaches 39 and 37 dB (bands in smooth colour) and is left out for that.
etcpak holds the interpreter's lock while it encodes: two threads take as long as one after the other (BC7 142 ms
against 135, BC5 75 against 67, ETC2 181 against 185). So pictures are encoded tile by tile, and between two tiles other
threads come to their turn; what is to go faster than one core does needs processes.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from common import packages
from common.errors import UnsupportedError
from common.images import etc2
from common.names import suggest

Bytes = NDArray[np.uint8]
Effort = Literal["fast", "medium", "best"]

BLOCK = 4
"""Texels of a block's side, in every format here."""

BLOCK_BYTES: dict[str, int] = {
    "bc4": 8,
    "bc5": 16,
    "bc7": 16,
    "bc7_srgb": 16,
    "etc2": 8,
    "etc2_srgb": 8,
}
"""Bytes of a block."""

FEATURE: dict[str, str] = {
    name: "etc2" if name.startswith("etc2") else "block-compression" for name in BLOCK_BYTES
}
"""The optional feature that a device must have to sample a format."""

PLAIN: dict[str, str] = {
    "bc4": "r8",
    "bc5": "rg8",
    "bc7": "rgba8",
    "bc7_srgb": "rgba8_srgb",
    "etc2": "rgba8",
    "etc2_srgb": "rgba8_srgb",
}
"""What holds the same channels in 8 bits each, where a device or the encoder is missing: it takes the same swizzle."""

_EFFORTS: dict[Effort, tuple[int, int]] = {"fast": (0, 0), "medium": (4, 0), "best": (4, 4)}
"""BC7: how many ways to cut a block in two are tried, and how far the ends of its colours are searched (0 to 4).

All 64 ways take three times as long as 4 and are no better: 48.9 and 45.9 dB in place of 49.0 and 45.9.
"""

_BC7_TILE, _TILE = 32, 128
"""Texels of the side of what is encoded in one call: 0.3 ms of BC7 in medium effort, and less than 4 ms in any."""


def lack() -> str:
    """Return "" where blocks can be encoded here, else what of the package etcpak: "is not installed"."""
    try:
        packages.load("etcpak")
    except ImportError as error:
        return str(error)
    return ""


def is_compressed(format: str) -> bool:
    """Whether a format, by its name of the backends, holds blocks and not texels."""
    return format in BLOCK_BYTES


def stored_shape(format: str, width: int, height: int, texel: int = 0) -> tuple[int, int]:
    """Return (rows, bytes of a row) of width x height texels as they are stored: rows of blocks, or of texels.

    `texel` is the bytes of a texel of a format without blocks; those with blocks ignore it.
    """
    if not is_compressed(format):
        return height, width * texel
    return (height + BLOCK - 1) // BLOCK, (width + BLOCK - 1) // BLOCK * BLOCK_BYTES[format]


def stored_bytes(format: str, width: int, height: int, texel: int = 0) -> int:
    """Return the bytes of width x height texels; the arguments are those of `stored_shape`."""
    rows, row = stored_shape(format, width, height, texel)
    return rows * row


def storage_of(wanted: str, features: Collection[str]) -> str:
    """Return the format in which a texture is stored: `wanted`, or its uncompressed one where `features` lack it.

    `features` are those of a device, by the names of `backends.contract.FEATURES`.
    """
    return PLAIN[wanted] if is_compressed(wanted) and FEATURE[wanted] not in features else wanted


def encode(pixels: Bytes, format: str, effort: Effort = "medium") -> Bytes:
    """Return (rows of blocks, bytes of a row) uint8 of `pixels` (H, W, 4) uint8.

    Sides that are no multiple of 4 are continued by their last texel. "bc4" takes red alone, "bc5" red and green,
    "etc2" no alpha. The "_srgb" formats hold the same bytes as those without: only their sampling differs. `effort`
    matters to BC7 alone.

    Raises UnsupportedError where the package etcpak is missing or broken, ValueError for other pixels or formats.
    """
    if format not in BLOCK_BYTES:
        raise ValueError(f"There is no block format '{format}'{suggest(format, BLOCK_BYTES)}")
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 4 or 0 in pixels.shape:
        raise ValueError(f"Blocks are made of (H, W, 4) uint8, not {pixels.shape} {pixels.dtype}.")
    family = format.removesuffix("_srgb")
    work, step = _encoder(family, effort), _BC7_TILE if family == "bc7" else _TILE
    height, width = pixels.shape[:2]
    rows, row_bytes = stored_shape(format, width, height)
    padded = np.pad(pixels, ((0, -height % BLOCK), (0, -width % BLOCK), (0, 0)), mode="edge")
    size = BLOCK_BYTES[format]
    encoded = np.empty((rows, row_bytes // size, size), np.uint8)
    for y in range(0, padded.shape[0], step):
        for x in range(0, padded.shape[1], step):
            tile = padded[y : y + step, x : x + step]
            down, across = tile.shape[0] // BLOCK, tile.shape[1] // BLOCK
            packed = work(tile.tobytes(), tile.shape[1], tile.shape[0])
            place = encoded[y // BLOCK :, x // BLOCK :][:down, :across]
            place[:] = np.frombuffer(packed, np.uint8).reshape(place.shape)
    if family == "etc2":
        texels = padded.reshape(rows, BLOCK, -1, BLOCK, 4).swapaxes(1, 2).reshape(-1, BLOCK * BLOCK, 4)
        encoded = etc2.with_constants(encoded.reshape(-1, size), texels)
    return encoded.reshape(rows, row_bytes)


def encode_chain(levels: Sequence[Bytes], format: str, effort: Effort = "medium") -> tuple[Bytes, ...]:
    """Return every level of a mip chain as `encode` does: what `common.scene.images.Chain` and uploads take."""
    return tuple(encode(level, format, effort) for level in levels)


@cache
def _encoder(family: str, effort: Effort) -> Callable[[bytes, int, int], bytes]:
    """Return what encodes tiles: (RGBA bytes, width, height) to blocks in rows."""
    # Here and not above: it asks the system for the processor, 35 ms that no start of the program waits for.
    try:
        etcpak = packages.load("etcpak")
    except ImportError as error:
        raise UnsupportedError(
            f"Block compression needs the package etcpak, which {error}: run `pip install etcpak`, or store textures "
            "uncompressed."
        ) from None
    if family == "bc7":
        parameters = etcpak.BC7CompressBlockParams()
        # Equal weights: as it comes it weighs green over blue by what the eye sees, which normal maps do not mean.
        parameters.init_linear_weights()
        parameters.m_max_partitions, parameters.m_uber_level = _EFFORTS[effort]
        return lambda data, width, height: etcpak.compress_bc7(data, width, height, parameters)
    plain: dict[str, Callable[[bytes, int, int], bytes]] = {
        "bc4": etcpak.compress_bc4,
        "bc5": etcpak.compress_bc5,
        "etc2": etcpak.compress_etc2_rgb,
    }
    return plain[family]
