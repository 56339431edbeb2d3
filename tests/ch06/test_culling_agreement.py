"""Culling changes no picture: colour, depth and ids are those of a frame that draws everything."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch06.settings import Settings
from common.errors import UnsupportedError
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.culled_frames import EXACT_KNOBS, OUTPUTS, SIZE, assert_same, frames, ways
from tests.support.scenes import moved, scaled
from tests.support.towns import OPAQUE, TWO_SIDED, ball, cube, of_shapes, town, walk

EXACT = Settings(**EXACT_KNOBS)


@pytest.fixture(scope="module")
def scene():
    return town()


@pytest.mark.core
@pytest.mark.feature("culling/two-phase-occlusion", "meshlets/compute-fallback")
@pytest.mark.parametrize(
    "turned",
    [{}, {"graph": "forward"}, pytest.param({"depth_prepass": True}, marks=pytest.mark.long)],
    ids=str,
)
def test_a_walk_and_a_jump_look_as_without_culling(chapter, scene, turned):
    """Views that move, and two that see another part of the town: the guess of the early phase is wrong there."""
    views = walk()
    for geometry in [way for way in ways(chapter) if way != "mesh"]:
        wanted = frames(chapter, scene, views, culling="off", geometry="classic", **turned)
        drawn = frames(chapter, scene, views, culling="occlusion", geometry=geometry, **turned)
        assert_same(drawn, wanted)
        assert all(0 < work["triangles_drawn"] < work_of(scene) for _, work in drawn)
        assert drawn[-2][1]["units_late"] > 0, "the jump shows what the frame before did not"


def work_of(scene):
    """Return the triangles of all solid instances."""
    kinds = [scene.materials[number].alpha_mode for number in scene.meshes["material"]]
    solid = np.array([kind != "blend" for kind in kinds])[scene.instances.mesh]
    return int(scene.meshes["index_count"][scene.instances.mesh][solid].sum()) // 3


def test_several_samples_a_pixel_hide_only_what_all_of_them_hide(chapter, scene):
    views = walk()[:3]
    wanted = frames(chapter, scene, views, culling="off", geometry="classic", msaa=4)
    drawn = frames(chapter, scene, views, culling="occlusion", geometry="classic", msaa=4)
    assert_same(drawn, wanted)


@pytest.mark.feature("meshlets/cone-and-frustum-culling")
@pytest.mark.parametrize("mode", ["frustum", "cone"])
def test_each_test_alone_leaves_the_picture_as_it_is(chapter, scene, mode):
    if "compute" not in ways(chapter):
        pytest.skip("the device draws one command with each call")
    views = walk()[::2]
    wanted = frames(chapter, scene, views, culling="off", geometry="classic")
    drawn = frames(chapter, scene, views, culling=mode, geometry="compute")
    assert_same(drawn, wanted)
    for _, work in drawn:
        assert work["meshlets_outside"] > 0 and (work["meshlets_away"] > 0) == (mode == "cone")
        assert work["units_late"] == 0 == work["meshlets_hidden"], "there is one phase"


@pytest.mark.core
@pytest.mark.feature("culling/two-phase-occlusion", "meshlets/cone-and-frustum-culling")
def test_what_the_late_phase_draws_is_missed_without_it(chapter, scene):
    """After a jump the early phase alone leaves holes: its guess is that of the frame before."""
    views = [walk()[0], walk()[0], walk()[-2]]
    whole = frames(chapter, scene, views, culling="occlusion", geometry="classic")[-1]
    assert whole[1]["units_late"] > 0
    settings = replaced(EXACT, culling="occlusion", geometry="classic")
    with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
        for view in views[:-1]:
            renderer.render(view)
        late = next(it for it in renderer.passes if getattr(it, "phases", ()) == (1,))
        late.record = lambda commands: None
        renderer._frames.forget()
        holes = renderer.render(views[-1]).image("depth")
    assert not np.array_equal(holes, whole[0]["depth"])
    assert (holes <= whole[0]["depth"]).all(), "something is missing, and nothing is added"


@pytest.mark.core
@pytest.mark.feature("culling/two-phase-occlusion")
def test_early_and_late_lists_never_overlap_and_are_complete_together(chapter, scene):
    """What the late phase finds visible is drawn by one of the two, and nothing is drawn by both."""
    with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion")) as renderer:
        for view in walk():
            work = renderer.render(view).work
            seen = work["meshlets_tested"] - work["meshlets_outside"] - work["meshlets_away"]
            visible = seen - work["meshlets_hidden"]
            early = work["units_drawn"] - work["units_late"]
            assert work["units_late"] <= visible <= work["units_drawn"]
            assert early + work["units_late"] == work["units_drawn"]


def test_a_view_that_stands_still_draws_nothing_late(chapter, scene):
    with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion")) as renderer:
        view = walk()[0]
        counts = [renderer.render(view).work for _ in range(4)]
    assert counts[0]["units_late"] == 0, "without a history everything is drawn early"
    assert counts[0]["units_drawn"] > counts[1]["units_drawn"], "what is hidden is known from then on"
    assert [work["units_late"] for work in counts[1:]] == [0, 0, 0]
    assert len({work["triangles_drawn"] for work in counts[1:]}) == 1


def test_cuts_resizes_and_edits_look_as_without_culling(chapter, scene):
    first, *_, jump, above = walk()
    pictures = []
    for culling in ("off", "occlusion"):
        shown = town()
        taken = []
        with chapter.open(
            shown, SIZE, replaced(EXACT, culling=culling, geometry="classic"), outputs=OUTPUTS
        ) as made:

            def take(view, made=made, taken=taken):
                frame = made.render(view)
                taken.append([frame.image(name).copy() for name in OUTPUTS])

            take(first)
            take(first)
            take(replace(jump, cut=True))
            with shown.edit() as edit:
                edit.set_visible(0, False)
                edit.set_visible(9, False)
            take(jump)
            made.resize((61, 37))
            take(jump)
            with shown.edit() as edit:
                edit.set_visible(0, True)
                edit.set_transform(1, matrix=shown.nodes.matrix[7])
            take(above)
            take(above)
            made.reset_history("a test")
            take(first)
        pictures.append(taken)
    for number, (one, other) in enumerate(zip(*pictures, strict=True)):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True)), f"picture {number}"


def test_mesh_shaders_draw_the_meshlets_that_compute_selects(chapter, scene):
    """The same counters in every frame, and the same picture but for the rounding of the driver's viewport."""
    if "mesh" not in ways(chapter):
        pytest.skip("the device has no mesh shaders")
    views = walk()
    compute = frames(chapter, scene, views, culling="occlusion", geometry="compute")
    mesh = frames(chapter, scene, views, culling="occlusion", geometry="mesh")
    uncut = frames(chapter, scene, views, culling="off", geometry="mesh")
    assert_same(mesh, uncut)
    counted = [
        name for name in compute[0][1] if name.startswith(("instances_", "meshlets_", "units_", "triangles_"))
    ]
    for (pictures, work), (others, told) in zip(mesh, compute, strict=True):
        assert {name: work[name] for name in counted} == {name: told[name] for name in counted}
        near = np.abs(pictures["depth"] - others["depth"]) <= 1e-5 * others["depth"] + 1e-9
        same = pictures["instance_id"] == others["instance_id"]
        # Vertices of the two paths differ by a rounding, which snapping can make 1/256 of a pixel: edges may move.
        assert near[same].mean() > 0.995 and same.mean() > 0.999


def test_orthographic_views_look_as_without_culling(chapter, scene):
    views = [
        View(pose_looking_at((9.0, 6.0, 9.0), (0.0, 0.0, 0.0)), Orthographic(5.0, 0.1, 40.0)),
        View(pose_looking_at((0.0, 9.0, 0.1), (0.0, 0.0, 0.0)), Orthographic(8.0, 0.5, 12.0)),
    ]
    geometry = ways(chapter)[min(1, len(ways(chapter)) - 1)]
    wanted = frames(chapter, scene, views, culling="off", geometry="classic")
    assert_same(frames(chapter, scene, views, culling="occlusion", geometry=geometry), wanted)


@pytest.mark.parametrize(
    "how", ["100 km away", "a thousandth", pytest.param("a thousandfold", marks=pytest.mark.long)]
)
def test_far_away_and_at_any_scale_culling_changes_no_picture(chapter, scene, how):
    geometry = ways(chapter)[min(1, len(ways(chapter)) - 1)]
    shown, views = None, []
    for view in walk()[::3]:
        if how == "100 km away":
            shown, there = moved(scene, view, (1e5, -1e5, 1e5))
        else:
            shown, there = scaled(scene, view, 1e-3 if how == "a thousandth" else 1e3)
        views.append(there)
    wanted = frames(chapter, shown, views, culling="off", geometry="classic")
    drawn = frames(chapter, shown, views, culling="occlusion", geometry=geometry)
    assert_same(drawn, wanted)
    assert any(work["instances_hidden"] > 0 for _, work in drawn)


def test_inside_of_things_and_through_the_near_plane(chapter, scene):
    """A camera in the middle of a ball and of a wall, and one whose near plane cuts several things."""
    centres = [scene.nodes.matrix[number][:3, 3] for number in (1, 7, 12)]
    views = [
        replace(walk()[0], world_from_view=pose_looking_at(at, at + np.array((0.3, 0.1, -1.0))))
        for at in centres
    ]
    geometry = ways(chapter)[min(1, len(ways(chapter)) - 1)]
    wanted = frames(chapter, scene, views, culling="off", geometry="classic")
    assert_same(frames(chapter, scene, views, culling="occlusion", geometry=geometry), wanted)


def test_transforms_that_are_broken_are_never_culled_wrongly(chapter):
    """A scale of 0, one of NaN, and one that is nearly flat: the others look as without culling."""
    matrices = town().nodes.matrix.copy()
    matrices[10, :3, :3] = 0.0
    matrices[11, :3, :3] = np.diag((1.0, 1e-30, 1.0))
    matrices[12, :3, :3] = np.diag((1.0, 1.0, 1e-6))
    matrices[13, :3, :3] = np.nan
    broken = town()
    broken = replace(broken, nodes=replace(broken.nodes, matrix=matrices))
    geometry = ways(chapter)[min(1, len(ways(chapter)) - 1)]
    wanted = frames(chapter, broken, walk()[::4], culling="off", geometry="classic")
    assert_same(frames(chapter, broken, walk()[::4], culling="occlusion", geometry=geometry), wanted)


@pytest.mark.feature("meshlets/compute-fallback")
def test_a_geometry_that_the_device_lacks_is_refused_in_a_sentence(chapter, scene):
    lacking = {"mesh": "mesh-shader", "compute": "multi-draw"}
    for geometry, feature in lacking.items():
        if chapter.backend == "gl" and feature == "mesh-shader":
            continue
        with pytest.raises(UnsupportedError, match=f"geometry={geometry}.*set geometry="):
            chapter.open(scene, SIZE, replaced(EXACT, geometry=geometry), without=(feature,))


def test_a_scene_too_small_to_gain_from_culling_is_drawn_as_in_chapter_5(chapter, scene):
    few = town(count=8)
    with closing(chapter.open(few, SIZE, EXACT)) as renderer:
        renderer.render(walk()[0])
        assert not any(gpu_pass.name.startswith("cull") for gpu_pass in renderer.passes)
    with closing(chapter.open(town(count=80), SIZE, EXACT)) as renderer:
        assert any(gpu_pass.name == "cull_late" for gpu_pass in renderer.passes)


def test_with_several_samples_ids_and_depth_are_those_of_the_centres(chapter):
    """A gap of 0.06 pixels, through the centres of a column: no sample is in it, and what is behind it has the id."""
    pixel = 2.0 / 33
    places = [(2.0 + 0.03 * pixel, 2.0, 0.0), (-2.0 - 0.03 * pixel, 2.0, 0.0), (0.0, 0.3 * pixel, -1.0)]
    matrices = np.zeros((3, 4, 4))
    for matrix, (x, half, z) in zip(matrices, places, strict=True):
        matrix[:] = np.diag((half, half, 0.05, 1.0))
        matrix[:3, 3] = (x, 0.0, z)
    gap = of_shapes([cube()], [OPAQUE], np.zeros(3, np.int32), matrices)
    views = [View(pose_looking_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)), Orthographic(1.0, 0.1, 20.0))] * 3
    turned = {"geometry": "classic", "graph": "forward", "msaa": 4}
    wanted = frames(chapter, gap, views, (33, 33), culling="off", **turned)
    drawn = frames(chapter, gap, views, (33, 33), culling="occlusion", **turned)
    assert wanted[0][0]["instance_id"][16, 16] == 3
    for (pictures, _), (others, _) in zip(drawn, wanted, strict=True):
        assert np.array_equal(pictures["instance_id"], others["instance_id"])
        assert np.array_equal(pictures["depth"], others["depth"])


def layers(count=200):
    """Return squares one before the other in a random order, and balls; both meshes have several meshlets."""
    rng = np.random.default_rng(5)
    corners, triangles = [], []
    for number, z in enumerate(rng.permutation(np.linspace(-1, 1, count))):
        x, y = rng.uniform(-0.6, 0.6, 2)
        corners += [
            (x - 0.4, y - 0.4, z),
            (x + 0.4, y - 0.4, z),
            (x + 0.4, y + 0.4, z),
            (x - 0.4, y + 0.4, z),
        ]
        triangles += [
            (4 * number, 4 * number + 1, 4 * number + 2),
            (4 * number, 4 * number + 2, 4 * number + 3),
        ]
    shapes = [(np.array(corners, np.float32), np.array(triangles, np.uint32)), ball()]
    matrices = np.stack([np.eye(4)] * 70)
    matrices[:, :3, 3] = rng.uniform(-5, 5, (70, 3))
    return of_shapes(shapes, [OPAQUE, TWO_SIDED], np.array([0] * 10 + [1] * 60, np.int32), matrices)


def test_what_becomes_blended_has_its_triangles_in_the_order_of_the_file(chapter):
    """While the renderer is open, in a renderer that is opened after it, and when the material is solid again."""
    view = View(pose_looking_at((0.0, 1.0, 14.0), (0.0, 0.0, 0.0)), Perspective(0.9, 0.05))
    geometry = ways(chapter)[min(1, len(ways(chapter)) - 1)]
    taken = []
    for culling, way in (("off", "classic"), ("occlusion", geometry)):
        scene, pictures = layers(), []
        solid = scene.materials[0]
        clear = replace(solid, alpha_mode="blend", base_color=(0.8, 0.5, 0.3, 0.4))

        def shown(renderer, material, scene=scene):
            with scene.edit() as edit:
                edit.set_material(0, material)
            renderer.render(view)
            return renderer.render(view).image("color_linear").copy()

        settings = replaced(EXACT, culling=culling, geometry=way)
        with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
            pictures += [shown(renderer, material) for material in (solid, clear, solid)]
            shown(renderer, clear)
        with chapter.open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
            pictures.append(shown(renderer, clear))
        taken.append(pictures)
    for number, (one, other) in enumerate(zip(*taken, strict=True)):
        assert np.array_equal(one, other), f"picture {number}"
    assert not np.array_equal(taken[0][0], taken[0][1])
