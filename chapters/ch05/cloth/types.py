"""The words of the cloth simulation: what a cloth is made of, what acts on it, and how time is cut into steps.

    Particles   points with mass, where the cloth's vertices are; a seam's vertices are one particle
    Springs     pairs of particles with a length at rest: along the threads, across the meshes, and over a fold
    Cloth       one piece of fabric, as it hangs at rest
    Cloths      all cloths of a scene in one set of arrays, so that one dispatch moves them all
    Collider    what no particle may be inside of
    Forces      gravity and wind
    Steps       how a stretch of time is simulated

Lengths are metres, times seconds, masses kilograms. Positions are relative to each cloth's `anchor`, with the world's
axes, so that 32 bits are enough anywhere in the world.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
UInt32 = NDArray[np.uint32]

KINDS = ("stretch", "shear", "bend")
"""What a spring resists, by its number in `Cloth.kinds`."""


@dataclass(frozen=True)
class Cloth:
    """One piece of fabric.

    `positions` (P, 3) float64 are those of the particles at rest, relative to `anchor` (3,) float64 in the world;
    `masses` (P,) float64 are 0 for a particle that is held. `springs` (S, 2) are pairs of particles, `kinds` (S,) what
    each resists, `stiffness` (3,) newtons a metre by kind; `rest` (S,) float64 their lengths. `triangles` (T, 3) are
    those of particles, `particle_of` (V,) the particle of each vertex of the mesh (-1: of no triangle).
    """

    mesh: int
    node: int
    anchor: Float64
    positions: Float64
    masses: Float64
    springs: NDArray[np.int32]
    kinds: NDArray[np.uint8]
    rest: Float64
    stiffness: Float64
    triangles: NDArray[np.int32]
    particle_of: NDArray[np.int32]
    kg_per_m2: float = 0.2
    damping: float = 1.5
    """Part of its velocity that a particle loses, by second: v(t) = v(0) exp(-damping t)."""
    drag: float = 1.2
    """Drag coefficient of a triangle that faces the wind."""
    thickness: float = 0.005
    """Metres that particles keep away from colliders."""
    friction: float = 0.4
    name: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def held(self) -> NDArray[np.bool_]:
        """(P,) whether each particle is held: it goes where its node goes, whatever pulls."""
        return self.masses == 0.0


@dataclass(frozen=True)
class Collider:
    """What no particle may be inside of: a "sphere", a half space under a "plane", or a "box".

    `world_from_collider` is a (4, 4) matrix without shear: a sphere has its centre at the origin and `radius`; a plane
    is y = 0, and free is what is above; a box reaches from -`half` to `half`.
    """

    shape: Literal["sphere", "plane", "box"]
    world_from_collider: Float64
    radius: float = 1.0
    half: tuple[float, float, float] = (0.5, 0.5, 0.5)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of its centre, in metres a second: it is where the matrix says when the steps that are simulated are over."""
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Radians a second by which it turns about its centre, around this axis of the world."""


@dataclass(frozen=True)
class Forces:
    """What acts on all cloths alike: gravity in m/s^2, the wind's velocity in m/s, the air's density in kg/m^3."""

    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    air_density: float = 1.2


@dataclass(frozen=True)
class Steps:
    """How time is cut: steps of `dt` seconds, each of `substeps` (of `h` = dt / substeps) with `iterations`.

    `method` "springs" pulls with forces, integrated by symplectic "euler" or velocity "verlet"; "xpbd" moves particles
    until their distances fit (Macklin, Mueller, Chentanez 2016), `iterations` times a substep.

    Why 16: they take twice the time of 8 and leave a third of the error (README.md, "Time and error").
    """

    dt: float = 1.0 / 60.0
    substeps: int = 16
    iterations: int = 1
    method: Literal["xpbd", "springs"] = "xpbd"
    integrator: Literal["verlet", "euler"] = "verlet"

    @property
    def h(self) -> float:
        """Seconds of a substep."""
        return self.dt / self.substeps


@dataclass
class State:
    """Where all particles are and how fast, (P, 3) each; what the twin in numpy and the GPU both carry forward."""

    positions: NDArray[np.floating]
    velocities: NDArray[np.floating]
    steps: int = 0
    """How many steps were simulated since the state at rest."""
    notes: list[str] = field(default_factory=list)
