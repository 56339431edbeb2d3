"""Automatic exposure and bloom against double precision: `strata bench 7 --only hdr`.

Pictures are the scenes of EXPOSED and one of a few lamps of a million nits. The exposure that the GPU settles on is
compared with that of the sorted or averaged picture. The frames that it needs after a step of brightness are compared
with the closed form, and bloom with the same pyramid in float64, in each format. Times are of the passes by size.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.scene import Scene
from common.settings import knobs, preset, replaced
from common.view.camera import UNIT_EV100, View, exposure

from . import hdr_truth as truth

KNOB = "exposure"
"""The setting; a chapter without it takes the exposure from the view alone."""

EXPOSED = (("market", "none"), ("atrium", "none"), ("spheres", "sky"))
"""Scenes, and their environments."""

WAYS = ("histogram", "mips")
FORMATS = ("rgba16f", "rgba32f")
"""Of the picture that is measured and spread."""

SIZE, QUICK_SIZE = (640, 360), (160, 90)

TIMED, QUICK_TIMED = ((640, 360), (1280, 720), (1920, 1080)), ((160, 90),)
"""Sizes of the pictures that are timed."""

SETTLED, SETTLE_S = 10, 10.0
"""Frames until an exposure is read, and the seconds between two: the time constants are far shorter."""

STEPS, QUICK_STEPS = (
    ((10.0, 2560.0), (2560.0, 10.0), (0.01, 1e6), (1e6, 0.01)),
    ((10.0, 160.0), (160.0, 10.0)),
)
"""Nits before and after a step of brightness."""

FRAME_S, WITHIN = 0.1, 0.01
"""Seconds between two frames that adapt, and the part of its target that the exposure has to come within."""

LEVELS, QUICK_LEVELS = (1, 2, 3, 4, 5, 6), (1, 5)
STRENGTH, THRESHOLD = 0.5, 1.0

DARK = {"ambient": 0.0, "default_light": False, "gbuffer_format": "full"}
"""Settings of a picture that glows by itself, and whose emission nothing rounds before it is light."""

LEAST_WARM_UP = 3

PASSES: dict[str, dict[str, Any]] = {
    "histogram": {"exposure": "histogram"},
    "luminance": {"exposure": "mips"},
    "bloom": {"bloom": STRENGTH},
}
"""What is timed, and the settings that have it: a kernel with the one that adapts, or all passes of bloom."""

Step = Callable[[str, float], None]


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without the setting."""
    if KNOB not in knobs(subject.settings_class):
        return None
    size = SIZE if effort.everything else QUICK_SIZE
    exposures: list[dict[str, Any]] = []
    for number, (name, scene, view) in enumerate(_pictures(subject, size)):
        step(f"exposures of {name}", 0.1 * number)
        exposures += _exposures(subject.on(scene, size), name, view)
    step("adaptation", 0.4)
    adaptation = [
        _adaptation(subject, way, *levels)
        for levels in (STEPS if effort.everything else QUICK_STEPS)
        for way in WAYS
    ]
    step("bloom", 0.5)
    bloom = list(_bloom(subject, size, LEVELS if effort.everything else QUICK_LEVELS))
    step("times", 0.7)
    passes = [
        row for at in (TIMED if effort.everything else QUICK_TIMED) for row in _times(subject, at, effort)
    ]
    return {
        "size": list(size),
        "exposures": exposures,
        "adaptation": adaptation,
        "bloom": bloom,
        "passes": passes,
    }


# --- exposure ---------------------------------------------------------------------------------------------------------


def _pictures(subject: Subject, size: tuple[int, int]) -> Iterator[tuple[str, Scene, View | None]]:
    """Yield the names of pictures, their scenes without motion, and their views, None for the scene's own."""
    for name, around in EXPOSED:
        scene = replace(subject.load(name, around), animations=[])
        yield (name if around == "none" else f"{name}, {around}"), scene, None
    yield f"lamps of {truth.LAMP_NITS:.0e} nits", truth.glowing(truth.lamps(size)), truth.facing(8.0)


def _exposures(drawn: Subject, name: str, view: View | None) -> Iterator[dict[str, Any]]:
    """Yield a row for each way and format: the settled exposure as an EV100, and its error in stops.

    The truth is what a picture in full precision asks for. It has the settled exposure itself, since unlit surfaces
    show the same values at any, and a black background, which adds no light.
    """
    still = _settings(drawn) if view is None else _settings(drawn, **DARK)
    exact = replaced(still, color_format="rgba32f", background=0.0)
    with drawn.open(exact, {"color_linear", "depth"}) as full:
        shown = view or drawn.view(full)
        for way in WAYS:
            for color_format in FORMATS:
                settings = replaced(still, exposure=way, color_format=color_format)
                with drawn.open(settings, {"color"}) as renderer:
                    for number in range(SETTLED):
                        frame = renderer.render(shown, SETTLE_S * number)
                    found = math.log2(_exposure_of(renderer, frame))
                ev100 = -math.log2(1.2) - found
                frame = full.render(replace(shown, ev100=ev100))
                nits = np.asarray(frame.image("color_linear"), np.float64) @ truth.WEIGHTS
                sky = drawn.scene.environment is not None
                counts = (frame.image("depth") > 0.0) | (nits > 0.0) | sky
                error = found - _wanted(nits, counts, way, settings.hdr)
                yield {
                    "picture": name,
                    "way": way,
                    "format": color_format,
                    "ev100": ev100,
                    "error_stops": error,
                }


def _wanted(nits: np.ndarray, counts: np.ndarray, way: str, hdr: Any) -> float:
    """Return log2 of the exposure that a picture (H, W) of luminances asks for."""
    if way == "histogram":
        average = truth.log2_average(nits[counts], hdr.exposure_low / 100, hdr.exposure_high / 100)
    else:
        average = math.log2(float(np.where(counts, nits, 0.0).mean()))
    most, least = (-math.log2(1.2) - ev for ev in (hdr.exposure_min_ev, hdr.exposure_max_ev))
    return float(np.clip(math.log2(hdr.exposure_key) - average, least, most))


def _adaptation(subject: Subject, way: str, before: float, after: float) -> dict[str, Any]:
    """Return the frames until the exposure is within WITHIN of its target after a step from `before` to `after` nits.

    `error_stops` is the largest distance on the way from the closed form of the state after so many frames.
    """
    scene = truth.glowing(np.full((8, 8, 3), before))
    drawn = subject.on(scene, (8, 8))
    settings = _settings(drawn, **DARK, exposure=way, color_format="rgba32f")
    hdr = settings.hdr
    stops = math.log2(before / after)
    tau = hdr.adapt_dark_s if stops > 0 else hdr.adapt_bright_s
    if way == "histogram":
        closed = truth.frames_by_histogram(stops, tau, FRAME_S, WITHIN)
    else:
        closed = truth.frames_by_mips(before, after, hdr.adapt_speed, FRAME_S, WITHIN)
    target, found = math.log2(hdr.exposure_key / after), []
    with drawn.open(settings, {"color"}) as renderer:
        for number in range(2 * closed + 20):
            if number == 2:  # the first frames settle on what was before
                with scene.edit() as edit:
                    edit.set_material(0, replace(scene.materials[0], emissive=(after,) * 3))
            frame = renderer.render(truth.facing(math.log2(before)), FRAME_S * number)
            found.append(math.log2(_exposure_of(renderer, frame)))
            if abs(2.0 ** (found[-1] - target) - 1.0) <= WITHIN:
                break
    path = np.array(found[2:])  # the frame that measures the new picture has the exposure of the old one
    frames = np.arange(len(path))
    if way == "histogram":
        expected = target + stops * -np.exp(-frames * FRAME_S / tau)
    else:
        left = 0.98 ** (hdr.adapt_speed * 1e3 * FRAME_S * frames)
        expected = math.log2(hdr.exposure_key) - np.log2(after + (before - after) * left)
    return {
        "way": way,
        "from_nits": before,
        "to_nits": after,
        "step_s": FRAME_S,
        "frames": len(path) - 1,
        "closed_frames": closed,
        "error_stops": float(np.abs(path - expected).max()),
    }


def _exposure_of(renderer: Any, frame: Any) -> float:
    """Return the exposure of a frame, which its outputs have divided out."""
    _ = frame.timings  # waits for the frame
    slot = getattr(frame, "_frame", frame)._slot.index
    return float(renderer._data.exposures.of_frame(slot, float("nan")))


# --- bloom ------------------------------------------------------------------------------------------------------------


def _bloom(subject: Subject, size: tuple[int, int], counts: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Yield a row for each number of levels and each format: how far bloom is from float64, what it loses and shifts.

    Errors are parts: of the mean light that bloom moves, and the largest of the largest. `energy` is how much more
    light the picture has than without bloom. `shift` is for lamps that move by one pixel: how far their bloom is from
    the one before, moved by a pixel, as a part of the mean. A blur that is the same at all places has 0.
    """
    scenes = [subject.on(truth.glowing(truth.lamps(size, moved)), size) for moved in (0, 1)]
    settings = _settings(subject, **DARK, bloom_threshold=THRESHOLD)
    plain = [_picture(drawn, replaced(settings, color_format="rgba32f")) for drawn in scenes]
    for levels in counts:
        wanted = truth.bloomed(plain[0], STRENGTH, THRESHOLD, levels)
        move = np.abs(wanted - plain[0])
        for color_format in FORMATS:
            spreads = {"bloom": STRENGTH, "bloom_levels": levels, "color_format": color_format}
            spread = [_picture(drawn, replaced(settings, **spreads)) for drawn in scenes]
            error = np.abs(spread[0] - wanted)
            moves = [bloomed - picture for bloomed, picture in zip(spread, plain, strict=True)]
            beside = np.abs(moves[1][:, 1:] - moves[0][:, :-1])
            yield {
                "levels": levels,
                "format": color_format,
                "mean_error": float(error.mean() / move.mean()),
                "largest_error": float(error.max() / move.max()),
                "energy": float(spread[0].sum() / plain[0].sum() - 1.0),
                "shift": float(beside.mean() / move.mean()),
            }


def _picture(drawn: Subject, settings: Any) -> truth.Float64:
    """Return the values of a picture (H, W, 3) in which a lamp is about 1,000 times as bright as white."""
    view = truth.facing(UNIT_EV100 + 10.0)
    with drawn.open(settings, {"color_linear"}) as renderer:
        light: truth.Float64 = renderer.render(view).image("color_linear").astype(np.float64)
    return light * exposure(view.ev100)


# --- times ------------------------------------------------------------------------------------------------------------


def _times(subject: Subject, size: tuple[int, int], effort: Effort) -> Iterator[dict[str, Any]]:
    """Yield a row for each of PASSES at a size of the picture: `ms` by timestamps, and how much longer a frame takes.

    Software drivers set timestamps before a dispatch is done: their kernels have no `ms`.
    """
    drawn = subject.on(truth.glowing(truth.lamps(QUICK_SIZE)), size)
    software = subject.device.capabilities.kind == "software"
    stamps: dict[str, list[float]] = {}
    frames: dict[str, list[float]] = {}
    with ExitStack() as stack:
        opened = {
            name: stack.enter_context(drawn.open(_settings(drawn, **DARK, **values), {"color"}))
            for name, values in {"": {}, **PASSES}.items()
        }
        for number in range(LEAST_WARM_UP + effort.frames):
            for name, renderer in opened.items():  # in turn: what disturbs one disturbs the others
                began = clock.perf_counter()
                passes = renderer.render(truth.facing(8.0), FRAME_S * number).timings
                wall = (clock.perf_counter() - began) * 1e3
                if number >= LEAST_WARM_UP:
                    own = (took for of, took in passes.items() if of.startswith((name, "adapt")))
                    stamps.setdefault(name, []).append(sum(own))
                    frames.setdefault(name, []).append(wall)
    for name in PASSES:
        longer = [wall - plain for wall, plain in zip(frames[name], frames[""], strict=True)]
        row: dict[str, Any] = {"size": list(size), "pass": name, "ms": None, "noise_ms": None}
        if not software or name == "bloom":
            row["ms"], row["noise_ms"] = middle(stamps[name])
        row["frame_ms"], row["frame_noise_ms"] = middle(longer)
        yield row


def _settings(subject: Subject, **values: Any) -> Any:
    """Return the settings of the pictures: those of `medium` on the deferred path, without what moves."""
    settings = replaced(
        preset(subject.settings_class, "medium"), graph="deferred", environment_size=64, **values
    )
    return replaced(settings, cloth=False) if "cloth" in knobs(subject.settings_class) else settings


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the errors and times as tables."""
    where = "{}x{}".format(*record["size"])
    exposures = table(
        f"Automatic exposure against the whole picture in double precision, {where}",
        *("picture", "way", "format", ">EV100", ">error, stops"),
    )
    for row in record["exposures"]:
        cells = row["picture"], row["way"], row["format"]
        exposures.add_row(*cells, f"{row['ev100']:.2f}", f"{row['error_stops']:+.1e}")
    to.print(exposures)
    adaptation = table(
        f"Frames of {FRAME_S:g} s until the exposure is within {WITHIN:.0%}",
        *("way", ">from nits", ">to nits", ">frames", ">closed form", ">largest error, stops"),
    )
    for row in record["adaptation"]:
        levels = f"{row['from_nits']:g}", f"{row['to_nits']:g}"
        frames = str(row["frames"]), str(row["closed_frames"])
        adaptation.add_row(row["way"], *levels, *frames, f"{row['error_stops']:.1e}")
    to.print(adaptation)
    bloom = table(
        f"Bloom against its pyramid in double precision, {where}",
        *(">levels", "format", ">mean error", ">largest error", ">light gained", ">moved by a pixel"),
    )
    for row in record["bloom"]:
        errors = (f"{100 * row[name]:.2g} %" for name in ("mean_error", "largest_error", "energy", "shift"))
        bloom.add_row(str(row["levels"]), row["format"], *errors)
    to.print(bloom)
    times = table("Passes of exposure and bloom", ">size", "pass", ">GPU ms", ">±", ">longer frame, ms", ">±")
    for row in record["passes"]:
        numbers = (row[name] for name in ("ms", "noise_ms", "frame_ms", "frame_noise_ms"))
        shown = ("-" if number is None else f"{number:.3f}" for number in numbers)
        times.add_row("{}x{}".format(*row["size"]), row["pass"], *shown)
    to.print(times)


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the error of the exposure of each picture, by way and format."""
    rows = record["exposures"]
    names = list(dict.fromkeys(row["picture"] for row in rows))
    for way in WAYS:
        for color_format, marker in zip(FORMATS, "os", strict=True):
            own = [row for row in rows if (row["way"], row["format"]) == (way, color_format)]
            errors = [max(abs(row["error_stops"]), 1e-7) for row in own]
            places = [names.index(row["picture"]) for row in own]
            axes.plot(places, errors, marker, label=f"{way}, {color_format}", ms=5)
    axes.set_yscale("log")
    axes.set_xticks(range(len(names)), names, fontsize=7)
    axes.set_ylabel("error of the exposure, stops")
    axes.legend(fontsize=7)
