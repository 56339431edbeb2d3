"""Every texture of a bound set is written, read or not: Mesa 22.3's software driver ends the process otherwise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from common.scene import Image, Light, Material, Scene
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated

TEXTURE = vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER
PARTIAL = vk.VK_DESCRIPTOR_SET_LAYOUT_CREATE_UPDATE_AFTER_BIND_POOL_BIT


def integer(handle: Any) -> int:
    return int(vk.ffi.cast("uint64_t", handle))


def unwritten(log: list[tuple[str, tuple[Any, ...]]]) -> list[str]:
    """Return the textures of bound sets that no call wrote, by the calls alone; bindless sets have gaps by design."""
    layouts: dict[int, dict[int, int]] = {}
    sets: dict[int, int] = {}
    written: set[tuple[int, int, int]] = set()
    bound: set[int] = set()
    for name, arguments in log:
        if name == "vkCreateDescriptorSetLayout":
            info = arguments[1]
            described = (info.pBindings[i] for i in range(info.bindingCount))
            layouts[integer(arguments[3][0])] = {
                one.binding: one.descriptorCount
                for one in described
                if one.descriptorType == TEXTURE and not info.flags & PARTIAL
            }
        if name == "vkAllocateDescriptorSets":
            for i in range(arguments[1].descriptorSetCount):
                sets[integer(arguments[2][i])] = integer(arguments[1].pSetLayouts[i])
        if name == "vkUpdateDescriptorSets":
            for write in (arguments[2][i] for i in range(arguments[1])):
                for element in range(write.descriptorCount):
                    assert write.descriptorType != TEXTURE or write.pImageInfo[element].sampler != vk.NULL
                    written.add((integer(write.dstSet), write.dstBinding, write.dstArrayElement + element))
        if name == "vkCmdBindDescriptorSets":
            bound |= {integer(arguments[5][i]) for i in range(arguments[4])}
    assert bound, "nothing was bound"
    return [
        f"binding {binding}[{element}] of set {one}"
        for one in sorted(bound & sets.keys())
        for binding, count in layouts[sets[one]].items()
        for element in range(count)
        if (one, binding, element) not in written
    ]


def lit() -> Scene:
    scene = quad_scene(Material(), matrices=(translated(0.0),), lights=(Light("point", 0),))
    scene.nodes = nodes_at(translated(0.0))
    return scene


SCENES = {
    "lit": lit,
    "unlit": lambda: quad_scene(Material(unlit=True)),
    "textured": lambda: quad_scene(
        Material(base_color_texture=texture(0)), images=(Image("white", np.full((2, 2, 4), 255, np.uint8)),)
    ),
}


@pytest.mark.newest
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.variants("vulkan", "without-all")
def test_every_texture_of_a_bound_set_is_written(chapter, name: str) -> None:
    """No scene here has an environment, whose maps are in the set of every frame."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    chapter.device.fn.trace(log)
    try:
        with chapter.open(SCENES[name](), (8, 8)) as made:
            for _ in range(3):
                made.render(facing()).image("color")
    finally:
        chapter.device.fn.trace(None)
    assert not unwritten(log)
