"""The lists that the kernels write: complete, in order, and counted as double precision counts them."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch06.culling import kernels as culling_kernels
from chapters.ch06.culling import lists as culling_lists
from chapters.ch06.culling.lists import (
    ALWAYS,
    BATCH,
    DRAW,
    MOST_UNITS,
    TWO_SIDED,
    WHOLE,
    StateLayout,
    folded,
    plan_lists,
)
from chapters.ch06.meshlets.scene import meshlets_of
from chapters.ch06.scene import data as scene_data
from chapters.ch06.scene.draw_lists import build_draw_lists
from chapters.ch06.scene.records import RECORD_BYTES, instance_parts
from chapters.ch06.settings import Settings
from common.errors import SceneError
from common.settings import replaced
from tests.support.culled import box_margins, commands
from tests.support.towns import BLENDED, MASKED, town, walk
from tests.support.towns import TWO_SIDED as BOTH_SIDES

SIZE = (120, 72)
EXACT = Settings(color_format="rgba32f", gbuffer_format="full", anisotropy=1.0)


@pytest.fixture(scope="module")
def scene():
    return town(count=300)


def several(chapter):
    if not chapter.device.has("multi-draw"):
        pytest.skip("the device draws one command with each call")


@pytest.mark.core
@pytest.mark.feature("culling/gpu-frustum", "culling/statistics")
def test_instances_outside_are_those_of_double_precision(chapter, scene):
    """But for boxes within a rounding of a plane; the counters are the sums, and nothing is listed twice."""
    for view in walk()[::3]:
        with chapter.open(scene, SIZE, replaced(EXACT, culling="frustum", geometry="classic")) as made:
            work = made.render(view).work
            listed = np.concatenate([batch[:, 4] for batch in commands(made, 0)])
            records = made._data.records.instances
            draws = made.techniques["culling"].memory.lists.draws
        centre = records["bounds_centre"][:, :3].astype(np.float64) + made.scene.origin
        extent = records["bounds_extent"][:, :3].astype(np.float64)
        margin = box_margins(centre - extent, centre + extent, view.clip_from_world(SIZE[0] / SIZE[1]))
        solid = draws["instance"].astype(int)
        inside, near = margin[solid] >= 0, np.abs(margin[solid]) < 1e-4
        drawn = np.isin(solid, listed)
        assert (drawn == inside)[~near].all()
        assert len(listed) == len(np.unique(listed)) == work["units_drawn"]
        assert work["instances_tested"] == len(solid)
        assert work["instances_outside"] == len(solid) - len(listed)


@pytest.mark.feature("culling/gpu-frustum", "culling/statistics")
def test_lists_and_counters_of_another_view_differ(chapter, scene):
    """What the test above holds them to would notice the view of another frame."""
    found = []
    for view in walk()[:2]:
        with chapter.open(scene, SIZE, replaced(EXACT, culling="frustum", geometry="classic")) as made:
            work = made.render(view).work
            listed = np.concatenate([batch[:, 4] for batch in commands(made, 0)])
        found.append((listed.tolist(), work["instances_outside"]))
    assert found[0][0] != found[1][0]
    assert found[0][1] != found[1][1]


@pytest.mark.feature("culling/statistics")
def test_counters_are_those_of_the_lists(chapter, scene):
    several(chapter)
    with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion", geometry="compute")) as made:
        for view in walk():
            work = made.render(view).work
            early, late = (np.concatenate(commands(made, phase)) for phase in (0, 1))
            assert len(early) + len(late) == work["units_drawn"] and len(late) == work["units_late"]
            assert early[:, 0].sum() // 3 + late[:, 0].sum() // 3 == work["triangles_drawn"]
            assert late[:, 0].sum() // 3 == work["triangles_late"]
            assert set(map(tuple, early.tolist())).isdisjoint(map(tuple, late.tolist()))
            assert work["units_dropped"] == 0


@pytest.mark.feature("gpu-driven/render-queues")
def test_queues_partition_the_scene(chapter, scene):
    """Every visible instance is in one batch of its own state, or among the blended ones; without culling all are."""
    with chapter.open(scene, SIZE, replaced(EXACT, culling="frustum", geometry="classic")) as made:
        made.render(walk()[-1])
        lists, memory = made._draws.lists, made.techniques["culling"].memory
        drawn = [batch[:, 4].tolist() for batch in commands(made, 0)]
        materials = scene.meshes["material"][scene.instances.mesh]
        solid = np.sort(memory.lists.draws["instance"])
        assert np.array_equal(np.sort(np.r_[solid, lists.transparent]), np.arange(len(scene.instances)))
        assert set(materials[lists.transparent]) == {BLENDED} and BLENDED not in materials[solid]
        for batch, instances in zip(lists.solid, drawn, strict=True):
            kinds = {materials[instance] for instance in instances}
            assert len(kinds) <= 1, "one state"
            assert instances == sorted(instances), "in the order of the scene"
            assert not (kinds & {MASKED, BOTH_SIDES}) or batch.material in kinds


@pytest.mark.feature("gpu-driven/render-queues")
def test_an_empty_queue_draws_nothing(chapter, scene):
    """Seen from behind, no list has a command, and the picture is the background."""
    away = walk()[0]
    turned = away.world_from_view.copy()
    turned[:3, :3] = turned[:3, :3] @ np.diag((-1.0, 1.0, -1.0))
    turned[:3, 3] += 40.0 * turned[:3, 2]
    turned = turned @ np.diag((-1.0, 1.0, -1.0, 1.0))
    turned[:3, 3] -= 80.0 * turned[:3, 2]
    view = type(away)(turned, away.projection)
    with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion"), outputs={"instance_id"}) as made:
        frame = made.render(view)
        assert not frame.image("instance_id").any()
        assert frame.work["units_drawn"] == 0 == sum(len(batch) for batch in commands(made, 0))


@pytest.mark.feature("gpu-driven/draw-records")
def test_a_second_binding_holds_the_instances_beyond_the_first(chapter, scene, monkeypatch):
    """The same picture where shaders see 64 records of instances in a buffer and the rest in another one."""
    pictures = []
    outputs = ("color_linear", "instance_id", "depth")
    for most in (1 << 27, 200 * RECORD_BYTES):
        monkeypatch.setattr(
            scene_data, "instance_parts", lambda count, _, most=most: instance_parts(count, most)
        )
        with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion"), outputs=outputs) as made:
            frame = made.render(walk()[0])
            pictures.append([frame.image(name).copy() for name in outputs])
            assert len(made._data.instance_parts) == len(pictures)
    assert all(np.array_equal(one, other) for one, other in zip(*pictures, strict=True))


def test_parts_of_instances_begin_where_any_device_allows():
    assert instance_parts(0, 1 << 27) == [(0, RECORD_BYTES)]
    assert instance_parts(699_048, 1 << 27) == [(0, 699_048 * RECORD_BYTES)]
    first, second = instance_parts(1_000_000, 1 << 27)
    assert first[1] == second[0] <= 1 << 27 and second[0] % 256 == 0
    assert sum(size for _, size in (first, second)) == 1_000_000 * RECORD_BYTES
    with pytest.raises(SceneError, match="1398096"):
        instance_parts(1_398_097, 1 << 27)


def lists_of(scene, meshlets=None, **more):
    """Return the tables of a scene whose meshes are all in one page."""
    from chapters.ch06.scene.packing import material_variant

    variants = [material_variant(material, scene) for material in scene.materials]
    count = len(scene.meshes)
    mirrored = np.linalg.det(scene.nodes.matrix[scene.instances.node][:, :3, :3]) < 0
    zero = np.zeros(count, np.uint32)
    lists = build_draw_lists(
        scene, variants, mirrored, zero, scene.meshes["first_index"], np.zeros(len(variants), np.int64)
    )
    two_sided = np.array([variant.double_sided for variant in variants])
    return lists, plan_lists(lists, scene, meshlets, np.zeros(count, bool), two_sided, **more)


def test_tables_name_units_in_the_order_of_the_scene(scene):
    meshlets = meshlets_of(scene)
    lists, tables = lists_of(scene, meshlets)
    assert DRAW.itemsize == 32 and BATCH.itemsize == 16
    draws = tables.draws
    number = meshlets.ranges[:, 1][scene.instances.mesh[draws["instance"]]]
    assert np.array_equal(draws["units"], np.maximum(number, 1))
    assert np.array_equal((draws["flags"] & WHOLE) != 0, number == 0)
    assert not (draws["flags"] & ALWAYS).any() and (draws["flags"] & TWO_SIDED).any()
    assert tables.units == tables.commands == draws["units"].sum() and tables.dropped == 0
    places = np.stack([draws["first_bit"], draws["first_bit"] + draws["units"]], axis=1)
    ordered = places[np.argsort(places[:, 0])]
    assert (ordered[1:, 0] >= ordered[:-1, 1]).all() and ordered[-1, 1] <= tables.bits
    assert [batch.first for batch in lists.solid] == tables.batches["first_draw"].tolist()


def test_more_units_than_places_are_shared_out_and_counted(scene):
    meshlets = meshlets_of(scene)
    _, whole = lists_of(scene, meshlets)
    assert whole.warning == ""
    _, tables = lists_of(scene, meshlets, buffer_bytes=40 * (whole.units // 3))
    assert tables.dropped >= whole.units // 2 and (tables.batches["capacity"] >= 1).all()
    assert tables.commands == tables.batches["capacity"].sum() <= whole.units // 3 + len(tables.batches)
    assert f"no places for {tables.dropped:,} of" in tables.warning and "units_dropped" in tables.warning


@pytest.mark.parametrize("share", [6, 60])
def test_what_has_no_place_is_left_out_with_a_sentence_and_a_counter(chapter, share):
    """With few places for commands, or few for units: no more than fit are drawn, and the frame says how many not."""
    scene = town(count=300)
    settings = replaced(EXACT, culling="frustum", geometry="classic")
    view = walk()[-1]
    with chapter.open(scene, SIZE, settings) as made:
        every = made.render(view).work["units_drawn"]
    with chapter.open(scene, SIZE, settings) as made:
        made.techniques["culling"].memory._kernels.buffer_bytes = 40 * 300 // share
        work = made.render(view).work
        drawn = sum(len(batch) for batch in commands(made, 0))
        assert any("units_dropped" in warning for warning in made.scene.warnings)
    assert 0 < drawn < every and work["units_dropped"] > 0
    assert drawn <= 300 // share + len(made.techniques["culling"].memory.lists.batches)


def test_words_of_the_state_do_not_overlap():
    layout = StateLayout(draws=1000, batches=7, units=5000)
    edges = [
        0,
        layout.arguments,
        layout.counts,
        layout.tasks,
        layout.draw_sums,
        layout.unit_sums,
        layout.words,
    ]
    assert edges == sorted(set(edges))
    assert layout.tasks - layout.counts == 14 and layout.words - layout.unit_sums == 2 * 20 + 1
    assert folded(1) == (1, 1) and folded(65535) == (65535, 1) and folded(65536) == (65535, 2)
    assert np.prod(folded(MOST_UNITS // 256)) >= MOST_UNITS // 256


def test_counters_of_a_frame_stay_when_an_edit_makes_the_tables_anew(chapter):
    scene = town(count=300)
    with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion", geometry="classic")) as made:
        made.render(walk()[0])
        before = made.render(walk()[0])
        with scene.edit() as edit:
            edit.set_visible(0, False)
        after = made.render(walk()[0])
        told = {name: before.work[name] for name in ("instances_tested", "units_drawn", "triangles_drawn")}
        assert all(told.values()) and told["instances_tested"] == after.work["instances_tested"] + 1


@pytest.mark.variants("vulkan")
def test_more_task_groups_than_a_draw_has_are_left_out_with_a_sentence_and_a_counter(chapter, monkeypatch):
    if not chapter.device.has("mesh-shader"):
        pytest.skip("the device has no mesh shaders")
    scene, settings = town(count=300), replaced(EXACT, culling="frustum", geometry="mesh")
    with chapter.open(scene, SIZE, settings) as made:
        every = made.render(walk()[-1]).work
        assert not any("units_dropped" in warning for warning in made.scene.warnings)
    for module in (culling_kernels, culling_lists):
        monkeypatch.setattr(module, "MOST_TASKS", 2)
    with chapter.open(scene, SIZE, settings) as made:
        work = made.render(walk()[-1]).work
        assert any("units_dropped" in warning for warning in made.scene.warnings)
    assert work["units_dropped"] % 32 == 0 and work["units_dropped"] > 0
    assert 0 < work["meshlets_drawn"] < every["meshlets_drawn"]
