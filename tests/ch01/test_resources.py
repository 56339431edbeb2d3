"""Resources behind handles: stale ones raise, and what is given up lives until no frame in flight can use it."""

from __future__ import annotations

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch01.frames.vulkan import SLOTS
from chapters.ch01.frames.vulkan_resources import DeferredDeletion, Resources
from chapters.ch01.renderer import Renderer
from common.numerics.pools import StaleHandleError
from common.scene import Image, Material, Sampler
from tests.support.scenes import facing, quad_scene, texture

STORAGE = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
SAMPLED = vk.VK_IMAGE_USAGE_SAMPLED_BIT


@pytest.fixture
def resources(vulkan_device):
    made = Resources(vulkan_device)
    yield made
    made.close()


def alive(device, name):
    """Return how many objects that the device knows by `name` are alive."""
    return sum(held == name for held in device.alive.values())


@pytest.mark.feature("device/deferred-deletion")
def test_deletion_waits_for_every_frame_that_may_read():
    """Given up while frame n is recorded: destroyed when frame n + SLOTS begins, whose slot frame n has left."""
    deletions, destroyed = DeferredDeletion(), []
    for frame in range(6):
        collected = deletions.collect(frame)
        assert collected == (1 if frame >= SLOTS else 0)
        assert destroyed == list(range(frame - SLOTS + 1))
        deletions.add(frame, lambda frame=frame: destroyed.append(frame))
        assert len(deletions) == min(frame + 1, SLOTS)
    deletions.flush()
    assert destroyed == list(range(6)), "each once, in the order in which they were given up"
    assert deletions.collect(100) == 0


@pytest.mark.feature("device/deferred-deletion")
def test_a_buffer_is_really_freed_two_frames_later(vulkan_device, resources):
    resources.collect(7)
    handle = resources.buffer(64, STORAGE, "upload", "scratch")
    resources.destroy_buffer(handle)
    for frame in (7, 8):
        resources.collect(frame)
        assert alive(vulkan_device, "scratch") == 1
    resources.collect(9)
    assert alive(vulkan_device, "scratch") == 0


@pytest.mark.newest
@pytest.mark.feature("device/deferred-deletion")
def test_no_fence_no_deletion(vulkan_device):
    """An image that an edit makes useless is destroyed after the waits for all frames that may have drawn it."""
    images = (
        Image("first", np.full((4, 4, 4), 255, np.uint8)),
        Image("second", np.zeros((4, 4, 4), np.uint8)),
    )
    scene = quad_scene(Material(unlit=True, base_color_texture=texture(0)), images=images)
    with Renderer(scene, (8, 8), device=vulkan_device) as made:
        made.render(facing())
        made.render(facing())
        with scene.edit() as edit:
            edit.set_material(0, Material(unlit=True, base_color_texture=texture(1)))

        def pool_count():
            return sum(kind == "VkDescriptorPool" for kind, _ in vulkan_device.alive)

        before = pool_count()
        log: list = []
        vulkan_device.fn.trace(log)
        shown, living, pools = [], [], []
        for _ in range(SLOTS + 1):
            shown.append(made.render(facing()))
            living.append((alive(vulkan_device, "first") > 0, alive(vulkan_device, "second") > 0))
            pools.append(pool_count())
        vulkan_device.fn.trace(None)
        assert (shown[-1].image("color") == 0).all()
    # Given up while frame 2 is recorded; frame 4 waits for that slot, and so for every frame that saw the image.
    assert living == [(True, True), (True, True), (False, True)]
    names = [name for name, _ in log]
    again = names.count("vkCreateDescriptorPool")
    assert again > 0 and pools == [before + again, before + again, before], "the old sets go with the image"
    last = max(index for index, name in enumerate(names) if name == "vkDestroyImage")
    waits = ("vkWaitForFences", "vkWaitSemaphores")  # later chapters pace their frames by timelines
    frames_waited = [i for i, n in enumerate(names) if n in waits and i < last]
    assert names[:last].count("vkQueueSubmit2") >= 2
    assert len(frames_waited) >= 3


@pytest.mark.feature("device/handle-pools")
def test_a_stale_handle_raises_and_its_place_is_used_again(resources):
    first = resources.image("rgba8", (4, 4), SAMPLED, "one")
    resources.destroy_image(first)
    with pytest.raises(StaleHandleError, match="image 0 of generation 0 was destroyed"):
        resources.images.get(first)
    with pytest.raises(StaleHandleError):
        resources.destroy_image(first)
    second = resources.image("rgba8", (4, 4), SAMPLED, "two")
    assert (second.index, second.generation) == (first.index, first.generation + 1)
    assert resources.images.get(second).name == "two"
    buffer = resources.buffer(16, STORAGE, "upload", "bytes")
    with pytest.raises(StaleHandleError, match="a buffer handle was given to the pool of images"):
        resources.images.get(buffer)


@pytest.mark.feature("device/samplers")
def test_equal_descriptions_share_a_sampler(resources):
    a = resources.sampler(Sampler("nearest", "linear", None, "clamp", "mirror"), 1.0)
    assert resources.sampler(Sampler("nearest", "linear", None, "clamp", "mirror"), 1.0) == a
    assert resources.sampler(Sampler("nearest", "linear", None, "clamp", "repeat"), 1.0) != a
    assert resources.sampler(Sampler("nearest", "linear", None, "clamp", "mirror"), 4.0) != a
    assert resources.counts == {"buffers": 0, "images": 0, "samplers": 3}


def test_closing_frees_what_is_alive_and_what_was_given_up(vulkan_device):
    before = dict(vulkan_device.alive)
    made = Resources(vulkan_device)
    made.buffer(64, STORAGE, "upload", "kept")
    made.destroy_buffer(made.buffer(64, STORAGE, "upload", "given up"))
    made.image("rgba16f", (3, 5), SAMPLED, "picture")
    made.sampler(Sampler(), 1.0)
    calls = []
    made.defer(lambda: calls.append("deferred"))
    assert made.counts == {"buffers": 1, "images": 1, "samplers": 1}
    made.close()
    assert calls == ["deferred"]
    left = set(vulkan_device.alive) - set(before)
    assert {kind for kind, _ in left} <= {"VkDeviceMemory"}, "blocks of memory are kept for the next"
