"""The study linear-depth: stored depth and distance against a plane and cards in float64, in both directions of Z."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch08.studies.linear_depth import Settings
from tests.support.bounds import codes_off, snapping

pytestmark = pytest.mark.feature("shadows/depth-recording")
WHICH, SIZE = "8/linear-depth", (90, 60)
OUTPUTS = ("color", "depth", "standard_depth", "distance")
TANGENT, FAR = 0.75, 100.0
CARDS = 1.5 * 2.0 ** np.arange(7)
"""Metres to the cards."""

ULP = 2.0**-24
"""Of a number below 1: how far rounding to a float of 32 bits moves it, relative to it, or from just below 1."""


STEPS = 6
"""Roundings on the way to a card's depth."""


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


def inverse_moved(device, size=SIZE):
    """Return by how much 1 / metres of the floor may move where a device moves vertices before it fills.

    1 / metres of the floor is TANGENT times `down`: it grows by the same step from each row to the next one, and is
    constant along a row. A device that moves each corner by a vector interpolates between the moved corners: a texel
    has the value of the plane at a place that is off by a weighted mean of these vectors. So what is affine on the
    screen, as 1 / metres and both depths are, is off by at most its slope times the largest way down. Here the floor's
    farthest corners are 0.40 of a step from the nearest 1/256 of a pixel, and an H100 was 0.40 off.
    Cards have no slope.
    """
    return snapping(device) * TANGENT * 2 / size[1]


def depth_off(device, metres, card, near, reversed_z):
    """Return by how much stored depths may differ from those of planes, of the shape of `metres`, inf where nothing is.

    A card has one depth, so its bound is that of the few roundings on the way. The floor's depth is interpolated from
    its nearest edge, 0.75 m away or at the near plane, and has the rounding of what is largest there; and it moves with
    the corners.
    """
    of_cards = STEPS * ULP * (depth_of(metres, near, True) if reversed_z else 1.0)
    largest = depth_of(max(0.75, near), near, True) if reversed_z else 1.0
    of_floor = 16 * ULP * largest + near * FAR / (FAR - near) * inverse_moved(device)
    return np.where(np.isfinite(metres), np.where(card >= 0, of_cards, of_floor), np.inf)


def distance_off(device, metres, card, near):
    """Return by how much interpolated distances may differ from those of planes, of the shape of `metres`, inf where
    nothing is. Hardware interpolates 1 / metres as it does depth, with the rounding of what is largest.
    """
    moved = inverse_moved(device)
    inverse = moved + (16 * ULP / max(0.75, near) if moved else 0.0)
    with np.errstate(invalid="ignore"):
        of_floor = np.where(card >= 0, 0.0, metres * (metres * inverse / (1 - metres * inverse)))
        return np.where(np.isfinite(metres), 1e-5 * metres + of_floor, np.inf)


@pytest.mark.parametrize("near", [0.001, 0.1, 1.0])
def test_depth_is_that_of_planes_at_every_texel(stage, near):
    images, (metres, card, clear) = drawn(stage, near), truth()
    assert clear.mean() > 0.55 and {*np.unique(card[clear])} == {*range(-1, 7)}
    seen = clear & np.isfinite(metres)
    for name, reversed_z, nothing in (("depth", True, 0.0), ("standard_depth", False, 1.0)):
        assert (images[name][clear & ~np.isfinite(metres)] == nothing).all()
        off = np.abs(images[name].astype(np.float64) - depth_of(metres, near, reversed_z))
        assert (off <= depth_off(stage.device, metres, card, near, reversed_z))[seen].all()
    off = np.abs(images["distance"] - metres)
    assert (off <= distance_off(stage.device, metres, card, near))[seen].all()
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
    assert (errors[0] <= STEPS * ULP * CARDS).all()
    assert (errors[1] <= STEPS * ULP * CARDS**2 / near).all()
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
        assert (off > STEPS * ULP).all()
        swapped = np.abs(metres_of(images[name][at], 0.1, not reversed_z) - metres[at])
        assert (swapped > 0.1 * metres[at]).all(), "each direction has a formula of its own"


@pytest.mark.parametrize("near", [0.01, 1.0])
def test_the_linear_panels_are_monotone_in_distance(stage, near):
    """A panel shows distance over far; on a picture of 90 x 60 a panel is 30 x 30, with every third column and the
    lower one of two rows. No two surfaces are so near to each other that what may move them changes their order."""
    images, at = drawn(stage, near), np.ix_(2 * np.arange(30) + 1, 3 * np.arange(30) + 1)
    metres, card, clear = (image[at] for image in truth())
    seen = clear & np.isfinite(metres)
    assert seen.sum() > 300
    metres, card = metres[seen], card[seen]
    shown, first, which = np.unique(metres, return_index=True, return_inverse=True)
    moved = 255 / FAR * distance_off(stage.device, metres, card, near)
    for rows, reversed_z in ((slice(0, 30), False), (slice(30, 60), True)):
        off = depth_off(stage.device, metres, card, near, reversed_z)[first]
        assert (np.abs(np.diff(depth_of(shown, near, reversed_z))) > off[:-1] + off[1:]).all()
        linear = images["color"][rows, 30:60, 0][seen].astype(int)
        assert in_order(linear, which) and linear.max() > 240
        assert (np.abs(linear - 255 * metres / FAR) <= codes_off(stage.device) + 0.2 + moved).all()
        raw = images["color"][rows, :30, 0][seen].astype(int)
        assert in_order(-raw if reversed_z else raw, which), "above near is dark, below bright"


def test_a_panel_shows_the_texel_below_the_middle_of_its_pixel(stage):
    """A pixel's middle is on the border of two rows of texels, whether the number of rows is even or odd. Distances of
    stored depths tell rows of the floor apart; the shader's own roundings of them are below a tenth of a code."""
    for width, height in (SIZE, (91, 61)):
        images = drawn(stage, 1.0, (width, height))
        y, x = 2 * np.arange(height) + 1, 3 * np.arange(width) + 1
        linear = images["color"][:, x // width == 1, 0]
        for rows, name in ((y < height, "standard_depth"), (y >= height, "depth")):
            at = np.ix_(y[rows] % height, x[x // width == 1] % width)
            wanted = 255 / FAR * metres_of(images[name][at], 1.0, name == "depth")
            shown = images["distance"][at] > 0
            assert shown.sum() > 300
            assert (np.abs(linear[rows] - wanted) <= codes_off(stage.device) + 0.1)[shown].all()


def in_order(codes, which):
    """Return whether no code of a distance is above one of the next distance; `which` numbers distances upwards."""
    low, high = np.full(which.max() + 1, 255), np.full(which.max() + 1, -255)
    np.minimum.at(low, which, codes)
    np.maximum.at(high, which, codes)
    return (high[:-1] <= low[1:]).all()


def metres_shown(colors):
    """Return the metres of error that colours of a panel mean, (N), of those that are not beyond green."""
    assert (colors[:, 0] == 0).all(), "below 10^-3.5 m, where red begins"
    green, blue = colors[:, 1] / 255, colors[:, 2] / 255
    # Of the six steps between seven colours: blue rises, then green rises, then blue falls.
    return 10 ** (np.where(green > 0, 2 + green - blue, blue) * 7 / 6 - 7)


def test_the_error_panels_are_dark_for_reversed_z_alone(stage):
    """A panel compares two distances: that of the recorded depth, whose roundings the tests above bound, and that of
    1 / w, which has as many at most: graphics hardware divides to within 2.5 steps of a float, five times ULP. Software
    divides to the nearest and stays below 5.6 micrometres; an H100 was one step of a float off, 7.6 at 96 m."""
    images, (metres, card, clear) = drawn(stage, 0.001), truth()
    at = np.ix_(2 * np.arange(30) + 1, 3 * np.arange(30) + 1)
    far_cards = clear[at] & (card[at] >= 3) & np.isfinite(metres[at])
    standard, reversed_z = (images["color"][rows, 60:][far_cards] for rows in (slice(0, 30), slice(30, 60)))
    assert far_cards.sum() > 20
    assert standard[:, 0].max() > 200, "red: centimetres and more"
    shown, code = metres_shown(reversed_z), 10 ** (7 / 6 * codes_off(stage.device) / 255)
    assert (shown <= 2 * STEPS * ULP * metres[at][far_cards] * code).all()
    if stage.device.capabilities.is_software:
        assert (shown < 5.6e-6).all()


def test_another_size_makes_new_depth_images(stage):
    with stage.open(WHICH, (33, 20), settings=Settings(near=0.1), outputs=OUTPUTS) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view)
        renderer.resize(SIZE)
        frame = renderer.render(view)
        images = {name: frame.image(name) for name in OUTPUTS}
    expected = drawn(stage, 0.1)
    assert all((images[name] == expected[name]).all() for name in OUTPUTS)
