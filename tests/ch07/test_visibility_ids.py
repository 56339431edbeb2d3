"""The visibility buffer names the triangle that a rasteriser in double precision finds, on each path that draws."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch07.scene import pages
from chapters.ch07.settings import Settings
from chapters.ch07.visibility.model import BACK
from common.settings import replaced
from tests.support.culled_frames import ways
from tests.support.towns import town, walk
from tests.twins.visibility import raster

SIZE = (64, 36)
IDS = Settings(surfaces="visibility", graph="deferred", anisotropy=1.0)
VIEWS = (walk()[0], walk()[-1])


@pytest.fixture(scope="module")
def scene():
    return town(count=20)


@pytest.fixture(scope="module")
def truths():
    """Return a function that rasters the drawn scene, once for each order of its indices."""
    known = {}

    def truth(scene):
        key = scene.indices.tobytes()
        if key not in known:
            known[key] = [raster(scene, view, SIZE) for view in VIEWS]
        return known[key]

    return truth


def ids_of(renderer, view, frames=2):
    """Return instance and triangle (H, W) of a view, -1 for nothing, and whether it is seen from behind."""
    for _ in range(frames):
        frame = renderer.render(view)
    drawing = [step.name for step in renderer.graph.steps if step.name in ("visibility", "visibility_late")]
    words = frame.image(f"{drawing[-1]}/visibility").astype(np.int64)
    place = words[..., 1] & ~BACK
    assert (place % 3 == 0).all()
    return words[..., 0] - 1, np.where(words[..., 0] > 0, place // 3, -1), words[..., 1] & BACK != 0


@pytest.mark.feature("visibility-buffer/ids")
@pytest.mark.parametrize("culling", ["occlusion", pytest.param("off", marks=pytest.mark.long)])
def test_ids_are_those_of_a_rasteriser_away_from_edges(chapter, scene, truths, culling):
    """Triangles are numbered in the order of the drawn scene, whichever command or mesh shader drew them."""
    for geometry in ways(chapter):
        if culling == "off" and geometry == "mesh":
            continue  # its early phase is that of occlusion culling
        assert_named(chapter, scene, truths, replaced(IDS, culling=culling, geometry=geometry))


def assert_named(chapter, scene, truths, settings):
    with chapter.open(scene, SIZE, settings, outputs=("color",), inspect=True) as renderer:
        drawn = renderer.techniques["culling"].scene
        for view, wanted in zip(VIEWS, truths(drawn), strict=True):
            instance, triangle, _ = ids_of(renderer, view)
            sure = wanted.sure
            assert sure.mean() > 0.5 and (wanted.instance[sure] >= 0).mean() > 0.3
            assert np.array_equal(instance[sure], wanted.instance[sure])
            assert np.array_equal(triangle[sure], wanted.triangle[sure])


@pytest.mark.feature("visibility-buffer/ids")
def test_a_page_of_geometry_has_places_of_its_own(chapter, scene, truths, monkeypatch):
    """With pages of a few meshes each mesh still counts from its own first index, and each page is resolved."""
    monkeypatch.setattr(pages, "PAGE_BYTES", 24_000)
    settings = replaced(IDS, culling="off", geometry="classic")
    with chapter.open(scene, SIZE, settings, outputs=("color",), inspect=True) as renderer:
        assert len(renderer._data.pages) > 1
        assert len({batch.page for batch in renderer._draws.solid}) <= 1, (
            "before the first frame nothing is listed"
        )
        instance, triangle, _ = ids_of(renderer, VIEWS[0])
        used = {batch.page for batch in renderer._draws.solid}
        assert len(used) > 1
        assert renderer.inspection.work.by_pass["visibility_resolve"]["dispatches"] == len(used)
        wanted = truths(renderer.techniques["culling"].scene)[0]
        assert np.array_equal(instance[wanted.sure], wanted.instance[wanted.sure])
        assert np.array_equal(triangle[wanted.sure], wanted.triangle[wanted.sure])


@pytest.mark.feature("visibility-buffer/ids")
def test_ids_agree_with_the_output_of_instances(chapter, scene):
    """Another pass finds the instances by depth: at every pixel it names the same ones, masked and mirrored, too."""
    with chapter.open(scene, SIZE, IDS, outputs=("color", "instance_id"), inspect=True) as renderer:
        instance, _, behind = ids_of(renderer, VIEWS[0])
        frame = renderer.render(VIEWS[0])
        assert np.array_equal(instance + 1, frame.image("instance_id").astype(np.int64))
        kinds = scene.meshes["material"][scene.instances.mesh][instance[instance >= 0]]
        two_sided = np.array([material.double_sided for material in scene.materials])[kinds]
        assert not behind[instance >= 0][~two_sided].any(), "what is culled is not seen from behind"
