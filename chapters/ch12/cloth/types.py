"""Types of the cloth simulation: cloths, colliders, forces, and the division of time into steps.

    Particles   points with mass at the vertices of a cloth; the vertices of a seam share one particle
    Springs     pairs of particles with a length at rest: along the threads, across the meshes, and over a fold
    Cloth       one piece of fabric, as it hangs at rest
    Cloths      all cloths of a scene in one set of arrays, so that one dispatch moves them all
    Collider    a body that no particle may enter
    Forces      gravity and wind
    Steps       steps, substeps and iterations of a method

Lengths are in metres, times in seconds, masses in kilograms. Positions are relative to the `anchor` of a cloth, along
the world's axes, so that 32 bits are precise enough anywhere in the world.
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
"""The deformation that a spring resists, by its number in `Cloth.kinds`."""


@dataclass(frozen=True)
class Cloth:
    """One piece of fabric.

    `positions` (P, 3) float64 are the particles at rest, relative to `anchor` (3,) float64 in the world. `masses` (P,)
    float64 are 0 for held particles. `springs` (S, 2) are pairs of particles, `kinds` (S,) the deformations that they
    resist, `rest` (S,) float64 their lengths at rest; `stiffness` (3,) are newtons a metre by kind. `triangles` (T, 3)
    are particles. `particle_of` (V,) is the particle of each vertex of the mesh, -1 for a vertex without a triangle.
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
    """Rate at which velocity decays, by second: v(t) = v(0) exp(-damping t)."""
    drag: float = 1.2
    """Drag coefficient of a triangle that faces the wind."""
    thickness: float = 0.005
    """Least distance of particles from colliders, in metres."""
    friction: float = 0.4
    name: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def held(self) -> NDArray[np.bool_]:
        """(P,) whether each particle is held: it moves with its node, whatever forces act on it."""
        return self.masses == 0.0


@dataclass(frozen=True)
class Collider:
    """A body that no particle may enter: a "sphere", the half space below a "plane", or a "box".

    `world_from_collider` is a (4, 4) matrix without shear. A sphere has its centre at the origin and `radius`. A plane
    is y = 0, and the side above it is free. A box reaches from -`half` to `half`.
    """

    shape: Literal["sphere", "plane", "box"]
    world_from_collider: Float64
    radius: float = 1.0
    half: tuple[float, float, float] = (0.5, 0.5, 0.5)
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Velocity of the centre, in metres a second; the matrix is the place at the end of the simulated steps."""
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Angular velocity about the centre, in radians a second, along an axis of the world."""


@dataclass(frozen=True)
class Forces:
    """The forces on all cloths: gravity in m/s^2, the wind's velocity in m/s, the air's density in kg/m^3."""

    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    air_density: float = 1.2


@dataclass(frozen=True)
class Steps:
    """The division of time: steps of `dt` seconds, each of `substeps` (of `h` = dt / substeps) with `iterations`.

    `method` "springs" integrates the forces of springs by symplectic "euler" or velocity "verlet". "xpbd" corrects the
    distances of particles (Macklin, Mueller, Chentanez 2016), `iterations` times a substep.

    The default is 16 substeps: they take twice the time of 8 and leave a third of the error (README.md, "Time and
    error").
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
    """Positions and velocities of all particles, (P, 3) each; the twin in numpy and the GPU both carry them forward."""

    positions: NDArray[np.floating]
    velocities: NDArray[np.floating]
    steps: int = 0
    """Steps simulated since the state at rest."""
    notes: list[str] = field(default_factory=list)
