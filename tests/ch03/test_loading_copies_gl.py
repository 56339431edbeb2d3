"""The loader on OpenGL, without a renderer: every byte arrives, in parts too, and no range is written too early."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from backends.gl import api as gl
from backends.gl.readback import read_image
from backends.gl.resources import create_image, destroy_image, level_size, mip_levels
from chapters.ch03.loading.gl import Loader
from chapters.ch03.loading.loading import Loading, Wanted
from chapters.ch03.loading.uploads import Upload
from chapters.ch03.scene.textures.texels import Shape
from common.images.blocks import FEATURE, stored_shape
from tests.support.gl_functions import noted
from tests.support.mip_levels import halved, halved_codes
from tests.support.odd_texels import ODD, random_pixels, rows_of

pytestmark = pytest.mark.usefixtures("no_thread_left")
MIB = 1 << 20


@dataclass
class Owner:
    """Gives each request a layer; requests of equal shape are layers of one array."""

    context: object
    arrays: dict = field(default_factory=dict)
    layers: dict = field(
        default_factory=dict
    )  # by shape: the keys of its requests, in the order of their layers

    def place(self, request):
        shape = request.upload.shape
        if shape not in self.arrays:
            self.arrays[shape] = create_image(
                self.context,
                shape.format,
                (shape.width, shape.height),
                "array",
                shape="array",
                levels=shape.levels,
                layers=4,
                view_format=shape.view_format,
            )
        keys = self.layers.setdefault(shape, [])
        keys.append(request.key)
        return self.arrays[shape], len(keys) - 1

    def level_of(self, key, level=0):
        """Return a level as pixels (H, W, C), or as (rows, bytes of a row) where the format has blocks."""
        shape = next(shape for shape, keys in self.layers.items() if key in keys)
        image, layer = self.arrays[shape], self.layers[shape].index(key)
        if shape.format in FEATURE:
            return blocks_of(self.context, image, level, layer)
        pixels = read_image(self.context, image, level=level, layer=layer)
        return pixels.reshape(*pixels.shape[:2], -1)

    def close(self):
        for image in self.arrays.values():
            destroy_image(self.context, image)


def blocks_of(context, image, level, layer):
    """Return the blocks of a level as they are stored: (rows, bytes of a row) uint8."""
    size = level_size(image, level)
    blocks = np.zeros(stored_shape(image.storage_format, *size), np.uint8)
    kind = "void (*)(GLuint, GLint, GLint, GLint, GLint, GLsizei, GLsizei, GLsizei, GLsizei, void *)"
    read = gl.ffi.cast(kind, context.fn._resolve("glGetCompressedTextureSubImage"))
    read(image.handle, level, 0, 0, layer, *size, 1, blocks.nbytes, gl.pointer(blocks))
    return blocks


@pytest.fixture
def opened(gl_context):
    kept = []

    def open_(ring=4096, streams=True, ahead=None):
        loading, owner = Loading(2, streams, ahead=ahead), Owner(gl_context)
        loader = Loader(gl_context, owner, loading, **({"ring": ring} if ring else {}))
        loader.advance(1)  # the first frame, which copies nothing
        kept.append((loader, owner))
        return loader, loading, owner

    yield open_
    for loader, owner in kept:
        loader.stop()
        owner.close()


def wanted(uploads):
    """Return requests for uploads, by number."""
    return {n: Wanted(f"picture {n}", one.nbytes, lambda one=one: one) for n, one in enumerate(uploads)}


def uploads_of(formats, mips=False):
    """Return uploads of level 0, and the pixels of each."""
    pixels = [random_pixels(format, size, n) for n, (format, size) in enumerate(formats)]
    shapes = [Shape(*size, format, None, mip_levels(*size) if mips else 1) for format, size in formats]
    return [
        Upload("picture", shape, False, (rows_of(one),)) for shape, one in zip(shapes, pixels, strict=True)
    ], pixels


def decode_all(loading):
    while loading.decoding:
        loading.wait()


def traced(context, work):
    """Return the calls that `work` makes, as (name, arguments)."""
    log = []
    with noted(context, lambda name, arguments: log.append((name, arguments))):
        work()
    return log


def frames(context, loader, loading, budget, most=2000):
    """Advance until everything has arrived; return how many bytes each step copied."""
    copied = []
    while loading.busy:
        before = loader.bytes
        loader.advance(budget)
        copied.append(loader.bytes - before)
        assert len(copied) < most
        if not copied[-1]:
            context.wait_idle()
            loading.wait()
    return copied


# --- bytes ---


@pytest.mark.feature("async-loading/staging-buffer")
@pytest.mark.parametrize("budget", [None, 1000, 1])
def test_every_byte_of_odd_sizes_arrives_and_more_than_the_ring_holds(gl_context, opened, budget):
    loader, loading, owner = opened(ring=4096)
    formats = [*ODD, ODD[2], ODD[2], *([("rgba8", (40, 150))] if budget != 1 else [])]
    uploads, pixels = uploads_of(formats)
    loader.want(wanted(uploads))
    copied = frames(gl_context, loader, loading, budget)
    assert sum(copied) == sum(one.nbytes for one in pixels)
    for number, one in enumerate(pixels):
        assert np.array_equal(rows_of(owner.level_of(number)), rows_of(one)), formats[number]
    if budget == 1000:
        assert max(copied) <= budget and len(copied) > 24
    if budget == 1:  # a row at a time, where the budget is less than one
        assert max(copied) == 64 * 4, "the longest row"


def test_where_frames_wait_for_textures_all_of_them_are_there_at_once(opened):
    loader, _, owner = opened(ring=1000, streams=False)
    uploads, pixels = uploads_of([*ODD, ("rgba8", (40, 150))])
    arrived = loader.want(wanted(uploads))
    assert sorted(request.key for request in arrived) == [*range(len(pixels))]
    for number, one in enumerate(pixels):
        assert np.array_equal(rows_of(owner.level_of(number)), rows_of(one))


@pytest.mark.feature("async-loading/batched-mip-upload")
@pytest.mark.parametrize(("ring", "budget"), [(1 << 16, None), (1 << 16, 130), (512, None)])
@pytest.mark.parametrize("format", ["r8", "rg8", "rgba8", "rgba16f", "bc4", "bc5", "bc7", "etc2"])
def test_a_chain_that_the_image_brings_is_copied_level_by_level(gl_context, opened, format, ring, budget):
    """In one part and in several; its bytes are no mip chain, so a level that the GPU made would differ."""
    if format in FEATURE and not gl_context.has(FEATURE[format]):
        pytest.skip(f"the device has no {FEATURE[format]}")
    loader, loading, owner = opened(ring=ring)
    sizes = [(22, 37), (11, 18), (5, 9), (2, 4), (1, 2), (1, 1)]
    random = np.random.default_rng(4)
    rows = tuple(
        random.integers(0, 256, stored_shape(format, *size), np.uint8)
        if format in FEATURE
        else rows_of(random_pixels(format, size, size[1]))
        for size in sizes
    )
    loader.want(wanted([Upload("chain", Shape(22, 37, format, None, 6), False, rows)]))
    names = [name for name, _ in traced(gl_context, lambda: frames(gl_context, loader, loading, budget))]
    copies = names.count("glTextureSubImage3D") + names.count("glCompressedTextureSubImage3D")
    assert "glDispatchCompute" not in names
    assert (copies == 6) == (budget is None and sum(level.nbytes for level in rows) < ring)
    for level, bytes_ in enumerate(rows):
        found = owner.level_of(0, level)
        assert np.array_equal(found if format in FEATURE else rows_of(found), bytes_), level


@pytest.mark.feature("async-loading/batched-mip-upload")
def test_levels_are_the_box_filter_of_the_one_above_all_in_one_frame(gl_context, opened):
    """A frame copies all images, makes their levels, and leaves one fence behind; it waits for nothing."""
    formats = [("rgba8", (13, 7)), ("rgba8", (16, 16)), ("rgba8", (13, 7)), ("r8", (9, 5)), ("rg8", (1, 6))]
    formats += [("rgba16f", (4, 8)), ("rgba16f", (7, 3))]
    uploads, pixels = uploads_of(formats, mips=True)
    shape = Shape(13, 7, "rgba8", "rgba8_srgb", 4)
    uploads.append(Upload("colour", shape, True, uploads[0].rows))
    loader, loading, owner = opened(ring=1 << 16)
    loader.want(wanted(uploads))
    decode_all(loading)
    log = traced(gl_context, lambda: loader.advance(MIB * 16))
    assert not loading.busy
    names = [name for name, _ in log]
    assert names.count("glTextureSubImage3D") == len(uploads) and names.count("glFenceSync") == 1
    assert not {"glFinish", "glClientWaitSync", "glWaitSync"} & {*names}
    for number, one in enumerate([*pixels, pixels[0]]):
        above = owner.level_of(number)
        assert np.array_equal(rows_of(above), rows_of(one))
        for level in range(1, uploads[number].shape.levels):
            found = owner.level_of(number, level).astype(np.float64)
            codes = one.dtype == np.uint8
            truth = halved_codes(above, uploads[number].srgb) if codes else halved(above.astype(np.float64))
            assert found.shape == truth.shape
            assert np.abs(found - truth).max() <= (1.0 if codes else 1 / 255), (number, level)
            above = found


# --- nothing is waited for, and no range is written too early ---


@pytest.fixture
def gpu(gl_context, monkeypatch):
    """Fences of a GPU that is as far as the test says: what is not in `gpu.done` is not reached."""
    fn, make = gl_context.fn, gl_context.fn.glFenceSync
    state = SimpleNamespace(made=[], done=set())

    def fence(*arguments):
        state.made.append(make(*arguments))
        return state.made[-1]

    def ask(handle, flags, nanoseconds):
        assert nanoseconds == 0, "a fence is asked and not waited for"
        return gl.GL_ALREADY_SIGNALED if handle in state.done else gl.GL_TIMEOUT_EXPIRED

    monkeypatch.setattr(fn, "glFenceSync", fence)
    monkeypatch.setattr(fn, "glClientWaitSync", ask)
    return state


def offsets(context, work):
    """Return where in the ring the copies that `work` makes read from."""
    log = traced(context, work)
    assert not {"glFinish", "glWaitSync"} & {name for name, _ in log}
    copies = [arguments for name, arguments in log if name == "glTextureSubImage3D"]
    return [int(gl.ffi.cast("intptr_t", arguments[-1])) for arguments in copies]


@pytest.mark.feature("async-loading/staging-buffer")
def test_a_range_is_used_again_only_when_the_fence_behind_its_copies_is_reached(gl_context, opened, gpu):
    loader, loading, _ = opened(ring=3 * 4096)
    uploads, _ = uploads_of([("rgba8", (32, 32))] * 4 + [("rgba8", (16, 64))] * 2)  # 4 KiB each
    loader.want(wanted(uploads))
    decode_all(loading)

    def step():
        return offsets(gl_context, lambda: loader.advance(4096))

    assert [step() for _ in range(5)] == [[0], [4096], [8192], [], []], "the GPU still reads all of the ring"
    gpu.done.add(gpu.made[1])
    assert step() == [], "the oldest range is still read"
    gpu.done.add(gpu.made[0])
    assert [step() for _ in range(3)] == [[0], [4096], []]
    gpu.done.update(gpu.made)
    assert step() == [0], "an empty ring begins anew"
    assert loader.bytes == 6 * 4096 and len(gpu.made) == 6, "a fence for each frame that copied"


@pytest.mark.feature("async-loading/staging-buffer")
def test_64_mib_are_under_way_before_a_frame_copies_nothing(gl_context, opened, gpu):
    """Without a budget the first frame fills the ring; the rest follows when the GPU has read it."""
    loader, loading, owner = opened(ring=None, ahead=1 << 30)
    rows, shape = np.zeros((1024, 4096), np.uint8), Shape(1024, 1024, "rgba8", None, 1)
    owner.place = lambda request: (Owner.place(owner, request)[0], 0)  # one layer is enough for all
    loader.want(wanted([Upload("picture", shape, False, (rows,))] * 17))
    decode_all(loading)
    copied = []
    for _ in range(3):
        loader.advance()
        copied.append(loader.bytes)
        gpu.done.update(gpu.made if len(copied) == 2 else ())
    assert copied == [64 * MIB, 64 * MIB, 68 * MIB]


# --- life ---


@pytest.mark.feature("async-loading/staging-buffer")
def test_the_ring_is_mapped_once_and_freed_when_nothing_is_left(gl_context, opened):
    loader, *_ = opened(ring=1000)
    uploads, _ = uploads_of(ODD)
    alive = {*gl_context.alive}
    loader.want(wanted(uploads))
    names = [name for name, _ in traced(gl_context, loader.finish)]
    assert names.count("glMapNamedBufferRange") == 1 and "glUnmapNamedBuffer" not in names
    gl_context.wait_idle()
    loader.advance()
    assert {kind for kind, _ in {*gl_context.alive} - alive} == {"texture"}, "the images, and nothing else"
    assert traced(gl_context, loader.advance) == [], "a frame without anything to load calls nothing"
