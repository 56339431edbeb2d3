"""The figures of chapter 12 are true: levels, the walk of a ray, arithmetic of edges, offsets, and tables."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from tools.site.figures.canvas import Canvas
from tools.site.figures.ch12 import edges, levels, offsets, table, walk


def words_of(canvas: Canvas) -> list[str]:
    return [text for text, _ in canvas.texts]


def test_records_follow_the_bits_of_x_and_y_by_turns():
    def code(place) -> list[int]:
        low, high = levels.PLACES.min(axis=0), levels.PLACES.max(axis=0)
        x, y = (int(min((place[i] - low[i]) / (high[i] - low[i]) * 2**20, 2**20 - 1)) for i in (0, 1))
        return [bit for digit in range(19, -1, -1) for bit in (x >> digit & 1, y >> digit & 1)]

    expected = sorted(range(len(levels.PLACES)), key=lambda number: code(levels.PLACES[number]))
    assert levels.along_the_curve() == expected
    shown = [word for word in words_of(levels.two_levels()) if word.startswith("instance")]
    assert [int(word.split()[1].rstrip(",")) for word in shown] == expected


def test_boxes_of_the_upper_level_hold_instances():
    boxes = levels.boxes_of_the_top()
    assert len(boxes) == len(levels.PLACES) - 2  # all nodes but the root
    for x0, y0, x1, y1 in boxes:
        inside = (((x0, y0) < levels.PLACES) & ((x1, y1) > levels.PLACES)).all(axis=1)
        assert 2 <= inside.sum() < len(levels.PLACES)


def test_the_walk_finds_the_nearest_segment_and_skips_others():
    found = walk.walk(walk.hierarchy())
    every = [walk.distance(pair) for pair in walk.segments()]
    assert found.t == min(every) < np.inf
    assert len(found.tested) < walk.COUNT / 3 and len(found.dropped) >= 2
    assert len(found.entered) + 1 == len(found.visits)
    nearest = every.index(min(every))
    assert nearest in found.tested
    # What was dropped begins behind the hit.
    tree = walk.hierarchy()
    for node, side in found.dropped:
        assert walk.interval(tree.low[node, side], tree.high[node, side], np.inf)[0] >= found.t


def test_what_a_walk_puts_off_is_entered_later_or_dropped():
    found = walk.walk(walk.hierarchy())
    put_off = {box for visit in found.visits for box in visit.waiting}
    assert put_off == {box for box in found.entered if box in put_off} | set(found.dropped)
    assert set(found.visits[-1].waiting) <= set(found.dropped), "at the end nothing waits"
    for one, after in pairwise(found.visits):
        assert after.before == one.waiting[: len(after.before)], "what came last is taken first"
        assert len(one.waiting) - len(one.before) == (len(one.sides) == 2) and after.t <= one.t


def test_a_crossing_is_on_the_ray_and_on_the_segment():
    for pair in walk.segments():
        t = walk.distance(pair)
        if np.isfinite(t):
            place, along = walk.ORIGIN + t * walk.DIRECTION, pair[1] - pair[0]
            away = place - pair[0]
            assert abs(along[0] * away[1] - along[1] * away[0]) < 1e-12
            assert 0 <= away @ along <= along @ along


def test_rounded_products_leave_no_gap_and_multiply_add_does():
    gaps, single, double = edges.shares("precise, rounded products")
    assert (gaps, double) == (0.0, 0.0) and single == 1.0
    gaps, single, double = edges.shares("contracted to a multiply-add")
    assert gaps == pytest.approx(1 / 9, abs=0.01), "the README says a ninth"
    assert double > 0.05 and gaps + single + double == pytest.approx(1.0)


def test_edge_functions_are_those_of_fractions():
    p, q = (ends[:200] for ends in edges.ends())
    for number, (a, b) in enumerate(zip(p.tolist(), q.tolist(), strict=True)):
        exact = Fraction(a[0]) * Fraction(b[1]) - Fraction(a[1]) * Fraction(b[0])
        assert np.sign(edges.exact(p, q)[number]) == (exact > 0) - (exact < 0)
        fused = Fraction(a[0]) * Fraction(b[1]) - Fraction(float(np.float32(a[1]) * np.float32(b[0])))
        assert edges.contracted(p, q)[number] == pytest.approx(float(fused), rel=1e-6, abs=1e-12)


def test_offsets_grow_with_distance_and_a_constant_does_not():
    assert offsets.offset(0.0, 1000.0, 0.0) == pytest.approx(7000 / 2**24)
    near, far = offsets.offset(1.0, 1.0), offsets.offset(1.0, 1e6)
    assert near < 1e-5 < 1e-3 < far
    assert "a constant millimetre" in words_of(offsets.offsets_by_distance())


def test_tables_are_those_of_the_figure():
    ends = [table.regions_of(limits)[1] for limits in table.DEVICES.values()]
    shown = [int(word.split()[0]) for word in words_of(table.binding_table()) if word.endswith(" bytes")]
    # 1 + 2 + 1 handles of 32 bytes; with regions at multiples of 64 the first one leaves 32 bytes unused.
    assert shown == ends == [128, 160]
    assert table.counts() == (1, 2, 1, 0)
