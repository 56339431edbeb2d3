"""Scene graphs with nodes taken out, and several graphs made one: what changes the numbers of nodes.

Both return a new graph and where each node went, so that whatever else is kept by node can follow:
`place[node]` is the new number, or -1.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from common.scene.parts import Place, by_node, places_of
from common.scene_graph import SceneGraph, graph_from_arrays


def delete_nodes(graph: SceneGraph, nodes: ArrayLike) -> tuple[SceneGraph, Place]:
    """Return the graph without `nodes` (K,) and everything below them, and `place` (N,) of the old nodes.

    The others keep their order, their transforms and what they have; `update` computes the new graph's world.

    Raises:
        IndexError: there is no such node.
    """
    kept = np.ones(len(graph), bool)
    kept[graph.ancestry.subtrees(nodes)] = False
    place = places_of(kept)
    parent = graph.links["parent"][kept]
    result = graph_from_arrays(np.where(parent < 0, -1, place[parent]), graph.local[kept])
    result.meshes = by_node(graph.meshes, place)
    result.materials = by_node(graph.materials, place)
    result.names = by_node(graph.names, place)
    return result, place


def merge_graphs(
    graphs: Sequence[SceneGraph],
    transforms: Sequence[ArrayLike] | None = None,
    *,
    mesh_counts: Sequence[int] | None = None,
    material_counts: Sequence[int] | None = None,
    name: str = "root",
) -> tuple[SceneGraph, list[Place]]:
    """Return all graphs below one new root, node 0, and for each the `place` (N,) of its nodes.

    `transforms` are (4, 4) matrices, one for each graph: its roots' matrices are multiplied by it from the left, so
    every node's world matrix is. Graphs that number meshes or materials of their own give their counts; without
    counts all mean the same ones, as a grid of copies does.
    """
    parents, matrices, places = [np.array([-1], np.int32)], [np.eye(4)[None]], []
    first = 1
    for number, graph in enumerate(graphs):
        local, parent = graph.local.copy(), graph.links["parent"]
        if transforms is not None:
            local[parent < 0] = np.asarray(transforms[number], np.float64) @ local[parent < 0]
        parents.append(np.where(parent < 0, 0, parent + first))
        matrices.append(local)
        places.append(np.arange(first, first + len(graph), dtype=np.int32))
        first += len(graph)
    result = graph_from_arrays(np.concatenate(parents), np.concatenate(matrices))
    result.names[0] = name
    first_mesh = first_material = 0
    for number, (graph, place) in enumerate(zip(graphs, places, strict=True)):
        meshes, materials = by_node(graph.meshes, place), by_node(graph.materials, place)
        result.meshes.update({node: mesh + first_mesh for node, mesh in meshes.items()})
        result.materials.update({node: material + first_material for node, material in materials.items()})
        result.names.update(by_node(graph.names, place))
        first_mesh += mesh_counts[number] if mesh_counts else 0
        first_material += material_counts[number] if material_counts else 0
    return result, places
