"""A frame on OpenGL, from top to bottom; compare ../renderer.py.

    update     constants, instances and lights of this frame are written into its slot
    forward    every object is drawn once and lit while it is drawn     -> color_hdr, depth
    instance   which object is where, if somebody asks                  -> instance_id
    resolve    with several samples a pixel: one colour from theirs     -> color_hdr
    tonemap    light becomes a picture                                  -> color
    copy       the outputs that were asked for go to the CPU

The driver finds out by itself that a pass must wait for what it reads. That is comfortable, and it is work that the
driver does for each call of each frame: what Vulkan's barriers say once, OpenGL guesses again and again.
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
from .frames.gl_commands import Rendering, Textures
from .frames.recording.gl_parts import open_commands
from .frames.stream import FrameStream
from .pipelines.gl import Pipelines
from .scene.gl_data import GlSceneData
from .shading.views import shown_exposure
from .tasks.workers import Workers


class Renderer(FrameStream):
    """The chapter on OpenGL: one stream of frames of one view of one scene."""

    device: Context
    _data: GlSceneData

    # --- made once ---

    def _open_device(self, validate: bool, without: Iterable[str]) -> Context:
        context = Context(validate, without)
        self._owned.append(context)
        return context

    def _offered(self) -> set[int]:
        of_color = sample_counts(self.device, self.settings.color_format)
        return {*of_color} & {*sample_counts(self.device, "d32f")}

    def _create(self) -> None:
        context, scene = self.device, self.scene
        settings = self.settings
        self._frames = Frames(context)
        self._pipelines = Pipelines(context)
        self._begin_stream()
        anisotropy = settings.anisotropy if self.plan.native("anisotropy") else 1.0
        self._data = GlSceneData(context, scene, settings, anisotropy, self._loading)
        self._workers = Workers(settings.recording_threads)
        multi_draw = self.plan.native("multi-draw")
        self._commands = open_commands(context, self._pipelines, multi_draw, self._workers, settings)
        self._make_passes()
        self._create_targets()

    def _create_targets(self) -> None:
        """Make everything whose size is the picture's: targets, framebuffers, readback."""
        context = self.device
        self._targets: dict[str, Image] = {}
        for made in self.passes:
            for access in made.writes:
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
        self.inspection = Inspection(context, watched, target, SLOTS)

    def _source(self, image: Image) -> Textures:
        """Return what a full-screen pass binds to read a target texel by texel."""
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
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for but the slot's last frame."""
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
        self._in_slot[slot.index] = weakref.ref(frame)  # not before: a frame that failed has no times to keep
        self._end_frame(frame, view, time, commands.work, written)
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _deform(self, slot: FrameSlot, pose: Pose) -> int:
        written = self._data.write_deformation(slot.index, pose)
        self._data.bind_frame(slot.index)
        return written

    def _run(self, made: Pass, rendering: Rendering) -> None:
        """Make the calls of one pass between its label, its timestamps and its framebuffer."""
        commands = self._commands
        commands.sources = self._sources.get(made.name)
        with self.device.label(made.name):
            commands.slot.timestamps.begin(made.name)
            commands.begin_rendering(rendering)
            made.record(commands)
            commands.slot.timestamps.end()
        self.inspection.record(commands.slot.index, made, commands.work)

    def _copy_outputs(self, slot: FrameSlot) -> None:
        with self.device.label("copy outputs"):
            for readback in self._readbacks[slot.index].values():
                readback.record()

    def _made(self) -> dict[str, int]:
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

    # --- life ---

    def _enter(self) -> None:
        self.device.make_current()

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files; view, time and the number of the frame go on."""
        self.device.make_current()
        rebuilt = self._pipelines.reload(changed)
        return self._reloaded(rebuilt, changed)

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self.device.make_current()
        if hasattr(self, "_readbacks"):  # else it was never whole, and there are no frames
            self._let_go("its renderer was closed")
        self._destroy_targets()
        for name in ("_workers", "_loading", "_data", "_frames", "_pipelines"):
            held = getattr(self, name, None)
            if held is not None:
                held.close()
        for owned in reversed(self._owned):
            owned.close()
