"""A frame, from top to bottom.

    update     constants, instances and lights go into this frame's slot, textures that have arrived into theirs
    cloth      steps that have become due, as compute: beside the frame before, where there is a queue for it
    passes     what the graph says, in its order (graph/*.json). Deferred: gbuffer, lighting, transparent -> color_hdr,
               depth; forward: the one pass of that name, and resolve with several samples a pixel. Then three for a
               lens -> color_focused; tonemap -> color; and instance_id, if somebody asks
    copy       the outputs that were asked for go to the CPU

Which passes there are, in which order, and what stands between them, follows from what they declare: the frame is a
graph (graph/frame_graph.py), compiled when its structure changes. It is recorded once for each slot and submitted again
while the recording is good, so that a frame in which only the camera moves costs a few writes and one call.
"""

from __future__ import annotations

import time as clock
import weakref
from collections.abc import Collection, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from backends.contract import Reloaded, check_arguments, check_moment, check_names, check_size, resolve
from backends.vulkan.device import Device
from backends.vulkan.inspection import Inspection
from backends.vulkan.instance import Instance
from backends.vulkan.resources import FORMATS, Image
from common.errors import ShaderError, StaleFrameError
from common.scene import Scene
from common.view.camera import View, exposure

from . import LESSON
from .cloth.scene import cloth_scene
from .cloth.vulkan import ClothPass
from .environment.model import files_at_start
from .frames.frame import OUTPUTS, SLOTS, SOURCES, Frame, check_outputs, output_of, reset_by
from .frames.queues.vulkan_queues import Queues
from .frames.queues.vulkan_submission import QueueFrames
from .frames.recording.vulkan_recordings import RecordedSlot
from .frames.recording.vulkan_secondaries import open_commands
from .frames.vulkan_outputs import CopyOutputs
from .frames.vulkan_profiler import Profiler
from .frames.vulkan_resources import Resources, offered_samples
from .graph.execute.vulkan import GraphExecutor
from .graph.file import graph_path, read_graph
from .graph.memory.vulkan_images import GraphMemory
from .graph.plan import COPY, FramePlan, check_samples, graph_name
from .graph.stream import GraphStream
from .graph.sync.queues import QUEUES
from .graph.types import Graph
from .graph.vulkan_passes import make_passes
from .loading.loading import Loading
from .loading.vulkan_first_uses import rehearse
from .pipelines.vulkan import Pipelines
from .pipelines.vulkan_cache import PipelineCache
from .pipelines.vulkan_descriptors import Descriptors
from .pipelines.vulkan_layouts import CAPACITY, SetLayout
from .scene.constants import frame_constants
from .scene.default_light import DefaultLight
from .scene.vulkan_data import SceneData
from .settings import Settings
from .shading.samples import choose_samples
from .shading.views import shown_exposure
from .tasks.workers import ALONE, Workers


class Renderer(GraphStream):
    """The chapter on Vulkan: one stream of frames of one view of one scene."""

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Settings | None = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        validate: bool = False,
        device: Device | None = None,
        presents: bool = False,
        inspect: bool = False,
    ) -> None:
        self.settings, outputs = check_arguments(scene, settings, Settings, outputs, OUTPUTS)
        without = check_names(without, "without")
        self._cloths = cloth_scene(scene, self.settings.cloth)
        self._light = DefaultLight(self._cloths.scene, self.settings)
        self.scene = self._light.scene
        self.outputs = tuple(name for name in OUTPUTS if name in outputs or inspect)
        self._inspects = inspect
        # Targets that somebody copies from after the passes: the CPU, or a window.
        self._handed_on = {*(SOURCES[name] for name in self.outputs), *(["color"] if presents else [])}
        self._owned: list[Any] = []
        self._closed = False
        self._loading = Loading.of(self.settings, presents)
        if device is None:
            instance = Instance(validate)
            self._owned.append(instance)
            try:
                device = Device(instance, without=without)
            except BaseException:
                instance.close()
                raise
            self._owned.append(device)
        self.device = device
        self.capabilities = device.capabilities
        off = {*without, *device.without}
        self.plan = resolve(LESSON.needs.required, LESSON.needs.optional, self.capabilities, off)
        self.size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        try:
            self._choose_samples()
            self._create()
        except BaseException:
            self.close()
            raise

    # --- made once ---

    def _choose_samples(self) -> None:
        self.samples, short = choose_samples(self.settings, self._offered(), self.capabilities.device)
        if short:
            self.plan = self.plan.falling_short("msaa", f"{self.samples} samples a pixel", short)

    def _offered(self) -> set[int]:
        """Return how many samples a pixel of both targets of the forward pass can have."""
        return offered_samples(self.device, self.settings.color_format, "d32f")

    def _create(self) -> None:
        device, scene = self.device, self.scene
        settings = replace(self.settings, msaa=self.samples)
        self._queues = Queues(device, self.plan.native("async-compute") and settings.async_compute)
        self._frames = QueueFrames(device, self._queues)
        self._resources = Resources(device, self._queues.families)
        self._descriptors = Descriptors(device)
        self._profiler = Profiler(device)
        self._begin_stream()
        self._workers = Workers(settings.recording_threads)
        self._by_address = multi_draw = self.plan.native("multi-draw")
        self._commands = open_commands(device, self._frames, self._workers, multi_draw, settings)
        anisotropy = settings.anisotropy if self.plan.native("anisotropy") else 1.0
        bindless = self.plan.native("bindless")
        self._data = SceneData(
            device, scene, settings, anisotropy, self._resources, self._descriptors, bindless, self._loading
        )
        rehearse(self._loading, device, self._frames.slots, self._data, self._cloths.pose(0.0))
        self._cache = PipelineCache.on_disk(device)
        self._pipelines = Pipelines(device, self._cache, self._data.slot_count or CAPACITY)
        file = read_graph(graph_path(graph_name(settings)))
        check_samples(file, settings)
        made = make_passes(scene, settings, self._data, self._pipelines)
        self._forward = made["forward"]
        parts = (self._data, self._pipelines, device, self._resources, self._descriptors)
        self._cloth = made["cloth"] = ClothPass(self._cloths, self.settings, *parts)
        self._cloth.add_to(made)
        outputs = {name: SOURCES[name] for name in self.outputs}
        self._plan_frame(FramePlan(file, made, outputs, self._handed_on, FORMATS))
        self._plan.keeps_all = self._inspects
        poisoned = ["copy_target"] * (settings.poison != "off")
        self._memory = GraphMemory(device, poisoned, self._queues.families)
        self._copies = CopyOutputs(device)
        self._created: list[Any] = []
        self._adopt(self._compiled())
        self._create_targets()

    def _compiled(self) -> Graph:
        settings = replace(self.settings, msaa=self.samples)
        needs = self._memory.requirement
        return self._plan.compile(self.size, self.scene, settings, needs, settings.alias, QUEUES)

    def _create_passes(self) -> None:
        """Make the pipelines, and then the sets of the scene, which all that draw it hold on to."""
        for made in self.passes:
            made.create()
        self._make_sets()

    def _make_sets(self) -> None:
        """Make the scene's descriptor sets, by the layouts that its pipelines' shaders told.

        One set serves them all. A pipeline that was made later than the others, from a file that was edited into
        another layout and refused for those, would read it wrongly.
        """
        layouts: dict[int, SetLayout] = {}
        for pipeline in (one for made in self.passes for one in getattr(made, "built", ())):
            for number, one in enumerate(pipeline.sets):
                if one is not None and layouts.setdefault(number, one).handle != one.handle:
                    raise ShaderError(
                        f"The shaders of the scene disagree about set {number}: a file that a new pipeline needs was "
                        "edited into other bindings; mend it, and open the scene again.",
                        pipeline.stages.files,
                    )
        self._data.make_sets(layouts)

    def _create_targets(self) -> None:
        """Make everything whose size is the picture's: targets, attachments, barriers, readback."""
        self._frames.forget()
        self._histories.forget()
        self._executor = GraphExecutor(
            self.device,
            self.graph,
            self._plan.implementations() | {COPY: self._copies},
            self._memory,
            self._resources,
            self._descriptors,
            partial(self._copies.attach, self.graph),
            self.settings.poison,
            self._queues,
        )
        self._frames.follow(self._executor, self._profiler)
        watched = self._plan.watched(self.graph)
        self.inspection = Inspection(self.device, watched, self._executor.images.by_name(self.graph), SLOTS)

    def _destroy_targets(self) -> None:
        self.device.wait_idle()  # for the frames, and for what a window still copies from them
        self._let_go("the size of the picture has changed since")
        self._copies.close()
        self.inspection.close()
        self._executor.close()
        self._resources.flush()  # however often the size changes before the next frame, there is one set of targets

    # --- every frame ---

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for but the slot's last frame."""
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        check_moment(view, time)
        started = clock.perf_counter()
        self._follow_needs()
        slot = self._frames.begin()
        last = self._in_slot[slot.index]()
        if last is not None:
            last.let_go(f"its slot was used again by frame {slot.number}")
        self._resources.collect(slot.number)
        frame = Frame(self, slot, self._index, shown_exposure(self.settings, view))
        self._in_slot[slot.index] = weakref.ref(frame)
        frame.reset = self._reset or reset_by(view, time, self._previous)
        written = self._update(slot, view, time, frame.reset)

        key = self._forward.recorded(slot.index, self._by_address)
        again = self.settings.resubmit
        recorded = self._frames.record(slot, key, self._commands, self.inspection, again)
        self._frames.submit(slot)
        self._histories.rendered(self.graph, slot.number)
        frame.work = self._count(slot.work, written) | {
            "recorded": int(recorded),
            "history_resets": int(frame.reset != ""),
        }
        self._index += 1
        self._reset = ""
        self._previous = view, time
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _update(self, slot: RecordedSlot, view: View, time: float, reset: str) -> int:
        """Write what this frame's shaders read; return the bytes written."""
        scene = self.scene
        if self._data.follow_materials():
            self._create_passes()
            self._frames.forget()
            self._data.followed()
        previous = self._previous
        if reset:  # then the frame before says nothing: neither where the camera was nor where objects were
            previous = None
            self._data.records.forget_pose()
        posed = self._cloths.pose(time)
        pose = self._light.pose(posed, view)
        constants = frame_constants(
            scene,
            self.size,
            view,
            time,
            previous=previous,
            index=self._index,
            ambient=self._light.ambient(),
            environment=self._data.environment,
        )
        constants["valid_histories"] = self._histories.mask(self.graph, slot.number, reset)
        self._data.write_frame(slot.index, constants)
        written = constants.nbytes + self._data.records.write(
            self._data.slots[slot.index], pose, exposure(view.ev100)
        )
        if scene.deformations:
            written += self._data.record_deformation(self._frames.uploads(slot), slot.index, pose)
        written += self._forward.prepare(slot.index, view)
        written += self._cloth.prepare(slot.index, posed, view, self.size, time, reset, self.passes)
        self._data.update_textures(slot.index, view)
        self._last = self._state(view, time)
        return written

    def _count(self, work: dict[str, int], written: int) -> dict[str, int]:
        return {
            **(ALONE | work | self._data.texture_work),
            **self.graph_work,
            "samples": self.samples,
            "instances": self._forward.visible,
            "lights": len(self.scene.lights) if self._data.lit else 0,
            "bytes_written": written,
            "pipelines": len(self._pipelines),
            "descriptor_sets": self._descriptors.set_count + self._data.bindless_sets,
            "samplers": self._resources.counts["samplers"],
            **(self._cloth.work | self._frames.work),
        }

    # --- reading ---

    @property
    def present_source(self) -> Image:
        """The finished picture on the GPU, for a window to copy from; see `backends.contract.Renderer`."""
        if "color" not in self._handed_on:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self._executor.images.image(0, self.graph.names["color"])

    def read(self, slot: RecordedSlot, name: str, exposed: float) -> np.ndarray:
        """Return an output of the slot's frame; see `Frame.image`."""
        inspected = self.inspection.readbacks[slot.index]
        check_outputs((*self.outputs, *inspected), OUTPUTS, name)
        self._frames.wait(slot)
        readback = (self._copies.readbacks[slot.index] | inspected).get(name)
        if readback is None:  # an empty scene has no instances, and so no pass that would draw them
            return np.zeros(self.size[::-1], np.uint32 if name == "instance_id" else np.float32)
        return output_of(name, readback.read(), exposed)

    def read_timings(self, slot: RecordedSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self._frames.wait(slot)
        return self._frames.timings(slot)

    # --- life ---

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels."""
        size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        if size == self.size or self._closed:
            return
        self._destroy_targets()
        self.size = size
        self._adopt(self._compiled())
        self._create_targets()
        self.reset_history(self._reset or "resize")

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files; view, time and the number of the frame go on."""
        graph = self._reload_graph(changed)
        rebuilt = self._pipelines.reload(changed, self._resources.defer)
        if rebuilt:
            self._last = None  # the same view makes another picture now
            self._frames.forget()
        return Reloaded(rebuilt, files_at_start(self.scene, self.settings).intersection(changed), graph)

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self.device.wait_idle()
        if hasattr(self, "_executor"):  # else it was never whole, and there are no frames
            self._let_go("its renderer was closed")
        for name in (
            *("_workers", "_loading", "inspection"),
            "_copies",
            "_executor",
            "_commands",
            "_frames",
            "_profiler",
            "_pipelines",
            "_cache",
            "_data",
            "_resources",
            "_descriptors",
        ):
            held = getattr(self, name, None)
            if held is not None:
                held.close()
        for owned in reversed(self._owned):
            owned.close()
