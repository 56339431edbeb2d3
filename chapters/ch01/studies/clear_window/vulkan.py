"""The study clear-window on Vulkan: two commands, and the barrier without which the first has nothing to write to."""

from __future__ import annotations

from backends.vulkan import api as vk
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ..stage_vulkan import Stage
from . import STUDY, color_at


class Renderer(Stage):
    """One colour. Nothing is made ahead: no shader, no pipeline, no memory of its own."""

    study = STUDY

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record the frame. Nothing is drawn here and now: the GPU reads this list later, when it is submitted."""
        fn = self.device.fn

        # The GPU may lay the same image out in memory in several ways, one for drawing, another for copying, and it
        # overlaps whatever it is not forbidden to overlap. A barrier says both: the layout from here on, and which
        # earlier work must be over (source) before which later work begins (target).
        ready = vk.new(
            "VkImageMemoryBarrier2",
            # The frame before was copied from this image, to a file or to a window. Wait until that is over. It only
            # read, so there is no access whose effect would have to be made visible.
            srcStageMask=vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
            srcAccessMask=0,
            dstStageMask=vk.VK_PIPELINE_STAGE_2_COLOR_ATTACHMENT_OUTPUT_BIT,
            dstAccessMask=vk.VK_ACCESS_2_COLOR_ATTACHMENT_WRITE_BIT,
            # "Undefined" gives the old content up. That is free, while keeping it would mean converting it.
            oldLayout=vk.VK_IMAGE_LAYOUT_UNDEFINED,
            newLayout=vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
            srcQueueFamilyIndex=vk.VK_QUEUE_FAMILY_IGNORED,
            dstQueueFamilyIndex=vk.VK_QUEUE_FAMILY_IGNORED,
            image=self.picture.handle,
            subresourceRange={"aspectMask": vk.VK_IMAGE_ASPECT_COLOR_BIT, "levelCount": 1, "layerCount": 1},
        )
        fn.vkCmdPipelineBarrier2(commands.handle, vk.new("VkDependencyInfo", pImageMemoryBarriers=[ready]))

        # Clearing is how an image is loaded, not a command: a GPU that draws tile by tile begins each tile with this
        # colour and never touches memory for it. The picture holds codes of a display, 8 bits a channel, so 0.5
        # becomes 128 and not the half of white's light; the study textured-mesh is the first that cares.
        attachment = {
            "imageView": self.picture.view,
            "imageLayout": vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
            "loadOp": vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
            "storeOp": vk.VK_ATTACHMENT_STORE_OP_STORE,
            "clearValue": {"color": {"float32": list(color_at(time))}},
        }
        width, height = self.size
        rendering = vk.new(
            "VkRenderingInfo",
            renderArea={"extent": {"width": width, "height": height}},
            layerCount=1,
            pColorAttachments=[attachment],
        )
        fn.vkCmdBeginRendering(commands.handle, rendering)
        # Draws would stand here: the next study has one.
        fn.vkCmdEndRendering(commands.handle)
