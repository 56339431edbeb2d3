"""Fog in float64: phase function, media and their optical depth, integration along a ray, filters, single scattering.

Extinction is per metre, albedo and scattering have three channels, light is in candela. The sums over a grid of froxels
are in tests/twins/fog_grid.py.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float64 = NDArray[np.float64]

GREY = (0.5, 0.5, 0.5)


# --- phase ------------------------------------------------------------------------------------------------------------


def henyey_greenstein(one_minus_cosine: ArrayLike, g: ArrayLike) -> Float64:
    """Return the density per steradian (Henyey and Greenstein 1941), 1 + g^2 - 2 g cos written as a sum.

    The cosine is that between the light's way before and after: 1 is straight on, where g > 0 has its peak.
    """
    g = np.asarray(g, np.float64)
    turned = np.where(g < 0, 2.0 - np.asarray(one_minus_cosine, np.float64), one_minus_cosine)
    size = np.abs(g)
    return (1 - size) * (1 + size) / (4 * np.pi * ((1 - size) ** 2 + 2 * size * turned) ** 1.5)


# --- media ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Height:
    """Extinction per metre up to y = `base`; above it falls by exp(-falloff * (y - base))."""

    extinction: float
    falloff: float
    base: float = 0.0
    albedo: tuple[float, float, float] = GREY


@dataclass(frozen=True)
class Box:
    """Extinction per metre where |point - center| <= half in every axis."""

    center: tuple[float, float, float]
    half: tuple[float, float, float]
    extinction: float
    albedo: tuple[float, float, float] = GREY


@dataclass(frozen=True)
class Medium:
    """The sum of constant, height and box fog, times `noise` at the point if there is one."""

    extinction: float = 0.0
    albedo: tuple[float, float, float] = GREY
    height: Height | None = None
    boxes: tuple[Box, ...] = ()
    noise: Callable[[Float64], Float64] | None = field(default=None, compare=False)

    def parts(self, points: Float64) -> list[tuple[Float64, tuple[float, float, float]]]:
        """Return (extinction (...), albedo) of each part at points (..., 3), without noise."""
        found = [(np.full(points.shape[:-1], float(self.extinction)), self.albedo)]
        if self.height:
            above = np.maximum(points[..., 1] - self.height.base, 0.0)
            found.append((self.height.extinction * np.exp(-self.height.falloff * above), self.height.albedo))
        for box in self.boxes:
            inside = (np.abs(points - box.center) <= box.half).all(axis=-1)
            found.append((box.extinction * inside, box.albedo))
        return found

    def at(self, points: ArrayLike) -> Float64:
        """Return scattering in three channels and extinction (..., 4) per metre at points (..., 3)."""
        points = np.asarray(points, np.float64)
        total = np.zeros((*points.shape[:-1], 4))
        for extinction, albedo in self.parts(points):
            total += extinction[..., None] * (*albedo, 1.0)
        return total if self.noise is None else total * self.noise(points)[..., None]

    def optical_depth(self, start: ArrayLike, end: ArrayLike, steps: int = 64) -> Float64:
        """Return the integral of extinction along segments (..., 3): closed forms, midpoints in `steps` with noise."""
        start, end = np.broadcast_arrays(np.asarray(start, np.float64), np.asarray(end, np.float64))
        length = np.linalg.norm(end - start, axis=-1)
        if self.noise is not None:
            along = (np.arange(steps) + 0.5) / steps
            points = start[..., None, :] + along[:, None] * (end - start)[..., None, :]
            return self.at(points)[..., 3].mean(axis=-1) * length
        depth = self.extinction * length
        if self.height:
            depth = depth + self.height.extinction * length * mean_above(
                start[..., 1] - self.height.base, end[..., 1] - self.height.base, self.height.falloff
            )
        for box in self.boxes:
            first, last = crossing(start, end - start, box)
            depth = depth + box.extinction * length * np.maximum(last - first, 0.0)
        return depth

    def breaks(self, start: Float64, direction: Float64, length: Float64) -> Float64:
        """Return distances (R, B) at which the medium has a step or a kink along rays, from 0 to `length`, sorted."""
        found = [np.zeros_like(length), length]
        if self.height:
            with np.errstate(divide="ignore", invalid="ignore"):
                found.append((self.height.base - start[:, 1]) / direction[:, 1])
        for box in self.boxes:
            found.extend(crossing(start, direction * length[:, None], box) * length)
        at = np.stack(found, axis=1)
        return np.sort(np.clip(np.where(np.isfinite(at), at, 0.0), 0.0, length[:, None]), axis=1)


def mean_above(first: ArrayLike, last: ArrayLike, falloff: float) -> Float64:
    """Return the mean of exp(-falloff * max(y, 0)) along segments from y = first to y = last, by its antiderivative."""
    first, last = np.broadcast_arrays(np.asarray(first, np.float64), np.asarray(last, np.float64))

    def integral(y: Float64) -> Float64:
        return np.where(y < 0, y, -np.expm1(-falloff * np.maximum(y, 0.0)) / falloff)

    away = last - first
    level = np.abs(away) < 1e-6
    middle = np.exp(-falloff * np.maximum((first + last) / 2, 0.0))
    return np.where(level, middle, (integral(last) - integral(first)) / np.where(level, 1.0, away))


def crossing(start: Float64, way: Float64, box: Box) -> Float64:
    """Return (2, ...) the parts of segments start + t * way, t in 0..1, where they enter and leave a box.

    Entry is not before exit where a segment misses the box.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        near = (np.asarray(box.center) - np.copysign(box.half, way) - start) / way
        far = (np.asarray(box.center) + np.copysign(box.half, way) - start) / way
    beside = (way == 0) & (np.abs(start - box.center) > box.half)
    near = np.where(way == 0, np.where(beside, np.inf, -np.inf), near)
    far = np.where(way == 0, np.where(beside, -np.inf, np.inf), far)
    return np.stack([np.clip(near.max(axis=-1), 0, 1), np.clip(far.min(axis=-1), 0, 1)])


# --- along a ray ------------------------------------------------------------------------------------------------------


def phi(x: ArrayLike) -> Float64:
    """Return (1 - exp(-x)) / x, and 1 at 0: the mean of exp(-t) over t in 0..x."""
    x = np.asarray(x, np.float64)
    small = np.abs(x) < 1e-5
    return np.where(small, 1 - x / 2 + x * x / 6, -np.expm1(-x) / np.where(small, 1.0, x))


def integrate(scattered: ArrayLike, extinction: ArrayLike, lengths: ArrayLike) -> tuple[Float64, Float64]:
    """Return light (..., N, 3) and transmittance (..., N) from the eye to the end of each of N segments in order.

    `scattered` (..., N, 3) is light scattered to the eye per metre, constant in a segment as `extinction` (..., N) is.
    """
    scattered, extinction = np.asarray(scattered, np.float64), np.asarray(extinction, np.float64)
    depth = extinction * lengths
    after = np.exp(-np.cumsum(depth, axis=-1))
    before = np.concatenate([np.ones_like(after[..., :1]), after[..., :-1]], axis=-1)
    light = before * lengths * phi(depth)
    return np.cumsum(scattered * light[..., None], axis=-2), after


@dataclass(frozen=True)
class Light:
    """A point light in candela; it has glTF's window to zero at `reach` metres if that is finite."""

    position: tuple[float, float, float]
    candela: tuple[float, float, float] = (1.0, 1.0, 1.0)
    reach: float = np.inf

    def window(self, distance: Float64) -> Float64:
        """Return clamp(1 - (distance / reach)^4, 0, 1)."""
        return np.clip(1 - (distance / self.reach) ** 4, 0.0, 1.0)


def scattered_at(
    points: Float64, to_eye: Float64, medium: Medium, light: Light, g: float, attenuated: bool = True
) -> Float64:
    """Return light of one lamp (..., 3) that a metre of the medium at points (..., 3) scatters to the eye.

    `to_eye` (..., 3) are unit vectors. The medium attenuates on the way from the lamp unless `attenuated` is false.
    """
    away = points - light.position
    distance = np.linalg.norm(away, axis=-1)
    # Half the squared distance of two unit vectors is 1 - cos, without cancelling.
    apart = ((away / distance[..., None] - to_eye) ** 2).sum(axis=-1) / 2
    strength = henyey_greenstein(apart, g) * light.window(distance) / distance**2
    if attenuated:
        strength = strength * np.exp(-medium.optical_depth(light.position, points))
    return medium.at(points)[..., :3] * light.candela * strength[..., None]


def single_scattering(
    start: ArrayLike,
    direction: ArrayLike,
    length: ArrayLike,
    medium: Medium,
    light: Light,
    g: float,
    nodes: int = 16,
    panels: int = 8,
) -> tuple[Float64, Float64]:
    """Return light (R, 3) and transmittance (R,) of rays (R, 3) by Gauss-Legendre quadrature of single scattering.

    The distance along a ray is t0 + h tan(angle), with t0 at the foot of the perpendicular from the lamp and h its
    length: per angle the lamp's 1 / r^2 is the constant 1 / h (Kulla and Fajardo 2012). The angle is cut into panels
    between steps of the medium, so the integrand of a panel is smooth but for kinks of the way to the lamp.
    """
    start, direction = np.asarray(start, np.float64), np.asarray(direction, np.float64)
    length = np.asarray(length, np.float64)
    to_lamp = np.asarray(light.position) - start
    foot = (to_lamp * direction).sum(axis=1)
    height = np.linalg.norm(to_lamp - foot[:, None] * direction, axis=1)
    angles = np.arctan((medium.breaks(start, direction, length) - foot[:, None]) / height[:, None])
    parts = np.linspace(0, 1, panels + 1)
    low, high = angles[:, :-1, None], angles[:, 1:, None]
    edges = low + (high - low) * parts  # (R, intervals, panels + 1)
    place, weight = np.polynomial.legendre.leggauss(nodes)
    width = (edges[..., 1:] - edges[..., :-1])[..., None]
    angle = edges[..., :-1, None] + width * (place + 1) / 2
    rays = len(start)
    angle, weights = angle.reshape(rays, -1), (width * weight / 2).reshape(rays, -1)
    distance = foot[:, None] + height[:, None] * np.tan(angle)
    points = start[:, None] + distance[..., None] * direction[:, None]
    per_metre = scattered_at(points, -direction[:, None], medium, light, g)
    seen = np.exp(-medium.optical_depth(start[:, None], points))
    metres = height[:, None] / np.cos(angle) ** 2
    total = (per_metre * (seen * metres * weights)[..., None]).sum(axis=1)
    return total, np.exp(-medium.optical_depth(start, start + length[:, None] * direction))


# --- filters ----------------------------------------------------------------------------------------------------------


def gaussian_weights(radius: int = 2, sigma: float = 4.0) -> Float64:
    """Return (2 radius + 1, 2 radius + 1) weights exp(-(r / sigma)^2), not normalized."""
    squared = np.arange(-radius, radius + 1) ** 2
    return np.exp(-(squared[:, None] + squared) / sigma**2)


def spatially_filtered(volume: Float64, radius: int = 2, sigma: float = 4.0) -> Float64:
    """Return a volume (Z, Y, X, C) averaged within slices; texels outside have no weight."""
    rows, columns = volume.shape[1:3]
    weights = gaussian_weights(radius, sigma)
    total, weight = np.zeros_like(volume), np.zeros((rows, columns))
    for y, x in np.ndindex(weights.shape):
        down, right = y - radius, x - radius
        to = np.s_[max(0, -down) : rows - max(0, down), max(0, -right) : columns - max(0, right)]
        of = np.s_[max(0, down) : rows + min(0, down), max(0, right) : columns + min(0, right)]
        total[(slice(None), *to)] += weights[y, x] * volume[(slice(None), *of)]
        weight[to] += weights[y, x]
    return total / weight[..., None]


def blended(history: Float64, current: Float64, share: float) -> Float64:
    """Return the history with `share` of it replaced by the current value; a history that is not finite is dropped."""
    good = np.isfinite(history)
    return np.where(good, np.where(good, history, 0.0) * (1 - share) + current * share, current)
