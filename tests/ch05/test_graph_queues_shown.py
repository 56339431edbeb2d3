"""What a graph with several queues looks like, and how a file asks for one: lanes, waits, and what can overlap."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from xml.etree import ElementTree

import pytest

from backends.contract import Access
from chapters.ch05.graph import types as words
from chapters.ch05.graph.checks import check_pass
from chapters.ch05.graph.file import read_graph
from chapters.ch05.graph.frame_graph import compile_graph
from chapters.ch05.graph.types import GraphError, Node
from tests.ch04.test_graph_checks import pass_of
from tests.support.queue_truths import QUEUES, on_queues
from tests.support.random_graphs import random_graph
from tests.support.timing import least_times, timed
from tools.frames import overlap
from tools.frames.overlap import overlaps
from tools.frames.report import record, text
from tools.frames.svg import svg

queues = pytest.mark.feature("async-compute/queue")
SVG = "{http://www.w3.org/2000/svg}"


def frame(there=QUEUES):
    """Cloth, whose vertices two passes draw; occlusion beside the shadows; fog that only the last pass needs."""
    vertices = Access("positions", "storage", stages=("vertex",))
    nodes = [
        Node("cloth", (), (Access("positions", "storage", bytes=4096),), queue="compute"),
        Node("gbuffer", (vertices,), (Access("normal", "color", "rgba8"),)),
        Node(
            "occlusion", (Access("normal", "sampled"),), (Access("ao", "storage", "r32f"),), queue="compute"
        ),
        Node("shadow", (vertices,), (Access("shadows", "depth", "d32f"),)),
        Node("fog", (), (Access("air", "storage", "rgba16f"),), queue="compute"),
        Node(
            "light",
            (Access("ao", "sampled"), Access("shadows", "sampled")),
            (Access("lit", "color", "rgba16f"),),
        ),
        Node(
            "tonemap",
            (Access("lit", "sampled"), Access("air", "sampled")),
            (Access("color", "color", "rgba8"),),
        ),
    ]
    return compile_graph(nodes, (64, 32), ["color"], queues=there)


# --- overlap ----------------------------------------------------------------------------------------------------------


def ordered_by_paths(graph, frames=3):
    """All pairs of (frame, step) of which the second begins behind the first, by walking every way of waits."""
    batches = list(product(range(frames), range(len(graph.batches))))
    begins = {}  # what is directly in front of each
    for frame, number in batches:
        batch = graph.batches[number]
        mine = {(frame - wait.before, wait.batch) for wait in batch.waits}
        mine |= {
            one for one in batches if one < (frame, number) and graph.batches[one[1]].queue == batch.queue
        }
        begins[frame, number] = {one for one in mine if one[0] >= 0}
    found = set()
    for one in batches:
        seen, stack = set(), [one]
        while stack:
            for other in begins[stack.pop()] - seen:
                seen.add(other)
                stack.append(other)
        found |= {(other, one) for other in seen}
    steps = {step: number for number, batch in enumerate(graph.batches) for step in batch.steps}
    return {
        ((f, a), (g, b))
        for f, g in product(range(frames), repeat=2)
        for a, b in product(steps, repeat=2)
        if ((f, steps[a]), (g, steps[b])) in found
    }


@queues
def test_steps_overlap_that_no_way_of_waits_orders():
    some = 0
    for seed in range(30):
        made = random_graph(seed, words)
        made.nodes = on_queues(made.nodes, seed)
        graph = made.compile(compile_graph, queues=QUEUES)
        ordered = ordered_by_paths(graph)
        for step, one in enumerate(overlaps(graph)):
            others = [n for n, other in enumerate(graph.steps) if other.queue != graph.steps[step].queue]
            free = [n for n in others if not {((2, n), (2, step)), ((2, step), (2, n))} & ordered]
            assert list(one.now) == free
            assert list(one.before) == [n for n in others if ((1, n), (2, step)) not in ordered]
            some += len(free)
    assert some > 50


@queues
def test_overlap_is_there_to_be_had_in_a_usual_frame():
    graph = frame()
    found = {
        graph.steps[number].name: {graph.steps[other].name for other in one.now}
        for number, one in enumerate(overlaps(graph))
    }
    assert "shadow" in found["occlusion"] and {"gbuffer", "shadow"} <= found["fog"]


# --- shown ------------------------------------------------------------------------------------------------------------


@queues
def test_the_text_has_batches_waits_hand_overs_and_what_runs_beside_what():
    graph = frame()
    lines = text(graph).splitlines()
    at = lines.index("batches, in the order in which they are submitted")
    assert len(lines[at + 1 : lines.index("", at)]) == len(graph.batches)
    number = next(i for i, step in enumerate(graph.steps, 1) if step.name == "occlusion")
    assert f" {number} occlusion (compute, 64x32), on the compute queue" in lines
    assert any(line.endswith("layout color -> read, from graphics to compute") for line in lines)
    assert "     releases ao, from compute to graphics" in lines
    beside = lines[lines.index("at the same time") + 1 :]
    assert any(f"{number} occlusion beside " in line for line in beside)


@queues
def test_the_record_has_batches_and_overlaps():
    graph = frame()
    read = json.loads(json.dumps(record(graph)))
    assert [batch["steps"] for batch in read["batches"]] == [list(batch.steps) for batch in graph.batches]
    assert [one["now"] for one in read["overlaps"]] == [list(one.now) for one in overlaps(graph)]
    assert "overlaps" not in record(frame(("graphics",)))


@queues
def test_the_drawing_has_a_lane_for_each_queue_and_a_line_for_each_wait():
    graph = frame()
    root = ElementTree.fromstring(svg(graph))
    titles = [one.findtext(f"{SVG}title") or "" for one in root.iter()]
    for number, batch in enumerate(graph.batches, 1):
        names = ", ".join(graph.steps[step].name for step in batch.steps)
        assert f"batch {number} on {batch.queue}: {names}" in titles
        for wait in batch.waits:
            assert (
                f"batch {number} waits for batch {wait.batch + 1}" + " of the frame before" * wait.before
                in titles
            )
    boxes = {
        one.findtext(f"{SVG}title"): [float(one.get(name)) for name in ("x", "y", "width", "height")]
        for one in root.iter(f"{SVG}rect")
        if (one.findtext(f"{SVG}title") or "").startswith("batch ")
    }
    columns = [one.get("cx") for one in root.iter(f"{SVG}circle")]
    for about, (
        x,
        y,
        wide,
        high,
    ) in boxes.items():  # each number is centred in its column, and stands in the box
        inside = {
            (one.text, one.get("x"), one.get("text-anchor"))
            for one in root.iter(f"{SVG}text")
            if x < float(one.get("x")) < x + wide and y < float(one.get("y")) < y + high
        }
        steps = graph.batches[int(about.split()[1]) - 1].steps
        assert inside == {(str(step + 1), columns[step], "middle") for step in steps}
    assert len({y for _, y, _, _ in boxes.values()}) == 2
    width, height = float(root.get("width")), float(root.get("height"))
    assert all(x >= 0 and x + wide <= width and y < height for x, y, wide, _ in boxes.values())


@queues
def test_with_one_batch_nothing_is_said_of_queues():
    graph = frame(("graphics",))
    assert "queue" not in text(graph) and "batch" not in text(graph) and "at the same time" not in text(graph)
    assert "batch" not in svg(graph)


# --- asked for --------------------------------------------------------------------------------------------------------


class Pass:
    """A pass as a file finds it."""

    def __init__(self, name, *writes, reads=(), **more):
        self.name, self.reads, self.writes, self.why_not, self.queue = name, reads, writes, "", "graphics"
        vars(self).update(more)


DECLARED = {
    "blur": Pass("blur", Access("blurred", "storage", "rgba8")),
    "cloth": Pass("cloth", Access("positions", "storage", bytes=64), queue="compute"),
    "draw": Pass("draw", Access("picture", "color", "rgba8")),
}


def nodes_of(tmp_path, entry):
    path = tmp_path / "graph.json"
    path.write_text('{"passes": [\n  ' + entry + "\n]}", encoding="utf-8")
    return read_graph(path).nodes(DECLARED, ("rgba8",))


@queues
@pytest.mark.parametrize(
    ("entry", "queue"),
    [
        ('{"pass": "blur"}', "graphics"),
        ('{"pass": "blur", "queue": "compute"}', "compute"),
        ('{"pass": "cloth"}', "compute"),
        ('{"pass": "cloth", "queue": "graphics"}', "graphics"),
        ('{"pass": "draw", "queue": "graphics"}', "graphics"),
    ],
)
def test_a_file_says_on_which_queue_a_pass_runs_or_leaves_it_to_the_pass(tmp_path, entry, queue):
    (node,) = nodes_of(tmp_path, entry)
    assert node.queue == queue


@queues
@pytest.mark.parametrize(
    ("value", "says"),
    [
        ('"compte"', "passes[0].queue is 'compte', which is no queue; did you mean 'compute'?"),
        ('"transfer"', "passes[0].queue is 'transfer', which is no queue; known are 'compute', 'graphics'."),
        ("3", "passes[0].queue must be a text, and is a number."),
        (
            '"compute"',
            "passes[0].queue is 'compute', and 'draw' draws: only what computes or copies can run there.",
        ),
    ],
)
def test_a_queue_that_cannot_be_is_refused_with_its_place(tmp_path, value, says):
    with pytest.raises(GraphError) as caught:
        nodes_of(tmp_path, '{"pass": "draw", "queue": ' + value + "}")
    assert "graph.json:2:29: " in str(caught.value)
    assert says in str(caught.value)


@queues
def test_a_pass_that_asks_for_a_queue_that_nobody_knows_is_refused():
    check_pass(pass_of(queue="compute"), ("rgba16f",))
    with pytest.raises(GraphError, match="'mine' asks for 'fast': its queue is graphics or compute"):
        check_pass(pass_of(queue="fast"), ("rgba16f",))


# --- time -------------------------------------------------------------------------------------------------------------


@pytest.mark.alone
@queues
@pytest.mark.parametrize(("count", "fewest"), [(20, 30), (300, 5)])
def test_a_second_queue_makes_compiling_little_longer(count, fewest):
    """tests/ch04 holds one queue to 2 ms for 20 passes and 150 ms for 1,000; two take 1.3 to 1.5 times that, on a quiet
    machine and on a busy one."""
    made = random_graph(4, words, count=count, why_not=0.0)
    made.requirements = None

    def compiling(share):
        nodes = replace(made, nodes=on_queues(made.nodes, 0, share))
        return timed(lambda: nodes.compile(compile_graph, queues=QUEUES))

    def holds(least):
        return least["two"] < 1.9 * least["one"]

    least = least_times({"one": compiling(0.0), "two": compiling(0.5)}, holds, fewest)
    assert holds(least), least


@pytest.mark.parametrize(
    ("steps", "shown"), [((), "-"), ((0,), "1"), ((0, 1, 2, 4), "1-3 5"), ((1, 3, 5), "2 4 6")]
)
def test_steps_side_by_side_are_shown_as_a_range(steps, shown):
    assert overlap._steps(steps) == shown
