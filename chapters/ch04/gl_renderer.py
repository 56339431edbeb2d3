"""A frame on OpenGL, from top to bottom; compare ../renderer.py.

    update     constants, instances and lights of this frame are written into its slot
    passes     what the graph says, in its order (graph/*.json). Deferred: gbuffer, lighting, transparent -> color_hdr,
               depth; forward: the one pass of that name, and resolve with several samples a pixel. Then three for a
               lens -> color_focused; tonemap -> color; and instance_id, if somebody asks
    copy       the outputs that were asked for go to the CPU

The driver finds out by itself that a pass must wait for what it reads. That is comfortable, and it is work that the
driver does for each call of each frame: what Vulkan's barriers say once, OpenGL guesses again and again.

Passes and their order come from the graph, as on Vulkan. The calls of a frame are found once for each slot, and made
from a list while they are good.
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
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.resources import FORMATS, sample_counts
from backends.gl.targets import Framebuffer
from common.errors import StaleFrameError
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View, exposure

from . import LESSON
from .environment.model import files_at_start
from .frames.frame import OUTPUTS, SLOTS, SOURCES, Frame, check_outputs, output_of, reset_by
from .frames.gl_outputs import CopyOutputs
from .frames.recording.gl_parts import open_commands
from .frames.recording.gl_recordings import RecordedSlot, Recordings
from .graph.execute.gl import GraphExecutor
from .graph.file import graph_path, read_graph
from .graph.gl_passes import make_passes
from .graph.plan import COPY, FramePlan, check_samples, graph_name
from .graph.stream import GraphStream
from .graph.types import Graph
from .loading.loading import Loading
from .pipelines.gl import Pipelines
from .scene.constants import frame_constants
from .scene.default_light import DefaultLight
from .scene.gl_data import SceneData
from .settings import Settings
from .shading.samples import choose_samples
from .shading.views import shown_exposure
from .tasks.workers import ALONE, Workers


class Renderer(GraphStream):
    """The chapter on OpenGL: one stream of frames of one view of one scene."""

    def __init__(
        self,
        scene: Scene,
        size: tuple[int, int] = (640, 360),
        settings: Settings | None = None,
        without: Iterable[str] = (),
        outputs: Collection[str] = ("color",),
        validate: bool = False,
        device: Context | None = None,
        presents: bool = False,
        inspect: bool = False,
    ) -> None:
        self.settings, outputs = check_arguments(scene, settings, Settings, outputs, OUTPUTS)
        without = check_names(without, "without")
        self._light = DefaultLight(scene, self.settings)
        self.scene = self._light.scene
        self.outputs = tuple(name for name in OUTPUTS if name in outputs or inspect)
        self._inspects = inspect
        # Targets that somebody copies from after the passes: the CPU, or a window.
        self._handed_on = {*(SOURCES[name] for name in self.outputs), *(["color"] if presents else [])}
        self._owned: list[Any] = []
        self._closed = False
        self._loading = Loading.of(self.settings, presents)
        if device is None:
            device = Context(validate, without)
            self._owned.append(device)
        self.device = device
        self.device.make_current()
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
        of_color = sample_counts(self.device, self.settings.color_format)
        return {*of_color} & {*sample_counts(self.device, "d32f")}

    def _create(self) -> None:
        context, scene = self.device, self.scene
        settings = replace(self.settings, msaa=self.samples)
        self._frames: Recordings = Recordings(context)
        self._pipelines = Pipelines(context)
        self._begin_stream()
        anisotropy = settings.anisotropy if self.plan.native("anisotropy") else 1.0
        self._data = SceneData(context, scene, settings, anisotropy, self._loading)
        self._workers = Workers(settings.recording_threads)
        multi_draw = self.plan.native("multi-draw")
        self._commands = open_commands(context, self._pipelines, multi_draw, self._workers, settings)
        file = read_graph(graph_path(graph_name(settings)))
        check_samples(file, settings)
        made = make_passes(scene, settings, self._data, self._pipelines)
        self._forward = made["forward"]
        outputs = {name: SOURCES[name] for name in self.outputs}
        self._plan_frame(FramePlan(file, made, outputs, self._handed_on, FORMATS))
        self._plan.keeps_all = self._inspects
        self._copies = CopyOutputs(context)
        self._created: list[Any] = []
        self._adopt(self._compiled())
        self._create_targets()

    def _compiled(self) -> Graph:
        settings = replace(self.settings, msaa=self.samples)
        return self._plan.compile(self.size, self.scene, settings, alias=settings.alias)

    def _create_passes(self) -> None:
        """Make the pipelines."""
        for made in self.passes:
            made.create()

    def _create_targets(self) -> None:
        """Make everything whose size is the picture's: targets, framebuffers, readback."""
        self._frames.forget()
        self._executor = GraphExecutor(
            self.device,
            self.graph,
            self._plan.implementations() | {COPY: self._copies},
            self._data.sampler,
            partial(self._copies.attach, self.graph),
            self.settings.alias,
            self.settings.poison,
        )
        watched = self._plan.watched(self.graph)
        self.inspection = Inspection(self.device, watched, self._executor.images.by_name(self.graph), SLOTS)

    def _destroy_targets(self) -> None:
        self.device.make_current()
        self._let_go("the size of the picture has changed since")
        self._copies.close()
        self.inspection.close()
        self._executor.close()

    def _begin_change(self) -> None:
        self.device.make_current()

    # --- every frame ---

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for but the slot's last frame."""
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        check_moment(view, time)
        started = clock.perf_counter()
        self.device.make_current()
        self._follow_needs()
        slot = self._frames.begin()
        last = self._in_slot[slot.index]()
        if last is not None:
            last.let_go(f"its slot was used again by frame {slot.number}")
        frame = Frame(self, slot, self._index, shown_exposure(self.settings, view))
        frame.reset = self._reset or reset_by(view, time, self._previous)
        written = self._update(slot, view, time, frame.reset)

        key = self._forward.recorded(slot.index, by_address=True)
        recorded = slot.key != key or not self.settings.resubmit
        if recorded:
            self._record(slot, key)
        self._frames.submit(slot)
        self._in_slot[slot.index] = weakref.ref(frame)  # not before: a frame that failed has no times to keep
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
        scene, data = self.scene, self._data
        if data.follow_materials():
            self._create_passes()
            self._frames.forget()
            data.followed()
        previous = self._previous
        if reset:  # then the frame before says nothing: neither where the camera was nor where objects were
            previous = None
            data.records.forget_pose()
        pose = self._light.pose(evaluate_pose(scene, time), view)
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
        data.write_frame(slot.index, constants)
        written = constants.nbytes + data.records.write(data.slots[slot.index], pose, exposure(view.ev100))
        written += data.write_deformation(slot.index, pose)
        data.update_textures(slot.index, view)
        written += self._forward.prepare(slot.index, view)
        self._last = self._state(view, time)
        return written

    def _record(self, slot: RecordedSlot, key: Any) -> None:
        """Find the calls of a slot's frame; they are made again and again while `key` stays the same."""
        with self._frames.recording(slot, key) as calls:
            self._commands.begin(slot)
            slot.timestamps.begin_frame()
            self._data.bind_frame(slot.index)
            self._executor.record(self._commands, slot.index, calls, self.inspection)
            slot.work = self._commands.work

    def _count(self, work: dict[str, int], written: int) -> dict[str, int]:
        return {
            **(ALONE | work | self._data.texture_work),
            **self.graph_work,
            "samples": self.samples,
            "instances": self._forward.visible,
            "lights": len(self.scene.lights) if self._data.lit else 0,
            "bytes_written": written,
            "pipelines": len(self._pipelines),
            "descriptor_sets": 0,  # OpenGL has none: textures and buffers are bound one by one
            "samplers": self._data.samplers,
        }

    # --- reading ---

    @property
    def present_source(self) -> Framebuffer:
        """The finished picture on the GPU, for a window to copy from; see `backends.contract.Renderer`."""
        if "color" not in self._handed_on:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        assert self._copies.picture is not None, "a picture is handed on"
        return self._copies.picture

    def read(self, slot: RecordedSlot, name: str, exposed: float) -> np.ndarray:
        """Return an output of the slot's frame; see `Frame.image`."""
        inspected = self.inspection.readbacks[slot.index]
        check_outputs((*self.outputs, *inspected), OUTPUTS, name)
        self.device.make_current()
        self._frames.wait(slot)
        readback = (self._copies.readbacks[slot.index] | inspected).get(name)
        if readback is None:  # an empty scene has no instances, and so no pass that would draw them
            return np.zeros(self.size[::-1], np.uint32 if name == "instance_id" else np.float32)
        return output_of(name, readback.read(), exposed)

    def read_timings(self, slot: RecordedSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self.device.make_current()
        self._frames.wait(slot)
        return slot.timestamps.read()

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
        self.device.make_current()
        graph = self._reload_graph(changed)
        rebuilt = self._pipelines.reload(changed)
        if rebuilt:
            self._last = None  # the same view makes another picture now
            self._frames.forget()
        return Reloaded(rebuilt, files_at_start(self.scene, self.settings).intersection(changed), graph)

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self.device.make_current()
        if hasattr(self, "_executor"):  # else it was never whole, and there are no frames
            self._let_go("its renderer was closed")
        for name in (
            "_workers",
            "_loading",
            "inspection",
            "_copies",
            "_executor",
            "_data",
            "_frames",
            "_pipelines",
        ):
            held = getattr(self, name, None)
            if held is not None:
                held.close()
        for owned in reversed(self._owned):
            owned.close()
