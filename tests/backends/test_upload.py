"""The upload ring: what goes up arrives whole, however large or many, and mip levels are exact box filters."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan import upload
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST, read_image
from backends.vulkan.resources import (
    FORMATS,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
    mip_levels,
)
from backends.vulkan.upload import HALF, SETS, Uploader
from tests.support.mip_levels import halved_codes

COPIES = vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
IMAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT
    | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
    | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
    | vk.VK_IMAGE_USAGE_STORAGE_BIT
)


def downloaded(device, buffer):
    """Return the bytes of a buffer of the GPU."""
    back = create_buffer(device, buffer.size, COPIES, "readback", "back")
    with submit_once(device) as commands:
        region = vk.new("VkBufferCopy", size=buffer.size)
        device.fn.vkCmdCopyBuffer(commands, buffer.handle, back.handle, 1, region)
        device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
    device.memory.invalidate(back.allocation)
    found = back.mapped.copy()
    destroy_buffer(device, back)
    return found


def counted_submissions(device, monkeypatch):
    real, count = device.fn.vkQueueSubmit2, []

    def submit(*arguments):
        count.append(1)
        return real(*arguments)

    monkeypatch.setitem(device.fn.__dict__, "vkQueueSubmit2", submit)
    return count


# --- the ring ---------------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/staging-copies")
def test_an_array_larger_than_the_ring_arrives_whole(vulkan_device, monkeypatch):
    """Two and a half rings of data: both halves are filled, waited for, and filled again."""
    data = np.random.default_rng(1).integers(0, 256, 5 * HALF + 12345, np.uint8)
    target = create_buffer(vulkan_device, data.size + 3, COPIES, "device", "large")
    count = counted_submissions(vulkan_device, monkeypatch)
    with Uploader(vulkan_device) as uploader:
        uploader.buffer(target, data, 3)
        assert uploader.bytes == data.size
    assert len(count) == 6
    assert np.array_equal(downloaded(vulkan_device, target)[3:], data)
    destroy_buffer(vulkan_device, target)


def test_a_row_may_fill_half_the_ring_and_no_more(vulkan_device, monkeypatch):
    monkeypatch.setattr(upload, "HALF", 256)
    usage = IMAGE & ~vk.VK_IMAGE_USAGE_STORAGE_BIT
    row = np.arange(256, dtype=np.uint8).reshape(1, 64, 4)
    for width in (64, 65):
        image = create_image(vulkan_device, "rgba8", (width, 1), usage, "row")
        with Uploader(vulkan_device) as uploader:
            if width == 64:
                uploader.image(image, row)
            else:
                with pytest.raises(ValueError, match="One row of 260 bytes does not fit"):
                    uploader.image(image, np.zeros((1, 65, 4), np.uint8))
        if width == 64:
            assert np.array_equal(read_image(vulkan_device, image, "sampled").reshape(row.shape), row)
        destroy_image(vulkan_device, image)


def test_many_small_arrays_go_up_in_one_submission(vulkan_device, monkeypatch):
    rng = np.random.default_rng(2)
    pieces = [rng.integers(0, 256, rng.integers(1, 40), np.uint8) for _ in range(2000)]
    target = create_buffer(vulkan_device, sum(map(len, pieces)), COPIES, "device", "pieces")
    count = counted_submissions(vulkan_device, monkeypatch)
    with Uploader(vulkan_device) as uploader:
        place = 0
        for piece in pieces:
            uploader.buffer(target, piece, place)
            place += len(piece)
        assert count == []
    assert len(count) == 1
    assert np.array_equal(downloaded(vulkan_device, target), np.concatenate(pieces))
    destroy_buffer(vulkan_device, target)


def test_any_type_goes_up_as_its_bytes(vulkan_device):
    grid = np.arange(24, dtype=np.float64).reshape(4, 6)[:, ::2]  # neither bytes nor contiguous
    target = create_buffer(vulkan_device, grid.size * 8, COPIES, "device", "grid")
    with Uploader(vulkan_device) as uploader:
        uploader.buffer(target, grid)
    assert np.array_equal(downloaded(vulkan_device, target).view(np.float64).reshape(4, 3), grid)
    destroy_buffer(vulkan_device, target)


@pytest.mark.parametrize("format", ["rgba8", "rgba16f", "rgba32f", "r32ui", "r8"])
def test_images_arrive_in_every_format_and_odd_size(vulkan_device, format):
    _, _, dtype, channels = FORMATS[format]
    rng = np.random.default_rng(3)
    usage = IMAGE & ~vk.VK_IMAGE_USAGE_STORAGE_BIT
    for size in ((1, 1), (3, 2), (33, 17), (250, 3)):
        image = create_image(vulkan_device, format, size, usage, "odd")
        pixels = (rng.random((size[1], size[0], channels)) * 250).astype(dtype)
        with Uploader(vulkan_device) as uploader:
            uploader.image(image, pixels)
        found = read_image(vulkan_device, image, "sampled").reshape(pixels.shape)
        assert np.array_equal(found, pixels)
        destroy_image(vulkan_device, image)


def test_an_image_larger_than_the_ring_goes_up_by_rows(vulkan_device, monkeypatch):
    """Rows that do not divide the ring, in more parts than it has halves."""
    size = (2999, 1801)
    image = create_image(vulkan_device, "rgba8", size, IMAGE, "large")
    pixels = np.random.default_rng(4).integers(0, 256, (size[1], size[0], 4), np.uint8)
    before = create_buffer(vulkan_device, 8, COPIES, "device", "before")
    count = counted_submissions(vulkan_device, monkeypatch)
    with Uploader(vulkan_device) as uploader:
        uploader.buffer(before, pixels[0, :2])  # so that the first row does not begin at 0
        uploader.image(image, pixels)
    assert len(count) == 3
    assert np.array_equal(read_image(vulkan_device, image, "sampled"), pixels)
    destroy_buffer(vulkan_device, before)
    destroy_image(vulkan_device, image)


@pytest.mark.feature("device/staging-copies")
def test_what_does_not_fit_is_refused_by_name(vulkan_device):
    buffer = create_buffer(vulkan_device, 16, COPIES, "device", "small")
    image = create_image(vulkan_device, "rgba8", (4, 2), IMAGE, "picture", levels=3)
    with Uploader(vulkan_device) as uploader:
        with pytest.raises(ValueError, match="9 bytes at 8 do not fit into 'small' of 16 bytes"):
            uploader.buffer(buffer, np.zeros(9, np.uint8), 8)
        with pytest.raises(ValueError, match=r"'picture' wants \(2, 4, 4\) uint8, not \(4, 2, 4\) uint8"):
            uploader.image(image, np.zeros((4, 2, 4), np.uint8))
        with pytest.raises(ValueError, match=r"not \(2, 4, 4\) float32"):
            uploader.image(image, np.zeros((2, 4, 4), np.float32))
    destroy_buffer(vulkan_device, buffer)
    destroy_image(vulkan_device, image)


@pytest.mark.feature("device/lifetime-and-leaks")
def test_an_exception_between_uploads_leaves_nothing(vulkan_device):
    before = {key for key in vulkan_device.alive if key[0] != "VkDeviceMemory"}
    with pytest.raises(KeyboardInterrupt), Uploader(vulkan_device):
        raise KeyboardInterrupt
    assert {key for key in vulkan_device.alive if key[0] != "VkDeviceMemory"} == before


# --- mip levels -------------------------------------------------------------------------------------------------------


def levels_of(device, image):
    """Return every level of an image in state 'sampled'."""
    found = []
    _, texel, dtype, channels = FORMATS[image.format]
    for level in range(image.levels):
        width, height = max(1, image.width >> level), max(1, image.height >> level)
        back = create_buffer(device, width * height * texel, COPIES, "readback", "level")
        region = vk.new(
            "VkBufferImageCopy",
            imageSubresource={"aspectMask": image.aspect, "mipLevel": level, "layerCount": 1},
            imageExtent={"width": width, "height": height, "depth": 1},
        )
        with submit_once(device) as commands:
            fn = device.fn
            there = image_barrier(image.handle, image.aspect, "sampled", "copy_source")
            back_again = image_barrier(image.handle, image.aspect, "copy_source", "sampled")
            fn.vkCmdPipelineBarrier2(commands, barriers(there))
            layout = vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL
            fn.vkCmdCopyImageToBuffer(commands, image.handle, layout, back.handle, 1, region)
            fn.vkCmdPipelineBarrier2(commands, barriers(back_again, memory=TO_HOST))
        device.memory.invalidate(back.allocation)
        found.append(back.view(dtype)[: width * height * channels].reshape(height, width, channels).copy())
        destroy_buffer(device, back)
    return found


def uploaded_levels(device, format, pixels, **more):
    size = pixels.shape[1::-1]
    image = create_image(device, format, size, IMAGE, "chain", levels=mip_levels(*size), **more)
    with Uploader(device) as uploader:
        uploader.image(image, pixels, srgb="view_format" in more)
    found = levels_of(device, image)
    destroy_image(device, image)
    return found


SIZES = [(1, 1), (2, 1), (1, 5), (3, 2), (8, 8), (17, 9), (100, 37), (64, 3)]


@pytest.mark.parametrize("size", SIZES)
def test_every_level_is_the_box_filter_of_the_one_above(vulkan_device, size):
    pixels = np.random.default_rng(5).integers(0, 256, (size[1], size[0], 4), np.uint8)
    levels = uploaded_levels(vulkan_device, "rgba8", pixels)
    assert np.array_equal(levels[0], pixels)
    for above, level in pairwise(levels):
        truth = halved_codes(above)
        assert level.shape == truth.shape
        assert np.abs(level - truth).max() <= 0.5 + 1e-3, "rounded to the nearest code"


@pytest.mark.parametrize("size", SIZES)
def test_srgb_colour_is_averaged_as_light_and_alpha_as_it_is(vulkan_device, size):
    pixels = np.random.default_rng(6).integers(0, 256, (size[1], size[0], 4), np.uint8)
    levels = uploaded_levels(vulkan_device, "rgba8", pixels, view_format="rgba8_srgb")
    for above, level in pairwise(levels):
        assert np.abs(level - halved_codes(above, srgb=True)).max() <= 0.5 + 1e-2


def test_light_is_kept_from_the_first_level_to_the_last(vulkan_device):
    """The mean of the one texel at the end is that of all texels, for sizes that halve badly."""
    pixels = np.random.default_rng(7).random((53, 97, 4)).astype(np.float32)
    levels = uploaded_levels(vulkan_device, "rgba32f", pixels)
    assert levels[-1].shape == (1, 1, 4)
    for level in levels:
        assert (
            np.abs(
                level.mean(axis=(0, 1), dtype=np.float64) - pixels.mean(axis=(0, 1), dtype=np.float64)
            ).max()
            < 2e-6
        )


def test_more_levels_than_sets_go_up_in_several_submissions(vulkan_device, monkeypatch):
    """Each level takes a descriptor set; the pool of a half holds a fixed number."""
    monkeypatch.setattr("backends.vulkan.upload.SETS", 12)
    assert SETS > 12
    rng = np.random.default_rng(8)
    images = [create_image(vulkan_device, "rgba8", (8, 8), IMAGE, f"image {n}", levels=4) for n in range(10)]
    pixels = [rng.integers(0, 256, (8, 8, 4), np.uint8) for _ in images]
    count = counted_submissions(vulkan_device, monkeypatch)
    with Uploader(vulkan_device) as uploader:
        for image, some in zip(images, pixels, strict=True):
            uploader.image(image, some)
    assert len(count) >= 3
    for image, some in zip(images, pixels, strict=True):
        levels = levels_of(vulkan_device, image)
        assert np.array_equal(levels[0], some)
        assert np.abs(levels[1] - halved_codes(some)).max() <= 0.5 + 1e-3
        destroy_image(vulkan_device, image)
