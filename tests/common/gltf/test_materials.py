"""Materials, textures, samplers and images: every property of the file arrives, every kind of picture is decoded."""

from __future__ import annotations

import base64
import io
import math
import struct
import threading
import zlib

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from common.errors import SceneError
from common.gltf import images as decoder
from common.gltf import load_scene
from common.gltf.images import MAX_SIDE
from common.paths import asset_dir
from common.scene import EncodedImage, Sampler
from tests.common.gltf.builder import TRIANGLE, Gltf
from tests.support.timing import PATIENCE_S, until


def textured(*images: bytes, **material) -> Gltf:
    """A triangle whose material samples the first image, unless it says otherwise."""
    gltf = Gltf()
    for data in images:
        gltf.add("textures", {"source": gltf.add("images", {"bufferView": gltf.view(data)})})
    gltf.add("materials", material or {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, material=0))
    return gltf


def encoded(pixels, mode=None, form="PNG", **options) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(np.asarray(pixels), mode).save(stream, form, **options)
    return stream.getvalue()


RGBA = np.random.default_rng(5).integers(0, 256, (5, 7, 4), np.uint8)


def test_every_property(tmp_path):
    images = [encoded(RGBA + number) for number in range(5)]
    info = [{"index": number, "texCoord": number % 2} for number in range(5)]
    gltf = textured(
        *images,
        name="paint",
        pbrMetallicRoughness={
            "baseColorFactor": [0.1, 0.2, 0.3, 0.4],
            "metallicFactor": 0.5,
            "roughnessFactor": 0.25,
            "baseColorTexture": info[0],
            "metallicRoughnessTexture": info[1],
        },
        normalTexture={**info[2], "scale": 0.75},
        occlusionTexture={**info[3], "strength": 0.5},
        emissiveTexture=info[4],
        emissiveFactor=[1, 0.5, 0.25],
        alphaMode="MASK",
        alphaCutoff=0.3,
        doubleSided=True,
        extensions={"KHR_materials_emissive_strength": {"emissiveStrength": 8}, "KHR_materials_unlit": {}},
    )
    for use_library in (True, False):
        scene = load_scene(gltf.write(tmp_path), use_library=use_library)
        material = scene.materials[0]
        assert material.name == "paint"
        assert material.base_color == (0.1, 0.2, 0.3, 0.4)
        assert (material.metallic, material.roughness) == (0.5, 0.25)
        assert material.emissive == (8, 4, 2)
        assert (material.normal_scale, material.occlusion_strength) == (0.75, 0.5)
        assert (material.alpha_mode, material.alpha_cutoff) == ("mask", 0.3)
        assert material.double_sided
        assert material.unlit
        textures = material.textures()
        roles = ["base_color", "metallic_roughness", "normal", "occlusion", "emissive"]
        assert list(textures) == roles
        assert [textures[role].image for role in roles] == [0, 1, 2, 3, 4]
        assert [textures[role].uv_set for role in roles] == [0, 1, 0, 1, 0]
        for number, image in enumerate(scene.images):
            assert np.array_equal(image.pixels, RGBA + number)


def test_defaults_are_the_standards(tmp_path):
    material = load_scene(textured(encoded(RGBA), name="x").write(tmp_path)).materials[0]
    assert material.base_color == (1, 1, 1, 1)
    assert (material.metallic, material.roughness, material.alpha_cutoff) == (1, 1, 0.5)
    assert material.emissive == (0, 0, 0)
    assert (material.alpha_mode, material.double_sided, material.unlit) == ("opaque", False, False)
    assert material.textures() == {}


def test_factors_out_of_range_are_clipped(tmp_path):
    gltf = textured(
        encoded(RGBA),
        pbrMetallicRoughness={"baseColorFactor": [2, -1, 0.5, 9], "metallicFactor": -1, "roughnessFactor": 7},
        emissiveFactor=[-1, 2, 0],
    )
    material = load_scene(gltf.write(tmp_path)).materials[0]
    assert material.base_color == (1, 0, 0.5, 1)
    assert (material.metallic, material.roughness) == (0, 1)
    assert material.emissive == (0, 2, 0)


@pytest.mark.parametrize(
    ("sampler", "expected"),
    [
        ({}, Sampler()),
        ({"magFilter": 9728, "minFilter": 9728}, Sampler("nearest", "nearest", None)),
        ({"magFilter": 9729, "minFilter": 9729}, Sampler("linear", "linear", None)),
        ({"minFilter": 9984}, Sampler("linear", "nearest", "nearest")),
        ({"minFilter": 9985}, Sampler("linear", "linear", "nearest")),
        ({"minFilter": 9986}, Sampler("linear", "nearest", "linear")),
        ({"minFilter": 9987}, Sampler("linear", "linear", "linear")),
        ({"wrapS": 33071, "wrapT": 33648}, Sampler(wrap_u="clamp", wrap_v="mirror")),
        ({"wrapS": 10497, "wrapT": 33071}, Sampler(wrap_u="repeat", wrap_v="clamp")),
    ],
)
def test_samplers(tmp_path, sampler, expected):
    gltf = textured(encoded(RGBA))
    gltf.json["textures"][0]["sampler"] = gltf.add("samplers", sampler)
    assert load_scene(gltf.write(tmp_path)).materials[0].base_color_texture.sampler == expected


def test_texture_transform(tmp_path):
    transform = {"offset": [0.1, 0.2], "rotation": 0.5, "scale": [2, 3], "texCoord": 1}
    info = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    gltf = textured(encoded(RGBA), pbrMetallicRoughness={"baseColorTexture": info})
    texture = load_scene(gltf.write(tmp_path)).materials[0].base_color_texture
    assert (texture.offset, texture.rotation, texture.scale, texture.uv_set) == ((0.1, 0.2), 0.5, (2, 3), 1)
    c, s = math.cos(0.5), math.sin(0.5)
    expected = np.array([[1, 0, 0.1], [0, 1, 0.2]]) @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] @ np.diag([2, 3, 1])
    assert np.allclose(texture.matrix(), expected)


def test_higher_uv_sets_take_the_free_places(tmp_path):
    gltf = Gltf()
    for _ in range(2):
        gltf.image(np.zeros((1, 1, 3), np.uint8))
    for number in range(2):
        gltf.add("textures", {"source": number})
    gltf.add(
        "materials",
        {"emissiveTexture": {"index": 0, "texCoord": 3}, "occlusionTexture": {"index": 1, "texCoord": 1}},
    )
    sets = {f"TEXCOORD_{n}": np.full((3, 2), n, "f4") for n in range(4)}
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, material=0, **sets))
    scene = load_scene(gltf.write(tmp_path))
    values = [scene.uv0[0, 0], scene.uv1[0, 0]]
    assert values[scene.materials[0].emissive_texture.uv_set] == 3
    assert values[scene.materials[0].occlusion_texture.uv_set] == 1


def test_a_texture_without_a_readable_source_is_left_out(tmp_path):
    gltf = textured(encoded(RGBA))
    gltf.json["textures"][0] = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    gltf.json["extensionsUsed"] = ["KHR_texture_basisu"]
    scene = load_scene(gltf.write(tmp_path))
    assert scene.materials[0].textures() == {}
    assert len(scene.warnings) == 2


def test_one_image_for_many_uses_is_decoded_once(tmp_path):
    gltf = textured(encoded(RGBA), emissiveTexture={"index": 0}, occlusionTexture={"index": 0})
    gltf.add("materials", {"emissiveTexture": {"index": 0}})
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, material=1))
    assert len(load_scene(gltf.write(tmp_path)).images) == 1


GREY = RGBA[..., 0]
WIDE = GREY.astype(np.uint16) * 257 + 3


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (encoded(RGBA), RGBA),
        (encoded(RGBA[..., :3]), np.dstack([RGBA[..., :3], np.full((5, 7), 255)])),
        (encoded(GREY), np.dstack([GREY] * 3 + [np.full((5, 7), 255)])),
        (encoded(RGBA[..., :2], "LA"), np.dstack([RGBA[..., 0]] * 3 + [RGBA[..., 1]])),
        (encoded(WIDE), np.dstack([WIDE] * 3 + [np.full((5, 7), 65535)])),
        (encoded(GREY > 99), np.dstack([(GREY > 99) * 255] * 3 + [np.full((5, 7), 255)])),
    ],
    ids=["rgba", "rgb", "grey", "grey-alpha", "grey-16", "bits"],
)
@pytest.mark.filterwarnings("ignore:'mode' parameter:DeprecationWarning")
def test_kinds_of_png(tmp_path, data, expected):
    image = load_scene(textured(data).write(tmp_path)).images[0]
    assert image.pixels.dtype == (np.uint16 if expected.max() > 255 else np.uint8)
    assert np.array_equal(image.pixels, expected)
    later = load_scene(textured(data).write(tmp_path), decode=False).images[0]
    assert (later.dtype, later.height, later.width) == (image.dtype, 5, 7)


def test_palette_with_transparency(tmp_path):
    picture = Image.fromarray((GREY % 3).astype(np.uint8), "P")
    picture.putpalette([255, 0, 0, 0, 255, 0, 0, 0, 255])
    stream = io.BytesIO()
    picture.save(stream, "PNG", transparency=bytes([255, 128, 0]))
    pixels = load_scene(textured(stream.getvalue()).write(tmp_path)).images[0].pixels
    table = np.array([(255, 0, 0, 255), (0, 255, 0, 128), (0, 0, 255, 0)])
    assert np.array_equal(pixels, table[GREY % 3])


def test_a_transparent_colour(tmp_path):
    """A PNG may name one colour that is seen through, instead of having a channel for that."""
    colors = np.array([(255, 0, 0), (0, 255, 0), (0, 0, 255)], np.uint8)[GREY % 3]
    stream = io.BytesIO()
    Image.fromarray(colors).save(stream, "PNG", transparency=(0, 255, 0))
    pixels = load_scene(textured(stream.getvalue()).write(tmp_path)).images[0].pixels
    assert np.array_equal(pixels, np.dstack([colors, np.where(GREY % 3 == 1, 0, 255)]))


@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK"])
def test_kinds_of_jpeg(tmp_path, mode):
    ramp = np.zeros((16, 16, 3), np.uint8)
    ramp[:] = 60
    ramp[:, 8:] = 200
    stream = io.BytesIO()
    Image.fromarray(ramp).convert(mode).save(stream, "JPEG", quality=95)
    pixels = load_scene(textured(stream.getvalue()).write(tmp_path)).images[0].pixels
    assert pixels.shape == (16, 16, 4)
    assert np.abs(pixels[..., :3].astype(int) - ramp).max() < 8
    assert (pixels[..., 3] == 255).all()


def in_chunks(data: bytes, size: int) -> bytes:
    """Return a PNG of one chunk of pixels with `size` bytes in each, as most programs write it, and a note between."""
    begin = data.index(b"IDAT") - 4
    length = struct.unpack(">I", data[begin : begin + 4])[0]
    stream, end = data[begin + 8 : begin + 8 + length], begin + 12 + length
    chunks = [b"tEXta\0b", *(b"IDAT" + stream[at : at + size] for at in range(0, length, size))]
    packed = (struct.pack(">I", len(one) - 4) + one + struct.pack(">I", zlib.crc32(one)) for one in chunks)
    return data[:begin] + b"".join(packed) + data[end:]


def test_a_png_in_many_chunks_is_read_at_once(tmp_path, monkeypatch):
    """Between chunks Pillow is Python, for which threads that decode and one that draws would wait for each other."""
    noise, reads = np.random.default_rng(7).integers(0, 256, (40, 40, 3), np.uint8), []
    read = PngImageFile.load_read
    monkeypatch.setattr(
        PngImageFile, "load_read", lambda self, count: reads.append(count) or read(self, count)
    )
    data = in_chunks(encoded(noise), 100)
    assert data.count(b"IDAT") > 30
    pixels = load_scene(textured(data).write(tmp_path)).images[0].pixels
    assert np.array_equal(pixels[..., :3], noise) and (pixels[..., 3] == 255).all()
    assert len(reads) <= 2
    with pytest.raises(SceneError, match="is damaged"):
        load_scene(textured(data[:-400]).write(tmp_path))


@pytest.mark.parametrize(("channels", "form"), [(3, "PNG"), (4, "PNG"), (3, "JPEG")])
def test_colours_are_decoded_to_where_they_stay(tmp_path, monkeypatch, channels, form):
    """Out of an image of Pillow's own, pixels would be copied while no other thread runs Python."""

    def never(*_: object, **__: object) -> None:
        raise AssertionError("the pixels are copied out of an image")

    path = textured(encoded(RGBA[..., :channels], form=form)).write(tmp_path)
    with Image.open(io.BytesIO(encoded(RGBA[..., :channels], form=form))) as picture:
        expected = np.asarray(picture.convert("RGBA"))
    for name in ("crop", "convert", "tobytes"):
        monkeypatch.setattr(Image.Image, name, never)
    assert np.array_equal(load_scene(path).images[0].pixels, expected)


def png_header(width: int, height: int) -> bytes:
    """A PNG that says how large it is and holds one row of nothing."""
    header = struct.pack(">II5B", width, height, 8, 6, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(4))), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


def jpeg_header(width: int, height: int) -> bytes:
    data = bytearray(encoded(RGBA[..., :3], form="JPEG"))
    place = data.index(b"\xff\xc0")
    struct.pack_into(">HH", data, place + 5, height, width)
    return bytes(data)


@pytest.mark.parametrize("make", [png_header, jpeg_header])
@pytest.mark.parametrize("size", [(30_000, 30_000), (30_000, 1), (1, 30_000), (MAX_SIDE, MAX_SIDE)])
def test_huge_images_are_refused_before_they_are_decoded(tmp_path, monkeypatch, make, size):
    monkeypatch.setattr(Image, "open", lambda *_, **__: pytest.fail("the image was opened"))
    with pytest.raises(
        SceneError, match=rf"images\[0\] is {size[0]} x {size[1]} pixels, .*; make the image smaller"
    ):
        load_scene(textured(make(*size)).write(tmp_path))


@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"GIF89a" + bytes(20), "neither a PNG nor a JPEG"),
        (b"\x89PNG\r\n\x1a\n", "neither a PNG nor a JPEG"),
        (b"\xff\xd8\xff", "damaged JPEG"),
        (b"\xff\xd8" + b"\xff\xe0\x00\x00" * 50, "damaged JPEG"),
        (png_header(0, 5), "has no pixels"),
        (png_header(64, 64), "is damaged"),
        (encoded(RGBA)[:-30], "is damaged"),
        (encoded(RGBA[..., :3], form="JPEG")[:-200], "is damaged"),
        (
            b"\xff\xd8"
            + jpeg_header(9, 9)[jpeg_header(9, 9).index(b"\xff\xc0") :][:19]
            + encoded(RGBA[..., :3], form="JPEG")[2:],
            "two sizes",
        ),
    ],
)
def test_damaged_images_are_named(tmp_path, data, fault):
    with pytest.raises(SceneError, match=rf"images\[0\] .*{fault}"):
        load_scene(textured(data).write(tmp_path))


def test_missing_image_is_refused_by_name(tmp_path):
    gltf = textured(encoded(RGBA))
    gltf.json["images"][0] = {"uri": "wood%20grain.png"}
    with pytest.raises(SceneError, match=r"images\[0\]\.uri names the file wood grain.png, which is missing"):
        load_scene(gltf.write(tmp_path))
    gltf.json["images"][0] = {}
    with pytest.raises(SceneError, match=r"images\[0\] has neither uri nor bufferView"):
        load_scene(gltf.write(tmp_path))


def test_images_come_from_files_and_data_uris(tmp_path):
    gltf = textured(encoded(RGBA), emissiveTexture={"index": 0}, normalTexture={"index": 1})
    (tmp_path / "wood.png").write_bytes(encoded(RGBA))
    gltf.add("textures", {"source": 1})
    gltf.json["images"] = [
        {"uri": "wood.png"},
        {"uri": "data:image/png;base64," + base64.b64encode(encoded(GREY)).decode()},
    ]
    images = load_scene(gltf.write(tmp_path, "gltf")).images
    assert [image.name for image in images] == ["wood", ""]
    assert np.array_equal(images[0].pixels, RGBA)
    assert np.array_equal(images[1].pixels[..., 0], GREY)


def test_images_are_decoded_on_threads_and_keep_their_order(tmp_path, monkeypatch):
    """The first image waits for the last, so that only a second thread can let the file load."""
    decode, last_done, names = decoder._decode, threading.Event(), []

    def slow(data, size, place):
        if place == "images[0]":
            assert last_done.wait(PATIENCE_S), "images are decoded one after another"
        pixels = decode(data, size, place)
        names.append(threading.current_thread().name)
        if place == "images[3]":
            last_done.set()
        return pixels

    monkeypatch.setattr(decoder, "_decode", slow)
    monkeypatch.setattr(decoder.os, "cpu_count", lambda: 4)
    pictures = [np.full_like(RGBA, value) for value in (10, 20, 30, 40)]
    uses = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}},
        "emissiveTexture": {"index": 2},
        "occlusionTexture": {"index": 3},
    }
    images = load_scene(textured(*map(encoded, pictures), **uses).write(tmp_path)).images
    assert [int(image.pixels[0, 0, 0]) for image in images] == [10, 20, 30, 40]
    assert len(set(names)) > 1 and all(name.startswith("decode-image") for name in names)


def test_images_decoded_later_are_the_same(tmp_path):
    """Their size and type are known before, by the header alone, and nothing is decoded twice."""
    both = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveTexture": {"index": 1}}
    path = textured(encoded(RGBA), encoded(WIDE), **both).write(tmp_path)
    now, later = load_scene(path).images, load_scene(path, decode=False).images
    for decoded, image in zip(now, later, strict=True):
        assert isinstance(image, EncodedImage)
        assert (image.name, image.width, image.height, image.dtype) == (
            decoded.name,
            decoded.width,
            decoded.height,
            decoded.dtype,
        )
        assert image.decode() is not image.decode(), "kept by whoever asks, not here"
        assert np.array_equal(image.decode(), decoded.pixels)
        assert image.pixels is image.pixels and np.array_equal(image.pixels, decoded.pixels)


def test_images_are_begun_before_somebody_asks(tmp_path, monkeypatch):
    """As many as are asked for: while the file is still read, by another thread, and once for who asks first."""
    decode, decoded = decoder._decode, []

    def noted(data, size, place):
        decoded.append((place, threading.current_thread().name.partition("_")[0]))
        return decode(data, size, place)

    monkeypatch.setattr(decoder, "_decode", noted)
    finish = decoder.ImageDecoder.finish

    def finished(self):
        until(lambda: decoded)
        return finish(self)

    monkeypatch.setattr(decoder.ImageDecoder, "finish", finished)
    both = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveTexture": {"index": 1}}
    path = textured(encoded(RGBA), encoded(RGBA[::-1]), **both).write(tmp_path)
    first, second = load_scene(path, decode=False, ahead=RGBA.size).images
    assert decoded == [("images[0]", "decode-image")]
    assert np.array_equal(first.decode(), RGBA) and len(decoded) == 1
    assert np.array_equal(second.decode(), RGBA[::-1]) and np.array_equal(first.decode(), RGBA)
    me = threading.current_thread().name.partition("_")[0]
    assert decoded[1:] == [("images[1]", me), ("images[0]", me)]


def test_what_is_begun_too_late_is_decoded_by_who_asks(tmp_path, monkeypatch):
    """Nobody waits for pixels when a file has been read: what no thread has taken up by then is given back."""
    gate, decode = threading.Event(), decoder._decode
    monkeypatch.setattr(decoder.os, "cpu_count", lambda: 1)

    def slow(data, size, place):
        if place == "images[0]":
            assert gate.wait(PATIENCE_S)
        return decode(data, size, place)

    monkeypatch.setattr(decoder, "_decode", slow)
    both = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "emissiveTexture": {"index": 1}}
    path = textured(encoded(RGBA), encoded(RGBA[::-1]), **both).write(tmp_path)
    first, second = load_scene(path, decode=False, ahead=1 << 20).images
    assert np.array_equal(second.decode(), RGBA[::-1]), "not behind the first"
    gate.set()
    assert np.array_equal(first.decode(), RGBA)


def test_a_damaged_image_that_was_begun_is_refused_when_somebody_asks(tmp_path):
    (image,) = load_scene(textured(encoded(RGBA)[:-30]).write(tmp_path), decode=False, ahead=1 << 20).images
    for _ in range(2):
        with pytest.raises(SceneError, match=r"images\[0\] .*is damaged"):
            image.decode()


def test_a_damaged_image_is_refused_in_the_same_words_when_it_is_decoded(tmp_path):
    path = textured(encoded(RGBA)[:-30]).write(tmp_path)
    with pytest.raises(SceneError) as now:
        load_scene(path)
    (image,) = load_scene(path, decode=False).images
    with pytest.raises(SceneError) as later:
        image.decode()
    assert str(later.value) == str(now.value) and str(path) in str(now.value)


def test_files_that_are_cut_short_before_images_are_decoded_end_nothing(tmp_path):
    """Where a file is mapped, reading behind its end is a signal that ends the process."""
    noise = np.random.default_rng(6).integers(0, 256, (96, 96, 4), np.uint8)
    path = textured(encoded(noise)).write(tmp_path)
    (image,) = load_scene(path, decode=False).images
    for file in tmp_path.iterdir():
        file.write_bytes(b"")
    assert np.array_equal(image.decode(), noise)


def test_no_thread_stays_behind(tmp_path):
    path = textured(*[encoded(RGBA)] * 4).write(tmp_path)
    load_scene(path)
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("decode-image")]


@pytest.mark.skipif(asset_dir() is None, reason="no models; set STRATA_ASSETS")
@pytest.mark.parametrize("name", ["Rotation", "Scale", "All"])
def test_transforms_of_the_sample_model_point_at_its_marks(name):
    """TextureTransformTest: the picture's arrow, which lies on the diagonal, must point at the mark 'Correct'."""
    scene = load_scene(asset_dir() / "models" / "TextureTransformTest" / "TextureTransformTest.gltf")
    quad, mark = scene.nodes.names.index(name), scene.nodes.names.index(f"{name} - Correct")
    row = scene.meshes[scene.instances.mesh[scene.instances.node == quad][0]]
    vertices = slice(row["first_vertex"], row["first_vertex"] + row["vertex_count"])
    plane = np.column_stack([scene.positions[vertices, :2], np.ones(row["vertex_count"])])
    uv_from_plane = np.linalg.lstsq(plane, scene.uv0[vertices], rcond=None)[0]
    uv = np.append(scene.nodes.translation[mark, :2], 1) @ uv_from_plane
    texture = scene.materials[row["material"]].base_color_texture
    assert np.allclose(texture.matrix() @ (*uv, 1), (0.777, 0.777), atol=0.03)
