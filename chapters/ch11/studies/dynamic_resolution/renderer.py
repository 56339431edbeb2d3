"""The study's renderer on either API: the chapter's frame, prepared at eight scales (prepared.py).

`choose` sets the scale between two frames. It makes the graph, the images and the recordings of a scale at its first
visit, and takes them up at later ones.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from typing import Any

from backends.contract import check_arguments
from common.errors import SettingError, StaleFrameError
from common.scene import Scene
from common.settings import replaced

from ...frames.frame import OUTPUTS
from ...renderer import Renderer as ChapterRenderer
from ...shading.views import PICTURE
from . import Settings
from .controller import SCALES, Controller, check_number
from .level import LevelTechnique, level_at
from .loads import frame_ms as formula
from .prepared import PreparedFrames

ALL_PIXELS = 1.0 - 2.0**-20
"""`taa_scale` of a frame that draws all pixels of the picture and weights its samples as the other scales do."""

NO_BIAS = -math.log2(SCALES[0])
"""`mip_bias` with which the chapter adds nothing to levels at the smallest scale: `level.py` does that."""


def check(settings: Settings) -> None:
    """Raise SettingError for settings with which a frame has buffers that follow its scale or its recordings."""
    refused = {
        f"view={settings.shading.view}": settings.shading.view != PICTURE,
        f"transparency={settings.transparency.mode}": settings.transparency.mode != "sorted",
        "fog_half=true": settings.fog.fog_half,
        f"recording_threads={settings.frames.recording_threads}": settings.frames.recording_threads > 0,
        f"surfaces={settings.visibility.surfaces}": settings.visibility.surfaces != "gbuffer",
        f"rate_policy={settings.rates.rate_policy}": settings.rates.rate_policy != "none",
    }
    wrong = next((text for text, applies in refused.items() if applies), "")
    if wrong:
        raise SettingError(
            f"The study dynamic-resolution keeps eight frames ready, and {wrong} has room for one: leave it out."
        )


class Scaled(PreparedFrames):
    """Draws what the chapter draws, at one of eight scales that `choose` or `pace` set between two frames."""

    TECHNIQUES = (*ChapterRenderer.TECHNIQUES, LevelTechnique)  # type: ignore[assignment]

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Settings | None = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        **more: Any,
    ) -> None:
        settings, outputs = check_arguments(scene, settings, Settings, outputs, OUTPUTS)
        check(settings)
        self._number, self._bias = settings.scaling.first_scale, settings.taa.mip_bias
        self._controller = Controller(settings.scaling.target_ms, self._number)
        self._paced = self._changes = 0
        self._prepared = {}
        # The period of jitter and the weights of a history are those of the smallest scale, whichever is drawn.
        opened = replaced(settings, taa_scale=SCALES[0], mip_bias=NO_BIAS)
        super().__init__(scene, size, opened, without, outputs, **more)
        self.settings = replaced(self.settings, mip_bias=self._bias)

    # --- what a window calls between two frames ---

    @property
    def number(self) -> int:
        """The number of the scale of the next frame."""
        return self._number

    def pace(self, frame_ms: float) -> None:
        """Take the time that a finished frame took on the GPU, and choose the scale of the next frame."""
        scaling = self.settings.scaling
        if scaling.load != "measured":
            frame_ms = formula(scaling.load, self._paced, SCALES[self._number], scaling.target_ms)
        self._paced += 1
        self.choose(self._controller.next(frame_ms))

    def choose(self, number: int) -> None:
        """Draw at scale `number` from the next frame on; histories continue. Raises UserError for another number.

        Waits for the frames in flight; their images can no longer be read.
        """
        check_number(number)
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        if number != self._number:
            self._go_to(number, "the scale has changed since")
            self._controller.go_on(number)
            self._changes += 1

    # --- what the chapter's renderer calls ---

    def _use(self, number: int) -> None:
        """Let settings be those of a scale."""
        self._number = number
        scale = min(SCALES[number], ALL_PIXELS)
        self.settings = replaced(self.settings, taa_scale=scale)
        self._settings = replaced(self._settings, taa_scale=scale)
        self._level.level = level_at(self._bias, SCALES[number])

    @property
    def _level(self) -> LevelTechnique:
        technique = self.techniques[LevelTechnique.name]
        assert isinstance(technique, LevelTechnique)
        return technique

    def _create(self) -> None:
        self._level.level = self._bias  # that of shadow maps, which are not drawn at a scale
        super()._create()

    def _object_counts(self) -> dict[str, int]:
        own = {
            "scale_number": self._number,
            "scale_percent": round(100 * SCALES[self._number]),
            "scales_prepared": len(self._prepared) + 1,
            "scales_made": self._made,
            "scale_changes": self._changes,
        }
        return super()._object_counts() | own
