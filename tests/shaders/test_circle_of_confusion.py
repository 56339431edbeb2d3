"""The thin lens of `shaders/circle_of_confusion.glsl` against rays that are traced through one in float64."""

from __future__ import annotations

import numpy as np

from tests.support.gpu_functions import evaluate, ulps

SENSOR = 0.024
COUNT = 4000


def radius_px(focal_px, height, f_number, focus, distance):
    """Return the signed radius in pixels, by tracing the ray through the rim of the lens in float64.

    The lens is at 0, the sensor at v behind it, where what is at `focus` is sharp. A ray from a point on the axis at
    `distance` through the lens's rim, at height A/2, leaves towards the point's image at z'; where it meets the sensor
    is the rim of the disc. Nothing here is the shader's closed form.
    """
    v = focal_px * SENSOR / height
    f = 1.0 / (1.0 / v + 1.0 / focus)
    rim = 0.5 * f / f_number
    with np.errstate(divide="ignore", invalid="ignore"):
        per_image = 1.0 / f - 1.0 / distance  # 1 / z': 0 for a point in the front focal plane
    at_sensor = (
        rim - v * rim * per_image
    )  # height of the ray at v: straight from the rim towards height 0 at z'
    # Before the focus the image lies behind the sensor, and the ray has not crossed the axis yet.
    return -at_sensor * height / SENSOR


def cases(seed=1):
    """Return random lenses and distances, float32: pictures of 64 to 2160 rows, f/0.5 to f/32, 1 cm to 10 km."""
    rng = np.random.default_rng(seed)
    height = np.float32(rng.integers(64, 2161, COUNT))
    return {
        "focal_px": np.float32(height * 10.0 ** rng.uniform(-0.5, 1.0, COUNT)),
        "height": height,
        "f_number": np.float32(2.0 ** rng.uniform(-1, 5, COUNT)),
        "per_focus": np.float32(10.0 ** rng.uniform(-4, 1, COUNT)),
        "per_distance": np.float32(10.0 ** rng.uniform(-4, 2, COUNT)),
    }


BODY = f"""
    float blur = blur_per_diopter(focal_px, height, {SENSOR}, f_number, per_focus);
    radius = circle_of_confusion(per_distance, per_focus, blur, 1e30);
"""


def test_a_radius_is_that_of_the_ray_through_the_rim(vulkan_device):
    given = cases()
    got = evaluate(vulkan_device, ["circle_of_confusion.glsl"], BODY, given, {"radius": "float"})["radius"]
    exact = {name: value.astype(np.float64) for name, value in given.items()}
    truth = radius_px(
        exact["focal_px"],
        exact["height"],
        exact["f_number"],
        1 / exact["per_focus"],
        1 / exact["per_distance"],
    )
    # The difference of two distances' inverses is exact to half a step of the larger; the factor to a few steps.
    size = np.maximum(exact["per_focus"], exact["per_distance"]) / np.abs(
        exact["per_focus"] - exact["per_distance"]
    )
    assert (np.abs(got - truth) <= 2.0**-24 * (8 + size) * np.abs(truth)).all()


def test_what_is_in_focus_is_a_point_what_is_infinitely_far_is_a_disc_and_signs_tell_them_apart(
    vulkan_device,
):
    given = cases(2)
    focus = given["per_focus"]
    body = """
        float blur = blur_per_diopter(focal_px, height, 0.024, f_number, per_focus);
        sharp = circle_of_confusion(per_focus, per_focus, blur, 8.0);
        far = circle_of_confusion(0.0, per_focus, blur, 8.0);
        near = circle_of_confusion(2.0 * per_focus, per_focus, blur, 8.0);
    """
    outputs = {"sharp": "float", "far": "float", "near": "float"}
    got = evaluate(vulkan_device, ["circle_of_confusion.glsl"], body, given, outputs)
    assert not got["sharp"].any()
    assert (got["far"] > 0).all() and got["far"].max() == 8.0, "held at the largest"
    assert np.array_equal(got["near"], -got["far"]), "half the distance is as blurred as infinity"
    assert (focus > 0).all()


def test_a_stop_halves_the_area(vulkan_device):
    """From f/2 to f/2.8 the disc has half the area: its radius is inversely proportional to the f-number."""
    given = cases(3)
    wide = evaluate(vulkan_device, ["circle_of_confusion.glsl"], BODY, given, {"radius": "float"})["radius"]
    given["f_number"] = given["f_number"] * np.float32(2.0)
    narrow = evaluate(vulkan_device, ["circle_of_confusion.glsl"], BODY, given, {"radius": "float"})["radius"]
    assert ulps(narrow, wide.astype(np.float64) / 2).max() <= 2


def test_the_blurred_part_begins_with_a_pixel_and_rises_to_all(vulkan_device):
    radius = np.float32(np.r_[np.linspace(-4, 4, 801), np.inf, -np.inf, 0.5, -0.5, 2.0])
    part = evaluate(
        vulkan_device,
        ["circle_of_confusion.glsl"],
        "part = blurred_part(radius);",
        {"radius": radius},
        {"part": "float"},
    )["part"]
    size = np.abs(radius.astype(np.float64))
    assert (part[size <= 0.5] == 0.0).all()
    assert (part[size >= 2.0] == 1.0).all()
    order = np.argsort(size, kind="stable")
    assert (np.diff(part[order]) >= 0.0).all()
