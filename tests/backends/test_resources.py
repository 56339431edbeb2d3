"""Buffers, images and samplers: what they hold, what sampling gives, and under which name messages show them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.memory import Allocation
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import (
    FORMATS,
    Buffer,
    create_buffer,
    create_image,
    create_sampler,
    create_view,
    destroy_buffer,
    destroy_image,
    mip_levels,
)
from backends.vulkan.selftests.bench import Bench
from backends.vulkan.upload import Uploader
from common.images.blocks import FEATURE
from common.scene import Sampler
from tests.support.bounds import decoded_srgb
from tests.support.drawing import draw

NUMBERS = {
    "r8": 9,
    "r8ui": 13,
    "rg8": 16,
    "rgba8": 37,
    "rgba8_srgb": 43,
    "rgb10a2": 64,
    "rg16f": 83,
    "rgba16f": 97,
    "r32ui": 98,
    "rg32ui": 101,
    "r32f": 100,
    "rgba32f": 109,
    "d32f": 126,
    "bc4": 139,
    "bc5": 141,
    "bc7": 145,
    "bc7_srgb": 146,
    "etc2": 147,
    "etc2_srgb": 148,
}
"""The values of VkFormat, as the Vulkan specification numbers them ("Format Definition")."""

COPIES = vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
SAMPLED = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT | vk.VK_IMAGE_USAGE_STORAGE_BIT


# --- buffers ----------------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/staging-copies")
def test_random_bytes_survive_upload_copy_and_download(vulkan_device):
    """Odd sizes from odd offsets to odd offsets: staged, copied between two buffers of the GPU, read back."""
    rng = np.random.default_rng(1)
    size = 5003
    first, second = (
        create_buffer(vulkan_device, size, COPIES, "device", name) for name in ("first", "second")
    )
    back = create_buffer(vulkan_device, size, COPIES, "readback", "back")
    for count, start, place in ((1, 0, 0), (1, 4999, 17), (4097, 3, 901), (5003, 0, 0), (7, 4996, 4995)):
        data = rng.integers(0, 256, count, np.uint8)
        with Uploader(vulkan_device) as uploader:
            uploader.buffer(first, np.zeros(size, np.uint8))
            uploader.buffer(second, np.zeros(size, np.uint8))
        with Uploader(vulkan_device) as uploader:
            uploader.buffer(first, data, start)
        with submit_once(vulkan_device) as commands:
            fn = vulkan_device.fn
            region = vk.new("VkBufferCopy", srcOffset=start, dstOffset=place, size=min(count, size - place))
            fn.vkCmdCopyBuffer(commands, first.handle, second.handle, 1, region)
            barrier = vk.new(
                "VkDependencyInfo",
                pMemoryBarriers=[
                    {
                        "srcStageMask": vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT,
                        "srcAccessMask": vk.VK_ACCESS_2_TRANSFER_WRITE_BIT,
                        "dstStageMask": vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT,
                        "dstAccessMask": vk.VK_ACCESS_2_MEMORY_READ_BIT,
                    }
                ],
            )
            fn.vkCmdPipelineBarrier2(commands, barrier)
            whole = vk.new("VkBufferCopy", size=size)
            fn.vkCmdCopyBuffer(commands, second.handle, back.handle, 1, whole)
            fn.vkCmdPipelineBarrier2(commands, barrier)
        vulkan_device.memory.invalidate(back.allocation)
        expected = np.zeros(size, np.uint8)
        expected[place : place + count] = data[: size - place]
        assert np.array_equal(back.mapped, expected)
    for buffer in (first, second, back):
        destroy_buffer(vulkan_device, buffer)


@pytest.mark.feature("device/buffers")
@pytest.mark.parametrize("use", ["device", "upload"])
def test_buffers_give_back_exact_bytes(vulkan_device, use):
    """What goes up once, and what the CPU writes anew: copied by the GPU into what the CPU reads."""
    fn = vulkan_device.fn
    buffer = create_buffer(vulkan_device, 1031, COPIES, use, use)
    back = create_buffer(vulkan_device, 1031, COPIES, "readback", "back")
    for seed in range(2):
        data = np.random.default_rng(seed).integers(0, 256, 1021, np.uint8)
        if use == "upload":
            buffer.mapped[7 : 7 + 1021] = data
        else:
            with Uploader(vulkan_device) as uploader:
                uploader.buffer(buffer, data, 7)
        with submit_once(vulkan_device) as commands:
            fn.vkCmdCopyBuffer(commands, buffer.handle, back.handle, 1, vk.new("VkBufferCopy", size=1031))
            fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
        vulkan_device.memory.invalidate(back.allocation)
        assert np.array_equal(back.mapped[7 : 7 + 1021], data)
    for made in (buffer, back):
        destroy_buffer(vulkan_device, made)


@pytest.mark.feature("device/buffers")
def test_the_storage_of_a_buffer_is_bound_once(vulkan_device):
    """What OpenGL refuses by itself, the layers say of Vulkan."""
    if not vulkan_device.instance.validates:
        pytest.skip("there are no validation layers")
    buffer, sink = create_buffer(vulkan_device, 64, COPIES, "device", "once"), vulkan_device.sink
    assert sink.report() == []
    place = buffer.allocation.memory, buffer.allocation.offset
    vulkan_device.fn.vkBindBufferMemory(vulkan_device.handle, buffer.handle, *place)
    assert any("vkBindBufferMemory" in text and "once" in text for text in sink.report())
    sink.messages.clear()
    destroy_buffer(vulkan_device, buffer)


RECORDS = """
layout(local_size_x = 1) in;
layout(set = 0, binding = 0) uniform Record { uvec4 place; vec4 value; float more; };
layout(set = 0, binding = 1, std430) buffer Found { float found[]; };
void main() { found[place.x] = value.y; }
"""


@pytest.mark.feature("device/uniform-buffers")
@pytest.mark.feature("device/buffers")
def test_each_dispatch_sees_its_own_record_of_one_uniform_buffer(vulkan_device):
    """Records lie at multiples of the device's alignment; at another place the layers name the binding."""
    alignment = vulkan_device.capabilities.limits["minUniformBufferOffsetAlignment"]
    size = 36  # more than a multiple of the smallest alignment that there is, 16
    stride = -(-size // alignment) * alignment
    records = np.zeros((5, stride // 4), np.float32)
    records.view(np.uint32)[:, 0] = np.arange(5)[::-1]
    records[:, 5] = np.arange(5) + 0.5
    dynamic, storage = vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER_DYNAMIC, vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER
    stage, point = vk.VK_SHADER_STAGE_COMPUTE_BIT, vk.VK_PIPELINE_BIND_POINT_COMPUTE
    fn = vulkan_device.fn
    with Bench(vulkan_device) as bench:
        buffer = bench.input(records, vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT)
        found = bench.output(5)
        kinds = (dynamic, storage)
        bindings = [
            {"binding": i, "descriptorType": kind, "descriptorCount": 1, "stageFlags": stage}
            for i, kind in enumerate(kinds)
        ]
        of_set = bench.make(
            "vkCreateDescriptorSetLayout", "VkDescriptorSetLayoutCreateInfo", pBindings=bindings
        )
        layout = bench.make("vkCreatePipelineLayout", "VkPipelineLayoutCreateInfo", pSetLayouts=[of_set])
        sizes = [{"type": kind, "descriptorCount": 1} for kind in kinds]
        pool = bench.make("vkCreateDescriptorPool", "VkDescriptorPoolCreateInfo", maxSets=1, pPoolSizes=sizes)
        sets = vk.ffi.new("VkDescriptorSet[1]")
        allocate = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=[of_set])
        vk.check(
            fn.vkAllocateDescriptorSets(vulkan_device.handle, allocate, sets), "vkAllocateDescriptorSets"
        )
        writes = [
            {
                "dstSet": sets[0],
                "dstBinding": i,
                "descriptorCount": 1,
                "descriptorType": kind,
                "pBufferInfo": [{"buffer": one.handle, "range": length}],
            }
            for i, (kind, one, length) in enumerate(((dynamic, buffer, size), (storage, found, found.size)))
        ]
        fn.vkUpdateDescriptorSets(
            vulkan_device.handle, 2, vk.array("VkWriteDescriptorSet", writes), 0, vk.NULL
        )
        (stages,) = bench.stages({"comp": RECORDS})
        info = vk.new("VkComputePipelineCreateInfo", stage=stages, layout=layout)
        infos = vk.array("VkComputePipelineCreateInfo", [info])
        (pipeline,) = vulkan_device.create_pipelines("vkCreateComputePipelines", infos, ["records"])
        bench.at_end(vulkan_device.destroy, "VkPipeline", pipeline)

        def bind(commands, offset):
            offsets = vk.ffi.new("uint32_t[1]", [offset])
            fn.vkCmdBindDescriptorSets(commands, point, layout, 0, 1, sets, 1, offsets)

        with submit_once(vulkan_device) as commands:
            fn.vkCmdBindPipeline(commands, point, pipeline)
            for index in range(5):
                bind(commands, index * stride)
                fn.vkCmdDispatch(commands, 1, 1, 1)
            fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
        assert bench.read(found, np.float32).tolist() == [4.5, 3.5, 2.5, 1.5, 0.5]
        assert vulkan_device.sink.report() == []
        if vulkan_device.instance.validates:
            with submit_once(vulkan_device) as commands:
                bind(commands, alignment // 2)
            assert any("vkCmdBindDescriptorSets" in text for text in vulkan_device.sink.report())
            vulkan_device.sink.messages.clear()


def test_a_buffer_is_never_empty_and_knows_its_size(vulkan_device):
    buffer = create_buffer(vulkan_device, 0, COPIES, "upload", "nothing")
    assert (buffer.size, len(buffer.mapped)) == (4, 4)
    destroy_buffer(vulkan_device, buffer)


@pytest.mark.feature("device/persistent-mapping")
def test_memory_that_the_cpu_cannot_reach_is_named():
    buffer = Buffer(None, 64, Allocation(None, 0, 64, None, True, None), "vertices")
    with pytest.raises(ValueError, match="'vertices' is in memory that the CPU cannot map"):
        buffer.view(np.float32)


# --- images -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (3, 5), (255, 2), (256, 256), (257, 1), (4096, 16)])
def test_a_full_chain_halves_the_longer_side_down_to_one(size):
    steps, side = 1, max(size)
    while side > 1:
        side //= 2
        steps += 1
    assert mip_levels(*size) == steps


@pytest.mark.feature("device/lifetime-and-leaks")
def test_an_image_goes_with_all_its_views(vulkan_device):
    before = dict(vulkan_device.alive)
    image = create_image(vulkan_device, "rgba8", (16, 8), SAMPLED, "shown", levels=5)
    create_view(vulkan_device, image, "rgba8", level=2, levels=1)
    made = [
        name for key, name in vulkan_device.alive.items() if key not in before and key[0] != "VkDeviceMemory"
    ]
    assert sorted(made) == ["shown", "shown view", "shown view"]
    destroy_image(vulkan_device, image)
    left = {key for key in vulkan_device.alive if key not in before}
    assert all(kind == "VkDeviceMemory" for kind, _ in left), "blocks are kept for the next one"


@pytest.mark.feature("device/textures")
def test_every_format_has_the_number_of_the_specification():
    """No picture shows this of the formats that the driver at hand lacks."""
    assert {name: constant for name, (constant, *_) in FORMATS.items()} == NUMBERS


def test_every_format_can_be_made_with_its_aspect(vulkan_device):
    for name in FORMATS:
        if name in FEATURE and not vulkan_device.has(FEATURE[name]):
            continue
        image = create_image(vulkan_device, name, (4, 4), vk.VK_IMAGE_USAGE_SAMPLED_BIT, name)
        depth = image.aspect == vk.VK_IMAGE_ASPECT_DEPTH_BIT
        assert depth == (name == "d32f")
        destroy_image(vulkan_device, image)


@pytest.mark.feature("device/textures")
def test_an_srgb_view_decodes_and_a_plain_one_does_not(vulkan_device):
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(4, axis=2)
    sampler = create_sampler(vulkan_device, Sampler("nearest", "nearest", None), 1.0, "nearest")
    found = {}
    for view in ("rgba8", "rgba8_srgb"):
        image = create_image(vulkan_device, "rgba8", (16, 16), SAMPLED, view, view_format=view)
        with Uploader(vulkan_device) as uploader:
            uploader.image(image, codes)
        found[view] = draw(vulkan_device, TEXEL, (16, 16), textures={0: (image, sampler)})
        destroy_image(vulkan_device, image)
    vulkan_device.destroy("VkSampler", sampler)
    c = codes / 255.0
    light = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)  # IEC 61966-2-1
    light[..., 3] = c[..., 3]
    assert np.abs(found["rgba8"] - c).max() < 1e-7
    low, high = decoded_srgb(codes[..., :3])
    assert ((low <= found["rgba8_srgb"][..., :3]) & (found["rgba8_srgb"][..., :3] <= high)).all()
    if vulkan_device.capabilities.is_software:
        # Half a step of 8 bits: the software driver decodes with a polynomial that is 1.2e-3 off.
        assert np.abs(found["rgba8_srgb"] - light).max() < 0.5 / 255
    assert np.abs(found["rgba8_srgb"] - c)[..., :3].max() > 0.2


TEXEL = """
layout(BIND(0, 0, 0)) uniform sampler2D image;
layout(location = 0) out vec4 out_color;
void main() { out_color = texelFetch(image, ivec2(gl_FragCoord.xy), 0); }
"""


# --- samplers ---------------------------------------------------------------------------------------------------------

SIZE = (7, 5)
LEVELS = 3

SAMPLE = """
layout(BIND(0, 0, 0)) uniform sampler2D image;
layout(location = 0) out vec4 out_color;
void main() {
    vec2 uv = (gl_FragCoord.xy - vec2(32.1, 16.3)) / vec2(19.37, 11.71);
    out_color = textureLod(image, uv, LOD);
}
"""


@pytest.fixture(scope="module")
def noise(vulkan_device):
    """Random texels, (5, 7, 4) float32, and their levels as numpy: those of the GPU, read by nearest fetches."""
    image = create_image(vulkan_device, "rgba32f", SIZE, SAMPLED, "noise", levels=LEVELS)
    texels = np.random.default_rng(2).random((SIZE[1], SIZE[0], 4), np.float32)
    with Uploader(vulkan_device) as uploader:
        uploader.image(image, texels)
    plain = create_sampler(vulkan_device, Sampler("nearest", "nearest", "nearest"), 1.0, "fetch")
    levels = []
    for level in range(LEVELS):
        size = (max(1, SIZE[0] >> level), max(1, SIZE[1] >> level))
        text = TEXEL.replace(", 0);", f", {level});")
        levels.append(draw(vulkan_device, text, size, textures={0: (image, plain)}).astype(np.float64))
    assert np.array_equal(levels[0], texels)
    yield image, levels
    vulkan_device.destroy("VkSampler", plain)
    destroy_image(vulkan_device, image)


def wrapped(index, count, wrap):
    """Return the texel that an index outside 0..count-1 means (Vulkan specification, "Wrapping Operation")."""
    if wrap == "repeat":
        return index % count
    if wrap == "clamp":
        return np.clip(index, 0, count - 1)
    folded = index % (2 * count)
    return np.where(folded < count, folded, 2 * count - 1 - folded)


def sampled(texels, uv, filter, wraps):
    """Return (H, W, 4) float64: `texels` at `uv` (H, W, 2), by the formulas of the specification."""
    size = np.array(texels.shape[1::-1])
    place = uv * size
    if filter == "nearest":
        i, j = (wrapped(np.floor(place[..., k]).astype(int), size[k], wraps[k]) for k in (0, 1))
        return texels[j, i]
    base = np.floor(place - 0.5).astype(int)
    part = place - 0.5 - base
    total = 0.0
    for dx, dy in itertools.product((0, 1), (0, 1)):
        i, j = (wrapped(base[..., k] + (dx, dy)[k], size[k], wraps[k]) for k in (0, 1))
        weight = (part[..., 0] if dx else 1 - part[..., 0]) * (part[..., 1] if dy else 1 - part[..., 1])
        total = total + weight[..., None] * texels[j, i]
    return total


def expected(levels, uv, lod, sampler):
    filter = sampler.mag if lod <= 0 else sampler.min
    lod = min(max(lod, 0.0), LEVELS - 1.0)
    wraps = (sampler.wrap_u, sampler.wrap_v)
    if sampler.mipmap is None:
        return sampled(levels[0], uv, filter, wraps)
    if sampler.mipmap == "nearest":
        return sampled(levels[int(np.floor(lod + 0.5))], uv, filter, wraps)
    low = min(int(lod), LEVELS - 2)
    return sum(
        weight * sampled(levels[level], uv, filter, wraps)
        for level, weight in ((low, 1 - (lod - low)), (low + 1, lod - low))
    )


FILTERS = {
    # glTF's number of a minification filter: (filter, mipmap); 9728 and 9729 are magnification filters too
    9728: ("nearest", None),
    9729: ("linear", None),
    9984: ("nearest", "nearest"),
    9985: ("linear", "nearest"),
    9986: ("nearest", "linear"),
    9987: ("linear", "linear"),
}


@pytest.mark.feature("device/samplers")
@pytest.mark.parametrize("number", FILTERS)
@pytest.mark.parametrize("mag", ["nearest", "linear"])
def test_filters_and_wraps_are_those_of_the_specification(vulkan_device, noise, number, mag):
    image, levels = noise
    minify, mipmap = FILTERS[number]
    y, x = np.mgrid[0:33, 0:64] + 0.5
    uv = np.stack([(x - 32.1) / 19.37, (y - 16.3) / 11.71], axis=-1)
    for wraps in (("repeat", "mirror"), ("clamp", "repeat"), ("mirror", "clamp")):
        sampler = Sampler(mag, minify, mipmap, *wraps)
        handle = create_sampler(vulkan_device, sampler, 1.0, str(number))
        for lod in (-1.0, 0.3, 0.75, 1.6, 5.0):
            text = SAMPLE.replace("LOD", str(lod))
            found = draw(vulkan_device, text, (64, 33), textures={0: (image, handle)})
            truth = expected(levels, uv, lod, sampler)
            # Weights have at least 8 bits, and no place lies on the border of two texels.
            assert np.abs(found - truth).max() <= 2 / 256, (wraps, lod)
        vulkan_device.destroy("VkSampler", handle)


@pytest.mark.feature("device/samplers")
def test_each_filter_and_wrap_taken_for_another_is_beyond_the_bound(vulkan_device, noise):
    """Of what the test above compares: a sampler that is not the one that was asked for would be seen there."""
    image, levels = noise
    y, x = np.mgrid[0:33, 0:64] + 0.5
    uv = np.stack([(x - 32.1) / 19.37, (y - 16.3) / 11.71], axis=-1)
    asked = [Sampler("linear", *FILTERS[number], "repeat", "mirror") for number in FILTERS]
    asked += [Sampler("linear", "linear", None, wrap, wrap) for wrap in ("repeat", "clamp", "mirror")]
    text = SAMPLE.replace("LOD", "0.75")
    truths = [expected(levels, uv, 0.75, sampler) for sampler in asked]
    for number, sampler in enumerate(asked):
        handle = create_sampler(vulkan_device, sampler, 1.0, "asked for")
        found = draw(vulkan_device, text, (64, 33), textures={0: (image, handle)})
        vulkan_device.destroy("VkSampler", handle)
        apart = [np.abs(found - truth).max() for truth in truths]
        assert apart.pop(number) <= 2 / 256 and min(apart) > 0.1, sampler
