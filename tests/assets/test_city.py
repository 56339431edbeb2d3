"""The city has exactly the triangles and instances that its size says, and is built as a street is: nothing overlaps.

Geometry is looked at as triangles in the world, by rays against all of them in float64.
"""

from __future__ import annotations

import hashlib
from collections import Counter

import numpy as np
import pytest

from assets import SCENES, locate
from assets.scenes import find, make
from common.errors import UserError
from common.gltf import load_scene
from common.scene.pose import evaluate_pose
from common.view.camera import Orthographic, Perspective, view_of_scene

STREETS = [f"street-{k}" for k in range(1, 17)]
ABOVE = ["roof-1", "roof-2", "bird-1", "bird-2", "plan"]
BUILDINGS = ("house_", "church", "tower_")


def load(size, kept):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STRATA_CACHE", str(kept))
        return load_scene(locate(f"city:{size}"))


@pytest.fixture(scope="module")
def small(kept):
    return load("10K", kept)


@pytest.fixture(scope="module")
def town(kept):
    return load("100K", kept)


def names_drawn(scene):
    """Return the name of the mesh of each instance."""
    return np.array(scene.mesh_names)[scene.instances.mesh]


def unique_triangles(scene):
    return int(scene.meshes["index_count"].sum()) // 3


def world_triangles(scene, wanted):
    """Return (T, 3, 3) triangles in the world, front faces counter-clockwise, of instances where `wanted(k)` holds."""
    world = evaluate_pose(scene, 0.0).world_from_object
    triangles = []
    for k, mesh in enumerate(scene.instances.mesh):
        if not wanted(k):
            continue
        record = scene.meshes[mesh]
        first, count = int(record["first_index"]), int(record["index_count"])
        corners = scene.indices[first : first + count].reshape(-1, 3) + int(record["first_vertex"])
        points = scene.positions[corners].astype(np.float64) @ world[k][:3, :3].T + world[k][:3, 3]
        triangles.append(points[:, ::-1] if np.linalg.det(world[k][:3, :3]) < 0 else points)
    return np.concatenate(triangles)


def front_hits(triangles, eye, direction):
    """Return the distances at which a ray enters triangles through their front, in order (Moeller and Trumbore)."""
    a, b, c = triangles.transpose(1, 0, 2)
    p = np.cross(direction, c - a)
    scale = np.einsum("ij,ij->i", b - a, p)
    facing = scale > 1e-12
    a, b, c, p, scale = a[facing], b[facing], c[facing], p[facing], scale[facing]
    u = np.einsum("ij,ij->i", eye - a, p) / scale
    q = np.cross(eye - a, b - a)
    v, t = q @ direction / scale, np.einsum("ij,ij->i", c - a, q) / scale
    return np.sort(t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6)])


class Located:
    """Triangles with their bounds."""

    def __init__(self, triangles):
        self.triangles = triangles
        self.low, self.high = triangles.min(axis=1), triangles.max(axis=1)

    def around(self, point, half):
        """Return the triangles whose bounds touch a box around a point."""
        touching = (self.low < point + half) & (self.high > point - np.array(half))
        return self.triangles[touching.all(axis=1)]


def solid(scene, k):
    """Return whether an instance has one opaque surface, not the leaves of a tree."""
    material = scene.materials[int(scene.meshes["material"][scene.instances.mesh[k]])]
    return material.alpha_mode == "opaque" and material.name not in ("foliage", "sky")


# --- sizes ---


@pytest.mark.parametrize("size", ["10K", "20K", "57K"])
def test_a_size_is_the_exact_number_of_unique_triangles_with_an_instance_for_each_hundred(size, kept):
    scene, count = load(size, kept), int(size[:-1]) * 1000
    assert unique_triangles(scene) == count
    assert len(scene.instances) == count // 100


def test_the_default_has_a_thousand_instances_of_hundreds_of_meshes(town):
    assert SCENES["city"].default_size == "100K"
    assert unique_triangles(town) == 100_000 and len(town.instances) == 1000
    triangles = town.meshes["index_count"] // 3
    assert len(triangles) > 300
    assert triangles.min() <= 12 and triangles.max() > 3000, "from less than one meshlet to many"
    drawn = Counter(town.instances.mesh.tolist())
    assert max(drawn.values()) >= 20, "furniture is drawn many times"


@pytest.mark.long
def test_a_million_triangles_are_drawn_in_ten_thousand_instances(kept):
    scene = load("1M", kept)
    assert unique_triangles(scene) == 1_000_000 and len(scene.instances) == 10_000
    triangles = scene.meshes["index_count"] // 3
    assert len(triangles) > 2500 and triangles.min() <= 12 and 15_000 < triangles.max() <= 20_000
    assert len(set(digests(scene))) == len(scene.meshes)
    assert [camera.name for camera in scene.cameras] == STREETS + ABOVE
    assert scene.warnings == []


@pytest.mark.long
@pytest.mark.parametrize(
    "thousands", [11, 17, 26, 38, 39, 40, 49, 63, 79, 80, 99, 150, 299, 300, 555, 899, 900, 2000]
)
def test_every_size_can_be_made(thousands):
    """The generator itself asserts that the numbers come out, and that there are places enough."""
    make(SCENES["city"], f"{thousands}K")


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("city", "100K"),
        ("city:1M", "1M"),
        ("city:1000k", "1M"),
        ("city:1.5m", "1500K"),
        ("city:0.25M", "250K"),
    ],
)
def test_each_size_has_one_name(text, size):
    assert find(text) == (SCENES["city"], size)


@pytest.mark.parametrize(
    ("size", "says"),
    [
        ("huge", 'The scene "city" has no size "huge"; write'),
        ("", 'The scene "city" has no size ""; write'),
        ("-1M", 'has no size "-1M"; write'),
        ("1e3K", 'has no size "1e3K"; write'),
        ("medium", 'has no size "medium"; write'),
        ("1000", 'has no size "1000"; write'),
        ("9K", '"city:9K" is too small; write'),
        ("4.001M", '"city:4.001M" is too large; write'),
        ("999999999M", "is too large; write"),
        ("10.0005K", '"city:10.0005K" is no whole number of thousands; write'),
    ],
)
def test_a_wrong_size_is_one_sentence_that_names_the_limits(size, says):
    with pytest.raises(UserError) as caught:
        locate(f"city:{size}")
    assert says in str(caught.value)
    assert str(caught.value).endswith("a number of triangles from 10K to 4M, such as 100K, 10K, 1M.")


def test_it_is_made_twice_the_same():
    one, two = (make(SCENES["city"], "12K") for _ in range(2))
    assert one.blob == two.blob
    assert one.gltf.gltf_to_json() == two.gltf.gltf_to_json()


# --- meshes and materials ---


def digests(scene):
    """Return a hash of everything in each mesh."""
    found = []
    for mesh in scene.meshes:
        vertices = slice(int(mesh["first_vertex"]), int(mesh["first_vertex"]) + int(mesh["vertex_count"]))
        indices = slice(int(mesh["first_index"]), int(mesh["first_index"]) + int(mesh["index_count"]))
        digest = hashlib.sha256(scene.indices[indices].tobytes())
        for array in (scene.positions, scene.normals, scene.uv0, scene.colors):
            digest.update(array[vertices].tobytes())
        found.append(digest.hexdigest())
    return found


def test_no_two_meshes_are_the_same(town):
    assert len(set(digests(town))) == len(town.meshes)


def test_few_materials_of_all_kinds_and_all_of_them_used(town):
    assert 10 <= len(town.materials) <= 24
    used = {int(town.meshes["material"][mesh]) for mesh in town.instances.mesh}
    assert used == set(range(len(town.materials)))
    modes = Counter(material.alpha_mode for material in town.materials)
    assert modes["mask"] >= 2 and modes["blend"] >= 2 and modes["opaque"] >= 10
    assert any(material.double_sided and material.alpha_mode == "opaque" for material in town.materials)
    assert any(max(material.emissive) > 1000 for material in town.materials)
    assert sum(bool(material.textures()) for material in town.materials) >= 10
    assert [light.kind for light in town.lights] == ["directional"], "lamps are meshes, not lights"


def linear_parts(scene):
    return evaluate_pose(scene, 0.0).world_from_object[:, :3, :3]


@pytest.mark.parametrize("name", ["small", "town"])
def test_some_instances_are_mirrored_stretched_and_sheared(name, request):
    linear = linear_parts(request.getfixturevalue(name))
    sizes = np.linalg.svd(linear, compute_uv=False)
    unit = linear / np.linalg.norm(linear, axis=1, keepdims=True)
    lean = np.abs(np.swapaxes(unit, 1, 2) @ unit - np.eye(3)).max(axis=(1, 2))
    assert (np.linalg.det(linear) < 0).sum() >= 2
    assert (sizes[:, 0] > 1.05 * sizes[:, 2]).sum() >= 4
    assert (lean > 0.01).sum() >= 2, "columns that are not at right angles: sheared"


def test_every_building_is_drawn_once(town):
    drawn = Counter(town.instances.mesh.tolist())
    houses = [mesh for mesh, name in enumerate(town.mesh_names) if name.startswith(BUILDINGS)]
    assert len(houses) > 100 and all(drawn[mesh] == 1 for mesh in houses)


# --- views ---


def test_the_first_view_is_at_street_level_and_all_have_names(small):
    assert [camera.name for camera in small.cameras] == STREETS + ABOVE
    pose = evaluate_pose(small, 0.0)
    default = view_of_scene(small, pose, None, 16 / 9)
    assert default == view_of_scene(small, pose, "street-1", 16 / 9)
    for name in STREETS + ABOVE:
        kind = Orthographic if name == "plan" else Perspective
        assert isinstance(view_of_scene(small, pose, name, 16 / 9).projection, kind)


def test_an_unknown_view_is_told_with_all_names(small):
    with pytest.raises(UserError) as caught:
        view_of_scene(small, evaluate_pose(small, 0.0), "nowhere", 16 / 9)
    assert all(f"'{name}'" in str(caught.value) for name in STREETS + ABOVE)


def test_the_plan_shows_the_whole_city_from_above(town):
    view = view_of_scene(town, evaluate_pose(town, 0.0), "plan", 16 / 9)
    assert np.allclose(view.world_from_view[:3, 2], [0, 1, 0], atol=1e-3), "it looks straight down"
    clip = view.clip_from_world(16 / 9)
    ground = world_triangles(town, lambda k: names_drawn(town)[k].startswith(("pavement", "house_")))
    ndc = ground.reshape(-1, 3) @ clip[:3, :3].T + clip[:3, 3]
    assert (np.abs(ndc[:, :2]) < 1).all() and (ndc[:, 2] > 0).all() and (ndc[:, 2] < 1).all()


@pytest.mark.parametrize("name", ["small", "town"])
def test_street_views_stand_on_the_ground_outside_of_buildings(name, request):
    """Below each eye is the ground at 1.7 m, above it no roof, in front of it nothing for 1.2 m.

    The ground ends where buildings stand: an eye in one of them would see no ground below.
    """
    scene = request.getfixturevalue(name)
    pose, drawn = evaluate_pose(scene, 0.0), names_drawn(scene)
    everything = Located(world_triangles(scene, lambda k: drawn[k] != "sky"))
    buildings = Located(world_triangles(scene, lambda k: drawn[k].startswith(BUILDINGS)))
    for street in STREETS:
        view = view_of_scene(scene, pose, street, 16 / 9)
        eye, ahead = view.eye, -view.world_from_view[:3, 2]
        below = front_hits(everything.around(eye, (0.1, 99.0, 0.1)), eye, np.array([0.0, -1.0, 0.0]))
        assert below[0] == pytest.approx(1.7, abs=0.02), street
        above = front_hits(buildings.around(eye, (0.1, 99.0, 0.1)), eye, np.array([0.0, 1.0, 0.0]))
        assert not len(above), street
        near = everything.around(eye, (1.3, 1.3, 1.3))
        assert not len(near) or np.abs(near.reshape(-1, 3) - eye).max(axis=1).min() > 0.3, "in its face"
        hits = front_hits(near, eye, ahead)
        assert not len(hits) or hits[0] > 1.2, street


def test_the_views_from_above_are_over_the_roofs(town):
    pose, drawn = evaluate_pose(town, 0.0), names_drawn(town)
    houses = world_triangles(town, lambda k: drawn[k].startswith(BUILDINGS))
    for name in ABOVE:
        eye = view_of_scene(town, pose, name, 16 / 9).eye
        assert not len(front_hits(houses, eye, np.array([0.0, 1.0, 0.0]))), name
        assert eye[1] > 15, name


# --- faces ---


def test_no_two_surfaces_lie_in_each_other(small):
    """No ray enters two opaque faces at the same distance: which of them is seen would be a matter of rounding."""
    triangles = world_triangles(small, lambda k: solid(small, k))
    pose, rng = evaluate_pose(small, 0.0), np.random.default_rng(5)
    eyes = [view_of_scene(small, pose, name, 16 / 9).eye for name in STREETS + ABOVE[:-1]]
    tested = 0
    for eye in eyes:
        for direction in rng.normal(size=(25, 3)):
            hits = front_hits(triangles, eye, direction / np.linalg.norm(direction))
            tested += len(hits)
            assert (np.diff(hits) > 2e-4).all(), f"from {eye} towards {direction}"
    assert tested > 300


def test_the_ground_has_no_gap_under_a_walker(small):
    """Wherever there is no building, a ray from above ends on exactly one ground surface."""
    drawn = names_drawn(small)
    ground = world_triangles(
        small, lambda k: drawn[k].startswith(("street", "crossing", "pavement", "court", "land"))
    )
    houses = world_triangles(small, lambda k: drawn[k].startswith(BUILDINGS))
    rng, open_places = np.random.default_rng(6), 0
    for x, z in rng.uniform(-1, 1, (250, 2)) * [60.0, 50.0]:
        eye, down = np.array([x, 90.0, z]), np.array([0.0, -1.0, 0.0])
        if len(front_hits(houses, eye, down)):
            continue
        hits = front_hits(ground, eye, down)
        assert len(hits) in (1, 2) and 89.8 < hits[0] < 90.05, (
            x,
            z,
        )  # two where the land goes on below the road
        open_places += 1
    assert open_places > 100
