"""What shadow maps are held to: the part of the light that reaches each pixel, by rays, and errors against it.

The *factor* of a pixel is the light that arrives at its surface over that which would arrive without casters, as the
view `shadow-factor` shows it: 0 to 1. Of several lights, the stronger one counts more.

    error      mean of |factor - truth| over all compared pixels
    wrong      share of pixels whose factor is off by more than WRONG
    off edges  the same of pixels around which the truth is constant: what is wrong there is no matter of resolution

Compared are opaque surfaces seen from their front that any light would reach, unless only a surface with holes is in
its way: rays do not know where the holes are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View

from ..clusters.lights import LightRecords
from ..scene.packing import LIGHT_KINDS
from ..shadows.faces import has_cube
from .ray_casting import FAR, Bool, Float64, RayCaster, Surfaces

WRONG = 0.25
"""By how much the factor of a wrong pixel is off."""

AROUND = 2
"""Pixels on each side within which the truth is constant off edges."""

EVEN = 0.02
"""The range of the truth that still counts as constant."""

LEAST = 1e-5
"""The part of the light of a pixel below which a light counts as unshadowed."""

LEAST_FACING = 0.01
"""The cosine between normal and light below which the slope grows no more (shadows/factor.glsl)."""

CHUNK = 16
"""Lights whose illuminance is computed at once."""

Intp = NDArray[np.intp]


class Lit(NamedTuple):
    """Pairs (N,) of a surface and a light that would reach it, with the part of the surface's light that it gives."""

    surfaces: Intp
    lights: Intp
    parts: Float64


class ShadowTruth:
    """The factors of one view of a scene by rays. `near` is the setting `shadow_near`."""

    def __init__(
        self, scene: Scene, view: View, size: tuple[int, int], caster: RayCaster, settings: Any
    ) -> None:
        self._caster, self._size = caster, size
        clusters = settings.clusters
        lights = LightRecords(scene, settings.scene.light_cutoff, clusters.most_lights)
        lights.follow()
        self.records = lights.at(evaluate_pose(scene, 0.0))
        self._near = settings.shadows.shadow_near * scene.length_scale
        self._far, self._smallest = FAR * scene.length_scale, 1e-6 * scene.length_scale
        self.surfaces = caster.surfaces(view, size)
        self.lit = self._lit(self.surfaces)

    def _lit(self, surfaces: Surfaces) -> Lit:
        """Return all pairs that matter."""
        rows: list[tuple[Intp, Intp, Float64]] = []
        total = np.zeros(len(surfaces.pixels))
        for first in range(0, len(self.records), CHUNK):
            light = illuminances(surfaces, self.records[first : first + CHUNK], self._smallest)
            total += light.sum(axis=1)
            surface, number = np.nonzero(light)
            rows.append((surface, number + first, light[surface, number]))
        surface, number, light = (np.concatenate(column) for column in zip(*rows, strict=True))
        parts = light / total[surface]
        kept = parts > LEAST
        return Lit(surface[kept], number[kept], parts[kept])

    def hard(self) -> Float64:
        """Return (H, W) factors of lights without an extent, NaN at pixels that are not compared."""
        ends = self._ends(self.lit)
        solid, perhaps = self._caster.blocked(self._begins(self.lit), ends)
        return self._picture(self.lit, solid.astype(np.float64), perhaps)

    def soft(self, radius: float, angle: float, rays: int) -> Float64:
        """Return (H, W) factors of lamps with a radius in metres, and of suns with half an angle in radians.

        A lamp is a disc that faces the surface. Places on it are those of a spiral, turned by lot at each pixel.
        """
        lit, rng = self.lit, np.random.default_rng(7)
        turn = rng.uniform(0, 2 * np.pi, len(lit.parts))
        begins, blocked = self._begins(lit), np.zeros(len(lit.parts))
        perhaps = np.zeros(len(lit.parts), bool)
        for number in range(rays):
            away, at = np.sqrt((number + 0.5) / rays), turn + number * np.pi * (3 - np.sqrt(5))
            solid, holes = self._caster.blocked(
                begins, self._ends(lit, away * np.cos(at), away * np.sin(at), radius, np.tan(angle))
            )
            blocked += solid / rays
            perhaps |= holes
        return self._picture(lit, blocked, perhaps)

    def exact(self, faces: np.ndarray, kernel: int, bias: tuple[float, float]) -> Float64:
        """Return (H, W) factors by maps without any error of depth, of FACE records `faces`, and a kernel.

        A tap asks whether the ray through the middle of its texel reaches the plane of the surface, or a place before
        it by a bias: texels, and those for each unit of slope. This is all that is left of the error of a map.
        """
        lit, reach = self.lit, kernel // 2
        blocked, perhaps = np.zeros(len(lit.parts)), np.zeros(len(lit.parts), bool)
        for light in np.unique(lit.lights).tolist():
            pairs = np.flatnonzero(lit.lights == light)
            own = faces[faces["light"] & 0x7FFFFFFF == light]
            own = own[own["size"] == own["size"].max(initial=0)]  # not the coarse ones
            surface = lit.surfaces[pairs]
            points = self.surfaces.points[surface]
            face, inside = face_of(own, points, reach + 1)
            chosen, pairs = own[face[inside]], pairs[inside]
            points, flat = points[inside], self.surfaces.flat[surface][inside]
            for y in range(-reach, reach + 1):
                for x in range(-reach, reach + 1):
                    places, ends, valid = self._through(chosen, points, flat, (x, y), bias)
                    solid, holes = self._caster.blocked(
                        (places + self._caster.lift * flat)[valid], ends[valid]
                    )
                    blocked[pairs[valid]] += solid / kernel**2
                    perhaps[pairs[valid]] |= holes
        return self._picture(lit, blocked, perhaps)

    def _through(
        self,
        faces: np.ndarray,
        points: Float64,
        flat: Float64,
        tap: tuple[int, int],
        bias: tuple[float, float],
    ) -> tuple[Float64, Float64, Bool]:
        """Return where the rays through the middles of texels meet planes through `points`, and where they come from.

        Places are nearer by the bias. The last of the three says which rays meet their plane from the front.
        """
        axes = _axes(faces)
        origin, scale = faces["origin"].astype(np.float64), _scale(faces)
        perspective = faces["perspective"] != 0.0
        p = np.einsum("nij,nj->ni", axes, points - origin)
        depth = np.where(perspective, p[:, 2], 1.0)[:, None]
        middle = 0.5 * faces["size"][:, None]
        texel = np.floor(p[:, :2] / depth * scale + middle) + 0.5 + tap
        xy = (texel - middle) / scale
        ahead = np.where(
            perspective[:, None], np.concatenate([xy, np.ones((len(xy), 1))], axis=1), (0.0, 0.0, 1.0)
        )
        begin = np.where(perspective[:, None], 0.0, np.concatenate([xy, np.zeros((len(xy), 1))], axis=1))
        way = np.einsum("nij,ni->nj", axes, ahead)
        begin = origin + np.einsum("nij,ni->nj", axes, begin)
        facing = (way * flat).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = ((points - begin) * flat).sum(axis=1) / facing
        ray = p / np.linalg.norm(p, axis=1)[:, None]
        ray = np.where(perspective, 1.0, 0.0)[:, None] * ray + np.where(perspective, 0.0, 1.0)[:, None] * (
            0,
            0,
            1,
        )
        cosine = np.clip(-(np.einsum("nij,nj->ni", axes, flat) * ray).sum(axis=1), LEAST_FACING, 1.0)
        slope = np.sqrt(1.0 - cosine**2) / cosine
        distance = distance - depth[:, 0] / scale.min(axis=1) * (bias[0] + bias[1] * slope)
        valid = (facing < 0.0) & np.isfinite(distance) & (~perspective | (distance > self._near))
        places = begin + np.where(valid, distance, 0.0)[:, None] * way
        ends = np.where(perspective[:, None], begin + self._near * way, places - self._far * way)
        return places, ends, valid

    def _begins(self, lit: Lit) -> Float64:
        return (self.surfaces.points + self._caster.lift * self.surfaces.flat)[lit.surfaces]

    def _ends(
        self, lit: Lit, x: Any = 0.0, y: Any = 0.0, radius: float = 0.0, tangent: float = 0.0
    ) -> Float64:
        """Return where rays to lights end, at places (x, y) of a unit disc that faces the surface."""
        chosen, points = self.records[lit.lights], self.surfaces.points[lit.surfaces]
        sun = (chosen["kind"] == LIGHT_KINDS["directional"])[:, None]
        ways = np.where(sun, -self._far * chosen["direction"], chosen["position"] - points)
        lengths = np.linalg.norm(ways, axis=1)[:, None]
        unit = ways / np.where(lengths > 0.0, lengths, 1.0)
        side = np.where(np.abs(unit[:, 1:2]) < 0.9, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
        right = np.cross(unit, side)
        right /= np.linalg.norm(right, axis=1)[:, None]
        offset = np.reshape(x, (-1, 1)) * right + np.reshape(y, (-1, 1)) * np.cross(unit, right)
        ways = ways + np.where(sun, lengths * tangent, radius) * offset
        # Maps hold nothing whose depth along the axis of its face is less than the near plane's.
        along = np.where(
            has_cube(chosen), np.abs(unit).max(axis=1), -(unit * chosen["direction"]).sum(axis=1)
        )
        depth = np.maximum(lengths * along[:, None], 1e-30)
        short = np.where(sun, 1.0, np.maximum(1.0 - self._near / depth, 0.0))
        return points + short * ways

    def _picture(self, lit: Lit, blocked: Float64, perhaps: Bool) -> Float64:
        count = len(self.surfaces.pixels)
        dark = np.bincount(lit.surfaces, lit.parts * blocked, count)
        unknown = np.bincount(lit.surfaces, perhaps & (blocked < 1.0), count) > 0
        reached = np.bincount(lit.surfaces, minlength=count) > 0
        factors = np.full(self._size[0] * self._size[1], np.nan)
        factors[self.surfaces.pixels] = np.where(reached & ~unknown, 1.0 - dark, np.nan)
        return factors.reshape(self._size[1], self._size[0])


def illuminances(surfaces: Surfaces, records: np.ndarray, smallest: float) -> Float64:
    """Return (S, L) how much light of each record would fall on surfaces: of the brightest channel, unexposed."""
    sun = records["kind"] == LIGHT_KINDS["directional"]
    offset = records["position"].astype(np.float64)[None] - surfaces.points[:, None]
    distance2 = np.maximum((offset * offset).sum(axis=2), smallest**2)
    to_light = offset / np.sqrt(distance2)[:, :, None]
    direction = records["direction"].astype(np.float64)
    to_light = np.where(sun[None, :, None], -direction[None], to_light)
    window = np.clip(1.0 - (distance2 * records["inverse_range2"].astype(np.float64)) ** 2, 0.0, 1.0)
    cone = -(to_light * direction).sum(axis=2) * records["cone"][:, 0] + records["cone"][:, 1]
    spot = np.where(records["kind"] == LIGHT_KINDS["spot"], np.clip(cone, 0.0, 1.0) ** 2, 1.0)
    reached = distance2 < records["end_distance2"]
    falloff = np.where(sun, 1.0, np.where(reached, window * spot / distance2, 0.0))
    facing = np.maximum((to_light * surfaces.normals[:, None]).sum(axis=2), 0.0)
    light: Float64 = falloff * facing * records["color"].max(axis=1, initial=0.0).astype(np.float64)
    return light


def face_of(faces: np.ndarray, points: Float64, margin: int) -> tuple[Intp, Bool]:
    """Return which of the FACE records of one light each point lies in, and whether it lies in any.

    Of cascades it is the first that holds the point with `margin` texels around it.
    """
    if not len(faces):
        return np.zeros(len(points), np.intp), np.zeros(len(points), bool)
    away = points[:, None] - faces["origin"].astype(np.float64)[None]
    p = np.einsum("fij,nfj->nfi", _axes(faces), away)
    if faces["perspective"][0] != 0.0:
        return p[..., 2].argmax(axis=1), np.ones(len(points), bool)
    held = (np.abs(p[..., :2] * _scale(faces)) <= 0.5 * faces["size"][:, None] - margin).all(axis=2)
    held &= p[..., 2] <= faces["far"]
    return held.argmax(axis=1), held.any(axis=1)


def _axes(faces: np.ndarray) -> Float64:
    return np.stack([faces["right"], faces["down"], faces["ahead"]], axis=1).astype(np.float64)


def _scale(faces: np.ndarray) -> Float64:
    return np.stack([faces["scale_x"], faces["scale_y"]], axis=1).astype(np.float64)


# --- errors -----------------------------------------------------------------------------------------------------------


def off_edges(truth: Float64) -> Bool:
    """Return (H, W) where the truth is known and constant within AROUND pixels."""
    padded = np.pad(truth, AROUND, constant_values=np.nan)
    windows = sliding_window_view(padded, (2 * AROUND + 1, 2 * AROUND + 1))
    constant: Bool = windows.max(axis=(2, 3)) - windows.min(axis=(2, 3)) <= EVEN  # NaN makes it false
    return constant


def errors_of(found: Float64, truth: Float64) -> dict[str, float]:
    """Return the errors of factors (H, W): all of them 0 to 1; `dark` and `bright` are shares of pixels off edges.

    `dark` are those that should be brighter, as with acne; `bright` those that should be darker, as where light leaks.
    """
    known = np.isfinite(truth) & np.isfinite(found)
    even = off_edges(np.where(known, truth, np.nan))
    difference = np.where(known, np.where(known, found, 0.0) - np.where(known, truth, 0.0), 0.0)
    compared, off = max(int(known.sum()), 1), max(int(even.sum()), 1)
    return {
        "error": float(np.abs(difference).sum() / compared),
        "wrong": float((np.abs(difference) > WRONG).sum() / compared),
        "off_edges": float(np.abs(difference[even]).sum() / off),
        "dark": float((difference[even] < -WRONG).sum() / off),
        "bright": float((difference[even] > WRONG).sum() / off),
    }
