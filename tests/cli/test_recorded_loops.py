"""Loops that a renderer draws along a path have the frames of `strata run --path`."""

from __future__ import annotations

import numpy as np

import chapters
from chapters import scenes
from common.settings import replaced
from common.view.paths import Stage, path
from tools.run.loops import GAP, PAPER, recorded
from tools.site.figures.film import pictures_of

SIZE = (48, 32)


def test_a_loop_along_a_path_has_every_second_frame_of_two_renderers_and_runs_back(vulkan_instance):
    settings = chapters.settings_class(1)()
    smooth = replaced(settings, msaa=4)
    made = recorded(
        1,
        "cornell",
        "pan:pixels=1.5",
        4,
        10.0,
        SIZE,
        (None, smooth),
        backend="vulkan",
        drawn=2,
        back=True,
        quality=None,
    )
    found = pictures_of(made)
    assert found.shape == (6, 32, 2 * 48 + GAP, 3)
    scene, expected = scenes.load("cornell"), []
    for one in (settings, smooth):
        with chapters.open(1, "vulkan", scene=scene, size=SIZE, settings=one) as renderer:
            views = path("pan:pixels=1.5", Stage.of(scene, chapters.view_of(renderer), SIZE), 7, 20.0)
            frames = [renderer.render(view, n / 20.0).image("color").copy() for n, view in enumerate(views)]
        expected.append([frames[n] for n in (0, 2, 4, 6, 4, 2)])
    assert np.array_equal(found[:, :, :48], expected[0])
    assert np.array_equal(found[:, :, 48 + GAP :], expected[1])
    assert (found[:, :, 48 : 48 + GAP] == PAPER).all()
    assert (found[0] != found[3]).any()
