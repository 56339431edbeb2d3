"""The swapchain: the images that a surface shows in turn, and the copy of a finished picture into the next of them.

The renderer draws into its own image and knows nothing of windows; the copy is a small command buffer of its own that
follows the frame's on the same queue. A user interface is drawn over the copy in the same command buffer.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.device import Device
from backends.vulkan.resources import Image
from backends.vulkan.window.display import HDR_METADATA, Display, Mastering
from backends.vulkan.window.draw_lists import DrawLists
from common.errors import UnsupportedError
from common.view.draw_lists import DrawList

SLOTS = 2
"""Copies in flight: as many as renderers have frames."""

TIMEOUT_NS = 500_000_000
"""How long to wait for an image: a compositor may give none to a hidden window."""

_FOREVER = 2**64 - 1

# --- what to choose ---------------------------------------------------------------------------------------------------


def choose_present_mode(offered: Collection[int], vsync: bool = True) -> int:
    """Return the present mode: FIFO, which every surface has and which never tears; without `vsync` a faster one."""
    fast = (vk.VK_PRESENT_MODE_MAILBOX_KHR, vk.VK_PRESENT_MODE_IMMEDIATE_KHR)
    return next((mode for mode in fast if mode in offered and not vsync), vk.VK_PRESENT_MODE_FIFO_KHR)


def choose_image_count(least: int, most: int) -> int:
    """Return how many images to ask for: one above the least, so that none is waited for; `most` 0 means no limit."""
    return least + 1 if most == 0 else min(least + 1, most)


def choose_extent(
    current: tuple[int, int], least: tuple[int, int], most: tuple[int, int], wanted: tuple[int, int]
) -> tuple[int, int]:
    """Return the images' (width, height): the surface's own, or `wanted` within bounds where it leaves that open."""
    if current[0] != 2**32 - 1:
        return current
    width, height = (min(max(want, low), high) for want, low, high in zip(wanted, least, most, strict=True))
    return width, height


# --- the swapchain ----------------------------------------------------------------------------------------------------


class _Slot:
    """What one copy in flight needs: its commands, the semaphore of the image it got, and its fence."""

    def __init__(self, device: Device, index: int) -> None:
        pool = vk.new(
            "VkCommandPoolCreateInfo",
            flags=vk.VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
            queueFamilyIndex=device.queue.family,
        )
        self.pool = device.create("vkCreateCommandPool", pool, f"present {index}")
        info = vk.new("VkCommandBufferAllocateInfo", commandPool=self.pool, commandBufferCount=1)
        out = vk.ffi.new("VkCommandBuffer[1]")
        vk.check(device.fn.vkAllocateCommandBuffers(device.handle, info, out), "vkAllocateCommandBuffers")
        self.commands = out[0]
        device.name("VkCommandBuffer", self.commands, f"present {index}")
        fence = vk.new("VkFenceCreateInfo", flags=vk.VK_FENCE_CREATE_SIGNALED_BIT)
        self.fence = device.create("vkCreateFence", fence, f"present {index} done")
        self.fences = vk.array("VkFence", [self.fence])
        self.acquired = device.create(
            "vkCreateSemaphore", vk.new("VkSemaphoreCreateInfo"), f"present {index} acquired"
        )

    def close(self, device: Device) -> None:
        device.destroy("VkCommandPool", self.pool)
        device.destroy("VkFence", self.fence)
        device.destroy("VkSemaphore", self.acquired)


class _Target:
    """One image of the swapchain, with everything that showing it takes, built once."""

    def __init__(self, device: Device, chain: Any, index: int, handle: Any, slots: Sequence[_Slot]) -> None:
        self.handle = handle
        device.name("VkImage", handle, f"swapchain image {index}")
        # By image: when an image comes back from `acquire`, its last presentation has waited for its semaphore.
        self.finished = device.create(
            "vkCreateSemaphore", vk.new("VkSemaphoreCreateInfo"), f"swapchain image {index} finished"
        )
        color = vk.VK_IMAGE_ASPECT_COLOR_BIT
        # The acquired semaphore is waited for by the transfer stage, and this barrier continues from there.
        self.to_copy = barriers(image_barrier(handle, color, "copy_target", "copy_target", discard=True))
        self.to_present = barriers(image_barrier(handle, color, "copy_target", "present"))
        self.to_draw = barriers(image_barrier(handle, color, "copy_target", "color"))
        self.drawn_to_present = barriers(image_barrier(handle, color, "color", "present"))
        self.view: Any = None  # made for the first user interface
        self.submits = [
            vk.new(
                "VkSubmitInfo2",
                pWaitSemaphoreInfos=[
                    {"semaphore": slot.acquired, "stageMask": vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT}
                ],
                pCommandBufferInfos=[{"commandBuffer": slot.commands}],
                pSignalSemaphoreInfos=[
                    {"semaphore": self.finished, "stageMask": vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT}
                ],
            )
            for slot in slots
        ]
        self.present = vk.new(
            "VkPresentInfoKHR",
            pWaitSemaphores=[self.finished],
            swapchainCount=1,
            pSwapchains=[chain],
            pImageIndices=[index],
        )


class Swapchain:
    """The images that a surface shows in turn. They are made anew when the window's size or state asks for it."""

    def __init__(
        self, device: Device, surface: Any, *, vsync: bool = True, display: Display | None = None
    ) -> None:
        self._device, self._surface = device, surface
        self._fn = device.fn
        ask = device.instance.fn
        physical = device.physical.handle
        formats = vk.listed(
            ask.vkGetPhysicalDeviceSurfaceFormatsKHR,
            "vkGetPhysicalDeviceSurfaceFormatsKHR",
            "VkSurfaceFormatKHR",
            physical,
            surface,
        )
        offered = [(int(item.format), int(item.colorSpace)) for item in formats]
        self.format, self.space = (display or Display()).choose(offered, device.instance.extensions)
        self._mastering: Mastering | None = None
        modes = vk.listed(
            ask.vkGetPhysicalDeviceSurfacePresentModesKHR,
            "vkGetPhysicalDeviceSurfacePresentModesKHR",
            "VkPresentModeKHR",
            physical,
            surface,
        )
        self.mode = choose_present_mode([int(mode) for mode in modes], vsync)
        self._slots = [_Slot(device, index) for index in range(SLOTS)]
        self._next = 0
        self._begin = vk.new("VkCommandBufferBeginInfo", flags=vk.VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT)
        self._label = vk.new("VkDebugUtilsLabelEXT", pLabelName="present")
        self._index = vk.ffi.new("uint32_t *")
        self._regions: dict[tuple[int, int], Any] = {}
        self.handle: Any = None
        self.extent = (0, 0)
        self._wanted = (0, 0)
        self.targets: list[_Target] = []
        self.stale = True
        self.made = self.shown = 0
        self._draws: DrawLists | None = None
        self._list: DrawList | None = None

    def _capabilities(self) -> Any:
        capabilities = vk.new("VkSurfaceCapabilitiesKHR")
        code = self._device.instance.fn.vkGetPhysicalDeviceSurfaceCapabilitiesKHR(
            self._device.physical.handle, self._surface, capabilities
        )
        vk.check(code, "vkGetPhysicalDeviceSurfaceCapabilitiesKHR")
        return capabilities

    def _recreate(self, wanted: tuple[int, int]) -> bool:
        """Make the images for the surface as it is now; return False if it has no area."""
        capabilities = self._capabilities()
        extent = choose_extent(
            (capabilities.currentExtent.width, capabilities.currentExtent.height),
            (capabilities.minImageExtent.width, capabilities.minImageExtent.height),
            (capabilities.maxImageExtent.width, capabilities.maxImageExtent.height),
            wanted,
        )
        if 0 in extent:
            return False
        if not capabilities.supportedUsageFlags & vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT:
            raise UnsupportedError("This display takes no copies of pictures: run with --headless.")
        alphas = capabilities.supportedCompositeAlpha
        opaque = vk.VK_COMPOSITE_ALPHA_OPAQUE_BIT_KHR
        old = self.handle
        info = vk.new(
            "VkSwapchainCreateInfoKHR",
            surface=self._surface,
            minImageCount=choose_image_count(capabilities.minImageCount, capabilities.maxImageCount),
            imageFormat=self.format,
            imageColorSpace=self.space,
            imageExtent={"width": extent[0], "height": extent[1]},
            imageArrayLayers=1,
            # A surface's images can always be drawn to (specification of VkSurfaceCapabilitiesKHR).
            imageUsage=vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT | vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT,
            imageSharingMode=vk.VK_SHARING_MODE_EXCLUSIVE,
            preTransform=capabilities.currentTransform,
            compositeAlpha=opaque if alphas & opaque else alphas & -alphas,
            presentMode=self.mode,
            clipped=1,
            oldSwapchain=old,
        )
        self._device.wait_idle()
        self.handle = self._device.create("vkCreateSwapchainKHR", info, "swapchain")
        self._destroy_targets()
        if old is not None:
            self._device.destroy("VkSwapchainKHR", old)
        images = vk.listed(
            self._fn.vkGetSwapchainImagesKHR,
            "vkGetSwapchainImagesKHR",
            "VkImage",
            self._device.handle,
            self.handle,
        )
        self.targets = [
            _Target(self._device, self.handle, index, image, self._slots)
            for index, image in enumerate(images)
        ]
        self.extent, self._wanted = extent, wanted
        self._tell()
        self._regions.clear()
        self.stale = False
        self.made += 1
        return True

    def tell(self, mastering: Mastering | None) -> None:
        """Tell the display about the content from now on, where the device can (VK_EXT_hdr_metadata)."""
        if mastering != self._mastering:
            self._mastering = mastering
            self._tell()

    def _tell(self) -> None:
        if self._mastering is None or self.handle is None or HDR_METADATA not in self._device.extensions:
            return
        chains = vk.array("VkSwapchainKHR", [self.handle])
        self._fn.vkSetHdrMetadataEXT(self._device.handle, 1, chains, self._mastering.info())

    def lay(self, drawn: DrawList | None) -> None:
        """Draw a user interface over whatever is shown from now on; None takes it away. Each list is given once."""
        self._list = drawn
        if drawn is None:
            return
        if self._draws is None:
            self._draws = DrawLists(self._device, self.format, SLOTS)
        self._draws.update(drawn)

    def show(self, source: Image, wanted: tuple[int, int]) -> bool:
        """Show `source`, which is in state 'copy_source' and stays in it; return whether that happened.

        `wanted` is the window's size in pixels. A picture of another size is stretched to the window, which lasts until
        the renderer has the new size. False: the window is minimised, or the display gave no image in time.
        """
        fn, device = self._fn, self._device
        slot_index = self._next
        slot = self._slots[slot_index]
        vk.check(fn.vkWaitForFences(device.handle, 1, slot.fences, 1, _FOREVER), "vkWaitForFences")
        index = self._acquire(slot, wanted)
        if index is None:
            return False
        target = self.targets[index]
        commands = slot.commands
        vk.check(fn.vkResetCommandPool(device.handle, slot.pool, 0), "vkResetCommandPool")
        vk.check(fn.vkBeginCommandBuffer(commands, self._begin), "vkBeginCommandBuffer")
        if device.instance.has_debug_utils:
            fn.vkCmdBeginDebugUtilsLabelEXT(commands, self._label)
        fn.vkCmdPipelineBarrier2(commands, target.to_copy)
        # A blit, not a copy: it also brings red and blue into the order of the display's format.
        fn.vkCmdBlitImage(
            commands,
            source.handle,
            vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL,
            target.handle,
            vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL,
            1,
            self._region(source.width, source.height),
            vk.VK_FILTER_NEAREST if (source.width, source.height) == self.extent else vk.VK_FILTER_LINEAR,
        )
        self._finish_target(commands, slot_index, target)
        if device.instance.has_debug_utils:
            fn.vkCmdEndDebugUtilsLabelEXT(commands)
        vk.check(fn.vkEndCommandBuffer(commands), "vkEndCommandBuffer")
        vk.check(fn.vkResetFences(device.handle, 1, slot.fences), "vkResetFences")
        queue = device.queue.handle
        vk.check(fn.vkQueueSubmit2(queue, 1, target.submits[slot_index], slot.fence), "vkQueueSubmit2")
        self._next = (slot_index + 1) % SLOTS
        code = fn.vkQueuePresentKHR(queue, target.present)
        if code in (vk.VK_SUBOPTIMAL_KHR, vk.VK_ERROR_OUT_OF_DATE_KHR):
            self.stale = True
        if code == vk.VK_ERROR_OUT_OF_DATE_KHR:
            return False
        vk.check(code, "vkQueuePresentKHR")
        self.shown += 1
        return True

    def _finish_target(self, commands: Any, slot: int, target: _Target) -> None:
        """Record what follows the copy: the user interface, if there is one, and the way to the display."""
        fn = self._device.fn
        if self._draws is None or self._list is None:
            fn.vkCmdPipelineBarrier2(commands, target.to_present)
            return
        if target.view is None:
            info = vk.new(
                "VkImageViewCreateInfo",
                image=target.handle,
                viewType=vk.VK_IMAGE_VIEW_TYPE_2D,
                format=self.format,
                subresourceRange={
                    "aspectMask": vk.VK_IMAGE_ASPECT_COLOR_BIT,
                    "levelCount": 1,
                    "layerCount": 1,
                },
            )
            target.view = self._device.create("vkCreateImageView", info, "swapchain image view")
        fn.vkCmdPipelineBarrier2(commands, target.to_draw)
        self._draws.record(commands, slot, self._list, target.view, self.extent)
        fn.vkCmdPipelineBarrier2(commands, target.drawn_to_present)

    def _acquire(self, slot: _Slot, wanted: tuple[int, int]) -> int | None:
        """Return the index of the image to be shown next, or None if there is none for now."""
        for _ in range(2):  # the window may change between the making of the images and the asking for one
            if (self.stale or wanted != self._wanted) and not self._recreate(wanted):
                return None
            code = self._fn.vkAcquireNextImageKHR(
                self._device.handle, self.handle, TIMEOUT_NS, slot.acquired, vk.NULL, self._index
            )
            if code == vk.VK_ERROR_OUT_OF_DATE_KHR:
                self.stale = True
                continue
            vk.check(code, "vkAcquireNextImageKHR")
            if code in (vk.VK_TIMEOUT, vk.VK_NOT_READY):
                return None
            # A suboptimal image is an image, and its semaphore will be signalled: it is shown, and replaced after.
            self.stale = code == vk.VK_SUBOPTIMAL_KHR
            return int(self._index[0])
        return None

    def _region(self, width: int, height: int) -> Any:
        region = self._regions.get((width, height))
        if region is None:
            layers = {"aspectMask": vk.VK_IMAGE_ASPECT_COLOR_BIT, "layerCount": 1}
            region = self._regions[width, height] = vk.new(
                "VkImageBlit",
                srcSubresource=layers,
                srcOffsets=[{}, {"x": width, "y": height, "z": 1}],
                dstSubresource=layers,
                dstOffsets=[{}, {"x": self.extent[0], "y": self.extent[1], "z": 1}],
            )
        return region

    def _destroy_targets(self) -> None:
        for target in self.targets:
            self._device.destroy("VkSemaphore", target.finished)
            if target.view is not None:
                self._device.destroy("VkImageView", target.view)
        self.targets = []

    def close(self) -> None:
        """Free everything but the surface, after the queue has left it."""
        self._fn.vkDeviceWaitIdle(self._device.handle)  # after a lost device there is nothing to wait for
        if self._draws is not None:
            self._draws.close()
            self._draws = None
        self._destroy_targets()
        for slot in self._slots:
            slot.close(self._device)
        self._slots = []
        if self.handle is not None:
            self._device.destroy("VkSwapchainKHR", self.handle)
            self.handle = None
