"""Exposure and bloom without a device: the histogram's range, the limits, and how long adaptation goes on.

A picture value is luminance times exposure. The view gives the exposure as EV100: E = 1 / (1.2 * 2^EV100). An automatic
exposure maps an average luminance L to a key value k: E = k / L, so log2 E = log2 k - log2 L. Its limits are EV100s.
"""

from __future__ import annotations

import math

from common.errors import UserError
from common.scene import Scene

from ..environment import model as environment
from ..settings import Settings
from ..shading.views import PICTURE
from ..taa import model as taa
from .settings import HISTOGRAM, MIPS, VIEW, HdrSettings

Defines = tuple[tuple[str, int | float | str], ...]

BINS = 256
"""Bins of the histogram of log2 luminance, and invocations of the group that reads it."""

LOG2_RANGE = (-16.0, 20.0)
"""The range of the histogram: log2 of luminance in nits, from starlight on a dark surface to one million nits."""

SIDE = 64
"""Texels along an edge of the luminance image whose mip chain gives the mean."""

MIP_FLOATS = sum(size * size for size in (64, 32, 16, 8, 4, 2, 1))
"""Floats of the luminance image and its levels, one behind the other."""

MOST_LEVELS = 6
"""Levels of the bloom pyramid at most; the graphs name a pass for each."""

REST_STOPS = 1.0 / 256.0
"""Adaptation rests where at most this many stops are left: a step of 0.3 %, which no 8-bit picture shows."""


LEAST_SHARE = 0.01
"""Percent between the two percentiles, at least: shares of a picture are 32-bit numbers."""


def check(hdr: HdrSettings) -> None:
    """Raise UserError if limits of the exposure contradict each other."""
    low, high = hdr.exposure_low, hdr.exposure_high
    if high - low < LEAST_SHARE:
        raise UserError(
            f"exposure_low={low:g} leaves nothing below exposure_high={high:g}: set one that is lower by "
            f"{LEAST_SHARE:g} at least."
        )
    low, high = hdr.exposure_min_ev, hdr.exposure_max_ev
    if low > high:
        raise UserError(f"exposure_min_ev={low:g} is above exposure_max_ev={high:g}: set a lower one.")


def automatic(settings: Settings) -> str:
    """Return how the GPU finds the exposure: "histogram" or "mips"; "" where the view gives it.

    A view of a quantity has no exposure.
    """
    mode = settings.hdr.exposure
    return mode if mode != VIEW and settings.shading.view == PICTURE else ""


def has_bloom(settings: Settings) -> bool:
    """Whether light spreads; a view of a quantity is shown as it is."""
    return settings.hdr.bloom > 0.0 and settings.shading.view == PICTURE


def skips_empty(scene: Scene, settings: Settings) -> bool:
    """Whether the background is no light: a pixel without a surface shows a grey, not a sky."""
    return not (settings.shading.sky and environment.needed(scene, settings))


def log2_exposure(ev100: float) -> float:
    """Return log2 of the exposure of an EV100: see `common.view.camera.exposure`."""
    return -math.log2(1.2) - ev100


def exposure_defines(settings: Settings) -> Defines:
    """Return the defines of the kernels that measure and adapt."""
    hdr = settings.hdr
    lowest, highest = LOG2_RANGE
    return (
        ("BINS", BINS),
        ("LOG2_LOWEST", lowest),
        ("BIN_WIDTH", (highest - lowest) / BINS),
        ("SIDE", SIDE),
        ("MIP_FLOATS", MIP_FLOATS),
        ("KEY", hdr.exposure_key),
        ("LOW", hdr.exposure_low / 100.0),
        ("HIGH", hdr.exposure_high / 100.0),
        ("LOG2_LEAST", log2_exposure(hdr.exposure_max_ev)),
        ("LOG2_MOST", log2_exposure(hdr.exposure_min_ev)),
        ("ADAPT_DARK_S", hdr.adapt_dark_s),
        ("ADAPT_BRIGHT_S", hdr.adapt_bright_s),
        ("ADAPT_SPEED", hdr.adapt_speed),
        ("MODE_MIPS", int(automatic(settings) == MIPS)),
        *((("ENLARGED", 3),) * (taa.scale(settings) < 1.0)),
    )


def rest_after_s(settings: Settings) -> float:
    """Return the seconds after a change of the picture after which adaptation rests; 0 without adaptation.

    In the histogram's mode the distance to the target falls as exp(-t / tau), in stops. At most the whole range of
    exposures is to be covered. In the book's mode luminance itself falls so, and the worst case is the way from the
    brightest picture to the darkest one: the error has to fall below a part of the *target*.
    """
    hdr, mode = settings.hdr, automatic(settings)
    span = hdr.exposure_max_ev - hdr.exposure_min_ev
    if mode == HISTOGRAM:
        return max(hdr.adapt_dark_s, hdr.adapt_bright_s) * max(0.0, math.log(max(span, 1.0) / REST_STOPS))
    if mode == MIPS:
        tau = -1e-3 / (math.log(0.98) * hdr.adapt_speed)
        return tau * (span * math.log(2.0) - math.log(REST_STOPS * math.log(2.0)))
    return 0.0
