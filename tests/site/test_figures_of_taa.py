"""The figures of chapter 11 are true: sequences, vectors, filters, boxes, shares and tone curves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.twins import taa as twin
from tests.twins.hdr import tone_aces, tone_reinhard
from tests.twins.shading import tone_neutral
from tools.site.figures.canvas import Canvas
from tools.site.figures.ch11 import blur, box, jitter, motion, passes, rest, tone


def words_of(canvas: Canvas) -> list[str]:
    return [text for text, _ in canvas.texts]


def test_means_are_those_of_the_sequences():
    halton = [[float(twin.digits_mirrored(n, base)) for base in (2, 3)] for n in range(1, jitter.PERIOD + 1)]
    np.testing.assert_allclose(jitter.means()["halton"], np.mean(halton, axis=0) - 0.5, atol=1e-15)
    step = np.array(twin.lattice_step())
    lattice = [(0.5 + n * step) % 1.0 for n in range(jitter.PERIOD)]
    np.testing.assert_allclose(jitter.means()["r2"], np.mean(lattice, axis=0) - 0.5, atol=1e-12)
    shown = [word for word in words_of(jitter.sequences_in_a_pixel()) if word.startswith("mean")]
    assert "mean (-0.055, 0.000)" in shown and len(shown) == 4


def test_vectors_of_a_box_lead_to_where_its_points_were():
    """Place now minus place before: turned by the frame's angle, the place before is the place now."""
    turn = np.array(
        [[math.cos(motion.RATE), -math.sin(motion.RATE)], [math.sin(motion.RATE), math.cos(motion.RATE)]]
    )
    boxed = [(x, y) for y in range(motion.SIDE) for x in range(motion.SIDE) if motion.inside(x, y)]
    assert len(boxed) == pytest.approx((2 * motion.HALF) ** 2, rel=0.1)
    for x, y in boxed:
        now = np.array((x, y)) - motion.MIDDLE
        np.testing.assert_allclose(turn @ (now - motion.turning(x, y)), now, atol=1e-12)
    shape = (motion.SIDE, motion.SIDE)
    depth = np.array([[0.5 * motion.inside(x, y) for x in range(shape[1])] for y in range(shape[0])])
    for y, row in enumerate(twin.closest(depth)):
        for x, (left, top) in enumerate(row.tolist()):
            assert motion.closest(x, y) == motion.turning(left, top)


@pytest.mark.parametrize("name", blur.LINES)
def test_a_history_that_moves_by_half_pixels_keeps_what_the_formula_says(name):
    """A cosine of which each frame shows half a pixel more, in the frame of what moves."""
    weights, frequency = blur.LINES[name], 0.25
    line = twin.LINES["tent" if name == "bilinear" else "catmull_rom_weight"]
    middle = (len(weights) - 1) / 2
    np.testing.assert_allclose(weights, line(np.arange(len(weights)) - middle), atol=1e-15)
    history = 0.0
    for _ in range(400):
        history = (1 - blur.SHARE) * blur.passed(weights, frequency) * history + blur.SHARE
    assert blur.left_over(weights, frequency) == pytest.approx(history, rel=1e-9)
    assert round(100 * history) == {"bilinear": 28, "Catmull-Rom": 49}[name], "the README says so"


def test_boxes_hold_what_is_clipped():
    for low, high in (box.extremes(), box.variance()):
        assert not ((low <= box.HISTORY) & (high >= box.HISTORY)).all()
        found = box.clipped(box.HISTORY, low, high)
        three = [np.append(one, 0.0)[None] for one in (box.HISTORY, low, high)]
        three[1][0, 2], three[2][0, 2] = -1.0, 1.0
        np.testing.assert_allclose(found, twin.clipped(*three)[0, :2], atol=1e-12)
    np.testing.assert_allclose(np.mean(box.variance(), axis=0), box.NINE.mean(axis=0))


def test_the_mean_rests_and_the_average_goes_around():
    plain, kept = map(np.array, rest.histories())
    mean = np.mean(rest.samples())
    assert 0 < mean < 1 and np.ptp(plain[-rest.PERIOD :]) > 0.1
    np.testing.assert_allclose(kept[4 * rest.PERIOD - 1 :], mean, atol=1e-12)
    assert np.ptp(kept[: 4 * rest.PERIOD]) > 0.2


def test_curves_are_those_of_the_shaders():
    lights = np.linspace(0.0, tone.MOST, 51)
    grey = np.repeat(lights[:, None], 3, axis=1)
    for name, wanted in (
        ("neutral", tone_neutral(grey)),
        ("reinhard", tone_reinhard(grey, tone.WHITE)),
        ("aces", tone_aces(grey)),
    ):
        np.testing.assert_allclose([tone.CURVES[name](x) for x in lights], wanted[:, 0], atol=1e-9)


def test_steps_stand_in_the_order_of_the_graph():
    from chapters.ch11.graph.file import graph_path, read_graph

    listed = [*read_graph(graph_path("deferred")).passes.values()]
    names = [name for names, *_ in passes.ROWS for name in names.split(", ") if name in listed]
    places = [listed.index(name) for name in names]
    assert places == sorted(places) and names[0] == "motion" and names[-1] == "fxaa"
    assert any("motion_objects" in word for word in words_of(passes.passes_behind_lighting()))
