"""The GLSL text of the records is parsed and laid out anew by the rules of std140 and std430."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np
import pytest

from common import layouts
from common.layouts import (
    CONSTANTS,
    INSTANCE_MIRRORED,
    INSTANCE_MOVED,
    INSTANCE_VISIBLE,
    RECORDS,
    dtype,
    fill_frame_constants,
    fill_instances,
    glsl,
    glsl_constants,
)
from common.numerics.transforms import compose, pose_looking_at, transform_points
from common.view.camera import UNIT_EV100, Orthographic, Perspective, View

RNG = np.random.default_rng(1)


def specification(type_name, rule):
    """Base alignment and size by the OpenGL 4.6 specification, 7.6.2.2, rules 1 to 7."""
    scalar = re.fullmatch(r"float|int|uint", type_name)
    vector = re.fullmatch(r"[iu]?vec([234])", type_name)
    matrix = re.fullmatch(r"mat([234])(?:x([234]))?", type_name)
    if scalar:
        return 4, 4
    if vector:
        n = int(vector[1])
        return {2: 8, 3: 16, 4: 16}[n], 4 * n
    columns, rows = int(matrix[1]), int(matrix[2] or matrix[1])
    alignment = {2: 8, 3: 16, 4: 16}[rows]
    if rule == "std140":
        alignment = max(alignment, 16)  # of an array, as which the columns are stored
    return alignment, columns * alignment


def lay_out(text, rule):
    at, largest, places = 0, 16 if rule == "std140" else 4, {}
    for line in text.splitlines():
        type_name, name = re.fullmatch(r"\s*(\w+) (\w+);\s*(?://.*)?", line).groups()
        alignment, size = specification(type_name, rule)
        at = -(-at // alignment) * alignment
        places[name], at, largest = at, at + size, max(largest, alignment)
    return places, -(-at // largest) * largest


@pytest.mark.parametrize("name", RECORDS)
@pytest.mark.parametrize("rule", ["std140", "std430"])
def test_numpy_and_glsl_agree_by_both_rules(name, rule):
    places, size = lay_out(glsl(name), rule)
    fields = dtype(name).fields
    assert {field: fields[field][1] for field in fields} == places and list(fields) == list(places)
    assert dtype(name).itemsize == size
    assert size <= 16384  # the smallest limit of a uniform block


@pytest.mark.parametrize("name", RECORDS)
def test_no_member_overlaps_and_every_one_is_explained(name):
    ends = sorted((offset, offset + kind.itemsize) for kind, offset in dtype(name).fields.values())
    assert all(a[1] <= b[0] for a, b in pairwise(ends))
    assert all(member.doc for member in RECORDS[name])


def test_constants_are_single_bits_and_reach_glsl():
    for prefix in ("INSTANCE_", "HISTORY_"):
        bits = [value for name, value in CONSTANTS.items() if name.startswith(prefix)]
        assert len(set(bits)) == len(bits) > 1 and all(value.bit_count() == 1 for value in bits)
    assert f"const uint INSTANCE_MIRRORED = {INSTANCE_MIRRORED}u;\n" in glsl_constants()
    assert "INSTANCE_VISIBLE" in vars(layouts)


def constants(view, before, **options):
    record = np.zeros((), dtype("FrameConstants"))
    options = {"origin": np.zeros(3), "length_scale": 2.0, **options}
    fill_frame_constants(record, view, before, (640, 360), **options)
    return record


def as_glsl(record, name):
    """The matrix as GLSL sees it: m[column][row] read column after column from memory."""
    columns = np.frombuffer(record.tobytes(), np.float32, 16, dtype("FrameConstants").fields[name][1])
    return columns.reshape(4, 4).T.astype(float)


@pytest.mark.parametrize("projection", [Perspective(0.8, 0.1), Orthographic(3.0, 0.5, 40.0)])
def test_frame_constants_project_as_the_view_does(projection):
    view = View(pose_looking_at((3, 4, 5), (0, 1, 0)), projection)
    before = View(pose_looking_at((3, 4.5, 5), (0, 1, 0)), projection)
    record = constants(view, before, jitter_px=(0.25, -0.5), previous_jitter_px=(-0.125, 0.375))
    points = RNG.uniform(-1, 1, (50, 3))
    for prefix, shown, jitter in (("", view, (0.25, -0.5)), ("previous_", before, (-0.125, 0.375))):
        expected = transform_points(shown.clip_from_world(640 / 360), points)
        steady = transform_points(as_glsl(record, f"{prefix}steady_clip_from_world"), points)
        drawn = transform_points(as_glsl(record, f"{prefix}clip_from_world"), points)
        assert np.abs(steady - expected).max() < 1e-6
        shift_px = (drawn - steady)[:, :2] * (320, 180)
        assert np.abs(shift_px - jitter).max() < 1e-3  # in pixels: to the right and down
        for name in ("view_from_world", "clip_from_view", "clip_from_world"):
            to, origin = name.split("_from_")
            for kind in ("",) if name == "view_from_world" else ("", "steady_"):
                forward = as_glsl(record, f"{prefix}{kind}{name}")
                backward = as_glsl(record, f"{prefix}{kind}{origin}_from_{to}")
                assert np.abs(forward @ backward - np.eye(4)).max() < 2e-5
        assert np.allclose(record[f"{prefix}eye"][:3], shown.eye)
    assert record["orthographic"] == isinstance(projection, Orthographic)
    assert record["near"] == np.float32(projection.near)
    assert record["far"] == (40 if isinstance(projection, Orthographic) else 0)
    assert record["eye"][3] == 2.0 and np.allclose(record["size"], (640, 360, 1 / 640, 1 / 360))


def test_every_byte_is_written_whatever_the_record_held_before():
    """Two fills of the same record: the second frame shares its camera with the first, and nothing else."""
    view = View(pose_looking_at((3, 4, 5), (0, 1, 0)), Orthographic(3.0, 0.5, 40.0))
    plain = {"origin": np.zeros(3), "length_scale": 2.0}
    told = {
        "time": 3.0,
        "frame_index": 7,
        "valid_histories": 5,
        "instance_count": 9,
        "light_count": 2,
        "ambient": 0.5,
    }
    kind = dtype("FrameConstants")
    record = np.frombuffer(bytearray(b"\xab" * kind.itemsize), kind).reshape(())
    fill_frame_constants(record, view, view, (640, 360), **plain, **told, environment=(1e3, 0.6, 0.8, 4.0))
    assert (record["time"], record["frame_index"], record["light_count"]) == (3.0, 7, 2)
    assert record["ambient"][0] > 0
    fill_frame_constants(record, view, view, (640, 360), **plain)
    assert record.tobytes() == constants(view, view).tobytes()


def test_a_static_view_has_bit_equal_matrices_now_and_before():
    view = View(pose_looking_at((3, 4, 5), (0, 1, 0)))
    record = constants(view, view, jitter_px=(0.25, -0.5))
    for member in RECORDS["FrameConstants"]:
        if member.name.startswith("previous_steady_"):
            assert np.array_equal(record[member.name], record[member.name.removeprefix("previous_")])


def test_far_from_zero_nothing_is_lost_that_the_origin_keeps():
    """In a world 1e5 m away a point moves by no more than 1e-4 px against the same scene at zero."""
    offset = np.array([1e5, -1e5, 1e5])
    here = View(pose_looking_at((3, 4, 5), (0, 1, 0)))
    there = View(here.world_from_view + np.pad(offset[:, None], ((0, 1), (3, 0))))
    points = RNG.uniform(-1, 1, (200, 3)).astype(np.float32)
    near = transform_points(as_glsl(constants(here, here), "clip_from_world"), points)
    record = constants(there, there, origin=offset)
    far = transform_points(as_glsl(record, "clip_from_world"), points)
    assert np.abs((near - far)[:, :2] * (320, 180)).max() < 1e-4
    assert np.allclose(record["eye"][:3], (3, 4, 5)) and np.array_equal(record["origin"][:3], offset)
    naive = (there.clip_from_world(640 / 360)).astype(np.float32) @ np.c_[
        points + offset, np.ones(200)
    ].T.astype(np.float32)
    assert np.abs((naive[:2] / naive[3]).T - near[:, :2]).max() * 320 > 1e-2  # what float32 alone would do


def test_exposures_times_and_counters():
    pose = np.eye(4)
    record = constants(
        View(pose, ev100=UNIT_EV100 + 1),
        View(pose, ev100=UNIT_EV100),
        time=3600.016,
        previous_time=3600.0,
        frame_index=7,
        valid_histories=5,
        instance_count=3,
        light_count=2,
    )
    assert record["exposure"] == pytest.approx(0.5) and record["previous_exposure"] == pytest.approx(1.0)
    assert record["delta_time"] == pytest.approx(0.016, rel=1e-6)  # the float32 times differ by 0.01611
    counters = ("frame_index", "valid_histories", "instance_count", "light_count")
    assert [int(record[name]) for name in counters] == [7, 5, 3, 2]
    adapted = constants(View(pose), View(pose), exposure_now=0.25, exposure_before=0.125)
    assert adapted["exposure"] == 0.25 and adapted["previous_exposure"] == 0.125


def test_light_beyond_float32_ends_at_its_largest_number():
    brightest = (1e17 * 1e9, 1.0, 0.0, 0.0)  # times the largest intensity
    record = constants(View(np.eye(4), ev100=-60.0), View(np.eye(4)), environment=brightest)
    assert record["environment"][0] == np.finfo(np.float32).max


def instances(now, before=None, **options):
    records = np.zeros(len(now), dtype("Instance"))
    boxes = np.tile(np.array([[-1.0, -2, -3], [2, 3, 5]]), (len(now), 1, 1))
    options = {
        "origin": np.zeros(3),
        "object_bounds": boxes,
        "mesh": 0,
        "material": 0,
        "visible": True,
        **options,
    }
    fill_instances(records, now, now if before is None else before, **options)
    return records


def test_instances_transform_as_glsl_multiplies():
    quaternions = RNG.normal(size=(40, 4))
    origin = np.array([1e4, 2e4, -3e4])
    now = compose(origin + RNG.normal(size=(40, 3)), quaternions, RNG.uniform(-2, 2, (40, 3)))
    records = instances(now, origin=origin, mesh=np.arange(40) % 7, material=3)
    points = RNG.uniform((-1, -2, -3), (2, 3, 5), (60, 3))
    expected = np.einsum("nij,pj->npi", now[:, :3, :3], points) + (now[:, None, :3, 3] - origin)
    rows = records["world_from_object"].astype(
        float
    )  # vec4 * mat3x4 is the dot product with each stored column
    ours = np.einsum("nij,pj->npi", rows, np.c_[points, np.ones(60)])
    assert np.abs(ours - expected).max() < 2e-6
    low = records["bounds_centre"][:, None, :3].astype(float) - records["bounds_extent"][:, None, :3]
    high = records["bounds_centre"][:, None, :3].astype(float) + records["bounds_extent"][:, None, :3]
    corners = np.array([(x, y, z) for x in (-1, 2) for y in (-2, 3) for z in (-3, 5)], float)
    world = np.einsum("nij,pj->npi", now[:, :3, :3], corners) + (now[:, None, :3, 3] - origin)
    assert (low <= world).all() and (world <= high).all()
    tight = np.stack([world.min(axis=1), world.max(axis=1)])
    assert np.abs(tight - [low[:, 0], high[:, 0]]).max() < 1e-5
    middle = records["bounds_centre"][:, None, :3]
    assert (np.linalg.norm(world - middle, axis=2) <= records["bounds_centre"][:, None, 3]).all()
    assert np.array_equal(records["id"], np.arange(40)) and np.array_equal(records["mesh"], np.arange(40) % 7)


def test_instance_normals_and_flags():
    now = compose(np.zeros((3, 3)), (0, 0, 0, 1), [(1, 2, 3), (-1, 2, 3), (1, 0, 1)])
    before = now.copy()
    before[0, 0, 3] = 1e-12
    records = instances(now, before, visible=[True, True, False])
    assert list(records["flags"]) == [
        INSTANCE_VISIBLE | INSTANCE_MOVED,
        INSTANCE_VISIBLE | INSTANCE_MIRRORED,
        0,
    ]
    normals = np.einsum("nij,j->ni", records["normal_from_object"], (1, 1, 1, 0))
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    expected = [np.array((1, 1 / 2, 1 / 3)), np.array((-1, 1 / 2, 1 / 3)), np.array((0, 1, 0))]
    assert np.allclose(normals, [e / math.sqrt(e @ e) for e in expected])
