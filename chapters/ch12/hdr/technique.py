"""The technique of exposure and bloom: it writes the view's exposure, and says until when adaptation goes on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from backends.contract import FrameInfo, Pass, Technique
from common.scene import Scene
from common.view.camera import exposure

from ..frames.backend.backend import Backend
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..taa import model as taa
from . import model
from .bloom import bloom_passes
from .memory import ExposureMemory
from .passes import AdaptPass, HistogramPass, LuminancePass
from .settings import HISTOGRAM, MIPS

LEAST_FRAMES = 2
"""Frames after a change: one measures the picture, and the next one shows the exposure that follows."""


class HdrTechnique(Technique):
    """Exposure and bloom.

    The first frame after a reset has the exposure of its view, since there is no picture before it. The second one has
    the exposure that the first picture asks for, and the next ones adapt: so equal calls since a reset give equal bits.
    """

    name = "hdr"

    def __init__(self, scene: Scene, settings: Settings) -> None:
        super().__init__(scene, settings)
        model.check(settings.hdr)
        self.settles_last = bool(model.automatic(settings)) and taa.averages_exposed(settings)
        self._memory: ExposureMemory | None = None
        self._rest_after_s = model.rest_after_s(settings)
        self._before: float | None = None
        self._adapt: Pass | None = None
        self._adapts = False
        self._shown: Any = None
        self._changed_at, self._frames_since, self._time = 0.0, 0, 0.0
        self._size = (1, 1)

    def create(self, parts: PassParts, backend: Backend, passes: Mapping[str, Pass]) -> None:
        """Make the passes, and the exposure's buffers, which become a part of the scene's bindings."""
        mode = model.automatic(parts.settings)
        self._memory = memory = backend.part(__package__).ExposureMemory(backend, mode)
        parts.data.exposures = memory

        def counted() -> tuple[int, int]:
            """Return the pixels to count: none if no pass reads the counts, and sets them to zero."""
            return self._size if self._adapts else (0, 0)

        own: tuple[Pass, ...] = (
            HistogramPass(parts, counted),
            LuminancePass(parts),
            *(AdaptPass(parts, each, memory.finish) for each in (HISTOGRAM, MIPS)),
            *bloom_passes(parts),
        )
        self.passes = {gpu_pass.name: gpu_pass for gpu_pass in own}
        self._adapt = self.passes.get(f"adapt_{mode}")

    def prepare(self, frame: FrameInfo) -> int:
        """Write the exposure of the frame's view; return the bytes written."""
        assert self._memory is not None, "frames come after `create`"
        of_view = exposure(frame.view.ev100)
        # Its value counts if the pass ran in the frame before, and the frame tells it if the pass runs in this one.
        adapts = self._adapt in frame.passes
        first = self._before is None or not (adapts and self._adapts)
        self._adapts = self._memory.tells[frame.slot] = adapts
        before = of_view if self._before is None else self._before
        self._before, self._size = of_view, frame.picture
        if adapts:
            shown = frame.view, dict(self.scene.revision), frame.time if self.scene.animations else 0.0
            # A frame that is drawn at rest is drawn because something else has changed, such as a shader; or for a
            # subject that settles last.
            changed = first or shown != self._shown or (self.resting(frame.time) and not frame.settling)
            self._frames_since = 0 if changed else self._frames_since + 1
            if changed:
                self._shown, self._changed_at = shown, frame.time
            self._time = frame.time
        return self._memory.write(frame.slot, of_view, before, not first)

    def resting(self, time: float) -> bool:
        """Whether adaptation is as close to its target as a display shows, by the time since the last change.

        Time and frames decide, since no value is read from the GPU. The frame after a change measures it, and the next
        one shows what was measured. While time stands still, nothing adapts any more.
        """
        if not self._adapts:
            return True
        over = time >= self._changed_at + self._rest_after_s or time == self._time
        return self._frames_since >= LEAST_FRAMES and over

    def reset(self, reason: str) -> None:
        """Let the next frame have the exposure of its view."""
        self._before = None

    def close(self) -> None:
        """Free the buffers."""
        if self._memory is not None:
            self._memory.close()
