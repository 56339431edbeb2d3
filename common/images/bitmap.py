"""A picture or a cube of pictures on the CPU: the twin of a texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.images.color import quantize

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Bitmap:
    """`texels` (H, W, C), or (6, H, W, C) for a cube, row 0 on top: uint8 that mean 0..1, or float32."""

    texels: NDArray[np.uint8] | NDArray[np.float32]

    def __post_init__(self) -> None:
        shape, kind = self.texels.shape, self.texels.dtype
        if kind not in (np.uint8, np.float32):
            raise ValueError(f"a bitmap holds uint8 or float32, not {kind}")
        if not (len(shape) == 3 or (len(shape) == 4 and shape[0] == 6)) or 0 in shape:
            raise ValueError(f"a bitmap has the shape (H, W, C) or (6, H, W, C), not {shape}")

    @property
    def is_cube(self) -> bool:
        """Whether there are six faces."""
        return self.texels.ndim == 4

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.texels.shape[-2], self.texels.shape[-3]

    def get(self, x: ArrayLike, y: ArrayLike, face: ArrayLike = 0) -> Float64:
        """Return the values (..., C) of texels, y down; raises IndexError outside the picture."""
        return self._values(self.texels[self._index(x, y, face)])

    def set(self, x: ArrayLike, y: ArrayLike, values: ArrayLike, face: ArrayLike = 0) -> None:
        """Set texels to `values` (..., C); bytes take the nearest of their 256 values."""
        stored = quantize(values) if self.texels.dtype == np.uint8 else np.asarray(values, np.float32)
        self.texels[self._index(x, y, face)] = stored

    def sample(self, u: ArrayLike, v: ArrayLike, face: ArrayLike = 0) -> Float64:
        """Return bilinear samples (..., C) at uv (...), exact at texel centres.

        u wraps around and v ends at the edges: the left edge of a panorama continues at its right one, its
        poles do not.
        """
        width, height = self.size
        x, y = np.asarray(u, np.float64) * width - 0.5, np.asarray(v, np.float64) * height - 0.5
        x0, y0 = np.floor(x), np.floor(y)
        s, t = (x - x0)[..., None], (y - y0)[..., None]
        left, right = x0.astype(np.int64) % width, (x0.astype(np.int64) + 1) % width
        top = np.clip(y0, 0, height - 1).astype(np.int64)
        bottom = np.clip(y0 + 1, 0, height - 1).astype(np.int64)
        upper = (1 - s) * self.get(left, top, face) + s * self.get(right, top, face)
        lower = (1 - s) * self.get(left, bottom, face) + s * self.get(right, bottom, face)
        return (1 - t) * upper + t * lower

    def _index(self, x: ArrayLike, y: ArrayLike, face: ArrayLike) -> tuple[NDArray[np.int64], ...]:
        width, height = self.size
        where = (np.asarray(face), np.asarray(y), np.asarray(x))
        limits = (6 if self.is_cube else 1, height, width)
        for index, limit in zip(where, limits, strict=True):
            if ((index < 0) | (index >= limit)).any():  # negative ones would count from the end
                raise IndexError(f"texel outside {limits[2]} x {limits[1]}, face of {limits[0]}")
        return where if self.is_cube else where[1:]

    def _values(self, stored: NDArray[np.uint8] | NDArray[np.float32]) -> Float64:
        scale = 255.0 if stored.dtype == np.uint8 else 1.0
        return stored.astype(np.float64) / scale
