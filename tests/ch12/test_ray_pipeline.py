"""Ray pipelines: groups of every kind and their table, libraries, payloads, edits of shaders, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import buffer_address, create_buffer, destroy_buffer
from backends.vulkan.upload import Uploader
from chapters import ch12
from chapters.ch12.frames.dispatches import check_rays
from chapters.ch12.frames.vulkan_commands import Commands
from chapters.ch12.pipelines.ray_description import HitGroup, RayDescription
from chapters.ch12.pipelines.vulkan import Pipelines
from chapters.ch12.pipelines.vulkan_descriptors import Descriptors, Structure
from chapters.ch12.pipelines.vulkan_rays import LIBRARY, RayLimits, links
from chapters.ch12.rays.groups import ray_description
from chapters.ch12.rays.vulkan_build import INPUT, Bottoms
from chapters.ch12.rays.vulkan_geometry import BoxGeometry
from chapters.ch12.rays.vulkan_top import TopLevel
from common.errors import ShaderError, UnsupportedError
from tests.support.ray_scenes import placements, random_rays, soup, soup_scene
from tests.support.ray_traces import traces_of

pytestmark = pytest.mark.variants("vulkan")


@pytest.fixture
def device(chapter):
    if not chapter.device.has("ray-tracing"):
        pytest.skip("this device has no ray-tracing")
    return chapter.device


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


@pytest.mark.feature("ray-tracing/callable-and-libraries")
def test_callables_run_by_their_places_and_a_trace_covers_its_extent(runs, callables):
    pipeline = runs.pipelines.get([callables])[0]
    assert (runs.trace(pipeline, (6, 3, 2)) == called()).all()
    assert runs.commands.work["dispatches"] == 1


@pytest.mark.feature("ray-tracing/shader-binding-table")
def test_two_swapped_entries_of_the_table_swap_the_shaders(runs, callables):
    pipeline = runs.pipelines.get([callables])[0]
    handles = pipeline.table.handles
    assert len({bytes(handle) for handle in handles}) == 3
    pipeline.table.write(handles[[0, 2, 1]])
    swapped = runs.trace(pipeline, (6, 3, 2))
    assert (swapped == called(doubled=1)).all() and (swapped != called()).any()
    pipeline.table.write(handles)
    assert (runs.trace(pipeline, (6, 3, 2)) == called()).all()


@pytest.mark.feature("ray-tracing/shader-binding-table")
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


@pytest.mark.feature("ray-tracing/callable-and-libraries")
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


@pytest.mark.feature("ray-tracing/callable-and-libraries")
def test_a_pipeline_is_not_linked_where_it_would_lose_its_push_constants():
    def device(*extensions, works):
        return SimpleNamespace(extensions=extensions, capabilities=SimpleNamespace(use=lambda *_: works))

    plain, pushed = (SimpleNamespace(module=SimpleNamespace(push=push)) for push in (None, object()))
    assert links(device(LIBRARY, works=True), [plain, pushed]) and links(
        device(LIBRARY, works=False), [plain]
    )
    assert not links(device(LIBRARY, works=False), [plain, pushed])
    assert not links(device(works=True), [plain])


@pytest.mark.feature("ray-tracing/callable-and-libraries")
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


@pytest.mark.feature("ray-tracing/any-hit-and-intersection")
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


@pytest.mark.feature("ray-tracing/pipeline")
def test_a_recursion_that_the_device_lacks_is_refused(runs, callables):
    deepest = RayLimits.of(runs.device).deepest
    for depth in (0, deepest + 1):
        described = RayDescription(callables.raygen, callables=callables.callables, recursion=depth)
        with pytest.raises(
            ShaderError, match=f"traces rays {depth} deep, and this device has 1 to {deepest}"
        ):
            runs.pipelines.get([described])
    assert len(runs.pipelines) == 0


@pytest.mark.feature("ray-tracing/trace-dispatch")
def test_more_rays_than_a_device_traces_at_once_are_refused():
    check_rays((1000, 1000, 1), 1_000_000)
    with pytest.raises(
        UnsupportedError, match="1000x1001x1 rays are 1001000, and this device traces 1000000"
    ):
        check_rays((1000, 1001, 1), 1_000_000)


@pytest.mark.feature("ray-tracing/capability-gate")
def test_a_device_without_ray_tracing_refuses_in_a_sentence(vulkan_instance, callables):
    with Device(vulkan_instance, without={"ray-tracing"}) as device:
        pipelines = Pipelines(device)
        with pytest.raises(UnsupportedError, match="no ray-tracing pipelines, or is used without them"):
            pipelines.get([callables])
        pipelines.close()


# --- the groups and payloads of the chapter's rays --------------------------------------------------------------------

PAYLOADS = """
#include "rays/pipeline.glsl"
layout(BIND(0, 0, 0), std430) readonly buffer Jobs_ { vec4 unused[]; };
layout(BIND(0, 1, 0), std430) writeonly buffer Hits_ { uvec4 hits[]; };
struct Push { uvec4 count; };
PUSH(Push, push)
void main() {
    uvec2 size = gl_LaunchSizeEXT.xy, id = gl_LaunchIDEXT.xy;
    vec2 at = (vec2(id) + 0.5) / vec2(size) * 4.0 - 2.0;
    Ray down = Ray(vec3(at, 5.0), 0.0, vec3(0.0, 0.0, -1.0), 100.0);
    Ray up = Ray(vec3(at, 5.0), 0.0, vec3(0.0, 0.0, 1.0), 100.0);
    trace(down, 0xFFu, 0u);
    bool none = occluded(up, 0xFFu, 0u);
    uvec4 first = uvec4(floatBitsToUint(ray_hit.t), ray_hit.instance, ray_hit.primitive, uint(none));
    bool some = occluded(down, 0xFFu, 0u);
    trace(up, 0xFFu, 0u);
    uint place = 2u * (id.x + size.x * id.y);
    hits[place] = first;
    hits[place + 1u] = uvec4(uint(some), ray_blocked, ray_hit.instance, 1u);
}
"""


@pytest.mark.feature("ray-tracing/trace-dispatch")
def test_an_image_of_rays_is_the_coverage_and_payloads_do_not_mix(chapter, device, tmp_path):
    """A triangle with corners (-1, -1), (1, -1), (-1, 1) covers pixels with x > -1, y > -1 and x + y < 0."""
    corners = np.array([(-1, -1, 1), (1, -1, 1), (-1, 1, 1)], np.float32)
    scene = soup_scene([(corners, np.array([[0, 1, 2]], np.uint32))], [(0, np.eye(4))])
    width, height = 24, 10
    (tmp_path / "payloads.rgen").write_text(PAYLOADS)
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        described = replace(
            traces.description("pipeline"), raygen=str(tmp_path / "payloads.rgen"), name="payloads"
        )
        pipeline = traces.pipeline(described)
        words = traces.words(pipeline, np.zeros((width * height, 8), np.float32), (width, height))
    x, y = np.meshgrid((np.arange(width) + 0.5) / width * 4 - 2, (np.arange(height) + 0.5) / height * 4 - 2)
    x, y = x.ravel() + scene.origin[0], y.ravel() + scene.origin[1]
    sure = np.abs(np.stack([x + 1, y + 1, x + y])).min(axis=0) > 1e-5
    covered = (x > -1) & (y > -1) & (x + y < 0)
    assert ((words[:, 1] == 0) == covered)[sure].all() and 10 < covered.sum() < width * height / 2
    assert (words[~covered & sure, 1] == 0xFFFFFFFF).all()
    distance = words[covered & sure, 0].copy().view(np.float32)
    assert np.abs(distance - (5 + scene.origin[2] - 1)).max() < 1e-5
    assert (words[:, 3] == 0).all()  # nothing is above, whatever the other payload has
    assert (words[sure, 4] == covered[sure]).all() and (words[:, 5] == words[:, 4]).all()
    assert (words[:, 6] == 0xFFFFFFFF).all()


@pytest.mark.feature("ray-tracing/pipeline")
@pytest.mark.parametrize("asked", [False, True])
def test_groups_are_one_of_generation_two_of_misses_and_one_of_hits(runs, device, tmp_path, asked):
    (tmp_path / "start.rgen").write_text('#include "rays/pipeline.glsl"\nvoid main() {}\n')
    any_hit = tmp_path / "any.rahit"
    any_hit.write_text("#extension GL_EXT_ray_tracing : require\nvoid main() { ignoreIntersectionEXT; }\n")
    described = ray_description(str(tmp_path / "start.rgen"), (("RAYS_SET", 1), ("RAYS_BINDING", 0)))
    if asked:
        described = replace(described, hits=(replace(described.hits[0], any=str(any_hit)),))
    log = []
    device.fn.trace(log)
    try:
        runs.pipelines.get([described])
    finally:
        device.fn.trace(None)
    (created,) = [arguments[4][0] for name, arguments in log if name == "vkCreateRayTracingPipelinesKHR"]
    stages = [created.pStages[place].stage for place in range(created.stageCount)]
    groups = [created.pGroups[place] for place in range(created.groupCount)]
    general = vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR
    triangles = vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR
    unused = vk.VK_SHADER_UNUSED_KHR
    assert [group.type for group in groups] == [general, general, general, triangles]
    assert [stages[group.generalShader] for group in groups[:3]] == [
        vk.VK_SHADER_STAGE_RAYGEN_BIT_KHR,
        vk.VK_SHADER_STAGE_MISS_BIT_KHR,
        vk.VK_SHADER_STAGE_MISS_BIT_KHR,
    ]
    assert groups[1].generalShader != groups[2].generalShader
    hits = groups[3]
    assert stages[hits.closestHitShader] == vk.VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR
    assert hits.generalShader == hits.intersectionShader == unused
    if asked:
        assert stages[hits.anyHitShader] == vk.VK_SHADER_STAGE_ANY_HIT_BIT_KHR
    else:
        assert hits.anyHitShader == unused
    assert created.maxPipelineRayRecursionDepth == 1


def test_a_pass_asks_surfaces_where_some_are_not_opaque():
    plain = ray_description("rays/picture.rgen")
    assert plain.hits[0].any == "" and dict(plain.defines)["RAYS_PIPELINE"] == 1
    assert ray_description("rays/picture.rgen", (("NON_OPAQUE", 1),)).hits[0].any == "rays/hit.rahit"
