"""The path tracer: sums of frames, and light whose mean is known: furnaces, lights, and what is reflected twice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.environment import constant
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Orthographic, View
from tests.support.path_pictures import SIZE, assert_agrees, light, opened, runs, z_scores
from tests.support.path_scenes import ABOVE, AROUND, MATTE, floor_under, light_of_square, lit_yard
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import spot
from tests.support.traced_pictures import picture
from tests.twins.shading import metallic_roughness
from tests.twins.shading_environment import albedo_table, weights

pytestmark = pytest.mark.variants("vulkan", "gl")


# --- sums of frames ---


@pytest.mark.core
@pytest.mark.feature("path-tracer/accumulation")
def test_the_picture_is_the_mean_of_all_frames(chapter):
    """A renderer shows the mean; another one shows each frame alone, with the same paths."""
    scene = lit_yard()
    with opened(chapter, scene, path_average=False) as renderer:
        frames = [light(renderer, AROUND) for _ in range(5)]
        assert renderer.render(AROUND).work["path_samples"] == 6
    with opened(chapter, scene) as renderer:
        shown = [light(renderer, AROUND) for _ in range(5)]
    assert np.abs(frames[1] - frames[0]).max() > 0.01 * frames[0].max()
    for count in (1, 2, 5):
        mean = np.mean(frames[:count], axis=0)
        assert np.abs(shown[count - 1] - mean).max() <= 2e-6 * mean.max()


@pytest.mark.feature("path-tracer/accumulation")
def test_several_paths_in_a_frame_are_those_of_several_frames(chapter):
    scene = lit_yard()
    with opened(chapter, scene) as renderer:
        one_by_one = light(renderer, AROUND, 6)
    with opened(chapter, scene, path_samples=3) as renderer:
        together = light(renderer, AROUND, 2)
    with opened(chapter, scene, path_samples=4, path_first=2) as renderer:
        others = light(renderer, AROUND)
        renderer.settings.paths.path_first, renderer.settings.paths.path_samples = 0, 2
        first = light(renderer, AROUND)
    assert np.abs(together - one_by_one).max() <= 2e-6 * one_by_one.max()
    assert np.abs((4 * others + 2 * first) / 6 - one_by_one).max() <= 2e-6 * one_by_one.max()


@pytest.mark.feature("path-tracer/accumulation")
def test_sums_begin_anew_when_anything_changes(chapter):
    """Each change gives the picture of a renderer that saw nothing before; frames without one go on."""
    scene, moved = lit_yard(), replace(AROUND, world_from_view=ABOVE.world_from_view)

    def edit():
        with scene.edit() as change:
            change.set_visible(3, not scene.instances.visible[3])

    with opened(chapter, scene) as renderer:
        knobs = renderer.settings.paths

        def count(view):
            return renderer.render(view).work["path_samples"]

        assert [count(AROUND) for _ in range(3)] == [1, 2, 3]
        assert [count(moved) for _ in range(2)] == [1, 2]
        edit()
        assert [count(moved) for _ in range(2)] == [1, 2]
        knobs.path_bounces = 2
        assert [count(moved) for _ in range(2)] == [1, 2]
        renderer.reset_history("test")
        assert [count(moved) for _ in range(2)] == [1, 2]
        renderer.resize((20, 16))
        assert [count(moved) for _ in range(2)] == [1, 2]
        after = light(renderer, AROUND)
    with opened(chapter, scene, (20, 16), path_bounces=2) as renderer:
        assert np.array_equal(after, light(renderer, AROUND))


@pytest.mark.feature("path-tracer/accumulation")
def test_a_finished_picture_rests(chapter):
    with opened(chapter, lit_yard(), path_samples=3, path_limit=7) as renderer:
        counts = [renderer.render(AROUND).work["path_samples"] for _ in range(3)]
        assert counts == [3, 6, 7] and renderer.idle(AROUND)
        finished = light(renderer, AROUND)
        assert np.array_equal(light(renderer, AROUND, 3), finished)
        renderer.settings.paths.path_limit = 8
        assert not renderer.idle(AROUND)
        assert not np.array_equal(light(renderer, AROUND), finished)


# --- closed forms ---


def furnace(material, energy):
    """Return a square in light of 2 nits from everywhere, seen at an angle, and (3,) what it reflects."""
    scene = replace(quad_scene(material, matrices=(np.eye(4) * (9, 9, 9, 1),)), environment=constant(2.0))
    view = View(pose_looking_at((1.5, 1.0, 2.0), (0.0, 0.0, 0.0)), Orthographic(0.5, 0.1, 9.0))
    table = albedo_table(view.world_from_view[2, 2], material.roughness)
    base, metallic = np.array(material.base_color[:3]), np.array(material.metallic)
    return scene, view, 2.0 * sum(weights(base, metallic, table, energy))


@pytest.mark.core
@pytest.mark.feature("path-tracer/core")
def test_a_square_in_a_furnace_shows_its_albedo(chapter):
    """The sums by Fresnel's, Smith's and Lambert's terms; without light it is black."""
    coated = Material(base_color=(1.0, 0.5, 0.0, 1.0), roughness=0.8, metallic=0.25)
    scene, view, wanted = furnace(coated, "gltf")
    (seen,) = runs(chapter, scene, view, path_samples=32)
    assert_agrees(z_scores(seen, wanted))
    assert np.abs(seen.mean(axis=(0, 1, 2)) - wanted).max() < 2e-3 * wanted.max()
    with opened(chapter, replace(scene, environment=None)) as renderer:
        assert not light(renderer, view).any()


@pytest.mark.variants("vulkan")
@pytest.mark.feature("path-tracer/core")
def test_a_white_square_in_a_furnace_cannot_be_seen(chapter):
    """With energy=conserving a white surface reflects all light, to the precision of a table in half floats."""
    white = Material(base_color=(1.0, 1.0, 1.0, 1.0), roughness=0.8, metallic=0.25)
    scene, view, wanted = furnace(white, "conserving")
    assert np.abs(wanted - 2.0).max() < 1e-3
    (seen,) = runs(chapter, scene, view, path_samples=32, energy="conserving")
    assert np.abs(seen.mean(axis=(0, 1, 2)) - 2.0).max() < 4e-3


@pytest.mark.feature("path-tracer/core")
def test_direct_light_is_that_of_the_drawn_picture(chapter):
    """Lights of all kinds, shadows by rays, one reflection: no random number is left with rays through centres."""
    scene = lit_yard()
    traced = picture(chapter, scene, AROUND, SIZE, rays="whole", ray_bounces=0, ray_way="auto")
    with opened(chapter, scene, path_filter="centre", path_bounces=1) as renderer:
        seen = light(renderer, AROUND)
    with opened(chapter, scene, path_filter="centre", path_bounces=0) as renderer:
        assert not light(renderer, AROUND).any()
    assert traced.std() > 0.2 * traced.mean() and (traced == 0).any()
    assert np.abs(seen - traced).max() < 1e-5 * traced.max()


@pytest.mark.feature("path-tracer/mis")
def test_an_emissive_square_lights_the_ground_by_each_strategy(chapter):
    """Rays that are reflected, rays towards the square, and both: each alone has the mean of the quadrature."""
    nits = np.array((5.0, 3.0, 1.0))
    glow = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=tuple(nits), roughness=1.0, metallic=1.0)
    truth = light_of_square(lambda lamp, direction: nits)
    knobs = [{"path_strategy": name} for name in ("mis", "bsdf", "lights")]
    more = {"path_bounces": 1, "path_samples": 8, "path_filter": "centre"}
    seen = runs(chapter, floor_under(glow), ABOVE, each=knobs, **more)
    for one in seen:
        assert_agrees(z_scores(one, truth))
        assert abs(one.mean() / truth.mean() - 1.0) < 0.02
    errors = [one.std(axis=0).mean() for one in seen]
    assert errors[0] < 0.7 * errors[1] and errors[0] < 1.5 * errors[2]


def test_points_of_a_sequence_err_less_than_random_ones(chapter):
    """Each half of the square light has every second of 64 even points, in random order: what is even is half gone."""
    glow = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=(5.0, 3.0, 1.0), roughness=1.0, metallic=1.0)
    more = {"path_bounces": 1, "path_samples": 64, "path_filter": "centre", "path_strategy": "lights"}
    each = [{"path_sequence": name} for name in ("pcg", "sobol")]
    random, even = runs(chapter, floor_under(glow), ABOVE, each=each, **more)
    truth = light_of_square(lambda lamp, direction: np.array((5.0, 3.0, 1.0)))
    assert_agrees(z_scores(even, truth))
    assert 0.0 < even.std(axis=0).mean() < 0.7 * random.std(axis=0).mean()


@pytest.mark.feature("path-tracer/core")
def test_light_that_is_reflected_twice(chapter):
    """A spot light shines up at a square, which alone lights the ground: a quadrature over the square."""
    half, foot, candela, outer = 0.8, 0.2, 30.0, math.radians(40)
    scene = floor_under(replace(MATTE, double_sided=False), half)  # the eye sees through its back
    lamp, pose = spot((0.0, foot, 0.0), (0.0, 1.0, 0.0), outer, candela)
    scene = replace(scene, lights=[replace(lamp, node=2)], nodes=nodes_at(*scene.nodes.matrix, pose))

    def reflected(at, towards):
        to_light = np.array((0.0, foot, 0.0)) - at
        distance = np.linalg.norm(to_light, axis=-1, keepdims=True)
        to_light = np.broadcast_to(to_light / distance, towards.shape)
        low, high = math.cos(outer), math.cos(0.8 * outer)
        cone = np.clip((-to_light[..., 1:2] - low) / (high - low), 0, 1) ** 2
        down = np.broadcast_to((0.0, -1.0, 0.0), towards.shape)
        base = np.broadcast_to(MATTE.base_color[:3], towards.shape)
        matte = np.zeros(towards.shape[:-1]), np.ones(towards.shape[:-1])
        return candela * cone / distance**2 * metallic_roughness(down, to_light, -towards, base, *matte)

    truth = light_of_square(reflected, half, nodes=48)
    assert truth[..., 0].min() > 0.05 * truth[..., 0].max() > 0.0
    (seen,) = runs(chapter, scene, ABOVE, path_bounces=2, path_samples=16, path_filter="centre")
    assert_agrees(z_scores(seen, truth))
    assert abs(seen.mean() / truth.mean() - 1.0) < 0.02
    with opened(chapter, scene, path_bounces=1) as renderer:
        assert not light(renderer, ABOVE).any()


@pytest.mark.feature("path-tracer/mis")
def test_edits_of_what_emits_are_followed(chapter):
    """A lamp is hidden, shown, put out and lit again; its triangles have places in the tables only while it emits."""
    nits = np.array((5.0, 3.0, 1.0))
    glow = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=tuple(nits), roughness=1.0, metallic=1.0)
    scene, truth = floor_under(glow), light_of_square(lambda lamp, direction: nits)
    more = {"path_bounces": 1, "path_samples": 32, "path_filter": "centre"}
    with opened(chapter, scene, **more) as renderer:

        def seen(edit):
            with scene.edit() as change:
                edit(change)
            return light(renderer, ABOVE, 2)

        assert not seen(lambda change: change.set_visible(1, False)).any()
        assert np.abs(seen(lambda change: change.set_visible(1, True)) - truth).mean() < 0.05 * truth.mean()
        dark = replace(glow, emissive=(0.0, 0.0, 0.0))
        assert not seen(lambda change: change.set_material(1, dark)).any()
        half = replace(glow, emissive=tuple(0.5 * nits))
        assert (
            np.abs(2.0 * seen(lambda change: change.set_material(1, half)) - truth).mean()
            < 0.05 * truth.mean()
        )
    # Of a scene that is opened dark there is no room for triangles: reflected rays find the lamp.
    scene = floor_under(replace(glow, emissive=(0.0, 0.0, 0.0)))
    with opened(chapter, scene, **more) as renderer:
        assert not light(renderer, ABOVE).any()
        with scene.edit() as change:
            change.set_material(1, glow)
        assert abs(light(renderer, ABOVE, 4).mean() / truth.mean() - 1.0) < 0.05
