"""Motion vectors of the camera: against rays in float64, on planes, cubes and the sky; exactly zero without motion."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import chapters
from chapters.ch11.settings import Settings
from common import layouts
from common.numerics.transforms import pose_looking_at
from common.scene import Instances, Material
from common.view.camera import Orthographic, Perspective, View
from tests.support.motion import SIZE, assert_close, motions, triangles_of
from tests.support.scenes import quad_scene
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


UNLIT = Material(unlit=True, double_sided=True)
NOTHING = np.zeros((0, 3, 3))
JITTER_PX = ((0.0, 0.0), (0.25, -0.375), (-0.5, 0.125), (0.4375, 0.5))


@pytest.fixture
def jittered(monkeypatch):
    """Let each frame be drawn with the next of JITTER_PX, whatever the renderer asks for."""
    fill = layouts.fill_frame_constants

    def filled(record, *what, **more):
        number = more["frame_index"]
        more["jitter_px"] = JITTER_PX[number % len(JITTER_PX)]
        more["previous_jitter_px"] = JITTER_PX[(number - 1) % len(JITTER_PX)]
        fill(record, *what, **more)

    monkeypatch.setattr(layouts, "fill_frame_constants", filled)


@pytest.mark.feature("motion-vectors/camera")
@pytest.mark.parametrize("lens", [WIDE, FLAT], ids=["perspective", "orthographic"])
@pytest.mark.parametrize("step", STEPS)
def test_each_pixel_has_the_motion_of_its_point(chapter, step, lens):
    """The ground, a cube and the sky, by a ray through each pixel."""
    scene = yard(material=UNLIT)
    before, view = looking(lens=lens), replace(STEPS[step], projection=lens)
    (_, seen) = motions(chapter, scene, [before, view])
    corners = triangles_of(scene)
    assert_close(seen, *twin.motion(view, before, SIZE, corners, corners))
    with pytest.raises(AssertionError):  # previous minus current is another convention
        assert_close(-seen, *twin.motion(view, before, SIZE, corners, corners))


@pytest.mark.feature("motion-vectors/camera")
@pytest.mark.parametrize("lens", [WIDE, FLAT], ids=["perspective", "orthographic"])
def test_jitter_moves_the_picture_and_no_vector(chapter, jittered, lens):
    """A camera that stands still: zero to the bit in each frame; one that walks: the motion of what the pixel shows."""
    scene, still = yard(material=UNLIT), looking(lens=lens)
    corners = triangles_of(scene)
    view = replace(STEPS["both"], projection=lens)
    with chapter.open(scene, SIZE, outputs={"motion", "depth"}) as renderer:
        depths = []
        for _ in range(4):
            frame = renderer.render(still)
            assert not frame.image("motion").view(np.uint32).any()
            depths.append(frame.image("depth").copy())
        assert all((one != other).any() for one, other in itertools.pairwise(depths))
        for before, now in ((still, view), (view, still)):
            jitter = JITTER_PX[renderer._index % len(JITTER_PX)]
            assert_close(
                renderer.render(now).image("motion"),
                *twin.motion(now, before, SIZE, corners, corners, jitter),
            )


@pytest.mark.core
@pytest.mark.feature("motion-vectors/camera")
def test_a_pan_before_a_plane_is_the_shift_that_a_ruler_gives(chapter):
    """A plane at distance 2 fills the picture, 2 * 2 tan(yfov / 2) * aspect wide there; the eye moves by 0.1."""
    wall = quad_scene(UNLIT, matrices=(np.diag((9.0, 9.0, 1.0, 1.0)),))
    before, view = (View(pose_looking_at((x, 0, 2), (x, 0, 0)), WIDE) for x in (0.0, 0.1))
    seen = motions(chapter, wall, [before, view])[1]
    across = 2 * 2 * math.tan(math.radians(30)) * SIZE[0] / SIZE[1]
    assert np.abs(seen[..., 0] * SIZE[0] + 0.1 / across * SIZE[0]).max() < 0.02
    assert np.abs(seen[..., 1]).max() < 1e-6


@pytest.mark.feature("motion-vectors/camera")
@pytest.mark.parametrize("knobs", [{}, {"graph": "forward", "msaa": 4}], ids=["deferred", "samples"])
def test_a_scene_of_nothing(chapter, knobs):
    """There is no depth on some paths; the sky still turns where there is one, and an output has its shape."""
    scene = quad_scene(UNLIT, matrices=(np.eye(4),))
    scene = replace(scene, instances=Instances(np.zeros(0, np.int32), np.zeros(0, np.int32)))
    before, view = looking(), looking(EYE, (0.3, 0.8, 0.0))
    seen = motions(chapter, scene, [before, view], settings=Settings(**{"graph": "deferred", **knobs}))[1]
    assert seen.shape == (*SIZE[::-1], 2)
    if knobs:
        assert not seen.any()
    else:
        assert_close(seen, *twin.motion(view, before, SIZE, NOTHING, NOTHING))


@pytest.mark.variants("gl")
@pytest.mark.feature("motion-vectors/camera")
def test_vulkan_is_opengl(chapter):
    """The same bits from the same texts, where one driver compiles both; a GPU's compilers may round another way.

    A rounding of a position, 2^-24 of some two pictures, may fall on the other half float: a step of 2^-11 at most.
    """
    software = chapter.device.capabilities.is_software
    vulkan = chapters.renderer_module(chapter.which, "vulkan").Renderer
    views, settings = [looking(), STEPS["both"]], Settings(graph="deferred")
    with vulkan(yard(material=UNLIT), SIZE, settings, outputs={"motion"}) as renderer:
        wanted = [renderer.render(view).image("motion") for view in views]
    for drawn, other in zip(
        motions(chapter, yard(material=UNLIT), views, settings=settings), wanted, strict=True
    ):
        apart = np.abs(drawn - other)
        assert (apart <= (0.0 if software else 2.0**-10) * np.abs(other)).all(), apart.max()
