"""The bench of rays: hits and geometry that are known without it, its clock, and what tables and figures say."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from chapters.ch12.benches import pass_times, rays, rays_results, rays_scenes
from chapters.ch12.benches.rays_scenes import NONE, Hits
from common.reports.benches import Effort
from common.scene.primitive import nothing
from tests.support.bench_views import drawn, shown
from tests.support.packages import BACKENDS
from tests.twins.rays import nearest
from tools.bench import bench, figures
from tools.bench.lessons import parts
from tools.bench.points import Subject

SMALL = Effort(0, 1, 1, 1, 1, everything=False)
SPHERE, RAYS = (24, 13), 1 << 10
SCENES = ("cornell", "sphere")

pytestmark = pytest.mark.feature("tools/bench")


def measured(request, backend, patch):
    """Return what a reader of the JSON gets of a quick look at few rays."""
    device = request.getfixturevalue("vulkan_device" if backend == "vulkan" else "gl_context")
    told = []
    small = {
        "QUICK_RAYS": RAYS,
        "QUICK_SCENES": SCENES[:1],
        "QUICK_SPHERE": SPHERE,
        "LEAST_ROUNDS": 1,
        "MOST_TIMES": 1,
    }
    for name, value in small.items():
        patch.setattr(rays, name, value)
    subject = Subject(12, "auto", nothing("bench"), (48, 32), device)  # as without --backend
    made = rays.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and 0.0 <= told[-1] < 1.0
    return json.loads(json.dumps(made, allow_nan=False))


@pytest.fixture(scope="module", params=BACKENDS)
def record(request):
    """Return a record without Embree, as on a machine that lacks the package."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "embreex", None)
        return measured(request, request.param, patch)


def ways_of(record):
    return list(dict.fromkeys(row["way"] for row in record["rows"]))


# --- the record -------------------------------------------------------------------------------------------------------


@pytest.mark.feature("ray-tracing/software-bvh")
def test_each_way_hits_as_many_rays_as_brute_force(record):
    geometry = rays_scenes.sphere(*SPHERE)
    corners = geometry.world()[0].astype(np.float64)
    rows = {(row["scene"], row["rays"], row["way"]): row for row in record["rows"]}
    assert len(rows) == len(record["rows"]) == 2 * 2 * len(ways_of(record))
    for kind, make in rays.KINDS.items():
        lot = make(geometry, RAYS)
        found, _, sure = nearest(corners, lot[:, :3].astype(np.float64), lot[:, 4:7].astype(np.float64))
        for way in ways_of(record):
            row = rows["sphere", kind, way]
            assert row["count"] == len(lot)
            assert abs(row["hits"] - (found >= 0).mean()) <= (~sure).mean()
            assert 0.05 < row["hits"] < 0.95
            assert row["mrays"] == pytest.approx(1e-3 * row["count"] / row["ms"])


def test_what_is_missing_is_left_out_by_name(record):
    missing = " ".join(record["missing"])
    assert "embreex" in missing and rays.EMBREE not in ways_of(record)
    assert all(row[name] is None for row in record["rows"] for name in rays.AGREEMENT)
    assert ("pipeline" in missing) == ("pipeline" not in ways_of(record))
    if record["backend"] == "gl":
        assert ways_of(record) == ["bvh"] and {row["way"] for row in record["builds"]} == {"bvh"}


def test_builds_say_what_they_built(record):
    builds = {(row["scene"], row["way"]): row for row in record["builds"]}
    for (scene, way), row in builds.items():
        assert row["triangles"] == (2 * SPHERE[0] * (SPHERE[1] - 1) if scene == "sphere" else 82)
        assert row["instances"] == (1 if scene == "sphere" else 6)
        assert row["ms"] > 0.0 and row["bytes"] > 48 * row["triangles"] * (way == "bvh")
    refits = {(row["way"], row["what"]): row for row in record["refits"]}
    assert refits["bvh", "build on the GPU"]["dispatches"] > refits["bvh", "refit"]["dispatches"] > 3
    assert (("driver", "refit") in refits) == (len(ways_of(record)) > 1)


@pytest.mark.needs("embreex")
def test_all_ways_agree_with_embree_off_edges(request, vulkan_device):
    with pytest.MonkeyPatch.context() as patch:
        found = measured(request, "vulkan", patch)
    compared = [row for row in found["rows"] if row["equal"] is not None]
    assert not any("embreex" in text for text in found["missing"]) and len(compared) >= 4
    for row in compared:
        assert row["differ"] == 0 and row["equal"] == 1.0 and row["edges"] < 0.1
        assert row["t_within"] > 0.99 and row["t_of_size"] < 1e-5
    text = shown(rays, found, 120)
    assert "x of embree" in text and "0 hit another triangle" in text


# --- what it says -----------------------------------------------------------------------------------------------------


def test_tables_and_figures_say_all_rows(record):
    text = shown(rays, record, 80)
    tables = text.partition("Left out: embree")[0]
    assert max(map(len, tables.splitlines())) <= 80 and tables != text
    assert all(name in text for name in (*SCENES, *ways_of(record), "build on the GPU"))
    found = dict(figures.PARTS["rays"]({"rays": record}))
    assert len(found) == len(record["rows"]) + len(record["builds"]) + len(record["refits"])
    assert dict(figures.PARTS["rays"]({})) == {}


@pytest.mark.needs("matplotlib")
def test_a_plot_has_bars_for_each_way(record):
    assert drawn(rays, record) == ways_of(record)


def test_speeds_are_given_beside_those_of_others():
    row = {"scene": "s", "rays": "camera", "count": 10, "equal": None}
    rows = [
        {**row, "way": way, "mrays": speed} for way, speed in (("bvh", 2.0), ("query", 1.0), ("embree", 8.0))
    ]
    made = {"missing": [], "software": True, "rows": rows, "builds": [], "refits": []}
    assert "2.00x of query, 0.25x of embree" in " ".join(rays_results.sentences(made))


# --- geometry and rays ------------------------------------------------------------------------------------------------


def test_the_sphere_is_closed_and_seen_from_outside():
    """Each edge is there once in each direction; the volume by the divergence theorem is near that of a ball."""
    geometry = rays_scenes.sphere(*SPHERE)
    (indices, positions), *more = geometry.meshes
    assert not more and len(indices) == 2 * SPHERE[0] * (SPHERE[1] - 1)
    edges = np.concatenate([indices[:, [0, 1]], indices[:, [1, 2]], indices[:, [2, 0]]])
    assert len(np.unique(edges, axis=0)) == len(edges)
    assert {tuple(edge) for edge in edges.tolist()} == {tuple(edge[::-1]) for edge in edges.tolist()}
    a, b, c = positions[indices].astype(np.float64).transpose(1, 0, 2)
    volume = (np.cross(a, b) * c).sum() / 6
    assert 0.85 < volume / (4 / 3 * np.pi) < 1.02


def test_camera_rays_are_those_of_the_lens():
    """The corners of the picture are at the tangent of half the vertical angle, a half pixel inside."""
    geometry = rays_scenes.sphere(*SPHERE)
    lot = rays_scenes.camera_rays(geometry, 1600)
    height, width = 30, 53
    assert len(lot) == width * height
    assert np.allclose(lot[:, :3], (0, 0, 2.6)) and (lot[:, 7] == np.float32(rays_scenes.FAR)).all()
    slope = np.tan(geometry.view.projection.yfov / 2)
    x, y = slope * (width - 1) / height, slope * (height - 1) / height
    corner = np.array([-x, y, -1.0])
    assert np.allclose(lot[0, 4:7], corner / np.linalg.norm(corner), atol=1e-6)
    assert np.allclose(lot[-1, 4:7] * (-1, -1, 1), lot[0, 4:7], atol=1e-6)


def test_random_rays_begin_in_the_box_and_repeat():
    geometry = rays_scenes.sphere(*SPHERE)
    lot = rays_scenes.random_rays(geometry, 500)
    low, high = geometry.box()
    size = high - low
    assert ((lot[:, :3] >= low - size / 8 - 1e-6) & (lot[:, :3] <= high + size / 8 + 1e-6)).all()
    assert np.allclose(np.linalg.norm(lot[:, 4:7], axis=1), 1, atol=1e-6)
    assert (lot == rays_scenes.random_rays(geometry, 500)).all()
    assert (lot != rays_scenes.random_rays(geometry, 500, seed=13)).any()


# --- agreement --------------------------------------------------------------------------------------------------------


def hits(*rows):
    """Return hits of (instance, primitive, t, u, v)."""
    table = np.array(rows, np.float64)
    ids = table[:, :2].astype(np.int64)
    return Hits(ids[:, 0], ids[:, 1], np.float32(table[:, 2]), np.float32(table[:, 3:]))


MISS = (NONE, NONE, 9.0, 0.0, 0.0)
TRUTH = hits((0, 1, 1.0, 0.3, 0.3), (0, 2, 2.0, 0.3, 0.3), (1, 0, 4.0, 0.5, 0.5), MISS)


def test_agreement_of_equal_hits():
    found = rays_scenes.agreement(TRUTH, TRUTH)
    assert found == {
        "hits": 0.75, "edges": 0.25, "equal": 1.0, "ties": 0, "differ": 0,
        "t_error": 0.0, "t_within": 1.0, "t_of_size": 0.0,
    }  # fmt: skip


def test_agreement_sees_other_triangles_other_t_and_holes():
    """The third ray meets an edge: nothing there counts. A tie is another triangle at the same place."""
    edge, miss = (1, 5, 7.0, 0.3, 0.3), MISS
    tie = rays_scenes.agreement(hits((0, 7, 1.0, 0.3, 0.3), (0, 2, 2.0, 0.3, 0.3), edge, miss), TRUTH)
    assert (tie["ties"], tie["differ"], tie["equal"]) == (1, 0, 1.0)
    other = rays_scenes.agreement(hits((0, 7, 1.1, 0.3, 0.3), (0, 2, 2.0, 0.3, 0.3), edge, miss), TRUTH)
    assert (other["ties"], other["differ"]) == (0, 1) and other["equal"] == pytest.approx(2 / 3)
    hole = rays_scenes.agreement(hits(miss, (0, 2, 2.0, 0.3, 0.3), edge, miss), TRUTH)
    assert hole["differ"] == 1 and hole["hits"] == 0.5
    far = rays_scenes.agreement(hits((0, 1, 1.0, 0.3, 0.3), (0, 2, 2.001, 0.3, 0.3), edge, miss), TRUTH)
    assert far["t_of_size"] == pytest.approx(1e-3, rel=1e-3)
    assert far["t_error"] == pytest.approx(5e-4, rel=1e-3) and far["t_within"] == 0.5 and far["differ"] == 0


# --- the clock --------------------------------------------------------------------------------------------------------


class Clock:
    """A device that takes a time for each submission and for each ray."""

    def __init__(self, ray_s, submission_s=1e-4):
        self.ray_s, self.submission_s, self.longest, self.seen = ray_s, submission_s, 0.0, []

    def seconds(self, calls, times=1):
        ((_, _, count, (first, same, *_)),) = calls
        assert count == same
        self.seen.append((first, count))
        took = self.submission_s + times * count * self.ray_s
        self.longest = max(self.longest, took)
        return took / times


@pytest.mark.parametrize("ray_s", [1e-9, 1e-6, 1e-4])
def test_a_time_is_that_of_the_rays_alone_and_no_submission_is_long(ray_s):
    device, count = Clock(ray_s), 20_000
    run = rays._Run(device, None, None, count, device.submission_s)
    device.seen = []
    assert run.seconds() == pytest.approx(count * ray_s, rel=1e-3)
    assert device.longest <= max(rays.LONGEST_S, rays.PROBE * ray_s) + 2 * device.submission_s
    ends = [first + number for first, number in device.seen]
    assert [first for first, _ in device.seen] == [0, *ends[:-1]] and ends[-1] == count


# --- chapters ---------------------------------------------------------------------------------------------------------


def test_a_chapter_without_rays_has_no_such_part():
    subject = Subject(11, "vulkan", nothing("bench"), (8, 8), None)
    assert rays.measure(subject, SMALL, lambda what, part: None) is None
    assert "rays" not in bench.parts_of(11, "vulkan")
    assert all("rays" in parts.parts_of(12, api) for api in ("vulkan", "gl"))


def test_times_by_the_clock_are_those_of_chapter_11s():
    """The file is a copy: benches of a chapter import nothing of another."""
    from chapters.ch11.benches import pass_times as before

    assert Path(pass_times.__file__).read_text("utf-8") == Path(before.__file__).read_text("utf-8")
