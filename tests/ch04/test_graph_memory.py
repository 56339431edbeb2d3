"""Shared memory: nobody's bytes are used by two at once, and hardly more of them than need be."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from backends.contract import Access
from chapters.ch04.graph import types as words
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.memory.placement import users_before
from chapters.ch04.graph.types import Node, Requirement
from tests.support.graph_truths import PREVIOUS, Truth
from tests.support.random_graphs import random_graph

aliasing = pytest.mark.feature("frame-graph/resource-aliasing")
externals = pytest.mark.feature("frame-graph/external-resources")


def lives_of(truth, graph):
    """The first and the last step that touch each transient."""
    lives = {}
    for number, step in enumerate(graph.steps):
        for resource, *_ in truth.touches(step.name):
            if truth.life(resource.removesuffix(PREVIOUS)) == "transient":
                lives[resource] = lives.get(resource, (number,))[0], number
    return lives


def most_alive(lives, sizes):
    """The most bytes that are alive in one step, step by step."""
    steps = range(max((last for _, last in lives.values()), default=0) + 1)
    return max(
        sum(sizes[name] for name, (first, last) in lives.items() if first <= step <= last) for step in steps
    )


def check_memory(seeds):
    for seed in seeds:
        made = random_graph(seed, words)
        truth = Truth(made.nodes, made.outputs, made.externals, made.keep)
        graph = made.compile(compile_graph)
        memory, lives = graph.memory, lives_of(truth, graph)
        assert memory.lives == lives
        assert memory.places.keys() == lives.keys(), "what is kept, a history or external lies in no heap"
        needs = {name: made.requirements(graph.resources[name]) for name in lives}
        for name, place in memory.places.items():
            need, heap = needs[name], memory.heaps[place.heap]
            assert place.size >= need.size and place.offset + place.size <= heap.size
            assert place.offset % need.alignment == 0 and heap.alignment % need.alignment == 0
            assert heap.types and heap.types & ~need.types == 0, "memory of a type that will not do"
        for one, other in combinations(lives, 2):
            first, second = memory.places[one], memory.places[other]
            apart = first.heap != second.heap or (
                first.offset + first.size <= second.offset or second.offset + second.size <= first.offset
            )
            in_turns = lives[one][1] < lives[other][0] or lives[other][1] < lives[one][0]
            assert apart or in_turns, f"{seed}: '{one}' and '{other}'"
        bound = sum(
            most_alive(
                {name: life for name, life in lives.items() if memory.places[name].heap == number}, sizes
            )
            for number in range(len(memory.heaps))
            for sizes in [{name: needs[name].size for name in lives}]
        )
        assert memory.bound == bound <= memory.size
        assert memory.alone == sum(need.size for need in needs.values())


@aliasing
@externals
def test_no_two_resources_share_bytes_while_both_are_alive():
    check_memory(range(150))


@aliasing
@pytest.mark.long
def test_no_two_resources_share_bytes_in_many_random_frames():
    check_memory(range(10_000))


@aliasing
def test_without_sharing_every_resource_has_bytes_of_its_own():
    for seed in range(30):
        graph = random_graph(seed, words).compile(compile_graph, alias=False)
        for one, other in combinations(graph.memory.places.values(), 2):
            assert one.heap != other.heap or (
                one.offset + one.size <= other.offset or other.offset + other.size <= one.offset
            )
        assert graph.memory.size >= graph.memory.alone


@aliasing
def test_hardly_more_memory_is_taken_than_is_alive_at_once():
    """Frames of 40 passes, images of some usual sizes. Measured: 0.8 % above the bound on average, 9 % at worst; the
    heaps take 64 % of what resources with memory of their own would."""
    over, saved = [], []
    for seed in range(25):
        made = random_graph(seed, words, count=40, why_not=0.0)
        made.requirements = usual
        memory = made.compile(compile_graph).memory
        over.append(memory.size / memory.bound)
        saved.append(memory.size / memory.alone)
    assert min(over) >= 1.0
    assert np.mean(over) < 1.02, over
    assert max(over) < 1.15, over
    assert np.mean(saved) < 0.7, saved


def usual(resource):
    """What images ask for: their texels in tiles of 4 KiB; all may lie in the same memory."""
    if resource.kind == "buffer":
        return Requirement(resource.bytes, 256)
    width, height = resource.size
    texel = {"rgba8": 4, "r32f": 4, "d32f": 4, "rgba16f": 8, "rgba32f": 16}[resource.format]
    size = width * height * texel * resource.samples
    return Requirement(-(-size // 4096) * 4096, 4096)


def chain(count, **sizes):
    """Passes of which each samples what the one before drew."""
    nodes = [Node("pass0", (), (Access("image0", "color", "rgba8"),))]
    for number in range(1, count):
        read = Access(f"image{number - 1}", "sampled")
        write = Access(f"image{number}", "color", "rgba8", **sizes.get(f"image{number}", {}))
        nodes.append(Node(f"pass{number}", (read,), (write,)))
    return nodes


@aliasing
def test_a_chain_of_any_length_needs_two_images():
    for count in (4, 5, 20):
        memory = compile_graph(chain(count), (64, 64), [f"image{count - 1}"]).memory
        assert memory.size == memory.bound == 2 * 64 * 64 * 4
        assert memory.alone == (count - 1) * 64 * 64 * 4


@aliasing
def test_what_a_pass_reads_never_shares_bytes_with_what_it_writes():
    graph = compile_graph(chain(3), (64, 64), ["image2"])
    first, second = graph.memory.places["image0"], graph.memory.places["image1"]
    assert first.offset + first.size <= second.offset or second.offset + second.size <= first.offset


@aliasing
def test_a_small_resource_lies_in_the_bytes_of_a_large_one():
    """The heap is not a list of slots: two small images fit where one large one was."""
    small = {"scale": 0.5}
    nodes = chain(5, image2=small, image3=small, image4=small)
    memory = compile_graph(nodes, (64, 64), ["image4"]).memory
    assert memory.size == memory.bound == 2 * 64 * 64 * 4


@aliasing
def test_what_is_looked_at_shares_memory_with_nobody():
    graph = compile_graph(chain(6), (64, 64), ["image5"], keep=["image2"])
    assert graph.resources["image2"].life == graph.resources["image5"].life == "kept"
    assert {"image2", "image5"}.isdisjoint(graph.memory.places)


@aliasing
def test_memory_of_another_type_is_another_heap():
    types = {"image0": 1, "image1": 2, "image2": 1, "image3": 2}
    needs = lambda resource: Requirement(100, 1, types[resource.name])  # noqa: E731
    graph = compile_graph(chain(5), (8, 8), ["image4"], requirements=needs)
    place = graph.memory.places
    assert place["image0"].heap == place["image2"].heap != place["image1"].heap == place["image3"].heap


@aliasing
def test_who_used_texels_in_the_padding_of_a_later_user_is_waited_for_as_well():
    """Validation follows chains of barriers over texels only; all bytes are ordered, too."""
    lives = {"old": (0, 1), "padded": (2, 3), "new": (4, 5), "in padding": (6, 7)}

    def users(padding):
        places = {
            "old": words.Place(0, 0, 100),
            "padded": words.Place(0, 0, 100, padding),
            "new": words.Place(0, 0, 100, 30),
            "in padding": words.Place(0, 80, 20),
        }
        return users_before(words.Memory(lives, places, (words.Heap(100, 1),), 320, 100))

    assert users(40) == {
        "old": ["in padding", "new", "old"],
        "padded": ["old"],
        "new": ["old", "padded"],
        "in padding": ["new", "old"],
    }
    assert users(0)["new"] == ["padded"] and users(0)["in padding"] == ["new", "padded"]
