"""What is no pass, no name and no output is one sentence, and the frame goes on as before."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from backends.contract import Access, Pass
from chapters.ch04.graph.checks import check_access, check_name, check_output, check_pass, check_readers
from chapters.ch04.graph.file import graph_path, read_graph
from chapters.ch04.graph.plan import FramePlan
from chapters.ch04.graph.types import GraphError
from chapters.ch04.settings import Settings
from common.settings import replaced
from tests.support.scenes import facing, quad_scene

FORMATS = ("rgba8", "rgba16f", "r32ui", "d32f")
GOOD = Access("mine", "color", format="rgba16f")


def pass_of(**more):
    """Return a pass that is right, but for what is given."""
    made = Pass()
    vars(made).update({"name": "mine", "writes": (GOOD,)} | more)
    return made


@pytest.mark.parametrize("name", [None, 3, [], "tonemop", ""])
def test_what_is_no_name_of_a_pass(name):
    with pytest.raises(GraphError, match=r"no name of a pass|There is no pass"):
        check_name(name, ["tonemap", "forward"])


@pytest.mark.parametrize(
    "made",
    [
        pytest.param(None, id="None"),
        pytest.param("tonemap", id="text"),
        pytest.param(SimpleNamespace, id="class"),
        pytest.param(pass_of(name=""), id="empty-name"),
        pytest.param(pass_of(name=3), id="number-as-name"),
        pytest.param(SimpleNamespace(name="mine", reads=(), writes=(GOOD,)), id="other-class"),
        pytest.param(pass_of(writes=[GOOD]), id="list-of-writes"),
        pytest.param(pass_of(reads=("depth",)), id="text-as-access"),
        pytest.param(pass_of(writes=(replace(GOOD, use="colour"),)), id="use"),
        pytest.param(pass_of(writes=(replace(GOOD, format="nonsense"),)), id="format"),
        pytest.param(pass_of(writes=(replace(GOOD, scale=-1.0),)), id="negative-scale"),
        pytest.param(pass_of(writes=(replace(GOOD, scale=1e9),)), id="large-scale"),
        pytest.param(pass_of(writes=(replace(GOOD, scale=float("nan")),)), id="nan-scale"),
        pytest.param(pass_of(writes=(replace(GOOD, size=(0, 4)),)), id="empty-size"),
    ],
)
def test_what_is_no_pass(made):
    check_pass(pass_of(), FORMATS)
    with pytest.raises(GraphError) as caught:
        check_pass(made, FORMATS)
    assert "\n" not in str(caught.value) and str(caught.value).endswith((".", "?"))


@pytest.mark.parametrize(
    "readers", [["tonemap"], {"tonemap": None}, {"tonemap": {"color_hdr": 3}}, {"no": {}}]
)
def test_what_says_not_who_reads_what(readers):
    check_readers({"tonemap": {"color_hdr": "mine"}}, ["tonemap"])
    with pytest.raises(GraphError):
        check_readers(readers, ["tonemap"])


@pytest.mark.parametrize(
    ("declared", "says"),
    [
        ({"writes": (replace(GOOD, resource="other"),)}, "has to write mine, not other."),
        ({"writes": ()}, "has to write mine, not nothing."),
        ({"writes": (replace(GOOD, format="rgba8"),)}, "has to write mine, in the same way."),
        ({"reads": (Access("depth", "sampled"),)}, "has to read nothing, not depth."),
    ],
)
def test_what_takes_the_place_of_a_pass_declares_the_same(tmp_path, declared, says):
    path = tmp_path / "own.json"
    path.write_text('{"passes": [{"pass": "mine"}]}', "utf-8")
    first, same = pass_of(), pass_of()
    plan = FramePlan(read_graph(path), {"mine": first}, {}, (), FORMATS)
    with pytest.raises(GraphError) as caught:
        plan.swap("mine", pass_of(**declared))
    assert str(caught.value) == f"What takes the place of 'mine' {says}"
    assert plan.implementations()["mine"] is first
    plan.swap("mine", same)
    assert plan.implementations()["mine"] is same


def test_the_largest_and_the_smallest_scale_that_can_be():
    for scale in (1e-3, 8.0):
        check_access(replace(GOOD, scale=scale), "mine", FORMATS)
    for scale in (0.0, 8.001):
        with pytest.raises(GraphError, match="times the picture's size"):
            check_access(replace(GOOD, scale=scale), "mine", FORMATS)


@pytest.mark.parametrize(
    ("output", "made"),
    [
        ("color", replace(GOOD, format="rgba16f")),
        ("color_linear", replace(GOOD, format="rgba8")),
        ("depth", replace(GOOD, format="r32ui")),
        ("color_linear", replace(GOOD, scale=0.5)),
        ("color_linear", replace(GOOD, size=(3, 3))),
        ("color_linear", replace(GOOD, samples=4)),
    ],
)
def test_what_cannot_be_an_output(output, made):
    check_output("color_linear", "mine", GOOD, (8, 8))
    with pytest.raises(GraphError, match=f"The output '{output}' cannot be"):
        check_output(output, "mine", made, (8, 8))


@pytest.mark.variants("vulkan", "gl")
def test_a_file_with_an_output_of_another_kind_is_one_sentence_with_its_name(chapter, tmp_path):
    file = json.loads(graph_path("deferred").read_text(encoding="utf-8"))
    for outputs in ({"color": "gbuffer_normal"}, {"color_linear": "instance_id"}):
        path = tmp_path / "odd.json"
        path.write_text(json.dumps(file | {"outputs": outputs}), encoding="utf-8")
        with pytest.raises(GraphError, match=r"odd\.json.*The output '\w+' cannot be"):
            chapter.open(quad_scene(), (8, 8), Settings(graph=str(path)), outputs={"color", "color_linear"})


@pytest.mark.variants("vulkan", "gl")
def test_light_is_not_sampled_from_whole_numbers(chapter, tmp_path):
    file = json.loads(graph_path("deferred").read_text(encoding="utf-8"))
    tonemap = next(one for one in file["passes"] if one["pass"] == "tonemap")
    tonemap["reads"] = {"color_hdr": "instance_id"}
    path = tmp_path / "ids.json"
    path.write_text(json.dumps(file), encoding="utf-8")
    with pytest.raises(GraphError, match="samples 'instance_id', which holds whole numbers"):
        chapter.open(quad_scene(), (8, 8), Settings(graph=str(path)), outputs={"color"})


@pytest.mark.variants("vulkan", "gl")
def test_a_change_for_which_the_device_has_no_memory_leaves_the_frame_as_it_was(chapter, monkeypatch):
    settings = Settings(graph="deferred", aperture=1.0)
    with chapter.open(quad_scene(), (16, 12), settings, outputs={"color"}) as made:
        before = made.render(facing()).image("color")
        create, tries = made._follow_graph, []

        def fails_once():
            tries.append(1)
            if len(tries) == 1:
                raise MemoryError("the device is full")
            create()

        monkeypatch.setattr(made, "_follow_graph", fails_once)
        with pytest.raises(MemoryError):
            made.switch_pass("depth_of_field", False)
        assert made.switches["depth_of_field"] and len(tries) == 2
        assert "depth_of_field" in [step.name for step in made.graph.steps]
        for _ in range(2):
            assert np.array_equal(made.render(facing()).image("color"), before)


@pytest.mark.variants("vulkan", "gl")
def test_a_closed_renderer_has_no_size_to_change(chapter):
    made = chapter.open(quad_scene(), (16, 12), Settings(graph="deferred"))
    made.close()
    made.resize((3, 3))
    assert made.size == (16, 12)


@pytest.mark.variants("vulkan", "gl")
def test_what_a_pass_that_is_off_would_write_says_nothing_of_an_output(chapter, tmp_path):
    """A spare pass, switched off, would write the output's name at half the size; the one that does is whole."""
    settings = Settings(graph="deferred", aperture=1.0)
    spare = {"pass": "bokeh", "name": "spare", "enabled": False, "writes": {"dof_blurred": "color_focused"}}
    file = json.loads(graph_path("deferred").read_text(encoding="utf-8"))
    file["passes"].append(spare)
    path = tmp_path / "spare.json"
    path.write_text(json.dumps(file), encoding="utf-8")
    pictures = []
    for graph in ("deferred", str(path)):
        opened = replaced(settings, graph=graph)
        with chapter.open(quad_scene(), (16, 12), opened, outputs={"color", "color_linear"}) as made:
            pictures.append(made.render(facing()).image("color_linear"))
    assert np.array_equal(*pictures)
