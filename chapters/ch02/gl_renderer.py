"""A frame on OpenGL, from top to bottom; compare renderer.py, which lists the same passes.

There are no barriers: the driver finds out itself which draws must wait for which. This is convenient, but the driver
repeats the work for each call of each frame. A Vulkan renderer states each dependency once, as a barrier.
"""

from __future__ import annotations

import time as clock
import weakref
from collections.abc import Collection, Iterable
from pathlib import Path

from backends.contract import Pass, Reloaded
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.readback import Readback
from backends.gl.resources import Image, create_image, destroy_image, sample_counts
from backends.gl.targets import Framebuffer, create_framebuffer, destroy_framebuffer
from common.errors import StaleFrameError
from common.scene import Pose, Sampler
from common.view.camera import View

from .frames.frame import SLOTS, SOURCES, Frame, reset_by
from .frames.gl import Frames, FrameSlot
from .frames.gl_commands import Commands, Rendering, Textures
from .frames.stream import FrameStream
from .pipelines.gl import Pipelines
from .scene.gl_data import GlSceneData
from .shading.views import shown_exposure


class Renderer(FrameStream):
    """The OpenGL renderer of the chapter: one stream of frames of one view of one scene."""

    PARTS = ("_data", "_frames", "_pipelines")

    device: Context
    _data: GlSceneData

    # --- creation ---

    def _open_device(self, validate: bool, without: Iterable[str]) -> Context:
        context = Context(validate, without)
        self._owned.append(context)
        return context

    def _offered(self) -> set[int]:
        of_color = sample_counts(self.device, self.settings.shading.color_format)
        return {*of_color} & {*sample_counts(self.device, "d32f")}

    def _create(self) -> None:
        context, scene = self.device, self.scene
        settings = self.settings
        self._frames = Frames(context)
        self._pipelines = Pipelines(context)
        self._begin_stream()
        anisotropy = settings.scene.anisotropy if self.plan.native("anisotropy") else 1.0
        self._data = GlSceneData(context, scene, settings, anisotropy)
        multi_draw = self.plan.native("multi-draw")
        self._commands = Commands(context, self._pipelines, multi_draw)
        self._make_passes()
        self._create_targets()

    def _create_targets(self) -> None:
        """Create everything that depends on the picture size: targets, framebuffers, readbacks."""
        context = self.device
        self._targets: dict[str, Image] = {}
        for gpu_pass in self.passes:
            for access in gpu_pass.writes:
                image = create_image(
                    context, str(access.format), self.size, access.resource, samples=access.samples
                )
                self._targets[access.resource] = image
        target = self._targets
        self._framebuffers: list[Framebuffer] = []
        self._sources: dict[str, Textures] = {}
        color, depth = (access.resource for access in self._forward.writes)
        grey = self._forward.writes[0].clear
        forward = self._framebuffer([target[color]], target[depth], "forward")
        self._forward_rendering = Rendering(forward, grey, 0.0)
        if self._instance_id in self.passes:
            framebuffer = self._framebuffer([target["instance_id"]], target["depth"], "instance_id")
            self._id_rendering = Rendering(framebuffer, (0, 0, 0, 0), None if depth == "depth" else 0.0)
        if self._resolve in self.passes:
            self._resolve_rendering = Rendering(self._framebuffer([target["color_hdr"]], None, "resolve"))
            self._sources["resolve"] = self._source(target[color])
        if self._tonemap in self.passes:
            self._picture = self._framebuffer([target["color"]], None, "tonemap")
            self._tonemap_rendering = Rendering(self._picture)
            self._sources["tonemap"] = self._source(target["color_hdr"])
        available = [name for name in self.outputs if SOURCES[name] in target]
        self._readbacks = [
            {name: Readback(context, target[SOURCES[name]], f"{name}, slot {slot}") for name in available}
            for slot in range(SLOTS)
        ]
        watched = self.passes if self._inspects else []
        self.inspection = Inspection(context, watched, [target] * SLOTS)

    def _source(self, image: Image) -> Textures:
        """Return the texture binding with which a full-screen pass fetches texels of a target."""
        nearest = self._data.sampler(Sampler("nearest", "nearest", None, "clamp", "clamp"), 1.0)
        return ((0, image.view, nearest),)

    def _framebuffer(self, colors: list[Image], depth: Image | None, name: str) -> Framebuffer:
        self._framebuffers.append(create_framebuffer(self.device, colors, depth, name))
        return self._framebuffers[-1]

    def _destroy_targets(self) -> None:
        if hasattr(self, "inspection"):
            self.inspection.close()
        for slot in getattr(self, "_readbacks", []):
            for readback in slot.values():
                readback.close()
        self._readbacks = []
        for framebuffer in getattr(self, "_framebuffers", []):
            destroy_framebuffer(self.device, framebuffer)
        self._framebuffers = []
        for image in getattr(self, "_targets", {}).values():
            destroy_image(self.device, image)
        self._targets = {}

    # --- every frame ---

    def render(self, view: View, time: float = 0.0) -> Frame:
        """Enqueue one frame of `view` at `time` seconds; wait only for the last frame of its slot."""
        self._check_frame(view, time)
        started = clock.perf_counter()
        self.device.make_current()
        slot = self._frames.begin()
        self._use_again(slot)
        slot.timestamps.begin_frame()
        frame = Frame(self, slot, self._index, shown_exposure(self.settings, view))
        commands = self._commands
        commands.begin(slot)

        frame.reset = self._reset or reset_by(view, time, self._previous)
        written = self._update(slot, view, time, frame.reset)

        self._run(self._forward, self._forward_rendering)
        if self._instance_id in self.passes:
            self._run(self._instance_id, self._id_rendering)
        if self._resolve in self.passes:
            self._run(self._resolve, self._resolve_rendering)
        if self._tonemap in self.passes:
            self._run(self._tonemap, self._tonemap_rendering)
        self._copy_outputs(slot)

        self._frames.submit(slot)
        self._in_slot[slot.index] = weakref.ref(frame)  # after submission: a frame that failed has no timings
        self._end_frame(frame, view, time, commands.work, written)
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _deform(self, slot: FrameSlot, pose: Pose) -> int:
        written = self._data.write_deformation(slot.index, pose)
        self._data.bind_frame(slot.index)
        return written

    def _run(self, gpu_pass: Pass, rendering: Rendering) -> None:
        """Make the calls of one pass, with its label, its timestamps and its framebuffer."""
        commands = self._commands
        commands.sources = self._sources.get(gpu_pass.name)
        with self.device.label(gpu_pass.name):
            commands.slot.timestamps.begin(gpu_pass.name)
            commands.begin_rendering(rendering)
            gpu_pass.record(commands)
            commands.slot.timestamps.end()
        self.inspection.record(commands.slot.index, gpu_pass, commands.work)

    def _copy_outputs(self, slot: FrameSlot) -> None:
        with self.device.label("copy outputs"):
            for readback in self._readbacks[slot.index].values():
                readback.record()

    def _object_counts(self) -> dict[str, int]:
        return {
            "descriptor_sets": 0,  # OpenGL has none: textures and buffers are bound one by one
            "textures": self._data.textures,
            "samplers": self._data.samplers,
        }

    # --- reading ---

    @property
    def present_source(self) -> Framebuffer:
        """The finished picture on the GPU, for a window to copy from; see `backends.contract.Renderer`."""
        if "color" not in self._handed_on:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self._picture

    def read_timings(self, slot: FrameSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self.device.make_current()
        self._frames.wait(slot)
        return slot.timestamps.read()

    # --- lifetime ---

    def _enter(self) -> None:
        self.device.make_current()

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Rebuild the pipelines that use one of the `changed` files; view, time and frame number continue."""
        self.device.make_current()
        rebuilt = self._pipelines.reload(changed)
        return self._reloaded(rebuilt, changed)

    def _free(self) -> None:
        self._destroy_targets()
