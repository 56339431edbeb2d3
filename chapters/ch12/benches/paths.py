"""Errors of path tracing against its samples, and its speed beside Mitsuba 3's: `strata bench 12 --only paths`.

Errors are those of small pictures, by independent and by Sobol's random numbers. Several pictures begin with other
numbers, and each is compared with the mean of the others when they are finished: so no reference is needed, and what
the others still lack is subtracted. Independent samples give the error samples^-0.5.

Speeds are by the clock, paths of a picture a second, for each way of tracing. Mitsuba (extra `reference`) traces the
same paths: in the same scene, of metals that both programs have alike, with the same number of reflections. What its
pictures and ours differ by from run to run says how much time each needs for the same error. A variant of Mitsuba that
does not run here is named.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from common.reports.benches import Effort, Subject
from common.settings import knobs, replaced
from common.view.camera import View

from ..rays.picture import BVH
from . import paths_scenes as scenes
from .pass_times import is_software
from .paths_results import plot, sentences, show, slope_of

__all__ = ["measure", "plot", "sentences", "show"]

KNOB = "path_tracer"
"""The setting; a chapter without it traces no paths."""

SIZE, SCENE = (16, 16), "cornell"
"""The pictures whose errors are measured."""

SAMPLES, QUICK_SAMPLES = 4096, 64
"""Paths through a pixel at the end; the first error is that of FIRST."""

FIRST, STEP = 4, 128
"""Paths after which errors are first known, and those of a frame at most: no submission takes long."""

PICTURES, QUICK_PICTURES = 8, 4

SEQUENCES = ("pcg", "sobol")

BESIDE, BESIDE_SIZE, BESIDE_SAMPLES, BESIDE_BOUNCES = "atrium", (160, 90), 16, 4
"""The scene, the size, the paths of a picture and the reflections of speeds."""

QUICK_BESIDE, QUICK_BESIDE_SIZE, QUICK_BESIDE_SAMPLES = "cornell", (32, 18), 4

VARIANTS = ("scalar_rgb", "llvm_ad_rgb")
"""Of Mitsuba: plain C++, and kernels compiled at run time."""

LEAST_ROUNDS = 4
"""Pictures of a kind: the noise is how they differ."""

PLAIN = {"background": 0.0, "ambient": 0.0, "default_light": False, "color_format": "rgba32f"}

Step = Callable[[str, float], None]


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without a path tracer.

    `errors` are rows of a sequence and a number of samples: `error` is relative RMS. `slopes` are those of log error
    over log samples. A row of `speeds` has millions of paths a second, the relative RMS of what one picture's
    pixels differ by from run to run (`noise`), and the mean light. `missing` says what was left out, and why.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    full, missing = effort.everything, list[str]()
    errors: list[dict[str, Any]] = []
    slopes: dict[str, float] = {}
    for sequence, rows in _errors(subject, full, step):
        errors += rows
        slopes[sequence] = slope_of([row["samples"] for row in rows], [row["error"] for row in rows])
    speeds = _speeds(subject, effort, step, missing)
    return {
        "software": is_software(subject),
        "backend": subject.device.capabilities.backend,
        "missing": missing,
        "errors": errors,
        "slopes": slopes,
        "speeds": speeds,
    }


def _settings(subject: Subject, **more: Any) -> Any:
    return replaced(subject.settings_class(), **{**PLAIN, "path_tracer": True, **more})


# --- errors -----------------------------------------------------------------------------------------------------------


def _errors(subject: Subject, full: bool, step: Step) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield each sequence of random numbers, and its rows."""
    most, count = (SAMPLES, PICTURES) if full else (QUICK_SAMPLES, QUICK_PICTURES)
    small = subject.on(subject.load(SCENE), SIZE)
    with small.open(_settings(subject, path_limit=most), {"color_linear"}) as renderer:
        view = small.view(renderer)
        for place, sequence in enumerate(SEQUENCES):
            renderer.settings.paths.path_sequence = sequence
            pictures = []
            for seed in range(count):
                step(f"errors, {sequence}", (place + seed / count) / (2 * len(SEQUENCES)))
                renderer.settings.paths.path_seed = seed
                pictures.append(_sums(renderer, view, most))
            relative = relative_errors(np.stack(pictures))
            yield (
                sequence,
                [
                    {"sequence": sequence, "samples": FIRST << number, "error": error}
                    for number, error in enumerate(relative)
                ],
            )


def _sums(renderer: Any, view: View, most: int) -> Any:
    """Return (N, H, W, 3) one picture after FIRST paths, and after each doubling of them."""
    shown, total, path_knobs = [], 0, renderer.settings.paths
    while total < most:
        path_knobs.path_samples = min(max(total, FIRST), STEP)  # the sums go on
        total += path_knobs.path_samples
        picture = renderer.render(view, 0.0).image("color_linear")
        if total & (total - 1) == 0:
            shown.append(np.asarray(picture, np.float64))
    return np.stack(shown)


def relative_errors(pictures: Any) -> list[float]:
    """Return the error (N,) of pictures (K, N, H, W, 3) after N numbers of samples, the last of which are the truth.

    The error is the root of the mean square over pixels and colours, in parts of the mean light. Each of the K pictures
    is compared with the mean of the others' last ones, which are independent of it. Their own error is subtracted: by
    what the last ones differ from each other.
    """
    count, light = len(pictures), float(pictures[:, -1].mean())
    last = pictures[:, -1]
    spread = float(last.var(axis=0, ddof=1).mean()) / (count - 1)
    truth = (last.sum(axis=0) - last) / (count - 1)
    squares = ((pictures - truth[:, None]) ** 2).mean(axis=(0, 2, 3, 4)) - spread
    return [float(np.sqrt(max(square, 0.0)) / light) for square in squares]


# --- speeds -----------------------------------------------------------------------------------------------------------


def _speeds(subject: Subject, effort: Effort, step: Step, missing: list[str]) -> list[dict[str, Any]]:
    """Return a row for each way of tracing, and for each variant of Mitsuba that runs here."""
    full = effort.everything
    name, size, samples = (
        (BESIDE, BESIDE_SIZE, BESIDE_SAMPLES)
        if full
        else (QUICK_BESIDE, QUICK_BESIDE_SIZE, QUICK_BESIDE_SAMPLES)
    )
    scene, rounds = scenes.of_metal(subject.load(name)), max(effort.rounds, LEAST_ROUNDS)
    beside, rows = subject.on(scene, size), []
    given = {"path_samples": samples, "path_bounces": BESIDE_BOUNCES, "path_roulette": BESIDE_BOUNCES}
    view: Any = None
    for way in _ways(subject)[: None if full else 1]:
        step(f"speed, {way}", 0.5)
        settings = _settings(subject, ray_way=way, path_average=False, **given)
        with beside.open(settings, {"color_linear"}) as renderer:
            view = beside.view(renderer)

            def trace(number: int, renderer: Any = renderer, view: Any = view) -> Any:
                return renderer.render(view, 0.0).image("color_linear")

            rows.append({"scene": name, "by": way, **scenes.timed(trace, rounds, size, samples)})
    for variant in VARIANTS:
        step(f"speed, Mitsuba's {variant}", 0.8)
        try:
            row = scenes.timed_mitsuba(variant, scene, view, size, BESIDE_BOUNCES, rounds, samples)
        except ImportError as error:
            missing.append(f"Mitsuba's {variant}: {str(error).splitlines()[0].rstrip('.')}")
            continue
        rows.append({"scene": name, "by": variant, **row})
    return rows


def _ways(subject: Subject) -> Sequence[str]:
    """Return the ways of tracing that the device has."""
    if subject.device.capabilities.backend != "vulkan":
        return (BVH,)
    has = subject.device.has
    return (*("pipeline",) * has("ray-tracing"), *("query",) * has("ray-query"), BVH)
