"""Rays outside of their passes: the way that finds hits, and the structures of the scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from backends.contract import FrameInfo, Pass, Plan, Technique
from common.scene import Scene

from ..cloth.passes import ClothPass
from ..frames.backend.backend import Backend
from ..paths.passes import PathsPass
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import picture
from .passes import RayPicturePass, Structures, StructuresPass
from .tiles import TileCount


def read_by_pipelines(fog: Pass) -> None:
    """Declare that shaders of a ray pipeline read what a pass of fog writes, until the next frame writes it again."""
    fog.externals = {
        name: replace(it, enters=replace(it.enters, stages=it.enters.stages | {"rays"}))
        for name, it in fog.externals.items()
    }


class RayTechnique(Technique):
    """Chooses the way of tracing, and builds what it traverses."""

    name = "rays"
    paths: type[PathsPass] = PathsPass
    """The pass that traces paths."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        self._structures: Structures | None = None
        self._tiles = TileCount()

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the passes, and the structures if they are in use."""
        build, rays, paths = StructuresPass(parts), RayPicturePass(parts), self.paths(parts)
        self.passes = {gpu_pass.name: gpu_pass for gpu_pass in (build, rays, paths)}
        trace = paths if paths.needed(parts.scene, parts.settings) else rays
        if not picture.in_use(parts.scene, parts.settings):
            return
        self._backend, self._settings, self._trace = backend, parts.settings, trace
        way = self.way(parts.settings, backend.plan)
        package = f"{__package__}.bvh" if way == picture.BVH else __package__
        self._structures = structures = backend.part(package).open_structures(backend, parts)
        hanging = passes["cloth"]
        assert isinstance(hanging, ClothPass)
        cloth = hanging.frames is not None
        if hanging.frames is not None:
            hanging.frames.everywhere = True
        for gpu_pass in (build, trace):
            gpu_pass.structures = structures
            gpu_pass.follow(way, structures.sizes, cloth)
        if way == picture.PIPELINE:
            read_by_pipelines(passes["fog_integrate"])

    def way(self, settings: Settings, plan: Plan) -> str:
        """Return the way that finds hits; raises UserError for one that there is not."""
        return picture.chosen_way(settings, plan)

    def prepare(self, frame: FrameInfo) -> int:
        """Let the structures follow what has moved; return the bytes written."""
        if self._structures is None:
            return 0
        cloth = any(gpu_pass.name == "cloth" and not gpu_pass.resting for gpu_pass in frame.passes)
        written = self._structures.prepare(frame.slot, frame.pose, cloth)
        self._trace.tiles = self._follow_time(frame)
        self.work = {**self._structures.work, "ray_tiles": self._trace.tiles}
        return written

    def _follow_time(self, frame: FrameInfo) -> int:
        """Return the number of tiles, by the time of the last frame of the slot, which is over."""
        tiles, frames = self._tiles, self._backend.frames
        if not tiles.count:
            rays = picture.most_rays(self.scene, self._settings, frame.size)
            tiles.begin(rays, self._backend.device.capabilities.is_software)
        elif frames.number > len(frames.slots) and tiles.is_due():  # drivers compile in the first frame
            tiles.follow(self._backend.timings(frames.slots[frame.slot]).get(self._trace.name, 0.0))
        return tiles.count

    def close(self) -> None:
        """Free the structures."""
        if self._structures is not None:
            self._structures.close()
