"""Graphs carried out on Vulkan: buffers, images that compute writes, histories, and what belongs to somebody else."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from itertools import pairwise

import numpy as np
import pytest

from backends import shader_text
from backends.contract import Access, Pass
from backends.vulkan import api as vk
from backends.vulkan.compute import Kernel, Sampled
from backends.vulkan.readback import read_image
from backends.vulkan.resources import create_buffer, create_image, destroy_buffer, destroy_image
from chapters.ch04.frames.recording.vulkan_recordings import Recordings
from chapters.ch04.frames.vulkan_commands import Commands
from chapters.ch04.frames.vulkan_profiler import Profiler
from chapters.ch04.frames.vulkan_resources import Resources
from chapters.ch04.graph.execute.vulkan import GraphExecutor
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.memory.vulkan_images import GraphMemory
from chapters.ch04.graph.types import External, Node, Touch
from chapters.ch04.pipelines.vulkan_descriptors import Descriptors

N = 64
BYTES = 4 * N
IDLE = Touch("", frozenset(), frozenset())
FOR_HOST = Touch("", frozenset({"host"}), frozenset({"host_read"}))

SEED = """
layout(local_size_x = 64) in;
layout(binding = 0) buffer Numbers { uint numbers[]; };
layout(binding = 1, r32ui) uniform uimage2D field;
void main() {
    uint i = gl_GlobalInvocationID.x;
    numbers[i] = i * i;
    imageStore(field, ivec2(i % 8u, i / 8u), uvec4(i));
}
"""
ADD = """
layout(local_size_x = 64) in;
layout(binding = 0) readonly buffer Numbers { uint numbers[]; };
layout(binding = 1, r32ui) readonly uniform uimage2D field;
layout(binding = 2) readonly buffer Before { uint before[]; };
layout(binding = 3) writeonly buffer Sum { uint sum[]; };
layout(binding = 4) readonly buffer Given { uint given[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    sum[i] = before[i] + numbers[i] + imageLoad(field, ivec2(i % 8u, i / 8u)).x + given[i];
}
"""


class Dispatch(Pass):
    """A compute pass, which binds what it touches in the order of `held`."""

    def __init__(self, device, name, text, held, reads, writes):
        kinds = ["image" if one == "field" else "storage" for one in held]
        self.kernel = Kernel(
            device, shader_text.build_text(text, "comp", "vulkan", name=f"<{name}>"), kinds, dispatches=8
        )
        self.name, self.held, self.reads, self.writes = name, held, reads, writes
        self.images = None

    def record(self, commands):
        mine = self.images.in_slot[commands.slot.index]
        held = [Sampled(mine[name].view) if name == "field" else mine[name] for name in self.held]
        self.kernel.record(commands.handle, held, (1, 1, 1))


class Copy(Pass):
    """A pass that copies one buffer into another."""

    def __init__(self, device, source, target):
        self.device, self.source, self.target, self.images = device, source, target, None
        self.name = f"copy {source}"
        self.reads = (Access(source, "copy"),)
        self.writes = (Access(target, "copy", bytes=BYTES),)

    def record(self, commands):
        mine = self.images.in_slot[commands.slot.index]
        region = vk.array("VkBufferCopy", [{"size": BYTES}])
        source, target = mine[self.source].handle, mine[self.target].handle
        self.device.fn.vkCmdCopyBuffer(commands.handle, source, target, 1, region)


@contextmanager
def carried_out(device, passes, outputs, externals, given, alias=True):
    """Yield (a function that draws a frame and returns its slot, the executor)."""
    with ExitStack() as stack:

        def owned(made):
            stack.callback(made.close)
            return made

        nodes = [Node(made.name, made.reads, made.writes) for made in passes]
        memory = GraphMemory(device, {"copy_source"})
        graph = compile_graph(nodes, (8, 8), outputs, externals, memory.requirement, alias)
        resources, descriptors = owned(Resources(device)), owned(Descriptors(device))
        frames, profiler = owned(Recordings(device)), owned(Profiler(device))
        named = {made.name: made for made in passes}
        executor = owned(GraphExecutor(device, graph, named, memory, resources, descriptors, lambda _: given))
        for made in passes:
            made.images = executor.images
        commands = Commands(device)

        def draw():
            slot = frames.begin()
            if slot.key is None:
                with frames.recording(slot, "recorded"):
                    commands.begin(slot)
                    profiler.begin_frame(slot)
                    executor.record(commands, slot.index, profiler)
            frames.submit(slot)
            frames.wait(slot)
            return slot

        yield draw, executor
        device.wait_idle()


@pytest.fixture
def summing(vulkan_device):
    """Passes that add up from frame to frame: a transient buffer and image, a history, two buffers of the test's."""
    device = vulkan_device
    usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT
    with ExitStack() as stack:

        def buffer(use, name):
            made = create_buffer(device, BYTES, usage, use, name)
            stack.callback(destroy_buffer, device, made)
            return made

        given = buffer("upload", "given")
        results = [buffer("readback", f"result {slot}") for slot in range(2)]
        numbers, field = Access("numbers", "storage", bytes=BYTES), Access("field", "storage", format="r32ui")
        reads = (
            Access("numbers", "storage"),
            Access("field", "storage"),
            Access("sum", "storage", previous=True),
            Access("given", "storage"),
        )
        passes = [
            Dispatch(device, "seed", SEED, ["numbers", "field"], (), (numbers, field)),
            Dispatch(
                device,
                "add",
                ADD,
                ["numbers", "field", "sum@previous", "sum", "given"],
                reads,
                (Access("sum", "storage", bytes=BYTES),),
            ),
            Copy(device, "sum", "result"),
        ]
        for made in passes[:2]:
            stack.callback(made.kernel.close)
        externals = {
            "given": External(None, None, IDLE, bytes=BYTES),
            "result": External(None, None, IDLE, FOR_HOST, BYTES),
        }
        yield passes, externals, given, results


@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("alias", [True, False])
@pytest.mark.feature("frame-graph/external-resources")
@pytest.mark.feature("frame-graph/resource-types")
def test_a_history_adds_up_what_compute_writes_to_buffers_and_images(vulkan_device, summing, alias):
    """sum(k) - sum(k - 1) = i*i + i + given(k), whatever was in memory before the first frame."""
    passes, externals, given, results = summing
    held = [{"given": given, "result": result} for result in results]
    i = np.arange(N, dtype=np.uint32)
    with carried_out(vulkan_device, passes, (), externals, held, alias) as (draw, executor):
        sums = []
        for number in range(6):
            given.view(np.uint32)[:] = 1000 * number
            slot = draw()
            vulkan_device.memory.invalidate(results[slot.index].allocation)
            sums.append(results[slot.index].view(np.uint32).copy())
        for number, (before, after) in enumerate(pairwise(sums), start=1):
            assert np.array_equal(after - before, i * i + i + np.uint32(1000 * number))
        lives = {name: one.life for name, one in executor.graph.resources.items()}
        assert lives == {
            "field": "transient",
            "numbers": "transient",
            "sum": "history",
            "given": "external",
            "result": "external",
        }
        assert set(executor.graph.memory.places) == {"field", "numbers"}
    # What belongs to somebody else is still there.
    assert int(given.view(np.uint32)[0]) == 5000


@pytest.mark.variants("vulkan")
@pytest.mark.feature("frame-graph/resource-types")
def test_each_type_of_resource_yields_its_barrier_or_attachment_and_a_reference_no_image(vulkan_device):
    """A target, a buffer and an image of a compute pass, and a second name of the target."""
    nodes = [
        Node("draw", (), (Access("lit", "color", format="rgba8", clear=(0, 0, 0, 0)),)),
        Node("over", (), (Access("over", "color", of="lit"),)),
        Node("count", (Access("over", "sampled"),), (Access("counts", "storage", bytes=BYTES),)),
        Node("show", (Access("counts", "uniform"),), (Access("shown", "storage", format="rgba8"),)),
    ]
    memory = GraphMemory(vulkan_device)
    graph = compile_graph(nodes, (8, 8), ["shown"], requirements=memory.requirement)
    resources, descriptors = Resources(vulkan_device), Descriptors(vulkan_device)
    made = GraphExecutor(
        vulkan_device, graph, {node.name: Clear(node.name) for node in nodes}, memory, resources, descriptors
    )
    try:
        steps = {ready.step.name: ready for ready in made._slots[0].steps}
        assert set(made.images.in_slot[0]) == {"lit", "counts", "shown"}  # "over" is "lit"
        assert made.images.by_name(graph)["over"] is made.images.by_name(graph)["lit"]
        for name in ("draw", "over"):
            info = steps[name].targets.info
            assert info.colorAttachmentCount == 1 and info.pDepthAttachment == vk.NULL
        assert steps["draw"].targets.info.pColorAttachments[0].loadOp == vk.VK_ATTACHMENT_LOAD_OP_CLEAR
        assert steps["over"].targets.info.pColorAttachments[0].loadOp == vk.VK_ATTACHMENT_LOAD_OP_LOAD
        assert steps["count"].targets is None
        counts = {
            name: (one.barriers.imageMemoryBarrierCount, one.barriers.bufferMemoryBarrierCount)
            for name, one in steps.items()
        }
        # `counts` is written again in the next frame, and needs no barrier for that: `count` waits for targets there,
        # and they wait for compute shaders of this frame.
        assert counts == {"draw": (1, 0), "over": (1, 0), "count": (1, 0), "show": (1, 1)}
        read = steps["show"].barriers.pBufferMemoryBarriers[0]
        assert read.srcAccessMask & vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
        assert read.dstAccessMask == vk.VK_ACCESS_2_UNIFORM_READ_BIT
    finally:
        made.close()
        resources.close()
        descriptors.close()


class Clear(Pass):
    """A pass that draws nothing: its targets are what they were cleared to."""

    def __init__(self, name, *writes):
        self.name, self.reads, self.writes, self.images = name, (), writes, None

    def record(self, commands):
        pass


@pytest.mark.variants("vulkan")
@pytest.mark.feature("device/offscreen-targets")
@pytest.mark.feature("frame-graph/render-targets")
@pytest.mark.feature("frame-graph/external-resources")
def test_targets_of_every_size_and_format_are_filled_completely(vulkan_device):
    """Whole, half, double and absolute sizes; colour, depth or both in a pass; integers; an image from outside.

    A target without a size is as large as the frame.
    """
    device = vulkan_device
    usage = vk.VK_IMAGE_USAGE_COLOR_ATTACHMENT_BIT | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
    theirs = create_image(device, "rgba8", (5, 3), usage, "theirs")
    mine = {
        "theirs": Access("theirs", "color", clear=(0.0, 1.0, 0.0, 1.0)),
        "whole": Access("whole", "color", format="rgba16f", clear=(0.5, 2.0, -1.0, 1.0)),
        "second": Access("second", "color", format="r32ui", clear=(7, 0, 0, 0)),
        "depth": Access("depth", "depth", format="d32f", clear=(0.25,)),
        "half": Access("half", "color", format="rgba32f", clear=(1.5, 0, 0, 1), scale=0.5),
        "double": Access("double", "color", format="rgba8", clear=(0, 0, 1, 1), scale=2.0),
        "fixed": Access("fixed", "color", format="rgba8", clear=(1, 1, 1, 1), size=(7, 9)),
        "shadow": Access("shadow", "depth", format="d32f", clear=(0.75,)),
    }
    passes = [
        Clear("several", mine["whole"], mine["second"], mine["depth"]),
        *(Clear(name, mine[name]) for name in ("half", "double", "fixed", "shadow", "theirs")),
    ]
    left = Touch("color", frozenset({"color"}), frozenset({"color_write"}), True)
    anything = Touch("undefined", frozenset(), frozenset())
    externals = {"theirs": External("rgba8", (5, 3), anything, left)}
    outputs = [name for name in mine if name != "theirs"]
    try:
        held = [{"theirs": theirs}] * 2
        with carried_out(device, passes, outputs, externals, held) as (draw, executor):
            for _ in range(2):
                draw()
            device.wait_idle()
            sizes = {"whole": (8, 8), "second": (8, 8), "half": (4, 4), "double": (16, 16), "fixed": (9, 7)}
            for name, (height, width) in sizes.items():
                pixels = read_image(device, executor.images.image(0, name), "color")
                assert pixels.shape[:2] == (height, width)
                scale = 255 if mine[name].format == "rgba8" else 1
                expected = np.array(mine[name].clear, np.float64) * scale
                assert (
                    pixels.reshape(height * width, -1) == expected[: pixels.size // height // width]
                ).all()
            for name, value in (("depth", 0.25), ("shadow", 0.75)):
                found = read_image(device, executor.images.image(0, name), "depth")
                assert found.shape[:2] == (8, 8) and (found == value).all()
            assert (read_image(device, theirs, "color") == (0, 255, 0, 255)).all()
    finally:
        destroy_image(device, theirs)
