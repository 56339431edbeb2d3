"""Deletion and merging of scene graphs against trees of objects that never had the nodes, or have one root more."""

from __future__ import annotations

import numpy as np
import pytest

from common.numerics.transforms import compose, normalize
from common.scene_graph import SceneGraph
from common.scene_graph.edit import delete_nodes, merge_graphs
from common.scene_graph.objects import ObjectNode


def random_graph(count: int, seed: int) -> tuple[SceneGraph, list[ObjectNode]]:
    """Return a graph whose nodes have all, some or no components, and the same as objects by number."""
    random = np.random.default_rng(seed)
    graph, made = SceneGraph(), []
    for node in range(count):
        above = int(random.integers(-1, node)) if node and random.random() < 0.9 else -1
        local = compose(random.normal(size=3), normalize(random.normal(size=4)), random.uniform(0.5, 2, 3))
        name = f"{seed}/{node}" if random.random() < 0.7 else None
        mesh, material = (int(random.integers(9)) if random.random() < 0.5 else None for _ in range(2))
        graph.add(above, local, name=name, mesh=mesh, material=material)
        made.append(ObjectNode(local, name or "", mesh, material))
        if above >= 0:
            made[above].add(made[node])
    return graph, made


def tree(graph: SceneGraph) -> list:
    """Return all a graph says, without numbers of nodes: each root with its level, components and children."""
    graph.update()

    def branch(node: int) -> tuple:
        return (
            int(graph.links["level"][node]),
            graph.names.get(node, ""),
            graph.meshes.get(node),
            graph.materials.get(node),
            graph.local[node].tobytes(),
            graph.world[node].tobytes(),
            [branch(child) for child in graph.children(node)],
        )

    return [branch(root) for root in graph.roots()]


def object_tree(roots: list[ObjectNode], without: set[int] = frozenset()) -> list:
    def branch(node: ObjectNode, level: int) -> tuple:
        below = [branch(child, level + 1) for child in node.children if id(child) not in without]
        parts = (node.local.tobytes(), node.world.tobytes(), below)
        return (level, node.name, node.mesh, node.material, *parts)

    for root in roots:
        root.update()
    return [branch(root, 0) for root in roots if id(root) not in without]


@pytest.mark.feature("scene/delete-nodes")
@pytest.mark.parametrize("seed", range(10))
def test_what_is_left_is_the_scene_built_without_the_deleted_subtrees(seed):
    graph, made = random_graph(60, seed)
    roots = [made[node] for node in graph.roots()]
    chosen = np.random.default_rng(seed).integers(0, 60, 6)
    left, place = delete_nodes(graph, chosen)
    assert tree(left) == object_tree(roots, {id(made[node]) for node in chosen})
    stays = np.flatnonzero(place >= 0)
    assert place[stays].tolist() == list(range(len(left)))
    assert np.array_equal(left.local, graph.local[stays])
    assert left.update() == 0  # `tree` has done it
    left.add(0 if len(left) else -1, name="later")
    assert left.links.tobytes() == rebuilt(left).links.tobytes()


def rebuilt(graph: SceneGraph) -> SceneGraph:
    """Return the graph that the insertion of the same nodes, one by one, gives."""
    result = SceneGraph()
    for above, local in zip(graph.links["parent"].tolist(), graph.local, strict=True):
        result.add(above, local)
    return result


@pytest.mark.feature("scene/delete-nodes")
def test_deleting_nothing_changes_nothing_and_deleting_the_roots_leaves_nothing():
    graph, _ = random_graph(30, 3)
    same, place = delete_nodes(graph, [])
    assert tree(same) == tree(graph)
    assert same.links.tobytes() == graph.links.tobytes()
    assert place.tolist() == list(range(30))
    empty, place = delete_nodes(graph, list(graph.roots()))
    assert len(empty) == 0 and not (empty.meshes or empty.materials or empty.names)
    assert (place == -1).all() and empty.update() == 0 and empty.shapes() == []
    with pytest.raises(IndexError, match="no node 30 among 30"):
        delete_nodes(graph, [2, 30])


@pytest.mark.feature("scene/delete-nodes")
def test_an_unsorted_selection_with_a_descendant_of_another_deletes_both_subtrees():
    """A search in the unsorted selection would miss some of what is below it."""
    graph = SceneGraph()
    for node in range(7):
        graph.add((node - 1) // 2 if node else -1, name=str(node))
    left, place = delete_nodes(graph, [4, 1])
    assert [left.names[node] for node in range(len(left))] == ["0", "2", "5", "6"]
    assert left.links["level"].tolist() == [0, 1, 2, 2]
    assert place.tolist() == [0, -1, 1, -1, -1, 2, 3]


@pytest.mark.feature("scene/merge-scenes")
def test_three_scenes_hang_below_one_new_root():
    parts = [random_graph(count, seed) for seed, count in enumerate((20, 1, 33))]
    graphs = [graph for graph, _ in parts]
    random = np.random.default_rng(9)
    transforms = [compose(random.normal(size=3), normalize(random.normal(size=4)), (2, 2, 2)) for _ in parts]
    merged, places = merge_graphs(
        graphs, transforms, mesh_counts=(9, 9, 9), material_counts=(9, 9, 9), name="all"
    )
    assert len(merged) == 1 + 20 + 1 + 33
    assert list(merged.roots()) == [0] and merged.names[0] == "all"
    assert list(merged.children(0)) == [
        int(place[root]) for graph, place in zip(graphs, places, strict=True) for root in graph.roots()
    ]
    assert merged.links.tobytes() == rebuilt(merged).links.tobytes()
    merged.update()
    for number, (graph, place) in enumerate(zip(graphs, places, strict=True)):
        graph.update()
        assert np.allclose(merged.world[place], transforms[number] @ graph.world, rtol=1e-13, atol=1e-13)
        assert np.array_equal(merged.links["level"][place], graph.links["level"] + 1)
        for node, target in enumerate(place.tolist()):
            mesh, material = graph.meshes.get(node), graph.materials.get(node)
            assert merged.meshes.get(target) == (None if mesh is None else mesh + 9 * number)
            assert merged.materials.get(target) == (None if material is None else material + 9 * number)
            assert merged.names.get(target) == graph.names.get(node)


@pytest.mark.feature("scene/merge-scenes")
def test_one_scene_merged_without_transform_is_itself_below_a_root():
    graph, _ = random_graph(25, 5)
    merged, [place] = merge_graphs([graph, SceneGraph()])[0], merge_graphs([graph])[1]
    merged.update(), graph.update()
    assert np.array_equal(merged.world[place], graph.world)
    copies, _ = merge_graphs([graph, graph])  # without counts, a grid of copies shares its meshes
    assert sorted(copies.meshes.values()) == sorted(2 * list(graph.meshes.values()))
    assert len(merge_graphs([])[0]) == 1
