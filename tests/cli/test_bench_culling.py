"""What a bench says of culling: measured in a small town on both backends, and of figures made up."""

from __future__ import annotations

import copy
import json
import sys
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from chapters import scenes
from chapters.ch06.benches import levels, meshlet_sizes, pyramid, stages, streets, visible_set
from chapters.ch06.meshlets import chains
from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.settings import Settings
from common.errors import UserError
from common.numerics.transforms import pose_looking_at
from common.reports.benches import Effort
from common.scene import SceneCamera
from common.view.camera import Perspective, View
from tests.support.scenes import nodes_at
from tests.support.towns import town
from tools.bench import bench, report
from tools.bench.figures import figures
from tools.bench.points import Subject

SMALL = Effort(1, 2, 1, 1, 1, everything=False)
SIZE = (48, 27)
PARTS = ("culling", "ideal", "meshlets", "lods")
EYES = ((-9.0, 1.2, 8.0), (0.5, 1.0, 9.0), (0.0, 14.0, 9.0))


def seen_town():
    """Return a town with two views at street level, and one from above."""
    scene = town(count=30)
    eyes = [pose_looking_at(eye, (0.3, 0.4, -1.0)) for eye in EYES]
    count = len(scene.nodes.parent)
    nodes = nodes_at(*scene.nodes.matrix, *eyes)
    names = ("street-1", "street-2", "roof")
    cameras = [SceneCamera(name, count + number) for number, name in enumerate(names)]
    return replace(scene, nodes=nodes, cameras=cameras)


@pytest.fixture(scope="module", params=["vulkan", "gl"])
def subject(request):
    """A town in place of the city, on each backend."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    with pytest.MonkeyPatch.context() as patch:
        scene = seen_town()
        patch.setattr(scenes, "load", lambda name, around: scene)
        patch.setattr(visible_set, "QUICK_SIZE", SIZE)
        patch.setattr(visible_set, "WALK", 2)
        patch.setattr(visible_set, "QUICK_VIEWS", 2)
        patch.setattr(pyramid, "QUICK_SIZES", ((33, 17),))
        patch.setattr(stages, "WAYS", (stages.WAYS[0], *stages.WAYS[3:]))
        patch.setattr(levels, "QUICK_PIXELS", (0.0, 0.1, 1.0))
        patch.setattr(meshlet_sizes, "SIZES", (meshlet_sizes.SIZES[0], meshlet_sizes.SIZES[2]))
        yield Subject(6, request.param, scene, SIZE, device)


@contextmanager
def progress():
    """Give a callback for progress; at the end, assert that it never fell and stayed within 0 and 1."""
    told = []
    yield lambda what, part: told.append(part)
    assert told and told == sorted(told) and told[0] >= 0.0 and told[-1] <= 1.0, told


def measured(module, subject):
    """Return what a reader of the JSON gets, who knows no NaN."""
    with progress() as step:
        return json.loads(json.dumps(module.measure(subject, SMALL, step), allow_nan=False))


# --- measured ---------------------------------------------------------------------------------------------------------


@pytest.mark.feature("tools/bench", "culling/two-phase-occlusion")
def test_every_stage_has_its_time_and_leaves_less_than_the_one_before(subject):
    record = measured(stages, subject)
    ways = {row["way"]: row for row in record["ways"]}
    wanted = [stages.name_of(*way) for way in stages.WAYS if way[0] in ("classic", *streets.paths(subject))]
    assert list(ways) == wanted and "compute, occlusion" in wanted
    assert record["views"] == ["street-1", "street-2"]
    whole, cone, seen = (ways[name] for name in ("classic, off", "compute, cone", "compute, occlusion"))
    assert whole["work"]["triangles_drawn"] == streets.solid_triangles(subject.scene)
    drawn = [row["work"]["triangles_drawn"] for row in (whole, cone, seen)]
    assert drawn[0] > drawn[1] > drawn[2] > 0
    counts = stages.left(seen["work"])
    assert counts[0] >= counts[1] and counts[2] >= counts[3] >= counts[4] >= counts[5] > 0
    for row in ways.values():
        assert row["frame_ms"] >= row["gpu_ms"] > 0 and row["python_ms"] > 0
        assert row["wall_ms"] > 0 and row["times_faster"] >= row["times_faster_least"] > 0
        assert row["views"].keys() == {*record["views"]}
    assert whole["times_faster"] == 1.0
    if "mesh, occlusion" in ways:
        assert ways["mesh, occlusion"]["work"]["triangles_drawn"] == drawn[2]
    assert [point["size"] for point in record["pyramid"]] == [[33, 17]]
    assert all(point["noise_ms"] >= 0 for point in record["pyramid"])


@pytest.mark.feature("tools/bench", "culling/two-phase-occlusion")
def test_more_is_drawn_than_is_visible_and_less_than_of_whole_meshes(subject):
    record = measured(visible_set, subject)
    assert [row["view"] for row in record["views"]] == ["street-1", "street-2"]
    for row in record["views"]:
        assert 0 < row["visible"] <= row["meshlets"] <= row["whole"] <= record["triangles"]
        assert 0 <= row["late"] <= row["late_most"] < 1
    assert 1 <= record["ratio"] <= record["ratio_whole"]


def test_meshlets_apart_are_the_scene(subject):
    """Each pixel shows the same instance, and no triangle is drawn twice."""
    scene = copy.copy(subject.scene)
    solid = np.array([kind.alpha_mode != "blend" for kind in scene.materials])
    visible = solid[scene.meshes["material"][scene.instances.mesh]]
    scene.instances = replace(scene.instances, visible=visible)
    meshlets = build_meshlets(scene)
    apart, triangles = visible_set.meshlets_apart(scene, meshlets)
    assert triangles.sum() == streets.solid_triangles(scene) and len(triangles) > 2 * len(scene.instances)
    settings = Settings(culling="off", geometry="classic")
    pictures = []
    for drawn in (scene, apart):
        with subject.on(drawn).open(settings, {"instance_id"}) as renderer:
            view = streets.view_at(scene, "street-1", SIZE)
            pictures.append(renderer.render(view).image("instance_id").astype(int))
    units = np.where(visible, np.maximum(meshlets.ranges[:, 1].astype(int), 1)[scene.instances.mesh], 0)
    owner = np.concatenate([[0], 1 + np.repeat(np.arange(len(units)), units)])
    assert np.array_equal(owner[pictures[1]], pictures[0]) and len(np.unique(pictures[1])) > 5


@pytest.mark.feature("tools/bench", "meshlets/generation")
def test_larger_meshlets_are_fewer_and_draw_more(subject):
    rows = measured(meshlet_sizes, subject)
    paths = streets.paths(subject)
    assert [(row["vertices"], row["path"]) for row in rows] == [
        (n, path) for n in (32, 128) for path in paths
    ]
    small, large = rows[0], rows[-1]
    assert small["meshlets"] > 2 * large["meshlets"] > 0
    assert small["work"]["units_drawn"] > large["work"]["units_drawn"]
    for row in rows:
        assert 0 < row["fill"] <= 1 and 0 < row["vertex_fill"] <= 1 and row["gpu_ms"] > 0
        assert row["work"]["triangles_drawn"] == next(
            other["work"]["triangles_drawn"] for other in rows if other["vertices"] == row["vertices"]
        )


@pytest.mark.needs("meshoptimizer")
@pytest.mark.feature("tools/bench")
def test_coarser_levels_draw_less_and_are_a_little_off(subject, tmp_path, monkeypatch):
    """The time of making the levels is that of the first run alone."""
    for module in (chains, levels):
        monkeypatch.setattr(module, "cache_dir", lambda name: tmp_path)
    record = measured(levels, subject)
    assert record["views"] == ["street-1", "roof"] and record["skipped"] == ""
    assert record["build_s"] > 0 and record["frames"] == 2 * levels.TURNS
    rows = record["rows"]
    assert [row["pixels"] for row in rows] == [0, 0.1, 1]
    full, *coarser = rows
    assert full["work"]["instances_coarser"] == 0 and full["error"]["ids_differ"] == 0
    assert full["time_ratio"] == full["triangles_ratio"] == 1 and full["time_ratio_noise"] == 0
    assert full["error"]["flip"] in (0, None)
    for row in coarser:
        assert row["work"]["instances_coarser"] > 0 and row["triangles_ratio"] < 1
        assert row["gpu_ms"] > 0 and row["time_ratio"] > 0 and row["time_ratio_noise"] >= 0
        assert row["views"].keys() == {*record["views"]}
        assert 0 <= row["error"]["ids_differ"] < 0.1
    assert coarser[1]["work"]["triangles_drawn"] < coarser[0]["work"]["triangles_drawn"]
    if (flip := coarser[1]["error"]["flip"]) is not None:
        assert 0 < flip < 0.1 and 0 <= coarser[0]["error"]["flip"] < 0.1
    assert levels.made_in(subject, copy.copy(subject.scene)) is None  # the cache has them


def test_errors_are_parts_of_the_pixels():
    shown, ids = np.zeros((4, 5, 3), np.uint8), np.arange(20, dtype=np.uint32).reshape(4, 5)
    other = np.where(ids == 7, np.uint32(99), ids)
    same, off = levels.errors_between([(shown, ids), (shown + 255, other)], [(shown, ids)] * 2)
    assert same["ids_differ"] == 0 and off["ids_differ"] == 1 / 20
    assert (same["flip"], off["flip"]) in ((0, pytest.approx(0.967, abs=1e-3)), (None, None))


def test_without_the_package_levels_are_one_sentence(subject, monkeypatch):
    monkeypatch.setitem(sys.modules, "meshoptimizer", None)
    monkeypatch.setattr("chapters.ch06.meshlets.chains.cache_dir", lambda name: None)
    monkeypatch.setattr(scenes, "load", lambda name, around: copy.copy(subject.scene))
    record = measured(levels, subject)
    (line,) = levels.sentences(record)
    assert record["rows"] == [] and line.endswith("`pip install meshoptimizer==0.2.30a0`.")
    assert line.startswith("Levels of detail were not measured: making levels of detail needs the package")


def test_a_chapter_without_culling_has_none_of_these_parts(subject):
    for api in ("vulkan", "gl"):
        assert set(PARTS) <= set(bench.parts_of(6, api)) and not set(PARTS) & set(bench.parts_of(5, api))
    with pytest.raises(UserError, match=r"chapter 5 names none in its settings \(culling\)"):
        bench.parts_of(5, "vulkan", ["ideal"])
    older = Subject(5, subject.backend, subject.scene, SIZE, subject.device)
    for module in (stages, visible_set, meshlet_sizes, levels):
        assert module.measure(older, SMALL, lambda what, part: None) is None


def test_a_walk_is_level_and_as_fast_as_walking():
    start = View(pose_looking_at((0.0, 1.7, 0.0), (3.0, 5.0, -4.0)), Perspective(0.9, 0.05))
    poses = [streets.walked(start, number).world_from_view for number in (0, 60)]
    assert streets.walked(start, 0).cut and not streets.walked(start, 1).cut
    assert np.array_equal(poses[0][:, :3], poses[1][:, :3])
    assert poses[1][:3, 3] - poses[0][:3, 3] == pytest.approx((1.4 * 0.6, 0.0, -1.4 * 0.8))


def test_views_are_spread_over_the_streets():
    class Device:
        class capabilities:
            kind = "discrete"

    scene = seen_town()
    scene.cameras = [SceneCamera(f"street-{number}", 0) for number in range(16)] + scene.cameras
    scene.cameras += [SceneCamera("bird-1", 0)]
    subject = Subject(6, "vulkan", scene, (64, 36), Device)
    full = replace(SMALL, everything=True)
    assert levels.chosen_views(subject, full, scene) == ["street-0", "street-6", "bird-1", "roof"]
    assert levels.chosen_views(subject, SMALL, scene) == ["street-0", "bird-1"]
    assert len(streets.street_views(subject, full, scene)) == streets.STREETS
    assert streets.picture_size(subject, full) == streets.LARGE
    assert streets.picture_size(subject, SMALL) == (64, 36)
    assert streets.street_views(subject, SMALL, scene) == ["street-0", "street-6"]
    Device.capabilities.kind = "software"
    assert streets.street_views(subject, full, scene) == [f"street-{number}" for number in (0, 3, 6, 9)]
    assert streets.picture_size(subject, full) == (64, 36)
    assert levels.chosen_views(subject, full, scene) == ["street-0", "street-6", "bird-1", "roof"]


# --- what is said -----------------------------------------------------------------------------------------------------


def way(geometry, culling, ms, triangles, **work):
    """Return the row of a way."""
    name = stages.name_of(geometry, culling)
    times = {f"{kind}_ms": ms + more for kind, more in (("gpu", 0), ("frame", 1), ("wall", 2), ("python", 0))}
    noise = {f"{kind}_noise_ms": 0.1 for kind in ("gpu", "frame", "wall", "python")}
    passes = (
        {"gbuffer": ms} if culling == "off" else {"cull": ms / 4, "gbuffer": ms / 2, "depth_pyramid": ms / 4}
    )
    counts = {"triangles_drawn": triangles, **work}
    faster = {"times_faster": 8.0 / ms, "times_faster_least": 7.0 / ms}
    row = {"way": name, "geometry": geometry, "culling": culling, **times, **noise, **faster}
    return {
        **row,
        "passes_ms": passes,
        "work": counts,
        "views": {"street-1": {"ms": ms, "triangles": triangles}},
    }


def culling():
    """Return the part `culling`."""
    work = dict.fromkeys(stages.COUNTERS[3:], 5) | {"meshlets_tested": 30}
    work |= {"instances_tested": 10, "instances_outside": 3, "instances_hidden": 2}
    ways = [way("classic", "off", 8.0, 1000)]
    ways += [
        way(path, "occlusion", ms, 250, **{**work, "triangles_drawn": 250})
        for path, ms in (("compute", 2.0), ("mesh", 1.0))
    ]
    pyramid_ms = {"gpu_ms": 0.5, "noise_ms": 0.01}
    record = {
        "scene": "a",
        "instances": 10,
        "size": [64, 36],
        "views": ["street-1"],
        "frames": 3,
        "ways": ways,
    }
    return {**record, "pyramid": [{"size": [64, 36], **pyramid_ms}]}


def ideal():
    """Return the part `ideal`."""
    row = {
        "view": "a",
        "visible": 100,
        "visible_meshlets": 4,
        "meshlets": 150,
        "whole": 300,
        "late": 0.01,
        "late_most": 0.25,
    }
    rest = {"triangles": 1000, "frames": 8, "ratio": 1.5, "ratio_whole": 3.0, "late": 0.01}
    return {"scene": "a", "size": [1920, 1080], "views": [row], **rest}


def sizes():
    """Return the part `meshlets`."""
    rows = []
    for limits, count, ms, triangles in (((32, 62), 40, 2.0, 100), ((128, 250), 10, 1.0, 150)):
        row = dict(zip(("vertices", "triangles"), limits, strict=True))
        row |= {
            "scene": "a",
            "path": "compute",
            "meshlets": count,
            "fill": 0.5,
            "vertex_fill": 0.9,
            "share": 1.0,
        }
        work = {"units_drawn": count // 2, "triangles_drawn": triangles}
        rows.append({**row, "bytes": 99, "build_s": 0.1, "gpu_ms": ms, "noise_ms": 0.1, "work": work})
    return rows


def lods(flip=0.002):
    """Return the part `lods`."""
    rows = []
    for pixels, ms, triangles, coarser in ((0.0, 4.0, 1000, 0), (1.0, 2.0, 500, 7)):
        ratios = {"time_ratio": ms / 4, "time_ratio_noise": 0.0 if pixels == 0 else 0.1}
        ratios["triangles_ratio"] = triangles / 1000
        error = {"flip": flip and flip * pixels, "ids_differ": 0.00125 * pixels}
        view = {"ms": ms, "noise_ms": 0.1, **ratios, "triangles": triangles, "coarser": coarser, **error}
        work = {"instances_coarser": coarser, "triangles_drawn": triangles}
        row = {"pixels": pixels, "gpu_ms": ms, "noise_ms": 0.1, **ratios, "work": work, "error": error}
        rows.append({**row, "views": {"bird-1": view}})
    record = {"scene": "a", "skipped": "", "size": [64, 36], "views": ["bird-1"], "frames": 3}
    return {**record, "build_s": 21.4, "rows": rows}


def test_stages_become_sentences():
    record = culling()
    compute, mesh, both, share = stages.sentences(record)
    assert (
        "compute, occlusion" in compute
        and "4.00 times as fast" in compute
        and "3.50 times in the worst" in compute
    )
    assert "8.00 times as fast" in mesh and "noise" not in mesh
    assert "0.50 times the time of the compute path" in both
    assert "25.00% of the triangles" in share and "-6.000 ms more" in share
    record["ways"][1]["gpu_ms"] = 7.9
    assert "within the noise" in stages.sentences(record)[0]
    assert stages.left(record["ways"][1]["work"]) == [7, 5, 30, 25, 20, 15]
    assert stages.left(record["ways"][0]["work"]) == []


def test_the_visible_set_becomes_sentences():
    first, second = visible_set.sentences(ideal())
    assert "1.50 times the triangles" in first and "3.00 times" in first
    assert "1.00%" in second and "25.00%" in second
    assert "in larger ones" in visible_set.sentences({**ideal(), "size": [64, 36]})[-1]


def test_sizes_become_sentences():
    fastest, ratio = meshlet_sizes.sentences(sizes())
    assert "128 vertices are the fastest (with 32 x 2.00)" in fastest
    assert "1.50 times the triangles" in ratio and "0.25 times as many" in ratio


def test_levels_become_sentences():
    record = lods()
    line, build = levels.sentences(record)
    assert line == (
        "lod_pixels=1: selecting and drawing takes 0.50 times the time of lod_pixels=0 in the median of the views; "
        "0.50 times the triangles are drawn (0.50 to 0.50); mean FLIP is 0.0020; 0.125% of the pixels show another "
        "instance."
    )
    assert build == "Making the levels of detail took 21.4 s; the cache keeps them."
    record["rows"][1]["time_ratio"] = 1.05
    line = levels.sentences(record)[0]
    assert "1.05 times the time of lod_pixels=0 in the median of the views, within the noise;" in line
    without = {**lods(flip=None), "build_s": None}
    line, flip = levels.sentences(without)
    assert "FLIP" not in line and flip == "FLIP was not measured: it needs the package flip-evaluator."


def test_tables_and_panels_show_every_part(capsys):
    record = {"culling": culling(), "ideal": ideal(), "meshlets": sizes(), "lods": lods()}
    for part in PARTS:
        report.shows(part).show(record[part], Console(width=100))
    said = capsys.readouterr().out
    words = ("compute, occlusion", "Python ms", "64x36", "whole meshes", "128/250", "90/50", "0.50 / 0.50")
    for word in words:
        assert word in said
    if report.can_plot():
        from matplotlib.figure import Figure

        for part in PARTS:
            axes = Figure().add_subplot()
            report.shows(part).plot(axes, record[part])
            assert axes.get_title() and axes.get_ylabel() and axes.get_legend() is not None
        axes = Figure().add_subplot()
        report.shows("lods").plot(axes, {"scene": "a", "skipped": "No package.", "rows": []})
        assert axes.get_title() and [text.get_text() for text in axes.texts] == ["No package."]


def test_every_part_has_figures_to_compare():
    empty = {"points": [], "prepared": [], "start_s": {}, "stability": None}
    held = {"culling": culling(), "ideal": ideal(), "meshlets": sizes(), "lods": lods()}
    found = figures({**empty, **held})
    assert {part for part, _, _ in found} == {*PARTS}
    assert found["culling", "mesh, occlusion", "gpu_ms"].noise == 0.1
    assert found["culling", "mesh, occlusion", "instances_hidden"].kind == "fact"
    assert found["ideal", "a", "meshlets"].value == 150 and found["ideal", "a", "late"].kind == "error"
    assert found["meshlets", "32 vertices, compute", "triangles_drawn"].kind == "work"
    kinds = {"flip": "error", "triangles_drawn": "work", "instances_coarser": "fact"}
    assert all(found["lods", "1 pixels", name].kind == kind for name, kind in kinds.items())
    assert found["lods", "1 pixels", "gpu_ms"].noise == 0.1
    assert found["lods", "all", "build_s"].value == 21.4
    assert not figures({**empty, "lods": {"scene": "a", "skipped": "No package.", "rows": []}})
