"""What costs more when it is done for the first time, done before the first frame.

A frame that fills in while textures load has enough to do, and nobody waits for the renderer to open for so short.
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
    """Have the driver make memory for the commands of all slots, and write the records at `pose` to them.

    Nothing where frames wait for what is loaded: there nobody sees how long the first one takes. A first frame at
    another time writes other records; one that sees the same objects finds theirs written.
    """
    if not loading.streams:
        return
    begin = vk.new("VkCommandBufferBeginInfo")
    for slot in slots:  # each is reset when its frame begins
        vk.check(device.fn.vkBeginCommandBuffer(slot.commands, begin), "vkBeginCommandBuffer")
        vk.check(device.fn.vkEndCommandBuffer(slot.commands), "vkEndCommandBuffer")
    if len(pose.world_from_object):
        for written in data.slots:
            data.records.write(written, pose, 1.0)
