"""Paths and surfaces that are not opaque, that no light lights, or that are seen from behind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Orthographic, Perspective, View
from tests.support.path_pictures import (
    SIZE,
    assert_agrees,
    assert_mean,
    light,
    opened,
    runs,
    z_scores,
)
from tests.support.path_scenes import ABOVE, MATTE, light_of_square, places
from tests.support.scenes import nodes_at, quad_scene
from tests.support.shadows import placed, point

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))
"""A cold driver of OpenGL takes 5 to 15 s for the kernel of each of these tests."""

FRONT = View(pose_looking_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0)), Orthographic(1.0, 0.1, 9.0))
BLACK = {"base_color": (0.0, 0.0, 0.0, 1.0), "roughness": 1.0, "metallic": 1.0}
"""Metal without colour: it reflects at grazing angles alone."""


def glowing(red, green, alpha=1.0, mode="blend", **more):
    """Return a material that emits, and covers a part of what is behind it."""
    colors = {**BLACK, "base_color": (0.0, 0.0, 0.0, alpha), "emissive": (red, green, 0.0)}
    return Material(**colors, alpha_mode=mode, **more)


@pytest.mark.feature("path-tracer/core")
def test_layers_cover_what_is_behind_them_by_their_alpha(chapter):
    """Left two blended squares before an emissive one; right two masked ones, of which one is there."""
    wall, back, front = glowing(1.0, 0.0, mode="opaque"), glowing(0.0, 4.0, 0.25), glowing(3.0, 1.0, 0.6)
    here, gone = glowing(0.0, 2.0, 0.6, "mask"), glowing(9.0, 9.0, 0.4, "mask")
    left, right = (-0.75, 0.0), (0.75, 0.0)
    kinds = (wall, back, front, here, gone)
    at = [(0, 0, -1.0), (*left, -0.5), (*left, 0.0), (*right, -0.5), (*right, 0.0)]
    sizes = [(9, 9)] + [(1.5, 3.0)] * 4
    squares = [placed(place, size, (0, 0, 1)) for place, size in zip(at, sizes, strict=True)]
    scene = quad_scene(materials=kinds, matrices=tuple(squares), instance_materials=tuple(range(5)))
    each = [{"path_filter": name} for name in ("box", "centre")]
    pictures = runs(chapter, scene, FRONT, each=each, path_samples=16, path_bounces=0)
    truth = np.zeros((*SIZE[::-1], 3))
    truth[:, : SIZE[0] // 2] = 0.6 * np.array((3.0, 1.0, 0)) + 0.4 * (
        0.25 * np.array((0, 4.0, 0)) + 0.75 * np.array((1.0, 0, 0))
    )
    truth[:, SIZE[0] // 2 :] = 0.0, 2.0, 0.0
    for seen in pictures:
        assert_agrees(z_scores(seen, truth))
        deviation = seen.std(axis=0)[..., :2]
        assert deviation[:, : SIZE[0] // 2].min() > 0.0 == deviation[:, SIZE[0] // 2 :].max()


def ground_and(*above):
    """Return a ground below a point light, with squares of 2 metres at height 1: materials, and where they face."""
    # Not above the middle: rays through the diagonal of a square would meet both of its triangles.
    lamp, pose = point((0.07, 2.0, -0.03), candela=20.0)
    facing = [placed((0, 1, 0), (2, 2), (0, up, 0)) for _, up in above]
    squares = [placed((0, 0, 0), (8, 8), (0, 1, 0)), *facing]
    materials = (MATTE, *(material for material, _ in above))
    scene = quad_scene(
        materials=materials, matrices=tuple(squares), instance_materials=tuple(range(len(squares)))
    )
    nodes = nodes_at(*squares, pose)
    return replace(scene, nodes=nodes, lights=[replace(lamp, node=len(squares))])


LOW = View(pose_looking_at((0.0, 0.7, 0.0), (0.0, 0.0, 0.0), (0, 0, -1)), Orthographic(0.3, 0.1, 9.0))
"""From below the squares of `ground_and`."""

DIRECT = {"path_bounces": 1, "path_filter": "centre"}


@pytest.fixture(scope="module")
def bare(chapter):
    """Return a renderer of the ground without squares."""
    with opened(chapter, ground_and(), **DIRECT) as renderer:
        yield renderer


@pytest.mark.feature("path-tracer/core")
def test_light_passes_blended_and_unlit_surfaces(chapter, bare):
    """A pane lets through what it does not cover, an unlit picture all; each pixel and each frame draws anew."""
    pane = Material(base_color=(1.0, 1.0, 1.0, 0.3), alpha_mode="blend")
    shown = Material(base_color=(0.9, 0.8, 0.7, 1.0), unlit=True, double_sided=True)
    free = light(bare, LOW)
    (seen,) = runs(chapter, ground_and((pane, 1), (shown, 1)), LOW, path_samples=16, **DIRECT)
    assert free.min() > 0.0
    assert_agrees(z_scores(seen, 0.7 * free))
    shares = seen[..., 0] / free[..., 0]
    assert np.unique(np.round(16 * shares)).size > 5 and np.abs(shares.mean(axis=(1, 2)) - 0.7).max() < 0.1
    with opened(chapter, ground_and((shown, 1)), **DIRECT) as renderer:
        above, below = light(renderer, ABOVE), light(renderer, LOW)
    assert np.array_equal(below, free)
    with opened(chapter, ground_and((shown, 1)), path_tracer=False) as renderer:
        drawn = light(renderer, ABOVE)
    middle = np.abs(places(ABOVE)).max(axis=-1) < 0.9
    assert drawn[middle].min() > 0.0 and np.abs(above - drawn)[middle].max() < 1e-6 * drawn.max()


@pytest.mark.feature("path-tracer/core")
def test_backs_are_seen_through_and_cast_shadows(chapter, bare):
    """As in a drawn picture, the eye sees through the back of a square; for light it is there."""
    plain = replace(MATTE, double_sided=False)
    beside = View(pose_looking_at((0.0, 3.0, 0.0), (0, 0, 0), (0, 0, -1)), Orthographic(2.6, 0.1, 9.0))
    free = light(bare, beside)
    with opened(chapter, ground_and((plain, -1)), **DIRECT) as renderer:
        seen = light(renderer, beside)
    at = np.abs(places(beside)).max(axis=-1)
    # The square at half the lamp's height casts a shadow of twice its size.
    shadow, lit = at < 1.75, at > 2.25
    assert shadow.sum() > 40 and lit.sum() > 20
    assert not seen[shadow].any() and np.abs(seen - free)[lit].max() < 1e-5 * free.max()


@pytest.mark.feature("path-tracer/mis")
def test_a_blended_square_lights_by_its_alpha(chapter):
    nits, alpha = np.array((5.0, 3.0, 0.0)), 0.35
    lamp = glowing(nits[0], nits[1], alpha)
    squares = (placed((0, 0, 0), (8, 8), (0, 1, 0)), placed((0, 1, 0), (0.8, 0.8), (0, -1, 0)))
    scene = quad_scene(materials=(MATTE, lamp), matrices=squares, instance_materials=(0, 1))
    truth = alpha * light_of_square(lambda at, direction: nits)
    each = [{"path_strategy": name} for name in ("mis", "bsdf", "lights")]
    for seen in runs(chapter, scene, ABOVE, each=each, path_samples=8, **DIRECT):
        assert_agrees(z_scores(seen, truth))
        assert_mean(seen, truth, 0.05)


# --- the lens ---


@pytest.mark.feature("path-tracer/core")
@pytest.mark.parametrize("focus", [1.5, 0.0], ids=["set", "found"])
def test_an_edge_out_of_focus_spreads_over_the_circle_of_a_thin_lens(chapter, focus):
    """An emissive square at z, focus at s: the part of a disc of radius A v |1/s - 1/z| / 2 on one side of a chord."""
    size, far, tangent, f_number = (33, 5), 4.0, 0.25, 0.02
    glow = Material(**BLACK, emissive=(2.0, 1.0, 0.5), double_sided=True)
    square = placed((5.0, 0.0, -far), (10.0, 20.0), (0, 0, 1))
    # Where the focus is found, it is that of a small square in the middle. It hides some of the edge in its row.
    mark = placed((0.0, 0.0, -1.5), (1e-3, 1e-3), (0, 0, 1))
    scene = quad_scene(glow, matrices=(square, mark), instance_materials=(0, 0))
    view = View(np.eye(4), Perspective(2.0 * np.arctan(tangent), 0.05))
    more = {"aperture": f_number, "focus_distance": focus, "path_samples": 64, "path_bounces": 0}
    (seen,) = runs(chapter, scene, view, size=size, **more)
    v = 0.024 / (2.0 * tangent)
    opening = 1.0 / (1.0 / v + 1.0 / 1.5) / f_number
    radius = 0.5 * opening * v * abs(1.0 / 1.5 - 1.0 / far) * size[1] / 0.024
    assert 4.0 < radius < 14.0
    at = (np.arange(size[0])[:, None] + (np.arange(64) + 0.5) / 64 - size[0] / 2) / radius
    chord = np.clip(at, -1.0, 1.0)
    covered = (0.5 + (chord * np.sqrt(1.0 - chord**2) + np.arcsin(chord)) / np.pi).mean(axis=1)
    truth = covered[None, :, None] * np.array((2.0, 1.0, 0.5))
    rows = [0, 4]  # without the mark
    assert_agrees(z_scores(seen[:, rows], np.broadcast_to(truth, (2, *truth.shape[1:])), block=2))
