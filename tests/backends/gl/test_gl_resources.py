"""Buffers, images, samplers and framebuffers: exact bytes, exact formats, and each trap that moderngl has there."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import pytest

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.draws import PushTable
from backends.gl.programs import Programs
from backends.gl.readback import Fence, Readback, read_image
from backends.gl.resources import (
    FORMATS,
    Image,
    bind_buffer,
    bind_storage_image,
    bind_texture,
    create_buffer,
    create_image,
    create_sampler,
    create_view,
    destroy_buffer,
    destroy_image,
    read_buffer,
    write_buffer,
    write_image,
)
from backends.gl.targets import Attachment, begin, copy, create_framebuffer, destroy_framebuffer
from backends.shader_text import build_text
from common.errors import DeviceError
from common.images.blocks import BLOCK_BYTES
from common.images.color import decode_srgb
from common.scene import Sampler
from tests.support.bounds import decoded_srgb
from tests.support.packed import channels_of

FULL_SCREEN = "void main() { gl_Position = vec4(VERTEX_ID == 1 ? 3 : -1, VERTEX_ID == 2 ? 3 : -1, 0.25, 1); }"


class Workbench:
    """Makes objects that are freed when the test ends."""

    def __init__(self, context: Context, stack: ExitStack) -> None:
        self.context, self.stack = context, stack
        self.programs = Programs(context)
        stack.callback(self.programs.close)

    def buffer(self, size, use="device"):
        made = create_buffer(self.context, size, use, "buffer")
        self.stack.callback(destroy_buffer, self.context, made)
        return made

    def image(self, format, size, **more) -> Image:
        made = create_image(self.context, format, size, "image", **more)
        self.stack.callback(destroy_image, self.context, made)
        return made

    def framebuffer(self, colors, depth=None):
        made = create_framebuffer(self.context, colors, depth, "framebuffer")
        self.stack.callback(destroy_framebuffer, self.context, made)
        return made

    def sampler(self, *words, anisotropy=1.0):
        made = create_sampler(self.context, Sampler(*words), anisotropy, "sampler")
        self.stack.callback(self.context.destroy, "sampler", made)
        return made

    def empty_vertices(self):
        made = self.context.create("vertex array", "nothing")
        self.stack.callback(self.context.destroy, "vertex array", made)
        self.context.fn.glBindVertexArray(made)

    def program(self, **texts):
        return self.programs.get([build_text(text, stage, "gl") for stage, text in texts.items()])

    def draw(self, fragment, vertex=FULL_SCREEN, count=3):
        """Draw over the framebuffer that was begun."""
        self.empty_vertices()
        self.context.fn.glUseProgram(self.program(vert=vertex, frag=fragment).handle)
        self.context.fn.glDrawArrays(gl.GL_TRIANGLES, 0, count)


@pytest.fixture
def bench(gl_context):
    with ExitStack() as stack:
        yield Workbench(gl_context, stack)


def random_pixels(format: str, shape: tuple[int, ...], seed: int = 3) -> np.ndarray:
    described = FORMATS[format]
    random = np.random.default_rng(seed)
    full = shape if described.channels == 1 else (*shape, described.channels)
    if np.issubdtype(described.dtype, np.integer):
        return random.integers(0, np.iinfo(described.dtype).max, full, described.dtype, endpoint=True)
    return random.uniform(0, 1, full).astype(described.dtype)


# --- buffers ----------------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/staging-copies")
@pytest.mark.feature("device/buffers")
def test_buffers_give_back_exact_bytes(gl_context, bench):
    data = np.random.default_rng(1).integers(0, 256, 1021, np.uint8)
    buffer = bench.buffer(1031)
    write_buffer(gl_context, buffer, data, 7)
    assert np.array_equal(read_buffer(gl_context, buffer)[7 : 7 + 1021], data)
    other = bench.buffer(1031, "readback")  # by way of the GPU, from an odd place to another
    gl_context.fn.glCopyNamedBufferSubData(buffer.handle, other.handle, 7, 3, 1021)
    Fence(gl_context).wait()
    assert np.array_equal(other.mapped[3 : 3 + 1021], data)
    with pytest.raises(ValueError, match="do not fit into 'buffer' of 1031 bytes"):
        write_buffer(gl_context, buffer, data, 11)
    with pytest.raises(ValueError, match="cannot map"):
        _ = buffer.mapped


@pytest.mark.feature("device/buffers")
def test_storage_is_immutable(gl_context, bench):
    buffer = bench.buffer(64)
    with pytest.raises(DeviceError, match="glNamedBufferStorage"):
        gl_context.fn.glNamedBufferStorage(buffer.handle, 128, gl.NULL, 0)
    gl_context.sink.messages.clear()


COPY = """
layout(local_size_x = 1) in;
layout(BIND(0, 0, 0), std430) readonly buffer A { uint a[]; };
layout(BIND(0, 1, 1), std430) buffer B { uint b[]; };
void main() { b[gl_WorkGroupID.x] = a[gl_WorkGroupID.x] + 1u; }
"""


@pytest.mark.feature("device/persistent-mapping")
def test_mapped_memory_is_seen_by_the_gpu_and_by_the_cpu_after_a_fence(gl_context, bench):
    source, result = bench.buffer(64, "upload"), bench.buffer(64, "readback")
    program = bench.program(comp=COPY)
    bind_buffer(gl_context, "storage", 0, source)
    bind_buffer(gl_context, "storage", 1, result)
    gl_context.fn.glUseProgram(program.handle)
    for frame in range(3):
        source.view(np.uint32)[:] = np.arange(16) * 100 + frame
        gl_context.fn.glDispatchCompute(16, 1, 1)
        gl_context.fn.glMemoryBarrier(gl.GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT)
        fence = Fence(gl_context)
        fence.wait()
        assert fence.reached()
        assert np.array_equal(result.view(np.uint32), np.arange(16) * 100 + frame + 1)


@pytest.mark.feature("device/uniform-buffers", "device/push-constants", "device/buffers")
def test_each_dispatch_sees_its_own_row_of_push_constants(gl_context, bench):
    text = """
    layout(local_size_x = 1) in;
    struct Push { uvec4 draw; vec4 scale; };
    PUSH(Push, push)
    layout(BIND(0, 0, 0), std430) buffer B { float b[]; };
    void main() { b[push.draw.x] = push.scale.y; }
    """
    rows = np.zeros((5, 8), np.float32)
    rows.view(np.uint32)[:, 0] = np.arange(5)[::-1]
    rows[:, 5] = np.arange(5) + 0.5
    table = PushTable(gl_context, rows, "rows")
    bench.stack.callback(table.close)
    alignment = gl_context.limits["minUniformBufferOffsetAlignment"]
    assert table.stride % alignment == 0
    buffer = bench.buffer(20)
    bind_buffer(gl_context, "storage", 0, buffer)
    gl_context.fn.glUseProgram(bench.program(comp=text).handle)
    for index in range(5):
        table.bind(index)
        gl_context.fn.glDispatchCompute(1, 1, 1)
    gl_context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
    assert read_buffer(gl_context, buffer, np.float32).tolist() == [4.5, 3.5, 2.5, 1.5, 0.5]
    gl_context.push(np.array([2, 0, 0, 0, 0, 0, 0, 0], np.uint32))
    gl_context.fn.glDispatchCompute(1, 1, 1)
    gl_context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
    assert read_buffer(gl_context, buffer, np.float32).tolist() == [4.5, 3.5, 0.0, 1.5, 0.5]
    with pytest.raises(ValueError, match="more than 256"):
        gl_context.push(np.zeros(65, np.uint32))
    if alignment > 1:
        with pytest.raises(DeviceError, match="glBindBufferRange"):
            gl_context.fn.glBindBufferRange(gl.GL_UNIFORM_BUFFER, 0, table.buffer.handle, alignment // 2, 16)
        gl_context.sink.messages.clear()


# --- images -----------------------------------------------------------------------------------------------------------

RED, RG, RGBA, RED_INTEGER, RG_INTEGER, DEPTH = 0x1903, 0x8227, 0x1908, 0x8D94, 0x8228, 0x1902
BYTE, UINT, FLOAT, HALF, PACKED_10 = 0x1401, 0x1405, 0x1406, 0x140B, 0x8368
NUMBERS = {
    "r8": (0x8229, RED, BYTE),
    "rg8": (0x822B, RG, BYTE),
    "rgba8": (0x8058, RGBA, BYTE),
    "rgba8_srgb": (0x8C43, RGBA, BYTE),
    "rgb10a2": (0x8059, RGBA, PACKED_10),
    "r8ui": (0x8232, RED_INTEGER, BYTE),
    "r32ui": (0x8236, RED_INTEGER, UINT),
    "rg32ui": (0x823C, RG_INTEGER, UINT),
    "r32f": (0x822E, RED, FLOAT),
    "rg16f": (0x822F, RG, HALF),
    "rgba16f": (0x881A, RGBA, HALF),
    "rgba32f": (0x8814, RGBA, FLOAT),
    "d32f": (0x8CAC, DEPTH, FLOAT),
    "bc4": (0x8DBB, RED, BYTE),
    "bc5": (0x8DBD, RG, BYTE),
    "bc7": (0x8E8C, RGBA, BYTE),
    "bc7_srgb": (0x8E8D, RGBA, BYTE),
    "etc2": (0x9274, RGBA, BYTE),
    "etc2_srgb": (0x9275, RGBA, BYTE),
}
"""Internal format, format and type of pixels, as OpenGL's registry (gl.xml) numbers them."""


@pytest.mark.feature("device/textures")
def test_every_format_has_the_numbers_of_the_registry():
    assert {name: tuple(described[:3]) for name, described in FORMATS.items()} == NUMBERS


@pytest.mark.feature("device/textures")
@pytest.mark.parametrize("format", sorted(FORMATS.keys() - BLOCK_BYTES.keys()))
def test_every_format_gives_back_its_bits(gl_context, bench, format):
    image = bench.image(format, (5, 3))  # odd: rows are not padded
    pixels = random_pixels(format, (3, 5))
    write_image(gl_context, image, pixels)
    if format == "rgb10a2":  # its channels share a word
        pixels = channels_of(pixels)
    assert np.array_equal(read_image(gl_context, image), pixels)
    readback = Readback(gl_context, image, "readback")
    bench.stack.callback(readback.close)
    readback.record()
    fence = Fence(gl_context)
    fence.wait()
    assert np.array_equal(readback.read(), pixels)


@pytest.mark.feature("device/textures")
@pytest.mark.parametrize(("shape", "layers"), [("array", 4), ("cube", 6), ("cube_array", 12), ("3d", 4)])
def test_layers_are_written_and_read_one_by_one_and_together(gl_context, bench, shape, layers):
    image = bench.image("rgba8", (4, 4), shape=shape, layers=layers, levels=2)
    pixels = random_pixels("rgba8", (layers, 4, 4))
    write_image(gl_context, image, pixels)
    write_image(gl_context, image, pixels[0, ::2, ::2], level=1, layer=1)
    write_image(gl_context, image, pixels[1, 2:], layer=2, y=2)
    expected = pixels.copy()
    expected[2, 2:] = pixels[1, 2:]
    for layer in range(layers):
        assert np.array_equal(read_image(gl_context, image, layer=layer), expected[layer])
    assert np.array_equal(read_image(gl_context, image, level=1, layer=1), pixels[0, ::2, ::2])


@pytest.mark.feature("device/textures")
def test_wrong_pixels_are_refused_before_the_driver_reads_past_them(gl_context, bench):
    image = bench.image("rgba8", (4, 4))
    for wrong in (
        np.zeros((4, 5, 4), np.uint8),
        np.zeros((5, 4, 4), np.uint8),
        np.zeros((4, 4, 3), np.uint8),
        np.zeros((4, 4, 4), np.float32),
        np.zeros((2, 4, 4, 4), np.uint8),
    ):
        with pytest.raises(ValueError, match="'image' wants rows of"):
            write_image(gl_context, image, wrong)
    with pytest.raises(ValueError, match="square faces"):
        create_image(gl_context, "rgba8", (4, 5), "cube", shape="cube")


def test_images_have_immutable_storage_and_so_views(gl_context, bench):
    """moderngl's textures have none, and no view can be made of them."""
    image = bench.image("rgba8", (8, 8), levels=4)
    out = gl.ffi.new("GLint *")
    gl_context.fn.glGetTextureParameteriv(image.handle, gl.GL_TEXTURE_IMMUTABLE_FORMAT, out)
    assert out[0] == 1
    texture = gl_context.mgl.texture((8, 8), 4)
    gl_context.fn.glGetTextureParameteriv(texture.glo, gl.GL_TEXTURE_IMMUTABLE_FORMAT, out)
    assert out[0] == 0, "moderngl's textures have become immutable: the raw ones can go"
    texture.release()
    view = create_view(gl_context, image, "r32ui", level=1, levels=2)
    assert view in image.views and view != image.handle


@pytest.mark.feature("device/depth-format")
def test_depth_has_32_bits_of_float(gl_context, bench):
    """moderngl's depth textures have 24 bits of integer: near reversed z's 0 nothing would be told apart."""
    image = bench.image("d32f", (2, 2))
    framebuffer = bench.framebuffer([], image)
    for value in (0.25, 1e-30, np.float32(np.pi / 4), 1.0):
        begin(gl_context, framebuffer, clear_depth=float(value))
        assert (read_image(gl_context, image) == np.float32(value)).all()
    theirs = gl_context.mgl.depth_texture((2, 2))
    fbo = gl_context.mgl.framebuffer(depth_attachment=theirs)
    fbo.clear(depth=0.25)
    assert np.frombuffer(theirs.read(), np.float32)[0] != 0.25, "moderngl has exact depth now"
    fbo.release()
    theirs.release()


FETCH = """
layout(local_size_x = 1) in;
layout(BIND(0, 0, 0)) uniform KIND source;
layout(BIND(0, 1, 0), std430) buffer B { vec4 b[]; };
void main() { b[0] = vec4(READ); }
"""


def fetched(bench, view, kind, read, sampler=0):
    """Return what a compute shader reads from a texture."""
    context, buffer = bench.context, bench.buffer(16)
    text = f"#define KIND {kind}\n#define READ {read}\n{FETCH}"
    bind_texture(context, 0, view, sampler)
    bind_buffer(context, "storage", 0, buffer)
    context.fn.glUseProgram(bench.program(comp=text).handle)
    context.fn.glDispatchCompute(1, 1, 1)
    context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
    return read_buffer(context, buffer, np.float32)


@pytest.mark.parametrize(
    ("format", "kind", "value", "seen"),
    [
        ("rgba8", "sampler2D", [51, 102, 153, 255], [0.2, 0.4, 0.6, 1.0]),
        ("r32ui", "usampler2D", [123456], [123456, 0, 0, 1]),
        ("d32f", "sampler2D", [0.3], [0.3, 0, 0, 1]),
        ("r32f", "sampler2D", [-7.5], [-7.5, 0, 0, 1]),
    ],
)
def test_textures_are_read_without_a_sampler_object(gl_context, bench, format, kind, value, seen):
    """OpenGL's default filters leave integer textures, and those without mip levels, silently black."""
    image = bench.image(format, (1, 1))
    described = FORMATS[format]
    pixels = np.array(value, described.dtype).reshape((1, 1, *([4] if described.channels == 4 else [])))
    write_image(gl_context, image, pixels)
    found = fetched(bench, image.view, kind, "texelFetch(source, ivec2(0), 0)")
    assert np.allclose(found[: described.channels], seen[: described.channels], rtol=1e-6)
    found = fetched(bench, image.view, kind, "texture(source, vec2(0.5))")
    assert np.allclose(found[: described.channels], seen[: described.channels], rtol=1e-6)


def test_an_image_is_written_as_plain_and_sampled_as_srgb(gl_context, bench):
    image = bench.image("rgba8", (1, 1), view_format="rgba8_srgb")
    text = """
    layout(local_size_x = 1) in;
    layout(BIND(0, 0, 0), rgba8) uniform writeonly image2D target;
    void main() { imageStore(target, ivec2(0), vec4(188.0, 0.0, 255.0, 128.0) / 255.0); }
    """
    bind_storage_image(gl_context, 0, image)
    gl_context.fn.glUseProgram(bench.program(comp=text).handle)
    gl_context.fn.glDispatchCompute(1, 1, 1)
    gl_context.fn.glMemoryBarrier(gl.GL_TEXTURE_FETCH_BARRIER_BIT)
    found = fetched(bench, image.view, "sampler2D", "texelFetch(source, ivec2(0), 0)")
    low, high = decoded_srgb(np.array([188, 0, 255]))
    assert (low <= found[:3]).all() and (found[:3] <= high).all()
    assert abs(found[3] - 128 / 255) < 1e-6
    if gl_context.capabilities.is_software:
        assert np.allclose(found[:3], [decode_srgb(188 / 255), 0.0, 1.0], atol=1e-3)
    assert read_image(gl_context, image).ravel().tolist() == [188, 0, 255, 128]


# --- samplers ---------------------------------------------------------------------------------------------------------

WRAPPED = {
    "repeat": lambda i, n: i % n,
    "clamp": lambda i, n: np.clip(i, 0, n - 1),
    "mirror": lambda i, n: np.where((i // n) % 2, n - 1 - i % n, i % n),
}


def sampled(bench, image, sampler, uv, level):
    """Return (N, 4) float32: `image` at each uv and an explicit level."""
    context = bench.context
    places, result = bench.buffer(uv.nbytes), bench.buffer(16 * len(uv))
    write_buffer(context, places, uv)
    text = f"""
    layout(local_size_x = 1) in;
    layout(BIND(0, 0, 0)) uniform sampler2D source;
    layout(BIND(0, 1, 0), std430) readonly buffer A {{ vec2 a[]; }};
    layout(BIND(0, 2, 1), std430) buffer B {{ vec4 b[]; }};
    void main() {{ b[gl_WorkGroupID.x] = textureLod(source, a[gl_WorkGroupID.x], {float(level)}); }}
    """
    bind_texture(context, 0, image.view, sampler)
    bind_buffer(context, "storage", 0, places)
    bind_buffer(context, "storage", 1, result)
    context.fn.glUseProgram(bench.program(comp=text).handle)
    context.fn.glDispatchCompute(len(uv), 1, 1)
    context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
    return read_buffer(context, result, np.float32).reshape(-1, 4)


def expected_sample(levels, uv, wrap, linear, mipmap, level):
    """Sample numpy arrays by the specification's own words (OpenGL 4.5, 8.14)."""

    def one(pixels, linear):
        size = np.array(pixels.shape[1::-1])
        place = uv.astype(np.float64) * size
        if not linear:
            i = np.floor(place).astype(int)
            x, y = (WRAPPED[wrap](i[:, k], size[k]) for k in (0, 1))
            return pixels[y, x]
        base = np.floor(place - 0.5).astype(int)
        part = place - 0.5 - base
        total = 0.0
        for dy in (0, 1):
            for dx in (0, 1):
                x = WRAPPED[wrap](base[:, 0] + dx, size[0])
                y = WRAPPED[wrap](base[:, 1] + dy, size[1])
                weight = np.where(dx, part[:, 0], 1 - part[:, 0]) * np.where(dy, part[:, 1], 1 - part[:, 1])
                total = total + weight[:, None] * pixels[y, x]
        return total

    if mipmap is None:
        return one(levels[0], linear)
    if mipmap == "nearest":
        return one(levels[int(np.ceil(level + 0.5)) - 1], linear)
    lower = int(level)
    part = level - lower
    return (1 - part) * one(levels[lower], linear) + part * one(
        levels[min(lower + 1, len(levels) - 1)], linear
    )


@pytest.mark.feature("device/samplers")
@pytest.mark.parametrize("wrap", WRAPPED)
@pytest.mark.parametrize(
    ("filter", "mipmap"),
    [
        ("nearest", None),
        ("linear", None),
        ("nearest", "nearest"),
        ("linear", "nearest"),
        ("nearest", "linear"),
        ("linear", "linear"),
    ],
)
def test_every_filter_and_wrap_of_gltf_equals_numpy(gl_context, bench, filter, mipmap, wrap):
    image = bench.image("rgba32f", (6, 4), levels=2)
    levels = [random_pixels("rgba32f", (4, 6), 1), random_pixels("rgba32f", (2, 3), 2)]
    for number, pixels in enumerate(levels):
        write_image(gl_context, image, pixels, level=number)
    # Off the texels' edges, where a rounding would choose another one.
    random = np.random.default_rng(4)
    uv = ((random.integers(-24, 48, (40, 2)) + 0.25) / 24).astype(np.float32)
    sampler = bench.sampler(filter, filter, mipmap, wrap, wrap)
    for level in (0.0, 0.25, 1.0):
        found = sampled(bench, image, sampler, uv, level)
        truth = expected_sample(levels, uv, wrap, filter == "linear", mipmap, level)
        # Eight bits of weight are what drivers promise.
        assert np.abs(found - truth).max() < 2 / 256, (filter, mipmap, wrap, level)


# --- framebuffers -----------------------------------------------------------------------------------------------------


@pytest.mark.feature("device/offscreen-targets")
@pytest.mark.parametrize(
    ("colors", "depth"), [(["rgba16f"], None), ([], "d32f"), (["rgba32f", "r32ui", "rgba8"], "d32f")]
)
def test_targets_read_back_what_they_were_cleared_to(gl_context, bench, colors, depth):
    images = [bench.image(format, (7, 5)) for format in colors]
    deep = bench.image(depth, (7, 5)) if depth else None
    framebuffer = bench.framebuffer(images, deep)
    # 0.5 lies half way between two codes, of which a driver may take either; 0.6 is the code 153.
    known = {"r32ui": (3, 0, 0, 0), "rgba8": (0.2, 0.6, 1.0, 0.0)}
    values = [known.get(format, (0.25, 0.5, 1.0, 0.0)) for format in colors]
    # Masks and scissor that an earlier pass left would hold a clear back.
    gl_context.fn.glEnable(gl.GL_SCISSOR_TEST)
    gl_context.fn.glScissor(0, 0, 1, 1)
    gl_context.fn.glColorMask(0, 0, 0, 0)
    gl_context.fn.glDepthMask(0)
    begin(gl_context, framebuffer, values, 0.125 if depth else None)
    for image in images:
        found = read_image(gl_context, image)
        wanted = {"r32ui": 3, "rgba8": [51, 153, 255, 0]}.get(image.format, [0.25, 0.5, 1.0, 0.0])
        assert found.shape[:2] == (5, 7) and (found == np.array(wanted)).all()
    if deep is not None:
        assert (read_image(gl_context, deep) == 0.125).all()


def test_a_framebuffer_draws_where_moderngl_s_silently_drops_everything(gl_context, bench):
    """Attached later, moderngl's framebuffer has no draw buffers: no error, no message, no picture."""
    image = bench.image("rgba8", (4, 4))
    fragment = "layout(location = 0) out vec4 o; void main() { o = vec4(1); }"
    theirs = gl_context.mgl.empty_framebuffer((4, 4))
    gl_context.fn.glNamedFramebufferTexture(theirs.glo, gl.GL_COLOR_ATTACHMENT0, image.handle, 0)
    theirs.use()
    bench.draw(fragment)
    assert not read_image(gl_context, image).any(), "moderngl draws there now"
    theirs.release()
    begin(gl_context, bench.framebuffer([image]))
    bench.draw(fragment)
    assert (read_image(gl_context, image) == 255).all()


def test_single_levels_layers_and_faces_can_be_drawn_to(gl_context, bench):
    """moderngl's framebuffers refuse them all."""
    cube = bench.image("rgba16f", (8, 8), shape="cube", levels=3)
    face = bench.framebuffer([Attachment(cube, level=1, layer=4)])
    assert face.size == (4, 4)
    begin(gl_context, face, [(1.0, 2.0, 3.0, 4.0)])
    assert (read_image(gl_context, cube, level=1, layer=4) == np.float16([1, 2, 3, 4])).all()
    theirs = gl_context.mgl.texture_cube((8, 8), 4, dtype="f2")
    with pytest.raises(Exception, match="invalid color attachment"):
        gl_context.mgl.framebuffer([theirs])
    theirs.release()
    shadows = bench.image("d32f", (8, 8), shape="array", layers=3)
    begin(gl_context, bench.framebuffer([], Attachment(shadows, layer=2)), clear_depth=0.75)
    assert (read_image(gl_context, shadows, layer=2) == 0.75).all()


@pytest.mark.parametrize("shape", ["array", "cube"])
def test_all_layers_are_cleared_and_drawn_to_at_once(gl_context, bench, shape):
    """A layered framebuffer: `gl_Layer` chooses; moderngl would see one of size (0, 0) and leave an error."""
    layers = 6
    color = bench.image("r32ui", (4, 4), shape=shape, layers=layers)
    depth = bench.image("d32f", (4, 4), shape=shape, layers=layers)
    framebuffer = bench.framebuffer([color], depth)
    begin(gl_context, framebuffer, [(9, 0, 0, 0)], 0.5)
    for layer in range(layers):
        assert (read_image(gl_context, color, layer=layer) == 9).all()
        assert (read_image(gl_context, depth, layer=layer) == 0.5).all()
    vertex = """
    #extension GL_ARB_shader_viewport_layer_array : require
    void main() {
        int corner = VERTEX_ID % 3;
        gl_Layer = VERTEX_ID / 3;
        gl_Position = vec4(corner == 1 ? 3 : -1, corner == 2 ? 3 : -1, 0.75, 1);
    }
    """
    fragment = "layout(location = 0) out uint o; void main() { o = uint(gl_Layer) + 1u; }"
    gl_context.fn.glEnable(gl.GL_DEPTH_TEST)
    gl_context.fn.glDepthFunc(gl.GL_GEQUAL)
    bench.draw(fragment, vertex, 3 * layers)
    gl_context.fn.glDisable(gl.GL_DEPTH_TEST)
    for layer in range(layers):
        assert (read_image(gl_context, color, layer=layer) == layer + 1).all()
        assert (read_image(gl_context, depth, layer=layer) == 0.75).all()


@pytest.mark.feature("device/offscreen-targets")
def test_an_impossible_framebuffer_is_a_sentence(gl_context, bench):
    small, large = bench.image("rgba8", (4, 4)), bench.image("d32f", (8, 8))
    with pytest.raises(ValueError, match="different sizes"):
        bench.framebuffer([small], large)
    with pytest.raises(ValueError, match="no attachment"):
        bench.framebuffer([])
    single, many = bench.image("rgba8", (4, 4)), bench.image("d32f", (4, 4), samples=4)
    with pytest.raises(ValueError, match="different numbers of samples"):
        bench.framebuffer([single], many)
    deep = bench.image("d32f", (4, 4))
    alive = len(gl_context.alive)
    with pytest.raises(
        DeviceError, match=r"cannot draw to 'framebuffer' \(0x8cd6\): image \(rgba8\), image \(d32f\)"
    ):
        bench.framebuffer([single, deep])
    assert len(gl_context.alive) == alive
    gl_context.sink.messages.clear()


def test_several_samples_are_resolved_to_their_mean(gl_context, bench):
    many = bench.image("rgba16f", (4, 4), samples=4)
    one = bench.image("rgba16f", (4, 4))
    source, target = bench.framebuffer([many]), bench.framebuffer([one])
    begin(gl_context, source, [(0, 0, 0, 0)])
    # The upper left half, whose edge runs through the diagonal's pixels.
    half = "void main() { gl_Position = vec4(VERTEX_ID == 1 ? 1.1 : -1, VERTEX_ID == 2 ? 1.1 : -1, 0.5, 1); }"
    bench.draw("layout(location = 0) out vec4 o; void main() { o = vec4(1); }", half)
    copy(gl_context, source, target)
    found = read_image(gl_context, one)[..., 0].astype(np.float64)
    assert found[0, 0] == 1.0 and found[3, 3] == 0.0
    assert set(np.unique(found)) <= {0.0, 0.25, 0.5, 0.75, 1.0} and 0 < found[1, 2] < 1


def test_srgb_targets_code_what_is_drawn_and_plain_ones_do_not(gl_context, bench):
    fragment = "layout(location = 0) out vec4 o; void main() { o = vec4(0.5); }"
    for format, code in (("rgba8", 128), ("rgba8_srgb", 188)):
        image = bench.image(format, (1, 1))
        begin(gl_context, bench.framebuffer([image]))
        bench.draw(fragment)
        assert abs(int(read_image(gl_context, image)[0, 0, 0]) - code) <= 1
