"""A scene as a graph and back: the same picture, and after edits of the graph the picture that they ask for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import compose, translation
from common.scene.delete import delete_nodes as delete_from_scene
from common.scene.pose import evaluate_pose
from common.scene_graph.edit import delete_nodes, merge_graphs
from common.scene_graph.exchange import graph_of, scene_with
from common.scene_graph.file import load_graph, save_graph
from tests.support.forests import assert_same_drawing, drawn, forest_scene


@pytest.mark.parametrize("in_order", [True, False])
@pytest.mark.parametrize("copies", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_there_and_back_draws_the_same(seed, copies, in_order, tmp_path):
    scene = forest_scene(seed, copies=copies, deforming=True, animated=True, in_order=in_order)
    graph, origins = graph_of(scene)
    graph.update()
    world = evaluate_pose(replace(scene, animations=[]), 0.0).world_from_node
    assert np.array_equal(graph.world[origins.nodes], world)
    assert len(graph.shapes()) == len(scene.instances)
    save_graph(graph, tmp_path / "a")
    back = scene_with(scene, load_graph(tmp_path / "a"), origins)
    for time in (0.0, 0.7):
        assert_same_drawing(drawn(back, time), drawn(scene, time), exact=not copies)
    assert back.instances.visible.tolist() == scene.instances.visible.tolist()
    assert not any(scene.revision.values()) and back.materials is not scene.materials


def test_a_plain_scene_keeps_its_nodes_as_they_are():
    scene = forest_scene(2, animated=True)
    alone = np.unique(scene.instances.node, return_index=True)[1]
    scene = replace(
        scene,
        instances=type(scene.instances)(*(a[alone] for a in (scene.instances.node, scene.instances.mesh))),
    )
    graph, origins = graph_of(scene)
    back = scene_with(scene, graph, origins).nodes
    assert origins.nodes.tolist() == list(range(40))
    assert (back.names, back.extras) == (scene.nodes.names, scene.nodes.extras)
    for field in ("parent", "translation", "rotation", "scale", "has_matrix"):
        assert np.array_equal(getattr(back, field), getattr(scene.nodes, field))


def test_edits_of_the_graph_are_drawn():
    scene = forest_scene(1, animated=True)
    graph, origins = graph_of(scene)
    free = next(node for node in range(5, 40) if node not in set(scene.instances.node.tolist()))
    graph.set_local(free, translation((1, 2, 3)))
    shape = graph.add(free, translation((0, 1, 0)), mesh=3, material=0, name="new")
    other = graph.add(-1, mesh=3, material=3)
    back = scene_with(scene, graph, origins)
    assert back.nodes.names[shape] == "new" and back.nodes.names[other] == f"node {other}"
    found = drawn(back)
    assert len(found) == len(scene.instances) + 2
    assert found[-2][0][1] == "1: material 0" and found[-1][0][1] == "1: material 3"
    assert len(back.meshes) == 6  # mesh 3 with another material
    world = evaluate_pose(back, 0.0).world_from_node
    assert np.array_equal(world[shape], world[free] @ translation((0, 1, 0)))
    assert found[-1][1] and found[-2][1]
    graph.set_local(4, compose((5, 6, 7), (0, 0, 0, 1), (2, 2, 2)))  # a clip drives its translation
    driven = scene_with(scene, graph, origins)
    assert not driven.nodes.has_matrix[4] and np.allclose(driven.nodes.scale[4], 2)


def test_a_mesh_that_deforms_takes_another_material_itself():
    scene = forest_scene(1, deforming=True)
    graph, origins = graph_of(scene)
    graph.materials[int(origins.instances[7])] = 3
    back = scene_with(scene, graph, origins)
    expected = drawn(scene)
    (mesh, *_), *rest = expected[7]
    expected[7] = ((mesh, "1: material 3", 0.5, drawn(back)[7][0][3]), *rest)
    assert_same_drawing(drawn(back), expected)
    assert len(back.meshes) == 5 and scene.meshes["material"][1] == 1


def test_deleting_from_the_graph_is_deleting_from_the_scene():
    scene = forest_scene(4, animated=True)
    chosen = [3, 11, 20]
    graph, origins = graph_of(scene)
    left, place = delete_nodes(graph, origins.nodes[chosen])
    back = scene_with(scene, left, origins.moved(place))
    expected, _ = delete_from_scene(scene, chosen)
    for time in (0.0, 0.7):
        assert_same_drawing(drawn(back, time), drawn(expected, time), exact=True)
    assert back.lights == [
        replace(one, node=int(origins.moved(place).nodes[old.node]))
        for one in expected.lights
        for old in scene.lights
        if old.name == one.name
    ]


def test_a_grid_of_copies_draws_the_scene_as_often():
    scene = forest_scene(0)
    graph, origins = graph_of(scene)
    grid, places = merge_graphs([graph, graph], [np.eye(4), translation((10, 0, 0))])
    back = scene_with(scene, grid, origins.moved(places[0]))
    found, count = drawn(back), len(scene.instances)
    assert_same_drawing(found[:count], drawn(scene))
    moved = sorted((names, world.round(6).tolist()) for (names, _, _, world) in map(plain, found[count:]))
    expected = drawn(scene, 0.0, translation((10, 0, 0)))
    assert moved == sorted((names, world.round(6).tolist()) for (names, _, _, world) in map(plain, expected))


def plain(one: tuple) -> tuple:
    names, *rest = one
    return (str(names), *rest)


def test_what_the_scene_does_not_have_is_refused():
    scene = forest_scene(1, deforming=True)
    graph, origins = graph_of(scene)
    for mesh, material in ((5, 0), (-1, 0), (0, 4)):
        graph, origins = graph_of(scene)
        graph.add(-1, mesh=mesh, material=material)
        with pytest.raises(ValueError, match="no mesh or no material"):
            scene_with(scene, graph, origins)
    graph, origins = graph_of(scene)
    graph.add(-1, mesh=1, material=1)
    with pytest.raises(ValueError, match="mesh 1 deforms, and 2 nodes draw it"):
        scene_with(scene, graph, origins)
