"""The stage of studies with rays on Vulkan: structures, a trace for each pixel, and the picture of what it found."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Buffer, buffer_address
from backends.vulkan.upload import Uploader
from common.errors import UnsupportedError
from common.view.camera import View

from ..frames.vulkan_commands import Commands
from ..pipelines.description import Built, Described, PipelineDescription
from ..pipelines.vulkan_descriptors import Held, Structure
from ..rays.vulkan_build import BUILD_AFTER_BUILD, INPUT, Bottoms
from ..rays.vulkan_geometry import Geometry
from ..rays.vulkan_top import TopLevel, tracing
from .seen import COUNTS, EYE, PIXEL, SHADERS, eye_of, work
from .stage_vulkan import Stage

_SHADER = vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
_FRAGMENT = vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT
_COPY = vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT


def require(device: Device, without: Collection[str], study: str) -> None:
    """Raise UnsupportedError where a study needs ray pipelines and there are none."""
    if "ray-tracing" in without:
        raise UnsupportedError(f"The study {study} needs ray-tracing, but it is switched off by --without.")
    if not device.has("ray-tracing"):
        why = device.capabilities.why_not.get("ray-tracing", "the device lacks it")
        raise UnsupportedError(f"The study {study} needs ray-tracing, but {why}.")


class RayStage(Stage):
    """A study that traces a ray for each pixel. `prepare_rays` says what it builds."""

    moves = False
    number = 0
    """The number of the study's own in the block of the eye."""

    @property
    def traces(self) -> bool:
        """Whether there are ray pipelines, and they are not switched off."""
        return bool(self.device.has("ray-tracing")) and "ray-tracing" not in self.without

    def describe(self) -> Described:
        """Return the pipeline that traces."""
        raise NotImplementedError

    def hold(self) -> dict[int, Held]:
        """Make what the pipeline reads, and return it by binding: those from 3 on."""
        raise NotImplementedError

    def create(self) -> None:
        """Build the pipelines, and what the study's rays meet."""
        self._eyes = self.per_slot(EYE.itemsize, "uniform", "eye")
        self._counts = self.empty(4 * COUNTS, ["storage"], "counts")
        self._held = self.hold()
        self._trace, self._show = self.pipelines.get(
            [self.describe(), PipelineDescription(SHADERS, color="rgba8", depth=None, name="show")]
        )
        stages = tracing(self.device)
        self._written = stages, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
        # The last frame may still show its pixels and count.
        self._begun = barriers(memory=(stages | _FRAGMENT, _SHADER, *_COPY))
        self._zeroed = barriers(memory=(*_COPY, stages, _SHADER))
        self._traced = barriers(memory=(*self._written, _FRAGMENT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT))

    def create_sized(self) -> None:
        """Make room for what is found at each pixel, and the sets that refer to it."""
        size = PIXEL.itemsize * self.size[0] * self.size[1]
        self._pixels = self.empty(size, ["storage"], "pixels", sized=True)
        self._tracing, self._showing = [], []
        for eye in self._eyes:
            shared: dict[int, Held] = {0: eye, 1: self._pixels}
            held: dict[int, Held] = {**shared, 2: self._counts, **self._held}
            self._tracing.append(self.set_of(self._trace, self._used(self._trace, held), "rays", sized=True))
            self._showing.append(self.set_of(self._show, shared, "show", sized=True))

    @staticmethod
    def _used(pipeline: Built, held: dict[int, Held]) -> dict[int, Held]:
        """Return those of the resources that the shaders use."""
        layout = pipeline.sets[0]
        assert layout is not None, "a study with rays writes pixels"
        numbers = {binding.number for binding in layout.bindings}
        return {number: it for number, it in held.items() if number in numbers}

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Trace a ray for each pixel, and show what they found."""
        slot, fn = commands.slot.index, self.device.fn
        self._eyes[slot].view(EYE)[0] = eye_of(view, self.size, self.number)
        commands.barrier(self._begun)
        fn.vkCmdFillBuffer(commands.handle, self._counts.handle, 0, self._counts.size, 0)
        commands.barrier(self._zeroed)
        commands.bind_compute(self._trace)
        commands.bind_compute_set(self._trace, 0, self._tracing[slot])
        commands.trace(self._trace, self.size)
        commands.barrier(self._traced)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._showing[slot])
        commands.draw_triangle()
        self.end(commands)
        self.work = work(self.size)

    # --- structures ---

    def input(self, array: NDArray[np.generic], name: str) -> tuple[Buffer, int]:
        """Return a buffer that builds and shaders read, and its address."""
        copied = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT | vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        buffer = self._buffer(array.nbytes, INPUT | copied, "device", name)
        with Uploader(self.device) as uploader:
            uploader.buffer(buffer, np.ascontiguousarray(array))
        return buffer, buffer_address(self.device, buffer)

    def world(
        self, geometries: Sequence[Geometry], flags: Sequence[int], records: Sequence[int] = ()
    ) -> Structure:
        """Return a structure with one instance of each geometry where it is, with these flags (rays/model.py).

        `records` are the offsets of instances among the hit groups of the pipeline, 0 unless they are given.
        """
        bottoms = self.keep(Bottoms(self.device, geometries), lambda bottoms: bottoms.close())
        top = self.keep(TopLevel(self.device, len(geometries)), lambda top: top.close())
        words = np.zeros((len(geometries), 16), np.uint32)
        words[:, :12] = np.eye(4, dtype=np.float32)[:3].reshape(-1).view(np.uint32)
        words[:, 12] = np.arange(len(geometries)) | 0xFF << 24
        offsets = np.array(records or [0] * len(geometries), np.uint32)
        words[:, 13] = offsets | np.array(flags, np.uint32) << np.uint32(24)
        words[:, 14:] = np.array([it.address for it in bottoms.all], np.uint64)[:, None].view(np.uint32)
        with Uploader(self.device) as uploader:
            uploader.buffer(top.records, words)
        with submit_once(self.device) as commands:
            self.device.fn.vkCmdPipelineBarrier2(commands, BUILD_AFTER_BUILD)
            top.record(commands)
            after = barriers(
                memory=(
                    vk.VK_PIPELINE_STAGE_2_ACCELERATION_STRUCTURE_BUILD_BIT_KHR,
                    vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_WRITE_BIT_KHR,
                    tracing(self.device),
                    vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_READ_BIT_KHR,
                )
            )
            self.device.fn.vkCmdPipelineBarrier2(commands, after)
        return Structure(top.handle)

    # --- what was found ---

    def pixels(self) -> np.ndarray:
        """Return what the last frame found, (H, W) PIXEL."""
        return self.download(self._pixels, self._written).view(PIXEL).reshape(self.size[::-1])

    def counted(self) -> NDArray[np.uint32]:
        """Return the counters of the last frame, (COUNTS,)."""
        counts: NDArray[np.uint32] = self.download(self._counts, self._written).view(np.uint32)
        return counts
