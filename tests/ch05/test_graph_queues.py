"""A frame on several queues: a simulated device finds nothing wrong with what is submitted, and misses all of it."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import pytest

from backends.contract import Access
from chapters.ch04.graph import types as before_words
from chapters.ch04.graph.frame_graph import compile_graph as compile_before
from chapters.ch05.graph import types as words
from chapters.ch05.graph.frame_graph import compile_graph
from chapters.ch05.graph.types import External, GraphError, Node, Touch
from tests.support.graph_truths import Truth
from tests.support.queue_truths import QUEUES, Submissions, hazards_of, on_queues, pieces
from tests.support.random_graphs import random_graph
from tools.frames.report import record

queues = pytest.mark.feature("async-compute/queue")
guard = pytest.mark.feature("async-compute/vertex-hazard-guard")
SIZE = (64, 32)


def made_of(seed, count=None):
    """A random frame with work for two queues, what it means, and what it compiles to."""
    made = random_graph(seed, words, count=count)
    made.nodes = on_queues(made.nodes, seed)
    truth = Truth(made.nodes, made.outputs, made.externals, made.keep)
    return made, truth, made.compile(compile_graph, queues=QUEUES)


SCHEDULES = tuple(product((2, 3), (False, True)))
"""Frames in flight, and whether both queues are one in truth."""


def check_frames(seeds, removing=False, every=False, **more):
    """Hold that frames have no hazard in one of some schedules, or in `every` one, and that each of their pieces is
    missed; return how many there were of each kind."""
    missed: dict[str, int] = {}
    for seed in seeds:
        _, truth, graph = made_of(seed, **more)
        for slots, together in SCHEDULES if every else [SCHEDULES[seed % len(SCHEDULES)]]:
            found = hazards_of(Submissions(truth, graph, slots=slots), seed, together=together)
            assert not found, f"{seed}: {found[:3]}"
        for piece in pieces(graph) if removing else ():
            left = Submissions(truth, graph, piece, slots=3)
            vain = not any(hazards_of(left, lot, stop=True) for lot in range(3))
            assert not vain, f"{seed}: nobody misses {piece}"
            missed[piece[0]] = missed.get(piece[0], 0) + 1
    return missed


@queues
@pytest.mark.feature("timeline/gpu-submit")
@pytest.mark.parametrize("part", range(4))
def test_no_schedule_of_random_frames_has_a_hazard_nor_stands_still(part):
    check_frames(range(25 * part, 25 * (part + 1)))


@queues
def test_each_wait_barrier_and_half_of_a_hand_over_is_missed():
    missed = check_frames(range(500, 516), removing=True)
    assert min(missed.values()) > 3 and missed.keys() == {"step", "releases", "wait", "prologue", "epilogue"}


@queues
@pytest.mark.feature("timeline/gpu-submit")
@pytest.mark.long
@pytest.mark.parametrize("part", range(20))
def test_no_schedule_of_10_000_random_frames_has_a_hazard_and_nothing_of_them_is_in_vain(part):
    check_frames(range(500 * part, 500 * (part + 1)), removing=True, every=True)


@queues
@pytest.mark.long
def test_no_schedule_of_large_frames_has_a_hazard():
    check_frames(range(20), count=60)


# --- the same frame ---------------------------------------------------------------------------------------------------


def plain(recorded):
    """A frame's record without the words that are new with several queues, and without that of 3D images at 0."""
    left = {"queue", "releases", "hand_over", "batches"}

    def strip(value):
        if isinstance(value, dict):
            kept = {key: one for key, one in value.items() if key not in left and (key, one) != ("slices", 0)}
            return {key: strip(one) for key, one in kept.items()}
        return [strip(one) for one in value] if isinstance(value, list) else value

    return strip(recorded)


@queues
def test_with_one_queue_a_frame_is_that_of_the_chapter_before_in_one_batch():
    for seed in range(40):
        made = random_graph(seed, before_words)
        now = random_graph(seed, words)
        now.nodes = on_queues(now.nodes, seed)
        graph = now.compile(compile_graph)
        assert plain(record(graph)) == record(made.compile(compile_before))
        (batch,) = graph.batches
        assert (batch.queue, batch.steps, batch.waits) == ("graphics", tuple(range(len(graph.steps))), ())


@queues
def test_nobody_who_asks_for_graphics_gets_another_frame_since_there_are_more_queues():
    for seed in range(20):
        made = random_graph(seed, words)
        assert made.compile(compile_graph, queues=QUEUES) == made.compile(compile_graph)


@queues
def test_what_is_submitted_is_every_step_once_in_an_order_that_all_edges_allow():
    for seed in range(100):
        _, truth, graph = made_of(seed)
        submitted = [step for batch in graph.batches for step in batch.steps]
        assert sorted(submitted) == list(range(len(graph.steps)))
        place = {graph.steps[step].name: number for number, step in enumerate(submitted)}
        for before, after, _ in truth.edges:
            assert place[before] < place[after]
        for number, batch in enumerate(graph.batches):
            assert {graph.steps[step].queue for step in batch.steps} <= {batch.queue}
            assert all(wait.batch < number or wait.before for wait in batch.waits)
            assert all(graph.batches[wait.batch].queue != batch.queue for wait in batch.waits)


@queues
@pytest.mark.feature("frame-graph/resource-aliasing")
def test_sharing_memory_adds_no_wait_between_queues():
    shared = 0
    for seed in range(60):
        made, _, graph = made_of(seed)
        alone = made.compile(compile_graph, queues=QUEUES, alias=False)
        for one, other in zip(graph.batches, alone.batches, strict=True):
            assert (one.queue, one.steps) == (other.queue, other.steps)
            assert [(wait.batch, wait.before) for wait in one.waits] == [
                (wait.batch, wait.before) for wait in other.waits
            ]
        shared += graph.memory.size < graph.memory.alone and len(graph.batches) > 1
    assert shared > 8


@queues
def test_the_order_of_declaration_makes_no_difference():
    for seed in range(20):
        made, _, graph = made_of(seed)
        made.nodes = made.nodes[::-1]
        assert made.compile(compile_graph, queues=QUEUES) == graph


# --- by hand ----------------------------------------------------------------------------------------------------------


def compiled(nodes, outputs, externals=None):
    graph = compile_graph(nodes, SIZE, outputs, externals, queues=QUEUES)
    truth = Truth(nodes, outputs, externals)
    for lot in range(4):
        assert not hazards_of(Submissions(truth, graph, slots=2 + lot % 2), lot)
    return graph, truth


def submitted(graph):
    """Each batch: its queue, its passes, and those of the batches that it waits for."""
    names = [[graph.steps[step].name for step in batch.steps] for batch in graph.batches]
    return [
        (
            batch.queue[0],
            mine,
            [("before ",)[: wait.before] + tuple(names[wait.batch]) for wait in batch.waits],
        )
        for batch, mine in zip(graph.batches, names, strict=True)
    ]


def draws(name, *reads, format="rgba8", stages=()):
    return Node(
        name,
        tuple(Access(one, "sampled", stages=stages) for one in reads),
        (Access(f"{name}d", "color", format),),
    )


def computes(name, *reads, format="rgba8"):
    made = tuple(Access(one, "sampled") for one in reads)
    return Node(name, made, (Access(f"{name}d", "storage", format),), queue="compute")


@queues
def test_work_that_only_the_last_pass_needs_runs_beside_the_others():
    nodes = [draws("a"), draws("b", "ad"), computes("fog"), draws("tone", "bd", "fogd")]
    graph, _ = compiled(nodes, ["toned"])
    assert submitted(graph) == [
        ("c", ["fog"], [("before ", "tone")]),
        ("g", ["a", "b"], []),
        ("g", ["tone"], [("fog",)]),
    ]


@queues
def test_who_needs_no_other_queue_is_drawn_while_it_works():
    """`gbuffer` goes first, since `occlusion` waits for it; `shadow` is drawn meanwhile, although its name is last."""
    nodes = [draws("zshadow"), draws("gbuffer"), computes("occlusion", "gbufferd")]
    nodes.append(draws("light", "gbufferd", "zshadowd", "occlusiond"))
    graph, _ = compiled(nodes, ["lightd"])
    assert submitted(graph) == [
        ("g", ["gbuffer"], []),
        ("c", ["occlusion"], [("gbuffer",)]),
        ("g", ["zshadow"], []),
        ("g", ["light"], [("occlusion",)]),
    ]
    light = graph.batches[-1].waits[0]
    assert light.stages == {"fragment"}


@queues
def test_a_pass_that_needs_no_wait_is_drawn_before_one_that_waits_for_the_first_of_all():
    """`fog` is placed first of all. `haze` has to wait for it, and `zshadow` has not, although its name is last."""
    nodes = [computes("fog"), draws("sky"), draws("haze", "fogd"), draws("zshadow", "skyd")]
    nodes.append(draws("tone", "hazed", "zshadowd"))
    graph, _ = compiled(nodes, ["toned"])
    assert submitted(graph) == [
        ("c", ["fog"], [("before ", "haze")]),
        ("g", ["sky", "zshadow"], []),
        ("g", ["haze"], [("fog",)]),
        ("g", ["tone"], []),
    ]


@queues
def test_an_image_goes_from_queue_to_queue_in_two_halves_that_say_the_same():
    nodes = [draws("a"), computes("blur", "ad"), draws("b", "ad", "blurd")]
    graph, _ = compiled(nodes, ["bd"])
    halves = {
        (one.resource, *one.hand_over): one for step in graph.steps for one in step.barriers if one.hand_over
    }
    assert halves.keys() == {
        ("ad", "graphics", "compute"),
        ("ad", "compute", "graphics"),  # for who reads there as well: an image has one owner
        ("blurd", "compute", "graphics"),
    }
    released = [one for step in graph.steps for one in step.releases]
    assert sorted(map(repr, released)) == sorted(map(repr, halves.values()))


@queues
def test_buffers_belong_to_both_queues():
    count = Node("count", (), (Access("sums", "storage", bytes=64),), queue="compute")
    draw = Node("draw", (Access("sums", "storage"),), (Access("picture", "color", "rgba8"),))
    graph, _ = compiled([count, draw], ["picture"])
    assert not any(step.releases or any(one.hand_over for one in step.barriers) for step in graph.steps)
    assert not any(one.resource == "sums" for step in graph.steps for one in step.barriers), (
        "waiting is enough"
    )


@queues
def test_a_history_is_handed_over_in_the_frame_before_and_once_before_the_first():
    nodes = [
        Node(
            "taa",
            (Access("h", "sampled", previous=True),),
            (Access("h", "storage", "rgba8"),),
            queue="compute",
        ),
        draws("show", "h"),
    ]
    graph, _ = compiled(nodes, ["showd"])
    (back,) = [one for one in graph.steps[1].releases if one.resource == "h"]
    (taken,) = [one for one in graph.steps[0].barriers if one.resource == "h@previous"]
    assert back == replace(taken, resource="h") and taken.hand_over == ("graphics", "compute")
    assert [(one.after.layout, one.hand_over) for one in graph.prologue] == [
        ("read", None),
        ("read", ("graphics", "compute")),
    ]


@queues
def test_what_an_owner_still_writes_is_waited_for_through_an_empty_batch():
    """His work is on the graphics queue, in front of everything that the frame submits there."""
    touch = Touch("copy_target", frozenset({"copy"}), frozenset({"copy_write"}), writes=True)
    externals = {"map": External("rgba8", SIZE, touch, None)}
    graph, _ = compiled([computes("mips", "map"), draws("show", "mipsd")], ["showd"], externals)
    first, *_ = graph.batches
    assert (first.queue, first.steps) == ("graphics", ())
    assert (graph.batches[1].queue, [wait.batch for wait in graph.batches[1].waits]) == ("compute", [0])


# --- vertices that compute writes and graphics reads ------------------------------------------------------------------

CLOTH = (Access("positions", "storage", bytes=4096),)
DRAWN = Node(
    "draw", (Access("positions", "storage", stages=("vertex",)),), (Access("picture", "color", "rgba8"),)
)
READY = Touch("", frozenset(), frozenset())


@guard
def test_one_buffer_of_vertices_is_not_written_while_the_frame_before_reads_it():
    nodes = [Node("cloth", (), CLOTH, queue="compute"), DRAWN]
    graph, truth = compiled(nodes, ["picture"])
    assert submitted(graph) == [("c", ["cloth"], [("before ", "draw")]), ("g", ["draw"], [("cloth",)])]
    without = Submissions(truth, graph, skip=("wait", 0, 0), slots=2)
    found = [text for lot in range(5) for text in hazards_of(without, lot)]
    assert any(
        "'positions' (storage_write in compute) is not ordered behind storage_read of draw" in one
        for one in found
    )


@guard
@pytest.mark.parametrize("slots", [2, 3])
def test_vertices_of_each_slot_are_guarded_by_the_cpu_and_by_nothing_else(slots):
    """Frame n waits on the CPU for all queues' values of frame n - slots: then nobody uses its buffers any more."""
    cloth = Node("cloth", (), (Access("positions", "storage", bytes=4096),), queue="compute")
    externals = {"positions": External(None, None, READY, None, 4096)}
    graph = compile_graph([cloth, DRAWN], SIZE, ["picture"], externals, queues=QUEUES)
    assert submitted(graph) == [("c", ["cloth"], []), ("g", ["draw"], [("cloth",)])]
    truth = Truth([cloth, DRAWN], ["picture"], externals)
    for lot in range(10):
        made = Submissions(truth, graph, slots=slots, slotted=["positions"])
        assert not hazards_of(made, lot, frames=6)
    # One buffer fewer than frames in flight: the schedule without the guard.
    found = []
    for lot in range(10):
        made = Submissions(truth, graph, slots=slots, slotted=["positions"], copies=slots - 1)
        found += hazards_of(made, lot, frames=6)
    assert any("is not ordered behind storage_read of draw in vertex" in text for text in found)


# --- who asks for what cannot be --------------------------------------------------------------------------------------


@queues
@pytest.mark.parametrize(
    ("node", "text"),
    [
        (replace(draws("a"), queue="compute"), "'a' draws, and asks for the queue 'compute': only what"),
        (replace(computes("a"), queue="compte"), "'a' asks for the queue 'compte', which is none"),
        (replace(computes("a"), queue="transfer"), "there are graphics and compute."),
    ],
)
def test_a_queue_that_cannot_be_is_one_sentence(node, text):
    for there in (QUEUES, ("graphics",)):
        with pytest.raises(GraphError) as caught:
            compile_graph([node], SIZE, ["ad"], queues=there)
        assert text in str(caught.value) and str(caught.value).endswith((".", "?"))


def test_the_kind_of_a_pass_follows_from_all_of_its_accesses():
    image, numbers = Access("image", "sampled"), Access("numbers", "storage", bytes=4)
    assert Node("draw", (image,), (Access("color", "color"),)).kind == "graphics"
    assert Node("kernel", (image,), (numbers,)).kind == "compute"
    assert Node("copy", (Access("image", "copy"),)).kind == "copy", (
        "to a window, nothing is written in the graph"
    )
    assert (
        Node("copy", (Access("image", "copy"), image), (Access("there", "copy", bytes=4),)).kind == "compute"
    )
