"""The study far-march: fog across the far end of its grid against quadrature in float64, and no seam there."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch10.studies.far_march import Settings
from common.errors import SettingError
from common.images.color import encode_srgb
from common.settings import apply_overrides
from tests.support.bounds import codes_off
from tests.twins import fog
from tests.twins.fog_grid import Grid

pytestmark = pytest.mark.feature("fog/far-range-march")
WHICH, SIZE = "10/far-march", (32, 18)
REACH, STEP = 4000.0, 1 / 255
SUN, SKY = np.array([1.0, 0.8, 0.55]), np.array([0.35, 0.5, 0.8])
BESIDE = 2.0**-18
"""Relative to the depth of the junction: so far before or behind it."""

MEDIA = [{}, {"height": 0.1, "falloff": 0.5}, {"constant": 0.01, "height": 0.0, "anisotropy": -0.3}]


def drawn(stage, size=SIZE, **knobs):
    """Return the fog (H, W, 4) in float64 and the picture of a frame, and its view."""
    with stage.open(WHICH, size, settings=Settings(**knobs)) as renderer:
        view = chapters.view_of(renderer)
        picture = renderer.render(view).image("color")
        return renderer.fog().astype(np.float64), picture, view


def rays(view, size=SIZE):
    """Return starts and directions (N, 3) of the pixels' rays, and metres of each for a metre of depth (N,)."""
    grid = Grid((1, 1, 1), 0.5, 40.0, view.clip_from_view(size[0] / size[1]), view.world_from_view)
    y, x = np.mgrid[: size[1], : size[0]].reshape(2, -1) + 0.5
    uv = np.stack([x / size[0], y / size[1]], axis=-1)
    return *grid.rays(uv), grid.stretch(uv)


def through(settings, start, direction, first, last, nodes=8, panels=48):
    """Return fog (N, 4) between two distances (N,) along rays: single scattering of a distant sun and an even sky.

    Gauss-Legendre in panels between the kinks of the medium, in float64.
    """
    height = fog.Height(settings.height, settings.falloff, 0.0, (settings.albedo,) * 3)
    medium = fog.Medium(settings.constant, (settings.albedo,) * 3, height)
    layer = fog.Medium(height=height)
    up, around = np.radians([settings.elevation, -35.0])
    to_sun = np.array([np.cos(up) * np.sin(around), np.sin(up), -np.cos(up) * np.cos(around)])
    begin, length = start + first[:, None] * direction, last - first
    place, weight = np.polynomial.legendre.leggauss(nodes)
    cuts = medium.breaks(begin, direction, length)
    low, high = cuts[:, :-1, None], cuts[:, 1:, None]
    edges = low + (high - low) * np.linspace(0, 1, panels + 1)
    width = np.diff(edges)[..., None]
    at = (edges[..., :-1, None] + width * (place + 1) / 2).reshape(len(start), -1)
    weights = (width * weight / 2).reshape(len(start), -1)
    points = begin[:, None] + at[..., None] * direction[:, None]
    # Light arrives along -to_sun and leaves along -direction: it is not turned where a ray leads to the sun.
    phase = fog.henyey_greenstein(((to_sun - direction) ** 2).sum(axis=1) / 2, settings.anisotropy)
    left = np.exp(-layer.optical_depth(points, points + 1e5 * to_sun))
    light = settings.sun * SUN * (phase[:, None] * left)[..., None] + settings.sky * SKY
    seen = np.exp(-medium.optical_depth(begin[:, None], points))
    total = (medium.at(points)[..., :3] * light * (seen * weights)[..., None]).sum(axis=1)
    passed = np.exp(-medium.optical_depth(begin, begin + length[:, None] * direction))
    return np.concatenate([total, passed[:, None]], axis=1)


def joined(near, far):
    """Return fog (N, 4) of two parts of a ray."""
    return np.concatenate([near[:, :3] + near[:, 3:] * far[:, :3], near[:, 3:] * far[:, 3:]], axis=1)


@pytest.mark.parametrize(
    "knobs", [*MEDIA, {"columns": 8, "rows": 5, "slices": 8}, {"far": 7.0}, {"steps": 1}]
)
def test_color_and_transmittance_are_continuous_at_the_junction_within_an_8_bit_step(stage, knobs):
    """Between both sides lie 0.3 mm of a medium, which adds no more than that times its extinction and twice the light;
    what is more is a seam. A pixel's ray is longer than a metre for a metre of depth, 1.4 at most."""
    far = Settings(**knobs).far
    before, picture_before, _ = drawn(stage, depth=far * (1 - BESIDE), **knobs)
    behind, picture_behind, _ = drawn(stage, depth=far * (1 + BESIDE), **knobs)
    assert 0.01 < before[..., :3].max() < 2 and before[..., 3].min() < 0.99
    assert np.abs(picture_behind.astype(int) - picture_before).max() <= 1
    extinction = Settings(**knobs).constant + Settings(**knobs).height
    assert np.abs(behind - before).max() <= 1.4 * 2 * BESIDE * far * extinction * 2 + 2.0**-21 < STEP / 10


@pytest.mark.parametrize(("knobs", "most"), list(zip(MEDIA, (1, 2, 1), strict=True)))
def test_fog_is_that_of_quadrature_on_both_sides_and_far_behind(stage, knobs, most):
    """Within an 8-bit step, the grid's own error included; a layer of 2 m is thin for its columns. A march of
    64 steps adds less than a quarter of that to it."""
    settings = Settings(**knobs)
    off = []
    for depth in (0.9975 * settings.far, 1.0025 * settings.far, 2 * settings.far, 500.0, REACH):
        got, _, view = drawn(stage, depth=depth, steps=64, **knobs)
        start, direction, stretch = rays(view)
        truth = through(settings, start, direction, 0 * stretch, depth * stretch)
        off.append(np.abs(got.reshape(-1, 4) - truth).max(axis=0))
        assert off[-1].max() <= most * STEP, depth
    assert np.abs(off[1] - off[0]).max() < STEP / 4, "the error does not jump"
    assert (np.array(off[2:]) <= off[0] + STEP / 4).all()


@pytest.mark.parametrize("knobs", MEDIA)
def test_the_march_transmits_by_the_closed_form_whatever_its_steps(stage, knobs):
    """Each step rounds its depth to 2^-22 or so, and an exp of Vulkan is off by 3 + 2 x units in the last place."""
    settings = Settings(**knobs)
    for steps in (1, 7):
        end, _, view = drawn(stage, depth=settings.far * (1 + BESIDE), steps=steps, **knobs)
        got, _, _ = drawn(stage, depth=300.0, steps=steps, **knobs)
        start, direction, stretch = rays(view)
        first = settings.far * (1 + BESIDE) * stretch
        left = through(settings, start, direction, first, 300.0 * stretch, 1, 1)[:, 3]
        found = got[..., 3].ravel() / end[..., 3].ravel()
        depth = -np.log(left)
        assert (np.abs(found / left - 1) <= (10 + 4 * depth) * steps * 2.0**-22).all()


def test_the_light_of_the_march_converges_with_its_steps(stage):
    """Behind what the grid has: a step takes its light at its middle, so four times the steps leave a sixteenth."""
    off = {}
    settings = Settings()
    end, _, view = drawn(stage, depth=settings.far)
    start, direction, stretch = rays(view)
    behind = through(settings, start, direction, settings.far * stretch, 800.0 * stretch)
    truth = joined(end.reshape(-1, 4), behind)
    for steps in (4, 16, 64):
        got, _, _ = drawn(stage, depth=800.0, steps=steps)
        off[steps] = np.abs(got.reshape(-1, 4) - truth)[:, :3].max()
    assert off[16] < off[4] / 6 and off[64] < off[16] / 6
    assert off[4] > STEP > 2 * off[16], "four steps are too few to be right, sixteen are enough"


def test_the_quadrature_has_converged(stage):
    _, _, view = drawn(stage, (8, 5))
    start, direction, stretch = rays(view, (8, 5))
    for knobs in MEDIA:
        coarse, fine = (
            through(Settings(**knobs), start, direction, 0 * stretch, REACH * stretch, *how)
            for how in ((8, 48), (20, 200))
        )
        assert np.abs(coarse - fine).max() < STEP / 40


def test_marches_that_begin_elsewhere_or_see_no_grid_would_be_noticed(stage):
    """Without the stretch of rays a march begins too near; without the grid's transmittance its light is too bright."""
    settings = Settings()
    end, _, view = drawn(stage, depth=settings.far)
    got, _, _ = drawn(stage, depth=100.0)
    end, got = end.reshape(-1, 4), got.reshape(-1, 4)
    start, direction, stretch = rays(view)
    last = 100.0 * stretch
    right = joined(end, through(settings, start, direction, settings.far * stretch, last))
    early = joined(end, through(settings, start, direction, settings.far + 0 * stretch, last))
    bright = end + [0, 0, 0, 1] * (right - end)
    bright[:, :3] = end[:, :3] + through(settings, start, direction, settings.far * stretch, last)[:, :3]
    assert np.abs(got - right).max() < STEP / 4
    for wrong in (early, bright):
        assert np.abs(wrong - right).max() > 3 * STEP


def test_without_a_march_fog_ends_with_the_grid(stage):
    settings = Settings()
    end, _, view = drawn(stage, depth=settings.far)
    off, _, _ = drawn(stage, depth=REACH, march=False)
    assert np.array_equal(off, end)
    start, direction, stretch = rays(view)
    truth = through(settings, start, direction, 0 * stretch, REACH * stretch)
    assert np.abs(off.reshape(-1, 4) - truth).max() > 20 * STEP


def test_the_plain_and_its_spheres_lie_behind_the_fog_up_to_them(stage):
    size = (64, 36)
    got, picture, view = drawn(stage, size)
    start, direction, stretch = rays(view, size)
    way = direction * stretch[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(way[:, 1] < 0, -start[:, 1] / way[:, 1], REACH)
    depth, normal = np.minimum(depth, REACH), np.tile((0.0, 1.0, 0.0), (len(depth), 1))
    sphere, clear = np.zeros(len(depth), bool), np.ones(len(depth), bool)
    for i in range(8):
        ahead = 14 * 2 ** (i / 2)
        side, radius = (-1) ** (i + 1) * (0.14 + 0.16 * (i // 2)) * ahead, 0.09 * ahead
        center = np.array([side, radius, -ahead])
        foot = ((center - start) * direction).sum(axis=1)
        away2 = ((start + foot[:, None] * direction - center) ** 2).sum(axis=1)
        inside = away2 < radius**2
        at = (foot - np.sqrt(np.where(inside, radius**2 - away2, 0))) / stretch
        nearer = inside & (at > 0) & (at < depth)
        depth, sphere = np.where(nearer, at, depth), sphere | nearer
        normal[nearer] = ((start + way * at[:, None] - center) / radius)[nearer]
        clear &= np.abs(np.sqrt(away2) / radius - 1) > 0.03
    clear &= depth > 0
    assert (
        (sphere & clear).sum() > 100 and (depth > 40)[clear].sum() > 500 and (depth < 40)[clear].sum() > 250
    )
    settings = Settings()
    truth = through(settings, start, direction, 0 * stretch, depth * stretch)
    assert np.abs(got.reshape(-1, 4) - truth)[clear].max() <= STEP
    # Spheres by their own light: half of it is scattered, evenly.
    points = start + way * depth[:, None]
    up, around = np.radians([12.0, -35.0])
    to_sun = np.array([np.cos(up) * np.sin(around), np.sin(up), -np.cos(up) * np.cos(around)])
    layer = fog.Medium(height=fog.Height(settings.height, settings.falloff))
    left = np.exp(-layer.optical_depth(points, points + 1e5 * to_sun))
    falls = left * np.maximum(normal @ to_sun, 0) / np.pi
    surface = 0.5 * (falls[:, None] * settings.sun * SUN + settings.sky * SKY)
    color = surface * truth[:, 3:] + truth[:, :3]
    shown = picture.reshape(-1, 3)[sphere & clear]
    assert np.abs(shown - 255 * encode_srgb(color[sphere & clear])).max() <= codes_off(stage.device) + 1


@pytest.mark.parametrize(
    "knobs",
    [
        {"constant": 10.0, "height": 10.0, "sun": 1e4, "sky": 1e4, "anisotropy": 0.99},
        {"height": 1e-9, "constant": 0.0, "falloff": 0.001, "elevation": 1.0, "far": 1.0, "steps": 1024},
        {"columns": 1, "rows": 1, "slices": 1, "steps": 1},
    ],
)
def test_all_is_finite(stage, knobs):
    got, _, _ = drawn(stage, (16, 9), **knobs)
    assert np.isfinite(got).all() and (got[..., 3] >= 0).all() and (got[..., 3] <= 1).all()


def test_without_a_medium_there_is_no_fog_at_all(stage):
    got, _, _ = drawn(stage, (16, 9), constant=0.0, height=0.0)
    assert (got == (0, 0, 0, 1)).all()


def test_another_size_and_another_frame_have_the_fog_of_a_new_renderer(stage):
    with stage.open(WHICH, (33, 20), settings=Settings()) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view)
        renderer.resize(SIZE)
        frames = [renderer.render(view) for _ in range(3)]
        found, picture, work = renderer.fog(), frames[-1].image("color"), frames[-1].work
    expected, same, _ = drawn(stage)
    assert np.array_equal(found, expected) and np.array_equal(picture, same)
    assert (work["dispatches"], work["froxels"], work["pixels"]) == (2, 64 * 36 * 64, 32 * 18)


@pytest.mark.parametrize(
    "asked", ["constant=nan", "height=-0.1", "anisotropy=1", "far=0.5", "steps=0", "falloff=0", "elevation=0"]
)
def test_numbers_out_of_range_are_refused_in_one_sentence(asked):
    with pytest.raises(SettingError, match=asked.split("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
