"""The study linear-depth: stored depth and distance against a plane and cards in float64, in both directions of Z."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch08.studies.linear_depth import Settings
from tests.support.bounds import codes_off

pytestmark = pytest.mark.feature("shadows/depth-recording")
WHICH, SIZE = "8/linear-depth", (90, 60)
OUTPUTS = ("color", "depth", "standard_depth", "distance")
TANGENT, FAR = 0.75, 100.0
CARDS = 1.5 * 2.0 ** np.arange(7)
"""Metres to the cards."""

ULP = 2.0**-24
"""Of a number below 1: how far rounding to a float of 32 bits moves it, relative to it, or from just below 1."""


def drawn(stage, near, size=SIZE, **more):
    with stage.open(WHICH, size, settings=Settings(near=near, **more), outputs=OUTPUTS) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        return {name: frame.image(name) for name in OUTPUTS}


def truth(size=SIZE):
    """Return (H, W) metres to what the lamp sees, inf where nothing is, (H, W) the card or -1, and the texels that no
    edge is near. By rays through the centres of texels, in float64."""
    width, height = size
    x = (np.arange(width)[None] + 0.5) / width * 2 - 1
    down = (np.arange(height)[:, None] + 0.5) / height * 2 - 1
    with np.errstate(divide="ignore"):
        floor = np.where(down > 0, 1.0 / (TANGENT * down), np.inf) + 0 * x
    nearest, card = np.where((floor >= 0.75) & (floor <= FAR), floor, np.inf), np.full((height, width), -1)
    clear = (np.abs(floor - FAR) > 0.2 * FAR) & (np.abs(floor - 0.75) > 0.05)
    pixel = np.array([2.0 / width, 2.0 / height])
    for number, z in reversed(list(enumerate(CARDS))):
        left, right = (number - 3.5) * 2 / 7 + 0.03, (number - 2.5) * 2 / 7 - 0.03
        top, bottom = -0.8, min(0.75, 1.0 / (TANGENT * z))
        inside = (x > left) & (x < right) & (down > top) & (down < bottom) & (z < nearest)
        nearest, card = np.where(inside, z, nearest), np.where(inside, number, card)
        for edge, along in ((left, x), (right, x)):
            clear &= (np.abs(along - edge) > pixel[0]) | (down < top - pixel[1]) | (down > bottom + pixel[1])
        for edge in (top, bottom):
            clear &= (np.abs(down - edge) > pixel[1]) | (x < left - pixel[0]) | (x > right + pixel[0])
    return nearest, card, clear


def depth_of(z, near, reversed_z):
    near = float(np.float32(near))
    with np.errstate(invalid="ignore"):
        value = near * (FAR / z - 1) if reversed_z else FAR * (1 - near / z)
    return value / (FAR - near)


def metres_of(depth, near, reversed_z):
    near, depth = float(np.float32(near)), depth.astype(np.float64)
    return near * FAR / (near + depth * (FAR - near) if reversed_z else FAR - depth * (FAR - near))


@pytest.mark.parametrize("near", [0.001, 0.1, 1.0])
def test_depth_is_that_of_planes_at_every_texel(stage, near):
    """A card has one depth, so its bound is that of the few roundings on the way. The floor's depth is interpolated
    from its nearest edge, 0.75 m away or at the near plane, and has the rounding of what is largest there."""
    images, (metres, card, clear) = drawn(stage, near), truth()
    assert clear.mean() > 0.55 and {*np.unique(card[clear])} == {*range(-1, 7)}
    seen = clear & np.isfinite(metres)
    for name, reversed_z, nothing in (("depth", True, 0.0), ("standard_depth", False, 1.0)):
        assert (images[name][clear & ~np.isfinite(metres)] == nothing).all()
        expected = depth_of(metres, near, reversed_z)
        off = np.abs(images[name].astype(np.float64) - expected)
        cards, floor = seen & (card >= 0), seen & (card < 0)
        assert (off[cards] <= 6 * ULP * (expected[cards] if reversed_z else 1.0)).all()
        largest = depth_of(max(0.75, near), near, True) if reversed_z else 1.0
        assert (off[floor] <= 16 * ULP * largest).all()
    assert (np.abs(images["distance"] - metres)[seen] <= 1e-5 * metres[seen]).all()
    assert (images["distance"][clear & ~np.isfinite(metres)] == 0.0).all()


@pytest.mark.parametrize("near", [0.001, 0.01, 0.1, 1.0])
def test_reversed_z_keeps_metres_and_standard_z_loses_them_with_the_square_of_the_distance(stage, near):
    """In metres, by the derivative of the distance: a step of 2^-24 of depth is z^2 / near 2^-24 metres where depth is
    near 1, and z 2^-24 where it is small. Six roundings each, as above."""
    images, (_, card, clear) = drawn(stage, near), truth()
    errors = np.zeros((2, len(CARDS)))
    for number, z in enumerate(CARDS):
        at = clear & (card == number)
        for row, (name, reversed_z) in enumerate((("depth", True), ("standard_depth", False))):
            errors[row, number] = np.abs(metres_of(images[name][at], near, reversed_z) - z).max()
    assert (errors[0] <= 6 * ULP * CARDS).all()
    assert (errors[1] <= 6 * ULP * CARDS**2 / near).all()
    if (
        near <= 0.01
    ):  # at worst a number is a step's half away from a float; of four cards one is far from all floats
        assert errors[1, 3:].max() > 1000 * errors[0, 3:].max()
        assert (errors[1, 3:] / CARDS[3:] ** 2).max() > 0.1 * ULP / near


def test_a_near_plane_that_is_one_percent_off_would_be_noticed(stage):
    images, (metres, card, clear) = drawn(stage, 0.1), truth()
    at = clear & (card >= 0)
    for name, reversed_z in (("depth", True), ("standard_depth", False)):
        off = np.abs(images[name][at] - depth_of(metres[at], 0.101, reversed_z))
        assert (off > 6 * ULP).all()
        swapped = np.abs(metres_of(images[name][at], 0.1, not reversed_z) - metres[at])
        assert (swapped > 0.1 * metres[at]).all(), "each direction has a formula of its own"


@pytest.mark.parametrize("near", [0.01, 1.0])
def test_the_linear_panels_are_monotone_in_distance(stage, near):
    """A panel shows distance over far; on a picture of 90 x 60 a panel is 30 x 30, with every third column."""
    images, (metres, _, clear) = drawn(stage, near), truth()
    panel_x, panel_y = (3 * np.arange(30) + 1, 2 * np.arange(30) + 1)
    metres, clear = metres[np.ix_(panel_y, panel_x)], clear[np.ix_(panel_y, panel_x)]
    seen = clear & np.isfinite(metres)
    assert seen.sum() > 300
    order = np.argsort(metres[seen], kind="stable")
    for rows in (slice(0, 30), slice(30, 60)):
        linear = images["color"][rows, 30:60, 0][seen].astype(int)
        assert (np.diff(linear[order]) >= 0).all() and linear.max() > 240
        assert (np.abs(linear - 255 * metres[seen] / FAR) <= codes_off(stage.device) + 0.2).all()
    raw = images["color"][:30, :30, 0][seen].astype(int), images["color"][30:, :30, 0][seen].astype(int)
    assert (np.diff(raw[0][order]) >= 0).all() and (np.diff(raw[1][order]) <= 0).all(), (
        "above near is dark, below bright"
    )


def test_the_error_panels_are_dark_for_reversed_z_alone(stage):
    images, (metres, card, clear) = drawn(stage, 0.001), truth()
    at = np.ix_(2 * np.arange(30) + 1, 3 * np.arange(30) + 1)
    far_cards = clear[at] & (card[at] >= 3) & np.isfinite(metres[at])
    standard, reversed_z = images["color"][:30, 60:], images["color"][30:, 60:]
    assert far_cards.sum() > 20
    assert standard[far_cards][:, 0].max() > 200, "red: centimetres and more"
    assert reversed_z[far_cards][:, :2].max() < 128 and reversed_z[far_cards][:, 0].max() == 0, "micrometres"


def test_another_size_makes_new_depth_images(stage):
    with stage.open(WHICH, (33, 20), settings=Settings(near=0.1), outputs=OUTPUTS) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view)
        renderer.resize(SIZE)
        frame = renderer.render(view)
        images = {name: frame.image(name) for name in OUTPUTS}
    expected = drawn(stage, 0.1)
    assert all((images[name] == expected[name]).all() for name in OUTPUTS)
