"""The passes of automatic exposure, after the lens and before the tone curve.

    color_lensed -> histogram -> adapt -> the exposure of the next frame

With the setting `mips` the pass `luminance` takes the place of `histogram`. The pass `adapt` writes the block of the
other slot. For the graph it is an external; shaders of the next frame read it as a uniform block. So the exposure goes
from frame to frame on the GPU, and the CPU waits for no frame.
"""

from __future__ import annotations

from collections.abc import Callable

from backends.contract import Access, Pass
from common.scene import Scene

from ..frames.commands import Commands
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..scene.data import BEHIND_SCENE
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model
from .memory import HISTOGRAM_BYTES, NEXT, TOLD
from .settings import HISTOGRAM, MIPS

_STORED = Touch("", frozenset({"compute"}), frozenset({"storage_read", "storage_write"}), writes=True)
_SHADERS_READ = Touch("", frozenset({"fragment", "compute"}), frozenset({"uniform"}))
_HOST_IDLE = Touch("", frozenset(), frozenset())
_HOST_READS = Touch("", frozenset({"host"}), frozenset({"host_read"}))

LUMINANCE_BYTES = 4 * model.MIP_FLOATS


class ExposurePass(Pass):
    """The common base: one kernel, which reads the scene's set and the images and buffers that the pass declares."""

    sources = BEHIND_SCENE
    mode = HISTOGRAM
    shader: str

    def __init__(self, parts: PassParts) -> None:
        self._settings, self._pipelines, self._draws = parts.settings, parts.pipelines, parts.draws
        self._skips = model.skips_empty(parts.scene, parts.settings)

    def needed(self, scene: Scene, settings: Settings) -> bool:  # type: ignore[override]
        """Whether the GPU finds the exposure in this way."""
        return model.automatic(settings) == self.mode

    def create(self) -> None:
        """Build the pipeline."""
        empty = ("SKIP_EMPTY", 1), ("BACKGROUND", self._settings.shading.background)
        defines = model.exposure_defines(self._settings) + (empty if self._skips else ())
        self.pipelines = self._pipelines.get([ComputeDescription(self.shader, defines, name=self.name)])

    def measured(self) -> tuple[Access, ...]:
        """Return the picture, and the depth if it says where there is no light."""
        depth = (Access("depth", "sampled"),) if self._skips else ()
        return (Access("color_hdr", "sampled"), *depth)


class HistogramPass(ExposurePass):
    """Counts the pixels of each luminance."""

    name = "histogram"
    shader = "hdr/histogram.comp"
    writes = (Access("histogram", "storage", bytes=HISTOGRAM_BYTES),)

    def __init__(self, parts: PassParts, size: Callable[[], tuple[int, int]]) -> None:
        super().__init__(parts)
        self.reads = self.measured()
        self.externals = {"histogram": External(None, None, _STORED, bytes=HISTOGRAM_BYTES)}
        self._size = size

    def record(self, commands: Commands) -> None:
        """Record an invocation for each pixel."""
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        commands.dispatch_over(pipeline, self._size())


class LuminancePass(ExposurePass):
    """Averages the luminance over each of 64x64 parts of the picture."""

    name = "luminance"
    mode = MIPS
    shader = "hdr/luminance.comp"
    writes = (Access("luminance", "storage", bytes=LUMINANCE_BYTES),)

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads = self.measured()

    def record(self, commands: Commands) -> None:
        """Record an invocation for each texel."""
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        commands.dispatch_over(pipeline, (model.SIDE, model.SIDE))


class AdaptPass(ExposurePass):
    """Writes the exposure of the next frame, and for the CPU that of this frame."""

    shader = "hdr/adapt.comp"

    def __init__(self, parts: PassParts, mode: str, finish: Callable[[], None]) -> None:
        super().__init__(parts)
        self.mode, self.name = mode, f"adapt_{mode}"
        measured, bytes_ = (
            ("histogram", HISTOGRAM_BYTES) if mode == HISTOGRAM else ("luminance", LUMINANCE_BYTES)
        )
        self.writes = (
            Access(f"{measured}_read", "storage", bytes=bytes_, of=measured),
            Access(NEXT, "storage", bytes=32),
            Access(TOLD, "storage", bytes=16),
        )
        self.externals = {
            NEXT: External(None, None, _SHADERS_READ, _SHADERS_READ, bytes=32),
            TOLD: External(None, None, _HOST_IDLE, _HOST_READS, bytes=16),
        }
        self._finish = finish

    def record(self, commands: Commands) -> None:
        """Record one work group."""
        (pipeline,) = self.pipelines
        commands.bind_compute(pipeline, self._draws.binding)
        commands.dispatch(1)
        self._finish()
