"""What self-tests say of pictures of lines: nothing of a right one, and what is wrong of each wrong one."""

from __future__ import annotations

import numpy as np
import pytest

from backends.selftest.draws import wireframe_wrong


def right() -> np.ndarray:
    """Return the picture: edges at x = 2.5 and y = 2.5 from 2.5 to 13.5, and the diagonal between their ends."""
    pixels = np.zeros((16, 16), np.uint8)
    pixels[2, 2:13] = pixels[2:13, 2] = 1
    for x in range(2, 14):
        pixels[min(15 - x, 13), x] = 1
    return pixels


def test_a_right_picture_has_no_fault():
    assert wireframe_wrong(right()) == ""


@pytest.mark.parametrize(
    ("place", "value", "says"),
    [
        (np.s_[5, 5], 1, "pixels away from the edges were drawn"),
        (np.s_[15, 15], 1, "pixels away from the edges were drawn"),
        (np.s_[2, 7], 0, "pixels of a straight edge are missing"),
        (np.s_[2, 5], 0, "pixels of a straight edge are missing"),
        (np.s_[7, 2], 0, "pixels of a straight edge are missing"),
        (np.s_[10, 2], 0, "pixels of a straight edge are missing"),
        (np.s_[6:, 6:], 0, "the diagonal edge is missing"),
    ],
)
def test_each_fault_is_named(place, value, says):
    pixels = right()
    if says.startswith("the diagonal"):
        for x in range(5, 12):
            pixels[15 - x, x] = 0
    else:
        pixels[place] = value
    assert wireframe_wrong(pixels) == says
