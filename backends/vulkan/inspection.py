"""Looks at a frame from inside: a copy of what each pass wrote, taken right behind it, and what the pass had to do.

It stands between the passes of a renderer that was opened with `inspect=True`, and changes nothing that they see: each
target is back in the state in which its pass left it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from backends.contract import Access, Pass, PassWork
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.device import Device
from backends.vulkan.readback import TO_HOST, Readback
from backends.vulkan.resources import Image, create_image, destroy_image

_LAYOUTS = {
    "color": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
    "depth": vk.VK_IMAGE_LAYOUT_DEPTH_ATTACHMENT_OPTIMAL,
}
_ATTACHMENTS = {
    "color": vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
    "depth": vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT,
}


@dataclass
class _Tap:
    """One output of one pass in one slot; of many samples first one is made (`rendering`)."""

    before: Any  # barriers
    rendering: Any
    between: Any
    source: Image
    after: Any
    readback: Any = None  # a Readback


class Inspection:
    """Copies of what `passes` write to the `targets` of each slot: a frame in flight may have images of its own.

    With several samples a pixel it is their mean that is copied, of a depth the first sample.
    """

    def __init__(
        self, device: Device, passes: Iterable[Pass], targets: Sequence[Mapping[str, Image]]
    ) -> None:
        self._device = device
        self._resolved: list[Image] = []
        self.readbacks: list[dict[str, Readback]] = [{} for _ in targets]
        """For each slot what can be read, by "pass/resource"."""
        self.work = PassWork()
        self._taps: list[dict[str, list[_Tap]]] = [{} for _ in targets]
        for gpu_pass in passes:
            for access in gpu_pass.writes:
                self._tap_in_slots(gpu_pass.name, access, [images[access.resource] for images in targets])

    @property
    def names(self) -> tuple[str, ...]:
        """What can be read: "pass/resource"."""
        return tuple(self.readbacks[0])

    def _tap_in_slots(self, name: str, access: Access, images: Sequence[Image]) -> None:
        taps: dict[int, _Tap] = {}  # by image: most are those of all slots
        for slot, image in enumerate(images):
            if id(image) not in taps:
                taps[id(image)] = self._tap(name, access, image)
            tap = taps[id(image)]
            readback = Readback(self._device, tap.source, f"{name} {image.name}, slot {slot}")
            self._taps[slot].setdefault(name, []).append(replace(tap, readback=readback))
            self.readbacks[slot][f"{name}/{access.resource}"] = readback

    def _tap(self, name: str, access: Access, image: Image) -> _Tap:
        state = access.use
        if image.samples == 1:
            source, rendering, between = image, None, None
            before = [image_barrier(image.handle, image.aspect, state, "copy_source")]
            after = [image_barrier(image.handle, image.aspect, "copy_source", state)]
        else:
            usage = _ATTACHMENTS[state] | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
            source = create_image(
                self._device, image.format, (image.width, image.height), usage, f"{name} {image.name}"
            )
            self._resolved.append(source)
            before = [
                image_barrier(image.handle, image.aspect, state, state),
                image_barrier(source.handle, source.aspect, "copy_source", state, discard=True),
            ]
            rendering = self._resolving(state, image, source)
            between = barriers(image_barrier(source.handle, source.aspect, state, "copy_source"))
            after = [image_barrier(image.handle, image.aspect, state, state)]
        return _Tap(barriers(*before), rendering, between, source, barriers(*after, memory=TO_HOST))

    @staticmethod
    def _resolving(state: str, image: Image, resolved: Image) -> Any:
        """Return a rendering that draws nothing: what it loads is resolved when it ends."""
        mean = state == "color" and not image.format.endswith("ui")
        attachment = {
            "imageView": image.view,
            "imageLayout": _LAYOUTS[state],
            "loadOp": vk.VK_ATTACHMENT_LOAD_OP_LOAD,
            "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
            "resolveMode": vk.VK_RESOLVE_MODE_AVERAGE_BIT if mean else vk.VK_RESOLVE_MODE_SAMPLE_ZERO_BIT,
            "resolveImageView": resolved.view,
            "resolveImageLayout": _LAYOUTS[state],
        }
        return vk.new(
            "VkRenderingInfo",
            renderArea={"extent": {"width": image.width, "height": image.height}},
            layerCount=1,
            pColorAttachments=[attachment] if state == "color" else None,
            pDepthAttachment=attachment if state == "depth" else None,
        )

    def record(self, commands: Any, slot: int, gpu_pass: Pass, work: Mapping[str, int]) -> None:
        """Record the copies of what a pass wrote; `work` are the frame's counters so far. Without passes do nothing."""
        if not any(self._taps):
            return
        fn = self._device.fn
        self.work.add(gpu_pass.name, work)
        for tap in self._taps[slot].get(gpu_pass.name, ()):
            fn.vkCmdPipelineBarrier2(commands, tap.before)
            if tap.rendering is not None:
                fn.vkCmdBeginRendering(commands, tap.rendering)
                fn.vkCmdEndRendering(commands)
                fn.vkCmdPipelineBarrier2(commands, tap.between)
            tap.readback.record(commands)
            fn.vkCmdPipelineBarrier2(commands, tap.after)

    def close(self) -> None:
        """Free everything; the device is idle."""
        for held in self.readbacks:
            for readback in held.values():
                readback.close()
            held.clear()
        for image in self._resolved:
            destroy_image(self._device, image)
        self._taps, self._resolved = [{} for _ in self._taps], []
