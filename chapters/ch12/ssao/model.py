"""What ambient occlusion is built with, and whether a frame has any; needs no device."""

from __future__ import annotations

from typing import Any

from common.scene import Scene

Defines = tuple[tuple[str, int | float | str], ...]
Constants = tuple[tuple[str, int | float], ...]

RESULT = "ambient_occlusion"
"""The image that the lighting pass reads: the part of the light from everywhere that reaches each pixel."""

RAW = "ambient_occlusion_raw"
"""The same before the blur, with the pattern of 4x4 pixels."""

FORMAT = "r8"
"""Of both, and of the picture between the two passes of the blur: steps of 1/255, which is what a screen shows."""

BLUR_TOLERANCE = 0.1
"""How far a distance may be from the plane of the pixel's surface for the blur to take it in full, in radii."""


def wanted(settings: Any) -> bool:
    """Whether the settings ask for occlusion that can be seen; a view shows a quantity of a surface, and no light."""
    knobs = settings.ssao
    shown = settings.shading.view == "picture"
    return bool(knobs.mode != "off" and knobs.scale > 0 and knobs.radius > 0 and shown)


def needed(scene: Scene, settings: Any) -> bool:
    """Whether a frame computes occlusion: it is wanted, and there are surfaces and light from everywhere."""
    return wanted(settings) and len(scene.instances) > 0 and _is_surrounded(scene, settings)


def _is_surrounded(scene: Scene, settings: Any) -> bool:
    """Whether any light comes from everywhere: of an environment, of a setting, of the scene, or a default."""
    if scene.environment is not None and settings.environment.intensity > 0:
        return True
    if settings.scene.ambient >= 0:
        return bool(settings.scene.ambient > 0)
    if scene.ambient is not None:
        return scene.ambient > 0
    return any(
        light.name == "default light" for light in scene.lights
    )  # which brings some (scene/default_light.py)


def trace_defines(settings: Any) -> Defines:
    """Return what ssao.frag is built with; the mode decides which images it reads, so it is no constant."""
    return (("NORMALS", 1),) if settings.ssao.mode == "normals" else ()


def trace_constants(settings: Any) -> Constants:
    """Return the specialization constants of ssao.frag: numbers alone, so that a slider compiles no text again."""
    rays: Constants = (("RAY_STEPS", settings.ssao.steps),) if settings.ssao.mode == "normals" else ()
    return (("OCCLUSION_RADIUS", settings.ssao.radius), *rays)


def blur_constants(settings: Any, step: tuple[int, int]) -> Constants:
    """Return the specialization constants of ssao_blur.frag; `step` is from tap to tap, in pixels."""
    tolerance = BLUR_TOLERANCE * settings.ssao.radius
    return (("STEP_X", step[0]), ("STEP_Y", step[1]), ("DISTANCE_TOLERANCE", tolerance))


def light_defines(scene: Scene, settings: Any) -> Defines:
    """Return what lighting.frag is built with to read the result: bias and scale, or nothing.

    Rays of a hemisphere estimate the visible part itself; only the estimate from depth alone takes a bias.
    """
    if not needed(scene, settings):
        return ()
    bias = settings.ssao.bias if settings.ssao.mode == "depth" else 0.0
    return (("OCCLUSION_BIAS", bias), ("OCCLUSION_SCALE", settings.ssao.scale))
