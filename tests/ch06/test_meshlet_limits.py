"""Meshlets of other limits than the usual ones are drawn as any others."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.model import MAX_TRIANGLES, MAX_VERTICES
from chapters.ch06.meshlets.scene import keep_meshlets
from chapters.ch06.settings import Settings
from tests.support.towns import town, walk

SIZE = (96, 54)
LIMITS = ((MAX_VERTICES, MAX_TRIANGLES), (32, 62), (128, 250))


@pytest.mark.feature("meshlets/generation", "meshlets/mesh-shader-output")
def test_meshlets_of_every_size_show_the_same_picture(chapter):
    """On each path that the device has; without any, whole meshes are drawn."""
    several, tasks = (chapter.device.has(name) for name in ("multi-draw", "mesh-shader"))
    for path in [path for path, there in (("compute", several), ("mesh", tasks)) if there]:
        pictures, drawn = zip(*(picture_and_units(chapter, path, limits) for limits in LIMITS), strict=True)
        assert drawn[1] > drawn[0] > drawn[2], "the meshlets are those that were given"
        assert all(np.array_equal(picture, pictures[0]) for picture in pictures[1:])


def picture_and_units(chapter, path, limits):
    """Return the picture of a town whose meshlets have these limits, and the number of units that were drawn."""
    scene = town(count=24)
    meshlets = build_meshlets(scene, *limits)
    assert meshlets.limits == limits and (meshlets.records["counts"] & 255).max() > 0.8 * limits[0]
    keep_meshlets(scene, meshlets)
    settings = Settings(culling="cone", geometry=path)
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        frame = renderer.render(walk()[0])
        return frame.image("color_linear").copy(), frame.work["units_drawn"]


def test_limits_of_a_scene_without_meshlets_are_those_that_were_asked_for():
    scene = town(count=24)
    scene.meshes = scene.meshes.copy()
    scene.meshes["index_count"] = 0
    assert build_meshlets(scene, 256, 90).limits == (255, 90)
