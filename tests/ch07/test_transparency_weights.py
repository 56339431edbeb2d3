"""Weighted blending: equal to the formula, exact where no order matters, and finite for any number of layers."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch07.settings import Settings
from chapters.ch07.transparency.model import GROUP, RUN, blocks_of, capacity_of, sizes_of
from common.scene.stability import cases
from common.settings import replaced
from tests.support.bounds import snapping
from tests.support.panes import BEHIND, DISTANCE, panes, random_colors, stack, tilted, view
from tests.twins.layers import Layers, U

SIZE = (32, 24)
EXACT = Settings(color_format="rgba32f", transparency="weighted", background=BEHIND)

pytestmark = pytest.mark.feature("oit/alternatives")


def draw(chapter, scene, size=SIZE, **turned):
    """Return the linear colour of a frame."""
    with chapter.open(scene, size, replaced(EXACT, **turned), outputs={"color_linear"}) as renderer:
        return renderer.render(view()).image("color_linear").astype(np.float64)


@pytest.mark.parametrize("graph", ["deferred", "forward"])
def test_weights_are_those_of_the_paper(chapter, graph):
    matrices, colors = tilted(9, 14)
    scene = panes(matrices, colors)
    truth = Layers(matrices, colors, SIZE, DISTANCE, snapping(chapter.device))
    wanted = truth.weighted(BEHIND, scene.length_scale)
    error = np.abs(draw(chapter, scene, graph=graph) - wanted).max(axis=-1)
    # A distance of 2.5 to 5.5 is off by a rounding of positions and eye, 4 U of 5; the fourth power has four times
    # that relative error, which shifts a mean of values up to 1 by as much. Sums of n terms have n U more. Where a
    # device moves corners, the distances of slanted squares follow.
    moved = np.where(truth.covered, truth.off[:, None, None] / (DISTANCE - truth.z), 0.0).max(axis=0)
    limit = (4 * 4 * 5 / 2.5 + 3 * 14 + 16) * U + 4 * moved
    assert (error <= limit)[~truth.near_edge].all(), error[~truth.near_edge].max() / U


def test_one_layer_and_layers_of_one_colour_are_exact(chapter):
    """c (1 - (1-a)^k) + b (1-a)^k, as with sorted layers: the mean of equal colours needs no weights."""
    color = np.array((0.75, 0.5, 0.25))
    for layers, alpha in ((1, 0.5), (7, 0.25)):
        colors = np.tile((*color, alpha), (layers, 1))
        picture = draw(chapter, panes(stack(np.linspace(-1, 1, layers)), colors), (5, 4))
        left = (1 - alpha) ** layers
        assert np.abs(picture - (color * (1 - left) + BEHIND * left)).max() <= (4 * layers + 8) * U


def test_opaque_and_invisible_layers(chapter):
    """Opacity 0 changes nothing, whatever its colour; opacity 1 lets nothing through."""
    color = (0.25, 0.5, 0.75)
    nothing = draw(chapter, panes(stack(np.zeros(1)), np.array([(*color, 0.0)])), (3, 2))
    assert np.abs(nothing - BEHIND).max() <= 2 * U
    solid = draw(chapter, panes(stack(np.zeros(1)), np.array([(*color, 1.0)])), (3, 2))
    assert np.abs(solid - color).max() <= 4 * U


def test_thousands_of_layers_of_extreme_colours_stay_finite(chapter):
    """The sums reach 65,504 times 3,000 times the number of layers, far beyond half precision."""
    count = 3000
    colors = np.tile((1e6, 1e6, 0.0, 1.0), (count, 1))
    for mode in ("weighted", "lists"):
        scene = panes(stack(np.linspace(3.8, 3.85, count)), colors)
        picture = draw(chapter, scene, (2, 2), transparency=mode, transparency_nodes=count)
        np.testing.assert_allclose(picture, np.broadcast_to((65504.0, 65504.0, 0.0), (2, 2, 3)), rtol=1e-3)


def test_the_error_of_weights_is_that_of_an_order_that_is_not_known(chapter):
    """The weights guess how much a layer is hidden: within a sixth of the range here, and not exactly."""
    matrices, colors = tilted(5, 24)
    truth = Layers(matrices, colors, SIZE, DISTANCE)
    sure = ~(truth.near_edge | truth.close)
    error = np.abs(draw(chapter, panes(matrices, colors)) - truth.sorted_over(BEHIND)).max(axis=-1)[sure]
    print(f"weighted against sorted: mean {error.mean():.3f}, largest {error.max():.3f}")
    assert 0.01 < error.mean() < 1 / 6


@pytest.mark.variants("vulkan")
def test_memory_is_sized_by_the_picture_and_by_what_a_buffer_holds(chapter):
    assert capacity_of((1920, 1080), 4.0, 1 << 30) == 8_294_400
    assert capacity_of((1920, 1080), 4.0, 1 << 20) == (1 << 20) // 16
    assert capacity_of((1, 1), 1 / 64, 1 << 30) == 1
    assert [blocks_of(pixels) for pixels in (1, GROUP * RUN, GROUP * RUN + 1)] == [1, 1, 2]
    sizes = sizes_of((3, 2), 10)
    assert sizes["keys"] + sizes["colors"] == 32 * 10 and sizes["words"] == 4 * (4 + 6)


@pytest.mark.parametrize("size", [(1, 1), (GROUP * RUN, 1), (GROUP * RUN + 1, 1), (64, 65)])
def test_every_pixel_has_its_own_range_at_any_size(chapter, size):
    """Around the blocks of the prefix sum: a pixel that took a layer of another one would have its colour."""
    colors = random_colors(np.random.default_rng(4), 3)
    matrices = stack(np.array([-0.5, 0.0, 0.5]), 3000.0)
    matrices[1, 0, 3] = 3000.0  # on the right half alone
    picture = draw(chapter, panes(matrices, colors), size, transparency="lists")
    truth = Layers(matrices, colors, size, DISTANCE)
    error = np.abs(picture - truth.sorted_over(BEHIND)).max(axis=-1)
    assert (error <= 14 * U)[~truth.near_edge].all()


@pytest.mark.long
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("mode", ["lists", pytest.param("weighted", marks=pytest.mark.long)])
def test_pictures_depend_neither_on_the_scale_nor_on_the_place_of_the_scene(chapter, mode):
    """Weights are those of distances in the scene's length scale; a constant in metres would change them."""
    matrices, colors = tilted(11, 10)
    scene, camera = panes(matrices, colors), view()
    wanted = draw(chapter, scene, transparency=mode, transparency_nodes=10)
    for name, other, seen in cases(scene, camera):
        settings = replaced(EXACT, transparency=mode, transparency_nodes=10)
        with chapter.open(other, SIZE, settings, outputs={"color_linear"}) as renderer:
            picture = renderer.render(seen).image("color_linear").astype(np.float64)
        # Vertices moved by a rounding move an edge over a few pixel centres at most.
        far = np.abs(picture - wanted).max(axis=-1) > 1e-4
        assert far.mean() < 0.01, name
