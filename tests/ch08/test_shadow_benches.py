"""The benches of shadows: what they find is of the right size, and tables and figures say all of it."""

from __future__ import annotations

import json
from importlib import import_module

import numpy as np
import pytest

from chapters.ch08.benches import (
    shadow_caching,
    shadow_cascades,
    shadow_casters,
    shadow_filters,
    shadow_memory,
    shadow_scenes,
)
from common.reports.benches import Effort
from common.scene.pose import evaluate_pose
from tests.support.bench_views import drawn, shown
from tests.support.packages import BACKENDS
from tests.support.scenes import quad_scene
from tests.support.shadows import placed, point, spot, sun, yard
from tools.bench import bench, figures
from tools.bench.points import Subject

SMALL = Effort(1, 2, 1, 1, 1, everything=False)
SIZE = (48, 32)
VULKAN, GL = BACKENDS
DRIVEN = (VULKAN, pytest.param(*GL.values, marks=[*GL.marks, pytest.mark.long]))
"""A bench drives what the tests of shadows draw with both, so OpenGL is measured with --long alone."""


def measured(request, module, **patched):
    """Return what a reader of the JSON gets of a bench's quick look at a yard with a sun and two lamps."""
    vulkan = request.param == "vulkan"
    device = request.getfixturevalue("vulkan_device" if vulkan else "gl_context")
    lamps = point((-1.2, 3.0, 0.8)), point((1.5, 2.5, -1.0), reach=6.0)
    scene = yard(
        sun((0.5, -1.0, 0.3)), *lamps, extra=(placed((2.0, 1.0, -2.0), (1.5, 1.0), (1.0, 0.4, 0.2)),)
    )
    subject = Subject(8, request.param, scene, SIZE, device)
    told = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Subject, "load", lambda self, name, around="none": scene)
        for name, value in patched.items():
            patch.setattr(module, name, value)
        record = module.measure(subject, SMALL, lambda what, part: told.append(part))
    assert told == sorted(told) and told[-1] < 1.0
    return json.loads(json.dumps(record, allow_nan=False))


# --- memory -----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def memory(request):
    return measured(request, shadow_memory)


@pytest.mark.feature("tools/bench")
@pytest.mark.needs("mitsuba")
def test_more_memory_has_less_error(memory):
    rows = {row["name"]: row for row in memory["rows"] if row["kind"] == "full"}
    coarse, fine = (rows[f"{size} texels"] for size in shadow_memory.QUICK_SIZES)
    assert coarse["mib"] == coarse["used_mib"] == 2 * 6 / 16 and fine["mib"] == 4 * coarse["mib"]
    assert 0.0 <= fine["error"] <= coarse["error"] < 0.1
    for row in rows.values():
        assert row["floor"] < 0.1 and row["lights"] == 2 and row["lowered"] == 0
        # A real map is about as good as one with exact depths: this is what the truth says of our own error.
        assert row["error"] < row["floor"] + 0.02
    (pool,) = (row for row in memory["rows"] if row["kind"] == "pool")
    assert 0.0 < pool["used_mib"] <= shadow_memory.QUICK_POOLS[0]
    assert all(row["ms"] >= 0.0 and row["error"] < 0.2 for row in memory["rows"])


@pytest.mark.feature("tools/bench")
@pytest.mark.needs("mitsuba", "matplotlib")
def test_the_table_of_memory_says_all_of_it(memory):
    text = shown(shadow_memory, memory)
    assert all(row["name"] in text for row in memory["rows"])
    assert "maps by need" in text and "Sparse memory" in text
    assert {"full", "pages", "pool", "full, exact depths"} <= set(drawn(shadow_memory, memory))
    assert len(dict(figures.PARTS["memory"]({"memory": memory}))) == len(memory["rows"])


@pytest.fixture(scope="module", params=DRIVEN)
def sparse_memory(request):
    """Return the record of a chapter that is taken to have sparse memory."""
    return measured(
        request, shadow_memory, QUICK_SIZES=(128,), QUICK_POOLS=(), has_sparse=lambda subject: True
    )


@pytest.mark.feature("tools/bench")
@pytest.mark.needs("mitsuba")
def test_sparse_memory_and_software_pages_are_compared_row_by_row(sparse_memory):
    kinds = [row["kind"] for row in sparse_memory["rows"]]
    assert kinds == ["full", "pages", "pages", shadow_memory.PARTING, shadow_memory.PARTING]
    assert [row["pixels_differ"] for row in sparse_memory["rows"]] == [None, None, None, 0, 0]
    assert "0 pixels differ" in shown(shadow_memory, sparse_memory)


@pytest.mark.feature("tools/bench")
def test_memory_at_equal_error_lies_on_a_line_of_logarithms():
    """Error falls with the root of memory: 16 MiB have 0.04, so 0.02 needs 64, and 0.01 needs 256."""
    rows = [
        {"kind": "full", "name": f"{mib}", "mib": mib, "error": 0.16 / np.sqrt(mib / 16) / 2}
        for mib in (64, 256, 4096)
    ]
    by_need = [{"kind": "pages", "mib": mib, "error": 0.04 / np.sqrt(mib / 16)} for mib in (16, 64, 1024)]
    worse = [{"kind": "pool", "mib": 100, "error": 0.5}]  # more memory and more error: on no front
    found = shadow_memory.equal_errors([*rows, *by_need, *worse])
    assert [one["ratio"] for one in found] == [pytest.approx(0.25), pytest.approx(0.25), pytest.approx(0.25)]
    assert not any(one["at_most"] for one in found)
    coarse = {"kind": "full", "name": "coarse", "mib": 32, "error": 0.05}
    (one,) = shadow_memory.equal_errors([coarse, *by_need])
    assert one["at_most"] and one["ratio"] == pytest.approx(0.5), "16 MiB have less error"
    assert shadow_memory.memory_at(0.2, [(1.0, 0.1), (4.0, 0.05)]) == pytest.approx(1.0)
    assert shadow_memory.memory_at(0.01, [(1.0, 0.1), (4.0, 0.05)]) is None
    assert shadow_memory.memory_at(0.1, []) is None
    assert shadow_memory.front([(4.0, 0.2), (1.0, 0.3), (2.0, 0.1), (8.0, 0.1)]) == [(1.0, 0.3), (2.0, 0.1)]


# --- filters ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def filters(request):
    return measured(request, shadow_filters, ANGLE=6.0, RADIUS=0.1, QUICK_RAYS=12)


@pytest.mark.feature("shadows/pcf", "shadows/depth-bias", "tools/bench")
@pytest.mark.needs("mitsuba", "matplotlib")
def test_filters_and_biases_have_the_errors_that_they_are_for(filters):
    for lights in shadow_filters.LIGHTS:
        rows = {row["name"]: row for row in filters["rows"] if row["lights"] == lights}
        assert rows["kernel 1"]["error"] < rows["kernel 13"]["error"], "a wide kernel is no hard edge"
        assert rows["pcss"]["soft_error"] < rows["kernel 1"]["soft_error"], "nor is a hard edge a soft one"
        assert rows["no bias"]["dark"] > 0.05 > rows["kernel 3"]["dark"], "acne"
        assert rows["kernel 3"]["floor"] == pytest.approx(rows["kernel 3"]["error"], abs=0.01)
    assert "acne" not in (text := shown(shadow_filters, filters))
    assert all(row["name"] in text for row in filters["rows"]) and "pcss is off by" in text
    assert len(drawn(shadow_filters, filters)) == 6
    assert len(dict(figures.PARTS["filters"]({"filters": filters}))) == len(filters["rows"])


# --- cascades ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def cascades(request):
    return measured(request, shadow_cascades, QUICK_SIZES=(256,))


@pytest.mark.feature("shadows/aliasing-improvements", "tools/bench")
@pytest.mark.needs("mitsuba", "matplotlib")
def test_cascades_have_their_texels_and_memory(cascades):
    one, three = cascades["rows"]
    page = 1 / 16  # the coarse one of the sun
    assert (one["cascades"], three["cascades"]) == (1, 3)
    assert (one["mib"], three["mib"]) == (1 / 4 + page, 3 / 4 + page)
    assert len(three["texels_mm"]) == 3 and three["texels_mm"] == sorted(three["texels_mm"])
    assert one["texels_mm"] == three["texels_mm"][-1:]
    assert one["drawn"] == 0.0, "the fit follows the scene and no view"
    assert all(row["error"] < row["floor"] + 0.02 < 0.1 for row in (one, three))
    assert "lengths are those of texels" in shown(shadow_cascades, cascades) and drawn(
        shadow_cascades, cascades
    ) == ["1", "3"]
    assert len(dict(figures.PARTS["cascades"]({"cascades": cascades}))) == 2


# --- caching ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def caching(request):
    return measured(request, shadow_caching, QUICK_FRAMES=5)


@pytest.mark.feature("shadows/caching", "tools/bench")
@pytest.mark.needs("matplotlib")
def test_only_what_has_changed_is_drawn(caching):
    rows = {row["state"]: row for row in caching["rows"]}
    assert list(rows) == list(shadow_caching.STATES) and caching["lamps"] == 2
    assert rows["rest"]["most_faces"] == 0 and rows["rest"]["work"]["shadow_faces"] == 3 + 1 + 2 * 6
    assert rows["lamp"]["most_faces"] == 6 == rows["lamp"]["work"]["shadow_faces_drawn"]
    # Each frame has another picture to light: the faces that a cut draws are those that differ from the frame before.
    assert 0 <= rows["walk"]["work"]["shadow_faces_drawn"] <= rows["cut"]["work"]["shadow_faces_drawn"]
    assert [row["frames"] for row in rows.values()][:3] == [5, 5, 5] and rows["cut"]["frames"] in (4, 5)
    for row in rows.values():
        assert 0 <= row["gpu_ms"] <= row["gpu_most_ms"] and 0 < row["python_ms"] <= row["python_most_ms"]
    text = shown(shadow_caching, caching)
    assert all(spoken in text for spoken in shadow_caching.SPOKEN.values())
    assert drawn(shadow_caching, caching) == ["mean", "most"]
    assert len(dict(figures.PARTS["caching"]({"caching": caching}))) == len(shadow_caching.STATES)


# --- casters ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=DRIVEN)
def casters(request):
    return measured(request, shadow_casters, QUICK_COUNTS=(1, 2), SOFTWARE_MOST=1)


@pytest.mark.feature("shadows/instance-culling", "shadows/cull-toggles", "tools/bench")
@pytest.mark.needs("matplotlib")
def test_all_maps_are_drawn_in_each_frame_and_slow_ways_are_left_out(casters):
    rows = casters["rows"]
    software = len(rows) == 3
    found = [(row["lights"], row["faces"], row["way"]) for row in rows]
    every = [(1, 6, "lists"), (1, 6, "everything"), (2, 12, "lists"), (2, 12, "everything")]
    assert found == (every[:3] if software else every)
    assert [row["times"] is None for row in rows] == [row["way"] == "lists" for row in rows]
    assert all(row["ms"] > 0 and row["light_ms"] > 0 for row in rows)
    text = shown(shadow_casters, casters)
    assert "times as long as what the lists leave" in text and "everything" in text
    assert drawn(shadow_casters, casters) == ["lists", "everything", "lighting"]
    assert len(dict(figures.PARTS["casters"]({"casters": casters}))) == len(rows)


@pytest.mark.feature("tools/bench")
def test_lights_get_nodes_of_their_own_and_move_alone():
    scene = yard(point((0.0, 3.0, 0.0)), spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)))
    loose = shadow_scenes.with_loose_lights(scene)
    before, after = (evaluate_pose(it, 0.0) for it in (scene, loose))
    for old, new in zip(scene.lights, loose.lights, strict=True):
        np.testing.assert_array_equal(before.world_from_node[old.node], after.world_from_node[new.node])
    shadow_scenes.move_lights(loose, [1], (0.5, 0.0, -0.25))
    moved = evaluate_pose(loose, 0.0)
    np.testing.assert_array_equal(moved.world_from_object, before.world_from_object)
    change = moved.world_from_node[loose.lights[1].node] - after.world_from_node[loose.lights[1].node]
    np.testing.assert_allclose(change[:3, 3], (0.5, 0.0, -0.25))
    assert not change[:3, :3].any() and not len(shadow_scenes.scene_with(scene, ("directional",)).lights)


# --- all of them ------------------------------------------------------------------------------------------------------


@pytest.mark.feature("tools/bench")
def test_a_chapter_without_shadow_maps_has_no_such_parts():
    subject = Subject(7, "vulkan", quad_scene(), (8, 8), None)
    for name in bench.SHADOWS.values():
        module = import_module(f"chapters.ch08.benches.{name}")
        assert module.measure(subject, SMALL, lambda what, part: None) is None
    assert not set(bench.SHADOWS) & set(bench.parts_of(7, "vulkan"))
    assert set(bench.SHADOWS) <= set(bench.parts_of(8, "gl"))
    assert all(dict(figures.PARTS[part]({})) == {} for part in bench.SHADOWS)


@pytest.mark.feature("tools/bench")
def test_pictures_of_software_drivers_are_small():
    class Device:
        class capabilities:
            kind = "software"

    sizes = [(640, 360), (160, 90)]
    found = [shadow_scenes.picture_size(Subject(8, "vulkan", quad_scene(), size, Device)) for size in sizes]
    assert found == [(320, 180), (160, 90)]
