"""Vulkan and OpenGL on the software drivers: the same functions, mip levels, coverage and depth, bit by bit.

Elsewhere two drivers are two compilers, and bits may differ; there the tests are skipped by name.
"""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import pytest

from backends.gl import api as gl
from backends.gl import readback as gl_readback
from backends.gl import resources as gl_resources
from backends.gl import upload as gl_upload
from backends.gl.context import FRONT_FACES
from backends.gl.programs import Programs
from backends.gl.targets import begin, create_framebuffer, destroy_framebuffer
from backends.shader_text import build_text
from backends.vulkan import api as vk
from backends.vulkan import upload as vulkan_upload
from backends.vulkan.barriers import transition
from backends.vulkan.once import submit_once
from backends.vulkan.readback import read_image
from backends.vulkan.resources import create_image, destroy_image, mip_levels
from backends.vulkan.selftests.bench import Bench
from tests.support import gl_functions, gpu_functions
from tests.support.drivers import needs_precise_products


@pytest.fixture(autouse=True)
def _same_compiler(gl_context, vulkan_device):
    both = (gl_context.capabilities, vulkan_device.capabilities)
    if not all(found.is_software for found in both):
        pytest.skip("bits agree on the software drivers alone")


# --- functions --------------------------------------------------------------------------------------------------------

COUNT = 20_000


def unit(random, count):
    vectors = random.normal(size=(count, 3))
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


def everything(random, count):
    """Return floats of every exponent and sign, with the special ones among them."""
    values = random.integers(0, 2**32, count, np.uint32).view(np.float32)
    values[:8] = (0.0, -0.0, np.inf, -np.inf, np.nan, 1e-40, 3.4e38, 1.0)
    return values


def cases():
    random = np.random.default_rng(11)
    colors = random.uniform(0, 2, (COUNT, 3)).astype(np.float32)
    brdf = {
        "n": unit(random, COUNT),
        "l": unit(random, COUNT),
        "v": unit(random, COUNT),
        "base": random.uniform(0, 1, (COUNT, 3)).astype(np.float32),
        "surface": random.uniform(0.001, 1, (COUNT, 2)).astype(np.float32),
    }
    plain = {"x": random.uniform(-20, 20, COUNT).astype(np.float32)}
    wild = {"x": everything(random, COUNT), "y": everything(random, COUNT)}
    matrix = random.normal(size=(2, 4, 4)).astype(np.float32)
    columns = ", ".join(f"{value!r}" for value in matrix[0].ravel().tolist())
    rows = ", ".join(f"{value!r}" for value in matrix[1].ravel().tolist())
    point = {"p": random.uniform(-100, 100, (COUNT, 3)).astype(np.float32)}
    return {
        "srgb": (
            ["srgb.glsl"],
            "a = linear_from_srgb(c); b = srgb_from_linear(c);",
            {"c": colors},
            "vec3",
            "vec3",
        ),
        "tone": (["tone.glsl"], "a = tone_neutral(c * 8.0); b = c;", {"c": colors}, "vec3", "vec3"),
        "brdf": (
            ["brdf.glsl"],
            "a = metallic_roughness(n, l, v, base, surface.x, surface.y); b = distribution_ggx(n, l, surface.y);",
            brdf,
            "vec3",
            "float",
        ),
        # A product of a matrix and a vector is summed in another order by each compiler, `precise` or not; written out,
        # or as a vector times a matrix, it is one sum for both.
        "product": (
            [],
            f"mat4 m = mat4({columns}); mat4 k = mat4({rows});"
            "precise vec4 v = k[0] * p.x + k[1] * p.y + k[2] * p.z + k[3];"
            "precise vec4 c = m[0] * v.x + m[1] * v.y + m[2] * v.z + m[3] * v.w;"
            "precise vec4 d = vec4(p, 1.0) * m; a = c; b = d;",
            point,
            "vec4",
            "vec4",
        ),
        "library": (
            [],
            "a = sin(x) + exp(x) * 1e-6; b = pow(abs(x), 2.3) + inversesqrt(abs(x));",
            plain,
            "float",
            "float",
        ),
        "bits": (
            [],
            "a = floatBitsToUint(x) ^ 1u; b = bitfieldReverse(floatBitsToUint(y));",
            wild,
            "uint",
            "uint",
        ),
        "finite": (["finite.glsl"], "a = finite_color(vec3(x, y, x * y)); b = x;", wild, "vec3", "float"),
    }


ROUNDED = ("brdf", "tone")
"""Functions with dot products of three numbers and mixes that are not `precise`: summed in another order, so that some
results are a few units of the last place apart. Everything else has equal bits."""


@pytest.mark.parametrize("name", cases())
def test_functions_have_equal_bits(gl_context, vulkan_device, name):
    if name == "product":
        needs_precise_products(vulkan_device)
    includes, body, inputs, a, b = cases()[name]
    outputs = {"a": a, "b": b}
    vulkan = gpu_functions.evaluate(vulkan_device, includes, body, inputs, outputs)
    opengl = gl_functions.evaluate(gl_context, includes, body, inputs, outputs)
    for key in outputs:
        one, other = vulkan[key], opengl[key]
        if name in ROUNDED:
            assert (np.abs(one - other) <= 1e-6 * np.maximum(1.0, np.abs(one))).all()
            continue
        nan = np.isnan(one) & np.isnan(other) if one.dtype == np.float32 else np.zeros(one.shape, bool)
        assert np.array_equal(one.view(np.uint32)[~nan], other.view(np.uint32)[~nan])
    assert len(np.unique(vulkan["a"])) > COUNT // 100, "the case computes nothing"


# --- mip levels -------------------------------------------------------------------------------------------------------


def vulkan_levels(device, format, pixels, srgb):
    """Return every mip level that the Vulkan uploader makes of (H, W, C) pixels."""
    height, width = pixels.shape[:2]
    usage = (
        vk.VK_IMAGE_USAGE_SAMPLED_BIT
        | vk.VK_IMAGE_USAGE_TRANSFER_DST_BIT
        | vk.VK_IMAGE_USAGE_TRANSFER_SRC_BIT
        | vk.VK_IMAGE_USAGE_STORAGE_BIT
    )
    view = "rgba8_srgb" if srgb else None
    levels = mip_levels(width, height)
    image = create_image(device, format, (width, height), usage, "chain", levels=levels, view_format=view)
    found = []
    with Bench(device) as bench:
        bench.at_end(destroy_image, device, image)
        with vulkan_upload.Uploader(device) as uploader:
            uploader.image(image, pixels, srgb=srgb)
        for level in range(levels):
            shape = (max(1, height >> level), max(1, width >> level), pixels.shape[2])
            count = shape[0] * shape[1] * shape[2]
            buffer = bench.output(-(-count * pixels.itemsize // 4))
            region = vk.new(
                "VkBufferImageCopy",
                imageSubresource={"aspectMask": image.aspect, "mipLevel": level, "layerCount": 1},
                imageExtent={"width": shape[1], "height": shape[0], "depth": 1},
            )
            layout = vk.VK_IMAGE_LAYOUT_TRANSFER_SRC_OPTIMAL
            with submit_once(device) as commands:
                transition(device, commands, image, "sampled", "copy_source")
                device.fn.vkCmdCopyImageToBuffer(commands, image.handle, layout, buffer.handle, 1, region)
                transition(device, commands, image, "copy_source", "sampled")
            found.append(bench.read(buffer, pixels.dtype)[:count].reshape(shape))
    return found


def opengl_levels(context, format, pixels, srgb):
    """Return every mip level that the OpenGL uploader makes of the same pixels."""
    height, width = pixels.shape[:2]
    levels = gl_resources.mip_levels(width, height)
    view = "rgba8_srgb" if srgb else None
    image = gl_resources.create_image(
        context, format, (width, height), "chain", levels=levels, view_format=view
    )
    with gl_upload.Uploader(context) as uploader:
        uploader.image(image, pixels, srgb=srgb)
        assert uploader.bytes == pixels.nbytes
    found = [gl_readback.read_image(context, image, level=level) for level in range(levels)]
    gl_resources.destroy_image(context, image)
    return found


@pytest.mark.parametrize(
    ("format", "srgb", "size"),
    [
        ("rgba8", False, (64, 32)),
        ("rgba8", True, (37, 21)),
        ("rgba8", True, (1, 9)),
        ("rgba16f", False, (30, 17)),
        ("rgba32f", False, (13, 13)),
    ],
)
def test_mip_levels_have_equal_bits(gl_context, vulkan_device, format, srgb, size):
    described = gl_resources.FORMATS[format]
    random = np.random.default_rng(5)
    shape = (size[1], size[0], 4)
    if described.dtype is np.uint8:
        pixels = random.integers(0, 256, shape, np.uint8)
    else:
        pixels = random.uniform(0, 4, shape).astype(described.dtype)
    vulkan = vulkan_levels(vulkan_device, format, pixels, srgb)
    opengl = opengl_levels(gl_context, format, pixels, srgb)
    assert len(vulkan) == len(opengl) == max(size).bit_length()
    assert np.array_equal(opengl[0], pixels)
    for level, (one, other) in enumerate(zip(vulkan, opengl, strict=True)):
        assert np.array_equal(one, other), f"level {level} differs"
    assert abs(float(opengl[-1].astype(np.float64).mean()) - float(pixels.astype(np.float64).mean())) < (
        30 if srgb else 1
    )


def test_a_chain_of_levels_is_not_made_by_mistake(gl_context):
    image = gl_resources.create_image(gl_context, "rgba8", (4, 4), "chain", levels=3)
    with gl_upload.Uploader(gl_context) as uploader:
        with pytest.raises(ValueError, match="has 3 levels, and only one was given"):
            uploader.image(image, np.zeros((4, 4, 4), np.uint8), mips=False)
        with pytest.raises(ValueError, match="wants"):
            uploader.image(image, np.zeros((2, 4, 4), np.uint8))
    gl_resources.destroy_image(gl_context, image)


# --- coverage and depth -----------------------------------------------------------------------------------------------

VERTEX = """
layout(BIND(0, 0, 0), std430) readonly buffer Corners_ { vec4 corners[]; };
layout(location = 0) flat out uint out_id;
invariant gl_Position;
void main() {
    out_id = VERTEX_ID;  // of the provoking vertex, the first one of the triangle
    gl_Position = corners[VERTEX_ID];
}
"""
FRAGMENT = """
layout(location = 0) flat in uint in_id;
layout(location = 0) out uint out_id;
void main() { out_id = (in_id + 1u) * 2u + (gl_FrontFacing ? 1u : 0u); }
"""
NO_COLOR = "void main() {}"
SIZE = (61, 43)


def triangles():
    """Return (3 N, 4) float32 clip positions: a mesh with shared edges, edges through pixel centres, clipped ones."""
    random = np.random.default_rng(2)
    grid = np.stack(np.meshgrid(np.linspace(-1.1, 1.1, 9), np.linspace(-1.1, 1.1, 9)), -1)
    grid += random.normal(scale=0.05, size=grid.shape)
    z = random.uniform(-0.2, 1.3, grid.shape[:2])  # part before the near plane, part behind the far one
    w = random.uniform(0.5, 4.0, grid.shape[:2])
    corners = np.concatenate([grid * w[..., None], (z * w)[..., None], w[..., None]], -1)
    quads = [corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]]
    mesh = np.stack([quads[k] for k in (0, 1, 2, 0, 2, 3)], 2).reshape(-1, 4)
    # Corners on pixel centres, so that edges run exactly through others.
    centres = (random.integers(0, 40, (60, 2)) + 0.5) / np.array(SIZE) * 2 - 1
    exact = np.concatenate([centres, random.uniform(0, 1, (60, 1)), np.ones((60, 1))], 1)
    behind = random.normal(size=(30, 4))  # some with w below zero
    return np.concatenate([mesh, exact, behind]).astype(np.float32)


def drawn_by_vulkan(device, corners):
    with Bench(device) as bench:
        buffer = bench.input(corners)

        def record(commands):
            device.fn.vkCmdDraw(commands, len(corners), 1, 0, 0)

        ids = bench.graphics({"vert": VERTEX, "frag": FRAGMENT}, [buffer])
        covered = bench.render(ids, SIZE, record)
        depth = bench.graphics({"vert": VERTEX, "frag": NO_COLOR}, [buffer], target="d32f")
        image = bench.image("d32f", SIZE, vk.VK_IMAGE_USAGE_DEPTH_STENCIL_ATTACHMENT_BIT)
        with bench.submit() as commands:
            transition(device, commands, image, "undefined", "depth")
            bench.draw(commands, depth, image.view, SIZE, record, depth=True)
            transition(device, commands, image, "depth", "copy_source")
        return covered, read_image(device, image, "copy_source")


def drawn_by_opengl(context, corners):
    fn = context.fn
    with ExitStack() as stack:
        buffer = gl_resources.create_buffer(context, corners.nbytes, "device", "corners")
        stack.callback(gl_resources.destroy_buffer, context, buffer)
        gl_resources.write_buffer(context, buffer, corners)
        color = gl_resources.create_image(context, "r32ui", SIZE, "ids")
        depth = gl_resources.create_image(context, "d32f", SIZE, "depth")
        for image in (color, depth):
            stack.callback(gl_resources.destroy_image, context, image)
        framebuffer = create_framebuffer(context, [color], depth, "both")
        stack.callback(destroy_framebuffer, context, framebuffer)
        programs = Programs(context)
        stack.callback(programs.close)
        program = programs.get([build_text(VERTEX, "vert", "gl"), build_text(FRAGMENT, "frag", "gl")])
        vertices = context.create("vertex array", "nothing")
        stack.callback(context.destroy, "vertex array", vertices)
        begin(context, framebuffer, [(0, 0, 0, 0)], 0.0)
        gl_resources.bind_buffer(context, "storage", 0, buffer)
        fn.glEnable(gl.GL_DEPTH_TEST)
        fn.glDepthFunc(gl.GL_ALWAYS)
        fn.glFrontFace(FRONT_FACES["counter_clockwise"])
        fn.glBindVertexArray(vertices)
        fn.glUseProgram(program.handle)
        fn.glDrawArrays(gl.GL_TRIANGLES, 0, len(corners))
        fn.glDisable(gl.GL_DEPTH_TEST)
        return gl_readback.read_image(context, color), gl_readback.read_image(context, depth)


def test_coverage_facing_and_depth_have_equal_bits(gl_context, vulkan_device):
    corners = triangles()
    covered, depth = drawn_by_vulkan(vulkan_device, corners)
    gl_covered, gl_depth = drawn_by_opengl(gl_context, corners)
    assert len(np.unique(covered)) > 60 and {0, 1} == set(np.unique(covered[covered > 0] % 2))
    assert np.array_equal(gl_covered, covered)
    assert len(np.unique(depth)) > 500
    assert np.array_equal(gl_depth.view(np.uint32), depth.view(np.uint32))


def test_row_0_is_y_of_minus_1_on_both(gl_context, vulkan_device):
    """The picture's top: neither backend turns anything over in memory."""
    corners = np.array([(-1, -1, 0.5, 1), (-0.6, -1, 0.5, 1), (-1, -0.6, 0.5, 1)], np.float32)
    for covered, depth in (drawn_by_vulkan(vulkan_device, corners), drawn_by_opengl(gl_context, corners)):
        assert covered[0, 0] and not covered[-1].any()
        assert depth[0, 0] == 0.5 and not depth[-1].any()


def test_descriptions_are_the_same_on_both():
    """Formats, levels and uses of memory have the same names and types on both backends."""
    from backends.vulkan import resources as vulkan

    assert vulkan.FORMATS.keys() == gl_resources.FORMATS.keys()
    for name, (_, texel, dtype, channels) in vulkan.FORMATS.items():
        described = gl_resources.FORMATS[name]
        assert (described.texel, described.dtype, described.channels) == (texel, dtype, channels)
    for size in ((1, 1), (5, 3), (1024, 1), (640, 360)):
        assert vulkan.mip_levels(*size) == gl_resources.mip_levels(*size)
