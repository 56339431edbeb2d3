"""The study first-triangle against edge functions and barycentric coordinates in double precision."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.bounds import codes_off

CORNERS = np.array([(-0.6, -0.4), (0.6, -0.4), (0.0, 0.6)])
"""Of the cookbook's first triangle; x to the right, y up, both from -1 to 1."""

BACKGROUND = 255 * np.array([0.05, 0.05, 0.06])


def barycentric(size: tuple[int, int]) -> np.ndarray:
    """Return (H, W, 3) weights of the corners at pixel centres: each the area of the triangle opposite to it."""
    width, height = size
    x = (np.arange(width) + 0.5) / width * 2 - 1
    y = 1 - (np.arange(height) + 0.5) / height * 2  # row 0 is the top
    p = np.stack(np.meshgrid(x, y), axis=-1)

    def area(a, b, c):
        return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (
            c[..., 0] - a[..., 0]
        )

    a, b, c = CORNERS
    whole = area(a, b, c)
    return np.stack([area(p, b, c), area(p, c, a), area(p, a, b)], axis=-1) / whole


@pytest.mark.feature("intro/first-triangle")
@pytest.mark.parametrize("size", [(64, 64), (61, 37)])
def test_coverage_and_colour_are_those_of_the_edge_functions(stage, size):
    picture = stage.draw("first-triangle", size)["color"].astype(np.float64)
    weights = barycentric(size)
    # A GPU places corners on a grid of 1/256 pixel: a centre that is nearer than that to an edge may fall to either
    # side. The weight of a corner goes from 0 to 1 over the triangle's height above the edge, at most this many pixels.
    unsure = np.abs(weights).min(axis=-1) < 1 / 256 / (0.5 * min(size) * 1.0)
    inside = (weights > 0).all(axis=-1)
    assert unsure.mean() < 0.01
    shown = np.where(inside[..., None], 255 * weights, BACKGROUND)
    assert np.abs(picture - shown)[~unsure].max() <= codes_off(stage.device) + 0.1
    assert np.abs(picture - shown[::-1]).max() > 100, "upside down it is another picture"
    assert 0.15 * 0.9 < inside.mean() < 0.15 * 1.1


@pytest.mark.feature("intro/first-triangle")
def test_15_percent_of_the_picture_within_an_edge_row_and_a_third_of_each_colour_at_the_centroid(stage):
    size = (60, 60)
    picture = stage.draw("first-triangle", size)["color"].astype(np.float64)
    covered = (np.abs(picture - BACKGROUND).max(axis=-1) > 1).sum()
    edge_pixels = 36 + 2 * 30  # along the bottom, and one a row on each side
    assert abs(covered - 0.15 * 60 * 60) <= edge_pixels / 2
    # The centroid is (0, -0.0667): the corner between the pixels of columns 29, 30 and rows 31, 32.
    around = picture[31:33, 29:31].reshape(-1, 3).mean(axis=0)
    assert np.abs(around - 85).max() <= 0.6
    assert (np.abs(picture[[0, 0, -1, -1], [0, -1, 0, -1]] - BACKGROUND) <= 0.5).all()


def test_what_a_frame_did_is_counted(stage):
    with stage.open("first-triangle", (16, 16)) as renderer:
        import chapters

        frame = renderer.render(chapters.view_of(renderer))
        assert frame.work == {"draws": 1, "triangles": 1, "history_resets": 1}
        assert set(frame.timings) <= {"first triangle"}
