"""How far a picture is from its reference: relative MSE, largest difference, FLIP, banding, finite checks.

Pictures are (H, W, C) or (H, W), both of one shape and one kind of numbers; sums are float64. Every metric refuses
NaN and infinity: a mean over them would say nothing, and a comparison with them would pass unseen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from common.errors import StrataError, UserError
from common.images.color import LUMINANCE

Array = NDArray[Any]
Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

PIXELS_PER_DEGREE = 0.7 * 3840 / 0.7 * math.pi / 180
"""What FLIP assumes of the viewer: 0.7 m before a screen 0.7 m and 3840 pixels wide, 67.02 pixels per degree."""

_EXPOSURE_OF_WHITE = 1.0832973
"""log2 of the luminance that the tone curve of HDR-FLIP (ACES) maps to 0.85, where its exposures begin."""
_STOPS = 16.0
"""Luminances this many factors of two below the brightest count as black when exposures are chosen."""

_HEAT = np.array([(0, 0, 4), (81, 18, 124), (183, 55, 121), (252, 137, 97), (252, 253, 191)], np.float64)
"""Five colours of the map magma (van der Walt and Smith, CC0); lightness rises evenly along it."""
_NOT_FINITE = (0, 255, 0)


class NonFiniteError(StrataError):
    """A picture has NaN or infinity in it; the text says how many and where the first is."""


@dataclass(frozen=True)
class FiniteReport:
    """Counts of what is not finite, and the first such value in reading order."""

    nan: int
    positive_infinity: int
    negative_infinity: int
    pixels: int
    first: tuple[int, ...] | None
    """Index into the array, (row, column, channel) for a picture; None where everything is finite."""

    @property
    def ok(self) -> bool:
        """Whether every value is finite."""
        return self.first is None

    def __str__(self) -> str:
        if self.first is None:
            return "all values are finite"
        names = ("row", "column", "channel")
        place = ", ".join(f"{name} {index}" for name, index in zip(names, self.first, strict=False))
        counts = f"{self.nan} NaN, {self.positive_infinity} +Inf, {self.negative_infinity} -Inf"
        return f"{counts} in {self.pixels} pixels, the first at {place}"


def finite_report(image: Array) -> FiniteReport:
    """Return what is not finite in an array, of which the first two axes are rows and columns."""
    bad = ~np.isfinite(image)
    if not bad.any():
        return FiniteReport(0, 0, 0, 0, None)
    first = tuple(int(index) for index in np.unravel_index(int(bad.argmax()), bad.shape))
    return FiniteReport(
        nan=int(np.isnan(image).sum()),
        positive_infinity=int(np.isposinf(image).sum()),
        negative_infinity=int(np.isneginf(image).sum()),
        pixels=int(bad.any(axis=-1).sum() if bad.ndim > 2 else bad.sum()),
        first=first,
    )


def check_finite(image: Array, name: str = "the picture") -> None:
    """Raise NonFiniteError if a value of `image` is not finite; `name` begins the sentence."""
    report = finite_report(image)
    if not report.ok:
        raise NonFiniteError(f"{name} is not finite: {report}")


def max_abs(image: Array, reference: Array) -> float:
    """Return the largest absolute difference, in the arrays' own units (steps of 1/255 for uint8)."""
    a, b = _pair(image, reference)
    return float(np.abs(a - b).max(initial=0.0))


def relative_mse(image: Array, reference: Array, epsilon: float = 0.01) -> float:
    """Return the mean of (image - reference)^2 / (reference^2 + epsilon * mean(|reference|)^2).

    This is the error of Rousselle et al. (Adaptive Sampling and Reconstruction using Greedy Error Minimization,
    2011, section 4) with the constant in the denominator relative to the mean, so that exposure cancels. An all-black
    reference gives 0 for an all-black picture and infinity for any other.
    """
    a, b = _pair(image, reference)
    floor = epsilon * float(np.abs(b).mean()) ** 2
    squares = (a - b) ** 2
    if floor == 0.0:
        return math.inf if squares.any() else 0.0
    return float((squares / (b * b + floor)).mean())


def flip_map(
    image: Array,
    reference: Array,
    mode: Literal["ldr", "hdr"] = "ldr",
    pixels_per_degree: float = PIXELS_PER_DEGREE,
) -> Float32:
    """Return (H, W) float32 the difference that a viewer sees when flipping between two pictures, 0 to 1.

    FLIP (Andersson et al. 2020) by the package of its authors. `pixels_per_degree` is the size of a pixel in the eye:
    fewer pixels per degree show finer detail. Alpha is ignored.

    - "ldr": what is on the screen, sRGB-coded, as integers or as floats of 0..1 (clamped).
    - "hdr": linear light (floats, negative values clamped to 0), shown at several exposures of which the worst counts
      (Andersson et al. 2021). They run from the brightest to the median luminance of the reference, black left out;
      the package's own choice counts black too, which makes 26 exposures of a picture that is half black, and ends
      the process for one that is all black.

    Raises:
        UserError: the package flip-evaluator is not installed.
        NonFiniteError: a value is NaN or infinite.
        ValueError: different shapes or kinds of numbers, integers as "hdr", or a size that is not positive.
    """
    if not pixels_per_degree > 0.0:
        raise ValueError(f"pixels_per_degree is {pixels_per_degree}, but must be positive")
    _pair(image, reference)  # for its errors
    shown, truth = (_rgb(picture, mode) for picture in (image, reference))
    parameters: dict[str, Any] = {"ppd": float(pixels_per_degree)}
    if mode == "hdr":
        parameters |= _exposures(truth)
    errors = _flip().evaluate(
        truth, shown, mode.upper(), applyMagma=False, computeMeanError=False, parameters=parameters
    )[0]
    return np.asarray(errors, np.float32)[..., 0]


def flip_mean(
    image: Array,
    reference: Array,
    mode: Literal["ldr", "hdr"] = "ldr",
    pixels_per_degree: float = PIXELS_PER_DEGREE,
) -> float:
    """Return the mean of `flip_map`: 0 for equal pictures, 0.967 for black against white."""
    return float(flip_map(image, reference, mode, pixels_per_degree).mean(dtype=np.float64))


def gradient_step(image: Array, axis: int = 1, window: int = 33) -> float:
    """Return the largest step of a smooth ramp along `axis` beyond its slope: how visible its bands are.

    The ramp is averaged over the other axes, as the eye does along a band, so noise counts little and bands fully.
    From each difference of neighbours the mean difference over `window` pixels is taken; the largest rest is the step.
    A ramp coded in steps of q, each k pixels wide (k a divisor of `window`), gives q (1 - 1/k); a linear one gives 0.

    Raises:
        NonFiniteError: a value is NaN or infinite.
        ValueError: the ramp is shorter than `window` + 1 pixels, or the window holds no pixel.
    """
    check_finite(image, "the ramp")
    profile = np.moveaxis(image, axis, 0).reshape(image.shape[axis], -1).mean(axis=1, dtype=np.float64)
    steps = np.diff(profile)
    if not 1 <= window <= len(steps):
        raise ValueError(f"a ramp of {len(profile)} pixels has no window of {window} steps")
    sums = np.concatenate([[0.0], np.cumsum(steps)])
    slope = (sums[window:] - sums[:-window]) / window
    first = (window - 1) // 2
    return float(np.abs(steps[first : first + len(slope)] - slope).max())


def error_map(image: Array, reference: Array, limit: float | None = None) -> NDArray[np.uint8]:
    """Return (H, W, 3) uint8 the largest difference of each pixel's channels as a colour: black, violet, orange, cream.

    `limit` is the difference shown brightest; without one it is the largest of the map. Pixels with a NaN or an
    infinity in either picture are green.
    """
    _check_kinds(image, reference)
    a, b = image.astype(np.float64), reference.astype(np.float64)
    with np.errstate(invalid="ignore"):
        difference = np.abs(a - b)
    difference = difference.max(axis=-1) if difference.ndim > 2 else difference
    finite = np.isfinite(difference)
    difference = np.where(finite, difference, 0.0)
    top = float(difference.max(initial=0.0)) if limit is None else limit
    place = np.clip(difference / top, 0.0, 1.0) if top > 0.0 else np.sign(difference)
    stops = np.linspace(0.0, 1.0, len(_HEAT))
    colors = np.stack([np.interp(place, stops, _HEAT[:, channel]) for channel in range(3)], axis=-1)
    colors[~finite] = _NOT_FINITE
    return np.round(colors).astype(np.uint8)


def _check_kinds(image: Array, reference: Array) -> None:
    if image.shape != reference.shape:
        raise ValueError(f"pictures of different shapes: {image.shape} and {reference.shape}")
    floats = [np.issubdtype(picture.dtype, np.floating) for picture in (image, reference)]
    if floats[0] != floats[1] or not (floats[0] or image.dtype == reference.dtype):
        raise ValueError(f"pictures of different units: {image.dtype} and {reference.dtype}")


def _pair(image: Array, reference: Array) -> tuple[Float64, Float64]:
    _check_kinds(image, reference)
    if image.size == 0:
        raise ValueError(f"a picture without pixels: {image.shape}")
    check_finite(image, "the picture")
    check_finite(reference, "the reference")
    return image.astype(np.float64), reference.astype(np.float64)


def _rgb(image: Array, mode: str) -> Float32:
    """Return (H, W, 3) float32 as the package of FLIP takes it: it scales no integers and takes no negative light."""
    image = image[..., None] if image.ndim == 2 else image
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4):
        raise ValueError(f"FLIP takes (H, W), (H, W, 1), (H, W, 3) or (H, W, 4), not {image.shape}")
    if image.dtype.kind in "ui":
        if mode == "hdr":
            raise ValueError(f"HDR-FLIP takes linear floats, not {image.dtype}")
        image = image / np.iinfo(image.dtype).max
    image = np.broadcast_to(image[..., :3], (*image.shape[:2], 3))
    return np.ascontiguousarray(np.clip(image, 0.0, np.finfo(np.float32).max), np.float32)


def _exposures(reference: Float32) -> dict[str, Any]:
    """Return first, last and number of exposures for HDR-FLIP (Andersson et al. 2021, section 4.1)."""
    luminance = reference.astype(np.float64) @ LUMINANCE
    brightest = float(luminance.max())
    if brightest == 0.0:
        start = stop = _EXPOSURE_OF_WHITE
    else:
        lit = luminance[luminance > brightest * 2.0**-_STOPS]
        start, stop = (_EXPOSURE_OF_WHITE - math.log2(value) for value in (brightest, float(np.median(lit))))
    return {
        "startExposure": start,
        "stopExposure": stop,
        "numExposures": max(2, math.ceil(stop - start)),
    }


def _flip() -> ModuleType:
    try:
        import flip_evaluator
    except ImportError:
        raise UserError(
            "FLIP needs the package flip-evaluator: run `pip install flip-evaluator`, or use another metric"
        ) from None
    module: ModuleType = flip_evaluator
    return module
