"""The loader on a device, without a renderer: every byte arrives, in parts too, and nothing is waited for."""

from __future__ import annotations

import weakref
from collections import deque
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, transition
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import (
    FORMATS,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
    mip_levels,
)
from chapters.ch03.frames.frame import SLOTS
from chapters.ch03.loading import vulkan as graphics_loader
from chapters.ch03.loading.loading import AHEAD, Loading, Wanted
from chapters.ch03.loading.uploads import Upload, level_places
from chapters.ch03.loading.vulkan import Loader
from chapters.ch03.loading.vulkan_barriers import Part, after_copy, before_copy, part_barrier
from chapters.ch03.loading.vulkan_copies import Target
from chapters.ch03.loading.vulkan_staging import LEAST_RING, RING
from chapters.ch03.scene.textures.texels import Shape
from chapters.ch03.scene.textures.vulkan_materials import takes_narrow
from common.errors import SceneError
from tests.support.mip_levels import halved, halved_codes
from tests.support.odd_texels import ODD, random_pixels, rows_of

pytestmark = pytest.mark.usefixtures("no_thread_left")
MIB = 1 << 20
USAGE = (
    vk.VK_IMAGE_USAGE_SAMPLED_BIT
    | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
    | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
    | vk.VK_IMAGE_USAGE_STORAGE_BIT
)


@dataclass
class Owner:
    """Makes an image for each request; its formats and sizes are those of the uploads."""

    device: object
    images: dict = field(default_factory=dict)
    discarded: list = field(default_factory=list)

    def place(self, request):
        shape = request.upload.shape
        size = (shape.width, shape.height)
        image = create_image(self.device, shape.format, size, USAGE, request.upload.name, levels=shape.levels)
        self.images[request.key] = image
        return Target(image)

    def discard(self, request):
        self.discarded.append(request.key)

    def close(self):
        self.device.wait_idle()
        for image in self.images.values():
            destroy_image(self.device, image)


@pytest.fixture
def opened(vulkan_device):
    made = []

    def open_(ring=4096, streams=True, own_queue=True, budget=AHEAD):
        loading = Loading(2, streams, budget)
        owner = Owner(vulkan_device)
        loader = Loader(vulkan_device, owner, loading, own_queue, **({"ring": ring} if ring else {}))
        loader.advance(1)  # the first frame, which copies nothing
        made.append((loader, owner))
        return loader, loading, owner

    yield open_
    for loader, owner in made:
        loader.stop()
        owner.close()


def wanted(formats, mips=False):
    """Return requests by number, and the pixels of each."""
    pixels = {n: random_pixels(format, size, n) for n, (format, size) in enumerate(formats)}
    made = {}
    for n, (format, size) in enumerate(formats):
        shape = Shape(*size, format, None, mip_levels(*size) if mips else 1)
        upload = Upload(f"picture {n}", shape, False, (rows_of(pixels[n]),))
        made[n] = Wanted(f"picture {n}", pixels[n].nbytes, lambda upload=upload: upload)
    return made, pixels


def level_of(device, image, level=0):
    """Return the bytes of a level of an image in state 'sampled', (rows, bytes of a row)."""
    width, height = max(1, image.width >> level), max(1, image.height >> level)
    row = width * FORMATS[image.format][1]
    back = create_buffer(device, row * height, vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT, "readback", "level")
    region = vk.new(
        "VkBufferImageCopy",
        imageSubresource={"aspectMask": image.aspect, "mipLevel": level, "layerCount": 1},
        imageExtent={"width": width, "height": height, "depth": 1},
    )
    with submit_once(device) as commands:
        transition(device, commands, image, "sampled", "copy_source")
        source = vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL
        device.fn.vkCmdCopyImageToBuffer(commands, image.handle, source, back.handle, 1, region)
        device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=TO_HOST))
        transition(device, commands, image, "copy_source", "sampled")
    device.memory.invalidate(back.allocation)
    found = back.mapped[: row * height].reshape(height, row).copy()
    destroy_buffer(device, back)
    return found


def frames(loader, loading, budget, most=2000):
    """Advance until everything has arrived; return how many bytes each step copied."""
    copied = []
    while loading.busy:
        before = loader.bytes
        loader.advance(budget)
        copied.append(loader.bytes - before)
        assert len(copied) < most
        if not copied[-1]:
            loading.wait()
            loader._copies.wait() if loader._staging else None
    return copied


def traced(device, work):
    """Return the calls that `work` makes, as (name, arguments)."""
    log = []
    device.fn.trace(log)
    try:
        work()
    finally:
        device.fn.trace(None)
    return log


# --- bytes ---


@pytest.mark.feature("async-loading/staging-buffer")
@pytest.mark.feature("async-loading/upload-barriers")
@pytest.mark.parametrize("budget", [None, 1000, 1])
def test_every_byte_of_odd_sizes_arrives_and_more_than_the_ring_holds(vulkan_device, opened, budget):
    loader, loading, owner = opened(ring=4096)
    requests, pixels = wanted([*ODD, ("rgba8", (40, 150))] if budget != 1 else ODD)
    loader.want(requests)
    copied = frames(loader, loading, budget)
    assert sum(copied) == sum(one.nbytes for one in pixels.values())
    for number, one in pixels.items():
        assert np.array_equal(level_of(vulkan_device, owner.images[number]), rows_of(one)), ODD[number:]
    if budget == 1000:
        assert max(copied) <= budget
    if budget == 1:  # a row at a time, where the budget is less than one
        assert max(copied) == 64 * 4, "the longest row"


@pytest.mark.parametrize(
    ("ring", "budget", "calls"), [(1 << 16, None, 1), (1 << 16, 1000, 3), (1500, None, 3)]
)
def test_all_levels_of_a_chain_are_copied_at_once_where_there_is_room(
    vulkan_device, opened, ring, budget, calls
):
    loader, loading, owner = opened(ring=ring)
    levels = [random_pixels("rgba8", (20 >> level, 19 >> level), level) for level in range(3)]
    whole = Upload("chain", Shape(20, 19, "rgba8", None, 3), False, tuple(map(rows_of, levels)))
    loader.want({0: Wanted("chain", whole.nbytes, lambda: whole)})
    log = traced(vulkan_device, lambda: frames(loader, loading, budget))
    copies = [arguments for name, arguments in log if name == "vkCmdCopyBufferToImage"]
    assert len(copies) >= calls and (calls > 1 or (len(copies) == 1 and copies[0][4] == 3))
    assert loader.bytes == whole.nbytes
    for number, level in enumerate(levels):
        found = level_of(vulkan_device, owner.images[0], number)
        assert np.array_equal(found, rows_of(level)), number


def test_levels_lie_behind_each_other_where_copies_may_begin():
    levels = [np.zeros((4, 10), np.uint8), np.zeros((3, 1), np.uint8), np.zeros((1, 64), np.uint8)]
    assert level_places(levels, 16) == ([0, 48, 64], 128)
    assert level_places(levels[1:2], 16) == ([0], 3)


@pytest.mark.feature("async-loading/staging-buffer")
@pytest.mark.parametrize(
    ("wanted_mib", "budget_mib", "mib"),
    [
        (0, 0, 2),
        (3, 0, 3),
        (9, 0, 8),
        (3, 16, 3),
        (1024, 1, 8),
        (1024, 8, 16),
        (1024, 16, 32),
        (1024, 1024, 64),
    ],
)
def test_the_ring_has_2_to_64_mib(opened, vulkan_device, wanted_mib, budget_mib, mib):
    """What is wanted, but 2 MiB at least and 8 at most, or 64 where two frames' budgets are that much."""
    loader, loading, _ = opened(ring=None, streams=budget_mib > 0, budget=budget_mib * MIB)
    small = Upload("small", Shape(4, 4, "rgba8", None, 1), False, (np.zeros((4, 16), np.uint8),))
    loader.want({0: Wanted("small", wanted_mib * MIB, lambda: small)})
    while loading.decoding:
        loading.wait()
    calls = traced(vulkan_device, loader.advance)
    (size,) = [arguments[1].size for name, arguments in calls if name == "vkCreateBuffer"]
    assert size == mib * MIB


def test_the_ring_is_as_large_as_what_is_still_wanted(opened):
    loader, loading, _ = opened(ring=RING)
    small = Upload(
        "small", Shape(4, 4, "rgba8", None, 1), False, (rows_of(random_pixels("rgba8", (4, 4), 1)),)
    )
    made = {n: Wanted(f"{n}", LEAST_RING, lambda: small) for n in range(3)}
    loader.want(made)
    assert loading.wanted_bytes == 3 * LEAST_RING
    while loading.busy:
        loader.advance()
        if loader._staging is not None:
            assert loader._staging.ring.capacity == 3 * LEAST_RING
        loading.wait()
    assert loading.wanted_bytes == 0


@pytest.mark.feature("async-loading/staging-buffer")
def test_the_ring_is_mapped_once_and_freed_when_nothing_is_left(vulkan_device, opened):
    loader, _, owner = opened(ring=1 << 16)
    allocated = vulkan_device.memory.allocated
    alive = len(vulkan_device.alive)
    requests, _ = wanted(ODD)
    loader.want(requests)
    calls = traced(vulkan_device, loader.finish)
    names = [name for name, _ in calls]
    assert names.count("vkMapMemory") <= 1 and "vkUnmapMemory" not in names
    vulkan_device.wait_idle()
    loader.advance()
    images = [*owner.images.values()]
    assert len(vulkan_device.alive) - alive <= 2 * len(images) + 4, (
        "images, views, and the blocks they lie in"
    )
    assert loader._staging is None
    assert vulkan_device.memory.allocated >= allocated
    assert traced(vulkan_device, loader.advance) == [], "a frame without anything to load calls nothing"


def test_half_of_the_ring_is_written_while_the_other_half_is_copied(vulkan_device, opened):
    loader, loading, owner = opened(ring=4096)
    requests, pixels = wanted([("rgba8", (32, 8))] * 9)
    loader.want(requests)
    while len(loading.requests) > len(loading._decoded):
        loading.wait()
    calls = [name for name, _ in traced(vulkan_device, loader.finish)]
    takes = 0 if loader.one_family else calls.count("vkQueueSubmit2") - loader.submissions
    assert loader.submissions == 5 and calls.count("vkQueueSubmit2") == 5 + takes, "two images in each"
    first = [name for name in calls if name in ("vkQueueSubmit2", "vkWaitForFences")][:2]
    assert first == ["vkQueueSubmit2"] * 2, "the second half is not waited for"
    for number, one in pixels.items():
        assert np.array_equal(level_of(vulkan_device, owner.images[number]), rows_of(one))


def test_pixels_are_given_up_when_the_ring_has_them(opened):
    """Not when the GPU has copied them: until then they would be in memory twice."""
    loader, loading, _ = opened(ring=1 << 16)
    held = np.zeros((16, 64), np.uint8)
    gone = weakref.ref(held)
    upload = Upload("picture", Shape(16, 16, "rgba8", None, 5), False, (held,))
    loader.want({0: Wanted("picture", 1024, partial(deque([upload]).pop))})
    del held, upload
    while loading.decoding:
        loading.wait()
    assert gone() is not None
    assert len(loader.advance()) == loader.one_family
    assert loader._copies.flying and gone() is None


@pytest.mark.feature("async-loading/batched-mip-upload")
def test_levels_are_the_box_filter_of_the_one_above_all_in_one_submission(vulkan_device, opened):
    formats = [("rgba8", (13, 7)), ("rgba8", (16, 16)), ("r8", (9, 5)), ("rgba16f", (4, 8)), ("rg8", (1, 6))]
    if not takes_narrow(vulkan_device):
        formats = [one for one in formats if one[0] not in ("r8", "rg8")]
    loader, loading, owner = opened(ring=1 << 16)
    requests, pixels = wanted(formats, mips=True)
    loader.want(requests)
    while loading.decoding:
        loading.wait()
    calls = [name for name, _ in traced(vulkan_device, loader.finish)]
    # On a queue of its own the copies are one submission, and making the levels is another one.
    assert calls.count("vkQueueSubmit2") == (1 if loader.one_family else 2)
    for number, (format, _) in enumerate(formats):
        _, _, dtype, channels = FORMATS[format]
        above = pixels[number]
        for level in range(owner.images[number].levels):
            rows = level_of(vulkan_device, owner.images[number], level)
            texels = rows.view(dtype).reshape(len(rows), -1, channels)
            if level == 0:
                assert np.array_equal(texels, above)
                continue
            codes = dtype is np.uint8
            truth = halved_codes(above) if codes else halved(above.astype(np.float64))
            assert texels.shape == truth.shape
            assert np.abs(texels - truth).max() <= (1.0 if codes else 1 / 255), (format, level)
            above = texels


def test_what_a_first_use_costs_is_paid_before_the_first_frame(vulkan_device, opened):
    loader, loading, owner = opened(ring=1 << 16)
    requests, pixels = wanted([("rgba8", (13, 7)), ("rgba8", (16, 16))], mips=True)
    loader.want(requests)
    names = [name for name, _ in traced(vulkan_device, lambda: loader.prepare({("rgba8", False)}))]
    queues = 1 if loader.one_family else 2
    assert names.count("vkQueueSubmit2") == names.count("vkBeginCommandBuffer") == SLOTS * queues
    assert names.count("vkCreateDescriptorPool") == SLOTS, "only one queue makes mip levels"
    assert loader.submissions == 0 and loader._copies.ready and loader._takes.ready
    while loading.decoding:
        loading.wait()
    assert "vkCreateDescriptorPool" not in [name for name, _ in traced(vulkan_device, loader.finish)]
    for number, texels in pixels.items():
        assert np.array_equal(level_of(vulkan_device, owner.images[number]), rows_of(texels))


@pytest.mark.feature("async-loading/batched-mip-upload")
def test_a_chain_that_the_image_brings_is_copied_level_by_level(vulkan_device, opened):
    loader, _, owner = opened(ring=1024)
    levels = [random_pixels("rgba8", size, size[0]) for size in ((20, 12), (10, 6), (5, 3), (2, 1), (1, 1))]
    upload = Upload("chain", Shape(20, 12, "rgba8", None, 5), True, tuple(rows_of(one) for one in levels))
    loader.want({"chain": Wanted("chain", upload.nbytes, lambda: upload)})
    calls = traced(vulkan_device, loader.finish)
    assert "vkCmdDispatch" not in [name for name, _ in calls]
    for number, level in enumerate(levels):
        assert np.array_equal(level_of(vulkan_device, owner.images["chain"], number), rows_of(level))


# --- nothing is waited for ---


@pytest.mark.feature("async-loading/transfer-submission")
def test_fences_are_polled_and_reset_only_for_a_submission(vulkan_device, opened, monkeypatch):
    loader, loading, _ = opened(ring=1 << 16)
    requests, _ = wanted([("rgba8", (32, 32))] * 5)  # 4 KiB each
    loader.want(requests)
    while loading.decoding:
        loading.wait()
    done = [vk.VK_NOT_READY]
    monkeypatch.setitem(vulkan_device.fn.__dict__, "vkGetFenceStatus", lambda *_: done[0])
    copied = []

    def step():
        before = loader.bytes
        loader.advance(4096)
        copied.append(loader.bytes - before)

    log = traced_with(vulkan_device, step, monkeypatch, done)
    assert copied == [4096], "the first begins on a fence that is signalled already"
    for _ in range(3):
        log += traced_with(vulkan_device, step, monkeypatch, done)
    assert copied == [4096, 4096, 0, 0], (
        "as many as there are frames; while the GPU has both, nothing is consumed"
    )
    vulkan_device.wait_idle()
    done[0] = vk.VK_SUCCESS
    log += traced_with(vulkan_device, step, monkeypatch, done)
    names = [name for name, _ in log]
    assert copied[-1] == 4096
    assert not {"vkWaitForFences", "vkDeviceWaitIdle", "vkQueueWaitIdle", "vkWaitSemaphores"} & {*names}
    queues = [arguments for name, arguments in log if name == "vkQueueSubmit2"]
    copies = [one for one in queues if one[0] == loader._queue.handle]
    assert names.count("vkResetFences") == len(queues) and len(copies) == 3
    assert names.count("vkBeginCommandBuffer") == len(queues), "nothing is begun and left empty"


def traced_with(device, work, monkeypatch, done):
    """Return the calls of `work`, during which fences are asked for what `done` holds."""
    log = []
    device.fn.trace(log)
    device.fn.__dict__["vkGetFenceStatus"] = lambda *_: done[0]
    try:
        work()
    finally:
        device.fn.trace(None)
    return log


def test_a_range_is_used_again_when_the_submission_that_copies_from_it_has_ended(
    vulkan_device, opened, monkeypatch
):
    loader, loading, _ = opened(ring=3 * 4096)
    requests, _ = wanted([("rgba8", (32, 32))] * 4)  # 4 KiB each
    loader.want(requests)
    while loading.decoding:
        loading.wait()
    ended = set()
    answer = {True: vk.VK_SUCCESS, False: vk.VK_NOT_READY}
    monkeypatch.setitem(
        vulkan_device.fn.__dict__, "vkGetFenceStatus", lambda _, fence: answer[fence in ended]
    )
    loader.advance(4096)
    loader.advance(4096)
    ended.add(loader._copies._flying[0].fence)
    vulkan_device.wait_idle()
    ring = loader._staging.ring
    assert (ring.tail, ring.head) == (0, 2 * 4096)
    loader.advance(4096)
    assert (ring.tail, ring.head) == (4096, 3 * 4096), "the other one is still copied from"


def test_each_frame_in_flight_has_its_pool_on_the_family_that_copies(vulkan_device, opened):
    loader, _, _ = opened()
    requests, _ = wanted(ODD)
    loader.want(requests)
    calls = traced(vulkan_device, loader.finish)
    families = [arguments[1].queueFamilyIndex for name, arguments in calls if name == "vkCreateCommandPool"]
    graphics = vulkan_device.queue.family
    other = vulkan_device.transfer_queue.family if vulkan_device.transfer_queue else graphics
    assert families == ([graphics] * 2 if other == graphics else [other] * 2 + [graphics] * 2)


# --- who is cancelled, and what fails ---


def test_what_is_cancelled_halfway_is_given_up_when_no_copy_is_under_way(vulkan_device, opened):
    loader, loading, owner = opened(ring=1 << 16)
    requests, pixels = wanted([("rgba8", (32, 64)), ("rgba8", (32, 8))])
    loader.want(requests)
    while loading.decoding:
        loading.wait()
    loader.advance(2000)
    assert 0 in owner.images and 1 not in owner.images
    loader.want({1: requests[1]})
    loader.finish()
    vulkan_device.wait_idle()
    loader.advance()
    assert owner.discarded == [0] and loading.resident(1) and not loading.resident(0)
    assert np.array_equal(level_of(vulkan_device, owner.images[1]), rows_of(pixels[1]))


def test_where_frames_wait_for_textures_one_that_fails_is_an_error_and_leaves_nothing(vulkan_device, opened):
    loader, loading, _ = opened(streams=False)
    requests, _ = wanted(ODD)

    def fail():
        raise OSError("cut short")

    requests[2] = Wanted("picture 2", 4, fail)
    requests[4] = Wanted("picture 4", 4, fail)
    loader.want(requests)
    with pytest.raises(
        SceneError, match=r"picture 2 cannot be decoded \(cut short\): save the image again\."
    ):
        loader.finish()
    assert loader._staging is None
    requests, _ = wanted(ODD)
    loader.want(requests)
    loader.finish()
    assert all(loading.resident(number) for number in requests)


# --- barriers ---

IGNORED = vk.VK_QUEUE_FAMILY_IGNORED
NONE = vk.VK_PIPELINE_STAGE_2_NONE
COPY = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
SHADERS = (
    vk.VK_PIPELINE_STAGE_2_VERTEX_SHADER_BIT
    | vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT
    | vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT
)
READ = (SHADERS, vk.VK_ACCESS_2_SHADER_SAMPLED_READ_BIT)
UNDEFINED = vk.VK_IMAGE_LAYOUT_UNDEFINED
TARGET = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL
SAMPLED = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL


def fields(one):
    return (
        (one.srcStageMask, one.srcAccessMask),
        (one.dstStageMask, one.dstAccessMask),
        (one.oldLayout, one.newLayout),
        (one.srcQueueFamilyIndex, one.dstQueueFamilyIndex),
    )


BEFORE = ((NONE, 0), COPY, (UNDEFINED, TARGET), (IGNORED, IGNORED))
AFTER_ON_ONE = (COPY, READ, (TARGET, SAMPLED), (IGNORED, IGNORED))


@pytest.mark.feature("async-loading/upload-barriers")
def test_the_barriers_between_two_families_and_within_one():
    part = Part(vk.ffi.cast("VkImage", 7), vk.VK_IMAGE_ASPECT_COLOR_BIT, 1, 3, 5)
    assert fields(before_copy(part, held=False)) == BEFORE
    held = fields(before_copy(part, held=True))
    assert held == (READ, COPY, (UNDEFINED, TARGET), (IGNORED, IGNORED))
    release, acquire = after_copy(part, 2, 0)
    assert fields(release) == (COPY, (NONE, 0), (TARGET, SAMPLED), (2, 0))
    everything = (vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, 0)
    assert fields(acquire) == (everything, READ, (TARGET, SAMPLED), (2, 0))
    assert fields(release)[2:] == fields(acquire)[2:], "both halves name the same layouts and families"
    one, none = after_copy(part, 0, 0)
    assert none is None and fields(one) == AFTER_ON_ONE
    for barrier in (release, acquire, one):
        touched = barrier.subresourceRange
        assert (touched.baseMipLevel, touched.levelCount) == (1, 3)
        assert (touched.baseArrayLayer, touched.layerCount) == (5, 1)


@pytest.mark.feature("async-loading/upload-barriers")
def test_what_is_recorded_around_a_copy(vulkan_device, opened):
    loader, _, _ = opened(own_queue=False)
    requests, _ = wanted([("rgba8", (4, 4))])
    loader.want(requests)
    calls = traced(vulkan_device, loader.finish)
    recorded = [(name, a) for name, a in calls if name in ("vkCmdPipelineBarrier2", "vkCmdCopyBufferToImage")]
    assert [name for name, _ in recorded] == [
        "vkCmdPipelineBarrier2",
        "vkCmdCopyBufferToImage",
        "vkCmdPipelineBarrier2",
    ]
    first, last = (arguments[1].pImageMemoryBarriers[0] for _, arguments in (recorded[0], recorded[2]))
    assert (fields(first), fields(last)) == (BEFORE, AFTER_ON_ONE)


@pytest.mark.feature("async-loading/transfer-submission")
def test_a_queue_of_its_own_hands_images_over(vulkan_device, opened):
    if vulkan_device.transfer_queue is None:
        pytest.skip("the device has one family of queues")
    loader, _, owner = opened(ring=4096)
    requests, pixels = wanted([("rgba8", (33, 17)), ("rgba8", (40, 150))], mips=True)
    loader.want(requests)
    calls = traced(vulkan_device, loader.finish)
    queues = {arguments[0] for name, arguments in calls if name == "vkQueueSubmit2"}
    assert queues == {vulkan_device.transfer_queue.handle, vulkan_device.queue.handle}
    for number, one in pixels.items():
        assert np.array_equal(level_of(vulkan_device, owner.images[number]), rows_of(one))


@pytest.mark.newest
@pytest.mark.feature("async-loading/transfer-submission")
@pytest.mark.parametrize("budget", [None, 9000, 700])
def test_two_submissions_hand_each_image_over_once(vulkan_device, opened, monkeypatch, budget):
    """The order of what two queues do, on one: the release is a barrier, the acquire another in a later submission.

    With little to spend, levels are left to the frame after the one that copied the last row; only then is the image
    given away.
    """

    def halves(part, giver, taker):
        return after_copy(part, 0, 0)[0], part_barrier(part, "sampled", "sampled")

    monkeypatch.setattr(graphics_loader, "after_copy", halves)
    loader, loading, owner = opened(ring=8192, own_queue=False)
    loader.one_family = False
    requests, pixels = wanted([("rgba8", (16, 16)), ("rgba8", (40, 24)), ("rgba8", (33, 17))], mips=True)
    loader.want(requests)
    arrived = []
    calls = traced(
        vulkan_device,
        lambda: arrived.extend(loader.finish() if budget is None else stepwise(loader, loading, budget)),
    )
    assert sorted(request.key for request in arrived) == [0, 1, 2], "each of them once"
    handed = {
        image.handle: [
            (barrier.oldLayout, barrier.newLayout)
            for name, arguments in calls
            if name == "vkCmdPipelineBarrier2"
            for barrier in arguments[1].pImageMemoryBarriers[0 : arguments[1].imageMemoryBarrierCount]
            if barrier.image == image.handle and barrier.subresourceRange.baseMipLevel == 0
        ]
        for image in owner.images.values()
    }
    read = vk.VK_IMAGE_LAYOUT_SHADER_READ_ONLY_OPTIMAL
    for layouts in handed.values():
        assert layouts[-2:] == [(vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, read), (read, read)]
        assert layouts.count((read, read)) == 1
    copied, waited = 0, 0  # submissions with copies so far, and how many of them a hand-over knows to be done
    for submit in (arguments[2] for name, arguments in calls if name == "vkQueueSubmit2"):
        if submit.signalSemaphoreInfoCount:
            copied += 1
            assert (submit.pSignalSemaphoreInfos[0].value, submit.waitSemaphoreInfoCount) == (copied, 0)
        else:
            info = submit.pWaitSemaphoreInfos[0]
            assert waited < info.value <= copied
            assert info.stageMask == vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
            waited = info.value
    assert waited == copied > 0
    for number, one in pixels.items():
        assert np.array_equal(level_of(vulkan_device, owner.images[number]), rows_of(one))


def stepwise(loader, loading, budget):
    """Advance frame by frame until everything has arrived; return what has."""
    arrived = []
    for _ in range(2000):
        arrived += loader.advance(budget)
        if not loading.busy:
            return arrived
        if loader._staging is None:
            loading.wait()
        else:
            loader._copies.wait()
    raise AssertionError("it never ends")
