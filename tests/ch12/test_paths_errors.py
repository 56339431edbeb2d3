"""What the path tracer knows of its errors: the estimate, paths that are no numbers, and pixels that have enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from common.scene import Material
from tests.support.path_pictures import SIZE, opened, runs_of, turned
from tests.support.path_scenes import (
    ABOVE,
    CORNER,
    floor_under,
    light_of_square,
    lit_yard,
    room,
)

pytestmark = pytest.mark.variants("vulkan", "gl")

NITS = np.array((5.0, 3.0, 1.0))
GLOW = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=tuple(NITS), roughness=1.0, metallic=1.0)
LUMINANCE = np.array((0.2126, 0.7152, 0.0722))


@pytest.fixture(scope="module")
def glowing(chapter):
    """Return a renderer of an emissive square above a ground, with live knobs."""
    with opened(chapter, floor_under(GLOW), path_bounces=1) as renderer:
        yield renderer


@pytest.mark.feature("path-tracer/accumulation")
def test_the_estimated_error_is_the_one_that_pictures_have(glowing):
    """The estimate of one picture, against how far independent pictures are from the truth."""
    more = {"path_samples": 32, "path_filter": "centre"}
    truth = light_of_square(lambda lamp, direction: NITS) @ LUMINANCE
    (seen,) = runs_of(glowing, ABOVE, **more)
    exposure = 1.0 / (1.2 * 2.0**ABOVE.ev100)
    relative = (seen @ LUMINANCE - truth) ** 2 / (truth**2 + (0.01 / exposure) ** 2)
    wanted = np.sqrt(relative.mean())
    with turned(glowing, **more):
        work = glowing.render(ABOVE).work
        assert work["path_total"] == 32 * SIZE[0] * SIZE[1] and work["path_left_out"] == 0
        assert abs(work["path_error_ppm"] / 1e6 / wanted - 1.0) < 0.1
        for _ in range(3):
            frame = glowing.render(ABOVE)
        assert abs(2.0 * frame.work["path_error_ppm"] / work["path_error_ppm"] - 1.0) < 0.1


@pytest.mark.feature("path-tracer/accumulation")
def test_paths_that_are_no_numbers_are_counted_and_left_out(chapter, glowing):
    """A square of infinite light: what sees it shows what the other paths see, and all else is as it was."""
    scene = floor_under(replace(GLOW, emissive=(3e38, 0.0, 0.0)), 0.4, 1.0)
    with opened(chapter, scene, path_samples=16, path_bounces=1, path_strategy="bsdf") as renderer:
        frame = renderer.render(ABOVE)
        picture = frame.image("color_linear")
        assert np.isfinite(picture).all() and not picture.any()
        left_out = frame.work["path_left_out"]
        assert left_out > 0 and frame.work["path_total"] == 16 * SIZE[0] * SIZE[1] - left_out
        assert renderer.render(ABOVE).work["path_left_out"] > left_out
    with turned(glowing, path_samples=16, path_strategy="bsdf"):
        assert glowing.render(ABOVE).work["path_left_out"] == 0


@pytest.mark.feature("path-tracer/accumulation")
def test_pixels_with_enough_paths_get_no_more(chapter):
    """Where light is even few paths are enough; the mean stays right, and the error comes near to the one asked for."""
    more = {"path_samples": 8, "path_bounces": 4}
    with opened(chapter, room(), path_error=0.05, **more) as renderer:
        totals = [renderer.render(CORNER).work["path_total"] for _ in range(16)]
        frame = renderer.render(CORNER)
        picture = np.asarray(frame.image("color_linear"), np.float64)
        assert 0.04 < frame.work["path_error_ppm"] / 1e6 < 0.055
        new = np.diff([0, *totals]) / (8 * SIZE[0] * SIZE[1])
        assert (new[:4] == 1.0).all() and 0.0 < new[-1] < 0.4
        renderer.reset_history("test")
        renderer.settings.paths.path_error = 0.0
        for _ in range(17):
            frame = renderer.render(CORNER)
        assert frame.work["path_total"] == 17 * 8 * SIZE[0] * SIZE[1]
        full = np.asarray(frame.image("color_linear"), np.float64)
    assert abs(picture.mean() / full.mean() - 1.0) < 0.02 and not np.array_equal(picture, full)


def test_a_scene_of_lights_alone_is_done_at_once(chapter):
    """Rays through centres, towards lights: all paths are equal, and the error is 0."""
    with opened(chapter, lit_yard(), path_samples=4, path_bounces=1, path_filter="centre") as renderer:
        assert renderer.render(ABOVE).work["path_error_ppm"] <= 300  # roundings of squares in 32 bits
