"""Hits of ray pipelines and ray queries through the chapter's acceleration structures, held against every triangle."""

from __future__ import annotations

import numpy as np
import pytest

from backends.vulkan.upload import Uploader
from chapters import ch12
from chapters.ch12.rays import model
from chapters.ch12.rays import vulkan as structures_on_vulkan
from chapters.ch12.rays import vulkan_build as build
from chapters.ch12.rays.model import BLENDED, SURFACES
from chapters.ch12.scene import data as scene_data
from chapters.ch12.scene.records import RECORD_BYTES
from common.errors import SceneError
from common.numerics.transforms import translation
from common.scene import Material
from tests.support.ray_scenes import placements, random_rays, soup, soup_scene, two_sided, world_triangles
from tests.support.ray_traces import WAYS, traces_of
from tests.support.scenes import facing
from tests.twins.brute_rays import nearest

pytestmark = pytest.mark.variants("vulkan")
SURE = 1e-4
"""Barycentric distance from edges beyond which rounding decides nothing."""


def needs(chapter, way):
    if not chapter.device.has(WAYS[way]):
        pytest.skip(f"this device has no {WAYS[way]}")


def hold(traced, scene, origins, directions, t_min=0.0, t_max=1e4):
    """Hold hits to the twin, off edges; return how many rays hit."""
    truth = nearest(origins, directions, t_min, t_max, *world_triangles(scene))
    sure = truth.margin > SURE
    assert sure.mean() > 0.5
    assert (traced.instance == truth.instance)[sure].all()
    assert (traced.primitive == truth.primitive)[sure].all()
    hit = sure & (truth.instance >= 0)
    assert (np.abs(traced.t - truth.t)[hit] <= 1e-5 * truth.t[hit]).all()
    assert (np.abs(traced.at - truth.at)[hit] < 2e-4).all()
    assert (traced.back == truth.back)[sure].all()
    assert (traced.blocked == (truth.instance >= 0))[sure].all()
    assert (traced.t[truth.instance < 0] == np.float32(t_max))[sure[truth.instance < 0]].all()
    return int(hit.sum())


@pytest.fixture(params=list(WAYS))
def way(request, chapter):
    needs(chapter, request.param)
    return request.param


def instanced():
    meshes = [soup(60, 1), soup(40, 2)]
    return soup_scene(meshes, [(number % 2, matrix) for number, matrix in enumerate(placements())])


@pytest.mark.feature("acceleration/blas-build")
def test_hits_are_those_of_every_triangle(chapter, way, tmp_path):
    scene = instanced()
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        origins, directions = random_rays(scene, 3000, 3)
        assert hold(traces.trace(pipeline, origins, directions), scene, origins, directions) > 300
        # An end between the surfaces cuts off what lies behind it, and a beginning what lies before.
        ends = {"t_min": 0.4, "t_max": 1.1}
        hold(traces.trace(pipeline, origins, directions, **ends), scene, origins, directions, **ends)


@pytest.mark.feature("acceleration/tlas")
def test_masks_choose_instances_and_hidden_ones_are_not_hit(chapter, way, tmp_path):
    meshes = [soup(50, 4), soup(50, 5)]
    glass = Material(alpha_mode="blend")
    drawn = [(0, np.eye(4)), (1, np.eye(4)), (0, translation((0.4, 0.0, 0.0)))]
    scene = soup_scene(meshes, drawn, (Material(), glass), (0, 1))
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        rays = random_rays(scene, 800, 6)

        def seen(mask, hidden=()):
            """Hold the hits with a mask to the twin without those that it excludes."""
            before = scene.instances.visible.copy()
            for number, mesh in enumerate(scene.instances.mesh):
                scene.instances.visible[number] &= bool((BLENDED if mesh else SURFACES) & mask)
            try:
                truth = nearest(*rays, 0.0, 1e4, *world_triangles(scene))
            finally:
                scene.instances.visible[:] = before
            traced = traces.trace(pipeline, *rays, mask=mask)
            sure = truth.margin > SURE
            assert (traced.instance == truth.instance)[sure].all()
            return set(traced.instance[traced.instance >= 0].tolist())

        assert seen(SURFACES) == {0, 2}
        assert seen(BLENDED) == {1}
        assert seen(SURFACES | BLENDED) == {0, 1, 2}
        assert seen(4) == set()
        with scene.edit() as edit:
            edit.set_visible(0, False)
        traces.build()
        assert seen(SURFACES | BLENDED) == {1, 2}


@pytest.mark.feature("ray-tracing/any-hit-and-intersection")
def test_a_side_is_skipped_of_surfaces_with_one_side(chapter, way, tmp_path):
    """Of instances of two meshes, one mirrored, those of one mesh have two sides. Sides are those of object space."""
    drawn = [(k % 2, matrix) for k, matrix in enumerate(placements())]
    drawn.append((0, placements()[3] @ translation((0.5, 0.2, 0.0))))
    kinds = (Material(), Material(double_sided=True))
    scene = soup_scene([soup(60, 25), soup(60, 26)], drawn, kinds, (0, 1))
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        rays = random_rays(scene, 2000, 27)
        seen = {}
        for sides, side in ((0, ""), (16, "backs"), (32, "fronts")):
            triangles, ids = world_triangles(scene)
            left = {side: two_sided(scene, ids)} if side else {}
            truth = nearest(*rays, 0.0, 1e4, triangles, ids, **left)
            traced = traces.trace(pipeline, *rays, sides=sides)
            sure = truth.margin > SURE
            assert sure.mean() > 0.5
            for found, wanted in ((traced.instance, truth.instance), (traced.primitive, truth.primitive)):
                assert (found == wanted)[sure].all(), side
            assert (traced.back == truth.back)[sure].all()
            assert (traced.blocked == (truth.instance >= 0))[sure].all(), side
            seen[sides] = traced.instance
        assert (seen[0] != seen[16]).sum() > 30 and (seen[16] != seen[32]).sum() > 30
        # An edit that gives a material both sides is followed.
        with scene.edit() as edit:
            edit.set_material(0, Material(double_sided=True))
        traces.build()
        assert (traces.trace(pipeline, *rays, sides=16).instance == seen[0]).all()


ACCEPT = "bool accept(Hit hit) { return hit.primitive % 2u == 0u && hit.at.x > 0.25; }"


@pytest.mark.feature("ray-tracing/any-hit-and-intersection")
def test_surfaces_that_are_not_opaque_are_asked(chapter, way, tmp_path):
    """Rays pass through what `accept` lets through, of instances that are not opaque alone."""
    meshes = [soup(60, 7), soup(60, 8)]
    scene = soup_scene(
        meshes, [(0, np.eye(4)), (1, np.eye(4))], (Material(alpha_mode="mask"), Material()), (0, 1)
    )
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way, ACCEPT))
        origins, directions = random_rays(scene, 1500, 9)
        traced = traces.trace(pipeline, origins, directions)
        triangles, ids = world_triangles(scene)
        # The twin asks by leaving out: whole triangles by their numbers, and the rest along the line at = 0.25.
        left = (ids[:, 0] == 1) | (ids[:, 1] % 2 == 0)
        triangles, ids = triangles[left], ids[left]
        cut = ids[:, 0] == 0
        corners = triangles[cut]
        first = corners[:, 1] - corners[:, 0]
        triangles[cut] = np.stack(
            [corners[:, 0] + 0.25 * first, corners[:, 1], corners[:, 2] * 0.75 + corners[:, 1] * 0.25], axis=1
        )
        truth = nearest(origins, directions, 0.0, 1e4, triangles, ids)
        sure = truth.margin > 1e-3
        assert (traced.instance == truth.instance)[sure].all()
        assert (traced.primitive == truth.primitive)[sure].all()
        assert (traced.blocked == (truth.instance >= 0))[sure].all()
        assert {0, 1} <= set(truth.instance[sure].tolist())
        # Without the question all of it is there.
        plain = traces.pipeline(traces.description(way))
        assert (traces.trace(plain, origins, directions).instance != traced.instance).any()


def write_vertices(traces, slot, corners):
    """Write other positions of mesh 0 into the page of a slot, as a deformation does."""
    data = traces.api.data
    data_page = data.page_buffer(slot, int(data.page_of[0]))
    offset = data.pages[int(data.page_of[0])].offsets["positions"]
    with Uploader(traces.device) as uploader:
        uploader.buffer(data_page, corners, offset)


@pytest.mark.feature("acceleration/refit")
@pytest.mark.parametrize("slot", [0, 1])
def test_a_refit_hits_what_a_new_build_hits(chapter, way, tmp_path, slot):
    corners, indices = soup(120, 10)
    scene = soup_scene([(corners, indices)], [(0, matrix) for matrix in placements()], deforms=(0,))
    moved = (corners + 0.4 * np.sin(3.0 * corners[:, [1, 2, 0]])).astype(np.float32)
    with traces_of(chapter, ch12.__name__, scene, tmp_path, frames=2) as traces:
        pipeline = traces.pipeline(traces.description(way))
        rays = random_rays(scene, 1500, 11)
        write_vertices(traces, slot, moved)
        assert not traces.structures.refits or traces.structures.work["ray_refits"] == 1
        traces.build(slot)
        assert not traces.structures.builds_top and traces.structures.work["ray_refits"] == 0
        hold(traces.trace(pipeline, *rays), scene, *rays)  # nothing is fitted yet
        traces.build(slot, deformed=True)
        assert traces.structures.builds_top and traces.structures.work["ray_refits"] == 1
        fitted = traces.trace(pipeline, *rays)
    new = soup_scene([(moved, indices)], [(0, matrix) for matrix in placements()])
    origins = (rays[0] + scene.origin - new.origin).astype(np.float32)  # the movement changed the bounds
    assert hold(fitted, new, origins, rays[1]) > 100
    with traces_of(chapter, ch12.__name__, new, tmp_path) as traces:
        again = traces.trace(traces.pipeline(traces.description(way)), origins, rays[1])
    sure = nearest(origins, rays[1], 0.0, 1e4, *world_triangles(new)).margin > SURE
    assert (fitted.instance == again.instance)[sure].all() and (fitted.primitive == again.primitive)[
        sure
    ].all()


@pytest.mark.feature("acceleration/tlas")
def test_an_instance_that_moves_is_hit_where_it_is_and_a_still_frame_builds_nothing(chapter, way, tmp_path):
    scene = instanced()
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        rays = random_rays(scene, 800, 12)
        before = traces.structures.key()
        with chapter.calls() as calls:
            written = traces.build(1)  # the other slot: its table is written, and nothing is built
        assert written > 0 and traces.build(1) == 0
        assert "vkCmdBuildAccelerationStructuresKHR" not in calls and traces.structures.key() != before
        with scene.edit() as edit:
            edit.set_transform(1, matrix=translation((-1.0, 2.0, 0.5)) @ scene.nodes.matrix[1])
        traces.renderer.render(facing(), 0.0)
        slot = 1  # the frame after the first one
        with chapter.calls() as calls:
            traces.build(slot)
        assert calls.count("vkCmdBuildAccelerationStructuresKHR") == 1
        assert calls.count("vkCmdPipelineBarrier2") == 3
        assert hold(traces.trace(pipeline, *rays), scene, *rays) > 50


def test_instances_are_sorted_again_after_many_moved_frames(chapter, tmp_path, monkeypatch):
    needs(chapter, "pipeline")
    monkeypatch.setattr(structures_on_vulkan, "SORT_EVERY", 1)
    matrices = [translation((float(x), 0.0, 0.0)) for x in range(8)]
    scene = soup_scene([soup(20, 13)], [(0, matrix) for matrix in matrices])
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description("pipeline"))
        rays = random_rays(scene, 800, 14)
        assert traces.structures._order.tolist() == list(range(8))
        for frame, slot in enumerate((1, 0, 1)):
            with scene.edit() as edit:
                for node in range(8):
                    matrix = translation((float((5 * node + frame) % 8), 0.0, 0.0))
                    edit.set_transform(node, matrix=matrix)
            traces.renderer.render(facing(), 0.0)
            traces.build(slot)
            hold(traces.trace(pipeline, *rays), scene, *rays)
        assert traces.structures._order.tolist() != list(range(8))


@pytest.mark.feature("acceleration/compaction")
def test_compaction_changes_no_hit_and_needs_no_more_memory(chapter, way, tmp_path, monkeypatch):
    scene = instanced()
    rays = random_rays(scene, 1000, 15)
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        compact = traces.trace(traces.pipeline(traces.description(way)), *rays)
        work = traces.structures.work
        assert 0 < work["ray_compacted_bytes"] <= work["ray_uncompacted_bytes"]
        hold(compact, scene, *rays)

    def copied(self, built, sizes, whole=build.Bottoms._compacted):
        """Copy in any case, also where the driver's sizes are no smaller, by telling of larger originals."""
        for it in built:
            it.size += 1 << 20
        return whole(self, built, sizes)

    monkeypatch.setattr(build.Bottoms, "_compacted", copied)
    with chapter.calls() as calls, traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        again = traces.trace(traces.pipeline(traces.description(way)), *rays)
    assert calls.count("vkCmdCopyAccelerationStructureKHR") == 2
    assert (again.t == compact.t).all() and (again.primitive == compact.primitive).all()


@pytest.mark.feature("acceleration/parallel-builds")
def test_builds_in_one_call_and_one_by_one_give_the_same(chapter, way, tmp_path):
    scene = soup_scene([soup(30, seed) for seed in range(6)], [(mesh, np.eye(4)) for mesh in range(6)])
    rays = random_rays(scene, 800, 16)
    traced = {}
    for name, budget, calls in (
        ("together", build.Budget(), 1),
        ("triangles", build.Budget(triangles=60), 3),
        ("scratch", build.Budget(scratch=1), 6),
        ("storage", build.Budget(storage=1), 6),
    ):
        with traces_of(chapter, ch12.__name__, scene, tmp_path, budget=budget) as traces:
            assert traces.structures.work["ray_build_calls"] == calls
            traced[name] = traces.trace(traces.pipeline(traces.description(way)), *rays)
    for other in traced.values():
        assert (other.t == traced["together"].t).all()
        assert (other.primitive == traced["together"].primitive).all()


@pytest.mark.feature("acceleration/parallel-builds")
def test_the_lower_and_the_upper_level_are_built_in_one_submission(chapter, way, tmp_path):
    corners, indices = soup(60, 17)
    scene = soup_scene([(corners, indices)], [(0, np.eye(4))], deforms=(0,))
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        rays = random_rays(scene, 500, 18)
        traces.structures.prepare(0, traces.renderer._pose(0.0), deformed=True)
        hold(traces.trace(pipeline, *rays, build=0), scene, *rays)


def test_an_empty_scene_is_missed(chapter, way, tmp_path):
    scene = soup_scene([soup(3, 19)], [])
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        origins, directions = np.zeros((50, 3), np.float32), np.ones((50, 3), np.float32)
        traced = traces.trace(traces.pipeline(traces.description(way)), origins, directions, t_max=7.0)
        assert (traced.instance == -1).all() and (traced.t == 7.0).all() and not traced.blocked.any()
        assert traces.structures.work["ray_structures"] == 0


@pytest.mark.feature("acceleration/blas-build")
def test_triangles_without_area_or_with_nan_are_left_out(chapter, way, tmp_path):
    corners, indices = soup(60, 20)
    corners[indices[3]] = corners[indices[3, 0]]  # a point
    corners[indices[9, 2]] = corners[indices[9, 1]]  # a line
    corners[indices[17, 1], 1] = np.nan
    corners[indices[30]] = np.inf
    nothing = np.full((3, 3), np.nan, np.float32), np.array([[0, 1, 2]], np.uint32)
    scene = soup_scene([(corners, indices), nothing], [(0, np.eye(4)), (1, np.eye(4)), (0, placements()[1])])
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        rays = random_rays(scene, 1500, 21)
        traced = traces.trace(traces.pipeline(traces.description(way)), *rays)
        assert hold(traced, scene, *rays) > 200
        assert not np.isin(traced.primitive[traced.instance >= 0], (3, 9, 17, 30)).any()
        assert traces.structures.work["ray_structures"] == 1


@pytest.mark.feature("acceleration/tlas")
def test_too_many_instances_are_refused():
    model.check_count(1 << 24)
    with pytest.raises(SceneError, match="16777217 instances, and rays of this device tell 16777216 apart"):
        model.check_count((1 << 24) + 1)
    with pytest.raises(SceneError, match="101 instances"):
        model.check_count(101, most=100)


def test_structures_follow_geometry_that_is_uploaded_anew(chapter, way, tmp_path):
    """A material that becomes another kind needs other streams: all pages are new, and so is the order of triangles."""
    scene = soup_scene([soup(60, 22)], [(0, matrix) for matrix in placements()], (Material(unlit=True),))
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        rays = random_rays(scene, 800, 23)
        before, page = traces.trace(pipeline, *rays), traces.api.data.page_buffer(0, 0)
        with scene.edit() as edit:
            edit.set_material(0, Material())
        traces.renderer.render(facing(), 0.0)
        assert traces.api.data.page_buffer(0, 0) is not page
        scene.indices[:] = scene.indices.reshape(-1, 3)[::-1].reshape(-1)  # as culling reorders them
        traces.build(1)
        assert traces.structures.revision == 1 and traces.structures.builds_top
        traces.renderer.render(facing(), 0.0)
        after = traces.trace(pipeline, *rays)
        hit = before.instance >= 0
        assert (after.t == before.t).all() and (after.primitive[hit] == 59 - before.primitive[hit]).all()
        traces.build(0)
        assert traces.structures.revision == 1 and not traces.structures.builds_top


def test_instances_in_two_bindings_are_all_hit(chapter, way, tmp_path, monkeypatch):
    """As on a device whose shaders see so little of a buffer that eight instances take two bindings."""
    monkeypatch.setattr(
        scene_data,
        "instance_parts",
        lambda count, most: [(0, 4 * RECORD_BYTES), (4 * RECORD_BYTES, 4 * RECORD_BYTES)],
    )
    matrices = [translation((2.5 * x, 0.0, 0.0)) for x in (3, 0, 5, 1, 7, 2, 6, 4)]
    scene = soup_scene([soup(30, 24)], [(0, matrix) for matrix in matrices])
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        assert dict(traces.api.data.defines)["INSTANCES_PER_PAGE"] == 4
        rays = random_rays(scene, 1500, 25)
        traced = traces.trace(traces.pipeline(traces.description(way)), *rays)
        hold(traced, scene, *rays)
        assert set(traced.instance.tolist()) == set(range(-1, 8))
        assert traces.structures._order.tolist() == [1, 3, 5, 0, 7, 2, 6, 4]
