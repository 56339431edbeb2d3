"""A frame, from top to bottom, on either API.

    update     constants, instances and lights go into this frame's slot, textures that have arrived into theirs; then
               each subject in TECHNIQUES prepares what it does (`frames/stream.py`)
    passes     what the graph says, in its order (graph/*.json). Deferred: gbuffer, lighting, transparent -> color_hdr,
               depth; forward: the one pass of that name, and resolve with several samples a pixel. Then three for a
               lens -> color_focused; tonemap -> color; and instance_id, if somebody asks
    copy       the outputs that were asked for go to the CPU

Which passes there are, in which order, and what stands between them, follows from what they declare: the frame is a
graph (graph/frame_graph.py), compiled when its structure changes. It is recorded once for each slot and submitted again
while the recording is good, so that a frame in which only the camera moves costs a few writes and one call.

What differs between the APIs is behind `frames/backend.py`.
"""

from __future__ import annotations

import time as clock
import weakref
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

from backends.contract import Reloaded
from common.errors import StaleFrameError
from common.view.camera import View

from .frames.frame import SOURCES, Frame, reset_by
from .graph.file import graph_path, read_graph
from .graph.passes import make_passes
from .graph.plan import FramePlan, check_samples, graph_name
from .graph.stream import GraphStream
from .scene.pass_parts import PassParts
from .scene.scene_draws import SceneDrawLists
from .shading.views import shown_exposure


class Renderer(GraphStream):
    """The chapter: one stream of frames of one view of one scene."""

    TECHNIQUES = ()
    """What each subject does outside its passes. A lesson adds a folder, and one line here."""

    # --- made once ---

    def _create(self) -> None:
        scene, api = self.scene, self._api
        self._settings = settings = replace(self.settings, msaa=self.samples)
        api.create(scene, settings, self.plan, self._loading, self._pose(0.0))
        self._data, self._pipelines, self._frames = api.data, api.pipelines, api.frames
        self._begin_stream()
        self._draws = SceneDrawLists(scene, self._data, api.by_address)
        self._parts = PassParts(scene, settings, self._data, self._draws, self._pipelines)
        passes = make_passes(self._parts)
        for technique in self.techniques.values():
            technique.create(self._parts, api, dict(passes))
            passes |= technique.passes
        file = read_graph(graph_path(graph_name(settings)))
        check_samples(file, settings)
        outputs = {name: SOURCES[name] for name in self.outputs}
        self._plan_frame(FramePlan(file, passes, outputs, self._handed_on, api.formats))
        self._plan.keeps_all = self._inspects
        for technique in self.techniques.values():
            for name in technique.passes.keys() - set(file.passes.values()):
                self._plan.insert(technique.passes[name], technique.readers)
        self._create_targets()

    # --- every frame ---

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for but the slot's last frame."""
        self._check_frame(view, time)
        started = clock.perf_counter()
        self._api.enter()
        self._follow_needs()
        slot = self._frames.begin()
        self._use_again(slot)
        self._api.begin(slot)
        frame = Frame(self, slot, self._index, shown_exposure(self.settings, view))

        frame.reset = self._reset or reset_by(view, time, self._previous)
        written = self._update(slot, view, time, frame.reset)

        self._recorded = self._api.record(slot, self.settings.resubmit)

        self._frames.submit(slot)
        self._in_slot[slot.index] = weakref.ref(frame)  # not before: a frame that failed has no times to keep
        self._histories.rendered(self.graph, slot.number)
        self._end_frame(frame, view, time, slot.work, written)
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _made(self) -> dict[str, int]:
        return {**self.graph_work, **self._api.counts, "recorded": int(self._recorded)}

    # --- reading ---

    @property
    def present_source(self) -> Any:
        """The finished picture on the GPU, for a window to copy from; see `backends.contract.Renderer`."""
        if "color" not in self._handed_on:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self._api.picture(self.graph)

    @property
    def inspection(self) -> Any:
        """The counters of each pass of the last frame; see `backends.contract.Renderer`."""
        return self._api.inspection

    def read_timings(self, slot: Any) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self._api.enter()
        self._frames.wait(slot)
        return self._api.timings(slot)

    # --- life ---

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files; view, time and the number of the frame go on."""
        self._api.enter()
        graph = self._reload_graph(changed)
        rebuilt = self._api.reload(changed)
        if rebuilt:
            self._frames.forget()
        return replace(self._reloaded(rebuilt, changed), graph=graph)

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self._api.enter()
        if self._api.executor is not None:  # else it was never whole, and there are no frames
            self._let_go("its renderer was closed")
        self._loading.close()
        for technique in self.techniques.values():
            technique.close()
        self._api.close()
