"""Lists of draws against what a loop over all instances says: every visible one once, in batches of one state."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from chapters.ch02.scene import packing
from chapters.ch02.scene.draw_lists import COMMAND, build_draw_lists
from chapters.ch02.scene.packing import Variant, material_variant
from chapters.ch02.scene.scene_draws import SceneDrawLists
from common import layouts
from common.numerics.transforms import pose_looking_at
from common.scene import MESH_DTYPE, Image, Instances, Material, Scene
from common.view.camera import Orthographic, View
from tests.support.scenes import nodes_at, quad_scene, texture

KINDS = [
    Material(),
    Material(base_color=(1, 0, 0, 1)),  # drawn like the one before
    Material(base_color_texture=texture()),
    Material(double_sided=True),
    Material(unlit=True),
    Material(alpha_mode="mask"),
    Material(alpha_mode="mask", base_color_texture=texture()),
    Material(alpha_mode="mask", unlit=True, alpha_cutoff=0.1),
    Material(alpha_mode="blend"),
    Material(alpha_mode="blend", double_sided=True),
    Material(alpha_mode="blend", unlit=True, base_color=(0, 0, 1, 0.5)),
]


def random_scene(rng: np.random.Generator) -> Scene:
    """Return a scene of random meshes and instances; some of either draw nothing."""
    materials = [KINDS[i] for i in rng.integers(0, len(KINDS), rng.integers(1, 12))]
    meshes = np.zeros(int(rng.integers(1, 15)), MESH_DTYPE)
    meshes["material"] = rng.integers(0, len(materials), len(meshes))
    meshes["index_count"] = 3 * rng.integers(0, 3, len(meshes))
    meshes["vertex_count"] = 4
    count = int(rng.integers(0, 60))
    instances = Instances(
        node=np.arange(count, dtype=np.int32),
        mesh=rng.integers(0, len(meshes), count).astype(np.int32),
        visible=rng.random(count) < 0.8,
    )
    places = np.tile(np.eye(4), (count, 1, 1))
    places[:, :3, 3] = rng.integers(-3, 4, (count, 3))  # on a grid: some are equally far
    scene = quad_scene(images=(Image("grey", np.full((1, 1, 4), 99, np.uint8)),))
    return replace(
        scene,
        materials=materials,
        meshes=meshes,
        mesh_names=[""] * len(meshes),
        nodes=nodes_at(*places),
        instances=instances,
        indices=np.zeros(6, np.uint32),
    )


class Case:
    """A random scene with random places of meshes, textures and mirrors, and its lists."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.scene = scene = random_scene(rng)
        self.variants = [material_variant(one, scene) for one in scene.materials]
        self.mirrored = rng.random(len(scene.instances)) < 0.3
        self.page_of = rng.integers(0, 3, len(scene.meshes)).astype(np.uint32)
        self.first_index = rng.integers(0, 10_000, len(scene.meshes)).astype(np.uint32)
        self.textures_of = rng.integers(0, 2, len(scene.materials))
        self.lists = build_draw_lists(
            scene, self.variants, self.mirrored, self.page_of, self.first_index, self.textures_of
        )

    def variant(self, instance: int) -> Variant:
        """Return how an instance is drawn."""
        return self.variants[self.scene.meshes["material"][self.scene.instances.mesh[instance]]]

    def state(self, instance: int) -> Any:
        """Return all that must be the same for two instances in one call."""
        mesh = self.scene.instances.mesh[instance]
        material = self.scene.meshes["material"][mesh]
        return (
            self.variant(instance),
            bool(self.mirrored[instance]),
            int(self.page_of[mesh]),
            int(self.textures_of[material]),
        )

    def stated(self, batch: Any) -> Any:
        """Return what a batch says of the same."""
        return self.variants[batch.material], batch.mirrored, batch.page, batch.textures

    def drawn(self) -> list[int]:
        """Return the instances that are to be drawn, in the order of the scene."""
        instances, counts = self.scene.instances, self.scene.meshes["index_count"]
        return [i for i in range(len(instances)) if instances.visible[i] and counts[instances.mesh[i]]]


CASES = range(40)


def assert_batches(case: Case, batches: Any, commands: np.ndarray, first: int) -> None:
    """The batches cover `commands`, number `first` of the list and on, each with one state and as long as it can be."""
    ids = commands["first_instance"].tolist()
    covered = [number for batch in batches for number in range(batch.first, batch.first + batch.count)]
    assert covered == list(range(first, first + len(ids)))
    before = None
    for batch in batches:
        members = ids[batch.first - first : batch.first - first + batch.count]
        assert {case.state(one) for one in members} == {case.stated(batch)}
        triangles = sum(int(case.scene.meshes["index_count"][case.scene.instances.mesh[i]]) for i in members)
        assert batch.triangles * 3 == triangles
        assert case.stated(batch) != before, "two batches that are one"
        before = case.stated(batch)


@pytest.mark.parametrize("seed", CASES)
def test_every_visible_instance_is_drawn_once(seed):
    case = Case(seed)
    commands = case.lists.commands
    ids = commands["first_instance"].tolist()
    assert sorted(ids) == case.drawn()
    mesh = case.scene.instances.mesh[ids]
    assert (commands["index_count"] == case.scene.meshes["index_count"][mesh]).all()
    assert (commands["first_index"] == case.first_index[mesh]).all()
    assert (commands["instance_count"] == 1).all()
    assert not commands["vertex_offset"].any()
    blended = [i for i in case.drawn() if case.variant(i).alpha_mode == "blend"]
    assert case.lists.transparent.tolist() == blended == ids[len(ids) - len(blended) :]


@pytest.mark.parametrize("seed", CASES)
def test_solid_batches_are_as_few_as_there_are_states_and_masked_ones_come_last(seed):
    case = Case(seed)
    solid = len(case.lists.commands) - len(case.lists.transparent)
    commands = case.lists.commands[:solid]
    assert_batches(case, case.lists.solid, commands, 0)
    states = {case.state(one) for one in commands["first_instance"].tolist()}
    assert len(case.lists.solid) == len(states)
    for batch in case.lists.solid:
        ids = commands["first_instance"][batch.first : batch.first + batch.count].tolist()
        assert ids == sorted(ids), "the order of the scene"
    modes = [case.variants[batch.material].alpha_mode for batch in case.lists.solid]
    assert modes == sorted(modes, key=["opaque", "mask"].index)


@pytest.mark.parametrize("seed", CASES)
def test_transparent_batches_follow_any_order(seed):
    case = Case(seed)
    clear = case.lists.transparent
    order = np.random.default_rng(seed).permutation(len(clear))
    commands, batches = case.lists.in_order(order)
    assert commands["first_instance"].tolist() == clear[order].tolist()
    assert_batches(case, batches, commands, len(case.lists.commands) - len(clear))


def test_the_cases_hold_what_they_are_about():
    cases = [Case(seed) for seed in CASES]
    assert any(not one.drawn() for one in cases) and any(len(one.lists.transparent) > 5 for one in cases)
    assert any(max((b.count for b in one.lists.solid), default=0) > 3 for one in cases)
    assert {case.stated(b)[1:] for case in cases for b in case.lists.solid} == {
        (mirrored, page, textures) for mirrored in (False, True) for page in range(3) for textures in (0, 1)
    }


def test_a_solid_batch_is_named_after_a_solid_material():
    """Under a view a transparent material is built as an opaque one is; passes of solid objects know it not."""
    scene = quad_scene(
        materials=(Material(alpha_mode="blend"), Material()),
        matrices=(np.eye(4), np.eye(4)),
        instance_materials=(0, 1),
    )
    alike = [replace(material_variant(one, scene), defines=(("VIEW", 1),)) for one in scene.materials]
    nothing = np.zeros(2, np.int64)
    lists = build_draw_lists(scene, alike, nothing.astype(bool), nothing, nothing, nothing)
    assert [batch.material for batch in lists.solid] == [1]
    assert lists.states[:, 0].tolist() == [0]


# --- which records are written ---


class Written:
    """The scene's data as far as the draws ask for it; keeps what is written."""

    def __init__(self, case: Case) -> None:
        self.variants, self.page_of, self.first_index = case.variants, case.page_of, case.first_index
        self.textures_of = case.textures_of
        scene = case.scene
        scene.origin = np.zeros(3)  # whole numbers stay whole, and what is equally far stays so
        instances = np.zeros(len(scene.instances), layouts.dtype("Instance"))
        instances["bounds_centre"][:, :3] = scene.nodes.matrix[:, :3, 3]
        instances["flags"] = np.where(case.mirrored, layouts.INSTANCE_MIRRORED, 0)
        self.records: Any = SimpleNamespace(instances=instances, revision=1)
        self.lists = {slot: np.zeros(len(instances), COMMAND) for slot in (0, 1)}
        self.writes: list[tuple[int, int, int]] = []

    def binding(self, slot: int) -> int:
        """Return the slot in place of what its draws bind."""
        return slot

    def write_commands(self, slot: int, commands: np.ndarray, first: int = 0) -> int:
        self.lists[slot][first : first + len(commands)] = commands
        self.writes.append((slot, first, len(commands)))
        return int(commands.nbytes)


def looking(x: float, y: float, z: float) -> View:
    """Return a view from a place to the origin."""
    return View(pose_looking_at((x, y, z), (0.0, 0.0, 0.0)), Orthographic(1.0, 0.1, 9.0))


VIEWS = [looking(0, 0, 5), looking(5, 1, 0), looking(-2, 3, -4)]


@pytest.mark.parametrize("seed", range(30))
def test_transparent_objects_are_drawn_from_the_farthest_on(seed):
    """In either slot, from each view, ties in the order of the scene; and what stands in the slot says the same."""
    case = Case(seed)
    data = Written(case)
    draws = SceneDrawLists(case.scene, data)
    for frame, view in enumerate([*VIEWS, VIEWS[0], VIEWS[0]]):
        slot = frame % 2
        draws.prepare(slot, view)
        batches = draws.transparent
        ids = [
            i
            for b in batches
            for i in data.lists[slot]["first_instance"][b.first : b.first + b.count].tolist()
        ]
        depth = packing.view_depth(case.scene.nodes.matrix[:, :3, 3], view.view_from_world())
        assert ids == sorted(case.lists.transparent.tolist(), key=lambda i: (-depth[i], i))
        solid = [
            i for b in draws.solid for i in data.lists[slot]["first_instance"][b.first : b.first + b.count]
        ]
        assert len(solid) == len({*solid}) and sorted([*solid, *ids]) == case.drawn()
        assert draws.visible == case.scene.instances.visible.sum()


def test_records_are_written_when_they_change_and_once_per_slot():
    case = next(
        case for case in map(Case, CASES) if len(case.lists.transparent) > 3 and len(case.lists.solid) > 2
    )
    data = Written(case)
    draws = SceneDrawLists(case.scene, data)
    total, clear = len(case.lists.commands), len(case.lists.transparent)
    every, order = (0, total), (total - clear, clear)

    def written(slot: int, view: View) -> list[tuple[int, int]]:
        data.writes.clear()
        amount = draws.prepare(slot, view)
        assert amount == sum(count for _, _, count in data.writes) * COMMAND.itemsize
        assert all(number == slot for number, _, _ in data.writes)
        return [(first, count) for _, first, count in data.writes]

    assert written(0, VIEWS[0]) == [every, order]
    assert written(1, VIEWS[0]) == [every, order]
    for slot in (0, 1):
        assert written(slot, VIEWS[0]) == [], "nothing changed"
    assert written(0, VIEWS[1]) == [order], "the camera moved"
    assert written(1, VIEWS[1]) == [order]
    assert written(0, VIEWS[1]) == []
    data.records.revision += 1  # objects moved, and none turned into its mirror image
    assert written(1, VIEWS[1]) == [order]
    assert written(0, VIEWS[1]) == [order]
    data.records.instances["flags"] ^= layouts.INSTANCE_MIRRORED
    data.records.revision += 1
    assert written(0, VIEWS[1]) == [every, order], "all are mirrored"
    assert written(1, VIEWS[1]) == [every, order]
    with case.scene.edit() as change:
        change.set_visible(case.drawn()[0], False)
    assert written(0, VIEWS[1])[0] == (0, total - 1), "one less"
    assert written(1, VIEWS[1])[0] == (0, total - 1)
    draws.forget()
    assert len(written(0, VIEWS[1])) == 2, "variants are other ones"


def test_an_opaque_scene_writes_nothing_for_a_camera_that_moves():
    case = next(
        case
        for case in map(Case, range(300))
        if not len(case.lists.transparent) and len(case.lists.solid) > 2
    )
    data = Written(case)
    draws = SceneDrawLists(case.scene, data)
    for slot in (0, 1):
        draws.prepare(slot, VIEWS[0])
    data.writes.clear()
    assert [draws.prepare(frame % 2, view) for frame, view in enumerate(VIEWS)] == [0, 0, 0]
    assert not data.writes
