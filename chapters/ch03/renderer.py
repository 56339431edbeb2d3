"""A frame, from top to bottom.

    update     write constants, instances and lights into this frame's slot; upload textures that are decoded
    forward    draw every object once, with lighting                    -> color_hdr, depth
    instance   write the id of the object at each pixel, if requested   -> instance_id
    resolve    combine the samples of each pixel, if there are several  -> color_hdr
    tonemap    convert light to display colours                         -> color
    copy       copy the requested outputs to the CPU

The barriers between the passes are written by hand here: a pass reads an image only after the writes to it are done.
"""

from __future__ import annotations

import time as clock
import weakref
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from backends.contract import Pass, Reloaded
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.device import Device
from backends.vulkan.inspection import Inspection
from backends.vulkan.instance import Instance
from backends.vulkan.readback import TO_HOST, Readback
from backends.vulkan.resources import Image
from common.errors import ShaderError, StaleFrameError
from common.scene import Pose, Sampler
from common.scene.pose import evaluate_pose
from common.view.camera import View

from .frames.frame import SLOTS, SOURCES, Frame, reset_by
from .frames.recording.vulkan_secondaries import open_commands
from .frames.stream import FrameStream
from .frames.vulkan import Frames, FrameSlot
from .frames.vulkan_commands import Rendering
from .frames.vulkan_profiler import Profiler
from .frames.vulkan_resources import Resources, offered_samples
from .loading.vulkan_first_uses import rehearse
from .pipelines.vulkan import Pipelines
from .pipelines.vulkan_cache import PipelineCache
from .pipelines.vulkan_descriptors import Descriptors, Sets, Texture
from .pipelines.vulkan_layouts import CAPACITY, SetLayout
from .post.fullscreen import FullscreenPass
from .scene.vulkan_data import VulkanSceneData
from .shading.views import shown_exposure
from .tasks.workers import Workers


class Renderer(FrameStream):
    """The Vulkan renderer of the chapter: one stream of frames of one view of one scene."""

    PARTS = (
        "_workers",
        "_loading",
        "inspection",
        "_commands",
        "_frames",
        "_profiler",
        "_pipelines",
        "_cache",
        "_data",
        "_resources",
        "_descriptors",
    )

    device: Device
    _data: VulkanSceneData

    # --- creation ---

    def _open_device(self, validate: bool, without: Iterable[str]) -> Device:
        instance = Instance(validate)
        self._owned.append(instance)
        try:
            device = Device(instance, without=without)
        except BaseException:
            instance.close()
            raise
        self._owned.append(device)
        return device

    def _offered(self) -> set[int]:
        return offered_samples(self.device, self.settings.shading.color_format, "d32f")

    def _create(self) -> None:
        device, scene = self.device, self.scene
        settings = self.settings
        self._frames = Frames(device)
        self._resources = Resources(device)
        self._descriptors = Descriptors(device)
        self._profiler = Profiler(device)
        self._begin_stream()
        self._workers = Workers(settings.frames.recording_threads)
        multi_draw = self.plan.native("multi-draw")
        self._commands = open_commands(device, self._frames, self._workers, multi_draw, settings.frames)
        anisotropy = settings.scene.anisotropy if self.plan.native("anisotropy") else 1.0
        bindless = self.plan.native("bindless")
        self._data = VulkanSceneData(
            device, scene, settings, anisotropy, self._resources, self._descriptors, bindless, self._loading
        )
        rehearse(self._loading, device, self._frames.slots, self._data, evaluate_pose(scene, 0.0))
        self._cache = PipelineCache.on_disk(device)
        self._pipelines = Pipelines(device, self._cache, self._data.slot_count or CAPACITY)
        self._make_passes()
        self._create_targets()

    def _make_sets(self) -> None:
        """Create the scene's descriptor sets, which all pipelines share; ShaderError if their layouts disagree."""
        layouts: dict[int, SetLayout] = {}
        for pipeline in (
            entry for gpu_pass in self.passes if gpu_pass.sources is None for entry in gpu_pass.pipelines
        ):
            for number, entry in enumerate(pipeline.sets):
                if entry is not None and layouts.setdefault(number, entry).handle != entry.handle:
                    raise ShaderError(
                        f"The shaders of the scene disagree about set {number}: a file that a new pipeline needs was "
                        "edited into other bindings; mend it, and open the scene again.",
                        pipeline.code.files,
                    )
        self._data.make_sets(layouts)

    def _create_targets(self) -> None:
        """Create everything that depends on the picture size: targets, attachments, barriers, readbacks."""
        self._targets: dict[str, Image] = {}
        self._target_handles = []
        self._source_sets: list[Sets] = []
        self._sources: dict[str, Any] = {}
        for gpu_pass in self.passes:
            for access in gpu_pass.writes:
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
            msaa = target[color]
            self._to_resolve = barriers(
                image_barrier(msaa.handle, msaa.aspect, "color", "sampled"), self._start("color_hdr", "color")
            )
            self._sources["resolve"] = self._source(self._resolve, msaa)
        if self._tonemap in self.passes:
            self._tonemap_rendering = Rendering(self.size, target["color"], None)
            hdr = target["color_hdr"]
            self._to_tonemap = barriers(
                image_barrier(hdr.handle, hdr.aspect, "color", "sampled"), self._start("color", "color")
            )
            self._sources["tonemap"] = self._source(self._tonemap, hdr)
        self._create_readbacks()

    def _source(self, gpu_pass: FullscreenPass, image: Image) -> Any:
        """Return an array of one descriptor set, with which a full-screen pass fetches texels of a target."""
        nearest = Sampler("nearest", "nearest", None, "clamp", "clamp")
        texture = Texture(image.view, self._resources.sampler(nearest, 1.0))
        layout, name = gpu_pass.pipelines[0].sets[0], f"{gpu_pass.name} source"
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
        """Return the barrier before a target's first use: it waits for the last use and discards the content."""
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
        self.inspection = Inspection(self.device, self.passes if self._inspects else [], [target] * SLOTS)

    def _destroy_targets(self) -> None:
        self.device.wait_idle()  # a window may still copy from a target
        for slot in self._readbacks:
            for readback in slot.values():
                readback.close()
        self._readbacks = []
        self.inspection.close()
        for handle in self._target_handles:
            self._resources.destroy_image(handle)
        self._target_handles = []
        self._resources.flush()  # now: several changes of size before the next frame keep only one set of targets
        for sets in self._source_sets:
            self._descriptors.destroy(sets)

    # --- every frame ---

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; wait only for the last frame of its slot."""
        self._check_frame(view, time)
        started = clock.perf_counter()
        slot = self._frames.begin()
        self._use_again(slot)
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
        self._end_frame(frame, view, time, commands.work, written)
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _deform(self, slot: FrameSlot, pose: Pose) -> int:
        return self._data.record_deformation(slot.commands, slot.index, pose)

    def _run(self, gpu_pass: Pass, rendering: Rendering) -> None:
        """Record one pass, with its label, its timestamps and its attachments."""
        commands = self._commands
        commands.sources = self._sources.get(gpu_pass.name)
        commands.begin_label(gpu_pass.name)
        self._profiler.begin(commands.slot, gpu_pass.name)
        commands.begin_rendering(rendering)
        gpu_pass.record(commands)
        commands.end_rendering()
        self._profiler.end(commands.slot)
        commands.end_label()
        self.inspection.record(commands.handle, commands.slot.index, gpu_pass, commands.work)

    def _copy_outputs(self, slot: FrameSlot) -> None:
        if self._handed_on:
            self._commands.begin_label("copy outputs")
            self._commands.barrier(self._to_copy)
            for readback in self._readbacks[slot.index].values():
                readback.record(slot.commands)
            self._commands.barrier(self._to_host)
            self._commands.end_label()

    def _object_counts(self) -> dict[str, int]:
        return {
            "descriptor_sets": self._descriptors.set_count + self._data.bindless_sets,
            "textures": self._data.textures,
            "samplers": self._resources.counts["samplers"],
        }

    # --- reading ---

    @property
    def present_source(self) -> Image:
        """The finished picture on the GPU, for a window to copy from; see `backends.contract.Renderer`."""
        if "color" not in self._handed_on:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self._targets["color"]

    def read_timings(self, slot: FrameSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self._frames.wait(slot)
        return self._profiler.read(slot)

    # --- lifetime ---

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Rebuild the pipelines that use one of the `changed` files; view, time and frame number continue."""
        rebuilt = self._pipelines.reload(changed, self._resources.defer)
        return self._reloaded(rebuilt, changed)

    def _free(self) -> None:
        self.device.wait_idle()
        for readbacks in getattr(self, "_readbacks", []):
            for readback in readbacks.values():
                readback.close()
