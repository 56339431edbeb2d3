"""Things that move: nodes, skins and morph targets at a time, against triangles posed and rasterised in float64."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.settings import Settings
from common.gltf import load_scene
from common.numerics.transforms import pose_looking_at
from common.scene import Animation, AnimationChannel, Deformation, Image, Light, Material
from common.scene.pose import evaluate_pose
from common.view.camera import Perspective, View, framed_view
from tests.support.bounds import snapping
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated
from tests.twins import shading

SIZE = (64, 64)
EXACT = Settings(color_format="rgba32f", background=0.0, default_light=False, tone_curve="none")
UNLIT = Material(unlit=True, double_sided=True)
MATTE = Material(metallic=0.0, roughness=1.0)
SQUARE = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
TIMES = (0.0, 0.3, 1.0, 0.45, 1.7, 0.3)
"""Forwards and backwards, over the end of the clip and back to a time that was there before."""


def rasterise(clip, indices, culled=True):
    """Return depth (H, W) of triangles at clip coordinates (V, 4), where the answer is sure, and its slope per pixel.

    By edge functions in float64 at the middles of pixels; not sure is what lies within 1/100 pixel of an edge.
    """
    width, height = SIZE
    ndc = clip[:, :3] / clip[:, 3:]
    pixels = (ndc[:, :2] + 1) / 2 * SIZE
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    depth, sure = np.zeros((height, width)), np.ones((height, width), bool)
    slope = np.zeros((height, width))
    for triangle in indices.reshape(-1, 3):
        a, b, c = pixels[triangle]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-9 or (
            culled and area > 0
        ):  # rows grow downwards, so a front face turns to the left
            continue
        weights, steps = [], []
        inside = np.ones((height, width), bool)
        for start, end in ((b, c), (c, a), (a, b)):
            edge = (end[0] - start[0]) * (y - start[1]) - (end[1] - start[1]) * (x - start[0])
            distance = edge / np.hypot(*(end - start)) * np.sign(area)
            sure &= np.abs(distance) > 0.01
            inside &= distance > 0
            weights.append(edge / area)
            steps.append(np.array((start[1] - end[1], end[0] - start[0])) / area)
        # Depth is linear over the screen.
        z = sum(w * ndc[corner, 2] for w, corner in zip(weights, triangle, strict=True))
        rise = sum(step * ndc[corner, 2] for step, corner in zip(steps, triangle, strict=True))
        nearer = inside & (z > depth)
        depth, slope = np.where(nearer, z, depth), np.where(nearer, np.abs(rise).sum(), slope)
    return depth, sure, slope


def assert_depth(picture, clip, indices, culled=True, device=None):
    """Hold a depth picture to `rasterise`, and see that the comparison says something."""
    depth, sure, slope = rasterise(clip, indices, culled)
    snap = 0.0 if device is None else snapping(device)
    assert (depth > 0).sum() > 30, "there is something to compare"
    assert sure.mean() > 0.8
    assert np.array_equal((picture > 0)[sure], (depth > 0)[sure])
    off = np.abs(picture - depth)
    assert (off <= 1e-7 + 1e-5 * depth + snap * slope)[sure].all()


def clip_of(view, points):
    """Return (V, 4) clip coordinates of world positions (V, 3)."""
    matrix = view.clip_from_world(SIZE[0] / SIZE[1])
    return points @ matrix[:, :3].T + matrix[:, 3]


def animated(scene, *channels, duration=1.0):
    """Return the scene with one clip of (node, path, times, values) channels."""
    made = tuple(
        AnimationChannel(node, path, np.array(times, np.float64), np.array(values, np.float64), "linear")
        for node, path, times, values in channels
    )
    return replace(scene, animations=[Animation("clip", made, duration)])


def turn(angle, axis=(0.0, 0.0, 1.0)):
    """Return the quaternion xyzw of a rotation."""
    return (*(math.sin(angle / 2) * component for component in axis), math.cos(angle / 2))


def with_trs(scene, count):
    """Return the scene with `count` root nodes of translation, rotation and scale, since matrices cannot move."""
    nodes = nodes_at(*(np.eye(4) for _ in range(count)))
    nodes.has_matrix[:] = False
    return replace(scene, nodes=nodes)


# --- a cube that turns ---

AROUND = View(pose_looking_at((1.6, 2.2, 4.0), (0.0, 0.0, 0.0)), Perspective(math.radians(40.0), 0.1))


def turning_cube(material=MATTE, **more):
    """Return a cube from -1 to 1 that turns about y by one radian a second, each face textured as a whole."""
    scene = with_trs(quad_scene(material, **more), 2)
    faces = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            # The square of `quad_scene` lies in x and y and faces z; its axes become those of the face.
            along, up = np.eye(3)[(axis + 1) % 3] * side, np.eye(3)[(axis + 2) % 3]
            faces.append(np.stack([along, up, np.cross(along, up)], axis=1))
    scene.positions = np.concatenate([np.add(SQUARE, (0, 0, 1)) @ face.T for face in faces]).astype(
        np.float32
    )
    scene.normals = np.concatenate([np.tile(face[:, 2], (4, 1)) for face in faces]).astype(np.float32)
    tangents = np.concatenate([np.tile(face[:, 0], (4, 1)) for face in faces])
    scene.tangents = np.concatenate([tangents, np.ones((24, 1))], axis=1).astype(np.float32)
    scene.uv0 = np.tile(scene.uv0, (6, 1))
    scene.indices = np.concatenate([scene.indices + 4 * face for face in range(6)]).astype(np.uint32)
    scene.meshes["index_count"], scene.meshes["vertex_count"] = 36, 24
    scene.meshes["bounds_min"], scene.meshes["bounds_max"] = -1.0, 1.0
    times = [quarter * math.pi / 2 for quarter in range(5)]
    keys = [turn(time, (0.0, 1.0, 0.0)) for time in times]
    return animated(scene, (0, "rotation", times, keys), duration=times[-1])


@pytest.mark.feature("intro/rotating-cube")
def test_a_cube_turns(chapter):
    """Silhouette and depth by float64 at times forwards and backwards; a full turn is the first picture again."""
    scene = turning_cube(lights=(Light("directional", node=1),))
    corners = scene.positions.astype(np.float64)
    with chapter.open(scene, SIZE, EXACT, outputs={"depth", "color_linear"}) as made:
        for time in (0.0, 0.4, 2.0, 1.1, 5.9):
            c, s = math.cos(time), math.sin(time)
            turned = corners @ np.array([(c, 0, s), (0, 1, 0), (-s, 0, c)]).T
            picture = made.render(AROUND, time).image("depth")
            assert_depth(picture, clip_of(AROUND, turned), scene.indices, device=chapter.device)
        first = made.render(AROUND, 0.0).image("color_linear")
        assert not np.array_equal(made.render(AROUND, math.pi / 4).image("color_linear"), first)
        assert np.array_equal(made.render(AROUND, 2 * math.pi).image("color_linear"), first)


@pytest.mark.variants("vulkan", "without-all")  # its pictures are those of one driver
@pytest.mark.feature("intro/textured-mesh")
@pytest.mark.parametrize(("name", "time"), [("cube", 0.0), ("cube-quarter-turn", math.pi / 2)])
def test_a_textured_mesh_looks_as_it_did(chapter, golden, name, time):
    """At 0 and a quarter turn, against goldens; asked again after another time, the same bits."""
    texels = np.full((4, 4, 4), 255, np.uint8)
    texels[..., :3] = np.random.default_rng(8).integers(30, 226, (4, 4, 3))
    material = replace(MATTE, base_color_texture=texture())
    scene = turning_cube(material, images=(Image("texels", texels),), lights=(Light("directional", node=1),))
    with scene.edit() as edit:
        edit.set_transform(1, rotation=turn(-0.6, (0.6, -0.8, 0.0)))
    settings = Settings(anisotropy=1.0, ambient=0.3)
    with chapter.open(scene, SIZE, settings, outputs={"color", "instance_id"}) as made:
        frame = made.render(AROUND, time)
        picture, ids = frame.image("color"), frame.image("instance_id")
        made.render(AROUND, 1.0)
        assert np.array_equal(made.render(AROUND, time).image("color"), picture)
    facts = {"coverage": float((ids > 0).mean()), "mean": float(picture.mean())}
    golden(name, picture, chapter.device.capabilities, **facts)


# --- a node ---


def turning_square():
    """Return a square that turns a quarter and moves by (0.3, 0.1, -0.4) in a second."""
    scene = with_trs(quad_scene(UNLIT), 1)
    return animated(
        scene,
        (0, "rotation", (0.0, 1.0), (turn(0.0), turn(math.pi / 2))),
        (0, "translation", (0.0, 1.0), ((0, 0, 0), (0.3, 0.1, -0.4))),
        (0, "scale", (0.0, 1.0), ((1, 1, 1), (0.5, 1.0, 1.0))),
    )


def turning_square_at(time):
    u = time % 1.0
    angle = u * math.pi / 2
    c, s = math.cos(angle), math.sin(angle)
    corners = SQUARE * (1 - 0.5 * u, 1, 1) @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)])
    return corners + np.array((0.3, 0.1, -0.4)) * u


@pytest.mark.newest
def test_a_node_is_where_its_keys_put_it(chapter):
    """Closed form: angle, place and scale linear in time, at times that go back and forth."""
    scene, view = turning_square(), facing(ymag=1.6)
    with chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as made:
        for time in TIMES:
            picture = made.render(view, time).image("depth")
            assert_depth(
                picture, clip_of(view, turning_square_at(time)), scene.indices, False, chapter.device
            )


def test_equal_times_are_equal_pictures_whatever_was_between(chapter):
    """And a whole turn of the clip gives the first picture again."""
    scene, view = turning_square(), facing(ymag=1.6)
    seen: dict[float, np.ndarray] = {}
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        for time in (0.0, 0.25, 0.5, 0.25, 0.75, 0.0, 0.5, 0.75):
            picture = made.render(view, time).image("color_linear")
            assert np.array_equal(seen.setdefault(time, picture), picture)
        assert np.array_equal(made.render(view, 1.0).image("color_linear"), seen[0.0])
        assert np.array_equal(made.render(view, 17.25).image("color_linear"), seen[0.25])
    assert len({picture.tobytes() for picture in seen.values()}) == 4


@pytest.mark.newest
def test_a_light_on_a_moving_node_moves(chapter):
    """A lamp swings from x = -1 to 1 above the square: every pixel by the definition, at three times."""
    lamp = Light("point", node=1, intensity=3.0)
    scene = with_trs(quad_scene(MATTE, lights=(lamp,)), 2)
    scene = animated(scene, (1, "translation", (0.0, 1.0), ((-1, 0.2, 0.7), (1, 0.2, 0.7))))
    x = (np.arange(16) + 0.5) / 8 - 1
    x, y = np.meshgrid(x, -x)
    up = np.broadcast_to((0.0, 0.0, 1.0), (16, 16, 3))
    with chapter.open(scene, (16, 16), EXACT, outputs={"color_linear"}) as made:
        for time in (0.0, 0.8, 0.4):
            picture = made.render(facing(), time).image("color_linear")
            to_light = np.stack([2 * time - 1 - x, 0.2 - y, np.full_like(x, 0.7)], axis=-1)
            distance = np.linalg.norm(to_light, axis=-1, keepdims=True)
            brdf = shading.metallic_roughness(
                up, to_light / distance, up, np.ones(3), np.zeros_like(x), np.ones_like(x)
            )
            assert np.allclose(picture, brdf * 3.0 / distance**2, rtol=5e-5)


# --- a skin ---


def bending_square(material=UNLIT, lights=()):
    """Return a square whose upper edge follows a joint that leans back, its lower edge one that stands still."""
    scene = with_trs(quad_scene(material, lights=lights), 3)
    top = (scene.positions[:, 1] > 0).astype(np.float64)
    deformation = Deformation(
        mesh=0,
        node=0,
        joints=np.array([1, 2], np.int32),
        inverse_bind=np.stack([np.eye(4), np.eye(4)]),
        vertex_joints=np.tile(np.array((0, 1, 0, 0), np.int32), (4, 1)),
        vertex_weights=np.stack([1 - top, top, 0 * top, 0 * top], axis=1),
    )
    keys = (turn(0.0, (1, 0, 0)), turn(-math.pi / 3, (1, 0, 0)))
    return animated(replace(scene, deformations=[deformation]), (2, "rotation", (0.0, 1.0), keys))


def bending_square_at(time):
    angle = -(time % 1.0) * math.pi / 3
    corners = SQUARE.copy()
    corners[2:, 1], corners[2:, 2] = math.cos(angle), math.sin(angle)
    return corners


@pytest.mark.newest
def test_a_skin_follows_its_joints(chapter):
    scene, view = bending_square(), facing(distance=3.0, ymag=1.3)
    with chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as made:
        for time in TIMES:
            picture = made.render(view, time).image("depth")
            assert_depth(
                picture, clip_of(view, bending_square_at(time)), scene.indices, False, chapter.device
            )


def test_normals_of_a_skin_turn_with_it(chapter):
    """Both edges follow the leaning joint: a plane tilted by 60 degrees at the end of the clip, lit from ahead."""
    sun = Light("directional", node=1, intensity=math.pi)
    scene = bending_square(MATTE, (sun,))
    scene.deformations[0].vertex_weights[:] = (0.0, 1.0, 0.0, 0.0)
    view = np.array((0.0, 0.0, 1.0))
    with chapter.open(scene, (16, 16), EXACT, outputs={"color_linear"}) as made:
        for time in (0.0, 0.9, 0.5):
            angle = time * math.pi / 3
            normal = np.array((0.0, math.sin(angle), math.cos(angle)))
            expected = shading.metallic_roughness(normal, view, view, np.ones(3), 0.0, 1.0) * math.pi
            centre = made.render(facing(), time).image("color_linear")[8, 8]
            assert np.allclose(centre, expected, rtol=2e-5)


# --- morph targets ---


def morphing_square():
    """Return a square whose right edge is pulled by one target along x and by another towards the eye."""
    scene = with_trs(quad_scene(UNLIT), 1)
    right = (scene.positions[:, :1] > 0).astype(np.float32)
    deformation = Deformation(
        mesh=0,
        node=0,
        morph_positions=np.stack([right * np.float32((0.5, 0, 0)), right * np.float32((0, 0.25, 0.5))]),
    )
    scene.nodes.weights[0] = np.zeros(2)
    scene = replace(scene, deformations=[deformation])
    return animated(scene, (0, "weights", (0.0, 0.5, 1.0), ((0, 0), (1, 0.5), (0, 1))))


def morphing_square_at(time):
    u = time % 1.0
    first, second = np.interp(u, (0, 0.5, 1), (0, 1, 0)), u
    corners = SQUARE.copy()
    corners[1:3] += first * np.array((0.5, 0, 0)) + second * np.array((0, 0.25, 0.5))
    return corners


@pytest.mark.newest
def test_morph_targets_add_up(chapter):
    scene, view = morphing_square(), facing(distance=3.0, ymag=1.7)
    with chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as made:
        for time in TIMES:
            picture = made.render(view, time).image("depth")
            assert_depth(
                picture, clip_of(view, morphing_square_at(time)), scene.indices, False, chapter.device
            )


@pytest.mark.newest
def test_what_moves_is_written_and_what_stands_is_not(chapter):
    """A frame at the time of the last one writes its constants alone; another time, the vertices of the skin too."""
    with chapter.open(bending_square(), SIZE, EXACT) as made:
        still = [made.render(facing(), 0.5).work["bytes_written"] for _ in range(5)][-1]
        assert made.render(facing(), 0.5).work["bytes_written"] == still
        assert made.render(facing(), 0.6).work["bytes_written"] >= still + 4 * 12
        assert made.idle(facing(), 0.6)
        assert not made.idle(facing(), 0.7)


@pytest.mark.newest
def test_poses_in_turns_do_not_overwrite_each_other(chapter):
    """Each slot keeps its own vertices: what one frame wrote is still there when the same time comes again."""
    scene, view = bending_square(), facing(distance=3.0, ymag=1.3)
    with chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as made:
        for time in (0.2, 0.8, 0.2, 0.8, 0.2, 0.2, 0.8):
            picture = made.render(view, time).image("depth")
            assert_depth(
                picture, clip_of(view, bending_square_at(time)), scene.indices, False, chapter.device
            )


def test_renderers_at_different_times_share_a_scene(chapter):
    """Animation is evaluated by each renderer and changes nothing in the scene."""
    scene, view = bending_square(), facing(distance=3.0, ymag=1.3)
    before = scene.positions.copy()
    with (
        chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as a,
        chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as b,
    ):
        frames = [(a.render(view, time), b.render(view, 1.0 - time)) for time in (0.0, 0.25)]
        pictures = [(x.image("depth"), y.image("depth")) for x, y in frames]
    for time, (first, second) in zip((0.0, 0.25), pictures, strict=True):
        assert_depth(first, clip_of(view, bending_square_at(time)), scene.indices, False, chapter.device)
        assert_depth(
            second, clip_of(view, bending_square_at(1.0 - time)), scene.indices, False, chapter.device
        )
    assert np.array_equal(scene.positions, before)


# --- models made elsewhere ---


@pytest.mark.parametrize("name", ["AnimatedCube", "SimpleSkin", "SimpleMorph"])
def test_a_model_moves_as_its_pose_says(chapter, models, name):
    """At three times within its clip: every sure pixel of the depth picture, by float64."""
    scene = load_scene(models / name / f"{name}.gltf")
    view = framed_view(scene, SIZE[0] / SIZE[1])
    duration = max(animation.duration for animation in scene.animations)
    assert duration > 0
    seen = set()
    with chapter.open(scene, SIZE, EXACT, outputs={"depth"}) as made:
        for part in (0.13, 0.62, 0.37):
            pose = evaluate_pose(scene, part * duration)
            (mesh,) = scene.meshes
            corners = scene.positions.astype(np.float64)
            if pose.vertices:
                corners = pose.vertices[0][0].astype(np.float64)
            world = pose.world_from_object[0]
            points = corners @ world[:3, :3].T + world[:3, 3]
            culled = not scene.materials[mesh["material"]].double_sided
            picture = made.render(view, part * duration).image("depth")
            assert_depth(picture, clip_of(view, points), scene.indices, culled, chapter.device)
            seen.add(picture.tobytes())
    assert len(seen) == 3


@pytest.mark.feature("intro/rotating-cube")
def test_the_raster_oracle_sees_a_hundredth_of_a_pixel_and_more():
    """The judge of the tests above: a square of known pixels, and one that is off by a fiftieth of its size."""
    view = facing(ymag=2.0)
    indices = np.array((0, 1, 2, 0, 2, 3))
    depth, sure, _ = rasterise(clip_of(view, SQUARE), indices)
    inside = np.zeros((64, 64), bool)
    inside[16:48, 16:48] = True
    assert np.array_equal((depth > 0)[sure], inside[sure])
    assert (rasterise(clip_of(view, SQUARE[::-1]), indices)[0] == 0).all(), "the back is culled"
    moved = clip_of(view, SQUARE * 1.04 @ translated()[:3, :3])
    with pytest.raises(AssertionError):
        assert_depth(np.where(inside, depth.max(), 0.0), moved, indices)
