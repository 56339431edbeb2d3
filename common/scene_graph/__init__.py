"""The scene graph as flat arrays: edits, files, and the way from and to a scene."""

from common.scene_graph.scene_graph import (
    SceneGraph,
    Shape,
    graph_from_arrays,
)

__all__ = ["SceneGraph", "Shape", "graph_from_arrays"]
