"""What fog is held to: light that a medium scatters once to the eye, by quadrature in double precision for each pixel.

Of a lamp at distance h from a ray, whose nearest point is t0 along it, places are those of angles: t = t0 + h tan(a).
In them 1 / r^2 is constant (Kulla and Fajardo 2012), so light beside a lamp has no peak that nodes could miss. The
angles are cut into panels, at all steps of the medium, too. Whether light arrives is asked at the ends of panels, by
rays; where they differ, halving finds the edge of the shadow. The lit parts of panels get Gauss-Legendre nodes.

Places are relative to the origin of the scene. Extinction is per metre, light in nits, all of it without an exposure.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.scene import Medium, Scene
from common.view.camera import View

from ..scene.packing import LIGHT_KINDS
from ..shadows.faces import has_cube
from .ray_casting import FAR, Bool, Float64

Blocked = Callable[[Float64, Float64], Bool]
"""Whether something lies between two places (R, 3)."""

NODES, PANELS, HALVINGS = 4, 48, 8
"""Nodes in a panel, panels of a ray, and by how many halvings the edge of a shadow is found in a panel."""

LEAST = 1e-5
"""The part of a ray's light, if nothing had shadows, below which a light is left out."""

PAIRS = 4096
"""Pairs of a ray and a light that are computed at once."""


class Rays(NamedTuple):
    """Rays (R, 3) from the eye: origins, unit directions, and lengths (R,) in metres."""

    origins: Float64
    directions: Float64
    lengths: Float64

    def at(self, distances: Float64) -> Float64:
        """Return places (R, N, 3) at distances (R, N)."""
        return self.origins[:, None] + distances[..., None] * self.directions[:, None]


def eye_rays(scene: Scene, view: View, depth: Float64, pixels: NDArray[np.intp], far: float) -> Rays:
    """Return the rays of pixels, by number, up to the surfaces of a depth buffer (H, W), at most to the depth `far`."""
    height, width = depth.shape
    y, x = np.divmod(pixels, width)
    ndc = 2 * (np.stack([x, y], axis=1) + 0.5) / (width, height) - 1
    clip = np.concatenate([ndc, np.ones((len(ndc), 2))], axis=1)  # on the near plane
    seen = clip @ np.linalg.inv(view.clip_from_view(width / height)).T
    seen = seen[:, :3] / seen[:, 3:]
    stretch = np.linalg.norm(seen, axis=1) / -seen[:, 2]
    stored = depth.reshape(-1)[pixels]
    ahead = np.where(stored > 0.0, view.projection.near / np.where(stored > 0.0, stored, 1.0), np.inf)
    ways = seen @ view.world_from_view[:3, :3].T
    eye = np.broadcast_to(view.world_from_view[:3, 3] - scene.origin, ways.shape)
    unit = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return Rays(eye.copy(), unit, np.minimum(ahead, far) * stretch)


# --- the medium -------------------------------------------------------------------------------------------------------


class Air:
    """A medium in double precision. Noise is no part of it."""

    def __init__(self, scene: Scene, medium: Medium) -> None:
        self._medium = medium
        self._base = medium.height_base - float(scene.origin[1])
        self._boxes = [
            (np.array(box.center) - scene.origin, np.array(box.half_size), box) for box in medium.boxes
        ]
        self.reach = (scene.bounds[1] - scene.bounds[0]) / 2
        """Half the size of the scene: to a sun, the medium ends at this box."""

    def scattering(self, points: Float64) -> Float64:
        """Return (..., 3) the part of light that a metre scatters at points (..., 3)."""
        medium = self._medium
        above = np.maximum(points[..., 1] - self._base, 0.0)
        thin = np.asarray(np.exp(-medium.height_falloff * above), np.float64)
        total = (medium.extinction + medium.height_extinction * thin.reshape(*thin.shape, 1)) * medium.albedo
        for center, half, box in self._boxes:
            inside = (np.abs(points - center) <= half).all(axis=-1, keepdims=True)
            total = total + np.where(inside, box.extinction, 0.0) * box.albedo
        return np.asarray(total, np.float64)

    def depth(self, starts: Float64, ends: Float64) -> Float64:
        """Return (...) optical depths between places (..., 3)."""
        ways = ends - starts
        lengths = np.linalg.norm(ways, axis=-1)
        mean = self._medium.extinction + self._medium.height_extinction * self._height_mean(
            starts[..., 1] - self._base, ends[..., 1] - self._base
        )
        for center, half, box in self._boxes:
            first, last = _crossing(starts - center, ways, half)
            mean = mean + box.extinction * np.maximum(last - first, 0.0)
        return np.asarray(lengths * mean, np.float64)

    def _height_mean(self, first: Float64, last: Float64) -> Float64:
        """Return the mean of exp(-falloff max(y, 0)) from y = first to y = last, by the integral of it."""
        falloff = self._medium.height_falloff
        if falloff == 0.0:
            return np.ones_like(first)
        sums = [np.minimum(y, 0.0) - np.expm1(-falloff * np.maximum(y, 0.0)) / falloff for y in (first, last)]
        level = np.abs(last - first) < 1e-6
        middle = np.exp(-falloff * np.maximum((first + last) / 2, 0.0))
        return np.where(level, middle, (sums[1] - sums[0]) / np.where(level, 1.0, last - first))

    def steps(self, rays: Rays) -> Float64:
        """Return (R, S) distances along rays at which the medium has a step or a kink; 0 where there is none."""
        ways = rays.directions * rays.lengths[:, None]
        found = [
            part * rays.lengths
            for box in self._boxes
            for part in _crossing(rays.origins - box[0], ways, box[1])
        ]
        if self._medium.height_extinction:
            with np.errstate(divide="ignore", invalid="ignore"):
                found.append((self._base - rays.origins[:, 1]) / rays.directions[:, 1])
        if not found:
            return np.zeros((len(ways), 0))
        return np.nan_to_num(np.clip(np.stack(found, axis=1), 0.0, rays.lengths[:, None]))

    def way_out(self, points: Float64, way: Float64) -> Float64:
        """Return metres from points (..., 3) to the end of the medium along a direction."""
        size = np.maximum(np.abs(way), 1e-20)
        return np.maximum(((self.reach - points * np.sign(way)) / size).min(axis=-1), 0.0)


def _crossing(starts: Float64, ways: Float64, half: Float64) -> tuple[Float64, Float64]:
    """Return the parts of segments, 0 to 1, at which they enter and leave the box |p| <= half."""
    safe = np.where(np.abs(ways) < 1e-12, 1e-12, ways)
    one, other = (-half - starts) / safe, (half - starts) / safe
    first, last = np.minimum(one, other).max(axis=-1), np.maximum(one, other).min(axis=-1)
    return np.clip(first, 0.0, 1.0), np.clip(last, 0.0, 1.0)


def phase(turned: Float64, g: float) -> Float64:
    """Return Henyey and Greenstein's density per steradian; `turned` is 1 - cos of the change of direction."""
    return np.asarray((1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 2 * g * turned) ** 1.5), np.float64)


# --- light ------------------------------------------------------------------------------------------------------------


class _Angles(NamedTuple):
    """Pairs (P,) of a ray and a light: ray, foot and height of the light over it, and the range of angles.

    A light without a place has the height 0, and distances for angles.
    """

    rays: NDArray[np.intp]
    feet: Float64
    heights: Float64
    first: Float64
    last: Float64

    def some(self, which: slice | NDArray[np.intp]) -> _Angles:
        """Return some of the pairs."""
        return _Angles(
            self.rays[which], self.feet[which], self.heights[which], self.first[which], self.last[which]
        )

    def distances(self, at: Float64, pair: NDArray[np.intp]) -> Float64:
        """Return the distances along rays at angles (P, N) of some pairs."""
        foot, height = self.feet[pair][:, None], self.heights[pair][:, None]
        return np.where(height > 0.0, foot + height * np.tan(at), at)

    def of(self, distances: Float64) -> Float64:
        """Return the angles (P, N) of distances."""
        height = self.heights[:, None]
        angles = np.arctan((distances - self.feet[:, None]) / np.where(height > 0.0, height, 1.0))
        return np.where(height > 0.0, angles, distances)


class FogTruth:
    """Light along rays, of LIGHT records (clusters/lights.py). Without `blocked` nothing casts shadows.

    `near` is the distance in metres, along the axis of a map's face, within which a lamp's maps hold nothing.
    """

    def __init__(
        self,
        scene: Scene,
        medium: Medium,
        records: np.ndarray,
        g: float,
        ambient: float = 0.0,
        blocked: Blocked | None = None,
        near: float = 0.0,
    ) -> None:
        self._air, self._records, self._g = Air(scene, medium), records, g
        self._ambient, self._blocked, self._near = ambient, blocked, near
        self._far = FAR * scene.length_scale

    def transmittance(self, rays: Rays) -> Float64:
        """Return (R,) the part of light that is left at the eye."""
        return np.asarray(np.exp(-self._air.depth(rays.origins, rays.at(rays.lengths[:, None])[:, 0])))

    def light(self, rays: Rays) -> Float64:
        """Return (R, 3) light that reaches the eye along rays."""
        total = self._everywhere(rays)
        found = []
        for number in range(len(self._records)):
            angles = self._range(rays, number)
            for first in range(0, len(angles.rays), PAIRS):
                part = angles.some(np.s_[first : first + PAIRS])
                found.append((part, number, self._sum(rays, part, number, *self._whole(rays, part))))
        unhidden = total.copy()
        for part, _, light in found:
            unhidden[part.rays] += light
        for part, number, light in found:
            if self._blocked is not None:
                kept = np.flatnonzero((light > LEAST * unhidden[part.rays]).any(axis=1))
                if not len(kept):
                    continue
                part = part.some(kept)
                light = self._sum(rays, part, number, *self._lit(rays, part, number))
            total[part.rays] += light
        return total

    def _everywhere(self, rays: Rays) -> Float64:
        """Return light of all directions alike."""
        edges = _with_steps(np.zeros(len(rays.lengths)), rays.lengths, self._air.steps(rays))
        distances, weights = _nodes(edges[:, :-1], edges[:, 1:])
        points = rays.at(distances)
        seen = np.exp(-self._air.depth(rays.origins[:, None], points)) * weights
        return self._ambient * (self._air.scattering(points) * seen[..., None]).sum(axis=1)

    def _range(self, rays: Rays, number: int) -> _Angles:
        """Return the angles of one light on all rays that it reaches; of a sun they are distances."""
        record, count = self._records[number], len(rays.lengths)
        if record["kind"] == LIGHT_KINDS["directional"]:
            none = np.zeros(count)
            return _Angles(np.arange(count), none, none, none, rays.lengths)
        to_lamp = record["position"].astype(np.float64) - rays.origins
        foot = (to_lamp * rays.directions).sum(axis=1)
        height = np.linalg.norm(to_lamp - foot[:, None] * rays.directions, axis=1)
        height = np.maximum(height, 1e-9)
        within = _end2(record) - height**2
        chord = np.sqrt(np.maximum(within, 0.0))
        first, last = (np.clip(foot + side * chord, 0.0, rays.lengths) for side in (-1, 1))
        met = np.flatnonzero((within > 0.0) & (last > first))
        angles = (np.arctan((end - foot) / height)[met] for end in (first, last))
        return _Angles(met, foot[met], height[met], *angles)

    def _whole(self, rays: Rays, angles: _Angles) -> tuple[Float64, Float64]:
        """Return the panels (P, N) of angles."""
        steps = angles.of(self._air.steps(rays)[angles.rays])
        edges = _with_steps(angles.first, angles.last, steps)
        return edges[:, :-1], edges[:, 1:]

    def _lit(self, rays: Rays, angles: _Angles, number: int) -> tuple[Float64, Float64]:
        """Return the part of each panel to which the light gets; of a panel without light it is empty."""
        low, high = self._whole(rays, angles)
        edges = np.concatenate([low, high[:, -1:]], axis=1)
        pair = np.broadcast_to(np.arange(len(edges))[:, None], edges.shape)
        seen = self._sees(rays, angles, number, pair.ravel(), edges.ravel()).reshape(edges.shape)
        before, after = seen[:, :-1], seen[:, 1:]
        row, panel = np.nonzero(before != after)
        a, b = low[row, panel], high[row, panel]
        for _ in range(HALVINGS):
            middle = (a + b) / 2
            alike = self._sees(rays, angles, number, row, middle) == before[row, panel]
            a, b = np.where(alike, middle, a), np.where(alike, b, middle)
        edge = (a + b) / 2
        ends, begins = np.where(before | after, high, low), low.copy()
        ends[row, panel] = np.where(before[row, panel], edge, high[row, panel])
        begins[row, panel] = np.where(before[row, panel], low[row, panel], edge)
        return begins, ends

    def _sees(self, rays: Rays, angles: _Angles, number: int, pair: NDArray[np.intp], at: Float64) -> Bool:
        """Return whether a light reaches places of pairs of a ray and the light."""
        assert self._blocked is not None
        record, ray = self._records[number : number + 1], angles.rays[pair]
        distances = angles.distances(at[:, None], pair)[:, 0]
        points = rays.origins[ray] + distances[:, None] * rays.directions[ray]
        if record["kind"][0] == LIGHT_KINDS["directional"]:
            return ~self._blocked(points, points - self._far * record["direction"].astype(np.float64))
        ways = record["position"].astype(np.float64) - points
        cosines = (ways * -record["direction"]).sum(axis=1)
        along = np.abs(ways).max(axis=1) if has_cube(record)[0] else cosines
        short = np.maximum(1.0 - self._near / np.maximum(along, 1e-30), 0.0)
        return ~self._blocked(points, points + short[:, None] * ways)

    def _sum(self, rays: Rays, angles: _Angles, number: int, low: Float64, high: Float64) -> Float64:
        """Return (P, 3) light of one light from parts of panels (P, N)."""
        at, weights = _nodes(low, high)
        pair = np.arange(len(at))
        distances, ray = angles.distances(at, pair), angles.rays
        points = rays.origins[ray][:, None] + distances[..., None] * rays.directions[ray][:, None]
        record, air = self._records[number], self._air
        travels = record["direction"].astype(np.float64)
        if record["kind"] == LIGHT_KINDS["directional"]:
            ends = points - air.way_out(points, -travels)[..., None] * travels
            received, way = weights, np.broadcast_to(travels, points.shape)
        else:
            away = points - record["position"].astype(np.float64)
            distance2 = np.maximum((away * away).sum(axis=-1), 1e-18)
            way = away / np.sqrt(distance2)[..., None]
            window = np.clip(1 - (distance2 * float(record["inverse_range2"])) ** 2, 0.0, 1.0)
            if record["kind"] == LIGHT_KINDS["spot"]:
                scale, offset = record["cone"][:2].astype(np.float64)
                window = window * np.clip((way * travels).sum(axis=-1) * scale + offset, 0.0, 1.0) ** 2
            # A step of the angle is h / cos^2 metres, and h^2 / cos^2 is the squared distance.
            received = weights * window / angles.heights[:, None]
            ends = np.broadcast_to(record["position"].astype(np.float64), points.shape)
        turned = ((way + rays.directions[ray][:, None]) ** 2).sum(axis=-1) / 2
        passed = np.exp(-air.depth(rays.origins[ray][:, None], points) - air.depth(points, ends))
        strength = received * passed * phase(turned, self._g)
        light: Float64 = (air.scattering(points) * strength[..., None]).sum(axis=1)
        return light * record["color"].astype(np.float64)


def _end2(record: np.ndarray) -> float:
    """Return the square of the distance at which a lamp ends."""
    inverse = float(record["inverse_range2"])
    return min(float(record["end_distance2"]), 1.0 / inverse if inverse else np.inf)


def _with_steps(first: Float64, last: Float64, steps: Float64) -> Float64:
    """Return (P, N) the ends of panels between first and last, in order, with all steps between them."""
    even = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, PANELS + 1)
    return np.sort(np.concatenate([even, np.clip(steps, first[:, None], last[:, None])], axis=1), axis=1)


def _nodes(low: Float64, high: Float64) -> tuple[Float64, Float64]:
    """Return nodes and weights (P, N * NODES) of panels (P, N)."""
    place, weight = np.polynomial.legendre.leggauss(NODES)
    half = (high - low)[..., None] / 2
    nodes = low[..., None] + half * (place + 1)
    return nodes.reshape(len(low), -1), (half * weight).reshape(len(low), -1)
