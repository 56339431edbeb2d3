"""Pictures of a glTF file decoded with Pillow on threads, their size bounded before a pixel is unpacked.

With `later` they are decoded when their pixels are needed, and only headers are read here.
"""

from __future__ import annotations

import hashlib
import io
import os
import zlib
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import PurePath
from typing import IO, cast

import numpy as np
from PIL import Image as Pillow
from PIL.ImageFile import ImageFile
from PIL.PngImagePlugin import PngImageFile

from common.errors import SceneError
from common.gltf.container import Bytes
from common.gltf.document import Document
from common.gltf.refusal import Refusal, refuse
from common.images.exif import without_exif
from common.names import visible
from common.scene.images import EncodedImage, Image, Pixels

MAX_SIDE = 16_384
"""Pixels along a side: what graphics cards take as a texture."""
MAX_PIXELS = 2**26
"""Pixels of one image (8192 x 8192); below the count at which Pillow suspects an attack."""
MAX_TOTAL_BYTES = 4 * 2**30
"""Decoded bytes of all images of a scene together."""
FREE_BYTES = 2**29
"""Decoded bytes of all images that a scene may have whatever the size of their files; see `MOST_RATIO`."""
MOST_RATIO = 256
"""Decoded bytes that each byte of an image file may bring beyond `FREE_BYTES`: photographs have 4 to 80, and a picture
of one colour, as PNG, has 1,000 to 30,000."""

_SMALLER = "make the image smaller"

_BLOCK = 1 << 18
"""Bytes of a file that Pillow takes at once: copied while no other thread runs Python, and so neither many nor few."""

_BAND = 1 << 17
"""Pixels that become an array at once. Decoding lets other threads run, this does not, and a renderer would wait."""


class ImageDecoder:
    """Decodes the images that a scene uses while the caller works on its geometry.

    The constructor reads headers and queues the work; `finish` waits. Pillow releases the interpreter lock
    while it inflates. Images of the file with equal bytes are one: `places` has, by number in the file, which of those
    that `finish` returns it is.
    """

    def __init__(
        self,
        document: Document,
        used: Sequence[int],
        progress: Callable[[], None] | None = None,
        later: Callable[[Refusal], SceneError] | None = None,
        ahead: int = 0,
    ) -> None:
        """`used` are image numbers of the file; `progress` is called from a thread after each image.

        With `later` nothing waits for pixels here: images are `EncodedImage`, and `later` makes the
        error that a refused image raises.
        The first of them, up to `ahead` bytes of pixels, are begun all the same.
        """
        self._later, self._encoded = later, list[Image]()
        self._copies: list[Future[None]] = []
        self._pool = ThreadPoolExecutor(min(8, os.cpu_count() or 1), thread_name_prefix="decode-image")
        self._futures: list[Future[Image]] = []
        self.places: dict[int, int] = {}
        total = begun = paid = 0
        makers: list[_Maker] = []
        pictures = _Pictures()
        try:
            for index in used:
                place = f"images[{index}]"
                entry = document.items("images")[index]
                name = entry.get("name") or visible(PurePath(_file_name(entry.get("uri", ""))).stem)
                if entry.get("uri"):
                    data = document.read_uri(entry["uri"], f"{place}.uri")
                elif "bufferView" in entry:
                    data = document.buffer_view(entry["bufferView"])
                else:
                    refuse(place, "has neither uri nor bufferView")
                width, height = image_size(data, place)
                self.places[index], known = pictures.place_of(data)
                if known:
                    continue
                dtype = np.uint16 if is_deep_grey(data) else np.uint8
                total += width * height * 4 * np.dtype(dtype).itemsize
                paid += len(data)
                _bound_total(total, paid, place)
                if self._later is not None:
                    # By then the file may be shorter, and reading behind its end ends the process.
                    kept = np.empty_like(data)
                    self._copies.append(self._pool.submit(np.copyto, kept, data))
                    decode = partial(_decode, kept, (width, height), place)
                    makers.append(_Maker(partial(_decode_later, decode, self._later)))
                    self._encoded.append(EncodedImage(name, (width, height), dtype, makers[-1]))
                    if total <= ahead:
                        begun = len(makers)
                    continue
                decode = partial(_decode, data, (width, height), place)
                self._futures.append(self._pool.submit(_decoded, decode, name, progress))
            for maker, copied in zip(makers[:begun], self._copies, strict=False):
                maker.begin(self._pool, copied)
        except BaseException:
            self.close()
            raise

    def finish(self) -> list[Image]:
        """Return the images in the order asked for, each picture once.

        Raises:
            Refusal: one is damaged; the first of them is named.
        """
        for copied in self._copies:
            copied.result()
        return [*self._encoded, *(future.result() for future in self._futures)]

    def close(self) -> None:
        """Drop images that have not begun and wait for the rest; an access to pixels waits for its image alone."""
        self._pool.shutdown(wait=self._later is None, cancel_futures=True)


class _Pictures:
    """Numbers pictures by the bytes of their files, equal ones alike. A file is hashed if another one is as long."""

    def __init__(self) -> None:
        self._count = 0
        self._alone: dict[
            int, tuple[Bytes, int] | None
        ] = {}  # by length; None where those of a length are hashed
        self._numbers: dict[bytes, int] = {}

    def place_of(self, data: Bytes) -> tuple[int, bool]:
        """Return the number of a picture, and whether one of equal bytes had it before."""
        number, length = self._count, len(data)
        if length not in self._alone:
            self._alone[length] = (data, number)
        else:
            alone = self._alone[length]
            if alone is not None:
                self._numbers[hashlib.sha256(alone[0].data).digest()] = alone[1]
                self._alone[length] = None
            number = self._numbers.setdefault(hashlib.sha256(data.data).digest(), number)
        known = number < self._count
        self._count += not known
        return number, known


def _bound_total(total: int, paid: int, place: str) -> None:
    """Refuse images of `total` decoded bytes in `paid` bytes of files where that is too many."""
    if total > MAX_TOTAL_BYTES:
        refuse(place, f"brings the images of the scene above {MAX_TOTAL_BYTES >> 30} GiB", _SMALLER)
    if total > FREE_BYTES + MOST_RATIO * paid:
        refuse(
            place,
            f"brings the images of the scene to {total >> 20} MiB, which {paid} bytes of files bring: at most "
            f"{FREE_BYTES >> 20} MiB and {MOST_RATIO} times their bytes are decoded",
            _SMALLER,
        )


class _Maker:
    """Decodes an image whenever it is called. The first call takes what was begun before, if it was."""

    def __init__(self, decode: Callable[[], Pixels]) -> None:
        self._decode = decode
        self._begun = deque[Future[Pixels]]()  # whose `pop` only one thread is given

    def begin(self, pool: ThreadPoolExecutor, copied: Future[None]) -> None:
        """Have it decoded by a thread of `pool`, when its bytes have been `copied`."""

        def decode() -> Pixels:
            copied.result()
            return self._decode()

        self._begun.append(pool.submit(decode))

    def __call__(self) -> Pixels:
        """Return the pixels, each time others. Raises what decoding raises."""
        try:
            begun = self._begun.pop()
        except IndexError:
            return self._decode()
        return self._decode() if begun.cancel() else begun.result()


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


class _File:
    """Bytes as a file that Pillow reads from. `io.BytesIO` would copy them first, while no other thread runs Python."""

    def __init__(self, data: Bytes) -> None:
        self._data, self._at = data.data, 0

    def read(self, count: int = -1) -> bytes:
        begin, self._at = self._at, len(self._data) if count < 0 else min(self._at + count, len(self._data))
        return bytes(self._data[begin : self._at])

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: len(self._data)}[whence]
        self._at = min(max(base + offset, 0), len(self._data))
        return self._at

    def tell(self) -> int:
        return self._at


def _joined(data: Bytes) -> Bytes:
    """Return a PNG with its compressed pixels in one chunk; anything else, and what is cut short, as it is.

    Most programs write chunks of 8 KiB. Pillow, which is Python between them, would take the interpreter lock for each:
    several threads that decode, and one that draws, then mostly wait for each other.
    """
    if not _is_png(data):
        return data
    places, at = list[tuple[int, int]](), 8
    while at + 12 <= len(data):
        head = data[at : at + 8].tobytes()
        end = at + 12 + int.from_bytes(head[:4], "big")
        if head[4:] == b"IDAT" and end <= len(data):
            places.append((at, end))
        elif places:
            break
        at = end
    if len(places) < 2 or at > len(data):
        return data
    first, last = places[0][0], places[-1][1]
    stream = [data[begin + 8 : end - 4] for begin, end in places]
    check = zlib.crc32(b"IDAT")
    for part in stream:
        check = zlib.crc32(part.data, check)
    length = sum(part.size for part in stream)
    around = [np.frombuffer(number.to_bytes(4, "big"), np.uint8) for number in (length, check)]
    kind = np.frombuffer(b"IDAT", np.uint8)
    return np.concatenate([data[:first], around[0], kind, *stream, around[1], data[last:]])


def _opened(data: Bytes) -> ImageFile:
    """Return what decodes a PNG or a JPEG. `Pillow.open` first imports what reads other formats, for 4 ms."""
    if _is_png(data):
        return PngImageFile(cast(IO[bytes], _File(_joined(data))))
    from PIL.JpegImagePlugin import JpegImageFile

    return JpegImageFile(cast(IO[bytes], _File(without_exif(data))))


def _is_png(data: Bytes) -> bool:
    return data[:8].tobytes() == b"\x89PNG\r\n\x1a\n"


def _decode(data: Bytes, size: tuple[int, int], place: str) -> Pixels:
    try:
        with _opened(data) as picture:
            picture.decodermaxblock = _BLOCK
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
    pixels = np.zeros((picture.height, picture.width, 4), np.uint8)
    if _decode_into(picture, pixels):
        return pixels
    rows = max(1, _BAND // picture.width)
    for top in range(0, picture.height, rows):
        band = picture.crop((0, top, picture.width, min(picture.height, top + rows)))
        pixels[top : top + rows] = np.asarray(band.convert("RGBA"))
    return pixels


def _decode_into(picture: Pillow.Image, pixels: np.ndarray) -> bool:
    """Decode a picture; return whether into `pixels`: not where it has other modes, a colour that stands for none.

    Pillow holds red, green and blue in four bytes, the last of them 255. Out of an image of its own they would be
    copied twice, while no other thread runs Python: a renderer that draws meanwhile would wait.
    """
    mode = {"RGB": "RGBX", "RGBA": "RGBA"}.get(picture.mode)
    held = None
    if mode is not None and isinstance(picture, ImageFile) and "transparency" not in picture.info:
        held = Pillow.frombuffer(mode, picture.size, pixels, "raw", mode, 0, 1).im
        picture.im = held
    picture.load()
    return (
        held is not None and picture.im is held
    )  # some versions decode into an image of their own all the same
