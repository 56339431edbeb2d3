"""`strata graph`: what is printed, drawn and written, and one sentence for chapters and files that do not fit."""

from __future__ import annotations

import json
from types import SimpleNamespace
from xml.etree import ElementTree

import pytest

import chapters
from backends.contract import Access
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.types import GraphError, Node
from tests.common.gltf.builder import triangle


@pytest.fixture
def opened(monkeypatch):
    """Have a stand-in opened in place of a chapter's renderer; return what it was asked for."""
    asked = {}

    class StandIn:
        capabilities = SimpleNamespace(device="a stand-in")

        def __init__(self, which, backend, **options):
            asked.update(options, which=which, backend=backend)
            nodes = [
                Node("draw", (), (Access("hdr", "color", "rgba16f", clear=(0, 0, 0, 0)),)),
                Node("glow", (), (Access("x", "color", "rgba8"),), "nothing glows"),
                Node("tonemap", (Access("hdr", "sampled"),), (Access("color", "color", "rgba8"),)),
            ]
            self.graph = compile_graph(nodes, options["size"], options["outputs"])

        def __enter__(self):
            return self

        def __exit__(self, *_):
            asked["closed"] = True

    monkeypatch.setattr(chapters, "open", StandIn)
    return asked


@pytest.fixture
def box(tmp_path):
    return triangle().write(tmp_path)


def test_the_text_is_printed_and_files_are_written(strata, opened, tmp_path, box):
    code, out, err = strata(
        *("graph", "4", "--scene", box, "--size", "64x48", "--backend", "vulkan", "--set", "msaa=1"),
        *("--without", "bindless", "--outputs", "color, hdr", "--json", "g.json", "--svg", "g.svg"),
    )
    assert code == 0, err
    assert (opened["which"], opened["backend"], opened["size"]) == (4, "vulkan", (64, 48))
    assert opened["without"] == ("bindless",) and opened["outputs"] == ("color", "hdr") and opened["closed"]
    assert opened["settings"].shading.msaa == 1
    assert out.startswith("Chapter 4, ") and "2 passes at 64x48" in out
    assert "   glow  nothing glows\n" in out and "\n 1 draw (graphics, 64x48)\n" in out
    assert json.loads((tmp_path / "g.json").read_text())["left_out"] == {"glow": "nothing glows"}
    assert ElementTree.fromstring((tmp_path / "g.svg").read_text()).get("width")
    assert err.splitlines() == ["wrote g.json", "wrote g.svg"]


def test_json_on_stdout_is_nothing_but_json(strata, opened, box):
    code, out, err = strata("graph", "ch04", "--scene", box, "--json", "-")
    assert code == 0
    assert [step["name"] for step in json.loads(out)["steps"]] == ["draw", "tonemap"]
    assert " 1 draw (graphics, 640x360)" in err


def test_the_width_of_the_terminal_cuts_nothing(strata, opened, box, monkeypatch):
    wide = strata("graph", "4", "--scene", box)[1]
    monkeypatch.setenv("COLUMNS", "40")
    assert strata("graph", "4", "--scene", box)[1] == wide


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("1",), "Chapter 1 has no frame graph, since its passes are put in order by hand: ./strata graph 4 shows"),
        (("1/first-triangle",), "1/first-triangle is a study, and this is about whole chapters: write 1."),
        (("99",), "There is no chapter 99"),
        (("4", "--svg", "none/g.svg"), "--svg none/g.svg cannot be written: name a file in a folder that exists."),
        (("4", "--svg", "."), "--svg . cannot be written"),
        (("4", "--json", "none/g.json"), "--json none/g.json cannot be written"),
        (("4", "--svg", "g.png"), "--svg g.png would be a drawing under another name: write it as g.svg."),
        (("4", "--json", "g.svg", "--svg", "g.svg"), "--svg and --json both name g.svg"),
        (("4", "--set", "graph=:x:.json"), "There is no graph :x:.json"),
        (("4", "--size", "0x8"), "A picture of 0x8 pixels cannot be made"),
        (("4", "--quality", "best"), "There is no quality 'best'"),
        (("4", "--set", "nothing=1"), "'nothing'"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_one_sentence(strata, words, says):
    code, out, err = strata("graph", *words)
    assert code == 2 and out == ""
    assert says in err.replace("\\", "/") and err.count("\n") == 1


def test_what_is_wrong_with_a_graph_is_said_as_it_is(strata, monkeypatch, box):
    def refuse(*_, **__):
        raise GraphError("g.json:3:9: passes[0].pass is 'x', and there is no such pass.")

    monkeypatch.setattr(chapters, "open", refuse)
    code, out, err = strata("graph", "4", "--scene", box)
    assert (code, out) == (2, "")
    assert err == "strata: g.json:3:9: passes[0].pass is 'x', and there is no such pass.\n"


OWN = """{
  "passes": [
    {"pass": "forward"},
    {"pass": "tonemap", "enabled": false},
    {"pass": "tonemap", "name": "second", "reads": {"color_hdr": "%s"}}
  ]
}
"""


def test_the_graph_of_the_chapter_follows_a_file_of_ones_own(strata, tmp_path, box):
    words = (
        "graph",
        "4",
        "--scene",
        box,
        "--size",
        "32x16",
        "--backend",
        "vulkan",
        "--set",
        "graph=own.json",
    )
    (tmp_path / "own.json").write_text(OWN % "color_hdr")
    code, out, err = strata(*words, "--json", "g.json")
    assert code == 0, err
    made = json.loads((tmp_path / "g.json").read_text())
    assert [step["name"] for step in made["steps"]][:2] == ["forward", "second"]
    assert made["left_out"]["tonemap"] == "switched off in own.json:4"
    assert "   tonemap  switched off in own.json:4\n" in out

    (tmp_path / "own.json").write_text(OWN % "color_hdx")
    code, out, err = strata(*words)
    assert (code, out) == (2, "")
    assert err == (
        "strata: own.json:5:66: passes[2].reads.color_hdr is 'color_hdx', which no pass here writes; "
        "did you mean 'color_hdr'?\n"
    )


@pytest.mark.parametrize("name", ["deferred", "forward"])
def test_a_graph_of_the_chapter_has_every_pass_that_settings_ask_for(strata, box, name):
    words = ("graph", "4", "--scene", box, "--size", "32x16", "--backend", "vulkan", "--set", f"graph={name}")
    code, out, err = strata(
        *words,
        "--set",
        "depth_prepass=on",
        "--set",
        "aperture=2",
        "--outputs",
        "color,instance_id",
        "--json",
        "-",
    )
    assert code == 0, err
    made = json.loads(out)
    own = {"deferred": {"gbuffer", "lighting"}, "forward": {"forward"}}[name]
    always = {"depth_prepass", "instance_id", "circle_of_confusion", "bokeh", "depth_of_field", "tonemap"}
    assert {step["name"] for step in made["steps"]} == own | always | {"copy outputs"}
    assert set(made["left_out"]) == {"deferred": {"transparent"}, "forward": {"resolve"}}[name]


CIRCLE = """{"passes": [{"pass": "forward"},
 {"pass": "tonemap", "name": "a", "reads": {"color_hdr": "cb"}, "writes": {"color": "ca"}},
 {"pass": "tonemap", "name": "b", "reads": {"color_hdr": "ca"}, "writes": {"color": "cb"}},
 {"pass": "tonemap", "reads": {"color_hdr": "cb"}}]}"""


@pytest.mark.parametrize(
    "command",
    [("run", "4", "--headless"), ("frame", "4"), ("graph", "4"), ("compare", "4")],
    ids=lambda words: words[0],
)
def test_a_graph_that_cannot_be_is_one_sentence_wherever_it_is_named(strata, tmp_path, box, command):
    (tmp_path / "circle.json").write_text(CIRCLE)
    (tmp_path / "broken.json").write_text('{"passes": [')
    (tmp_path / "unknown.json").write_text('{"passes": [{"pass": "gbufer"}]}')
    for name, says in (
        ("none/x.json", "There is no graph none"),
        ("broken.json", "broken.json:1:13: this is no JSON"),
        ("unknown.json", "there is no such pass; did you mean 'gbuffer'?"),
        ("circle.json", "circle.json:2: The passes wait for each other in a circle: 'a' -> 'b'"),
    ):
        chosen = (f"4:graph={name}",) if command[0] == "compare" else ("--set", f"graph={name}")
        code, out, err = strata(*command, *chosen, "--scene", box, "--size", "16x16")
        assert (code, out) == (2, ""), (name, err)
        assert says in err and err.count("\n") == 1, err
