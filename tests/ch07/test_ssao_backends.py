"""Ambient occlusion on Vulkan and on OpenGL, and both against rays that are cast at the scene's triangles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch07.benches.ray_casting import RayCaster
from chapters.ch07.settings import Settings
from common.settings import replaced
from tests.support.occluded import EYE_VIEW, FLAT_VIEW, METHODS, RAW, RESULT, STEP, codes, room
from tests.support.scenes import translated

pytestmark = pytest.mark.variants("vulkan")

SIZE = (48, 32)
SETTINGS = Settings(ambient=0.5, anisotropy=1.0, graph="deferred", ssao_radius=0.15)


def found(chapter, scene, view, method):
    """Return the estimate and the result of a frame."""
    settings = replaced(SETTINGS, ssao=method)
    with chapter.open(scene, SIZE, settings, outputs={"color"}, inspect=True) as renderer:
        frame = renderer.render(view)
        return codes(frame, RAW), codes(frame, RESULT)


@pytest.mark.feature("ssao/depth-only")
@pytest.mark.parametrize("method", METHODS)
def test_both_backends_are_within_a_step(chapter, gl_context, method):
    scene = room(translated(0.5, 0.8, 1.2))
    both = [chapter, replace(chapter, backend="gl", device=gl_context)]
    for view in (EYE_VIEW, FLAT_VIEW):
        (raw, result), (other_raw, other_result) = (found(one, scene, view, method) for one in both)
        assert raw.std() > 10
        assert np.abs(raw - other_raw).max() <= 1 and np.abs(result - other_result).max() <= 1


@pytest.mark.long
@pytest.mark.needs("mitsuba")
@pytest.mark.feature("ssao/depth-only")
def test_rays_around_the_normal_are_nearer_to_cast_rays_than_depth_alone(chapter):
    """A floor, a wall and a square before them: half of the floor's light is hidden at the wall's foot."""
    scene = room(translated(0.5, 0.8, 1.2))
    truth = RayCaster(scene).visibility(EYE_VIEW, SIZE, 0.15 * scene.length_scale, 64, every=2)
    compared = np.isfinite(truth)
    assert compared.sum() > 300 and np.nanmin(truth) < 0.6 and (truth[compared] == 1).mean() > 0.1
    errors = {}
    for method in METHODS:
        _, result = found(chapter, scene, EYE_VIEW, method)
        visible = np.minimum(result * STEP + (0.2 if method == "depth" else 0.0), 1.0)
        errors[method] = float(np.sqrt(np.mean((visible - truth)[compared] ** 2)))
    none = float(np.sqrt(np.mean((1 - truth[compared]) ** 2)))
    assert errors["normals"] < 0.6 * none, (errors, none)
    assert errors["normals"] < errors["depth"], (errors, none)
