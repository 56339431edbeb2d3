"""Structures that are built anew once refits have made them bad: when, how many, and that no hit changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch12.rays import vulkan_build
from chapters.ch12.rays.triangles import build_order
from chapters.ch12.rays.vulkan_quality import figure_of
from common.images.palette import heat
from common.numerics.transforms import pose_looking_at, translation
from common.scene import Animation, AnimationChannel, Deformation, Material
from common.scene.merge import merge_scenes
from common.view.camera import Perspective, View
from tests.support.ray_scenes import soup_scene
from tests.support.traced_pictures import need, opened

pytestmark = [pytest.mark.variants("vulkan", "gl"), pytest.mark.feature("acceleration/refit")]

VIEW = View(pose_looking_at((1.8, 1.5, 2.6), (0.0, 0.0, 0.0)), Perspective(0.9, 0.05))
UNLIT = Material(unlit=True, double_sided=True)
TRIANGLES = 300
OF_STEPS = heat(np.arange(129) / 128.0)


def scattering(count=TRIANGLES, size=0.12):
    """Return a mesh of small triangles that trade places within a second, and stay there."""
    rng = np.random.default_rng(3)
    centres, shapes = rng.uniform(-1, 1, (count, 1, 3)), rng.uniform(-size, size, (count, 3, 3))
    start = np.float32(centres + shapes).reshape(-1, 3)
    end = np.float32(rng.permutation(centres) + shapes).reshape(-1, 3)
    scene = soup_scene([(start, np.arange(3 * count, dtype=np.uint32))], [(0, np.eye(4))], [UNLIT])
    scene.nodes.has_matrix[:] = False
    scene.nodes.weights[0] = np.zeros(1)
    keys = np.array([(0,), (1,), (1,)], np.float64)
    channel = AnimationChannel(0, "weights", np.array((0.0, 1.0, 100.0)), keys, "linear")
    return replace(
        scene,
        deformations=[Deformation(mesh=0, node=0, morph_positions=(end - start)[None])],
        animations=[Animation("scatter", (channel,), 100.0)],
    )


def crowd(count=120, size=0.2):
    """Return a scene of many instances of one triangle, and twice other places of each."""
    rng = np.random.default_rng(5)
    places = rng.uniform(-1, 1, (count, 3))
    corners = np.float32(rng.uniform(-size, size, (3, 3)))
    there = [translation(place) for place in places]
    scene = soup_scene([(corners, np.arange(3, dtype=np.uint32))], [(0, it) for it in there], [UNLIT])
    return scene, *([translation(place) for place in rng.permutation(places)] for _ in range(2))


def place_all(scene, places):
    with scene.edit() as edit:
        for node, place in enumerate(places):
            edit.set_transform(node, matrix=place)


def steps_of(picture):
    """Return the mean steps of rays, from the colours of `ray_view=steps`."""
    far = np.abs(picture[..., None, :] - OF_STEPS).sum(axis=-1)
    return float(far.argmin(axis=-1).mean())


def seen(renderer, time=0.0):
    """Return the picture and the counters of a frame."""
    frame = renderer.render(VIEW, time)
    return frame.image("color_linear").astype(np.float64), frame.work


def test_a_mesh_that_has_bent_too_far_is_built_anew(chapter):
    """The frame that reads the report of two frames before builds: rays take fewer steps from then on."""
    times = (0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    with opened(chapter, scattering(), ray_way="bvh", ray_view="steps") as renderer:
        pictures, work = zip(*(seen(renderer, time) for time in times), strict=True)
    assert [it["ray_refits"] for it in work] == [1, 0, 1, 0, 1, 0, 0, 0]
    assert [it["ray_rebuilds"] for it in work] == [0, 0, 0, 0, 1, 0, 0, 0]
    percent = [it["ray_quality_percent"] for it in work]
    assert percent[:4] == [100] * 4 and percent[4] > 200 and percent[-1] == 100
    steps = [steps_of(picture) for picture in pictures]
    assert steps[2] == steps[3] > 1.5 * steps[4] and steps[4:] == [steps[4]] * 4, steps


def test_hits_are_those_of_the_refitted_mesh(chapter):
    """In every frame, of refits in the new order, too, and when the mesh comes back to where it began."""
    times = (0.0, 1.0, 1.0, 1.0, 0.9, 0.8, 0.7, 0.0, 0.0, 0.0, 0.1, 0.1)
    shown = []
    for most in (2.0, 0.0):
        with opened(
            chapter, scattering(), ray_way="bvh", ray_view="barycentrics", ray_rebuild=most
        ) as renderer:
            shown.append([seen(renderer, time) for time in times])
    for (anew, _), (refitted, _) in zip(*shown, strict=True):
        assert np.array_equal(anew, refitted)
        assert (refitted.sum(axis=-1) > 0).mean() > 0.05
    rebuilds = [[work["ray_rebuilds"] for _, work in one] for one in shown]
    assert rebuilds[0][3] == 1 and sum(rebuilds[0]) >= 2 and sum(rebuilds[1]) == 0


def test_instances_that_trade_places_are_built_anew(chapter):
    """The upper level, with the hits of a renderer that only refits, also after edits of what an instance is."""
    shown = {}
    for view, most in (("steps", 1.5), ("instance", 1.5), ("instance", 0.0)):
        scene, elsewhere, apart = crowd()
        with opened(chapter, scene, ray_way="bvh", ray_view=view, ray_rebuild=most) as renderer:
            frames = [seen(renderer), seen(renderer)]
            place_all(scene, elsewhere)
            frames += [seen(renderer) for _ in range(4)]
            with scene.edit() as edit:
                for node in range(0, len(elsewhere), 3):
                    edit.set_visible(node, False)
                edit.set_transform(7, matrix=translation((0.5, 0.4, 0.3)))
            frames.append(seen(renderer))
            with scene.edit() as edit:
                edit.set_material(0, replace(UNLIT, alpha_mode="mask"))
            frames += [seen(renderer), seen(renderer)]
            place_all(scene, apart)
            frames += [seen(renderer) for _ in range(4)]
        shown[view, most] = frames
    for (anew, _), (refitted, work) in zip(shown["instance", 1.5], shown["instance", 0.0], strict=True):
        assert np.array_equal(anew, refitted) and work["ray_rebuilds"] == 0
    pictures, works = zip(*shown["steps", 1.5], strict=True)
    assert [it["ray_rebuilds"] for it in works] == [0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 0]
    steps = [steps_of(picture) for picture in pictures]
    assert max(steps[4:6]) < 0.5 * steps[3] and max(steps[11:]) < 0.8 * steps[10], steps
    before, hidden = shown["instance", 1.5][5][0], shown["instance", 1.5][6][0]
    assert not np.array_equal(before, hidden)


def test_nothing_is_built_anew_in_a_still_scene(chapter):
    """By a bound that little would exceed: the first frame measures what numpy has built, and no other one anything."""
    with opened(chapter, scattering(), ray_way="bvh", ray_view="steps", ray_rebuild=1.01) as renderer:
        works = [seen(renderer)[1] for _ in range(6)]
        assert [work["ray_refits"] for work in works] == [1, 0, 0, 0, 0, 0]
        assert [work["ray_rebuilds"] for work in works] == [0] * 6
        assert (
            len({work["dispatches"] for work in works[1:]}) == 1
            and works[0]["dispatches"] > works[1]["dispatches"]
        )


def test_a_frame_builds_as_much_as_its_budget(chapter):
    """Two meshes are late at once: with a budget of one they follow one another."""
    for budget, wanted in ((TRIANGLES, [0, 0, 1, 1, 0]), (2 * TRIANGLES, [0, 0, 2, 0, 0])):
        scene, _ = merge_scenes([scattering(), scattering()])
        turned = {"ray_way": "bvh", "ray_view": "steps", "ray_rebuild_budget": budget}
        with opened(chapter, scene, **turned) as renderer:
            seen(renderer, 0.0)
            assert [seen(renderer, 1.0)[1]["ray_rebuilds"] for _ in range(5)] == wanted


# --- the driver's structures ---


@pytest.mark.variants("vulkan")
def test_a_structure_of_the_driver_is_built_anew_where_its_shape_is_another_one(chapter):
    """After it has scattered, and after it has come back. The figure is that of numpy, and no hit changes."""
    need(chapter, "pipeline")
    scene, shown, times = scattering(), [], (0.0, 1.0, 1.0, 1.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0)
    start, indices = scene.positions, scene.indices.reshape(-1, 3)
    order = build_order(indices, start, True)
    figures = [
        figure_of(positions[indices[order]])
        for positions in (start, start + scene.deformations[0].morph_positions[0])
    ]
    for most in (2.0, 0.0):
        with opened(
            chapter, scattering(), ray_way="pipeline", ray_view="barycentrics", ray_rebuild=most
        ) as renderer:
            shown.append([seen(renderer, time) for time in times])
    for (anew, _), (refitted, _) in zip(*shown, strict=True):
        assert np.array_equal(anew, refitted) and (anew.sum(axis=-1) > 0).mean() > 0.05
    rebuilds = [[work["ray_rebuilds"] for _, work in one] for one in shown]
    assert rebuilds == [[0, 0, 0, 1, 0, 0, 0, 1, 0, 0], [0] * 10]
    percent = shown[0][3][1]["ray_quality_percent"]
    assert abs(percent - 100.0 * figures[1] / figures[0]) < 0.6 and percent > 200


@pytest.mark.variants("vulkan")
def test_the_mode_of_a_build_is_that_of_the_report(chapter):
    """One call, in which the structures at the given places are built, and the others are updated from themselves."""
    need(chapter, "pipeline")
    scene, _ = merge_scenes([scattering(20), scattering(30)])
    with opened(chapter, scene, ray_way="pipeline", ray_view="barycentrics") as renderer:
        seen(renderer)
        bottoms, infos = renderer.techniques["rays"]._structures._bottoms, []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                vulkan_build, "record_builds", lambda device, commands, them, counts: infos.extend(them)
            )
            bottoms.record_refits(None, [0, 0], (1,))
    update, build = (
        vk.VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR,
        vk.VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
    )
    assert [info.mode for info in infos] == [update, build]
    assert infos[0].srcAccelerationStructure == infos[0].dstAccelerationStructure == bottoms.moving[0].handle
    assert (
        infos[1].srcAccelerationStructure == vk.NULL
        and infos[1].dstAccelerationStructure == bottoms.moving[1].handle
    )
