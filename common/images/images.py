"""Pictures in files: PNG for what is shown, EXR and Radiance for what is measured.

Arrays are (H, W, C), row 0 on top. Integers are coded as the file has them; floats are linear. Every file is
written whole or not at all, and what is wrong with a path or a file is a UserError of one sentence.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image as PillowImage
from PIL.PngImagePlugin import PngInfo

from common import packages
from common.errors import UnsupportedError, UserError
from common.files.regular_files import read_regular
from common.images.exif import without_exif
from common.images.png16 import decode_png16, encode_png16, is_deep_color
from common.images.radiance import decode_radiance, encode_radiance, radiance_size
from common.names import visible
from common.paths import temporary_folder, write_problem, write_whole, written_file

Array = NDArray[Any]

WRITABLE = (".png", ".exr", ".hdr")
READABLE = (".png", ".jpg", ".jpeg", ".exr", ".hdr")
MAX_PIXELS = 1 << 28
_CHANNEL_NAMES = {1: "Y", 2: "XY", 3: "RGB", 4: "RGBA"}


def check_writable(path: Path, kinds: Sequence[str] = WRITABLE) -> None:
    """Raise UserError if no picture of these `kinds` can be written to `path`: to be called before the work."""
    if path.is_dir():
        raise UserError(f"{path} is a folder: name a file in it, such as {path / 'picture'}{kinds[0]}")
    if path.suffix.lower() not in kinds:
        raise UserError(f"{path} cannot be written as a picture: name {', '.join(kinds[:-1])} or {kinds[-1]}")
    target = written_file(path)
    if not target.parent.is_dir():
        raise UserError(f"there is no folder {target.parent} for {target.name}: create it first")
    problem = write_problem(path)
    if problem:
        raise UserError(f"{path} cannot be written: {problem}.")
    check_format(path.suffix)


def check_format(suffix: str) -> None:
    """Raise UserError if the package that writes pictures of a format is missing; `suffix` is as ".exr"."""
    if suffix.lower() == ".exr":
        _openexr()


def write_image(path: str | Path, image: Array) -> None:
    """Write a picture in the format of its suffix.

    .png takes uint8 or uint16 in 1 to 4 channels, .exr float16, float32 or uint32, .hdr floats in 3 channels.
    Raises UserError for a path that cannot be written, ValueError for an array that the format cannot hold.
    """
    path = Path(path)
    check_writable(path)
    image = image[..., None] if image.ndim == 2 else image
    if image.ndim != 3 or 0 in image.shape:
        raise ValueError(f"a picture has the shape (H, W, C), not {image.shape}")
    suffix = path.suffix.lower()
    data = {".png": encode_png, ".exr": _encode_exr_image, ".hdr": _encode_hdr}[suffix](image)
    _write(path, data)


def write_layers(
    path: str | Path, layers: Mapping[str, Array], notes: Mapping[str, str] | None = None
) -> None:
    """Write pictures of one size into one EXR: the layer "" is the picture, others become "name.R".

    `notes` become attributes of the header by their names.
    """
    path = Path(path)
    check_writable(path)
    if path.suffix.lower() != ".exr":
        raise UserError(f"{path} cannot hold layers: only .exr can")
    _write(path, _encode_exr(layers, notes))


def read_image(path: str | Path) -> Array:
    """Return a picture (H, W, C) as its file has it; raises UserError if it cannot be read."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise UserError(f"{path} is not of a kind that can be read: {', '.join(READABLE)}")
    if suffix == ".exr":
        layers = read_layers(path)
        if "" not in layers:
            raise UserError(f"{path} has no unnamed layer, only {visible(', '.join(layers))}")
        return layers[""]
    data = _read(path)
    try:
        if suffix == ".hdr":
            return decode_radiance(data)
        return decode_png16(data) if is_deep_color(data[:26]) else _decode_with_pillow(data)
    except (ValueError, OSError, SyntaxError, PillowImage.DecompressionBombError) as error:
        reason = (
            str(error)
            if isinstance(error, ValueError)
            else "it is broken or of another kind than its suffix says"
        )
        raise UserError(f"{path} cannot be read: {reason}") from None


def image_size(path: str | Path) -> tuple[int, int]:
    """Return (width, height) of a picture from its header, before memory for it is asked for. Raises UserError."""
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise UserError(f"{path} is not of a kind that can be read: {', '.join(READABLE)}")
    if suffix == ".exr":
        return _exr_size(path)
    data = _read(path, -1 if suffix != ".hdr" else 1 << 16)
    try:
        if suffix == ".hdr":
            return radiance_size(data)
        shown = without_exif(np.frombuffer(data, np.uint8)).data
        with PillowImage.open(io.BytesIO(shown), formats=("PNG", "JPEG")) as picture:
            return picture.size
    except ValueError as error:
        raise UserError(f"{path} cannot be read: {error}") from None
    except (OSError, SyntaxError, PillowImage.DecompressionBombError):
        raise UserError(
            f"{path} cannot be read: it is broken or of another kind than its suffix says"
        ) from None


def _exr_size(path: Path) -> tuple[int, int]:
    openexr = _openexr()
    _read(path, 4)  # for its errors
    try:
        window = openexr.File(str(path), header_only=True).header()["dataWindow"]
        width, height = (window[1].astype(np.int64) - window[0] + 1).tolist()
    except (RuntimeError, ValueError, KeyError):
        raise UserError(f"{path} cannot be read: it is broken or no EXR") from None
    return width, height


def read_layers(path: str | Path) -> dict[str, Array]:
    """Return all layers (H, W, C) of an EXR by name, "" for the channels without one. Raises UserError."""
    path = Path(path)
    openexr = _openexr()
    width, height = _exr_size(path)
    if width * height > MAX_PIXELS:
        raise UserError(f"{path} cannot be read: it claims {width} x {height} pixels")
    try:
        channels = {
            name: c.pixels for name, c in openexr.File(str(path), separate_channels=True).channels().items()
        }
    except (RuntimeError, ValueError, KeyError):
        raise UserError(f"{path} cannot be read: it is broken or no EXR") from None
    layers: dict[str, dict[str, Array]] = {}
    for name, pixels in channels.items():
        # A file that is cut off is reported on the console alone: its channels then have no pixels.
        if pixels is None or pixels.shape != (height, width):
            raise UserError(f"{path} cannot be read: it is cut off or has channels of different sizes")
        layer, _, channel = name.rpartition(".")
        layers.setdefault(layer, {})[channel] = pixels
    return {layer: np.stack(_in_order(parts), axis=-1) for layer, parts in layers.items()}


def _in_order(parts: dict[str, Array]) -> list[Array]:
    """Channels in the order of RGBA or XY, which files sort by letter."""
    return [parts[name] for name in sorted(parts, key=lambda name: ("RGBAXYZW".find(name[:1].upper()), name))]


def encode_png(image: Array, srgb: bool = False, notes: Mapping[str, str] | None = None) -> bytes:
    """Return (H, W, C) as a PNG; with `srgb` it says that its bytes are codes of sRGB, as programs mostly take them.

    `notes` are texts in a PNG of 8 bits, by their names.
    Raises ValueError for an array that a PNG cannot hold.
    """
    if image.dtype not in (np.uint8, np.uint16) or image.shape[2] > 4:
        raise ValueError(
            f"a PNG holds uint8 or uint16 in 1 to 4 channels, not {image.dtype} in {image.shape[2]}"
        )
    if image.dtype == np.uint16:
        return encode_png16(image)
    pillow = PillowImage.fromarray(np.ascontiguousarray(image[..., 0] if image.shape[2] == 1 else image))
    stream = io.BytesIO()
    told = PngInfo()
    if srgb:
        told.add(b"sRGB", b"\0")  # "perceptual", of which only profiles that convert take notice
    for name, text in (notes or {}).items():
        told.add_itxt(name, text)
    pillow.save(stream, "PNG", compress_level=6, pnginfo=told)
    return stream.getvalue()


def _decode_with_pillow(data: bytes) -> Array:
    shown = without_exif(np.frombuffer(data, np.uint8)).data
    with PillowImage.open(io.BytesIO(shown), formats=("PNG", "JPEG")) as picture:
        if picture.width * picture.height > MAX_PIXELS:
            raise ValueError(f"it claims {picture.width} x {picture.height} pixels")
        plain = picture.mode in ("L", "LA", "RGB", "RGBA", "I;16")
        palette = "RGBA" if "transparency" in picture.info else "RGB"
        pixels = np.asarray(picture if plain else picture.convert(palette))
    return pixels[..., None] if pixels.ndim == 2 else pixels


def _encode_hdr(image: Array) -> bytes:
    if not np.issubdtype(image.dtype, np.floating) or image.shape[2] != 3:
        raise ValueError(f"a Radiance file holds floats in 3 channels, not {image.dtype} in {image.shape[2]}")
    return encode_radiance(image)


def _encode_exr_image(image: Array) -> bytes:
    return _encode_exr({"": image})


def _encode_exr(layers: Mapping[str, Array], notes: Mapping[str, str] | None = None) -> bytes:
    openexr = _openexr()
    channels = {}
    for layer, image in layers.items():
        image = image[..., None] if image.ndim == 2 else image
        image = image.astype(np.float32) if image.dtype == np.float64 else image
        if (
            image.ndim != 3
            or image.shape[2] not in _CHANNEL_NAMES
            or image.dtype not in (np.float16, np.float32, np.uint32)
        ):
            raise ValueError(
                f"an EXR layer is (H, W, 1..4) of float16, float32 or uint32, not {image.shape} {image.dtype}"
            )
        for index, channel in enumerate(_CHANNEL_NAMES[image.shape[2]]):
            name = f"{layer}.{channel}" if layer else channel
            channels[name] = np.ascontiguousarray(image[..., index])  # the package ignores strides
    if len({pixels.shape for pixels in channels.values()}) != 1:
        raise ValueError("the layers of an EXR must have one size")
    header = {**(notes or {}), "compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    with temporary_folder() as folder:  # older versions of the package cannot write to memory
        path = folder / "image.exr"
        openexr.File(header, channels).write(str(path))
        return path.read_bytes()


def _openexr() -> ModuleType:
    try:
        return packages.load("OpenEXR")
    except ImportError as error:
        raise UnsupportedError(
            f"EXR needs the package OpenEXR, which {error}: run `pip install OpenEXR`, or write .png or .hdr"
        ) from None


def _write(path: Path, data: bytes) -> None:
    try:
        write_whole(path, data)
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}") from None


def _read(path: Path, count: int = -1) -> bytes:
    if path.is_dir():
        raise UserError(f"{path} is a folder, not a picture")
    try:
        return read_regular(path, count)
    except FileNotFoundError:
        raise UserError(f"there is no file {path}") from None
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}") from None
