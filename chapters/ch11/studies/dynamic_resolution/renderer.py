"""The study's renderer on either API: the chapter's frame, prepared at eight scales that share the histories.

A prepared frame is a compiled graph with its images, its descriptor sets and its recordings. `choose` parks the current
one and takes another one. The next frame continues the histories: they belong to the stream of frames, and their images
are lent from one executor to the next. Scene, pipelines, shadow maps, fog and exposure exist once for all scales.

`choose` waits for the frames in flight, as a change of the graph does. It makes the images of a scale at its first
visit. What invalidates recordings, such as an edit of materials or another size, drops all prepared frames but the
current one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

from backends.contract import check_arguments
from common.errors import SettingError, StaleFrameError
from common.scene import Scene
from common.settings import replaced

from ...frames.frame import OUTPUTS
from ...graph.types import Graph
from ...renderer import Renderer as ChapterRenderer
from ...shading.views import PICTURE
from . import Settings
from .controller import SCALES, Controller, check_number
from .level import LevelTechnique, level_at
from .loads import frame_ms as formula

ALL_PIXELS = 1.0 - 2.0**-20
"""`taa_scale` of a frame that draws all pixels of the picture and weights its samples as the other scales do."""

NO_BIAS = -math.log2(SCALES[0])
"""`mip_bias` with which the chapter adds nothing to levels at the smallest scale: `level.py` does that."""


@dataclass
class Prepared:
    """A frame that is ready to be drawn; `parts` are members of the backend."""

    graph: Graph
    nodes: Any
    recordings: Any
    parts: dict[str, Any]


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


class Scaled(ChapterRenderer):
    """Draws what the chapter draws, at one of eight scales that `choose` or `pace` set between two frames."""

    TECHNIQUES = (*ChapterRenderer.TECHNIQUES, LevelTechnique)
    PARTS: tuple[str, ...] = ("executor", "copies", "inspection", "_passes")
    """Members of the backend that belong to a prepared frame."""

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
        self._paced = self._made = self._changes = 0
        self._prepared: dict[int, Prepared] = {}
        self._valid_until = 0
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
        if number == self._number:
            return
        self._api.enter()
        self._let_go("the scale has changed since")
        if self._frames.forgotten != self._valid_until:
            self._drop()
        before, prepared = self._number, self._prepared.pop(number, None)
        parked = self._park(prepared)
        self._use(number)
        if prepared is not None:
            self._resume(prepared)
        else:
            try:
                self._prepare(parked)
            except BaseException:  # the device has no memory for it
                self._use(before)
                self._undo(parked)
                raise
            self._made += 1
        self._prepared[before] = parked
        self._changes += 1
        self._controller.go_on(number)
        self._valid_until = self._frames.forgotten

    # --- prepared frames ---

    def _park(self, other: Prepared | None) -> Prepared:
        """Return the frame that is drawn, and go on with the recordings of another one, or with none."""
        recordings = self._frames.exchange(other.recordings if other else None)
        parts = {name: getattr(self._api, name) for name in self.PARTS}
        return Prepared(self.graph, self._plan.nodes, recordings, parts)

    def _resume(self, prepared: Prepared) -> None:
        """Draw a prepared frame from now on."""
        for name, part in prepared.parts.items():
            setattr(self._api, name, part)
        self.graph, self._plan.nodes = prepared.graph, prepared.nodes
        self.graph_work = self.graph.counts()

    def _prepare(self, lender: Prepared) -> None:
        """Make the frame of a scale that was not visited yet, with the histories of another one."""
        api, steps = self._api, [step.name for step in self.graph.steps]
        graph = self._compiled()
        assert sorted(step.name for step in graph.steps) == sorted(steps), "a scale changes sizes alone"
        copies = type(api.copies)(self.device)
        copies.also = api.copies.also
        api.copies = copies
        self._renew()
        api.follow(self._plan, graph, self._settings, lender.parts["executor"].images)
        self.graph, self.graph_work = graph, graph.counts()

    def _undo(self, parked: Prepared) -> None:
        """Free what a failed `_prepare` has made, and draw a parked frame again."""
        failed = self._park(parked)
        failed.parts["copies"].close()
        self._free_renewed(failed)
        self._frames.discard(failed.recordings)
        self._resume(parked)

    def _renew(self) -> None:
        """Make what else a prepared frame has of its own."""

    def _drop(self, with_histories: bool = False) -> None:
        """Free all prepared frames but the current one, which then owns the histories, unless they are freed, too."""
        if self._prepared:
            self._wait()
        for prepared in self._prepared.values():
            if not with_histories:
                self._api.executor.images.own(prepared.parts["executor"].images)
            self._frames.discard(prepared.recordings)
            for name in ("copies", "inspection", "executor"):
                prepared.parts[name].close()
            self._free_renewed(prepared)
        self._prepared = {}

    def _wait(self) -> None:
        """Wait until nothing uses images: a window may still copy from one."""

    def _free_renewed(self, prepared: Prepared) -> None:
        """Free what `_renew` made."""

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

    def _create_targets(self) -> None:
        self._drop(with_histories=True)  # those of another size
        self._use(self._number)
        super()._create_targets()
        self._valid_until = self._frames.forgotten

    def _rebuild(self) -> None:
        super()._rebuild()
        self._drop()
        self._valid_until = self._frames.forgotten

    def _object_counts(self) -> dict[str, int]:
        own = {
            "scale_number": self._number,
            "scale_percent": round(100 * SCALES[self._number]),
            "scales_prepared": len(self._prepared) + 1,
            "scales_made": self._made + 1,
            "scale_changes": self._changes,
        }
        return super()._object_counts() | own

    def _free(self) -> None:
        self._drop()
        super()._free()
