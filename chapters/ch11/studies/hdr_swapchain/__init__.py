"""Study: the last pass for a display of high dynamic range. It sends luminance in nits, not fractions of white.

    scene light -> nits (1.0 is paper white) -> rolled off to the display's peak -> the signal of the surface

A surface offers pairs of a format and a colour space. The study takes the first of these that is there:

    HDR10   10 bits, primaries of Rec. 2020, codes of SMPTE ST 2084 (PQ), whose code 1 is 10,000 nits
    scRGB   half floats, primaries of Rec. 709, linear, where 1.0 is 80 nits
    sRGB    8 bits; the brightest code is paper white, so its peak is paper white, whatever `peak` says

A window whose surface takes the encoding shows the encoded image itself. A file, and a window of another encoding, has
a picture of the signal of each strip of the scene: clipped as on a display of 8 bits, as numbers, as luminance in false
colours from 0.1 (black) to 10,000 nits (white), and as a curve. The output `encoded` is the signal in numbers.

On OpenGL a window has no surface of high dynamic range: GLFW asks for no colour space and for no half floats. Software
drivers offer pairs of sRGB only. The study says which pair was chosen, and why.

Sources: SMPTE ST 2084:2014; ITU-R BT.2100-2; ITU-R BT.2408-5 (paper white of 203 nits); IEC 61966-2-2 (scRGB).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import SettingError, UnsupportedError
from common.lessons import Study
from common.scene import Sampler
from common.settings import knob

from .gamut import REC_709, REC_2020, between

STUDY = Study(
    title="HDR swapchain",
    idea="A display of high dynamic range takes luminance in nits; only the last pass knows its curve and peak.",
    order=1,
    outputs=("color", "encoded"),
)

FORMATS = {"hdr10": "rgb10a2", "scrgb": "rgba16f", "srgb": "rgba8"}
"""The format of the encoded image for each encoding, in the order in which surfaces are asked for them."""

SPOKEN = {"hdr10": "HDR10", "scrgb": "scRGB", "srgb": "8-bit sRGB"}

WRITES = {
    "hdr10": "the last pass writes PQ codes of Rec. 2020, 10 bits each",
    "scrgb": "the last pass writes linear light, where 1.0 is 80 nits",
    "srgb": "the last pass writes sRGB codes, and paper white is the brightest",
}

STRIPS, STOPS = 5, 8
"""Strips of the scene, and factors of two on either side of paper white."""

FOLDER = "studies/hdr_swapchain"
TRIANGLE = "post/fullscreen.vert"
PASSES = {"ramp": f"{FOLDER}/ramp.frag", "encode": f"{FOLDER}/encode.frag", "show": f"{FOLDER}/show.frag"}
TEXELS = Sampler("nearest", "nearest", None, "clamp", "clamp")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    encoding: str = knob(
        "auto", "signal of the last pass; auto takes the window's", choices=("auto", *FORMATS)
    )
    paper_white: float = knob(203.0, "luminance of scene light 1.0", "nits", minimum=1, maximum=10000)
    peak: float = knob(1000.0, "largest luminance of the display", "nits", minimum=1, maximum=10000)
    knee: float = knob(0.5, "share of the peak up to which luminance stays as it is", minimum=0, maximum=0.99)


def check(settings: Settings) -> None:
    """Raise SettingError for a peak below paper white, and for a number that no knob would take."""
    for name, low, high in (("paper_white", 1, 10000), ("peak", 1, 10000), ("knee", 0, 0.99)):
        if not low <= getattr(settings, name) <= high:  # NaN is in no range
            raise SettingError(
                f"{name}={getattr(settings, name):g} is out of range: give {low:g} to {high:g}."
            )
    if settings.peak < settings.paper_white:
        raise SettingError(
            f"peak={settings.peak:g} is below paper_white={settings.paper_white:g}: white would exceed what "
            f"the display can show; raise peak or lower paper_white."
        )


def decide(wanted: str, surface: str | None) -> str:
    """Return the encoding for a setting `wanted` and the encoding of the window's surface, None without a window.

    Without a window `auto` is HDR10, since nothing limits it. A window of 8 bits shows a picture of any encoding.
    Raises UnsupportedError for another encoding than that of a surface of high dynamic range.
    """
    if wanted == "auto":
        return surface or "hdr10"
    if surface not in (None, "srgb", wanted):
        raise UnsupportedError(
            f"This window takes {SPOKEN[str(surface)]}, not {SPOKEN[wanted]}: leave encoding at auto, or run with "
            f"--headless."
        )
    return wanted


def limits(settings: Settings, encoding: str) -> tuple[float, float]:
    """Return the knee and the peak of an encoding, in nits; the peak of sRGB is paper white."""
    peak = settings.paper_white if encoding == "srgb" else settings.peak
    return settings.knee * peak, peak


def defines(settings: Settings, encoding: str) -> tuple[tuple[str, int | float | str], ...]:
    """Return the macros of the shaders."""
    knee, peak = limits(settings, encoding)
    return (
        *((name.upper(), number) for number, name in enumerate(FORMATS)),
        ("ENCODING", list(FORMATS).index(encoding)),
        *(("STRIPS", STRIPS), ("STOPS", STOPS)),
        *(("PAPER_WHITE", settings.paper_white), ("KNEE", float(knee)), ("PEAK", float(peak))),
        *matrices(),
    )


def matrices() -> tuple[tuple[str, str], ...]:
    """Return the macros of both matrices: elements by columns, as GLSL's mat3 takes them."""

    def text(matrix: NDArray[np.float64]) -> str:
        return ", ".join(f"{element:.9g}" for element in matrix.T.reshape(-1))

    return (
        ("REC_2020_FROM_709", text(between(REC_709, REC_2020))),
        ("REC_709_FROM_2020", text(between(REC_2020, REC_709))),
    )
