"""Automatic exposure of blended surfaces with nothing behind them: their own light counts, and the grey does not."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from chapters.ch07.hdr import model
from chapters.ch07.settings import Settings
from common.numerics.transforms import translation
from common.scene import Material
from common.settings import replaced
from tests.support.glowing import exposure_of
from tests.support.scenes import facing, quad_scene

pytestmark = pytest.mark.variants("vulkan", "gl")

GREY = 0.5
"""Of the background: seen through glass and taken for light, it alone would be more than the key of 0.18."""

PLAIN = Settings(
    graph="deferred",
    ambient=0.0,
    default_light=False,
    color_format="rgba32f",
    msaa=1,
    background=GREY,
    transparency_nodes=64,
)
SIZE = (24, 16)
MODES = ("histogram", "mips")
WAYS = ("sorted", "weighted", "lists")


def glowing_panes(layers, left_half=True):
    """Return panes of (opacity, nits), the farthest first, over the left half of the picture or all of it."""
    matrices = []
    for number in range(len(layers)):
        matrix = translation((-2.0 if left_half else 0.0, 0.0, 0.5 * number / len(layers)))
        matrix[0, 0] = matrix[1, 1] = 2.0
        matrices.append(matrix)
    materials = tuple(
        Material(
            base_color=(0.0, 0.0, 0.0, opacity),
            metallic=1.0,
            roughness=1.0,
            emissive=(nits,) * 3,
            alpha_mode="blend",
        )
        for opacity, nits in layers
    )
    return quad_scene(
        materials=materials, matrices=tuple(matrices), instance_materials=tuple(range(len(layers)))
    )


def light_of(layers):
    """Return the nits of the layers over black."""
    light = 0.0
    for opacity, nits in layers:
        light = opacity * nits + (1.0 - opacity) * light
    return light


def found(chapter, scene, **knobs):
    """Return the exposures of some frames; that of the first one is the view's."""
    with closing(chapter.open(scene, SIZE, replaced(PLAIN, **knobs))) as renderer:
        view = facing(ev100=6.0)
        return [exposure_of(renderer, renderer.render(view, 10.0 * number)) for number in range(6)]


ONE, THREE = ((0.25, 40.0),), ((0.5, 900.0), (0.25, 900.0), (0.75, 900.0))


@pytest.mark.parametrize(
    ("layers", "way", "mode"),
    [
        pytest.param(layers, way, mode, marks=[pytest.mark.long] * ((at + number + of) % 2))
        for of, layers in enumerate((ONE, THREE))
        for at, way in enumerate(WAYS)
        for number, mode in enumerate(MODES)
    ],
)
def test_panes_alone_are_measured_without_the_grey_behind_them(chapter, mode, way, layers):
    """E = k / L, whatever shows through; the mean over the picture has them on half of it.

    Layers of one light are a case that weights composite as lists do. What lists let through is known to 1/4096 of a
    stop, of which a layer is rounded by half: 3 layers by a part of 3e-4 of the grey, and the bins by 2e-4.
    """
    light = light_of(layers) * (1.0 if mode == "histogram" else 0.5)
    got = found(chapter, glowing_panes(layers), exposure=mode, transparency=way)
    bound = 3 * 0.5 / 4096 * GREY / 0.18 + 6e-4
    np.testing.assert_allclose(got[-1], 0.18 / light, rtol=bound)


@pytest.mark.parametrize("mode", MODES)
def test_other_graphs_and_several_samples_do_the_same(chapter, mode):
    layers = ((0.5, 900.0), (0.25, 100.0))
    light = light_of(layers)
    for knobs in ({"graph": "forward"}, {"graph": "forward", "msaa": 4}, {"graph": "compute"}):
        got = found(chapter, glowing_panes(layers, left_half=False), exposure=mode, **knobs)
        np.testing.assert_allclose(got[-1], 0.18 / light, rtol=2e-3)


@pytest.mark.parametrize("way", WAYS)
def test_glass_that_lets_all_light_through_is_not_measured(chapter, way):
    """It shows nothing but the grey: the view's exposure stays."""
    got = found(chapter, glowing_panes(((0.0, 900.0),)), exposure="histogram", transparency=way)
    assert len(set(got)) == 1


def test_only_automatic_exposure_asks_for_what_layers_let_through(chapter):
    """The kernel that composites has no part for it otherwise; and the picture of the first frame is the same."""
    scene, pictures, built = glowing_panes(((0.5, 40.0), (0.25, 90.0))), [], []
    for mode in ("view", "histogram"):
        knobs = replaced(PLAIN, exposure=mode, transparency="lists")
        with closing(chapter.open(scene, SIZE, knobs, outputs={"color_linear"})) as renderer:
            pictures.append(renderer.render(facing(ev100=6.0)).image("color_linear"))
            built.append(next(it for it in renderer.passes if it.name == "transparent_resolve")._measured)
    assert np.array_equal(*pictures)
    assert [bool(it) for it in built] == [False, True]
    assert model.skips_empty(scene, PLAIN)
