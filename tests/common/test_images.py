"""Pictures survive their files; what is wrong with a file or a path is one sentence."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from common import images
from common.errors import UserError
from common.images import color, read_image, read_layers, write_image, write_layers
from common.images.bitmap import Bitmap
from common.images.png16 import SIGNATURE, decode_png16, encode_png16

RNG = np.random.default_rng(1)


@pytest.mark.feature("images/io")
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("size", [(2, 3), (1, 1), (33, 17)])
def test_png_round_trip_is_exact(tmp_path, kind, channels, size):
    image = RNG.integers(0, np.iinfo(kind).max, (*size, channels), endpoint=True).astype(kind)
    write_image(tmp_path / "a.png", image)
    back = read_image(tmp_path / "a.png")
    assert back.dtype == kind and np.array_equal(back, image)
    assert [p.name for p in tmp_path.iterdir()] == ["a.png"]  # no temporary is left behind
    seen = np.asarray(Image.open(tmp_path / "a.png").convert("RGBA"))  # upright for others too
    if channels == 4:
        assert np.array_equal(seen, image if kind == np.uint8 else image >> 8)


def naive_filter(kind, row, above, size):
    """One line by the recommendation, byte by byte."""
    out = bytearray([kind])
    for i, value in enumerate(row):
        left = row[i - size] if i >= size else 0
        corner = above[i - size] if i >= size else 0
        estimate = left + above[i] - corner
        distances = [abs(estimate - left), abs(estimate - above[i]), abs(estimate - corner)]
        paeth = (left, above[i], corner)[distances.index(min(distances))]
        out.append((value - (0, left, above[i], (left + above[i]) // 2, paeth)[kind]) % 256)
    return bytes(out)


def make_png(width, height, color_type, raw, depth=16, interlaced=0, data=None):
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, depth, color_type, 0, 0, interlaced)
    packed = zlib.compress(raw) if data is None else data
    parts = (
        chunk(b"IHDR", header),
        chunk(b"IDAT", packed[:7]),
        chunk(b"IDAT", packed[7:]),
        chunk(b"IEND", b""),
    )
    return SIGNATURE + b"".join(parts)


@pytest.mark.parametrize("channels", [2, 3, 4])
def test_every_png_filter_is_undone(channels):
    image = RNG.integers(0, 65536, (15, 9, channels)).astype(np.uint16)
    image[5:] //= 700  # small steps, where the predictors tie
    rows = [row.astype(">u2").tobytes() for row in image]
    above = [bytes(len(rows[0])), *rows]
    raw = b"".join(naive_filter(y % 5, row, above[y], 2 * channels) for y, row in enumerate(rows))
    assert np.array_equal(decode_png16(make_png(9, 15, {2: 4, 3: 2, 4: 6}[channels], raw)), image)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "no PNG"),
        (SIGNATURE, "no header"),
        (encode_png16(np.ones((4, 4, 3), np.uint16))[:-20], "cut off|ends before"),
        (encode_png16(np.ones((4, 4, 3), np.uint16)).replace(b"IDAT", b"IDAU"), "fails the checksum"),
        (make_png(4, 4, 2, bytes(10)), "ends before its last line"),
        (make_png(4, 4, 2, b"", data=b"nonsense"), "compressed data is broken"),
        (make_png(4, 4, 2, bytes([9]) * 200), "filter that does not exist"),
        (make_png(4, 4, 2, bytes(200), interlaced=1), "interlaced"),
        (make_png(4, 4, 5, bytes(200)), "does not exist"),
        (make_png(2**31, 2**31, 2, bytes(200)), "it claims"),
    ],
)
def test_broken_png16(data, reason):
    with pytest.raises(ValueError, match=reason):
        decode_png16(data)


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.needs("OpenEXR")
def test_exr_round_trip_is_exact(tmp_path, kind, channels):
    image = (RNG.normal(size=(7, 5, channels)) * 1e3).astype(kind)
    image[0, 0] = [np.nan, np.inf, -np.inf, -0.0][:channels]
    write_image(
        tmp_path / "a.exr", image[:, ::-1]
    )  # a view with negative strides, which the package writes wrongly
    back = read_image(tmp_path / "a.exr")
    assert back.dtype == kind and back.tobytes() == image[:, ::-1].tobytes()


@pytest.mark.needs("OpenEXR")
def test_exr_layers(tmp_path):
    layers = {
        "": RNG.random((4, 6, 4)).astype(np.float32),
        "normal": RNG.random((4, 6, 3)).astype(np.float16),
        "motion": RNG.random((4, 6, 2)).astype(np.float32),
        "instance_id": RNG.integers(0, 2**32, (4, 6, 1)).astype(np.uint32),
    }
    write_layers(tmp_path / "a.exr", layers)
    back = read_layers(tmp_path / "a.exr")
    assert back.keys() == layers.keys()
    for name, layer in layers.items():
        assert back[name].dtype == layer.dtype and np.array_equal(back[name], layer)
    with pytest.raises(ValueError, match="one size"):
        write_layers(tmp_path / "b.exr", {"": layers[""], "x": layers["motion"][1:]})
    write_layers(tmp_path / "c.exr", {"only": layers["motion"]})
    with pytest.raises(UserError, match="no unnamed layer, only only"):
        read_image(tmp_path / "c.exr")


def test_without_the_package_exr_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)
    for call in (
        lambda p: write_image(p, np.zeros((2, 2, 3), np.float32)),
        images.check_writable,
        read_image,
    ):
        with pytest.raises(UserError, match="pip install OpenEXR"):
            call(tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("a.bmp", "cannot be written as a picture: name .png, .exr or .hdr"),
        ("a", "cannot be written as a picture"),
        ("missing/a.png", "there is no folder"),
        ("folder.png", "is a folder: name a file in it"),
    ],
)
def test_unwritable_paths(tmp_path, name, sentence):
    (tmp_path / "folder.png").mkdir()
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(UserError) as error:
        write_image(tmp_path / name, np.zeros((2, 2, 3), np.uint8))
    assert sentence in str(error.value) and "\n" not in str(error.value)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def full(*_args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("common.paths.os.replace", full)
    with pytest.raises(UserError, match=r"a\.png cannot be written: No space left on device"):
        write_image(path, np.zeros((2, 2, 3), np.uint8))
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


@pytest.mark.feature("images/io")
@pytest.mark.parametrize(
    ("name", "data", "sentence"),
    [
        ("a.png", None, "there is no file"),
        ("a.png", b"", "broken or of another kind"),
        ("a.png", b"\x89PNG\r\n\x1a\n" + bytes(50), "broken or of another kind"),
        ("a.jpg", b"\xff\xd8\xff\xe0" + bytes(50), "broken or of another kind"),
        ("a.hdr", b"PNG", "it does not begin with #?RADIANCE"),
        ("a.gif", b"GIF89a", "not of a kind that can be read"),
        pytest.param("a.exr", b"v/1\1 broken", "broken or no EXR", marks=pytest.mark.needs("OpenEXR")),
        ("d.png", "folder", "is a folder"),
        pytest.param("d.exr", "folder", "is a folder", marks=pytest.mark.needs("OpenEXR")),
    ],
)
def test_unreadable_files(tmp_path, name, data, sentence):
    if data == "folder":
        (tmp_path / name).mkdir()
    elif data is not None:
        (tmp_path / name).write_bytes(data)
    with pytest.raises(UserError) as error:
        read_image(tmp_path / name)
    assert sentence in str(error.value) and "\n" not in str(error.value)


@pytest.mark.needs("OpenEXR")
def test_truncated_files_of_every_kind(tmp_path):
    noise = RNG.random((40, 30, 3))
    for name, image in (
        ("a.png", color.quantize(noise)),
        ("b.png", color.quantize(noise, 16)),
        ("c.exr", noise.astype(np.float32)),
        ("d.hdr", noise),
    ):
        write_image(tmp_path / name, image)
        whole = (tmp_path / name).read_bytes()
        for part in (0.1, 0.5, 0.9):
            (tmp_path / name).write_bytes(whole[: int(len(whole) * part)])
            with pytest.raises(UserError, match="cannot be read"):
                read_image(tmp_path / name)


def test_jpeg_and_palette_files_are_read(tmp_path):
    smooth = np.tile(np.linspace(0, 255, 64).astype(np.uint8)[:, None, None], (1, 64, 3))
    Image.fromarray(smooth).save(tmp_path / "a.jpg", quality=95)
    back = read_image(tmp_path / "a.jpg")
    assert back.shape == (64, 64, 3) and np.abs(back.astype(int) - smooth).max() <= 3
    Image.fromarray(smooth).quantize(4).save(tmp_path / "p.png")
    assert read_image(tmp_path / "p.png").shape == (64, 64, 3)


def test_arrays_that_a_format_cannot_hold(tmp_path):
    for name, image in (
        ("a.png", np.zeros((2, 2, 3), np.float32)),
        ("a.png", np.zeros((2, 2, 5), np.uint8)),
        ("a.hdr", np.zeros((2, 2, 4), np.float32)),
        ("a.hdr", np.zeros((2, 2, 3), np.uint8)),
        ("a.png", np.zeros((0, 2, 3), np.uint8)),
        ("a.png", np.zeros(3, np.uint8)),
    ):
        with pytest.raises(ValueError):
            write_image(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


@pytest.mark.feature("images/srgb-transfer")
def test_srgb_round_trips():
    """The CPU half; the shader functions are tested against these."""
    bytes_ = np.arange(256)
    for encode, decode in ((color.encode_srgb, color.decode_srgb), (color.encode_gamma, color.decode_gamma)):
        linear = np.linspace(0, 4, 10_001)
        assert np.abs(decode(encode(linear)) - linear).max() < 1e-7
        assert np.array_equal(color.quantize(encode(decode(bytes_ / 255))), bytes_)
        assert np.allclose(encode(-linear), -encode(linear))
    assert np.array_equal(color.quantize(color.encode_srgb(color.srgb8_table())), bytes_)


@pytest.mark.feature("images/srgb-transfer")
def test_srgb_has_the_values_of_the_standard():
    assert color.encode_srgb(0.5) == pytest.approx(0.735357, abs=1e-6)
    assert color.decode_srgb(0.5) == pytest.approx(0.214041, abs=1e-6)
    assert (
        color.encode_srgb([0, 1]).tolist() == pytest.approx([0, 1])
        and color.decode_srgb(0.04) == 0.04 / 12.92
    )
    linear = np.linspace(0, 1, 100_001)
    apart = np.abs(color.encode_srgb(linear) - color.encode_gamma(linear))
    assert 0.03 < apart.max() < 0.034  # what the approximation costs
    assert (
        np.abs(np.diff(color.encode_srgb(np.linspace(0.003, 0.0033, 1001)))).max() < 1e-5
    )  # no jump at the joint


def test_quantize():
    assert color.quantize([-1, 0, 0.5, 1, 2, np.nan, np.inf]).tolist() == [0, 0, 128, 255, 255, 0, 255]
    assert (
        color.quantize([0.25, 1], 16).tolist() == [16384, 65535] and color.quantize(1, 16).dtype == np.uint16
    )


@pytest.mark.feature("images/bitmap")
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
@pytest.mark.parametrize("faces", [(), (6,)])
def test_bitmap_pixels_round_trip(kind, faces):
    bitmap = Bitmap(np.zeros((*faces, 3, 5, 4), kind))
    assert bitmap.is_cube == bool(faces) and bitmap.size == (5, 3)
    for face in range(6 if faces else 1):
        values = RNG.integers(0, 256, (3, 5, 4)) / 255 if kind == np.uint8 else RNG.normal(size=(3, 5, 4))
        for y in range(3):
            for x in range(5):
                bitmap.set(x, y, values[y, x], face)
        expected = values if kind == np.uint8 else values.astype(np.float32)
        y, x = np.mgrid[:3, :5]
        assert np.array_equal(bitmap.get(x, y, face), expected)
    for x, y, face in ((5, 0, 0), (-1, 0, 0), (0, 3, 0), (0, 0, 6 if faces else 1)):
        with pytest.raises(IndexError):
            bitmap.get(x, y, face)


@pytest.mark.feature("images/bitmap")
@pytest.mark.parametrize("faces", [(), (6,)])
def test_bilinear_samples(faces):
    width, height = 5, 3
    bitmap = Bitmap(RNG.normal(size=(*faces, height, width, 2)).astype(np.float32))
    face = 4 if faces else 0
    y, x = np.mgrid[:height, :width]
    texels = bitmap.get(x, y, face)
    assert np.allclose(bitmap.sample((x + 0.5) / width, (y + 0.5) / height, face), texels, atol=1e-15)
    t = np.linspace(0, 1, 9)[:, None]
    between = bitmap.sample((1.5 + t[:, 0]) / width, 1.5 / height, face)
    assert np.allclose(between, (1 - t) * texels[1, 1] + t * texels[1, 2])
    down = bitmap.sample(2.5 / width, (0.5 + t[:, 0]) / height, face)
    assert np.allclose(down, (1 - t) * texels[0, 2] + t * texels[1, 2])
    seam = bitmap.sample((4.5 + t[:, 0]) / width, 0.5 / height, face)
    assert np.allclose(seam, (1 - t) * texels[0, 4] + t * texels[0, 0])  # u wraps
    assert np.allclose(bitmap.sample((2.5 + 5 * 3) / width, 0.5 / height, face), texels[0, 2])
    for v, row in ((-0.4, 0), (0.0, 0), (1.0, 2), (7.0, 2)):
        assert np.allclose(bitmap.sample(2.5 / width, v, face), texels[row, 2])  # v ends
    corner = bitmap.sample(2.0 / width, 1.0 / height, face)
    assert np.allclose(corner, texels[:2, 1:3].reshape(4, 2).mean(axis=0))


def test_bitmap_refuses_other_shapes():
    for texels in (
        np.zeros((2, 2)),
        np.zeros((5, 2, 2, 3), np.uint8),
        np.zeros((2, 2, 3)),
        np.zeros((0, 2, 3), np.uint8),
    ):
        with pytest.raises(ValueError, match="bitmap"):
            Bitmap(texels)
