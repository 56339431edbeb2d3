"""Pictures of a glTF file decoded with Pillow on threads, their size bounded before a pixel is unpacked.

Or decoded later, by whoever needs their pixels: then only headers are read here.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import PurePath

import numpy as np
from PIL import Image as Pillow

from common.errors import SceneError
from common.gltf.container import Bytes, read_uri
from common.gltf.document import Document
from common.gltf.refusal import Refusal, refuse
from common.scene_images import EncodedImage, Image, Pixels

MAX_SIDE = 16_384
"""Pixels along a side: what graphics cards take as a texture."""
MAX_PIXELS = 2**26
"""Pixels of one image (8192 x 8192); below the count at which Pillow suspects an attack."""
MAX_TOTAL_BYTES = 4 * 2**30
"""Decoded bytes of all images of a scene together."""

_SMALLER = "make the image smaller"

_BAND = 1 << 17
"""Pixels that become an array at once. Decoding lets other threads run, this does not, and a renderer would wait."""


class ImageDecoder:
    """Decodes the images that a scene uses while the caller works on its geometry.

    The constructor reads headers and queues the work; `finish` waits. Pillow releases the interpreter lock
    while it inflates.
    """

    def __init__(
        self,
        document: Document,
        used: Sequence[int],
        progress: Callable[[], None] | None = None,
        later: Callable[[Refusal], SceneError] | None = None,
    ) -> None:
        """`used` are image numbers of the file; `progress` is called from a thread after each image.

        With `later` nothing is decoded here: images are `EncodedImage`, and it makes of a refusal what they raise.
        """
        self._later, self._encoded = later, list[Image]()
        self._pool = ThreadPoolExecutor(min(8, os.cpu_count() or 1), thread_name_prefix="decode-image")
        self._futures: list[Future[Image]] = []
        total = 0
        try:
            for index in used:
                place = f"images[{index}]"
                entry = document.items("images")[index]
                name = entry.get("name") or PurePath(_file_name(entry.get("uri", ""))).stem
                if entry.get("uri"):
                    data = read_uri(entry["uri"], document.folder, f"{place}.uri")
                elif "bufferView" in entry:
                    data = document.buffer_view(entry["bufferView"])
                else:
                    refuse(place, "has neither uri nor bufferView")
                if (
                    later is not None
                ):  # by then the file may be shorter, and reading behind its end ends the process
                    data = data.copy()
                width, height = image_size(data, place)
                total += width * height * 4
                if total > MAX_TOTAL_BYTES:
                    refuse(
                        place, f"brings the images of the scene above {MAX_TOTAL_BYTES >> 30} GiB", _SMALLER
                    )
                decode = partial(_decode, data, (width, height), place)
                if self._later is not None:
                    dtype = np.uint16 if is_deep_grey(data) else np.uint8
                    self._encoded.append(
                        EncodedImage(
                            name, (width, height), dtype, partial(_decode_later, decode, self._later)
                        )
                    )
                    continue
                self._futures.append(self._pool.submit(_decoded, decode, name, progress))
        except BaseException:
            self.close()
            raise

    def finish(self) -> list[Image]:
        """Return the images in the order asked for.

        Raises:
            Refusal: one is damaged; the first of them is named.
        """
        return [*self._encoded, *(future.result() for future in self._futures)]

    def close(self) -> None:
        """Drop what has not begun and wait for the rest."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def _file_name(uri: str) -> str:
    return "" if uri[:5].lower() == "data:" else uri


def image_size(data: Bytes, place: str) -> tuple[int, int]:
    """Return (width, height) from the header of a PNG or JPEG.

    Pillow would tell as well, but only after its own check against huge images, which warns or raises by a
    process-wide setting.

    Raises:
        Refusal: neither PNG nor JPEG, cut short, or larger than `MAX_SIDE` and `MAX_PIXELS` allow.
    """
    head = data[:24].tobytes()
    if head[:8] == b"\x89PNG\r\n\x1a\n" and head[12:16] == b"IHDR" and len(head) == 24:
        width, height = int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    elif head[:2] == b"\xff\xd8":
        width, height = _jpeg_size(data, place)
    else:
        refuse(place, "is neither a PNG nor a JPEG", "convert it to PNG or JPEG")
    if width == 0 or height == 0:
        refuse(place, "has no pixels", "save the image again")
    if width > MAX_SIDE or height > MAX_SIDE or width * height > MAX_PIXELS:
        limit = f"at most {MAX_SIDE} pixels a side and {MAX_PIXELS} together are loaded"
        refuse(place, f"is {width} x {height} pixels, and {limit}", _SMALLER)
    return width, height


def _jpeg_size(data: Bytes, place: str) -> tuple[int, int]:
    """Walk the segments up to the frame header (SOF0..SOF15 without DHT, JPG and DAC; ITU T.81, B.2.2)."""
    offset = 2
    while offset + 9 <= len(data):
        if data[offset] != 0xFF:
            break
        marker = int(data[offset + 1])
        if marker == 0xFF:  # fill byte
            offset += 1
            continue
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = data[offset + 5 : offset + 9].view(">u2")
            return int(width), int(height)
        alone = marker == 0x01 or 0xD0 <= marker <= 0xD7
        offset += 2 if alone else 2 + int.from_bytes(data[offset + 2 : offset + 4].tobytes(), "big")
    return refuse(place, "is a damaged JPEG without a frame header", "save the image again")


def is_deep_grey(data: Bytes) -> bool:
    """Whether this is a PNG with 16 bits of grey: of all files only these have pixels of that type, see `_to_rgba`."""
    head = data[:26].tobytes()
    return head[:4] == b"\x89PNG" and head[24:26] == b"\x10\x00"


def _decode(data: Bytes, size: tuple[int, int], place: str) -> Pixels:
    try:
        with Pillow.open(io.BytesIO(data.tobytes()), formats=("PNG", "JPEG")) as picture:
            if picture.size != size:
                refuse(place, f"has two sizes, {size} and {picture.size}", "save the image again")
            return _to_rgba(picture)
    except Refusal:
        raise
    except Exception as error:  # Pillow's plugins let struct, zlib, syntax and index errors out
        raise Refusal(
            place, f"is damaged ({str(error) or type(error).__name__})", "save the image again"
        ) from error


def _decoded(decode: Callable[[], Pixels], name: str, progress: Callable[[], None] | None) -> Image:
    image = Image(name, decode())
    if progress is not None:
        progress()
    return image


def _decode_later(decode: Callable[[], Pixels], later: Callable[[Refusal], SceneError]) -> Pixels:
    try:
        return decode()
    except Refusal as refusal:
        raise later(refusal) from None


def _to_rgba(picture: Pillow.Image) -> np.ndarray:
    """Return (H, W, 4) uint8, or uint16 for 16-bit grey.

    Pillow keeps 16 bits of grey alone; of 16-bit colour it gives the upper byte.
    """
    if picture.mode.startswith("I"):  # "I;16", "I;16B", and "I" in older versions
        grey = np.asarray(picture)
        if grey.dtype != np.uint16:
            grey = np.clip(grey, 0, 65535).astype(np.uint16)
        pixels = np.full((*grey.shape, 4), 65535, np.uint16)
        pixels[..., :3] = grey[..., None]
        return pixels
    if picture.mode == "CMYK":
        picture = picture.convert("RGB")
    picture.load()
    width, height = picture.size
    pixels = np.empty((height, width, 4), np.uint8)
    rows = max(1, _BAND // width)
    for top in range(0, height, rows):
        band = picture.crop((0, top, width, min(height, top + rows)))
        pixels[top : top + rows] = np.asarray(band if band.mode == "RGBA" else band.convert("RGBA"))
    return pixels
