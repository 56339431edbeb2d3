"""The study procedural-spheres: hits against a quadratic in float64, by intersection shaders and by a kernel."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch12.studies.procedural_spheres import GROUND, Settings, boxes, spheres
from common.errors import SettingError
from common.numerics.transforms import pose_looking_at
from common.settings import apply_overrides
from common.view.camera import Perspective, View
from tests.support.bounds import codes_off
from tests.support.pixel_rays import pixel_rays

pytestmark = pytest.mark.feature("ray-tracing/any-hit-and-intersection")
WHICH, SIZE = "12/procedural-spheres", (64, 48)
SHADED = np.array([0.4558, 0.7975, 0.3960])


@pytest.fixture(params=["driver", "kernel"])
def without(request, stage):
    """What is switched off: nothing, or ray pipelines, which OpenGL does not have."""
    if request.param == "driver" and (stage.backend == "gl" or not stage.device.has("ray-tracing")):
        pytest.skip("no ray pipelines here")
    return ("ray-tracing",) if request.param == "kernel" and stage.backend == "vulkan" else ()


def drawn(stage, without=(), view=None, size=SIZE, **knobs):
    """Return what rays found (H, W), the picture, the counters, and the view."""
    with stage.open(WHICH, size, settings=Settings(**knobs), without=without) as renderer:
        view = chapters.view_of(renderer) if view is None else view
        frame = renderer.render(view)
        return renderer.pixels(), frame.image("color"), frame.work, view


def truth(view, settings, size=SIZE):
    """Return t, the nearest sphere and how sure it is (N,): no rim and no other sphere as near, in float64.

    A ray meets a sphere where the distance to its centre is the radius, by Pythagoras in the plane of ray and centre.
    """
    eye, along = pixel_rays(view, size)
    places = spheres(settings).astype(np.float64)
    to = places[:, :3] - eye
    ahead = along @ to.T
    apart = np.linalg.norm(np.cross(along[:, None], to[None]), axis=2)
    radii = places[:, 3]
    half = np.sqrt(np.maximum(radii**2 - apart**2, 0))
    t = np.where(apart < radii, np.where(ahead - half > 0, ahead - half, ahead + half), np.inf)
    t[t <= 0] = np.inf
    order = np.sort(t, axis=1)
    rim = (np.abs(apart / radii - 1) < 1e-3).any(axis=1)
    with np.errstate(invalid="ignore"):
        sure = ~rim & ~(order[:, 1] - order[:, 0] < 1e-3)
    return t.min(axis=1), t.argmin(axis=1), sure


def test_hits_are_those_of_the_closed_form(stage, without):
    found, _, work, view = drawn(stage, without)
    t, sphere, sure = truth(view, Settings())
    hit = found["color"][..., 3].ravel()
    assert sure.mean() > 0.8 and len(np.unique(sphere[sure])) > 60
    assert ((hit >= 0) == np.isfinite(t))[sure].all()
    both = sure & np.isfinite(t)
    assert (found["what"][..., 0].ravel() == sphere)[both].all()
    # t is off by roundings of the distance to the centre, over the sine at which the ray meets the sphere.
    assert np.abs(hit / t - 1)[both].max() < 2e-5
    assert (found["what"][..., 1:3].reshape(-1, 2)[both] == (0, 1)).all()
    assert work["rays"] == SIZE[0] * SIZE[1]


def test_the_shader_of_boxes_runs_where_boxes_are_met(stage, without):
    """A kernel asks all spheres; a structure those in boxes on the way, at most all of the boxes that are met."""
    found, _, work, view = drawn(stage, without)
    eye, along = pixel_rays(view, SIZE)
    box = boxes(spheres(Settings())).astype(np.float64).reshape(-1, 2, 3)
    with np.errstate(divide="ignore"):
        ends = (box[None] - eye) / along[:, None, None]
    near, far = ends.min(axis=2).max(axis=2), ends.max(axis=2).min(axis=2)
    pad = 1e-3
    met = int((near - pad <= np.minimum(far + pad, np.inf)).sum())
    hits = int((found["what"][..., 2] == 1).sum())
    if without == () and stage.backend == "vulkan":
        assert hits <= work["tests"] <= met < len(box) * work["rays"] / 20
    else:
        assert work["tests"] == len(box) * work["rays"]


def test_the_picture_is_the_light_of_the_closed_form(stage, without):
    _, picture, _, view = drawn(stage, without)
    t, sphere, sure = truth(view, Settings())
    eye, along = pixel_rays(view, SIZE)
    ground = sure & (sphere == 0) & np.isfinite(t)
    normals = (eye + t[ground, None] * along[ground] + (0, GROUND, 0)) / GROUND
    light = 0.45 * (0.15 + 0.85 * np.maximum(normals @ SHADED, 0))
    codes = 255 * (1.055 * light ** (1 / 2.4) - 0.055)
    assert ground.sum() > 1000
    off = np.abs(picture.reshape(-1, picture.shape[-1])[ground, :3] - codes[:, None])
    assert off.max() <= codes_off(stage.device) + 0.6
    assert picture[0, 0, 2] > picture[0, 0, 0]


@pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
def test_intersection_shaders_and_a_kernel_find_the_same(stage):
    if not stage.device.has("ray-tracing"):
        pytest.skip("no ray pipelines here")
    there, here = (drawn(stage, without)[:2] for without in ((), ("ray-tracing",)))
    assert (there[0]["what"] == here[0]["what"]).all()
    assert np.abs(there[0]["color"] - here[0]["color"]).max() < 1e-5
    assert np.abs(there[1].astype(int) - here[1]).max() <= 1


def test_from_within_the_ground_its_inside_is_seen(stage, without):
    eye = np.array([0.0, -GROUND, 0.0])
    view = View(pose_looking_at(tuple(eye), (0.0, -GROUND, -10.0)), Perspective(yfov=0.8))
    found, *_ = drawn(stage, without, view)
    assert (found["what"][..., :3] == (0, 1, 1)).all()
    assert np.abs(found["color"][..., 3] / GROUND - 1).max() < 1e-6


def far(stage, without, discriminant):
    """Return the share of sure pixels with a wrong sphere, from 4 km away with a narrow lens."""
    view = View(pose_looking_at((0.0, 1500.0, 3700.0), (0.0, 0.0, 0.0)), Perspective(yfov=6 / 4000))
    found, *_ = drawn(stage, without, view, discriminant=discriminant)
    t, sphere, sure = truth(view, Settings())
    same = (found["what"][..., 0].ravel() == sphere) & (
        (found["color"][..., 3].ravel() >= 0) == np.isfinite(t)
    )
    small = sure & (sphere > 0)
    assert small.sum() > 100
    return 1 - same[small].mean()


def test_the_usual_discriminant_loses_small_spheres_that_are_far_away(stage, without):
    """f f is 1.6e7, whose steps are 1, against a squared radius of 0.04. Lengths across the ray have steps of 2^-12."""
    assert far(stage, without, "stable") < 0.02
    assert far(stage, without, "usual") > 0.3


def test_boxes_hold_their_spheres():
    places = spheres(Settings(spheres=500))
    box = boxes(places).astype(np.float64)
    exact = places.astype(np.float64)
    assert (box[:, :3] <= exact[:, :3] - exact[:, 3:]).all() and (
        box[:, 3:] >= exact[:, :3] + exact[:, 3:]
    ).all()
    assert np.abs((box[:, 3:] - box[:, :3]) / (2 * exact[:, 3:]) - 1).max() < 1e-5
    on = np.linalg.norm(exact[1:, :3] + (0, GROUND, 0), axis=1) - GROUND
    assert np.abs(on / exact[1:, 3] - 1).max() < 1e-3


def test_another_size_has_the_pixels_of_a_new_renderer(stage, without):
    with stage.open(WHICH, (33, 20), settings=Settings(spheres=9), without=without) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view)
        renderer.resize(SIZE)
        frames = [renderer.render(view) for _ in range(3)]
        found, work = renderer.pixels(), frames[-1].work
    expected, _, same, _ = drawn(stage, without, spheres=9)
    assert (found == expected).all() and work["tests"] == same["tests"] > 0


@pytest.mark.parametrize("asked", ["spheres=0", "spheres=5000", "discriminant=best"])
def test_what_is_no_choice_is_refused_in_one_sentence(asked):
    with pytest.raises(SettingError, match=asked.partition("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
