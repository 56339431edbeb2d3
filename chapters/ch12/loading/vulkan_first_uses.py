"""First uses that are slow, done before the first frame.

Frames that stream textures have little time, and opening the renderer takes only slightly longer.
"""

from __future__ import annotations

from collections.abc import Iterable

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from common.scene import Pose

from ..frames.vulkan import FrameSlot
from ..scene.vulkan_data import VulkanSceneData
from .loading import Loading


def rehearse(
    loading: Loading, device: Device, slots: Iterable[FrameSlot], data: VulkanSceneData, pose: Pose
) -> None:
    """Let the driver allocate memory for the commands of all slots, and write the records at `pose` to them.

    It does nothing if loading ends before the first frame: then its time does not matter. A first frame at another time
    writes its records again.
    """
    if not loading.streams:
        return
    begin = vk.new("VkCommandBufferBeginInfo")
    for slot in slots:  # each is reset when its frame begins
        vk.check(device.fn.vkBeginCommandBuffer(slot.commands, begin), "vkBeginCommandBuffer")
        vk.check(device.fn.vkEndCommandBuffer(slot.commands), "vkEndCommandBuffer")
    if len(pose.world_from_object):
        for written in data.slots:
            data.records.write(written, pose)
