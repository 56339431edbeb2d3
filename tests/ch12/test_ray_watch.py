"""When a hierarchy is due for a rebuild: by reports that come two frames late, within a budget. No device."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch12.rays.bvh import model
from chapters.ch12.rays.bvh.fast import Rebuilt
from chapters.ch12.rays.bvh.memory import _ranges, _without
from chapters.ch12.rays.bvh.quality import Watch
from chapters.ch12.rays.vulkan_quality import figure_of

pytestmark = pytest.mark.feature("acceleration/refit")


def watch(sizes=(100, 200, 50), most=2.0, budget=250):
    return Watch(sizes, [10.0] * len(sizes), [4] * len(sizes), most, budget)


def report(watched, slot, *costs):
    watched.ask(slot, True)
    watched.take(slot, np.array(costs, np.float32))


def test_the_worst_comes_first_within_the_budget():
    watched = watch()
    report(watched, 0, 21.0, 30.0, 20.0)
    assert watched.worst_percent == 300
    assert watched.due() == (1,)  # 200 and 100 are more than 250
    assert watched.due() == (0,) and watched.due() == ()  # 20 is no more than twice 10
    assert watched.builds == (1, 1, 0)


def test_reports_of_before_a_build_are_not_read_after_it():
    """The frame behind one that is late has measured the same; the first report behind a build is its cost."""
    watched = watch()
    watched.ask(0, True)
    watched.ask(1, True)
    late = np.array([50.0, 10.0, 10.0])
    watched.take(0, late)
    assert watched.due() == (0,)
    watched.ask(0, True)
    watched.take(1, late)
    assert watched.due() == ()
    watched.take(0, np.array([30.0, 10.0, 10.0]))
    assert watched.due() == () and watched.worst_percent == 100
    report(watched, 1, 59.0, 10.0, 10.0)
    assert watched.due() == ()
    report(watched, 1, 61.0, 10.0, 10.0)
    assert watched.due() == (0,)


def test_what_is_too_large_or_has_one_form_alone_is_not_watched():
    watched = watch((4, 5, 250, 251))
    assert watched.watched == (1, 2)
    report(watched, 0, *[99.0] * 4)
    assert watched.due() == (1,) and watched.due() == (2,) and watched.due() == ()


def test_a_frame_in_which_meshes_rest_measures_the_last_alone():
    watched = watch()
    watched.ask(0, False)
    watched.take(0, np.array([np.nan, 99.0, 30.0]))
    assert watched.due() == (2,) and not watched.asks(0)


def test_a_bound_below_one_builds_nothing_that_has_not_changed():
    watched = watch(most=0.1)
    report(watched, 0, 10.0, 10.0, 10.0)
    assert watched.due() == ()


def test_a_mesh_without_extent_is_due_once_it_has_one():
    watched = Watch([9], [0.0], [4], 2.0, 100)
    report(watched, 0, 0.0)
    assert watched.due() == ()
    report(watched, 0, 7.0)
    assert watched.due() == (0,) and watched.worst_percent == 10**9


def test_a_figure_that_falls_is_a_reason_where_either_way_is():
    for either_way, due in ((False, ()), (True, (0,))):
        watched = Watch([9], [30.0], [4], 2.0, 100, either_way)
        report(watched, 0, 14.0)
        assert watched.due() == due


def test_a_cost_that_is_no_number_or_infinite_is_no_reason():
    watched = Watch([9], [30.0], [4], 2.0, 100, either_way=True)
    for cost in (np.nan, np.inf, -1.0):
        report(watched, 0, cost)
        assert watched.due() == () and watched.worst_percent == 100


def test_the_figure_of_groups_is_that_of_their_boxes():
    """Nine triangles are two groups: flat unit squares in x and y, one of them 3 above the others."""
    triangle = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)
    corners = np.tile(triangle, (9, 1, 1))
    corners[8, :, 2] = 3.0
    # Half the surfaces: 1 for each group, and 1 + 3 + 3 for the box around all.
    assert figure_of(corners) == pytest.approx(2 / 7)
    corners[0, :, 2] = 3.0  # the first group reaches through all
    assert figure_of(corners) == pytest.approx(8 / 7)
    assert figure_of(corners[:0]) == 0.0 and figure_of(np.zeros((9, 3, 3))) == 0.0


def test_levels_are_refitted_without_what_the_gpu_has_built():
    """Ranges of the list that `pack.refit_lists` returns, deepest level first."""
    levels = [[0, 1, 3], [0, 1, 2, 5], [0, 1]]
    ranges = _ranges(levels)
    assert ranges == [[(1, 0, 3)], [(0, 3, 2), (1, 5, 1)], [(0, 6, 1), (1, 7, 1), (2, 8, 1)]]
    assert _without(ranges, frozenset()) == [[(0, 3)], [(3, 3)], [(6, 3)]]
    assert _without(ranges, frozenset({1})) == [[(3, 2)], [(6, 1), (8, 1)]]
    assert _without(ranges, frozenset({0, 1, 2})) == [] and _ranges([]) == []


def test_the_upper_level_has_a_bound_of_its_own():
    """A traversal keeps a code for each node on its way through both levels."""
    for count in (1, 2, 1000, 10**6, model.INSTANCES_LARGEST):
        tree = Rebuilt(0, 0, count, upper=True)
        assert tree.bits + max(count - 1, 0).bit_length() <= model.DEPTH_UPPER and tree.bits >= 8
        assert not any(step.part in ("ORDER", "TRIANGLES") for step in tree.rebuild())
