"""The study phong against its closed forms in double precision: functions over arrays, pictures of a flat square."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.studies.phong import LAMP_COLOR, SPOT_COLOR, SPOT_PLACE, Settings
from common.images.color import decode_srgb, encode_srgb
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.view.camera import Perspective, View
from tests.support.bounds import codes_off
from tests.support.scenes import quad_scene

SIZE = (32, 32)
BASE = (0.9, 0.6, 0.25, 1.0)
EYE = np.array([0.3, -0.2, 2.5])
VIEW = View(pose_looking_at(EYE, (0.3, -0.2, 0.0)), Perspective(math.radians(40.0), 0.1))
RADIUS = math.sqrt(2)  # of the sphere around the square
SHOWN = Settings(brightness=0.25, shininess=12.0, cone_deg=15.0, softness=0.5)


def functions(stage, body: str, inputs: dict[str, np.ndarray]) -> np.ndarray:
    return stage.evaluate("phong/phong.glsl", body, inputs, {"value": "float"})["value"]


def at(degrees: np.ndarray) -> np.ndarray:
    """Return unit vectors (N, 3) in the xz plane at angles from z."""
    angle = np.radians(degrees)
    return np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1).astype(np.float32)


@pytest.mark.feature("lighting/phong")
def test_diffuse_and_specular_meet_their_closed_forms(stage):
    light = np.array([0.0, 60.0, 90.0, 120.0])
    up = np.tile(np.float32((0, 0, 1)), (4, 1))
    got = functions(stage, "value = phong_diffuse(n, l);", {"n": up, "l": at(light)})
    assert np.abs(got - [1.0, 0.5, 0.0, 0.0]).max() < 1e-6
    # The mirrored light is at -angle: towards an eye there the highlight is whole, 30 degrees aside it is cos(30)^p.
    light, eye, power = np.meshgrid([0.0, 25.0, 60.0], np.arange(-80.0, 81.0, 10.0), [1.0, 8.0, 64.0])
    light, eye, power = light.ravel(), eye.ravel(), power.ravel()
    inputs = {
        "n": np.tile(up[:1], (len(eye), 1)),
        "l": at(light),
        "v": at(eye),
        "p": power.astype(np.float32),
    }
    got = functions(stage, "value = phong_specular(n, l, v, p);", inputs)
    expected = np.maximum(np.cos(np.radians(eye + light)), 0) ** power
    assert np.abs(got - expected).max() < 2e-5 and expected.max() == 1
    behind = {"n": up[:1], "l": at(np.array([100.0])), "v": at(np.array([-80.0])), "p": np.float32([4])}
    assert functions(stage, "value = phong_specular(n, l, v, p);", behind) == 0


@pytest.mark.feature("lighting/punctual-lights")
@pytest.mark.feature("lighting/phong")
def test_attenuation_and_cone_meet_their_closed_forms(stage):
    distance = np.array([0.0, 0.5, 2.0, 10.0], np.float32)
    terms = np.tile(np.float32((1.0, 0.2, 0.1)), (4, 1))
    got = functions(stage, "value = polynomial_attenuation(d, t);", {"d": distance, "t": terms})
    assert np.abs(got - [1.0, 1 / 1.125, 1 / 1.8, 1 / 13]).max() < 1e-6
    assert np.abs(got[2:] - 1 / distance[2:] ** 2).min() > 0.05, (
        "the square of the distance alone is another law"
    )
    cosines = np.tile(np.float32((0.5, 0.75)), (5, 1))
    cosine = np.array([0.4, 0.5, 0.5625, 0.625, 0.8], np.float32)
    got = functions(stage, "value = smooth_cone(c, b);", {"c": cosine, "b": cosines})
    assert np.abs(got - [0.0, 0.0, 0.15625, 0.5, 1.0]).max() < 1e-6  # t^2 (3 - 2 t) at a quarter is 10/64
    edges = np.cos(np.radians([30.0, 25.0]))  # 0.8660 and 0.9063
    cosine = edges[0] + np.float32([-0.1, 0.0, 0.25, 0.5, 1.0, 1.2]) * (edges[1] - edges[0])
    inputs = {"c": cosine.astype(np.float32), "b": np.tile(np.float32(edges), (6, 1))}
    got = functions(stage, "value = smooth_cone(c, b);", inputs)
    assert np.abs(got - [0.0, 0.0, 0.15625, 0.5, 1.0, 1.0]).max() < 1e-5


def truth(settings: Settings, time: float, base: tuple[float, ...] = BASE) -> dict[str, np.ndarray]:
    """Return the light (32, 32, 3) of lamp and spot on the square from -1 to 1 at z = 0, and where it is seen."""
    axis = ((np.arange(32) + 0.5) / 32 * 2 - 1) * math.tan(math.radians(20.0)) * EYE[2]
    x, y = np.meshgrid(EYE[0] + axis, EYE[1] - axis)
    place = np.stack([x, y, 0 * x], axis=-1)
    to_eye = EYE - place
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    lamp = 2 * RADIUS * np.array([math.sin(time), 1.0, math.cos(time)]) / math.sqrt(2)
    found = {"seen": (np.abs(x) < 0.999) & (np.abs(y) < 0.999)}
    for name, light, color in (("lamp", lamp, LAMP_COLOR), ("spot", SPOT_PLACE * RADIUS, SPOT_COLOR)):
        away = light - place
        distance = np.linalg.norm(away, axis=-1)
        direction = away / distance[..., None]
        mirrored = direction * (-1, -1, 1)
        cosine = direction[..., 2].clip(0, None)
        peak = (mirrored * to_eye).sum(axis=-1).clip(0, None) ** settings.shininess * (cosine > 0)
        cone = 1.0
        if name == "spot":
            outer = math.radians(settings.cone_deg)
            low, high = math.cos(outer), math.cos(outer * (1 - settings.softness))
            t = ((direction @ SPOT_PLACE / np.linalg.norm(SPOT_PLACE) - low) / (high - low)).clip(0, 1)
            cone = t * t * (3 - 2 * t)
        d = distance / RADIUS
        fade = settings.brightness / (1 + settings.linear * d + settings.quadratic * d * d)
        matt = settings.ambient + cone * cosine
        gloss = cone * settings.specular * peak
        reflected = np.array(base[:3]) * matt[..., None] + gloss[..., None]
        found[name] = reflected * color * fade[..., None]
    return found


@pytest.mark.feature("lighting/phong")
def test_the_picture_of_two_lights_is_the_sum_of_theirs_before_clamping(stage):
    scene = quad_scene(Material(base_color=BASE))
    expected = truth(SHOWN, 0.9)
    seen = expected.pop("seen")
    assert seen.mean() > 0.5
    pictures = {}
    for which in ("lamp", "spot", "both"):
        settings = replace(SHOWN, lights=which)
        pictures[which] = stage.draw("phong", SIZE, 0.9, VIEW, scene=scene, settings=settings)["color"][seen]
        light = expected["lamp"] + expected["spot"] if which == "both" else expected[which]
        assert (
            np.abs(pictures[which] - 255 * encode_srgb(light.clip(0, 1))[seen]).max()
            <= codes_off(stage.device) + 0.05
        )
    # The codes alone say the same, as far as their rounding lets them.
    codes = {name: picture.astype(np.float64) for name, picture in pictures.items()}
    assert codes["both"].max() < 255
    off = codes_off(stage.device) + 0.05
    low, high = (
        {name: decode_srgb((code + side).clip(0, 255) / 255) for name, code in codes.items()}
        for side in (-off, off)
    )
    assert (low["lamp"] + low["spot"] <= high["both"]).all()
    assert (low["both"] <= high["lamp"] + high["spot"]).all()
    assert (low["both"] > np.maximum(high["lamp"], high["spot"])).any(), (
        "one light in place of two is noticed"
    )


def test_what_is_too_bright_is_cut_off_after_the_sum(stage):
    """Each light alone is shown whole; together they are more than white, and become white, not less."""
    base, time = (0.9, 0.9, 0.9, 1.0), 5.5  # the lamp on the spot's side
    bright = replace(SHOWN, brightness=1.4, specular=0.0, cone_deg=30.0)
    expected = truth(bright, time, base)
    light, seen = expected["lamp"] + expected["spot"], expected["seen"]
    green = [each[seen][:, 1].max() for each in (expected["lamp"], expected["spot"], light)]
    assert max(green[:2]) < 1 < green[2]
    scene = quad_scene(Material(base_color=base))
    picture = stage.draw("phong", SIZE, time, VIEW, scene=scene, settings=bright)["color"]
    assert np.abs(picture - 255 * encode_srgb(light.clip(0, 1)))[seen].max() <= codes_off(stage.device) + 0.05
