"""Which passes finish the picture, and what their shaders are built with.

    color_bloomed -> motion_blur -> color_blurred -> sharpen -> color_focused -> tonemap -> color
                                                                               tonemap -> color_toned -> fxaa -> color

Motion blur and sharpening work on linear light, before the tone curve. A shutter adds up light, and a lamp that moves
leaves a bright streak. Sharpening is last of the two: blur that is meant is wider than its 3x3 pixels. FXAA needs the
codes that are seen, so it follows the tone curve. The last pass, `tonemap` or `fxaa`, also dithers and splits the view.
"""

from __future__ import annotations

from typing import Protocol

from backends.contract import Access, Sources

from ..scene.data import BEHIND_SCENE
from ..shading.settings import ShadingSettings
from ..shading.views import PICTURE
from .settings import RAW, PostSettings

Defines = tuple[tuple[str, int | float | str], ...]

TONED = "color_toned"
"""The picture between tone curve and FXAA."""

LEAST_CONTRAST = 1 / 24
"""Luma below which no contrast is an edge: about 10 of 255 codes."""


class Settings(Protocol):
    """The settings of the finished picture."""

    shading: ShadingSettings
    post: PostSettings


def shows_picture(settings: Settings) -> bool:
    """Whether a frame shows the picture: a view of a quantity is shown as it is."""
    return settings.shading.view == PICTURE


def has_motion_blur(settings: Settings) -> bool:
    """Whether the shutter is open for any time."""
    return settings.post.motion_blur > 0.0 and shows_picture(settings)


def has_fxaa(settings: Settings) -> bool:
    """Whether the settings want FXAA."""
    return settings.post.fxaa and shows_picture(settings)


def toned_format(settings: Settings) -> str:
    """Return the format between tone curve and FXAA: that of the picture, or more bits for a dither to round."""
    return "rgba16f" if settings.post.dither > 0.0 else "rgba8"


def last_reads(settings: Settings) -> tuple[Access, ...]:
    """Return what the last pass reads besides the picture."""
    splits = settings.post.split != "off" and shows_picture(settings)
    return (Access(RAW, "sampled"),) if splits else ()


def last_sources(settings: Settings) -> Sources:
    """Return the sources of the last pass: behind those of the scene, if it reads the number of the frame."""
    dithers = settings.post.dither > 0.0 and shows_picture(settings)
    return BEHIND_SCENE if dithers else Sources()


def last_defines(settings: Settings, reads: tuple[Access, ...]) -> Defines:
    """Return what finish.glsl is built with, for a pass with these reads; nothing if it has nothing to do."""
    knobs = settings.post
    if not shows_picture(settings):
        return ()
    dither: Defines = (("DITHER", knobs.dither),) if knobs.dither > 0.0 else ()
    if knobs.split == "off":
        return dither
    (raw,) = (number for number, access in enumerate(reads) if access.resource == RAW)
    axis = ("columns", "rows").index(knobs.split)
    return (*dither, ("SPLIT", axis), ("SPLIT_AT", knobs.split_at), ("RAW", raw))


def display_defines(settings: Settings) -> Defines:
    """Return what tonemap.frag is built with around the tone curve; nothing for an exposure and a gamma of 1."""
    knobs = settings.post
    if not shows_picture(settings):
        return ()
    exposure: Defines = (
        (("DISPLAY_EXPOSURE", knobs.display_exposure),) if knobs.display_exposure != 1.0 else ()
    )
    return exposure + ((("DISPLAY_GAMMA", knobs.display_gamma),) if knobs.display_gamma != 1.0 else ())
