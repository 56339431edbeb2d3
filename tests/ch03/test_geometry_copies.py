"""Geometry goes to memory that is the GPU's alone, beside what the CPU does, and is not copied again by any frame."""

from __future__ import annotations

import numpy as np
import pytest

from backends import shader_text
from backends.gl import api as gl
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.compute import Kernel
from backends.vulkan.once import submit_once
from backends.vulkan.readback import TO_HOST
from backends.vulkan.resources import create_buffer, destroy_buffer
from chapters.ch03.scene import pages
from chapters.scenes import load
from common.scene.crowds import crowd
from common.view.camera import UNIT_EV100
from tests.support.chapter import of_backend
from tests.support.meshes import grid, scene_of, shuffled
from tests.support.scenes import facing

COPY = """
layout(local_size_x = 64) in;
layout(std430, BIND(0, 0, 0)) readonly buffer Source { uint source[]; };
layout(std430, BIND(0, 1, 1)) writeonly buffer Target { uint target[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < target.length()) {
        target[i] = source[i];
    }
}
"""


def words_on_vulkan(device, buffer, size):
    """Return what shaders find in a buffer, (size,) uint8."""
    kernel = Kernel(
        device, shader_text.build_text(COPY, "comp", "vulkan", name="copy"), ("storage", "storage")
    )
    target = create_buffer(device, size, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "readback", "words")
    with submit_once(device) as commands:
        kernel.record(commands, (buffer, target), (size // 256 + 1, 1, 1))
        stage, write = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_WRITE_BIT
        device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=(stage, write, *TO_HOST[2:])))
    device.memory.invalidate(target.allocation)
    found = target.mapped[:size].copy()
    destroy_buffer(device, target)
    kernel.close()
    return found


def words_on_gl(context, buffer, size):
    found = np.zeros(size, np.uint8)
    context.fn.glGetNamedBufferSubData(buffer.handle, 0, size, gl.pointer(found))
    return found


def pages_of(chapter, made):
    """Return the bytes of each page as shaders find them, (size,) uint8 each."""
    found = []
    for number, page in enumerate(made._data.pages):
        one = made._data._geometry[0][number]
        if chapter.backend == "gl":
            found.append(words_on_gl(chapter.device, one, page.size))
        else:
            found.append(
                words_on_vulkan(chapter.device, of_backend(made, "resources").buffers.get(one), page.size)
            )
    return found


only_the_gpus = pytest.mark.feature("async-loading/device-only-buffers")


@only_the_gpus
@pytest.mark.variants("vulkan", "gl")
def test_pages_hold_the_bytes_of_the_scene_and_no_frame_copies_them_again(chapter):
    scene = load("spheres")
    device = chapter.device
    with chapter.open(scene, (32, 32), outputs={"color"}) as made:
        held = [name for name in device.alive.values() if name.startswith("upload ring")]
        assert held or chapter.backend == "gl", "nobody waited for what is copied from it"
        work = []
        for turn in range(4):
            frame = made.render(facing(distance=2.0 + 0.1 * turn, ev100=UNIT_EV100))
            frame.image("color")
            work.append(frame.work)
        assert not [name for name in device.alive.values() if name.startswith("upload ring")]
        geometry = sum(page.size for page in made._data.pages)
        assert geometry > 10_000 and work[-1]["bytes_written"] == work[-2]["bytes_written"] < geometry
        for page, found in zip(made._data.pages, pages_of(chapter, made), strict=True):
            expected = np.zeros(page.size, np.uint8)
            known = np.zeros(page.size, bool)
            for offset, array in pages.page_arrays(scene, page):
                raw = np.ascontiguousarray(array).view(np.uint8).reshape(-1)
                expected[offset : offset + raw.size], known[offset : offset + raw.size] = raw, True
            assert known.sum() > 0.9 * page.size
            assert np.array_equal(found[known], expected[known])


def missing(scene, found):
    """Return what of each mesh is nowhere in the pages, wherever they have it: (mesh, what)."""
    whole, lost = b"".join(page.tobytes() for page in found), []
    for number, mesh in enumerate(scene.meshes):
        first, count = int(mesh["first_vertex"]), int(mesh["vertex_count"])
        indices = scene.indices[int(mesh["first_index"]) :][: int(mesh["index_count"])]
        parts = {name: getattr(scene, name)[first : first + count] for name in ("positions", "normals")}
        for name, part in {**parts, "indices": indices}.items():
            if part.tobytes() not in whole:
                lost.append((number, name))
    return lost


@only_the_gpus
@pytest.mark.variants("vulkan", "gl")
def test_each_mesh_is_found_in_the_pages_and_one_that_was_not_copied_is_missed(chapter, monkeypatch):
    """Bytes are looked for anywhere, so nothing of the plan that the copies follow is believed."""

    def by_lot(seed):
        surfaces = [shuffled(grid(rows, 5, seed=rows + seed), seed=rows + seed) for rows in (4, 5, 6)]
        return scene_of(*surfaces, matrices=(np.eye(4),) * 3, drawn=(0, 1, 2))

    scene = by_lot(0)
    with chapter.open(scene, (16, 16)) as made:
        assert missing(scene, pages_of(chapter, made)) == []

    def short(scene, page, whole=pages.page_arrays):
        return ((at, array[: len(array) - 1]) for at, array in whole(scene, page))

    monkeypatch.setattr(pages, "page_arrays", short)
    scene = by_lot(10)  # another one: the memory may be that of the first, with its bytes
    with chapter.open(scene, (16, 16)) as made:
        lost = missing(scene, pages_of(chapter, made))
    assert lost == [(2, "positions"), (2, "normals"), (2, "indices")]


@only_the_gpus
@pytest.mark.variants("vulkan")
def test_a_page_is_copied_to_before_the_first_frame_and_by_none(chapter):
    """By the driver's calls, whatever the renderer reports of itself."""
    log = []
    chapter.device.fn.trace(log)
    try:
        with chapter.open(load("spheres"), (16, 16)) as made:
            held = {of_backend(made, "resources").buffers.get(one).handle for one in made._data._geometry[0]}
            before = targets(log)
            log.clear()
            for turn in range(4):
                made.render(facing(distance=2.0 + 0.1 * turn, ev100=UNIT_EV100)).image("color")
            later = targets(log)
    finally:
        chapter.device.fn.trace(None)
    assert held <= before and not held & later


def targets(log):
    """Return the buffers that the CPU had the GPU copy to or fill."""
    copies = (
        "vkCmdCopyBuffer",
        "vkCmdCopyBuffer2",
        "vkCmdUpdateBuffer",
        "vkCmdFillBuffer",
        "vkCmdCopyImageToBuffer2",
    )
    return {
        arguments[1].dstBuffer if name.endswith("2") else arguments[2 if name == "vkCmdCopyBuffer" else 1]
        for name, arguments in log
        if name in copies
    }


@pytest.mark.variants("vulkan")
def test_a_renderer_that_never_draws_frees_what_it_copied_from(chapter):
    before = dict(chapter.device.alive)
    with chapter.open(crowd(10, 2), (16, 16)):
        pass

    assert not [name for name in chapter.device.alive.values() if "upload ring" in name]
    assert {kind for kind, _ in chapter.device.alive.keys() - before.keys()} <= {"VkDeviceMemory"}
