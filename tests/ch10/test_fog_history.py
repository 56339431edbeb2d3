"""The history of froxels: blended by rule, found again after the camera has moved, and at rest when nothing moves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from chapters.ch10.fog import model
from chapters.ch10.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.scene import FogBox, Medium
from common.settings import replaced
from common.view.camera import Perspective, View
from tests.support.cloth_runs import VIEW as CLOTH_VIEW
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.fog import FULL, LAYERS, SIZE, VIEW, foggy, grid_of
from tests.support.shadows import point
from tests.twins import fog_grid

pytestmark = pytest.mark.variants("vulkan", "gl")

BASE = Settings(**{**FULL, "fog_temporal": True, "fog_share": 0.25})
LIGHT, HISTORY = "fog_scatter/fog_light", "fog_temporal/history_fog"
LAMP = point((-1.2, 3.0, 0.8), candela=60.0)
TURNED = View(pose_looking_at((3.1, 2.5, 3.8), (0.2, 0.5, 0.1)), Perspective(0.9, 0.05))


@pytest.fixture(scope="module")
def scene():
    return foggy(LAMP, medium=LAYERS)


def opened(chapter, scene, **turned):
    return chapter.open(scene, SIZE, replaced(BASE, **turned), outputs={"color"}, inspect=True)


def volumes(renderer, view):
    frame = renderer.render(view)
    return [frame.image(name).astype(np.float64) for name in (LIGHT, HISTORY)]


@pytest.mark.core
@pytest.mark.feature("fog/temporal-filter")
def test_a_still_view_is_the_mean_of_its_frames(chapter, scene):
    """The first frame has no history; each later one is a part of 1 / n of their mean."""
    with opened(chapter, scene) as renderer:
        pairs = [volumes(renderer, VIEW) for _ in range(5)]
    assert np.array_equal(pairs[0][0], pairs[0][1])
    for n in range(1, 5):
        mean = np.mean([light for light, _ in pairs[: n + 1]], axis=0)
        assert np.allclose(pairs[n][1], mean, rtol=1e-5, atol=1e-9)
    assert not np.allclose(pairs[3][0], pairs[4][0], rtol=1e-3)  # each frame has its own depths


@pytest.mark.feature("fog/temporal-filter")
def test_a_camera_that_moves_finds_its_history(chapter, scene):
    with opened(chapter, scene) as renderer:
        history = [volumes(renderer, VIEW)[1] for _ in range(2)][-1]
        before = grid_of(renderer, VIEW)
        light, found = volumes(renderer, TURNED)
        grid = grid_of(renderer, TURNED)
        share = float(renderer.techniques["fog"]._block["history"][0])
    truth = fog_grid.reprojected(history, light, grid, before, share)
    # Within 1e-4 of a border float32 may decide otherwise; and a place is right within some 1e-5 of a froxel.
    uvw = before.uvw_from_world(grid.world_from_uvw(grid.centers()))
    sure = np.nan_to_num(np.minimum(np.abs(uvw), np.abs(1 - uvw)).min(axis=-1), nan=1.0) > 1e-4
    outside = ((uvw < 0) | (uvw > 1) | np.isnan(uvw)).any(axis=-1) & sure
    assert share == pytest.approx(1 / 3) and outside.any() and (~outside).any()
    assert np.array_equal(found[outside], light[outside])
    assert np.allclose(found[sure], truth[sure], rtol=2e-3, atol=2e-3 * np.abs(history).max())
    assert np.median(np.abs(found - truth)[sure].max(axis=-1)) < 1e-5 * np.abs(history).max()


@pytest.mark.feature("fog/temporal-filter")
def test_a_view_at_rest_stays_as_it_is(chapter, monkeypatch):
    monkeypatch.setattr(model, "REST_FRAMES", 4)
    with opened(chapter, foggy(LAMP)) as renderer:
        frames, work = [], []
        for _ in range(8):
            frame = renderer.render(VIEW)
            frames.append((renderer.idle(VIEW), frame.image(HISTORY), frame.image("color")))
            work.append(frame.work["dispatches"])
        assert [idle for idle, _, _ in frames] == [False] * 4 + [True] * 4
        for _, history, color in frames[5:]:
            assert np.array_equal(history, frames[4][1]) and np.array_equal(color, frames[4][2])
        assert (
            work[:5] == [work[0]] * 5 and work[5:] == [work[0] - 4] * 3
        )  # inject, scatter, temporal, integrate
        assert not renderer.idle(TURNED)
        light, history = volumes(renderer, TURNED)
        assert not np.array_equal(light, history) and not renderer.idle(TURNED)


@pytest.mark.feature("fog/temporal-filter")
def test_a_view_rests_once_its_shadow_maps_do(chapter, monkeypatch):
    """Pages that come within some frames change light in fog: the count begins after the last map was drawn."""
    monkeypatch.setattr(model, "REST_FRAMES", 4)
    with opened(chapter, foggy(LAMP), shadows="on", shadow_memory="pages") as renderer:
        idle, rounds = [], []
        for _ in range(14):
            renderer.render(VIEW).image("color")
            idle.append(renderer.techniques["fog"].resting(0.0))
            rounds.append(len(renderer.techniques["shadows"]._pass.schedule.faces) > 0)
    last = max(i for i, any_ in enumerate(rounds) if any_)
    assert not any(idle[: last + 5]) and idle[-1]


@pytest.mark.feature("fog/temporal-filter")
def test_a_view_at_rest_follows_its_shaders_and_its_graph(chapter, scene, monkeypatch):
    """What is not dispatched any more would stay that of the old kernels, and of a filter that is switched off."""
    monkeypatch.setattr(model, "REST_FRAMES", 2)

    def rested(renderer):
        for _ in range(40):
            work = renderer.render(VIEW).work["dispatches"]
            if renderer.idle(VIEW):
                break
        return work, renderer.render(VIEW).work["dispatches"]

    with chapter.open(
        scene, SIZE, replaced(BASE, fog_spatial=True, fog_noise=0.5, fog_wind=0.0), outputs={"color"}
    ) as renderer:
        first = renderer.render(VIEW).work["dispatches"]
        running, resting = rested(renderer)
        assert resting < running == first - 1  # the noise is made once
        monkeypatch.setattr(renderer._api, "reload", lambda changed: ("fog_scatter",))
        renderer.reload_shaders({Path("fog/scatter.comp")})
        assert not renderer.idle(VIEW)
        assert renderer.render(VIEW).work["dispatches"] == first and not renderer.idle(VIEW)
        assert rested(renderer) == (running, resting)
        filtered = renderer.render(VIEW).image("color")
        renderer.switch_pass("fog_spatial", False)
        rested(renderer)
        plain = renderer.render(VIEW).image("color")
    assert not np.array_equal(filtered, plain)


@pytest.mark.feature("fog/temporal-filter")
def test_a_view_rests_once_its_cloth_does(chapter, monkeypatch):
    """Time goes on, and what could move with it does not: no frame is drawn for its number alone."""
    monkeypatch.setattr(model, "REST_FRAMES", 4)
    fabric = replace(cloth_scene_of(cloth(damping_per_s=30)), medium=Medium(extinction=0.1))
    settings = replaced(BASE, cloth_substeps=4)
    with chapter.open(fabric, SIZE, settings, outputs={"color"}) as renderer:
        found = []
        for number in range(200):
            renderer.render(CLOTH_VIEW, number / 60)
            cloth_rests, fog_rests = (
                renderer.techniques[name].resting((number + 1) / 60) for name in ("cloth", "fog")
            )
            found.append((cloth_rests, fog_rests))
            if renderer.idle(CLOTH_VIEW, (number + 1) / 60):
                break
    moving = [fog_rests for cloth_rests, fog_rests in found if not cloth_rests]
    assert len(moving) > 4 and not any(moving) and found[-1] == (True, True)


@pytest.mark.feature("fog/temporal-filter")
def test_a_medium_out_of_view_is_not_waited_for(chapter):
    medium = Medium(boxes=(FogBox((0.0, 0.5, 0.0), (0.7, 0.7, 0.7), 0.5),))
    away = View(pose_looking_at((3.0, 2.5, 4.0), (6.0, 4.0, 8.0)), Perspective(0.9, 0.05))
    with opened(chapter, foggy(LAMP, medium=medium)) as renderer:
        for view, rests in ((VIEW, False), (away, True), (VIEW, False)):
            renderer.render(view)
            assert renderer.techniques["fog"].resting(0.0) == rests


@pytest.mark.feature("fog/temporal-filter")
def test_a_reset_forgets(chapter, scene):
    """Equal calls since a reset give equal bits, and a cut is a reset."""
    with opened(chapter, scene) as renderer:
        first = [volumes(renderer, VIEW) for _ in range(3)]
        renderer.reset_history("a test")
        again = [volumes(renderer, VIEW) for _ in range(3)]
        assert all(
            np.array_equal(a, b)
            for one, other in zip(first, again, strict=True)
            for a, b in zip(one, other, strict=True)
        )
        light, history = volumes(renderer, replace(VIEW, cut=True))
        assert np.array_equal(light, history)


@pytest.mark.feature("fog/temporal-filter")
def test_what_was_out_of_view_has_no_history(chapter):
    """A box that comes back into view begins anew: while it is outside nothing is written."""
    medium = Medium(boxes=(FogBox((0.0, 0.5, 0.0), (0.7, 0.7, 0.7), 0.5),))
    away = View(pose_looking_at((3.0, 2.5, 4.0), (6.0, 4.0, 8.0)), Perspective(0.9, 0.05))
    with opened(chapter, foggy(LAMP, medium=medium)) as renderer:
        for view in (VIEW, VIEW, away, away, away):
            frame = renderer.render(view)
        assert frame.work["dispatches"] == 0 or not renderer.techniques["fog"]._visible
        light, history = volumes(renderer, VIEW)
        assert np.array_equal(light, history) and (light > 0).any()


@pytest.mark.feature("fog/history-ping-pong")
def test_two_images_swap_and_nothing_is_copied(chapter, scene):
    settings = replaced(BASE)
    with chapter.open(scene, SIZE, settings, outputs={"color"}) as renderer:
        images = renderer._api.executor.images
        now = [images.image(slot, "history_fog") for slot in range(2)]
        before = [images.image(slot, "history_fog@previous") for slot in range(2)]
        assert now[0] is before[1] and now[1] is before[0] and now[0] is not now[1]
        renderer.render(VIEW)
        with chapter.calls() as calls:
            renderer.render(VIEW)
        renderer.render(VIEW).image("color")
    copies = [name for name in calls if "CopyImage" in name and "Buffer" not in name]
    assert not copies


@pytest.mark.feature("fog/temporal-filter")
def test_a_history_that_is_not_finite_does_not_stay(chapter, scene):
    """Poisoned memory of a first frame is never read; a history full of NaN is dropped (shaders/medium.glsl)."""
    with opened(chapter, scene, poison="depth 0") as renderer:
        for _ in range(3):
            light, history = volumes(renderer, VIEW)
            assert np.isfinite(light).all() and np.isfinite(history).all()


@pytest.mark.parametrize("half", [False, True])
def test_another_size_is_that_of_a_new_renderer(chapter, scene, half):
    """Records and half-resolution pixels follow the size of the picture; a resize is a reset."""
    settings = replaced(BASE, graph="deferred", fog_half=half)
    with chapter.open(scene, (50, 30), settings, outputs={"color"}) as renderer:
        for size in (SIZE, (33, 71), SIZE):
            renderer.render(VIEW)
            renderer.resize(size)
        found = [renderer.render(VIEW).image("color") for _ in range(2)]
    with chapter.open(scene, SIZE, settings, outputs={"color"}) as renderer:
        assert all(np.array_equal(renderer.render(VIEW).image("color"), picture) for picture in found)


@pytest.mark.feature("fog/spatial-filter")
def test_filters_are_switched_off_one_by_one(chapter, scene):
    """Readers of a filter get what the filter would have read."""
    with opened(chapter, scene, fog_spatial=True) as renderer:
        renderer.render(VIEW).image("color")
        renderer.switch_pass("fog_spatial", False)
        light, history = volumes(renderer, VIEW)
        assert np.array_equal(light, history) and light.any()  # another graph, and no history yet
        assert "fog_spatial" not in [step.name for step in renderer.graph.steps]
        renderer.switch_pass("fog_temporal", False)
        frame = renderer.render(VIEW)
        assert np.isfinite(frame.image(LIGHT)).all() and frame.image("color").any()
        assert "fog_temporal" not in [step.name for step in renderer.graph.steps]
