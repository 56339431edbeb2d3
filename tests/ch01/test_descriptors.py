"""Descriptor sets: pools of exactly the size that is needed, one set per material, none for what is not used."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.api import VulkanError
from backends.vulkan.resources import (
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from chapters.ch01.frames.frame import SLOTS
from chapters.ch01.pipelines.vulkan_descriptors import Binding, Descriptors, Texture, pool_sizes
from chapters.ch01.renderer import Renderer
from chapters.ch01.settings import Settings
from common.scene import Image, Light, Material, Sampler
from tests.support.scenes import facing, quad_scene, texture, translated

pytestmark = pytest.mark.until(1, "one bindless set takes the place of a set per material")

UNIFORM, STORAGE, TEXTURE = (
    vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER,
    vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER,
    vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER,
)


@pytest.fixture
def descriptors(vulkan_device):
    made = Descriptors(vulkan_device)
    yield made
    made.close()


@pytest.fixture
def held(vulkan_device):
    """One of each thing that a descriptor can hold."""
    both = vk.VK_BUFFER_USAGE_UNIFORM_BUFFER_BIT | vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    buffer = create_buffer(vulkan_device, 256, both, "upload", "held")
    image = create_image(vulkan_device, "rgba8", (4, 4), vk.VK_IMAGE_USAGE_SAMPLED_BIT, "held")
    sampler = create_sampler(vulkan_device, Sampler(), 1.0, "held")
    yield {"uniform": buffer, "storage": buffer, "texture": Texture(image.view, sampler)}
    destroy_buffer(vulkan_device, buffer)
    destroy_image(vulkan_device, image)
    vulkan_device.destroy("VkSampler", sampler)


@pytest.mark.feature("device/descriptor-sets")
@pytest.mark.parametrize(
    "kinds", list(itertools.product(["uniform", "storage", "texture"], repeat=2)), ids="+".join
)
def test_pool_and_writes_equal_the_table(vulkan_device, descriptors, held, kinds):
    """Three sets of every mix of kinds: what is asked of the API, read from its trace."""
    bindings = [Binding(3 * number, kind) for number, kind in enumerate(kinds)]
    wanted = [(bindings, {one.number: held[one.kind] for one in bindings}, f"set {i}") for i in range(3)]
    log: list = []
    vulkan_device.fn.trace(log)
    sets = descriptors.create(wanted)
    vulkan_device.fn.trace(None)
    calls = dict(log)
    types = {"uniform": UNIFORM, "storage": STORAGE, "texture": TEXTURE}
    info = calls["vkCreateDescriptorPool"][1]
    sizes = {info.pPoolSizes[i].type: info.pPoolSizes[i].descriptorCount for i in range(info.poolSizeCount)}
    assert info.maxSets == 3
    assert sizes == {types[kind]: 3 * kinds.count(kind) for kind in kinds} == pool_sizes([bindings] * 3)
    count, writes = calls["vkUpdateDescriptorSets"][1:3]
    table = [(writes[i].dstSet, writes[i].dstBinding, writes[i].descriptorType) for i in range(count)]
    assert table == [
        (one, binding.number, types[binding.kind]) for one in sets.handles for binding in bindings
    ]
    assert all(writes[i].descriptorCount == 1 for i in range(count))
    assert descriptors.set_count == 3
    descriptors.destroy(sets)
    assert descriptors.set_count == 0


@pytest.mark.feature("device/descriptor-sets")
def test_a_frame_binds_the_set_of_its_slot_and_that_holds_the_slots_buffers(vulkan_device):
    """What the driver was told of each set, by the names that messages show its buffers under."""
    held, bound, log = {}, [], []
    vulkan_device.fn.trace(log)
    try:
        with Renderer(quad_scene(Material()), (8, 8), Settings(), device=vulkan_device) as made:
            for call, arguments in log:
                if call == "vkUpdateDescriptorSets":
                    for write in (arguments[2][i] for i in range(arguments[1])):
                        if write.descriptorType in (UNIFORM, STORAGE):
                            buffer = int(vk.ffi.cast("uint64_t", write.pBufferInfo[0].buffer))
                            name = vulkan_device.alive["VkBuffer", buffer]
                            held.setdefault(write.dstSet, {})[write.dstBinding] = name
            for _ in range(2 * SLOTS + 1):
                log.clear()
                made.render(facing())
                calls = [arguments for name, arguments in log if name == "vkCmdBindDescriptorSets"]
                bound.append({a[5][0] for a in calls if a[3] == 0 and a[5][0] in held})
    finally:
        vulkan_device.fn.trace(None)
    for number, sets in enumerate(bound):
        (one,) = sets
        slot = f"slot {number % SLOTS}"
        names = ["frame", "instances", "materials", "lights"]
        assert held[one] == {binding: f"{name}, {slot}" for binding, name in enumerate(names)}
    assert bound[0] != bound[1] and bound[0] == bound[SLOTS], "frames in flight do not share a set"


@pytest.mark.feature("device/descriptor-sets")
def test_a_pool_that_is_too_small_raises_what_the_driver_says(vulkan_device, held, monkeypatch):
    """Pools are exactly as large as needed, so no driver says it by itself: here one does."""

    def exhausted(device, info, sets):
        return vk.VK_ERROR_OUT_OF_POOL_MEMORY

    monkeypatch.setattr(vulkan_device.fn, "vkAllocateDescriptorSets", exhausted, raising=False)
    before, descriptors = dict(vulkan_device.alive), Descriptors(vulkan_device)
    with pytest.raises(VulkanError, match=r"vkAllocateDescriptorSets.*VK_ERROR_OUT_OF_POOL_MEMORY"):
        descriptors.create([([Binding(0, "uniform")], {0: held["uniform"]}, "one too many")])
    assert descriptors.set_count == 0
    descriptors.close()
    assert vulkan_device.alive.keys() == before.keys(), "the pool goes, too, though it has no sets"


def test_equal_tables_share_a_layout(descriptors):
    table = [Binding(0, "uniform"), Binding(1, "texture", "fragment")]
    layout = descriptors.layout(table)
    assert descriptors.layout(list(table)) == layout
    assert descriptors.layout(table[:1]) != layout
    assert descriptors.layout([table[0], Binding(1, "texture")]) != layout, "other stages are another layout"


@pytest.mark.feature("gltf/prebuilt-descriptor-sets")
def test_a_set_per_textured_material_and_no_other(vulkan_device):
    """Four materials: two with textures (of one and of three roles), one without, one unlit whose maps nobody reads."""
    images = tuple(Image(f"image {i}", np.full((2, 2, 4), 60 * i, np.uint8)) for i in range(4))
    materials = (
        Material(name="one", base_color_texture=texture(0)),
        Material(name="plain"),
        Material(
            name="three",
            base_color_texture=texture(1),
            normal_texture=texture(2),
            emissive_texture=texture(3),
        ),
        Material(name="unlit", unlit=True, normal_texture=texture(2), occlusion_texture=texture(3)),
    )
    scene = quad_scene(
        materials=materials,
        images=images,
        matrices=tuple(translated(i) for i in range(4)),
        instance_materials=(0, 1, 2, 3),
        lights=(Light("directional", node=0),),
    )
    log: list = []
    with Renderer(scene, (8, 8), Settings(), outputs={"color_linear"}, device=vulkan_device) as warm:
        warm.render(facing())
    vulkan_device.fn.trace(log)
    with Renderer(scene, (8, 8), Settings(), outputs={"color_linear"}, device=vulkan_device) as made:
        work = [made.render(facing(ymag=4.0)).work for _ in range(5)][-1]
    vulkan_device.fn.trace(None)
    assert work["descriptor_sets"] == 2 + 2
    assert work["textures"] == 4
    assert work["descriptor_binds"] == 4 + 2, (
        "the frame's with each pipeline, and one per material with textures"
    )
    names = [name for name, _ in log]
    first_frame = names.index("vkCmdBeginRendering")
    assert "vkAllocateDescriptorSets" in names[:first_frame]
    assert not [n for n in names[first_frame:] if n in ("vkAllocateDescriptorSets", "vkUpdateDescriptorSets")]
    pool = [arguments[1] for name, arguments in log if name == "vkCreateDescriptorPool"][-1]
    sizes = {pool.pPoolSizes[i].type: pool.pPoolSizes[i].descriptorCount for i in range(pool.poolSizeCount)}
    assert sizes == {UNIFORM: 2, STORAGE: 2 * 3, TEXTURE: 1 + 3}
