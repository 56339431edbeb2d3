"""The study reflection-refraction against the laws of Snell and Fresnel, and rays into its panorama, in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chapters.ch01.studies.reflection_refraction import RADIUS, Settings, around
from common.environment.directions import panorama_uv
from common.images.color import encode_srgb
from common.numerics.transforms import pose_looking_at
from common.view.camera import Orthographic, Perspective, View

FILE = "reflection_refraction/optics.glsl"
SIZE = (36, 24)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def snell(d: np.ndarray, n: np.ndarray, eta: float) -> np.ndarray:
    """Return d (N, 3) bent at surfaces of normals n: by angles in the plane of both, NaN where nothing passes."""
    along = d - (d * n).sum(-1, keepdims=True) * n
    sine = np.linalg.norm(along, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore"):
        angle = np.arcsin(eta * sine)
    return np.sin(angle) * along / np.maximum(sine, 1e-300) - np.cos(angle) * n


def crossing(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Return unit directions and normals that face them, float32."""
    random = np.random.default_rng(3)
    d, n = unit(random.normal(size=(count, 3))), unit(random.normal(size=(count, 3)))
    n *= -np.sign((d * n).sum(-1, keepdims=True))
    return d.astype(np.float32), n.astype(np.float32)


@pytest.mark.feature("environment/reflection-refraction")
def test_the_mirrored_part_is_fresnels_at_the_normal_all_at_grazing_and_schlicks_between(stage):
    cosine = np.array([1.0, 0.5, 0.25, 0.0, 1.0], np.float32)
    eta = np.array([1 / 1.31, 1 / 1.31, 1 / 1.31, 1 / 1.31, 1.31], np.float32)
    got = stage.evaluate(FILE, "f = schlick_share(e, c);", {"e": eta, "c": cosine}, {"f": "float"})["f"]
    f0 = ((1.31 - 1) / (1.31 + 1)) ** 2
    assert abs(got[0] - 0.018009) < 1e-6
    expected = [f0, f0 + (1 - f0) / 32, f0 + (1 - f0) * 0.75**5, 1.0, f0]  # the same from inside
    assert np.abs(got - expected).max() < 1e-6


@pytest.mark.feature("environment/reflection-refraction")
@pytest.mark.parametrize("eta", [1 / 1.31, 1 / 2.4, 1.31])
def test_rays_match_the_reference(stage, eta):
    d, n = crossing()
    inputs = {"d": d, "n": n, "e": np.full(len(d), eta, np.float32)}
    body = "m = mirrored_ray(d, n); b = bent_ray(d, n, e); g = refract(d, n, e);"
    got = stage.evaluate(FILE, body, inputs, {"m": "vec3", "b": "vec3", "g": "vec3"})
    exact_d, exact_n = d.astype(np.float64), n.astype(np.float64)
    turned = exact_d - 2 * (exact_d * exact_n).sum(-1, keepdims=True) * exact_n
    assert np.abs(got["m"] - turned).max() < 1e-6
    expected = snell(exact_d, exact_n, np.float64(np.float32(eta)))
    trapped = np.isnan(expected[:, 0])
    assert (trapped.any()) == (eta > 1)
    assert (got["b"][trapped] == 0).all()
    # Near the critical angle the root of a small difference has few digits left: of k's 1e-7, the root is 3e-4.
    k = 1 - eta**2 * (1 - (exact_d * exact_n).sum(-1) ** 2)
    sure = k > 0.01
    assert np.abs(got["b"] - expected)[sure].max() < 5e-6 and sure.mean() > 0.3
    turned_about = snell(exact_d, exact_n, np.float64(1 / np.float32(eta)))
    assert np.nanmax(np.abs(got["b"] - turned_about)[sure]) > 0.1, (
        "the quotient the wrong way round is noticed"
    )
    assert np.abs(got["b"] - got["g"])[sure].max() < 5e-6, "GLSL's own"


@pytest.mark.feature("environment/reflection-refraction")
def test_a_ray_leaves_a_ball_turned_twice_by_the_same_angle(stage):
    """The deviation of a ray through a ball is 2 (angle outside - angle inside): where rainbows begin."""
    d, n = crossing()
    inputs = {"d": d, "n": n}
    body = "r = leaving_ray(bent_ray(d, n, 1.0 / 1.31), n, 1.31);"
    got = stage.evaluate(FILE, body, inputs, {"r": "vec3"})["r"].astype(np.float64)
    outside = np.arccos(np.clip(-(d.astype(np.float64) * n).sum(-1), 0, 1))
    turned = 2 * (outside - np.arcsin(np.sin(outside) / 1.31))
    assert np.abs((got * d).sum(-1) - np.cos(turned)).max() < 1e-4  # the worst: those that graze
    assert np.abs(np.linalg.norm(got, axis=-1) - 1).max() < 1e-5
    assert np.abs((np.cross(d, n) * got).sum(-1)).max() < 1e-5, "in the plane of ray and normal"


def looked_up(panorama: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Return light from directions (..., 3), mixed of four texels as a sampler does: round in u, ending in v."""
    height, width = panorama.shape[:2]
    place = panorama_uv(directions) * (width, height) - 0.5
    corner = np.floor(place).astype(int)
    part = place - corner
    light = np.zeros(directions.shape)
    for x in (0, 1):
        for y in (0, 1):
            weight = np.where(x, part[..., 0], 1 - part[..., 0]) * np.where(y, part[..., 1], 1 - part[..., 1])
            row, column = (corner[..., 1] + y).clip(0, height - 1), (corner[..., 0] + x) % width
            light += weight[..., None] * panorama[row, column]
    return light


def truth(
    settings: Settings, view: View, half: tuple[float, float], flat: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return light (24, 36, 3), and the pixels near the rim, where a ray that grazes has few digits."""
    x = ((np.arange(SIZE[0]) + 0.5) / SIZE[0] * 2 - 1) * half[0]
    y = (1 - (np.arange(SIZE[1]) + 0.5) / SIZE[1] * 2) * half[1]
    x, y = np.meshgrid(x, y)
    turn, eye = view.world_from_view[:3, :3], view.world_from_view[:3, 3]
    ends = np.stack([x, y, np.zeros_like(x) if flat else -np.ones_like(x)], axis=-1) @ turn.T
    origin = eye + ends if flat else np.broadcast_to(eye, ends.shape)
    d = np.broadcast_to(-turn[:, 2], ends.shape) if flat else unit(ends)
    b = (origin * d).sum(-1)
    root = b * b - (origin**2).sum(-1) + RADIUS**2
    n = unit(origin + (-b - np.sqrt(np.maximum(root, 0)))[..., None] * d)
    bent = snell(d, n, 1 / settings.index)
    out = n - 2 * (n * bent).sum(-1, keepdims=True) * bent
    if settings.surfaces == 2:
        bent = snell(bent, -out, settings.index)
    f0 = ((settings.index - 1) / (settings.index + 1)) ** 2
    share = (f0 + (1 - f0) * (1 + (d * n).sum(-1)).clip(0, 1) ** 5)[..., None]
    panorama = around(settings).radiance.astype(np.float64) * settings.brightness
    mirrored = looked_up(panorama, d - 2 * (d * n).sum(-1, keepdims=True) * n)
    with np.errstate(invalid="ignore"):
        passed = looked_up(panorama, np.nan_to_num(bent))
    show = {"both": (1, 1), "reflected": (1, 0), "refracted": (0, 1)}[settings.show]
    ball = show[0] * share * mirrored + show[1] * (1 - share) * passed
    light = np.where((root > 0)[..., None], ball, looked_up(panorama, d))
    return light, np.abs(root) < 0.03


@pytest.mark.parametrize(
    "settings",
    [Settings(), Settings(show="reflected"), Settings(index=1.5, surfaces=1), Settings(show="refracted")],
)
def test_the_picture_is_that_of_rays_into_the_panorama(stage, settings):
    eye = np.array([0.6, 0.5, 2.6])
    if settings.surfaces == 2:
        tangent = math.tan(math.radians(25.0))
        view = View(pose_looking_at(eye, (0, 0, 0)), Perspective(math.radians(50.0), 0.1))
        expected, rim = truth(settings, view, (tangent * 1.5, tangent), flat=False)
    else:
        view = View(pose_looking_at(eye, (0, 0, 0)), Orthographic(1.0, 0.1, 10.0))
        expected, rim = truth(settings, view, (1.5, 1.0), flat=True)
    picture = stage.draw("reflection-refraction", SIZE, 0.0, view, settings=settings)["color"]
    apart = np.abs(picture - 255 * encode_srgb(expected.clip(0, 1)))
    # A sampler mixes texels in steps of 1/256; beside the sun, 10,000 times the sky, that is everything.
    apart = apart[~rim].max(axis=-1)
    assert np.mean(apart <= 1.0) > 0.98
    assert np.median(apart) <= 0.5 and rim.mean() < 0.1
