"""Figures of fog: pictures with all filters against quadrature and path tracing, bands, edges, and rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters import scenes
from chapters.ch10.benches import fog, fog_scenes
from chapters.ch10.benches.fog_truth import FogTruth, Rays, eye_rays
from chapters.ch10.clusters.lights import LightRecords
from chapters.ch10.fog import model
from chapters.ch10.settings import Settings
from common.reports.benches import Effort
from common.reports.metrics import gradient_step
from common.scene import Material
from common.settings import replaced
from tests.support.fog import FULL, HAZE, VIEW, foggy, grid_of, in_cube, lights_of, radii, records, twin_of
from tests.support.shadows import point, sun
from tests.twins import fog as twin
from tools.bench.points import Subject

pytestmark = pytest.mark.variants("vulkan", "gl")

BLACK = Material(base_color=(0.0, 0.0, 0.0, 1.0), roughness=1.0, metallic=0.0, double_sided=True)
DEFAULT = Settings()
GRID = fog.grid((DEFAULT.fog.fog_columns, DEFAULT.fog.fog_rows, DEFAULT.fog.fog_slices))
FILTERED = {**FULL, **GRID, "fog_spatial": True, "fog_temporal": True, "fog_near": 0.01}
"""The default grid and filters, in 32 bits."""

SIZE = (96, 72)


SMALL = (48, 36)
"""Of pictures that are compared pixel by pixel: what the fog holds is the matter of its grid."""


def pictures(chapter, scene, frames, view=VIEW, size=SMALL, **turned):
    """Return light (H, W, 3) of the fog, rays of all pixels, numbers of those that show a surface, and the grid."""
    outputs, found = {"color", "color_linear", "depth"}, []
    for on in (False, True):
        settings = replaced(Settings(**FILTERED), **{**turned, "fog": on})
        with chapter.open(scene, size, settings, outputs=outputs) as renderer:
            for _ in range(frames if on else 4):
                frame = renderer.render(view)
                found = [*found[:on], frame.image("color_linear")[..., :3].astype(np.float64)]
            depth = frame.image("depth").astype(np.float64).reshape(size[::-1])
            grid, far = grid_of(renderer, view), model.range_of(scene, renderer.settings.fog)[1]
    rays = eye_rays(scene, view, depth, np.arange(depth.size), far)
    seen = np.exp(-scene.medium.extinction * rays.lengths).reshape(*depth.shape, 1)
    return found[1] - found[0] * seen, rays, np.flatnonzero(depth), grid


# --- quadrature ---


@pytest.mark.feature("fog/light-scattering", "fog/integration", "fog/temporal-filter", "fog/spatial-filter")
def test_a_picture_is_that_of_quadrature_and_nearer_with_each_grid(chapter):
    """The lamp is farther than two diagonals from each froxel. Measured: 0.7, 0.2 and 0.06 % rms."""
    lamp = point((6.0, 3.0, 6.0), candela=100.0)
    scene = foggy(lamp, medium=HAZE, material=BLACK)
    light = twin.Light(tuple(lamp[1][:3, 3]), (100.0,) * 3)
    errors, truth = [], None
    for size in ((32, 18, 16), (64, 36, 32), tuple(GRID.values())):
        found, rays, _, grid = pictures(chapter, scene, 4, **fog.grid(size))
        if truth is None:  # whatever the grid, rays end at the same depths
            truth, _ = twin.single_scattering(
                rays.origins + scene.origin, rays.directions, rays.lengths, twin_of(HAZE), light, 0.6
            )
        errors.append(float(np.sqrt(((found.reshape(-1, 3) / truth - 1) ** 2).mean())))
    distances = np.linalg.norm(grid.samples() - light.position, axis=-1)
    assert (distances > 2 * 2 * radii(grid)).all()
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.01, errors


@pytest.mark.feature("fog/medium", "fog/integration")
@pytest.mark.parametrize(
    ("format", "bound"), [pytest.param("rgba32f", 1e-4, marks=pytest.mark.long), ("rgba16f", 1e-3)]
)
def test_all_filters_leave_beer_and_lambert_at_every_slice(chapter, format, bound):
    """At the default grid. A half near 1 has steps of 2^-11, and extinction in halves is off by as much, relatively."""
    knobs = {**FILTERED, "fog_format": format}
    with chapter.open(foggy(), SIZE, Settings(**knobs), outputs={"color"}) as renderer:
        for _ in range(3):
            renderer.render(VIEW).image("color")
        before, _ = records(renderer)
        grid = grid_of(renderer)
    metres = grid.edges()[:-1, None, None] * grid.stretch(grid.centers()[0, ..., :2])
    assert np.abs(before[..., 3] - np.exp(-HAZE.extinction * metres)).max() < bound


# --- path tracing ---

TRACED: dict[float, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
"""Pixels, their light and its noise, by anisotropy: paths take seconds, and are those of either backend."""


def some(rays, numbers):
    """Return some of the rays."""
    return Rays(*(values[numbers] for values in rays))


def traced(scene, lamp, g, rays, batches=8, samples=2048):
    """Return light (R, 3) of a volumetric path tracer that scatters once, and its standard error, along rays.

    The medium is a homogeneous box around the yard. Its surfaces are black, and the cube casts a shadow.
    """
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    turn = mitsuba.ScalarTransform4f

    def rgb(values):
        return {"type": "rgb", "value": [float(value) for value in values]}

    black, air = {"type": "diffuse", "reflectance": rgb((0, 0, 0))}, {"type": "ref", "id": "air"}
    film = {"type": "hdrfilm", "height": 1, "component_format": "float32", "pixel_format": "rgb"}
    film["rfilter"] = {"type": "box"}
    sensors = {
        f"ray{number}": {
            "type": "radiancemeter",
            "origin": (origin + scene.origin).tolist(),
            "direction": way.tolist(),
            "film": {**film, "width": 1},
            "medium": air,
        }
        for number, (origin, way) in enumerate(zip(rays.origins, rays.directions, strict=True))
    }
    world = mitsuba.load_dict(
        {
            "type": "scene",
            "air": {
                "type": "homogeneous",
                "id": "air",
                "albedo": rgb(HAZE.albedo),
                "sigma_t": rgb((HAZE.extinction,) * 3),
                "phase": {"type": "hg", "g": g},
            },
            "integrator": {"type": "volpath", "max_depth": 2, "rr_depth": 100},
            "box": {
                "type": "cube",
                "to_world": turn().scale([30, 30, 30]),
                "bsdf": {"type": "null"},
                "interior": air,
            },
            "ground": {
                "type": "rectangle",
                "to_world": turn().rotate([1, 0, 0], -90).scale([4, 4, 1]),
                "bsdf": {"type": "twosided", "bsdf": black},
            },
            "cube": {
                "type": "cube",
                "to_world": turn().translate([0, 1, 0]).scale([0.5, 0.5, 0.5]),
                "bsdf": black,
            },
            "lamp": {
                "type": "point",
                "position": lamp[1][:3, 3].tolist(),
                "intensity": rgb((lamp[0].intensity,) * 3),
                "medium": air,
            },
            "sensor": {"type": "batch", "film": {**film, "width": len(sensors)}, "medium": air, **sensors},
        }
    )
    found = np.array([np.array(mitsuba.render(world, spp=samples, seed=seed))[0] for seed in range(batches)])
    return found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(batches)


@pytest.mark.feature("fog/light-scattering", "fog/henyey-greenstein", "fog/integration")
@pytest.mark.needs("mitsuba")
@pytest.mark.parametrize("anisotropy", [0.6, pytest.param(-0.5, marks=pytest.mark.long)])
def test_a_homogeneous_box_is_that_of_a_path_tracer(chapter, anisotropy):
    """At pixels that show a surface: behind it ours has more air than the box.

    Where the shadow of the cube is in no way, there are maps of shadows or none; without, paths have the larger noise.
    With maps, a froxel that reaches behind a surface has less light (most of it where light is thrown back), and edges
    are as wide as a froxel: measured 2 % and 6 % rms.
    """
    lamp = point((-1.2, 3.0, 0.8), candela=60.0)
    scene = foggy(lamp, medium=HAZE, material=BLACK)
    knobs = {"fog_anisotropy": anisotropy, **fog.grid((64, 36, 32))}
    unfiltered = {"shadows": "off", "fog_spatial": False, "fog_temporal": False}
    plain, rays, drawn, _ = pictures(chapter, scene, 2, **unfiltered, **knobs)
    found, *_ = pictures(chapter, scene, 6, shadows="on", **knobs)
    if anisotropy not in TRACED:
        lights = [
            FogTruth(scene, HAZE, lights_of(scene, LightRecords), anisotropy, blocked=blocked).light(
                some(rays, drawn)
            )
            for blocked in (None, in_cube(scene))
        ]
        shade = 1 - (lights[1] / lights[0])[:, 0]
        rng, groups = np.random.default_rng(8), (shade < 1e-4, shade > 0.03)
        chosen = np.concatenate([rng.choice(drawn[group], 20, replace=False) for group in groups])
        TRACED[anisotropy] = chosen, *traced(scene, lamp, anisotropy, some(rays, chosen))
    chosen, light, noise = TRACED[anisotropy]
    open_, shaded = chosen[:20], chosen[20:]
    away = plain.reshape(-1, 3)[open_] / light[:20] - 1
    assert np.sqrt(((noise / light) ** 2).mean()) < 0.02
    assert abs(away.mean()) < 0.01 and np.sqrt((away**2).mean()) < 0.025
    away = found.reshape(-1, 3)[chosen] / light - 1
    assert np.sqrt((away**2).mean()) < 0.1 and np.abs(away).max() < 0.3
    blind = plain.reshape(-1, 3)[shaded] / light[20:] - 1
    assert np.sqrt((blind**2).mean()) > 1.5 * np.sqrt((away[20:] ** 2).mean())


# --- bands ---


@pytest.mark.feature("metrics/banding", "fog/temporal-filter", "noise/blue-noise")
def test_jitter_and_the_temporal_filter_take_bands_away(chapter):
    """Of a layer of mist whose upper side is met at a flat angle: with 16 slices each is a band of many codes."""
    scene, found = fog_scenes.ramp(), {}
    for name, values in fog.WAYS[:3]:
        settings = replaced(
            Settings(**FULL),
            **{**GRID, "fog_slices": 16, "fog_near": 0.01, "fog_spatial": True, "fog_temporal": True},
        )
        settings = replaced(settings, **values, ambient=-1.0, tone_curve=DEFAULT.post.tone_curve)
        with chapter.open(scene, (80, 180), settings, outputs={"color"}) as renderer:
            view = Subject.view(None, renderer)
            for _ in range(10):
                shown = renderer.render(view).image("color")
        found[name] = gradient_step(shown[fog.HORIZON :, :, :3].astype(np.float64), axis=0)
    assert found["as it is"] > 4.0
    assert found["jitter, temporal"] < 0.4 * found["as it is"]
    assert found["all filters"] < 0.25 * found["as it is"]


# --- at rest ---


@pytest.mark.feature("fog/light-scattering", "fog/temporal-filter")
def test_reports_of_froxels_do_not_follow_the_random_depths_of_frames(chapter):
    """Pages that some frames alone ask for would come and go, and the view would never rest."""
    lamp = sun((0.5, -0.3, 0.2))
    knobs = {"shadows": "on", "shadow_memory": "pages", "fog_spatial": False, "fog_temporal": True}
    settings = replaced(Settings(**FULL), **knobs)
    with chapter.open(foggy(lamp), SMALL, settings, outputs={"color"}, inspect=True) as renderer:
        reports, light = [], []
        for _ in range(8):
            frame = renderer.render(VIEW)
            light.append(frame.image("fog_scatter/fog_light"))
            reports.append(renderer.techniques["shadows"]._report.read(0).copy())
    assert not np.array_equal(light[-1], light[-2])  # depths are other ones
    assert reports[-1].any() and all(np.array_equal(one, reports[-1]) for one in reports[4:])


# --- whole scenes ---


@pytest.mark.long
@pytest.mark.feature("fog/half-resolution-apply")
@pytest.mark.parametrize("name", ["atrium:fog", "market:fog"])
def test_a_scene_at_half_resolution_has_no_halo(chapter, name):
    """No pixel beside a step of depth is off by more than two codes.

    Elsewhere a shaft may be narrower than the distance of samples: measured, 0.01 % of the pixels are off by 3 or 4.
    """
    scene, shown = replace(scenes.load(name), animations=[]), []
    for half in (False, True):
        knobs = {"fog_half": half, "fog_dither": False, "fog_temporal": False, "cloth": False}
        settings = replaced(DEFAULT, graph="deferred", **knobs)
        with chapter.open(scene, (320, 180), settings, outputs={"color", "depth"}) as renderer:
            view = Subject.view(None, renderer)
            for _ in range(8):
                frame = renderer.render(view)
                codes = frame.image("color")[..., :3].astype(int)
            shown.append(codes)
            depth = frame.image("depth").astype(np.float64).reshape(180, 320)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(depth, 1, mode="edge"), (3, 3))
    steps = around.max(axis=(2, 3)) > 1.1 * around.min(axis=(2, 3))
    away = np.abs(shown[0] - shown[1]).max(axis=-1)
    assert steps.mean() > 0.02 and away.any()
    assert away[steps].max() <= 2, away[steps].max()
    assert (away > 2).mean() < 1e-3 and away.max() <= 6


@pytest.mark.long
@pytest.mark.feature("fog/temporal-filter")
def test_a_scene_at_rest_converges_and_stays(chapter):
    """Each doubling of the frames leaves less to come; after REST_FRAMES and the frames of loading nothing changes."""
    scene = replace(scenes.load("atrium:fog"), animations=[])
    settings = replaced(DEFAULT, graph="deferred", cloth=False, **fog.grid((32, 18, 16)))
    shown = []
    with chapter.open(scene, (160, 90), settings, outputs={"color_linear"}) as renderer:
        view = Subject.view(None, renderer)
        while not renderer.idle(view) or len(shown) < 8:
            shown.append(renderer.render(view).image("color_linear").astype(np.float64))
            assert len(shown) < 2 * model.REST_FRAMES, "the view does not come to rest"
        again = renderer.render(view).image("color_linear")
    assert np.array_equal(again, shown[-1])
    left = [float(np.abs(shown[number] - shown[-1]).mean()) for number in (7, 15, 31, 47)]
    assert left == sorted(left, reverse=True) and left[-1] < 0.4 * left[0], left


FEW = Effort(1, 2, 1, 1, 1, everything=False)
BOUNDS = {"atrium:fog": (0.01, 0.06), "market:fog": (0.015, 0.15)}
"""Half and 95 % of all errors relative to cast rays at the default grid. Measured: 0.4 % and 2.5 %, 0.6 % and 8 %."""


@pytest.mark.long
@pytest.mark.feature("fog/light-scattering")
@pytest.mark.needs("mitsuba")
@pytest.mark.parametrize("name", list(BOUNDS))
def test_a_scene_with_shadows_is_near_quadrature_with_cast_rays(chapter, name):
    subject = Subject(10, chapter.device.capabilities.backend, foggy(), (320, 180), chapter.device)
    scene, values = fog.scene_named(subject, name)
    drawn, truth = subject.on(scene), None
    for turned in ({"fog": False}, {}):
        settings = fog_scenes.settings_of(subject, **values, **turned)
        figures, _, truth = fog._found(drawn, settings, FEW, truth, 200)
    median, most = BOUNDS[name]
    assert figures["median"] < median and figures["p95"] < most, figures
    assert abs(figures["bias"]) < 0.06, figures
