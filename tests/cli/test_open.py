"""`chapters.open` from Python: a wrong argument is a UserError of one sentence, whatever the backend."""

from __future__ import annotations

import re

import numpy as np
import pytest

import chapters
from chapters import scenes
from common.errors import UserError
from common.images import read_image
from common.paths import ROOT
from tests.support.scenes import facing, quad_scene
from tools.run import shown


@pytest.mark.parametrize("backend", ["vulkan", pytest.param("gl", marks=pytest.mark.needs("moderngl"))])
@pytest.mark.parametrize("scene", [None, "atrium"])
def test_what_is_no_scene_is_refused_before_a_device_is_opened(backend, scene):
    with pytest.raises(UserError, match=r"is no scene: chapters\.scenes\.load"):
        chapters.open(1, backend, scene=scene)


@pytest.mark.parametrize("number", ["1", "ch01", 1])
def test_a_chapter_may_be_written_as_on_the_command_line(number, vulkan_device):
    with chapters.open(number, "vulkan", scene=quad_scene(), size=(8, 8), device=vulkan_device) as renderer:
        assert renderer.render(facing()).image("color").shape == (8, 8, 3)


@pytest.mark.parametrize("number", [99, "x", None, 1.5])
def test_a_chapter_that_is_none_is_refused(number):
    with pytest.raises(UserError, match="There is no chapter"):
        chapters.open(number, scene=quad_scene())


@pytest.mark.parametrize(
    ("here", "says"), [((1,), "chapter 1 is here"), ((1, 2), "chapters 1 to 2 are here")]
)
def test_the_chapters_that_are_here_are_named(monkeypatch, here, says):
    monkeypatch.setattr(chapters, "available", lambda: here)
    with pytest.raises(UserError, match=f"There is no chapter 3: {says}."):
        chapters.parse("3")


def test_a_backend_that_is_none_is_refused():
    with pytest.raises(UserError, match="There is no backend None"):
        chapters.open(1, None, scene=quad_scene())


EXAMPLES = re.findall(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text("utf-8"), re.M | re.S)


def test_the_example_of_the_readme_has_five_lines_and_shows_its_picture(monkeypatch, tmp_path, capsys):
    seen = []
    monkeypatch.setattr(shown, "open_viewer", lambda path: seen.append(read_image(path)) or True)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first = EXAMPLES[0]
    assert len([line for line in first.splitlines() if line]) == 5
    exec(compile(first, "README.md", "exec"), {})
    with chapters.open(1, scene=scenes.load("cornell"), size=(640, 360)) as renderer:
        assert np.array_equal(seen[0], renderer.render(chapters.view_of(renderer)).image("color"))
    assert str(tmp_path) in capsys.readouterr().err


def test_the_other_example_goes_on_from_it(monkeypatch, tmp_path, capsys):
    """With a scene that is loaded sooner than the atrium."""
    monkeypatch.chdir(tmp_path)
    space = {"chapters": chapters, "scenes": scenes}
    exec(compile(EXAMPLES[1].replace("atrium", "cornell"), "README.md", "exec"), space)
    assert space["picture"].shape == (360, 640, 3) and space["picture"].dtype == np.uint8
    assert len(np.unique(read_image(tmp_path / "depth.png"))) > 20
    assert "'forward': " in capsys.readouterr().out
