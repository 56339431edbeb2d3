"""Bands of a ramp of fog, measured: coarse slices show them, samples at random depths that are averaged do not."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch10.settings import Settings
from common.numerics.transforms import pose_looking_at
from common.reports.metrics import gradient_step
from common.scene import FogBox, Material, Medium
from common.settings import replaced
from common.view.camera import Orthographic, View
from tests.support.fog import FULL, foggy

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (16, 96)
VIEW = View(pose_looking_at((2.5, 2.5, 4.0), (2.5, 0.0, 0.0)), Orthographic(0.6, 0.05, 20.0))
"""Down to the ground at a slant, past the cube: depth is linear from row to row."""

BASE = Settings(
    **{**FULL, "fog_columns": 4, "fog_rows": 96, "fog_slices": 12, "fog_far": 1.0, "ambient": 2.0}
)
BLACK = Material(unlit=True, base_color=(0.0, 0.0, 0.0, 1.0), double_sided=True)
SLAB = Medium(boxes=(FogBox((0.0, 0.5, 0.0), (9.0, 0.4, 9.0), 0.3, (1.0, 1.0, 1.0)),))
"""Its top is cut at another depth in each row, so a fixed sample of a slice is now in it and now above it."""


def ramp(chapter, frames, **turned):
    """Return light of the last of some frames, (H, W, 3)."""
    scene = foggy(medium=SLAB, material=BLACK)
    with chapter.open(scene, SIZE, replaced(BASE, **turned), outputs={"color_linear"}) as renderer:
        for _ in range(frames):
            frame = renderer.render(VIEW)
        return frame.image("color_linear")[..., :3].astype(np.float64)


@pytest.mark.feature("metrics/banding")
def test_bands_of_a_ramp_fall_with_jitter_and_the_temporal_filter(chapter):
    """In parts of the light: a slice that enters the slab at once is a step of a slice's own light."""
    off, one, on = ramp(chapter, 1), ramp(chapter, 1, fog_temporal=True), ramp(chapter, 64, fog_temporal=True)
    steps = [gradient_step(picture, axis=0) / picture.mean() for picture in (off, one, on)]
    assert steps[0] > 0.02
    assert steps[2] < 0.1 * steps[0], "both together"
    assert steps[2] < 0.1 * steps[1], "jitter alone is noise"
    assert on.mean() == pytest.approx(off.mean(), rel=0.1)
