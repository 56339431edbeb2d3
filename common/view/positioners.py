"""What moves a camera: free flight, orbit, travel to a goal, or nothing.

Every motion is the exact solution of its equation over the time step, so that ten steps of 10 ms and one of
100 ms end in the same place. Explicit Euler steps, as in most textbooks, depend on the frame rate and diverge
in slow frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.transforms import (
    compose,
    matrix_from_quaternion,
    pose_looking_at,
    quaternion_from_axis_angle,
    quaternion_from_matrix,
    quaternion_multiply,
)
from common.view.inputs import Action, Inputs

Float64 = NDArray[np.float64]

WORLD_UP = (0.0, 1.0, 0.0)


@dataclass
class Fixed:
    """Stands where it was put."""

    world_from_view: Float64

    def update(self, dt: float, inputs: Inputs) -> None:
        """Do nothing."""


@dataclass
class FirstPerson:
    """Free flight: drag to look, W S A D 1 2 to move, shift to be ten times as fast, space to level.

    Keys accelerate up to `max_speed`; without keys the speed decays as exp(-t / damping). `unit` is the
    length of the scene that counts as one metre here, so that a thimble and a city are crossed in the same
    time.
    """

    position: Float64
    orientation: Float64  # unit quaternion xyzw, world from view
    unit: float = 1.0
    mouse_speed: float = 4.0  # radians for a drag across the window
    acceleration: float = 150.0  # units / s^2
    damping: float = 0.2  # s
    max_speed: float = 10.0  # units / s
    fast_factor: float = 10.0
    velocity: Float64 = field(default_factory=lambda: np.zeros(3))  # metres / s, in the world
    _mouse: tuple[float, float] | None = None
    _axes: tuple[Float64, Float64] | None = None  # an orientation and its matrix

    @classmethod
    def at(cls, world_from_view: ArrayLike, unit: float = 1.0) -> FirstPerson:
        """Start from a pose."""
        pose = np.asarray(world_from_view, np.float64)
        return cls(pose[:3, 3].copy(), quaternion_from_matrix(pose), unit)

    @property
    def world_from_view(self) -> Float64:
        """The (4, 4) rigid pose now."""
        return compose(self.position, self.orientation, (1.0, 1.0, 1.0))

    def update(self, dt: float, inputs: Inputs) -> None:
        """Advance by `dt` seconds."""
        if inputs.dragging and self._mouse is not None and inputs.mouse != self._mouse:
            self._look(inputs.mouse[0] - self._mouse[0], inputs.mouse[1] - self._mouse[1])
        # Only a drag keeps the place: the first event after the button went down must not turn by the way
        # before it.
        self._mouse = inputs.mouse if inputs.dragging else None
        actions = inputs.actions
        if Action.RESET_UP in actions:
            self.set_up(WORLD_UP)
        factor = self.fast_factor if Action.FAST in actions else 1.0
        thrust = self._thrust(actions)
        if not thrust.any() and not self.velocity.any():
            return
        limit = self.max_speed * self.unit * factor
        accelerate = thrust * (self.acceleration * self.unit * factor)
        self.velocity, way = fly(self.velocity, accelerate, limit, self.damping, dt)
        self.position = self.position + way
        if not thrust.any() and _length(self.velocity) < 1e-3 * self.unit:
            self.position = self.position + self.velocity * self.damping  # the rest of the way, to infinity
            self.velocity = np.zeros(3)

    def set_up(self, up: ArrayLike) -> None:
        """Turn about the line of sight until `up` is up in the picture."""
        forward = -matrix_from_quaternion(self.orientation)[:, 2]
        self.orientation = quaternion_from_matrix(pose_looking_at(np.zeros(3), forward, up))

    def _look(self, dx: float, dy: float) -> None:
        """Turn by a drag: to the right for dx > 0, down for dy > 0, about the camera's own axes."""
        yaw, pitch = -self.mouse_speed * dx / 2, -self.mouse_speed * dy / 2
        sy, cy, sp, cp = math.sin(yaw), math.cos(yaw), math.sin(pitch), math.cos(pitch)
        turn = np.array([sp * cy, cp * sy, sp * sy, cp * cy])  # the product of pitch about x and yaw about y
        turned = quaternion_multiply(self.orientation, turn)
        self.orientation = turned / math.sqrt(turned @ turned)  # products drift off length 1

    def _thrust(self, actions: Action) -> Float64:
        """Return the sum of the axes (3,) that the keys ask for, in the world; opposite keys cancel."""
        local = _along_axes(actions)
        if not any(local):
            return np.zeros(3)
        if self._axes is None or self._axes[0] is not self.orientation:
            self._axes = (self.orientation, matrix_from_quaternion(self.orientation))
        return self._axes[1] @ local


@cache
def _along_axes(actions: Action) -> tuple[float, ...]:
    """Return (right, up, back) that keys ask for; there are 256 sets of keys, and asking a set costs microseconds."""
    axes = ((Action.RIGHT, Action.LEFT), (Action.UP, Action.DOWN), (Action.BACK, Action.FORWARD))
    return tuple(float(plus in actions) - float(minus in actions) for plus, minus in axes)


def _length(vector: Float64) -> float:
    return math.sqrt(vector @ vector)


def fly(
    velocity: Float64, accelerate: Float64, limit: float, damping: float, dt: float
) -> tuple[Float64, Float64]:
    """Return the velocity after `dt` and the way gone, both (3,), of a flight with limited speed.

    Without acceleration dv/dt = -v / damping. With it dv/dt = a until |v| reaches `limit`; then only the part
    of `a` across v remains, and v turns on its sphere towards `a`. With theta the angle between v and a,
    dtheta/dt = -(|a| / limit) sin theta, so tan(theta / 2) decays exponentially, and cos theta and sin theta
    have closed integrals: t + ln((1 + k'^2) / (1 + k^2)) / s and 2 (atan k - atan k') / s, where k =
    tan(theta / 2) before and k' after, s = |a| / limit.
    """
    speed = _length(velocity)
    if speed > limit:  # the key for more speed was let go
        velocity, speed = velocity * (limit / speed), limit
    strength = _length(accelerate)
    if strength == 0.0:
        decay = math.expm1(-dt / damping)
        return velocity * (1 + decay), velocity * (-decay * damping)
    direction = accelerate / strength
    along = float(velocity @ direction)
    free = (-along + math.sqrt(max(along * along + limit * limit - speed * speed, 0.0))) / strength
    if dt <= free:
        return velocity + accelerate * dt, velocity * dt + accelerate * (dt * dt / 2)
    way = velocity * free + accelerate * (free * free / 2)
    velocity = velocity + accelerate * free
    across = velocity - direction * float(velocity @ direction)
    size = _length(across)
    across = across / size if size > 0 else across
    rate, rest = strength / limit, dt - free
    k = math.tan(math.atan2(size, float(velocity @ direction)) / 2)
    later = k * math.exp(-rate * rest)
    forward = rest + math.log((1 + later * later) / (1 + k * k)) / rate
    sideways = 2 * (math.atan(k) - math.atan(later)) / rate
    cosine, sine = (1 - later * later) / (1 + later * later), 2 * later / (1 + later * later)
    return limit * (direction * cosine + across * sine), way + limit * (
        direction * forward + across * sideways
    )


@dataclass
class Orbit:
    """Circles a target: drag to turn, wheel or W and S to come nearer and to go away."""

    target: Float64
    distance: float
    yaw: float = 0.0  # radians about +y, 0 looks along -z
    pitch: float = 0.0  # radians, positive looks down from above
    mouse_speed: float = 4.0  # radians for a drag across the window
    zoom_rate: float = 1.0  # of the logarithm of the distance, per second of a held key
    max_pitch: float = math.radians(89.0)
    _mouse: tuple[float, float] | None = None

    @classmethod
    def at(cls, world_from_view: ArrayLike, distance: float) -> Orbit:
        """Start from a pose, around the point `distance` in front of it; roll is dropped."""
        pose = np.asarray(world_from_view, np.float64)
        backward = pose[:3, 2]
        pitch = math.asin(float(np.clip(backward[1], -1, 1)))
        # Straight up or down the line of sight has no yaw, but the picture's up still has one.
        level = backward if abs(backward[1]) < 0.9999 else -math.copysign(1, backward[1]) * pose[:3, 1]
        yaw = math.atan2(level[0], level[2])
        return cls(pose[:3, 3] - backward * distance, distance, yaw, pitch)

    @property
    def world_from_view(self) -> Float64:
        """The (4, 4) rigid pose now."""
        turn = quaternion_multiply(
            quaternion_from_axis_angle((0.0, 1.0, 0.0), self.yaw),
            quaternion_from_axis_angle((1.0, 0.0, 0.0), -self.pitch),
        )
        pose = compose(self.target, turn, (1.0, 1.0, 1.0))
        pose[:3, 3] += pose[:3, 2] * self.distance
        return pose

    def update(self, dt: float, inputs: Inputs) -> None:
        """Advance by `dt` seconds."""
        if inputs.dragging and self._mouse is not None:
            self.yaw -= self.mouse_speed * (inputs.mouse[0] - self._mouse[0])
            pitch = self.pitch + self.mouse_speed * (inputs.mouse[1] - self._mouse[1])
            self.pitch = min(max(pitch, -self.max_pitch), self.max_pitch)
        self._mouse = inputs.mouse if inputs.dragging else None
        actions = inputs.actions
        nearer = float(Action.FORWARD in actions) - float(Action.BACK in actions)
        steps = inputs.take_scroll()
        if nearer or steps:
            self.distance *= math.exp(-self.zoom_rate * nearer * dt - 0.1 * steps)


@dataclass
class MoveTo:
    """Travels to a pose set by program: the remaining way shrinks as exp(-rate t).

    Angles are (pitch, pan, roll) in degrees: the pose is translation, then pan about y, pitch about x, roll
    about z. They turn the shorter way round.
    """

    position: Float64
    angles_deg: Float64
    desired_position: Float64
    desired_angles_deg: Float64
    rate: float = 10.0  # 1 / s
    angular_rate: float = 5.0  # 1 / s

    @property
    def world_from_view(self) -> Float64:
        """The (4, 4) rigid pose now."""
        pitch, pan, roll = np.radians(self.angles_deg)
        turn = quaternion_from_axis_angle((0.0, 1.0, 0.0), pan)
        turn = quaternion_multiply(turn, quaternion_from_axis_angle((1.0, 0.0, 0.0), pitch))
        turn = quaternion_multiply(turn, quaternion_from_axis_angle((0.0, 0.0, 1.0), roll))
        return compose(self.position, turn, (1.0, 1.0, 1.0))

    def update(self, dt: float, inputs: Inputs) -> None:
        """Advance by `dt` seconds."""
        way = self.desired_position - self.position
        turn = (self.desired_angles_deg - self.angles_deg + 180.0) % 360.0 - 180.0
        self.position = self.position - math.expm1(-self.rate * dt) * way
        self.angles_deg = np.fmod(self.angles_deg - math.expm1(-self.angular_rate * dt) * turn, 360.0)
