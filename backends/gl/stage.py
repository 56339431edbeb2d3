"""The stage of a study on OpenGL: context, frames in flight, the picture and its depth, copies to the CPU, times."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from backends.creation import BufferCreation
from backends.gl.context import Context
from backends.gl.creation import buffer_from, image_from
from backends.gl.draws import create_vertex_array
from backends.gl.readback import Readback
from backends.gl.resources import (
    Buffer,
    Image,
    MemoryUse,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    write_buffer,
    write_image,
)
from backends.gl.targets import Framebuffer, begin, create_framebuffer, destroy_framebuffer
from backends.stage import Stage as AnyStage
from common.errors import StaleFrameError
from common.scene import Sampler
from common.view.camera import View


class Graphics(NamedTuple):
    """The parts of a chapter's OpenGL with which its studies draw."""

    frames: Callable[[Context], Any]
    pipelines: Callable[[Context], Any]


class Stage(AnyStage):
    """A study on OpenGL. `draw` gets the frame's slot: there are no commands to record, calls act at once."""

    graphics: Graphics
    device: Context
    picture: Image
    depth: Image | None
    framebuffer: Framebuffer
    background = (0.05, 0.05, 0.06, 1.0)

    def begin(self) -> None:
        """Begin drawing to the picture, and to the depth where there is one, both cleared."""
        begin(self.device, self.framebuffer, (self.background,), 0.0 if self.has_depth else None)

    def per_slot(self, size: int, name: str) -> list[Buffer]:
        """Return a buffer for each frame in flight, written by the CPU where the GPU reads it."""
        creation = BufferCreation(size=size, memory="upload")
        return [
            self._made_from(creation.set_name(f"{name}, slot {slot}"))
            for slot in range(self.frame_logic.SLOTS)
        ]

    def filled(self, array: np.ndarray, name: str) -> Buffer:
        """Return a buffer that holds an array for good."""
        buffer = self._buffer(array.nbytes, "device", name)
        write_buffer(self.device, buffer, array)
        return buffer

    def texture(
        self,
        pixels: np.ndarray,
        shape: Literal["2d", "array", "3d"],
        name: str,
        format: str = "rgba8",
        sized: bool = False,
    ) -> Image:
        """Return an image of pixels (H, W, C), or of layers or slices (N, H, W, C).

        One that is `sized` is made by `create_sized` and goes when the picture's size changes.
        """
        image = image_from(self.device, self.image_of(pixels, shape, name, format))
        (self.keep_sized if sized else self.keep)(image, lambda image: destroy_image(self.device, image))
        write_image(self.device, image, pixels)
        return image

    def target(self, name: str, format: str, output: str = "") -> Image:
        """Return an image of the picture's size to draw to, freed when that changes; frames can read an `output`."""
        image = create_image(self.device, format, self.size, name)
        self.keep_sized(image, lambda image: destroy_image(self.device, image))
        if output:
            self._targets[output] = image
        return image

    def framebuffer_of(self, color: Image, depth: Image | None, name: str) -> Framebuffer:
        """Return what draws to targets, freed when the picture's size changes."""
        framebuffer = create_framebuffer(self.device, [color], depth, name)
        return self.keep_sized(framebuffer, lambda framebuffer: destroy_framebuffer(self.device, framebuffer))

    def sampler(self, how: Sampler, name: str) -> int:
        """Return a sampler."""
        sampler = create_sampler(self.device, how, 1.0, name)
        return self.keep(sampler, lambda sampler: self.device.destroy("sampler", sampler))

    def _buffer(self, size: int, use: MemoryUse, name: str) -> Buffer:
        buffer = create_buffer(self.device, size, use, name)
        return self.keep(buffer, lambda buffer: destroy_buffer(self.device, buffer))

    def _made_from(self, creation: BufferCreation) -> Buffer:
        buffer = buffer_from(self.device, creation)
        return self.keep(buffer, lambda buffer: destroy_buffer(self.device, buffer))

    # --- what the study is not about ---

    def _open(self, validate: bool, without: Iterable[str]) -> Context:
        self._owned.append(Context(validate, without))
        context: Context = self._owned[-1]
        return context

    def _set_up(self) -> None:
        self.device.make_current()
        self._frames = self.graphics.frames(self.device)
        self.pipelines = self.graphics.pipelines(self.device)
        # For shaders that make their own vertices: OpenGL draws nothing unless some vertex array is bound.
        self.no_vertices = create_vertex_array(self.device, (), None, None, "no vertices")

    def _create_targets(self) -> None:
        context = self.device
        context.make_current()
        self._targets: dict[str, Image] = {}
        self.picture = self.target("picture", "rgba8", "color")
        self.depth = self.target("depth", "d32f", "depth") if self.has_depth else None
        self.framebuffer = self.framebuffer_of(self.picture, self.depth, "picture")
        self.create_sized()
        self._readbacks = [
            {name: Readback(context, self._targets[name], f"{name}, slot {slot}") for name in self.outputs}
            for slot in range(self.frame_logic.SLOTS)
        ]

    def _destroy_targets(self) -> None:
        self.device.make_current()
        for slot in getattr(self, "_readbacks", ()):
            for readback in slot.values():
                readback.close()
        self._readbacks = []

    def _begin(self) -> Any:
        self.device.make_current()
        return self._frames.begin()

    def _draw(self, slot: Any, view: View, time: float) -> None:
        slot.timestamps.begin_frame()
        with self.device.label(self.study.title):
            slot.timestamps.begin(self.study.title)
            self.draw(slot, view, time)
            slot.timestamps.end()
        for readback in self._readbacks[slot.index].values():
            readback.record()
        self._frames.submit(slot)

    def _read(self, slot: Any, name: str) -> np.ndarray:
        self.device.make_current()
        self._frames.wait(slot)
        return self._readbacks[slot.index][name].read()

    def read_timings(self, slot: Any) -> dict[str, float]:
        """Return GPU milliseconds of the slot's frame."""
        self.device.make_current()
        self._frames.wait(slot)
        timings: dict[str, float] = slot.timestamps.read()
        return timings

    @property
    def present_source(self) -> Framebuffer:
        """The finished picture on the GPU, for a window to copy from."""
        if not self.has_picture:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self.framebuffer

    def _wait(self) -> None:
        self.device.make_current()
        for slot in self._frames.slots if hasattr(self, "_frames") else ():
            self._frames.wait(slot)

    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        self.device.make_current()
        rebuilt: tuple[str, ...] = self.pipelines.reload(changed)
        return rebuilt

    def _tear_down(self) -> None:
        if hasattr(self, "no_vertices"):
            self.device.destroy("vertex array", self.no_vertices)
        for name in ("_frames", "pipelines"):
            if hasattr(self, name):
                getattr(self, name).close()
