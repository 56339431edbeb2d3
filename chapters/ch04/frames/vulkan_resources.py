"""Pools of buffers and images behind handles, and deletion that waits until no frame in flight can use them.

A handle is a number and a generation. Destroying a resource raises its slot's generation, so a stale handle is noticed
instead of silently meaning the slot's next owner.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
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
    """Return the usage of an image that passes write as `use`, and then read or copy; of many samples, only colour."""
    usage: int = _ATTACHMENTS[use]
    if samples == 1:
        return usage | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT | vk.VK_IMAGE_USAGE_SAMPLED_BIT
    return usage | vk.VK_IMAGE_USAGE_SAMPLED_BIT if use == "color" else usage


def offered_samples(device: Device, color_format: str, depth_format: str) -> set[int]:
    """Return how many samples a pixel of two targets that are drawn to together can have."""
    color = sample_counts(device, color_format, target_usage("color", 2))
    return {1} | set(color) & set(sample_counts(device, depth_format, target_usage("depth", 2)))


class DeferredDeletion:
    """Destroys things `SLOTS` frames after they were given up: by then no frame in flight can use them."""

    def __init__(self) -> None:
        self._queue: deque[tuple[int, Callable[[], None]]] = deque()

    def add(self, frame: int, destroy: Callable[[], None]) -> None:
        """Call `destroy` once frame number `frame` has left the GPU."""
        self._queue.append((frame + SLOTS, destroy))

    def collect(self, frame: int) -> int:
        """Destroy what frame `frame`, about to be recorded, proves unused; return how many things that were."""
        count = 0
        while self._queue and self._queue[0][0] <= frame:
            self._queue.popleft()[1]()
            count += 1
        return count

    def flush(self) -> None:
        """Destroy everything now, after the device has become idle."""
        while self._queue:
            self._queue.popleft()[1]()

    def __len__(self) -> int:
        return len(self._queue)


class Resources:
    """The buffers, images and samplers of a renderer. Equal sampler descriptions share one sampler."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.buffers: Pool[Buffer] = Pool("buffer", CAPACITY)
        self.images: Pool[Image] = Pool("image", CAPACITY)
        self._samplers: dict[tuple[Sampler, float], Any] = {}
        self._deletions = DeferredDeletion()
        self.frame = 0
        """Number of the frame being recorded; the renderer keeps it up to date."""

    @property
    def counts(self) -> dict[str, int]:
        """How many of each kind are alive."""
        return {"buffers": len(self.buffers), "images": len(self.images), "samplers": len(self._samplers)}

    def buffer(self, size: int, usage: int, use: MemoryUse, name: str) -> Handle:
        """Make a buffer; see `backends.vulkan.resources.create_buffer`."""
        return self.buffers.create(create_buffer(self._device, size, usage, use, name))

    def image(self, format: str, size: tuple[int, int], usage: int, name: str, **more: Any) -> Handle:
        """Make an image; see `backends.vulkan.resources.create_image`."""
        return self.images.create(create_image(self._device, format, size, usage, name, **more))

    def target(self, access: Access, size: tuple[int, int]) -> Handle:
        """Make the image that a pass says it writes; with several samples, nothing can copy it."""
        assert access.format is not None, access
        usage = target_usage(access.use, access.samples)
        return self.image(access.format, size, usage, access.resource, samples=access.samples)

    def sampler(self, sampler: Sampler, anisotropy: float) -> Any:
        """Return the sampler for this description, made at its first use."""
        key = (sampler, anisotropy)
        if key not in self._samplers:
            name = f"{sampler.min}/{sampler.mag}/{sampler.mipmap} {sampler.wrap_u}/{sampler.wrap_v}"
            self._samplers[key] = create_sampler(self._device, sampler, anisotropy, name)
        return self._samplers[key]

    def destroy_buffer(self, handle: Handle) -> None:
        """Give a buffer up: its handle is stale at once, its memory is freed when no frame can use it."""
        buffer = self.buffers.destroy(handle)
        self._deletions.add(self.frame, lambda: destroy_buffer(self._device, buffer))

    def destroy_image(self, handle: Handle) -> None:
        """Give an image up, as `destroy_buffer` does."""
        image = self.images.destroy(handle)
        self._deletions.add(self.frame, lambda: destroy_image(self._device, image))

    def defer(self, destroy: Callable[[], None]) -> None:
        """Call `destroy` when no frame can use what it destroys any more."""
        self._deletions.add(self.frame, destroy)

    def collect(self, frame: int) -> None:
        """Note that frame `frame` is about to be recorded, and free what is no longer in use."""
        self.frame = frame
        self._deletions.collect(frame)

    def flush(self) -> None:
        """Free what was given up; no frame may be in flight."""
        self._deletions.flush()

    def close(self) -> None:
        """Free everything; the device is idle."""
        self.flush()
        for _, buffer in list(self.buffers.items()):
            destroy_buffer(self._device, buffer)
        for _, image in list(self.images.items()):
            destroy_image(self._device, image)
        for sampler in self._samplers.values():
            self._device.destroy("VkSampler", sampler)
        self._samplers.clear()
