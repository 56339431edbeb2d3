"""Shading rates outside of their passes: the sentence about a policy that has no effect."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import Pass, Technique
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .native import without_effect


class RateTechnique(Technique):
    """Says why a policy of shading rates has no effect."""

    name = "rates"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._settings = settings

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Add the sentence to the warnings of the scene, once."""
        sentence = without_effect(self._settings, backend.plan, parts.limits)
        if sentence and sentence not in parts.scene.warnings:
            parts.scene.warnings.append(sentence)
