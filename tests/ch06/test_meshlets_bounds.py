"""Bounds of meshlets: boxes and spheres hold every vertex, and what a cone culls faces away; in float64 and exactly."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from assets import locate
from chapters.ch06.meshlets.bounds import boxes_and_radii, normal_cones
from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.packing import NO_CONE, pack_cones, unpack_cones, unpack_counts
from common.gltf import load_scene
from tests.support.meshes import grid, scene_of
from tests.support.meshlet_surfaces import SURFACES, placed, sphere, theirs_of_scene

bounds = pytest.mark.feature("meshlets/bounds-and-cones")
FINITE = [name for name in SURFACES if name != "holed"]


def parts(surface):
    """Return the meshlets of a surface, and the corners (T, 3, 3) float64 of the triangles of each."""
    scene = scene_of(surface)
    meshlets = build_meshlets(scene)
    _, counts = unpack_counts(meshlets.records["counts"])
    corners = scene.positions.astype(np.float64)[meshlets.indices].reshape(-1, 3, 3)
    return meshlets.records, np.split(corners, np.cumsum(counts)[:-1])


def largest(name):
    """Return the largest absolute place of a surface."""
    return float(np.abs(SURFACES[name][0]).max())


@bounds
@pytest.mark.parametrize("name", FINITE)
def test_boxes_and_spheres_hold_their_vertices_and_hardly_more(name):
    records, corners = parts(SURFACES[name])
    rounding = largest(name) * 2.0**-23  # the centre is a float32
    for record, triangles in zip(records, corners, strict=True):
        places = triangles.reshape(-1, 3).astype(np.float32)
        assert (record["centre"] - record["extent"] <= places).all()  # in float32, as a shader computes it
        assert (record["centre"] + record["extent"] >= places).all()
        centre = record["centre"].astype(np.float64)
        farthest = np.linalg.norm(places - centre, axis=1).max()
        assert farthest <= record["radius"] <= farthest * (1 + 1e-6)
        half = (places.max(axis=0).astype(float) - places.min(axis=0)) / 2
        assert (record["extent"] <= half * (1 + 1e-6) + rounding).all()


@bounds
def test_bounds_hold_in_exact_numbers():
    """Random places of all sizes, against fractions."""
    rng = np.random.default_rng(8)
    places = (rng.normal(size=(40, 5, 3)) * 10.0 ** rng.integers(-20, 16, (40, 5, 1))).astype(np.float32)
    centres, extents, radii = boxes_and_radii(places.reshape(-1, 3), np.arange(0, 200, 5))
    exact = np.vectorize(Fraction.from_float, otypes=[object])
    for corners, centre, extent, radius in zip(places, centres, extents, radii, strict=True):
        offsets = exact(corners.astype(float)) - exact(centre.astype(float))
        assert (np.abs(offsets) <= exact(extent.astype(float))).all()
        assert max((offsets**2).sum(axis=1)) <= Fraction(float(radius)) ** 2
    single = boxes_and_radii(places[0, :1], np.zeros(1, np.int64))
    assert single[0].tolist() == places[0, :1].tolist() and not single[1].any() and not single[2].any()


def eyes_around(rng, corners, count):
    """Return eyes (E, 3) near to and far from some triangles, many of them behind."""
    middle, size = corners.reshape(-1, 3).mean(axis=0), np.ptp(corners.reshape(-1, 3), axis=0).max() + 1e-30
    directions = rng.normal(size=(count, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).mean(axis=0)
    directions[::2] -= 3 * normals / (np.linalg.norm(normals) or 1.0)  # behind
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return middle + directions * size * 10.0 ** rng.uniform(-1, 3, (count, 1))


def culled_by(record, eyes, lower=0.0):
    """Return which eyes (E, 3) the cone of a record culls; `lower` is taken off the cutoff."""
    axes, cutoffs = unpack_cones(record["cone"].reshape(1))
    if cutoffs[0] >= 1:
        return np.zeros(len(eyes), bool)
    away = record["centre"].astype(np.float64) - eyes
    return away @ axes[0] >= (cutoffs[0] - lower) * np.linalg.norm(away, axis=1) + record["radius"]


def fronts(corners, eyes):
    """Return (E,) the largest cosine between a direction to the eye and the normal of a triangle that has area."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals = normals[lengths > 0] / lengths[lengths > 0, None]
    toward = eyes[:, None] - corners[lengths > 0, 0]
    cosines = (toward * normals).sum(axis=2) / np.linalg.norm(toward, axis=2)
    return cosines.max(axis=1, initial=-np.inf)


@bounds
@pytest.mark.parametrize("name", FINITE)
def test_what_a_cone_culls_faces_away(name):
    records, corners = parts(SURFACES[name])
    rng = np.random.default_rng(1)
    culled = faced_away = 0
    for record, triangles in zip(records, corners, strict=True):
        eyes = eyes_around(rng, triangles, 60)
        by_cone, front = culled_by(record, eyes), fronts(triangles, eyes)
        assert (front[by_cone] <= 1e-12).all()
        culled, faced_away = culled + by_cone.sum(), faced_away + (front <= 0).sum()
    if name in ("grid", "sphere", "small", "large", "far"):  # smooth ones
        assert culled > 0.4 * faced_away > 0


@bounds
def test_a_cone_that_is_a_little_narrower_culls_what_is_seen():
    """The checks above can fail: with a cutoff that is 10 degrees less, front faces are culled."""
    rng = np.random.default_rng(1)
    records, corners = parts(SURFACES["sphere"])
    wrong = 0
    for record, triangles in zip(records, corners, strict=True):
        eyes = eyes_around(rng, triangles, 400)
        wrong += (fronts(triangles, eyes)[culled_by(record, eyes, 0.17)] > 1e-3).sum()
    assert wrong > 0


@bounds
def test_views_without_perspective_see_no_culled_triangle():
    records, corners = parts(SURFACES["sphere"])
    rng = np.random.default_rng(3)
    directions = rng.normal(size=(300, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    axes, cutoffs = unpack_cones(records["cone"])
    count = 0
    for axis, cutoff, triangles in zip(axes, cutoffs, corners, strict=True):
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        culled = directions[(directions @ axis >= cutoff) & (cutoff < 1)]
        assert (culled @ normals.T >= -1e-16).all()
        count += len(culled)
    assert count > 0.2 * 300 * len(records)  # half of all directions see the back of a triangle


@bounds
def test_cones_are_rounded_so_that_they_stay_conservative():
    """Packed cones against all normals of the cone: what they cull, every one of these faces away from."""
    rng = np.random.default_rng(4)
    axes = rng.normal(size=(300, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = rng.uniform(0, 1.2, 300)
    decoded, cutoffs = unpack_cones(pack_cones(axes, np.sin(angles)))
    assert (cutoffs <= np.sin(angles) + 0.5 * np.sqrt(3) / 127 + 1 / 127 + 1e-5).all()
    for axis, angle, packed, cutoff in zip(axes, angles, decoded, cutoffs, strict=True):
        side = np.cross(axis, rng.normal(size=(200, 3)))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        rim = np.cos(angle) * axis + np.sin(angle) * side
        seen = rng.normal(size=(400, 3)) + 2 * axis
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        culled = seen[seen @ packed >= cutoff]
        assert len(culled) > 0 or cutoff > 0.9
        assert (culled @ rim.T >= 0).all()


@bounds
def test_what_has_no_cone_is_never_culled():
    line = np.array([[(0, 0, 0), (1, 1, 1), (2, 2, 2)]], np.float32)
    up = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], np.float32)
    down, hole = up[:, ::-1], up.copy()
    hole[0, 1, 0] = np.nan
    side = up[:, :, [1, 2, 0]]
    groups = [
        line,
        np.concatenate([up, down]),
        hole,
        np.concatenate([up, hole]),
        np.concatenate([up, side, down]),
    ]
    starts = np.cumsum([0, *(len(group) for group in groups)])[:-1]
    axes, sines = normal_cones(np.concatenate(groups), starts)
    assert (sines == 1).all() and not axes.any()
    packed = pack_cones(axes, sines)
    assert (packed == NO_CONE << 24).all()
    # Corners at one place cover no pixel. Those on a line may, when each is rounded: that has no side, or either.
    point, needle = line.copy(), up * np.float32((1, 1e-7, 1))
    point[0, 2] = point[0, 1]
    axes, sines = normal_cones(np.concatenate([up, point]), np.zeros(1, np.int64))
    assert axes.tolist() == [[0, 0, 1]] and sines.tolist() == [0]
    for thin in (line, needle):
        assert normal_cones(np.concatenate([up, thin]), np.zeros(1, np.int64))[1].tolist() == [1]
    axes, sines = normal_cones(np.concatenate([up, side]), np.zeros(1, np.int64))
    assert sines == pytest.approx([np.sqrt(0.5)])
    assert axes[0] == pytest.approx([0, np.sqrt(0.5), np.sqrt(0.5)], abs=1e-12)


@bounds
@pytest.mark.filterwarnings("ignore:invalid value")
def test_places_that_are_not_finite_make_bounds_that_cull_nothing():
    records, corners = parts(SURFACES["holed"])
    whole = np.array([np.isfinite(triangles).all() for triangles in corners])
    assert 0 < whole.sum() < len(whole)
    bounded = np.concatenate([records["centre"], records["extent"], records["radius"][:, None]], axis=1)
    assert np.isnan(bounded[~whole]).all() and np.isfinite(bounded[whole]).all()
    _, cutoffs = unpack_cones(records["cone"])
    assert (cutoffs[~whole] == 1).all() and (cutoffs[whole] < 1).any()
    extreme = np.array([(3e38, 3e38, 3e38), (-3e38, -3e38, -3e38)], np.float32)
    assert np.isnan(boxes_and_radii(extreme, np.zeros(1, np.int64))[2]).all()


@bounds
def test_scale_and_place_change_no_cone():
    """Scales are powers of two, and offsets keep every bit of a coarse surface."""
    coarse = np.round(sphere(16)[0] * 64) / 64, sphere(16)[1]
    plain, _ = parts(coarse)
    for scale, offset in ((2.0**-10, 0.0), (2.0**10, 0.0), (1.0, 2.0**15)):
        moved, _ = parts(placed(coarse, scale, offset))
        assert (moved["cone"] == plain["cone"]).all()
        assert moved["radius"] == pytest.approx(plain["radius"] * scale, rel=1e-6, abs=abs(offset) * 2.0**-23)


@bounds
@pytest.mark.needs("meshoptimizer")
@pytest.mark.parametrize("name", ["grid", "sphere", "atrium", "spheres"])
def test_cones_are_about_as_narrow_as_those_of_meshoptimizer(name):
    surfaces = {"grid": grid(60, 60), "sphere": sphere(60)}
    scene = scene_of(surfaces[name]) if name in surfaces else load_scene(locate(name))
    usable, mean = compare(name, scene)
    assert usable[0] >= 0.9 * usable[1] and mean[0] <= mean[1] + 0.1


@bounds
@pytest.mark.needs("meshoptimizer")
@pytest.mark.parametrize("name", ["ToyCar", "FlightHelmet", "Suzanne", "SpecularTest"])
def test_cones_of_models_are_about_as_narrow_as_those_of_meshoptimizer(models, name):
    path = next(path for path in sorted((models / name).rglob("*")) if path.suffix in (".gltf", ".glb"))
    usable, mean = compare(name, load_scene(path, decode=False))
    assert usable[0] >= 0.75 * usable[1] and mean[0] <= mean[1] + 0.05


def compare(name, scene):
    """Return the share of meshlets with a cone, and the mean cutoff, for ours and theirs each."""
    meshlets = build_meshlets(scene)
    _, ours = unpack_cones(meshlets.records["cone"])
    others = theirs_of_scene(scene, np.flatnonzero(meshlets.ranges[:, 1]))
    cutoffs = np.minimum(np.concatenate([each.cutoffs for each in others]) / 127, 1.0)
    usable, mean = ((ours < 1).mean(), (cutoffs < 1).mean()), (ours.mean(), cutoffs.mean())
    print(f"{name}: usable {usable[0]:.2f} and {usable[1]:.2f}, mean cutoffs {mean[0]:.2f} and {mean[1]:.2f}")
    return usable, mean
