"""A frame, from top to bottom, on either API.

    update     write constants, instances and lights into this frame's slot; prepare each technique in TECHNIQUES;
               upload textures that are decoded (`frames/stream.py`)
    passes     record the passes of the graph, in its order (graph/*.json): light_lists, shadows, what culling needs;
               deferred: gbuffer, or visibility and visibility_resolve; ssao; lighting
               forward:  one pass of that name, and resolve with several samples a pixel
               and behind either: transparent, or the passes of layers -> color_hdr, depth; rays over a part of
               it, or paths -> color_traced; motion and taa
               -> history_color; three passes of a lens, exposure and bloom -> color_bloomed; motion_blur and sharpen
               -> color_focused; tonemap, and fxaa -> color; instance_id and motion, if requested
    copy       copy the requested outputs to the CPU

The frame is a graph (graph/frame_graph.py), compiled when its structure changes. The passes, their order and the
barriers between them follow from what the passes declare. The frame is recorded once for each slot and submitted again
while the recording is valid, so a frame in which only the camera moves costs a few writes and one call.

The interface in `frames/backend/backend.py` hides the differences between the APIs.
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
from common.settings import replaced
from common.view.camera import View

from .cloth.technique import ClothTechnique
from .clusters.technique import ClusterTechnique
from .culling.technique import CullingTechnique
from .fog.technique import SHADERS, FogTechnique
from .frames.frame import SOURCES, Frame, reset_by
from .graph.file import graph_path, read_graph
from .graph.passes import make_passes
from .graph.plan import FramePlan, check_samples, graph_name
from .graph.stream import GraphStream
from .hdr.technique import HdrTechnique
from .motion.technique import MotionTechnique
from .paths.technique import PathTechnique
from .rates.native import settled
from .rates.technique import RateTechnique
from .rays.technique import RayTechnique
from .scene.pass_parts import PassParts
from .scene.scene_draws import SceneDrawLists
from .shading.views import shown_exposure
from .shadows.technique import ShadowTechnique
from .taa.technique import TaaTechnique
from .transparency.technique import TransparencyTechnique
from .visibility.technique import VisibilityTechnique


class Renderer(GraphStream):
    """The renderer of the chapter: one stream of frames of one view of one scene."""

    TECHNIQUES = (
        TransparencyTechnique,
        FogTechnique,
        ClusterTechnique,
        CullingTechnique,
        ClothTechnique,
        HdrTechnique,
        VisibilityTechnique,
        ShadowTechnique,
        RateTechnique,
        RayTechnique,
        PathTechnique,
        MotionTechnique,
        TaaTechnique,
    )
    """The work of each subject outside its passes. A lesson adds a folder, and one line here."""

    # --- creation ---

    def _create(self) -> None:
        scene, api = self.scene, self._api
        limits, settings = self.capabilities.limits, replaced(self.settings, msaa=self.samples)
        self._settings = settings = settled(settings, self.plan, limits)
        api.create(scene, settings, self.plan, self._loading, self._pose(0.0))
        self._data, self._pipelines, self._frames = api.data, api.pipelines, api.frames
        self._begin_stream()
        self._draws = SceneDrawLists(scene, self._data, api.by_address)
        self._parts = PassParts(
            scene, settings, self._data, self._draws, self._pipelines, limits, self.outputs
        )
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
        """Enqueue one frame of `view` at `time` seconds; wait only for the last frame of its slot."""
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

        self._recorded = self._api.record(slot, self.settings.graph.resubmit)

        self._frames.submit(slot)
        self._in_slot[slot.index] = weakref.ref(frame)  # after submission: a frame that failed has no timings
        self._histories.rendered(self.graph, slot.number)
        self._end_frame(frame, view, time, slot.work, written)
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _object_counts(self) -> dict[str, int]:
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

    def read_told(self, slot: Any) -> dict[str, int]:
        """Return the counters that the GPU wrote in the slot's frame."""
        telling = [technique for technique in self.techniques.values() if technique.tells]
        if telling:
            self._api.enter()
            self._frames.wait(slot)
        return {name: count for it in telling for name, count in it.told(slot.index).items()}

    # --- lifetime ---

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Rebuild the pipelines that use one of the `changed` files; view, time and frame number continue."""
        self._api.enter()
        graph = self._reload_graph(changed)
        rebuilt = self._api.reload(changed)
        if rebuilt:
            self._frames.forget()
            self.techniques[FogTechnique.name].reset(SHADERS)
        return replace(self._reloaded(rebuilt, changed), graph=graph)

    def _free(self) -> None:
        self._loading.close()
        for technique in self.techniques.values():
            technique.close()
        self._api.close()
