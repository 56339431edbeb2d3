"""Readback: from which memory, with which bytes, and how fast beside memory that is not cached."""

from __future__ import annotations

import statistics
import time

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, transition
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST, Readback, read_image
from backends.vulkan.resources import FORMATS, create_buffer, create_image, destroy_buffer, destroy_image
from backends.vulkan.upload import Uploader
from common.images.blocks import BLOCK_BYTES
from tests.support.packed import channels_of

USAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
)

CACHED = vk.VK_MEMORY_PROPERTY_HOST_CACHED_BIT


def uploaded(device, format, pixels):
    image = create_image(device, format, pixels.shape[1::-1], USAGE, format)
    with Uploader(device) as uploader:
        uploader.image(image, pixels)
    return image


def type_of(device, buffer):
    """Return the memory type's flags of a buffer."""
    found = [
        index
        for (index, _), blocks in device.memory._blocks.items()
        if any(block is buffer.allocation.block for block in blocks)
    ]
    return device.memory.types[found[0]].flags


@pytest.mark.feature("device/host-cached-readback")
def test_what_the_cpu_reads_lies_in_memory_that_it_caches(vulkan_device):
    if not any(kind.flags & CACHED for kind in vulkan_device.memory.types):
        pytest.skip("the device has no cached memory")
    image = create_image(vulkan_device, "rgba8", (8, 8), USAGE, "image")
    readback = Readback(vulkan_device, image, "readback")
    assert type_of(vulkan_device, readback.buffer) & CACHED
    readback.close()
    destroy_image(vulkan_device, image)


@pytest.mark.feature("device/host-cached-readback")
def test_21_megabytes_come_back_whole_and_their_rate_is_told(vulkan_device, record_property):
    size = (2625, 2000)  # 21,000,000 bytes
    pixels = np.random.default_rng(1).integers(0, 256, (size[1], size[0], 4), np.uint8)
    image = uploaded(vulkan_device, "rgba8", pixels)
    readback = Readback(vulkan_device, image, "21 MB")
    with submit_once(vulkan_device) as commands:
        transition(vulkan_device, commands, image, "sampled", "copy_source")
        readback.record(commands)
        vulkan_device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
    assert np.array_equal(readback.read(), pixels)

    def rate(read):
        times = []
        for _ in range(3):
            began = time.perf_counter()
            read()
            times.append(time.perf_counter() - began)
        return 21e-3 / statistics.median(times)

    usage = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    other = create_buffer(vulkan_device, pixels.nbytes, usage, "upload", "not for reading")
    cached = "cached" if type_of(vulkan_device, other) & CACHED else "uncached"
    record_property("readback_GB_per_s", round(rate(readback.read), 2))
    record_property(f"upload_memory_{cached}_GB_per_s", round(rate(other.mapped.copy), 2))
    destroy_buffer(vulkan_device, other)
    readback.close()
    destroy_image(vulkan_device, image)


@pytest.mark.parametrize("format", sorted(FORMATS.keys() - BLOCK_BYTES.keys()))
def test_every_format_comes_back_in_its_own_type_and_shape(vulkan_device, format):
    _, texel, dtype, channels = FORMATS[format]
    values = np.random.default_rng(2).integers(0, 200, (5, 7, channels)).astype(dtype)
    if format == "rgb10a2":
        values = np.random.default_rng(2).integers(0, 2**32, (5, 7, 1), np.uint32)
    if format == "d32f":
        values = (values / 256).astype(dtype)
    image = uploaded(vulkan_device, format, values)
    found = read_image(vulkan_device, image, "sampled")
    expected = values[..., 0] if channels == 1 else values
    if format == "rgb10a2":  # its channels share a word
        expected = channels_of(expected)
    else:
        assert found.dtype == dtype
        assert found.itemsize * channels == texel
    assert np.array_equal(found, expected)
    assert np.array_equal(read_image(vulkan_device, image, "sampled"), found), "it can be read again"
    destroy_image(vulkan_device, image)


def test_what_was_read_does_not_change_with_the_buffer(vulkan_device):
    image = uploaded(vulkan_device, "r8", np.full((4, 4, 1), 7, np.uint8))
    readback = Readback(vulkan_device, image, "readback")
    readback.buffer.mapped[:] = 1
    first = readback.read()
    readback.buffer.mapped[:] = 2
    assert (first == 1).all()
    readback.close()
    destroy_image(vulkan_device, image)


@pytest.mark.parametrize(("coherent", "calls"), [(True, 0), (False, 1)])
def test_memory_that_is_not_coherent_is_invalidated_before_it_is_read(vulkan_device, coherent, calls):
    image = uploaded(vulkan_device, "r8", np.zeros((4, 4, 1), np.uint8))
    readback = Readback(vulkan_device, image, "readback")
    readback.buffer.allocation.coherent = coherent
    log = []
    vulkan_device.fn.trace(log)
    readback.read()
    vulkan_device.fn.trace(None)
    assert [name for name, _ in log] == ["vkInvalidateMappedMemoryRanges"] * calls
    readback.close()
    destroy_image(vulkan_device, image)
