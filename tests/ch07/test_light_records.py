"""Records of lights as shaders read them: unexposed, directional ones first, from the ordinary to the absurd."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch07.clusters import lights as module
from chapters.ch07.clusters.lights import LightRecords
from chapters.ch07.scene.packing import LIGHT_KINDS
from common.numerics.transforms import pose_looking_at
from common.scene import Light
from common.scene.pose import evaluate_pose
from tests.support.scenes import nodes_at, quad_scene, translated


def packed(light, node=None, cutoff=0.0, origin=None):
    """Return the record of one light at `node` (4, 4)."""
    scene = quad_scene(lights=(light,))
    scene = replace(scene, nodes=nodes_at(np.eye(4), np.eye(4) if node is None else node))
    if origin is not None:
        scene.origin = np.array(origin, np.float64)
    records = LightRecords(scene, cutoff, 4096)
    records.follow()
    return records.at(evaluate_pose(scene, 0.0))[0]


def test_a_light_is_placed_and_directed_by_its_node():
    node = pose_looking_at((3.0, 4.0, 5.0), (3.0, 0.0, 5.0), (0.0, 0.0, -1.0))
    record = packed(
        Light("spot", node=1, intensity=2.0, color=(1.0, 0.5, 0.25)), node @ np.diag((7.0, 7, 7, 1))
    )
    assert record["kind"] == LIGHT_KINDS["spot"] == 1
    assert np.allclose(record["position"], (3, 4, 5))
    assert np.allclose(record["direction"], (0, -1, 0), atol=1e-7), "scale changes no direction"
    assert np.allclose(record["color"], (2.0, 1.0, 0.5)), "candela of each colour, unexposed"


def test_positions_are_relative_to_the_origin_before_they_are_rounded():
    far = 1e7
    record = packed(Light("point", node=1), translated(far + 0.125), origin=(far, 0.0, 0.0))
    assert record["position"][0] == 0.125


def test_the_cone_is_one_inside_and_zero_outside():
    """glTF: ((cos - cos outer) / (cos inner - cos outer))^2, clamped; scale and offset are those of the line."""
    inner, outer = 0.3, 0.7
    scale, offset = packed(Light("spot", node=1, inner_cone=inner, outer_cone=outer))["cone"][:2].astype(
        np.float64
    )
    assert scale * math.cos(inner) + offset == pytest.approx(1.0, abs=1e-6)
    assert scale * math.cos(outer) + offset == pytest.approx(0.0, abs=1e-6)
    equal = packed(Light("spot", node=1, inner_cone=0.5, outer_cone=0.5))["cone"]
    assert equal[0] == pytest.approx(1000.0), (
        "cones of no width are the steepest line that the extension's code has"
    )


@pytest.mark.parametrize("kind", ["point", "spot", "directional"])
@pytest.mark.parametrize("intensity", [0.0, 1e-30, 1.0, 1e30, 1e300])
@pytest.mark.parametrize("reach", [1e-320, 1e-200, 1e-3, 1e3, 1e200, math.inf])
@pytest.mark.parametrize("cutoff", [0.0, 1e-300, 1e-3])
def test_records_are_finite_whatever_the_file_says(kind, intensity, reach, cutoff):
    record = packed(Light(kind, node=1, intensity=intensity, range=reach), cutoff=cutoff)
    for name in record.dtype.names:
        assert np.isfinite(record[name]).all(), name


def test_a_light_on_a_node_without_size_shines_somewhere():
    record = packed(Light("directional", node=1), np.diag((0.0, 0.0, 0.0, 1.0)))
    assert np.linalg.norm(record["direction"]) == 1.0


def test_a_light_whose_place_is_no_number_gives_no_light():
    """As brute force adds it, a place of NaN would blacken every pixel."""
    lost = packed(Light("spot", node=1, intensity=3.0), translated(math.nan, 1.0, 2.0))
    assert lost["color"].max() == 0.0
    assert np.isfinite(lost["position"]).all() and np.isfinite(lost["direction"]).all()
    assert packed(Light("spot", node=1, intensity=3.0), translated(4.0, 1.0, 2.0))["color"].max() == 3.0


def test_range_and_cutoff_are_squares_of_distances():
    record = packed(Light("point", node=1, range=4.0, intensity=9.0), cutoff=0.25)
    assert record["inverse_range2"] == 1 / 16
    assert record["end_distance2"] == pytest.approx(36.0)
    sun = packed(Light("directional", node=1, range=4.0, intensity=9.0), cutoff=0.25)
    assert sun["inverse_range2"] == 0.0, "the sun has no range"
    assert sun["end_distance2"] > 1e37


def test_cutoff_is_where_the_brightest_colour_falls_below():
    light = Light("point", node=1, intensity=8.0, color=(0.1, 0.5, 0.25))
    distance = math.sqrt(packed(light, cutoff=0.02)["end_distance2"])
    assert 8.0 * 0.5 / distance**2 == pytest.approx(0.02), "in lux, whatever the exposure is"
    assert packed(light, cutoff=0.0)["end_distance2"] > 1e37


def test_directional_lights_come_first_and_nodes_go_with_them():
    """Records follow the order that the loops take; each keeps the place of its own node."""
    kinds = ("point", "directional", "spot", "directional")
    lights = tuple(Light(kind, node=number, intensity=number + 1.0) for number, kind in enumerate(kinds))
    scene = quad_scene(matrices=tuple(translated(float(x)) for x in range(4)), lights=lights)
    records = LightRecords(scene, 0.0, 4096)
    records.follow()
    found = records.at(evaluate_pose(scene, 0.0))
    assert records.directional == 2 and records.nodes.tolist() == [1, 3, 0, 2]
    assert found["color"][:, 0].tolist() == [2.0, 4.0, 1.0, 3.0]
    assert (found["position"][:, 0] + scene.origin[0]).tolist() == [1.0, 3.0, 0.0, 2.0]


@pytest.mark.parametrize("bad", [math.nan, -3.0, -math.inf])
def test_what_is_negative_or_no_number_gives_no_light(bad):
    record = packed(Light("point", node=1, intensity=bad), cutoff=0.001)
    assert not record["color"].any() and record["end_distance2"] == 0.0
    channel = packed(Light("point", node=1, intensity=2.0, color=(1.0, bad, 0.5)), cutoff=0.5)
    assert channel["color"].tolist() == [2.0, 0.0, 1.0] and channel["end_distance2"] == pytest.approx(4.0)


def test_a_light_that_is_no_number_is_the_weakest():
    assert kept([Light("point", node=0, intensity=value) for value in (1.0, math.nan, 5.0, 2.0, 9.0)], 2) == [
        2,
        4,
    ]


def test_equal_lights_keep_the_first():
    lights = [Light("point", node=0, intensity=1.0)] * 5 + [Light("directional", node=0, intensity=1e-3)]
    assert kept(lights, 3) == [5, 0, 1]


def kept(lights, most):
    """Return the numbers of the lights that are kept, from the nodes of the records: each has its own."""
    lights = [replace(light, node=number) for number, light in enumerate(lights)]
    records = LightRecords(quad_scene(matrices=(np.eye(4),) * len(lights), lights=tuple(lights)), 0.0, most)
    records.follow()
    return records.nodes.tolist()


def chosen(lights, most):
    """Return the same by sorting: the strongest by lux before the strongest by candela, in the order of the records."""

    def strength(number):
        light = lights[number]
        peak = max((value for part in light.color if (value := part * light.intensity) > 0), default=0.0)
        return light.kind != "directional", -peak

    best = sorted(range(len(lights)), key=strength)[:most]
    return sorted(best, key=lambda number: (lights[number].kind != "directional", number))


def any_light(rng):
    """Return a light of any kind on one of four nodes, now and then a useless one."""
    inner, outer = np.sort(rng.uniform(0.0, 1.6, 2))
    return Light(
        str(rng.choice(["point", "spot", "directional"], p=(0.5, 0.4, 0.1))),
        node=int(rng.integers(4)),
        color=tuple(rng.choice([0.0, 0.3, 1.0, math.nan, -1.0], 3, p=(0.2, 0.3, 0.3, 0.1, 0.1))),
        intensity=float(rng.choice([rng.uniform(0, 900), 5.0, math.nan, -2.0], p=(0.6, 0.2, 0.1, 0.1))),
        range=float(rng.choice([rng.uniform(0.01, 50), 0.0, math.inf], p=(0.6, 0.1, 0.3))),
        inner_cone=float(inner),
        outer_cone=float(outer),
    )


@pytest.mark.parametrize("most", [17, 4096])
def test_lights_that_edits_replace_have_the_records_of_a_fresh_start(most):
    """Bit for bit, whatever an edit changes, also as a light comes among the brightest and leaves them."""
    rng = np.random.default_rng(7)
    scene = quad_scene(
        matrices=tuple(translated(float(x)) for x in range(4)),
        lights=tuple(any_light(rng) for _ in range(40)),
    )
    records, pose, orders = LightRecords(scene, 0.01, most), evaluate_pose(scene, 0.0), set()
    for number in range(60):
        with scene.edit() as edit:
            for index in rng.integers(39, size=rng.integers(1, 4)):
                edit.set_light(int(index), any_light(rng))
        if number % 20 == 19:  # no edit does this; records follow all the same
            scene.lights.pop() if number % 40 == 19 else scene.lights.insert(3, any_light(rng))
        records.follow()
        fresh = LightRecords(scene, 0.01, most)
        fresh.follow()
        assert records.at(pose).tobytes() == fresh.at(pose).tobytes()
        assert records.directional == fresh.directional and np.array_equal(records.nodes, fresh.nodes)
        assert records.nodes.tolist() == [scene.lights[it].node for it in chosen(scene.lights, most)]
        orders.add(tuple(records.nodes.tolist()))
    assert len(orders) > 10


def test_an_edit_packs_the_lights_that_it_replaces(monkeypatch):
    """Counted, not timed: of 2,400 lights an edit of 3 packs 3, and one of an equal copy packs that."""
    packed_at_once, pack = [], module.packed
    monkeypatch.setattr(
        module, "packed", lambda lights, cutoff: (packed_at_once.append(len(lights)), pack(lights, cutoff))[1]
    )
    scene = quad_scene(lights=tuple(Light("point", node=0, intensity=1.0 + n) for n in range(2400)))
    records = LightRecords(scene, 0.01, 1000)
    records.follow()
    for count in (1, 3):
        with scene.edit() as edit:
            for number in range(count):
                edit.set_light(700 * number, replace(scene.lights[700 * number], intensity=1e5 + number))
        records.follow()
        records.follow()
    with scene.edit() as edit:
        edit.set_transform(0, matrix=translated(1.0))
    records.follow()
    assert packed_at_once == [2400, 1, 3]
    assert len(records.nodes) == 1000
