"""GPU memory: which type is chosen on which machine, and that ranges neither overlap nor get lost."""

from __future__ import annotations

import pickle
import random
from itertools import pairwise

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.memory import BLOCK_SIZE, MemoryType, choose_memory_type
from backends.vulkan.resources import (
    DEDICATED_SIZE,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
)
from common.errors import DeviceError

LOCAL, VISIBLE, COHERENT, CACHED, LAZY = (
    vk.VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
    vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT,
    vk.VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
    vk.VK_MEMORY_PROPERTY_HOST_CACHED_BIT,
    vk.VK_MEMORY_PROPERTY_LAZILY_ALLOCATED_BIT,
)
USAGE = vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
GIB = 1 << 30


def table(*kinds):
    return [MemoryType(flags, heap) for flags, heap in kinds]


MACHINES = {
    # types as their drivers list them, and the index expected for (device, upload, readback)
    "discrete, with a window of 256 MiB into its memory": (
        table(
            (LOCAL, 8 * GIB),
            (VISIBLE | COHERENT, 16 * GIB),
            (LOCAL | VISIBLE | COHERENT, 256 << 20),
            (VISIBLE | COHERENT | CACHED, 16 * GIB),
        ),
        (0, 1, 3),
    ),
    "integrated: all memory is the GPU's": (
        table(
            (LOCAL | VISIBLE | COHERENT, 16 * GIB),
            (LOCAL | VISIBLE | COHERENT | CACHED, 16 * GIB),
        ),
        (0, 0, 1),
    ),
    "software: one type for everything": (table((LOCAL | VISIBLE | COHERENT | CACHED, 4 * GIB)), (0, 0, 0)),
    "a phone: cached memory is not coherent, and tiles live in lazy memory": (
        table(
            (LOCAL | LAZY, 4 * GIB),
            (LOCAL, 4 * GIB),
            (LOCAL | VISIBLE | COHERENT, 4 * GIB),
            (LOCAL | VISIBLE | CACHED, 4 * GIB),
        ),
        (1, 2, 3),
    ),
    "no cached memory at all": (table((LOCAL, GIB), (VISIBLE | COHERENT, GIB)), (0, 1, 1)),
}


@pytest.mark.feature("device/host-cached-readback")
@pytest.mark.feature("device/memory-suballocator")
@pytest.mark.parametrize("machine", MACHINES)
def test_the_type_for_each_use_is_the_expected_one(machine):
    types, expected = MACHINES[machine]
    assert tuple(choose_memory_type(types, ~0, use) for use in ("device", "upload", "readback")) == expected


@pytest.mark.feature("device/host-cached-readback")
@pytest.mark.feature("device/memory-suballocator")
def test_only_allowed_types_are_chosen():
    types, _ = MACHINES["discrete, with a window of 256 MiB into its memory"]
    assert choose_memory_type(types, 0b1110, "device") == 2
    assert choose_memory_type(types, 0b0100, "readback") == 2
    with pytest.raises(DeviceError, match="no memory type for upload among 0x1"):
        choose_memory_type(types, 0b0001, "upload")


@pytest.fixture
def memory(vulkan_device):
    """The allocator, which must use as many bytes in the end as in the beginning."""

    def live():
        return sorted(
            (id(block), *some)
            for blocks in vulkan_device.memory._blocks.values()
            for block in blocks
            for some in block.ranges.ranges()
        )

    before = live()
    yield vulkan_device.memory
    assert live() == before


@pytest.mark.feature("device/memory-suballocator")
def test_random_buffers_neither_overlap_nor_lose_their_bytes(vulkan_device, memory):
    """400 steps of making and freeing; each buffer is filled with its own number and checked when it goes."""
    chance = random.Random(7)
    alive = []
    for number in range(400):
        if alive and chance.random() < (0.3 if len(alive) < 60 else 0.7):
            buffer, mark = alive.pop(chance.randrange(len(alive)))
            assert (buffer.mapped == mark).all()
            destroy_buffer(vulkan_device, buffer)
        else:
            size = int(2 ** chance.uniform(0, 20))
            buffer = create_buffer(vulkan_device, size, USAGE, "upload", f"buffer {number}")
            needs = vk.new("VkMemoryRequirements")
            vulkan_device.fn.vkGetBufferMemoryRequirements(vulkan_device.handle, buffer.handle, needs)
            assert buffer.allocation.offset % needs.alignment == 0
            assert buffer.allocation.size >= needs.size
            buffer.mapped[:] = number % 256
            alive.append((buffer, number % 256))
        places = sorted(
            (vk.ffi.cast("uintptr_t", one.allocation.memory), one.allocation.offset, one.allocation.size)
            for one, _ in alive
        )
        for (block, start, size), (other, after, _) in pairwise(places):
            assert block != other or start + size <= after
    assert len(alive) > 20
    for buffer, mark in alive:
        assert (buffer.mapped == mark).all()
        destroy_buffer(vulkan_device, buffer)


@pytest.mark.feature("device/memory-suballocator")
def test_a_freed_place_is_given_out_again(vulkan_device, memory):
    three = [create_buffer(vulkan_device, 1 << 20, USAGE, "upload", f"buffer {n}") for n in range(3)]
    allocated = memory.allocated
    offset = three[0].allocation.offset
    for buffer in three[:2]:
        destroy_buffer(vulkan_device, buffer)
    both = create_buffer(vulkan_device, 2 << 20, USAGE, "upload", "as large as two")
    assert both.allocation.offset == offset, "freed neighbours are one hole"
    assert memory.allocated == allocated
    for buffer in (both, three[2]):
        destroy_buffer(vulkan_device, buffer)


@pytest.mark.feature("device/memory-suballocator")
def test_buffers_and_images_never_share_a_block(vulkan_device, memory):
    buffer = create_buffer(vulkan_device, 4096, USAGE, "device", "buffer")
    image = create_image(vulkan_device, "rgba8", (16, 16), vk.VK_IMAGE_USAGE_SAMPLED_BIT, "image")
    assert buffer.allocation.memory != image.allocation.memory
    destroy_buffer(vulkan_device, buffer)
    destroy_image(vulkan_device, image)


@pytest.mark.feature("device/memory-suballocator")
def test_large_things_have_memory_of_their_own_and_give_it_back(vulkan_device, memory):
    side = int((DEDICATED_SIZE / 4) ** 0.5)
    allocated = memory.allocated
    image = create_image(vulkan_device, "rgba8", (side, side), vk.VK_IMAGE_USAGE_SAMPLED_BIT, "large image")
    assert memory.allocated - allocated == image.allocation.size >= DEDICATED_SIZE
    buffer = create_buffer(vulkan_device, BLOCK_SIZE + 4096, USAGE, "device", "large buffer")
    assert buffer.allocation.offset == 0
    assert memory.allocated - allocated >= image.allocation.size + BLOCK_SIZE + 4096
    destroy_image(vulkan_device, image)
    destroy_buffer(vulkan_device, buffer)
    assert memory.allocated == allocated


@pytest.mark.feature("device/memory-suballocator")
def test_memory_of_one_image_never_serves_another(vulkan_instance):
    """Also where it is the last of its kind, which the allocator keeps (VUID-vkBindImageMemory-memory-01509)."""
    side = int((DEDICATED_SIZE / 4) ** 0.5)
    with Device(vulkan_instance) as device:
        for size in (side, 16):
            image = create_image(
                device, "rgba8", (size, size), vk.VK_IMAGE_USAGE_SAMPLED_BIT, f"{size} texels wide"
            )
            destroy_image(device, image)
            kept = [block.dedicated for blocks in device.memory._blocks.values() for block in blocks]
            assert kept == [False] * (size == 16)


@pytest.mark.feature("device/memory-suballocator")
def test_more_than_the_heap_is_refused_before_the_driver_is_asked(vulkan_device, memory):
    needs = vk.new("VkMemoryRequirements", size=1 << 50, alignment=256, memoryTypeBits=2**32 - 1)
    with pytest.raises(vk.VulkanError, match="VK_ERROR_OUT_OF_DEVICE_MEMORY"):
        memory.allocate(needs, "device", linear=True)


def a_buffer(device):
    return create_buffer(device, 1 << 20, USAGE, "device", "refused")


def an_image(device):
    return create_image(device, "rgba8", (8, 8), vk.VK_IMAGE_USAGE_SAMPLED_BIT, "refused")


@pytest.mark.feature("device/lifetime-and-leaks")
@pytest.mark.parametrize("make", [a_buffer, an_image])
def test_memory_that_is_refused_leaves_no_object(vulkan_device, memory, monkeypatch, make):
    before = dict(vulkan_device.alive)

    def refuse(*_, **__):
        raise vk.VulkanError("vkAllocateMemory", vk.VK_ERROR_OUT_OF_DEVICE_MEMORY)

    monkeypatch.setattr(memory, "allocate", refuse)
    with pytest.raises(vk.VulkanError, match="smaller --size or scene") as caught:
        make(vulkan_device)
    assert vulkan_device.alive == before
    what = "'refused', 1.0 MiB" if make is a_buffer else "'refused' of 8x8 pixels, "
    assert str(caught.value).startswith(f"There is no memory on the device for {what}")
    assert str(caught.value).endswith("less (vkAllocateMemory() failed with VK_ERROR_OUT_OF_DEVICE_MEMORY).")
    assert caught.value.exit_code == 2


@pytest.mark.feature("device/lifetime-and-leaks")
@pytest.mark.parametrize("own", [True, False])
@pytest.mark.parametrize("make", [a_buffer, an_image])
def test_memory_that_is_refused_when_it_is_bound_leaves_no_object(
    vulkan_device, memory, monkeypatch, make, own
):
    """Also where the memory is the caller's, as that of a frame graph is."""
    needs = vk.new("VkMemoryRequirements", size=2 << 20, alignment=1 << 16, memoryTypeBits=2**32 - 1)
    lent = None if own else memory.allocate(needs, "device", linear=make is a_buffer)
    place = None if lent is None else (lent.memory, lent.offset)
    before, used = dict(vulkan_device.alive), ranges_of(memory)
    for call in ("vkBindBufferMemory", "vkBindImageMemory"):
        monkeypatch.setitem(vulkan_device.fn.__dict__, call, lambda *_: vk.VK_ERROR_OUT_OF_DEVICE_MEMORY)
    kinds = {
        a_buffer: lambda: create_buffer(vulkan_device, 1 << 20, USAGE, "device", "refused", place),
        an_image: lambda: create_image(
            vulkan_device, "rgba8", (8, 8), vk.VK_IMAGE_USAGE_SAMPLED_BIT, "refused", place=place
        ),
    }
    with pytest.raises(vk.VulkanError, match=r"vkBind.*VK_ERROR_OUT_OF_DEVICE_MEMORY"):
        kinds[make]()
    assert vulkan_device.alive.keys() - before.keys() <= {
        key for key in vulkan_device.alive if key[0] == "VkDeviceMemory"
    }
    assert ranges_of(memory) == used
    if lent is not None:
        memory.free(lent)


def ranges_of(memory):
    """Return how many ranges of blocks are in use."""
    return sum(block.live for blocks in memory._blocks.values() for block in blocks)


@pytest.mark.feature("device/lifetime-and-leaks")
def test_memory_that_cannot_be_mapped_is_given_back(vulkan_instance):
    with Device(vulkan_instance) as device:
        before = dict(device.alive)
        device.fn.__dict__["vkMapMemory"] = lambda *_: vk.VK_ERROR_MEMORY_MAP_FAILED
        with pytest.raises(vk.VulkanError, match="vkMapMemory") as caught:
            create_buffer(device, 64, USAGE, "upload", "refused")
        assert device.alive == before and caught.value.exit_code == 1


@pytest.mark.feature("device/lifetime-and-leaks")
def test_what_a_lack_of_memory_leaves_is_freed_with_the_device(vulkan_instance):
    """It may come between any two creations, and the sentence about it is the one that counts."""
    freed = []

    def opened():
        with Device(vulkan_instance) as device:
            real = device.fn.vkDestroyDevice
            device.fn.__dict__["vkDestroyDevice"] = lambda *words: (
                freed.append(dict(device.alive)),
                real(*words),
            )
            an_image(device)
            a_buffer(device)
            raise vk.VulkanError("vkAllocateMemory", vk.VK_ERROR_OUT_OF_DEVICE_MEMORY)

    with pytest.raises(vk.VulkanError, match="smaller --size or scene"):
        opened()
    assert freed == [{}]


def test_a_lack_of_memory_is_the_same_sentence_in_another_process():
    for code, full in ((vk.VK_ERROR_OUT_OF_HOST_MEMORY, True), (vk.VK_ERROR_OUT_OF_POOL_MEMORY, False)):
        error = vk.VulkanError("vkCall", code)
        sent = pickle.loads(pickle.dumps(error))
        assert (str(sent), sent.is_full, sent.exit_code) == (str(error), full, 2 if full else 1)
        assert isinstance(sent, DeviceError)


@pytest.mark.feature("device/persistent-mapping")
def test_mapped_memory_is_one_range_of_bytes_for_as_long_as_the_buffer_lives(vulkan_device, memory):
    buffer = create_buffer(vulkan_device, 1000, USAGE, "upload", "mapped")
    values = buffer.view(np.uint32)
    assert values.shape == (250,)
    values[:] = np.arange(250)
    assert np.array_equal(buffer.mapped, np.arange(250, dtype=np.uint32).view(np.uint8))
    assert buffer.view(np.float64).shape == (125,)
    destroy_buffer(vulkan_device, buffer)
