"""Radiance pictures (.hdr): three mantissas with one shared exponent in four bytes a pixel, run-length coded.

The format is that of Ward, "Real Pixels" (Graphics Gems II, 1991), and of the file `rgbe.c` that followed it.
Pixels are decoded as mantissa * 2^(exponent - 136); a channel is exact to 2^-8 of the largest channel of its
pixel.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]

MAX_PIXELS = 1 << 28
MAX_EXPOSURE = 1e30
"""The largest product of a file's exposures, and the inverse of the smallest."""
_RESOLUTION = re.compile(rb"([+-])([XY]) +(\d{1,18}) +([+-])([XY]) +(\d{1,18})")


def decode_radiance(data: bytes) -> Float32:
    """Return the picture (H, W, 3) float32, linear, row 0 on top. Raises ValueError saying what is wrong.

    All three codings are read (flat, old runs, runs per component), all eight orientations, and EXPOSURE
    lines are divided out, as the format asks.
    """
    exposure, orientation, start = _header(data)
    (first_sign, first_axis, rows), (second_sign, _, columns) = orientation
    if rows == 0 or columns == 0 or rows * columns > MAX_PIXELS:
        raise ValueError(f"it claims {columns} x {rows} pixels")
    body = np.frombuffer(data, np.uint8, offset=start)
    coded_per_component = (
        8 <= columns < 32768 and len(body) >= 4 and body[0] == body[1] == 2 and body[2] < 128
    )
    pixels = (
        _decode_components(body, rows, columns)
        if coded_per_component
        else _decode_pixels(body, rows, columns)
    )
    image = rgbe_to_float(pixels)
    if exposure != 1.0:
        scaled = image / np.float64(exposure)  # the largest values may leave float32
        image = np.minimum(scaled, np.finfo(np.float32).max).astype(np.float32)
    # The first axis counts lines in the file: -Y means from the top down, +X from left to right.
    if first_axis == b"X":
        image = image.transpose(1, 0, 2)
        (first_sign, second_sign) = (second_sign, first_sign)
    vertical = slice(None) if first_sign == b"-" else slice(None, None, -1)
    horizontal = slice(None) if second_sign == b"+" else slice(None, None, -1)
    return np.ascontiguousarray(image[vertical, horizontal])


def radiance_size(data: bytes) -> tuple[int, int]:
    """Return (width, height) from the beginning of a file. Raises ValueError saying what is wrong with its header."""
    _, ((_, first_axis, lines), (_, _, within)), _ = _header(data)
    return (within, lines) if first_axis == b"Y" else (lines, within)


def _header(data: bytes) -> tuple[float, list[tuple[bytes, bytes, int]], int]:
    """Return the product of exposures, (sign, axis, count) of lines and within one, and the start of data."""
    if not data.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise ValueError("it does not begin with #?RADIANCE or #?RGBE")
    exposure, at = 1.0, 0
    while True:
        end = data.find(b"\n", at, at + 4096)
        if end < 0:
            raise ValueError("its header has no end")
        line, at = data[at:end].rstrip(b"\r"), end + 1
        if not line:
            break
        key, _, value = line.partition(b"=")
        if key.strip() == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise ValueError(f"its format {value.strip().decode(errors='replace')!r} is not 32-bit_rle_rgbe")
        if key.strip() == b"EXPOSURE":
            exposure *= _positive(value)
    end = data.find(b"\n", at, at + 4096)
    match = _RESOLUTION.fullmatch(data[at:end].rstrip(b"\r")) if end >= 0 else None
    if match is None or match[2] == match[5]:
        raise ValueError("its resolution line is not like '-Y 512 +X 1024'")
    axes = [(match[1], match[2], int(match[3])), (match[4], match[5], int(match[6]))]
    if not 1 / MAX_EXPOSURE <= exposure <= MAX_EXPOSURE:
        raise ValueError(
            f"its exposure of {exposure:g} is not between {1 / MAX_EXPOSURE:g} and {MAX_EXPOSURE:g}"
        )
    return exposure, axes, end + 1


def _positive(text: bytes) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < np.inf:
        raise ValueError(f"its exposure {text.strip().decode(errors='replace')!r} is not a positive number")
    return value


def _decode_components(body: Bytes, rows: int, columns: int) -> Bytes:
    """Decode lines whose four components are run-length coded one after the other.

    Only the chain of codes is walked in Python (each says where the next one is); the bytes are then gathered
    for the whole picture at once.
    """
    data = body.tobytes()
    marker = bytes((2, 2, columns >> 8, columns & 255))
    codes: list[int] = []  # where each code stands
    at = 0
    try:
        for row in range(rows):
            if data[at : at + 4] != marker:
                raise ValueError(f"line {row} does not begin as the run-length coding asks")
            at += 4
            for _ in range(4):
                filled = 0
                while filled < columns:
                    code = data[at]
                    codes.append(at)
                    if code > 128:
                        filled += code - 128
                        at += 2
                    elif code:
                        filled += code
                        at += code + 1
                    else:
                        raise ValueError(f"line {row} has a run of no bytes")
                if filled > columns:
                    raise ValueError(f"line {row} has a run beyond its end")
    except IndexError:
        raise ValueError(f"it ends in line {row} of {rows}") from None
    if at > len(data):
        raise ValueError(f"it ends in line {rows - 1} of {rows}")
    places = np.array(codes)
    values = body[places].astype(np.int64)
    is_run = values > 128
    counts = np.where(is_run, values - 128, values)
    ends = np.cumsum(counts)
    within = np.arange(ends[-1]) - np.repeat(ends - counts, counts)  # place of each byte in its run
    source = np.repeat(places + 1, counts) + np.where(np.repeat(is_run, counts), 0, within)
    return body[source].reshape(rows, 4, columns).transpose(0, 2, 1)


def _decode_pixels(body: Bytes, rows: int, columns: int) -> Bytes:
    """Decode flat pixels, among which (1, 1, 1, n) repeats the one before: digits, base 256, lowest first."""
    count = rows * columns
    pixels = body[: len(body) // 4 * 4].reshape(-1, 4)[:count]
    repeats = (pixels[:, :3] == 1).all(axis=1)
    if repeats.any():
        if repeats[0]:
            raise ValueError("it begins with a repeat of nothing")
        index = np.arange(len(pixels))
        last_pixel = np.maximum.accumulate(np.where(repeats, 0, index))
        digit = index - last_pixel - 1
        if digit[repeats].max() > 3:
            raise ValueError("it has a run of more than 2^32 pixels")
        times = np.where(repeats, pixels[:, 3].astype(np.int64) << (8 * np.maximum(digit, 0)), 1)
        total = np.cumsum(times)
        enough = (
            int(np.searchsorted(total, count)) + 1
        )  # a run may be longer than memory: cut it before it is made
        times = times[:enough]
        if total[-1] >= count:
            times[-1] -= total[enough - 1] - count
        pixels = np.repeat(pixels[last_pixel[:enough]], times, axis=0)
    if len(pixels) < count:
        raise ValueError(f"it ends in line {len(pixels) // columns} of {rows}")
    return pixels.reshape(rows, columns, 4)


def rgbe_to_float(pixels: ArrayLike) -> Float32:
    """Return (..., 3) float32 of (..., 4) bytes: mantissa * 2^(exponent - 136), and 0 for exponent 0."""
    pixels = np.asarray(pixels, np.uint8)
    exponent = pixels[..., 3:].astype(np.int32) - 136
    values = np.ldexp(pixels[..., :3].astype(np.float32), exponent)
    return np.where(pixels[..., 3:] == 0, np.float32(0), values)


def float_to_rgbe(image: ArrayLike) -> Bytes:
    """Return (..., 4) bytes of (..., 3) values, rounded to nearest: within 2^-8 of the largest channel.

    Negative values and NaN become 0; values beyond the format's range end at its largest, 255 * 2^119.
    """
    values = np.nan_to_num(np.asarray(image, np.float64), nan=0.0, posinf=np.inf, neginf=0.0)
    values = np.clip(values, 0.0, 255 * 2.0**119)
    largest = values.max(axis=-1)
    _, exponent = np.frexp(largest)
    exponent = exponent + (largest >= (255.5 / 256) * np.ldexp(1.0, exponent))  # rounding would carry to 256
    exponent = np.maximum(exponent, -127)
    mantissa = np.floor(np.ldexp(values, (8 - exponent)[..., None]) + 0.5)
    pixels = np.empty((*largest.shape, 4), np.uint8)
    pixels[..., :3] = np.minimum(mantissa, 255)
    pixels[..., 3] = np.where(mantissa.any(axis=-1), exponent + 128, 0)
    return pixels


def encode_radiance(image: ArrayLike) -> bytes:
    """Return a .hdr file of an image (H, W, 3), run-length coded where its width allows."""
    pixels = float_to_rgbe(image)
    rows, columns = pixels.shape[:2]
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (rows, columns)
    if not 8 <= columns < 32768:
        # Flat, with every pixel that looks like a repeat moved by one step of its exponent's scale.
        looks_like_repeat = (pixels[..., :3] == 1).all(axis=-1)
        pixels[looks_like_repeat, 0] = 2
        return header + pixels.tobytes()
    marker = bytes((2, 2, columns >> 8, columns & 255))
    parts = [header]
    for row in pixels:
        parts.append(marker)
        parts.extend(_encode_component(row[:, component]) for component in range(4))
    return b"".join(parts)


def _encode_component(values: Bytes) -> bytes:
    """Code one component of a line: runs of at least four equal bytes, the rest in pieces of at most 128."""
    edges = np.flatnonzero(np.diff(values)) + 1
    starts = np.concatenate([[0], edges])
    lengths = np.diff(np.concatenate([starts, [len(values)]]))
    data, out, at = values.tobytes(), bytearray(), 0

    def literal(end: int) -> None:
        nonlocal at
        while at < end:
            piece = data[at : min(at + 128, end)]
            out.append(len(piece))
            out.extend(piece)
            at += len(piece)

    for start, length in zip(starts[lengths >= 4].tolist(), lengths[lengths >= 4].tolist(), strict=True):
        literal(start)
        for piece in range(0, length, 127):
            out.extend((128 + min(127, length - piece), data[start]))
        at = start + length
    literal(len(data))
    return bytes(out)
