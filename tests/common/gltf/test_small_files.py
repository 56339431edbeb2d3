"""A small file takes little memory, whatever it asks for: zeros, copies and pixels that lie in no byte of it."""

from __future__ import annotations

import io
import json
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from common.errors import SceneError
from common.gltf import document, images, load_scene
from common.paths import ROOT
from tests.common.gltf.builder import QUAD, QUAD_INDICES, TRIANGLE, Gltf
from tests.support.scene_equality import difference

UV = np.array([(0, 0), (1, 0), (0, 1)], "f4")


def bare(counts):
    """Write a scene of triangles of zeros: one accessor without a bufferView, and one mesh, for each count."""
    gltf = Gltf()
    for count in counts:
        number = gltf.add("accessors", {"componentType": 5126, "count": count, "type": "VEC3"})
        gltf.draw(gltf.primitive(POSITION=number, NORMAL=number))
    return gltf


def picture(side, note="", color=(9, 9, 9)):
    """Return a PNG of one colour; `note` makes its bytes other ones."""
    stream, told = io.BytesIO(), PngInfo()
    told.add_text("note", note)
    Image.new("RGB", (side, side), color).save(stream, "PNG", pnginfo=told)
    return stream.getvalue()


def drawn_with(gltf, *sources):
    """Draw a triangle for each image number."""
    for place, source in enumerate(sources):
        texture = gltf.add("textures", {"source": source})
        material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
        part = gltf.primitive(POSITION=TRIANGLE + np.float32(place), TEXCOORD_0=UV, material=material)
        gltf.draw(part)
    return gltf


def test_zeros_are_bounded_by_their_sum(tmp_path, monkeypatch):
    """Each of them alone is far below what a file may have; a mesh takes its vertices once more."""
    monkeypatch.setattr(document, "FREE_ELEMENTS", 2**15)
    assert len(load_scene(bare([2**12] * 4).write(tmp_path)).positions) == 2**14
    with pytest.raises(
        SceneError, match=r"brings the scene to \d+ vertices and other elements; a file may have"
    ):
        load_scene(bare([2**12] * 5).write(tmp_path))


def test_copies_are_bounded_by_their_sum(tmp_path):
    """One accessor of real bytes, drawn flat again and again: every primitive has vertices of its own."""
    gltf = Gltf()
    count = 30_000
    positions = gltf.accessor(np.tile(TRIANGLE, (count // 3, 1)))
    gltf.draw(*(gltf.primitive(POSITION=positions, material=gltf.add("materials", {})) for _ in range(500)))
    with pytest.raises(SceneError, match=r"meshes\[0\].primitives\[\d+\] brings the scene to"):
        load_scene(gltf.write(tmp_path))


def test_morph_targets_are_bounded_by_their_sum(tmp_path):
    gltf = Gltf()
    positions = gltf.accessor(np.tile(TRIANGLE, (10_000, 1)))
    targets = [{"POSITION": positions}] * 200
    gltf.draw(*(gltf.primitive(POSITION=positions, targets=targets) for _ in range(3)), weights=[1.0] * 200)
    with pytest.raises(SceneError, match=r"primitives\[1\].targets brings the scene to"):
        load_scene(gltf.write(tmp_path))


def test_what_lies_in_the_file_always_may(tmp_path, monkeypatch):
    """With nothing free: indexed and flat triangles of the smallest types that glTF has."""
    monkeypatch.setattr(document, "FREE_ELEMENTS", 0)
    gltf = Gltf()
    for indices in (None, QUAD_INDICES, QUAD_INDICES.astype("u1")):
        normals = None if indices is None else np.tile((0, 0, 1), (4, 1)).astype("f4")
        more = {} if normals is None else {"NORMAL": normals}
        gltf.draw(gltf.primitive(indices, POSITION=(QUAD if indices is not None else TRIANGLE), **more))
    gltf.draw(gltf.primitive(QUAD_INDICES.astype("u1"), POSITION=QUAD))
    gltf.draw(gltf.primitive(POSITION=QUAD, mode=0))
    assert load_scene(gltf.write(tmp_path)).triangle_count > 4


@pytest.mark.parametrize("decode", [True, False])
@pytest.mark.parametrize(
    "stored", ["one file", "copies of it", "one view", "copies in the buffer", "data URIs"]
)
def test_equal_pictures_are_decoded_once(tmp_path, monkeypatch, decode, stored):
    data, other = picture(8), picture(8, color=(9, 9, 8))
    assert len(data) == len(other), "so that the length alone does not tell them"
    gltf = Gltf()
    for number in range(5):
        content = other if number == 2 else data
        if stored == "one view":
            gltf.add("images", {"bufferView": 0 if number and number != 2 else gltf.view(content)})
        elif stored == "copies in the buffer":
            gltf.add("images", {"bufferView": gltf.view(content)})
        else:
            name = "p.png" if stored == "one file" and number != 2 else f"p{number}.png"
            (tmp_path / name).write_bytes(content)
            gltf.add("images", {"uri": name})
    if stored == "data URIs":
        from base64 import b64encode

        for number, entry in enumerate(gltf.json["images"]):
            content = other if number == 2 else data
            entry["uri"] = "data:image/png;base64," + b64encode(content).decode()
    decoded = []
    original = images._decode
    monkeypatch.setattr(images, "_decode", lambda *args: decoded.append(args) or original(*args))
    scene = load_scene(drawn_with(gltf, 0, 1, 2, 3, 4).write(tmp_path, "gltf"), decode=decode)
    assert [image.pixels[0, 0].tolist() for image in scene.images] == [[9, 9, 9, 255], [9, 9, 8, 255]]
    assert len(decoded) == 2
    assert [one.base_color_texture.image for one in scene.materials] == [0, 0, 1, 0, 0]


def test_a_picture_that_is_left_out_moves_no_other(tmp_path):
    """The first primitive has no POSITION: its picture is read, and the second one's stays the second one's."""
    gltf = Gltf()
    first, second = (gltf.image(np.full((2, 2, 4), value, np.uint8)) for value in (10, 200))
    drawn_with(gltf, first, second)
    del gltf.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    scene = load_scene(gltf.write(tmp_path))
    (material,) = scene.materials
    assert scene.images[material.base_color_texture.image].pixels[0, 0, 0] == 200


def test_pixels_are_bounded_by_their_sum_and_paid_for_by_files(tmp_path, monkeypatch):
    monkeypatch.setattr(images, "FREE_BYTES", 3 * 64 * 64 * 4)
    for side, count, fits in ((64, 3, True), (256, 2, False)):
        gltf = Gltf()
        numbers = [
            gltf.add("images", {"bufferView": gltf.view(picture(side, n))}) for n in "abcdefgh"[:count]
        ]
        path = drawn_with(gltf, *numbers).write(tmp_path)
        for decode in (True, False):
            if fits:
                assert len(load_scene(path, decode=decode).images) == count
            else:
                with pytest.raises(SceneError, match=r"images.\d. brings the images .* bytes of files"):
                    load_scene(path, decode=decode)
    noise = np.random.default_rng(1).integers(0, 256, (256, 256, 4), np.uint8)
    gltf = Gltf()
    paying = [
        gltf.image(noise),
        *(gltf.add("images", {"bufferView": gltf.view(picture(256, n))}) for n in "abc"),
    ]
    assert len(load_scene(drawn_with(gltf, *paying).write(tmp_path)).images) == 4


def test_sixteen_bits_of_grey_count_as_the_eight_bytes_that_they_take(tmp_path, monkeypatch):
    gltf = Gltf()
    deep = Image.fromarray(np.full((64, 64), 300, np.uint16))
    stream = io.BytesIO()
    deep.save(stream, "PNG")
    path = drawn_with(gltf, gltf.add("images", {"bufferView": gltf.view(stream.getvalue())})).write(tmp_path)
    monkeypatch.setattr(images, "MOST_RATIO", 0)
    assert load_scene(path).images[0].pixels.nbytes == 64 * 64 * 8
    for free, fits in ((64 * 64 * 8, True), (64 * 64 * 8 - 1, False)):
        monkeypatch.setattr(images, "FREE_BYTES", free)
        if fits:
            load_scene(path)
        else:
            with pytest.raises(SceneError, match="brings the images of the scene to"):
                load_scene(path)


def test_what_an_equal_picture_is_read_for_may_differ(tmp_path):
    """As colour and as normals, with other samplers: all else is that of a file whose pictures differ in a note."""
    pixels = picture(16, "a", (120, 130, 250))
    for form, second in (("same", pixels), ("other", picture(16, "b", (120, 130, 250)))):
        (tmp_path / form).mkdir()
        gltf = Gltf()
        for number, data in enumerate((pixels, second)):
            gltf.add("images", {"bufferView": gltf.view(data), "name": "p"})
            gltf.add("samplers", {"magFilter": 9728 + number, "wrapS": (33071, 10497)[number]})
            gltf.add("textures", {"source": number, "sampler": number})
        surface = {"baseColorTexture": {"index": 0}}
        material = gltf.add("materials", {"pbrMetallicRoughness": surface, "normalTexture": {"index": 1}})
        normals = np.tile((0, 0, 1), (3, 1)).astype("f4")
        gltf.draw(gltf.primitive(POSITION=TRIANGLE, NORMAL=normals, TEXCOORD_0=UV, material=material))
        gltf.write(tmp_path / form)
    same, other = (load_scene(tmp_path / form / "scene.glb") for form in ("same", "other"))
    assert (len(same.images), len(other.images)) == (1, 2)
    one, two = same.materials[0], other.materials[0]
    assert one.base_color_texture == two.base_color_texture
    assert one.normal_texture.sampler == two.normal_texture.sampler != one.base_color_texture.sampler
    assert difference(same.images[0].pixels, other.images[1].pixels) == ""


_PEAK = """
import resource, sys
from common.errors import SceneError
from common.gltf import load_scene
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
before = peak()
try:
    load_scene(sys.argv[1])
except SceneError as error:
    print(error, file=sys.stderr)
print((peak() - before) // 1024)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="units of ru_maxrss differ")
def test_files_of_a_kilobyte_stay_far_below_what_they_took(tmp_path):
    """The file that took 5.2 GB: six accessors of 2^24 elements without a bufferView."""
    kinds = {"POSITION": "VEC3", "NORMAL": "VEC3", "TANGENT": "VEC4", "TEXCOORD_0": "VEC2", "COLOR_0": "VEC4"}
    accessors = [{"componentType": 5126, "count": 2**24, "type": kind} for kind in kinds.values()]
    attributes = {name: number for number, name in enumerate(kinds)}
    root = {
        "asset": {"version": "2.0"},
        "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": attributes}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps(root))
    assert path.stat().st_size < 1000
    done = subprocess.run(
        [sys.executable, "-c", _PEAK, str(path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert "more than" in done.stderr or "a file may have" in done.stderr
    assert int(done.stdout) < 300, f"{done.stdout} MiB"
