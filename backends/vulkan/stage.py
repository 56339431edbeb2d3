"""The stage of a study on Vulkan: device, frames in flight, the picture and its depth, copies to the CPU, times."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from backends.creation import BufferCreation, BufferUse
from backends.stage import Stage as AnyStage
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.creation import BUFFER_USAGES, buffer_from, image_from
from backends.vulkan.device import Device
from backends.vulkan.instance import Instance
from backends.vulkan.memory import MemoryUse
from backends.vulkan.readback import TO_HOST, Readback
from backends.vulkan.resources import (
    Buffer,
    Image,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from backends.vulkan.upload import Uploader
from common.errors import StaleFrameError
from common.scene import Sampler
from common.view.camera import View

USAGES = BUFFER_USAGES
"""The bit of each use that a study has for a buffer."""


class Graphics(NamedTuple):
    """The parts of a chapter's graphics layer with which its studies draw."""

    frames: Callable[[Device], Any]
    commands: Callable[[Device], Any]
    rendering: Callable[..., Any]
    descriptors: Callable[[Device], Any]
    pipelines: Callable[..., Any]
    profiler: Callable[[Device], Any]
    target_usage: Callable[[str, int], int]


class Stage(AnyStage):
    """A study on Vulkan. `draw` finds `picture` in no known state and leaves it in the state `leaves`."""

    graphics: Graphics
    device: Device
    picture: Image
    depth: Image | None = None
    background = (0.05, 0.05, 0.06, 1.0)
    leaves = "color"  # of `backends.vulkan.barriers.STATES`

    def begin(self, commands: Any) -> None:
        """Begin drawing to the picture, and to the depth where there is one, both cleared."""
        commands.barrier(self._to_draw)
        commands.begin_rendering(self._rendering)

    def end(self, commands: Any) -> None:
        """End drawing."""
        commands.end_rendering()

    def per_slot(self, size: int, use: BufferUse, name: str) -> list[Buffer]:
        """Return a buffer for each frame in flight, written by the CPU where the GPU reads it."""
        creation = BufferCreation(size=size, memory="upload", uses=(use,))
        return [
            self._made_from(creation.set_name(f"{name}, slot {slot}"))
            for slot in range(self.frame_logic.SLOTS)
        ]

    def filled(self, array: np.ndarray, uses: Sequence[BufferUse], name: str) -> Buffer:
        """Return a buffer that holds an array for good."""
        creation = BufferCreation(size=array.nbytes, uses=("copy_target", *uses), name=name)
        buffer = self._made_from(creation)
        with Uploader(self.device) as uploader:
            uploader.buffer(buffer, array)
        return buffer

    def texture(
        self,
        pixels: np.ndarray,
        shape: Literal["2d", "array", "3d"],
        name: str,
        format: str = "rgba8",
        sized: bool = False,
    ) -> Image:
        """Return an image of pixels (H, W, C), or of layers or slices (N, H, W, C), ready to be sampled.

        One that is `sized` is made by `create_sized` and goes when the picture's size changes.
        """
        slices = pixels if shape != "2d" else pixels[None]
        image = image_from(self.device, self.image_of(pixels, shape, name, format))
        (self.keep_sized if sized else self.keep)(image, lambda one: destroy_image(self.device, one))
        with Uploader(self.device) as uploader:
            uploader.image(image, list(slices))
        return image

    def target(self, name: str, format: str, output: str = "", leaves: str = "color") -> Image:
        """Return an image of the picture's size to draw to, freed when that changes.

        As an `output` it can be read from frames; `leaves` is the state in which `draw` leaves it, as of the picture it
        finds it in none.
        """
        use = "depth" if format == "d32f" else "color"
        usage = self.graphics.target_usage(use, 1)
        image = create_image(self.device, format, self.size, usage, name)
        self.keep_sized(image, lambda one: destroy_image(self.device, one))
        if output:
            self._targets[output] = (image, leaves)
        return image

    def sampler(self, how: Sampler, name: str) -> Any:
        """Return a sampler."""
        made = create_sampler(self.device, how, 1.0, name)
        return self.keep(made, lambda one: self.device.destroy("VkSampler", one))

    def _buffer(self, size: int, usage: int, use: MemoryUse, name: str) -> Buffer:
        made = create_buffer(self.device, size, usage, use, name)
        return self.keep(made, lambda one: destroy_buffer(self.device, one))

    def _made_from(self, creation: BufferCreation) -> Buffer:
        made = buffer_from(self.device, creation)
        return self.keep(made, lambda one: destroy_buffer(self.device, one))

    # --- what the study is not about ---

    def _open(self, validate: bool, without: Iterable[str]) -> Device:
        instance = Instance(validate)
        try:
            device = Device(instance, without=without)
        except BaseException:
            instance.close()
            raise
        self._owned += [instance, device]
        return device

    def _set_up(self) -> None:
        self._frames = self.graphics.frames(self.device)
        self._profiler = self.graphics.profiler(self.device)
        self.descriptors = self.graphics.descriptors(self.device)
        self.pipelines = self.make_pipelines()
        self.commands = self.graphics.commands(self.device)

    def make_pipelines(self) -> Any:
        """Return what builds the study's pipelines."""
        return self.graphics.pipelines(self.device)

    def _create_targets(self) -> None:
        device = self.device
        self._targets: dict[str, tuple[Image, str]] = {}
        self.picture = self.target("picture", "rgba8", "color", self.leaves)
        starts = [self._start(self.picture, "color")]
        if self.has_depth:
            self.depth = self.target("depth", "d32f", "depth", "depth")
            starts.append(self._start(self.depth, "depth"))
        self._to_draw = barriers(*starts)
        self._rendering = self.graphics.rendering(self.size, self.picture, self.depth, self.background, 0.0)
        self.create_sized()
        self._to_copy = barriers(
            *(image_barrier(i.handle, i.aspect, state, "copy_source") for i, state in self._targets.values())
        )
        self._to_host = barriers(memory=TO_HOST)
        self._readbacks = [
            {name: Readback(device, self._targets[name][0], f"{name}, slot {slot}") for name in self.outputs}
            for slot in range(self.frame_logic.SLOTS)
        ]

    @staticmethod
    def _start(image: Image, state: str) -> Any:
        """Return the barrier that begins an image's frame: its content is given up, its last copy waited for."""
        return image_barrier(image.handle, image.aspect, "copy_source", state, discard=True)

    def _destroy_targets(self) -> None:
        for slot in getattr(self, "_readbacks", ()):
            for readback in slot.values():
                readback.close()
        self._readbacks = []

    def _begin(self) -> Any:
        return self._frames.begin()

    def _draw(self, slot: Any, view: View, time: float) -> None:
        commands, name = self.commands, self.study.title
        commands.begin(slot)
        self._profiler.begin_frame(slot)
        commands.begin_label(name)
        self._profiler.begin(slot, name)
        self.draw(commands, view, time)
        self._profiler.end(slot)
        commands.end_label()
        commands.barrier(self._to_copy)
        for readback in self._readbacks[slot.index].values():
            readback.record(slot.commands)
        commands.barrier(self._to_host)
        self._frames.submit(slot)

    def _read(self, slot: Any, name: str) -> np.ndarray:
        self._frames.wait(slot)
        return self._readbacks[slot.index][name].read()

    def read_timings(self, slot: Any) -> dict[str, float]:
        """Return GPU milliseconds of the slot's frame."""
        self._frames.wait(slot)
        timings: dict[str, float] = self._profiler.read(slot)
        return timings

    @property
    def present_source(self) -> Image:
        """The finished picture on the GPU, for a window to copy from."""
        if not self.has_picture:
            raise StaleFrameError("This renderer has no picture for a window: open it with presents=True.")
        return self.picture

    def _wait(self) -> None:
        self.device.wait_idle()  # for the frames, and for what a window still copies from them

    def _exchange(self, changed: Collection[Path]) -> tuple[str, ...]:
        def retire(destroy: Callable[[], None]) -> None:
            self._wait()  # a study need not be quick about it
            destroy()

        rebuilt: tuple[str, ...] = self.pipelines.reload(changed, retire)
        return rebuilt

    def _tear_down(self) -> None:
        held: Sequence[str] = ("_frames", "_profiler", "pipelines", "descriptors")
        for name in held:
            if hasattr(self, name):
                getattr(self, name).close()
