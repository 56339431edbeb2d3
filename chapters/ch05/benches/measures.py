"""Measures of a simulated cloth: its energies, its stretch, and its depth inside of colliders.

Where cloth touches something, two simulations that differ in a bit soon diverge. These numbers stay close.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..cloth.dispatches import collider_axes
from ..cloth.types import Cloth, Collider, Float64, Forces, State
from .twin import depth_below


@dataclass(frozen=True)
class Energy:
    """Joules: of motion, in springs, and against gravity (0 at the anchor)."""

    kinetic: float
    elastic: float
    potential: float

    @property
    def total(self) -> float:
        """The sum, which only damping, drag, contact and moving pins change."""
        return self.kinetic + self.elastic + self.potential


def energy(cloth: Cloth, state: State, forces: Forces) -> Energy:
    """Return the energies of a state; held particles have none of motion and height."""
    x, v = state.positions.astype(np.float64), state.velocities.astype(np.float64)
    kinetic = 0.5 * float(cloth.masses @ (v * v).sum(axis=1))
    longer = _lengths(cloth, state) - cloth.rest
    elastic = 0.5 * float(cloth.stiffness[cloth.kinds] @ (longer * longer))
    return Energy(kinetic, elastic, -float(cloth.masses @ (x @ np.asarray(forces.gravity))))


def momentum(cloth: Cloth, state: State) -> Float64:
    """Return (3,) kilogram metres a second of all free particles."""
    momentum: Float64 = cloth.masses @ state.velocities.astype(np.float64)
    return momentum


@dataclass(frozen=True)
class Stretch:
    """Relative change of the length of springs along the threads: the greatest, and the root of the mean square."""

    greatest: float
    rms: float


def stretch(cloth: Cloth, state: State) -> Stretch:
    """Return the stretch of the threads, without springs of length 0."""
    own = (cloth.kinds == 0) & (cloth.rest > 0)
    part = _lengths(cloth, state)[own] / cloth.rest[own] - 1.0
    if not len(part):
        return Stretch(0.0, 0.0)
    return Stretch(float(np.abs(part).max()), float(np.sqrt((part * part).mean())))


def penetration(cloth: Cloth, state: State, colliders: Sequence[Collider]) -> float:
    """Return the depth of the deepest free particle below a collider's surface, in metres, at least 0."""
    deepest = 0.0
    places = state.positions[~cloth.held].astype(np.float64)
    for collider in colliders:
        axes, size = collider_axes(collider)
        q = (places + cloth.anchor - collider.world_from_collider[:3, 3]) @ axes.T
        deepest = max(deepest, float(depth_below(collider.shape, q, size)[0].max(initial=0.0)))
    return deepest


def _lengths(cloth: Cloth, state: State) -> Float64:
    x = state.positions.astype(np.float64)
    lengths: Float64 = np.linalg.norm(x[cloth.springs[:, 0]] - x[cloth.springs[:, 1]], axis=1)
    return lengths
