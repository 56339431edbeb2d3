"""A frame, from top to bottom.

    update     constants, instances and lights go into this frame's slot, textures that have arrived into theirs
    forward    every object is drawn once and lit while it is drawn     -> color_hdr, depth
    instance   which object is where, if somebody asks                  -> instance_id
    resolve    with several samples a pixel: one colour from theirs     -> color_hdr
    tonemap    light becomes a picture                                  -> color
    copy       the outputs that were asked for go to the CPU

Between the passes stand barriers, written by hand here: an image must be finished as a target before it is read.
"""

from __future__ import annotations

import time as clock
import weakref
from collections.abc import Collection, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from backends.contract import Reloaded, check_arguments, check_moment, check_names, check_size, resolve
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.device import Device
from backends.vulkan.inspection import Inspection
from backends.vulkan.instance import Instance
from backends.vulkan.readback import TO_HOST, Readback
from backends.vulkan.resources import Image
from common.errors import ShaderError, StaleFrameError
from common.scene import Sampler, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View, exposure

from . import LESSON
from .environment.model import files_at_start
from .frames.frame import OUTPUTS, SLOTS, SOURCES, Frame, check_outputs, output_of, reset_by
from .frames.recording.vulkan_secondaries import open_commands
from .frames.stream import FrameStream
from .frames.vulkan import Frames, FrameSlot
from .frames.vulkan_commands import Rendering
from .frames.vulkan_profiler import Profiler
from .frames.vulkan_resources import Resources, offered_samples
from .loading.loading import Loading
from .loading.vulkan_first_uses import rehearse
from .pipelines.vulkan import Pipelines
from .pipelines.vulkan_cache import PipelineCache
from .pipelines.vulkan_descriptors import Descriptors, Sets, Texture
from .pipelines.vulkan_layouts import CAPACITY, SetLayout
from .post.vulkan_resolve import ResolvePass
from .post.vulkan_tonemap import TonemapPass
from .scene.constants import frame_constants
from .scene.default_light import DefaultLight
from .scene.vulkan_data import SceneData
from .settings import Settings
from .shading.samples import choose_samples
from .shading.views import shown_exposure
from .shading.vulkan_forward import ForwardPass
from .shading.vulkan_instance_id import InstanceIdPass
from .tasks.workers import ALONE, Workers


class Renderer(FrameStream):
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
        self._frames = Frames(device)
        self._resources = Resources(device)
        self._descriptors = Descriptors(device)
        self._profiler = Profiler(device)
        self._begin_stream()
        self._workers = Workers(settings.recording_threads)
        multi_draw = self.plan.native("multi-draw")
        self._commands = open_commands(device, self._frames, self._workers, multi_draw, settings)
        anisotropy = settings.anisotropy if self.plan.native("anisotropy") else 1.0
        bindless = self.plan.native("bindless")
        self._data = SceneData(
            device, scene, settings, anisotropy, self._resources, self._descriptors, bindless, self._loading
        )
        rehearse(self._loading, device, self._frames.slots, self._data, evaluate_pose(scene, 0.0))
        self._cache = PipelineCache.on_disk(device)
        self._pipelines = Pipelines(device, self._cache, self._data.slot_count or CAPACITY)
        self._forward = ForwardPass(scene, settings, self._data, self._pipelines)
        self._instance_id = InstanceIdPass(self._forward, self._data, self._pipelines)
        self._resolve = ResolvePass(settings, self._pipelines)
        self._tonemap = TonemapPass(settings, self._pipelines)
        self.passes: list[Any] = [self._forward]
        asked = {access.resource for access in self._instance_id.writes} & set(self.outputs)
        if asked and InstanceIdPass.needed(scene, settings):
            self.passes.append(self._instance_id)
        if {"color", "color_hdr"} & self._handed_on and ResolvePass.needed(scene, settings):
            self.passes.append(self._resolve)
        if "color" in self._handed_on:
            self.passes.append(self._tonemap)
        for made in self.passes:
            made.create()
        self._make_sets()
        self._create_targets()

    def _make_sets(self) -> None:
        """Make the scene's descriptor sets, by the layouts that its pipelines' shaders told.

        One set serves them all. A pipeline that was made later than the others, from a file that was edited into
        another layout and refused for those, would read it wrongly.
        """
        layouts: dict[int, SetLayout] = {}
        for pipeline in (*self._forward.built, *self._instance_id.built):
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
        self._targets: dict[str, Image] = {}
        self._target_handles = []
        self._source_sets: list[Sets] = []
        for made in self.passes:
            for access in made.writes:
                handle = self._resources.target(access, self.size)
                self._target_handles.append(handle)
                self._targets[access.resource] = self._resources.images.get(handle)
        target = self._targets
        color, depth = (access.resource for access in self._forward.writes)
        grey = self._forward.writes[0].clear
        self._forward_rendering = Rendering(self.size, target[color], target[depth], grey, 0.0)
        self._to_forward = barriers(self._start(color, "color"), self._start(depth, "depth"))
        if self._instance_id in self.passes:
            own_depth = depth != "depth"
            self._id_rendering = Rendering(
                self.size, target["instance_id"], target["depth"], (0, 0, 0, 0), 0.0 if own_depth else None
            )
            self._to_id = barriers(
                self._start("instance_id", "color"),
                self._start("depth", "depth")
                if own_depth
                else image_barrier(target["depth"].handle, target["depth"].aspect, "depth", "depth"),
            )
        if self._resolve in self.passes:
            self._resolve_rendering = Rendering(self.size, target["color_hdr"], None)
            many = target[color]
            self._to_resolve = barriers(
                image_barrier(many.handle, many.aspect, "color", "sampled"), self._start("color_hdr", "color")
            )
            self._resolve.source_set = self._source(self._resolve, many)
        if self._tonemap in self.passes:
            self._tonemap_rendering = Rendering(self.size, target["color"], None)
            hdr = target["color_hdr"]
            self._to_tonemap = barriers(
                image_barrier(hdr.handle, hdr.aspect, "color", "sampled"), self._start("color", "color")
            )
            self._tonemap.source_set = self._source(self._tonemap, hdr)
        self._create_readbacks()

    def _source(self, made: ResolvePass | TonemapPass, image: Image) -> Any:
        """Return an array of one set, through which a full-screen pass reads a target texel by texel."""
        nearest = Sampler("nearest", "nearest", None, "clamp", "clamp")
        texture = Texture(image.view, self._resources.sampler(nearest, 1.0))
        layout, name = made.pipeline.sets[0], f"{made.name} source"
        assert layout is not None, "a full-screen pass reads its source"
        self._source_sets.append(self._descriptors.create([(layout, {0: texture}, name)]))
        return vk.array("VkDescriptorSet", self._source_sets[-1].handles)

    def _used_last(self, name: str) -> str:
        """Return the state in which the passes leave target `name`."""
        readers = {"color_hdr": self._tonemap, "color_msaa": self._resolve}
        if readers.get(name) in self.passes:
            return "sampled"
        return "depth" if name.startswith("depth") else "color"

    def _start(self, name: str, state: str) -> Any:
        """Return the barrier that begins a target's frame: its content is given up, its last user waited for."""
        image = self._targets[name]
        last = "copy_source" if name in self._handed_on else self._used_last(name)
        return image_barrier(image.handle, image.aspect, last, state, discard=True)

    def _create_readbacks(self) -> None:
        target = self._targets
        available = [name for name in self.outputs if SOURCES[name] in target]
        handed_on = [image for name, image in target.items() if name in self._handed_on]
        self._to_copy = barriers(
            *(image_barrier(i.handle, i.aspect, self._used_last(i.name), "copy_source") for i in handed_on)
        )
        self._to_host = barriers(memory=TO_HOST)
        self._readbacks = [
            {name: Readback(self.device, target[SOURCES[name]], f"{name}, slot {slot}") for name in available}
            for slot in range(SLOTS)
        ]
        self.inspection = Inspection(self.device, self.passes if self._inspects else [], target, SLOTS)

    def _destroy_targets(self) -> None:
        self.device.wait_idle()  # for the frames, and for what a window still copies from them
        self._let_go("the size of the picture has changed since")
        for slot in self._readbacks:
            for readback in slot.values():
                readback.close()
        self._readbacks = []
        self.inspection.close()
        for handle in self._target_handles:
            self._resources.destroy_image(handle)
        self._target_handles = []
        self._resources.flush()  # however often the size changes before the next frame, there is one set of targets
        for sets in self._source_sets:
            self._descriptors.destroy(sets)

    # --- every frame ---

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for but the slot's last frame."""
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        check_moment(view, time)
        started = clock.perf_counter()
        slot = self._frames.begin()
        last = self._in_slot[slot.index]()
        if last is not None:
            last.let_go(f"its slot was used again by frame {slot.number}")
        self._resources.collect(slot.number)
        frame = Frame(self, slot, self._index, shown_exposure(self.settings, view))
        self._in_slot[slot.index] = weakref.ref(frame)
        commands = self._commands
        commands.begin(slot)
        self._profiler.begin_frame(slot)

        frame.reset = self._reset or reset_by(view, time, self._previous)
        written = self._update(slot, view, time, frame.reset)

        commands.barrier(self._to_forward)
        self._run(self._forward, self._forward_rendering)
        if self._instance_id in self.passes:
            commands.barrier(self._to_id)
            self._run(self._instance_id, self._id_rendering)
        if self._resolve in self.passes:
            commands.barrier(self._to_resolve)
            self._run(self._resolve, self._resolve_rendering)
        if self._tonemap in self.passes:
            commands.barrier(self._to_tonemap)
            self._run(self._tonemap, self._tonemap_rendering)
        self._copy_outputs(slot)

        self._frames.submit(slot)
        frame.work = self._count(commands.work, written) | {"history_resets": int(frame.reset != "")}
        self._index += 1
        self._reset = ""
        self._previous = view, time
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _update(self, slot: FrameSlot, view: View, time: float, reset: str) -> int:
        """Write what this frame's shaders read; return the bytes written."""
        scene = self.scene
        if self._data.follow_materials():
            for made in (self._forward, self._instance_id):
                if made in self.passes:
                    made.create()
            self._make_sets()
            self._data.followed()
        previous = self._previous
        if reset:  # then the frame before says nothing: neither where the camera was nor where objects were
            previous = None
            self._data.records.forget_pose()
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
        self._data.write_frame(slot.index, constants)
        written = constants.nbytes + self._data.records.write(
            self._data.slots[slot.index], pose, exposure(view.ev100)
        )
        written += self._data.record_deformation(slot.commands, slot.index, pose)
        written += self._forward.prepare(slot.index, view)
        self._data.update_textures(slot.index, view)
        self._last = self._state(view, time)
        return written

    def _run(self, made: Any, rendering: Rendering) -> None:
        """Record one pass between its label, its timestamps and its attachments."""
        commands = self._commands
        commands.begin_label(made.name)
        self._profiler.begin(commands.slot, made.name)
        commands.begin_rendering(rendering)
        made.record(commands)
        commands.end_rendering()
        self._profiler.end(commands.slot)
        commands.end_label()
        self.inspection.record(commands.handle, commands.slot.index, made, commands.work)

    def _copy_outputs(self, slot: FrameSlot) -> None:
        if self._handed_on:
            self._commands.begin_label("copy outputs")
            self._commands.barrier(self._to_copy)
            for readback in self._readbacks[slot.index].values():
                readback.record(slot.commands)
            self._commands.barrier(self._to_host)
            self._commands.end_label()

    def _count(self, work: dict[str, int], written: int) -> dict[str, int]:
        return {
            **(ALONE | work | self._data.texture_work),
            "passes": len(self.passes),
            "passes_skipped": 4 - len(self.passes),
            "samples": self.samples,
            "instances": self._forward.visible,
            "lights": len(self.scene.lights) if self._data.lit else 0,
            "bytes_written": written,
            "pipelines": len(self._pipelines),
            "descriptor_sets": self._descriptors.set_count + self._data.bindless_sets,
            "samplers": self._resources.counts["samplers"],
        }

    # --- reading ---

    @property
    def present_source(self) -> Image:
        """The finished picture on the GPU, for a window to copy from; see `backends.contract.Renderer`."""
        if "color" not in self._handed_on:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self._targets["color"]

    def read(self, slot: FrameSlot, name: str, exposed: float) -> np.ndarray:
        """Return an output of the slot's frame; see `Frame.image`."""
        inspected = self.inspection.readbacks[slot.index]
        check_outputs((*self.outputs, *inspected), OUTPUTS, name)
        self._frames.wait(slot)
        readback = (self._readbacks[slot.index] | inspected).get(name)
        if readback is None:  # an empty scene has no instances, and so no pass that would draw them
            return np.zeros(self.size[::-1], np.uint32 if name == "instance_id" else np.float32)
        return output_of(name, readback.read(), exposed)

    def read_timings(self, slot: FrameSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self._frames.wait(slot)
        return self._profiler.read(slot)

    # --- life ---

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels."""
        size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        if size == self.size:
            return
        self._destroy_targets()
        self.size = size
        self._create_targets()
        self.reset_history(self._reset or "resize")

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files; view, time and the number of the frame go on."""
        rebuilt = self._pipelines.reload(changed, self._resources.defer)
        if rebuilt:
            self._last = None  # the same view makes another picture now
        return Reloaded(rebuilt, files_at_start(self.scene, self.settings).intersection(changed))

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self.device.wait_idle()
        if hasattr(self, "_readbacks"):  # else it was never whole, and there are no frames
            self._let_go("its renderer was closed")
        for readbacks in getattr(self, "_readbacks", []):
            for readback in readbacks.values():
                readback.close()
        for name in (
            *("_workers", "_loading", "inspection"),
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
