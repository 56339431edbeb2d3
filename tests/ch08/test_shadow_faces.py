"""Faces of lights without a device: projections, cubes, the fit to a scene, cascades, and the places of tiles."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch08.page_table import lamps, rule
from chapters.ch08.scene.packing import LIGHT, LIGHT_KINDS
from chapters.ch08.settings import Settings
from chapters.ch08.shadows import cascades, faces, model
from common.numerics.transforms import pose_looking_at
from common.settings import replaced
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
    cube, *_ = faces.local_faces(
        records("point"), np.array([0]), np.array([256]), 0.01, np.array([7.0]), np.array([3])
    )
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
    (face,), *_ = faces.local_faces(
        records("spot"), np.array([0]), np.array([256]), 0.5, np.array([9.0]), np.array([0])
    )
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


@pytest.mark.feature("shadows/depth-recording")
@pytest.mark.parametrize("near", [1e-6, 1e-3, 0.1])
def test_reversed_depth_keeps_its_digits_and_standard_depth_loses_them(near):
    """Depth of a lamp in 32 bits, there and back as records.glsl has it, with 1 at the near plane, and with 0 there.

    Reversed depth is about near / Z: its rounding of 2^-24 is one of Z. Standard depth is about 1: rounded by 2^-25, it
    moves Z by Z^2 / near as much.
    """
    far, f32 = 7.6, np.float32
    z = np.linspace(1.0, 7.0, 1001)
    reverse = near * (far - z) / ((far - near) * z)
    back = f32(near * far) / (f32(near) + f32(reverse) * f32(far - near))
    assert (np.abs(back - z) < 5 * 2.0**-24 * z).all()
    standard = f32(1.0 - reverse).astype(np.float64)
    lost = np.abs(near * far / (far - standard * (far - near)) - z)
    rounding = (z**2 / near * 2.0**-25).max()
    assert 0.3 * rounding < lost.max() < 1.5 * rounding
    assert lost.max() > 10 * np.abs(back - z).max()


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
        ahead, radius = cascades.slice_sphere(view.projection, 1.5, begin, end)
        centre, farthest = view.eye - ahead * back, 0.0
        for depth in (begin, end):
            for x in (-1.5, 1.5):
                for y in (-1, 1):
                    tangent = depth * np.tan(0.45)
                    corner = view.eye - depth * back + x * tangent * right + y * tangent * up
                    farthest = max(farthest, float(np.linalg.norm(corner - centre)))
        assert farthest == pytest.approx(radius, rel=1e-9)


@pytest.mark.core
@pytest.mark.feature("shadows/aliasing-improvements")
def test_cascades_move_by_whole_texels_and_never_change_their_size():
    directions = np.array([(0.48, -0.8, 0.36)])
    random, before = np.random.default_rng(2), None
    ends = cascades.splits(0.01, float(np.linalg.norm(BOX[1] - BOX[0])), 3)
    ahead, radius = cascades.slice_sphere(Perspective(1.0, 0.01), 16 / 9, ends[0], ends[1])
    for _ in range(50):
        eye = random.uniform(-3, 3, 3)
        view = View(pose_looking_at(eye, eye + random.normal(size=3), (0.1, 1, 0)), Perspective(1.0, 0.01))
        made = cascades.directional_faces(directions, BOX, view, np.zeros(3), 16 / 9, 3, 256, 2)
        axes = np.stack([made["right"], made["down"]], axis=1).astype(np.float64)
        texels = (
            np.einsum("fij,fj->fi", axes, made["origin"].astype(np.float64))[:2] * made["scale_x"][:2, None]
        )
        step = 252 // cascades.STEPS
        assert np.allclose(
            texels / step, np.round(texels / step), atol=2e-4
        )  # float32 of a few hundred texels
        # The sphere of the first slice is inside, wherever it is within its step.
        centre = np.stack([made["right"][0], made["down"][0]]).astype(np.float64) @ (
            view.eye - ahead * view.world_from_view[:3, 2]
        )
        assert (
            np.abs(centre * made["scale_x"][0] - texels[0]) + radius * made["scale_x"][0] <= 126 + 1e-2
        ).all()
        if before is not None:
            assert (made["scale_x"] == before["scale_x"]).all() and made[2] == before[2]
        before = made
    # Density rises by the extent of the scene over the diameter of the first slice, and that of a step.
    _, box = cascades.fit(directions[0], BOX)
    factor = before["scale_x"][0] / before["scale_x"][2]
    assert (
        factor == pytest.approx((box[1, 0] - box[0, 0]) / (2 * radius) * (252 - step) / 252, rel=1e-5)
        and factor > 3
    )


def test_orthographic_views_have_cascades():
    view = View(pose_looking_at((0, 9, 0.1), (0, 0, 0)), Orthographic(2.0, 0.1, 20.0))
    made = cascades.directional_faces(np.array([(0.0, -1.0, 0.0)]), BOX, view, np.zeros(3), 1.0, 2, 256, 2)
    assert np.isfinite(made["scale_x"]).all() and (made["scale_x"] > 0).all()


@pytest.mark.feature("shadows/per-light-resolution")
def test_resolution_is_that_of_the_solid_angle():
    found = rule.cluster_resolution(np.array([2.0, 5.0, 20.0, 0.5]), 1.0, 4096, 2048)
    assert np.round(found).tolist() == [101, 260, 1045, 2048]
    assert rule.solid_angle(1e6, 1.0) == pytest.approx(np.pi / 1e12, rel=1e-3)
    assert rule.solid_angle(0.5, 1.0) == 4 * np.pi
    wishes, cubes = np.array([1.0, 40.0, 41.0, 128.0, 129.0, 5000.0, np.inf]), np.full(7, 6)
    levels = lamps.level_above(wishes, cubes, lamps.level_of_side(8))
    assert lamps.sizes_of(levels, cubes).tolist() == [40, 40, 128, 128, 256, 1024, 1024]
    spots = np.array([1, 1])
    levels = lamps.level_above(np.array([1.0, 129.0]), spots, lamps.level_of_side(8))
    assert lamps.sizes_of(levels, spots).tolist() == [128, 256]
    assert not (found[:3] > rule.cluster_resolution(np.array([2.1, 5.1, 20.1]), 1.0, 4096, 2048)).any()


@pytest.mark.feature("shadows/per-light-resolution")
def test_the_bound_of_a_light_holds_for_all_clusters_that_it_covers():
    view, random = (
        View(pose_looking_at((0, 0, 0), (0, 0, -1)), Perspective(0.9, 0.1)),
        np.random.default_rng(5),
    )
    rows, tiles = 720, (80, 45)
    boxes = rule.cluster_boxes(view, 16 / 9, tiles, 64, 60.0).reshape(-1, 2, 3)
    centre, radius = boxes.mean(axis=1), np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1) / 2
    pixels = (1280 / tiles[0]) * (720 / tiles[1])
    for _ in range(20):
        place = np.array((*random.uniform(-4, 4, 2), random.uniform(-40, -8)))
        reach = random.uniform(1.0, 5.0)
        away = np.linalg.norm(centre - place, axis=1)
        covered = (away < reach) & (away > 2 * radius)
        if covered.any():
            asked = rule.cluster_resolution(away[covered], radius[covered], pixels, 1e9).max()
            bound = rule.resolutions(view, rows, place[None], np.array([reach]))[0]
            # A sphere around a cluster covers more than the cluster, so it asks for less than points of it do.
            assert asked <= bound and rule.seen(view, 16 / 9, place[None], np.array([reach]))[0]


@pytest.mark.feature("shadows/cluster-aabbs")
def test_cluster_boxes_hold_their_part_of_the_view():
    view = View(np.eye(4), Perspective(1.1, 0.1))
    boxes = rule.cluster_boxes(view, 1.5, (7, 5), 9, 50.0)
    random = np.random.default_rng(6).uniform(size=(4000, 3))
    slices = np.minimum((random[:, 2] * 9).astype(int), 8)
    depth = 0.1 * (50.0 / 0.1) ** (random[:, 2])
    x, y = random[:, 0] * 2 - 1, 1 - random[:, 1] * 2
    points = np.stack([x * np.tan(0.55) * 1.5 * depth, y * np.tan(0.55) * depth, -depth], 1)
    of = boxes[slices, (random[:, 1] * 5).astype(int), (random[:, 0] * 7).astype(int)]
    assert ((points >= of[:, 0] - 1e-9) & (points <= of[:, 1] + 1e-9)).all()
    wrong = boxes[slices, ((random[:, 1] * 5).astype(int) + 1) % 5, (random[:, 0] * 7).astype(int)]
    assert not ((points >= wrong[:, 0] - 1e-9) & (points <= wrong[:, 1] + 1e-9)).all()


def test_lights_out_of_sight_do_not_matter():
    view = View(pose_looking_at((0, 0, 0), (0, 0, -1)), Perspective(0.8, 0.1))
    centres = np.array([(0, 0, -5), (0, 0, 5), (0, 0, 0.5), (30, 0, -5), (2.5, 0, -5)], np.float64)
    assert rule.seen(view, 1.0, centres, np.ones(5)).tolist() == [True, False, True, False, True]
    weights = rule.importance(view, 1.0, centres, np.ones(5), np.full(5, 2.0))
    assert weights[[1, 3]].tolist() == [0.0, 0.0] and weights[2] > weights[0] > weights[4] > 0
    flat = View(pose_looking_at((0, 0, 0), (0, 0, -1)), Orthographic(2.0, 0.1, 20.0))
    assert rule.seen(flat, 1.0, centres, np.ones(5)).tolist() == [True, False, True, False, True]


def test_lights_of_a_yard_are_what_they_say():
    scene = yard(sun((0, -1, 0)), spot((0, 3, 0), (0, 0, 0)), point((1, 2, 1)))
    assert [light.kind for light in scene.lights] == ["directional", "spot", "point"]


@pytest.mark.feature("shadows/depth-bias", "shadows/cull-toggles")
def test_sliders_toggles_and_more_lights_change_data_and_no_define():
    """Else each step of a slider, and each scene, would compile all that lights and all kernels of shadows again."""

    def built(settings, *lights):
        scene = yard(*lights)
        held = model.places(scene, settings)
        words = model.filter_words(settings).tolist(), model.place_words(settings, held).tolist()
        return model.shadow_defines(scene, settings, held), words

    lamps_ = point((0.0, 3.0, 0.0)), spot((1.0, 3.0, 0.0), (0.0, 0.0, 0.0))
    plain = replaced(Settings(), shadow_filter="pcss")
    defines, words = built(plain, *lamps_)
    for knobs in (
        {"shadow_constant": 2.5},
        {"shadow_slope": 0.25},
        {"shadow_lamp": 0.1},
        {"shadow_sun_angle": 3.0},
        {"shadow_cull_faces": False},
        {"shadow_size": 1024},
    ):
        others, changed = built(replaced(plain, **knobs), *lamps_)
        assert others == defines and changed != words, knobs
    more = [point((float(x), 3.0, float(z))) for x in range(3) for z in range(3)]
    others, changed = built(plain, sun((0.3, -1.0, 0.2)), *more)
    assert others == defines and changed != words
    assert built(replaced(plain, shadow_bias="slope"), *lamps_)[0] != defines
