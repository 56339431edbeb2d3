"""The study compacted-indices: its lists against lists by hand, what must be in them, and the pictures of all ways."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch06.meshlets.packing import unpack_cones
from chapters.ch06.studies.compacted_indices import WAYS, Settings
from chapters.ch06.studies.meshlet_field import field_of
from chapters.ch06.studies.meshlet_field.shapes import all_meshes
from common.errors import UnsupportedError
from common.numerics.transforms import frustum_planes
from common.view.camera import Orthographic, View
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, owed, use, without_each
from tests.twins.bounds import screen_area

compaction = pytest.mark.feature("gpu-driven/command-compaction")
survivors = pytest.mark.feature("meshlets/survivor-compaction")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH, SIZE, COUNT = "6/compacted-indices", (96, 72), 24
OUTPUTS = ("color", "depth", "instance_id")
CLOSE = "0.3,0.5,0.9:0,0,0"
"""A camera among the objects."""


def drawn(stage, settings, camera=CLOSE, view=None, **more):
    """Return the outputs of a frame and its counters."""
    with stage.open(WHICH, SIZE, settings=settings, outputs=OUTPUTS, **more) as renderer:
        frame = renderer.render(view or chapters.view_of(renderer, camera))
        return {name: frame.image(name) for name in OUTPUTS}, frame.work


def listed(stage, settings, camera=CLOSE):
    """Return the commands of a frame, the indices that they draw, its counters and its view."""
    with stage.open(WHICH, SIZE, settings=settings) as renderer:
        view = chapters.view_of(renderer, camera)
        work = renderer.render(view).work
        commands, indices = renderer.lists_after()
        return commands[: work["commands"]], indices, work, view


def same(one, other):
    return all((one[name] == other[name]).all() for name in OUTPUTS)


@cache
def units_of(count):
    """Return the first index and the number of indices of each unit, in order, and its instance: three (U,) arrays."""
    field, rows = field_of(count), []
    for number, instance in enumerate(field.instances):
        for meshlet in range(instance["first_meshlet"], instance["first_meshlet"] + instance["meshlets"]):
            record = field.meshlets[meshlet]
            rows.append((int(record["first_index"]), 3 * (int(record["counts"]) >> 8), number))
    assert len(rows) == field.units
    return np.array(rows).T


def kept_of(commands, count):
    """Return which units the commands of the way "commands" draw, (U,) bool; fail unless they are units in order."""
    first, length, instance = units_of(count)
    place = {key: unit for unit, key in enumerate(zip(first, length, instance, strict=True))}
    fields = (commands[name].astype(int) for name in ("first_index", "index_count", "first_instance"))
    units = [place[key] for key in zip(*fields, strict=True)]
    assert (np.diff(units) > 0).all()  # in the order of the scene, none twice
    assert (commands["instance_count"] == 1).all() and not commands["vertex_offset"].any()
    kept = np.zeros(len(first), bool)
    kept[units] = True
    return kept


def must_and_need_not(count, view):
    """Return which units have a triangle that is seen, and which have certainly none: two (U,) bool, in float64.

    A triangle counts as seen if a corner of it is in the view and its area on the screen is positive. Of the second,
    the sphere is outside by a hundredth of its radius, or the cone faces away by 5 degrees more than it has to; then
    the margin for grazing triangles, a part of 0.375 / radius in pixels, must be small, too.
    """
    field, (first, length, _) = field_of(count), units_of(count)
    must, need_not = np.zeros((2, field.units), bool)
    clip_from_world = view.clip_from_world(SIZE[0] / SIZE[1])
    planes = frustum_planes(clip_from_world)
    axes, cutoffs = unpack_cones(field.meshlets["cone"])
    positions = field.vertices[: len(field.vertices) // 2].astype(float)
    for instance in field.instances:
        rows = instance["world_from_object"].astype(float)
        world = positions @ rows[:, :3].T + rows[:, 3]
        inside = (world @ planes[:, :3].T + planes[:, 3] > 0).all(axis=-1)
        stretch = np.linalg.norm(rows[0, :3])  # objects are scaled alike in all directions
        for k in range(instance["meshlets"]):
            unit, meshlet = instance["first_unit"] + k, instance["first_meshlet"] + k
            corners = field.indices[first[unit] : first[unit] + length[unit]].reshape(-1, 3)
            facing = screen_area(world[corners], clip_from_world) > 0
            must[unit] = (facing & inside[corners].any(axis=-1)).any()
            record = field.meshlets[meshlet]
            centre = rows[:, :3] @ record["centre"].astype(float) + rows[:, 3]
            radius = stretch * float(record["radius"])
            outside = (planes[:, :3] @ centre + planes[:, 3]).min() < -1.01 * radius
            seen = centre - view.eye
            away = np.linalg.norm(seen)
            pixels = radius / away * SIZE[1]
            turned = rows[:, :3] / stretch @ axes[meshlet]
            backs = turned @ seen > (cutoffs[meshlet] + 0.02 + 1.5 / pixels) * away + radius
            need_not[unit] = outside or (backs and cutoffs[meshlet] < 1)
    return must, need_not


# --- lists ------------------------------------------------------------------------------------------------------------


@compaction
@survivors
@pytest.mark.parametrize("camera", [CLOSE, None])
def test_the_list_has_what_is_seen_and_not_what_certainly_is_not(stage, camera):
    commands, _, work, view = listed(stage, Settings(COUNT), camera)
    kept = kept_of(commands, COUNT)
    must, need_not = must_and_need_not(COUNT, view)
    assert not (must & ~kept).any() and not (need_not & kept).any()
    assert must.sum() > 200 and need_not.sum() > 200
    assert work["triangles"] == units_of(COUNT)[1][kept].sum() // 3


@survivors
@pytest.mark.parametrize("group", [8, 16, 32, 256])
def test_every_size_of_work_groups_gives_the_same_complete_list(stage, group):
    """An instance has 56 to 73 meshlets: a work group takes them in chunks, or with a part of its invocations."""
    alone, _, _, _ = listed(stage, Settings(COUNT, group=64))
    commands, _, _, _ = listed(stage, Settings(COUNT, group=group))
    assert 0.2 < kept_of(alone, COUNT).mean() < 0.8 and (commands == alone).all()
    if group == 8:
        every, _, _, _ = listed(stage, Settings(COUNT, group=group, culling=False))
        assert kept_of(every, COUNT).all()


@survivors
def test_more_instances_than_one_chunk_of_the_scan(stage):
    """The scan adds up 256 instances at once."""
    count = 300
    commands, _, work, _ = listed(stage, Settings(count), camera=None)
    assert work["triangles"] == units_of(count)[1][kept_of(commands, count)].sum() // 3
    assert len(np.unique(commands["first_instance"])) > 130 and commands["first_instance"].max() > 256


@compaction
@pytest.mark.parametrize("group", [8, 64])
@pytest.mark.parametrize("camera", [CLOSE, None])
def test_runs_and_copied_indices_are_those_of_the_units_by_hand(stage, group, camera):
    first, length, instance = units_of(COUNT)
    kept = kept_of(listed(stage, Settings(COUNT), camera)[0], COUNT)
    indices = field_of(COUNT).indices
    runs, compacted, expected = [], [], {}
    for unit in np.flatnonzero(kept):
        if runs and kept[unit - 1] and instance[unit - 1] == instance[unit]:
            runs[-1][0] += length[unit]
        else:
            runs.append([length[unit], 1, first[unit], 0, instance[unit]])
        expected.setdefault(int(instance[unit]), [0, sum(map(len, compacted))])[0] += int(length[unit])
        compacted.append(indices[first[unit] : first[unit] + length[unit]])
    commands, _, work, _ = listed(stage, Settings(COUNT, "runs", group=group), camera)
    assert commands.tolist() == [tuple(run) for run in runs] and work["indices_copied"] == 0
    commands, copied, work, _ = listed(stage, Settings(COUNT, "indices", group=group), camera)
    assert commands.tolist() == [(count, 1, begin, 0, number) for number, (count, begin) in expected.items()]
    assert (copied[: work["indices_copied"]] == np.concatenate(compacted)).all()
    assert work["indices_copied"] == 3 * work["triangles"] == sum(map(len, compacted))
    assert len(expected) < len(runs) < kept.sum()


@survivors
def test_nothing_left_is_no_command_and_one_object_is_enough(stage):
    away = "0,0.5,9:0,0.5,20"
    for way in WAYS:
        images, work = drawn(stage, Settings(5, way), away)
        assert (
            work["commands"] == work["triangles"] == work["indices_copied"] == 0 and not images["depth"].any()
        )
        commands, _, work, _ = listed(stage, Settings(1, way, culling=False))
        assert work["triangles"] == commands["index_count"].sum() // 3 == len(all_meshes()[0].indices)


# --- pictures ---------------------------------------------------------------------------------------------------------


@compaction
@pytest.mark.parametrize("camera", [CLOSE, None])
def test_all_ways_draw_the_bits_of_the_whole_field(stage, camera):
    whole, work = drawn(stage, Settings(COUNT, culling=False), camera)
    assert len(np.unique(whole["instance_id"])) > 4
    for way in WAYS:
        images, less = drawn(stage, Settings(COUNT, way), camera)
        assert same(images, whole) and less["triangles"] < 0.7 * work["triangles"]


@compaction
def test_a_view_from_another_side_shows_what_is_missing(stage):
    """The pictures above are equal since what was left out is not seen, and not since nothing was left out."""
    whole, _ = drawn(stage, Settings(COUNT, turned=140.0, culling=False))
    images = [drawn(stage, Settings(COUNT, way, turned=140.0))[0] for way in WAYS]
    assert (images[0]["instance_id"] != whole["instance_id"]).mean() > 0.05
    assert same(images[0], images[1]) and same(images[0], images[2])


@compaction
def test_an_orthographic_view_is_whole_too(stage):
    with stage.open(WHICH, SIZE) as renderer:
        pose = chapters.view_of(renderer, "2,2.5,3:0,0,0").world_from_view
    view = View(pose, Orthographic(1.2, 0.5, 5.0))
    whole, work = drawn(stage, Settings(COUNT, culling=False), view=view)
    images, less = drawn(stage, Settings(COUNT, "runs"), view=view)
    assert same(images, whole) and less["triangles"] < 0.8 * work["triangles"] and whole["depth"].any()


# --- who waits --------------------------------------------------------------------------------------------------------


@compaction
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    read, written = "compute storage_read", "compute storage_write"
    uses = {
        "select": [use("select", name, written, fresh=True) for name in ("places", "sums")],
        "scan": [use("scan", "sums", read, written), use("scan", "totals#", written, fresh=True)],
        "write": [
            *(use("write", name, read) for name in ("places", "sums")),
            *(use("write", name, written, fresh=True) for name in ("commands", "copied")),
        ],
        "draws": [
            *(use("draws", name, "indirect indirect") for name in ("commands", "totals#")),
            use("draws", "copied", "index index_read"),
        ],
    }
    with stage.open(WHICH, (8, 8), settings=Settings(3, "indices")) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view), uses, downloaded=["totals#"])
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "compute" in str(one)]
    assert len(own) == 3 and all(own)


@compaction
@only_gl
def test_opengl_shows_commands_and_indices_to_draws(stage):
    bits = gl.GL_COMMAND_BARRIER_BIT | gl.GL_ELEMENT_ARRAY_BARRIER_BIT
    reads = {
        "glMultiDrawElementsIndirectCountARB": bits,
        "glDispatchCompute": gl.GL_SHADER_STORAGE_BARRIER_BIT,
    }
    with stage.open(WHICH, (8, 8), settings=Settings(3, "indices")) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view), 3)
    draws = {"glMultiDrawElementsIndirectCountARB": bits}
    assert owed(calls, draws, bits) == [] and sum(name in draws for name, _ in calls) == 3
    assert sum(name == "glDispatchCompute" for name, _ in calls) == 3 * 3
    between = [name for name, _ in calls if name in reads or name == "glMemoryBarrier"]
    assert all("glMemoryBarrier" in pair for pair in pairwise(between))


# --- what cannot be ---------------------------------------------------------------------------------------------------


@compaction
@pytest.mark.parametrize("feature", ["multi-draw", "draw-indirect-count"])
def test_a_device_without_a_feature_is_told_in_a_sentence(stage, feature):
    with pytest.raises(UnsupportedError, match=f"is used without {feature}: the study edited-draws shows"):
        stage.open(WHICH, (4, 4), without={feature})


@survivors
@pytest.mark.parametrize(("way", "what"), [("commands", "commands|places"), ("indices", "compacted indices")])
def test_lists_that_exceed_a_storage_buffer_are_refused(stage, way, what, monkeypatch):
    monkeypatch.setitem(stage.device.capabilities.limits, "maxStorageBufferRange", 1 << 18)
    with pytest.raises(
        UnsupportedError, match=rf"The ({what}) of this field take .* MiB, .*: set fewer instances\."
    ):
        stage.open(WHICH, (4, 4), settings=Settings(600 if way == "commands" else 30, way))
    stage.open(WHICH, (4, 4), settings=Settings(3, way)).close()


@survivors
@pytest.mark.parametrize(
    ("set_", "said"),
    [
        ("instances=65536", "instances must be 1 to 65535"),
        ("way=index", "did you mean 'indices'?"),
        ("group=12", "group"),
    ],
)
def test_a_wrong_knob_is_one_sentence(strata, set_, said):
    code, _, err = strata("run", WHICH, "--set", set_)
    assert code == 2 and said in err and err.count("\n") == 1, err
