"""Temporal anti-aliasing without a device: what settings mean, and the share of each frame in the history."""

from __future__ import annotations

import math

from ..settings import Settings
from ..shading.views import PICTURE
from . import settings as knobs

Defines = tuple[tuple[str, int | float | str], ...]

REST_PERIODS = 4
"""Periods of jitter that a mean covers."""

HALF_SLACK = 5e-4
"""How far a history of half floats may be outside of a box, in its largest value: they are rounded by 2^-11."""

SETTLING_SHARE = 0.25
"""Share of a frame at least, in the period between the last movement and the mean."""

FRAMES_BEFORE = 3.0
"""Frames as which an earlier history counts at the beginning of a mean."""

RESIDUE = 6e-4
"""Part of an earlier history at most in a picture that rests: about a code of 255 for a white one."""

KERNEL_RADIUS = 1.25
"""Radius of the kernel that weights samples which are drawn at a scale, in pixels of the picture."""

HARRIS_MEAN = 0.35875
"""Mean of the window of Harris over its radius: its first term."""


def in_use(settings: Settings) -> bool:
    """Whether frames have a history of colour; a view of a quantity is shown as it is, and paths have sums."""
    return settings.taa.taa != "off" and settings.shading.view == PICTURE and not settings.paths.path_tracer


def scale(settings: Settings) -> float:
    """Return the sides of what is drawn, in sides of the picture: 1 without a history."""
    return settings.taa.taa_scale if in_use(settings) else 1.0


def averages(settings: Settings) -> bool:
    """Whether frames that show the same become their mean."""
    return settings.taa.taa == "full" and settings.taa.taa_average


def averages_exposed(settings: Settings) -> bool:
    """Whether frames are averaged while the exposure adapts: the history is multiplied by the ratio of exposures.

    A history of halves would lose small steps of exposure, and rates by a Sobel filter depend on it.
    """
    return (
        in_use(settings)
        and averages(settings)
        and settings.taa.taa_format == "rgba32f"
        and settings.rates.rate_policy != "sobel"
    )


def scale_defines(settings: Settings, period: int) -> Defines:
    """Return the defines of resolve.comp for a picture with more pixels than are drawn; `period` is that of the jitter.

    WEIGHT_BEFORE is the weight of a history at the beginning of a mean, in sums of the kernel's weights: FRAMES_BEFORE
    times the mean sum of a frame.
    """
    if scale(settings) == 1.0:
        return ()
    area = (HARRIS_MEAN * 2.0 * KERNEL_RADIUS) ** 2
    weight = FRAMES_BEFORE * area * scale(settings) ** 2
    return ("SCALED", 1), ("KERNEL_RADIUS", KERNEL_RADIUS), ("WEIGHT_BEFORE", weight)


def resolve_defines(settings: Settings) -> Defines:
    """Return the defines of resolve.comp."""
    taa = settings.taa
    if taa.taa == "simple":
        return (("CONSTRAINT", 0), ("FILTER", 0), ("WEIGHT", 0), ("FORMAT", taa.taa_format))
    return (
        ("CONSTRAINT", knobs.CONSTRAINTS.index(taa.taa_constraint)),
        ("FILTER", knobs.FILTERS.index(taa.taa_filter)),
        ("WEIGHT", knobs.WEIGHTS.index(taa.taa_weight)),
        ("GAMMA", taa.taa_gamma),
        *((("YCOCG", 1),) * taa.taa_ycocg),
        *((("CATMULL_ROM", 1),) * (taa.taa_history == "catmull-rom")),
        *((("CLOSEST", 1),) * (taa.taa_velocity == "closest")),
        *((("LONGEST", 1),) * (taa.taa_velocity == "longest")),
        *((("TOLERANCE", taa.taa_tolerance),) * (taa.taa_tolerance > 0.0)),
        *((("REACTIVE", taa.taa_reactive),) * (taa.taa_reactive > 0.0)),
        *((("CLIP_SLACK", HALF_SLACK),) * (taa.taa_format == "rgba16f")),
        ("FORMAT", taa.taa_format),
    )


def texture_defines(settings: Settings) -> Defines:
    """Return the defines of shaders that sample materials; without a history textures are filtered as ever."""
    if not in_use(settings):
        return ()
    level = settings.taa.mip_bias + math.log2(scale(settings))
    bias = (("MIP_BIAS", level),) * (level != 0.0)
    return (*bias, *((("STEADY_UV", 1),) * settings.taa.steady_uv))


def short_means(period: int) -> int:
    """Return how many means over a `period` of frames come before the last mean, so that RESIDUE is left at most."""
    each, last = (FRAMES_BEFORE / (FRAMES_BEFORE + count) for count in (period, REST_PERIODS * period))
    return max(0, math.ceil(math.log(RESIDUE / last) / math.log(each)))


class Shares:
    """The share of each frame in the history, from how long the view has not changed.

    While something changes, a frame has the share of the settings, or 1 / n in the first n frames after a reset. Frames
    that show the same are averaged (`averages`):

    - If no frame since the reset showed anything else, frame n has the share 1 / n. The history is the mean of all.
    - Otherwise one more period is blended, with SETTLING_SHARE at least, so that what has moved leaves the history: of
      what the constraint has left of it, 0.75^8 or a tenth after eight frames. Then means follow. At the beginning of a
      mean the history counts as B = FRAMES_BEFORE frames, so frame j has the share 1 / (B + j). After K frames each of
      them has the weight 1 / (B + K), and the history before has B / (B + K). The first means cover a period each, and
      the last one REST_PERIODS. Periods are equal, so all means are the same, and what is left of the history is the
      product of those parts: at most RESIDUE. A share of 1 for the first frame would leave nothing, but its aliasing
      would be visible in that frame.

    After that the share is 0, and the history stays as it is.
    """

    def __init__(self, share: float, period: int, averages: bool) -> None:
        self._share, self._period, self._averages = share, period, averages
        self.reset()

    def reset(self) -> None:
        """Begin with an empty history."""
        self.age = 0
        """Frames in the history."""
        self.alike = 0
        """Frames that show the same as the last one, the last one included."""
        self.averaging = False
        """Whether the last frame was a part of a mean."""
        self.begins = False
        """Whether the last frame began a mean, for which the history counts as FRAMES_BEFORE frames."""

    @property
    def frames_to_rest(self) -> int:
        """How many equal frames a picture needs until it rests."""
        settling = 0 if self.age == self.alike else 1 + short_means(self._period)
        return (settling + REST_PERIODS) * self._period

    @property
    def resting(self) -> bool:
        """Whether the history stays as it is while frames show the same."""
        return self._averages and self.age > 0 and self.alike >= self.frames_to_rest

    def next(self, still: bool, valid: bool) -> float:
        """Return the share of the next frame; `still` says that it shows the same as the last one.

        Without a `valid` history the share is 1.
        """
        if not valid:
            self.reset()
        if still and self.resting:
            self.begins = False
            return 0.0
        from_start = self.age == self.alike
        self.alike = self.alike + 1 if still and self.age else 1
        periods, number = divmod(self.alike - 1, self._period)
        number += max(0, periods - 1 - short_means(self._period)) * self._period  # of the last mean
        self.averaging = self._averages and self.age > 0 and still and (from_start or periods > 0)
        self.begins = self.averaging and not from_start and number == 0
        self.age += 1
        if self.age == 1:
            return 1.0
        if not self._averages:
            return self._share
        if not self.averaging:
            return max(self._share, 1.0 / self.age, SETTLING_SHARE if still else 0.0)
        if from_start:
            return 1.0 / self.age
        return 1.0 / (FRAMES_BEFORE + number + 1)
