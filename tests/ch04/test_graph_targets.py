"""Targets: what a pass finds in them, and whether anybody wants what it leaves there."""

from __future__ import annotations

import pytest

from backends.contract import Access
from chapters.ch04.graph import types as words
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.types import Attachment, External, Node, Touch
from tests.support.graph_truths import Truth
from tests.support.random_graphs import SIZE, random_graph

targets = pytest.mark.feature("frame-graph/render-targets")


def expected(truth, name):
    """The targets of a pass, from its declarations: (those of colour, that of depth)."""
    colors, depth = [], None
    for access in truth.nodes[name].writes:
        if access.use not in ("color", "depth"):
            continue
        load = "clear" if access.clear is not None else "load" if access.of else "discard"
        store = "store" if truth.is_wanted_later(access.resource) else "discard"
        target = Attachment(truth.resource(access.resource), load, store, access.clear)
        if access.use == "color":
            colors.append(target)
        else:
            depth = target
    for access in truth.nodes[name].reads:
        if access.use == "depth":
            depth = Attachment(truth.resource(truth.value(access.resource)), "load", "none")
    return tuple(colors), depth


def pixels(truth, resource):
    """The size of an image: an external's own, what its first writer says, or a share of the output."""
    if resource in truth.externals:
        return truth.externals[resource].size
    made = next(a for node in truth.wanted.values() for a in node.writes if a.resource == resource)
    return made.size or (round(SIZE[0] * made.scale), round(SIZE[1] * made.scale))


@targets
def test_targets_are_cleared_loaded_and_stored_exactly_where_somebody_wants_it():
    counts = dict.fromkeys(("clear", "load", "discard", "store", "discarded", "none"), 0)
    for seed in range(150):
        made = random_graph(seed, words)
        truth = Truth(made.nodes, made.outputs, made.externals, made.keep)
        graph = made.compile(compile_graph)
        for step in graph.steps:
            assert (step.colors, step.depth) == expected(truth, step.name), (seed, step.name)
            assert step.kind == truth.nodes[step.name].kind
            drawn = [*step.colors, *([step.depth] if step.depth else [])]
            sizes = {pixels(truth, target.resource) for target in drawn}
            assert sizes == ({step.size} if drawn else set())
            for target in drawn:
                counts[target.load] += 1
                counts["discarded" if target.store == "discard" else target.store] += 1
        for name, resource in graph.resources.items():
            if truth.is_image(name):
                assert resource.size == pixels(truth, name)
    assert min(counts.values()) > 10, counts


@targets
def test_what_a_pass_draws_on_top_of_is_kept_and_what_nobody_reads_is_not():
    nodes = [
        Node(
            "opaque",
            (),
            (
                Access("lit", "color", "rgba16f", clear=(0.0, 0.0, 0.0, 1.0)),
                Access("depth", "depth", "d32f", clear=(0.0,)),
            ),
        ),
        Node("glass", (Access("depth", "depth"),), (Access("lit_glass", "color", of="lit"),)),
        Node(
            "final",
            (Access("lit_glass", "sampled"),),
            (Access("picture", "color", "rgba8"), Access("unused", "color", "rgba8")),
        ),
    ]
    graph = compile_graph(nodes, (64, 32), ["picture"])
    opaque, glass, final = graph.steps
    assert opaque.colors == (Attachment("lit", "clear", "store", (0.0, 0.0, 0.0, 1.0)),)
    assert opaque.depth == Attachment("depth", "clear", "store", (0.0,))
    assert glass.colors == (Attachment("lit", "load", "store"),)
    assert glass.depth == Attachment("depth", "load", "none"), "tested against, and not written"
    assert final.colors == (
        Attachment("picture", "discard", "store"),
        Attachment("unused", "discard", "discard"),
    )
    assert final.depth is None


@targets
def test_depth_may_be_tested_and_sampled_at_once():
    """Neither writes: one layout serves both, and no barrier stands between them."""
    first = Node("prepass", (), (Access("depth", "depth", "d32f", clear=(0.0,)),))
    soft = Node(
        "soft", (Access("depth", "depth"), Access("depth", "sampled")), (Access("picture", "color", "rgba8"),)
    )
    graph = compile_graph([soft, first], (64, 32), ["picture"])
    assert graph.steps[1].depth == Attachment("depth", "load", "none")
    (barrier,) = [barrier for barrier in graph.steps[1].barriers if barrier.resource == "depth"]
    assert barrier.after == Touch(
        "read", frozenset({"depth", "fragment"}), frozenset({"depth_read", "sampled"})
    )


@targets
def test_targets_that_last_are_stored_though_nobody_reads_them_in_this_frame():
    taa = Node(
        "taa", (Access("resolved", "sampled", previous=True),), (Access("resolved", "color", "rgba16f"),)
    )
    tone = Node(
        "tone",
        (Access("resolved", "sampled"),),
        (Access("screen", "color"), Access("looked", "color", "rgba8")),
    )
    screen = {"screen": External("rgba8", (64, 32), Touch("undefined", frozenset(), frozenset()))}
    graph = compile_graph([taa, tone], (64, 32), externals=screen, keep=["looked"])
    assert [target.store for step in graph.steps for target in step.colors] == ["store"] * 3


@targets
def test_sizes_are_shares_of_the_output_or_absolute():
    def size(output, **how):
        nodes = [Node("draw", (), (Access("image", "color", "rgba8", **how),))]
        return compile_graph(nodes, output, ["image"]).steps[0].size

    assert size((1280, 720)) == (1280, 720)
    assert size((1280, 720), scale=0.5) == (640, 360)
    assert size((1280, 720), size=(7, 3)) == (7, 3)
    assert size((3, 1), scale=0.25) == (1, 1), "an image has a pixel at least"
