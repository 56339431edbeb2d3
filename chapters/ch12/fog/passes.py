"""The passes of fog, before the passes that light surfaces.

    fog_noise      the noise of the medium, once -> fog_tables
    fog_inject     the medium -> fog_medium
    fog_scatter    fog_medium, lights and their shadows -> fog_light
    fog_spatial    fog_light -> fog_smooth
    fog_temporal   fog_smooth, the history of the frame before -> history_fog
    fog_integrate  the sum along each column -> records in the store, which surfaces read
    fog_half       the fog before each second pixel in each second row -> the store

The volumes are 3D images of the frame graph, so fog_smooth may lie where fog_medium was, and the history swaps its two
images. Tables and store are memory of the technique. Shaders of the scene bind the store with all else that
they see.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from backends.contract import Access, Pass, Sources
from common.scene import Scene

from ..clusters import model as clusters
from ..clusters.passes import read_lists
from ..frames.commands import Commands
from ..graph.execute.bindings import OWNED
from ..graph.file import graph_path, read_graph
from ..graph.plan import graph_name
from ..graph.types import External, Touch
from ..page_table.memory import NEEDS_OF_FOG
from ..pipelines.compute_description import ComputeDescription
from ..scene.data import BEHIND_SCENE
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shadows import model as shadows
from ..shadows.passes import read_pages
from . import model

TABLES = "fog_tables"
"""Blue noise and the noise of the medium, as froxels read them."""

RECORDS, PIXELS = "fog_records", "fog_pixels"
"""The store in the graph, by the passes that write it."""

HISTORY = "history_fog"

LIT = (
    *("lighting", "lighting_blocks", "lighting_compute", "lighting_pixels"),
    *("forward", "forward_late", "transparent", "transparent_fill"),
)
"""The passes that show surfaces through fog."""

_READ = Touch("", frozenset({"fragment", "compute"}), frozenset({"storage_read"}))
"""The last use in the frame before."""


class FogPass(Pass):
    """The common base: a kernel with an invocation for each froxel."""

    sources = BEHIND_SCENE
    shader: str
    result: str
    """The volume that the pass writes."""
    samples = False
    """Whether froxels take their samples at random depths."""

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._pipelines, self._draws = parts.settings, parts.pipelines, parts.draws
        self._data = parts.data
        self.active = True
        """Whether fog is in view, and its froxels change: else nothing is dispatched."""
        self._volume()

    def _volume(self, instead: str = "") -> None:
        """Declare the volume that the pass writes."""
        knobs = self._settings.fog
        columns, rows, slices = model.grid_of(knobs)
        self.writes = (
            Access(
                self.result,
                "storage",
                format=knobs.fog_format,
                size=(columns, rows),
                slices=slices,
                instead=instead,
            ),
        )

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is a medium whose light is shown."""
        return model.in_use(scene, settings)

    def defines(self) -> model.Defines:
        """Return the defines of the kernel."""
        settings, bound = self._settings, [access.resource for access in self.reads]
        noise = (("NOISE_SIZE", settings.fog.fog_noise_size),) if model.noise_in_use(settings) else ()
        jitter = (("JITTER", 1),) if self.samples and settings.fog.fog_temporal else ()
        lit = (("LIT", 1),) if self._data.lit else ()
        tables = (("TABLES_BINDING", bound.index(TABLES)),) if TABLES in bound else ()
        result = ("RESULT_BINDING", sum(it.use == "sampled" or it.resource == TABLES for it in self.reads))
        return (("FORMAT", settings.fog.fog_format), *noise, *jitter, *lit, *tables, result)

    def create(self) -> None:
        """Build the pipeline."""
        self.pipelines = self._pipelines.get(
            [ComputeDescription(self.shader, self.defines(), name=self.name)]
        )

    def extent(self) -> tuple[int, int, int]:
        """Return the invocations along each axis."""
        return model.grid_of(self._settings.fog)

    def record(self, commands: Commands) -> None:
        """Record the kernel over all froxels, if they change."""
        if self.active:
            (pipeline,) = self.pipelines
            commands.bind_compute(pipeline, self._draws.binding)
            commands.dispatch_over(pipeline, self.extent())

    def key(self, slot: int) -> Any:
        """Return what the recording depends on."""
        return self.active


class NoisePass(FogPass):
    """Makes the noise, in the first frame."""

    name, shader = "fog_noise", "fog/noise.comp"
    sources = Sources(first={"storage": 4})
    due = True
    """Whether there is no noise yet."""

    def _volume(self, instead: str = "") -> None:
        self.writes = (_tables(self._settings),)
        self.externals = {TABLES: External(None, None, _READ, bytes=self.writes[0].bytes)}

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the medium has noise."""
        return FogPass.needed(scene, settings) and model.noise_in_use(settings)

    def extent(self) -> tuple[int, int, int]:
        """Return an invocation for two texels."""
        size = self._settings.fog.fog_noise_size
        return size // 2, size, size

    def record(self, commands: Commands) -> None:
        """Record the kernel, once. It reads nothing of the scene."""
        if self.due and self.active:
            (pipeline,) = self.pipelines
            commands.bind_compute(pipeline)
            commands.dispatch_over(pipeline, self.extent())

    def key(self, slot: int) -> Any:
        """Return whether the kernel runs."""
        return self.due, self.active


class InjectPass(FogPass):
    """Writes the medium into the froxels."""

    name, shader, result = "fog_inject", "fog/inject.comp", "fog_medium"
    samples = True

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        if model.tables_in_use(parts.settings):
            self.reads = (_tables(parts.settings),)


class ScatterPass(FogPass):
    """Finds the light that each froxel sends to the eye."""

    name, shader, result = "fog_scatter", "fog/scatter.comp", "fog_light"
    samples = True
    reads: tuple[Access, ...] = (Access("fog_medium", "sampled"),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        if parts.settings.fog.fog_temporal:
            self.reads = (*self.reads, _tables(parts.settings))
        if clusters.needed(parts.scene, parts.settings):
            read_lists([self])
        if shadows.possible(parts.scene, parts.settings):
            read_pages([self])
        self.reports = shadows.by_need(parts.settings) and shadows.needed(parts.scene, parts.settings)
        """Whether froxels say which pages of shadows they read."""
        if self.reports:
            size = 4 * parts.data.shadow_places.report_words
            self.writes += (Access(NEEDS_OF_FOG, "storage", bytes=size),)

    def defines(self) -> model.Defines:
        """Return the defines of the kernel."""
        return (*super().defines(), *((("REPORTS", 1),) if self.reports else ()))


def _tables(settings: Settings) -> Access:
    return Access(TABLES, "storage", bytes=model.table_bytes(settings))


class SpatialPass(FogPass):
    """Averages neighbours."""

    name, shader, result = "fog_spatial", "fog/spatial.comp", "fog_smooth"
    reads = (Access("fog_light", "sampled"),)

    def _volume(self, instead: str = "") -> None:
        super()._volume(instead="fog_light")

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the settings ask for it."""
        return FogPass.needed(scene, settings) and settings.fog.fog_spatial


class TemporalPass(FogPass):
    """Blends with the frames before."""

    name, shader, result = "fog_temporal", "fog/temporal.comp", HISTORY
    reads = (Access("fog_smooth", "sampled"), Access(HISTORY, "sampled", previous=True))

    def _volume(self, instead: str = "") -> None:
        super()._volume(instead="fog_smooth")

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the settings ask for it."""
        return FogPass.needed(scene, settings) and settings.fog.fog_temporal


class IntegratePass(FogPass):
    """Sums the light along each column."""

    name, shader = "fog_integrate", "fog/integrate.comp"
    reads = (Access(HISTORY, "sampled"),)

    def _volume(self, instead: str = "") -> None:
        self.writes = (Access(RECORDS, "storage", bytes=OWNED),)
        self.externals = {RECORDS: External(None, None, _READ, bytes=OWNED)}

    def extent(self) -> tuple[int, int, int]:
        """Return an invocation for each column."""
        columns, rows, _ = super().extent()
        return columns, rows, 1


class HalfPass(FogPass):
    """Looks up the fog of each second pixel in each second row, for the pass that lights surfaces of a G-buffer."""

    name, shader = "fog_half", "fog/half.comp"
    reads = (Access("depth", "sampled"),)
    size = (1, 1)
    """The size of the picture."""

    def _volume(self, instead: str = "") -> None:
        self.writes = (Access(PIXELS, "storage", bytes=OWNED, of=RECORDS),)

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the settings ask for it, and the depth of all surfaces is known before they are lit."""
        in_use = FogPass.needed(scene, settings) and model.half_in_use(settings)
        return in_use and "gbuffer" in read_graph(graph_path(graph_name(settings))).passes.values()

    def extent(self) -> tuple[int, int, int]:
        """Return an invocation for four pixels."""
        width, height = self.size
        return -(-width // 2), -(-height // 2), 1

    def key(self, slot: int) -> Any:
        """Return what the recording depends on."""
        return self.active, self.size


FOG_PASSES = (NoisePass, InjectPass, ScatterPass, SpatialPass, TemporalPass, IntegratePass, HalfPass)


def read_fog(passes: Collection[Pass]) -> None:
    """Declare in the passes that show surfaces that they read the store."""
    for gpu_pass in passes:
        gpu_pass.reads = (*gpu_pass.reads, Access(PIXELS, "storage"))
