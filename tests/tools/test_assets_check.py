"""A reader's own model: examined, told about, given a name, and found by it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from chapters import scenes
from common.errors import SceneError, UserError
from common.models import store
from tests.common.gltf.builder import Gltf, triangle
from tools.assets import command
from tools.assets.check import examine

UV = np.array([(0, 0), (1, 0), (0, 1)], np.float32)
NORMALS = np.array([(0, 0, 1)] * 3, np.float32)
TRIANGLE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "cache"))


def gltf(**attributes) -> Gltf:
    """Return a file with one triangle of these attributes, beside its position."""
    made = Gltf()
    made.draw(made.primitive(POSITION=TRIANGLE, **attributes))
    return made


def add_material(made: Gltf, **entry) -> None:
    made.add("materials", entry)
    made.json["meshes"][0]["primitives"][0]["material"] = 0


def with_normal_map(**attributes) -> Gltf:
    made = gltf(**attributes)
    made.image(np.full((2, 2, 3), 128, np.uint8))
    made.add("textures", {"source": 0})
    add_material(made, normalTexture={"index": 0})
    return made


def rows(path: Path) -> dict[str, str]:
    return dict(examine(path).contents)


def test_contents_are_those_of_the_scene(tmp_path):
    made = with_normal_map(NORMAL=NORMALS, TEXCOORD_0=UV)
    made.node(mesh=0, translation=[3, 0, 0])
    found = rows(made.write(tmp_path))
    assert found["size"] == "4 x 1 x 0 m (x, y, z), around (2, 0.5, 0)"
    assert found["drawn"] == "2 objects, 2 triangles"
    assert found["geometry"] == "1 mesh, 3 vertices"
    assert found["textures"] == "1 of 2x2; 21 bytes on the device"  # 16 bytes, and 4/3 of it with its mips
    assert found["lights"] == found["cameras"] == found["animations"] == "none"


def test_a_model_without_losses_has_none(tmp_path):
    found = examine(gltf(NORMAL=NORMALS, TEXCOORD_0=UV).write(tmp_path))
    assert not found.refusal and not found.losses and not found.extensions


@pytest.mark.parametrize(
    ("made", "loss"),
    [
        (lambda: gltf(), "1 primitive has no normals: every triangle is shaded flat."),
        (
            lambda: with_normal_map(NORMAL=NORMALS, TEXCOORD_0=UV),
            "a normal map and no tangents: they are made",
        ),
        (lambda: with_normal_map(NORMAL=NORMALS), "a normal map without texture coordinates."),
        (
            lambda: gltf(NORMAL=NORMALS, _HEAT=UV, COLOR_1=NORMALS),
            "Vertex attributes COLOR_1, _HEAT are not read.",
        ),
    ],
)
def test_what_is_left_out_or_made_up_is_told(tmp_path, made, loss):
    losses = examine(made().write(tmp_path)).losses
    assert [text for text in losses if loss in text], losses


def test_pictures_and_scenes_that_nothing_draws_are_told(tmp_path):
    made = gltf(NORMAL=NORMALS)
    made.image(np.zeros((2, 2, 3), np.uint8))
    made.json["scenes"] = [{"nodes": [0]}, {"nodes": []}]
    assert examine(made.write(tmp_path)).losses == [
        "1 picture is in the file that nothing of what is drawn reads.",
        "1 further scene cannot be chosen: the default one is drawn.",
    ]


def test_an_animation_that_is_not_played_is_told(tmp_path):
    """Two clips for the same property: the first plays."""
    made = gltf(NORMAL=NORMALS)
    times = made.accessor(np.array([0, 1], np.float32))
    places = made.accessor(np.zeros((2, 3), np.float32))
    for name in ("walk", "run"):
        made.add(
            "animations",
            {
                "name": name,
                "samplers": [{"input": times, "output": places}],
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
            },
        )
    found = examine(made.write(tmp_path))
    assert dict(found.contents)["animations"] == "walk (1 s), run (1 s)"
    assert found.losses == ["run would move what an earlier animation moves, and is not played."]


@pytest.mark.parametrize(("scale", "told"), [(1e-4, True), (1.0, False), (1e5, True)])
def test_a_size_that_is_no_size_in_metres_is_told(tmp_path, scale, told):
    made = gltf(NORMAL=NORMALS)
    made.json["nodes"][0]["scale"] = [scale] * 3
    assert any("counts in metres" in text for text in examine(made.write(tmp_path)).hints) == told


def test_a_texture_that_some_devices_do_not_take_is_told(tmp_path, monkeypatch):
    path = with_normal_map(NORMAL=NORMALS, TEXCOORD_0=UV).write(tmp_path)
    assert not any("do not take" in text for text in examine(path).hints)
    monkeypatch.setattr("tools.assets.check.EVERY_DEVICE", 1)
    assert "1 texture is larger than 1 pixels, which some devices do not take." in examine(path).hints


def test_a_model_of_nothing_is_told(tmp_path, capsys):
    made = Gltf()
    made.node()
    found = examine(made.write(tmp_path))
    assert found.hints == ["Nothing of it is drawn: it has no triangles."]
    command.report(found)
    assert "All of it is drawn" not in capsys.readouterr().out


def test_an_extension_is_told_with_what_is_drawn_instead(tmp_path, capsys):
    made = gltf(NORMAL=NORMALS)
    add_material(made, extensions={"KHR_materials_clearcoat": {}, "KHR_materials_unlit": {}})
    made.json["extensionsUsed"] = ["KHR_materials_clearcoat", "KHR_materials_unlit"]
    assert command.add(made.write(tmp_path), "coat") == 0
    shown = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert "KHR_materials_clearcoat 1 of materials the surface below the coat" in shown
    assert "KHR_materials_unlit 1 of materials all of it" in shown
    assert "All of it is drawn as the file has it." not in shown


def test_a_model_that_requires_what_strata_lacks_is_not_added(tmp_path, capsys):
    """Every extension is told, not the first alone, and what to do."""
    made = gltf(NORMAL=NORMALS)
    made.json["extensionsRequired"] = ["KHR_draco_mesh_compression", "EXT_meshopt_compression"]
    assert command.add(made.write(tmp_path), "packed") == 2
    printed = capsys.readouterr()
    shown = " ".join(printed.out.split())
    assert "required: export it without Draco compression" in shown
    assert "required: export it without meshopt compression" in shown
    assert "extensionsRequired names KHR_draco_mesh_compression" in printed.err
    assert store.own_models() == {}


def test_a_damaged_file_is_a_sentence_and_not_added(tmp_path, capsys):
    (tmp_path / "broken.gltf").write_text("{", "utf-8")
    assert command.add(tmp_path / "broken.gltf") == 2
    assert "is not valid JSON" in capsys.readouterr().err
    assert store.own_models() == {}


def test_a_name_means_the_file_from_then_on(tmp_path, monkeypatch, capsys):
    path = triangle().write(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert command.add(Path(path.name), "Mine") == 0
    monkeypatch.chdir("/")
    assert scenes.find("mine") == path
    with pytest.raises(SceneError, match="There is no scene or model 'nine'; did you mean 'Mine'"):
        scenes.find("nine")
    assert scenes.load("Mine").triangle_count == 1
    other = triangle().write(tmp_path, "gltf")
    assert command.add(other, "mine") == 0
    assert f"mine was {path} before." in capsys.readouterr().err
    assert store.own_models() == {"mine": other}
    other.unlink()
    with pytest.raises(SceneError, match=r"Your model mine was .* which is gone: \./strata assets add PATH"):
        scenes.find("Mine")
    assert "stays where it is" in store.remove("MINE")
    with pytest.raises(UserError, match="There is nothing of mine to remove"):
        store.remove("mine")


@pytest.mark.parametrize(
    ("stem", "name"), [("Scan 3 (final)", "Scan-3--final-"), ("café", "caf-"), ("a_b-c", "a-b-c")]
)
def test_without_a_name_it_is_that_of_the_file(tmp_path, stem, name):
    path = triangle().write(tmp_path)
    renamed = path.rename(tmp_path / f"{stem}{path.suffix}")
    command.add(renamed)
    assert store.own_models() == {name: renamed}


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("atrium", "atrium is a scene of Strata's own: "),
        ("Cornell", "Cornell is a scene of Strata's own: "),
        ("BOX", "BOX is a model that `strata assets get` fetches: "),
        ("a/b", "'a/b' is no name for a model"),
        ("a.glb", "'a.glb' is no name"),
        ("1", "'1' is no name"),
        ("", "'' is no name"),
    ],
)
def test_a_name_that_means_something_else_is_refused(tmp_path, name, fault):
    path = triangle().write(tmp_path)
    with pytest.raises(UserError) as raised:
        command.add(path, name)
    assert fault in str(raised.value) and "--name NAME gives it another" in str(raised.value)


def test_a_list_that_cannot_be_read_is_a_sentence():
    store.writable_place().joinpath("own.json").write_text("[1", "utf-8")
    with pytest.raises(UserError, match=r"own\.json, cannot be read: remove it"):
        scenes.find("mine")
    assert scenes.find("atrium").is_file()  # our own scenes need no list


def test_nothing_that_steers_a_terminal_comes_from_a_file(tmp_path, capsys):
    made = gltf(NORMAL=NORMALS)
    made.add("cameras", {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}})
    made.json["nodes"][0] |= {"camera": 0, "name": "\x1b[31mred [bold]x[/bold]"}
    made.json["extensionsUsed"] = ["\x1b]0;title"]
    command.add(made.write(tmp_path), "red")
    shown = capsys.readouterr().out
    assert "\x1b" not in shown and "[31mred [bold]x[/bold]" in shown


def test_commands_as_typed(strata, tmp_path):
    path = triangle().write(tmp_path)
    code, out, err = strata("assets", "add", path, "--name", "three")
    assert code == 0 and "1 triangle" in out and "--scene three" in err
    code, out, err = strata("assets")
    assert code == 0 and "BoxVertexColors" in out and "three" in out and not err
    assert strata("assets", "list")[1] == out
    code, out, err = strata("assets", "get", "Box")
    assert code == 2 and "CC-BY-4.0" in err and "There is no terminal to ask at" in err
    code, out, err = strata("assets", "add", "nowhere.glb")
    assert code == 2 and "There is no file nowhere.glb" in err
    assert strata("assets", "remove", "three")[0] == 0
