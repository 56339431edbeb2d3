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
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from backends.contract import Reloaded, check_arguments, check_moment, check_names, check_size, resolve
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.readback import Readback
from backends.gl.resources import Image, create_image, destroy_image, sample_counts
from backends.gl.targets import Framebuffer, create_framebuffer, destroy_framebuffer
from common.errors import StaleFrameError
from common.numerics.transforms import translation
from common.scene import Change, Sampler, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import View, exposure

from . import LESSON
from .environment.model import files_at_start
from .frames.frame import OUTPUTS, SLOTS, SOURCES, Frame, check_outputs, output_of, reset_by
from .frames.gl import Frames, FrameSlot
from .frames.gl_commands import Commands, Rendering, Textures
from .frames.stream import FrameStream
from .pipelines.gl import Pipelines
from .post.gl_resolve import ResolvePass
from .post.gl_tonemap import TonemapPass
from .scene.constants import frame_constants
from .scene.default_light import DefaultLight
from .scene.gl_data import SceneData
from .settings import Settings
from .shading.gl_forward import ForwardPass
from .shading.gl_instance_id import InstanceIdPass
from .shading.samples import choose_samples
from .shading.views import shown_exposure


class Renderer(FrameStream):
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
        self._frames = Frames(context)
        self._pipelines = Pipelines(context)
        self._begin_stream()
        anisotropy = settings.anisotropy if self.plan.native("anisotropy") else 1.0
        self._data = SceneData(context, scene, settings, anisotropy)
        push = self._data.push
        self._commands = Commands(context, self._pipelines, push.buffer.handle, push.size)
        self._forward = ForwardPass(scene, settings, self._data, self._pipelines)
        self._instance_id = InstanceIdPass(self._forward, self._data, self._pipelines)
        self._resolve = ResolvePass(settings, self._data, self._pipelines)
        self._tonemap = TonemapPass(settings, self._data, self._pipelines)
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
        self._create_targets()

    def _create_targets(self) -> None:
        """Make everything whose size is the picture's: targets, framebuffers, readback."""
        context = self.device
        self._targets: dict[str, Image] = {}
        for made in self.passes:
            for access in made.writes:
                image = create_image(
                    context, access.format, self.size, access.resource, samples=access.samples
                )
                self._targets[access.resource] = image
        target = self._targets
        self._framebuffers: list[Framebuffer] = []
        color, depth = (access.resource for access in self._forward.writes)
        grey = self._forward.writes[0].clear
        forward = self._framebuffer([target[color]], target[depth], "forward")
        self._forward_rendering = Rendering(forward, grey, 0.0)
        if self._instance_id in self.passes:
            framebuffer = self._framebuffer([target["instance_id"]], target["depth"], "instance_id")
            self._id_rendering = Rendering(framebuffer, (0, 0, 0, 0), None if depth == "depth" else 0.0)
        if self._resolve in self.passes:
            self._resolve_rendering = Rendering(self._framebuffer([target["color_hdr"]], None, "resolve"))
            self._resolve.source = self._source(target[color])
        if self._tonemap in self.passes:
            self._picture = self._framebuffer([target["color"]], None, "tonemap")
            self._tonemap_rendering = Rendering(self._picture)
            self._tonemap.source = self._source(target["color_hdr"])
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
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        check_moment(view, time)
        started = clock.perf_counter()
        self.device.make_current()
        slot = self._frames.begin()
        last = self._in_slot[slot.index]()
        if last is not None:
            last.let_go(f"its slot was used again by frame {slot.number}")
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
        frame.work = self._count(commands.work, written) | {"history_resets": int(frame.reset != "")}
        self._index += 1
        self._reset = ""
        self._previous = view, time
        frame.cpu_ms = (clock.perf_counter() - started) * 1e3
        return frame

    def _update(self, slot: FrameSlot, view: View, time: float, reset: str) -> int:
        """Write what this frame's shaders read; return the bytes written."""
        scene, data = self.scene, self._data
        if data.follow_materials():
            for made in (self._forward, self._instance_id):
                if made in self.passes:
                    made.create()
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
        data.bind_frame(slot.index)
        view_from_origin = view.view_from_world() @ translation(scene.origin)
        visibility = scene.revision[Change.VISIBILITY]
        self._forward.prepare(slot.index, view_from_origin, data.records.instances, visibility)
        self._last = self._state(view, time)
        return written

    def _run(self, made: Any, rendering: Rendering) -> None:
        """Make the calls of one pass between its label, its timestamps and its framebuffer."""
        commands = self._commands
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

    def _count(self, work: dict[str, int], written: int) -> dict[str, int]:
        return {
            **work,
            "passes": len(self.passes),
            "passes_skipped": 4 - len(self.passes),
            "samples": self.samples,
            "instances": int(self.scene.instances.visible.sum()),
            "lights": len(self.scene.lights) if self._data.lit else 0,
            "bytes_written": written,
            "pipelines": len(self._pipelines),
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

    def read(self, slot: FrameSlot, name: str, exposed: float) -> np.ndarray:
        """Return an output of the slot's frame; see `Frame.image`."""
        inspected = self.inspection.readbacks[slot.index]
        check_outputs((*self.outputs, *inspected), OUTPUTS, name)
        self.device.make_current()
        self._frames.wait(slot)
        readback = (self._readbacks[slot.index] | inspected).get(name)
        if readback is None:  # an empty scene has no instances, and so no pass that would draw them
            return np.zeros(self.size[::-1], np.uint32 if name == "instance_id" else np.float32)
        return output_of(name, readback.read(), exposed)

    def read_timings(self, slot: FrameSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        self.device.make_current()
        self._frames.wait(slot)
        return slot.timestamps.read()

    # --- life ---

    def resize(self, size: tuple[int, int]) -> None:
        """Change the picture to (width, height) pixels."""
        size = check_size(size, self.capabilities.limits["maxImageDimension2D"])
        if size == self.size:
            return
        self.device.make_current()
        self._let_go("the size of the picture has changed since")
        self._destroy_targets()
        self.size = size
        self._create_targets()
        self.reset_history(self._reset or "resize")

    def reload_shaders(self, changed: Collection[Path]) -> Reloaded:
        """Build anew the pipelines that use one of these files; view, time and the number of the frame go on."""
        self.device.make_current()
        rebuilt = self._pipelines.reload(changed)
        if rebuilt:
            self._last = None  # the same view makes another picture now
        return Reloaded(rebuilt, files_at_start(self.scene, self.settings).intersection(changed))

    def close(self) -> None:
        """Free everything on the GPU; a second time does nothing."""
        if self._closed:
            return
        self._closed = True
        self.device.make_current()
        if hasattr(self, "_readbacks"):  # else it was never whole, and there are no frames
            self._let_go("its renderer was closed")
        self._destroy_targets()
        for name in ("_data", "_frames", "_pipelines"):
            held = getattr(self, name, None)
            if held is not None:
                held.close()
        for owned in reversed(self._owned):
            owned.close()
