"""Barriers: a simulated GPU finds none missing, and misses each one that is taken away."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest

from backends.contract import Access
from chapters.ch04.frames.frame import OUTPUTS
from chapters.ch04.graph import plan as frame_plan
from chapters.ch04.graph import types as words
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.sync import states
from chapters.ch04.graph.types import External, GraphError, Node, Touch
from chapters.ch04.settings import Settings
from common.scene import Material
from tests.support.graph_truths import Truth, events_of, places_of
from tests.support.hazards import find_hazards, is_safe
from tests.support.random_graphs import random_graph
from tests.support.scenes import quad_scene, translated

barriers = pytest.mark.feature("frame-graph/barriers")


def numbered(graph):
    """Every barrier of a compiled frame, as `events_of` names the one to leave out."""
    parts = {"prologue": graph.prologue, "epilogue": graph.epilogue}
    parts |= {number: step.barriers for number, step in enumerate(graph.steps)}
    return [(part, number) for part, listed in parts.items() for number in range(len(listed))]


def check_barriers(truth, graph, removing):
    """Hold that none is missing and, if `removing`, that none is there in vain; return how many were removed."""
    places = places_of(graph)
    found = find_hazards(events_of(truth, graph), places)
    assert not found, "\n".join(map(str, found))
    if not removing:
        return 0
    removed = numbered(graph)
    vain = [one for one in removed if is_safe(events_of(truth, graph, skip=one), places)]
    assert not vain, f"nobody misses these barriers: {vain}"
    return len(removed)


def check_random(seeds, removing, **more):
    count = 0
    for seed in seeds:
        made = random_graph(seed, words, **more)
        truth = Truth(made.nodes, made.outputs, made.externals, made.keep)
        count += check_barriers(truth, made.compile(compile_graph), removing)
    return count


@barriers
def test_no_barrier_is_missing_in_random_frames():
    check_random(range(100), removing=False)


@barriers
def test_none_is_missing_where_resources_keep_memory_of_their_own():
    for seed in range(30):
        made = random_graph(seed, words)
        truth = Truth(made.nodes, made.outputs, made.externals, made.keep)
        check_barriers(truth, made.compile(compile_graph, alias=False), removing=False)


@barriers
def test_each_barrier_of_random_frames_is_missed():
    assert check_random(range(120, 150), removing=True) > 250


@barriers
@pytest.mark.long
def test_no_barrier_is_missing_nor_in_vain_in_10_000_random_frames():
    check_random(range(10_000), removing=True)


@barriers
@pytest.mark.long
def test_no_barrier_is_missing_in_large_frames():
    check_random(range(20), removing=False, count=100)


@pytest.mark.core
@barriers
@pytest.mark.variants("vulkan")
@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_the_frames_of_the_chapter_miss_no_barrier_and_have_none_in_vain(chapter, graph, monkeypatch):
    """As the renderer compiles them for its device with all that it can hand on, and with each pass switched off."""
    compiled = []

    def watched(nodes, size, outputs=(), externals=None, requirements=None, alias=True, keep=(), **more):
        found = compile_graph(nodes, size, outputs, externals, requirements, alias, keep, **more)
        compiled.append((Truth(nodes, set(dict(outputs).values()), externals, keep), found))
        return found

    monkeypatch.setattr(frame_plan, "compile_graph", watched)
    glass = Material(base_color=(0.2, 0.6, 0.9, 0.5), alpha_mode="blend")
    scene = quad_scene(
        materials=(glass, Material()), instance_materials=(0, 1), matrices=(np.eye(4), translated(0, 0, 1))
    )
    settings = Settings(graph=graph, aperture=0.5)
    with chapter.open(scene, (32, 16), settings, outputs=set(OUTPUTS), presents=True) as renderer:
        plan = renderer._plan
        for name in plan.switches:
            plan.switch(name, False)
            with suppress(GraphError):  # somebody needs it
                plan.compile((32, 16), scene, settings)
            plan.switch(name, True)
    assert len(compiled) > 2, "no pass could be switched off"
    drawn, *switched = compiled
    assert check_barriers(*drawn, removing=True) > 10
    for one in switched:
        check_barriers(*one, removing=False)


# --- by hand ----------------------------------------------------------------------------------------------------------


def compiled(nodes, outputs=(), externals=None):
    graph = compile_graph(nodes, (64, 32), outputs, externals)
    check_barriers(Truth(nodes, outputs, externals), graph, removing=True)
    return graph


def between(graph, resource):
    """The layouts that an image goes through, step by step: (number of the step, before, after)."""
    return [
        (number, "undefined" if barrier.discard else barrier.before.layout, barrier.after.layout)
        for number, step in enumerate(graph.steps)
        for barrier in step.barriers
        if barrier.resource == resource
    ]


@barriers
def test_readers_in_a_row_share_one_barrier():
    """It is in front of the first and for the stages of all: nothing stands between one reader and the next."""
    nodes = [
        Node("draw", (), (Access("image", "color", "rgba8"),)),
        Node("a", (Access("image", "sampled"),), (Access("first", "storage", bytes=16),)),
        Node("b", (Access("image", "sampled", stages=("vertex",)),), (Access("second", "color", "rgba8"),)),
    ]
    graph = compiled(nodes, ["first", "second"])
    assert between(graph, "image") == [(0, "undefined", "color"), (1, "color", "read")]
    (barrier,) = [barrier for barrier in graph.steps[1].barriers if barrier.resource == "image"]
    assert barrier.after.stages == {"compute", "vertex"}


@barriers
def test_a_target_that_is_sampled_and_drawn_to_again_goes_back():
    """What the book's frame graph forgets: it gives up the old content, or leaves the layout as it is."""
    nodes = [
        Node("draw", (), (Access("lit", "color", "rgba16f", clear=(0.0,) * 4),)),
        Node("measure", (Access("lit", "sampled"),), (Access("mean", "storage", bytes=4),)),
        Node("glass", (Access("mean", "storage"),), (Access("lit_glass", "color", of="lit"),)),
    ]
    graph = compiled(nodes, ["lit_glass"])
    assert between(graph, "lit") == [(0, "undefined", "color"), (1, "color", "read"), (2, "read", "color")]


@barriers
def test_a_history_is_found_as_the_frame_before_left_it():
    taa = Node(
        "taa",
        (Access("lit", "sampled"), Access("resolved", "sampled", previous=True)),
        (Access("resolved", "color", "rgba16f"),),
    )
    light = Node("light", (), (Access("lit", "color", "rgba16f"),))
    tone = Node("tone", (Access("resolved", "sampled"),), (Access("picture", "color", "rgba8"),))
    graph = compiled([tone, taa, light], ["picture"])
    assert between(graph, "resolved") == [(1, "undefined", "color"), (2, "color", "read")]
    assert between(graph, "resolved@previous") == [], "it was sampled before, and is still"
    assert [(one.resource, one.after.layout) for one in graph.prologue] == [("resolved@previous", "read")]


@barriers
def test_memory_waits_for_whoever_used_it_last_the_frame_before_included():
    nodes = [Node("pass0", (), (Access("image0", "color", "rgba8"),))]
    for number in range(1, 5):
        read = Access(f"image{number - 1}", "sampled")
        nodes.append(Node(f"pass{number}", (read,), (Access(f"image{number}", "color", "rgba8"),)))
    graph = compiled(nodes, ["image4"])
    assert graph.memory.size < graph.memory.alone
    taken = {
        barrier.resource: barrier.instead_of
        for step in graph.steps
        for barrier in step.barriers
        if barrier.discard
    }
    assert taken["image2"] == ("image0",) and taken["image3"] == ("image1",)
    assert taken["image0"] == ("image2",) and taken["image1"] == ("image3",)


@barriers
def test_an_external_is_taken_as_it_comes_and_left_as_it_is_wanted():
    screen = External(
        "rgba8",
        (64, 32),
        Touch("undefined", frozenset(), frozenset()),
        Touch("copy_source", frozenset({"copy"}), frozenset({"copy_read"})),
    )
    counts = External(
        None,
        None,
        Touch("", frozenset(), frozenset()),
        Touch("", frozenset({"host"}), frozenset({"host_read"})),
        64,
    )
    nodes = [
        Node("draw", (), (Access("screen", "color"), Access("counted", "storage", of="counts", bytes=64)))
    ]
    graph = compiled(nodes, externals={"screen": screen, "counts": counts})
    assert between(graph, "screen") == [(0, "undefined", "color")]
    handed = {barrier.resource: barrier.after for barrier in graph.epilogue}
    assert handed == {"screen": screen.leaves, "counts": counts.leaves}
    assert graph.prologue == (), "what is somebody else's is in nobody's steady state"


@barriers
def test_an_external_that_others_could_read_is_made_visible_to_a_new_stage():
    constants = External(None, None, Touch("", frozenset({"vertex"}), frozenset({"uniform"})), None, 64)
    nodes = [Node("cull", (Access("constants", "uniform"),), (Access("list", "storage", bytes=64),))]
    graph = compiled(nodes, ["list"], {"constants": constants})
    assert [
        barrier.after.stages for barrier in graph.steps[0].barriers if barrier.resource == "constants"
    ] == [{"compute"}]


@barriers
def test_a_write_behind_a_read_sees_what_was_there():
    """Written in a compute shader, read in a vertex shader, written on in a compute shader: the barrier in front of the
    last does not only wait, for nothing had made the first visible to it, whoever else waits for the vertex shader."""
    nodes = [
        Node("make", (), (Access("list", "storage", bytes=64), Access("image", "storage", "r32f"))),
        Node(
            "draw",
            (Access("list", "storage", stages=("vertex",)), Access("image", "storage", stages=("vertex",))),
            (Access("picture", "color", "rgba8"),),
        ),
        Node("more", (Access("image", "sampled"),), (Access("longer", "storage", of="list", bytes=64),)),
    ]
    graph = compiled(nodes, ["picture", "longer"])
    assert "list" in [barrier.resource for barrier in graph.steps[2].barriers]


@barriers
def test_a_wait_that_others_imply_is_left_out():
    """A buffer that was read is written again; the barrier of an image on the way waits for the same stages."""
    nodes = [
        Node("count", (), (Access("counts", "storage", bytes=64), Access("image", "storage", "r32f"))),
        Node(
            "show",
            (Access("counts", "storage"), Access("image", "sampled")),
            (Access("shown", "storage", "r32f"),),
        ),
    ]
    graph = compiled(nodes, ["shown"])
    assert [one.resource for one in graph.steps[0].barriers] != []
    assert sum(barrier.resource == "counts" for step in graph.steps for barrier in step.barriers) == 1


@pytest.mark.parametrize(
    ("access", "kind", "writes", "says"),
    [
        (Access("x", "color", "rgba8"), "compute", True, "a pass that is compute writes nothing as 'color'"),
        (Access("x", "depth", "d32f"), "compute", False, "a pass that is compute reads nothing as 'depth'"),
        (
            Access("x", "sampled", "rgba8"),
            "graphics",
            True,
            "a pass that is graphics writes nothing as 'sampled'",
        ),
        (Access("x", "uniform"), "compute", True, "a pass that is compute writes nothing as 'uniform'"),
        (
            Access("x", "color", "rgba8"),
            "graphics",
            False,
            "a pass that is graphics reads nothing as 'color'",
        ),
    ],
)
def test_uses_that_cannot_be_are_refused(access, kind, writes, says):
    with pytest.raises(GraphError, match=says):
        states.touch_of(access, kind, writes)


@pytest.mark.parametrize(
    ("access", "kind", "writes"),
    [
        (Access("x", "color", "rgba8"), "graphics", True),
        (Access("x", "depth", "d32f"), "graphics", False),
        (Access("x", "sampled", "rgba8"), "compute", False),
        (Access("x", "storage", "rgba8"), "compute", True),
    ],
)
def test_uses_that_can_be_have_stages(access, kind, writes):
    touch = states.touch_of(access, kind, writes)
    assert touch.stages and touch.writes == writes
