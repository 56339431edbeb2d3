"""A scene graph of objects, the obvious first design: `common.scene_graph` is measured against it.

Nothing in Strata draws with it. It is short and plainly right, which makes it the tests' truth; and it shows the
costs of pointers: a Python object and two small arrays for every node, one call of numpy for every product, and
recursion, which ends at a depth of some hundred nodes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(eq=False)
class ObjectNode:
    """A node that owns its children; `local` and `world` are (4, 4) float64."""

    local: NDArray[np.float64]
    name: str = ""
    mesh: int | None = None
    material: int | None = None
    children: list[ObjectNode] = field(default_factory=list)
    world: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))

    def add(self, child: ObjectNode) -> ObjectNode:
        """Append a child and return it."""
        self.children.append(child)
        return child

    def update(self, above: NDArray[np.float64] | None = None) -> None:
        """Compute `world` of this node and of everything below it."""
        self.world = self.local if above is None else above @ self.local
        for child in self.children:
            child.update(self.world)

    def walk(self) -> Iterator[ObjectNode]:
        """Give this node and everything below it, depth first."""
        yield self
        for child in self.children:
            yield from child.walk()
