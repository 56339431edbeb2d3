"""Buffers, images, views and samplers: each with a name, and one call to make and one to free it.

Storage is immutable: its size, levels and format are fixed when it is made, as in Vulkan. The descriptions (formats,
samplers, mip levels) are those of `backends.vulkan.resources`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.storage import in_memory, mapped
from common.errors import UnsupportedError
from common.images import blocks
from common.scene import Sampler


class Format(NamedTuple):
    """OpenGL's name of a format, how pixels of it lie in the CPU's memory, and the same in numpy's words.

    Of the formats of `common.images.blocks`, `texel` is the bytes of a block of 4x4 texels; the rest says how they are
    read back, unpacked.
    """

    internal: int
    pixels: int
    component: int
    texel: int  # bytes
    dtype: type
    channels: int


_BYTE, _HALF, _FLOAT, _UINT = gl.GL_UNSIGNED_BYTE, gl.GL_HALF_FLOAT, gl.GL_FLOAT, gl.GL_UNSIGNED_INT

FORMATS: dict[str, Format] = {
    "r8": Format(gl.GL_R8, gl.GL_RED, _BYTE, 1, np.uint8, 1),
    "rg8": Format(gl.GL_RG8, gl.GL_RG, _BYTE, 2, np.uint8, 2),
    "rgba8": Format(gl.GL_RGBA8, gl.GL_RGBA, _BYTE, 4, np.uint8, 4),
    "rgba8_srgb": Format(gl.GL_SRGB8_ALPHA8, gl.GL_RGBA, _BYTE, 4, np.uint8, 4),
    "rgb10a2": Format(gl.GL_RGB10_A2, gl.GL_RGBA, gl.GL_UNSIGNED_INT_2_10_10_10_REV, 4, np.uint32, 1),
    "r8ui": Format(gl.GL_R8UI, gl.GL_RED_INTEGER, _BYTE, 1, np.uint8, 1),
    "r32ui": Format(gl.GL_R32UI, gl.GL_RED_INTEGER, _UINT, 4, np.uint32, 1),
    "rg32ui": Format(gl.GL_RG32UI, gl.GL_RG_INTEGER, _UINT, 8, np.uint32, 2),
    "r32f": Format(gl.GL_R32F, gl.GL_RED, _FLOAT, 4, np.float32, 1),
    "rg16f": Format(gl.GL_RG16F, gl.GL_RG, _HALF, 4, np.float16, 2),
    "rgba16f": Format(gl.GL_RGBA16F, gl.GL_RGBA, _HALF, 8, np.float16, 4),
    "rgba32f": Format(gl.GL_RGBA32F, gl.GL_RGBA, _FLOAT, 16, np.float32, 4),
    # moderngl's own depth textures have 24 bits, in which reversed z is worth nothing.
    "d32f": Format(gl.GL_DEPTH_COMPONENT32F, gl.GL_DEPTH_COMPONENT, _FLOAT, 4, np.float32, 1),
    "bc4": Format(gl.GL_COMPRESSED_RED_RGTC1, gl.GL_RED, _BYTE, 8, np.uint8, 1),
    "bc5": Format(gl.GL_COMPRESSED_RG_RGTC2, gl.GL_RG, _BYTE, 16, np.uint8, 2),
    "bc7": Format(gl.GL_COMPRESSED_RGBA_BPTC_UNORM, gl.GL_RGBA, _BYTE, 16, np.uint8, 4),
    "bc7_srgb": Format(gl.GL_COMPRESSED_SRGB_ALPHA_BPTC_UNORM, gl.GL_RGBA, _BYTE, 16, np.uint8, 4),
    "etc2": Format(gl.GL_COMPRESSED_RGB8_ETC2, gl.GL_RGBA, _BYTE, 8, np.uint8, 4),
    "etc2_srgb": Format(gl.GL_COMPRESSED_SRGB8_ETC2, gl.GL_RGBA, _BYTE, 8, np.uint8, 4),
}
"""The short names of formats, as passes declare them: those of `backends.vulkan.resources.FORMATS`."""

# --- buffers ----------------------------------------------------------------------------------------------------------

MemoryUse = Literal["device", "upload", "readback"]

_USES: dict[MemoryUse, tuple[int, int]] = {
    # (flags of the storage, flags of the mapping)
    "device": (gl.GL_DYNAMIC_STORAGE_BIT, 0),
    "upload": (0, gl.GL_MAP_WRITE_BIT | gl.GL_MAP_PERSISTENT_BIT | gl.GL_MAP_COHERENT_BIT),
    "readback": (
        gl.GL_CLIENT_STORAGE_BIT,
        gl.GL_MAP_READ_BIT | gl.GL_MAP_WRITE_BIT | gl.GL_MAP_PERSISTENT_BIT | gl.GL_MAP_COHERENT_BIT,
    ),
}


@dataclass(eq=False)
class Buffer:
    """A buffer; `mapped` is (size,) uint8 where the CPU can reach it, and stays valid while the GPU uses the buffer."""

    handle: int
    size: int
    name: str
    _mapped: np.ndarray | None

    @property
    def mapped(self) -> np.ndarray:
        """The buffer's bytes; ValueError for memory that only the GPU reaches."""
        if self._mapped is None:
            raise ValueError(f"The buffer '{self.name}' is in memory that the CPU cannot map.")
        return self._mapped

    def view(self, dtype: Any) -> np.ndarray:
        """Return the mapped bytes as an array of `dtype`."""
        itemsize = np.dtype(dtype).itemsize
        return self.mapped[: self.size // itemsize * itemsize].view(dtype)


def create_buffer(context: Context, size: int, use: MemoryUse, name: str) -> Buffer:
    """Return a buffer of `size` bytes (at least 4), for any binding.

    "device": written with `write_buffer`; "upload": mapped for the CPU's writing, read by the GPU where it lies;
    "readback": mapped for the CPU's reading. Mapped memory is coherent: what the CPU writes before a call, the call
    sees; what the GPU wrote, the CPU sees once a fence says so. Reading "upload" memory is slow.
    """
    size = max(int(size), 4)
    handle = context.create("buffer", name)
    storage, mapping = _USES[use]
    with in_memory(context, "buffer", handle, f"'{name}'", size):
        context.fn.glNamedBufferStorage(handle, size, gl.NULL, storage | mapping)
        seen = mapped(context, handle, size, mapping) if mapping else None
    return Buffer(handle, size, name, seen)


def write_buffer(context: Context, buffer: Buffer, data: np.ndarray, offset: int = 0) -> None:
    """Copy the bytes of `data` to a "device" buffer from byte `offset` on, in the order of the other calls."""
    raw = np.ascontiguousarray(data).view(np.uint8).reshape(-1)
    if offset + raw.size > buffer.size:
        raise ValueError(
            f"{raw.size} bytes at {offset} do not fit into '{buffer.name}' of {buffer.size} bytes."
        )
    if raw.size:
        context.fn.glNamedBufferSubData(buffer.handle, offset, raw.size, gl.pointer(raw))


def read_buffer(context: Context, buffer: Buffer, dtype: Any = np.uint8) -> np.ndarray:
    """Return a copy of a buffer's content now, waiting for the GPU: for tests and tools.

    What shaders wrote needs the barrier GL_BUFFER_UPDATE_BARRIER_BIT before.
    """
    # Of a copy: NVIDIA's driver (580.159) loses what a dispatch writes to a buffer that was read directly, until the
    # buffer or the program is bound anew.
    copied = create_buffer(context, buffer.size, "device", f"copy of {buffer.name}")
    values = np.empty(buffer.size, np.uint8)
    context.fn.glCopyNamedBufferSubData(buffer.handle, copied.handle, 0, 0, buffer.size)
    context.fn.glGetNamedBufferSubData(copied.handle, 0, buffer.size, gl.pointer(values))
    destroy_buffer(context, copied)
    itemsize = np.dtype(dtype).itemsize
    return values[: buffer.size // itemsize * itemsize].view(dtype)


def destroy_buffer(context: Context, buffer: Buffer) -> None:
    """Free a buffer; its mapped bytes must not be touched any more. OpenGL itself waits for the GPU's use."""
    buffer._mapped = None
    context.destroy("buffer", buffer.handle)


_BLOCKS = {"uniform": gl.GL_UNIFORM_BUFFER, "storage": gl.GL_SHADER_STORAGE_BUFFER}


def bind_buffer(
    context: Context,
    kind: Literal["uniform", "storage"],
    binding: int,
    buffer: Buffer,
    offset: int = 0,
    size: int | None = None,
) -> None:
    """Bind a buffer, or `size` bytes from an aligned `offset` on, to a block's binding."""
    fn = context.fn
    size = buffer.size - offset if size is None else size
    fn.glBindBufferRange(_BLOCKS[kind], binding, buffer.handle, offset, size)


# --- images -----------------------------------------------------------------------------------------------------------

Shape = Literal["2d", "array", "cube", "cube_array", "3d"]

TARGETS: dict[Shape, int] = {
    "2d": gl.GL_TEXTURE_2D,
    "array": gl.GL_TEXTURE_2D_ARRAY,
    "cube": gl.GL_TEXTURE_CUBE_MAP,
    "cube_array": gl.GL_TEXTURE_CUBE_MAP_ARRAY,
    "3d": gl.GL_TEXTURE_3D,
}


@dataclass(eq=False)
class Image:
    """An image: `handle` is its storage, `view` what is sampled; `views` holds the others that were asked for.

    `layers` are those of an array, six per cube, or the slices of a 3D image. `format` is the view's.
    """

    handle: int
    view: int
    format: str
    storage_format: str
    shape: Shape
    width: int
    height: int
    levels: int
    layers: int
    samples: int
    name: str
    views: list[int] = field(default_factory=list)

    @property
    def target(self) -> int:
        """The kind of texture, as OpenGL's calls name it."""
        return gl.GL_TEXTURE_2D_MULTISAMPLE if self.samples > 1 else TARGETS[self.shape]


def create_image(
    context: Context,
    format: str,
    size: tuple[int, int],
    name: str,
    *,
    shape: Shape = "2d",
    levels: int = 1,
    layers: int = 1,
    samples: int = 1,
    view_format: str | None = None,
    swizzle: str = "rgba",
) -> Image:
    """Return an image of (width, height); `view_format` is that in which it is sampled, if another.

    `swizzle` says which channels of the image are sampled as red, green, blue and alpha: "0rg1" has its red in green.

    An image that is sampled as sRGB and written by compute is made as "rgba8" with the view "rgba8_srgb": image stores
    know no sRGB formats.

    Raises UnsupportedError for a compressed format that the device lacks: `blocks.storage_of` chooses another.
    """
    width, height = size
    if format.startswith("etc2") and view_format not in (None, format):
        raise ValueError(
            f"'{name}': OpenGL has no views of ETC2 in another format; store it as {view_format}."
        )
    if blocks.is_compressed(format) and not context.has(blocks.FEATURE[format]):
        raise UnsupportedError(
            f"'{name}' cannot be stored as {format}: the device lacks {blocks.FEATURE[format]}."
        )
    if shape in ("cube", "cube_array"):
        layers = 6 if shape == "cube" else layers
        if width != height or layers % 6:
            raise ValueError(
                f"'{name}': a cube has square faces, six per cube, not {layers} of {width}x{height}."
            )
    if samples > 1 and (shape != "2d" or levels > 1):
        raise ValueError(f"'{name}': a multisampled image has one layer and one level.")
    target = gl.GL_TEXTURE_2D_MULTISAMPLE if samples > 1 else TARGETS[shape]
    handle = context.create("texture", name, target)
    internal, fn = FORMATS[format].internal, context.fn
    per_texel = FORMATS[format].texel / (16 if blocks.is_compressed(format) else 1)
    bytes_needed = int(width * height * layers * samples * per_texel)
    with in_memory(context, "texture", handle, f"'{name}' of {width}x{height} pixels", bytes_needed):
        if samples > 1:
            fn.glTextureStorage2DMultisample(handle, samples, internal, width, height, 1)
        elif shape in ("2d", "cube"):
            fn.glTextureStorage2D(handle, levels, internal, width, height)
        else:
            fn.glTextureStorage3D(handle, levels, internal, width, height, layers)
    image = Image(
        handle, handle, view_format or format, format, shape, width, height, levels, layers, samples, name
    )
    _take_nearest(context, image, handle)
    if image.format != format or swizzle != "rgba":
        image.view = create_view(context, image, image.format)
    for channel, shown in zip(_CHANNELS, swizzle, strict=True):
        if shown != channel:
            fn.glTextureParameteri(image.view, _CHANNELS[channel], _SWIZZLES[shown])
    return image


_CHANNELS = {
    "r": gl.GL_TEXTURE_SWIZZLE_R,
    "g": gl.GL_TEXTURE_SWIZZLE_G,
    "b": gl.GL_TEXTURE_SWIZZLE_B,
    "a": gl.GL_TEXTURE_SWIZZLE_A,
}
_SWIZZLES = {
    "0": gl.GL_ZERO,
    "1": gl.GL_ONE,
    "r": gl.GL_RED,
    "g": gl.GL_GREEN,
    "b": gl.GL_BLUE,
    "a": gl.GL_ALPHA,
}


def sample_counts(context: Context, format: str) -> tuple[int, ...]:
    """Return how many samples a pixel of an image of `format` can have, in ascending order.

    `create_image` takes other numbers too, and OpenGL then gives the next larger one without a word.
    """
    internal, query = FORMATS[format].internal, context.fn.glGetInternalformativ
    count = gl.ffi.new("GLint[1]")
    query(gl.GL_TEXTURE_2D_MULTISAMPLE, internal, gl.GL_NUM_SAMPLE_COUNTS, 1, count)
    counts = gl.ffi.new("GLint[]", max(1, count[0]))
    query(gl.GL_TEXTURE_2D_MULTISAMPLE, internal, gl.GL_SAMPLES, count[0], counts)
    return tuple(sorted({1, *(int(number) for number in counts[0 : count[0]])}))


def create_view(
    context: Context,
    image: Image,
    format: str,
    *,
    level: int = 0,
    levels: int | None = None,
    layer: int = 0,
    layers: int | None = None,
    shape: Shape | None = None,
) -> int:
    """Return a view of some levels and layers of an image, in another format or shape; it is freed with its image.

    Layers of a cube or an array can be seen as "2d", "array" or "cube"; a 3D image has no views of single slices.
    """
    shape = shape or image.shape
    if layers is None:
        layers = 1 if shape in ("2d", "3d") else image.layers - layer
    out = gl.ffi.new("GLuint[1]")
    context.fn.glGenTextures(1, out)  # a view's name must not have been given a kind of texture
    view = int(out[0])
    context.fn.glTextureView(
        view,
        gl.GL_TEXTURE_2D_MULTISAMPLE if image.samples > 1 else TARGETS[shape],
        image.handle,
        FORMATS[format].internal,
        level,
        image.levels - level if levels is None else levels,
        layer,
        layers,
    )
    context.adopt("texture", view, f"{image.name} view")
    image.views.append(view)
    _take_nearest(context, image, view)
    return view


def _take_nearest(context: Context, image: Image, texture: int) -> None:
    """Make a texture readable without a sampler: OpenGL's own filters ask for mip levels, and leave integers black."""
    if image.samples == 1:
        context.fn.glTextureParameteri(texture, gl.GL_TEXTURE_MIN_FILTER, gl.GL_NEAREST_MIPMAP_NEAREST)
        context.fn.glTextureParameteri(texture, gl.GL_TEXTURE_MAG_FILTER, gl.GL_NEAREST)


def write_image(
    context: Context, image: Image, pixels: np.ndarray, *, level: int = 0, layer: int = 0, y: int = 0
) -> None:
    """Copy (rows, W) or (rows, W, C) pixels of the format's type into a level and layer, from row `y` on.

    A whole number of layers may be given as (layers, rows, W, C).
    """
    described = FORMATS[image.storage_format]
    width, height = level_size(image, level)
    shape = pixels.shape if described.channels > 1 else (*pixels.shape, 1)
    layered = len(shape) == 4
    count, rows = (shape[0] if layered else 1), shape[-3]
    wanted = (width, described.channels)
    if (
        shape[-2:] != wanted
        or pixels.dtype != described.dtype
        or y + rows > height
        or layer + count > image.layers
    ):
        raise ValueError(
            f"'{image.name}' wants rows of {wanted} {np.dtype(described.dtype)}, at most {height} of them in "
            f"{image.layers} layers, not {pixels.shape} {pixels.dtype}."
        )
    raw, fn = np.ascontiguousarray(pixels), context.fn
    where = (described.pixels, described.component, gl.pointer(raw))
    if image.shape == "2d":
        fn.glTextureSubImage2D(image.handle, level, 0, y, width, rows, *where)
    else:
        fn.glTextureSubImage3D(image.handle, level, 0, y, layer, width, rows, count, *where)


def level_size(image: Image, level: int) -> tuple[int, int]:
    """Return (width, height) of a mip level."""
    return max(1, image.width >> level), max(1, image.height >> level)


def mip_levels(width: int, height: int) -> int:
    """Return the number of levels of a full chain down to 1x1."""
    return max(width, height).bit_length()


def destroy_image(context: Context, image: Image) -> None:
    """Free an image and its views."""
    for view in image.views:
        context.destroy("texture", view)
    image.views.clear()
    context.destroy("texture", image.handle)


# --- samplers ---------------------------------------------------------------------------------------------------------

_FILTERS = {"nearest": gl.GL_NEAREST, "linear": gl.GL_LINEAR}
_MINIFICATIONS = {
    ("nearest", None): gl.GL_NEAREST,
    ("linear", None): gl.GL_LINEAR,
    ("nearest", "nearest"): gl.GL_NEAREST_MIPMAP_NEAREST,
    ("linear", "nearest"): gl.GL_LINEAR_MIPMAP_NEAREST,
    ("nearest", "linear"): gl.GL_NEAREST_MIPMAP_LINEAR,
    ("linear", "linear"): gl.GL_LINEAR_MIPMAP_LINEAR,
}
_WRAPS = {"repeat": gl.GL_REPEAT, "clamp": gl.GL_CLAMP_TO_EDGE, "mirror": gl.GL_MIRRORED_REPEAT}


def create_sampler(context: Context, sampler: Sampler, anisotropy: float, name: str) -> int:
    """Return a sampler for glTF's filters and wraps; `anisotropy` above 1 needs the feature and trilinear filters."""
    handle = context.create("sampler", name)
    set_integer, set_float = context.fn.glSamplerParameteri, context.fn.glSamplerParameterf
    set_integer(handle, gl.GL_TEXTURE_MAG_FILTER, _FILTERS[sampler.mag])
    set_integer(handle, gl.GL_TEXTURE_MIN_FILTER, _MINIFICATIONS[sampler.min, sampler.mipmap])
    set_integer(handle, gl.GL_TEXTURE_WRAP_S, _WRAPS[sampler.wrap_u])
    set_integer(handle, gl.GL_TEXTURE_WRAP_T, _WRAPS[sampler.wrap_v])
    set_integer(handle, gl.GL_TEXTURE_WRAP_R, gl.GL_CLAMP_TO_EDGE)
    trilinear = sampler.mag == sampler.min == sampler.mipmap == "linear"
    if trilinear and anisotropy > 1.0 and context.has("anisotropy"):
        out = gl.ffi.new("GLfloat[1]")
        context.fn.glGetFloatv(gl.GL_MAX_TEXTURE_MAX_ANISOTROPY, out)
        set_float(handle, gl.GL_TEXTURE_MAX_ANISOTROPY, min(anisotropy, float(out[0])))
    return handle


def bind_texture(context: Context, unit: int, view: int, sampler: int) -> None:
    """Let the sampler variable with binding `unit` read `view` through `sampler` (0: the view's own, nearest)."""
    context.fn.glBindTextureUnit(unit, view)
    context.fn.glBindSampler(unit, sampler)


def bind_storage_image(
    context: Context,
    unit: int,
    image: Image,
    *,
    level: int = 0,
    layer: int | None = None,
    access: str = "write",
) -> None:
    """Let the image variable with binding `unit` reach a level: all its layers, or the one given."""
    context.fn.glBindImageTexture(
        unit,
        image.handle,
        level,
        int(layer is None and image.shape != "2d"),
        layer or 0,
        {"read": gl.GL_READ_ONLY, "write": gl.GL_WRITE_ONLY, "both": gl.GL_READ_WRITE}[access],
        FORMATS[image.storage_format].internal,
    )
