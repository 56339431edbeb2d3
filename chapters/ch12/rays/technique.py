"""Rays outside of their passes: the way that finds hits, and the structures of the scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .passes import BUFFERS, RayPicturePass


class RayTechnique(Technique):
    """Chooses the way of tracing, and builds what it traverses."""

    name = "rays"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._memory: Any = None

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the pass, and the structures if it is in use."""
        picture = RayPicturePass(parts)
        self.passes = {picture.name: picture}
        if not model.in_use(parts.settings):
            return
        picture.way = model.chosen_way(parts.settings, backend.plan)
        part = backend.part(__package__)
        self._memory = part.RayMemory(backend, parts)
        picture.bind = self._memory.bind
        picture.read_structures(self._memory.sizes)
        for resources in backend.copies.also:
            resources |= dict(zip(BUFFERS, self._memory.buffers, strict=True))

    def prepare(self, frame: FrameInfo) -> int:
        """Follow instances that moved; return the bytes written."""
        return 0

    def close(self) -> None:
        """Free the structures."""
        if self._memory is not None:
            self._memory.close()
