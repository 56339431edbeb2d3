"""The pass of the path tracer.

    paths        structures, both histories of the frame before -> history_paths, history_squares, color_traced
    paths_tell   both histories -> path_told, sums from which the CPU finds the error of the picture

Nothing that is drawn is read, so the frame graph leaves out all passes that draw the picture.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from backends.contract import Access, Pass, Sources
from common.environment import ENERGIES
from common.scene import Scene

from ..cloth.passes import VERTICES
from ..frames.commands import Commands
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..rays import picture
from ..rays.passes import TRACED, RayPicturePass, structure_accesses
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model

SUMS = "history_paths"
"""Sums of the light of all paths, in nits, and their number."""

SQUARES = "history_squares"
"""Sums of squared luminances of paths, and the number of paths that were left out since they were no numbers."""

TOLD = "path_told"
"""Sums over parts of the pixels (paths/tell.comp)."""

GROUPS, THREADS = 128, 64
"""The parts of the pixels, and the invocations that sum one."""

TABLES, FRAME = "path_tables", "path_frame"
"""The tables by which rays are sent towards light, and what paths of a frame are told."""

BLOCK_BYTES = 96
"""Bytes of the block of a frame (paths/frame.glsl)."""


class PathsPass(RayPicturePass):
    """Traces paths, an invocation for each pixel, and adds their light to that of the frames before."""

    name = "paths"
    shader = "paths/paths"
    sources = Sources(set=3, first={"texture": 16, "storage": 5, "uniform": 3})

    def hold(self, table_bytes: int) -> None:
        """Declare the tables, which have so many bytes, and the block of the frame."""
        stages = frozenset({"rays" if self._way == picture.PIPELINE else "compute"})
        self.externals = {
            TABLES: External(None, None, Touch("", stages, frozenset({"storage_read"})), bytes=table_bytes),
            FRAME: External(None, None, Touch("", stages, frozenset({"uniform"})), bytes=BLOCK_BYTES),
        }

    def follow(self, way: str, sizes: Mapping[str, int], cloth: bool = False) -> None:
        """Declare that the structures of a way are read, and the vertices of cloth if there is some."""
        self._way = way
        stages = ("rgen", "rahit") if way == picture.PIPELINE else ()
        vertices = (Access(VERTICES, "storage", stages=stages),) * cloth
        self.reads = (
            *structure_accesses(way, sizes, False),
            *vertices,
            Access(SUMS, "storage", previous=True, stages=stages),
            Access(SQUARES, "storage", previous=True, stages=stages),
            Access(TABLES, "storage", stages=stages),
            Access(FRAME, "uniform", stages=stages),
        )
        format = self._settings.shading.color_format
        self.writes = (
            Access(SUMS, "storage", format="rgba32f", stages=stages),
            Access(SQUARES, "storage", format="rgba32f", stages=stages),
            Access(TRACED, "storage", format=format, instead="color_hdr", stages=stages),
        )

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the picture is traced by paths."""
        return model.in_use(scene, settings)

    def defines(self) -> picture.Defines:
        """Return the defines of the shader, besides those of materials and of the way."""
        scene, settings = self._scene, self._settings
        lit = any(self._data.variants[it].has("ENVIRONMENT") for it in self._draws.used)
        sky = model.has_environment(scene, settings) and not lit  # behind surfaces that it does not light
        energy = ENERGIES.index(settings.environment.energy)
        return (
            *picture.surface_defines(scene, settings, self._draws.used),
            *model.path_defines(scene, settings),
            *((("ENVIRONMENT", 1), ("ENERGY", energy)) if sky else ()),
            ("PATH_BINDING", self._behind_structures()),
        )


class TellPass(Pass):
    """Sums what is known of the errors of all pixels, for the CPU to read."""

    name = "paths_tell"
    sources = Sources(set=3, first={"texture": 16, "storage": 5, "uniform": 3})
    reads = (Access(SUMS, "storage"), Access(SQUARES, "storage"))
    writes = (Access(TOLD, "storage", bytes=16 * GROUPS),)

    def __init__(self, parts: PassParts) -> None:
        self._draws, self._pipelines = parts.draws, parts.pipelines
        idle, read = (
            Touch("", frozenset(), frozenset()),
            Touch("", frozenset({"host"}), frozenset({"host_read"})),
        )
        self.externals = {TOLD: External(None, None, idle, read, bytes=16 * GROUPS)}
        self.finish: Callable[[], None] = lambda: None
        """Makes what was stored visible to the CPU, set by the technique."""

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the picture is traced by paths."""
        return model.in_use(scene, settings)

    def create(self) -> None:
        """Build the pipeline."""
        described = ComputeDescription("paths/tell.comp", (("THREADS", THREADS),), name=self.name)
        self.pipelines = self._pipelines.get([described])

    def record(self, commands: Commands) -> None:
        """Record the kernel."""
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        commands.dispatch(GROUPS)
        self.finish()
