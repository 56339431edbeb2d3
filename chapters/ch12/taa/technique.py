"""Temporal anti-aliasing outside of its pass: the jitter of each frame, its share in the history, and rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.contract import FrameInfo, Pass, Technique
from common.layouts import HISTORY_COLOR
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model, scale
from .enlarge import EnlargePass
from .jitter import offset
from .passes import TaaPass


class TaaTechnique(Technique):
    """Decides jitter and share. A view whose other subjects rest is averaged, and then rests as well."""

    name = "taa"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        scale.check(settings)
        self._knobs = settings.taa
        self._on = model.in_use(settings)
        self.settles_last = self._on
        self._scaled = model.scale(settings) < 1.0
        self._period = scale.period(settings)
        self._shares = model.Shares(settings.taa.taa_share, self._period, model.averages(settings))
        self._index = 0
        self._jitter = (0.0, 0.0)
        self._reset = self._drawn = True
        self._passes: Any = None

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass."""
        enlarge = [EnlargePass(parts, image) for image in scale.ENLARGED] if self._scaled else []
        self.passes = {gpu_pass.name: gpu_pass for gpu_pass in (TaaPass(parts), *enlarge)}

    def constants(self, frame: FrameInfo) -> dict[str, Any]:
        """Return the jitter of the frame, and the share of the frame in the history."""
        if frame.passes is not self._passes:
            self._passes = frame.passes
            self._drawn = self._on and any(gpu_pass.name == TaaPass.name for gpu_pass in frame.passes)
        if not self._drawn:  # also if the pass is switched off: without a history the picture would tremble
            self.reset("")
            return {}
        shares, valid = self._shares, bool(frame.valid_histories & HISTORY_COLOR) and not self._reset
        share = shares.next(frame.still and not self._reset, valid)
        before = self._jitter
        if share > 0.0:  # else the frame is not a part of the picture, and its jitter stays
            self._jitter = offset(self._knobs.jitter, self._period, self._index)
            self._index += 1
        if self._reset:
            before, self._reset = self._jitter, False
        self.work = {"taa_frames": shares.age, "taa_averaging": int(shares.averaging)}
        return {
            "jitter_px": self._jitter,
            "previous_jitter_px": before,
            "history_share": share,
            "averaging": 2 if shares.begins else int(shares.averaging),
            **({"aspect": frame.picture[0] / frame.picture[1]} if self._scaled else {}),
        }

    def resting(self, time: float) -> bool:
        """Whether the picture stays as it is, as long as nothing else changes."""
        return not (self._on and self._drawn) or self._shares.resting

    def reset(self, reason: str) -> None:
        """Begin the sequence and the history anew."""
        self._index, self._reset = 0, True
        self._shares.reset()
