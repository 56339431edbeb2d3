"""What lies far away or is not there is drawn or refused with a sentence, and said: never a warning of Python's."""

from __future__ import annotations

import io
import warnings

import numpy as np
import pytest
from PIL import Image

from common.errors import SceneError, UserError
from common.gltf import load_scene
from common.images import image_size, read_image
from common.images.exif import without_exif
from common.layouts import dtype, fill_frame_constants
from common.scene.pose import evaluate_pose
from common.view.camera import framed_view, view_of_scene
from tests.common.gltf.builder import QUAD, QUAD_INDICES, TRIANGLE, Gltf, triangle

UV = np.array([(0, 0), (1, 0), (0, 1)], "f4")


@pytest.fixture(autouse=True)
def strict():
    """A warning of Python's is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def constants(scene, view):
    """Return what a frame gives to shaders; every number of it is finite."""
    record = np.zeros((), dtype("FrameConstants"))
    fill_frame_constants(
        record, view, view, size=(64, 48), origin=scene.origin, length_scale=scene.length_scale
    )
    for name in record.dtype.names:
        assert np.isfinite(record[name]).all(), name
    return record


@pytest.mark.parametrize("place", [(1e17, 0, 0), (1e17, 1e17, 1e17), (0, 0, -9e17)])
@pytest.mark.parametrize("scale", [1.0, 5.0, 1e3])
def test_a_model_far_away_is_framed_and_said(tmp_path, place, scale):
    gltf = triangle()
    gltf.json["nodes"][0].update(translation=list(place), scale=[scale] * 3)
    scene = load_scene(gltf.write(tmp_path))
    view = framed_view(scene, 1.0)
    constants(scene, view)
    # The pose is rigid, and looks as it does at a model that is near.
    near = framed_view(load_scene(triangle().write(tmp_path)), 1.0)
    assert np.array_equal(view.world_from_view[:3, :3], near.world_from_view[:3, :3])
    assert [text for text in scene.warnings if "from its origin, where places are rounded to" in text]


def test_a_model_of_no_size_that_is_near_is_no_matter(tmp_path):
    gltf = Gltf()
    gltf.draw(gltf.primitive(POSITION=np.ones((3, 3), "f4")))
    assert not [text for text in load_scene(gltf.write(tmp_path)).warnings if "origin" in text]
    gltf = triangle()
    gltf.json["nodes"][0]["translation"] = [6_371_000.0, 0, 0]  # steps of a nanometre
    assert not load_scene(gltf.write(tmp_path)).warnings


@pytest.mark.parametrize("scale", [1e-12, 1e-15, 1e-18])
def test_a_model_of_next_to_no_size_has_finite_matrices(tmp_path, scale):
    gltf = triangle()
    gltf.json["nodes"][0]["scale"] = [scale] * 3
    scene = load_scene(gltf.write(tmp_path))
    constants(scene, framed_view(scene, 1.0))
    constants(scene, view_of_scene(scene, evaluate_pose(scene, 0.0), "0,0,1:0,0,0", 1.0))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("1e308,0,0:0,0,0", "beyond 1e\\+18"),
        ("0,0,0:0,-1e19,0", "beyond 1e\\+18"),
        ("nan,0,0:0,0,0", "not finite"),
        ("0,0,3:0,0,0:1e-300", "must be between 6e-05 and 180"),
    ],
)
def test_views_that_32_bits_cannot_hold_are_refused(tmp_path, text, fault):
    scene = load_scene(triangle().write(tmp_path))
    with pytest.raises(UserError, match=fault):
        view_of_scene(scene, evaluate_pose(scene, 0.0), text, 1.0)


@pytest.mark.parametrize(
    "text", ["1e18,-1e18,1e18:0,0,0", "1e-300,0,0:0,0,0", "0,0,3:0,0,0:6e-05", "0,0,1:0,0,0:179.9"]
)
def test_the_last_views_that_are_drawn_have_finite_matrices(tmp_path, text):
    scene = load_scene(triangle().write(tmp_path))
    constants(scene, view_of_scene(scene, evaluate_pose(scene, 0.0), text, 1.0))


LENSES = {
    "yfov": (
        "perspective",
        {"yfov": 1e-300, "znear": 0.1},
        r"yfov is 1e-300, not an angle between 1e-06 and pi",
    ),
    "znear": ("perspective", {"yfov": 1.0, "znear": 1e-30}, "znear is 1e-30, not 1e-18 or more"),
    "ymag": ("orthographic", {"xmag": 1, "ymag": 1e-300, "znear": 0, "zfar": 1}, "ymag is 1e-300"),
    "xmag": ("orthographic", {"xmag": 1e-300, "ymag": 1, "znear": 0, "zfar": 1}, "xmag is 1e-300"),
    "zfar": (
        "orthographic",
        {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1e-300},
        "zfar is only 1e-300 m beyond",
    ),
}


@pytest.mark.parametrize("name", LENSES)
def test_lenses_that_32_bits_cannot_hold_are_refused(tmp_path, name):
    kind, lens, fault = LENSES[name]
    gltf = triangle()
    gltf.node(camera=gltf.add("cameras", {"type": kind, kind: lens}))
    with pytest.raises(SceneError, match=fault):
        load_scene(gltf.write(tmp_path))


@pytest.mark.parametrize("kind", ["perspective", "orthographic"])
def test_the_last_lenses_that_are_drawn_have_finite_matrices(tmp_path, kind):
    lenses = {
        "perspective": {"yfov": 1e-6, "znear": 1e-18},
        "orthographic": {"xmag": 1e-9, "ymag": 1e-9, "znear": 0, "zfar": 1e-9},
    }
    gltf = triangle()
    gltf.node(camera=gltf.add("cameras", {"type": kind, kind: lenses[kind]}), translation=[1e18, 0, 0])
    scene = load_scene(gltf.write(tmp_path))
    constants(scene, view_of_scene(scene, evaluate_pose(scene, 0.0), None, 1.0))


def test_a_camera_that_its_parents_carry_beyond_all_is_refused(tmp_path):
    """Each node is within the limit of a number, and together they are not."""
    gltf = triangle()
    camera = gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}})
    child = gltf.node(camera=camera, translation=[1e18, 0, 0])
    gltf.node(children=[child], scale=[1e18] * 3)
    scene = load_scene(gltf.write(tmp_path))
    with pytest.raises(SceneError, match=r"stands further than 1e\+18 m from the origin"):
        view_of_scene(scene, evaluate_pose(scene, 0.0), None, 1.0)


@pytest.mark.parametrize("used", [0, 1, 4])
def test_a_texture_without_its_coordinates_is_said_and_read_at_zero(tmp_path, used):
    gltf = Gltf()
    pixels = np.full((4, 4, 4), 255, np.uint8)
    texture = gltf.add("textures", {"source": gltf.image(pixels)})
    info = {"index": texture, "texCoord": used}
    material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": info}})
    more = {} if used == 0 else {"TEXCOORD_0": np.tile((0.5, 0.7), (4, 1)).astype("f4")}
    gltf.draw(gltf.primitive(QUAD_INDICES, POSITION=QUAD, material=material, **more))
    scene = load_scene(gltf.write(tmp_path))
    note = (
        f"meshes[0].primitives[0] has no TEXCOORD_{used}, which materials[0] samples: the texture is read at (0, 0), "
        "as in other viewers."
    )
    assert scene.warnings == [note]
    uv = scene.uv1 if scene.materials[0].base_color_texture.uv_set else scene.uv0
    assert uv is None or not uv.any()


def test_a_texture_with_its_coordinates_is_not_said(tmp_path):
    gltf = Gltf()
    texture = gltf.add("textures", {"source": gltf.image(np.full((4, 4, 4), 255, np.uint8))})
    gltf.add("textures", {})
    surface = {"baseColorTexture": {"index": texture, "texCoord": 2}}
    material = gltf.add("materials", {"pbrMetallicRoughness": surface})
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_2=UV, material=material))
    gltf.draw(gltf.primitive(POSITION=TRIANGLE))
    assert not load_scene(gltf.write(tmp_path)).warnings


def jpeg(exif):
    """Return a JPEG of one colour with that EXIF segment."""
    stream = io.BytesIO()
    Image.new("RGB", (8, 8), (200, 100, 50)).save(stream, "JPEG", exif=b"Exif\0\0" + exif)
    return stream.getvalue()


BROKEN = {
    "too few entries": b"II*\0\x08\0\0\0\xff\xff\x1a\x01\x05\0\x01\0\0\0\xff\xff\xff\x7f",
    "cut short": b"MM\0*\0\0\0\x08\0\x02\x01\x1a\0\x05\0\0\0\x01\0\0\xff\xff\x01\x28\0\x03",
}


@pytest.mark.parametrize("name", BROKEN)
def test_broken_exif_is_not_read(tmp_path, name):
    data = jpeg(BROKEN[name])
    with pytest.raises(UserWarning, match="Truncated"):
        Image.open(io.BytesIO(data))  # or this file shows nothing
    (tmp_path / "p.jpg").write_bytes(data)
    gltf = Gltf()
    texture = gltf.add("textures", {"source": gltf.add("images", {"uri": "p.jpg"})})
    material = gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    gltf.draw(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_0=UV, material=material))
    plain = np.asarray(Image.open(io.BytesIO(jpeg(b""))))
    assert np.array_equal(load_scene(gltf.write(tmp_path, "gltf")).images[0].pixels[..., :3], plain)
    assert np.array_equal(read_image(tmp_path / "p.jpg"), plain) and image_size(tmp_path / "p.jpg") == (8, 8)


def test_only_exif_is_hidden_and_only_where_it_is():
    data = np.frombuffer(jpeg(b"II*\0"), np.uint8)
    found = without_exif(data)
    (changed,) = np.flatnonzero(found != data)
    assert data[changed : changed + 6].tobytes() == b"Exif\0\0" and not data.flags.writeable
    assert without_exif(found) is found
    for other in (
        b"",
        b"\xff\xd8",
        b"\xff\xd8\xff",
        b"\xff\xd8\xff\xe1\0\0",
        b"\x89PNG\r\n\x1a\n",
        data[:24].tobytes()[:-6],
    ):
        values = np.frombuffer(other, np.uint8)
        assert without_exif(values) is values
