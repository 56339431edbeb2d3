"""The study strategies: which one finds which lamp, their means, and the bound of their combination."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch12.studies.strategies import Settings, plates_and_lamps
from chapters.ch12.studies.strategies.model import (
    HALVES,
    LAMPS,
    PLATES,
    POWER,
    ROUGHNESS,
    STRATEGIES,
    shown_plates,
    variances,
)
from common.scene.pose import evaluate_pose
from tests.support.path_pictures import assert_agrees, runs_of, z_scores
from tests.support.shadows import PLAIN

WHICH, SIZE, FRAMES = "12/strategies", (56, 35), 48
EYE = np.array((0.0, 2.2, 8.0))

pytestmark = [
    pytest.mark.feature("path-tracer/mis"),
    pytest.mark.parametrize(
        "stage", ["vulkan", pytest.param("gl", marks=pytest.mark.long)], indirect=True, scope="module"
    ),
]


@pytest.fixture(scope="module")
def drawn(stage):
    """Return a renderer of the study whose frames have paths of their own, and its view."""
    way = {"ray_way": "pipeline"} if stage.backend == "vulkan" and stage.device.has("ray-tracing") else {}
    settings = Settings(**{**PLAIN, **way, "path_average": False})
    with stage.open(WHICH, SIZE, settings=settings, outputs={"color_linear", "instance_id"}) as renderer:
        yield renderer, chapters.view_of(renderer)


def test_each_strategy_wins_where_the_other_one_fails(drawn):
    """Reflected rays at the largest lamp and the smoothest plate, rays to lamps at the smallest one and the roughest.

    The combination is within a factor of 2 of the better one everywhere. Veach (1997, 9.2.2) bounds the variance with
    the balance heuristic by that of the better strategy and half of the squared mean. Where reflected rays hardly ever
    meet a lamp, their variance is not known: then their mean is not that of the others, and rays to lamps are better.
    """
    variance, light = variances(*drawn, FRAMES)
    lights, bsdf, mis = (variance[STRATEGIES.index(name)] for name in ("lights", "bsdf", "mis"))
    assert bsdf[0, -1] < 0.1 * lights[0, -1]
    assert lights[-1, 0] < 0.1 * lights[0, 0] and lights[-1, 1] < 0.1 * bsdf[-1, 1]
    assert (np.diff(lights[:, -1]) < 0).all(), "rays to a large lamp get better with roughness"
    assert (np.diff(bsdf[0]) < 0).all(), (
        "reflected rays of a smooth plate get better with the size of the lamp"
    )
    known = np.abs(light[STRATEGIES.index("bsdf")] / light[STRATEGIES.index("mis")] - 1.0) < 0.3
    assert known[0, 1:].all() and known[:, -1].all()
    better = np.where(known, np.minimum(lights, bsdf), lights)
    assert (mis < 2.0 * better).all(), mis / better
    worse = np.maximum(lights, bsdf)
    assert (mis[0, -1] < 0.1 * worse[0, -1]) and (mis[-1, 1] < 0.1 * worse[-1, 1])


def test_all_strategies_have_one_mean(drawn):
    """The combination against rays to lamps; reflected rays need far more frames at small lamps."""
    renderer, view = drawn
    each = [{"path_strategy": "lights", "path_samples": 16}, {"path_strategy": "mis", "path_samples": 16}]
    lights, mis = runs_of(renderer, view, 16, each)
    both = np.concatenate([lights, mis])
    assert lights.std(axis=0).sum() > 0 and both.mean() > 0.01
    z = z_scores(lights - mis, block=7)
    rows = np.abs(both.mean(axis=(0, 3)).reshape(SIZE[1] // 7, 7, SIZE[0] // 7, 7).mean(axis=(1, 3))) > 1e-4
    assert rows.sum() > 8
    assert_agrees(z[rows])


def test_lamps_have_one_power_and_plates_mirror_them_to_the_eye(stage):
    scene = plates_and_lamps()
    matrices = evaluate_pose(scene, 0.0).world_from_object
    for number in range(len(HALVES)):
        lamp = len(ROUGHNESS) + number
        across, along = matrices[lamp][:3, 0], matrices[lamp][:3, 1]
        area = 4.0 * np.linalg.norm(np.cross(across, along))
        assert area * scene.materials[lamp].emissive[0] == pytest.approx(POWER, rel=1e-5)
        assert matrices[lamp][:3, 2] @ (np.array((0.0, 1.0, 0.0)) - np.array(LAMPS[number])) > 0
    middle = np.mean(LAMPS, axis=0)
    for plate, (y, z) in enumerate(PLATES):
        normal, center = matrices[plate][:3, 2], np.array((0.0, y, z))
        to_eye, to_lamps = ((it - center) * (0, 1, 1) for it in (EYE, middle))
        mirrored = 2 * normal * (normal @ to_eye) - to_eye
        assert mirrored @ to_lamps > 0.9999 * np.linalg.norm(mirrored) * np.linalg.norm(to_lamps)


def test_pixels_of_a_plate_are_inside_of_it(stage):
    ids = np.zeros((6, 7), np.uint32)
    ids[1:5, 1:6] = 3
    ids[2, 5] = 1
    inside = shown_plates(ids)
    assert inside.shape == (len(ROUGHNESS), 6, 7)
    assert not inside[[0, 1, 3]].any()
    assert np.argwhere(inside[2]).tolist() == [[2, 2], [2, 3], [3, 2], [3, 3]]
