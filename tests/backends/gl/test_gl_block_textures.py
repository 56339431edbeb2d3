"""Block-compressed textures on OpenGL: every level and layer arrives, and is sampled as other authors decode it."""

from __future__ import annotations

import numpy as np
import pytest

from backends.gl import api as gl
from backends.gl.programs import Programs
from backends.gl.resources import (
    bind_buffer,
    bind_texture,
    create_buffer,
    create_image,
    destroy_buffer,
    destroy_image,
    mip_levels,
    read_buffer,
)
from backends.gl.upload import Uploader
from backends.shader_text import build_text
from common.images.ktx import Ktx, read_ktx, write_ktx
from tests.support.block_pictures import DECODED, by_level, chains, check, sampling


def sampled(context, format, size, layers, **more):
    """Return (layers, h, w, 4) float32 for each level, as a shader reads what was uploaded."""
    levels = len(layers[0])
    image = create_image(
        context, format, size, "blocks", shape="array", levels=levels, layers=len(layers), **more
    )
    text, count = sampling(*size, levels, len(layers))
    texels = create_buffer(context, 16 * count, "device", "texels")
    programs = Programs(context)
    try:
        with Uploader(context) as uploader:
            uploader.chain(image, layers)
            assert uploader.bytes == sum(rows.nbytes for chain in layers for rows in chain)
        bind_texture(context, 0, image.view, 0)
        bind_buffer(context, "storage", 0, texels)
        context.fn.glUseProgram(programs.get([build_text(text, "comp", "gl")]).handle)
        context.fn.glDispatchCompute((count + 63) // 64, 1, 1)
        context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        return by_level(read_buffer(context, texels, np.float32), *size, levels, len(layers))
    finally:
        programs.close()
        destroy_buffer(context, texels)
        destroy_image(context, image)


@pytest.mark.feature("textures/block-compression")
@pytest.mark.feature("textures/etc2-ktx")
@pytest.mark.parametrize("size", [(61, 37), (16, 4), (1, 3)])
@pytest.mark.parametrize("format", DECODED)
def test_every_level_and_layer_is_sampled_as_it_decodes(gl_context, format, size):
    layers = chains(format, *size, mip_levels(*size), 3)
    for level, texels in enumerate(sampled(gl_context, format, size, layers)):
        for layer, picture in enumerate(texels):
            check(format, picture, layers[layer][level], gl_context.capabilities)


@pytest.mark.feature("textures/etc2-ktx")
@pytest.mark.needs("texture2ddecoder")
def test_a_file_goes_up_as_it_was_read(gl_context, tmp_path):
    """The levels of a KTX file are what an upload takes."""
    write_ktx(tmp_path / "a.ktx", Ktx("etc2", 20, 12, tuple(map(tuple, chains("etc2", 20, 12, 5, 2)))))
    texture = read_ktx(tmp_path / "a.ktx")
    for level, texels in enumerate(
        sampled(gl_context, texture.format, (texture.width, texture.height), texture.layers)
    ):
        for layer, picture in enumerate(texels):
            check("etc2", picture, texture.layers[layer][level], gl_context.capabilities)


@pytest.mark.needs("texture2ddecoder")
def test_an_image_of_one_layer_takes_them_too(gl_context):
    (chain,) = chains("bc7", 8, 8, 2, 1)
    image = create_image(gl_context, "bc7", (8, 8), "one", levels=2)
    with Uploader(gl_context) as uploader:
        uploader.chain(image, [chain])
    back = np.empty((4, 4, 4), np.uint8)
    where = (gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, back.nbytes, gl.pointer(back))
    gl_context.fn.glGetTextureSubImage(image.handle, 1, 0, 0, 0, 4, 4, 1, *where)
    check("bc7", (back / np.float32(255)).astype(np.float32), chain[1], gl_context.capabilities)
    destroy_image(gl_context, image)


@pytest.mark.parametrize("format", ["r8", "rg8", "rgba8", "rgba16f"])
def test_levels_of_texels_go_up_the_same_way(gl_context, format):
    size, dtype = (13, 7), np.float16 if format == "rgba16f" else np.uint8
    channels = {"r8": 1, "rg8": 2}.get(format, 4)
    random = np.random.default_rng(2)
    pixels = [
        random.integers(0, 256, (max(1, 7 >> n), max(1, 13 >> n), channels)).astype(dtype) for n in range(4)
    ]
    rows = [one.view(np.uint8).reshape(len(one), -1) for one in pixels]
    for level, texels in enumerate(sampled(gl_context, format, size, [rows])):
        scale = 1 if format == "rgba16f" else 255
        assert np.array_equal(np.rint(texels[0, ..., :channels] * scale), pixels[level].astype(np.float64))


def test_views_take_the_same_blocks_as_srgb(gl_context):
    colour = chains("bc7", 8, 8, 1, 1)
    srgb = sampled(gl_context, "bc7_srgb", (8, 8), colour)[0]
    assert np.array_equal(sampled(gl_context, "bc7", (8, 8), colour, view_format="bc7_srgb")[0], srgb)
    with pytest.raises(ValueError, match="no views of ETC2 in another format; store it as etc2_srgb"):
        create_image(gl_context, "etc2", (8, 8), "leaves", view_format="etc2_srgb")


@pytest.mark.parametrize("format", ["bc5", "etc2"])
def test_swizzles_work_as_for_other_formats(gl_context, format):
    two = chains(format, 8, 8, 1, 1)
    plain = sampled(gl_context, format, (8, 8), two)[0]
    moved = sampled(gl_context, format, (8, 8), two, swizzle="0rg1")[0]
    assert np.array_equal(moved[..., 1:3], plain[..., :2])
    assert (moved[..., 0] == 0).all() and (moved[..., 3] == 1).all()


def test_wrong_levels_are_refused_by_name(gl_context):
    image = create_image(gl_context, "bc4", (5, 4), "picture", levels=2)
    good = [np.zeros((1, 16), np.uint8), np.zeros((1, 8), np.uint8)]
    with Uploader(gl_context) as uploader:
        with pytest.raises(ValueError, match="'picture' has 2 levels, and 1 were given"):
            uploader.chain(image, [good[:1]])
        with pytest.raises(ValueError, match="'picture' has 1 layers, and 2 were given"):
            uploader.chain(image, [good, good])
        with pytest.raises(
            ValueError, match=r"Level 0 of 'picture' wants \(1, 16\) uint8, not \(1, 8\) uint8"
        ):
            uploader.chain(image, [good[::-1]])
        with pytest.raises(ValueError, match="'picture' holds blocks, not pixels"):
            uploader.image(image, np.zeros((4, 5), np.uint8))
    destroy_image(gl_context, image)
