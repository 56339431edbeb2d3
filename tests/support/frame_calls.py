"""The Vulkan calls of one frame, each with the innermost label under which it was recorded."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import chapters
from backends.vulkan import api as vk


class Call(NamedTuple):
    """One call: the label that was open, the function's name, its arguments."""

    label: str
    name: str
    arguments: tuple[Any, ...]


@contextmanager
def views_made(device: Any) -> Iterator[dict[Any, Any]]:
    """Give a dictionary; on leaving, it holds the image of each view that was made meanwhile."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    images: dict[Any, Any] = {}
    device.fn.trace(log)
    try:
        yield images
    finally:
        device.fn.trace(None)
        for name, arguments in log:
            if name == "vkCreateImageView":
                images[arguments[3][0]] = arguments[1].image


_WRITES = vk.VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT | vk.VK_ACCESS_2_DEPTH_STENCIL_ATTACHMENT_WRITE_BIT


def not_waited_for(calls: list[Call], images: dict[Any, Any]) -> list[str]:
    """Return what a frame forgets, "pass 2: image 0x..": attachments that are drawn to again without a barrier.

    Synchronization validation of the layers 1.3.239 does not look at what dynamic rendering loads and stores. Every
    image needs a barrier before its first pass of a frame, and one that waits for its writes before each pass after it.
    """
    forgotten, ready, written, number = [], set(), set(), 0
    for _, name, arguments in calls:
        if name == "vkCmdPipelineBarrier2":
            for i in range(arguments[1].imageMemoryBarrierCount):
                barrier = arguments[1].pImageMemoryBarriers[i]
                if barrier.image not in written or barrier.srcAccessMask & _WRITES:
                    written.discard(barrier.image)
                if barrier.image not in written and barrier.dstAccessMask & _WRITES:
                    ready.add(barrier.image)
        if name == "vkCmdBeginRendering":
            info, number = arguments[1], number + 1
            attachments = [info.pColorAttachments[i] for i in range(info.colorAttachmentCount)]
            attachments += [info.pDepthAttachment[0]] if info.pDepthAttachment else []
            for one in attachments:
                image = images[one.imageView]
                if image not in ready:
                    forgotten.append(f"pass {number}: image {image}")
                ready.discard(image)
                written.add(image)
    return forgotten


def calls_of_a_frame(device: Any, renderer: Any, time: float = 0.0) -> list[Call]:
    """Return what a renderer calls in its next frame, of its default view."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    view = chapters.view_of(renderer)
    device.fn.trace(log)
    try:
        renderer.render(view, time)
    finally:
        device.fn.trace(None)
    labels, calls = [""], []
    for name, arguments in log:
        if name == "vkCmdBeginDebugUtilsLabelEXT":
            labels.append(vk.ffi.string(arguments[1].pLabelName).decode())
        elif name == "vkCmdEndDebugUtilsLabelEXT":
            labels.pop()
        calls.append(Call(labels[-1], name, arguments))
    return calls


def barriers_of(calls: list[Call], image: Any) -> Iterator[tuple[str, Any]]:
    """Yield the barriers that an image goes through, each with its label, in order."""
    for label, name, arguments in calls:
        if name == "vkCmdPipelineBarrier2":
            for number in range(arguments[1].imageMemoryBarrierCount):
                if arguments[1].pImageMemoryBarriers[number].image == image:
                    yield label, arguments[1].pImageMemoryBarriers[number]


def labels_of(calls: list[Call]) -> list[str]:
    """Return the labels that were opened, in order."""
    return [one.label for one in calls if one.name == "vkCmdBeginDebugUtilsLabelEXT"]
