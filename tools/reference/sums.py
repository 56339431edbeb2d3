"""Sums of the light of paths: what a reference is the mean of, merged in order and kept in a file.

A block of paths is summed on the GPU in 32 bits, and blocks are added here in 64 bits, in the order of their paths.
Which paths form a block follows from the number before it and from the size of the picture alone. So the sums of a run
that was interrupted and went on are those of one that was not, bit for bit, on the same device and driver. They never
stop growing, as 32 bits would after 2^24 equal paths.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.files.regular_files import read_regular
from common.images.color import LUMINANCE
from common.paths import write_whole

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

LEAST_PATHS = 32
"""Paths of a pixel below which an estimated error says too little: how much paths differ is not known yet."""

DARK = 0.01
"""The part of white below which a pixel's error is relative to this instead of its light."""

MOST_OF_BLOCK = 1 << 22
"""Paths of all pixels in a block at most, as long as it has one path of each pixel."""

MOST_OF_PIXEL = 4096
"""Paths of a pixel in a block at most."""

HEADER_BYTES = 4096
"""More than the header of an array takes in a file."""

CHANNELS = {"light": 4, "squares": 2}


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums over the first `paths` paths of each pixel; they never change, each block gives new ones.

    `light` (H, W, 4) float64 are red, green and blue in nits, and the number of paths that have them; `squares`
    (H, W, 2) float64 are squared luminances, and the number of paths whose light was no number. `devices` are those
    that traced, by name.
    """

    light: Float64
    squares: Float64
    paths: int = 0
    devices: tuple[str, ...] = ()

    @classmethod
    def none_of(cls, size: tuple[int, int]) -> Sums:
        """Return the sums of no path, for a picture of (width, height) pixels."""
        width, height = size
        light, squares = (np.zeros((height, width, count)) for count in CHANNELS.values())
        return cls(light, squares)

    def plus(self, light: Float32, squares: Float32, count: int, *devices: str) -> Sums:
        """Return these sums and those of the next `count` paths, as the path tracer's images have them.

        `devices` are those that traced them.
        """
        return replace(
            self,
            light=self.light + light,
            squares=self.squares + squares[..., :2],
            paths=self.paths + count,
            devices=tuple(dict.fromkeys((*self.devices, *devices))),
        )

    @property
    def picture(self) -> Float32:
        """The mean light (H, W, 3) float32 in nits; black where no path counts."""
        return (self.light[..., :3] / np.maximum(self.light[..., 3:], 1.0)).astype(np.float32)

    @property
    def left_out(self) -> int:
        """The number of paths whose light was no number, or infinite."""
        return int(self.squares[..., 1].sum())

    def squared_errors(self, exposure: float) -> Float64:
        """Return (H, W) squared standard errors of the luminance, relative to it.

        1 where fewer than two paths count. As paths/error.glsl of the path tracer has it, in float64.
        """
        count = np.maximum(self.light[..., 3], 2.0)
        mean = self.light[..., :3] @ np.asarray(LUMINANCE) / count
        variance = np.maximum(self.squares[..., 0] / count - mean * mean, 0.0) / (count - 1.0)
        found: Float64 = variance / (mean * mean + (DARK / exposure) ** 2)
        return np.where(self.light[..., 3] < 2.0, 1.0, found)

    def error(self, exposure: float) -> float:
        """Return the mean of the squared errors of all pixels, under the root."""
        return math.sqrt(float(self.squared_errors(exposure).mean()))


def block_after(paths: int, pixels: int) -> int:
    """Return how many paths of each pixel the block has that begins after `paths` of them.

    A sixteenth of those before, as a power of two: the first picture is there soon, and the cost of a block is small.
    """
    most = min(max(MOST_OF_BLOCK // pixels, 1), MOST_OF_PIXEL)
    return 1 << (min(max(paths // 16, 1), most).bit_length() - 1)


def is_judged(paths: int) -> bool:
    """Whether the error is estimated after so many paths: sixteen times while their number doubles."""
    return paths >= LEAST_PATHS and paths % (1 << max(paths.bit_length() - 5, 0)) == 0


# --- files ---


def write_sums(path: Path, sums: Sums, facts: Mapping[str, str]) -> None:
    """Write sums whole or not at all, with the `facts` that say what they are of. Raises OSError."""
    told = json.dumps({"facts": dict(facts), "paths": sums.paths, "devices": sums.devices})
    stream = io.BytesIO()
    np.savez(stream, light=sums.light, squares=sums.squares, told=np.array(told))
    write_whole(path, stream.getvalue())


def read_sums(path: Path, facts: Mapping[str, str], size: tuple[int, int]) -> Sums:
    """Return the sums of a file. Raises UserError: it cannot be read, is damaged, or is of another picture."""
    try:
        data = read_regular(path)
    except OSError as error:
        raise UserError(f"{path} cannot be read: {error.strerror or error}.") from None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            told = _told(file)
            found = told["facts"]
            if found == dict(facts):
                return _checked(file, told, size)
    except (ValueError, KeyError, TypeError, EOFError, OSError, zipfile.BadZipFile, zlib.error):
        raise UserError(
            f"{path} holds no sums of paths: it is damaged, or of another kind; name another file, or delete it."
        ) from None
    other = [name for name in facts if found.get(name) != facts[name]] or ["kind"]
    raise UserError(
        f"{path} holds the sums of another picture (of another {' and another '.join(other)}): name another file, or "
        "delete it."
    )


def _told(file: Any) -> dict[str, Any]:
    if file.zip.getinfo("told.npy").file_size > 1 << 20:
        raise ValueError("longer than any that are written")
    told = json.loads(str(file["told"]))
    if not isinstance(told["facts"], dict):
        raise TypeError("no facts")
    return dict(told)


def _checked(file: Any, told: dict[str, Any], size: tuple[int, int]) -> Sums:
    """Return the sums after a check of sizes, before memory is asked for, and of numbers. Raises ValueError."""
    width, height = size
    arrays = {}
    for name, channels in CHANNELS.items():
        if file.zip.getinfo(f"{name}.npy").file_size > 8 * width * height * channels + HEADER_BYTES:
            raise ValueError("larger than the picture")
        arrays[name] = array = file[name]
        if array.shape != (height, width, channels) or array.dtype != np.float64:
            raise ValueError("of another shape")
        if not np.isfinite(array).all():
            raise ValueError("not finite")
    paths, devices = int(told["paths"]), tuple(map(str, told["devices"]))
    counted = arrays["light"][..., 3] + arrays["squares"][..., 1]
    if paths < 1 or (counted != paths).any():
        raise ValueError("the pixels have other numbers of paths")
    return Sums(arrays["light"], arrays["squares"], paths, devices)
