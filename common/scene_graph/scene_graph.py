"""The scene graph as flat arrays: links instead of pointers, components beside the nodes, and updates by level.

The obvious scene graph is a tree of objects (see `common.scene_graph.objects`). Its nodes lie scattered in memory, each
new feature makes every node larger, and every frame walks all of them. Here a node is a number. Its links and
matrices are rows of arrays; what only some nodes have (a mesh, a material, a name) is a map from node to value; and
an update computes what was marked, all nodes of a level in one product.

Nodes are appended, so parents have smaller numbers than their children, and siblings ascend. Numbers change when
nodes are deleted or graphs merged (`common.scene_graph.edit`). `common.scene_graph.exchange` leads to the `Scene` that
renderers draw, and back.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.scene.ancestry import HIERARCHY, Ancestry, node_numbers

Float64 = NDArray[np.float64]


class Shape(NamedTuple):
    """Something that is drawn: a node with a mesh and a material."""

    node: int
    mesh: int
    material: int


class SceneGraph:
    """A forest of nodes in arrays that grow. All matrices are float64 and act on columns.

    `meshes`, `materials` and `names` map nodes to what they have; they may be changed freely. Numbers of meshes and
    materials mean whatever the owner of the geometry says.
    """

    def __init__(self) -> None:
        self._links = np.zeros(0, HIERARCHY)
        self._local = np.zeros((0, 4, 4))
        self._world = np.zeros((0, 4, 4))
        self._count = 0
        self._marked: set[int] = set()
        self._ancestry: Ancestry | None = None
        self.meshes: dict[int, int] = {}
        self.materials: dict[int, int] = {}
        self.names: dict[int, str] = {}

    def __len__(self) -> int:
        return self._count

    @property
    def links(self) -> np.ndarray:
        """(N,) parent, first child, next sibling, last sibling and level of each node (HIERARCHY); do not write."""
        return self._links[: self._count]

    @property
    def local(self) -> Float64:
        """(N, 4, 4) parent_from_node. Write with `set_local`, or call `mark` for what was written here."""
        return self._local[: self._count]

    @property
    def world(self) -> Float64:
        """(N, 4, 4) world_from_node as of the last `update`; do not write."""
        return self._world[: self._count]

    @property
    def ancestry(self) -> Ancestry:
        """The hierarchy, for work on many nodes at once; another object after nodes were added."""
        if self._ancestry is None:
            self._ancestry = Ancestry(self.links["parent"].copy())
        return self._ancestry

    def add(
        self,
        parent: int = -1,
        local: ArrayLike | None = None,
        *,
        name: str | None = None,
        mesh: int | None = None,
        material: int | None = None,
    ) -> int:
        """Append a node as the last child of `parent` (-1: as the last root) and return its number.

        The first child knows the last one, so this costs the same for the thousandth child as for the second.

        Raises:
            IndexError: there is no such parent.
        """
        if not -1 <= parent < self._count:
            raise IndexError(f"node {parent} cannot be a parent: there are {self._count} nodes")
        node = self._count
        if node == len(self._links):
            self._grow(max(64, 2 * node))
        self._count += 1
        self._ancestry = None
        links = self._links
        if parent >= 0:
            first = int(links["first_child"][parent])
            level = int(links["level"][parent]) + 1
        else:
            first, level = (0 if node > 0 else -1), 0
        links[node] = (parent, -1, -1, -1, level)
        if first >= 0:
            links["next_sibling"][links["last_sibling"][first]] = node
            links["last_sibling"][first] = node
        else:
            links["last_sibling"][node] = node
            if parent >= 0:
                links["first_child"][parent] = node
        self._local[node] = np.eye(4) if local is None else local
        self._marked.add(node)
        for component, value in ((self.meshes, mesh), (self.materials, material)):
            if value is not None:
                component[node] = value
        if name is not None:
            self.names[node] = name
        return node

    def _grow(self, capacity: int) -> None:
        def grown(old: np.ndarray, new: np.ndarray) -> np.ndarray:
            new[: self._count] = old[: self._count]
            return new

        self._links = grown(self._links, np.zeros(capacity, HIERARCHY))
        self._local = grown(self._local, np.zeros((capacity, 4, 4)))
        self._world = grown(self._world, np.zeros((capacity, 4, 4)))

    def roots(self) -> Iterator[int]:
        """Give the nodes without parent, in the order in which they were added."""
        return self._chain(0 if self._count else -1)

    def children(self, node: int) -> Iterator[int]:
        """Give the children of a node in the order in which they were added."""
        return self._chain(int(self.links["first_child"][node]))

    def _chain(self, node: int) -> Iterator[int]:
        following = self.links["next_sibling"]
        while node >= 0:
            yield node
            node = int(following[node])

    def set_local(self, node: int, matrix: ArrayLike) -> None:
        """Set parent_from_node (4, 4) of a node; `update` will carry it down."""
        self.mark([node])
        self.local[node] = matrix

    def mark(self, nodes: ArrayLike) -> None:
        """Note that the local matrices of `nodes` (K,) have changed.

        Raises:
            IndexError: there is no such node.
        """
        self._marked.update(node_numbers(nodes, self._count).tolist())

    def update(self) -> int:
        """Bring `world` up to date and return the number of matrix products that it took.

        Computed are the marked nodes and what hangs on them, each once, however often it was marked; the roots
        among them are copied. Without marks nothing is done. Levels without marks cost nothing and end nothing:
        a lone node far down is found.
        """
        if not self._marked:
            return 0
        levels = self.ancestry.levels_below(list(self._marked))
        self._marked.clear()
        for level in levels:
            self._world[level] = self._local[level]
        return self.ancestry.compose(self.world, levels)

    def shapes(self) -> list[Shape]:
        """Return what is drawn, by ascending node: a node without mesh or without material draws nothing."""
        drawn = sorted(self.meshes.keys() & self.materials.keys())
        return [Shape(node, self.meshes[node], self.materials[node]) for node in drawn]


def graph_from_arrays(parent: ArrayLike, local: Float64) -> SceneGraph:
    """Return a graph with all its nodes at once: `parent` (N,) before their children, `local` (N, 4, 4).

    Raises:
        ValueError: a parent does not stand before its child.
    """
    graph = SceneGraph()
    above = np.asarray(parent, np.int32).reshape(-1)
    count = len(above)
    if not ((above >= -1) & (above < np.arange(count))).all():
        raise ValueError("a parent must have a smaller number than its child")
    graph._ancestry = Ancestry(above.copy())
    graph._links, graph._count = graph._ancestry.links(), count
    graph._local = np.array(local, np.float64).reshape(count, 4, 4)
    graph._world = np.zeros_like(graph._local)
    graph._marked = set(range(count))
    return graph
