"""The atrium holds everything that a chapter may want to show: forms, materials, lights, cameras, motion.

The committed file is looked at as JSON for what it says, and as a loaded scene for what comes out of it.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from assets import SCENES, locate
from common.gltf import load_scene
from common.scene.pose import evaluate_pose
from common.view.camera import view_of_scene

ROLES = {"base_color", "metallic_roughness", "normal", "occlusion", "emissive"}
EXTENSIONS = {
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_texture_transform",
}


@pytest.fixture(scope="module")
def scene():
    return load_scene(locate("atrium"))


@pytest.fixture(scope="module")
def root():
    return json.loads(SCENES["atrium"].committed().read_text("utf-8"))


def drawn(scene, prefix):
    """Return how often meshes whose name begins so are drawn."""
    return sum(scene.mesh_names[mesh].startswith(prefix) for mesh in scene.instances.mesh)


def materials(scene, **values):
    """Return the names of the materials with these values that something drawn uses."""
    used = {int(scene.meshes["material"][mesh]) for mesh in scene.instances.mesh}
    return {
        scene.materials[k].name
        for k in used
        if all(getattr(scene.materials[k], name) == value for name, value in values.items())
    }


@pytest.mark.parametrize(
    ("form", "times"),
    [("arch_", 30), ("column_", 30), ("banner_crimson", 2), ("orange_tree", 4), ("ivy_", 6), ("pebble", 64)],
)
def test_it_has_its_forms(scene, form, times):
    assert drawn(scene, form) >= times


def test_every_node_has_a_name_of_its_own(scene):
    views = {camera.node for camera in scene.cameras}  # named after what they look at
    names = [name for k, name in enumerate(scene.nodes.names) if k not in views]
    assert all(names)
    assert len(set(names)) == len(names)


def test_its_materials_cover_what_a_frame_can_hold(scene):
    assert "leaves" in materials(scene, alpha_mode="mask", double_sided=True)
    assert {"stained_glass", "water", "lantern_glass"} <= materials(scene, alpha_mode="blend")
    assert any(name.startswith("cloth_") for name in materials(scene, alpha_mode="opaque", double_sided=True))
    assert "sky_backdrop" in materials(scene, unlit=True)
    assert "gold" in materials(scene, metallic=1.0)
    used = [material for material in scene.materials if material.name in materials(scene)]
    assert len(used) == len(scene.materials), "a material that nothing uses"
    assert {role for material in used for role in material.textures()} == ROLES
    assert any(max(material.emissive) > 1000 for material in used), "nits, not a share of white"


def test_masks_cut_and_glass_lets_through(scene):
    """Alpha in the pictures is what the materials need: both sides of a mask's cutoff, glass between 0 and 1."""
    by_name = {material.name: material for material in scene.materials}

    def alpha(name):
        return scene.images[by_name[name].base_color_texture.image].pixels[..., 3] / 255

    for name in ("leaves", "iron_lattice"):
        covered = (alpha(name) >= by_name[name].alpha_cutoff).mean()
        assert 0.1 < covered < 0.9, name
    glass = alpha("stained_glass")
    assert ((glass > 0.2) & (glass < 0.8)).mean() > 0.3
    assert 0.2 < by_name["water"].base_color[3] < 0.8


def test_it_uses_every_part_of_the_texture_model(scene):
    textures = [texture for material in scene.materials for texture in material.textures().values()]
    assert {texture.uv_set for texture in textures} == {0, 1}
    assert any(texture.rotation and texture.scale != (1, 1) for texture in textures)
    assert scene.uv1 is not None and np.ptp(scene.uv1) > 0.5
    assert scene.colors is not None and np.ptp(scene.colors[:, :3]) > 0.5


def test_what_it_asks_of_a_loader_is_optional(root):
    assert set(root["extensionsUsed"]) == EXTENSIONS
    assert not root.get("extensionsRequired")


def test_every_image_is_used_and_no_wider_than_meant(scene, root):
    used = {texture.image for material in scene.materials for texture in material.textures().values()}
    assert used == set(range(len(scene.images)))
    assert len(root["images"]) == len(scene.images)
    assert max(max(image.pixels.shape[:2]) for image in scene.images) <= 512


def test_its_lights_are_of_all_kinds(scene):
    kinds = [light.kind for light in scene.lights]
    assert kinds.count("directional") == 1 and kinds.count("point") >= 8 and kinds.count("spot") == 2
    for light in scene.lights:
        assert np.isfinite(light.range) == (light.kind != "directional"), light.name
        assert light.intensity > 0 and 0 < max(light.color) <= 1
        assert 0 <= light.inner_cone < light.outer_cone < np.pi / 2


def test_the_lanterns_shine_where_their_flames_are(scene):
    """Each point light lies inside the lantern that hangs from the same hook, at all times."""
    lamps = {name: k for k, name in enumerate(scene.nodes.names) if name.endswith("_body")}
    points = [light for light in scene.lights if light.kind == "point"]
    assert len(points) == len(lamps) == 8
    for time in (0.0, 0.7):
        world = evaluate_pose(scene, time).world_from_node
        for light in points:
            body = lamps[light.name.replace("_light", "_body")]
            assert np.linalg.norm(world[light.node][:3, 3] - world[body][:3, 3]) < 0.45
            assert scene.nodes.parent[light.node] == body


def test_it_moves_and_comes_back(scene):
    (clip,) = scene.animations
    assert {channel.path for channel in clip.channels} == {"translation", "rotation"}
    assert {channel.interpolation for channel in clip.channels} == {"linear", "cubic"}
    assert all(abs(channel.times[-1] - clip.duration) < 1e-3 for channel in clip.channels), "all end together"
    start, middle, end = (evaluate_pose(scene, t).world_from_object for t in (0.0, 1.1, clip.duration))
    moved = np.abs(middle - start).max(axis=(1, 2)) > 1e-3
    assert 8 <= moved.sum() <= 40, "some things move, the building stands"
    assert np.abs(end - start).max() < 2e-3


def test_banners_are_ready_to_be_simulated(scene):
    """A banner's vertices are a grid of particles, row by row from the pinned edge, none of them doubled."""
    cloths = {k: e["strata"]["cloth"] for k, e in scene.nodes.extras.items() if "cloth" in e["strata"]}
    assert len(cloths) == 6
    for node, cloth in cloths.items():
        (instance,) = np.flatnonzero(scene.instances.node == node)
        mesh = scene.meshes[scene.instances.mesh[instance]]
        rows, columns = cloth["rows"], cloth["columns"]
        assert mesh["vertex_count"] == rows * columns
        first = int(mesh["first_vertex"])
        points = scene.positions[first : first + rows * columns].reshape(rows, columns, 3)
        assert len(np.unique(points.reshape(-1, 3), axis=0)) == rows * columns
        assert (np.diff(points[..., 0], axis=1) > 0).all(), "from left to right"
        assert (np.diff(points[..., 1], axis=0) < 0).all(), "from top to bottom"
        assert set(cloth["pins"]) <= set(range(columns)) and {0, columns - 1} <= set(cloth["pins"])


@pytest.mark.parametrize(
    "camera", ["overview", "fountain", "gallery", "upper", "banners", "oranges", "portal", "roof"]
)
def test_its_cameras_stand_where_they_see_something(scene, camera):
    """A named camera is within the sky, and has nothing in its face: no vertex within 20 cm of the eye."""
    pose = evaluate_pose(scene, 0.0)
    assert view_of_scene(scene, pose, camera, 16 / 9) is not None
    (node,) = [c.node for c in scene.cameras if c.name == camera]
    eye = pose.world_from_node[node][:3, 3]
    assert np.linalg.norm(eye) < 21 and eye[1] > 1
    mesh = scene.meshes[scene.instances.mesh]
    for record, world in zip(mesh, pose.world_from_object, strict=True):
        first = int(record["first_vertex"])
        points = scene.positions[first : first + int(record["vertex_count"])]
        assert np.linalg.norm(points @ world[:3, :3].T + world[:3, 3] - eye, axis=1).min() > 0.2
    assert {c.name for c in scene.cameras} == {
        "overview", "fountain", "gallery", "upper", "banners", "oranges", "portal", "roof",
    }  # fmt: skip


def test_something_is_drawn_in_every_direction(scene):
    """The sky closes above the meadow: rays from the court that miss the building end on the dome, seen from inside."""
    (sky,) = [k for k, name in enumerate(scene.mesh_names) if name == "sky"]
    mesh = scene.meshes[sky]
    first, start = int(mesh["first_vertex"]), int(mesh["first_index"])
    corners = scene.indices[start : start + int(mesh["index_count"])].reshape(-1, 3) + first
    a, b, c = (scene.positions[corners[:, k]].astype(np.float64) for k in range(3))
    rng = np.random.default_rng(3)
    eye = np.array([0.3, 2.0, -0.2])
    for direction in rng.normal(size=(200, 3)):
        direction[1] = abs(direction[1])
        # Moeller-Trumbore against all triangles.
        p = np.cross(direction, c - a)
        scale = np.einsum("ij,ij->i", b - a, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = np.einsum("ij,ij->i", eye - a, p) / scale
            q = np.cross(eye - a, b - a)
            v = q @ direction / scale
            t = np.einsum("ij,ij->i", c - a, q) / scale
        hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0)
        assert hit.any()
        assert (scale[hit] > 0).all(), "counter-clockwise seen from inside"


def test_uv_and_tangents_fit_the_surface(scene):
    """Tangents of textured meshes are unit vectors in the surface; the handedness is a sign."""
    assert set(np.unique(scene.tangents[:, 3])) <= {-1.0, 1.0}
    assert np.allclose(np.linalg.norm(scene.tangents[:, :3], axis=1), 1, atol=1e-3)
    lean = np.abs(np.einsum("ij,ij->i", scene.tangents[:, :3], scene.normals))
    assert np.quantile(lean, 0.999) < 1e-2


def test_triangles_face_the_way_their_normals_point(scene):
    """Seen from the side that the normals name, corners run counter-clockwise; no triangle is without area."""
    for name, mesh in zip(scene.mesh_names, scene.meshes, strict=True):
        first, start = int(mesh["first_vertex"]), int(mesh["first_index"])
        corners = scene.indices[start : start + int(mesh["index_count"])].reshape(-1, 3) + first
        a, b, c = (scene.positions[corners[:, k]].astype(np.float64) for k in range(3))
        facing = np.cross(b - a, c - a)
        assert (np.linalg.norm(facing, axis=1) > 1e-9).all(), name
        normal = scene.normals[corners].sum(axis=1)
        assert (np.einsum("ij,ij->i", facing, normal) > 0).mean() > 0.99, name
