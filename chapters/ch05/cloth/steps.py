"""How time is cut for cloth: into substeps short enough for its springs, and into steps that become due in a frame.

A mass on springs swings with omega^2 = sum(k) / m, and against a neighbour that swings the other way with twice that
(Gershgorin's circles bound it for any masses): omega^2 <= 2 sum(k) / m. Explicit integration grows without bound where
h omega > 2. So springs get as many substeps as their stiffest particle needs; where that is more than allowed, they are
made softer, and that is told. XPBD is stable at any step.

But not at any *short* step in 32 bits. XPBD has no velocity of its own, only a difference: v = (x - x_before) / h. With
coordinates up to X a position is a multiple of u = 2^(floor(log2 X) - 23), and so v is one of u / h. Two things follow.

    What is too little is lost.  A substep changes v by a h. If that is less than half of a multiple, a h < u / (2 h),
        it is rounded away in every substep: below h = sqrt(u / (2 a)) a cloth does not even feel its weight.
    Errors become energy.  A substep rounds the position of a particle with s springs s + 1 times, each time with a
        variance of u^2 / 12, and v takes over all of it by 1 / h. Of three coordinates, in 1 / h substeps, v^2 gains
        (s + 1) u^2 / (4 h^3) a second at least. It is the third power that makes this sudden: what XPBD takes from a
        motion grows with h, so that at one h the two are even, and with half of that energy gains sixteenfold.

Both are far away where weight moves a particle by several units in a substep, a h^2 >= UNITS u. With X from 1 to 2 m
that is h >= 0.22 ms, and it grows with the root of X. Where steps are cut shorter they are cut into fewer.
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
"""Part of the longest stable substep that is used."""

MOST_SECONDS = 0.25
"""Time that one frame simulates at most; a frame that took longer skips the rest."""


UNITS = 4
"""By how many of the last digits of its position its weight is to move a particle in a substep of XPBD."""

_GRAVITY = math.hypot(*Forces().gravity)


def greatest_omega(cloth: Cloth) -> float:
    """Return the bound on how fast anything in a cloth swings, in radians a second."""
    stiffness = cloth.stiffness[cloth.kinds]
    sums = np.zeros(len(cloth.masses))
    for end in (0, 1):
        sums += np.bincount(cloth.springs[:, end], stiffness, len(sums))
    free = ~cloth.held
    return math.sqrt(2.0 * float((sums[free] / cloth.masses[free]).max(initial=0.0)))


def least_substep(cloth: Cloth) -> float:
    """Return the shortest substep of XPBD in seconds, as the head of this module derives it from 32 bits.

    Coordinates are those at rest: a cloth that falls far below its anchor would need longer ones.
    """
    unit = float(np.spacing(np.float32(_reach(cloth))))
    return math.sqrt(UNITS * unit / _GRAVITY)


def _reach(cloth: Cloth) -> float:
    """Return the greatest coordinate of a cloth at rest, in metres from its anchor."""
    return float(np.abs(cloth.positions).max(initial=0.0))


def fit_steps(
    cloths: Sequence[Cloth], steps: Steps, most: int = MAX_SUBSTEPS
) -> tuple[list[Cloth], Steps, list[str]]:
    """Return the cloths and steps that are simulated when these are asked for, and a sentence for each difference.

    Springs get more substeps than asked for where the stiffest cloth needs them, `most` at most, and a cloth that
    needs more still is made softer, all its springs alike. XPBD gets fewer where they would be too short for 32 bits.
    Raises SettingError for steps that are not positive.
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
    """Return steps of XPBD whose substeps are long enough for 32 bits, if fewer will do, and what is to be said."""
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
    """What a frame simulates: `count` steps; `skipped` more would have been due; `reached` are done afterwards."""

    count: int
    skipped: int
    reached: int

    @property
    def note(self) -> str:
        """A sentence about what was skipped, "" if nothing was."""
        if not self.skipped:
            return ""
        return (
            f"Cloth stood still for {self.skipped} steps: a frame took longer than the {self.count} steps "
            "that one may simulate."
        )


def due_steps(time: float, done: int, dt: float, most_seconds: float = MOST_SECONDS) -> Due:
    """Return the steps to simulate at `time` seconds after the cloth hung at rest, when `done` steps lie behind it.

    A time before the simulated steps returns none: time that runs backwards starts the cloth again. A step counts as
    due at a millionth before its time, so that k frames of dt are k steps whatever their rounding.
    """
    reached = max(math.floor(time / dt + 1e-6), done)
    wanted = reached - done
    count = min(wanted, max(1, math.floor(most_seconds / dt + 1e-6)))
    return Due(count, wanted - count, reached)


def motion_between(world_before: Float64, world_now: Float64, anchor: Float64) -> Float64:
    """Return the (4, 4) matrix that takes what a node held at `world_before` to where it is held at `world_now`.

    Both are world matrices; the result moves points relative to `anchor` and is exactly the identity for a node that
    stands where it stood. A node whose matrix cannot be turned round holds things where they were.
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
"""Why a frame may be without history while its cloth goes on: only the picture or the view is another one. Time may run
backwards at the same moment, and then it does not."""

CALM_SECONDS = 0.5
"""For how long a cloth must have been calm before it is at rest: at the end of a swing it stands still, too."""


class ClothClock:
    """Which steps each frame simulates, of which of `count` cloths; steps are `dt` seconds long.

        clock = ClothClock(count=2, dt=1 / 60)
        due = clock.frame(time, reset="", key=what_acts_on_it)    # due.count steps; clock.active says which cloths
        clock.told(mark, tested, calm)                            # what the GPU said of a frame that is over

    The state of a cloth is a function of the number of steps, never of the times of frames: a frame simulates the
    steps that have become due, all of the same length.

    A cloth is *at rest* when it hardly moved for `CALM_SECONDS` and nothing that acts on it has changed since: forces,
    what holds it, what is in its way. It is not simulated then, until something changes. The GPU says whether a cloth
    hardly moves. The CPU reads the answer when the slot of its frame is used again: nothing waits for it, and it always
    comes the same number of frames later.
    """

    def __init__(self, count: int, dt: float) -> None:
        self.dt = dt
        self.done = 0
        """Steps that have become due since the cloths hung at rest at time 0, those included that were skipped."""
        self.at_rest: NDArray[np.bool_] = np.zeros(count, bool)
        self.began = False
        """Whether the cloths have to begin anew in this frame, as they were modelled."""
        self._key: Any = None
        self._time = float("-inf")  # of the last frame
        self._since = np.zeros(count, np.int64)  # step from which on a calm cloth counts as such
        self._round = 0

    def frame(self, time: float, reset: str, key: Sequence[Any]) -> Due:
        """Return what a frame at `time` seconds simulates.

        `reset` is why it has no history, or "". `key` is all that acts on the cloths: whenever it is another one, all
        wake.
        """
        self._begin(time, reset)
        if key != self._key:
            self._key = key
            self.wake()
        due = due_steps(time, self.done, self.dt)
        self.done = due.reached
        return due

    def moves(self, time: float) -> bool:
        """Whether a frame at `time` simulates, or begins anew."""
        return time < self._time or due_steps(time, self.done, self.dt).reached > self.done

    def kept(self) -> Self:
        """Return the clock as it is now, whatever becomes of this one."""
        clock = copy(self)
        clock.at_rest, clock._since = self.at_rest.copy(), self._since.copy()
        return clock

    def pause(self, time: float, reset: str = "") -> None:
        """Let time go by up to that of a frame in which nothing is simulated: it is no skipping, and no calm."""
        self._begin(time, reset)
        reached = due_steps(time, self.done, self.dt).reached
        self._since += reached - self.done
        self.done = reached
        if self.began:
            self.wake()

    def _begin(self, time: float, reset: str) -> None:
        """Begin anew where a frame at `time` has no history."""
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
        """Return what a frame has to be remembered by until the GPU tells of it: see `told`."""
        return self._round, self.done

    def goes_on(self, mark: tuple[int, int]) -> bool:
        """Whether the cloths have not begun anew since then."""
        return mark[0] == self._round

    def told(self, mark: tuple[int, int], tested: NDArray[np.bool_], calm: NDArray[np.bool_]) -> None:
        """Take in which of the cloths that were simulated (`tested`, (C,)) were `calm` at the end of that frame.

        A cloth that was is at rest, if it had been calm for CALM_SECONDS: one that moved begins to count anew. Frames
        of before the cloths began anew, or were woken, say nothing.
        """
        done = mark[1]
        if not self.goes_on(mark):
            return
        moved = tested & ~calm & (done >= self._since)
        self._since[moved] = done
        self.at_rest |= tested & calm & ((done - self._since) * self.dt >= CALM_SECONDS)
