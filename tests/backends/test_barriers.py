"""Layout transitions: each state's layout, stages and accesses as the specification numbers them, and on a device."""

from __future__ import annotations

import pytest

from backends.vulkan import api as vk
from backends.vulkan.barriers import STATES, image_barrier, transition
from backends.vulkan.once import submit_once
from backends.vulkan.resources import create_image, destroy_image

TABLE = {
    # state: (layout, stages, accesses), the numbers of vulkan_core.h
    "undefined": (0, 0x0, 0x0),
    "color": (2, 0x400, 0x80 | 0x100),
    "depth": (1000241000, 0x100 | 0x200, 0x200 | 0x400),
    "sampled": (5, 0x8 | 0x80 | 0x800, 0x1_0000_0000),
    "storage": (1, 0x8 | 0x80 | 0x800, 0x2_0000_0000 | 0x4_0000_0000),
    "copy_source": (6, 0x1000, 0x800),
    "copy_target": (7, 0x1000, 0x1000),
    "present": (1000001002, 0x0, 0x0),
}
ALL_LEVELS = 0xFFFFFFFF


@pytest.mark.feature("device/layout-transitions")
@pytest.mark.parametrize("after", [name for name in TABLE if name != "undefined"])
@pytest.mark.parametrize("before", TABLE)
def test_a_transition_has_the_tabulated_masks(before, after):
    made = image_barrier(vk.ffi.NULL, 1, before, after)
    assert (made.oldLayout, made.srcStageMask, made.srcAccessMask) == TABLE[before]
    assert (made.newLayout, made.dstStageMask, made.dstAccessMask) == TABLE[after]
    assert made.subresourceRange.levelCount == made.subresourceRange.layerCount == ALL_LEVELS


def test_every_state_is_in_the_table():
    assert STATES.keys() == TABLE.keys()


@pytest.mark.feature("device/layout-transitions")
@pytest.mark.parametrize(("before", "after"), [("colour", "sampled"), ("sampled", "colour")])
def test_an_unknown_state_raises(before, after):
    with pytest.raises(KeyError, match="colour"):
        image_barrier(vk.ffi.NULL, 1, before, after)


def test_giving_up_the_content_works_from_any_layout_and_still_waits():
    made = image_barrier(vk.ffi.NULL, 1, "sampled", "color", 2, 1, discard=True)
    assert made.oldLayout == 0
    assert (made.srcStageMask, made.srcAccessMask) == TABLE["sampled"][1:]
    assert (made.subresourceRange.baseMipLevel, made.subresourceRange.levelCount) == (2, 1)


@pytest.mark.feature("device/layout-transitions")
def test_a_device_takes_every_transition(vulkan_device):
    """The layers, which watch layouts and hazards, have nothing to say: the fixture fails otherwise."""
    colour = ["color", "sampled", "storage", "copy_source", "copy_target"]
    usage = 0x1 | 0x2 | 0x4 | 0x8 | 0x10  # copied from and to, sampled, stored to, drawn to
    image = create_image(vulkan_device, "rgba16f", (4, 4), usage, "every state")
    try:
        with submit_once(vulkan_device) as commands:
            transition(vulkan_device, commands, image, "undefined", colour[0])
            at = colour[0]
            for first in colour:
                for second in colour:
                    for state in (first, second):
                        if state != at:
                            transition(vulkan_device, commands, image, at, state)
                            at = state
    finally:
        destroy_image(vulkan_device, image)
