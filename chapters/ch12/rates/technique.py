"""Shading rates outside of their passes: a policy that has no effect, and frames in which nothing changes."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .model import KEPT
from .native import without_effect
from .passes import RatePass, follows_edges


class RateTechnique(Technique):
    """Says why a policy of shading rates has no effect, and when the mask is kept (`model.KEPT`)."""

    name = "rates"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._settings = settings
        self._followed: list[RatePass] = []
        self._still = 0

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Add the sentence to the warnings of the scene, once; find the passes that rest."""
        sentence = without_effect(self._settings, backend.plan, parts.limits)
        if sentence and sentence not in parts.scene.warnings:
            parts.scene.warnings.append(sentence)
        if follows_edges(self._settings):
            self.settles_last = True
            self._followed = [step for step in passes.values() if isinstance(step, RatePass)]

    def prepare(self, frame: FrameInfo) -> int:
        """Count frames in which nothing changes; return 0, as nothing is written."""
        if self._followed:
            self._still = min(self._still + 1, KEPT) if frame.still else 0
            for gpu_pass in self._followed:
                gpu_pass.still = self._still
        return 0

    def resting(self, time: float) -> bool:
        """Whether the mask is kept: no texel has its turn any more."""
        return not self._followed or self._still == KEPT

    def reset(self, reason: str) -> None:
        """Begin to follow edges again."""
        self._still = 0
