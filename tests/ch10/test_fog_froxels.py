"""What froxels hold, read back: against the same sums in float64, on both backends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch10.settings import Settings
from common.scene import Medium
from common.settings import replaced
from tests.support.fog import FULL, GRID, HAZE, LAYERS, SIZE, VIEW, apart, foggy, grid_of, records, twin_of
from tests.support.shadows import point, spot, sun
from tests.twins import fog as twin
from tests.twins import fog_grid

pytestmark = pytest.mark.variants("vulkan", "gl")

BASE = Settings(**FULL)
MEDIUM, LIGHT, SMOOTH = "fog_inject/fog_medium", "fog_scatter/fog_light", "fog_spatial/fog_smooth"
LAMP = point((-1.2, 3.0, 0.8), candela=60.0)


def opened(chapter, scene, **turned):
    return chapter.open(
        scene, SIZE, replaced(BASE, **turned), outputs={"color", "color_linear"}, inspect=True
    )


def frame_of(chapter, scene, *names, view=VIEW, **turned):
    """Return the grid's twin and volumes (Z, Y, X, 4) of a first frame."""
    with opened(chapter, scene, **turned) as renderer:
        frame = renderer.render(view)
        return grid_of(renderer, view), *(frame.image(name).astype(np.float64) for name in names)


def lamp_of(pair):
    """Return the twin of a point light and its pose."""
    light, pose = pair
    return twin.Light(tuple(pose[:3, 3]), tuple(light.intensity * np.array(light.color)))


def exposed(values, view=VIEW):
    """Return light times the exposure of the view, extinction as it is."""
    return values * (*(1 / (1.2 * 2**view.ev100),) * 3, 1.0)


# --- the medium ---


@pytest.mark.feature("fog/inject-constant-and-height", "fog/medium")
@pytest.mark.parametrize("medium", [HAZE, replace(LAYERS, boxes=())], ids=["constant", "height"])
def test_froxels_hold_the_medium(chapter, medium):
    grid, volume = frame_of(chapter, foggy(medium=medium), MEDIUM)
    assert volume.shape == (*GRID[::-1], 4)
    truth = fog_grid.injected(grid, twin_of(medium))
    # Depth by exp2 is right within 2^-20, so a height is within 1e-5 of 14 metres, and the exponent within 2e-5.
    assert np.allclose(volume, truth, rtol=1e-4, atol=0)


@pytest.mark.feature("fog/inject-box")
def test_a_box_changes_froxels_with_their_sample_inside(chapter):
    grid, volume = frame_of(
        chapter, foggy(medium=replace(LAYERS, extinction=0.0, height_extinction=0.0)), MEDIUM
    )
    box = LAYERS.boxes[0]
    away = np.abs(grid.samples() - box.center) - box.half_size
    inside, sure = (away <= 0).all(axis=-1), np.abs(away).min(axis=-1) > 1e-4
    assert inside.sum() > 20
    assert np.array_equal(volume[..., 3][sure] > 0, inside[sure])
    assert (volume[~inside & sure] == 0).all()
    assert np.allclose(volume[inside & sure], (*(0.6 * np.array(box.albedo)), 0.6), rtol=1e-6)


# --- light ---


@pytest.mark.feature("fog/light-scattering", "fog/henyey-greenstein")
@pytest.mark.parametrize("anisotropy", [0.0, 0.6, -0.5])
def test_one_lamp_in_a_layered_medium(chapter, anisotropy):
    scene = foggy(LAMP, medium=LAYERS)
    grid, volume = frame_of(chapter, scene, LIGHT, fog_anisotropy=anisotropy)
    truth = exposed(fog_grid.scattered(grid, twin_of(LAYERS), [lamp_of(LAMP)], anisotropy))
    edge = (
        np.abs(np.abs(grid.samples() - LAYERS.boxes[0].center) - LAYERS.boxes[0].half_size).min(axis=-1)
        < 1e-4
    )
    sure = ~edge & apart(grid, [LAMP[1][:3, 3]])
    assert sure.mean() > 0.8
    assert np.allclose(volume[sure], truth[sure], rtol=3e-4, atol=1e-12)


@pytest.mark.core
@pytest.mark.feature("fog/light-scattering")
def test_light_from_everywhere_has_no_direction(chapter):
    grid, volume = frame_of(chapter, foggy(LAMP), LIGHT, ambient=30.0)
    truth = exposed(fog_grid.scattered(grid, twin_of(HAZE), [lamp_of(LAMP)], 0.6, ambient=(30.0,) * 3))
    sure = apart(grid, [LAMP[1][:3, 3]])
    assert np.allclose(volume[sure], truth[sure], rtol=3e-4)


@pytest.mark.feature("fog/light-scattering")
def test_the_sun_is_dimmed_up_to_the_box_around_the_scene(chapter):
    light, pose = sun((0.4, -0.8, 0.3), lux=5.0)
    scene = foggy((light, pose))
    grid, volume = frame_of(chapter, scene, LIGHT)
    points, to_light = grid.samples(), -np.array((0.4, -0.8, 0.3)) / np.linalg.norm((0.4, -0.8, 0.3))
    with np.errstate(divide="ignore"):
        ways = (np.where(to_light > 0, *scene.bounds[::-1]) - points) / to_light
    metres = np.maximum(ways.min(axis=-1), 0.0)
    _, direction = grid.rays(grid.centers()[..., :2])
    turned = 1 - (-to_light * -direction).sum(axis=-1)
    light_ = 5.0 * twin.henyey_greenstein(turned, 0.6) * np.exp(-HAZE.extinction * metres)
    truth = light_[..., None] * HAZE.extinction * np.array(HAZE.albedo)
    assert np.allclose(
        volume[..., :3], exposed(np.concatenate([truth, truth[..., :1]], -1))[..., :3], rtol=3e-4
    )


@pytest.mark.feature("fog/light-scattering")
@pytest.mark.parametrize("memory", ["pages", "all"])
def test_a_caster_takes_light_from_froxels(chapter, memory):
    """Rays to the lamp are cast against the cube; froxels near the edge of its shadow may be on either side."""
    scene = foggy(LAMP, medium=HAZE)
    knobs = {"shadows": "on", "shadow_memory": memory} if memory != "all" else {"shadows": "on"}
    grid, lit = frame_of(chapter, scene, LIGHT)
    _, dark = frame_of(chapter, scene, LIGHT, **knobs)
    points, lamp = grid.samples(), np.array(LAMP[1][:3, 3])

    def crossed(half):
        first, last = twin.crossing(points, lamp - points, twin.Box((0.0, 1.0, 0.0), (half,) * 3, 1.0))
        return last > first

    below = points[..., 1] < -0.05  # the ground is a caster, too
    hidden, near = crossed(0.45), crossed(0.55)
    sure = (
        (hidden == near) & (np.abs(points[..., 1]) > 0.1) & (np.abs(points[..., [0, 2]]) < 3.8).all(axis=-1)
    )
    assert (hidden & sure).sum() > 10
    assert (dark[hidden & sure][..., :3] == 0).all()
    assert (dark[sure & below][..., :3] == 0).all()
    assert np.allclose(dark[sure & ~hidden & ~below], lit[sure & ~hidden & ~below], rtol=1e-5)


@pytest.mark.feature("fog/light-scattering")
@pytest.mark.parametrize("lists", ["clusters"])
def test_light_of_lists_is_that_of_all_lights(chapter, lists):
    rng = np.random.default_rng(3)
    lamps = [point(tuple(rng.uniform((-3, 0.5, -3), (3, 3, 3))), reach=2.5) for _ in range(14)]
    lamps += [spot(tuple(rng.uniform((-3, 2, -3), (3, 3, 3))), (0.0, 0.0, 0.0), reach=3.0) for _ in range(4)]
    _, brute = frame_of(chapter, foggy(*lamps), LIGHT, light_lists="brute")
    _, listed = frame_of(chapter, foggy(*lamps), LIGHT, light_lists=lists)
    assert (brute[..., :3] > 0).any()
    assert np.array_equal(brute, listed)


# --- filters ---


@pytest.mark.core
@pytest.mark.feature("fog/spatial-filter")
def test_a_slice_is_averaged_in_all_four_channels(chapter):
    scene = foggy(LAMP, medium=LAYERS)
    _, before, after = frame_of(chapter, scene, LIGHT, SMOOTH, fog_spatial=True)
    assert np.allclose(after, twin.spatially_filtered(before), rtol=2e-6, atol=1e-12)
    assert not np.allclose(after[..., 3], before[..., 3], rtol=1e-3)


@pytest.mark.feature("fog/spatial-filter")
def test_a_constant_medium_stays_constant(chapter):
    _, volume = frame_of(chapter, foggy(), SMOOTH, fog_spatial=True, ambient=10.0)
    assert np.allclose(volume, volume[0, 0, 0], rtol=1e-6) and volume[0, 0, 0].min() > 0


# --- along the ray ---


@pytest.mark.feature("fog/integration")
@pytest.mark.parametrize("format", ["rgba32f", "rgba16f"])
def test_records_are_the_sum_up_to_each_froxel(chapter, format):
    with opened(chapter, foggy(LAMP, medium=LAYERS), fog_format=format) as renderer:
        frame = renderer.render(VIEW)
        volume = frame.image(LIGHT).astype(np.float64)
        before, here = records(renderer)
        ends = fog_grid.integrated(grid_of(renderer), volume)
    start = np.broadcast_to((0.0, 0.0, 0.0, 1.0), ends[:1].shape)
    bound = {"rgba32f": 2e-5, "rgba16f": 2e-3}[format]  # halves: steps of 2^-11
    assert np.allclose(before, np.concatenate([start, ends[:-1]]), rtol=bound, atol=1e-7)
    assert np.array_equal(here, volume)


@pytest.mark.feature("fog/integration", "fog/medium")
@pytest.mark.parametrize("extinction", [1e-9, 1e-4, 0.05, 3.0, 1e4])
def test_a_homogeneous_medium_is_beer_lambert_at_every_slice(chapter, extinction):
    """Transmittance within 1e-4, and light (1 - exp(-extinction z)) albedo L of light from everywhere."""
    medium = Medium(extinction, albedo=(0.9, 0.8, 0.7))
    with opened(chapter, foggy(medium=medium), ambient=10.0) as renderer:
        renderer.render(VIEW)
        before, _ = records(renderer)
        grid = grid_of(renderer)
    metres = grid.edges()[:-1, None, None] * grid.stretch(grid.centers()[0, ..., :2])
    assert np.abs(before[..., 3] - np.exp(-extinction * metres)).max() < 1e-4
    light = (
        -np.expm1(-extinction * metres)[..., None] * np.array(medium.albedo) * exposed(np.full(4, 10.0))[0]
    )
    assert np.allclose(before[..., :3], light, rtol=1e-4, atol=1e-30)
