"""What a bench says of frame graphs, the depth pre-pass and the G-buffer: measured small, and of figures made up."""

from __future__ import annotations

import json
from contextlib import ExitStack

import numpy as np
import pytest
from rich.console import Console

import chapters
from chapters import scenes
from chapters.ch04.benches import gbuffer
from chapters.ch04.benches import graph as bench_graph
from chapters.ch04.settings import Settings
from common.errors import UserError
from common.reports.benches import Effort, middle
from common.scene.crowds import layers
from tools.bench import bench, report
from tools.bench import prepass as bench_prepass
from tools.bench.points import Subject
from tools.run.run import open_device

SMALL = Effort(1, 1, 1, 1, 1, everything=False)
SIZE = (16, 8)


@pytest.fixture(scope="module")
def subject(vulkan_instance):
    """The box, small, on a device of its own."""
    with ExitStack() as stack:
        device = open_device(stack, "vulkan")
        yield Subject(4, "vulkan", scenes.load("cornell"), SIZE, device)


def nothing(what, part):
    """Report nothing."""


def strict(made):
    """Return what a reader of the JSON gets, that knows no NaN."""
    return json.loads(json.dumps(made, allow_nan=False))


@pytest.fixture(scope="module")
def graph(subject):
    """The part `graph`, of few passes and few frames."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench_graph, "ROUNDS", 2)
        patch.setattr(bench_graph, "SIZE", SIZE)
        submit = subject.device.fn.vkQueueSubmit2
        made = bench_graph.measure(subject, SMALL, nothing, chains=(3,), passes=(5,))
        assert subject.device.fn.vkQueueSubmit2 is submit  # it was watched meanwhile
    return strict(made)


@pytest.mark.feature("tools/bench")
def test_memory_of_each_frame_is_told_with_sharing_and_without(graph):
    assert [one["name"] for one in graph["graphs"]] == list(bench_graph.GRAPHS)
    for one in graph["graphs"]:
        assert 0 < one["transient_bytes_bound"] <= one["transient_bytes"] <= one["transient_bytes_alone"]
        assert 0 < one["transitions"] <= one["barriers"]
        assert len(one["left_out"]) == one["passes_skipped"] and all(one["left_out"].values())
        assert one["compile_ms"] > 0
    lens, deferred, forward = graph["graphs"]
    assert lens["transient_bytes"] < lens["transient_bytes_alone"]
    assert lens["passes"] == deferred["passes"] + 3 and "bokeh" in deferred["left_out"]
    assert forward["transient_bytes_alone"] < deferred["transient_bytes_alone"]


def test_frames_are_timed_in_every_way(graph):
    assert [(one["passes"], one["way"]) for one in graph["frames"]] == [(5, way) for way in bench_graph.WAYS]
    for one in graph["frames"]:
        assert one["frames"] == 2
        assert 0 < one["driver_least_us"] < one["render_least_us"]
        assert 0 < one["own_us"] < one["render_us"]
    (chain,) = graph["chains"]
    assert chain["passes"] == 3 and 0 < chain["compile_least_ms"] <= chain["compile_ms"]


def test_added_passes_are_drawn_between_the_curve_and_what_it_reads(subject):
    """The curve over what is white is white, however often: the picture of the added passes is told from the other."""
    pictures = []
    for again in (True, False):
        settings = Settings(resubmit=again)
        with subject.open(settings, {"color"}) as renderer:
            before = renderer.render(chapters.view_of(renderer)).image("color")
            bench_graph.repeat(renderer, 6)
            names = [made.name for made in renderer.passes]
            assert len(names) == 6 and names[-1] == "tonemap" and names[-2].startswith("tonemap ")
            for _ in range(3):
                frame = renderer.render(chapters.view_of(renderer))
            assert frame.work["recorded"] != again
            pictures.append(frame.image("color"))
            assert not np.array_equal(pictures[-1], before)
    assert np.array_equal(*pictures)


@pytest.mark.feature("tools/bench")
def test_the_prepass_shades_each_pixel_once_and_changes_no_bit(subject, monkeypatch):
    monkeypatch.setattr(bench_prepass, "LAYERS", (1, 3))
    monkeypatch.setattr(bench_prepass, "LEAST_FRAMES", 2)
    made = strict(bench_prepass.measure(subject, SMALL, nothing, lamps=2))
    pixels = made["pixels"] = SIZE[0] * SIZE[1]
    assert len(made["points"]) == 8
    for point in made["points"]:
        assert point["error"] == {"max_abs": 0.0, "pixels_differ": 0}
        assert point["gpu_ms"] > 0
        assert ("depth_prepass" in point["passes_ms"]) == point["prepass"]
        least = pixels * (1 if point["prepass"] else point["layers"])
        # What runs beside a triangle's edges, for derivatives' sake, some devices count too.
        assert least <= point["shaded"] <= 1.5 * least
    assert subject.device.has("pipeline-statistics") == made["points"][0]["counted"]


def test_without_a_counter_the_scene_says_how_often_is_shaded(subject, monkeypatch):
    monkeypatch.setattr(type(subject.device), "has", lambda self, feature: feature != "pipeline-statistics")
    runs = [bench_prepass._Run("forward", 4, prepass, None) for prepass in (False, True)]  # type: ignore[arg-type]
    for run, factor in zip(runs, (4, 1), strict=True):
        run.renderer = type("Bare", (), {"device": subject.device})()  # type: ignore[assignment]
        assert bench_prepass._shaded(run, SIZE) == (factor * SIZE[0] * SIZE[1], False)


@pytest.mark.feature("tools/bench")
def test_every_format_has_its_bytes_and_errors_of_its_own(subject):
    (made,) = strict(gbuffer.measure(subject, SMALL, nothing, "cornell"))
    points = {point["format"]: point for point in made["points"]}
    # Base colour, normal, material, emission, depth.
    assert {name: point["bytes"] for name, point in points.items()} == {
        "compact": 4 + 4 + 4 + 8 + 4,
        "half": 4 + 8 + 4 + 8 + 4,
        "full": 4 * 16 + 4,
    }
    assert points["full"]["error"]["full"]["pixels_differ"] == 0
    for truth in ("full", "forward"):
        errors = {name: point["error"][truth]["relative_mse"] for name, point in points.items()}
        assert errors["full"] < 1e-6 < 10 * errors["compact"] < 1e-2
    for point in points.values():
        assert point["gpu_ms"] > 0 and point["passes_ms"].keys() == set(gbuffer.PASSES)
        assert 0 < point["gpu_ms"] < 1e5 and made["forward_ms"] > 0


def test_a_chapter_without_a_graph_has_none_of_these_parts(subject):
    parts = {"graph", "prepass", "gbuffer"}
    assert parts <= set(bench.parts_of(4, "gl")) and not parts & set(bench.parts_of(3, "vulkan"))
    with pytest.raises(UserError, match=r"chapter 3 names none in its settings \(depth_prepass\)"):
        bench.parts_of(3, "vulkan", ["prepass"])
    older = Subject(3, "vulkan", subject.scene, SIZE, subject.device)
    assert bench_graph.measure(older, SMALL, nothing) is None
    assert bench_prepass.measure(older, SMALL, nothing) is None
    assert gbuffer.measure(older, SMALL, nothing, "cornell") == []


# --- what is said -----------------------------------------------------------------------------------------------------


def layer(path, count, prepass, gpu_ms, differ=0):
    """Return a point of the part `prepass`."""
    shaded = 100 * (1 if prepass else count)
    passes = {"depth_prepass": 0.5} if prepass else {}
    made = {"path": path, "layers": count, "prepass": prepass, "gpu_ms": gpu_ms, "noise_ms": 0.1}
    return {
        **made,
        "passes_ms": passes,
        "shaded": shaded,
        "counted": True,
        "error": {"pixels_differ": differ},
    }


def prepass(*points):
    """Return the part."""
    return {"lamps": 3, "pixels": 100, "points": list(points)}


def test_the_prepass_pays_from_where_it_pays_for_good():
    times = {1: (2.0, 1.0), 2: (2.0, 2.1), 4: (4.0, 2.2), 8: (8.0, 2.4)}  # at one layer by chance
    points = [layer("forward", n, on, times[n][on]) for n in times for on in (False, True)]
    first, second = bench_prepass.sentences(prepass(*points))
    assert "a frame of 1 layer 2.00 times" in first and "8 layers 3.33 times" in first
    assert "pays from 4 layers on" in first and "same to the bit" in second
    never = [layer("deferred", 2, False, 2.0), layer("deferred", 2, True, 1.9, differ=5)]
    first, second = bench_prepass.sentences(prepass(*never))
    assert "does not pay by more than the noise" in first
    assert "deferred with 2 layers in 5 pixels" in second
    never[0]["counted"] = False
    assert "counts no fragments" in bench_prepass.sentences(prepass(*never))[-1]


def test_a_graph_says_what_sharing_saves_and_what_a_pass_more_costs():
    frames = {"transient_bytes": 70, "transient_bytes_alone": 100, "transient_bytes_bound": 60}
    times = [
        {"passes": passes, "way": way, "frames": 9, "own_us": own}
        for way, few, many in (("sent again", 100.0, 100.0), ("recorded anew", 200.0, 1100.0))
        for passes, own in ((5, few), (50, many))
    ]
    made = {"graphs": [{"name": "a", **frames}], "frames": times}
    first, second, third = bench_graph.sentences(made)
    assert "saves 30.0% in the frame a" in first and "more than 40.0%" in first
    assert "100 us with 50; 0.00 us for each pass more" in second and "20.00 us for each" in third
    made["graphs"][0]["transient_bytes"] = 100
    assert "No two images" in bench_graph.sentences(made)[0]


def test_tables_and_panels_show_every_part(graph, capsys):
    points = [layer("forward", n, on, 1.0 + n) for n in (1, 4) for on in (False, True)]
    error = {"relative_mse": 1e-5, "max_abs": 0.004, "flip": None, "max_linear": 2.0, "pixels_differ": 3}
    times = {"gpu_ms": 1.5, "noise_ms": 0.1}
    point = {"format": "tiny", "bytes": 12, **times, "error": {"full": error, "forward": error}}
    made = {"graph": graph, "prepass": prepass(*points), "gbuffer": [{"scene": "box", "points": [point]}]}
    for part in made:
        report.shows(part).show(made[part], Console(width=100))
    said = capsys.readouterr().out
    for word in ("deferred with a lens", "vkQueueSubmit2", "camera moves", "4.00", "tiny", "0.0040"):
        assert word in said
    if report.can_plot():
        from matplotlib.figure import Figure

        for part in made:
            axes = Figure().add_subplot()
            report.shows(part).plot(axes, made[part])
            assert axes.get_title() and axes.get_ylabel() and axes.get_legend() is not None


def test_the_middle_of_figures():
    assert middle([4.0, 1.0, 2.0, 3.0, 100.0]) == (3.0, 1.0)
    assert np.isnan(middle([])).all()


def test_layers_cover_the_picture_one_behind_the_other():
    scene = layers(5, lamps := 4)
    assert len(scene.instances) == 5 and len(scene.lights) == lamps
    depth = scene.instances.local[:, 2, 3]
    assert (np.diff(depth) > 0).all() and depth[-1] == 0  # the camera looks along -z, the nearest comes last
    half = np.tan(scene.cameras[0].yfov / 2) * (2.0 - depth)
    assert (scene.instances.local[:, 0, 0] > 4 * half).all() and (scene.instances.local[:, 1, 1] > half).all()
    material = scene.meshes["material"][scene.instances.mesh]
    assert (material[1:] != material[:-1]).all()
    with pytest.raises(ValueError, match="at least one layer"):
        layers(0)
