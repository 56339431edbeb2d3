"""The tree of the scene's nodes in the panel: branches that unfold, and what is known of the node that was chosen."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from common.numerics.transforms import decompose
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.scene.tree import Entry, Response, show_tree

ROWS = 12
"""Of the tree that are seen at once; it scrolls."""


class Tree:
    """What is unfolded and chosen. Rows are listed when a branch is folded, and drawn where they are in sight."""

    def __init__(self, imgui: Any, placed: Callable[[str], None]) -> None:
        self._imgui, self._placed = imgui, placed
        self._scene: Scene | None = None
        self._unfolded: set[int] = set()
        self._rows: list[Entry] = []
        self.chosen: int | None = None

    def build(self, scene: Scene, time: float) -> None:
        """Show the nodes of `scene` and the transform of the chosen one at `time`."""
        if scene is not self._scene:
            self._scene, self.chosen = scene, None
            roots = np.flatnonzero(scene.nodes.parent < 0)
            self._unfolded = set(roots.tolist()) if len(roots) == 1 else set()
            self._list(scene)
        imgui = self._imgui
        height = min(len(self._rows), ROWS) * imgui.get_text_line_height_with_spacing()
        height += 2 * imgui.get_style().window_padding.y
        imgui.begin_child("nodes", (0.0, height), imgui.ChildFlags_.borders)
        clipper, folded = imgui.ListClipper(), None
        clipper.begin(len(self._rows))
        while clipper.step():
            for entry in self._rows[clipper.display_start : clipper.display_end]:
                if self._row(entry):
                    folded = entry.node
        imgui.end_child()
        if folded is not None:
            self._unfolded ^= {folded}
            self._list(scene)
        if self.chosen is not None:
            self._transform(scene, self.chosen, time)

    def _list(self, scene: Scene) -> None:
        rows: list[Entry] = []

        def row(entry: Entry) -> Response:
            rows.append(entry)
            return Response(unfolded=entry.node in self._unfolded)

        show_tree(scene.nodes.ancestry, scene.nodes.names, row)
        self._rows = rows

    def _row(self, entry: Entry) -> bool:
        """Draw a row; return whether its branch was folded or unfolded."""
        imgui, flags = self._imgui, self._imgui.TreeNodeFlags_
        style = flags.no_tree_push_on_open | flags.open_on_arrow | flags.span_avail_width
        style |= flags.leaf if entry.leaf else flags.none
        style |= flags.selected if entry.node == self.chosen else flags.none
        indent = entry.depth * imgui.get_tree_node_to_label_spacing() / 2
        if indent:
            imgui.indent(indent)
        imgui.set_next_item_open(entry.node in self._unfolded)
        imgui.tree_node_ex(f"{entry.label}###{entry.node}", style)
        self._placed(f"node {entry.node}")
        if indent:
            imgui.unindent(indent)
        toggled: bool = imgui.is_item_toggled_open()
        if imgui.is_item_clicked() and not toggled:
            self.chosen = entry.node
        return toggled

    def _transform(self, scene: Scene, node: int, time: float) -> None:
        imgui, world = self._imgui, evaluate_pose(scene, time).world_from_node[node]
        imgui.text_wrapped(f"node {node}: {scene.nodes.names[node]}")
        place, rotation, scale = decompose(world)
        for name, values in (("position [m]", place), ("rotation xyzw", rotation), ("scale", scale)):
            imgui.text(f"{name:14}" + " ".join(f"{value:8.4g}" for value in values))
        self._placed("transform")
        imgui.set_item_tooltip("In the world, at the time shown.")
