"""The passes of this chapter on Vulkan and on OpenGL: they declare the same, and draw the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch04.gl import Renderer as OpenGL
from chapters.ch04.renderer import Renderer as Vulkan
from chapters.ch04.settings import Settings
from tests.support.jumble import CAMERA, jumble

pytestmark = pytest.mark.variants("gl")

SIZE = (40, 24)
OUTPUTS = {"color", "color_linear", "depth", "instance_id"}
EXACT = Settings(color_format="rgba32f", graph="deferred", gbuffer_format="full", depth_prepass=True)


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"gbuffer_format": "compact", "depth_prepass": False},
        {"aperture": 0.1},
        {"aperture": 0.1, "focus_distance": 3.0, "bokeh_taps": 2, "graph": "forward"},
    ],
    ids=["full", "compact", "lens", "forward-lens"],
)
def test_the_same_frame_on_both(vulkan_device, gl_context, changed):
    """Depth and ids to the bit; light to 1e-5, or where the lens keeps it in halves, to two of their steps.

    Compact, a number on the border of two codes may become either: then a code is all that may differ.
    """
    if not (vulkan_device.capabilities.is_software and gl_context.capabilities.is_software):
        pytest.skip("the bounds are those of the software drivers")
    settings, scene = replace(EXACT, **changed), jumble(7)
    with (
        Vulkan(scene, SIZE, settings, outputs=OUTPUTS, device=vulkan_device) as vulkan,
        OpenGL(scene, SIZE, settings, outputs=OUTPUTS, device=gl_context) as opengl,
    ):
        a, b = vulkan.render(CAMERA), opengl.render(CAMERA)
        for mine, other in zip(vulkan.passes, opengl.passes, strict=True):
            assert (mine.name, mine.reads, mine.writes) == (other.name, other.reads, other.writes)
        assert np.array_equal(a.image("depth"), b.image("depth"))
        assert np.array_equal(a.image("instance_id"), b.image("instance_id"))
        light = [frame.image("color_linear").astype(np.float64) for frame in (a, b)]
        off = np.abs(light[0] - light[1]) / np.maximum(1.0, light[0])
        bound = 2 * 2.0**-10 if "aperture" in changed else 1e-5
        if "gbuffer_format" in changed:
            assert (off > bound).mean() < 0.01
            bound = 0.02
        assert off.max() <= bound
        assert light[0].std() > 0.1
        shared = ("passes", "passes_skipped", "draws", "triangles")
        assert {name: a.work[name] for name in shared} == {name: b.work[name] for name in shared}
