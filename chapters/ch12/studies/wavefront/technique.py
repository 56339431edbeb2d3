"""The techniques of the study: the pass that traces, the buffers of its counters, and what the CPU is told."""

from __future__ import annotations

from collections.abc import Mapping

from backends.contract import Pass, Plan
from common.scene import Scene

from ...frames.backend.backend import Backend
from ...paths.passes import PathsPass
from ...paths.technique import PathTechnique
from ...rays import picture
from ...rays.technique import RayTechnique
from ...scene.pass_parts import PassParts
from . import Settings, check
from .memory import WaveMemory
from .passes import WavePass


class WaveRays(RayTechnique):
    """Finds hits in kernels, and traces paths by the kernels of the settings."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        check(scene, settings)
        self.paths = WavePass if settings.waves.kernel == "wave" else PathsPass

    def way(self, settings: Settings, plan: Plan) -> str:  # type: ignore[override]
        """Return the way that finds hits: of those of the device the first one that a kernel can take."""
        if settings.rays.ray_way != "auto":
            return picture.chosen_way(settings, plan)
        return picture.QUERY if plan.native(picture.FEATURES[picture.QUERY]) else picture.BVH


class WavePaths(PathTechnique):
    """Sums paths as the chapter does, and tells how many were alive in each round."""

    _wave: WaveMemory | None = None

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the tables, and the buffers of the head."""
        super().create(parts, backend, passes)
        trace = passes[PathsPass.name]
        if self._memory is not None and isinstance(trace, WavePass):
            self._wave = backend.part(__package__).WaveMemory(backend)
            trace.head = self._wave.head

    def told(self, slot: int) -> dict[str, int]:
        """Return what the chapter tells, and what the kernels have counted in a frame.

        wave_lanes       invocations that ran for live paths, in whole groups of 32
        loop_lanes       those of a loop, in which 32 neighbours wait for the longest of their paths
        wave_live_0 ...  live paths in each round; the last counter has those of all further rounds
        """
        told = super().told(slot)
        if self._wave is not None:
            lanes, loop, *live = self._wave.told(slot).tolist()
            told |= {"wave_lanes": lanes, "loop_lanes": loop}
            told |= {f"wave_live_{turn}": count for turn, count in enumerate(live)}
        return told

    def close(self) -> None:
        """Free the memory."""
        super().close()
        if self._wave is not None:
            self._wave.close()
