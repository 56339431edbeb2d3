"""Block-compressed textures on Vulkan: every level and layer arrives, and is sampled as other authors decode it."""

from __future__ import annotations

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan import upload
from backends.vulkan.device import Device
from backends.vulkan.resources import create_image, destroy_image, mip_levels
from backends.vulkan.selftests.bench import Bench
from backends.vulkan.selftests.bindings import Texture
from backends.vulkan.upload import Uploader
from common.errors import UnsupportedError
from common.images.blocks import PLAIN, storage_of
from common.images.mips import mip_chain
from tests.support.block_pictures import DECODED, by_level, chains, check, pictures, sampling

USAGE = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT


def sampled(device, format, size, layers, **more):
    """Return (layers, h, w, 4) float32 for each level, as a shader reads what was uploaded."""
    levels = len(layers[0])
    image = create_image(
        device, format, size, USAGE, "blocks", levels=levels, layers=len(layers), array=True, **more
    )
    with Uploader(device) as uploader:
        uploader.chain(image, layers)
        assert uploader.bytes == sum(rows.nbytes for chain in layers for rows in chain)
    text, count = sampling(*size, levels, len(layers))
    with Bench(device) as bench:
        output = bench.output(4 * count)
        bench.dispatch(text, [Texture(image.view, bench.sampler()), output], groups=(count + 63) // 64)
        texels = bench.read(output, np.float32)
    destroy_image(device, image)
    return by_level(texels, *size, levels, len(layers))


@pytest.mark.feature("textures/block-compression")
@pytest.mark.parametrize("size", [(61, 37), (16, 4), (1, 3)])
@pytest.mark.parametrize("format", DECODED[:4])
def test_every_level_and_layer_is_sampled_as_it_decodes(vulkan_device, format, size):
    if not vulkan_device.has("block-compression"):
        pytest.skip("the device has no block-compression")
    levels = mip_levels(*size)
    layers = chains(format, *size, levels, 3)
    found = sampled(vulkan_device, format, size, layers)
    for level, texels in enumerate(found):
        for layer, picture in enumerate(texels):
            check(format, picture, layers[layer][level], vulkan_device.capabilities)


def test_levels_larger_than_the_ring_go_up_by_rows_of_blocks(vulkan_device, monkeypatch):
    """Three rows of blocks fit into a half of the ring, and the image has seventeen, the last one cut by its edge."""
    if not vulkan_device.has("block-compression"):
        pytest.skip("the device has no block-compression")
    layers = chains("bc7", 62, 66, 3, 2)
    plain = sampled(vulkan_device, "bc7", (62, 66), layers)
    submitted = []
    real = Uploader.flush
    monkeypatch.setattr(Uploader, "flush", lambda self: (submitted.append(1), real(self)))
    monkeypatch.setattr(upload, "HALF", 3 * 16 * 16 + 200)
    found = sampled(vulkan_device, "bc7", (62, 66), layers)
    assert len(submitted) >= 2 * 17 // 3
    for one, other in zip(found, plain, strict=True):
        assert np.array_equal(one, other)


@pytest.mark.parametrize("format", ["r8", "rg8", "rgba8", "rgba16f"])
def test_levels_of_texels_go_up_the_same_way(vulkan_device, format):
    size, dtype = (13, 7), np.float16 if format == "rgba16f" else np.uint8
    channels = {"r8": 1, "rg8": 2}.get(format, 4)
    random = np.random.default_rng(2)
    pixels = [
        random.integers(0, 256, (max(1, 7 >> n), max(1, 13 >> n), channels)).astype(dtype) for n in range(4)
    ]
    rows = [one.view(np.uint8).reshape(len(one), -1) for one in pixels]
    for level, texels in enumerate(sampled(vulkan_device, format, size, [rows])):
        scale = 1 if format == "rgba16f" else 255
        assert np.array_equal(np.rint(texels[0, ..., :channels] * scale), pixels[level].astype(np.float64))


def test_views_and_swizzles_work_as_for_other_formats(vulkan_device):
    if not vulkan_device.has("block-compression"):
        pytest.skip("the device has no block-compression")
    colour = chains("bc7", 8, 8, 1, 1)
    srgb = sampled(vulkan_device, "bc7_srgb", (8, 8), colour)[0]
    assert np.array_equal(sampled(vulkan_device, "bc7", (8, 8), colour, view_format="bc7_srgb")[0], srgb)
    two = chains("bc5", 8, 8, 1, 1)
    plain = sampled(vulkan_device, "bc5", (8, 8), two)[0]
    moved = sampled(vulkan_device, "bc5", (8, 8), two, swizzle="0rg1")[0]
    assert np.array_equal(moved[..., 1:3], plain[..., :2])
    assert (moved[..., 0] == 0).all() and (moved[..., 3] == 1).all()


def test_wrong_levels_are_refused_by_name(vulkan_device):
    image = create_image(vulkan_device, "rgba8", (4, 4), USAGE, "picture", levels=2)
    good = [np.zeros((4, 16), np.uint8), np.zeros((2, 8), np.uint8)]
    with Uploader(vulkan_device) as uploader:
        with pytest.raises(ValueError, match="'picture' has 2 levels, and 1 were given"):
            uploader.chain(image, [good[:1]])
        with pytest.raises(ValueError, match="'picture' has 1 layers, and 2 were given"):
            uploader.chain(image, [good, good])
        with pytest.raises(
            ValueError, match=r"Level 1 of 'picture' wants \(2, 8\) uint8, not \(2, 9\) uint8"
        ):
            uploader.chain(image, [[good[0], np.zeros((2, 9), np.uint8)]])
        blocks = create_image(vulkan_device, "bc7", (4, 4), USAGE, "blocks")
        with pytest.raises(ValueError, match="'blocks' holds blocks, not pixels"):
            uploader.image(blocks, np.zeros((4, 4, 4), np.uint8))
    destroy_image(vulkan_device, blocks)
    destroy_image(vulkan_device, image)


@pytest.mark.feature("textures/block-compression")
@pytest.mark.feature("textures/etc2-ktx")
def test_a_device_without_the_feature_stores_8_bits_a_channel(vulkan_instance):
    """The plan says so, nothing compressed can be made by mistake, and the plain one shows the same picture."""
    pixels = pictures(16, 8)["alpha"]
    chain = [level.reshape(len(level), -1) for level in mip_chain(pixels, True)]
    with Device(vulkan_instance, without={"block-compression", "etc2"}) as device:
        for wanted, plain in PLAIN.items():
            assert storage_of(wanted, device.features) == plain
            feature = "etc2" if "etc2" in wanted else "block-compression"
            with pytest.raises(UnsupportedError, match=f"'t' cannot be stored as {wanted}.* lacks {feature}"):
                create_image(device, wanted, (16, 8), USAGE, "t")
        found = sampled(device, storage_of("bc7", device.features), (16, 8), [chain])
    assert np.array_equal(np.rint(found[0][0] * 255), pixels)


@pytest.mark.needs("texture2ddecoder")
def test_etc2_on_a_device_that_has_it(vulkan_device):
    """Devices that lack it refuse it by name."""
    if vulkan_device.has("etc2"):
        layers = chains("etc2", 13, 9, 4, 1)
        for level, texels in enumerate(sampled(vulkan_device, "etc2", (13, 9), layers)):
            check("etc2", texels[0], layers[0][level], vulkan_device.capabilities)
        return
    with pytest.raises(UnsupportedError, match="lacks etc2"):
        create_image(vulkan_device, "etc2", (4, 4), USAGE, "picture")


@pytest.mark.parametrize("srgb", [False, True])
@pytest.mark.parametrize("size", [(64, 32), (61, 37), (1, 7), (2, 1), (96, 3)])
def test_the_mip_chain_of_the_cpu_is_that_of_the_gpu(vulkan_device, size, srgb):
    """To one code: in a quarter of all windows the mean lies half way between two, and a GPU may take either."""
    pixels = np.random.default_rng(3).integers(0, 256, (size[1], size[0], 4), np.uint8)
    chain = mip_chain(pixels, srgb)
    usage = USAGE | vk.VK_IMAGE_USAGE_STORAGE_BIT
    image = create_image(vulkan_device, "rgba8", size, usage, "gpu", levels=mip_levels(*size), array=True)
    with Uploader(vulkan_device) as uploader:
        uploader.image(image, pixels, srgb=srgb)
    text, count = sampling(*size, image.levels, 1)
    with Bench(vulkan_device) as bench:
        output = bench.output(4 * count)
        bench.dispatch(text, [Texture(image.view, bench.sampler()), output], groups=(count + 63) // 64)
        found = by_level(bench.read(output, np.float32), *size, image.levels, 1)
    destroy_image(vulkan_device, image)
    assert len(chain) == image.levels
    for level, texels in zip(chain, found, strict=True):
        assert np.abs(level - np.rint(texels[0] * 255)).max() <= 1
