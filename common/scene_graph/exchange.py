"""From a `Scene` to its scene graph and back: take nodes apart, hang things elsewhere, draw the result.

A scene's instances become components of nodes; a node that draws several meshes, or copies of one, gets a child for
each. The graph can then be edited, deleted from, merged and stored. On the way back geometry, materials and pictures
come from the scene, and what else hangs on its nodes (lights, cameras, clips, skins) follows them by `Origins`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from common.numerics.transforms import decompose
from common.scene import Instances, Nodes, Scene
from common.scene.parts import Place, attached, by_node, changed, same_places
from common.scene.pose import local_matrices
from common.scene_graph import SceneGraph, Shape, graph_from_arrays


@dataclass(frozen=True)
class Origins:
    """Which node of a graph each node (N,) of a scene became, and which one draws each instance (I,); -1: none."""

    nodes: Place
    instances: Place

    def moved(self, place: Place) -> Origins:
        """Return the origins after the graph's nodes got the numbers `place`, as deleting and merging return them."""
        beyond = np.append(place, -1).astype(np.int32)  # where -1 leads to
        return Origins(beyond[self.nodes], beyond[self.instances])


def graph_of(scene: Scene) -> tuple[SceneGraph, Origins]:
    """Return the graph of a scene at rest. Nodes keep their numbers where parents stand before their children.

    A node that draws one mesh has it as a component. Where there are several, or instances with matrices of their
    own, each becomes a child that comes after all nodes of the scene.
    """
    nodes, drawn = scene.nodes, scene.instances
    count = len(nodes)
    place = same_places(count)
    if (nodes.parent >= np.arange(count)).any():
        place[np.concatenate(nodes.ancestry.levels)] = np.arange(count)
    uses = np.bincount(drawn.node, minlength=count)
    own = uses[drawn.node] > 1
    if drawn.local is not None:
        own |= (drawn.local != np.eye(4)).any(axis=(1, 2))
    shape = place[drawn.node]
    shape[own] = np.arange(count, count + own.sum())
    parent = np.empty(count + int(own.sum()), np.int32)
    parent[place] = np.where(nodes.parent < 0, -1, place[nodes.parent])
    parent[count:] = place[drawn.node[own]]
    local = np.tile(np.eye(4), (len(parent), 1, 1))
    local[place] = local_matrices(nodes)
    if drawn.local is not None:
        local[count:] = drawn.local[own]
    graph = graph_from_arrays(parent, local)
    graph.names = {int(place[node]): name for node, name in enumerate(nodes.names)}
    for node, mesh in zip(shape.tolist(), drawn.mesh.tolist(), strict=True):
        graph.meshes[node] = mesh
        graph.materials[node] = int(scene.meshes["material"][mesh])
        if node >= count:
            graph.names[node] = scene.mesh_names[mesh]
    return graph, Origins(place, shape)


def scene_with(scene: Scene, graph: SceneGraph, origins: Origins) -> Scene:
    """Return a scene that draws the shapes of `graph` with the meshes, materials and images of `scene`.

    Instances of `scene` keep their order and visibility as long as their nodes are there; new shapes follow by
    ascending node. A node whose matrix was not changed keeps its translation, rotation and scale. One that was
    changed has a matrix, or, where a clip drives it, the parts of that matrix (without its shear).

    Raises:
        UserError: a mesh that stays has lost a joint of its skin.
        ValueError: a mesh or material that the scene does not have, or a deforming mesh that two nodes draw.
    """
    shapes = _ordered(graph, origins)
    wrong = [shape for shape in shapes if not (0 <= shape.mesh < len(scene.meshes))]
    wrong += [shape for shape in shapes if not (0 <= shape.material < len(scene.materials))]
    if wrong:
        raise ValueError(f"the scene has no mesh or no material of {wrong[0]}")
    meshes, names, rows = _meshes(scene, shapes)
    seen = np.zeros(len(graph), bool)
    for node, visible in zip(origins.instances.tolist(), scene.instances.visible.tolist(), strict=True):
        if node >= 0:
            seen[node] = visible
    seen[sorted({shape.node for shape in shapes} - set(origins.instances.tolist()))] = True
    drawing = np.array([shape.node for shape in shapes], np.int32)
    return changed(
        scene,
        meshes=meshes,
        mesh_names=names,
        nodes=_nodes(scene, graph, origins.nodes),
        instances=Instances(drawing, np.array(rows, np.int32), visible=seen[drawing]),
        **attached(scene, origins.nodes, same_places(len(scene.meshes))),
    )


def _ordered(graph: SceneGraph, origins: Origins) -> list[Shape]:
    """Return the shapes: first those that draw instances of the scene, in their order."""
    shapes = {shape.node: shape for shape in graph.shapes()}
    first = [shapes.pop(node) for node in origins.instances.tolist() if node in shapes]
    return [*first, *shapes.values()]


def _meshes(scene: Scene, shapes: list[Shape]) -> tuple[np.ndarray, list[str], list[int]]:
    """Return the table of meshes with their names, and each shape's row; another material makes another row.

    A row that deforms is drawn once and takes its shape's material itself.
    """
    meshes, names = scene.meshes.copy(), list(scene.mesh_names)
    deforming = {deformation.mesh for deformation in scene.deformations}
    uses = Counter(shape.mesh for shape in shapes)
    row_of: dict[tuple[int, int], int] = {}
    added: list[np.void] = []
    rows = []
    for _, mesh, material in shapes:
        if mesh in deforming:
            if uses[mesh] > 1:
                raise ValueError(f"mesh {mesh} deforms, and {uses[mesh]} nodes draw it")
            meshes["material"][mesh] = material
        row = mesh if meshes["material"][mesh] == material else row_of.get((mesh, material))
        if row is None:
            row = row_of[mesh, material] = len(meshes) + len(added)
            added.append(meshes[mesh].copy())
            added[-1]["material"] = material
            names.append(names[mesh])
        rows.append(row)
    return np.append(meshes, np.array(added, meshes.dtype)), names, rows


def _nodes(scene: Scene, graph: SceneGraph, place: Place) -> Nodes:
    old, count = scene.nodes, len(graph)
    translation, scale = np.zeros((count, 3)), np.ones((count, 3))
    rotation = np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))
    has_matrix = np.ones(count, bool)
    kept = np.flatnonzero(place >= 0)
    at = place[kept]
    translation[at], rotation[at], scale[at] = old.translation[kept], old.rotation[kept], old.scale[kept]
    has_matrix[at] = old.has_matrix[kept]
    changed_ = (graph.local[at] != local_matrices(old, kept)).any(axis=(1, 2))
    has_matrix[at[changed_]] = True
    driven = {
        channel.node
        for clip in scene.animations
        for channel in clip.channels
        if channel.path != "weights" and not old.has_matrix[channel.node]
    }
    for node in sorted(driven & set(kept[changed_].tolist())):
        row = place[node]
        translation[row], rotation[row], scale[row] = decompose(graph.local[row])
        has_matrix[row] = False
    return Nodes(
        parent=graph.links["parent"].copy(),
        translation=translation,
        rotation=rotation,
        scale=scale,
        matrix=graph.local.copy(),
        has_matrix=has_matrix,
        names=[graph.names.get(node) or f"node {node}" for node in range(count)],
        weights=by_node(old.weights, place),
        extras=by_node(old.extras, place),
    )
