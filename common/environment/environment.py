"""Environments: the light that arrives from far away, as a panorama in nits, read from a file and checked.

A panorama is twice as wide as high; its rows go from the zenith down, its middle is seen along -z (see
`common.environment.directions`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment.directions import panorama_solid_angles
from common.errors import UserError
from common.images import image_size, read_image
from common.images.color import LUMINANCE
from common.names import visible

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

READABLE = (".hdr", ".exr")
MAX_WIDTH = 8192
"""Pixels of the widest panorama that is read: 0.04 degrees each, 400 MB as floats."""

BRIGHTEST = 1e17
"""Nits of the brightest texel: the sun has 2e9; exposures, which end at EV100 60, fit no light beyond."""

Energy = Literal["gltf", "compensated", "conserving"]

ENERGIES: tuple[Energy, ...] = ("gltf", "compensated", "conserving")
"""How the parts of the BRDF share an environment's light; the position is the number that `shaders/ibl.glsl` uses."""


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from far away. `radiance` is (H, 2H, 3) float32 in nits, from 0 to `BRIGHTEST`, and never written."""

    name: str
    radiance: Float32
    warnings: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        pixels = self.radiance
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.float32:
            raise ValueError(f"a panorama is (H, 2H, 3) float32, not {pixels.shape} {pixels.dtype}")
        if pixels.shape[0] < 2 or pixels.shape[1] != 2 * pixels.shape[0]:
            raise ValueError(
                f"a panorama is twice as wide as high, not {pixels.shape[1]} x {pixels.shape[0]}"
            )
        if not (pixels.min() >= 0 and pixels.max() <= BRIGHTEST):
            raise ValueError(f"radiance is neither negative nor above {BRIGHTEST:g} nits")

    @cached_property
    def content(self) -> str:
        """A hash of the pixels and nothing else: equal pictures have equal light, whatever they are called."""
        pixels = np.ascontiguousarray(self.radiance)
        return hashlib.sha256(f"{pixels.shape}".encode() + pixels.tobytes()).hexdigest()

    @cached_property
    def mean(self) -> Float64:
        """The mean radiance over all directions (3,), in nits."""
        weight = panorama_solid_angles(len(self.radiance)) / (4 * np.pi)
        return np.asarray(np.einsum("hwc,hx->c", self.radiance, weight, dtype=np.float64))

    @property
    def mean_luminance(self) -> float:
        """The luminance of `mean`, in nits."""
        return float(self.mean @ LUMINANCE)


def constant(nits: float | Sequence[float] = 1.0, height: int = 2) -> Environment:
    """Return an environment that is the same in every direction."""
    pixels = np.broadcast_to(np.asarray(nits, np.float32), (height, 2 * height, 3))
    return Environment("constant", np.ascontiguousarray(pixels))


def read_environment(path: str | Path) -> Environment:
    """Return the environment in an .hdr or .exr file; what it counts as 1 is taken to be a nit.

    NaN and negative texels become black, infinite ones as bright as the brightest finite one, all at most `BRIGHTEST`:
    `warnings` says how many there were. Raises UserError, a sentence, for what is no picture, no panorama, too large,
    or has no light at all.
    """
    path = Path(path)
    if path.suffix.lower() not in READABLE:
        raise UserError(f"{path} is no environment: name a panorama in a file {' or '.join(READABLE)}")
    width, height = image_size(path)
    if width > MAX_WIDTH:
        raise UserError(
            f"{path} is {width} x {height} pixels, wider than the {MAX_WIDTH} of the largest environment: scale it down"
        )
    if width != 2 * height:
        raise UserError(
            f"{path} is {width} x {height} pixels, but a panorama of all directions is twice as wide as high: "
            "name another file"
        )
    if height < 2:
        raise UserError(
            f"{path} is {width} x {height} pixels, fewer than the 4 x 2 of the smallest panorama: name another file"
        )
    pixels = read_image(path)
    channels = pixels.shape[2]
    color = np.repeat(pixels[..., :1], 3, axis=2) if channels < 3 else pixels[..., :3]
    with np.errstate(over="ignore"):
        radiance, warnings = clean(color)
    if not radiance.any():
        why = "has no texel that is a positive number" if warnings else "sends no light, every texel is black"
        raise UserError(f"{path} {why}: name another file")
    return Environment(visible(path.stem), radiance, tuple(f"{path}: {warning}" for warning in warnings))


def clean(pixels: ArrayLike) -> tuple[Float32, list[str]]:
    """Return pixels as finite float32 that are not negative, and a sentence for each kind that had to be changed."""
    values = np.array(pixels, np.float32)
    warnings = []
    bad = np.isnan(values) | (values < 0)
    if bad.any():
        values[bad] = 0.0
        warnings.append(
            f"{int(bad.any(axis=-1).sum())} texels are negative or no numbers and were made black"
        )
    infinite = np.isinf(values)
    if infinite.any():
        values[infinite] = values[~infinite].max(initial=0.0)
        count = int(infinite.any(axis=-1).sum())
        warnings.append(f"{count} texels are infinite and were made as bright as the brightest other one")
    beyond = values > BRIGHTEST
    if beyond.any():
        values[beyond] = BRIGHTEST
        count = int(beyond.any(axis=-1).sum())
        warnings.append(f"{count} texels are brighter than {BRIGHTEST:g} nits and were made that bright")
    return values, warnings
