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
    """Return the places of each cloth's vertices in these pages of geometry."""
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
    """The cloths of a scene from frame to frame. `drawn` are the places of their vertices in the pages."""

    everywhere = False
    """Whether vertices are written that are out of view, too: a ray may meet them."""

    def __init__(
        self,
        cloth_scene: ClothScene,
        settings: ClothSettings,
        drawn: Sequence[Drawn],
        limits: Limits | None = None,
    ) -> None:
        self._cloth_scene, self._settings = cloth_scene, settings
        requested = Steps(
            settings.step,
            settings.substeps,
            settings.iterations,
            settings.method,
            settings.integrator,
        )
        self.cloths, self.steps, notes = fit_steps(cloth_scene.cloths, requested)
        self._tell(notes)
        self._limits = limits
        self.draw_from(drawn)
        self.execution = choose_execution(self.packed, settings.execution)
        count = len(self.cloths)
        self.clock = ClothClock(count, self.steps.dt)
        self._particles = np.diff(self.packed.first_particles)
        sizes = [np.linalg.norm(np.ptp(cloth.positions, axis=0)) for cloth in self.cloths]
        self._sizes: Float64 = np.maximum(np.array(sizes), 1e-6)
        self._version = np.zeros(count, np.int64)  # of the state: grows with every change
        self._made = np.zeros(count, np.int64)  # steps simulated
        self._held = np.tile(np.eye(4), (count, 1, 1))  # motions of the nodes at the last step
        self._stones: Float64 = np.zeros((0, 4, 4))  # world matrices of the colliders' nodes then
        self._bounds = np.full((count, 2, 3), np.nan)  # relative to the anchors, from the latest stats
        self._speed = np.zeros(count)
        self._told_at = np.zeros(count, np.int64)  # steps simulated up to these stats
        self._acts: Any = None  # forces, nodes and colliders of the last frame,
        self._acts_since = np.zeros(count, np.int64)  # and the steps simulated before them
        self._warned = self._broken = False
        self.undo: Callable[[], None] = lambda: None
        """Restores the state before the last frame, which never reached the GPU."""
        self.forget_vertices()

    def draw_from(self, drawn: Sequence[Drawn]) -> None:
        """Lay out the buffers, for vertices at these places."""
        self.packed = pack(self.cloths, drawn, len(self._cloth_scene.obstacles), self._limits)

    def forget_vertices(self) -> None:
        """Mark the vertices of all slots as outdated: their buffers were replaced."""
        count = len(self.cloths)
        self._slots = [_Slot(np.full(count, -1, np.int64)) for _ in range(SLOTS)]
        self.known: NDArray[np.bool_] = np.zeros(count, bool)
        """(C,) Whether the other slots have the vertices of the frame before."""

    # --- every frame ---

    def told(self, slot: int, raw: NDArray[np.uint8]) -> None:
        """Take in the GPU's results of the last frame of a slot, which is over: the bytes of the buffer "stats"."""
        slot_state = self._slots[slot]
        if slot_state.mark is None:
            return
        stats, speed = stats_of(raw), np.zeros(len(self.cloths))
        tested = slot_state.tested
        finite = stats["not_finite"] == 0
        speed[finite] = np.sqrt(stats["speed_squared"][finite])
        if not (self._broken or finite[tested].all()):
            self._broken = True
            names = ", ".join(self.cloths[number].name for number in np.flatnonzero(tested & ~finite))
            self._tell(
                [f"The cloth {names} is lost: its particles are no numbers any more; take smaller steps."]
            )
        if self.clock.goes_on(slot_state.mark):
            self._speed[tested], self._told_at[tested] = speed[tested], slot_state.simulated[tested]
            self._bounds[tested, 0], self._bounds[tested, 1] = stats["low"][tested], stats["high"][tested]
            self._bounds[tested & ~finite] = np.nan
        self.clock.told(slot_state.mark, tested, finite & (speed < CALM * self._sizes))
        slot_state.mark = None

    def begin(self, slot: int, pose: Pose, view: View, aspect: float, time: float, reset: str) -> Plan:
        """Return the plan of a slot's frame at `time`.

        `pose` is that of the scene at that time; `reset` is why earlier frames do not count, or "".
        """
        self.undo = self._kept(slot)
        cloth_scene, clock = self._cloth_scene, self.clock
        forces, colliders = self._forces(), cloth_scene.colliders(pose)
        nodes = [cloth.node for cloth in self.cloths]
        worlds = pose.world_from_node[nodes]
        key = (
            forces,
            worlds.tobytes(),
            [
                (collider.world_from_collider.tobytes(), collider.radius, collider.half)
                for collider in colliders
            ],
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
        stones = pose.world_from_node[[obstacle.node for obstacle in cloth_scene.obstacles]]
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
        slot_state = self._slots[slot]
        shown = [it.shows == self._version for it in self._slots if it is not slot_state]
        self.known = np.all(shown, axis=0)
        self._version += (steps > 0) | begin
        write = self._seen(view, aspect) & (slot_state.shows != self._version)
        slot_state.shows[write] = self._version[write]
        slot_state.mark, slot_state.tested, slot_state.simulated = clock.mark(), steps > 0, self._made.copy()
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
        """Return a function that restores everything that a frame of a slot changes here."""
        clock, slot_state = self.clock.kept(), copy(self._slots[slot])
        slot_state.shows = slot_state.shows.copy()
        state = {name: getattr(self, name) for name in ("_held", "_stones", "_acts", "_acts_since")}
        state |= {name: getattr(self, name).copy() for name in ("_made", "_told_at", "_version", "_bounds")}

        def undo() -> None:
            self.clock, self._slots[slot] = clock, slot_state
            vars(self).update(state)

        return undo

    def pause(self, pose: Pose, time: float, reset: str) -> Plan | None:
        """Pass over a frame without the cloth pass; `pose`, `time` and `reset` are as those of `begin`.

        Cloth keeps its state, or hangs as it was modelled after a reset. Returns a plan that writes the vertices of
        this state, the same for all slots, or None if all slots have them.
        """
        clock, count = self.clock, len(self.cloths)
        clock.pause(time, reset)
        self._stones = pose.world_from_node[[obstacle.node for obstacle in self._cloth_scene.obstacles]]
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
        """Return the dispatches of a frame of at most `count` steps."""
        simulate = dispatches(self.packed, self.steps, count, self.execution)
        return simulate + surface_dispatches(self.packed)

    def recorded(self, plan: Plan) -> Any:
        """Return the key of a recording of `dispatches`: the GPU reads all else from the frame's buffer."""
        if plan.idle:
            return None
        return max(plan.count, 1) if self.execution == "dispatch" else 1

    # --- forces and visibility ---

    def _motion(self, number: int, pose: Pose) -> Float64:
        """Return the (4, 4) matrix of a node's motion since its cloth hung as it was modelled."""
        cloth = self.cloths[number]
        return motion_between(self._cloth_scene.rest[number], pose.world_from_node[cloth.node], cloth.anchor)

    def _anew(self, held: Float64) -> None:
        """Forget the simulation: the cloths hang as they were modelled, moved by their nodes (`held`)."""
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
        if self.everywhere:
            return visible
        planes = frustum_planes(view.clip_from_world(aspect))
        boxes = self.boxes()
        center, half = boxes.mean(axis=1), np.ptp(boxes, axis=1) / 2
        outside = center @ planes[:, :3].T + half @ np.abs(planes[:, :3]).T + planes[:, 3] < 0  # (C, P)
        seen: NDArray[np.bool_] = visible & ~outside.any(axis=1)
        return seen

    def boxes(self) -> Float64:
        """Return the (C, 2, 3) boxes of cloths in the world, NaN where they are unknown."""
        anchors = np.array([cloth.anchor for cloth in self.cloths])
        # The stats are some frames old; since then cloth went on, and fell at most. Other forces may move it anywhere.
        ago = (self._made - self._told_at) * self.clock.dt
        margin = (self._speed + 10.0 * ago) * ago * 1.5 + 0.02 * self._sizes
        boxes = self._bounds + anchors[:, None] + margin[:, None, None] * np.array((-1.0, 1.0))[:, None]
        followed = self._told_at > self._acts_since
        known: Float64 = np.where(followed[:, None, None], boxes, np.nan)
        return known

    def _tell(self, sentences: Sequence[str]) -> None:
        warnings = self._cloth_scene.source.warnings
        warnings.extend(text for text in sentences if text not in warnings)


@dataclass(frozen=True)
class Plan:
    """The work of a frame: none if `idle`; else at most `count` steps of a cloth, and the bytes to write by buffer."""

    idle: bool
    count: int
    arrays: dict[str, NDArray[np.uint8]]
    work: dict[str, int]
