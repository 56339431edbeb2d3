"""Layers of transparent squares in float64: where they are at each pixel, sorted compositing, and weighted blending."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

U = 2.0**-24
"""The relative error of one rounding to single precision."""


class Layers:
    """The squares of a `panes` scene (tests/support/panes.py) as an orthographic view from +z sees them.

    `matrices` are (N, 4, 4); the picture of `size` shows y from -1 to 1. Arrays are (N, H, W). `moved` is how far, in
    pixels along each axis, the device may move the corners of a square before it fills it.
    """

    def __init__(
        self,
        matrices: np.ndarray,
        colors: np.ndarray,
        size: tuple[int, int],
        distance: float,
        moved: float = 0.0,
    ) -> None:
        width, height = size
        x = ((np.arange(width) + 0.5) / width * 2 - 1) * (width / height)
        y = 1 - (np.arange(height) + 0.5) / height * 2
        at = np.stack(np.meshgrid(x, y))
        self.colors, self.distance = np.asarray(colors, np.float64), distance
        local = np.linalg.inv(matrices[:, :2, :2])
        away = at[None] - matrices[:, :2, 3][:, :, None, None]
        inside = np.einsum("nij,njhw->nihw", local, away)
        self.z = matrices[:, 2, 3][:, None, None] + np.einsum("ni,nihw->nhw", matrices[:, 2, :2], inside)
        """Towards the camera."""
        shift = moved * 2 / height
        self.off = shift * np.abs(np.einsum("ni,nij->nj", matrices[:, 2, :2], local)).sum(axis=1)
        """(N) how far off `z` is where corners move: their way along each axis times the slope along it."""
        edge = 1 - np.abs(inside).max(axis=1)
        self.covered = edge > 0
        wide = 1e-3 + shift * np.abs(local).sum(axis=2).max(axis=1)
        self.near_edge = (np.abs(edge) < wide[:, None, None]).any(axis=0)
        """(H, W) whether a pixel's centre is so near to an edge that rounding decides."""
        order = np.argsort(np.where(self.covered, self.z, np.inf), axis=0, kind="stable")
        ordered = np.take_along_axis(np.where(self.covered, self.z, np.inf), order, axis=0)
        off = self.off[order]
        with np.errstate(invalid="ignore"):
            gaps = np.diff(ordered, axis=0)
        self.close = (gaps < 1e-5 + off[:-1] + off[1:]).any(axis=0)
        """(H, W) whether two layers are so near to each other that rounding decides which is the nearer one."""

    @property
    def count(self) -> np.ndarray:
        """(H, W) number of layers."""
        counted: np.ndarray = self.covered.sum(axis=0)
        return counted

    def sorted_over(self, behind: float, order: Sequence[int] | None = None) -> np.ndarray:
        """Return (H, W, 3): the layers over a grey, farthest first, or all in a given order of squares."""
        number, height, width = self.z.shape
        picture = np.full((height, width, 3), behind, np.float64)
        ranks = np.argsort(self.z, axis=0, kind="stable")
        for step in range(number):
            square = ranks[step] if order is None else np.full((height, width), order[step])
            covered = np.take_along_axis(self.covered, square[None], axis=0)[0]
            alpha = np.where(covered, self.colors[square, 3], 0.0)[..., None]
            picture = self.colors[square, :3] * alpha + picture * (1 - alpha)
        return picture

    def weighted(self, behind: float, length_scale: float) -> np.ndarray:
        """Return (H, W, 3): equations 6 and 9 of McGuire and Bavoil 2013, lengths relative to `length_scale` / 200."""
        alpha = np.where(self.covered, self.colors[:, 3, None, None], 0.0)
        ahead = np.maximum(self.distance - self.z, 0.0) * (200 / length_scale)
        weight = alpha * np.clip(0.03 / (1e-5 + (ahead / 200) ** 4), 1e-2, 3e3)
        sums = np.einsum("nhw,nc->hwc", alpha * weight, self.colors[:, :3])
        weights = (alpha * weight).sum(axis=0)[..., None]
        left = (1 - alpha).prod(axis=0)[..., None]
        mean = np.divide(sums, weights, out=np.zeros_like(sums), where=weights > 0)
        blended: np.ndarray = mean * (1 - left) + behind * left
        return blended
