"""Pools of buffers and images behind handles, and deletion that waits until no frame in flight can use them.

A handle is a number and a generation. Destroying a resource raises its slot's generation, so a stale handle raises an
error and never refers to the next resource in the slot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any

from backends.contract import Access
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.memory import MemoryUse
from backends.vulkan.resources import (
    Buffer,
    Image,
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
    sample_counts,
)
from common.numerics.pools import Handle, Pool
from common.scene import Sampler

from .frame import SLOTS

CAPACITY = 1 << 16
"""Buffers and images that may live at once; more than any scene of this chapter has."""


_ATTACHMENTS = {
    "color": vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
    "depth": vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT,
}


def target_usage(use: str, samples: int) -> int:
    """Return the usage of a target written as `use`: also sampled and copied; multisampled colour is only sampled."""
    usage: int = _ATTACHMENTS[use]
    if samples == 1:
        return usage | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT | vk.VK_IMAGE_USAGE_SAMPLED_BIT
    return usage | vk.VK_IMAGE_USAGE_SAMPLED_BIT if use == "color" else usage


def offered_samples(device: Device, color_format: str, depth_format: str) -> set[int]:
    """Return the sample counts that a colour and a depth target of these formats can have together."""
    color = sample_counts(device, color_format, target_usage("color", 2))
    return {1} | set(color) & set(sample_counts(device, depth_format, target_usage("depth", 2)))


class DeferredDeletion:
    """Destroys resources `SLOTS` frames after their release: by then no frame in flight can use them.

    All timelines have then reached that frame's values: a slot is used again after the CPU has waited for them.
    """

    def __init__(self) -> None:
        self._queue: deque[tuple[int, Callable[[], None]]] = deque()

    def add(self, frame: int, destroy: Callable[[], None]) -> None:
        """Call `destroy` when the GPU has finished frame number `frame`."""
        self._queue.append((frame + SLOTS, destroy))

    def collect(self, frame: int) -> int:
        """Destroy what no frame in flight can use when frame `frame` is about to be recorded; return the number."""
        count = 0
        while self._queue and self._queue[0][0] <= frame:
            self._queue.popleft()[1]()
            count += 1
        return count

    def flush(self) -> None:
        """Destroy everything now; the device must be idle."""
        while self._queue:
            self._queue.popleft()[1]()

    def __len__(self) -> int:
        return len(self._queue)


class Resources:
    """The buffers, images and samplers of a renderer. Equal sampler descriptions share one sampler."""

    def __init__(self, device: Device, families: Sequence[int] = ()) -> None:
        self._device, self._families = device, families
        self.buffers: Pool[Buffer] = Pool("buffer", CAPACITY)
        self.images: Pool[Image] = Pool("image", CAPACITY)
        self._samplers: dict[tuple[Sampler, float], Any] = {}
        self._deletions = DeferredDeletion()
        self.frame = 0
        """Number of the frame being recorded; `collect` sets it."""

    @property
    def counts(self) -> dict[str, int]:
        """The number of live resources of each kind."""
        return {"buffers": len(self.buffers), "images": len(self.images), "samplers": len(self._samplers)}

    def buffer(self, size: int, usage: int, use: MemoryUse, name: str, shared: bool = False) -> Handle:
        """Create a buffer, if `shared` for all queue families; see `backends.vulkan.resources.create_buffer`."""
        families = self._families if shared else ()
        return self.buffers.create(create_buffer(self._device, size, usage, use, name, families=families))

    def image(self, format: str, size: tuple[int, int], usage: int, name: str, **options: Any) -> Handle:
        """Create an image; see `backends.vulkan.resources.create_image`."""
        return self.images.create(create_image(self._device, format, size, usage, name, **options))

    def target(self, access: Access, size: tuple[int, int]) -> Handle:
        """Create the image of a pass's write `access`; with several samples, it cannot be copied."""
        assert access.format is not None, access
        usage = target_usage(access.use, access.samples)
        return self.image(access.format, size, usage, access.resource, samples=access.samples)

    def sampler(self, sampler: Sampler, anisotropy: float) -> Any:
        """Return the sampler for this description, created at its first use."""
        key = (sampler, anisotropy)
        if key not in self._samplers:
            name = f"{sampler.min}/{sampler.mag}/{sampler.mipmap} {sampler.wrap_u}/{sampler.wrap_v}"
            self._samplers[key] = create_sampler(self._device, sampler, anisotropy, name)
        return self._samplers[key]

    def destroy_buffer(self, handle: Handle) -> None:
        """Destroy a buffer: its handle is stale at once; its memory is freed when no frame in flight can use it."""
        buffer = self.buffers.destroy(handle)
        self._deletions.add(self.frame, lambda: destroy_buffer(self._device, buffer))

    def destroy_image(self, handle: Handle) -> None:
        """Destroy an image, as `destroy_buffer` does a buffer."""
        image = self.images.destroy(handle)
        self._deletions.add(self.frame, lambda: destroy_image(self._device, image))

    def defer(self, destroy: Callable[[], None]) -> None:
        """Call `destroy` when no frame in flight can use the resource that it destroys."""
        self._deletions.add(self.frame, destroy)

    def collect(self, frame: int) -> None:
        """Set the number of the frame that is about to be recorded, and free what no frame in flight can use."""
        self.frame = frame
        self._deletions.collect(frame)

    def flush(self) -> None:
        """Free all destroyed resources; no frame may be in flight."""
        self._deletions.flush()

    def close(self) -> None:
        """Free everything; the device must be idle."""
        self.flush()
        for _, buffer in list(self.buffers.items()):
            destroy_buffer(self._device, buffer)
        for _, image in list(self.images.items()):
            destroy_image(self._device, image)
        for sampler in self._samplers.values():
            self._device.destroy("VkSampler", sampler)
        self._samplers.clear()
