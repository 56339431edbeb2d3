"""Hits of ray pipelines and ray queries through the chapter's acceleration structures, held against every triangle."""

from __future__ import annotations

import numpy as np
import pytest

from chapters import ch12
from tests.support.ray_scenes import placements, random_rays, soup, soup_scene, world_triangles
from tests.support.ray_traces import WAYS, traces_of
from tests.twins.brute_rays import nearest

pytestmark = pytest.mark.variants("vulkan")
SURE = 1e-4
"""Barycentric distance from edges beyond which rounding decides nothing."""


def needs(chapter, way):
    if not chapter.device.has(WAYS[way]):
        pytest.skip(f"this device has no {WAYS[way]}")


def hold(traced, scene, origins, directions, t_min=0.0, t_max=1e4):
    """Hold hits to the twin, off edges; return how many rays hit."""
    truth = nearest(origins, directions, t_min, t_max, *world_triangles(scene))
    sure = truth.margin > SURE
    assert sure.mean() > 0.5
    assert (traced.instance == truth.instance)[sure].all()
    assert (traced.primitive == truth.primitive)[sure].all()
    hit = sure & (truth.instance >= 0)
    assert (np.abs(traced.t - truth.t)[hit] <= 1e-5 * truth.t[hit]).all()
    assert (np.abs(traced.at - truth.at)[hit] < 2e-4).all()
    assert (traced.back == truth.back)[sure].all()
    assert (traced.blocked == (truth.instance >= 0))[sure].all()
    assert (traced.t[truth.instance < 0] == np.float32(t_max))[sure[truth.instance < 0]].all()
    return int(hit.sum())


@pytest.fixture(params=list(WAYS))
def way(request, chapter):
    needs(chapter, request.param)
    return request.param


def instanced():
    meshes = [soup(60, 1), soup(40, 2)]
    return soup_scene(meshes, [(number % 2, matrix) for number, matrix in enumerate(placements())])


def test_hits_are_those_of_every_triangle(chapter, way, tmp_path):
    scene = instanced()
    with traces_of(chapter, ch12.__name__, scene, tmp_path) as traces:
        pipeline = traces.pipeline(traces.description(way))
        origins, directions = random_rays(scene, 3000, 3)
        assert hold(traces.trace(pipeline, origins, directions), scene, origins, directions) > 300
        # An end between the surfaces cuts off what lies behind it, and a beginning what lies before.
        ends = {"t_min": 0.4, "t_max": 1.1}
        hold(traces.trace(pipeline, origins, directions, **ends), scene, origins, directions, **ends)
