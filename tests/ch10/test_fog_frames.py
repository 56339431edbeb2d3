"""Pictures through fog: at the depth of each surface, alike on all paths, and with nothing done where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters.ch10.fog import model
from chapters.ch10.settings import Settings
from common.errors import UnsupportedError, UserError
from common.numerics.transforms import pose_looking_at
from common.scene import FogBox, Material, Medium
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.fog import FULL, HAZE, LAYERS, SIZE, VIEW, foggy, grid_of, records, twin_of
from tests.support.shadows import placed, point, spot, yard
from tests.twins import fog as twin
from tests.twins import fog_grid

pytestmark = pytest.mark.variants("vulkan", "gl")

BASE = Settings(**FULL)
LAMP = point((-1.2, 3.0, 0.8), candela=60.0)
WHITE = Material(unlit=True, base_color=(0.5, 0.5, 0.5, 1.0), double_sided=True)


DARK = replace(VIEW, ev100=VIEW.ev100 + 2)  # no pixel is white


def picture(chapter, scene, view=VIEW, size=SIZE, frames=1, **turned):
    """Return light of the last frame, divided by the exposure, and its depth buffer."""
    outputs = {"color", "color_linear", "depth"}
    with chapter.open(scene, size, replaced(BASE, **turned), outputs=outputs) as renderer:
        for _ in range(frames):
            frame = renderer.render(view)
        return frame.image("color_linear").astype(np.float64)[..., :3], frame.image("depth").astype(
            np.float64
        )


def distances(depth, view=VIEW):
    """Return (H, W) metres from the eye along each pixel's ray, infinite where nothing was drawn."""
    rows, columns = depth.shape
    tan = np.tan(view.projection.yfov / 2)
    y, x = np.indices(depth.shape) + 0.5
    slope = np.stack([(2 * x / columns - 1) * tan * columns / rows, (2 * y / rows - 1) * tan], axis=-1)
    with np.errstate(divide="ignore"):
        ahead = view.projection.near / depth
    return ahead * np.sqrt(1 + (slope**2).sum(axis=-1))


# --- surfaces ---


@pytest.mark.feature("fog/apply", "fog/medium")
@pytest.mark.parametrize("graph", ["deferred", pytest.param("compute", marks=pytest.mark.long), "forward"])
def test_fog_at_a_surface_is_that_up_to_its_depth(chapter, graph):
    """Against the twin, which takes the end of the slice before and the closed form of the rest, at each pixel."""
    scene = foggy(LAMP, medium=HAZE, material=WHITE)
    clear, depth = picture(chapter, scene, graph=graph, fog=False)
    with chapter.open(scene, SIZE, replaced(BASE, graph=graph), outputs={"color_linear"}) as renderer:
        foggy_light = renderer.render(VIEW).image("color_linear")[..., :3].astype(np.float64)
        before, here = records(renderer)
        grid = grid_of(renderer)
    ends = np.concatenate([before[1:], fog_grid.integrated(grid, here)[-1:]])
    y, x = np.indices(depth.shape) + 0.5
    uv = np.stack([x / SIZE[0], y / SIZE[1]], axis=-1)
    with np.errstate(divide="ignore"):
        ahead = np.where(depth > 0, VIEW.projection.near / depth, 1e9)
    fog = fog_grid.within_slice(grid, ends, here, uv, ahead)
    truth = clear * fog[..., 3:] + fog[..., :3] * (1.2 * 2**VIEW.ev100)
    assert (depth > 0).mean() > 0.4 and (depth == 0).any()
    assert np.abs(foggy_light - truth).max() < 1e-4 * truth.max()
    linear = fog_grid.between_ends(grid, ends, uv, np.minimum(ahead, grid.far))
    wrong = clear * linear[..., 3:] + linear[..., :3] * (1.2 * 2**VIEW.ev100)
    assert np.abs(foggy_light - wrong).max() > 1e-3 * truth.max()


@pytest.mark.core
@pytest.mark.feature("fog/apply", "fog/medium")
def test_surfaces_are_dimmed_by_beer_lambert_at_their_own_depth(chapter):
    """A picture of surfaces that shine by themselves in a medium that only absorbs, at the default grid.

    Pixels at the border lie outside of the centres of froxels: they have the ray of the nearest column.
    """
    medium = Medium(0.2, albedo=(0.0, 0.0, 0.0))
    knobs = {"fog_columns": 128, "fog_rows": 72, "fog_slices": 64}
    clear, depth = picture(chapter, foggy(medium=medium, material=WHITE), fog=False)
    dim, _ = picture(chapter, foggy(medium=medium, material=WHITE), **knobs)
    drawn = depth > 0
    drawn[[0, -1]] = drawn[:, [0, -1]] = False
    seen = np.exp(-0.2 * distances(depth)[drawn])
    assert drawn.mean() > 0.4 and seen.min() < 0.3 < seen.max()
    assert np.abs(dim[drawn] / clear[drawn] - seen[:, None]).max() < 1e-4


@pytest.mark.feature("fog/apply")
def test_all_paths_give_the_same_picture(chapter):
    scene = foggy(LAMP, spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), medium=LAYERS)
    forward, *others = (
        picture(chapter, scene, graph=graph, ambient=3.0, background=0.3)[0]
        for graph in ("forward", "deferred", "compute")
    )
    assert all(np.abs(other - forward).max() < 1e-4 * forward.max() for other in others)
    assert (forward > 0).all()  # there is light of the fog everywhere, and of what is behind


@pytest.mark.feature("fog/apply")
@pytest.mark.parametrize("graph", ["deferred", pytest.param("compute", marks=pytest.mark.long), "forward"])
def test_a_blended_surface_is_seen_through_the_same_fog(chapter, graph):
    """With an alpha of 1 it has the light of a solid one."""
    solid = Material(roughness=1.0, metallic=0.0, double_sided=True)
    blended = replace(solid, alpha_mode="blend", base_color=(1.0, 1.0, 1.0, 1.0))
    knobs = {"graph": graph, "background": 0.3}
    pictures = [
        picture(chapter, foggy(LAMP, material=material, medium=HAZE), **knobs)[0]
        for material in (solid, blended)
    ]
    assert np.abs(pictures[0] - pictures[1]).max() < 3e-4 * pictures[0].max()


@pytest.mark.feature("fog/apply")
def test_an_orthographic_view_looks_along_parallel_rays(chapter):
    view = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Orthographic(3.0, 0.05, 20.0))
    medium = Medium(0.2, albedo=(0.0, 0.0, 0.0))
    clear, depth = picture(chapter, foggy(medium=medium, material=WHITE), view, fog=False)
    dim, _ = picture(chapter, foggy(medium=medium, material=WHITE), view)
    drawn = depth > 0
    metres = 20.0 - depth[drawn] * (20.0 - 0.05)
    assert np.abs(dim[drawn] / clear[drawn] - np.exp(-0.2 * metres)[:, None]).max() < 1e-4


# --- along rays ---


@pytest.mark.feature("fog/integration", "fog/light-scattering")
def test_light_of_columns_is_that_of_quadrature(chapter):
    """A lamp beside the view, farther than two diagonals from each froxel: within 1 % rms at the default grid."""
    lamp = point((6.0, 3.0, 6.0), candela=100.0)
    wanted, errors = 128, []
    for columns, rows, slices in ((32, 18, 16), (64, 36, 32), (wanted, 72, 64)):
        knobs = {"fog_columns": columns, "fog_rows": rows, "fog_slices": slices}
        with chapter.open(foggy(lamp), SIZE, replaced(BASE, **knobs, fog_near=0.01)) as renderer:
            renderer.render(VIEW).image("color")
            before, _ = records(renderer)
            grid = grid_of(renderer)
        rng = np.random.default_rng(5)
        x, y = rng.integers(columns, size=60), rng.integers(rows, size=60)
        z = rng.integers(slices // 4, slices, size=60)
        uv = np.stack([(x + 0.5) / columns, (y + 0.5) / rows], axis=-1)
        start, direction = grid.rays(uv)
        metres = grid.edges()[z] * grid.stretch(uv)
        light = twin.Light(tuple(lamp[1][:3, 3]), (100.0,) * 3)
        truth, _ = twin.single_scattering(start, direction, metres, twin_of(HAZE), light, 0.6)
        found = before[z, y, x, :3] * (1.2 * 2**VIEW.ev100)
        errors.append(float(np.sqrt(((found / truth - 1) ** 2).mean())))
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.01, errors


# --- half resolution ---


@pytest.mark.feature("fog/half-resolution-apply")
@pytest.mark.parametrize(
    ("graph", "size"),
    [
        *(("deferred", (61, 47)), ("compute", (64, 48))),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in (("deferred", (64, 48)), ("compute", (61, 47)))
        ),
    ],
)
def test_half_resolution_has_no_halo(chapter, graph, size):
    """Nowhere, across depth edges neither, is a picture off by two steps of 8 bits; taking any depth does worse."""
    near = placed((2.4, 2.1, 3.2), (0.6, 0.5), (0.9, 0.1, 0.5))
    scene = foggy(LAMP, medium=Medium(0.25, albedo=(1.0, 1.0, 1.0)), extra=(near,))
    settings = replaced(BASE, graph=graph, ambient=2.0, fog_columns=32, fog_rows=24)
    found = []
    for half, tolerance in ((False, 0.01), (True, 0.01), (True, 1.0)):
        knobs = {"fog_half": half, "fog_half_tolerance": tolerance}
        with chapter.open(scene, size, replaced(settings, **knobs)) as renderer:
            found.append(renderer.render(DARK).image("color").astype(int)[..., :3])
            assert ("fog_half" in [step.name for step in renderer.graph.steps]) == half
    assert np.abs(found[0] - found[1]).max() <= 2 < np.abs(found[0] - found[2]).max()
    assert not np.array_equal(found[0], found[1])


@pytest.mark.feature("fog/half-resolution-apply")
def test_without_a_matching_sample_a_pixel_looks_up_its_own_fog(chapter):
    """With no tolerance all pixels do but those with a sample of their own, and those beside one at the same depth."""
    scene = foggy(LAMP, medium=HAZE)
    full, depth = picture(chapter, scene, graph="deferred", fog_format="rgba32f")
    half, _ = picture(chapter, scene, graph="deferred", fog_half=True, fog_half_tolerance=0.0)
    # Samples are halves, and those beside are a pixel away.
    assert np.abs(full - half)[depth > 0].max() < 4e-3 * full.max()


def test_half_resolution_says_where_it_has_no_effect(chapter):
    scene = foggy(LAMP)
    with chapter.open(scene, SIZE, replaced(BASE, graph="forward", fog_half=True)) as renderer:
        renderer.render(VIEW)
        assert any("fog_half has no effect" in sentence for sentence in scene.warnings)
    scene = foggy(LAMP)
    with chapter.open(scene, SIZE, replaced(BASE, graph="deferred", fog_half=True)):
        assert not scene.warnings


# --- dither ---


@pytest.mark.feature("fog/apply")
def test_dither_moves_no_pixel_by_more_than_a_step_and_keeps_the_mean(chapter):
    scene = foggy(LAMP, medium=Medium(0.05, albedo=(1.0, 1.0, 1.0)))
    pictures = []
    for dither in (False, True):
        knobs = {"ambient": 2.0, "background": 0.2, "fog_dither": dither}
        with chapter.open(scene, (128, 96), replaced(BASE, **knobs)) as renderer:
            pictures.append(renderer.render(DARK).image("color").astype(int)[..., :3])
    away = pictures[1] - pictures[0]
    assert np.abs(away).max() <= 2 and 0.1 < (away != 0).mean() < 0.9
    assert abs(away.mean()) < 0.05


# --- nothing to do ---


@pytest.mark.feature("fog/medium")
@pytest.mark.parametrize(
    "turned", [{"fog": False}, {"fog_density": 0.0}, {"view": "normal"}], ids=["off", "none", "view"]
)
def test_without_fog_there_is_no_pass_image_or_buffer(chapter, turned):
    scenes = foggy(LAMP), yard(LAMP)
    settings = replaced(BASE, **turned), replaced(BASE, view=turned.get("view", "picture"))
    found = []
    for scene, knobs in zip(scenes, settings, strict=True):
        with chapter.open(scene, SIZE, knobs, outputs={"color"}) as renderer:
            frame = renderer.render(VIEW)
            found.append((frame.image("color"), dict(frame.timings).keys(), len(renderer._pipelines)))
            assert not [name for name in renderer.graph.resources if "fog" in name]
            assert renderer.techniques["fog"]._memory is None
            assert not renderer.techniques["fog"].work
    assert np.array_equal(found[0][0], found[1][0]) and found[0][1:] == found[1][1:]


@pytest.mark.feature("fog/inject-box")
def test_boxes_out_of_view_dispatch_nothing(chapter):
    medium = Medium(boxes=(FogBox((0.0, 0.5, 40.0), (1.0, 1.0, 1.0), 0.5),))
    with chapter.open(foggy(LAMP, medium=medium), SIZE, BASE, outputs={"color"}) as renderer:
        frame = renderer.render(VIEW)
        outside, count = frame.image("color"), frame.work["dispatches"]
    with chapter.open(yard(LAMP), SIZE, BASE, outputs={"color"}) as renderer:
        frame = renderer.render(VIEW)
        assert np.array_equal(outside, frame.image("color")) and count == frame.work["dispatches"]


def test_a_box_is_in_view_where_a_corner_may_be():
    """Against points: a box of which any point is in view is."""
    rng = np.random.default_rng(2)
    view, aspect, far = VIEW, 4 / 3, 9.0
    kept = 0
    for _ in range(300):
        center, half = rng.uniform(-8, 8, 3), rng.uniform(0.1, 2, 3)
        medium = Medium(boxes=(FogBox(tuple(center), tuple(half), 0.1),))
        points = center + rng.uniform(-1, 1, (200, 3)) * half
        clip = np.c_[points, np.ones(200)] @ view.clip_from_world(aspect).T
        ahead = -(np.c_[points, np.ones(200)] @ view.view_from_world()[2])
        inside = (np.abs(clip[:, :2]) <= clip[:, 3:]).all(axis=1) & (ahead > 0) & (ahead < far)
        shown = model.Extent(medium, far).in_view(view, aspect)
        kept += shown
        assert shown or not inside.any()
    assert 30 < kept < 270


# --- refusals ---


@pytest.mark.parametrize(
    ("turned", "words"),
    [
        ({"fog_density": -0.5}, "fog_density is -0.5"),
        ({"fog_height": -2.0}, "fog_height is -2"),
        ({"fog_anisotropy": 1.0}, "fog_anisotropy=1 is no mean cosine"),
        ({"fog_anisotropy": -1.5}, "fog_anisotropy=-1.5 is no mean cosine"),
        ({"fog_near": 3.0, "fog_far": 2.0}, "fog_near=3 is not in front of fog_far=2"),
        ({"fog_near": 2.0, "fog_far": 2.0}, "fog_near=2 is not in front of fog_far=2"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(chapter, turned, words):
    with pytest.raises(UserError, match=words):
        chapter.open(foggy(LAMP), SIZE, replaced(BASE, **turned))


@pytest.mark.feature("fog/inject-box", "fog/inject-constant-and-height")
@pytest.mark.parametrize("density", [float("nan"), -1.0, float("inf")])
def test_a_medium_of_no_density_is_refused(chapter, density):
    with pytest.raises(UserError, match="it is a number per metre"):
        chapter.open(foggy(LAMP, medium=Medium(extinction=density)), SIZE, BASE)
    box = FogBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), density)
    with pytest.raises(UserError, match="fog box 0 is"):
        chapter.open(foggy(LAMP, medium=Medium(boxes=(box,))), SIZE, BASE)


def test_too_bright_a_medium_and_too_many_boxes_are_refused(chapter):
    with pytest.raises(UserError, match="albedo of fog"):
        chapter.open(foggy(LAMP, medium=Medium(0.1, albedo=(1.2, 1.0, 1.0))), SIZE, BASE)
    boxes = (FogBox((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.1),) * 9
    with pytest.raises(UserError, match="9 boxes"):
        chapter.open(foggy(LAMP, medium=Medium(boxes=boxes)), SIZE, BASE)


@pytest.mark.feature("fog/inject-box")
@pytest.mark.parametrize("half", [-1.0, float("nan"), float("inf")])
def test_a_box_of_no_size_is_refused(chapter, half):
    """A froxel is never inside such a box, and a way of light would cross it."""
    box = FogBox((0.0, 0.0, 0.0), (1.0, half, 1.0), 0.1)
    with pytest.raises(UserError, match="Half the size of fog box 0 is"):
        chapter.open(foggy(LAMP, medium=Medium(boxes=(box,))), SIZE, BASE)


def test_a_grid_beyond_the_device_is_refused(chapter):
    most = chapter.device.capabilities.limits["maxImageDimension3D"]
    with pytest.raises(UnsupportedError, match="froxels is more than this device holds"):
        chapter.open(foggy(LAMP), SIZE, replaced(BASE, fog_slices=most + 1))
    seen = chapter.device.capabilities.limits["maxStorageBufferRange"]
    rows = min(most, int(seen // (32 * 128 * 1024)) + 1)
    with pytest.raises(UnsupportedError, match="froxels take"):
        chapter.open(
            foggy(LAMP),
            SIZE,
            replaced(BASE, fog_columns=min(most, 1024), fog_rows=min(most, 128 * rows), fog_slices=1024),
        )


@pytest.mark.parametrize(
    "name", ["fog_density", "fog_height", "fog_falloff", "fog_anisotropy", "fog_near", "fog_far"]
)
def test_nan_is_no_knob(chapter, name):
    with pytest.raises(UserError, match=name):
        chapter.open(foggy(LAMP), SIZE, replaced(BASE, **{name: float("nan")}))


def test_a_lens_of_any_kind_keeps_light_finite(chapter):
    """Lamps inside of froxels, and a dense medium in halves."""
    lamps = [point((0.3, 1.5, 1.0), candela=1e6), point((3.0, 2.5, 3.9), candela=1e6)]
    scene = foggy(*lamps, medium=Medium(1e3))
    view = View(VIEW.world_from_view, Perspective(2.5, 0.001))
    for format in ("rgba16f", "rgba32f"):
        light, _ = picture(chapter, scene, view, fog_format=format, fog_temporal=True, frames=3)
        assert np.isfinite(light).all()


def test_ground_and_lamp_in_one_column(chapter):
    """A surface in front of the first slice's end is not behind fog of the whole slice."""
    near = placed((2.97, 2.48, 3.96), (0.02, 0.02), (0.6, 0.42, 0.8))
    medium = Medium(0.5, albedo=(0.0, 0.0, 0.0))
    scene = foggy(medium=medium, material=WHITE, extra=(near,))
    clear, depth = picture(chapter, scene, fog=False)
    dim, _ = picture(chapter, scene)
    close = distances(depth) < 0.2
    assert close.any()
    assert np.abs(dim[close] / clear[close] - np.exp(-0.5 * distances(depth)[close])[:, None]).max() < 1e-3
