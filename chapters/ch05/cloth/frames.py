"""The cloth simulation in each frame, on both backends: steps, the nodes that hold cloth, and vertices to write.

The state of the simulation exists once, the drawn vertices once per slot: while the GPU draws one frame, the vertices
of the next one are written. The vertices of a cloth at rest are written until every slot has them. Invisible cloth is
simulated as well, since its later state depends on it; its vertices are written when it becomes visible.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.numerics.transforms import frustum_planes
from common.scene import Pose
from common.view.camera import View

from ..frames.frame import SLOTS
from ..scene import pages
from ..scene.geometry import DEFORMED, STREAMS
from ..scene.pages import Page
from .dispatches import (
    Dispatch,
    Moment,
    choose_execution,
    dispatches,
    frame_arrays,
    stats_of,
    surface_dispatches,
)
from .layout import Drawn, Limits, pack
from .scene import ClothScene
from .settings import ClothSettings
from .steps import MOST_SECONDS, ClothClock, fit_steps, motion_between
from .types import Float64, Forces, Steps

CALM = 2e-3
"""Speed of the fastest particle of a calm cloth, in its own sizes a second."""

AIR_DENSITY = 1.2

LATE = (
    f"Cloth hangs as it was modelled until the first frame, which simulates {MOST_SECONDS:g} s and not all the time "
    "before: let the frames begin at time 0 to see how it hangs by then."
)


@dataclass
class _Slot:
    """The state in a slot's copy of the vertices, and the steps of its last frame, whose answer is read later."""

    shows: NDArray[np.int64]
    mark: tuple[int, int] | None = None
    tested: Any = None
    simulated: Any = None


def drawn_from(cloth_scene: ClothScene, planned: Sequence[Page]) -> list[Drawn]:
    """Return where the vertices of each cloth lie in these pages of geometry."""
    scene = cloth_scene.scene
    records, page_of, _ = pages.mesh_records(scene, planned)
    drawn = []
    for cloth in cloth_scene.cloths:
        row, page = scene.meshes[cloth.mesh], int(page_of[cloth.mesh])
        first, vertex = int(row["first_index"]), int(row["first_vertex"])
        streams = zip(STREAMS, records["streams"][cloth.mesh].tolist(), strict=False)
        at = {name: word for name, word in streams if name in planned[page].offsets and name in DEFORMED}
        triangles = scene.indices[first : first + int(row["index_count"])].reshape(-1, 3)
        uv = scene.uv0[vertex : vertex + int(row["vertex_count"])]
        drawn.append(Drawn(page, triangles, **at, uv=uv))
    return drawn


class ClothFrames:
    """The cloths of a scene from frame to frame. `drawn` says where the vertices of each are drawn from."""

    def __init__(
        self,
        cloth_scene: ClothScene,
        settings: ClothSettings,
        drawn: Sequence[Drawn],
        limits: Limits | None = None,
    ) -> None:
        self._cloth_scene, self._settings = cloth_scene, settings
        wanted = Steps(
            settings.step,
            settings.substeps,
            settings.iterations,
            settings.method,
            settings.integrator,
        )
        self.cloths, self.steps, notes = fit_steps(cloth_scene.cloths, wanted)
        self._tell(notes)
        self._limits = limits
        self.draw_from(drawn)
        self.execution = choose_execution(self.packed, settings.execution)
        count = len(self.cloths)
        self.clock = ClothClock(count, self.steps.dt)
        self._particles = np.diff(self.packed.first_particles)
        sizes = [np.linalg.norm(np.ptp(cloth.positions, axis=0)) for cloth in self.cloths]
        self._sizes: Float64 = np.maximum(np.array(sizes), 1e-6)
        self._version = np.zeros(count, np.int64)  # of the state: grows with every change of it
        self._made = np.zeros(count, np.int64)  # steps simulated
        self._held = np.tile(np.eye(4), (count, 1, 1))  # where nodes held the cloths at the last step
        self._stones: Float64 = np.zeros((0, 4, 4))  # where the nodes of colliders were then
        self._bounds = np.full((count, 2, 3), np.nan)  # about the anchors, and when: as the GPU told last
        self._speed = np.zeros(count)
        self._told_at = np.zeros(count, np.int64)
        self._acts: Any = None  # what acts on the cloths,
        self._acts_since = np.zeros(count, np.int64)  # and from which step on
        self._warned = self._broken = False
        self.undo: Callable[[], None] = lambda: None
        """Makes as if the last frame had not been asked for: it never reached the GPU."""
        self.forget_vertices()

    def draw_from(self, drawn: Sequence[Drawn]) -> None:
        """Lay out the buffers, for vertices that are drawn from these places."""
        self.packed = pack(self.cloths, drawn, len(self._cloth_scene.obstacles), self._limits)

    def forget_vertices(self) -> None:
        """Note that no slot shows any cloth as it is: the vertices are other buffers."""
        count = len(self.cloths)
        self._slots = [_Slot(np.full(count, -1, np.int64)) for _ in range(SLOTS)]

    # --- every frame ---

    def told(self, slot: int, raw: NDArray[np.uint8]) -> None:
        """Take in what the GPU wrote about the last frame of a slot, which is over: the bytes of the buffer "stats"."""
        held = self._slots[slot]
        if held.mark is None:
            return
        stats, speed = stats_of(raw), np.zeros(len(self.cloths))
        tested = held.tested
        finite = stats["not_finite"] == 0
        speed[finite] = np.sqrt(stats["speed_squared"][finite])
        if not (self._broken or finite[tested].all()):
            self._broken = True
            names = ", ".join(self.cloths[number].name for number in np.flatnonzero(tested & ~finite))
            self._tell(
                [f"The cloth {names} is lost: its particles are no numbers any more; take smaller steps."]
            )
        if self.clock.goes_on(held.mark):
            self._speed[tested], self._told_at[tested] = speed[tested], held.simulated[tested]
            self._bounds[tested, 0], self._bounds[tested, 1] = stats["low"][tested], stats["high"][tested]
            self._bounds[tested & ~finite] = np.nan
        self.clock.told(held.mark, tested, finite & (speed < CALM * self._sizes))
        held.mark = None

    def begin(self, slot: int, pose: Pose, view: View, aspect: float, time: float, reset: str) -> Plan:
        """Return what the frame of a slot asks for at `time`.

        `pose` is that of the scene at that time; `reset` says why nothing of the frames before counts, or is "".
        """
        self.undo = self._kept(slot)
        cloth_scene, clock = self._cloth_scene, self.clock
        forces, colliders = self._forces(), cloth_scene.colliders(pose)
        nodes = [cloth.node for cloth in self.cloths]
        worlds = pose.world_from_node[nodes]
        key = (
            forces,
            worlds.tobytes(),
            [(it.world_from_collider.tobytes(), it.radius, it.half) for it in colliders],
        )
        slept = bool(clock.at_rest.all())
        due = clock.frame(time, reset, key)
        active = ~clock.at_rest
        begin = np.full(len(nodes), clock.began)
        steps = np.where(active, due.count, 0)
        skipped = due.skipped if active.any() and not slept else 0
        if skipped and clock.began:
            self._tell([LATE])
        elif skipped and not self._warned:
            self._warned = True
            self._tell([due.note])
        after = self._held.copy()
        for number in np.flatnonzero((steps > 0) | begin).tolist():
            after[number] = self._motion(number, pose)
        stones = pose.world_from_node[[each.node for each in cloth_scene.obstacles]]
        if clock.began:  # at rest where the nodes are now
            self._anew(after)
            self._stones = stones
        if key != self._acts or clock.began:
            self._acts, self._acts_since = key, self._made.copy()
        if steps.any():
            colliders = cloth_scene.colliders(pose, self._stones, due.count * clock.dt)
            self._stones = stones
        before, self._held = self._held, after
        self._made += steps
        self._version += (steps > 0) | begin
        held = self._slots[slot]
        write = self._seen(view, aspect) & (held.shows != self._version)
        held.shows[write] = self._version[write]
        held.mark, held.tested, held.simulated = clock.mark(), steps > 0, self._made.copy()
        work = {
            "cloth_steps": due.count if active.any() else 0,
            "cloth_particles": int(self._particles[steps > 0].sum()),
            "cloths_at_rest": int(clock.at_rest.sum()),
            "cloth_steps_skipped": skipped,
        }
        moment = Moment(steps, begin, write, before, after)
        idle = not (begin.any() or steps.any() or write.any())
        arrays = {} if idle else frame_arrays(self.packed, self.steps, forces, moment, colliders)
        return Plan(idle, int(steps.max(initial=0)), arrays, work)

    def _kept(self, slot: int) -> Callable[[], None]:
        """Return what brings back all that a frame of a slot changes here."""
        clock, held = self.clock.kept(), copy(self._slots[slot])
        held.shows = held.shows.copy()
        own = {name: getattr(self, name) for name in ("_held", "_stones", "_acts", "_acts_since")}
        own |= {name: getattr(self, name).copy() for name in ("_made", "_told_at", "_version", "_bounds")}

        def undo() -> None:
            self.clock, self._slots[slot] = clock, held
            vars(self).update(own)

        return undo

    def pause(self, pose: Pose, time: float, reset: str) -> Plan | None:
        """Pass over a frame without the cloth pass; `pose`, `time` and `reset` are as those of `begin`.

        Cloth stays as it hangs, or as it was modelled after a reset. Returns what has a slot show that, for all slots
        alike, and None where all of them do.
        """
        clock, count = self.clock, len(self.cloths)
        clock.pause(time, reset)
        self._stones = pose.world_from_node[[each.node for each in self._cloth_scene.obstacles]]
        begin = np.full(count, clock.began)
        if clock.began:
            self._anew(np.array([self._motion(number, pose) for number in range(count)]))
            self._version += 1
        for slot in self._slots:
            slot.mark = None
        if all((slot.shows == self._version).all() for slot in self._slots):
            return None
        for slot in self._slots:
            slot.shows[:] = self._version
        moment = Moment(np.zeros(count, np.int64), begin, np.ones(count, bool), self._held, self._held)
        return Plan(False, 0, frame_arrays(self.packed, self.steps, self._forces(), moment), {})

    def busy(self, time: float) -> bool:
        """Whether a frame at `time` would show cloth in another place: a cloth that is not at rest has steps due."""
        woken = self._acts is not None and self._acts[0] != self._forces()
        return (woken or not self.clock.at_rest.all()) and self.clock.moves(time)

    def dispatches(self, count: int) -> list[Dispatch]:
        """Return what a frame of at most `count` steps dispatches."""
        simulate = dispatches(self.packed, self.steps, count, self.execution)
        return simulate + surface_dispatches(self.packed)

    def recorded(self, plan: Plan) -> Any:
        """Return what a recording of `dispatches` is good for: the GPU reads all else from the frame's buffer."""
        if plan.idle:
            return None
        return max(plan.count, 1) if self.execution == "dispatch" else 1

    # --- what acts, and what is seen ---

    def _motion(self, number: int, pose: Pose) -> Float64:
        """Return the (4, 4) matrix by which a cloth's node went away from where the cloth hung as it was modelled."""
        cloth = self.cloths[number]
        return motion_between(self._cloth_scene.rest[number], pose.world_from_node[cloth.node], cloth.anchor)

    def _anew(self, held: Float64) -> None:
        """Forget what was simulated: the cloths hang as they were modelled, where their nodes hold them."""
        self._held, self._made[:], self._told_at[:] = held, 0, 0
        self._bounds[:], self._acts_since = np.nan, np.zeros(len(self.cloths), np.int64)

    def _forces(self) -> Forces:
        settings = self._settings
        angle = np.radians(settings.wind_direction)
        wind = settings.wind_speed * np.array((np.cos(angle), 0.0, -np.sin(angle)))
        return Forces(wind=(float(wind[0]), 0.0, float(wind[2])), air_density=AIR_DENSITY)

    def _seen(self, view: View, aspect: float) -> NDArray[np.bool_]:
        """Return (C,) which cloths may be in the picture; a cloth with unknown bounds may be."""
        cloth_scene = self._cloth_scene
        visible = cloth_scene.scene.instances.visible[cloth_scene.instances]
        anchors = np.array([cloth.anchor for cloth in self.cloths])
        planes = frustum_planes(view.clip_from_world(aspect))
        # Told frames ago; since then it went on, and fell at most. But what acts on it may have sent it anywhere since.
        ago = (self._made - self._told_at) * self.clock.dt
        margin = (self._speed + 10.0 * ago) * ago * 1.5 + 0.02 * self._sizes
        center = self._bounds.mean(axis=1) + anchors
        half = np.ptp(self._bounds, axis=1) / 2 + margin[:, None]
        outside = center @ planes[:, :3].T + half @ np.abs(planes[:, :3]).T + planes[:, 3] < 0  # (C, P)
        followed = self._told_at > self._acts_since
        seen: NDArray[np.bool_] = visible & ~(followed & outside.any(axis=1))
        return seen

    def _tell(self, sentences: Sequence[str]) -> None:
        warnings = self._cloth_scene.source.warnings
        warnings.extend(text for text in sentences if text not in warnings)


@dataclass(frozen=True)
class Plan:
    """What a frame asks for: nothing if `idle`; else `count` steps of a cloth at most, and by buffer the bytes that say
    so."""

    idle: bool
    count: int
    arrays: dict[str, NDArray[np.uint8]]
    work: dict[str, int]
