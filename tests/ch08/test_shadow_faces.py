"""Faces of lights without a device: projections, cubes, the fit to a scene, cascades, and the places of tiles."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch08.scene.packing import LIGHT, LIGHT_KINDS
from chapters.ch08.shadows import cascades, faces, layout
from chapters.ch08.shadows.faces import FACE
from chapters.ch08.shadows.model import selected
from common.numerics.transforms import pose_looking_at
from common.scene import Light
from common.view.camera import Orthographic, Perspective, View
from tests.support.shadows import point, spot, sun, yard

BOX = np.array([(-3.0, -0.5, -2.0), (5.0, 4.0, 7.0)])


def records(*kinds: str, outer: float = 0.7) -> np.ndarray:
    """Return LIGHT records of kinds, all at one place."""
    lights = np.zeros(len(kinds), LIGHT)
    lights["kind"] = [LIGHT_KINDS[kind] for kind in kinds]
    lights["position"], lights["direction"] = (1.0, 2.0, 3.0), (0.6, -0.8, 0.0)
    lights["inverse_range2"], lights["end_distance2"] = 1 / 49.0, 1e38
    scale = 1.0 / max(0.001, np.cos(0.0) - np.cos(outer))
    lights["cone"][:, 0], lights["cone"][:, 1] = scale, -np.cos(outer) * scale
    return lights


def clip(face: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return (N, 4) clip positions of points (N, 3) in float64, as records.glsl defines them."""
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    p = (points - face["origin"]) @ axes.T
    near, far, size = (float(face[name]) for name in ("near", "far", "size"))
    z = (far - p[:, 2]) / (far - near)
    w = p[:, 2] if face["perspective"] else np.ones(len(p))
    scale = np.array([face["scale_x"], face["scale_y"]], np.float64) * 2 / size
    return np.stack([p[:, 0] * scale[0], p[:, 1] * scale[1], z * near if face["perspective"] else z, w], 1)


@pytest.mark.feature("shadows/cube-faces")
def test_six_faces_cover_the_sphere_without_gap_or_overlap():
    cube = faces.local_faces(records("point"), np.array([0]), np.array([256]), 0.01, np.array([7.0]), 3)
    directions = np.random.default_rng(1).normal(size=(20_000, 3))
    axes = np.stack([cube["right"], cube["down"], cube["ahead"]], axis=1).astype(np.float64)
    assert np.allclose(np.linalg.det(axes), 1.0)
    local = np.einsum("fij,nj->nfi", axes, directions)
    inside = (np.abs(local[..., :2]) < local[..., 2:]).all(-1)
    assert (inside.sum(axis=1) == 1).all()
    # What the light shines into ends `guard` texels before the face does.
    assert np.allclose(cube["scale_x"] / (256 / 2), 1 - 2 * 3 / 256)
    narrow = (np.abs(local[..., :2]) < local[..., 2:] * np.tan(np.pi / 8)).all(-1).any(axis=1)
    assert narrow.mean() == pytest.approx(0.281, abs=0.01)  # six faces of 45 degrees
    assert not (np.abs(local[..., :2]) < 0.99 * local[..., 2:]).all(-1).any(axis=1).all()


@pytest.mark.feature("shadows/bias-matrices")
def test_corners_of_a_light_frustum_meet_those_of_clip_space():
    (face,) = faces.local_faces(records("spot"), np.array([0]), np.array([256]), 0.5, np.array([9.0]), 0)
    axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
    edge = np.tan(0.7)
    for depth, z in ((0.5, 1.0), (9.0, 0.0)):
        corners = np.array([(x * edge * depth, y * edge * depth, depth) for x in (-1, 1) for y in (-1, 1)])
        at = clip(face, corners @ axes + face["origin"])
        ndc = at[:, :3] / at[:, 3:]
        assert np.allclose(np.abs(ndc[:, :2]), 1.0, atol=1e-6)
        assert np.allclose(ndc[:, 2], z, atol=1e-6)
        # In the window of either API: to 0..1 in x and y. Depth is there already, as glClipControl has it.
        unit = ndc * (0.5, 0.5, 1.0) + (0.5, 0.5, 0.0)
        assert np.allclose(unit[:, :2], np.round(unit[:, :2]), atol=1e-6)
        # Standard depth is 1 - z, and OpenGL's own 1 - 2 z: the scale and bias of that map it to the same cube.
        assert np.allclose(0.5 * (1 - 2 * ndc[:, 2]) + 0.5, 1 - ndc[:, 2])
        # OpenGL's scale and bias for depth that is 0 to 1 already: the far plane stays, and the near one moves.
        assert not np.allclose(0.5 * (1 - ndc[:, 2]) + 0.5, 1 - ndc[:, 2]) or depth == 9.0


def test_wide_spots_have_cubes():
    assert faces.has_cube(records("spot", outer=np.radians(59))).tolist() == [False]
    assert faces.has_cube(records("spot", outer=np.radians(85))).tolist() == [True]
    assert faces.has_cube(records("point", "directional")).tolist() == [True, False]


@pytest.mark.feature("shadows/directional-fit")
@pytest.mark.parametrize("direction", [(0, -1, 0), (0.5, -1, 0.3), (-1, -0.2, 0.4), (0.1, 0.6, -0.9)])
def test_the_fit_touches_the_scene_on_all_sides(direction):
    unit = np.array(direction, np.float64) / np.linalg.norm(direction)
    view = View(pose_looking_at((9, 9, 9), (0, 0, 0)), Perspective())
    (face,) = cascades.directional_faces(unit[None], BOX, view, np.zeros(3), 1.6, 1, 512, 0)
    at = clip(face, cascades.corners(BOX))
    assert (np.abs(at[:, :2]) <= 1 + 1e-6).all()
    assert (at[:, 2] >= -1e-6).all() and (at[:, 2] <= 1 + 1e-6).all()
    assert np.allclose(at[:, :2].max(axis=0), 1, atol=1e-6) and np.allclose(
        at[:, :2].min(axis=0), -1, atol=1e-6
    )
    margin = cascades.DEPTH_MARGIN * np.linalg.norm(BOX[1] - BOX[0]) / face["far"]
    assert np.allclose((at[:, 2].min(), at[:, 2].max()), (margin, 1 - margin), atol=1e-6)
    axes, box = cascades.fit(unit, BOX)
    along = cascades.corners(BOX) @ axes.T
    assert (along.min(axis=0) == box[0]).all() and (along.max(axis=0) == box[1]).all()


@pytest.mark.feature("shadows/aliasing-improvements")
def test_slices_of_a_view_lie_in_their_spheres():
    view = View(pose_looking_at((1, 2, 3), (4, 1, -5)), Perspective(0.9))
    right, up, back = view.world_from_view[:3, :3].T
    for begin, end in ((0.0, 1.0), (1.0, 5.0), (5.0, 80.0)):
        ahead, radius = cascades.slice_sphere(view, 1.5, begin, end)
        centre, farthest = view.eye - ahead * back, 0.0
        for depth in (begin, end):
            for x in (-1.5, 1.5):
                for y in (-1, 1):
                    tangent = depth * np.tan(0.45)
                    corner = view.eye - depth * back + x * tangent * right + y * tangent * up
                    farthest = max(farthest, float(np.linalg.norm(corner - centre)))
        assert farthest == pytest.approx(radius, rel=1e-9)


@pytest.mark.feature("shadows/aliasing-improvements")
def test_cascades_move_by_whole_texels_and_never_change_their_size():
    directions = np.array([(0.48, -0.8, 0.36)])
    random, before = np.random.default_rng(2), None
    for _ in range(50):
        eye = random.uniform(-3, 3, 3)
        view = View(pose_looking_at(eye, eye + random.normal(size=3), (0.1, 1, 0)), Perspective(1.0, 0.01))
        made = cascades.directional_faces(directions, BOX, view, np.zeros(3), 16 / 9, 3, 256, 2)
        axes = np.stack([made["right"], made["down"]], axis=1).astype(np.float64)
        texels = (
            np.einsum("fij,fj->fi", axes, made["origin"].astype(np.float64))[:2] * made["scale_x"][:2, None]
        )
        assert np.allclose(texels, np.round(texels), atol=2e-3)  # float32 of a few hundred texels
        if before is not None:
            assert (made["scale_x"] == before["scale_x"]).all() and made[2] == before[2]
        before = made
    # Density rises by the extent of the scene over the diameter of the first slice.
    _, box = cascades.fit(directions[0], BOX)
    ends = cascades.splits(0.01, float(np.linalg.norm(BOX[1] - BOX[0])), 3)
    _, radius = cascades.slice_sphere(view, 16 / 9, ends[0], ends[1])
    factor = before["scale_x"][0] / before["scale_x"][2]
    assert factor == pytest.approx((box[1, 0] - box[0, 0]) / (2 * radius), rel=1e-5) and factor > 3


def test_orthographic_views_have_cascades():
    view = View(pose_looking_at((0, 9, 0.1), (0, 0, 0)), Orthographic(2.0, 0.1, 20.0))
    made = cascades.directional_faces(np.array([(0.0, -1.0, 0.0)]), BOX, view, np.zeros(3), 1.0, 2, 256, 2)
    assert np.isfinite(made["scale_x"]).all() and (made["scale_x"] > 0).all()


def test_suns_come_first_and_the_brightest_after_them():
    lights = [Light("point", 0, intensity=value) for value in (3.0, 9.0, 9.0, 1.0)]
    lights += [Light("directional", 0, intensity=value) for value in (1.0, 2.0, 0.1, 0.2, 0.3)]
    scene = yard(*((light, np.eye(4)) for light in lights))
    numbers = np.arange(len(lights))
    assert selected(scene, numbers, 9).tolist() == [5, 4, 8, 7, 1, 2, 0, 3]  # four suns at most
    assert selected(scene, numbers, 5).tolist() == [5, 4, 8, 7, 1]


def test_sizes_shrink_from_the_least_important_light_on():
    counts, sizes = np.array([3, 1, 6, 6]), np.array([1024, 256, 512, 512])
    whole = int((counts * layout.tiles_of(sizes)).sum())
    assert layout.fitting_sizes(counts, sizes, whole).tolist() == sizes.tolist()
    less = layout.fitting_sizes(counts, sizes, 120)
    assert (counts * layout.tiles_of(less)).sum() <= 120
    assert (less <= sizes).all() and less[0] >= 256
    for most in (1, 3, 5, 10, 16, 50, 100, 333):
        fitted = layout.fitting_sizes(counts, sizes, most)
        assert (counts * layout.tiles_of(fitted)).sum() <= most
    assert layout.fitting_sizes(counts, sizes, 1).tolist() == [0, 0, 0, 0]
    assert layout.fitting_sizes(counts[1:], sizes[1:], 1).tolist() == [128, 0, 0]


@pytest.mark.feature("sparse/page-pool")
def test_no_tile_has_two_owners():
    made = np.zeros(5, FACE)
    made["size"] = (512, 256, 256, 128, 1024)
    layout.place_tiles(made)
    tiles = layout.tiles_of(made["size"].astype(np.int64))
    owned = np.concatenate(
        [np.arange(first, first + n) for first, n in zip(made["first"], tiles, strict=True)]
    )
    assert np.array_equal(owned, np.arange(tiles.sum()))
    width, height = layout.pages_size(int(tiles.sum()))
    table = layout.full_table(int(tiles.sum()), width)
    assert len(np.unique(table)) == tiles.sum() <= width * height
    assert ((table & 0xFFFF) < width).all() and ((table >> 16) < height).all()
    assert layout.TILE_BYTES == 64 << 10


def test_lights_of_a_yard_are_what_they_say():
    scene = yard(sun((0, -1, 0)), spot((0, 3, 0), (0, 0, 0)), point((1, 2, 1)))
    assert [light.kind for light in scene.lights] == ["directional", "spot", "point"]
