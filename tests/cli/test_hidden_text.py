"""Whatever a file is called and says, the terminal gets what can be seen, and each backend a name that it takes."""

from __future__ import annotations

import json

import pytest
from rich.table import Table

from common.images import read_image
from tests.common.gltf.test_hidden_text import BAD, SEEN, named
from tests.support.drivers import needs_layers
from tools.cli.console import out, say


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of its own."""
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))


@pytest.mark.parametrize("chapter", [1, 3, 5])
@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_scene_of_such_names_is_drawn_like_any_other(strata, tmp_path, chapter, backend, vulkan_instance):
    if backend == "vulkan":
        needs_layers(vulkan_instance)
    pictures = []
    for text in ("plain", BAD):
        path = named(text).write(tmp_path)
        code, printed, err = strata(
            *(
                "run",
                str(chapter),
                "--backend",
                backend,
                "--scene",
                path,
                "--size",
                "32x24",
                "--out",
                "a.png",
            ),
            *("--json", "a.json", "-v", "--validate"),
        )
        assert code == 0, err
        pictures.append(read_image(tmp_path / "a.png"))
    assert (pictures[0] == pictures[1]).all()
    assert f"strata: scene: The extension {SEEN} is not supported" in err
    assert not any(line.startswith("strata: all is well") for line in err.splitlines())
    assert (err + printed).replace("\n", "").isprintable()
    record = json.loads((tmp_path / "a.json").read_text())
    assert all(text.isprintable() for text in record["scene"]["warnings"])


def test_an_examination_and_a_conversion_show_it_too(strata, tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_ASSETS", str(tmp_path / "models"))
    path = named(BAD).write(tmp_path)
    code, printed, err = strata("assets", "add", path, "--name", "bad")
    assert code == 0 and (err + printed).replace("\n", "").isprintable() and r"\ud800" in printed
    code, printed, err = strata("convert", path, "files")
    assert code == 0 and (err + printed).replace("\n", "").isprintable()
    about = json.loads((tmp_path / "files" / "scene.json").read_text())
    assert about["meshes"] == [SEEN] and about["textures"][0].isascii()


def test_nothing_that_is_printed_steers_the_terminal(capsys):
    """Also where a text came another way than through a scene: the console writes out all but lines and tabs."""
    made = Table(title="a\x1b[2Jb")
    made.add_column("c\x9bd")
    made.add_row("e\u202ef\ud800")
    say("g\x1bh\n\ti\udcff")
    out.print(made)
    out.print("j\x07k", markup=False)
    printed, err = capsys.readouterr()
    assert err.split() == [r"g\x1bh", r"i\xff"]  # rich makes a tab spaces
    for text in (r"a\x1b[2Jb", r"c\x9bd", r"e\u202ef\ud800", r"j\x07k"):
        assert text in printed
