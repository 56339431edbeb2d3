"""Levels of detail on the GPU: which one is drawn, how far it is off in the picture, and that all paths agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch06.culling.lists import DRAW, WHOLE, Levels, plan_lists
from chapters.ch06.meshlets import lods
from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.lods import SceneLevels, with_levels
from chapters.ch06.meshlets.scene import meshlets_of
from chapters.ch06.scene import pages as scene_pages
from chapters.ch06.scene.draw_lists import build_draw_lists
from chapters.ch06.scene.packing import material_variant
from chapters.ch06.settings import Settings
from common.mesh.metrics import hausdorff
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.culled import commands
from tests.support.culled_frames import EXACT_KNOBS, OUTPUTS, SIZE, assert_same, frames, ways
from tests.support.towns import BLENDED, MASKED, OPAQUE, TWO_SIDED, ball, cube, of_shapes

EXACT = Settings(**EXACT_KNOBS)

RINGS, AROUND = 24, 32
STEPS = (2, 4, 8)
"""A coarser ball has every second, fourth and eighth of the vertices along both directions."""


def coarser_ball(step):
    """Return the indices (3 T,) of a ball over the vertices of the finest one."""
    triangles = ball(RINGS // step, AROUND // step)[1]
    ring, angle = np.divmod(triangles, AROUND // step + 1)
    return (ring * step * (AROUND + 1) + angle * step).astype(np.uint32).reshape(-1)


def chain_of_balls():
    """Return the chain of a ball of radius 1: a point of it is at most as far off as its arcs are high."""
    place, triangles = ball(RINGS, AROUND)
    parts = [coarser_ball(step) for step in STEPS]
    extent = (place.max(axis=0) - place.min(axis=0)).max()
    found = [
        hausdorff(place, triangles.reshape(-1), place, part, 4000) / extent / lods.SURE for part in parts
    ]
    return list(zip(parts, found, strict=True))


CHAIN = chain_of_balls()


@pytest.fixture(autouse=True)
def hand_made(monkeypatch):
    """Let every mesh that may have levels have those of a ball, without the package that makes them."""
    monkeypatch.setattr(lods, "kept_chains", lambda scene, meshes, kept: [CHAIN for _ in meshes])


def balls(count=40, seed=3):
    """Return balls of several materials in a row that leads away, some stretched or mirrored, and a wall."""
    rng = np.random.default_rng(seed)
    shapes = [ball(RINGS, AROUND) for _ in range(4)] + [cube()]
    mesh, matrices = rng.integers(0, 4, count), np.zeros((count, 4, 4))
    for number, matrix in enumerate(matrices):
        matrix[:] = np.eye(4)
        linear = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.2, 0.8)
        if number % 3 == 1:
            linear = linear @ np.diag(rng.uniform(0.4, 1.6, 3))
        matrix[:3, :3] = linear * (-1 if number % 5 == 2 else 1)
        matrix[:3, 3] = (rng.uniform(-1, 1) * (1 + 0.15 * number), rng.uniform(-1, 1), 3.0 - 1.5 * number)
    mesh[0], matrices[0] = 4, np.eye(4)
    matrices[0, :3, :3] = np.diag((0.7, 0.9, 0.1))
    matrices[0, :3, 3] = (0.3, 0.0, 2.0)
    return of_shapes(shapes, [OPAQUE, TWO_SIDED, MASKED, BLENDED, OPAQUE], mesh, matrices)


def steps(count=5):
    """Return views of a walk along the row: levels change on the way, and the last view is a jump."""
    views = []
    for number in range(count):
        eye = np.array((0.4 * number, 0.5, 9.0 - 2.0 * number))
        views.append(View(pose_looking_at(eye, (0.0, 0.0, -30.0)), Perspective(0.9, 0.05)))
    views.append(View(pose_looking_at((4.0, 2.0, -30.0), (0.0, 0.0, 0.0)), Perspective(0.9, 0.05)))
    return views


# --- the level in double precision ------------------------------------------------------------------------------------


def levels_at(scene, view, pixels, size=SIZE):
    """Return (I,) the coarsest allowed level of each instance, and the ratio of each error to what is allowed, (I, 3).

    The bound is that of levels.glsl, from the scene's own matrices.
    """
    levels = with_levels(scene)
    world = scene.nodes.matrix[scene.instances.node].astype(np.float64)
    mesh = scene.instances.mesh
    stretch = np.linalg.svd(world[:, :3, :3], compute_uv=False)[:, 0]
    low, high = (scene.meshes[name][mesh].astype(np.float64) for name in ("bounds_min", "bounds_max"))
    bits = np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, 8).T
    corners = np.where(bits[None], high[:, None], low[:, None])
    placed = corners @ world[:, :3, :3].transpose(0, 2, 1) + world[:, None, :3, 3]
    box_low, box_high = placed.min(axis=1), placed.max(axis=1)
    centre, radius = (box_low + box_high) / 2, np.linalg.norm(box_high - box_low, axis=1) / 2
    clip = view.clip_from_view(size[0] / size[1])
    to_view = np.linalg.inv(view.world_from_view)
    nearest = -(centre @ to_view[:3, :3].T + to_view[:3, 3])[:, 2] - radius
    focal = np.abs([clip[0, 0] * size[0], clip[1, 1] * size[1]]) / 2
    scale = np.full(len(mesh), focal.max())
    if isinstance(view.projection, Perspective):
        slope = (1 + np.abs(clip[:2, 2])) / np.abs([clip[0, 0], clip[1, 1]])
        with np.errstate(divide="ignore"):
            scale = np.where(nearest > 0, scale * np.sqrt(1 + (slope**2).sum()) / nearest, np.inf)
    with np.errstate(invalid="ignore"):
        ratio = levels.errors[mesh, 1:4] * (stretch * scale)[:, None] / pixels
    having = np.arange(1, 4) < levels.counts[mesh][:, None]
    ratio = np.where(having, ratio, np.inf)
    return (ratio <= 1).sum(axis=1), ratio


def drawn_levels(renderer, scene):
    """Return the level of each instance that is drawn whole, by the number of its indices."""
    counts = {
        RINGS * AROUND * 6: 0,
        **{len(part): number for number, (part, _) in enumerate(CHAIN, 1)},
        36: 0,
    }
    listed = np.concatenate([np.concatenate(commands(renderer, phase)) for phase in (0, 1)])
    return {int(row[4]): counts[int(row[0])] for row in listed}


@pytest.mark.parametrize("pixels", [0.5, 20.0])
def test_levels_are_those_of_double_precision(chapter, pixels):
    """But for errors within a rounding of what is allowed; the counter is that of the lists."""
    scene = balls()
    views = [
        *steps(3),
        View(pose_looking_at((3.0, 2.0, 9.0), (0.0, 0.0, -30.0)), Orthographic(20.0, 0.1, 90.0)),
        View(pose_looking_at((9.0, 30.0, -30.0), (0.0, 0.0, -30.0)), Orthographic(200.0, 0.1, 90.0)),
    ]
    found = set()
    with chapter.open(
        scene, SIZE, replaced(EXACT, culling="frustum", geometry="classic", lod_pixels=pixels)
    ) as made:
        for view in views:
            work = made.render(view).work
            wanted, ratio = levels_at(scene, view, pixels)
            # The kernels bound the largest stretch of a sheared matrix from above, so they may take a finer level.
            sure = (np.abs(ratio - 1) > 1e-3).all(axis=1)
            drawn = drawn_levels(made, scene)
            assert len(drawn) > 8
            for instance, level in drawn.items():
                assert level == wanted[instance] or not sure[instance], (instance, ratio[instance])
            assert work["instances_coarser"] == sum(level > 0 for level in drawn.values())
            found |= {*drawn.values()}
    assert len(found) > 1 and (pixels < 20 or max(found) == 3)


@pytest.mark.parametrize("pixels", [0.5, 2.0, 20.0])
def test_no_point_of_a_chosen_level_is_off_by_more_in_the_picture(pixels):
    """Every sampled point of the mesh has a point of its level so near in the picture, and the other way round."""
    scene, rng = balls(), np.random.default_rng(8)
    place = ball(RINGS, AROUND)[0].astype(np.float64)
    most = 0.0
    for view in steps():
        wanted, _ = levels_at(scene, view, pixels)
        clip = view.clip_from_world(SIZE[0] / SIZE[1])
        for instance in np.flatnonzero(wanted).tolist():
            part = CHAIN[wanted[instance] - 1][0].reshape(-1, 3)
            world = scene.nodes.matrix[instance].astype(np.float64)

            def projected(points, world=world, clip=clip):
                moved = np.c_[points, np.ones(len(points))] @ (clip @ world).T
                inside = (np.abs(moved[:, :2]) <= moved[:, 3:]).all(axis=1) & (moved[:, 3] > 0)
                return moved[:, :2] / moved[:, 3:] * np.array(SIZE) / 2, inside

            # A point of the level and the point of the ball straight above it are at most the chain's error apart.
            weights = rng.dirichlet((1, 1, 1), 60)
            chosen = part[rng.integers(0, len(part), 60)]
            below = (weights[:, :, None] * place[chosen]).sum(axis=1)
            above = below / np.linalg.norm(below, axis=1, keepdims=True)
            (one, first), (other, second) = projected(below), projected(above)
            apart = np.linalg.norm(one - other, axis=1)[first & second]
            assert apart.max(initial=0.0) <= 1.02 * pixels  # the error itself was sampled
            most = max(most, apart.max(initial=0.0))
    assert most > 0.05 * pixels, "the bound says something"


# --- the picture ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "turned",
    [pytest.param({}, marks=pytest.mark.long), {"graph": "forward", "depth_prepass": True}],
    ids=str,
)
def test_with_levels_too_culling_changes_no_picture(chapter, turned):
    """On a walk on which levels change: the bits of what was seen are those of another level then."""
    scene, views = balls(), steps()
    # Blended objects are drawn in full, and would hide which levels are behind them.
    wanted = frames(chapter, scene, views, culling="off", geometry="classic", lod_pixels=1.5, **turned)
    assert all(work["instances_coarser"] > 0 for _, work in wanted)
    for geometry in [way for way in ways(chapter) if way != "mesh"]:
        drawn = frames(
            chapter, scene, views, culling="occlusion", geometry=geometry, lod_pixels=1.5, **turned
        )
        assert_same(drawn, wanted)
        assert any(work["units_late"] > 0 for _, work in drawn)
        assert all(work["triangles_drawn"] <= whole["triangles_drawn"]
                   for (_, work), (_, whole) in zip(drawn, wanted, strict=True))  # fmt: skip


def test_mesh_shaders_draw_the_levels_that_compute_selects(chapter):
    if "mesh" not in ways(chapter):
        pytest.skip("the device has no mesh shaders")
    # With a depth pre-pass, the forward pass runs the task shaders of both phases after the late kernels have run.
    scene, views, turned = balls(), steps(), {"lod_pixels": 1.5, "graph": "forward", "depth_prepass": True}
    uncut = frames(chapter, scene, views, culling="off", geometry="mesh", **turned)
    mesh = frames(chapter, scene, views, culling="occlusion", geometry="mesh", **turned)
    compute = frames(chapter, scene, views, culling="occlusion", geometry="compute", **turned)
    assert_same(mesh, uncut)
    kinds = ("instances_", "meshlets_", "units_", "triangles_")
    for (_, work), (_, told) in zip(mesh, compute, strict=True):
        assert all(told[name] == count for name, count in work.items() if name.startswith(kinds))


def test_a_level_is_drawn_as_a_mesh_that_is_as_coarse(chapter):
    """With 100 pixels everything is as coarse as it can be: the picture is that of a scene with those balls."""
    scene = balls()
    far = [replace(view, projection=Perspective(0.4, 0.05)) for view in (steps()[0], steps()[-1])]
    levels = with_levels(scene)
    coarse = replace(scene, indices=levels.scene.indices, meshes=levels.scene.meshes[levels.meshes[:, 3]])
    rows = levels.scene.meshes
    kept = np.isin(np.arange(len(scene.meshes)), [3, 4])  # the blended ball, and the wall
    coarse.meshes[kept] = rows[: len(scene.meshes)][kept]
    coarse.bounds, coarse.origin = scene.bounds, scene.origin
    ids = [number for number in range(len(scene.instances)) if scene.instances.mesh[number] not in (3, 4)]
    for geometry in ways(chapter)[-2:]:
        drawn = frames(chapter, scene, far, culling="occlusion", geometry=geometry, lod_pixels=100.0)
        base = "mesh" if geometry == "mesh" else "classic"
        wanted = frames(chapter, coarse, far, culling="off", geometry=base, lod_pixels=0.0)
        for (pictures, work), (others, _), view in zip(drawn, wanted, far, strict=True):
            level, _ = levels_at(scene, view, 100.0)
            if (level[ids] == 3).all():
                assert all(np.array_equal(pictures[name], others[name]) for name in OUTPUTS)
            assert work["instances_coarser"] > 0
        assert (levels_at(scene, far[0], 100.0)[0][ids] == 3).all()


def test_off_by_default_and_nothing_is_made(chapter, monkeypatch):
    monkeypatch.setattr(lods, "kept_chains", lambda *_: pytest.fail("levels are off"))
    with chapter.open(balls(), SIZE, EXACT) as made:
        assert EXACT.culling.lod_pixels == 0 and made.techniques["culling"].levels is None
        assert len(made.scene.meshes) == 5


def test_a_scene_without_coarser_levels_is_drawn_as_without_the_knob(chapter):
    scene = balls()
    few = replace(scene, meshes=scene.meshes.copy())
    few.meshes["index_count"] = np.minimum(few.meshes["index_count"], 900)
    with chapter.open(few, SIZE, replaced(EXACT, lod_pixels=2.0)) as made:
        assert made.techniques["culling"].levels is None
        assert not any(it.name.startswith("cull") for it in made.passes)


# --- tables -----------------------------------------------------------------------------------------------------------


def tables(scene, levels, meshlets, page_of, **more):
    view = levels.scene
    variants = [material_variant(material, scene) for material in scene.materials]
    mirrored = np.linalg.det(scene.nodes.matrix[scene.instances.node][:, :3, :3]) < 0
    none = np.zeros(len(view.meshes), np.uint32)
    first = view.meshes["first_index"]
    lists = build_draw_lists(view, variants, mirrored, none, first, np.zeros(len(scene.materials), np.int64))
    always, sides = np.zeros(len(view.meshes), bool), np.zeros(len(scene.materials), bool)
    return plan_lists(
        lists, view, meshlets, always, sides, levels=Levels(levels, first, page_of, 2.0), **more
    )


def test_records_of_levels():
    scene = balls()
    levels = with_levels(scene)
    meshlets = build_meshlets(levels.scene)
    page_of = np.zeros(len(levels.scene.meshes), np.uint32)
    planned = tables(scene, levels, meshlets, page_of)
    assert planned.levels.dtype == DRAW and len(planned.levels) == 9  # three balls, the blended one has none
    assert planned.levels["index_count"].tolist() == [len(part) for part, _ in CHAIN] * 3
    errors = planned.levels["first_bit"].copy().view(np.float32)
    assert errors == pytest.approx(
        [lods.SURE * distance * 2 / 2.0 for _, distance in CHAIN] * 3, rel=1e-5
    )  # extent 2, 2 pixels
    number = (planned.draws["flags"] >> 4) & 15
    assert set(number) == {0, 3}
    # Of meshlets that a level has, those of the finest are the most.
    assert planned.units == planned.draws["units"].sum() and planned.meshed.any()
    by_mesh_shaders = tables(scene, levels, meshlets, page_of, mesh_shaders=True)
    whole = (by_mesh_shaders.draws["flags"] & WHOLE) != 0
    fits = (by_mesh_shaders.levels["flags"] & WHOLE) != 0
    assert by_mesh_shaders.units == whole.sum() + (number > 0).sum() * fits.any()


def test_a_level_in_another_page_is_not_used():
    scene = balls()
    levels = with_levels(scene)
    page_of = np.zeros(len(levels.scene.meshes), np.uint32)
    page_of[levels.meshes[1, 2:]] = 1
    usable = Levels(levels, page_of, page_of, 1.0).counts
    assert usable.tolist() == [3, 1, 3, 0, 0]


def test_pages_of_a_large_scene_hold_levels_beside_their_meshes():
    """Pages of half the size: those of a mesh and of its levels are the same, whatever lies behind them."""
    scene = balls()
    view = with_levels(scene).scene
    page_bytes = 60_000
    planned = scene_pages.plan_pages(view, ["positions"], page_bytes)
    assert len(planned) > 2 and all(page.size <= page_bytes for page in planned)
    _, page_of, _ = scene_pages.mesh_records(view, planned)
    levels = with_levels(scene)
    assert Levels(levels, page_of, page_of, 1.0).counts.sum() >= 6


def test_ranges_that_overlap_keep_their_indices():
    """Meshes that share a part of their indices: each still has its own triangles, and its chain is behind all."""
    scene = balls()
    rows = scene.meshes
    rows["first_index"][1] = rows["first_index"][0] + 600
    for name in ("first_vertex", "vertex_count"):
        rows[name][1] = rows[name][0]
    rows["index_count"][1] -= 600
    levels = with_levels(scene)
    view = levels.scene
    assert isinstance(levels, SceneLevels) and len(view.indices) == len(scene.indices) + 3 * sum(
        len(part) for part, _ in CHAIN
    )
    for mesh in range(len(rows)):
        old, new = rows[mesh], view.meshes[mesh]
        first, moved = int(old["first_index"]), int(new["first_index"])
        count = int(old["index_count"])
        assert np.array_equal(scene.indices[first : first + count], view.indices[moved : moved + count])
    for mesh in range(3):
        for number, (part, _) in enumerate(CHAIN, 1):
            row = view.meshes[levels.meshes[mesh, number]]
            assert np.array_equal(view.indices[row["first_index"] :][: row["index_count"]], part)
    assert meshlets_of(view) is meshlets_of(view)
