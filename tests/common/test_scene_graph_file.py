"""The file of a scene graph: bytes, size, and everything that can be wrong with it."""

from __future__ import annotations

import contextlib
import struct

import numpy as np
import pytest

from common.errors import SceneError, UserError
from common.scene_graph import SceneGraph
from common.scene_graph.file import graph_bytes, load_graph, save_graph


def sample(named: bool = True, count: int = 12) -> SceneGraph:
    """Return a graph whose components were given in no order."""
    random = np.random.default_rng(2)
    graph = SceneGraph()
    for node in range(count):
        graph.add(int(random.integers(-1, node)) if node else -1, random.normal(size=(4, 4)))
    for node in (9, 2, 7):
        graph.meshes[node] = 5 * node
    for node in (7, 3):
        graph.materials[node] = node
    if named:
        graph.names.update({7: "lamp", 1: "räum 🙂", 4: "lamp"})
    return graph


@pytest.mark.feature("scene/binary-file")
@pytest.mark.feature("scene/components")
@pytest.mark.parametrize("named", [True, False])
@pytest.mark.parametrize("count", [12, 10])
def test_a_graph_comes_back_and_gives_the_same_bytes(tmp_path, named, count):
    graph = sample(named, count)
    save_graph(graph, tmp_path / "a.graph")
    back = load_graph(tmp_path / "a.graph")
    assert back.links.tobytes() == graph.links.tobytes()
    assert np.array_equal(back.local, graph.local)
    assert (back.meshes, back.materials, back.names) == (graph.meshes, graph.materials, graph.names)
    assert back.shapes() == graph.shapes() == [(7, 35, 7)]
    back.update(), graph.update()
    assert np.array_equal(back.world, graph.world)
    save_graph(back, tmp_path / "b.graph")
    data = (tmp_path / "a.graph").read_bytes()
    assert (tmp_path / "b.graph").read_bytes() == data
    size = 4 + count * (64 + 64 + 20) + (4 + 8 * 2) + (4 + 8 * 3)
    if named:
        size += (4 + 8 * 3) + 4 + sum(4 + len(text.encode()) for text in ("lamp", "räum 🙂"))
    assert len(data) == size
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.graph", "b.graph"]


@pytest.mark.feature("scene/binary-file")
def test_an_empty_graph_has_its_counts_alone(tmp_path):
    save_graph(SceneGraph(), tmp_path / "empty")
    assert (tmp_path / "empty").stat().st_size == 4 + 4 + 4
    assert len(load_graph(tmp_path / "empty")) == 0


def broken(change) -> bytes:
    data = bytearray(graph_bytes(sample()))
    change(data)
    return bytes(data)


def put(offset: int, value: int, form: str = "<i"):
    return lambda data: struct.pack_into(form, data, offset, value)


LINKS = 4 + 12 * 128
MAPS = LINKS + 12 * 20
NAMES = MAPS + (4 + 16) + (4 + 24)
FAULTS = {
    "another version": (put(3, 0x82, "<B"), "version 2 where 1 is known"),
    "a text file": (lambda data: data.__setitem__(slice(0, 4), b"glTF"), "version 70"),
    "too many nodes": (put(0, 200, "<B"), "cut short"),
    "not a number": (put(4 + 5 * 8, 0x7FF8000000000000, "<q"), "not finite"),
    "a parent behind its child": (put(LINKS + 20 * 3, 3), "parent does not stand before"),
    "a parent below -1": (put(LINKS + 20 * 3, -2), "parent does not stand before"),
    "a cycle of siblings": (put(LINKS + 8, 0), "links that do not fit"),
    "a wrong level": (put(LINKS + 20 * 5 + 16, 7), "links that do not fit"),
    "a map of an odd length": (put(MAPS, 3), "map with a wrong"),
    "a huge map": (put(MAPS, 0x7FFFFFFF), "cut short"),
    "a component of a missing node": (put(MAPS + 12, 12), "map with a wrong"),
    "a component of a node twice": (put(MAPS + 12, 3), "map with a wrong"),
    "a negative mesh": (put(MAPS + 8, -1), "map with a wrong"),
    "a missing text": (put(NAMES + 8, 2), "text that it does not have"),
    "a text that is none": (lambda data: data.__setitem__(slice(-2, None), b"\xff\xff"), "no text"),
    "a byte too much": (lambda data: data.append(0), "goes on for 1 bytes"),
    "no names where names are said to be": (lambda data: data.__delitem__(slice(NAMES, None)), "cut short"),
    "names where none are said to be": (put(3, 1, "<B"), "goes on"),
    "nothing": (lambda data: data.clear(), "cut short"),
}


@pytest.mark.feature("scene/binary-file")
@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_is_said_in_one_sentence(tmp_path, fault):
    change, reason = FAULTS[fault]
    path = tmp_path / "wrong.graph"
    path.write_bytes(broken(change))
    with pytest.raises(SceneError, match=reason) as caught:
        load_graph(path)
    text = str(caught.value)
    assert text.startswith(str(path)) and text.endswith(".") and "\n" not in text


def test_a_file_cut_anywhere_or_with_any_byte_changed_never_raises_anything_else(tmp_path):
    whole = graph_bytes(sample())
    random = np.random.default_rng(0)
    path = tmp_path / "wrong.graph"
    for cut in random.integers(0, len(whole), 60):
        path.write_bytes(whole[:cut])
        with pytest.raises(SceneError):
            load_graph(path)
    for place in random.integers(0, len(whole), 200):
        data = bytearray(whole)
        data[place] ^= 1 << int(random.integers(8))
        path.write_bytes(data)
        with contextlib.suppress(SceneError):
            graph_bytes(load_graph(path))


def test_what_a_file_cannot_hold_is_not_written(tmp_path):
    with pytest.raises(SceneError, match="cannot be read"):
        load_graph(tmp_path / "missing")
    with pytest.raises(UserError, match="cannot be written"):
        save_graph(sample(), tmp_path / "missing" / "a.graph")
    path = tmp_path / "a.graph"
    save_graph(sample(), path)
    kept = path.read_bytes()
    strange, lost, negative = sample(), sample(), sample()
    strange.local[3] = np.inf
    lost.meshes[12] = 0
    negative.materials[3] = -1
    for graph, error in ((strange, ValueError), (lost, IndexError), (negative, ValueError)):
        with pytest.raises(error):
            save_graph(graph, path)
    assert path.read_bytes() == kept
