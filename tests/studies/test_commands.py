"""Studies as a user types them: found by name, listed in teaching order, run, refused in a sentence."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

import chapters
from chapters import studies
from common.errors import StaleFrameError, UnsupportedError, UserError
from common.images import read_image
from common.lessons import Study
from tests.support.drivers import checked

ALL = list(studies.available(1))
ORDER = ["clear-window", "first-triangle", "rotating-cube", "textured-mesh", "one-light"]


@pytest.fixture
def strata(strata, monkeypatch):
    """Run a command as everywhere, in a wide terminal: names of studies are not broken."""
    monkeypatch.setenv("COLUMNS", "200")
    return strata


# --- names ---


@pytest.mark.parametrize(
    "text", ["1/first-triangle", "ch01/first_triangle", "01/First-Triangle", "1/first-triangle/"]
)
def test_a_study_is_found_however_its_name_is_written(text):
    assert chapters.parse(text) == "1/first-triangle"


def test_a_number_is_still_a_chapter():
    assert chapters.parse("1") == 1 and chapters.parse_chapter("ch01") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1/frist-triangle", "Chapter 1 has no study 'frist-triangle'; did you mean 'first-triangle'?"),
        ("1/", "'clear-window', "),
        ("1/../ch01", "Chapter 1 has no study '../ch01'"),
        ("99/first-triangle", "There is no chapter 99"),
        ("x/first-triangle", "There is no folder x/first-triangle"),
    ],
)
def test_an_unknown_one_is_a_sentence_with_the_near_name(strata, text, said):
    code, out, err = strata("run", text)
    assert (code, out) == (2, "")
    assert said in err and err.count("\n") == 1


def test_studies_stand_in_teaching_order_and_the_ideas_are_listed(strata):
    assert list(studies.available(1))[: len(ORDER)] == ORDER
    code, out, _ = strata("list", "1")
    places = [out.index(name) for name in ORDER]
    assert code == 0 and places == sorted(places)
    for about in studies.available(1).values():
        assert about.idea.split()[0] in out
    code, out, _ = strata("list", "1/one-light")
    assert code == 0
    for part in ("Study 1/one-light", "mesh.frag", "color, depth", "instance, brightness"):
        assert part in out
    code, out, _ = strata("list", "1/one-light", "--settings")
    assert code == 0 and "brightness" in out and "Presets" not in out
    code, out, _ = strata("list", "1/rotating-cube", "--settings")
    assert (code, out) == (0, "Study 1/rotating-cube has no settings: there is nothing for --set.\n")


def test_a_sentence_is_what_an_idea_is():
    with pytest.raises(ValueError, match="no sentence"):
        Study("a", "no full stop", 1)


# --- running ---


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_study_takes_the_options_of_a_chapter(request, strata, tmp_path, backend):
    device = request.getfixturevalue("vulkan_instance" if backend == "vulkan" else "gl_context")
    code, out, err = strata(
        *(
            "run",
            "1/rotating-cube",
            "--backend",
            backend,
            "--size",
            "48x32",
            "--frames",
            "3",
            "--time",
            "1.5",
        ),
        *("--out", "cube.png", "--json", "run.json", *checked(device, backend), "-v"),
    )
    assert code == 0, err
    assert "Study 1/rotating-cube" in err and "cube.png" in err
    assert "rotating cube" in out  # the pass, in the table of times
    picture = read_image(tmp_path / "cube.png")
    assert picture.shape == (32, 48, 3) and len(np.unique(picture)) > 20
    record = json.loads((tmp_path / "run.json").read_text())
    assert (record["chapter"], record["title"]) == ("1/rotating-cube", "rotating cube")
    assert record["backend"] == backend and record["size"] == [48, 32]
    assert [frame["work"]["triangles"] for frame in record["frames"]] == [12, 12, 12]


def test_a_picture_without_a_name_is_called_after_the_study(strata, tmp_path, vulkan_instance):
    assert strata("run", "1/clear-window", "--size", "8x8", "--backend", "vulkan")[0] == 0
    code, _, err = strata(
        *("run", "1/one-light", "--size", "8x8", "--backend", "vulkan"),
        *("--scene", "cornell", "--set", "instance=2"),
    )
    assert code == 0, err
    made = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert made == ["ch01-clear-window.png", "ch01-one-light-cornell.png"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("run", "1/first-triangle", "--scene", "cornell"), "leave --scene out"),
        (("run", "1/one-light", "--environment", "sky"), "leave --environment out"),
        (("run", "1/one-light", "--quality", "high"), "leave --quality out"),
        (("run", "1/one-light", "--out", "a.exr"), "write a .png"),
        (("run", "1/one-light", "--set", "instance=7000000", "--headless"), "its objects are 0 to"),
        (("run", "1/one-light", "--set", "instance=no"), "instance must be a whole number"),
        (("run", "1/first-triangle", "--set", "speed=2"), "no setting 'speed': there is none to set here."),
        (("run", "1/one-light", "--scene", "cornel"), 'did you mean "cornell"'),
        (("bench", "1/first-triangle"), "write 1."),
    ],
)
def test_what_a_study_cannot_do_is_one_sentence(strata, words, said):
    code, _, err = strata(*words)
    assert code == 2
    assert said in err and err.count("\n") == 1, err


def test_a_package_is_not_asked_for_that_would_not_help(strata, monkeypatch):
    """A study that gives no linear light says so whether or not the package of .exr is there."""
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    code, _, err = strata("run", "1/one-light", "--out", "a.exr")
    assert code == 2 and "write a .png" in err and "pip" not in err and err.count("\n") == 1


def test_a_backend_that_a_study_lacks_is_named_with_the_other(monkeypatch):
    monkeypatch.setitem(studies.FILES, "gl", "missing.py")
    with pytest.raises(UnsupportedError, match="has no OpenGL version: use --backend vulkan"):
        studies.renderer_module("1/first-triangle", "gl")


def test_an_empty_scene_has_no_object_to_draw(stage):
    from common.scene.primitive import nothing

    for name in ("textured-mesh", "one-light"):
        with pytest.raises(UserError, match="draws nothing"):
            stage.open(name, (8, 8), nothing("empty"))


# --- the contract ---


@pytest.mark.parametrize("name", ALL)
def test_a_study_keeps_the_contract_of_a_renderer(stage, name):
    with stage.open(name, (16, 12)) as renderer:
        view = chapters.view_of(renderer)
        frames = [renderer.render(view, 0.1 * index) for index in range(3)]
        assert [frame.index for frame in frames] == [0, 1, 2]
        assert frames[2].image("color").shape == (12, 16, 3)
        with pytest.raises(StaleFrameError, match="slot was used again"):
            frames[0].image("color")
        with pytest.raises(StaleFrameError, match="not among this renderer's outputs"):
            frames[2].image("depth")
        assert renderer.idle(view, 0.2)
        assert renderer.idle(view, 0.3) == (not renderer.moves)
        if name in ORDER:
            assert renderer.moves == (name != "first-triangle")
        renderer.reset_history("a test")
        again = renderer.render(view, 0.0)
        assert (again.index, again.reset, frames[0].reset, frames[1].reset) == (
            0,
            "a test",
            "first frame",
            "",
        )
    with pytest.raises(StaleFrameError, match="closed"):
        renderer.render(view)
    with pytest.raises(StaleFrameError, match="closed"):
        again.image("color")
    with pytest.raises(UserError, match="no output 'normal'"):
        stage.open(name, (16, 12), outputs=("normal",))


@pytest.mark.parametrize("name", ALL)
def test_a_study_that_fails_halfway_leaves_nothing_behind(stage, name, monkeypatch):
    module = chapters.renderer_module(f"1/{name}", stage.backend)

    def fail(self):
        raise RuntimeError("halfway")

    with stage.open(name, (8, 8)):  # what the device itself keeps is made by the first one
        pass
    before = dict(stage.device.alive)
    monkeypatch.setattr(module.Renderer, "_create_targets", fail)
    with pytest.raises(RuntimeError, match="halfway"):
        stage.open(name, (8, 8))
    monkeypatch.undo()
    monkeypatch.setattr(module.Renderer, "_set_up", fail)
    with pytest.raises(RuntimeError, match="halfway"):
        stage.open(name, (8, 8))
    assert stage.device.alive == before
