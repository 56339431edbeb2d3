"""The tree of a scene as rows of a list, for a panel whose user looks into branches and chooses a node.

Neither a window nor a library of widgets is known here: a caller gives a function that draws one row and says what
the user did with it, and gets the chosen node back. A graph and a `Scene` have the same tree: `graph.ancestry` with
`graph.names`, or `scene.nodes.ancestry` with `scene.nodes.names`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from common.scene.ancestry import Ancestry


class Entry(NamedTuple):
    """One row of the tree. `depth` is 0 for roots; a leaf has nothing to unfold."""

    node: int
    label: str
    depth: int
    leaf: bool


class Response(NamedTuple):
    """What the user did with a row: whether it is unfolded, and whether it was chosen just now."""

    unfolded: bool = True
    chosen: bool = False


def tree_entries(ancestry: Ancestry, names: Mapping[int, str] | Sequence[str]) -> Iterator[Entry]:
    """Give one entry for each node, a node before its children, children in ascending order."""
    for place in range(len(ancestry.order)):
        yield _entry(ancestry, names, place)


def show_tree(
    ancestry: Ancestry, names: Mapping[int, str] | Sequence[str], row: Callable[[Entry], Response]
) -> int | None:
    """Call `row` for each node that folded branches leave visible; return the node chosen last, or None.

    Depth-first order makes a branch a stretch of rows, so a folded one is a jump over it, and no recursion is
    needed for a tree of any depth.
    """
    place, chosen = 0, None
    while place < len(ancestry.order):
        entry = _entry(ancestry, names, place)
        response = row(entry)
        if response.chosen:
            chosen = entry.node
        place += 1 if response.unfolded else int(ancestry.sizes[entry.node])
    return chosen


def _entry(ancestry: Ancestry, names: Mapping[int, str] | Sequence[str], place: int) -> Entry:
    node = int(ancestry.order[place])
    name = names.get(node) if isinstance(names, Mapping) else names[node]
    return Entry(node, name or f"node {node}", int(ancestry.depth[node]), bool(ancestry.sizes[node] == 1))
