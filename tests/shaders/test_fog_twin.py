"""The float64 twins of fog against closed forms: decimals of 60 digits, plain sums of many points, vacuum and slabs."""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np
import pytest

from common.numerics.transforms import orthographic, perspective, pose_looking_at
from tests.twins import fog, fog_grid, noise
from tests.twins.fog_grid import Grid

LAMP = fog.Light((0.5, 1.5, -4.0), (10.0, 5.0, 1.0))
HAZE = fog.Medium(0.03, (0.9, 0.8, 0.7))
LAYERS = fog.Medium(
    0.01,
    height=fog.Height(0.08, 0.6, base=0.4),
    boxes=(fog.Box((0.0, 1.0, -5.0), (1.5, 0.8, 1.0), 0.2, (0.2, 0.4, 0.9)),),
)


def waves(points):
    return 1.0 + 0.5 * np.sin(points @ (0.9, 0.4, 0.7))


WAVES = fog.Medium(0.05, height=fog.Height(0.05, 0.3, base=-9.0), noise=waves)


def some_rays(count=12, seed=1):
    rng = np.random.default_rng(seed)
    start = rng.uniform(-1, 1, (count, 3)) * (1, 1, 0) + (0, 1.0, 0)
    direction = np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), -np.ones(count)])
    return start, direction / np.linalg.norm(direction, axis=1, keepdims=True), rng.uniform(2, 12, count)


# --- along a ray ------------------------------------------------------------------------------------------------------


def exact_phi(x):
    with localcontext() as context:
        context.prec = 60
        return float((1 - (-Decimal(x)).exp()) / Decimal(x))


def test_the_mean_of_transmittance_from_1e_15_to_1e5():
    x = np.concatenate([np.geomspace(1e-15, 1e5, 400), np.geomspace(9e-6, 1.1e-5, 50)])
    truth = np.array([exact_phi(float(one)) for one in x])
    assert np.abs(fog.phi(x) / truth - 1).max() < 4e-16
    assert fog.phi(0.0) == 1.0


@pytest.mark.parametrize("beta", np.geomspace(1e-9, 1e4, 14))
def test_slices_of_any_lengths_are_one_slab(beta):
    """Light s (1 - exp(-beta z)) / beta at every end, from decimals; 128 slices of the default grid."""
    edges = np.concatenate([[0.0], 0.1 * 1000 ** (np.arange(1, 129) / 128)])
    light, seen = fog.integrate(np.full((128, 3), 3.0), np.full(128, beta), np.diff(edges))
    with localcontext() as context:
        context.prec = 60
        depth = [-Decimal(float(beta)) * Decimal(float(z)) for z in edges[1:]]
        exact = np.array([[float(t.exp()), float(3 * (1 - t.exp()) / Decimal(float(beta)))] for t in depth])
    np.testing.assert_allclose(light, np.repeat(exact[:, 1:], 3, axis=1), rtol=1e-12)
    np.testing.assert_allclose(seen, exact[:, 0], rtol=1e-11, atol=1e-300)


def test_light_and_transmittance_of_a_lit_slab_are_no_more_than_there_was():
    rng = np.random.default_rng(2)
    extinction, lengths = 10.0 ** rng.uniform(-5, 2, (50, 30)), rng.uniform(0.01, 2, (50, 30))
    albedo = rng.uniform(0, 1, (50, 30, 3))
    light, seen = fog.integrate(albedo * extinction[..., None], extinction, lengths)
    assert (light + seen[..., None] <= 1 + 1e-14).all()
    light, seen = fog.integrate(np.ones((50, 30, 3)) * extinction[..., None], extinction, lengths)
    np.testing.assert_allclose(light + seen[..., None], 1.0, rtol=1e-13)


# --- media ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("medium", [HAZE, LAYERS], ids=["haze", "layers"])
def test_optical_depth_is_the_sum_over_many_points(medium):
    rng = np.random.default_rng(3)
    start, end = rng.uniform(-6, 6, (2, 60, 3)) + np.array((0, 1, -3))
    end[:10, 1] = start[:10, 1]
    end[10:12] = start[10:12] + np.array((0, 0, 5))
    along = (np.arange(20_000) + 0.5) / 20_000
    points = start[:, None] + along[:, None] * (end - start)[:, None]
    summed = medium.at(points)[..., 3].mean(axis=1) * np.linalg.norm(end - start, axis=1)
    # Two faces of a box are met within half a step each.
    assert np.abs(medium.optical_depth(start, end) - summed).max() < 0.2 * 17 / 20_000 + 1e-7


def test_height_fog_above_a_point_is_rho_over_k():
    """rho / k (exp(-k y0) - exp(-k y1)) straight up; down through the base it is rho per metre."""
    medium = fog.Medium(height=fog.Height(0.08, 0.6, base=0.4))
    up = medium.optical_depth((0, 1.4, 0), (0, 3.4, 0))
    assert up == pytest.approx(0.08 / 0.6 * (np.exp(-0.6) - np.exp(-1.8)), rel=1e-14)
    assert medium.optical_depth((0, -2.6, 0), (0, 0.4, 0)) == pytest.approx(0.24, rel=1e-14)
    assert medium.optical_depth((5, 1.4, 0), (0, 1.4, 12)) == pytest.approx(
        13 * 0.08 * np.exp(-0.6), rel=1e-12
    )


def test_a_box_has_its_chord_and_a_half_turned_segment_misses_it():
    medium = fog.Medium(boxes=(fog.Box((0, 0, 0), (1, 2, 3), 0.5),))
    assert medium.optical_depth((-9, 0, 0), (9, 0, 0)) == pytest.approx(1.0)
    assert medium.optical_depth((0, 0, 0), (0, 0, 9)) == pytest.approx(1.5)
    assert medium.optical_depth((-1.0001, -9, 0), (-1.0001, 9, 0)) == 0.0
    assert medium.at([(0.99, 1.99, 2.99), (1.01, 0, 0)])[:, 3].tolist() == [0.5, 0.0]


def test_a_volume_of_noise_repeats_and_moves_with_the_wind():
    volume = np.random.default_rng(8).uniform(0, 1, (4, 5, 6))
    z, y, x = np.indices(volume.shape)
    centers = (np.stack([x, y, z], axis=-1) + 0.5) / (6, 5, 4)
    np.testing.assert_allclose(noise.tiled(volume, centers), volume, rtol=1e-12)
    points = np.random.default_rng(9).uniform(-20, 20, (200, 3))
    here = noise.in_wind(volume, points, 0.1, (0, 0, 0), 0.0)
    assert here.min() >= volume.min() and here.max() <= volume.max()
    for step in np.diag([10.0, -20.0, 30.0]):
        np.testing.assert_allclose(
            noise.in_wind(volume, points + step, 0.1, (0, 0, 0), 0.0), here, atol=1e-12
        )
    # Ten minutes on, what was here is 600 velocities downwind: also half a texel, and after a whole number of turns.
    wind = np.array((1.0, 0.1, 2.0))
    then = noise.in_wind(volume, points + 600 * wind, 0.1, wind, 600.0)
    np.testing.assert_allclose(then, here, atol=1e-10)
    assert np.abs(noise.in_wind(volume, points, 0.1, wind, 3.0) - here).max() > 0.1
    # Between two texels of opposite faces it is their mean.
    seam = noise.tiled(volume, (0.0, 0.5 / 5, 0.5 / 4))
    assert seam == pytest.approx((volume[0, 0, 0] + volume[0, 0, 5]) / 2)


# --- single scattering ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("g", [0.0, 0.6, -0.4])
@pytest.mark.parametrize("medium", [HAZE, LAYERS, WAVES], ids=["haze", "layers", "waves"])
def test_single_scattering_is_the_sum_over_many_points(medium, g):
    """Midpoints in equal steps of distance, nothing but the definition: within what steps across a face err by."""
    start, direction, length = some_rays()
    light, seen = fog.single_scattering(start, direction, length, medium, LAMP, g)
    steps = 4000
    along = (np.arange(steps) + 0.5) / steps * length[:, None]
    points = start[:, None] + along[..., None] * direction[:, None]
    away = points - LAMP.position
    r = np.linalg.norm(away, axis=-1)
    cosine = (away / r[..., None] * -direction[:, None]).sum(axis=-1)
    value = (1 - g * g) / (4 * np.pi * (1 + g * g - 2 * g * cosine) ** 1.5) / r**2
    depth = medium.at(points)[..., 3] * length[:, None] / steps
    before = np.cumsum(depth, axis=1) - depth / 2
    value = value * np.exp(-before - medium.optical_depth(points, LAMP.position)) * length[:, None] / steps
    summed = (medium.at(points)[..., :3] * np.asarray(LAMP.candela) * value[..., None]).sum(axis=1)
    assert (
        np.abs(light / summed - 1).max() < 2e-3
        if medium is LAYERS
        else np.abs(light / summed - 1).max() < 2e-4
    )
    assert np.abs(seen / np.exp(-depth.sum(axis=1)) - 1).max() < 1e-3


@pytest.mark.parametrize("medium", [HAZE, LAYERS], ids=["haze", "layers"])
def test_more_nodes_change_nothing(medium):
    """The angle's integrand is smooth in a haze; behind a box the way to the lamp has kinks."""
    start, direction, length = some_rays(40, seed=5)
    few, _ = fog.single_scattering(start, direction, length, medium, LAMP, 0.5)
    many, _ = fog.single_scattering(start, direction, length, medium, LAMP, 0.5, nodes=24, panels=32)
    assert np.abs(few / many - 1).max() < (1e-10 if medium is HAZE else 2e-4)


def test_next_to_no_medium_gives_the_angle_under_which_the_lamp_sees_the_ray():
    """Without attenuation: scattering * candela / (4 pi h) * (angle between the ray's ends, seen from the lamp)."""
    start, direction, length = some_rays(30, seed=6)
    thin = fog.Medium(1e-12, (1.0, 1.0, 1.0))
    light, _ = fog.single_scattering(start, direction, length, thin, LAMP, 0.0)
    ends = [start - LAMP.position, start + length[:, None] * direction - LAMP.position]
    unit = [one / np.linalg.norm(one, axis=1, keepdims=True) for one in ends]
    angle = np.arctan2(np.linalg.norm(np.cross(*unit), axis=1), (unit[0] * unit[1]).sum(axis=1))
    height = np.linalg.norm(np.cross(ends[0], direction), axis=1)
    np.testing.assert_allclose(light[:, 0], 1e-12 * 10.0 / (4 * np.pi * height) * angle, rtol=1e-9)


def test_a_lamp_out_of_reach_gives_no_light_and_a_denser_medium_less_of_what_is_far():
    start, direction, length = some_rays(30, seed=7)
    near = fog.Light(LAMP.position, LAMP.candela, reach=0.01)
    assert not fog.single_scattering(start, direction, length, HAZE, near, 0.3)[0].any()
    windowed = fog.single_scattering(
        start, direction, length, HAZE, fog.Light(LAMP.position, LAMP.candela, 6.0), 0.3
    )
    free = fog.single_scattering(start, direction, length, HAZE, LAMP, 0.3)
    assert (windowed[0] < free[0]).all()
    thick = fog.single_scattering(start, direction, length, fog.Medium(3.0), LAMP, 0.3)
    assert (thick[0] < 1e-2 * free[0]).all()


# --- filters ----------------------------------------------------------------------------------------------------------


def test_the_weights_of_the_filter():
    weights = fog.gaussian_weights()
    assert weights.shape == (5, 5) and weights.sum() == pytest.approx(19.6819, abs=5e-5)
    assert weights[0, 0] == pytest.approx(0.60653, abs=5e-6) and weights[2, 2] == 1.0


def test_the_filter_keeps_a_constant_and_spreads_an_impulse():
    volume = np.broadcast_to((1.0, 2.0, 3.0, 4.0), (3, 9, 11, 4))
    np.testing.assert_allclose(fog.spatially_filtered(volume), volume, rtol=1e-14)
    impulse = np.zeros((3, 9, 11, 4))
    impulse[1, 4, 5] = (1, 0, 0, 2)
    filtered = fog.spatially_filtered(impulse)
    table = fog.gaussian_weights() / 19.6819
    np.testing.assert_allclose(filtered[1, 2:7, 3:8, 0], table, atol=1e-5)
    np.testing.assert_allclose(filtered[1, 2:7, 3:8, 3], 2 * table, atol=1e-5)
    assert not filtered[[0, 2]].any() and np.count_nonzero(filtered[1, ..., 0]) == 25
    corner = np.zeros((1, 9, 11, 1))
    corner[0, 0, 0] = 1
    assert fog.spatially_filtered(corner)[0, 0, 0, 0] == pytest.approx(
        1 / fog.gaussian_weights()[2:, 2:].sum()
    )


def test_a_blend_forgets_by_a_power_and_drops_what_is_not_finite():
    history, current = np.full(4, 7.0), np.full(4, 3.0)
    for frame in range(1, 30):
        history = fog.blended(history, current, 0.1)
        np.testing.assert_allclose(history - 3.0, 4.0 * 0.9**frame, rtol=1e-12)
    lost = fog.blended(np.array([np.nan, np.inf, 1.0]), np.array([1.0, 2.0, 3.0]), 0.5)
    assert lost.tolist() == [1.0, 2.0, 2.0]


# --- the grid ---------------------------------------------------------------------------------------------------------


def grid_of(size, lens=None, eye=(0.0, 1.2, 0.0), to=(0.1, 1.0, -5.0), near=0.1, far=20.0):
    lens = perspective(1.0, 1.5, 0.1) if lens is None else lens
    return Grid(
        size, near, far, lens, pose_looking_at(np.array(eye), np.array(to), np.array((0.0, 1.0, 0.0)))
    )


@pytest.mark.parametrize(
    "lens", [None, orthographic(3.0, 1.5, 0.1, 50.0)], ids=["perspective", "orthographic"]
)
def test_a_homogeneous_medium_is_exact_at_every_slice_and_between(lens):
    """Along the ray, not along the axis: at a corner of the picture the way is longer."""
    grid = grid_of((6, 4, 24), lens)
    medium = fog.Medium(0.21, (0.9, 0.6, 0.3))
    volume = fog_grid.scattered(grid, medium, [], 0.0, ambient=(2.0, 2.0, 2.0))
    ends = fog_grid.integrated(grid, volume)
    stretch = grid.stretch(grid.centers()[0, ..., :2])
    exact = np.exp(-0.21 * grid.edges()[1:, None, None] * stretch)
    np.testing.assert_allclose(ends[..., 3], exact, rtol=1e-13)
    np.testing.assert_allclose(ends[..., 0], 1.8 * (1 - exact), rtol=1e-12)
    uv = np.tile(grid.centers()[0, 1, 2, :2], (500, 1))
    depth = np.linspace(0.0, 20.0, 500)
    found = fog_grid.within_slice(grid, ends, volume, uv, depth)
    np.testing.assert_allclose(found[:, 3], np.exp(-0.21 * depth * stretch[1, 2]), rtol=1e-12)
    np.testing.assert_allclose(found[:, 0], 1.8 * (1 - found[:, 3]), atol=1e-12)
    linear = fog_grid.between_ends(grid, ends, uv, depth)
    assert np.abs(linear[:, 3] - found[:, 3]).max() > 1e-3, "what a sampler gives is not exact between ends"


def test_histories_rest_shift_with_the_view_and_are_left_at_the_border():
    """The same grid: a fixed point. Moved by two froxels of an orthographic view: the history moves by two columns."""
    lens = orthographic(2.0, 1.0, 0.1, 50.0)
    grid = grid_of((8, 8, 6), lens, eye=(0, 0, 0), to=(0, 0, -1))
    volume = np.random.default_rng(4).uniform(0, 1, (6, 8, 8, 4))
    np.testing.assert_allclose(fog_grid.reprojected(volume, volume, grid, grid, 0.1), volume, rtol=1e-12)
    moved = grid_of((8, 8, 6), lens, eye=(1, 0, 0), to=(1, 0, -1))  # a froxel is half a metre wide
    current = np.random.default_rng(5).uniform(0, 1, volume.shape)
    found = fog_grid.reprojected(volume, current, moved, grid, 0.25)
    np.testing.assert_allclose(found[:, :, :6], 0.75 * volume[:, :, 2:] + 0.25 * current[:, :, :6], rtol=1e-9)
    assert np.array_equal(found[:, :, 6:], current[:, :, 6:])
    behind = grid_of((8, 8, 6), lens, eye=(0, 0, 0), to=(0, 0, 1))
    assert np.array_equal(fog_grid.reprojected(volume, current, behind, grid, 0.25), current)


def test_a_froxel_s_light_is_albedo_extinction_phase_candela_and_the_square_of_the_distance():
    grid = grid_of((4, 4, 8))
    medium = fog.Medium(0.1, (1.0, 0.5, 0.25))
    volume = fog_grid.scattered(grid, medium, [LAMP], 0.0, attenuated=False)
    points = grid.samples()
    square = ((points - LAMP.position) ** 2).sum(axis=-1)
    np.testing.assert_allclose(volume[..., 0], 0.1 * 10.0 / (4 * np.pi * square), rtol=1e-12)
    dimmed = fog_grid.scattered(grid, medium, [LAMP], 0.0)
    np.testing.assert_allclose(dimmed[..., 1] / volume[..., 1], np.exp(-0.1 * np.sqrt(square)), rtol=1e-12)
    both = fog_grid.scattered(grid, medium, [LAMP, LAMP], 0.4)
    np.testing.assert_allclose(
        both[..., :3], 2 * fog_grid.scattered(grid, medium, [LAMP], 0.4)[..., :3], rtol=1e-12
    )


def error_of(size, lamp, count=60):
    """Return the relative rms error of light along rays through froxel centres of the grid, against quadrature."""
    grid = grid_of(size, far=12.0)
    medium = fog.Medium(0.08, (0.9, 0.8, 0.7))
    volume = fog_grid.scattered(grid, medium, [lamp], 0.4)
    ends = fog_grid.integrated(grid, volume)
    rng = np.random.default_rng(6)
    uv = (np.column_stack([rng.integers(0, size[0], count), rng.integers(0, size[1], count)]) + 0.5) / size[
        :2
    ]
    depth = rng.uniform(4, 12, count)
    found = fog_grid.within_slice(grid, ends, volume, uv, depth)
    start, direction = grid.rays(uv)
    truth, _ = fog.single_scattering(start, direction, depth * grid.stretch(uv), medium, lamp, 0.4)
    return np.sqrt(((found[:, :3] - truth) ** 2).mean() / (truth**2).mean())


@pytest.mark.parametrize("place", [(-6.0, 4.0, -5.0), (1.0, 1.6, -2.0)], ids=["far", "near"])
def test_slices_converge_to_quadrature_for_a_lamp_beside_the_rays(place):
    """Samples in the middle of slices: the error falls by their thickness squared, and 128 slices are within 1e-4.

    From 16 to 128 slices that is a factor of 64; the random depths leave a half of it certain.
    """
    errors = [
        error_of((16, 12, slices), fog.Light(place, (10.0, 10.0, 10.0))) for slices in (16, 32, 64, 128)
    ]
    assert errors[2] < 0.01 and errors[3] < 1e-4
    assert errors[0] > 32 * errors[3] and errors == sorted(errors, reverse=True)


def test_a_first_slice_sampled_at_its_texel_s_place_would_cost_accuracy():
    """That place is near its end, as the slice begins at the eye and not at `near`; the error stays for any grid."""
    grid = grid_of((4, 4, 64))
    assert grid.depths()[0] == grid.edges()[1] / 2
    assert grid.depth(0.5 / 64) > 0.9 * grid.edges()[1]
    np.testing.assert_allclose(grid.depths()[1:], np.sqrt(grid.edges()[1:-1] * grid.edges()[2:]), rtol=1e-13)
