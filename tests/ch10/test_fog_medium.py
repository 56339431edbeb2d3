"""Noise of the medium and its wind, reports of froxels, histories under another exposure, views, and files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch10.settings import Settings
from common.environment.medium import medium_of
from common.scene import FogBox, Medium, stability
from common.settings import replaced
from common.view.camera import View
from tests.support.fog import FULL, HAZE, LAYERS, SIZE, VIEW, foggy, grid_of, noise_volume
from tests.support.shadows import point, sun, yard
from tests.twins import noise as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

BASE = Settings(**FULL)
LAMP = point((-1.2, 3.0, 0.8), candela=60.0)
MEDIUM, LIGHT, HISTORY = "fog_inject/fog_medium", "fog_scatter/fog_light", "fog_temporal/history_fog"
NOISY = {"fog_noise": 0.8, "fog_noise_size": 32, "fog_noise_period": 0.4, "fog_wind": 0.7}


def opened(chapter, scene, **turned):
    return chapter.open(scene, SIZE, replaced(BASE, **turned), outputs={"color"}, inspect=True)


# --- noise ---


@pytest.mark.feature("fog/perlin-noise-volume")
def test_noise_is_made_once_and_tiles(chapter):
    """Seven octaves from four periods on, within a step of halves of the twin; a period on all of it comes again."""
    with opened(chapter, foggy(), **NOISY) as renderer:
        dispatches = []
        for number in range(4):
            frame = renderer.render(VIEW, 0.1 * number)
            frame.image("color")
            dispatches.append(frame.work["dispatches"])
        volume = noise_volume(renderer)
    places = (np.stack(np.indices((32, 32, 32))[::-1], axis=-1) + 0.5) / 32
    truth = twin.octaves_of_noise(places, 4, 7, 0)
    assert np.abs(volume - truth).max() < 2.0**-11
    assert np.allclose(twin.octaves_of_noise(places + np.array((1.0, -2.0, 3.0)), 4, 7, 0), truth, atol=1e-12)
    assert dispatches[0] == dispatches[1] + 1 and len(set(dispatches[1:])) == 1
    assert abs(volume.mean() - 0.5) < 0.02 and volume.std() > 0.03


@pytest.mark.feature("fog/perlin-noise-volume")
@pytest.mark.parametrize("time", [0.0, 12.5, 1e6])
def test_wind_carries_noise_along(chapter, time):
    """Metres per second along (1, 0.1, 2), whatever the number of frames; the density is HAZE times a factor."""
    with opened(chapter, foggy(), **NOISY) as renderer:
        volume = renderer.render(VIEW, time).image(MEDIUM).astype(np.float64)
        noise = noise_volume(renderer)
        grid, scene = grid_of(renderer), renderer.scene
    velocity = np.array((1.0, 0.1, 2.0)) / np.sqrt(5.01) * 0.7
    per_metre = 1 / (0.4 * scene.length_scale)
    found = twin.in_wind(noise, grid.samples() - scene.origin, per_metre, velocity, time)
    truth = 0.05 * (1 + 0.8 * (2 * found - 1))
    assert truth.std() > 0.002
    # A place is right within some 1e-6 of a period, and noise changes by 32 texels' steps a period.
    assert np.abs(volume[..., 3] - truth).max() < 2e-4 * 0.05 + 1e-6


@pytest.mark.feature("fog/perlin-noise-volume")
def test_wind_keeps_a_window_drawing(chapter):
    with opened(chapter, foggy(), **NOISY) as renderer:
        renderer.render(VIEW, 0.0)
        assert renderer.idle(VIEW, 0.0) and not renderer.idle(VIEW, 1.0)
    with opened(chapter, foggy(), **{**NOISY, "fog_wind": 0.0}) as renderer:
        renderer.render(VIEW, 0.0)
        assert renderer.idle(VIEW, 1.0)


# --- pages of shadows ---


@pytest.mark.feature("fog/light-scattering")
def test_froxels_report_the_pages_that_they_read(chapter):
    """The sun's light is seen in air above surfaces, too, where no pixel of a surface asks for a page."""
    lamp = sun((0.5, -0.3, 0.2))
    knobs = {"shadows": "on", "shadow_memory": "pages", "fog_columns": 24, "fog_rows": 20}
    view = View(VIEW.world_from_view, VIEW.projection)
    pages = []
    for medium in (None, HAZE):
        scene = replace(yard(lamp), medium=medium)
        with opened(chapter, scene, **knobs) as renderer:
            renderer.render(view).image("color")
            report = renderer.techniques["shadows"]._report.read(0)
            pages.append(np.unpackbits(report.view(np.uint8)).astype(bool))
    assert pages[1][pages[0]].all() and pages[1].sum() > 1.2 * pages[0].sum() > 0


# --- exposure ---


@pytest.mark.feature("fog/temporal-filter")
def test_a_history_follows_the_exposure(chapter):
    """Light is stored exposed: the history is scaled by the ratio, so a frame of another EV is no step."""
    with opened(chapter, foggy(LAMP), fog_temporal=True, fog_share=0.001) as renderer:
        for _ in range(3):
            before = renderer.render(VIEW).image(HISTORY).astype(np.float64)
        after = renderer.render(replace(VIEW, ev100=VIEW.ev100 + 1)).image(HISTORY).astype(np.float64)
    assert np.allclose(after[..., 3], before[..., 3], rtol=1e-5)
    share = renderer.techniques["fog"]._block["history"][0]
    assert np.median(after[..., :3] / before[..., :3]) == pytest.approx(0.5, rel=2 * float(share))


# --- views ---


@pytest.mark.feature("fog/apply")
def test_the_view_of_transmittance(chapter):
    medium = Medium(0.2)
    settings = replaced(BASE, view="fog-transmittance", fog_columns=64, fog_rows=48)
    with chapter.open(foggy(LAMP, medium=medium), SIZE, settings, outputs={"color", "depth"}) as renderer:
        frame = renderer.render(VIEW)
        shown, depth = frame.image("color")[..., 0] / 255, frame.image("depth")
    rows, columns = depth.shape
    y, x = np.indices(depth.shape) + 0.5
    tan = np.tan(VIEW.projection.yfov / 2)
    slope2 = ((2 * x / columns - 1) * tan * columns / rows) ** 2 + ((2 * y / rows - 1) * tan) ** 2
    drawn = depth > 0
    metres = VIEW.projection.near / depth[drawn] * np.sqrt(1 + slope2[drawn])
    assert np.abs(shown[drawn] - np.exp(-0.2 * metres)).max() < 1.5 / 255


@pytest.mark.feature("fog/froxel-volume")
def test_the_view_of_slices_has_a_colour_for_each_and_no_froxels(chapter):
    settings = replaced(BASE, view="fog-slices")
    with chapter.open(foggy(LAMP), SIZE, settings, outputs={"color", "depth"}) as renderer:
        frame = renderer.render(VIEW)
        shown, depth = frame.image("color")[..., :3], frame.image("depth")
        grid = grid_of(renderer)
        assert not [step.name for step in renderer.graph.steps if step.name.startswith("fog")]
    drawn = depth > 0
    place = grid.w(VIEW.projection.near / depth[drawn].astype(np.float64)) * grid.size[2]
    slices = np.maximum(np.floor(place), 0)
    sure = np.abs(place - np.round(place)) > 1e-3
    colors = {}
    for slice_, color in zip(slices[sure], shown[drawn][sure], strict=True):
        colors.setdefault(slice_, set()).add(tuple(color))
    assert len(colors) > 3 and all(len(them) == 1 for them in colors.values())
    assert len(set.union(*colors.values())) == len(colors)


# --- other worlds ---


@pytest.mark.feature("fog/apply")
def test_a_world_that_is_moved_or_scaled_looks_the_same(chapter):
    """Fog, too: 100 km away, and a thousand times as large or as small. The denser medium shows that it could fail."""
    scene, view = foggy(LAMP, medium=LAYERS), replace(VIEW, ev100=VIEW.ev100 + 2)
    knobs = replaced(BASE, **{**NOISY, "ambient": 1.0})

    def drawn(scene, view):
        with chapter.open(scene, SIZE, knobs, outputs={"color"}) as renderer:
            return renderer.render(view).image("color")

    still = drawn(scene, view)
    for name, changed, seen_from in stability.cases(scene, view):
        assert stability.pixels_changed(still, drawn(changed, seen_from)) <= stability.BOUND, name
    denser = replace(scene, medium=replace(LAYERS, extinction=0.05))
    assert stability.pixels_changed(still, drawn(denser, view)) > 0.1


# --- files ---


def test_a_scene_says_its_medium():
    said = {
        "extinction": 0.02,
        "height_extinction": 0.3,
        "height_falloff": 1.5,
        "height_base": 0.2,
        "albedo": [0.9, 0.8, 0.7],
        "boxes": [
            {
                "center": [1.0, 0.8, 1.5],
                "half_size": [0.8, 0.7, 0.9],
                "extinction": 0.6,
                "albedo": [0.2, 0.5, 0.9],
            }
        ],
        "of a later version": 1,
    }
    assert medium_of({"fog": said}) == LAYERS
    assert medium_of({}) is None and medium_of({"fog": {}}) == Medium()
    assert medium_of(
        {"fog": {"boxes": [{"center": [0, 1, 0], "half_size": [1, 1, 1], "extinction": 2}]}}
    ) == Medium(boxes=(FogBox((0.0, 1.0, 0.0), (1.0, 1.0, 1.0), 2.0),))
