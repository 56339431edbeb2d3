"""Motion vectors of the camera: against rays in float64, on planes, cubes and the sky; exactly zero where nothing moves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Orthographic, Perspective, View
from tests.support.motion import SIZE, assert_close, motions, triangles_of
from tests.support.shadows import yard
from tests.twins import motion as twin

pytestmark = pytest.mark.variants("vulkan", "gl")

WIDE, FLAT = Perspective(math.radians(60), 0.1), Orthographic(2.5, 0.1, 40.0)
EYE, TARGET = (3.0, 2.5, 4.0), (0.0, 0.8, 0.0)


def looking(eye=EYE, target=TARGET, lens=WIDE) -> View:
    return View(pose_looking_at(eye, target), lens)


STEPS = {
    "pan": looking((3.2, 2.5, 3.9), (0.2, 0.8, -0.1)),
    "dolly": looking((2.7, 2.3, 3.6), TARGET),
    "turn": looking(EYE, (0.5, 1.0, 0.2)),
    "both": looking((3.3, 2.2, 4.4), (0.1, 1.1, -0.3)),
}


@pytest.mark.feature("motion-vectors/camera")
@pytest.mark.parametrize("lens", [WIDE, FLAT], ids=["perspective", "orthographic"])
@pytest.mark.parametrize("step", STEPS)
def test_each_pixel_has_the_motion_of_its_point(chapter, step, lens):
    """The ground, a cube and the sky, by a ray through each pixel."""
    scene = yard(material=Material(unlit=True, double_sided=True))
    before, view = looking(lens=lens), replace(STEPS[step], projection=lens)
    (_, seen) = motions(chapter, scene, [before, view])
    corners = triangles_of(scene)
    assert_close(seen, *twin.motion(view, before, SIZE, corners, corners))
