"""The binary file of a scene graph: arrays as they lie in memory, read with a handful of calls and no parsing.

Little-endian, without padding:

    uint32             number of nodes (24 bits), version (7 bits), and in the highest bit whether names follow
    N x 16 float64     parent_from_node, row by row
    N x 5 int32        parent, first child, next sibling, last sibling, level
    map of materials   uint32 count of integers (two a pair), then node and value as int32, ascending by node
    map of meshes      the same
    map of names       the same, to the texts that follow: uint32 count, then each as uint32 bytes and UTF-8

A node takes 128 bytes of matrices. The textbook's format spends them on two of float32, local and world; world
follows from local, so here they hold the local one in full precision. Equal graphs give equal bytes.
"""

from __future__ import annotations

import os
import struct
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError, UserError
from common.files.regular_files import read_regular
from common.paths import write_whole
from common.scene.ancestry import HIERARCHY, node_numbers
from common.scene_graph import SceneGraph, graph_from_arrays

VERSION = 1
MAX_NODES = 2**24 - 1
_NAMED = 1 << 31
_COUNT = struct.Struct("<I")


def save_graph(graph: SceneGraph, path: str | os.PathLike[str]) -> None:
    """Write a graph so that a reader sees the old file or the whole new one.

    Raises:
        UserError: the file cannot be written, or the graph has more than `MAX_NODES` nodes.
    """
    data = graph_bytes(graph)
    try:
        write_whole(Path(path), data)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{path} cannot be written ({reason}): choose another place.") from None


def load_graph(path: str | os.PathLike[str]) -> SceneGraph:
    """Read a graph; nothing in the file is trusted.

    Raises:
        SceneError: no such file, a version that is not known, or bytes that are damaged.
    """
    try:
        data = read_regular(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise SceneError(f"{path} cannot be read ({reason}): check the path.") from None
    return _Reader(data, str(path)).graph()


def graph_bytes(graph: SceneGraph) -> bytes:
    """Return the content of the file.

    Raises:
        UserError: more than `MAX_NODES` nodes.
        IndexError: a component of a node that does not exist.
        ValueError: a matrix that is not finite, or a negative number of a mesh or material.
    """
    if not np.isfinite(graph.local).all():
        raise ValueError("a matrix is not finite")
    if len(graph) > MAX_NODES:
        raise UserError(
            f"A graph of {len(graph)} nodes does not fit into a file, which holds {MAX_NODES}: split it."
        )
    texts = sorted(set(graph.names.values()))
    number = {text: index for index, text in enumerate(texts)}
    head = len(graph) | VERSION << 24 | (_NAMED if texts else 0)
    parts = [_COUNT.pack(head), graph.local.astype("<f8").tobytes(), graph.links.tobytes()]
    maps = [graph.materials, graph.meshes]
    if texts:
        maps.append({node: number[text] for node, text in graph.names.items()})
    for component in maps:
        node_numbers(list(component), len(graph))
        if min(component.values(), default=0) < 0:
            raise ValueError(f"a component has the number {min(component.values())}")
        pairs = np.array(sorted(component.items()), "<i4")
        parts += [_COUNT.pack(pairs.size), pairs.tobytes()]
    if texts:
        parts.append(_COUNT.pack(len(texts)))
        for text in texts:
            code = text.encode("utf-8", "surrogatepass")
            parts += [_COUNT.pack(len(code)), code]
    return b"".join(parts)


class _Reader:
    """Reads `data` from front to back, never beyond its end."""

    def __init__(self, data: bytes, name: str) -> None:
        self._data, self._name = data, name
        self._at = 0

    def graph(self) -> SceneGraph:
        (head,) = _COUNT.unpack(self._take(_COUNT.size))
        count, version = head & MAX_NODES, head >> 24 & 0x7F
        if version != VERSION:
            self._refuse(f"has version {version} where {VERSION} is known, or is no scene graph")
        local = np.frombuffer(self._take(128 * count), "<f8").reshape(count, 4, 4)
        links = np.frombuffer(self._take(HIERARCHY.itemsize * count), HIERARCHY)
        if not np.isfinite(local).all():
            self._refuse("has a matrix that is not finite")
        try:
            graph = graph_from_arrays(links["parent"], local)
        except ValueError:
            self._refuse("has a node whose parent does not stand before it")
        if graph.links.tobytes() != links.tobytes():
            self._refuse("has links that do not fit its parents")
        for component in (graph.materials, graph.meshes):
            component.update(self._map(count))
        if head & _NAMED:
            numbers = self._map(count)
            texts = [self._text() for _ in range(self._number(4))]
            if not all(text < len(texts) for text in numbers.values()):
                self._refuse("names a node by a text that it does not have")
            graph.names.update({node: texts[text] for node, text in numbers.items()})
        if self._at != len(self._data):
            self._refuse(f"goes on for {len(self._data) - self._at} bytes after its end")
        return graph

    def _map(self, count: int) -> dict[int, int]:
        integers = self._number(4)
        pairs: NDArray[np.int32] = np.frombuffer(self._take(4 * (integers & ~1)), "<i4").reshape(-1, 2)
        nodes, values = pairs[:, 0], pairs[:, 1]
        if integers % 2 or (np.diff(nodes) <= 0).any() or (pairs < 0).any() or (nodes >= count).any():
            self._refuse("has a map with a wrong node or value")
        return dict(zip(nodes.tolist(), values.tolist(), strict=True))

    def _text(self) -> str:
        try:
            return str(self._take(self._number(1)), "utf-8", "surrogatepass")
        except UnicodeDecodeError:
            self._refuse("has a name that is no text")

    def _number(self, size: int) -> int:
        """Return a count of things of at least `size` bytes; one that the file cannot hold is refused at once."""
        number: int = _COUNT.unpack(self._take(_COUNT.size))[0]
        if number * size > len(self._data) - self._at:
            self._refuse("is cut short")
        return number

    def _take(self, size: int) -> bytes:
        if size > len(self._data) - self._at:
            self._refuse("is cut short")
        part = self._data[self._at : self._at + size]
        self._at += size
        return part

    def _refuse(self, fault: str) -> NoReturn:
        raise SceneError(f"{self._name} {fault}: write it again with save_graph, or name another file.")
