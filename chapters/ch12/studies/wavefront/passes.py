"""The pass of the study: the kernels of wave.comp, round by round."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from backends.contract import Access
from common.errors import UnsupportedError

from ...frames.commands import Commands
from ...graph.types import External, Touch
from ...paths.passes import PathsPass
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built
from ...rays import picture
from ...scene.pass_parts import PassParts
from . import PATH_BYTES, layout

_WRITTEN = Touch("", frozenset({"compute"}), frozenset({"storage_write"}), writes=True)
_IDLE = Touch("", frozenset(), frozenset())
_READ = Touch("", frozenset({"host"}), frozenset({"host_read"}))


class WavePass(PathsPass):
    """Traces the paths of a frame: tile by tile, path by path of each pixel, round by round.

    Raises UnsupportedError where the device has no buffer for so many paths.
    """

    shader = "studies/wavefront/wave"
    head: Any = None
    """The buffer of the head, set by the technique."""

    def __init__(self, parts: PassParts) -> None:
        settings: Any = parts.settings  # those of the study
        self._paths = int(settings.waves.paths)
        self._bytes, self._limit = self._paths * PATH_BYTES, int(parts.limits["maxStorageBufferRange"])
        super().__init__(parts)

    def hold(self, table_bytes: int) -> None:
        """Declare what the technique owns: tables, blocks, and the head with its counters."""
        super().hold(table_bytes)
        self.externals = {
            **self.externals,
            layout.HEAD: External(None, None, _WRITTEN, bytes=layout.HEAD_BYTES),
            layout.TOLD: External(None, None, _IDLE, _READ, bytes=4 * layout.TOLD_WORDS),
        }

    def follow(self, way: str, sizes: Mapping[str, int], cloth: bool = False) -> None:
        """Declare the structures of a way, and the paths in flight."""
        if self._bytes > self._limit:
            raise UnsupportedError(
                f"wave_paths={self._paths} takes a buffer of {self._bytes / 2**20:.4g} MiB, and shaders of this device "
                f"see {self._limit / 2**20:.4g} MiB of one: set wave_paths={self._limit // PATH_BYTES} or less."
            )
        super().follow(way, sizes, cloth)
        self.writes = (
            *self.writes,
            Access(layout.WAVE, "storage", bytes=self._bytes),
            Access(layout.HEAD, "storage", bytes=layout.HEAD_BYTES),
            Access(layout.TOLD, "storage", bytes=4 * layout.TOLD_WORDS),
        )

    def defines(self) -> picture.Defines:
        """Return the defines of the kernels."""
        return (*super().defines(), ("WAVE_PATHS", f"{self._paths}u"), ("TOLD_ROUNDS", f"{layout.ROUNDS}u"))

    def create(self) -> None:
        """Build a pipeline for each stage; the first one stands for all where bindings are checked."""
        described = self.describe()
        assert isinstance(described, ComputeDescription)
        self._bound()  # refuses a scene before its shaders are compiled
        kernels = [
            ComputeDescription(
                described.shader, described.defines, (("STAGE", number),), name=f"paths, {stage}"
            )
            for number, stage in enumerate(layout.STAGES)
        ]
        built = self._pipelines.get(kernels)
        self.kernels = dict(zip(layout.STAGES, built, strict=True))
        self.pipelines = built[:1]
        self.structures.trace_by(built)

    def record(self, commands: Commands) -> None:
        """Record all rounds of all paths in all tiles."""
        self._page, self._textures = self._bound()
        knobs = self._settings.paths
        samples, rounds = int(knobs.path_samples), int(knobs.path_bounces) + 1
        commands.compute_barrier()
        self._run(commands, "next", (0, 0, 0, layout.CLEARS), 1)
        for x, y, columns, rows in layout.wave_tiles(commands.extent, self.tiles, self._paths):
            size = columns | rows << 16
            groups = layout.blocks(columns, rows)
            for sample in range(samples):
                told = sample << layout.SAMPLE_SHIFT
                self._run(commands, "generate", (x, y, size, told), groups)
                self._run(commands, "next", (x, y, size, told), 1)
                self._bind(commands, "extend", (x, y, size, told))
                commands.dispatch_indirect(self.head, layout.LIVE_GROUPS)
                for turn in range(rounds):
                    self._round(commands, (x, y, size), turn, told, turn + 1 < rounds)
                last = layout.IS_LAST * (sample == samples - 1)
                self._run(commands, "add", (x, y, size, told | last), groups)
        self._run(commands, "next", (0, 0, 0, layout.IS_LAST), 1)

    def _round(
        self, commands: Commands, tile: tuple[int, int, int], turn: int, told: int, goes_on: bool
    ) -> None:
        """Record a round whose hits are being found, and the search for the hits of the next one.

        Nothing lies between rays towards light and rays of the next round but a barrier for the sake of validation,
        which takes all stages of one text for writers of all that it names.
        """
        commands.compute_barrier()
        self._bind(commands, "shade", (*tile, told | turn))
        commands.dispatch_indirect(self.head, layout.LIVE_GROUPS)
        commands.compute_barrier()
        self._run(commands, "next", (*tile, told | turn + 1), 1)
        self._bind(commands, "shadow", (*tile, told | turn))
        commands.dispatch_indirect(self.head, layout.SHADOW_GROUPS)
        commands.compute_barrier()
        if goes_on:
            self._bind(commands, "extend", (*tile, told | turn + 1))
            commands.dispatch_indirect(self.head, layout.LIVE_GROUPS)

    def key(self, slot: int) -> Any:
        """Return what the recording depends on."""
        knobs = self._settings.paths
        return super().key(slot), knobs.path_samples, knobs.path_bounces

    def _bind(self, commands: Commands, stage: str, told: tuple[int, int, int, int]) -> Built:
        pipeline = self.kernels[stage]
        images = self._data.texture_set(self._textures) if self._textured else None
        page = self._data.bound_page(self._draws.slot, self._page)
        self.structures.bind_pass(commands, pipeline, self._draws.binding, page, images)
        commands.push(pipeline, np.array(told, np.uint32))
        return pipeline

    def _run(self, commands: Commands, stage: str, told: tuple[int, int, int, int], groups: int) -> None:
        """Record so many groups of a stage, and a barrier behind them."""
        self._bind(commands, stage, told)
        commands.dispatch(groups)
        commands.compute_barrier()
