"""The cloth simulation on the CPU: the operations of cloth/motion.glsl, one by one, in numpy.

In float64 it is the truth for the GPU; in float32 it shows that the rest of the difference is rounding. Sums run in the
shader's order: the k-th springs of all particles are added at once, then those after them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cloth.dispatches import collider_axes
from ..cloth.model import Floats, Incidence, Ints, model_of
from ..cloth.types import Cloth, Collider, Float64, Forces, State, Steps

TINY = 1e-30
"""Squares of lengths and areas below this have no direction."""


class Twin:
    """Moves one cloth by steps: `advance` changes `state`, whose arrays have the given dtype."""

    def __init__(
        self,
        cloth: Cloth,
        steps: Steps,
        forces: Forces | None = None,
        colliders: Sequence[Collider] = (),
        dtype: Any = np.float64,
    ) -> None:
        self.cloth, self.steps, self.dtype = cloth, steps, np.dtype(dtype).type
        self.model = model_of(cloth, dtype)
        forces = forces or Forces()
        self.gravity, self.wind = self._array(forces.gravity), self._array(forces.wind)
        self.air = self._number(forces.air_density * cloth.drag / 12)
        h = steps.h
        self.h, self.per_h, self.half = (self._number(x) for x in (h, 1.0 / h, h / 2))
        self.per_h_squared = self._number(1.0 / (h * h))
        self.decay, self.half_decay = (self._number(np.exp(-cloth.damping * w)) for w in (h, h / 2))
        self.free = self.model.inverse_masses > 0
        self._spring_slots = list(_slots(self.model.springs_of))
        self._triangle_slots = list(_slots(self.model.triangles_of))
        self.meet(colliders)
        self._left = self._number(0.0)
        self.state = State(self.model.positions.copy(), np.zeros_like(self.model.positions))

    def meet(self, colliders: Sequence[Collider]) -> None:
        """Set the colliders from now on, at their places at the end of the next `advance`."""
        self._colliders = []
        for collider in colliders:
            axes, size = map(self._array, collider_axes(collider))
            centre = self._array(collider.world_from_collider[:3, 3] - self.cloth.anchor)
            velocity, spin = self._array(collider.velocity), self._array(collider.spin)
            self._colliders.append(_Obstacle(collider.shape, axes, size, centre, velocity, spin))

    def _array(self, values: Any) -> Floats:
        return np.asarray(values, np.float64).astype(self.dtype)

    def _number(self, value: float) -> Any:
        return self.dtype(value)

    def begin(self, before: Float64 | None = None) -> None:
        """Start the cloth at rest again, moved by `before`, the motion of its node."""
        x = self._held(before, before, self._number(1.0), np.ones(len(self.free), bool))
        self.state = State(x, np.zeros_like(x))

    def advance(self, count: int = 1, before: Float64 | None = None, after: Float64 | None = None) -> State:
        """Simulate `count` steps while the node moves from `before` to `after`; return the new state."""
        substeps, seconds = self.steps.substeps, self._number(count * self.steps.dt)
        for done in range(1, count * substeps + 1):
            # As in the shader: a quotient of two floats, and exactly 1 at the end.
            part = self._number(done) / self._number(count * substeps)
            self._left = (self._number(1.0) - part) * seconds
            held = self._held(before, after, part, ~self.free)
            substep = (done - 1) % substeps
            (self._substep_xpbd if self.steps.method == "xpbd" else self._substep_springs)(held, substep)
        self.state.steps += count
        return self.state

    def _held(
        self, before: Float64 | None, after: Float64 | None, part: Any, which: NDArray[np.bool_]
    ) -> Floats:
        first = self._array(np.eye(4) if before is None else before)[:3]
        last = self._array(np.eye(4) if after is None else after)[:3]
        m = last if part == 1 else first + (last - first) * part
        rest = self.model.positions[which]
        place: Floats = m[:, 0] * rest[:, :1] + m[:, 1] * rest[:, 1:2] + m[:, 2] * rest[:, 2:] + m[:, 3]
        return place

    # -- springs ---------------------------------------------------------------------------------------------------

    def _substep_springs(self, held: Floats, substep: int) -> None:
        verlet = self.steps.integrator == "verlet"
        half_first = verlet and substep == 0
        self._kick(self.half if half_first else self.h, self.half_decay if half_first else self.decay)
        self._move(self.state.positions + self.h * self.state.velocities, held)
        if verlet and substep == self.steps.substeps - 1:
            self._kick(self.half, self.half_decay)
            here = self.state.positions
            # The last half kick looks half a substep ahead, and so do the colliders.
            self._left = self._left - self.half
            self._keep(here + self.half * self.state.velocities, self.half)
            self.state.positions = here

    def _kick(self, w: Any, decay: Any) -> None:
        free, model = self.free, self.model
        force = np.zeros_like(self.state.positions)
        x = self.state.positions
        pulls = _pulls(x, model.springs, model.rest, model.rest_squared, model.stiffness)
        for particles, springs in self._spring_slots:
            first = model.springs[springs, 0] == particles
            force[particles] += np.where(first[:, None], pulls[springs], -pulls[springs])
        v = self.state.velocities + w * (force * model.inverse_masses[:, None] + self.gravity)
        v = v + self._air_drag(w)
        self.state.velocities = np.where(free[:, None], v * decay, self.state.velocities)

    def _air_drag(self, w: Any) -> Floats:
        x, v, model = self.state.positions, self.state.velocities, self.model
        change = np.zeros_like(v)
        if self.air == 0:
            return change
        a, b, c = model.triangles.T
        normal = _cross(x[b] - x[a], x[c] - x[a])
        squared = _dot(normal, normal)
        fit = (squared > TINY) & (model.third_masses > 0)
        unity = self._number(1.0)
        twice_area = np.sqrt(np.where(fit, squared, unity))
        n = normal / twice_area[:, None]
        third = np.where(fit, model.third_masses, unity)
        against = (v[a] + v[b] + v[c]) * self._number(1.0 / 3.0) + w * self.gravity - self.wind
        u = _dot(against, n)
        slowed = self.air * twice_area / third * np.abs(u) * w
        fraction = slowed / (unity + slowed)
        for particles, triangles in self._triangle_slots:
            share = third[triangles] * model.inverse_masses[particles]
            lost = (u[triangles] * fraction[triangles] * share)[:, None] * n[triangles]
            change[particles] -= np.where(fit[triangles, None], lost, self._number(0.0))
        return change

    # -- XPBD ------------------------------------------------------------------------------------------------------

    def _substep_xpbd(self, held: Floats, _: int) -> None:
        model, x, v = self.model, self.state.positions, self.state.velocities
        p = x + self.h * (v + self.h * self.gravity + self._air_drag(self.h))
        p[~self.free] = held
        multipliers = np.zeros(len(model.springs), self.dtype)
        for _iteration in range(self.steps.iterations):
            for color in range(model.colors):
                self._constrain(
                    p, multipliers, slice(model.color_starts[color], model.color_starts[color + 1])
                )
        self.state.velocities = (p - x) * self.per_h
        self._keep(p)
        self.state.velocities[self.free] *= self.decay

    def _constrain(self, p: Floats, multipliers: Floats, own: slice) -> None:
        model = self.model
        a, b = model.springs[own].T
        wa, wb = model.inverse_masses[a], model.inverse_masses[b]
        apart = p[b] - p[a]
        squared = _dot(apart, apart)
        fit = squared > TINY
        distance = np.sqrt(np.where(fit, squared, self._number(1.0)))
        longer = (squared - model.rest_squared[own]) / (distance + model.rest[own])
        alpha = self.per_h_squared / model.stiffness[own]
        change = (-longer - alpha * multipliers[own]) / (wa + wb + alpha)
        n = apart / distance[:, None]
        p[a] = np.where(fit[:, None], p[a] - (wa * change)[:, None] * n, p[a])
        p[b] = np.where(fit[:, None], p[b] + (wb * change)[:, None] * n, p[b])
        multipliers[own] += np.where(fit, change, self._number(0.0))

    # -- both ------------------------------------------------------------------------------------------------------

    def _move(self, to: Floats, held: Floats) -> None:
        to[~self.free] = held
        self.state.velocities[~self.free] = (held - self.state.positions[~self.free]) * self.per_h
        self._keep(to)

    def _keep(self, to: Floats, h: Any = None) -> None:
        """Move free particles in h seconds from their places to `to`, and out of colliders."""
        free = self.free
        p, v = to[free], self.state.velocities[free]
        origin = self.state.positions[free]
        for obstacle in self._colliders:
            self._keep_out(obstacle, self.h if h is None else h, origin, p, v)
        to[free] = p
        self.state.velocities[free] = v
        self.state.positions = to

    def _keep_out(self, obstacle: _Obstacle, h: Any, origin: Floats, p: Floats, v: Floats) -> None:
        friction = self._number(self.cloth.friction)
        zero, unity = self._number(0.0), self._number(1.0)
        moves = bool(obstacle.velocity.any() or obstacle.spin.any())
        axes, centre = obstacle.before(self._left) if moves else (obstacle.axes, obstacle.centre)
        away = p - centre
        q = np.stack([_dot(np.broadcast_to(axis, away.shape), away) for axis in axes], axis=1)
        below, outward = depth_below(obstacle.shape, q, obstacle.size)
        depth = below + self._number(self.cloth.thickness)
        hit = depth > 0
        depth, out = depth[hit], outward[hit]
        n = out[:, :1] * axes[0] + out[:, 1:2] * axes[1] + out[:, 2:] * axes[2]
        put = p[hit] + depth[:, None] * n
        moved = put - origin[hit]
        if moves:
            middle = away[hit] - self._number(0.5) * ((p[hit] - origin[hit]) - h * obstacle.velocity)
            moved = moved - h * (obstacle.velocity + _cross(obstacle.spin[None], middle))
            surface = obstacle.velocity + _cross(obstacle.spin[None], away[hit])
        slid = moved - _dot(moved, n)[:, None] * n
        path = np.sqrt(_dot(slid, slid))
        kept = friction * depth
        part = np.where(kept >= path, unity, kept / np.where(path > 0, path, unity))
        p[hit] = put - part[:, None] * slid
        against = v[hit] - surface if moves else v[hit]
        along = _dot(against, n)
        tangential = against - along[:, None] * n
        speed = np.sqrt(_dot(tangential, tangential))
        lost = friction * -along
        left = np.where(lost >= speed, zero, unity - lost / np.where(speed > 0, speed, unity))
        slower = tangential * left[:, None]
        v[hit] = np.where((along < 0)[:, None], slower + surface if moves else slower, v[hit])


@dataclass(frozen=True)
class _Obstacle:
    """A collider in the shader's form: its axes (3, 3), sizes (3,), centre, velocity and spin (3,)."""

    shape: str
    axes: Floats
    size: Floats
    centre: Floats
    velocity: Floats
    spin: Floats

    def before(self, left: Any) -> tuple[Floats, Floats]:
        """Return axes and centre `left` seconds before the end of the steps: see turned_back in cloth/contact.glsl."""
        once = _cross(self.spin[None], self.axes)
        twice = _cross(self.spin[None], once)
        half = left.dtype.type(0.5) * left
        return self.axes - left * (once - half * twice), self.centre - left * self.velocity


def depth_below(shape: str, q: Floats, size: Floats) -> tuple[Floats, Floats]:
    """Return (N,) the depths of points below a collider's surface (negative outside), and (N, 3) the ways out.

    `q` (N, 3) are in the collider's axes about its centre; `size` (3,) is the half of a box, or the radius.
    """
    up = np.broadcast_to(np.array([0, 1, 0], q.dtype), q.shape)
    if shape == "plane":
        return -q[:, 1], up
    if shape == "sphere":
        squared = _dot(q, q)
        away = np.sqrt(squared)
        some = (squared > TINY)[:, None]
        return size[0] - away, np.where(some, q / np.where(some, away[:, None], 1), up)
    over = np.abs(q) - size
    side = np.where(q < 0, -1, 1).astype(q.dtype)
    outside = np.maximum(over, 0)
    squared = _dot(outside, outside)
    beyond = squared > TINY
    away = np.sqrt(np.where(beyond, squared, 1)).astype(q.dtype)
    axis = np.argmax(over, axis=1)
    inward = np.where(np.arange(3) == axis[:, None], side, 0)
    least = np.take_along_axis(over, axis[:, None], axis=1)[:, 0]
    out = np.where(beyond[:, None], side * outside / away[:, None], inward)
    return np.where(beyond, -away, -least), out.astype(q.dtype)


def _slots(meets: Incidence) -> Iterator[tuple[Ints, Ints]]:
    """Yield, for k = 0, 1, ..., the particles with more than k entries, and the k-th entry of each."""
    counts = np.diff(meets.starts)
    for k in range(int(counts.max(initial=0))):
        particles = np.flatnonzero(counts > k)
        yield particles, meets.entries[meets.starts[particles] + k]


def _pulls(x: Floats, springs: Ints, rest: Floats, rest_squared: Floats, stiffness: Floats) -> Floats:
    """Return (S, 3) newtons on the first particle of each spring; the second one gets the opposite."""
    apart = x[springs[:, 1]] - x[springs[:, 0]]
    squared = _dot(apart, apart)
    fit = squared > TINY
    distance = np.sqrt(np.where(fit, squared, x.dtype.type(1)))
    longer = (squared - rest_squared) / (distance + rest)
    pull = np.where(fit, stiffness * longer / distance, x.dtype.type(0))
    forces: Floats = pull[:, None] * apart
    return forces


def _dot(a: Floats, b: Floats) -> Floats:
    sums: Floats = a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]
    return sums


def _cross(a: Floats, b: Floats) -> Floats:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
