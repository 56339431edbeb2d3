"""Lists of layers: at each pixel the sorted composite of float64, whatever the order of draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch07.settings import Settings
from common.numerics.transforms import translation
from common.settings import replaced
from tests.support.bounds import snapping
from tests.support.panes import BEHIND, DISTANCE, panes, random_colors, stack, tilted, view
from tests.support.scenes import quad_scene
from tests.twins.layers import Layers, U

SIZE = (48, 32)
EXACT = Settings(color_format="rgba32f", gbuffer_format="full", transparency="lists", background=BEHIND)

pytestmark = pytest.mark.feature("oit/per-pixel-lists")


def draw(chapter, scene, size=SIZE, **turned):
    """Return the linear colour of the second frame, and its work."""
    settings = replaced(EXACT, **turned)
    with chapter.open(scene, size, settings, outputs={"color_linear"}) as renderer:
        renderer.render(view())
        frame = renderer.render(view())
        return frame.image("color_linear").astype(np.float64), frame.work


def bound(count):
    """Return the error of composites of `count` layers of colours up to 1 in single precision.

    A layer's product, 1 - a, the product with it and the sum are four roundings of values up to 1; later layers
    multiply the error by 1 - a at most. Two more are those of the background and of the exposure.
    """
    return (4 * count + 2) * U


@pytest.mark.parametrize("graph", ["deferred", "compute", "forward"])
def test_random_layers_are_composited_as_sorted_ones_in_double_precision(chapter, graph):
    """Squares that pierce one another: the order is another one from pixel to pixel, which no sort of objects gives."""
    matrices, colors = tilted(5, 24)
    picture, work = draw(chapter, panes(matrices, colors), graph=graph, transparency_nodes=24)
    truth = Layers(matrices, colors, SIZE, DISTANCE, snapping(chapter.device))
    sure = ~(truth.near_edge | truth.close)
    assert sure.mean() > 0.8 and truth.count.max() > 8
    error = np.abs(picture - truth.sorted_over(BEHIND)).max(axis=-1)
    assert (error <= bound(truth.count))[sure].all(), error[sure].max()
    assert abs(work["transparent_fragments"] - truth.count.sum()) <= truth.near_edge.sum()
    assert work["transparent_overflow"] == 0


def test_sorted_objects_are_wrong_where_squares_cross_and_lists_are_right(chapter):
    """Two squares that cross like an X: each is in front on one side."""
    slope = 0.5
    matrices = np.stack([np.eye(4), np.eye(4)])
    matrices[:, :2, :2] *= 2
    matrices[0, 2, 0], matrices[1, 2, 0] = slope, -slope
    colors = np.array([(1.0, 0.0, 0.0, 0.5), (0.0, 0.0, 1.0, 0.5)])
    truth = Layers(matrices, colors, SIZE, DISTANCE).sorted_over(BEHIND)
    wrong = {}
    for mode in ("sorted", "lists"):
        picture, _ = draw(chapter, panes(matrices, colors), transparency=mode)
        wrong[mode] = (np.abs(picture - truth).max(axis=-1) > 0.1).mean()
    assert wrong == {"sorted": 0.5, "lists": 0.0}


def test_the_order_of_instances_changes_no_bit(chapter):
    matrices, colors = tilted(6, 20)
    order = np.random.default_rng(1).permutation(len(matrices))
    first, _ = draw(chapter, panes(matrices, colors), transparency_nodes=20)
    other, _ = draw(chapter, panes(matrices[order], colors[order]), transparency_nodes=20)
    assert np.array_equal(first, other)
    objects = [
        draw(chapter, panes(matrices[it], colors[it]), transparency="sorted")[0]
        for it in (np.arange(20), order)
    ]
    assert np.ptp(first) > 0.5 and not np.array_equal(objects[0], first)


def one_mesh(depths, colors, order):
    """Return one object of squares at these depths, with vertex colours, whose triangles are in an order."""
    count = len(depths)
    corners = np.array([(-2, -2), (2, -2), (2, 2), (-2, 2)], np.float32)
    scene = panes(np.eye(4)[None], np.ones((1, 4)))
    positions = np.concatenate(
        [np.column_stack([corners, np.full(4, z, np.float32)]) for z in depths], dtype=np.float32
    )
    triangles = (np.array([(0, 1, 2), (0, 2, 3)])[None] + 4 * np.arange(count)[:, None, None]).reshape(-1, 3)
    meshes = scene.meshes.copy()
    meshes["index_count"], meshes["vertex_count"] = 6 * count, 4 * count
    meshes["bounds_min"], meshes["bounds_max"] = positions.min(axis=0), positions.max(axis=0)
    return replace(
        scene,
        positions=positions,
        normals=np.tile(np.float32((0, 0, 1)), (4 * count, 1)),
        tangents=np.tile(np.float32((1, 0, 0, 1)), (4 * count, 1)),
        uv0=np.zeros((4 * count, 2), np.float32),
        colors=np.repeat(colors, 4, axis=0).astype(np.float32),
        indices=triangles[order].reshape(-1).astype(np.uint32),
        meshes=meshes,
    )


def test_the_order_of_triangles_changes_no_bit(chapter):
    """Triangles of one object, which no sort of objects tells apart."""
    rng = np.random.default_rng(3)
    depths, colors = rng.permutation(np.linspace(-1, 1, 12)), random_colors(rng, 12)
    orders = [np.arange(24), rng.permutation(24)]
    one, other = (
        draw(chapter, one_mesh(depths, colors, order), transparency_nodes=12)[0] for order in orders
    )
    assert np.array_equal(one, other)
    truth = Layers(stack(depths), colors, SIZE, DISTANCE)
    # Interpolated vertex colours have three products and two sums more.
    assert np.abs(one - truth.sorted_over(BEHIND)).max() <= bound(12) + 5 * U


def test_equal_depths_are_composited_by_instance_whatever_is_drawn_first(chapter):
    """The box of the first object reaches towards the camera: a sort of objects draws it last, and so on top."""
    colors = np.array([(0.0, 0.0, 1.0, 0.5), (1.0, 0.0, 0.0, 0.5)])  # in the order of panes' materials
    scene = panes(stack(np.zeros(2)), colors)
    meshes = scene.meshes.copy()
    meshes["bounds_max"][0, 2] = 2.0
    scene = replace(scene, meshes=meshes)
    shown = {mode: draw(chapter, scene, transparency=mode)[0] for mode in ("lists", "sorted")}
    truth = Layers(stack(np.zeros(2)), colors, SIZE, DISTANCE)
    for mode, order in (("lists", (0, 1)), ("sorted", (1, 0))):
        assert np.abs(shown[mode] - truth.sorted_over(BEHIND, order)).max() < bound(2), mode


def test_equal_depths_of_an_object_are_composited_by_triangle(chapter):
    depths, colors = np.zeros(5), random_colors(np.random.default_rng(8), 5)
    picture, _ = draw(chapter, one_mesh(depths, colors, np.arange(10)), transparency_nodes=5)
    truth = Layers(stack(depths), colors, SIZE, DISTANCE).sorted_over(BEHIND, range(5))
    assert np.abs(picture - truth).max() <= bound(5) + 5 * U


@pytest.mark.parametrize(
    ("layers", "alpha"), [(1, 0.5), (16, 0.25), pytest.param(17, 0.25, marks=pytest.mark.core), (40, 0.0625)]
)
def test_layers_of_one_colour_have_a_closed_form(chapter, layers, alpha):
    """c (1 - (1-a)^k) + b (1-a)^k, on both sides of the length from which a list is a heap."""
    color = np.array((0.75, 0.5, 0.25))
    colors = np.tile((*color, alpha), (layers, 1))
    scene = panes(stack(np.linspace(-1, 1, layers)), colors)
    picture, work = draw(chapter, scene, (9, 7), transparency_nodes=layers)
    left = (1 - alpha) ** layers
    assert np.abs(picture - (color * (1 - left) + BEHIND * left)).max() <= bound(layers)
    assert work["transparent_fragments"] == work["transparent_capacity"] == layers * 9 * 7


def test_ten_thousand_layers_in_a_pixel_are_all_composited_in_order(chapter):
    """Squares in a mixed order over one pixel: the last rounding errors fade by 1 - a from layer to layer."""
    count, alpha = 10_000, 2.0**-12
    rng = np.random.default_rng(2)
    depths = rng.permutation(np.linspace(-1.5, 1.5, count))
    shades = np.array([(1.0, 0.0, 0.25, alpha), (0.0, 1.0, 0.75, alpha)])
    which = (np.argsort(np.argsort(depths)) > count // 2).astype(int)  # the nearer half has another colour
    matrices = stack(depths, 1.0)
    matrices[:, :2, :2] *= 0.25
    matrices[:, :2, 3] = 0.5  # over one pixel of 2x2
    picture, work = draw(chapter, panes(matrices, shades[which]), (2, 2), transparency_nodes=2500)
    assert work["transparent_fragments"] == work["transparent_capacity"] == count
    truth = np.array((BEHIND,) * 3)
    for row in shades[which][np.argsort(depths)]:
        truth = row[:3] * alpha + truth * (1 - alpha)
    # The sum of 4 U (1-a)^j over all layers is below 4 U / a.
    assert np.abs(picture[0, 1] - truth).max() <= 4 * U / alpha
    untouched = np.abs(picture - BEHIND).max(axis=-1) <= 2 * U
    assert untouched.tolist() == [[True, False], [True, True]]


def test_solid_surfaces_hide_layers_behind_them(chapter):
    """What fails the depth test is neither counted nor stored."""
    matrices = np.stack([*stack(np.array([-0.5, 0.5])), translation((1.0, 0.0, 0.0))])
    blended = {"alpha_mode": "blend", "unlit": True}
    base = quad_scene().materials[0]
    scene = quad_scene(
        materials=(
            replace(base, base_color=(1.0, 0.0, 0.0, 0.5), **blended),
            replace(base, base_color=(0.5, 0.5, 0.5, 1.0), unlit=True),
        ),
        matrices=tuple(matrices),
        instance_materials=(0, 0, 1),
    )
    picture, work = draw(chapter, scene, (8, 8))
    assert work["transparent_fragments"] == 2 * 32 + 32, "the right half has a solid square between the two"
    halves = picture[4, 1, 0], picture[4, 6, 0]
    assert np.allclose(halves, (0.75 + 0.25 * BEHIND, 0.5 + 0.5 * 0.5), atol=8 * U)
