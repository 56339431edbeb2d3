"""The same passes by dynamic rendering: nothing is made ahead but structs, and barriers stand where they are needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import STATES, barriers, image_barrier
from backends.vulkan.device import Device
from backends.vulkan.resources import FORMATS, Image

from ...frames.vulkan_commands import Commands
from . import CLEAR_COLOR, CLEAR_DEPTH, GOES_ON, SCENE, SHOWN
from .flags import Flag, Use, uses
from .objects import LOADS, STORES


class Dynamic:
    """Passes as commands."""

    objects = 0

    def __init__(
        self, device: Device, flags: Sequence[Flag], formats: Sequence[tuple[str, str | None]]
    ) -> None:
        self._device, self._flags, self._formats = device, flags, formats

    def into(self, number: int) -> dict[str, Any]:
        """Return what a pipeline must know of pass `number`: formats."""
        color, depth = self._formats[number]
        rendering = vk.new(
            "VkPipelineRenderingCreateInfo",
            pColorAttachmentFormats=[FORMATS[color][0]],
            depthAttachmentFormat=FORMATS[depth][0] if depth else vk.VK_FORMAT_UNDEFINED,
        )
        return {"pNext": rendering}

    def create_sized(self, size: tuple[int, int], images: Sequence[tuple[Image, Image | None]]) -> None:
        """Fill in how each pass begins, and the barriers around it."""
        self._begins = []
        for flags, (color, depth) in zip(self._flags, images, strict=True):
            uses_color, uses_depth = uses(flags)
            value: Any = {"color": {"float32": list(CLEAR_COLOR)}}
            attachment = _attachment(color, "color", uses_color, value)
            value = {"depthStencil": {"depth": CLEAR_DEPTH}}
            self._begins.append(
                vk.new(
                    "VkRenderingInfo",
                    renderArea={"extent": {"width": size[0], "height": size[1]}},
                    layerCount=1,
                    pColorAttachments=[attachment],
                    pDepthAttachment=_attachment(depth, "depth", uses_depth, value) if depth else None,
                )
            )
        scene, depth = images[SCENE]
        picture, _ = images[SHOWN]
        assert depth is not None

        def barrier(image: Image, before: str, after: str, discard: bool = False) -> Any:
            return image_barrier(image.handle, image.aspect, before, after, discard=discard)

        # By hand there is one less change of layout: the second pass goes on where the first has ended, while flags
        # make the target ready for shaders in between.
        self._before = {
            SCENE: barriers(
                barrier(scene, "sampled", "color", discard=True),
                barrier(depth, "depth", "depth", discard=True),
            ),
            GOES_ON: barriers(barrier(scene, "color", "color"), barrier(depth, "depth", "depth")),
            SHOWN: barriers(
                barrier(scene, "color", "sampled"), barrier(picture, "copy_source", "color", discard=True)
            ),
        }
        self._after = {SHOWN: barriers(barrier(picture, "color", "copy_source"))}

    def begin(self, commands: Commands, number: int) -> None:
        """Begin pass `number` behind its barrier."""
        commands.barrier(self._before[number])
        self._device.fn.vkCmdBeginRendering(commands.handle, self._begins[number])

    def end(self, commands: Commands, number: int) -> None:
        """End pass `number`."""
        self._device.fn.vkCmdEndRendering(commands.handle)
        if number in self._after:
            commands.barrier(self._after[number])

    def destroy_sized(self) -> None:
        """Free nothing: structs go by themselves."""

    def close(self) -> None:
        """Free nothing."""


def _attachment(image: Image, state: str, use: Use, clear: dict[str, Any]) -> dict[str, Any]:
    return {
        "imageView": image.view,
        "imageLayout": STATES[state].layout,
        "loadOp": LOADS[use.load],
        "storeOp": STORES[use.store],
        "clearValue": clear,
    }
