"""`strata run` as a user types it: pictures, records, and one sentence with exit code 2 for whatever is wrong."""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from backends.gl import api as gl
from common.environment import constant
from common.images import read_image, read_layers
from common.paths import ROOT
from tests.common.gltf.builder import TRIANGLE, Gltf, triangle
from tests.support import children
from tests.support.drivers import needs_layers
from tools.run.run import Request, expose

KEYS = {
    *("strata", "chapter", "title", "backend", "device", "system", "plan", "scene", "size", "quality"),
    *("settings", "start_s", "shaders", "median_ms", "frames", "pictures"),
}
"""Of the record of `--json`; scripts read it by these names."""
KEYS_WITHIN = {
    "device": {"name", "driver", "api_version", "kind"},
    "scene": {
        *("name", "path", "meshes", "instances", "triangles", "indices"),
        *("materials", "images", "lights", "environment", "warnings"),
    },
    "shaders": {"compiled", "cached", "reused"},
    "median_ms": {"forward", "tonemap", "cpu"},
}
FRAME_KEYS = {"index", "cpu_ms", "timings_ms", "work", "reset"}


@pytest.fixture
def box(tmp_path) -> Path:
    """A scene of one triangle."""
    return triangle().write(tmp_path)


def test_a_picture_and_a_record_are_written_where_they_were_asked_for(strata, tmp_path, box, vulkan_instance):
    needs_layers(vulkan_instance)
    code, out, err = strata(
        *("run", "1", "--scene", box, "--size", "64x48", "--frames", "3"),
        *("--out", "picture.png", "--json", "run.json", "--validate"),
    )
    assert code == 0, err
    assert out == ""
    assert "picture.png" in err and err.count("\n") == 1
    picture = read_image(tmp_path / "picture.png")
    assert picture.shape == (48, 64, 3)
    assert len(np.unique(picture)) > 1
    record = json.loads((tmp_path / "run.json").read_text())
    assert record.keys() == KEYS
    for key, within in KEYS_WITHIN.items():
        assert record[key].keys() == within
    assert all(frame.keys() == FRAME_KEYS for frame in record["frames"])
    assert all(step.keys() == {"feature", "native", "path", "reason"} for step in record["plan"])
    assert record["scene"]["triangles"] == 1
    assert record["size"] == [64, 48]
    assert [frame["index"] for frame in record["frames"]] == [0, 1, 2]
    assert set(record["frames"][0]["timings_ms"]) == {"forward", "tonemap"}
    assert record["frames"][0]["work"]["draws"] == 2  # the triangle, and the tone mapping's own
    assert [frame["reset"] for frame in record["frames"]] == ["first frame", "", ""]
    assert record["plan"][0]["feature"] == "anisotropy"
    assert record["device"]["name"] and record["device"]["driver"]
    assert record["settings"]["anisotropy"] == 4.0  # medium
    assert record["start_s"]["total"] >= sum(v for k, v in record["start_s"].items() if k != "total")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["picture.png", "run.json", "scene.glb"]


@pytest.mark.needs("OpenEXR")
def test_an_exr_holds_linear_light_depth_and_ids(strata, tmp_path, box):
    assert strata("run", "1", "--scene", box, "--size", "32x32", "--out", "a.exr")[0] == 0
    layers = read_layers(tmp_path / "a.exr")
    assert {name: (a.shape, a.dtype) for name, a in layers.items()} == {
        "": ((32, 32, 3), np.float32),
        "depth": ((32, 32, 1), np.float32),
        "instance_id": ((32, 32, 1), np.uint32),
    }
    drawn = layers["instance_id"] == 1
    assert drawn.any() and ((layers["depth"] > 0) == drawn).all()


def test_without_a_name_the_picture_goes_to_out_in_the_current_folder(strata, tmp_path, box):
    code, _, err = strata("run", "ch01", "--scene", box, "--size", "16x16")
    assert code == 0
    assert "out/ch01-scene.png" in err.replace(os.sep, "/")
    assert (tmp_path / "out" / "ch01-scene.png").is_file()


def test_a_wavefront_file_is_a_scene_too(strata, tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert strata("run", "1", "--scene", "a.obj", "--size", "32x32", "--out", "a.png")[0] == 0
    assert len(np.unique(read_image(tmp_path / "a.png"))) > 1


def test_opengl_draws_the_same_picture(strata, tmp_path, gl_context, vulkan_instance):
    needs_layers(vulkan_instance)
    for backend in ("vulkan", "gl"):
        words = ("--backend", backend, "--out", f"{backend}.png", "--json", f"{backend}.json", "--validate")
        assert strata("run", "1", "--scene", "cornell", "--size", "64x64", *words)[0] == 0
    pictures = [read_image(tmp_path / f"{backend}.png").astype(int) for backend in ("vulkan", "gl")]
    assert np.abs(pictures[0] - pictures[1]).max() <= 1
    records = [json.loads((tmp_path / f"{backend}.json").read_text()) for backend in ("vulkan", "gl")]
    assert [record["backend"] for record in records] == ["vulkan", "gl"]
    assert records[0]["frames"][0]["work"]["draws"] == records[1]["frames"][0]["work"]["draws"]


def test_an_exposure_darkens_the_picture_and_a_sky_that_does_not_fit_is_said(strata, tmp_path, box):
    common = ("run", "1", "--scene", box, "--size", "32x32")
    assert strata(*common, "--out", "a.png")[0] == 0
    assert strata(*common, "--ev", "3", "--out", "b.png")[0] == 0
    assert read_image(tmp_path / "b.png").mean() < read_image(tmp_path / "a.png").mean()
    words = ("--environment", "sky", "--quality", "low", "--size", "32x32")
    code, _, err = strata("run", "1", "--scene", "cornell", *words, "--out", "c.png")
    assert code == 0
    assert re.search(r"--ev [\d.]+ fits", err)


@pytest.mark.parametrize(
    ("nits", "said"),
    [(1e-30, "nits on average: it is too dark for any exposure"), (1e-10, "--ev -32.2 fits"), (0.4, "")],
)
def test_no_exposure_is_named_that_does_not_fit(capsys, nits, said):
    scene = SimpleNamespace(ev100=None, environment=constant(nits), cameras=[SimpleNamespace(ev100=0.0)])
    scene.bounds, scene.length_scale = np.array([[0.0, 0, 0], [1, 1, 1]]), 1.0
    expose(scene, Request(1))
    told = capsys.readouterr().err
    assert said in told and told.count("--ev") == ("--ev" in said) and bool(told) == bool(said)


@pytest.mark.needs("OpenEXR")
def test_opengl_writes_the_same_light_depth_and_ids(strata, tmp_path, gl_context, vulkan_instance):
    needs_layers(vulkan_instance)
    words = ("run", "1", "--scene", "cornell", "--size", "32x32", "--set", "color_format=rgba32f")
    for backend in ("vulkan", "gl"):
        assert strata(*words, "--backend", backend, "--out", f"{backend}.exr", "--validate")[0] == 0
    vulkan, opengl = (read_layers(tmp_path / f"{backend}.exr") for backend in ("vulkan", "gl"))
    assert list(vulkan) == list(opengl) == ["", "depth", "instance_id"]
    assert all(vulkan[layer].dtype == opengl[layer].dtype for layer in vulkan)
    seen = vulkan["instance_id"]
    assert len(np.unique(seen)) > 3 and (seen == opengl["instance_id"]).mean() > 0.99
    both = (seen == opengl["instance_id"])[..., 0]
    for layer in ("", "depth"):
        assert np.allclose(vulkan[layer][both], opengl[layer][both], rtol=1e-3)


def test_validation_on_opengl_names_the_pass_and_the_line(strata, box, gl_context, monkeypatch):
    """A wrong call by moderngl is heard from the driver, and the picture is drawn; a wrong raw call ends the run."""
    from chapters.ch01.post.tonemap import TonemapPass

    whole = TonemapPass.record

    def by_moderngl(self, commands):
        commands._context.mgl.enable_direct(0x1234)
        whole(self, commands)

    words = ("run", "1", "--backend", "gl", "--scene", box, "--size", "16x16")
    words += ("--out", "a.png", "--frames", "3")
    place = by_moderngl.__code__.co_firstlineno + 1
    monkeypatch.setattr(TonemapPass, "record", by_moderngl)
    for validate in ((), ("--validate",)):
        code, _, err = strata(*words, *validate)
        assert code == 1
        assert f"called from tests/cli/test_run.py:{place} in pass tonemap: error: " in err
        assert "GL_INVALID_ENUM" in err and err.count("\n") == 2 and "(3 times)\n" in err
    monkeypatch.setattr(TonemapPass, "record", whole)
    monkeypatch.setattr(gl, "GL_TRIANGLES", 0x1234)
    code, _, err = strata(*words, "--validate")
    assert code == 1
    assert err.startswith("strata: glDrawElementsBaseVertex(0x1234, 3, ")
    assert "failed with GL_INVALID_ENUM: a constant is not allowed there." in err
    trace = [line.split(", ") for line in err.splitlines() if line.startswith("  File")]
    assert trace[-2][0].endswith('forward.py"') and trace[-2][2] == "in record"
    assert trace[-1][0].endswith('commands.py"') and trace[-1][2] == "in draw_groups"


def test_without_all_draws_and_verbose_says_the_plan(strata, box):
    code, out, err = strata("run", "1", "--scene", box, "--size", "16x16", "--without", "all", "-v")
    assert code == 0
    assert "strata: drawing with " in err
    text = " ".join(out.split())
    assert "trilinear filtering" in out
    assert "switched off by --without" in text or "its self-test failed" in text
    assert "recording (CPU)" in out
    assert "history_resets 1" in out and "Started without history: first frame (frame 0)" in out


@pytest.mark.parametrize(("frames", "head"), [(1, "first frame"), (3, "median")])
def test_times_of_a_first_frame_are_not_called_a_median(strata, box, frames, head):
    code, out, _ = strata("run", 1, "--scene", box, "--size", "16x16", "--headless", "--frames", frames, "-v")
    table = out[out.index("Milliseconds") :].splitlines()
    assert code == 0 and next(line for line in table if "part" in line).split(maxsplit=1)[1].strip() == head


def test_a_camera_and_a_time_change_the_picture(strata, tmp_path):
    """A triangle that an animation moves to the side, seen from the front and from the back."""
    gltf = Gltf()
    node = gltf.draw(gltf.primitive(POSITION=TRIANGLE))
    sampler = {"input": gltf.accessor([0.0, 2.0], "f4", min=[0.0], max=[2.0])}
    sampler["output"] = gltf.accessor([(0, 0, 0), (0.4, 0, 0)], "f4")
    channel = {"sampler": 0, "target": {"node": node, "path": "translation"}}
    gltf.add("animations", {"samplers": [sampler], "channels": [channel]})
    path = gltf.write(tmp_path)
    common = ("run", "1", "--scene", path, "--size", "32x32")
    view = ("--camera", "0.5,0.5,3:0.5,0.5,0")
    assert strata(*common, *view, "--out", "start.png")[0] == 0
    assert strata(*common, *view, "--time", "1", "--out", "end.png")[0] == 0
    assert strata(*common, *view, "--fps", "4", "--frames", "5", "--out", "frame4.png")[0] == 0
    start, end, frame4 = (read_image(tmp_path / f"{name}.png") for name in ("start", "end", "frame4"))
    assert (start != end).any()
    assert np.array_equal(end, frame4)


WRONG_WORDS = {
    "no such chapter": (("run", "16"), "chapter 16"),
    "a chapter that is a word": (("run", "helmet"), "no chapter 'helmet'"),
    "no chapter": (("run",), "Missing argument"),
    "empty size": (("run", "1", "--size", "0x5"), "0x5"),
    "huge size": (("run", "1", "--size", "100000x5"), "100000x5"),
    "size without a cross": (("run", "1", "--size", "640"), "640x360"),
    "negative size": (("run", "1", "--size", "-4x4"), "-4x4"),
    "no such setting": (("run", "1", "--set", "anistropy=2"), "did you mean 'anisotropy'?"),
    "a setting out of range": (("run", "1", "--set", "anisotropy=99"), "1 to 16"),
    "a setting that is no number": (("run", "1", "--set", "anisotropy=much"), "a number"),
    "a setting without a value": (("run", "1", "--set", "anisotropy"), "anisotropy=value"),
    "no such feature": (("run", "1", "--without", "mesh-shaders"), "did you mean 'mesh-shader'?"),
    "no such quality": (("run", "1", "--quality", "hihg"), "did you mean 'high'?"),
    "no such backend": (("run", "1", "--backend", "metal"), "no backend 'metal'"),
    "no frames": (("run", "1", "--frames", "0"), "--frames 0"),
    "an exposure that is none": (("run", "1", "--ev", "nan"), "--ev"),
    "no such environment": (
        ("run", "1", "--scene", "cornell", "--environment", "nowhere.hdr"),
        "nowhere.hdr",
    ),
    "an environment in capitals": (
        ("run", "1", "--scene", "cornell", "--environment", "SKY"),
        "did you mean 'sky'?",
    ),
    "an environment misspelt": (
        ("run", "1", "--scene", "cornell", "--environment", "skyy"),
        "did you mean 'sky'?",
    ),
    "no environment": (("run", "1", "--scene", "cornell", "--environment", ""), "--environment needs"),
    "a time that is none": (("run", "1", "--time", "nan"), "--time"),
    "a time too far": (("run", "1", "--time", "1e308"), "between -1e+09 and 1e+09"),
    "a rate that is next to none": (
        ("run", "1", "--fps", "1e-300", "--frames", "3"),
        "With --frames and --fps the last --time",
    ),
    "frames without end": (("run", "1", "--frames", "9" * 400), "With --frames and --fps"),
    "no such scene": (("run", "1", "--scene", "atrum"), "atrium"),
    "no such size of a scene": (("run", "1", "--scene", "atrium:huge"), "atrium:large"),
    "no such file": (("run", "1", "--scene", "nowhere/box.gltf"), "nowhere/box.gltf"),
    "a folder": (("run", "1", "--scene", "."), "folder"),
    "no such camera": (("run", "1", "--scene", "cornell", "--camera", "nose"), "no camera 'nose'"),
    "a picture of an unknown kind": (("run", "1", "--out", "a.jpg"), ".png"),
    "a picture in no folder": (("run", "1", "--out", "nowhere/a.png"), "nowhere"),
    "a picture over a folder": (("run", "1", "--out", "."), "."),
    "a record in no folder": (("run", "1", "--json", "nowhere/a.json"), "nowhere"),
    "no such command": (("rnu", "1"), "No such command"),
    "no such option": (("run", "1", "--fames", "2"), "--frames"),
    "settings of no chapter": (("list", "--settings"), "list 1 --settings"),
    "no such tests": (("test", "ch1"), "ch01"),
}


@pytest.mark.parametrize("name", WRONG_WORDS)
def test_a_wrong_word_is_one_sentence_and_leaves_no_file(strata, tmp_path, name):
    words, part = WRONG_WORDS[name]
    code, out, err = strata(*words)
    assert code == 2
    assert out == ""
    assert part in err
    one_sentence(err)
    assert not list(tmp_path.iterdir())


def one_sentence(err: str) -> None:
    assert err.startswith("strata: ")
    assert err.count("\n") == 1, err
    assert "Traceback" not in err and 'File "' not in err


def truncated(tmp_path):
    path = triangle().write(tmp_path)
    path.write_bytes(path.read_bytes()[:-20])
    return path


def changed(**changes):
    """A triangle whose document differs in one place: "accessors.0.count" -> value."""

    def make(tmp_path):
        gltf = triangle()
        for place, value in changes.items():
            target = gltf.json
            *steps, last = place.split("__")
            for step in steps:
                target = target[int(step) if step.isdigit() else step]
            target[int(last) if last.isdigit() else last] = value
        return gltf.write(tmp_path, "data")

    return make


def nan_positions(tmp_path):
    gltf = Gltf()
    gltf.draw(gltf.primitive(POSITION=np.full((3, 3), np.nan, "f4")))
    return gltf.write(tmp_path)


def indices_out_of_range(tmp_path):
    gltf = Gltf()
    gltf.draw(gltf.primitive(np.array([0, 1, 9], "u2"), POSITION=TRIANGLE))
    return gltf.write(tmp_path)


def cyclic_nodes(tmp_path):
    gltf = triangle()
    gltf.node(children=[2])
    gltf.node(children=[1])
    gltf.json["scenes"] = [{"nodes": [0, 1]}]
    gltf.json["scene"] = 0
    return gltf.write(tmp_path)


def with_image(make_png):
    def make(tmp_path):
        gltf = Gltf()
        gltf.add("images", {"uri": "picture.png"})
        gltf.add("textures", {"source": 0})
        gltf.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
        uv = np.array([(0, 0), (1, 0), (0, 1)], "f4")
        gltf.draw(gltf.primitive(POSITION=TRIANGLE, TEXCOORD_0=uv, material=0))
        make_png(tmp_path / "picture.png")
        return gltf.write(tmp_path, "gltf")

    return make


def giant_png(path):
    """A PNG of a few bytes whose header claims 30,000 x 30,000 pixels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 30_000, 30_000, 8, 2, 0, 0, 0)
    data = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 64)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + data)


WRONG_SCENES = {
    "truncated": (truncated, "scene.glb"),
    "an empty file": (lambda tmp: _file(tmp, b""), "scene.glb"),
    "text that is no JSON": (lambda tmp: _file(tmp, b"{]", "scene.gltf"), "scene.gltf"),
    "a wrong JSON type": (changed(nodes={"mesh": 0}), "nodes"),
    "a number that is a text": (changed(accessors__0__count="three"), "accessors[0]"),
    "an accessor out of range": (changed(meshes__0__primitives__0__attributes__POSITION=5), "5"),
    "an accessor beyond its buffer": (changed(accessors__0__count=3_000_000), "accessors[0]"),
    "indices out of range": (indices_out_of_range, "9"),
    "NaN positions": (nan_positions, "meshes[0]"),
    "cyclic nodes": (cyclic_nodes, "nodes"),
    "an unknown required extension": (changed(extensionsRequired=["ACME_teapot"]), "ACME_teapot"),
    "a missing image": (with_image(lambda path: None), "picture.png"),
    "an image of 30,000 pixels a side": (with_image(giant_png), "30000"),
    "an image that is none": (with_image(lambda path: path.write_bytes(b"nonsense")), "images[0]"),
}


def _file(folder, data, name="scene.glb"):
    path = folder / name
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("name", WRONG_SCENES)
def test_a_wrong_scene_is_one_sentence_that_names_the_place(strata, tmp_path, name):
    make, part = WRONG_SCENES[name]
    path = make(tmp_path)
    before = sorted(tmp_path.iterdir())
    code, out, err = strata(
        "run", "1", "--scene", path, "--size", "16x16", "--out", "a.png", "--json", "a.json"
    )
    assert code == 2, err
    assert out == ""
    assert part in err
    one_sentence(err)
    assert sorted(tmp_path.iterdir()) == before


def test_a_chapter_that_fails_leaves_the_old_picture(strata, tmp_path, box, monkeypatch):
    """A picture is written when it is whole: the one from before stays until then."""
    (tmp_path / "a.png").write_bytes(b"the picture from before")
    from chapters.ch01.renderer import Renderer

    def broken(self, view, time=0.0):
        raise ValueError("a slip of the pen")

    monkeypatch.setattr(Renderer, "render", broken)
    code, _, err = strata("run", "1", "--scene", box, "--size", "16x16", "--out", "a.png")
    assert code == 1
    assert "a slip of the pen" in err
    assert 'test_run.py", line' in err  # the reader's own line, and none of the foundation's
    assert "tools/run/run.py" not in err
    assert (tmp_path / "a.png").read_bytes() == b"the picture from before"


def start(*words: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run the command line as a process of its own, outside the clone."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        environment.pop(name, None)
    command = [sys.executable, "-P", "-m", "chapters", *words]
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False, timeout=60
    )


NO_VULKAN = {"VK_DRIVER_FILES": "/nowhere.json"}
BASE_INSTANCE = "GL_ARB_shader_draw_parameters"
NO_OPENGL = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"}


@pytest.mark.needs("glcontext")
def test_without_any_driver_it_says_what_to_install(tmp_path):
    words = ("run", "1", "--size", "16x16")
    # Where EGL was asked once, the process keeps the drivers that were found: what needs them to be hidden comes last.
    found = children.commands(
        ((*words, "--backend", "vulkan"), NO_VULKAN),
        (words, NO_OPENGL),
        ((*words, "--backend", "gl"), dict.fromkeys(NO_VULKAN, os.environ.get("VK_DRIVER_FILES"))),
        cwd=tmp_path,
    )
    for done in found:
        assert done.returncode == 2
        one_sentence(done.stderr)
        assert "./strata doctor" in done.stderr
    assert "install" in found[1].stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("taken", "said"),
    [
        ({"GLCONTEXT_LINUX_LIBEGL": "libno-such-egl.so"}, "libno-such-egl.so"),
        ({"MESA_GL_VERSION_OVERRIDE": "4.4"}, "No OpenGL 4.5 was found ("),
        ({"MESA_EXTENSION_OVERRIDE": f"-{BASE_INSTANCE}"}, f"the driver lacks {BASE_INSTANCE}"),
    ],
    ids=["no EGL", "OpenGL 4.4", "no base instance"],
)
def test_opengl_that_cannot_be_used_is_one_sentence(tmp_path, gl_context, taken, said):
    if not gl_context.capabilities.is_software:
        pytest.skip("these ways to take OpenGL away are those of Mesa")
    words = ("run", "1", "--scene", "cornell", "--size", "16x16", "--out", "a.png")
    named = (*words, "--backend", "gl")
    alone, done = children.commands((named, taken), (words, NO_VULKAN), cwd=tmp_path)
    assert alone.returncode == 2
    one_sentence(alone.stderr)
    assert said in alone.stderr and "./strata doctor" in alone.stderr
    assert done.returncode == 2
    one_sentence(done.stderr)
    assert "neither Vulkan 1.3 nor OpenGL 4.5" in done.stderr and "install" in done.stderr
    assert not list(tmp_path.iterdir())


def test_without_opengl_vulkan_draws(tmp_path, vulkan_instance):
    words = ("run", "1", "--scene", "cornell", "--size", "16x16", "--out", "a.png", "--json", "a.json")
    done = start(*words, cwd=tmp_path, **NO_OPENGL)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "a.json").read_text())["backend"] == "vulkan"


def test_opengl_without_an_extension_takes_the_other_path_and_says_why(tmp_path, gl_context):
    if not gl_context.capabilities.is_software:
        pytest.skip("extensions are taken away as Mesa does it")
    names = "-GL_ARB_texture_filter_anisotropic -GL_EXT_texture_filter_anisotropic"
    words = ("run", "1", "--backend", "gl", "--scene", "cornell", "--size", "16x16", "--out", "a.png")
    done = start(*words, "--json", "a.json", cwd=tmp_path, MESA_EXTENSION_OVERRIDE=names)
    assert done.returncode == 0, done.stderr
    (choice,) = json.loads((tmp_path / "a.json").read_text())["plan"]
    assert not choice["native"] and choice["path"] == "trilinear filtering"
    assert "the driver lacks GL_ARB_texture_filter_anisotropic" in choice["reason"]


def test_without_vulkan_opengl_draws_and_it_is_said(tmp_path, gl_context):
    done = start(
        "run", "1", "--scene", "cornell", "--size", "16x16", "--out", "a.png", cwd=tmp_path, **NO_VULKAN
    )
    assert done.returncode == 0, done.stderr
    assert "drawing with OpenGL" in done.stderr
    assert (tmp_path / "a.png").is_file()


def test_a_cache_that_cannot_be_written_costs_time_only(tmp_path, vulkan_instance):
    blocked = tmp_path / "cache"
    blocked.write_text("a file where the folder should be")
    done = start(
        *("run", "1", "--scene", "cornell", "--size", "16x16", "--out", "a.png"),
        cwd=tmp_path,
        STRATA_CACHE=str(blocked),
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").is_file()


def test_two_at_once_give_the_same_picture(tmp_path, vulkan_instance):
    words = ("run", "1", "--scene", "cornell", "--size", "32x32", "--out")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "STRATA_CACHE": str(tmp_path / "cache")}
    both = [
        subprocess.Popen(
            [sys.executable, "-P", "-m", "chapters", *words, f"{name}.png"],
            cwd=tmp_path,
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        for name in "ab"
    ]
    for process in both:
        _, err = process.communicate(timeout=60)
        assert process.returncode == 0, err
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
