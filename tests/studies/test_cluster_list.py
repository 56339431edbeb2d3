"""The study cluster-list: its list, its pictures against those of the vertex path, and what devices may lack."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import chapters
from chapters.ch06.studies import cluster_list, compacted_indices
from chapters.ch06.studies.cluster_list import Settings, blocks_of, folded, vulkan
from chapters.ch06.studies.cluster_list.limits import Limits
from chapters.ch06.studies.meshlet_field import field_of
from common.errors import UnsupportedError
from common.paths import ROOT
from tests.support.drivers import needs_feature
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, use, without_each
from tests.twins.surfaces import surface_at

pytestmark = pytest.mark.feature("meshlets/mesh-shader-output")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
WHICH, SIZE, COUNT = "6/cluster-list", (96, 72), 24
OUTPUTS = ("color", "depth", "instance_id")
CLOSE = "0.3,0.5,0.9:0,0,0"
WAYS = ("list", "tasks")
SIZES = [(64, 124), (32, 124), (128, 124), (128, 0)]


@pytest.fixture
def mesh_stage(stage):
    """The Vulkan device, if it has mesh shaders."""
    needs_feature(stage.device, "mesh-shader")
    return stage


def drawn(stage, settings, camera=CLOSE, which=WHICH, **more):
    """Return the outputs of a frame and its counters."""
    with stage.open(which, SIZE, settings=settings, outputs=OUTPUTS, **more) as renderer:
        frame = renderer.render(chapters.view_of(renderer, camera))
        return {name: frame.image(name) for name in OUTPUTS}, frame.work


def same(one, other):
    return all((one[name] == other[name]).all() for name in OUTPUTS)


@cache
def triangles_of(number):
    """Return the triangles of an instance in the world, (T, 3, 3) float64."""
    field = field_of(COUNT)
    instance = field.instances[number]
    first = instance["first_meshlet"]
    of_mesh = field.meshlets[first : first + instance["meshlets"]]
    begin, end = of_mesh["first_index"][0], of_mesh["first_index"][-1] + 3 * (of_mesh["counts"][-1] >> 8)
    rows = instance["world_from_object"].astype(float)
    return field.vertices[field.indices[begin:end].reshape(-1, 3)] @ rows[:, :3].T + rows[:, 3]


# --- pictures ---------------------------------------------------------------------------------------------------------

EQUAL = """
import json
import chapters
from chapters import studies
from chapters.ch06.studies import cluster_list, compacted_indices

def draw(which, settings, camera):
    scene, outputs = studies.load(which, None), ("color", "depth", "instance_id")
    with chapters.open(which, "vulkan", scene=scene, size=(96, 72), settings=settings, outputs=outputs) as renderer:
        frame = renderer.render(chapters.view_of(renderer, camera))
        return [frame.image(name) for name in outputs]

unequal = {}
for camera, cases in (
    ("0.3,0.5,0.9:0,0,0", [("list", 64, 124), ("tasks", 64, 124), ("list", 32, 62), ("list", 128, 0)]),
    (None, [("list", 64, 124)]),
):
    classic = draw("6/compacted-indices", compacted_indices.Settings(24), camera)
    for case in cases:
        images = draw("6/cluster-list", cluster_list.Settings(24, *case), camera)
        unequal[f"{camera} {case}"] = [int((a != b).sum()) for a, b in zip(classic, images)]
        unequal[f"{camera} {case}"].append(int((images[1] > 0).sum()))
print(json.dumps(unequal))
"""


@only_vulkan
def test_mesh_shaders_draw_the_bits_of_the_vertex_path(mesh_stage):
    """The driver in software moves vertices to the screen with a fused multiply-add in its vertex path alone. Without
    processor features beyond SSE 4.1 it has none, and both paths agree to the bit. A driver reads that once, so it
    takes a process of its own."""
    if not mesh_stage.device.capabilities.is_software:
        pytest.skip("the variable is for the drivers in software")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "GALLIUM_OVERRIDE_CPU_CAPS": "sse4.1"}
    ran = subprocess.run(
        [sys.executable, "-c", EQUAL],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert ran.returncode == 0, ran.stderr
    unequal = json.loads(ran.stdout)
    assert len(unequal) == 5
    for name, (color, depth, ids, covered) in unequal.items():
        assert color == depth == ids == 0 and covered > 1000, name


@only_vulkan
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("camera", [CLOSE, None])
def test_the_picture_is_that_of_the_vertex_path_within_a_derived_bound(mesh_stage, way, camera):
    classic, _ = drawn(mesh_stage, compacted_indices.Settings(COUNT), camera, "6/compacted-indices")
    images, _ = drawn(mesh_stage, Settings(COUNT, way), camera)
    with mesh_stage.open(WHICH, SIZE, settings=Settings(COUNT)) as renderer:
        clip_from_world = chapters.view_of(renderer, camera).clip_from_world(SIZE[0] / SIZE[1])
    rows, columns = np.nonzero(classic["instance_id"])
    chosen = np.random.default_rng(1).permutation(len(rows))[:200]
    clear, bounds, depths = [], [], []
    for row, column in zip(rows[chosen], columns[chosen], strict=True):
        number = int(classic["instance_id"][row, column]) - 1
        surface = surface_at(clip_from_world, triangles_of(number), SIZE, (column + 0.5, row + 0.5))
        if surface is not None:
            clear.append((row, column))
            depths.append(surface[0])
            bounds.append(surface[1])
    place, bound = tuple(np.array(clear).T), np.array(bounds)
    assert len(clear) > 150
    assert (images["instance_id"][place] == classic["instance_id"][place]).all()
    assert (np.abs(images["depth"][place].astype(float) - classic["depth"][place]) <= bound).all()
    # The bound is worth something, and the surfaces are those that were drawn.
    assert np.median(bound / depths) < 2e-4
    assert (np.abs(classic["depth"][place] - depths) < bound + 2e-4 * np.array(depths)).mean() > 0.99
    assert np.abs(images["color"].astype(int) - classic["color"]).max(axis=-1)[place].max() <= 1


@only_vulkan
@pytest.mark.parametrize(("vertices", "triangles"), SIZES)
def test_both_ways_and_all_sizes_draw_the_whole_field(mesh_stage, vertices, triangles):
    whole, all_work = drawn(mesh_stage, Settings(COUNT, culling=False))
    works = []
    for way in WAYS:
        images, work = drawn(mesh_stage, Settings(COUNT, way, vertices, triangles))
        works.append(work)
        assert same(images, whole)
        assert (
            0 < work["triangles"] < 0.7 * all_work["triangles"]
            and all_work["meshlets"] == field_of(COUNT).units
        )
        turned, _ = drawn(mesh_stage, Settings(COUNT, way, vertices, triangles, turned=140.0))
        assert (turned["instance_id"] != whole["instance_id"]).any()
    assert works[0] == works[1]


# --- lists ------------------------------------------------------------------------------------------------------------


@only_vulkan
@pytest.mark.parametrize("culling", [True, False])
def test_the_list_has_the_meshlets_of_the_commands_in_their_order(mesh_stage, culling):
    field = field_of(COUNT)
    with mesh_stage.open(
        "6/compacted-indices", SIZE, settings=compacted_indices.Settings(COUNT, culling=culling)
    ) as it:
        work = it.render(chapters.view_of(it, CLOSE)).work
        commands = it.lists_after()[0][: work["commands"]]
    with mesh_stage.open(WHICH, SIZE, settings=Settings(COUNT, culling=culling)) as renderer:
        work = renderer.render(chapters.view_of(renderer, CLOSE)).work
        instance, meshlet = renderer.list_after()[: work["meshlets"]].T
    assert (instance == commands["first_instance"]).all()
    assert (field.meshlets["first_index"][meshlet] == commands["first_index"]).all()
    assert (3 * (field.meshlets["counts"][meshlet] >> 8) == commands["index_count"]).all()


@only_vulkan
@pytest.mark.parametrize(("at_once", "culling"), [(1, True), (97, True), (65_535, True), (1, False)])
def test_a_list_in_several_draws_is_the_same_and_has_nothing_of_the_frame_before(
    mesh_stage, at_once, culling
):
    """From the side, what an earlier frame has left behind the end of the list would be seen."""
    cameras, settings = (None, CLOSE), Settings(COUNT, vertices=32, culling=culling, turned=45.0)
    alone = [drawn(mesh_stage, settings, camera) for camera in cameras]
    more = replace(settings, at_once=at_once)
    with mesh_stage.open(WHICH, SIZE, settings=more, outputs=OUTPUTS) as renderer:
        for camera, (images, work) in zip(cameras, alone, strict=True):
            frame = renderer.render(chapters.view_of(renderer, camera))
            assert same({name: frame.image(name) for name in OUTPUTS}, images)
            assert frame.work["meshlets"] == work["meshlets"] and work["meshlets"] % 97
    first, second = (work["meshlets"] for _, work in alone)
    assert first > second > 0 if culling else first > 64 * COUNT  # more draws than the kernel has invocations


@only_vulkan
def test_a_grid_of_task_shaders_in_several_rows_is_the_same(mesh_stage, monkeypatch):
    one_row, work = drawn(mesh_stage, Settings(COUNT, "tasks"))
    monkeypatch.setattr(cluster_list, "ROW", 7)
    rows, again = drawn(mesh_stage, Settings(COUNT, "tasks"))
    assert same(rows, one_row) and again == work and len(blocks_of(field_of(COUNT))) % 7


def test_blocks_of_task_shaders_cover_every_unit_once():
    sizes = [folded(count) for count in (1, 65_535, 65_536, 200_000)]
    assert sizes == [(1, 1), (65_535, 1), (65_535, 2), (65_535, 4)]
    field = field_of(5)
    units = [
        (number, meshlet)
        for number, first in blocks_of(field).tolist()
        for meshlet in range(first, first + 32)
        if meshlet < field.instances["first_meshlet"][number] + field.instances["meshlets"][number]
    ]
    assert len(units) == len(set(units)) == field.units


# --- who waits --------------------------------------------------------------------------------------------------------


@only_vulkan
@pytest.mark.parametrize("way", WAYS)
def test_each_barrier_is_needed_and_none_is_missing(mesh_stage, way):
    read, written = "compute storage_read", "compute storage_write"
    uses = {
        "select": [use("select", name, written, fresh=True) for name in ("places", "sums")],
        "scan": [use("scan", "sums", read, written), use("scan", "totals#", written, fresh=True)],
        "list": [
            *(use("list", name, read) for name in ("places", "sums")),
            *(use("list", name, written, fresh=True) for name in ("listed", "arguments")),
        ],
        "draws": [
            use("draws", "listed", "mesh storage_read"),
            use("draws", "arguments", "indirect indirect"),
        ],
    }
    if way == "tasks":
        cleared = use("clear", "totals#", "copy copy_write", fresh=True)
        uses = {
            "clear": [cleared],
            "draws": [use("draws", "totals#", "task storage_read", "task storage_write")],
        }
    with mesh_stage.open(WHICH, (8, 8), settings=Settings(3, way)) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view), uses, downloaded=["totals#"])
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "compute" in str(one) or "task" in str(one)]
    assert len(own) == (3 if way == "list" else 2) and all(own)


# --- what cannot be ---------------------------------------------------------------------------------------------------


@only_vulkan
def test_a_device_without_mesh_shaders_is_told_in_a_sentence(stage, strata):
    with pytest.raises(
        UnsupportedError, match=r"draws with mesh shaders, which .* is used without: the study compacted"
    ):
        stage.open(WHICH, (4, 4), without={"mesh-shader"})
    code, _, err = strata("run", WHICH, "--backend", "gl")
    assert code == 2 and "has no OpenGL version: use --backend vulkan" in err and err.count("\n") == 1, err


@only_vulkan
@pytest.mark.parametrize(
    ("limits", "settings", "said"),
    [
        ({"vertices": 64}, Settings(3, vertices=128), r"of 128 vertices .* at most 64: set fewer vertices\."),
        ({"triangles": 96}, Settings(3), r"of 124 triangles .* at most 96: set fewer triangles\."),
        ({"draws": 18}, Settings(3, at_once=10), r"take 19 draws, .* at most 18: set fewer instances\."),
        (
            {"task_groups": 5},
            Settings(3, "tasks"),
            r"take 7 work groups of task .* at most 5: set fewer instances\.",
        ),
    ],
)
def test_what_exceeds_a_limit_of_the_device_is_one_sentence(mesh_stage, limits, settings, said, monkeypatch):
    small = replace(Limits(256, 256, 1 << 22, 1 << 16), **limits)
    monkeypatch.setattr(vulkan, "limits_of", lambda device: small)
    with pytest.raises(UnsupportedError, match=said):
        mesh_stage.open(WHICH, (4, 4), settings=settings)
    if "triangles" in limits:  # and 0 takes as many as there are
        _, work = drawn(mesh_stage, Settings(3, triangles=0, culling=False))
        assert work["meshlets"] == field_of(3, 64, 96).units


@only_vulkan
def test_the_limits_are_those_of_the_specification_or_more(mesh_stage):
    limits = vulkan.limits_of(mesh_stage.device)
    assert limits.vertices >= 256 and limits.triangles >= 256
    assert limits.task_groups >= 1 << 22 and limits.draws >= 1 << 16
