"""Who writes what others read: edges, passes that fall out, what stands in for them, and graphs that are refused."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest

from backends.contract import Access
from chapters.ch04.graph import types as words
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.types import External, GraphError, Node, Touch
from tests.support.graph_truths import PREVIOUS, Truth
from tests.support.random_graphs import random_graph

edges = pytest.mark.feature("frame-graph/edges")
types = pytest.mark.feature("frame-graph/resource-types")
externals = pytest.mark.feature("frame-graph/external-resources")
enabling = pytest.mark.feature("frame-graph/node-enable")
sorting = pytest.mark.feature("frame-graph/topological-sort")

READY = Touch("read", frozenset(), frozenset())


def drawing(name, target, *reads, why_not="", **more):
    """A pass that draws to `target` and samples `reads`."""
    sampled = tuple(Access(read, "sampled") for read in reads)
    write = Access(target, "color", "rgba8", **more)
    return Node(name, sampled, (write,), why_not)


def compiled(*nodes, outputs=(), size=(64, 32), **more):
    return compile_graph(nodes, size, outputs, **more)


def random_frames(seeds, **more):
    """Random graphs with their truth and what they compile to."""
    for seed in seeds:
        made = random_graph(seed, words, **more)
        truth = Truth(made.nodes, made.outputs, made.externals, made.keep)
        yield made, truth, made.compile(compile_graph)


# --- against brute force ----------------------------------------------------------------------------------------------


def check_connections(seeds):
    for made, truth, graph in random_frames(seeds):
        assert {(edge.before, edge.after, edge.why) for edge in graph.edges} == truth.edges
        assert all(edge.before != edge.after for edge in graph.edges)
        assert {step.name for step in graph.steps} == truth.alive
        assert graph.left_out.keys() == truth.nodes.keys() - truth.alive
        assert {name: made.life for name, made in graph.resources.items()} == {
            name: truth.life(name) for name in truth.resources()
        }
        for step in graph.steps:
            touched = truth.touches(step.name)
            assert list(step.reads) == [resource for resource, _, writes in touched if not writes]
            assert list(step.writes) == [resource for resource, _, writes in touched if writes]
        there = {name: truth.value(name) for name in made.outputs}
        wanted = {name: truth.resource(value) for name, value in there.items() if value is not None}
        assert graph.outputs == {name: root for name, root in wanted.items() if root in graph.resources}
        assert {*graph.missing} == {*made.outputs} - graph.outputs.keys()


@edges
@enabling
def test_edges_passes_and_resources_are_those_that_brute_force_finds():
    check_connections(range(150))


@edges
@pytest.mark.long
def test_edges_passes_and_resources_are_those_that_brute_force_finds_in_many_frames():
    check_connections(range(10_000))


@edges
def test_every_name_leads_to_its_memory():
    for _, truth, graph in random_frames(range(60)):
        for name in truth.alive:
            for access in (*truth.nodes[name].reads, *truth.nodes[name].writes):
                value = truth.value(access.resource)
                assert graph.names[access.resource] == truth.resource(value)


# --- the four types ---------------------------------------------------------------------------------------------------


@types
def test_an_attachment_a_texture_and_a_buffer_give_a_target_a_barrier_and_an_edge():
    """Of what a pass reads, the texture and the buffer make it wait, and nothing but what it draws to is a target."""
    lists = Node("lists", (), (Access("list", "storage", bytes=64), Access("image", "storage", "r32f")))
    draw = Node(
        "draw",
        (Access("list", "indirect"), Access("image", "sampled")),
        (Access("color", "color", "rgba8", clear=(0.0, 0.0, 0.0, 1.0)), Access("depth", "depth", "d32f")),
    )
    graph = compiled(draw, lists, outputs=["color"])
    assert {name: made.kind for name, made in graph.resources.items()} == {
        "list": "buffer",
        "image": "texture",
        "color": "attachment",
        "depth": "attachment",
    }
    first, second = graph.steps
    assert (first.name, first.colors, first.depth) == ("lists", (), None)
    assert [target.resource for target in second.colors] == ["color"]
    assert second.depth is not None and second.depth.resource == "depth"
    waited = {barrier.resource: (barrier.before, barrier.after) for barrier in second.barriers}
    assert waited.keys() == {"list", "image", "color", "depth"}
    assert waited["list"][1] == Touch("", frozenset({"indirect"}), frozenset({"indirect"}))
    assert waited["image"][1] == Touch("read", frozenset({"fragment"}), frozenset({"sampled"}))
    assert {(edge.before, edge.after, edge.name) for edge in graph.edges} == {
        ("lists", "draw", "list"),
        ("lists", "draw", "image"),
    }


@types
def test_a_reference_is_an_edge_and_no_image():
    """Drawing on top is another name, behind everybody who read the old one, and the same memory."""
    lit = drawing("light", "lit", clear=(0.0,) * 4)
    blur = drawing("blur", "blurred", "lit")
    glass = Node("glass", (), (Access("lit_glass", "color", of="lit"),))
    final = drawing("final", "picture", "lit_glass", "blurred")
    graph = compiled(final, glass, blur, lit, outputs=["picture"])
    assert set(graph.resources) == {"lit", "blurred", "picture"}
    assert graph.resources["lit"].names == ("lit", "lit_glass")
    assert graph.names["lit_glass"] == graph.names["lit"] == "lit"
    assert {(edge.before, edge.after, edge.why) for edge in graph.edges} == {
        ("light", "blur", "reads"),
        ("light", "glass", "reads"),
        ("blur", "glass", "replaces"),
        ("glass", "final", "reads"),
        ("blur", "final", "reads"),
    }
    assert [step.name for step in graph.steps] == ["light", "blur", "glass", "final"]


@externals
def test_what_comes_from_outside_needs_no_writer_and_is_nobody_s_memory():
    sky = External("rgba16f", (16, 16), READY)
    graph = compiled(drawing("draw", "color", "sky"), outputs=["color"], externals={"sky": sky})
    assert graph.resources["sky"].life == "external"
    assert "sky" not in graph.memory.places and "sky" not in graph.memory.lives
    with pytest.raises(GraphError, match="'draw' reads 'sky', which no pass writes"):
        compiled(drawing("draw", "color", "sky"), outputs=["color"])


@externals
def test_who_writes_to_the_outside_is_part_of_the_frame():
    """By the external's own name, as its continuation, and behind another pass that does."""
    target = {"screen": External("rgba8", (64, 32), Touch("color", frozenset(), frozenset()))}
    assert [step.name for step in compiled(drawing("draw", "screen"), externals=target).steps] == ["draw"]
    first = Node("first", (), (Access("once", "color", of="screen"),))
    second = Node("second", (), (Access("twice", "color", of="once"),))
    graph = compiled(second, first, externals=target)
    assert [step.name for step in graph.steps] == ["first", "second"]
    assert graph.left_out == {}


# --- passes that fall out ---------------------------------------------------------------------------------------------


@enabling
def test_a_history_keeps_its_writer_though_it_makes_no_edge():
    taa = Node(
        "taa",
        (Access("lit", "sampled"), Access("resolved", "sampled", previous=True)),
        (Access("resolved", "color", "rgba16f"),),
    )
    moments = Node("moments", (Access("lit", "sampled"),), (Access("mean", "storage", "r32f"),))
    light = Node("light", (Access("mean", "sampled", previous=True),), (Access("lit", "color", "rgba16f"),))
    graph = compiled(taa, moments, light, outputs=["resolved"])
    assert {step.name for step in graph.steps} == {"taa", "moments", "light"}
    assert {(edge.before, edge.after) for edge in graph.edges} == {("light", "taa"), ("light", "moments")}
    assert {graph.resources[name].life for name in ("resolved", "mean")} == {"history"}
    assert dict(zip([step.name for step in graph.steps], graph.steps, strict=True))["taa"].reads == (
        "lit",
        "resolved" + PREVIOUS,
    )
    assert compiled(taa, moments, light).steps == (), "what only feeds itself is for nobody"


@enabling
def test_a_pass_that_is_left_out_takes_along_what_only_it_needed():
    chain = [
        drawing("draw", "color"),
        Node("blur", (Access("color", "sampled"),), (Access("blurred", "color", "rgba8"),)),
        Node(
            "focus",
            (Access("color", "sampled"), Access("blurred", "sampled")),
            (Access("sharp", "color", "rgba8", instead="color"),),
        ),
        drawing("final", "picture", "sharp"),
    ]
    whole = compiled(*chain, outputs=["picture"])
    assert [step.name for step in whole.steps] == ["draw", "blur", "focus", "final"]
    chain[2] = Node(chain[2].name, chain[2].reads, chain[2].writes, "the lens has no depth of field")
    rest = compiled(*chain, outputs=["picture"])
    assert [(step.name, step.reads) for step in rest.steps] == [("draw", ()), ("final", ("color",))]
    assert set(rest.resources) == {"color", "picture"}
    assert rest.left_out.keys() == {"blur", "focus"}
    assert rest.left_out["focus"] == "the lens has no depth of field"
    assert rest.names["sharp"] == "color"


@enabling
def test_a_replacement_that_no_pass_writes_is_named_though_no_pass_reads_it():
    left_out = Node("focus", (), (Access("sharp", "color", "rgba8", instead="colour"),), "no lens")
    with pytest.raises(GraphError, match=r"^A reader of 'sharp' reads 'colour', which no pass writes"):
        compiled(drawing("draw", "picture"), left_out, outputs=["picture"])


@enabling
def test_who_draws_on_top_of_a_pass_that_is_left_out_draws_on_what_was_below():
    sky = Node("sky", (), (Access("with_sky", "color", of="lit"),), "no sky")
    glass = Node("glass", (), (Access("with_glass", "color", of="with_sky"),))
    final = drawing("final", "picture", "with_glass")
    graph = compiled(drawing("light", "lit"), sky, glass, final, outputs=["picture"])
    assert [(step.name, step.writes) for step in graph.steps][1] == ("glass", ("lit",))
    assert graph.names["with_sky"] == graph.names["with_glass"] == "lit"


@enabling
def test_an_output_that_nobody_writes_is_missing_and_a_reader_without_a_writer_is_reported():
    left_out = drawing("focus", "sharp", why_not="switched off")
    graph = compiled(drawing("draw", "color"), left_out, outputs={"picture": "color", "focus": "sharp"})
    assert graph.missing == ("focus",)
    assert graph.outputs == {"picture": "color"}
    with pytest.raises(GraphError, match=r"'final' .*'sharp'.*'focus'.*switched off"):
        compiled(left_out, drawing("final", "picture", "sharp"), outputs=["picture"])


# --- what is refused --------------------------------------------------------------------------------------------------

COLOR = Access("color", "color", "rgba8")
REFUSED = {
    "unknown": ([drawing("draw", "color", "shado")], {"shado", "draw"}),
    "two writers": ([drawing("one", "color"), drawing("two", "color")], {"one", "two", "color"}),
    "two of one name": ([drawing("draw", "color"), drawing("draw", "other")], {"draw"}),
    "two continuations": (
        [
            drawing("draw", "base"),
            Node("one", (), (Access("first", "color", of="base"),)),
            Node("two", (Access("first", "sampled"),), (Access("color", "color", of="base"),)),
        ],
        {"one", "two", "base"},
    ),
    "self": ([Node("draw", (Access("color", "sampled"),), (COLOR,))], {"draw", "color"}),
    "on itself": ([Node("draw", (), (Access("color", "color", of="color"),))], {"draw", "color"}),
    "circle": (
        [drawing("one", "a", "b"), drawing("two", "b", "a"), drawing("draw", "color", "a")],
        {"one", "two"},
    ),
    "circle of a reader that comes too late": (
        [
            drawing("base", "a"),
            Node("over", (), (Access("b", "color", of="a"),)),
            drawing("draw", "color", "a", "b"),
        ],
        {"over", "draw"},
    ),
    "format": ([Node("draw", (), (Access("color", "color"),))], {"color"}),
    "size": ([Node("draw", (), (Access("color", "color", "rgba8", size=(0, 4)),))], {"color"}),
    "sizes": (
        [Node("draw", (), (COLOR, Access("depth", "depth", "d32f", scale=0.5)))],
        {"draw", "color", "depth"},
    ),
    "two layouts": (
        [
            Node("make", (), (Access("image", "storage", "r32f"),)),
            Node("draw", (Access("image", "sampled"), Access("image", "storage")), (COLOR,)),
        ],
        {"draw", "image"},
    ),
    "an image as constants": (
        [drawing("make", "image"), Node("draw", (Access("image", "uniform"),), (COLOR,))],
        {"draw", "image"},
    ),
    "the history of what is written over": (
        [
            drawing("make", "image"),
            Node("over", (), (Access("later", "color", of="image"),)),
            Node("draw", (Access("image", "sampled", previous=True), Access("later", "sampled")), (COLOR,)),
        ],
        {"draw", "over", "image"},
    ),
    "stand-ins in a circle": (
        [
            Node("one", (), (Access("a", "color", "rgba8", instead="b"),), "off"),
            Node("two", (), (Access("b", "color", "rgba8", instead="a"),), "off"),
            drawing("draw", "color", "a"),
        ],
        {"a", "b"},
    ),
}


@types
@pytest.mark.feature("frame-graph/render-targets")
@edges
@pytest.mark.parametrize("name", REFUSED)
def test_a_graph_that_cannot_be_is_refused_in_one_sentence_with_the_names(name):
    nodes, blamed = REFUSED[name]
    for order in (nodes, nodes[::-1]):
        with pytest.raises(GraphError) as caught:
            compiled(*order, outputs=["color"])
        text = str(caught.value)
        assert all(f"'{word}'" in text for word in blamed), text
        assert text[-1] in ".?" and not re.search(r"[.?!] ", text), text


@sorting
def test_a_circle_is_shown_as_a_path_of_passes_that_wait_for_each_other():
    """Random frames in which one pass is made to read what comes out far behind it."""
    found = 0
    for seed in range(120):
        random = np.random.default_rng(seed)
        made = random_graph(seed, words, why_not=0.0)
        truth = Truth(made.nodes, made.outputs, made.externals)
        after = {(before, later) for before, later, why in truth.edges if why == "reads"}
        if not after:
            continue
        before, later = sorted(after)[int(random.integers(len(after)))]
        back = Access(f"{later}.back", "storage", bytes=16)
        extra = {before: ((Access(back.resource, "storage"),), ()), later: ((), (back,))}
        nodes = [
            Node(
                node.name,
                node.reads + extra.get(node.name, ((), ()))[0],
                node.writes + extra.get(node.name, ((), ()))[1],
            )
            for node in made.nodes
        ]
        with pytest.raises(GraphError) as caught:
            compile_graph(nodes, made.size, made.outputs, made.externals)
        circle = [word for word in re.findall(r"'([\w.]+)'", str(caught.value)) if word in truth.nodes]
        assert circle[0] == circle[-1] and len(circle) > 2
        waits = {(before, later) for before, later, _ in Truth(nodes, made.outputs, made.externals).edges}
        assert all(pair in waits for pair in pairwise(circle)), (seed, str(caught.value))
        found += 1
    assert found > 60
