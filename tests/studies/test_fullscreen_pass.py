"""The study fullscreen-pass: every pixel once, with the coordinates of its centre, by three vertices as by six."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch04.studies.fullscreen_pass import Settings
from tests.support.bounds import codes_off

fullscreen = pytest.mark.feature("composition/fullscreen-pass")
SHAPES = ("triangle", "quad")
SIZES = [(64, 64), (61, 37), (1, 1), (1, 50), (255, 3)]


def filled(stage, shape, size):
    outputs = ("color", "uv", "writes")
    return stage.draw("4/fullscreen-pass", size, settings=Settings(shape), outputs=outputs)


def centres(size):
    """Return (H, W, 2) float64: (i + 0.5) / W and (j + 0.5) / H."""
    width, height = size
    return np.stack(
        np.meshgrid((np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height), axis=-1
    )


@fullscreen
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("shape", SHAPES)
def test_every_pixel_is_written_once_with_the_uv_of_its_centre(stage, shape, size):
    images = filled(stage, shape, size)
    assert (images["writes"] == 1.0).all() and images["writes"].shape == (size[1], size[0], 4)
    # Rounding of an interpolation between 0 and 2 in 32 bits, and the vertices' grid of 1/256 pixel: corners lie on it.
    bound = 8 * np.finfo(np.float32).eps
    assert np.abs(images["uv"][..., :2] - centres(size)).max() <= bound
    steps = images["uv"][..., 2:] * np.array(size)
    assert np.abs(steps - 1.0).max() <= 2 * bound * max(size)
    shown = 255 * np.concatenate([centres(size), np.full((size[1], size[0], 1), 0.25)], axis=-1)
    assert np.abs(images["color"] - shown).max() <= codes_off(stage.device) + 1e-3


@fullscreen
@pytest.mark.parametrize("shape", SHAPES)
def test_a_picture_upside_down_or_mirrored_would_be_noticed(stage, shape):
    uv = filled(stage, shape, (61, 37))["uv"][..., :2]
    assert np.abs(uv - centres((61, 37))[::-1]).max() > 0.9
    assert np.abs(uv - centres((61, 37))[:, ::-1]).max() > 0.9


@fullscreen
@pytest.mark.parametrize("size", SIZES)
def test_three_vertices_and_six_agree_to_rounding(stage, size):
    triangle, quad = (filled(stage, shape, size) for shape in SHAPES)
    assert np.abs(triangle["uv"] - quad["uv"]).max() <= 8 * np.finfo(np.float32).eps
    assert (triangle["writes"] == quad["writes"]).all()
    assert np.abs(triangle["color"].astype(int) - quad["color"]).max() <= 1


@fullscreen
def test_three_vertices_are_one_triangle_and_six_are_two_and_only_what_is_asked_for_is_drawn(stage):
    for shape, triangles in zip(SHAPES, (1, 2), strict=True):
        with stage.open("4/fullscreen-pass", (16, 16), settings=Settings(shape)) as renderer:
            work = renderer.render(chapters.view_of(renderer)).work
            assert (work["draws"], work["triangles"]) == (1, triangles)


@fullscreen
def test_another_size_is_filled_as_well(stage):
    with stage.open("4/fullscreen-pass", (9, 5), outputs=("color", "uv", "writes")) as renderer:
        renderer.render(chapters.view_of(renderer))
        renderer.resize((30, 7))
        for _ in range(3):  # also in a slot that was used before
            frame = renderer.render(chapters.view_of(renderer))
            assert frame.image("color").shape == (7, 30, 3)
            assert (frame.image("writes") == 1.0).all() and frame.image("uv").shape == (7, 30, 4)
