"""Rays outside of their passes: the way that finds hits, and the structures of the scene."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Scene

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import picture
from .passes import RayPicturePass, Structures, StructuresPass


class RayTechnique(Technique):
    """Chooses the way of tracing, and builds what it traverses."""

    name = "rays"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._structures: Structures | None = None

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the passes, and the structures if they are in use."""
        build, trace = StructuresPass(parts), RayPicturePass(parts)
        self.passes = {build.name: build, trace.name: trace}
        if not picture.in_use(parts.settings):
            return
        way = picture.chosen_way(parts.settings, backend.plan)
        package = f"{__package__}.bvh" if way == picture.BVH else __package__
        self._structures = structures = backend.part(package).open_structures(backend, parts)
        cloth = bool(passes["cloth"].externals)
        for gpu_pass in (build, trace):
            gpu_pass.structures = structures
            gpu_pass.follow(way, structures.sizes, cloth)

    def prepare(self, frame: FrameInfo) -> int:
        """Let the structures follow what has moved; return the bytes written."""
        if self._structures is None:
            return 0
        cloth = any(gpu_pass.name == "cloth" and not gpu_pass.resting for gpu_pass in frame.passes)
        written = self._structures.prepare(frame.slot, frame.pose, cloth)
        self.work = dict(self._structures.work)
        return written

    def close(self) -> None:
        """Free the structures."""
        if self._structures is not None:
            self._structures.close()
