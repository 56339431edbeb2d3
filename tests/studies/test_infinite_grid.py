"""The study infinite-grid against the same formula in double precision, with footprints from finite differences."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch01.studies.infinite_grid import Settings
from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, Perspective, View
from tests.support import gl_functions, gpu_functions

INCLUDE = "../chapters/ch01/studies/infinite_grid/grid.glsl"
SIZE = (64, 48)
CELL, LEAST, RADIUS = 0.025, 2.0, 100.0
LENS = Perspective(math.radians(50.0), 0.05)


def evaluate(stage, body, inputs, outputs):
    run = gpu_functions.evaluate if stage.backend == "vulkan" else gl_functions.evaluate
    arrays = {name: np.asarray(values, np.float32) for name, values in inputs.items()}
    return run(stage.device, [INCLUDE], body, arrays, outputs)


def place_of(view: View, x: np.ndarray, y: np.ndarray, height: float) -> np.ndarray:
    """Return (..., 2) world x and z of where rays through pixels meet the plane; NaN above the horizon."""
    lens = view.projection
    across, up = x / SIZE[0] * 2 - 1, 1 - y / SIZE[1] * 2
    aspect = SIZE[0] / SIZE[1]
    if isinstance(lens, Perspective):
        tangent = math.tan(lens.yfov / 2)
        ray = np.stack([across * tangent * aspect, up * tangent, -np.ones_like(x)], axis=-1)
        start = np.zeros_like(ray)
    else:
        start = np.stack([across * lens.ymag * aspect, up * lens.ymag, np.zeros_like(x)], axis=-1)
        ray = np.broadcast_to((0.0, 0.0, -1.0), start.shape)
    turn = view.world_from_view[:3, :3].T
    start, ray = start @ turn + view.eye, ray @ turn
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (height - start[..., 1]) / ray[..., 1]
        return np.where((way > 0)[..., None], (start + way[..., None] * ray)[..., ::2], np.nan)


def picture_of(view: View, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (H, W) brightness 0 to 1, and the footprints' lengths."""
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    place, step = place_of(view, x, y, height), 1e-4
    slope_x, slope_y = (
        (place_of(view, x + dx, y + dy, height) - place_of(view, x - dx, y - dy, height)) / (2 * step)
        for dx, dy in ((step, 0), (0, step))
    )
    footprint = np.hypot(slope_x, slope_y)
    length = np.hypot(footprint[..., 0], footprint[..., 1])
    with np.errstate(divide="ignore"):
        level = np.clip(np.log10(length * LEAST / CELL) + 1, 0, 3)
    finest = np.floor(level)
    fade = level - finest
    ink = []
    for k in range(3):
        side = (CELL * 10.0 ** (finest + k))[..., None]
        off = np.abs(place - np.round(place / side) * side) / footprint  # pixels
        ink.append(np.clip(1 - off / 2, 0, 1).max(axis=-1))
    dark = np.max([ink[0] * (1 - fade) * 0.5, ink[1] * (1 - 0.5 * fade), ink[2]], axis=0)
    away = np.hypot(*np.moveaxis(place - view.eye[[0, 2]], -1, 0))
    dark = dark * np.clip(1 - away / RADIUS, 0, 1)
    return 1 - np.nan_to_num(dark), length


@pytest.mark.feature("debug-draw/infinite-grid")
def test_levels_are_0_1_and_2_at_a_twentieth_of_a_cell_and_ten_times_that(stage):
    footprints = np.array([0.00125, 0.0125, 0.125, 0.0, 1e-9, 1e9, 0.004, 0.05])
    ones = np.ones(8)
    inputs = {"d": footprints, "cell": CELL * ones, "least": LEAST * ones}
    got = evaluate(stage, "l = grid_level(d, cell, least);", inputs, {"l": "float"})["l"]
    assert np.abs(got[:3] - [0, 1, 2]).max() < 1e-5
    assert (got[3:6] == [0, 0, 3]).all()
    assert np.abs(got[6:] - (np.log10(footprints[6:] * 2 / CELL) + 1)).max() < 1e-5


def test_a_line_is_full_in_its_middle_and_ends_after_two_pixels(stage):
    pixels = np.arange(-4, 5)
    places = np.stack([0.01 * pixels, np.full(9, 0.5)], axis=-1)
    inputs = {"place": places, "side": np.ones(9), "footprint": np.full((9, 2), 0.01)}
    body = "ink = grid_lines(place, side, footprint);"
    got = evaluate(stage, body, inputs, {"ink": "float"})["ink"]
    assert np.abs(got - [0, 0, 0, 0.5, 1, 0.5, 0, 0, 0]).max() < 1e-5


DOWN = np.eye(4)
DOWN[:3, :3] = [(1, 0, 0), (0, 0, 1), (0, -1, 0)]  # looks along -y, world -z is up in the picture
DOWN[:3, 3] = 0.013, 3.0, -0.007
VIEWS = {
    "a table": (View(pose_looking_at((0.1, 0.35, 0.3), (0.0, 0.0, 0.0)), LENS), 0.0),
    "a field": (View(pose_looking_at((0.3, 2.2, 5.0), (0.0, 1.2, 0.0)), LENS), 0.0),
    "from above, 1 cm a pixel": (View(DOWN, Orthographic(0.24, 0.1, 10.0)), 0.0),
    "a plane elsewhere": (View(pose_looking_at((0.3, 2.2, 5.0), (0.0, 1.0, 0.0)), LENS), -7.0),
    "a ceiling": (View(pose_looking_at((0.3, 0.2, 5.0), (1.0, 1.0, 0.0)), LENS), 1.5),
}


@pytest.mark.feature("debug-draw/infinite-grid")
@pytest.mark.parametrize("name", VIEWS)
def test_the_picture_is_the_references_to_a_code(stage, name):
    view, height = VIEWS[name]
    picture = stage.draw("infinite-grid", SIZE, 0.0, view, settings=Settings(height=height))["color"]
    reference, length = picture_of(view, height)
    # A row whose pixels' own area holds the horizon has no finite difference to compare with.
    known = ~np.isnan(length) | (reference == 1)
    assert known.mean() > 0.97 and 0.02 < (reference < 0.9).mean() < 0.9
    assert np.abs(picture / 255 - reference[..., None])[known].max() <= 1 / 255


@pytest.mark.feature("debug-draw/infinite-grid")
def test_a_grid_a_hundredth_higher_is_another_picture(stage):
    view, height = VIEWS["a table"]
    picture = stage.draw("infinite-grid", SIZE, 0.0, view, settings=Settings(height=height))["color"]
    reference, _ = picture_of(view, height + 0.01)
    assert np.nanmax(np.abs(picture / 255 - reference[..., None])) > 0.1


def test_far_from_home_lines_stay_on_their_places(stage):
    view, height = VIEWS["a table"]
    here = stage.draw("infinite-grid", SIZE, 0.0, view, settings=Settings(height=height))["color"]
    moved = view.world_from_view.copy()
    moved[:3, 3] += 2.5e6, 0.0, -7.5e6  # whole squares of every size that is drawn
    there = stage.draw("infinite-grid", SIZE, 0.0, View(moved, LENS), settings=Settings(height=height))[
        "color"
    ]
    assert np.abs(here.astype(int) - there).max() <= 1
