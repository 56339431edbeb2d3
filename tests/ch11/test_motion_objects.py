"""Motion vectors of objects: rigid, skinned and morphed ones and cloth, against the same rays in float64."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch11.motion import model
from chapters.ch11.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import Animation, AnimationChannel, Deformation, Material
from common.view.camera import Orthographic, Perspective, View
from tests.support.cloth_runs import VIEW as CLOTH_VIEW
from tests.support.cloth_runs import state
from tests.support.cloth_scenes import cloth, cloth_scene_of, sheet
from tests.support.culled_frames import ways
from tests.support.motion import LOOSE_PX, SIZE, assert_close, motions, triangles_of
from tests.support.scenes import moved, nodes_at, quad_scene, scaled
from tests.support.shadows import bending, bent, yard
from tests.support.towns import KINDS, ball, cube, of_shapes
from tests.twins import motion as twin
from tests.twins.motion import HALF

pytestmark = pytest.mark.variants("vulkan", "gl")

WIDE, FLAT = Perspective(math.radians(60), 0.1), Orthographic(2.5, 0.1, 40.0)
VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.8, 0.0)), WIDE)
ASIDE = View(pose_looking_at((2.9, 2.4, 4.1), (0.1, 0.8, 0.0)), WIDE)
FRONT = View(pose_looking_at((0.4, 0.3, 4.0), (0.0, 0.1, 0.0)), WIDE)
FRONT_ASIDE = View(pose_looking_at((0.5, 0.2, 3.9), (0.1, 0.1, 0.0)), WIDE)
BESIDE = View(pose_looking_at((0.3, -0.3, 2.2), (4.6, -0.3, -0.5)), Perspective(math.radians(50), 0.1))
"""The eye of CLOTH_VIEW, turned until the cloth is out of view."""
UNLIT = Material(unlit=True, double_sided=True)
CUBE = range(1, 7)
"""The nodes of the yard's cube."""

PATHS = {
    "forward": {"graph": "forward"},
    "compute": {"graph": "compute"},
    "visibility": {"graph": "deferred", "surfaces": "visibility"},
    "prepass": {"graph": "deferred", "depth_prepass": True},
    "samples": {"msaa": 4},
    "uncut": {"culling": "off", "geometry": "classic"},
    "frustum": {"culling": "frustum", "geometry": "compute"},
    "occlusion": {"culling": "occlusion", "geometry": "compute"},
}
SAMPLE = ("forward", "visibility", "samples", "occlusion")


def turned(angle: float, shift=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the matrix of a turn about a slanted axis through (0, 1, 0), and of a shift behind it."""
    axis = np.array((1.0, 2.0, 0.5)) / math.sqrt(5.25)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    pivot = np.array((0.0, 1.0, 0.0))
    matrix[:3, 3] = pivot - matrix[:3, :3] @ pivot + shift
    return matrix


def move(scene, motion, nodes=CUBE):
    """Move nodes, of which none is below another one, by a matrix."""
    with scene.edit() as edit:
        for node in nodes:
            edit.set_transform(node, matrix=motion @ scene.nodes.matrix[node])


# --- rigid objects ---


@pytest.mark.variants("vulkan", "without-all", "gl")
@pytest.mark.feature("motion-vectors/objects", "motion-vectors/camera")
@pytest.mark.parametrize("view", [VIEW, ASIDE], ids=["still", "walking"])
@pytest.mark.parametrize("lens", [WIDE, FLAT], ids=["perspective", "orthographic"])
def test_a_cube_that_moves_and_turns(chapter, view, lens):
    """The world of both frames, then a frame in which the cube has stopped: zero again, or the camera's motion."""
    scene, before, view = yard(material=UNLIT), replace(VIEW, projection=lens), replace(view, projection=lens)
    with chapter.open(scene, SIZE, outputs={"motion"}) as renderer:
        renderer.render(before)
        then = triangles_of(scene)
        move(scene, turned(0.15, (0.1, 0.05, -0.08)))
        now = triangles_of(scene)
        frame = renderer.render(view)
        seen, work = frame.image("motion"), frame.work
        # A GPU puts corners on a grid of 1/256 pixel: a face that is seen from the side has other vectors nearby.
        loose = LOOSE_PX if chapter.device.capabilities.is_software else 0.2
        assert_close(seen, *twin.motion(view, before, SIZE, now, then), loose=loose)
        with pytest.raises(AssertionError):  # the present model matrix leaves the motion of the camera alone
            assert_close(seen, *twin.motion(view, before, SIZE, now, now))
        assert work["motion_objects"] == len(CUBE)
        frame = renderer.render(view)
        assert frame.work["motion_objects"] == 0
        assert not frame.image("motion").view(np.uint32).any()
        assert not renderer.render(view).image("motion").view(np.uint32).any()


@pytest.mark.feature("motion-vectors/objects")
def test_a_reset_a_cut_and_a_resize_have_no_frame_before(chapter):
    scene = yard(material=UNLIT)
    with chapter.open(scene, SIZE, outputs={"motion"}) as renderer:
        assert not renderer.render(VIEW).image("motion").any()
        for step, begin in enumerate(
            (lambda: renderer.reset_history("a test"), lambda: renderer.resize((40, 30)))
        ):
            move(scene, turned(0.1))
            begin()
            frame = renderer.render((VIEW, ASIDE)[step])
            assert not frame.image("motion").view(np.uint32).any() and frame.work["motion_objects"] == 0
        move(scene, turned(0.1))
        assert not renderer.render(replace(VIEW, cut=True)).image("motion").view(np.uint32).any()
        move(scene, turned(0.1))
        assert renderer.render(VIEW).image("motion").any()


@pytest.mark.feature("motion-vectors/objects")
def test_where_the_point_was_behind_the_camera_the_vector_leaves_the_picture(chapter):
    """The cube jumps through the camera; what was behind it has a finite vector from outside of the picture."""
    scene = yard(material=UNLIT)
    with chapter.open(scene, SIZE, outputs={"motion", "instance_id"}) as renderer:
        behind = np.array(VIEW.world_from_view[:3, 2]) * 3 + VIEW.world_from_view[:3, 3] - (0.0, 1.0, 0.0)
        move(scene, turned(0.0, tuple(behind)))
        renderer.render(VIEW)
        move(scene, turned(0.0, tuple(-behind)))
        frame = renderer.render(VIEW)
        seen, cube = frame.image("motion"), frame.image("instance_id") >= 2
    assert cube.sum() > 50 and not seen[~cube].any()
    assert (seen[cube] == model.FARTHEST).all()
    view = View(pose_looking_at((3.0, 2.5, 4.0), (6.0, 4.2, 8.0)), WIDE)  # the camera turns round
    for vectors in motions(chapter, yard(material=UNLIT), [view, VIEW])[1:]:
        assert np.isfinite(vectors).all() and (np.abs(vectors).max(axis=-1) > 1).mean() > 0.9


@pytest.mark.feature("motion-vectors/objects", "motion-vectors/camera")
@pytest.mark.parametrize(
    "way", [("moved", (1e5, -1e5, 1e5)), ("scaled", 1e-3), ("scaled", 1e3)], ids=["moved", "small", "large"]
)
def test_in_a_world_far_away_or_of_another_size(chapter, way):
    name, by = way
    change = {"moved": moved, "scaled": scaled}[name]
    base = yard(material=UNLIT)
    _, before = change(base, VIEW, by)
    scene, view = change(base, ASIDE, by)
    placed = np.diag((by, by, by, 1.0)) if name == "scaled" else np.eye(4)
    if name == "moved":
        placed[:3, 3] = by
    with chapter.open(scene, SIZE, outputs={"motion"}) as renderer:
        renderer.render(before)
        then = triangles_of(scene)
        move(scene, turned(0.1, (0.1, 0.0, 0.05)))  # below the node that has moved or scaled the world
        now = triangles_of(scene)
        seen = renderer.render(view).image("motion")
        # Beside the world's origin the twin has all digits, too.
        back = np.linalg.inv(placed)
        corners = [points @ back[:3, :3].T + back[:3, 3] for points in (now, then)]
        assert_close(seen, *twin.motion(ASIDE, VIEW, SIZE, *corners))
        assert renderer.render(view).image("motion").any() == 0


# --- deforming meshes ---


def leaning():
    """Return the square that bends, without lights."""
    return replace(bending(), lights=[], materials=[UNLIT])


def bent_between(view, before, now, then):
    return twin.motion(view, before, SIZE, bent(now), bent(then))


@pytest.mark.variants("vulkan", "without-all", "gl")
@pytest.mark.feature("motion-vectors/objects")
def test_a_skin_that_bends(chapter):
    """Each frame knows the vertices of the one before; at the same time again, zero to the bit."""
    times = [0.0, 0.1, 0.25, 0.25, 0.25, 0.4, 0.45]
    views = [FRONT, FRONT, FRONT_ASIDE, FRONT_ASIDE, FRONT_ASIDE, FRONT, FRONT]
    seen = motions(chapter, leaning(), views, times)
    for k in range(1, len(times)):
        if (views[k], times[k]) == (views[k - 1], times[k - 1]):
            assert not seen[k].view(np.uint32).any()
        else:
            assert_close(seen[k], *bent_between(views[k], views[k - 1], times[k], times[k - 1]))


@pytest.mark.feature("motion-vectors/objects")
def test_a_skin_after_a_reset(chapter):
    with chapter.open(leaning(), SIZE, outputs={"motion"}) as renderer:
        for time in (0.0, 0.1, 0.2):
            renderer.render(FRONT, time)
        renderer.reset_history("a test")
        assert not renderer.render(FRONT, 0.4).image("motion").view(np.uint32).any()
        seen = renderer.render(FRONT, 0.5).image("motion")
        assert_close(seen, *bent_between(FRONT, FRONT, 0.5, 0.4))
        assert not renderer.render(FRONT, 0.1).image("motion").any(), "time runs backwards: a cut"


def morphing():
    """Return a square whose right edge is pulled along x by one target and towards the eye by another."""
    scene = quad_scene(UNLIT)
    right = (scene.positions[:, :1] > 0).astype(np.float32)
    targets = np.stack([right * np.float32((0.5, 0, 0)), right * np.float32((0, 0.25, 0.5))])
    nodes = nodes_at(np.eye(4))
    nodes.has_matrix[:] = False
    nodes.weights[0] = np.zeros(2)
    channel = AnimationChannel(
        0, "weights", np.array((0.0, 1.0)), np.array([(0, 0), (1, 0.5)], np.float64), "linear"
    )
    return replace(
        scene,
        nodes=nodes,
        deformations=[Deformation(mesh=0, node=0, morph_positions=targets)],
        animations=[Animation("pull", (channel,), 1.0)],
    )


def morphed(time):
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float64)
    corners[1:3] += np.array((0.5, 0, 0)) * time + np.array((0, 0.25, 0.5)) * time / 2
    return corners[[0, 1, 2, 0, 2, 3]].reshape(2, 3, 3)


@pytest.mark.feature("motion-vectors/objects")
def test_morph_targets(chapter):
    times = (0.0, 0.2, 0.5, 0.5)
    seen = motions(chapter, morphing(), [FRONT] * 4, times)
    for k in (1, 2):
        assert_close(seen[k], *twin.motion(FRONT, FRONT, SIZE, morphed(times[k]), morphed(times[k - 1])))
    assert not seen[3].view(np.uint32).any()


@pytest.mark.feature("motion-vectors/objects")
@pytest.mark.parametrize("execution", ["group", "dispatch"])
def test_cloth_that_falls(chapter, execution):
    """Vertices are the particles, which the test reads back after each frame."""
    scene = cloth_scene_of(cloth(pins=(0,)), light=False, material=UNLIT)
    _, triangles = sheet(5, 5)
    settings = Settings(cloth_step=1 / 60, cloth_execution=execution)
    times = [k / 60 for k in range(4)] + [3 / 60, 3 / 60]
    with chapter.open(scene, SIZE, settings, outputs={"motion"}) as renderer:
        then = None
        for k, time in enumerate(times):
            seen = renderer.render(CLOTH_VIEW, time).image("motion")
            now = state(renderer).astype(np.float64)[triangles]
            if k == 0 or time == times[k - 1]:
                assert not seen.view(np.uint32).any()
            else:
                assert np.abs(now - then).max() > 1e-4
                assert_close(seen, *twin.motion(CLOTH_VIEW, CLOTH_VIEW, SIZE, now, then))
            then = now


@pytest.mark.feature("motion-vectors/objects")
def test_cloth_that_comes_into_view_has_no_vertices_before(chapter):
    """Vertices out of view are not written: without a rule, the first vector would be that of many frames."""
    scene = cloth_scene_of(cloth(pins=(0,)), light=False, material=UNLIT)
    _, triangles = sheet(5, 5)
    with chapter.open(scene, SIZE, outputs={"motion"}) as renderer:
        for k in range(6):
            renderer.render(CLOTH_VIEW if k < 2 else BESIDE, 2 * k / 60)
        corners = []
        for k, before in enumerate((BESIDE, CLOTH_VIEW)):
            seen = renderer.render(CLOTH_VIEW, (11 + k) / 60).image("motion")
            corners.append(state(renderer).astype(np.float64)[triangles])
            assert renderer.techniques["cloth"].cloth.known()[1].all() == (k > 0)
            truth = twin.motion(CLOTH_VIEW, before, SIZE, corners[-1], corners[0])
            assert_close(seen, *truth)
            assert (truth[1] >= 0).sum() > 100


# --- paths ---


def crowd():
    """Return balls, cubes and masked balls, some of them mirrored, in front of a wall."""
    rng = np.random.default_rng(3)
    kinds = [replace(material, unlit=True) for material in KINDS]
    mesh = rng.integers(0, 3, 20)
    matrices = np.zeros((20, 4, 4))
    for number, matrix in enumerate(matrices):
        linear = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.3, 0.8)
        matrix[:3, :3], matrix[3, 3] = linear * (-1 if number % 4 == 3 else 1), 1
        matrix[:3, 3] = rng.uniform((-3, -1, -6), (3, 2, 1))
    matrices[0] = np.diag((5.0, 4.0, 0.1, 1.0))
    matrices[0, :3, 3], mesh[0] = (0, 0, -7), 1
    return of_shapes([ball(), cube(), ball(6, 9)], [0, 0, 2], mesh, matrices, tuple(kinds))


def crowd_frames(chapter, **knobs):
    """Return motion of frames in which every second object moves, under a camera that walks."""
    scene = replace(crowd(), lights=[])
    seen = []
    with chapter.open(scene, SIZE, Settings(shadows="off", **knobs), outputs={"motion"}) as renderer:
        for k in range(3):
            view = View(
                pose_looking_at((0.2 * k, 1.0, 4.0 - 0.2 * k), (0.0, 0.2, -2.0)), Perspective(0.9, 0.05)
            )
            seen.append(renderer.render(view).image("motion"))
            for node in range(1, 20, 2):
                move(scene, turned(0.02 * node, (0.05, 0.02, -0.03)), [node])
    return seen


@pytest.fixture(scope="module")
def expected(chapter):
    """Return motion of the classic draws of the deferred graph."""
    return crowd_frames(chapter, culling="off", geometry="classic", graph="deferred")


@pytest.mark.feature("motion-vectors/objects")
@pytest.mark.parametrize(
    "path", [pytest.param(path, marks=[pytest.mark.long] * (path not in SAMPLE)) for path in PATHS]
)
def test_every_path_draws_the_same_motion(chapter, expected, path):
    assert [bool(motion.any()) for motion in expected] == [False, True, True]
    knobs = PATHS[path]
    if knobs.get("geometry", "classic") not in ways(chapter):
        pytest.skip("the device draws one command with each call")
    for number, (drawn, wanted) in enumerate(zip(crowd_frames(chapter, **knobs), expected, strict=True)):
        assert np.array_equal(drawn, wanted), number


@pytest.mark.feature("motion-vectors/objects")
@pytest.mark.variants("vulkan")
def test_mesh_shaders_draw_the_same_motion(chapter, expected):
    """Meshlets begin triangles with other corners, so interpolation rounds in another order: by a half at most."""
    if "mesh" not in ways(chapter):
        pytest.skip("the device has no mesh shaders")
    found = crowd_frames(chapter, culling="occlusion", geometry="mesh")
    for number, (drawn, wanted) in enumerate(zip(found, expected, strict=True)):
        assert (np.abs(drawn - wanted) <= 2 * HALF * np.abs(wanted) + 2.0**-24).all(), number


@pytest.mark.feature("motion-vectors/objects")
@pytest.mark.parametrize("knobs", [{"graph": "forward", "msaa": 4}, {"graph": "deferred"}], ids=str)
def test_a_skin_on_other_paths(chapter, knobs):
    seen = motions(chapter, leaning(), [FRONT] * 3, (0.0, 0.1, 0.25), settings=Settings(**knobs))
    assert_close(seen[2], *bent_between(FRONT, FRONT, 0.25, 0.1))


@pytest.mark.feature("motion-vectors/camera")
def test_without_a_reader_no_pass_of_motion_exists(chapter):
    with chapter.open(yard(material=UNLIT), SIZE, outputs={"color"}) as renderer:
        renderer.render(VIEW)
        assert not {"motion", "motion_objects"} & {it.name for it in renderer.passes}
        assert "motion_objects" not in renderer.render(ASIDE).work


@pytest.mark.feature("motion-vectors/objects")
@pytest.mark.variants("vulkan")
def test_cloth_waits_for_the_frame_that_still_reads_its_slot(chapter):
    """The frame before reads the vertices that this one overwrites, as its previous ones; without motion none does."""
    scene = cloth_scene_of(cloth(pins=(0,)), light=False, material=UNLIT)
    for output, waits in (("color", False), ("motion", True)):
        with chapter.open(scene, SIZE, Settings(shadows="off"), outputs={output}) as renderer:
            plan = renderer._plan
            graph = plan.compile(
                renderer.size, renderer.scene, renderer._settings, queues=("graphics", "compute")
            )
            (simulation,) = [batch for batch in graph.batches if batch.queue == "compute"]
            assert [graph.steps[step].name for step in simulation.steps] == ["cloth"]
            ahead = [graph.batches[wait.batch] for wait in simulation.waits]
            assert [batch.queue for batch in ahead] == ["graphics"] * waits


@pytest.mark.feature("motion-vectors/objects")
@pytest.mark.variants("vulkan")
def test_copies_of_a_skin_wait_for_the_frame_that_still_reads_its_slot(chapter):
    """One more barrier in a frame with motion, before the copies."""
    counts = {}
    for output in ("depth", "motion"):
        with chapter.open(leaning(), SIZE, outputs={output}) as renderer:
            for time in (0.0, 0.1, 0.2):
                renderer.render(FRONT, time)
            with chapter.calls() as calls:
                renderer.render(FRONT, 0.3)
            copy = calls.index("vkCmdCopyBuffer")
            counts[output] = calls[:copy].count("vkCmdPipelineBarrier2")
    assert counts == {"depth": 0, "motion": 1}


@pytest.mark.feature("motion-vectors/objects")
def test_a_skin_whose_pages_are_replaced_has_no_vertices_before(chapter):
    """A material that is lit from now on needs normals: all streams are uploaded anew, as they were modelled."""
    scene = leaning()
    with chapter.open(scene, SIZE, Settings(shadows="off"), outputs={"motion", "color"}) as renderer:
        for time in (0.0, 0.1):
            renderer.render(FRONT, time)
        with scene.edit() as edit:
            edit.set_material(0, replace(UNLIT, unlit=False))
        assert not renderer.render(FRONT, 0.25).image("motion").view(np.uint32).any()
        seen = renderer.render(FRONT_ASIDE, 0.4).image("motion")
        assert_close(seen, *bent_between(FRONT_ASIDE, FRONT, 0.4, 0.25))


@pytest.mark.parametrize("taa", ["off", "full"])
def test_a_deforming_surface_is_found_by_the_number_of_its_triangle(chapter, taa):
    """The kernel that resolves materials reads vertices, and no vertices of the frame before."""
    pictures = []
    for surfaces in ("gbuffer", "visibility"):
        settings = Settings(surfaces=surfaces, graph="deferred", taa=taa, shadows=False)
        with chapter.open(bending(), (48, 32), settings, outputs={"color"}) as renderer:
            pictures += [renderer.render(VIEW, time).image("color").astype(int) for time in (0.0, 0.25)]
    assert np.abs(pictures[0] - pictures[1]).max() > 8
    assert np.abs(pictures[0] - pictures[2]).max() <= 1 and np.abs(pictures[1] - pictures[3]).max() <= 1
