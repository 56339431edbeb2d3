"""`strata bench --truth path-tracer`: chapters are held to light that paths find, on one scale."""

from __future__ import annotations

import json
import re
from contextlib import ExitStack
from dataclasses import replace

import pytest

from chapters import scenes
from common.errors import UnsupportedError, UserError
from common.scene import Material
from common.settings import preset, replaced
from tests.cli.test_bench_compare import made, point
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import placed, sun
from tools.bench import all_chapters, bench, truth
from tools.bench.figures.below import write_below
from tools.bench.figures.chapters import plot_all
from tools.bench.points import QUICK, Subject
from tools.bench.report import plot
from tools.run.run import open_device

FACTS = {
    "truth": "path-tracer",
    "estimated_error": 0.02,
    "by_design": "Chapter 1 draws by design no shadows.",
}


def held(chapter, scene, wanted="path-tracer", size=(32, 24), **turned):
    """Return the truth of a chapter on Vulkan, and the errors of its preset `reference` with some knobs turned."""
    with ExitStack() as stack:
        try:
            device = open_device(stack, "vulkan")
        except UnsupportedError as error:
            pytest.skip(f"no Vulkan: {error}")
        subject = Subject(chapter, "vulkan", scene, size, device)
        found = truth.truth_of(subject, wanted, QUICK, lambda name, part: None)
        settings = replaced(preset(subject.settings_class, "reference"), **turned)
        return found, found.errors(subject.pictures(settings))


def floor():
    """Return the ground of the yard alone, in the sun: nothing stands in any light, and no light is reflected twice."""
    light, pose = sun((0.3, -1.0, 0.2))
    ground = placed((0.0, 0.0, 0.0), (8.0, 8.0), (0.0, 1.0, 0.0))
    scene = quad_scene(Material(roughness=0.4, metallic=0.3, double_sided=True), matrices=(ground,))
    nodes = nodes_at(ground, pose)
    return replace(scene, lights=[replace(light, node=1)], nodes=nodes)


@pytest.mark.feature("tools/bench")
def test_what_chapter_1_draws_in_full_has_no_error():
    """Colours are drawn with halves, whose relative steps are 2^-11. Edges are smooth in both, or in neither."""
    found, errors = held(1, floor(), "path-tracer-centre", msaa=1)
    light = found.picture[0]
    assert found.facts["estimated_error"] <= truth.QUICK_GOAL and (light > 0).any(axis=-1).mean() > 0.5
    assert errors["relative_mse"] < 2.0**-22 and errors["max_abs"] < 1e-3
    assert held(1, floor())[1]["max_abs"] < 0.3 < held(1, floor(), "path-tracer-centre")[1]["max_abs"]


@pytest.mark.feature("tools/bench")
def test_shadows_are_nearer_to_the_truth_than_none():
    scene = scenes.load("cornell")
    errors = [held(chapter, scene)[1]["relative_mse"] for chapter in (1, 8)]
    assert errors[1] < 0.8 * errors[0]


@pytest.mark.feature("tools/bench")
def test_a_quick_look_says_what_errors_are_against(strata):
    words = "bench 1 --quick --scene cornell --size 16x12 --truth path-tracer --only settings --json -"
    code, printed, said = strata(*words.split())
    record = json.loads(printed)
    assert code == 0 and record["parts"] == ["settings"]
    facts = record["reference"]
    assert facts["truth"] == "path-tracer" and 0 < facts["estimated_error"] < 0.5
    assert "traced by paths anywhere in a pixel" in said and "no shadows" in said
    assert all(0 < one["error"]["relative_mse"] < 1 for one in record["points"])


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ("bench 1 --truth paths", "There is no truth 'paths'"),
        ("bench 1 --truth path-tracer --record", "leave out --truth, or --record"),
        ("bench 1 --truth path-tracer --only start", "is for pictures of the part settings"),
        ("bench --all --truth path-tracer --only start", "is for pictures of the part settings"),
        ("bench --all --plot a.png", "--truth path-tracer"),
        ("bench --all --truth path-tracer --plot a.txt", "write one of"),
    ],
)
def test_a_wrong_wish_is_one_sentence(strata, monkeypatch, words, part):
    monkeypatch.setattr(bench, "measure", None)
    monkeypatch.setattr(all_chapters, "one", None)
    code, printed, said = strata(*words.split())
    assert (code, printed) == (2, "") and part in said and said.count("\n") == 1


@pytest.mark.needs("matplotlib")
def test_the_plot_of_a_chapter_says_what_is_left_out(tmp_path):
    """As the terminal does. A plot against the chapter's own reference leaves nothing out."""
    said = f"{FACTS['by_design']} {'Rough metals reflect all of it. ' * 6}".strip()
    own = {"preset": "reference", "samples_per_pixel": 16}
    drawn = {}
    for name, facts in (("own", own), ("traced", FACTS | {"by_design": said})):
        plot(tmp_path / f"{name}.svg", made(point("low", 1.0), point("high", 2.0), reference=facts))
        drawn[name] = (tmp_path / f"{name}.svg").read_text("utf-8")
    lines = re.findall(r"<!-- (.*?) -->", drawn["traced"])
    at = next(number for number, line in enumerate(lines) if line.startswith("Chapter 1 draws by design"))
    assert " ".join(lines[at:]).startswith(said) and len(lines[at]) < len(said)
    assert "by design" not in drawn["own"]


@pytest.mark.needs("matplotlib")
def test_what_stands_below_a_plot_is_inside_of_it_and_below_its_panels():
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 4.8), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel("GPU time")
    write_below(figure, [FACTS["by_design"] * 9, "", "Another sentence."])
    figure.draw_without_rendering()
    text = figure._supxlabel.get_window_extent()
    whole = figure.bbox
    assert whole.x0 <= text.x0 < text.x1 <= whole.x1 and whole.y0 <= text.y0
    assert text.y1 <= axes.get_tightbbox().y0
    assert figure.get_supxlabel().splitlines()[-1] == "Another sentence."
    plain = Figure(layout="constrained")
    write_below(plain, [""])
    assert plain.get_supxlabel() == ""


@pytest.mark.needs("matplotlib")
def test_one_plot_has_the_presets_of_all_chapters(tmp_path):
    records = [
        made(point("low", 1.0), point("high", 2.0), chapter=number, reference=FACTS, backend=api)
        for number in (1, 2)
        for api in ("vulkan", "gl")
    ]
    plot_all(tmp_path / "all.svg", records)
    drawn = (tmp_path / "all.svg").read_text("utf-8")
    for words in ("chapter 1, vulkan", "chapter 2, gl", "By design chapters 1, 2: no shadows."):
        assert words in drawn
    with pytest.raises(UserError, match="nothing to draw"):
        plot_all(tmp_path / "none.svg", [])


def test_errors_of_a_record_are_told_with_their_truth():
    own = {"preset": "reference", "samples_per_pixel": 16}
    assert truth.sentence(own) == "Errors are against the reference at 16 samples a pixel."
    assert truth.sentence(FACTS).endswith("an estimated error of 0.02. Chapter 1 draws by design no shadows.")
    assert "centres" in truth.sentence(FACTS | {"truth": "path-tracer-centre"})
