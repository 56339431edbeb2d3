"""Steps of cloth: substeps that are short enough for its springs, and the steps that are due in a frame.

A mass on springs swings with omega^2 = sum(k) / m, and with twice that against a neighbour in the opposite phase.
Gershgorin's circles give the bound for any masses: omega^2 <= 2 sum(k) / m. Explicit integration grows without bound
where h omega > 2. So springs get as many substeps as their stiffest particle needs. Where that is more than allowed,
they are made softer, with a warning. XPBD is stable at any step.

In 32 bits XPBD also has a shortest step. It has no velocity of its own, only a difference: v = (x - x_before) / h. With
coordinates up to X a position is a multiple of u = 2^(floor(log2 X) - 23), so v is a multiple of u / h. This has two
effects.

    Small changes are lost.  A substep changes v by a h. A change of less than half a multiple, a h < u / (2 h), is
        rounded away in every substep. Below h = sqrt(u / (2 a)) even the weight of a cloth has no effect.
    Errors become energy.  A substep rounds the position of a particle with s springs s + 1 times, each time with a
        variance of u^2 / 12, and v takes over all of it by 1 / h. With three coordinates and 1 / h substeps a second,
        v^2 gains at least (s + 1) u^2 / (4 h^3) a second. The damping of XPBD grows with h. So gain and loss are equal
        at one h, and at half of it the gain is sixteen times the loss.

Both effects are small where weight moves a particle by several units in a substep, a h^2 >= UNITS u. With X from 1 to 2
m that is h >= 0.22 ms, and it grows with the root of X. Steps with shorter substeps get fewer of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from common.errors import SettingError

from .types import Cloth, Float64, Forces, Steps

MAX_SUBSTEPS = 64
MARGIN = 0.9
"""The substep that is used, as a part of the longest stable one."""

MOST_SECONDS = 0.25
"""Longest time that one frame simulates; a frame that took longer skips the rest."""


UNITS = 4
"""Units in the last place of a position by which weight moves a particle in a substep of XPBD, at least."""

_GRAVITY = math.hypot(*Forces().gravity)


def greatest_omega(cloth: Cloth) -> float:
    """Return the bound on the angular frequency of a cloth's swings, in radians a second."""
    stiffness = cloth.stiffness[cloth.kinds]
    sums = np.zeros(len(cloth.masses))
    for end in (0, 1):
        sums += np.bincount(cloth.springs[:, end], stiffness, len(sums))
    free = ~cloth.held
    return math.sqrt(2.0 * float((sums[free] / cloth.masses[free]).max(initial=0.0)))


def least_substep(cloth: Cloth) -> float:
    """Return the shortest substep of XPBD in seconds, as the head of this module derives it from 32 bits.

    Coordinates are those at rest: a cloth that falls far below its anchor would need longer substeps.
    """
    unit = float(np.spacing(np.float32(_reach(cloth))))
    return math.sqrt(UNITS * unit / _GRAVITY)


def _reach(cloth: Cloth) -> float:
    """Return the greatest absolute coordinate of a cloth at rest, in metres from its anchor."""
    return float(np.abs(cloth.positions).max(initial=0.0))


def fit_steps(
    cloths: Sequence[Cloth], steps: Steps, most: int = MAX_SUBSTEPS
) -> tuple[list[Cloth], Steps, list[str]]:
    """Return the cloths and steps to simulate for requested ones, and a sentence for each difference.

    Springs get more substeps where the stiffest cloth needs them, `most` at most. A cloth that needs even more is made
    softer, all its springs alike. XPBD gets fewer substeps where they would be too short for 32 bits. Raises
    SettingError for steps that are not positive.
    """
    if not (math.isfinite(steps.dt) and steps.dt > 0 and steps.substeps >= 1 and steps.iterations >= 1):
        raise SettingError(
            f"Steps of {steps.dt:g} s with {steps.substeps} substeps and {steps.iterations} iterations cannot be "
            "simulated: all three are above 0."
        )
    if steps.method != "springs":
        return list(cloths), *_long_enough(cloths, steps)
    most = max(most, steps.substeps)
    longest = 2.0 * MARGIN
    omegas = [greatest_omega(cloth) for cloth in cloths]
    needed = [math.ceil(steps.dt * omega / longest - 1e-9) for omega in omegas]
    substeps = min(max([steps.substeps, *needed]), most)
    notes = []
    if substeps > steps.substeps:
        notes.append(
            f"Springs of these cloths need {substeps} substeps of each {steps.dt * 1e3:.3g} ms, not {steps.substeps}."
        )
    fitted = []
    for cloth, omega, count in zip(cloths, omegas, needed, strict=True):
        if count > substeps:
            part = (longest * substeps / (steps.dt * omega)) ** 2
            cloth = replace(cloth, stiffness=cloth.stiffness * part)
            notes.append(
                f"The cloth {cloth.name} would need {count} substeps of each {steps.dt * 1e3:.3g} ms, and gets "
                f"{substeps}: its springs are {1 / part:.3g} times softer than asked for; take XPBD or shorter steps."
            )
        fitted.append(cloth)
    return fitted, replace(steps, substeps=substeps), notes


def _long_enough(cloths: Sequence[Cloth], steps: Steps) -> tuple[Steps, list[str]]:
    """Return steps of XPBD with substeps long enough for 32 bits, if fewer will do, and warnings."""
    farthest = max(cloths, key=_reach, default=None)
    if farthest is None or steps.h >= least_substep(farthest) * (1 - 1e-9):
        return steps, []
    least = least_substep(farthest)
    fewer = replace(steps, substeps=min(max(math.floor(steps.dt / least + 1e-9), 1), steps.substeps))
    why = (
        f"in less than {least * 1e3:.2g} ms a cloth that reaches {_reach(farthest):,.1f} m from its node moves by less "
        "than what a position of 32 bits can tell, and XPBD gains energy"
    )
    if fewer.substeps == steps.substeps:
        return steps, [f"Steps of {steps.dt * 1e3:.3g} ms are too short, as {why}: take longer steps."]
    return fewer, [
        f"Steps of {steps.dt * 1e3:.3g} ms are cut into {fewer.substeps} substeps, not {steps.substeps}: {why}."
    ]


@dataclass(frozen=True)
class Due:
    """The steps of a frame: `count` are simulated, `skipped` are due but left out, `reached` counts all since the
    start."""

    count: int
    skipped: int
    reached: int

    @property
    def note(self) -> str:
        """A sentence about skipped steps, "" without any."""
        if not self.skipped:
            return ""
        return (
            f"Cloth stood still for {self.skipped} steps: a frame took longer than the {self.count} steps "
            "that one may simulate."
        )


def due_steps(time: float, done: int, dt: float, most_seconds: float = MOST_SECONDS) -> Due:
    """Return the steps that are due at `time` seconds after the cloth hung at rest, when `done` of them are past.

    A time before those steps has none due; `ClothClock` starts the cloth anew there. A step is due a millionth of its
    length before its time, so that k frames of dt are k steps whatever their rounding.
    """
    reached = max(math.floor(time / dt + 1e-6), done)
    due = reached - done
    count = min(due, max(1, math.floor(most_seconds / dt + 1e-6)))
    return Due(count, due - count, reached)


def motion_between(world_before: Float64, world_now: Float64, anchor: Float64) -> Float64:
    """Return the (4, 4) matrix that moves points with a node from `world_before` to `world_now`, its world matrices.

    Points are relative to `anchor`. The result is exactly the identity for a node that did not move. It is the
    identity, too, if `world_before` has no inverse.
    """
    if np.array_equal(world_before, world_now):
        return np.eye(4)
    to_world, from_world = np.eye(4), np.eye(4)
    to_world[:3, 3], from_world[:3, 3] = anchor, -np.asarray(anchor)
    try:
        moved: Float64 = from_world @ world_now @ np.linalg.inv(world_before) @ to_world
    except np.linalg.LinAlgError:
        return np.eye(4)
    return moved if np.isfinite(moved).all() else np.eye(4)


KEEPS_ON = frozenset({"", "resize", "camera cut"})
"""Reasons for a frame without history that let cloth go on: only the picture or the view changed. If time runs
backwards in the same frame, cloth starts anew all the same."""

CALM_SECONDS = 0.5
"""Seconds that a cloth must be calm before it is at rest: it also stands still at the end of a swing."""


class ClothClock:
    """The steps that each frame simulates, for each of `count` cloths; steps are `dt` seconds long.

        clock = ClothClock(count=2, dt=1 / 60)
        due = clock.frame(time, reset="", key=forces_and_places)  # due.count steps, of cloths not in clock.at_rest
        clock.told(mark, tested, calm)                            # the GPU's results of a frame that is over

    The state of a cloth is a function of the number of steps, not of the times of frames. A frame simulates the due
    steps, all of the same length.

    A cloth is *at rest* when it hardly moved for `CALM_SECONDS` and its forces, held particles and colliders have not
    changed since. It is then not simulated until one of them changes. The GPU measures whether a cloth hardly moves.
    The CPU reads the result when it uses the slot of that frame again. So nothing waits for the result, and it always
    arrives the same number of frames later.
    """

    def __init__(self, count: int, dt: float) -> None:
        self.dt = dt
        self.done = 0
        """Steps due since the cloths hung at rest at time 0, with the skipped ones."""
        self.at_rest: NDArray[np.bool_] = np.zeros(count, bool)
        self.began = False
        """Whether the cloths start anew in this frame, as they were modelled."""
        self._key: Any = None
        self._time = float("-inf")  # of the last frame
        self._since = np.zeros(count, np.int64)  # the step since which a cloth may count as calm
        self._round = 0

    def frame(self, time: float, reset: str, key: Sequence[Any]) -> Due:
        """Return the steps that a frame at `time` seconds simulates.

        `reset` is the reason for a frame without history, or "". `key` is everything that acts on the cloths: another
        key wakes all of them.
        """
        self._begin(time, reset)
        if key != self._key:
            self._key = key
            self.wake()
        due = due_steps(time, self.done, self.dt)
        self.done = due.reached
        return due

    def moves(self, time: float) -> bool:
        """Whether a frame at `time` simulates steps, or starts anew."""
        return time < self._time or due_steps(time, self.done, self.dt).reached > self.done

    def kept(self) -> Self:
        """Return a copy of the clock in its present state."""
        clock = copy(self)
        clock.at_rest, clock._since = self.at_rest.copy(), self._since.copy()
        return clock

    def pause(self, time: float, reset: str = "") -> None:
        """Let time pass up to a frame that simulates nothing; its steps count neither as skipped nor as calm."""
        self._begin(time, reset)
        reached = due_steps(time, self.done, self.dt).reached
        self._since += reached - self.done
        self.done = reached
        if self.began:
            self.wake()

    def _begin(self, time: float, reset: str) -> None:
        """Start anew where a frame at `time` has no history."""
        self.began = reset not in KEEPS_ON or time < self._time
        self._time = time
        if self.began:
            self.done, self._key = 0, None
            self._round += 1

    def wake(self) -> None:
        """Simulate all cloths again."""
        self.at_rest[:] = False
        self._since[:] = self.done

    def mark(self) -> tuple[int, int]:
        """Return the mark of a frame, which `told` takes with the results of that frame."""
        return self._round, self.done

    def goes_on(self, mark: tuple[int, int]) -> bool:
        """Whether the cloths have not started anew since a mark."""
        return mark[0] == self._round

    def told(self, mark: tuple[int, int], tested: NDArray[np.bool_], calm: NDArray[np.bool_]) -> None:
        """Take in which of the simulated cloths (`tested`, (C,)) were `calm` at the end of a marked frame.

        A calm cloth is at rest if it has been calm for CALM_SECONDS; for a cloth that moved this time starts anew.
        Results of frames before a new start or a wake-up have no effect.
        """
        done = mark[1]
        if not self.goes_on(mark):
            return
        moved = tested & ~calm & (done >= self._since)
        self._since[moved] = done
        self.at_rest |= tested & calm & ((done - self._since) * self.dt >= CALM_SECONDS)
