"""Filtering across the edges of a cube map: seamless on Vulkan always, on OpenGL because the context asks for it."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from backends import shader_text
from backends.gl import api as gl
from backends.gl import resources as gl_resources
from backends.gl.driver import constants as gl_constants
from backends.gl.programs import Programs
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.compute import Kernel, Sampled
from backends.vulkan.once import submit_once
from backends.vulkan.resources import (
    create_buffer,
    create_image,
    create_sampler,
    destroy_buffer,
    destroy_image,
)
from chapters.ch01.environment.model import SMOOTH
from chapters.ch01.environment.vulkan import cube_view, fill

LOOKUP = """
layout(local_size_x = 1) in;
layout(BIND(0, 0, 0)) uniform samplerCube cube;
layout(BIND(0, 1, 0), std430) buffer Points { vec4 points[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    points[i] = textureLod(cube, points[i].xyz, 0.0);
}
"""
EDGE = 4
FACES = np.float16(2.0) ** np.arange(6, dtype=np.float16)
"""One number for all texels of a face."""
# In the middle between two texels of neighbouring faces, and away from corners: +x and +z, -y and -z, -x and +y.
EDGES = {(1.0, 0.1, 1.0): (0, 4), (0.3, -1.0, -1.0): (3, 5), (-1.0, 1.0, 0.2): (1, 2)}


def texels():
    """Return the cube's level 0 (6, EDGE, EDGE, 4) float16."""
    return np.broadcast_to(FACES[:, None, None, None], (6, EDGE, EDGE, 4)).astype(np.float16)


def directions():
    """Return (P, 4) float32 points: the edges, and the middles of all faces."""
    middles = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    return np.array([(*d, 0.0) for d in [*EDGES, *middles]], np.float32)


def on_vulkan(device):
    """Return what a linear lookup gives in each direction."""
    source = shader_text.build_text(LOOKUP, "comp", "vulkan", name="lookup")
    kernel = Kernel(device, source, ("texture", "storage"))
    usage = vk.VK_IMAGE_USAGE_SAMPLED_BIT | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
    image = create_image(
        device, "rgba16f", (EDGE, EDGE), usage, "cube", layers=6, flags=vk.VK_IMAGE_CREATE_CUBE_COMPATIBLE_BIT
    )
    sampler = create_sampler(device, SMOOTH, 1.0, "smooth")
    points = directions()
    buffer = create_buffer(device, points.nbytes, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "readback", "points")
    try:
        fill(device, image, [texels()])
        buffer.view(np.float32)[:] = points.ravel()
        with submit_once(device) as commands:
            kernel.record(commands, (Sampled(cube_view(device, image), sampler), buffer), (len(points), 1, 1))
            written = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
            read = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)
            device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*written, *read)))
        device.memory.invalidate(buffer.allocation)
        return buffer.view(np.float32).reshape(-1, 4)[:, 0].copy()
    finally:
        destroy_buffer(device, buffer)
        device.destroy("VkSampler", sampler)
        destroy_image(device, image)
        kernel.close()


@contextmanager
def seams(context):
    """Switch seamless filtering off for a while."""
    context.fn.glDisable(gl_constants.GL_TEXTURE_CUBE_MAP_SEAMLESS)
    try:
        yield
    finally:
        context.fn.glEnable(gl_constants.GL_TEXTURE_CUBE_MAP_SEAMLESS)


def on_opengl(context):
    """Return what a linear lookup gives in each direction."""
    programs = Programs(context)
    image = gl_resources.create_image(context, "rgba16f", (EDGE, EDGE), "cube", shape="cube")
    sampler = gl_resources.create_sampler(context, SMOOTH, 1.0, "smooth")
    points = directions()
    buffer = gl_resources.create_buffer(context, points.nbytes, "device", "points")
    try:
        gl_resources.write_image(context, image, texels())
        gl_resources.write_buffer(context, buffer, points)
        gl_resources.bind_texture(context, 0, image.view, sampler)
        gl_resources.bind_buffer(context, "storage", 0, buffer)
        program = programs.get([shader_text.build_text(LOOKUP, "comp", "gl", name="lookup")])
        context.fn.glUseProgram(program.handle)
        context.fn.glDispatchCompute(len(points), 1, 1)
        context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        return gl_resources.read_buffer(context, buffer, np.float32).reshape(-1, 4)[:, 0]
    finally:
        gl_resources.destroy_buffer(context, buffer)
        context.destroy("sampler", sampler)
        gl_resources.destroy_image(context, image)
        programs.close()


def halves():
    """Return the mean of both faces at each edge."""
    return np.array([(FACES[one] + FACES[other]) / 2 for one, other in EDGES.values()])


@pytest.mark.feature("environment/seamless-cube-map")
def test_an_edge_is_half_of_each_face_on_vulkan(vulkan_device):
    got = on_vulkan(vulkan_device)
    assert np.allclose(got[: len(EDGES)], halves(), rtol=1 / 128)
    assert np.array_equal(got[len(EDGES) :], FACES)


@pytest.mark.feature("environment/seamless-cube-map")
def test_an_edge_is_half_of_each_face_on_opengl_and_one_of_them_with_seams(gl_context):
    got = on_opengl(gl_context)
    assert np.allclose(got[: len(EDGES)], halves(), rtol=1 / 128)
    assert np.array_equal(got[len(EDGES) :], FACES)
    with seams(gl_context):
        clamped = on_opengl(gl_context)
    for value, pair in zip(clamped[: len(EDGES)], EDGES.values(), strict=True):
        assert value in [FACES[face] for face in pair]
    assert not np.allclose(clamped[: len(EDGES)], halves(), rtol=1 / 128)
    assert np.array_equal(clamped[len(EDGES) :], FACES)
