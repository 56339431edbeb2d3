"""Ghosts that constraints leave, where nothing but a constraint removes them; and those of the defaults."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch11.benches import taa as bench
from chapters.ch11.benches import taa_scenes as scenes
from chapters.ch11.benches.taa_truth import shown
from common.numerics.transforms import transform_points
from tools.bench.points import Subject

SIZE, FRAMES, SETTLED = (64, 36), 9, 3
COLORS = ((0.95, 0.3, 0.05), (1.0, 1.0, 1.0))

pytestmark = pytest.mark.variants("vulkan", "gl")


def cover(case, frame):
    """Return (H, W) the pixels of the columns that the passing box may touch in a frame, and one more."""
    width, height = SIZE
    x = scenes.PASSING_PX * scenes.pixel(SIZE, 0.5) * (frame - FRAMES / 2)
    corners = np.add(scenes.box(0.15, 0.4, 0.05).reshape(-1, 3), (x, 0.0, 0.5))
    view = case.view(None, 0)
    clip = np.c_[transform_points(view.view_from_world(), corners), np.ones(len(corners))]
    clip = clip @ view.clip_from_view(width / height).T
    across = (clip[:, 0] / clip[:, 3] + 1) / 2 * width
    column = np.arange(width)[None, :] + 0.5
    inside = (column > across.min() - 1.5) & (column < across.max() + 1.5)
    return np.broadcast_to(inside, (height, width))


def ghost(chapter, color, **values):
    """Return the mean and the largest ghost in codes, four frames after pixels were covered last."""
    case = scenes.disocclusion(SIZE, FRAMES)
    case.scene.materials[1] = scenes.unlit(*color)
    subject = Subject(chapter.which, chapter.backend, case.scene, SIZE, chapter.device)
    settings = scenes.settings_of(subject, taa="full", **values)

    with chapter.open(case.scene, SIZE, settings, outputs={"color_linear"}) as renderer:

        def frames():
            renderer.reset_history("a sequence begins")
            first = case.view(None, 0)
            for _ in range(SETTLED):
                renderer.render(first, 0.0)
            return [
                255 * shown(renderer.render(first, case.time(at)).image("color_linear"))
                for at in range(FRAMES)
            ]

        seen = frames()
        with bench.hidden(case.scene, 1):
            without = frames()
    covered = [cover(case, frame) for frame in range(FRAMES)]
    left = []
    for frame in range(bench.AFTER, FRAMES):
        since = covered[frame - bench.AFTER] & ~np.any(covered[frame - bench.AFTER + 1 : frame + 1], axis=0)
        left.append(np.abs(seen[frame] - without[frame])[since].ravel())
    away = np.concatenate(left)
    assert len(away) > 300
    return float(away.mean()), float(away.max())


@pytest.mark.feature("taa/variance-clip-clamped")
@pytest.mark.parametrize("color", [COLORS[0], pytest.param(COLORS[1], marks=pytest.mark.long)])
def test_clipping_to_both_boxes_leaves_the_least_ghost(chapter, color):
    """An object passes before a wall, and depth, which would find most ghosts, does not count."""
    found = {
        name: ghost(chapter, color, taa_constraint=name, taa_tolerance=0.0)[0]
        for name in ("clamp", "clip", "variance", "variance-clamp")
    }
    best = found.pop("variance-clamp")
    assert best <= min(found.values()), (best, found)
    assert best < 0.6 * found["clamp"]


@pytest.mark.feature("taa/variance-clip-clamped")
def test_without_a_constraint_a_ghost_is_left_and_with_the_defaults_none_is_seen(chapter):
    color = COLORS[0]
    assert ghost(chapter, color, taa_constraint="none", taa_tolerance=0.0)[1] > 30
    assert ghost(chapter, color)[1] < 2.0
