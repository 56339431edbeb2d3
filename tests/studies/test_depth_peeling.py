"""The study depth-peeling: equal to sorted compositing where its layers suffice, and the nearest layers where not."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch07.settings import Settings as ChapterSettings
from chapters.ch07.studies.depth_peeling import Settings
from common.errors import SettingError
from common.scene import Material
from tests.support.bounds import snapping
from tests.support.panes import BEHIND, DISTANCE, panes, stack, tilted, view
from tests.support.scenes import quad_scene
from tests.twins.layers import Layers, U

pytestmark = pytest.mark.feature("oit/alternatives")
WHICH = "7/depth-peeling"
SIZE = (32, 24)


def exact(**turned):
    return Settings(
        color_format="rgba32f", gbuffer_format="full", background=BEHIND, graph="deferred", **turned
    )


def draw(stage, scene, camera=None, size=SIZE, **turned):
    """Return the linear colour of the second frame."""
    with stage.open(WHICH, size, scene, settings=exact(**turned), outputs=("color_linear",)) as renderer:
        camera = camera if camera is not None else chapters.view_of(renderer)
        renderer.render(camera)
        return renderer.render(camera).image("color_linear").astype(np.float64)


@pytest.mark.parametrize("culling", ["off", "occlusion"])
def test_enough_layers_equal_sorted_compositing(stage, culling):
    """Squares that pierce one another, at each pixel sorted in double precision; four roundings for each layer."""
    matrices, colors = tilted(5, 10)
    truth = Layers(matrices, colors, SIZE, DISTANCE, snapping(stage.device))
    most = int(truth.count.max())
    assert most >= 4
    picture = draw(stage, panes(matrices, colors), view(), peeled_layers=most, culling=culling)
    error = np.abs(picture - truth.sorted_over(BEHIND)).max(axis=-1)
    sure = ~(truth.near_edge | truth.close)
    assert sure.mean() > 0.8 and (error <= (4 * truth.count + 2) * U)[sure].all()


def test_the_farthest_layers_are_lost_if_there_are_too_few(stage):
    colors = np.array([(1.0, 0, 0, 0.5), (0, 1.0, 0, 0.5), (0, 0, 1.0, 0.5), (1.0, 1.0, 0, 0.5)])
    depths = np.array([0.5, -0.5, 1.0, 0.0])
    picture = draw(stage, panes(stack(depths), colors), view(), (3, 2), peeled_layers=3)
    wanted = np.full(3, BEHIND)
    for place in np.argsort(depths)[1:]:
        wanted = colors[place, :3] * 0.5 + wanted * 0.5
    assert np.abs(picture - wanted).max() <= 14 * U


def test_the_scene_of_the_study_equals_the_chapter_s_lists(stage):
    """The nodes are those that run: the picture is read from the last layer, not from what was lit."""
    with stage.open(WHICH, SIZE, settings=exact(), outputs=("color", "color_linear")) as renderer:
        camera, scene = chapters.view_of(renderer), renderer.scene
        read = {node.name: [access.resource for access in node.reads] for node in renderer.nodes}
        assert read["tonemap"] == ["color_hdr"] and read["over_0"] == ["peeled_0"]
        peeled = renderer.render(camera).image("color_linear")
    settings = ChapterSettings(
        color_format="rgba32f", gbuffer_format="full", background=BEHIND, transparency="lists"
    )
    with chapters.open(
        7,
        stage.backend,
        scene=scene,
        size=SIZE,
        settings=settings,
        device=stage.device,
        outputs={"color_linear"},
    ) as renderer:
        lists = renderer.render(camera).image("color_linear")
    np.testing.assert_allclose(peeled, lists, rtol=1e-4)
    assert np.ptp(lists) > 0


def test_a_scene_without_blended_material_peels_nothing(stage):
    scene = quad_scene(Material(base_color=(0.5, 0.25, 0.5, 1.0), unlit=True))
    with stage.open(WHICH, SIZE, scene, settings=exact(peeled_layers=3)) as renderer:
        renderer.render(view())
        assert not [it.name for it in renderer.passes if it.name.startswith(("peel", "over"))]


def test_settings_that_leave_no_place_for_layers_are_refused(stage):
    for turned in ({"transparency": "lists"}, {"msaa": 4, "graph": "auto"}):
        with pytest.raises(SettingError, match="depth-peeling composites layers itself"):
            stage.open(WHICH, SIZE, settings=Settings(**turned))
