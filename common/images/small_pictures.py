"""Pictures that are kept in the repository: PNG files of at most 150 kB, without loss where that is enough."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from common.errors import UserError
from common.paths import write_whole

MOST_BYTES = 150_000
"""Of one picture. A clone carries every version of every picture for ever, and a page of a lesson shows a dozen."""

COLORS = (256, 192, 128, 64)
"""Sizes of palettes that are tried: one byte a pixel instead of three is what makes a picture of noise fit."""


def encode_small(image: NDArray[np.uint8], most: int = MOST_BYTES) -> bytes | None:
    """Return a PNG of (H, W, 3) uint8 in at most `most` bytes, or None where there is none.

    All bits are kept if they fit. Else the picture gets the largest palette that does, of its own colours: the boxes of
    median cut (Heckbert 1982), moved to the means of what they stand for, since boxes alone forget a small thing of a
    colour of its own. The rounding of each pixel is handed on to its neighbours (Floyd and Steinberg 1976), so that a
    gradient becomes fine grain and not steps.
    """
    whole = Image.fromarray(np.ascontiguousarray(image[..., :3]))
    data = _png(whole)
    for colors in COLORS:
        if len(data) <= most:
            return data
        palette = whole.quantize(colors, Image.Quantize.MEDIANCUT, kmeans=8, dither=Image.Dither.NONE)
        # Pillow hands rounding on only over a palette that is given.
        data = _png(whole.quantize(colors, palette=palette, dither=Image.Dither.FLOYDSTEINBERG))
    return data if len(data) <= most else None


def _png(image: Image.Image) -> bytes:
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    return stream.getvalue()


def write_small(path: Path, image: NDArray[np.uint8], most: int = MOST_BYTES) -> None:
    """Write a picture (H, W, 3) uint8 in at most `most` bytes, whole or not at all.

    Raises UserError for one that is too large even with a palette, or where the disk refuses.
    """
    data = encode_small(image, most)
    if data is None:
        height, width = image.shape[:2]
        raise UserError(
            f"{path} would be larger than {most / 1e3:.0f} kB at {width}x{height}: draw it smaller than that."
        )
    try:
        write_whole(path.absolute(), data)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None
