"""The graph of tasks: its cycles are found and shown, and its drawing has every edge."""

from __future__ import annotations

import random
import re
from graphlib import CycleError
from itertools import pairwise

import pytest

from chapters.ch03.tasks.graph import TaskGraph
from chapters.ch03.tasks.scheduler import Scheduler

scheduler = pytest.mark.feature("tasks/scheduler")


def graph_of(edges, names):
    graph = TaskGraph("made")
    for name in names:
        graph.add(name, lambda: None, after=[a for a, b in edges if b == name])
    return graph


@scheduler
def test_a_cycle_is_shown_as_the_path_of_its_names():
    graph = graph_of(
        [("cull", "record"), ("record", "submit"), ("submit", "cull"), ("a", "cull")],
        ["a", "cull", "record", "submit"],
    )
    with pytest.raises(CycleError) as caught:
        graph.ordered()
    text, path = caught.value.args
    assert path[0] == path[-1] and set(path) == {"cull", "record", "submit"}
    assert text == "the graph 'made' has no beginning: each comes before the next in " + " -> ".join(path)
    with Scheduler(0) as tasks, pytest.raises(CycleError):
        tasks.run(graph)


@scheduler
def test_a_cycle_is_found_wherever_it_is_and_nowhere_else():
    for seed in range(300):
        rng = random.Random(seed)
        names = [f"t{i}" for i in range(rng.randint(1, 10))]
        edges = {(a, b) for i, b in enumerate(names) for a in names[:i] if rng.random() < 0.3}
        order = [step.name for step in graph_of(edges, rng.sample(names, len(names))).ordered()]
        assert sorted(order) == sorted(names)
        assert all(order.index(a) < order.index(b) for a, b in edges)
        ring = rng.sample(names, rng.randint(1, len(names)))
        edges |= set(zip(ring, [*ring[1:], ring[0]], strict=True))
        with pytest.raises(CycleError) as caught:
            graph_of(edges, rng.sample(names, len(names))).ordered()
        path = caught.value.args[1]
        assert path[0] == path[-1] and len(path) > 1
        assert all(edge in edges for edge in pairwise(path)), (seed, path)


@scheduler
def test_a_name_that_is_not_there_and_one_that_is_there_twice_are_refused():
    graph = TaskGraph("frame")
    graph.add("cull", lambda: None)
    graph.add_range("record", lambda *_: None, 4, after=["kull"])
    with pytest.raises(
        ValueError, match=r"'record' comes after 'kull', which is not there; did you mean 'cull'\?"
    ):
        graph.ordered()
    with pytest.raises(ValueError, match="'frame' has a task 'cull' already"):
        graph.add("cull", lambda: None)


# --- dot --------------------------------------------------------------------------------------------------------------


STRING = r'"((?:[^"\\]|\\.)*)"'


def parsed(text):
    """Nodes with labels, and edges, of a drawing in Graphviz' language; whatever else is in it fails."""

    def plain(quoted):
        return re.sub(r"\\(.)", lambda found: {"n": "\n"}.get(found[1], found[1]), quoted)

    lines = text.splitlines()
    head = re.fullmatch(rf"digraph {STRING} \{{", lines[0])
    assert head and lines[-1] == "}" and text.endswith("}\n")
    nodes, edges = {}, []
    for line in lines[1:-1]:
        if node := re.fullmatch(rf"  {STRING} \[label={STRING}\];", line):
            nodes[plain(node[1])] = plain(node[2])
        elif edge := re.fullmatch(rf"  {STRING} -> {STRING};", line):
            edges.append((plain(edge[1]), plain(edge[2])))
        else:
            assert re.fullmatch(r"  (rankdir=LR|node \[shape=box\]);", line), line
    return plain(head[1]), nodes, edges


@scheduler
def test_the_drawing_has_every_task_and_every_edge():
    for seed in range(100):
        rng = random.Random(seed)
        letters = 'ab "\\\n->;{}[]ü'
        names = list({"".join(rng.choices(letters, k=rng.randint(0, 6))) for _ in range(8)})
        edges = {(a, b) for a in names for b in names if rng.random() < 0.3}  # cycles can be drawn, too
        title, nodes, drawn = parsed(graph_of([*edges, *edges], names).dot())
        assert title == "made"
        assert nodes == {name: name for name in names}
        assert len(drawn) == len(edges) and set(drawn) == edges


@scheduler
def test_the_drawing_tells_ranges_and_pinned_threads():
    graph = TaskGraph('a "frame"')
    graph.add("load", lambda: None, pin="io")
    graph.add_range("record", lambda *_: None, 100, after=["load"])
    title, nodes, edges = parsed(graph.dot())
    assert title == 'a "frame"'
    assert nodes == {"load": "load\non io", "record": "record\n0 to 100"}
    assert edges == [("load", "record")]
