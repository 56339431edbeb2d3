"""Textures of assets as small files that are all alike: PNG, RGBA of 8 bits, at most so many pixels on each side.

What is uniform needs no checks at run time. Each axis is bounded on its own: a picture of 1024 x 256 becomes 512 x 256,
since uv coordinates go from 0 to 1 whatever the number of texels is. Pictures are never made larger.

A map of opacity goes into the alpha of the albedo that it is for, so that a material needs one texture instead of two.
One albedo with two such maps becomes two files. The two may differ in size, as they often do, a mask being finer than
what it cuts or coarser: on each axis the larger number of texels is kept, and the other picture is interpolated. (The
3D Graphics Rendering Cookbook, chapter 7, has this converter with one map for an albedo, of the same size, and output
names in which "a/b" and "a__b" are one.)

Colours are averaged as light and not as sRGB codes, normals, roughness and opacity as they are. Alpha is averaged on
its own, and colours without regard to it, as mip levels are made here.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from warnings import catch_warnings, simplefilter

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from common.errors import UserError
from common.files.file_repair import Finder, as_typed, leads_out
from common.files.regular_files import read_regular
from common.images.color import encode_srgb, srgb8_table
from common.images.exif import without_exif
from common.names import stable_hash
from common.paths import write_whole

Bytes = NDArray[np.uint8]
Float32 = NDArray[np.float32]

MOST = 512
"""Texels of a side, unless asked otherwise."""
MAX_PIXELS = 1 << 26
"""Of a source: 8192 x 8192. Up to eight threads decode at once, and each needs about eight bytes a pixel."""
FORMATS = ("PNG", "JPEG", "TGA", "BMP", "TIFF", "WEBP", "DDS")
SUFFIXES = (".png", ".jpg", ".jpeg", ".tga", ".bmp", ".tif", ".tiff", ".webp", ".dds")

Kind = Literal["color", "data", "normal", "emissive"]
PLACEHOLDERS: dict[Kind, tuple[int, int, int, int]] = {
    "color": (255, 255, 255, 255),  # times a factor: as without a texture
    "data": (255, 255, 255, 255),
    "normal": (128, 128, 255, 255),  # straight up
    "emissive": (0, 0, 0, 255),  # white would make the whole surface a lamp
}
"""The one texel of the file that stands for an absent one, by what it is for."""

_KEY = "strata-source"
_VERSION = "1"
"""Of what is made from equal sources; another one makes everything anew."""
_BAND = 256
"""Rows that are filtered at once: what numpy needs beside the pictures stays small."""


@dataclass(frozen=True)
class TextureRequest:
    """A texture that is asked for: its file name, that of its map of opacity ("" for none), and what it is for.

    Without a `name` but with `opacity` it is white, and cut by that map.
    """

    name: str
    opacity: str = ""
    kind: Kind = "color"

    @property
    def output(self) -> str:
        """The name of the file that it becomes: what can be read of its own, and a hash by which no two are equal."""
        typed = as_typed(self.name or self.opacity)
        stem = "".join(c if c.isascii() and c.isalnum() else "_" for c in Path(typed).stem.lower())
        about = "\n".join((as_typed(self.name), as_typed(self.opacity), self.kind))
        hashed = stable_hash(about.encode("utf-8", "surrogatepass").hex())
        return f"{stem[:48]}-{hashed:016x}.png"


@dataclass(frozen=True)
class Converted:
    """What became of a request: the file in the output folder, its width and height, whether it was written now.

    `placeholder` says that the texture was absent; `note` is a sentence about what is absent or cannot be read, or "".
    """

    request: TextureRequest
    file: str
    size: tuple[int, int]
    written: bool
    placeholder: bool = False
    note: str = ""


@dataclass(frozen=True)
class _Made:
    data: bytes | None  # None: what is there is right already
    size: tuple[int, int]
    placeholder: bool
    note: str


def convert_textures(
    requests: Iterable[TextureRequest],
    folder: Path,
    out: Path,
    most: int = MOST,
    progress: Callable[[float, str], None] | None = None,
) -> dict[TextureRequest, Converted]:
    """Convert textures, whose names are relative to `folder`, into files in `out`; equal requests are one.

    A name in other letters than its file's is repaired. What is absent, outside the folder or damaged becomes a
    placeholder of one texel, so that each file that is referred to exists, and its note says so. A file whose
    sources and size are those of a run before is left as it is, untouched; a damaged one is made again. Each file is
    written whole or not at all. Two runs make the same bytes. `progress` is called with a part from 0 to 1.

    Raises:
        UserError: `most` is not positive, or `out` cannot be written.
    """
    if most < 1:
        raise UserError(f"{most} texels a side are none: ask for 1 or more.")
    wanted = list(dict.fromkeys(requests))
    finder = Finder(folder)
    converted: dict[TextureRequest, Converted] = {}
    try:
        out.mkdir(parents=True, exist_ok=True)
        with (
            catch_warnings(),
            ThreadPoolExecutor(min(8, os.cpu_count() or 1), thread_name_prefix="convert-texture") as pool,
        ):
            simplefilter("ignore", Pillow.DecompressionBombWarning)  # a note says it
            try:
                results = pool.map(lambda request: _made(request, finder, out / request.output, most), wanted)
                for number, (request, result) in enumerate(zip(wanted, results, strict=True), 1):
                    if result.data is not None:
                        # On this thread alone: a file gets its rights by way of the umask, which is the process's.
                        write_whole(out / request.output, result.data)
                    converted[request] = Converted(
                        request,
                        request.output,
                        result.size,
                        result.data is not None,
                        result.placeholder,
                        result.note,
                    )
                    if progress is not None:
                        progress(number / len(wanted), request.name)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    except OSError as error:
        raise UserError(f"{error.filename or out} cannot be written: {error.strerror or error}.") from None
    return converted


def _made(request: TextureRequest, finder: Finder, target: Path, most: int) -> _Made:
    notes: list[str] = []
    albedo = _read(request.name, finder, notes)
    mask = _read(request.opacity, finder, notes)
    digest = hashlib.blake2b(f"{_VERSION} {most} {request.kind}".encode(), digest_size=16)
    for data in (albedo, mask):
        digest.update(b"-" if data is None else hashlib.blake2b(data).digest())
    key = digest.hexdigest()
    if (kept := _kept(target, key)) is not None:
        return kept
    pixels = None if albedo is None else _decoded(albedo, request.name, notes)
    alpha = None if mask is None else _opacity(_decoded(mask, request.opacity, notes))
    placeholder = pixels is None and (bool(request.name) or alpha is None)
    if pixels is None:
        pixels = np.full((1, 1, 4), PLACEHOLDERS[request.kind], np.uint8)
    shapes = [pixels.shape[:2]] + ([] if alpha is None else [alpha.shape])
    height, width = (min(max(sides), most) for sides in zip(*shapes, strict=True))
    pixels = resized(pixels, (width, height), srgb=request.kind in ("color", "emissive"))
    if alpha is not None:
        pixels[..., 3] = resized(alpha[..., None], (width, height), srgb=False)[..., 0]
    note = " ".join(notes)
    told = PngInfo()
    told.add_text(_KEY, f"{key} {'placeholder' if placeholder else 'texture'}")
    told.add_itxt(f"{_KEY}-note", note.encode("utf-8", "replace").decode())
    stream = io.BytesIO()
    Pillow.fromarray(pixels).save(stream, "PNG", compress_level=6, pnginfo=told)
    return _Made(stream.getvalue(), (width, height), placeholder, note)


def _kept(target: Path, key: str) -> _Made | None:
    """Return what an earlier run wrote from the same sources, or None where it must be made again."""
    try:
        with Pillow.open(target, formats=("PNG",)) as picture:
            size, told = picture.size, picture.info.get(_KEY, "")
            note = picture.info.get(f"{_KEY}-note", "")
            picture.verify()  # its checksums
    except Exception:  # absent, cut short, no picture: Pillow's plugins let errors of many kinds out
        return None
    own_key, _, what = str(told).partition(" ")
    return _Made(None, size, what == "placeholder", str(note)) if own_key == key else None


# --- sources ---


def _read(name: str, finder: Finder, notes: list[str]) -> bytes | None:
    """Return the bytes of a file, or None with a note, without one where no file is named."""
    if not name:
        return None
    path = finder.find(name)
    if path is None:
        # The note is kept in a file, which does not say on whose machine.
        outside = leads_out(name)
        notes.append(f"{name} {'lies outside the folder of the sources' if outside else 'is not there'}.")
        return None
    try:
        return read_regular(path)
    except OSError as error:
        notes.append(f"{name} cannot be read: {error.strerror or error}.")
        return None


def _decoded(data: bytes, name: str, notes: list[str]) -> Bytes | None:
    """Return a picture as (H, W, 4) uint8, or None with a note."""
    try:
        shown = without_exif(np.frombuffer(data, np.uint8)).data
        with Pillow.open(io.BytesIO(shown), formats=FORMATS) as picture:
            width, height = picture.size
            if width * height > MAX_PIXELS:
                raise Pillow.DecompressionBombError
            if picture.mode.startswith("I"):  # 16 bits of grey, of which Pillow would keep the wrong ones
                grey = np.clip(np.asarray(picture).astype(np.float32), 0, 65535)
                return np.asarray(Pillow.fromarray(np.rint(grey / 257).astype(np.uint8)).convert("RGBA"))
            if picture.mode == "F":
                notes.append(f"{name} has numbers without bounds as its pixels, and 8 bits cannot hold them.")
                return None
            return np.array(picture.convert("RGBA"))
    except Pillow.DecompressionBombError:
        notes.append(f"{name} has more pixels than the {MAX_PIXELS} that are converted at most.")
    except MemoryError:  # says nothing about the file, and a placeholder would be kept by later runs
        raise
    except Exception as error:  # as above
        about = "of no kind that can be read" if isinstance(error, UnidentifiedImageError) else "damaged"
        notes.append(f"{name} is {about}.")
    return None


def _opacity(pixels: Bytes | None) -> Bytes | None:
    """Return the opacity (H, W) that a map means: its alpha where it has one that is not 255 throughout, else its grey.

    The first is for libraries that name the albedo itself as the map of its opacity.
    """
    if pixels is None:
        return None
    if (pixels[..., 3] != 255).any():
        return pixels[..., 3]
    return np.asarray(Pillow.fromarray(np.ascontiguousarray(pixels[..., :3])).convert("L"))


# --- sizes ---


def resized(pixels: Bytes, size: tuple[int, int], srgb: bool) -> Bytes:
    """Return (H, W, C) uint8 at another (width, height); of the same size, the same numbers in a new array.

    An axis that shrinks gets means over the area of each new texel, of parts of texels too; one that grows is
    interpolated between the middles of texels. With `srgb` the first three channels are codes of sRGB, which become
    light before.
    """
    width, height = size
    if pixels.shape[:2] == (height, width):
        return pixels.copy()
    light = (srgb8_table() if srgb else np.zeros(0)).astype(np.float32)
    result = np.empty((height, width, pixels.shape[2]), np.uint8)
    for channel in range(pixels.shape[2]):
        coded = srgb and channel < 3
        bands = []
        for top in range(0, len(pixels), _BAND):
            codes = pixels[top : top + _BAND, :, channel]
            scaled = light[codes] if coded else codes.astype(np.float32)
            bands.append(_along(scaled.T, width).T)
        values = _along(np.concatenate(bands), height)
        result[..., channel] = np.rint(encode_srgb(values) * 255 if coded else values)
    return result


def _along(values: Float32, count: int) -> Float32:
    """Return (N, M) values with `count` of them along the first axis."""
    source = len(values)
    if count == source:
        return values
    if count > source:
        place = np.clip((np.arange(count) + 0.5) * source / count - 0.5, 0, source - 1)
        below = place.astype(np.int64)
        above = np.minimum(below + 1, source - 1)
        part = (place - below)[:, None].astype(np.float32)
        return values[below] * (1 - part) + values[above] * part
    sums = np.zeros((source + 1, values.shape[1]))
    np.cumsum(values, axis=0, dtype=np.float64, out=sums[1:])
    edges = np.arange(count + 1) * source / count
    whole = np.minimum(edges.astype(np.int64), source - 1)
    at = sums[whole] + (edges - whole)[:, None] * (sums[whole + 1] - sums[whole])
    return (np.diff(at, axis=0) * (count / source)).astype(np.float32)


def pictures_in(folder: Path, leaving_out: Path | None = None) -> list[str]:
    """Return the names of all pictures in a folder and below it, relative to it and sorted, but for one folder's."""
    files_found = []
    for here, folders, files in os.walk(folder):
        base = Path(here)
        if leaving_out is not None:
            folders[:] = [name for name in folders if (base / name).resolve() != leaving_out.resolve()]
        files_found += [
            (base / name).relative_to(folder).as_posix() for name in files if name.lower().endswith(SUFFIXES)
        ]
    return sorted(files_found)
