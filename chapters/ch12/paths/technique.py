"""Paths outside of their pass: which paths a frame traces, when sums begin anew, and the tables of light."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Change, Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .memory import PathMemory
from .passes import PathsPass, TellPass


class PathTechnique(Technique):
    """Sums the paths of frames that show the same, until there are `path_limit` for each pixel.

    Sums begin anew with the first frame that shows anything else.
    """

    name = "paths"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._knobs = settings.paths
        self.settles_last = model.in_use(scene, settings)
        self._memory: PathMemory | None = None
        self._count = 0
        self._reset = True
        self._seen: Any = None
        self._drawn: Any = None
        self._size = (1, 1)
        self.crop: tuple[int, int, int, int] | None = None
        """Of what larger picture the one that is drawn is a part: x, y, width, height. None: it is whole.

        x and y are the place of its upper left pixel there, width and height the size of the larger picture. Pixels
        have the paths that they have there. It may be set before each frame; sums begin anew.
        """
        self._lights: bytes | None = None  # the records of which the tables have a tree
        self._packed: dict[int, Any] = {}  # those of each slot

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the tables if paths are traced. The pass that traces is one of those of rays."""
        tell = TellPass(parts)
        self.passes = {tell.name: tell}
        if not model.in_use(parts.scene, parts.settings):
            return
        trace = passes[PathsPass.name]
        assert isinstance(trace, PathsPass)
        self._scene, self._slots = parts.scene, parts.data.slots
        parts.data.records.darken(model.stand_ins(parts.scene))
        lit = model.has_environment(parts.scene, parts.settings)
        self._around = model.environment_entries(parts.scene.environment if lit else None)
        self._tables_now = tables = self._tables()
        self._memory = backend.part(__package__).PathMemory(backend, tables)
        trace.hold(tables.words.nbytes)
        tell.finish = self._memory.finish

    def _tables(self, most_bytes: int | None = None) -> model.Tables:
        revision = self._scene.revision
        self._seen = revision[Change.MATERIALS], revision[Change.VISIBILITY]
        tables = model.tables(self._scene, self._around, most_bytes)
        both = bool(tables.environment and tables.emitters)
        self._towards_environment = 0.5 if both else float(tables.environment > 0)
        return tables

    def _with_lights(self, tables: model.Tables, slot: int) -> model.Tables:
        """Return the tables with the lights as they are in this frame: where they are, how bright and how far."""
        records = self._slots[slot].written.get("light_records")
        if records is None or (records is self._packed.get(slot) and self._lights is not None):
            return tables
        self._packed[slot] = records
        lights = records.tobytes()
        if lights == self._lights:
            return tables
        self._lights = lights
        return tables.with_lights(records)

    def constants(self, frame: FrameInfo) -> dict[str, Any]:
        """Return the aspect of the larger picture, if there is one: rays have its projection."""
        return {} if self.crop is None else {"aspect": self.crop[2] / self.crop[3]}

    def prepare(self, frame: FrameInfo) -> int:
        """Write which paths the frame traces; return the bytes written."""
        if self._memory is None:
            return 0
        knobs, revision = self._knobs, self._scene.revision
        self._size = frame.size
        tables = self._tables_now
        if self._seen != (revision[Change.MATERIALS], revision[Change.VISIBILITY]):
            tables, self._lights = self._tables(self._memory.room), None
        tables = self._with_lights(tables, frame.slot)
        if tables is not self._tables_now:
            self._memory.follow(tables)
            self._tables_now = tables
        if self._reset or not frame.still or self._state() != self._drawn:
            self._count, self._reset = 0, False
        self._drawn = self._state()
        first = self._count
        count = (
            max(min(knobs.path_samples, knobs.path_limit - first), 0)
            if knobs.path_average
            else knobs.path_samples
        )
        self._count += count
        self.work = {"path_samples": self._count, "path_new_samples": count}
        goes_on = knobs.path_average and first > 0
        samples = (knobs.path_first + first) & 0xFFFFFFFF, count, int(goes_on), knobs.path_seed
        words, choice = model.knob_words(knobs), (self._towards_environment, knobs.path_error)
        return self._memory.write(frame.slot, samples, words, choice, self.crop or (0, 0, *frame.size))

    def _state(self) -> tuple[Any, ...]:
        """Return what paths depend on and may change while frames are drawn: knobs, and the larger picture."""
        knobs = self._knobs
        return knobs.path_average, knobs.path_first, knobs.path_seed, model.knob_words(knobs), self.crop

    @property
    def tells(self) -> bool:
        """Whether paths are traced: then the GPU sums their errors."""
        return self._memory is not None

    def told(self, slot: int) -> dict[str, int]:
        """Return what is known of a frame's picture.

        path_error_ppm   the mean of squared relative errors of its pixels, under the root, in millionths
        path_total       paths of all pixels
        path_left_out    paths whose light was no number, or infinite
        """
        assert self._memory is not None, "it tells"
        errors, paths, left_out, *_ = self._memory.told(slot).tolist()
        pixels = self._size[0] * self._size[1]
        return {
            "path_error_ppm": round(1e6 * math.sqrt(max(errors, 0.0) / pixels)),
            "path_total": round(paths),
            "path_left_out": round(left_out),
        }

    def resting(self, time: float) -> bool:
        """Whether each pixel has all of its paths."""
        if self._memory is None:
            return True
        return self._count >= self._knobs.path_limit and self._state() == self._drawn

    def reset(self, reason: str) -> None:
        """Begin the sums anew."""
        self._reset = True

    def close(self) -> None:
        """Free the memory."""
        if self._memory is not None:
            self._memory.close()
