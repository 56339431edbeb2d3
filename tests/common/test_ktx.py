"""KTX files: laid out as the specification says, read back as written, and refused in one sentence where broken."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from common.errors import UserError
from common.images.blocks import encode_chain, stored_shape
from common.images.ktx import FORMATS, Ktx, decode_ktx, encode_ktx, read_ktx, write_ktx
from common.images.mips import mip_chain
from tests.support.block_pictures import pictures


def random_texture(format, width, height, levels=1, layers=1, **more) -> Ktx:
    random = np.random.default_rng(4)
    shapes = [
        stored_shape(format, max(1, width >> n), max(1, height >> n), FORMATS[format].texel)
        for n in range(levels)
    ]
    made = tuple(tuple(random.integers(0, 256, shape, np.uint8) for shape in shapes) for _ in range(layers))
    return Ktx(format, width, height, made, **more)


def same(one: Ktx, other: Ktx) -> bool:
    head = [(t.format, t.width, t.height, t.cube, t.elements, dict(t.metadata)) for t in (one, other)]
    pairs = zip(one.layers, other.layers, strict=True)
    return head[0] == head[1] and all(
        np.array_equal(a, b) for first, second in pairs for a, b in zip(first, second, strict=True)
    )


@pytest.mark.feature("textures/etc2-ktx")
@pytest.mark.parametrize("size", [(64, 32), (61, 37), (5, 3), (1, 1)])
@pytest.mark.needs("etcpak")
def test_an_etc2_texture_has_the_size_of_its_blocks(tmp_path, size):
    """8*ceil(w/4)*ceil(h/4) bytes a level, and a header; it comes back as it was."""
    width, height = size
    levels = encode_chain(mip_chain(pictures(width, height)["smooth"], True), "etc2_srgb")
    texture = Ktx("etc2_srgb", width, height, (levels,), metadata={})
    path = tmp_path / "blätter.ktx"
    write_ktx(path, texture)
    sizes = [8 * -(-max(1, width >> n) // 4) * -(-max(1, height >> n) // 4) for n in range(len(levels))]
    assert [rows.nbytes for rows in levels] == sizes
    assert path.stat().st_size == 64 + sum(4 + size for size in sizes)
    assert same(read_ktx(path), texture)


@pytest.mark.feature("textures/etc2-ktx")
def test_the_header_is_that_of_the_specification():
    data = encode_ktx(random_texture("etc2", 20, 8, levels=2))
    assert data[:12] == bytes([0xAB, 0x4B, 0x54, 0x58, 0x20, 0x31, 0x31, 0xBB, 0x0D, 0x0A, 0x1A, 0x0A])
    pair = b"KTXorientation\0S=r,T=d\0"
    rest = [0, 1, 0, 0x9274, 0x1907, 20, 8, 0, 0, 1, 2, 4 + len(pair) + -len(pair) % 4]
    assert struct.unpack_from("<13I", data, 12) == (0x04030201, *rest)
    assert data[64:68] == struct.pack("<I", len(pair)) and data[68 : 68 + len(pair)] == pair
    first = 64 + rest[-1]
    assert struct.unpack_from("<I", data, first) == (8 * 5 * 2,)
    assert struct.unpack_from("<I", data, first + 4 + 80) == (8 * 3 * 1,)
    assert len(data) == first + 4 + 80 + 4 + 24


def test_rows_of_texels_are_padded_to_four_bytes():
    texture = random_texture("r8", 5, 3, metadata={})
    data = encode_ktx(texture)
    assert len(data) == 64 + 4 + 3 * 8
    assert struct.unpack_from("<I", data, 64) == (24,)
    for row in range(3):
        assert data[68 + 8 * row :][:8] == texture.layers[0][0][row].tobytes() + bytes(3)
    assert same(decode_ktx(data), texture)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("format", FORMATS)
def test_every_format_comes_back_from_either_order_of_bytes(format, big_endian):
    texture = random_texture(format, 7, 6, levels=3)
    data = encode_ktx(texture, big_endian)
    assert data[12:16] == (b"\4\3\2\1" if big_endian else b"\1\2\3\4")
    assert same(decode_ktx(data), texture)


def test_words_of_the_other_order_are_turned_and_blocks_are_not():
    half = Ktx("rgba16f", 1, 1, ((np.arange(8, dtype=np.uint8)[None],),), metadata={})
    assert encode_ktx(half, True)[68:] == bytes([1, 0, 3, 2, 5, 4, 7, 6])
    block = random_texture("bc7", 4, 4, metadata={})
    assert encode_ktx(block, True)[68:] == encode_ktx(block)[68:]


def test_arrays_and_cubes_come_back():
    for more in (
        {"layers": 3},
        {"layers": 1, "array": True},
        {"layers": 6, "cube": True},
        {"layers": 12, "cube": True},
    ):
        texture = random_texture("rgba8", 6, 6, levels=2, **more)
        assert same(decode_ktx(encode_ktx(texture)), texture)
    cube = encode_ktx(random_texture("rgba8", 6, 6, layers=6, cube=True, metadata={}))
    assert struct.unpack_from("<I", cube, 64) == (144,), "a cube's size is that of one face"
    with pytest.raises(ValueError, match="5 layers are no whole number of textures of 6"):
        encode_ktx(random_texture("rgba8", 6, 6, layers=5, cube=True))
    with pytest.raises(ValueError, match="the levels of a layer are"):
        encode_ktx(Ktx("rgba8", 6, 6, ((np.zeros((6, 23), np.uint8),),)))


GOOD = encode_ktx(random_texture("bc4", 8, 8, levels=3))


@pytest.mark.feature("textures/etc2-ktx")
@pytest.mark.parametrize(
    ("at", "word", "says"),
    [
        (0, 0, "it is no KTX file"),
        (12, 7, "its header names no order of bytes"),
        (16, 0x1401, "its header contradicts itself about the texels of bc4"),
        (28, 0x1234, "its format 0x1234 is none of r8, rg8"),
        (36, 0, "it claims 0x8 texels in 1 layers"),
        (36, 1 << 31, "it claims 2147483648x8 texels"),
        (40, 0, "it holds no 2D texture"),
        (44, 5, "it holds no 2D texture"),
        (48, 1 << 30, "in 1073741824 layers"),
        (48, 4000, "it ends within mip level 0"),
        (52, 3, "it claims 3 faces of 8x8 texels"),
        (56, 0, "it holds no mip levels"),
        (56, 9, "it claims 9 mip levels of 8x8 texels"),
        (56, 4, "it ends within mip level 3"),
        (60, 1 << 31, "it ends within its metadata"),
        (64, 1 << 31, "its metadata is broken"),
        (92, 31, "its mip level 0 has another size than 8x8 texels give"),
    ],
)
def test_a_broken_file_is_one_sentence(tmp_path, at, word, says):
    path = tmp_path / "broken.ktx"
    path.write_bytes(GOOD[:at] + struct.pack("<I", word) + GOOD[at + 4 :])
    with pytest.raises(UserError) as caught:
        read_ktx(path)
    text = str(caught.value)
    assert text.startswith(f"{path} cannot be read: ") and says in text and "\n" not in text


def test_a_file_that_is_cut_off_anywhere_is_refused():
    for end in range(len(GOOD)):
        with pytest.raises(ValueError):
            decode_ktx(GOOD[:end])
    assert decode_ktx(GOOD).levels == 3


def test_what_is_no_file_is_a_sentence(tmp_path):
    with pytest.raises(UserError, match="there is no file"):
        read_ktx(tmp_path / "none.ktx")
    with pytest.raises(UserError, match="is a folder"):
        read_ktx(tmp_path)
    with pytest.raises(UserError, match="cannot be written"):
        write_ktx(tmp_path / "none" / "a.ktx", random_texture("bc4", 4, 4))
    (tmp_path / "two.ktx").write_bytes(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(100))
    with pytest.raises(UserError, match="only KTX 1 is read"):
        read_ktx(tmp_path / "two.ktx")
