"""Ray pipelines: the shader binding table, groups of every kind, libraries, edits of shaders, and what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from backends.contract import Access
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import buffer_address, create_buffer, destroy_buffer
from backends.vulkan.upload import Uploader
from chapters import ch12
from chapters.ch12.frames.dispatches import check_rays
from chapters.ch12.frames.vulkan_commands import Commands
from chapters.ch12.graph.frame_graph import compile_graph
from chapters.ch12.graph.sync.states import touch_of
from chapters.ch12.graph.sync.vulkan import ACCESS, STAGES
from chapters.ch12.graph.types import External, Node, Touch
from chapters.ch12.pipelines.ray_description import HitGroup, RayDescription
from chapters.ch12.pipelines.vulkan import Pipelines
from chapters.ch12.pipelines.vulkan_descriptors import Descriptors, Structure
from chapters.ch12.pipelines.vulkan_rays import LIBRARY, RayLimits, table_layout
from chapters.ch12.rays.vulkan_build import INPUT, Bottoms, BoxGeometry
from chapters.ch12.rays.vulkan_top import TopLevel
from common.errors import ShaderError, UnsupportedError
from tests.support.graph_truths import Truth, events_of, places_of
from tests.support.hazards import find_hazards, is_safe
from tests.support.ray_scenes import placements, random_rays, soup, soup_scene
from tests.support.ray_traces import traces_of

pytestmark = pytest.mark.variants("vulkan")


@pytest.fixture
def device(chapter):
    if not chapter.device.has("ray-tracing"):
        pytest.skip("this device has no ray-tracing")
    return chapter.device


# --- the binding table, on paper --------------------------------------------------------------------------------------


def limits(size, alignment, base):
    return RayLimits(size, alignment, base, 1, 1 << 30, 4096)


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


# --- groups -----------------------------------------------------------------------------------------------------------

RAYGEN = """
#extension GL_EXT_ray_tracing : require
layout(set = 0, binding = 0, std430) writeonly buffer Out_ { uint found[]; };
layout(location = 0) callableDataEXT uint data;
void main() {
    data = gl_LaunchIDEXT.x + 10u * gl_LaunchIDEXT.y + 100u * gl_LaunchIDEXT.z;
    executeCallableEXT(gl_LaunchIDEXT.x % 2u, 0);
    found[gl_LaunchIDEXT.x + gl_LaunchSizeEXT.x * (gl_LaunchIDEXT.y + gl_LaunchSizeEXT.y * gl_LaunchIDEXT.z)] = data;
}
"""
CALLED = """
#extension GL_EXT_ray_tracing : require
layout(location = 0) callableDataInEXT uint data;
void main() {{ data = {}; }}
"""


@pytest.fixture
def callables(tmp_path):
    """The description of a pipeline with two callables, of which one doubles and one adds 1000."""
    (tmp_path / "start.rgen").write_text(RAYGEN)
    (tmp_path / "twice.rcall").write_text(CALLED.format("2u * data"))
    (tmp_path / "more.rcall").write_text(CALLED.format("data + 1000u"))
    names = tuple(str(tmp_path / name) for name in ("twice.rcall", "more.rcall"))
    return RayDescription(str(tmp_path / "start.rgen"), callables=names)


class Runs:
    """Pipelines on a device, and traces whose only buffer is what they write."""

    def __init__(self, device):
        self.device = device
        self.pipelines, self.descriptors = Pipelines(device), Descriptors(device)
        self.commands = Commands(device)

    def trace(self, pipeline, extent, held=None):
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        count = int(np.prod(extent))
        found = create_buffer(self.device, 4 * count, usage, "readback", "found")
        sets = self.descriptors.create([(pipeline.sets[0], {0: found} | (held or {}), "found")])
        every = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
        with submit_once(self.device) as handle:
            self.commands.begin(SimpleNamespace(commands=handle, index=0))
            self.commands.bind_compute(pipeline)
            self.commands.bind_compute_set(pipeline, 0, vk.array("VkDescriptorSet", sets.handles))
            self.commands.trace(pipeline, extent)
            to_host = every, vk.VK_ACCESS_2_MEMORY_WRITE_BIT, vk.VK_PIPELINE_STAGE_2_HOST_BIT
            self.device.fn.vkCmdPipelineBarrier2(
                handle, barriers(memory=(*to_host, vk.VK_ACCESS_2_HOST_READ_BIT))
            )
        words = found.view(np.uint32)[:count].copy()
        self.descriptors.destroy(sets)
        destroy_buffer(self.device, found)
        return words

    def close(self):
        self.descriptors.close()
        self.pipelines.close()


@pytest.fixture
def runs(device):
    made = Runs(device)
    yield made
    made.close()


def called(doubled=0):
    """Return what a trace over (6, 3, 2) finds, if rays of this parity are doubled."""
    z, y, x = np.meshgrid(*map(np.arange, (2, 3, 6)), indexing="ij")
    data = x + 10 * y + 100 * z
    return np.where(x % 2 == doubled, 2 * data, data + 1000).ravel()


def test_callables_run_by_their_places_and_a_trace_covers_its_extent(runs, callables):
    pipeline = runs.pipelines.get([callables])[0]
    assert (runs.trace(pipeline, (6, 3, 2)) == called()).all()
    assert runs.commands.work["dispatches"] == 1


def test_two_swapped_entries_of_the_table_swap_the_shaders(runs, callables):
    pipeline = runs.pipelines.get([callables])[0]
    handles = pipeline.table.handles
    assert len({bytes(handle) for handle in handles}) == 3
    pipeline.table.write(handles[[0, 2, 1]])
    assert (runs.trace(pipeline, (6, 3, 2)) == called(doubled=1)).all()
    pipeline.table.write(handles)
    assert (runs.trace(pipeline, (6, 3, 2)) == called()).all()


def test_the_table_is_where_the_device_wants_it(runs, callables, device):
    table = runs.pipelines.get([callables])[0].table
    asked = vk.new("VkPhysicalDeviceRayTracingPipelinePropertiesKHR")
    outer = vk.new("VkPhysicalDeviceProperties2", pNext=asked)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, outer)
    for region, count in zip(table.arguments, (1, 0, 0, 2), strict=True):
        assert (region.size > 0) == (count > 0)
        if count:
            assert region.deviceAddress % asked.shaderGroupBaseAlignment == 0
            assert region.stride % asked.shaderGroupHandleAlignment == 0
            assert region.stride >= asked.shaderGroupHandleSize and region.size == count * region.stride
    assert table.arguments[0].size == table.arguments[0].stride


@pytest.mark.parametrize("linked", [False, True])
def test_libraries_give_what_one_pipeline_gives(runs, callables, device, linked):
    if linked and LIBRARY not in device.extensions:
        pytest.skip(f"this device has no {LIBRARY}")
    described = RayDescription(callables.raygen, callables=callables.callables, linked=linked)
    log = []
    device.fn.trace(log)
    try:
        pipeline = runs.pipelines.get([described])[0]
    finally:
        device.fn.trace(None)
    made = [arguments for name, arguments in log if name == "vkCreateRayTracingPipelinesKHR"]
    libraries = [bool(one[4][0].flags & vk.VK_PIPELINE_CREATE_LIBRARY_BIT_KHR) for one in made]
    assert libraries == ([True, True, True, False] if linked else [False])
    assert (runs.trace(pipeline, (6, 3, 2)) == called()).all()


def test_a_linked_pipeline_traces_the_same_picture(chapter, device, tmp_path):
    """It has push constants: a driver that loses them, as a self-test has shown, gets one pipeline in the end."""
    scene = soup_scene([soup(50, 30)], [(0, matrix) for matrix in placements()])
    rays = random_rays(scene, 600, 31)
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        whole = traces.trace(traces.pipeline(traces.description("pipeline")), *rays)
        linked = traces.trace(traces.pipeline(traces.description("pipeline", linked=True)), *rays)
    assert (whole.instance >= 0).any()
    for field in ("t", "instance", "primitive", "at", "back", "blocked"):
        assert (getattr(whole, field) == getattr(linked, field)).all(), field


SPHERES = """
#extension GL_EXT_ray_tracing : require
layout(set = 0, binding = 0, std430) writeonly buffer Out_ { uint found[]; };
layout(set = 0, binding = 1) uniform accelerationStructureEXT world;
layout(location = 0) rayPayloadEXT vec2 payload;
void main() {
    float x = (float(gl_LaunchIDEXT.x) + 0.5) / float(gl_LaunchSizeEXT.x) * 12.0 - 6.0;
    payload = vec2(-1.0);
    traceRayEXT(world, gl_RayFlagsNoneEXT, 0xFF, 0, 1, 0, vec3(x, 0.0, 5.0), 0.0, vec3(0.0, 0.0, -1.0), 100.0, 0);
    found[gl_LaunchIDEXT.x] = floatBitsToUint(payload.x);
}
"""
IN_SPHERE = """
#extension GL_EXT_ray_tracing : require
hitAttributeEXT float height;
void main() {
    vec3 o = gl_ObjectRayOriginEXT - vec3(3.0 * float(gl_PrimitiveID), 0.0, 0.0);
    vec3 d = gl_ObjectRayDirectionEXT;
    float b = dot(o, d), inside = b * b - dot(o, o) + 1.0;
    if (inside >= 0.0) {
        height = o.z + d.z * (-b - sqrt(inside));
        reportIntersectionEXT(-b - sqrt(inside), 0u);
    }
}
"""
SHOWN = """
#extension GL_EXT_ray_tracing : require
layout(location = 0) rayPayloadInEXT vec2 payload;
hitAttributeEXT float height;
void main() { payload = vec2(height, gl_HitTEXT); }
"""
MISSED = """
#extension GL_EXT_ray_tracing : require
layout(location = 0) rayPayloadInEXT vec2 payload;
void main() { payload = vec2(-2.0); }
"""


def test_intersection_shaders_find_spheres_in_boxes(runs, device, tmp_path):
    """The height at which vertical rays meet spheres of radius 1 around 0 and 3: sqrt(1 - (x - centre)^2)."""
    for name, text in (
        ("start.rgen", SPHERES),
        ("sphere.rint", IN_SPHERE),
        ("shown.rchit", SHOWN),
        ("missed.rmiss", MISSED),
    ):
        (tmp_path / name).write_text(text)
    path = {
        name.partition(".")[0]: str(tmp_path / name) for name in ("start.rgen", "sphere.rint", "shown.rchit")
    }
    boxes = np.array([[-1, -1, -1, 1, 1, 1], [2, -1, -1, 4, 1, 1]], np.float32)
    copied = vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    buffer = create_buffer(device, boxes.nbytes, INPUT | copied, "device", "boxes")
    with Uploader(device) as uploader:
        uploader.buffer(buffer, boxes)
    bottoms = Bottoms(device, [BoxGeometry(buffer_address(device, buffer), 2, "spheres")])
    top = TopLevel(device, 1)
    record = np.zeros(16, np.uint32)
    record[:12] = np.eye(4, dtype=np.float32)[:3].reshape(-1).view(np.uint32)
    record[12] = 0xFF << 24
    record[14:] = np.array([bottoms.all[0].address], np.uint64).view(np.uint32)
    with Uploader(device) as uploader:
        uploader.buffer(top.records, record)
    with submit_once(device) as commands:
        top.record(commands)
    described = RayDescription(
        path["start"], (str(tmp_path / "missed.rmiss"),), (HitGroup(path["shown"], "", path["sphere"]),)
    )
    pipeline = runs.pipelines.get([described])[0]
    found = runs.trace(pipeline, (240,), {1: Structure(top.handle)}).view(np.float32)
    x = (np.arange(240) + 0.5) / 240 * 12 - 6
    nearest = np.minimum(np.abs(x), np.abs(x - 3))
    expected = np.where(nearest < 1, np.sqrt(np.maximum(1 - nearest**2, 0)), -2)
    assert np.abs(found - expected).max() < 1e-3
    assert (found > 0).sum() == (nearest < 1).sum()
    top.close()
    bottoms.close()
    destroy_buffer(device, buffer)


# --- edits ------------------------------------------------------------------------------------------------------------


def test_an_edited_shader_of_a_group_takes_effect_and_a_wrong_one_changes_nothing(runs, callables, tmp_path):
    pipeline = runs.pipelines.get([callables])[0]
    file, retired = tmp_path / "more.rcall", []
    file.write_text(CALLED.format("data + 5u"))
    assert runs.pipelines.reload({file}, retired.append) == (callables.title,)
    assert len(retired) == 1
    for free in retired:
        free()
    data = runs.trace(pipeline, (6, 1, 1))
    assert data.tolist() == [0, 6, 4, 8, 8, 10]
    file.write_text(CALLED.format("data + five"))
    with pytest.raises(ShaderError, match=r"more\.rcall.*5|five"):
        runs.pipelines.reload({file}, retired.append)
    file.write_text("layout(set = 0, binding = 3) buffer B_ { uint b; };\n" + CALLED.format("data + b"))
    with pytest.raises(ShaderError, match="binding 3"):
        runs.pipelines.reload({file}, retired.append)
    assert len(retired) == 1
    assert runs.trace(pipeline, (6, 1, 1)).tolist() == [0, 6, 4, 8, 8, 10]


# --- what is refused --------------------------------------------------------------------------------------------------


def test_a_recursion_that_the_device_lacks_is_refused(runs, callables):
    deepest = RayLimits.of(runs.device).deepest
    for depth in (0, deepest + 1):
        described = RayDescription(callables.raygen, callables=callables.callables, recursion=depth)
        with pytest.raises(
            ShaderError, match=f"traces rays {depth} deep, and this device has 1 to {deepest}"
        ):
            runs.pipelines.get([described])
    assert len(runs.pipelines) == 0


def test_more_rays_than_a_device_traces_at_once_are_refused():
    check_rays((1000, 1000, 1), 1_000_000)
    with pytest.raises(
        UnsupportedError, match="1000x1001x1 rays are 1001000, and this device traces 1000000"
    ):
        check_rays((1000, 1001, 1), 1_000_000)


def test_a_device_without_ray_tracing_refuses_in_a_sentence(vulkan_instance, callables):
    with Device(vulkan_instance, without={"ray-tracing"}) as device:
        pipelines = Pipelines(device)
        with pytest.raises(UnsupportedError, match="no ray-tracing pipelines, or is used without them"):
            pipelines.get([callables])
        pipelines.close()


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
