"""A history may be used only if the frame before wrote it, as it is now, without a cut."""

from __future__ import annotations

import pytest

from backends.contract import Access
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.histories import BITS, Histories
from chapters.ch04.graph.types import Node
from common import layouts


def graph(size=(8, 8), format="rgba16f", skipped=""):
    """Return a frame with a history: a blend that reads what it wrote the frame before."""
    blend = Node(
        "blend",
        (Access("noise", "sampled"), Access("history_color", "sampled", previous=True)),
        (Access("history_color", "color", format=format),),
        skipped,
    )
    noise = Node("noise", (), (Access("noise", "color", format="rgba8"),))
    shown = "noise" if skipped else "history_color"
    show = Node("show", (Access(shown, "sampled"),), (Access("color", "color", format="rgba8"),))
    return compile_graph([blend, noise, show], size, ["color"])


def test_the_first_frame_has_none_and_the_second_has_it():
    histories, made = Histories(), graph()
    assert histories.valid(made, 0, "first frame") == frozenset()
    histories.rendered(made, 0)
    assert histories.valid(made, 1, "") == {"history_color"}
    assert histories.mask(made, 1, "") == layouts.HISTORY_FRAME | layouts.HISTORY_COLOR


@pytest.mark.parametrize("reset", ["camera cut", "resize", "time ran backwards"])
def test_a_cut_makes_it_invalid_for_one_frame(reset):
    histories, made = Histories(), graph()
    histories.rendered(made, 0)
    assert histories.mask(made, 1, reset) == 0
    histories.rendered(made, 1)
    assert histories.valid(made, 2, "") == {"history_color"}


@pytest.mark.parametrize("other", [graph(size=(8, 4)), graph(format="rgba32f")])
def test_another_size_or_format_makes_it_invalid(other):
    histories = Histories()
    histories.rendered(graph(), 0)
    assert histories.valid(other, 1, "") == frozenset()


def test_skipping_the_writer_for_one_frame_makes_it_invalid():
    histories, made = Histories(), graph()
    histories.rendered(made, 0)
    histories.rendered(graph(skipped="switched off"), 1)
    assert histories.valid(made, 2, "") == frozenset()
    histories.rendered(made, 2)
    assert histories.valid(made, 3, "") == {"history_color"}


def test_a_frame_that_was_not_drawn_makes_it_invalid():
    histories, made = Histories(), graph()
    histories.rendered(made, 0)
    assert histories.valid(made, 2, "") == frozenset()


def test_other_images_have_no_history():
    histories, made = Histories(), graph()
    histories.rendered(made, 0)
    histories.forget()
    assert histories.valid(made, 1, "") == frozenset()


def test_bits_are_those_of_the_frame_constants():
    assert BITS["history_frame"] == layouts.HISTORY_FRAME and len(set(BITS.values())) == len(BITS) == 9
