"""Classic render passes: objects that are made ahead, and two commands that need nothing beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.resources import Image

from ...frames.vulkan_commands import Commands
from . import CLEAR_COLOR, CLEAR_DEPTH
from .flags import Flag
from .objects import create_render_pass


class Classic:
    """Passes as objects."""

    def __init__(
        self, device: Device, flags: Sequence[Flag], formats: Sequence[tuple[str, str | None]]
    ) -> None:
        self._device = device
        self._passes = [
            create_render_pass(device, form, flag, f"pass {number}")
            for number, (flag, form) in enumerate(zip(flags, formats, strict=True))
        ]
        self._framebuffers: dict[tuple[Any, ...], Any] = {}
        self._subpass = vk.new("VkSubpassBeginInfo", contents=vk.VK_SUBPASS_CONTENTS_INLINE)
        self._end = vk.new("VkSubpassEndInfo")

    @property
    def objects(self) -> int:
        """Render passes and framebuffers that exist."""
        return len(self._passes) + len(self._framebuffers)

    def into(self, number: int) -> dict[str, Any]:
        """Return what a pipeline must know of pass `number`: one that it is compatible with."""
        return {"renderPass": self._passes[number]}

    def create_sized(self, size: tuple[int, int], images: Sequence[tuple[Image, Image | None]]) -> None:
        """Make a framebuffer for each set of images; passes that draw to the same images share theirs."""
        extent = {"width": size[0], "height": size[1]}
        clear = [{"color": {"float32": list(CLEAR_COLOR)}}, {"depthStencil": {"depth": CLEAR_DEPTH}}]
        self._begins = []
        for render_pass, used in zip(self._passes, images, strict=True):
            views = [image.view for image in used if image is not None]
            if used not in self._framebuffers:
                info = vk.new(
                    "VkFramebufferCreateInfo",
                    renderPass=render_pass,
                    pAttachments=views,
                    width=size[0],
                    height=size[1],
                    layers=1,
                )
                framebuffer = self._device.create("vkCreateFramebuffer", info, used[0].name)
                self._framebuffers[used] = framebuffer
            self._begins.append(
                vk.new(
                    "VkRenderPassBeginInfo",
                    renderPass=render_pass,
                    framebuffer=self._framebuffers[used],
                    renderArea={"extent": extent},
                    pClearValues=clear[: len(views)],
                )
            )

    def begin(self, commands: Commands, number: int) -> None:
        """Begin pass `number`: the one command waits, changes layouts, and clears."""
        self._device.fn.vkCmdBeginRenderPass2(commands.handle, self._begins[number], self._subpass)

    def end(self, commands: Commands, number: int) -> None:
        """End pass `number`; its attachments go into their final layouts."""
        self._device.fn.vkCmdEndRenderPass2(commands.handle, self._end)

    def destroy_sized(self) -> None:
        """Free the framebuffers."""
        for framebuffer in self._framebuffers.values():
            self._device.destroy("VkFramebuffer", framebuffer)
        self._framebuffers.clear()

    def close(self) -> None:
        """Free the passes."""
        for render_pass in self._passes:
            self._device.destroy("VkRenderPass", render_pass)
