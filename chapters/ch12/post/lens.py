"""The lens of the camera: what its three passes are built with, and whether there is one at all."""

from __future__ import annotations

from typing import Protocol

from common.scene import Scene

from ..paths.settings import PathSettings
from ..shading.settings import ShadingSettings
from ..shading.views import PICTURE
from .fullscreen import FullscreenPass
from .settings import PostSettings

Defines = tuple[tuple[str, int | float | str], ...]

SENSOR_HEIGHT_M = 0.024
"""Height of the sensor, that of 35 mm film: with it an f-number means what it means to a photographer."""

LARGEST_RADIUS = 0.06
"""Radius at most of a circle of confusion, in heights of the picture: its cost grows with the square."""

FORMAT = "rgba16f"
"""Of everything that is blurred. A radius of 64 pixels, more than there are in 1000 rows, is kept to 1/32 of one."""

PART_FORMAT = "r8"
"""Of the part of a pixel that is covered: quarters, where nothing is between two radii."""


class Settings(Protocol):
    """The settings of the lens."""

    shading: ShadingSettings
    post: PostSettings
    paths: PathSettings


def needed(scene: Scene, settings: Settings) -> bool:
    """Whether anything can be out of focus: not through a pinhole, and not where a view shows numbers."""
    # Paths go through the lens themselves.
    drawn = settings.shading.view == PICTURE and not settings.paths.path_tracer
    return settings.post.aperture > 0.0 and drawn and len(scene.instances) > 0


def lens_defines(settings: Settings) -> Defines:
    """Return what shaders are built with that include circle_of_confusion.glsl; a focus at 0 is found by the shader."""
    return (
        ("F_NUMBER", settings.post.aperture),
        ("FOCUS_DISTANCE", settings.post.focus_distance),
        ("SENSOR_HEIGHT", SENSOR_HEIGHT_M),
        ("LARGEST_RADIUS", LARGEST_RADIUS),
    )


def bokeh_defines(settings: Settings) -> Defines:
    """Return what bokeh.frag is built with."""
    return (("LARGEST_RADIUS", LARGEST_RADIUS), ("TAPS", settings.post.bokeh_taps))


class LensPass(FullscreenPass):
    """One of the lens's three passes."""

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether the lens has an opening, and there is anything before it."""
        return needed(scene, settings)
