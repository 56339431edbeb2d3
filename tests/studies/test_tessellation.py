"""The study tessellation: counts by the tables of the specification, edges that neighbours share to the bit."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch06.studies.tessellation import SIDE, Settings, levels, patches, triangles_of
from common.errors import UnsupportedError
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, use, without_each

tessellates = pytest.mark.feature("geometry/tessellation")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "6/tessellation"
SIZE = (48, 36)
UNIFORM = {1: 1, 2: 6, 3: 13, 4: 24, 5: 37, 6: 54, 7: 73}
"""Triangles of one patch whose levels are all equal."""


def work(stage, settings, camera=None):
    with stage.open(WHICH, (8, 8), settings=settings) as renderer:
        return renderer.render(chapters.view_of(renderer, camera)).work


def recorded(stage, camera=None, **more):
    """Return the small triangles of a frame, (N, 3, 3) float32, the patch of each, and what the frame did."""
    with stage.open(WHICH, (8, 8), settings=Settings(recorded=True, **more)) as renderer:
        frame = renderer.render(chapters.view_of(renderer, camera))
        counters, corners = frame.work, renderer.triangles()
    return corners[..., :3], corners[:, 0, 3].astype(int), counters


def edges_of(triangles):
    """Return how often each edge is there, by the bytes of its two ends in any order."""
    ends = [[corner.tobytes() for corner in triangle] for triangle in triangles]
    return Counter(frozenset(pair) for a, b, c in ends for pair in ((a, b), (b, c), (c, a)))


# --- counts -----------------------------------------------------------------------------------------------------------


@tessellates
@pytest.mark.parametrize("level", UNIFORM)
def test_a_patch_of_equal_levels_has_the_triangles_of_the_table(stage, level):
    counters = work(stage, Settings(cells=2, level=level))
    assert counters["patches"] == 8
    assert counters["generated"] == counters["triangles"] == 8 * UNIFORM[level]


@tessellates
def test_the_rule_for_any_levels():
    equal = np.arange(1, 8)
    assert triangles_of(np.repeat(equal[:, None], 3, 1), equal).tolist() == [*UNIFORM.values()]
    # Edges of 5, 3 and 1 pieces around an inside of level 5: one triangle on each of 9 pieces, 9 on the next ring, 13.
    assert triangles_of(np.array([(5, 3, 1)]), np.array([5])).tolist() == [9 + 9 + 13]
    assert triangles_of(np.array([(3, 1, 1), (1, 1, 1)]), np.array([1, 2])).tolist() == [5, 3]


@tessellates
@pytest.mark.parametrize("scale", [0.0, 0.25, 0.3, 0.36, 1.0])
def test_the_scale_moves_the_levels_and_the_gpu_counts_the_same(stage, scale):
    """A mean distance up to 7 times the scale gives level 5, up to 10 times level 3, and beyond that 1."""
    settings = Settings(scale=scale)
    counters = work(stage, settings)
    with stage.open(WHICH, (8, 8), settings=settings) as renderer:
        eye = chapters.view_of(renderer).eye
    total = 0
    for corners in patches(settings):
        found = []
        for one, other in ((1, 2), (2, 0), (0, 1)):
            away = (np.linalg.norm(corners[one] - eye) + np.linalg.norm(corners[other] - eye)) / 2
            assert scale == 0 or min(abs(away - 7 * scale), abs(away - 10 * scale)) > 1e-5
            found.append(5 if away <= 7 * scale else 3 if away <= 10 * scale else 1)
        inside = max(found)
        if inside == 1:
            total += 1
        else:
            total += sum(found) + 3 * (inside - 2) + {3: 1, 5: 13}[inside]
    assert counters["generated"] == counters["triangles"] == total
    assert {0.0: total == 200, 1.0: total == 200 * 37}.get(scale, 200 < total < 200 * 37)


# --- the surface ------------------------------------------------------------------------------------------------------


@tessellates
@pytest.mark.parametrize("more", [{}, {"scale": 0.25}, {"level": 4}])
def test_neighbours_share_the_vertices_of_their_edge_to_the_bit(stage, more):
    """Every edge inside belongs to two triangles, those at the border of the terrain to one: there is no crack."""
    triangles, patch, counters = recorded(stage, cells=6, **more)
    assert len(triangles) == counters["triangles"] and {*patch} == {*range(72)}
    edges = edges_of(triangles)
    assert {*edges.values()} == {1, 2}
    border = np.float32(SIDE / 2)
    for edge, count in edges.items():
        one, other = (np.frombuffer(end, np.float32) for end in edge)
        outside = any(abs(one[axis]) == border and one[axis] == other[axis] for axis in (0, 2))
        assert count == 2 - outside
    outer, _ = levels(Settings(cells=6, **more), view_eye(stage))
    assert sum(count == 1 for count in edges.values()) == border_levels(outer, 6)


def view_eye(stage):
    with stage.open(WHICH, (8, 8)) as renderer:
        return chapters.view_of(renderer).eye


def border_levels(outer, cells):
    """Return the sum of the levels of all edges at the border of the terrain."""
    corners = patches(Settings(cells=cells))
    total = 0
    for patch, own in zip(corners, outer, strict=True):
        for i in range(3):
            one, other = patch[(i + 1) % 3], patch[(i + 2) % 3]
            if any(abs(one[axis]) == SIDE / 2 and one[axis] == other[axis] for axis in (0, 2)):
                total += int(own[i])
    return total


@tessellates
def test_a_level_from_the_patch_s_middle_would_open_cracks(stage, monkeypatch, tmp_path):
    """The same test fails for the usual mistake, in a copy of the control shader."""
    module = chapters.renderer_module(WHICH, stage.backend)
    before = module.shaders
    source = chapters.folder_of(6) / "studies/tessellation/terrain.tesc"
    text = source.read_text("utf-8")
    wrong = text.replace(
        "distance(first, frame.eye.xyz) + distance(second, frame.eye.xyz)",
        "2.0 * distance((in_position[0] + in_position[1] + in_position[2]) / 3.0, frame.eye.xyz)",
    )
    assert wrong != text
    place = tmp_path / "wrong.tesc"
    place.write_text(wrong.replace('"terrain.glsl"', '"studies/tessellation/terrain.glsl"'), "utf-8")
    monkeypatch.setattr(
        module, "shaders", lambda s: tuple(str(place) if f.endswith(".tesc") else f for f in before(s))
    )
    triangles, _, _ = recorded(stage, cells=6)
    assert sum(count == 1 for count in edges_of(triangles).values()) > 4 * 6 * 5


@tessellates
def test_the_triangles_cover_the_terrain_once_and_look_up(stage):
    triangles, patch, _ = recorded(stage, cells=5, bumps=0.0)
    a, b, c = triangles.astype(float).transpose(1, 0, 2)
    areas = np.cross(b - a, c - a)[:, 1] / 2
    assert (areas > 0).all() and not triangles[..., 1].any()
    assert np.abs(np.bincount(patch, areas) - (SIDE / 5) ** 2 / 2).max() < 1e-6


@tessellates
def test_vertices_lie_on_the_hills(stage):
    triangles, _, _ = recorded(stage, cells=5, bumps=0.2, level=3)
    x, y, z = triangles.astype(float).reshape(-1, 3).T
    waves = ((1.7, 2.6, 0.4, 0.6), (-4.3, 2.2, 1.9, 0.4), (6.1, 5.3, 2.2, 0.2))
    hills = sum(part * np.sin(along_x * x + along_z * z + begin) for along_x, along_z, begin, part in waves)
    assert np.abs(y - 0.2 * hills).max() < 2e-6


@tessellates
def test_a_flat_terrain_looks_the_same_at_any_level(stage):
    flat = {"bumps": 0.0, "edges": False}
    found = {}
    for level in (1, 5):
        found[level] = stage.draw(
            WHICH, SIZE, settings=Settings(level=level, **flat), outputs=("color", "depth")
        )
    one, other = found[1], found[5]
    covered = one["depth"] > 0
    assert covered.mean() > 0.3 and (covered == (other["depth"] > 0)).all()
    assert np.abs(one["depth"] - other["depth"]).max() < 1e-6


@tessellates
def test_edges_are_darker_than_faces_and_cover_the_same_pixels(stage):
    with_edges, without = (
        stage.draw(WHICH, (96, 72), settings=Settings(cells=4, edges=edges), outputs=("color", "depth"))
        for edges in (True, False)
    )
    assert (with_edges["depth"] == without["depth"]).all()
    covered = without["depth"] > 0
    ratio = with_edges["color"][covered].sum(axis=-1) / without["color"][covered].sum(axis=-1)
    assert ratio.max() < 1.03 and ratio.min() < 0.5 and 0.05 < (ratio > 0.97).mean() < 0.9
    assert (with_edges["color"][~covered] == without["color"][~covered]).all()


# --- who waits, and what is missing -----------------------------------------------------------------------------------


@tessellates
@only_vulkan
def test_each_barrier_is_needed_and_none_is_missing(stage):
    uses = {
        "clear": [use("clear", "record", "copy copy_write", fresh=True)],
        "terrain": [use("terrain", "record", "geometry storage_read", "geometry storage_write")],
    }
    with stage.open(WHICH, (8, 8), settings=Settings(cells=1, recorded=True)) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(renderer, lambda number: renderer.render(view), uses)
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "geometry" in str(one)]
    assert len(own) == 2 and all(own)


@tessellates
@only_gl
def test_opengl_is_told_before_the_list_begins_again(stage):
    both = gl.GL_BUFFER_UPDATE_BARRIER_BIT | gl.GL_SHADER_STORAGE_BARRIER_BIT
    with stage.open(WHICH, (8, 8), settings=Settings(cells=1, recorded=True)) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view), 2)
    names = [name for name, argument in calls if name != "glMemoryBarrier" or argument == both]
    wanted = ["glMemoryBarrier", "glNamedBufferSubData", "glDrawArrays"]
    assert [name for name in names if name in wanted] == wanted * 2


@tessellates
@only_vulkan
@pytest.mark.parametrize(
    ("bit", "settings", "said"),
    [
        ("tessellationShader", Settings(edges=False), r"cuts triangles on the GPU: .*tessellationShader\."),
        ("geometryShader", Settings(), r"geometry shader: .*geometryShader; try --set edges=off\."),
        (
            "vertexPipelineStoresAndAtomics",
            Settings(recorded=True),
            r"records triangles: .*StoresAndAtomics; try --set recorded=off\.",
        ),
    ],
)
def test_what_a_device_lacks_is_one_sentence(stage, monkeypatch, bit, settings, said):
    kind = type(stage.device.physical)
    before = kind.lacks

    def lacks(self, needed):
        return f"the driver lacks the feature {bit}" if bit in str(needed) else before(self, needed)

    monkeypatch.setattr(kind, "lacks", lacks)
    with pytest.raises(UnsupportedError, match=said):
        stage.open(WHICH, (4, 4), settings=settings)


@tessellates
@only_vulkan
def test_without_statistics_only_the_count_is_missing(stage):
    with stage.open(WHICH, (8, 8), settings=Settings(cells=1)) as renderer:
        whole = renderer.render(chapters.view_of(renderer)).work
    with chapters.open(
        WHICH,
        "vulkan",
        scene=chapters.studies.load(WHICH, None),
        size=(8, 8),
        without={"pipeline-statistics"},
    ) as renderer:
        work = renderer.render(chapters.view_of(renderer)).work
    assert "generated" in whole and "generated" not in work


@tessellates
@pytest.mark.parametrize(
    ("set_", "said"), [("level=65", "level must be 0 to 64"), ("cells=0", "cells must be 1")]
)
def test_what_cannot_be_is_one_sentence(strata, set_, said):
    code, _, err = strata("run", WHICH, "--set", set_)
    assert code == 2 and said in err and err.count("\n") == 1, err
