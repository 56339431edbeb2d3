"""The array scene graph against a tree of objects, a walk along the tail, and exact numbers."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from common.numerics.transforms import compose, normalize
from common.scene.ancestry import Ancestry
from common.scene.tree import Response, show_tree, tree_entries
from common.scene_graph import SceneGraph, Shape, graph_from_arrays
from common.scene_graph.objects import ObjectNode


def random_parents(count: int, seed: int, roots: float = 0.05) -> np.ndarray:
    """Return (N,) parents before their children; every seed prefers another shape, from chains to stars."""
    random = np.random.default_rng(seed)
    near = random.random() ** 2
    steps = np.arange(count)
    back = 1 + (random.random(count) ** (1 / (near + 0.05)) * steps).astype(int)
    parent = np.maximum(steps - back, -1)
    parent[random.random(count) < roots] = -1
    parent[:1] = -1
    return parent.astype(np.int32)


def random_locals(count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return compose(
        random.normal(size=(count, 3)),
        normalize(random.normal(size=(count, 4))),
        random.uniform(0.5, 1.5, (count, 3)),
    )


def grown(parent: np.ndarray, local: np.ndarray) -> SceneGraph:
    graph = SceneGraph()
    for above, matrix in zip(parent.tolist(), local, strict=True):
        graph.add(above, matrix)
    return graph


def objects(parent: np.ndarray, local: np.ndarray) -> list[ObjectNode]:
    """Return the same tree as objects, by number."""
    made = [ObjectNode(matrix.copy()) for matrix in local]
    for child, above in zip(made, parent.tolist(), strict=True):
        if above >= 0:
            made[above].add(child)
    return made


def object_worlds(made: list[ObjectNode], parent: np.ndarray) -> np.ndarray:
    for node, above in zip(made, parent.tolist(), strict=True):
        if above < 0:
            node.update()
    return np.array([node.world for node in made])


@pytest.mark.feature("scene/object-graph-baseline")
@pytest.mark.parametrize("seed", range(6))
def test_objects_and_arrays_give_the_same_world_matrices(seed):
    parent, local = random_parents(150, seed), random_locals(150, seed)
    graph = grown(parent, local)
    graph.update()
    assert np.array_equal(graph.world, object_worlds(objects(parent, local), parent))


def whole_numbers(count: int, seed: int) -> list[list[list[int]]]:
    """Return affine matrices of whole numbers: signed permutations and offsets, whose products stay whole and exact."""
    random = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        turn = np.eye(3, dtype=int)[random.permutation(3)] * random.choice([-1, 1], 3)[:, None]
        offset = random.integers(-1000, 1000, (3, 1))
        made.append([*np.concatenate([turn, offset], axis=1).tolist(), [0, 0, 0, 1]])
    return made


def product(a: list[list[int]], b: list[list[int]]) -> list[list[int]]:
    return [[sum(row[k] * b[k][j] for k in range(4)) for j in range(4)] for row in a]


def walked_up(node: int, parent: np.ndarray, local: list[list[list[int]]]) -> list[list[int]]:
    """Return the product of what stands on the way from a node up to its root, in Python's integers."""
    world = local[node]
    while (node := int(parent[node])) >= 0:
        world = product(local[node], world)
    return world


@pytest.mark.feature("scene/object-graph-baseline")
@pytest.mark.feature("scene/transform-update")
@pytest.mark.parametrize("seed", range(4))
def test_objects_and_arrays_are_where_whole_numbers_say(seed):
    """Neither path is believed: both must give the integers that a walk upwards multiplies, to the last bit."""
    parent, local = random_parents(100, seed), whole_numbers(100, seed)
    matrices = np.array(local, np.float64)
    graph = grown(parent, matrices)
    graph.update()
    truth = np.array([walked_up(node, parent, local) for node in range(100)], np.float64)
    assert np.array_equal(graph.world, truth)
    assert np.array_equal(object_worlds(objects(parent, matrices), parent), truth)
    edited = seed + 3
    local[edited] = whole_numbers(1, 99)[0]
    graph.set_local(edited, np.array(local[edited], np.float64))
    graph.update()
    again = np.array([walked_up(node, parent, local) for node in range(100)], np.float64)
    assert np.array_equal(graph.world, again) and not np.array_equal(again, truth)


@pytest.mark.feature("scene/object-graph-baseline")
def test_products_the_other_way_round_are_another_tree():
    """What the test above would see: a node that is multiplied from the wrong side, by either path."""
    parent, local = random_parents(100, 1), whole_numbers(100, 1)
    worlds, wrong = object_worlds(objects(parent, np.array(local, np.float64)), parent), []
    for matrix, above in zip(local, parent.tolist(), strict=True):
        wrong.append(matrix if above < 0 else product(matrix, wrong[above]))
    assert (worlds != np.array(wrong)).any(axis=(1, 2)).sum() > 50


@pytest.mark.feature("scene/transform-update")
def test_what_nobody_marked_keeps_its_old_place_until_it_is_marked():
    parent, local = random_parents(60, 3), whole_numbers(60, 3)
    graph = grown(parent, np.array(local, np.float64))
    graph.update()
    before = graph.world.copy()
    node = next(one for one in range(60) if parent[one] >= 0 and one in parent)
    local[node] = whole_numbers(1, 98)[0]
    graph.local[node] = local[node]
    assert graph.update() == 0 and np.array_equal(graph.world, before)
    graph.mark([node])
    assert graph.update() > 1
    truth = [walked_up(one, parent, local) for one in range(60)]
    assert np.array_equal(graph.world, truth) and not np.array_equal(before, truth)


@pytest.mark.feature("scene/array-graph")
@pytest.mark.parametrize("seed", range(6))
def test_links_are_those_of_a_walk_to_the_tail(seed):
    """The oracle walks along the siblings for every insertion and keeps no cache."""
    parent = random_parents(120, seed)
    first, following, children = {}, {}, {}
    for node, above in enumerate(parent.tolist()):
        children.setdefault(above, []).append(node)
        if above not in first:
            first[above] = node
            continue
        tail = first[above]
        while tail in following:
            tail = following[tail]
        following[tail] = node
    graph = grown(parent, random_locals(120, seed))
    depth = []
    for node, above in enumerate(parent.tolist()):
        depth.append(0 if above < 0 else depth[above] + 1)
        assert list(graph.children(node)) == children.get(node, [])
        last = children[above][-1] if children[above][0] == node else -1
        assert graph.links[node].tolist() == (
            above,
            first.get(node, -1),
            following.get(node, -1),
            last,
            depth[node],
        )
    assert list(graph.roots()) == children[-1]
    assert graph.links.tobytes() == graph_from_arrays(parent, graph.local).links.tobytes()


@pytest.mark.feature("scene/array-graph")
def test_children_cost_one_step_each_however_many_there_are():
    """Counts what is read and written of the links: k children take k times what one takes."""

    class Counted(np.ndarray):
        touched = 0

        def __getitem__(self, key):
            Counted.touched += 1
            return super().__getitem__(key)

        def __setitem__(self, key, value):
            Counted.touched += 1
            super().__setitem__(key, value)

    def steps(count: int) -> int:
        graph = SceneGraph()
        graph.add()
        graph._grow(count + 1)
        graph._links = graph._links.view(Counted)
        graph.add(0)
        Counted.touched = 0
        for _ in range(count - 1):
            graph.add(0)
        return Counted.touched

    assert steps(201) == 2 * steps(101) > 0


@pytest.mark.feature("scene/array-graph")
def test_a_parent_must_be_there():
    graph = SceneGraph()
    graph.add()
    for parent in (1, -2):
        with pytest.raises(IndexError, match=f"node {parent} cannot be a parent"):
            graph.add(parent)
    with pytest.raises(ValueError, match="smaller number"):
        graph_from_arrays([-1, 2, 0], np.tile(np.eye(4), (3, 1, 1)))
    for nodes in ([1], [-1]):
        with pytest.raises(IndexError, match=f"no node {nodes[0]} among 1"):
            graph.mark(nodes)
    with pytest.raises(IndexError):
        graph.set_local(-1, np.eye(4))


@pytest.mark.feature("scene/transform-update")
@pytest.mark.parametrize("seed", range(8))
def test_an_update_computes_what_was_marked_and_nothing_else(seed):
    """Random edits and insertions; the oracle is the tree of objects and a walk that colours subtrees."""
    random = np.random.default_rng(seed)
    parent, local = random_parents(80, seed), random_locals(80, seed)
    graph = grown(parent, local)
    assert graph.update() == (parent >= 0).sum()
    for _ in range(12):
        if random.random() < 0.3:
            above = int(random.integers(-1, len(graph)))
            parent = np.append(parent, above).astype(np.int32)
            local = np.concatenate([local, random_locals(1, int(random.integers(1000)))])
            marked = {graph.add(above, local[-1])}
        else:
            marked = set()
        for node in random.integers(0, len(graph), random.integers(0, 4)):
            local[node] = random_locals(1, int(random.integers(1000)))[0]
            graph.set_local(int(node), local[node])
            graph.mark([node, node])
            marked.add(int(node))
        below = []
        for node, above in enumerate(parent.tolist()):
            below.append(node in marked or (above >= 0 and below[above]))
        stale = np.flatnonzero(~np.array(below))
        graph.local[stale] = np.nan  # would be seen if it were used
        assert graph.update() == (np.array(below) & (parent >= 0)).sum()
        graph.local[stale] = local[stale]
        assert np.array_equal(graph.world, object_worlds(objects(parent, local), parent))
        before = graph.world.copy()
        assert graph.update() == 0
        assert graph.world.tobytes() == before.tobytes()


@pytest.mark.feature("scene/transform-update")
def test_a_lone_node_of_level_three_is_found_though_the_levels_above_have_no_marks():
    graph = SceneGraph()
    node = -1
    for _ in range(5):
        node = graph.add(node)
    other = graph.add()
    graph.update()
    graph.set_local(3, 2 * np.eye(4))
    assert graph.links["level"][3] == 3
    assert graph.update() == 2
    assert graph.world[:, 0, 0].tolist() == [1, 1, 1, 2, 2, 1]
    graph.set_local(other, 3 * np.eye(4))  # a root is copied
    assert graph.update() == 0
    assert graph.world[other, 0, 0] == 3


@pytest.mark.parametrize("scale", [1.0, 1e5])
def test_a_chain_of_a_thousand_nodes_stays_exact(scale):
    """Against integers of 300 binary places: 1e-6 of the scene's size is asked for, float64 gives 1e-12."""
    count = 1000
    random = np.random.default_rng(1)
    local = compose(
        scale * random.normal(size=(count, 3)), normalize(random.normal(size=(count, 4))), np.ones((count, 3))
    )
    graph = graph_from_arrays(np.arange(-1, count - 1), local)
    assert graph.update() == count - 1
    one = 2**300
    exact = [[one * (row == column) for column in range(4)] for row in range(3)]
    worlds = []
    for matrix in local:
        last = [[int(Fraction(value) * one) for value in row] for row in matrix.tolist()]
        exact = [[sum(row[k] * last[k][j] for k in range(4)) // one for j in range(4)] for row in exact]
        worlds.append([[value / one for value in row] for row in exact])
    truth = np.array(worlds)
    size = np.ptp(truth[:, :, 3], axis=0).max()
    assert np.abs(graph.world[:, :3, 3] - truth[:, :, 3]).max() < 1e-12 * size
    assert np.abs(graph.world[:, :3, :3] - truth[:, :, :3]).max() < 1e-12


@pytest.mark.feature("scene/shape-list")
@pytest.mark.feature("scene/components")
def test_shapes_are_the_nodes_with_mesh_and_material_in_the_order_of_nodes():
    graph = SceneGraph()
    for _ in range(6):
        graph.add()
    for node in (5, 1, 4, 0):
        graph.meshes[node] = 10 + node
    for node in (4, 2, 5, 0):
        graph.materials[node] = 20 + node
    assert graph.shapes() == [Shape(0, 10, 20), Shape(4, 14, 24), Shape(5, 15, 25)]
    assert not {1, 2, 3} & {shape.node for shape in graph.shapes()}, "a mesh or a material alone is no shape"
    other = SceneGraph()
    for node in range(6):
        mesh, material = graph.meshes.get(node), graph.materials.get(node)
        other.add(mesh=mesh, material=material)
    assert other.shapes() == graph.shapes()


@pytest.mark.parametrize("seed", range(8))
def test_subtrees_and_order_are_those_of_a_recursive_walk(seed):
    """Also for parents behind their children, which no graph has but a scene may."""
    random = np.random.default_rng(seed)
    parent = random_parents(60, seed)
    shuffled = random.permutation(60)
    moved = np.empty(60, np.int32)
    moved[shuffled] = np.where(parent < 0, -1, shuffled[parent])

    def walk(node: int) -> list[int]:
        return [node, *(found for child in np.flatnonzero(moved == node) for found in walk(int(child)))]

    ancestry = Ancestry(moved)
    roots = np.flatnonzero(moved < 0)
    assert ancestry.order.tolist() == [found for root in roots for found in walk(int(root))]
    assert ancestry.sizes.tolist() == [len(walk(node)) for node in range(60)]
    chosen = random.integers(0, 60, 5)
    expected = set().union(*(walk(int(node)) for node in chosen))
    found = ancestry.subtrees(chosen).tolist()
    assert len(found) == len(expected) and set(found) == expected
    assert len(ancestry.subtrees([])) == 0 and ancestry.levels_below([]) == []


@pytest.mark.feature("scene/tree-inspector")
@pytest.mark.parametrize("seed", range(4))
def test_the_tree_has_one_entry_for_each_node_and_tells_which_was_chosen(seed):
    parent = random_parents(50, seed)
    made = objects(parent, random_locals(50, seed))
    numbers = {id(node): number for number, node in enumerate(made)}
    expected = []

    def walk(node: ObjectNode, depth: int) -> None:
        number = numbers[id(node)]
        label = "lamp" if number == 7 else f"node {number}"
        expected.append((number, label, depth, not node.children))
        for child in node.children:
            walk(child, depth + 1)

    for root in np.flatnonzero(parent < 0):
        walk(made[root], 0)
    ancestry, names = Ancestry(parent), {7: "lamp"}
    assert list(tree_entries(ancestry, names)) == expected
    rows = []
    chosen = show_tree(ancestry, names, lambda entry: rows.append(entry) or Response(chosen=entry.node == 33))
    assert rows == expected and chosen == 33
    assert show_tree(ancestry, [""] * 50, lambda entry: Response()) is None


@pytest.mark.feature("scene/tree-inspector")
def test_a_folded_branch_hides_what_is_below_it():
    graph = SceneGraph()
    root = graph.add(name="house")
    floor = graph.add(root, name="floor")
    graph.add(floor, name="table")
    graph.add(root, name="roof")
    shown = []

    def row(entry) -> Response:
        shown.append(entry.label)
        return Response(unfolded=entry.node != floor)

    show_tree(graph.ancestry, graph.names, row)
    assert shown == ["house", "floor", "roof"]


def test_a_tree_as_deep_as_no_recursion_goes_is_shown():
    graph = graph_from_arrays(np.arange(-1, 4999), np.tile(np.eye(4), (5000, 1, 1)))
    assert [entry.depth for entry in tree_entries(graph.ancestry, {})] == list(range(5000))
