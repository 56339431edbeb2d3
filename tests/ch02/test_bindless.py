"""The set of all textures, read slot by slot in a compute shader: who owns a slot, what it holds, how it is read."""

from __future__ import annotations

from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, transition
from backends.vulkan.once import submit_once
from backends.vulkan.readback import read_image
from backends.vulkan.resources import FORMATS, Image, create_buffer, destroy_buffer
from backends.vulkan.shaders.compiler import compile_shader
from backends.vulkan.upload import Uploader
from chapters.ch02.frames.vulkan import SLOTS
from chapters.ch02.frames.vulkan_resources import Resources
from chapters.ch02.pipelines.vulkan import CHAPTER
from chapters.ch02.pipelines.vulkan_descriptors import Descriptors, Texture
from chapters.ch02.pipelines.vulkan_layouts import Layouts
from chapters.ch02.pipelines.vulkan_reflection import Stage, merge
from chapters.ch02.scene.textures.vulkan_bindless import DUMMY, Bindless
from common.errors import UnsupportedError
from common.scene import Sampler

pytestmark = pytest.mark.variants("vulkan")

ROOM = 48
USAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
)
NEAREST = Sampler("nearest", "nearest", None, "clamp", "clamp")
LINEAR = Sampler("linear", "linear", None, "clamp", "clamp")
TEXEL, VOLUME, UINT, STORE, SMOOTH = range(5)
"""What the shader does with a slot: fetch a texel, sample a volume in its middle, fetch, store, sample at uv."""

SOURCE = """
#include "bindless.glsl"
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0), std430) readonly buffer Wanted_ { uvec4 wanted[]; };
layout(BIND(0, 1, 1), std430) writeonly buffer Found_ { vec4 found[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= wanted.length()) return;
    uint slot = wanted[i].y;
    ivec2 texel = ivec2(wanted[i].zw);
    switch (wanted[i].x) {
        case 0u: found[i] = texelFetch(textures_2d[nonuniformEXT(slot)], texel, 0); break;
        case 1u: found[i] = sample_volume(slot, vec3(0.5)); break;
        case 2u: found[i] = uintBitsToFloat(fetch_uint(slot, texel)); break;
        case 3u: store_texel(slot, texel, vec4(float(i), float(slot), 0.0, 1.0)); break;
        default: found[i] = textureLod(textures_2d[nonuniformEXT(slot)], uintBitsToFloat(wanted[i].zw), 0.0);
    }
}
"""


class Reader:
    """A set with `textures` and `images` slots, and the shader that reads them."""

    def __init__(self, device: Any, textures: int = ROOM, images: int = 4) -> None:
        self.device, self._stack = device, ExitStack()
        self.resources = Resources(device)
        self._stack.callback(self.resources.close)
        self._descriptors = Descriptors(device)
        self._stack.callback(self._descriptors.close)
        self._layouts = Layouts(device, max(textures, images))
        self._stack.callback(self._layouts.close)
        dummy = self.image("rgba8", DUMMY)
        storage = self.image(
            "rgba32f", None, (2, 2), usage=USAGE | vk.VK_IMAGE_USAGE_STORAGE_BIT, state="storage"
        )
        self.sampler = self.resources.sampler(NEAREST, 1.0)
        held = Texture(dummy.view, self.sampler)
        self.bindless = Bindless(device, self.resources, textures, held, images, storage.view)
        self._stack.callback(self.bindless.close)
        source = shader_text.build_text(
            SOURCE,
            "comp",
            "vulkan",
            roots=(CHAPTER / "scene" / "textures",),
            extensions=["GL_EXT_nonuniform_qualifier"],
        )
        stage = Stage(compile_shader(source), source)
        self._layout, sets = self._layouts.pipeline(merge([stage]))
        self._buffers, slots = sets[0], sets[2]
        assert self._buffers is not None and slots is not None
        assert [(one.number, one.kind) for one in slots.bindings] == [(10, "texture"), (11, "image")]
        self.bindless.create(slots)
        module = device.create(
            "vkCreateShaderModule",
            vk.new("VkShaderModuleCreateInfo", codeSize=len(stage.code), pCode=stage.code),
        )
        self._stack.callback(device.destroy, "VkShaderModule", module)
        made = vk.new(
            "VkPipelineShaderStageCreateInfo",
            stage=vk.VK_SHADER_STAGE_COMPUTE_BIT,
            module=module,
            pName="main",
        )
        infos = vk.array(
            "VkComputePipelineCreateInfo",
            [vk.new("VkComputePipelineCreateInfo", stage=made, layout=self._layout)],
        )
        self._pipeline = device.create_pipelines("vkCreateComputePipelines", infos, ["slots"])[0]
        self._stack.callback(device.destroy, "VkPipeline", self._pipeline)

    def image(
        self, format: str, pixels: Any, size: Any = None, usage: int = USAGE, state: str = "sampled"
    ) -> Image:
        """Return a 2D image with these pixels, or of `size` and unknown content, in a state."""
        height, width = pixels.shape[:2] if pixels is not None else size
        made = self.resources.images.get(self.resources.image(format, (width, height), usage, "texels"))
        if pixels is not None:
            with Uploader(self.device) as uploader:
                uploader.image(made, pixels)
        else:
            with submit_once(self.device) as commands:
                transition(self.device, commands, made, "undefined", state)
        return made

    def volume(self, color: tuple[float, ...]) -> Image:
        """Return a volume of 2x2x2 texels of one colour."""
        info = vk.new(
            "VkImageCreateInfo",
            imageType=vk.VK_IMAGE_TYPE_3D,
            format=FORMATS["rgba32f"][0],
            extent={"width": 2, "height": 2, "depth": 2},
            mipLevels=1,
            arrayLayers=1,
            samples=1,
            usage=USAGE,
        )
        device, fn = self.device, self.device.fn
        handle = device.create("vkCreateImage", info, "volume")
        requirements = vk.new("VkMemoryRequirements")
        fn.vkGetImageMemoryRequirements(device.handle, handle, requirements)
        memory = device.memory.allocate(requirements, "device", linear=False)
        vk.check(
            fn.vkBindImageMemory(device.handle, handle, memory.memory, memory.offset), "vkBindImageMemory"
        )
        aspect = vk.VK_IMAGE_ASPECT_COLOR_BIT
        whole = {"aspectMask": aspect, "levelCount": 1, "layerCount": 1}
        view = vk.new(
            "VkImageViewCreateInfo",
            image=handle,
            viewType=vk.VK_IMAGE_VIEW_TYPE_3D,
            format=FORMATS["rgba32f"][0],
            subresourceRange=whole,
        )
        shown = device.create("vkCreateImageView", view, "volume")
        made = Image(handle, shown, "rgba32f", 2, 2, 1, 1, aspect, memory, "volume", views=[shown])
        self.resources.images.create(made)
        value, range_ = (
            vk.new("VkClearColorValue", float32=list(color)),
            vk.new("VkImageSubresourceRange", **whole),
        )
        with submit_once(device) as commands:
            transition(device, commands, made, "undefined", "copy_target")
            layout = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
            fn.vkCmdClearColorImage(commands, handle, layout, value, 1, range_)
            transition(device, commands, made, "copy_target", "sampled")
        return made

    def read(self, wanted: Any) -> np.ndarray:
        """Return (N, 4) float32: what the shader found for each row (what to do, slot, x, y) of `wanted`."""
        rows = np.ascontiguousarray(wanted, np.uint32).reshape(-1, 4)
        self.bindless.update()
        device, fn = self.device, self.device.fn
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        buffers = [
            create_buffer(device, rows.nbytes, usage, "readback", name) for name in ("wanted", "found")
        ]
        buffers[0].mapped[:] = rows.view(np.uint8).reshape(-1)
        sets = self._descriptors.create([(self._buffers, dict(enumerate(buffers)), "slots")])
        written = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
        host = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)
        point = vk.VK_PIPELINE_BIND_POINT_COMPUTE
        with submit_once(device) as commands:
            fn.vkCmdBindPipeline(commands, point, self._pipeline)
            handles = vk.array("VkDescriptorSet", sets.handles)
            fn.vkCmdBindDescriptorSets(commands, point, self._layout, 0, 1, handles, 0, vk.NULL)
            fn.vkCmdBindDescriptorSets(commands, point, self._layout, 2, 1, self.bindless.sets, 0, vk.NULL)
            fn.vkCmdDispatch(commands, -(-len(rows) // 64), 1, 1)
            fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*written, *host)))
        device.memory.invalidate(buffers[1].allocation)
        found = buffers[1].view(np.float32).reshape(-1, 4).copy()
        self._descriptors.destroy(sets)
        for buffer in buffers:
            destroy_buffer(device, buffer)
        return found

    def close(self) -> None:
        """Free everything."""
        self._stack.close()


@pytest.fixture
def reader(vulkan_device):
    if not vulkan_device.has("bindless"):
        pytest.skip("the device has no descriptor indexing")
    made = Reader(vulkan_device)
    yield made
    made.close()


def one_color(color):
    """Return pixels of an image of one texel."""
    return np.array(color, np.float32).reshape(1, 1, 4)


# --- who owns a slot ---


def test_slots_are_the_lowest_that_no_frame_reads(vulkan_device):
    """A thousand random steps against sets: in use, given up in which frame, free."""
    resources = Resources(vulkan_device)
    slots = Bindless(vulkan_device, resources, ROOM, Texture(vk.NULL, vk.NULL), 5, vk.NULL)
    rng = np.random.default_rng(3)
    room, used, leaving = {"texture": ROOM, "image": 5}, {"texture": {0}, "image": set()}, []
    refused = waits = 0
    frame = 0
    for _ in range(1000):
        kind = ("texture", "image")[int(rng.integers(8)) == 0]
        busy = used[kind] | {slot for one, slot, _ in leaving if one == kind}
        step = rng.random()
        if step < 0.5:
            free = sorted({*range(room[kind])} - busy)
            add = slots.add if kind == "texture" else slots.add_image
            if not free:  # then all frames are waited for
                leaving = []
                free = sorted({*range(room[kind])} - used[kind])
                waits += 1
            if free:
                assert add(vk.NULL) == free[0]
                used[kind].add(free[0])
            else:
                refused += 1
                with pytest.raises(UnsupportedError, match=f"more {kind}s than the {room[kind]}"):
                    add(vk.NULL)
        elif step < 0.85 and used[kind] - {0}:
            slot = int(rng.choice(sorted(used[kind] - {0})))
            slots.free(slot, kind)
            used[kind].remove(slot)
            leaving.append((kind, slot, frame))
        else:
            frame += 1
            resources.collect(frame)
            leaving = [(one, slot, since) for one, slot, since in leaving if since + SLOTS > frame]
        assert len(slots) == sum(map(len, used.values())) + len(leaving)
    assert refused > 10 and waits > refused + 10 and frame > 50
    resources.close()


# --- what it holds ---


@pytest.mark.feature("bindless/global-descriptor-set")
@pytest.mark.feature("bindless/default-and-dummy-textures")
def test_a_slot_that_nobody_filled_reads_the_dummy(reader):
    """Never written, and given up: both show its chequerboard, and only when no frame can read what was there."""
    green = reader.image("rgba32f", one_color((0, 1, 0, 1)))
    slot = reader.bindless.add(green.view, reader.sampler)
    corners = [(x, y) for y in (0, 1) for x in (0, 1)]

    def texels(number):
        return reader.read([(TEXEL, number, x, y) for x, y in corners])

    board = (DUMMY / np.float32(255)).reshape(4, 4)
    for number in (0, slot + 1, ROOM - 1):
        assert np.array_equal(texels(number), board)
    assert np.array_equal(texels(slot)[0], (0, 1, 0, 1))
    reader.resources.collect(1)
    reader.bindless.free(slot)
    for frame in (1, 2):
        reader.resources.collect(frame)
        assert np.array_equal(texels(slot)[0], (0, 1, 0, 1)), "a frame in flight still reads it"
    reader.resources.collect(1 + SLOTS)
    assert np.array_equal(texels(slot), board)
    other = reader.image("rgba32f", one_color((0, 0, 1, 1)))
    assert reader.bindless.add(other.view, reader.sampler) == slot
    assert np.array_equal(texels(slot)[0], (0, 0, 1, 1)), "a new owner, at the first frame that may name it"


def test_what_is_given_up_before_it_was_written_is_never_written(reader):
    written = reader.bindless.written
    slot = reader.bindless.add(reader.image("rgba32f", one_color((1, 1, 1, 1))).view)
    reader.bindless.free(slot)
    assert reader.bindless.update() == 0
    assert reader.read([(TEXEL, slot, 0, 0)])[0, 2] == 1.0, "the dummy's magenta"
    reader.resources.collect(SLOTS)
    assert reader.bindless.update() == 1, "the dummy, which stands there already"
    assert reader.bindless.update() == 0
    assert reader.bindless.written == written + 1


@pytest.mark.feature("bindless/update-queue")
def test_the_queue_is_written_once_in_one_call(reader, vulkan_device):
    views = [reader.image("rgba32f", one_color((i, 0, 0, 1))).view for i in range(5)]
    added = [reader.bindless.add(view, reader.sampler) for view in views]
    log: list = []
    vulkan_device.fn.trace(log)
    count, again = reader.bindless.update(), reader.bindless.update()
    vulkan_device.fn.trace(None)
    assert count == 5
    assert not again > 0, "what was written is no longer in the queue"
    (call,) = [arguments for name, arguments in log if name == "vkUpdateDescriptorSets"]
    writes = [call[2][i] for i in range(call[1])]
    assert [(one.dstBinding, one.dstArrayElement, one.descriptorCount) for one in writes] == [
        (10, slot, 1) for slot in added
    ]
    assert [one.pImageInfo[0].imageView for one in writes] == views


# --- how it is read ---


@pytest.mark.feature("bindless/default-and-dummy-textures")
def test_the_sampler_that_is_linked_shows_at_the_boundary_of_texels(reader):
    """A step from 0 to 1, a hundredth of a texel before its middle: 0 by nearest, almost a half by linear."""
    step = np.zeros((1, 2, 4), np.float32)
    step[0, 1] = 1.0
    view = reader.image("rgba32f", step).view
    linear = reader.resources.sampler(LINEAR, 1.0)
    slots = [reader.bindless.add(view, sampler) for sampler in (None, reader.sampler, linear)]
    before, after = (np.array((u, 0.5), np.float32).view(np.uint32).tolist() for u in (0.495, 0.505))
    found = reader.read([(SMOOTH, slot, *uv) for slot in slots for uv in (before, after)])[:, 0].reshape(3, 2)
    assert found[0].tolist() == found[1].tolist() == [0.0, 1.0], (
        "the default is the dummy's sampler, here nearest"
    )
    assert np.allclose(found[2], (0.49, 0.51), atol=1 / 256)
    assert (np.abs(found[2] - found[0]) > 0.4).all(), "the one that was linked is seen"


@pytest.mark.feature("bindless/nonuniform-indexing")
def test_random_indices_of_all_kinds_pick_the_right_texture(reader):
    """Neighbours of one wave read other slots, as 2D, as 3D and as integers: 4,096 of each, exact to the bit."""
    rng = np.random.default_rng(5)
    kinds: dict[int, list[tuple[int, np.ndarray]]] = {TEXEL: [], VOLUME: [], UINT: []}
    for number in range(36):
        kind = int(rng.permutation(3)[0]) if number > 2 else number
        color = (number + 0.25, number / 3, -number, 1.0)
        if kind == UINT:
            codes = rng.integers(0, 0x7F000000, (3, 2), dtype=np.uint32)
            image = reader.image("r32ui", codes[..., None])
            content = codes
        elif kind == VOLUME:
            image = reader.volume(color)
            content = np.array(color, np.float32)
        else:
            content = rng.normal(size=(3, 2, 4)).astype(np.float32)
            image = reader.image("rgba32f", content)
        kinds[kind].append((reader.bindless.add(image.view, reader.sampler), content))
    assert min(len(held) for held in kinds.values()) > 4
    rows, expected = [], []
    for _ in range(3 * 4096):
        kind = int(rng.integers(3))
        slot, content = kinds[kind][int(rng.integers(len(kinds[kind])))]
        x, y = int(rng.integers(2)), int(rng.integers(3))
        rows.append((kind, slot, x, y))
        if kind == UINT:
            expected.append(np.array((content[y, x], 0, 0, 1), np.uint32).view(np.float32))
        else:
            expected.append(content if kind == VOLUME else content[y, x])
    found = reader.read(rows)
    assert np.array_equal(found.view(np.uint32), np.array(expected, np.float32).view(np.uint32))


@pytest.mark.feature("bindless/global-descriptor-set")
def test_storage_images_are_written_through_their_slots(reader):
    usage = USAGE | vk.VK_IMAGE_USAGE_STORAGE_BIT
    images = [reader.image("rgba32f", None, (4, 4), usage, "storage") for _ in range(3)]
    slots = [reader.bindless.add_image(one.view) for one in images]
    assert slots == [0, 1, 2]
    rng = np.random.default_rng(6)
    places = [(slot, x, y) for slot in slots for y in range(4) for x in range(4)]
    places = [places[i] for i in rng.permutation(len(places))]
    reader.read([(STORE, *place) for place in places])
    for slot, image in zip(slots, images, strict=True):
        found = read_image(reader.device, image, "storage")
        expected = np.zeros((4, 4, 4), np.float32)
        for i, (which, x, y) in enumerate(places):
            if which == slot:
                expected[y, x] = (i, slot, 0, 1)
        assert np.array_equal(found, expected)
