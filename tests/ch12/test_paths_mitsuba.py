"""The path tracer against that of Mitsuba 3, on scenes in which both have the same materials, lights and media.

Eleven scenes are independent. Their surfaces are metals: Lambert's surface alone is no material of glTF, whose
dielectrics have facets with F0 = 0.04 above it. Metals are Mitsuba's `roughconductor` (white) or `principled` (any
colour) at roughnesses from 0.1 to 0.9. Their light comes from even and textured skies, emissive squares, and lights of
each kind; one is seen through a lens, two have a homogeneous medium. A twelfth scene shows dielectrics. For it Mitsuba
gets a mixture of its own materials that was written for this test (tests/support/mitsuba_paths.py), so that Schlick's
Fresnel in it is not independent.

Means of blocks of 8x8 pixels are compared in standard errors, which follow from independent pictures of both programs.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.support import mitsuba_paths
from tests.support.path_cases import CASES, PAINTED, Case
from tests.support.path_pictures import light, opened

pytestmark = [
    pytest.mark.variants("vulkan"),
    pytest.mark.needs("mitsuba"),
    pytest.mark.feature("path-tracer/core"),
]

BLOCK = 8
BATCHES, FEW = 32, 16
"""Pictures of each program. Student's t with the 62 degrees of freedom of 32 has variance 1.03, and 0.4 % beyond 3."""

FLOOR = 3e-4
"""The error of a textured sky, relative: texels have 16 bits, which leaves 2^-12, and are interpolated."""


def ours(chapter, case: Case, size, samples, batches=BATCHES):
    """Return (batches, H, W, 3) pictures of a case by our path tracer, and one of light that is reflected once."""
    knobs = {
        "sky": True,
        "environment_size": 128,
        "path_roulette": 1024,
        "path_bounces": case.bounces,
    } | case.ours
    knobs |= {"path_average": False, "path_samples": samples}
    pictures = []
    with opened(chapter, case.scene(), size, **knobs) as renderer:
        path_knobs = renderer.settings.paths
        for seed in range(batches):  # points of one sequence of Sobol's are not independent of each other
            path_knobs.path_seed = seed
            pictures.append(light(renderer, case.view))
        path_knobs.path_bounces, path_knobs.path_samples = 1, samples * batches
        once = light(renderer, case.view)
    return np.stack(pictures), once


def theirs(case: Case, size, samples, batches=BATCHES):
    """Return the same by Mitsuba."""
    parts = mitsuba_paths.scene_parts(case.scene(), case.view, size, bounces=case.bounces, **case.theirs)
    return mitsuba_paths.render(parts, samples, batches)


def scores(case: Case, first, second):
    """Return the differences of blocks in standard errors, where noise is what they have.

    Blocks that have none, or less than the error of a sky, must be equal to within that.
    """

    def blocks(pictures):
        count, height, width, _ = pictures.shape
        parts = pictures.reshape(count, height // BLOCK, BLOCK, width // BLOCK, BLOCK, 3).mean(axis=(2, 4))
        return parts.mean(axis=0), parts.var(axis=0, ddof=1) / count

    (mean, variance), (other, other_variance) = blocks(first), blocks(second)
    sky = case.scene().environment
    textured = sky is not None and np.ptp(sky.radiance, axis=(0, 1)).any()
    floor = (FLOOR if textured else 1e-6) * other
    error = np.sqrt(variance + other_variance)
    noisy = error > floor
    assert noisy.mean() > 0.4, case.name
    assert (np.abs(mean - other) <= 3.0 * floor)[~noisy].all(), case.name
    return (mean - other)[noisy] / np.hypot(error, floor)[noisy]


@pytest.mark.parametrize("name", [pytest.param("many lamps", marks=pytest.mark.long), "bank of fog"])
def test_pictures_are_those_of_another_path_tracer(chapter, name):
    """With all kinds of light between them; light that is reflected once is less by more than noise."""
    (case,) = (it for it in CASES if it.name == name)
    (first, once), second = ours(chapter, case, (64, 48), 8, FEW), theirs(case, (64, 48), 8, FEW)
    z = scores(case, first, second)
    assert 0.6 < (z**2).mean() < 1.5, (z**2).mean()
    assert np.abs(z).max() < 5.0 and (np.abs(z) > 3.0).mean() <= 0.02, np.abs(z).max()
    noise = np.hypot(*(it.mean(axis=(1, 2, 3)).std(ddof=1) / np.sqrt(FEW) for it in (first, second)))
    away = 4.0 * noise + FLOOR * second.mean()
    assert abs(first.mean() - second.mean()) < away < 0.02 * second.mean()
    assert second.mean() - once.mean() > 2.0 * away


@pytest.mark.long
def test_scores_of_all_scenes_are_those_of_noise_alone(chapter):
    """Their variance is 1 to within a tenth, and a hundredth of them at most is beyond 3."""
    every, size = [], (128, 96)
    for case in CASES:
        z = scores(case, ours(chapter, case, size, 16)[0], theirs(case, size, 16))
        print(
            f"{case.name}: variance {(z**2).mean():.3f}, mean {z.mean():+.3f}, largest {np.abs(z).max():.2f}"
        )
        assert (z**2).mean() < 1.4 and np.abs(z).max() < 6.0, case.name
        every.append(z)
    z = np.concatenate(every)
    print(f"all: variance {(z**2).mean():.3f}, {(np.abs(z) > 3.0).mean():.2%} beyond 3")
    assert abs((z**2).mean() - 1.0) < 0.1
    assert (np.abs(z) > 3.0).mean() <= 0.01


@pytest.mark.long
def test_dielectrics_are_those_of_a_mixture_of_materials(chapter):
    """Schlick's Fresnel is the test's; diffuse light, facets, and all that paths do, are Mitsuba's."""
    z = scores(PAINTED, ours(chapter, PAINTED, (64, 48), 8)[0], theirs(PAINTED, (64, 48), 4))
    assert 0.6 < (z**2).mean() < 1.5 and np.abs(z).max() < 5.0, (z**2).mean()
