"""Films: animations in files, as WebP, GIF or PNG, and what each of them can hold.

Frames are taken one after the other while the file is written, and what is kept of them is bounded: of WebP all frames
are kept compressed, of GIF all frames with a byte a pixel, of PNG a single frame.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL import features

from common.errors import UserError
from common.images.images import check_writable, encode_png
from common.paths import WholeFile

Codes = NDArray[np.uint8]

LONGEST_S = 60.0
"""A frame is shown for at most so long: PNG counts milliseconds in 16 bits."""


@dataclass(frozen=True)
class _Kind:
    """A format: its name, the largest side, frames per second, bytes of all frames, and options of Pillow.

    Browsers show a frame of 10 ms or less for 100 ms. `tick_ms` is the unit of a frame's time, `pixel` the bytes of a
    pixel of which `most` is the sum.
    """

    name: str
    side: int
    rate: float
    tick_ms: int
    pixel: int
    most: int
    how: dict[str, Any]


FILMS = {
    ".webp": _Kind("WEBP", 16383, 90.0, 1, 3, 8 << 30, {"lossless": True, "quality": 0, "method": 0}),
    ".gif": _Kind("GIF", 65535, 50.0, 10, 1, 2 << 30, {}),
    ".png": _Kind("PNG", 65535, 90.0, 1, 3, 8 << 30, {}),
}
"""Formats by suffix. WebP and PNG keep every code; GIF has 256 colours a frame. WebP is written with the least effort:
more makes a file half as large in ten times the time."""


USUAL_RATE = 60.0
"""Frames per second where none are asked for."""


def usual_rate(path: Path | None) -> float:
    """Return the frames per second of a file where none are asked for: no more than a film of its format can show.

    A frame of a GIF lasts whole hundredths of a second, and at least two: 50 a second are the nearest to 60.
    """
    kind = FILMS.get("" if path is None else path.suffix.lower())
    return USUAL_RATE if kind is None else min(USUAL_RATE, kind.rate)


def check_film(path: Path, frames: int, size: tuple[int, int], per_second: float) -> None:
    """Raise UserError if a film cannot be written to `path`: to be called before the work."""
    check_writable(path, tuple(FILMS))
    suffix, (width, height) = path.suffix.lower(), size
    kind = FILMS[suffix]
    if kind.name == "WEBP" and not features.check("webp"):
        raise UserError(f"{path} cannot be written: this Pillow has no WebP; write .png or .gif.")
    if max(size) > kind.side:
        raise UserError(f"{path} cannot hold {width}x{height}: a side has at most {kind.side} pixels.")
    if per_second > kind.rate:
        raise UserError(
            f"{path} cannot show {per_second:g} frames a second: --fps is at most {kind.rate:g} for {suffix}."
        )
    if per_second * LONGEST_S < 1:
        raise UserError(
            f"{path} cannot show a frame for {1 / per_second:g} s: give an --fps of at least {1 / LONGEST_S:.2g}."
        )
    if frames * width * height * kind.pixel > kind.most:
        raise UserError(
            f"{path} would be too large with {frames} frames of {width}x{height}: record fewer or smaller ones, or "
            f"numbered pictures, as in {path.with_name(path.stem)}-%04d.png."
        )


def durations_ms(frames: int, per_second: float, tick_ms: int = 1) -> list[int]:
    """Return for how long each frame is shown, in whole ticks: together they last frames / per_second within a tick.

    60 frames a second are 17, 16 and 17 ms in turns.
    """
    ends = [round(frame * 1000 / (per_second * tick_ms)) for frame in range(frames + 1)]
    return [(end - begin) * tick_ms for begin, end in pairwise(ends)]


def write_film(path: Path, pictures: Iterable[Codes], frames: int, per_second: float) -> None:
    """Write an endless film of `frames` pictures (H, W, 3 or 4) uint8 of one size, whole or not at all.

    Errors that come from `pictures` pass through. Raises UserError for a path that cannot be written.
    """
    kind = FILMS[path.suffix.lower()]
    shown_ms = durations_ms(frames, per_second, kind.tick_ms)
    codes = (np.ascontiguousarray(picture[..., :3]) for picture in pictures)
    try:
        file = WholeFile(path.absolute())
        try:
            if kind.name == "PNG":
                _write_png(file.stream, codes, shown_ms)
            else:
                film = _Frames(codes, frames)
                duration = shown_ms if frames > 1 else shown_ms[0]
                film.save(file.stream, kind.name, save_all=True, loop=0, duration=duration, **kind.how)
            file.keep()
        finally:
            file.drop()
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None


class _Frames(PillowImage.Image):
    """A picture of many frames, which come from an iterator when Pillow moves on to them: it holds one at a time."""

    def __init__(self, pictures: Iterator[Codes], count: int) -> None:
        super().__init__()
        self.n_frames, self.is_animated = count, count > 1
        self._pictures, self._at = pictures, -1
        self.seek(0)

    def tell(self) -> int:
        """Return the number of the frame."""
        return self._at

    def seek(self, frame: int) -> None:
        """Go on to a frame. At the end Pillow goes back to the first, of which it then takes nothing."""
        if frame >= self.n_frames:
            raise EOFError(frame)
        while self._at < frame:
            picture = PillowImage.fromarray(next(self._pictures))
            self.im, self._mode, self._size = picture.im, picture.mode, picture.size
            self._at += 1


def _write_png(to: BinaryIO, pictures: Iterator[Codes], shown_ms: list[int]) -> None:
    """Write an animated PNG (W3C Recommendation "PNG", third edition, 11.3.6) of whole frames.

    Pillow would run over the frames twice and keep all of them.
    """
    number = 0  # of the chunks fcTL and fdAT, which count together
    for index, (picture, milliseconds) in enumerate(zip(pictures, shown_ms, strict=True)):
        height, width = picture.shape[:2]
        chunks = _chunks(encode_png(picture))
        if index == 0:
            to.write(_SIGNATURE + _chunk(b"IHDR", chunks[b"IHDR"]))
            to.write(_chunk(b"acTL", struct.pack(">II", len(shown_ms), 0)))
        place = struct.pack(">IIIIIHHBB", number, width, height, 0, 0, milliseconds, 1000, 0, 0)
        to.write(_chunk(b"fcTL", place))
        data = chunks[b"IDAT"]
        to.write(
            _chunk(b"IDAT", data) if index == 0 else _chunk(b"fdAT", struct.pack(">I", number + 1) + data)
        )
        number += 1 if index == 0 else 2
    to.write(_chunk(b"IEND", b""))


_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _chunks(png: bytes) -> dict[bytes, bytes]:
    """Return the contents of a PNG's chunks by name; those of one name are joined, as IDAT is meant to be."""
    contents: dict[bytes, bytes] = {}
    at = len(_SIGNATURE)
    while at < len(png):
        (size,), kind = struct.unpack(">I", png[at : at + 4]), png[at + 4 : at + 8]
        contents[kind] = contents.get(kind, b"") + png[at + 8 : at + 8 + size]
        at += 12 + size
    return contents
