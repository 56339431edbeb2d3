"""Between rays and the rest: features, the layout of binding tables, and the barriers of a frame that traces."""

from __future__ import annotations

import pytest

from backends.contract import Access, resolve
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from chapters import ch12
from chapters.ch12.graph.frame_graph import compile_graph
from chapters.ch12.graph.sync.states import touch_of
from chapters.ch12.graph.sync.vulkan import ACCESS, STAGES
from chapters.ch12.graph.types import External, Node, Touch
from chapters.ch12.pipelines.vulkan_layouts import Layouts
from chapters.ch12.pipelines.vulkan_rays import RayLimits, table_layout
from tests.support.graph_truths import Truth, events_of, places_of
from tests.support.hazards import find_hazards, is_safe

pytestmark = pytest.mark.variants("vulkan")


@pytest.mark.feature("ray-tracing/capability-gate")
@pytest.mark.parametrize("off", ["ray-tracing", "ray-query"])
def test_a_feature_that_is_switched_off_is_not_enabled(vulkan_instance, off):
    """Neither its extension nor a set that its shaders see; what both need stays for the other."""
    with Device(vulkan_instance) as device:
        if not {"ray-tracing", "ray-query"} <= device.features:
            pytest.skip("this device has one of the two")
        assert {"VK_KHR_ray_tracing_pipeline", "VK_KHR_ray_query"} <= device.extensions
    with Device(vulkan_instance, without={off}) as device:
        gone = {"ray-tracing": "VK_KHR_ray_tracing_pipeline", "ray-query": "VK_KHR_ray_query"}[off]
        assert gone not in device.extensions and not device.has(off)
        assert "VK_KHR_acceleration_structure" in device.extensions
        layouts = Layouts(device)
        seen = layouts.stages(vk.VK_SHADER_STAGE_COMPUTE_BIT)
        assert bool(seen & vk.VK_SHADER_STAGE_RAYGEN_BIT_KHR) == (off != "ray-tracing")
        layouts.close()
    needs = ch12.LESSON.needs
    assert not resolve(needs.required, needs.optional, device.capabilities, {off}).native(off)


# --- the binding table, on paper --------------------------------------------------------------------------------------


def limits(size, alignment, base):
    return RayLimits(size, alignment, base, 1, 1 << 30, 4096)


@pytest.mark.feature("ray-tracing/shader-binding-table")
@pytest.mark.parametrize("numbers", [(32, 16, 32), (32, 32, 64), (32, 64, 64), (24, 8, 128), (16, 16, 16)])
@pytest.mark.parametrize("counts", [(1, 0, 0, 0), (1, 2, 1, 0), (1, 1, 5, 3), (1, 0, 3, 1)])
def test_regions_are_aligned_and_do_not_overlap(numbers, counts):
    """The rules of vkCmdTraceRaysKHR: addresses, strides, and that of generation equal to its size."""
    size, alignment, base = numbers
    regions, end = table_layout(counts, limits(*numbers))
    taken = set()
    for number, (region, count) in enumerate(zip(regions, counts, strict=True)):
        if not count:
            assert (region.offset, region.stride, region.size) == (0, 0, 0)
            continue
        assert region.offset % base == 0 and region.stride % alignment == 0 and region.stride >= size
        assert region.size == count * region.stride
        if number == 0:
            assert region.size == region.stride
        own = set(range(region.offset, region.offset + region.size))
        assert not own & taken and max(own) < end
        taken |= own


# --- barriers ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stage", ["rgen", "rmiss", "rchit", "rahit", "rint", "rcall"])
def test_shaders_of_rays_wait_in_their_stage(stage):
    rays = vk.VK_PIPELINE_STAGE_2_RAY_TRACING_SHADER_BIT_KHR
    build = vk.VK_PIPELINE_STAGE_2_ACCELERATION_STRUCTURE_BUILD_BIT_KHR
    touch = touch_of(Access("picture", "storage", stages=(stage,)), "compute", True)
    assert {STAGES[it] for it in touch.stages} == {rays}
    touch = touch_of(Access("world", "structure", stages=(stage,)), "compute", False, buffer=True)
    assert {STAGES[it] for it in touch.stages} == {rays} and touch.layout == ""
    assert {ACCESS[it] for it in touch.access} == {vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_READ_BIT_KHR}
    touch = touch_of(Access("world", "structure", stages=("build",)), "compute", True, buffer=True)
    assert {STAGES[it] for it in touch.stages} == {build}
    assert {ACCESS[it] for it in touch.access} == {vk.VK_ACCESS_2_ACCELERATION_STRUCTURE_WRITE_BIT_KHR}
    touch = touch_of(Access("vertices", "build"), "compute", False, buffer=True)
    assert {STAGES[it] for it in touch.stages} == {build}
    assert {ACCESS[it] for it in touch.access} == {vk.VK_ACCESS_2_SHADER_READ_BIT}


def test_a_frame_of_builds_and_traces_has_no_hazard_and_no_barrier_in_vain():
    """Vertices from compute, a refit, two passes of rays through the result, a draw that samples what they wrote."""
    traced = Touch("", frozenset({"rays", "compute"}), frozenset({"structure_read"}))
    nodes = [
        Node("cloth", writes=(Access("vertices", "storage", bytes=64),)),
        Node(
            "structures",
            reads=(Access("vertices", "build"),),
            writes=(Access("world", "structure", of="kept_world", stages=("build",), bytes=4),),
        ),
        Node(
            "picture",
            reads=(Access("world", "structure", stages=("rgen",)),),
            writes=(Access("rays", "storage", "rgba16f", stages=("rgen",)),),
        ),
        Node(
            "queried",
            reads=(Access("world", "structure"), Access("rays", "sampled")),
            writes=(Access("more", "storage", "rgba16f"),),
        ),
        Node(
            "shown",
            reads=(Access("rays", "sampled"), Access("more", "sampled")),
            writes=(Access("color", "color", "rgba8"),),
        ),
    ]
    externals = {"kept_world": External(None, None, traced, traced, bytes=4)}
    graph = compile_graph(nodes, (8, 8), ["color"], externals)
    truth = Truth(nodes, ["color"], externals)
    places = places_of(graph)
    assert not find_hazards(events_of(truth, graph), places)
    listed = [
        (number, place) for number, step in enumerate(graph.steps) for place in range(len(step.barriers))
    ]
    assert len(listed) >= 5
    assert [one for one in listed if is_safe(events_of(truth, graph, skip=one), places)] == []
