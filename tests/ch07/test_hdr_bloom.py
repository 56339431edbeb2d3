"""Bloom by a pyramid: energy, constants, the threshold, extremes, and nothing of it where it is off."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

from chapters.ch07.settings import Settings
from common.settings import replaced
from tests.support.glowing import glow_of, glowing
from tests.support.gpu_functions import evaluate
from tests.support.scenes import facing, quad_scene
from tests.twins.hdr import bloomed, bright_part

pytestmark = pytest.mark.variants("vulkan", "gl")

EV = -0.2630344058337938
"""The EV100 of exposure 1: nits are picture values."""

PLAIN = Settings(
    ambient=0.0, default_light=False, color_format="rgba32f", msaa=1, bloom=0.5, bloom_threshold=0.0
)
LEVELS = (1, 6)


def shown(chapter, picture, **knobs):
    """Return the linear picture (H, W, 3) of a rectangle that shows `picture`."""
    size = picture.shape[1::-1]
    with closing(
        chapter.open(glowing(picture), size, replaced(PLAIN, **knobs), outputs={"color_linear"})
    ) as opened:
        return opened.render(facing(ev100=EV)).image("color_linear").astype(np.float64)


def values(shape, seed=2):
    rng = np.random.default_rng(seed)
    return np.float32(10.0 ** rng.uniform(-2, 2, (*shape, 1)) * rng.uniform(0.2, 1.0, (*shape, 3)))


@pytest.mark.feature("hdr/bloom")
@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_the_picture_is_that_of_its_definition(chapter, levels, threshold):
    """Against the pyramid in float64, at an odd size, with what float32 rounds at a dozen stores."""
    picture = shown(chapter, values((27, 38)), bloom=0.0)  # as the texture rounds it
    found = shown(chapter, values((27, 38)), bloom_levels=levels, bloom_threshold=threshold)
    wanted = bloomed(picture, 0.5, threshold, levels)
    np.testing.assert_allclose(found, wanted, rtol=2e-5, atol=2e-5)
    assert np.abs(found - picture).max() > 1.0


@pytest.mark.feature("hdr/bloom")
@pytest.mark.parametrize("levels", [1, 3, 4])
def test_an_impulse_keeps_its_energy_and_spreads(chapter, levels):
    """Away from borders: at sizes that halve without remainder each filter gives every texel the same weight."""
    picture = np.zeros((64, 64, 3), np.float32)
    picture[29, 34] = (800.0, 400.0, 25.0)
    found = shown(chapter, picture, bloom_levels=levels, bloom=1.0)
    if levels < 4:  # the fourth level reaches the border
        assert found[0].max() == found[-1].max() == found[:, 0].max() == 0.0
    np.testing.assert_allclose(found.sum((0, 1)), picture.sum((0, 1)), rtol=1e-5)
    assert found.min() >= 0.0
    assert found[29, 34, 0] < 800.0 / 6 and np.count_nonzero(found[..., 0]) > 30


@pytest.mark.parametrize(
    ("value", "threshold"), [(7.5, 1.0), pytest.param(0.25, 0.0, marks=pytest.mark.long), (60_000.0, 1.0)]
)
def test_constants_are_preserved(chapter, value, threshold):
    picture = np.full((13, 22, 3), value, np.float32) * np.float32((1.0, 0.5, 0.125))
    for levels in (1, 6):
        found = shown(chapter, picture, bloom_levels=levels, bloom_threshold=threshold)
        np.testing.assert_allclose(found, picture, rtol=1e-6)


def test_texels_below_the_threshold_add_nothing(chapter):
    """Not even a bit: the picture is that without bloom."""
    picture = np.minimum(values((20, 20)), np.float32(0.9))
    off, on = (shown(chapter, picture, bloom=bloom, bloom_threshold=1.0) for bloom in (0.0, 1.0))
    assert np.array_equal(off, on)
    picture[10, 10] = 100.0
    assert not np.array_equal(shown(chapter, picture, bloom=1.0, bloom_threshold=1.0), off)


def test_the_bright_part_keeps_hues_and_has_no_step(vulkan_device):
    colors = values((1, 3000))[0]
    colors[:20] = 0.0
    colors[20:40] = (np.nextafter(np.float32(1), np.float32(2)), 0.5, 0.0)
    got = evaluate(
        vulkan_device, ["bright.glsl"], "part = bright_part(color, 1.0);", {"color": colors}, {"part": "vec3"}
    )["part"]
    np.testing.assert_allclose(got, bright_part(colors, 1.0), rtol=1e-5, atol=3e-7)
    assert np.abs(got[20:40]).max() < 1e-6 and (got[:20] == 0).all()


@pytest.mark.feature("hdr/float-target")
@pytest.mark.parametrize("color_format", ["rgba16f", pytest.param("rgba32f", marks=pytest.mark.long)])
def test_extremes_stay_finite_and_values_above_1_stay(chapter, color_format):
    """Light beyond half precision is clamped to 65504 when it is written, and no level of the pyramid exceeds that."""
    for nits in (1e5, 3e38):
        with closing(
            chapter.open(
                quad_scene(glow_of(nits)),
                (16, 16),
                replaced(PLAIN, color_format=color_format, bloom_levels=6, bloom=1.0),
                outputs={"color_linear"},
            )
        ) as opened:
            found = opened.render(facing(ev100=EV)).image("color_linear")
        assert np.isfinite(found).all()
        assert found.max() != nits and found.max() == pytest.approx(65504.0, rel=1e-6)
    picture = np.float32([[1.0, 1.5, 1000.0], [4096.0, 65504.0, 0.0]])
    for bloom in (0.0, 1e-6):
        found = shown(chapter, picture, color_format=color_format, bloom=bloom, bloom_threshold=60000.0)
        np.testing.assert_allclose(found[..., 0], picture, rtol=1e-3, atol=0.02)


NAMES = {"bloom", *(f"bloom_down_{level}" for level in range(1, 7))} | {
    f"bloom_up_{level}" for level in range(1, 6)
}


def test_off_it_has_no_pass_image_or_pipeline(chapter):
    """And with `levels` it has as many passes as levels need; the rest of the frame is the same."""
    scene, plain = glowing(values((16, 16))), replaced(PLAIN, bloom=0.0)
    steps, pipelines, pictures = [], [], []
    for knobs in ({}, {"bloom": 0.5, "bloom_levels": 1}, {"bloom": 0.5, "bloom_levels": 4}):
        with closing(
            chapter.open(scene, (16, 16), replaced(plain, **knobs), outputs={"color", "color_linear"})
        ) as opened:
            frame = opened.render(facing(ev100=EV))
            steps.append([step.name for step in opened.graph.steps])
            pipelines.append(frame.work["pipelines"])
            pictures.append(frame.image("color"))
            images = [name for name in opened.graph.resources if "bloom" in name]
            assert bool(images) == bool(knobs)
    assert not NAMES & set(steps[0])
    assert set(steps[1]) - set(steps[0]) == {"bloom_down_1", "bloom"}
    assert len(set(steps[2]) - set(steps[0])) == 4 + 3 + 1
    assert pipelines[1] - pipelines[0] == 2 and pipelines[2] - pipelines[0] == 8
    assert not np.array_equal(pictures[0], pictures[2])


@pytest.mark.long
@pytest.mark.parametrize("graph", ["deferred", "compute"])
def test_every_path_has_it(chapter, graph):
    more = {"graph": graph, "gbuffer_format": "full", "bloom_levels": 2}
    picture = shown(chapter, values((16, 16)), **more | {"bloom": 0.0})
    found = shown(chapter, values((16, 16)), exposure="histogram", **more)
    np.testing.assert_allclose(found, bloomed(picture, 0.5, 0.0, 2), rtol=2e-5, atol=2e-5)


def test_a_view_of_a_quantity_is_not_changed(chapter):
    scene = glowing(values((8, 8)))
    pictures = []
    for knobs in ({"bloom": 0.0}, {"bloom": 1.0, "exposure": "histogram"}):
        with closing(chapter.open(scene, (8, 8), replaced(PLAIN, view="normal", **knobs))) as opened:
            frames = [opened.render(facing(ev100=EV)) for _ in range(2)]
            assert not (NAMES | {"histogram"}) & {step.name for step in opened.graph.steps}
            pictures.append(frames[1].image("color"))
    assert np.array_equal(*pictures)
