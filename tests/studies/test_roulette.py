"""The study roulette: equal means, shorter paths, and what paths that end early cost in variance."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch12.studies.roulette import Settings
from chapters.ch12.studies.roulette.model import STARTS, Measured, measured, room
from chapters.ch12.studies.wavefront import Settings as Waves
from chapters.ch12.studies.wavefront.layout import ROUNDS
from common.scene.pose import evaluate_pose
from tests.support.path_pictures import assert_agrees, z_scores
from tests.support.shadows import PLAIN

WHICH, SIZE, FRAMES = "12/roulette", (24, 16), 48

pytestmark = [
    pytest.mark.feature("path-tracer/russian-roulette"),
    pytest.mark.parametrize(
        "stage", ["vulkan", pytest.param("gl", marks=pytest.mark.long)], indirect=True, scope="module"
    ),
]


@pytest.fixture(scope="module")
def drawn(stage):
    """Return what paths show that end by each rule, by its name."""
    way = {"ray_way": "pipeline"} if stage.backend == "vulkan" and stage.device.has("ray-tracing") else {}
    with stage.open(WHICH, SIZE, settings=Settings(**{**PLAIN, **way}), outputs={"color_linear"}) as renderer:
        view = chapters.view_of(renderer)
        before = renderer.settings.paths.path_roulette
        found = {name: measured(renderer, view, start, FRAMES) for name, start in STARTS.items()}
        assert renderer.settings.paths.path_roulette == before and renderer.settings.paths.path_average
    return found


def test_all_rules_have_one_mean(drawn):
    first, after, never = drawn.values()
    for other in (first, after):
        assert_agrees(z_scores(other.pictures - never.pictures))
        assert np.abs(other.pictures - never.pictures).max() > 0.1 * never.pictures.mean()


def test_variance_grows_with_roulette_and_not_by_much(drawn):
    """What it adds is what paths carry that end: little behind three reflections."""
    first, after, never = (it.variance for it in drawn.values())
    assert 0.9 * never < after < 1.3 * never and 0.9 * never < first < 2.0 * never
    assert first > 0.9 * after


def test_roulette_saves_more_steps_than_it_costs(stage, drawn):
    """Steps of paths, which the study wavefront counts, in place of time: times of a busy machine prove nothing."""
    settings = Waves(**{**PLAIN, "path_bounces": 64, "path_average": False})
    with stage.open("12/wavefront", SIZE, room(), settings=settings, outputs={"color_linear"}) as renderer:
        view, steps = chapters.view_of(renderer), {}
        for name, start in STARTS.items():
            renderer.settings.paths.path_roulette = start
            frame = renderer.render(view)
            frame.image("color_linear")
            steps[name] = sum(frame.work[f"wave_live_{turn}"] for turn in range(ROUNDS))
    pixels = SIZE[0] * SIZE[1]
    assert 20 < steps["never"] / pixels <= 65, (
        "only the lamp and backs of the block, which are black, end paths"
    )
    efficiency = {name: 1.0 / (drawn[name].variance * steps[name]) for name in STARTS}
    first, after, never = efficiency.values()
    assert after > 2.0 * never and first > 2.0 * never


def test_efficiency_is_one_over_variance_and_time(stage):
    green = np.array([1.0, 3.0, 2.0, 2.0])
    pictures = np.zeros((4, 1, 1, 3))
    pictures[:, 0, 0, 1] = green
    found = Measured(pictures, 5.0)
    assert found.variance == pytest.approx(2 / 3 / 4) and found.efficiency == pytest.approx(6 / 5)


def test_the_room_is_closed(stage):
    """Rays from inside meet a wall in every direction: squares in float64."""
    scene = room()
    matrices = evaluate_pose(scene, 0.0).world_from_object
    rays = np.random.default_rng(1).normal(size=(4000, 3))
    eye, met = np.array((0.0, 1.0, 1.9)), np.zeros(len(rays), bool)
    for matrix in matrices[: len(scene.instances)]:
        back = np.linalg.inv(matrix)
        origin, along = back[:3, :3] @ eye + back[:3, 3], rays @ back[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -origin[2] / along[:, 2]
        at = origin + t[:, None] * along
        met |= (t > 0) & (np.abs(at[:, :2]) <= 1.0 + 1e-9).all(axis=1)
    assert met.all()
