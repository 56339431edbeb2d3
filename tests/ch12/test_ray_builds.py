"""What is asked of the driver when structures are built: sizes, scratch memory, calls, and barriers between them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.resources import buffer_address
from chapters import ch12
from chapters.ch12.rays import vulkan as on_vulkan
from chapters.ch12.rays import vulkan_build as build
from chapters.ch12.rays.vulkan_build import Budget, Sizes, batches, places
from common.errors import SceneError
from tests.support.hazards import Barriers, find_hazards, is_safe
from tests.support.kernel_calls import barriers_told, use
from tests.support.pacing import number
from tests.support.ray_scenes import soup, soup_scene
from tests.support.ray_traces import traces_of

pytestmark = pytest.mark.variants("vulkan")
BOTTOM = vk.VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
UPDATE = vk.VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR


@pytest.fixture
def device(chapter):
    if not chapter.device.has("ray-tracing"):
        pytest.skip("this device has no ray-tracing")
    return chapter.device


def fifth_deforms():
    """Return a scene of five meshes, of which the last deforms."""
    return soup_scene(
        [soup(20 + 10 * mesh, 40 + mesh) for mesh in range(5)],
        [(mesh, np.eye(4)) for mesh in range(5)],
        deforms=(4,),
    )


def told(device, call):
    """Return the calls that a function makes, as (name, arguments), with structs kept alive."""
    log = []
    device.fn.trace(log)
    try:
        call()
    finally:
        device.fn.trace(None)
    return log


def minimal_scratch(device):
    limits = vk.new("VkPhysicalDeviceAccelerationStructurePropertiesKHR")
    outer = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, outer)
    return int(limits.minAccelerationStructureScratchOffsetAlignment)


def builds_of(log):
    """Return what was built, by call: (whether it is a mesh, whether anew, offset, size, address of scratch memory).

    And what was asked: (size of the structure, of its scratch memory) by the number of triangles or instances.
    """
    asked, created, builds = {}, {}, []
    for name, arguments in log:
        if name == "vkGetAccelerationStructureBuildSizesKHR":
            sizes = arguments[4]
            asked[int(arguments[3][0])] = int(sizes.accelerationStructureSize), int(sizes.buildScratchSize)
        elif name == "vkCreateAccelerationStructureKHR":
            created[number(arguments[3][0])] = int(arguments[1].offset), int(arguments[1].size)
        elif name == "vkCmdBuildAccelerationStructuresKHR":
            infos = [arguments[2][place] for place in range(int(arguments[1]))]
            builds.append(
                [
                    (
                        info.type == BOTTOM,
                        info.mode != UPDATE,
                        # Now: a compacted copy may get the number of a structure that was destroyed.
                        *created[number(info.dstAccelerationStructure)],
                        int(info.scratchData.deviceAddress),
                    )
                    for info in infos
                ]
            )
    return builds, asked


@pytest.mark.feature("acceleration/size-and-scratch")
def test_sizes_are_those_that_the_driver_says_and_scratch_memory_is_aligned(chapter, device, tmp_path):
    with traces_of(chapter, ch12.__name__, fifth_deforms(), tmp_path) as traces:
        structures = traces.structures
        builds, asked = builds_of(
            told(device, lambda: (structures._make_anew(), traces.build(0, deformed=True)))
        )
    still, moving, refit, top = builds
    assert [len(call) for call in builds] == [4, 1, 1, 1]
    assert all(it[:2] == (True, True) for it in (*still, *moving))
    assert refit[0][:2] == (True, False) and top[0][:2] == (False, True)
    alignment = minimal_scratch(device)
    for _, _, offset, _, scratch in (*still, *moving, *refit, *top):
        assert offset % 256 == 0 and scratch % alignment == 0 and scratch > 0
    counts = [20 + 10 * mesh for mesh in range(5)]
    assert [it[3] for it in (*still, *moving)] == [asked[count][0] for count in counts]
    assert top[0][3] == asked[5][0]
    # Those of one call may run at the same time: no two of them share a byte, of their own or of scratch memory.
    for place, sizes in ((2, [it[3] for it in still]), (4, [asked[count][1] for count in counts[:4]])):
        parts = sorted((it[place], it[place] + size) for it, size in zip(still, sizes, strict=True))
        assert all(first[1] <= second[0] for first, second in itertools.pairwise(parts))
    assert structures._bottoms.all == []


@pytest.mark.feature("acceleration/size-and-scratch")
def test_a_mesh_of_more_triangles_than_a_structure_holds_is_refused(chapter, device, tmp_path, monkeypatch):
    limits = build.StructureLimits.of(device)
    assert limits.scratch_alignment == minimal_scratch(device)
    few = build.StructureLimits(limits.scratch_alignment, 59, limits.most_instances)
    monkeypatch.setattr(on_vulkan.StructureLimits, "of", lambda device: few)
    with (
        pytest.raises(
            SceneError, match="Mesh 4 has 60 triangles, and structures of this device hold 59: split it"
        ),
        traces_of(chapter, ch12.__name__, fifth_deforms(), tmp_path),
    ):
        pass


def test_batches_keep_to_each_budget_and_take_one_at_least():
    random = np.random.default_rng(50)
    for _ in range(200):
        count = int(random.integers(0, 12))
        numbers = random.integers(1, 100, (count, 3))
        sizes = [Sizes(int(storage), int(scratch), 0) for storage, scratch, _ in numbers]
        counts = [int(triangles) for _, _, triangles in numbers]
        budget = Budget(*(int(limit) for limit in random.integers(1, 250, 3)))
        split = list(batches(sizes, counts, budget))
        assert [place for batch in split for place in batch] == list(range(count))

        def over(batch, sizes=sizes, counts=counts, budget=budget):
            """Whether structures are more than a budget has room for."""
            return (
                sum(sizes[place].scratch for place in batch) > budget.scratch
                or sum(sizes[place].structure for place in batch) > budget.storage
                or sum(counts[place] for place in batch) > budget.triangles
            )

        for batch, following in itertools.zip_longest(split, split[1:]):
            assert len(batch) == 1 or not over(batch)
            assert following is None or over([*batch, following[0]])


def test_places_follow_one_another_at_multiples_of_the_alignment():
    assert places([1, 256, 257, 0, 5], 256) == ([0, 256, 512, 1024, 1024], 1280)


@pytest.mark.feature("acceleration/compaction")
def test_structures_that_would_not_become_smaller_are_not_copied(chapter, device, tmp_path, monkeypatch):
    monkeypatch.setattr(build.Bottoms, "_answers", lambda self, query, count: [1 << 20] * count)
    with chapter.calls() as calls, traces_of(chapter, ch12.__name__, fifth_deforms(), tmp_path) as traces:
        work = traces.structures.work
        assert work["ray_compacted_bytes"] == work["ray_uncompacted_bytes"]
    assert "vkCmdWriteAccelerationStructuresPropertiesKHR" in calls
    assert "vkCmdCopyAccelerationStructureKHR" not in calls


RESOURCES = ("records", "bottoms", "scratch", "top")


@pytest.mark.feature("acceleration/parallel-builds")
def test_barriers_of_a_frame_of_builds_are_enough_and_each_is_missed(chapter, device, tmp_path):
    """Two frames on a simulated GPU: records, a refit, the build of the upper level, and rays of both kinds."""
    with traces_of(chapter, ch12.__name__, fifth_deforms(), tmp_path) as traces:
        before, between, after = barriers_told(device, lambda: traces.build(0, deformed=True), RESOURCES)
    again = ("build structure_read", "build structure_write")
    frame = [
        before,
        use("records", "records", "compute storage_write", fresh=True),
        use("refit", "bottoms", *again),
        use("refit", "scratch", "build structure_write", fresh=True),
        between,
        use("upper level", "records", "build build_input"),
        use("upper level", "bottoms", "build structure_read"),
        use("upper level", "top", "build structure_write", fresh=True),
        use("upper level", "scratch", "build structure_write", fresh=True),
        after,
        *(
            use("rays", resource, f"{stage} structure_read")
            for stage in ("rays", "compute")
            for resource in ("top", "bottoms")
        ),
    ]
    first = [use("first build", "bottoms", "build structure_write", fresh=True)]
    assert find_hazards([*first, *frame, *frame], {}) == []
    for one in (before, between, after):
        assert isinstance(one, Barriers)
        left = [event for event in frame if event is not one]
        assert not is_safe([*first, *left, *left], {}), f"the frame is safe without the barrier {one}"


def test_an_address_of_a_page_is_where_its_positions_begin(chapter, device, tmp_path):
    with traces_of(chapter, ch12.__name__, fifth_deforms(), tmp_path, frames=2) as traces:
        data = traces.api.data
        offset = data.pages[0].offsets["positions"]
        for slot in (0, 1):
            start = buffer_address(device, data.page_buffer(slot, 0)) + offset
            first = [traces.structures._vertices(mesh, slot) for mesh in range(5)]
            vertices = np.cumsum([0, *(3 * (20 + 10 * mesh) for mesh in range(4))])
            assert first == [start + 12 * int(vertex) for vertex in vertices]
        assert traces.structures._vertices(0, 0) != traces.structures._vertices(0, 1)
