"""The path tracer: sums of frames, and light whose mean is known: furnaces, lights, and what is reflected twice."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from common.environment import constant
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Orthographic, View
from tests.support.path_pictures import (
    SIZE,
    assert_agrees,
    assert_mean,
    light,
    opened,
    runs,
    runs_of,
    turned,
    z_scores,
)
from tests.support.path_scenes import ABOVE, AROUND, MATTE, floor_under, light_of_square, lit_yard
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import box, spot
from tests.support.traced_pictures import picture
from tests.twins.shading import metallic_roughness
from tests.twins.shading_environment import albedo_table, weights

pytestmark = pytest.mark.variants("vulkan", "gl")

COLD = pytest.mark.variants("vulkan", "gl", long=("gl",))
"""A cold driver of OpenGL takes about 6 s for the kernel of each of these."""


NITS = np.array((5.0, 3.0, 1.0))
GLOW = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=tuple(NITS), roughness=1.0, metallic=1.0)


@pytest.fixture(scope="module")
def lit(chapter):
    """Return a renderer of `lit_yard` with live knobs."""
    with opened(chapter, lit_yard()) as renderer:
        yield renderer


@pytest.fixture(scope="module")
def glowing(chapter):
    """Return a renderer of an emissive square above a ground, with live knobs."""
    with opened(chapter, floor_under(GLOW), path_bounces=1, path_filter="centre") as renderer:
        yield renderer


# --- sums of frames ---


@pytest.mark.core
@pytest.mark.feature("path-tracer/accumulation")
def test_the_picture_is_the_mean_of_all_frames(lit):
    """Frames alone, then the same paths in a running mean."""
    with turned(lit, path_average=False):
        frames = [light(lit, AROUND) for _ in range(5)]
        assert lit.render(AROUND).work["path_samples"] == 6
    with turned(lit):
        shown = [light(lit, AROUND) for _ in range(5)]
    assert np.abs(frames[1] - frames[0]).max() > 0.01 * frames[0].max()
    for count in (1, 2, 5):
        mean = np.mean(frames[:count], axis=0)
        assert np.abs(shown[count - 1] - mean).max() <= 2e-6 * mean.max()


@pytest.mark.feature("path-tracer/accumulation")
def test_several_paths_in_a_frame_are_those_of_several_frames(lit):
    with turned(lit):
        one_by_one = light(lit, AROUND, 6)
    with turned(lit, path_samples=3):
        together = light(lit, AROUND, 2)
    with turned(lit, path_samples=4, path_first=2):
        others = light(lit, AROUND)
        lit.settings.paths.path_first, lit.settings.paths.path_samples = 0, 2
        first = light(lit, AROUND)
    assert np.abs(together - one_by_one).max() <= 2e-6 * one_by_one.max()
    assert np.abs((4 * others + 2 * first) / 6 - one_by_one).max() <= 2e-6 * one_by_one.max()


@COLD
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
        renderer.resize((20, 8))
        assert [count(moved) for _ in range(2)] == [1, 2]
        after = light(renderer, AROUND)
    with opened(chapter, scene, (20, 8), path_bounces=2) as renderer:
        assert np.array_equal(after, light(renderer, AROUND))


@pytest.mark.feature("path-tracer/accumulation")
@pytest.mark.parametrize(
    ("knobs", "places"),
    [
        ({"path_error": 0.12, "path_sequence": "sobol"}, [(8, 0), (4, 8), (6, 0)]),
        ({}, [(3, 5), (8, 8)]),
    ],
)
def test_a_part_of_a_larger_picture_has_its_paths(lit, knobs, places):
    """Bit for bit: sums go on, whole blocks of 4x4 pixels stop at the same paths, and another part begins anew."""
    technique = lit.techniques["paths"]
    with turned(lit, path_samples=16, **knobs):
        whole = light(lit, AROUND, 4)
        traced = lit.render(AROUND).work["path_total"] / (5 * 16 * 12 * 16)
        assert 0.4 < traced < 1.0 if knobs else traced == 1.0
        try:
            lit.resize((8, 4))
            for x, y in places:
                technique.crop = (x, y, *SIZE)
                part, wanted = light(lit, AROUND, 4), whole[y : y + 4, x : x + 8]
                inner = slice(-x % 4, 8 - x % 4) if knobs else slice(None)
                assert np.array_equal(part[:, inner], wanted[:, inner])
        finally:
            technique.crop = None
            lit.resize(SIZE)


@pytest.mark.feature("path-tracer/accumulation")
def test_a_finished_picture_rests(lit):
    with turned(lit, path_samples=3, path_limit=7):
        counts = [lit.render(AROUND).work["path_samples"] for _ in range(3)]
        assert counts == [3, 6, 7] and lit.idle(AROUND)
        finished = light(lit, AROUND)
        assert np.array_equal(light(lit, AROUND, 3), finished)
        lit.settings.paths.path_limit = 8
        assert not lit.idle(AROUND)
        assert not np.array_equal(light(lit, AROUND), finished)


# --- closed forms ---


def furnace(material, energy):
    """Return a cube in light of 2 nits from everywhere, and (3,) what it reflects to a view that sees it alone.

    The view looks along the cube's diagonal, so it sees three sides, all at the same angle. A path that the cube
    reflects does not meet it again.
    """
    scene = replace(quad_scene(material, matrices=tuple(box((0, 0, 0), 2.0))), environment=constant(2.0))
    view = View(pose_looking_at((3.0, 3.0, 3.0), (0.0, 0.0, 0.0)), Orthographic(0.6, 0.1, 20.0))
    table = albedo_table(3.0**-0.5, material.roughness)
    base, metallic = np.array(material.base_color[:3]), np.array(material.metallic)
    return scene, view, 2.0 * sum(weights(base, metallic, table, energy))


COATED = Material(base_color=(0.9, 0.5, 0.0, 1.0), roughness=0.8, metallic=0.25)


@pytest.fixture(scope="module")
def heated(chapter):
    """Return a renderer of a cube in a furnace with live knobs, its scene and view, and what is reflected."""
    scene, view, wanted = furnace(COATED, "gltf")
    with opened(chapter, scene, path_strategy="bsdf") as renderer:
        yield renderer, scene, view, wanted


@COLD
@pytest.mark.core
@pytest.mark.feature("path-tracer/core")
def test_a_cube_in_a_furnace_shows_its_albedo(heated):
    """The sums by Fresnel's, Smith's and Lambert's terms, times the light. What is black in all of them shows 0."""
    renderer, scene, view, wanted = heated
    both = [{"path_strategy": "bsdf"}, {"path_strategy": "mis"}]
    for seen in runs_of(renderer, view, each=both, path_samples=12):
        assert_agrees(z_scores(seen, wanted))
        assert_mean(seen, wanted, 4e-3)
        assert not np.abs(seen.mean(axis=(0, 1, 2)) - 0.98 * wanted).max() < 4e-3 * wanted.max()
    before = scene.materials[0]
    try:
        with scene.edit() as edit:
            edit.set_material(0, replace(before, base_color=(0.0, 0.0, 0.0, 1.0), unlit=True))
        assert not light(renderer, view).any()
    finally:
        with scene.edit() as edit:
            edit.set_material(0, before)


@pytest.mark.feature("path-tracer/russian-roulette")
def test_paths_end_by_what_they_carry(heated):
    """Paths end with probability 1 - p, and else count 1/p times: each is compared with itself without roulette."""
    renderer, _, view, _ = heated
    with turned(renderer, path_average=False):
        carried = np.stack([light(renderer, view) for _ in range(16)]) / 2.0
    with turned(renderer, path_average=False, path_roulette=0):
        seen = np.stack([light(renderer, view) for _ in range(16)]) / 2.0
    stays = np.minimum(carried.max(axis=-1), 1.0)
    went_on = seen.any(axis=-1)
    assert stays.min() < 0.7 and 0.3 < went_on.mean() < 0.98
    assert np.abs(seen - carried / np.maximum(stays, 1e-9)[..., None])[went_on].max() < 1e-4
    edges = np.quantile(stays, (0.0, 0.5, 1.0))  # the halves that carry less and more
    for low, high in pairwise(edges):
        part = (stays >= low) & (stays <= high)
        p = stays[part]
        assert abs((went_on[part] - p).sum()) < 4.0 * np.sqrt((p * (1.0 - p)).sum())
    assert not abs((went_on - stays**2).sum()) < 4.0 * np.sqrt((stays * (1.0 - stays)).sum())
    difference = (seen - carried).reshape(-1, 3)
    assert (np.abs(difference.mean(axis=0)) < 4.0 * difference.std(axis=0) / np.sqrt(len(difference))).all()


@pytest.mark.variants("vulkan")
@pytest.mark.feature("path-tracer/core")
def test_a_white_cube_in_a_furnace_cannot_be_seen(chapter):
    """With energy=conserving a white surface reflects all light, to the precision of a table in half floats."""
    white = Material(base_color=(1.0, 1.0, 1.0, 1.0), roughness=0.8, metallic=0.25)
    scene, view, wanted = furnace(white, "conserving")
    assert np.abs(wanted - 2.0).max() < 1e-3
    (seen,) = runs(chapter, scene, view, path_samples=16, energy="conserving")
    assert np.abs(seen.mean(axis=(0, 1, 2)) - 2.0).max() < 6e-3


@COLD
@pytest.mark.feature("path-tracer/core")
def test_direct_light_is_that_of_the_drawn_picture(chapter, lit):
    """Lights of all kinds, shadows by rays, one reflection: no random number is left with rays through centres."""
    traced = picture(chapter, lit_yard(), AROUND, SIZE, rays="whole", ray_bounces=0, ray_way="auto")
    with turned(lit, path_filter="centre", path_bounces=1):
        seen = light(lit, AROUND)
    with turned(lit, path_filter="centre", path_bounces=0):
        assert not light(lit, AROUND).any()
    assert traced.std() > 0.2 * traced.mean() and (traced == 0).any()
    assert np.abs(seen - traced).max() < 1e-5 * traced.max()


@COLD
@pytest.mark.feature("path-tracer/mis")
def test_an_emissive_square_lights_the_ground_by_each_strategy(glowing):
    """Rays that are reflected, rays towards the square, and both: each alone has the mean of the quadrature."""
    truth = light_of_square(lambda lamp, direction: NITS)
    knobs = [{"path_strategy": name} for name in ("mis", "bsdf", "lights")]
    seen = runs_of(glowing, ABOVE, each=knobs, path_samples=8)
    for one in seen:
        assert_agrees(z_scores(one, truth))
        assert_mean(one, truth, 0.03)
    errors = [one.std(axis=0).mean() for one in seen]
    assert errors[0] < 0.7 * errors[1] and errors[0] < 1.5 * errors[2]


@pytest.mark.parametrize("points", [16, pytest.param(64, marks=pytest.mark.long)])
def test_points_of_a_sequence_err_less_than_random_ones(glowing, points):
    """Each half of the square light has every second of the even points, in random order: what is even is half gone."""
    each = [{"path_sequence": name} for name in ("pcg", "sobol")]
    random, even = runs_of(glowing, ABOVE, each=each, path_samples=points, path_strategy="lights")
    assert_agrees(z_scores(even, light_of_square(lambda lamp, direction: NITS)))
    assert 0.0 < even.std(axis=0).mean() < 0.75 * random.std(axis=0).mean()


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

    truth = light_of_square(reflected, half)
    assert truth[..., 0].min() > 0.05 * truth[..., 0].max() > 0.0
    with opened(chapter, scene, path_bounces=2, path_filter="centre") as renderer:
        (seen,) = runs_of(renderer, ABOVE, path_samples=8)
        with turned(renderer, path_bounces=1):
            assert not light(renderer, ABOVE).any()
    assert_agrees(z_scores(seen, truth))
    assert_mean(seen, truth, 0.04)


@COLD
@pytest.mark.feature("path-tracer/mis")
def test_edits_of_what_emits_are_followed(chapter):
    """A lamp is hidden, shown, put out and lit again; its triangles have places in the tables only while it emits."""
    scene, truth = floor_under(GLOW), light_of_square(lambda lamp, direction: NITS)
    more = {"path_bounces": 1, "path_samples": 32, "path_filter": "centre"}
    with opened(chapter, scene, **more) as renderer:

        def seen(edit, frames=1):
            with scene.edit() as change:
                edit(change)
            return light(renderer, ABOVE, frames)

        assert not seen(lambda change: change.set_visible(1, False)).any()
        shown = seen(lambda change: change.set_visible(1, True), 2)
        assert np.abs(shown - truth).mean() < 0.05 * truth.mean()
        dark = replace(GLOW, emissive=(0.0, 0.0, 0.0))
        assert not seen(lambda change: change.set_material(1, dark)).any()
        half = replace(GLOW, emissive=tuple(0.5 * NITS))
        dimmed = seen(lambda change: change.set_material(1, half), 2)
        assert np.abs(2.0 * dimmed - truth).mean() < 0.05 * truth.mean()
    # Of a scene that is opened dark there is no room for triangles: reflected rays find the lamp.
    scene = floor_under(replace(GLOW, emissive=(0.0, 0.0, 0.0)))
    with opened(chapter, scene, **more) as renderer:
        assert not light(renderer, ABOVE).any()
        with scene.edit() as change:
            change.set_material(1, GLOW)
        assert abs(light(renderer, ABOVE, 4).mean() / truth.mean() - 1.0) < 0.05
