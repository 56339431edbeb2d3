"""What each mode of temporal anti-aliasing leaves of errors, ghosts and flicker: `strata bench 11 --only taa`.

Each mode draws the same sequences of frames: views at rest, pans, and small scenes in which one thing moves or
flickers. Frames are held to the same frames with 64 samples a pixel (`taa_truth.py`), over time:

- PSNR in decibels, of the mean squared error of all frames, and of the last one.
- Flicker in codes of 255: how much pixels change otherwise than those of the reference (`common.reports.sequences`).
- Ghost in codes: an object passes before a wall, and pixels that it has left are compared with the same frames without
  the object, some frames later.
- Blur as MTF50 of a slanted edge in a pan, in cycles per pixel.

Lights cast no shadows, since the texels of shadow maps depend on the number of pixels. A software driver draws small
pictures. Times are those of a camera that drifts by much less than a pixel, so no pass can rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.reports.benches import Effort, Subject, moved_view
from common.reports.sequences import OverTime, ghost, mtf50
from common.scene import Scene
from common.settings import knobs
from common.view.camera import View, exposure

from . import taa_scenes as scenes
from .pass_times import Groups, is_software, times_of
from .taa_results import FULL, OFF, plot, sentences, show
from .taa_scenes import Case
from .taa_truth import Reference, references
from .taa_truth import shown as in_codes_of_light

KNOB = "taa"
"""The setting; a chapter without it has no history of colour."""

Mode = tuple[str, dict[str, Any]]

FRAMES, QUICK_FRAMES = 24, 14
"""Frames of a sequence."""

SETTLED = 10
"""Frames of what will move, before it does."""

MOST_FRAMES = 128
"""Frames after which a view at rest is taken as it is, whether it rests or not."""

AT_REST = 8
"""Frames of a view at rest whose flicker is measured."""

SLOW_SIZE, USUAL_SIZE = (160, 90), (640, 360)
"""The size on a software driver where the bench's usual size was not changed."""

AGES, AFTER = 8, 4
"""Frames since an object covered a pixel: up to which ghosts are recorded, and the one that counts."""

SHARP_FRAMES = 8
"""Frames, the last ones, whose mean sharpness counts."""

GROUPS: Groups = {"taa": ("taa",), "motion": ("motion",)}
"""Passes that are timed. Nothing but the camera moves, so of `motion` it is the camera's part."""

SLOW_TIMED = 6
"""Frames that are timed on a software driver."""

Step = Callable[[str, float], None]

__all__ = ["FULL", "OFF", "measure", "plot", "sentences", "show"]


def full(**values: Any) -> dict[str, Any]:
    """Return settings of the defaults but for some."""
    return {"taa": "full", **{f"taa_{name}": value for name, value in values.items()}}


MODES: tuple[Mode, ...] = (
    (OFF, {"taa": "off"}),
    ("simple", {"taa": "simple"}),
    (FULL, full()),
    *((f"constraint {one}", full(constraint=one)) for one in ("none", "clamp", "clip", "variance")),
    *((f"weight {one}", full(weight=one)) for one in ("fixed", "contrast", "luminance")),
    ("bilinear", full(history="bilinear")),
    *((f"velocity {one}", full(velocity=one)) for one in ("own", "longest")),
    ("rgba16f", full(format="rgba16f")),
)
"""Each choice of the settings by itself; the default ones are in `FULL`."""

DEPTHLESS: tuple[Mode, ...] = tuple(
    (f"blind {one}", full(constraint=one, tolerance=0.0))
    for one in ("none", "clamp", "clip", "variance", "variance-clamp")
)
"""Constraints that must remove ghosts alone, blind for depth: for scenes with a disocclusion."""

QUICK_MODES = (OFF, FULL)


# --- measuring --------------------------------------------------------------------------------------------------------


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without a history of colour.

    A row is one mode in one case. `psnr`, `psnr_last` and `psnr_frames` are in decibels, None for equal pictures;
    `flicker`, `ghost_max` and `ghost_mean` are in codes. `rest` is the number of frames until the picture rested, with
    `psnr_rest` and `flicker_rest` of that picture; None where something moves. `ghost_ages` are ghosts (most, mean) of
    pixels that the object has left 1 to `AGES` frames ago. `mtf50` is None where there is no edge or no limit, which
    `sharpest` tells apart. `times` has ms of passes for each mode.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    if is_software(subject) and subject.size == USUAL_SIZE:
        subject = subject.on(subject.scene, SLOW_SIZE)
    frames = FRAMES if effort.everything else QUICK_FRAMES
    made = cases(subject, effort.everything, frames)
    rows: list[dict[str, Any]] = []
    for at, case in enumerate(made):
        step(f"{case.name}, reference", 0.9 * at / len(made))
        plain = scenes.settings_of(subject, taa="off")
        truth = references(subject, case, plain, frames)
        modes = modes_of(effort.everything, case)
        for number, (name, values) in enumerate(modes):
            step(f"{case.name}, {name}", 0.9 * (at + (number + 1) / (len(modes) + 1)) / len(made))
            settings = scenes.settings_of(subject, **values)
            figures = sequence(subject, case, settings, truth, frames)
            rows.append({"case": case.name, "mode": name, "settings": values, **figures})
    step("times", 0.9)
    return {
        "size": list(subject.size),
        "frames": frames,
        "after": AFTER,
        "clock": is_software(subject),
        "rows": rows,
        "times": _times(subject, effort),
    }


def modes_of(everything: bool, case: Case | None = None) -> tuple[Mode, ...]:
    """Return the modes to measure, in a case if one is given."""
    modes = MODES if everything else tuple(mode for mode in MODES if mode[0] in QUICK_MODES)
    return modes + DEPTHLESS if everything and case is not None and case.passing is not None else modes


def cases(subject: Subject, everything: bool, frames: int) -> list[Case]:
    """Return the sequences to measure."""
    size = subject.size
    if not everything:
        return [scenes.still(), scenes.disocclusion(size, frames), scenes.edge(size)]
    return [
        *(scenes.large(subject, name, pan) for name in ("atrium", "market") for pan in (False, True)),
        scenes.rotating(size, frames),
        scenes.disocclusion(size, frames),
        scenes.disocclusion(size, frames, checked=True),
        scenes.wires(size),
        scenes.flickering(frames),
        scenes.edge(size),
    ]


def sequence(
    subject: Subject, case: Case, settings: Any, truth: list[Reference], frames: int
) -> dict[str, Any]:
    """Return the figures of a row."""
    figures: dict[str, Any] = dict.fromkeys(
        ("rest", "psnr_rest", "flicker_rest", "ghost_max", "ghost_mean", "ghost_ages", "mtf50", "sharpest")
    )
    drawn = subject.on(case.scene)
    outputs = {"color"} if case.edge is None and case.passing is None else {"color", "color_linear"}
    over, sharp, seen = OverTime(flip=False), [], []
    with drawn.open(settings, outputs) as renderer:
        first = drawn.view(renderer)
        begin(renderer, case, first)
        for frame in range(frames):
            view = case.view(first, frame)
            if frame == 0 and not case.moves:
                view = replace(view, cut=True)
            picture = renderer.render(view, case.time(frame))
            if case.passing is not None:
                seen.append(unrounded(picture, view))
            over.add(codes(picture), truth[frame if case.moves else 0].shown)
            if case.edge is not None and frame >= frames - SHARP_FRAMES:
                light = picture.image("color_linear").mean(axis=-1) * exposure(view.ev100)
                sharp.append(mtf50(light, case.edge))
        if not case.moves:
            figures |= rest(renderer, case.view(first, 0), frames, truth[0].shown)
    if case.passing is not None:
        with hidden(case.scene, case.passing), drawn.open(settings, {"color_linear"}) as renderer:
            first = drawn.view(renderer)
            begin(renderer, case, first)
            views = [case.view(first, frame) for frame in range(frames)]
            without = [
                unrounded(renderer.render(view, case.time(frame)), view) for frame, view in enumerate(views)
            ]
        figures |= ghosts(seen, without, truth)
    if sharp:
        finite = [one for one in sharp if math.isfinite(one)]
        figures["sharpest"] = len(finite) < len(sharp)
        figures["mtf50"] = float(np.mean(finite)) if finite else None
    mean = over.mean()
    return {
        "psnr": decibels(mean["psnr"]),
        "psnr_last": decibels(over.errors[-1].psnr),
        "psnr_frames": [decibels(one.psnr) for one in over.errors],
        "flicker": mean["flicker"],
        "flicker_frames": over.flicker,
        **figures,
    }


def begin(renderer: Any, case: Case, first: View) -> None:
    """Draw what comes before a sequence: until textures are there, and histories are those of a view at rest."""
    view = case.view(first, 0)
    renderer.render(view, case.time(0))
    renderer.wait_loaded()
    for _ in range(SETTLED if case.moves else 1):
        renderer.render(view, case.time(0))


def codes(frame: Any) -> NDArray[np.float64]:
    """Return what a frame shows (H, W, 3), 0 to 1."""
    return np.asarray(frame.image("color")[..., :3] / 255.0)


def unrounded(frame: Any, view: View) -> NDArray[np.float64]:
    """Return the same without the rounding to 8 bits, which moves small differences by a code."""
    return in_codes_of_light(frame.image("color_linear") * exposure(view.ev100))


def decibels(value: float | None) -> float | None:
    """Return a ratio for the record: None where it is infinite."""
    return None if value is None or math.isinf(value) else value


def rest(renderer: Any, view: View, drawn: int, truth: NDArray[np.float64]) -> dict[str, Any]:
    """Return how many frames a picture takes to rest, how good it is then, and how much it still flickers."""
    while drawn < MOST_FRAMES and not renderer.idle(view):
        renderer.render(view)
        drawn += 1
    over = OverTime(flip=False)
    for _ in range(AT_REST):
        over.add(codes(renderer.render(view)), truth)
    return {
        "rest": drawn,
        "psnr_rest": decibels(over.errors[-1].psnr),
        "flicker_rest": over.mean()["flicker"],
    }


class hidden:
    """Hides an instance of a scene, whose bounds stay as they are."""

    def __init__(self, scene: Scene, instance: int) -> None:
        self._scene, self._instance = scene, instance

    def __enter__(self) -> None:
        self._set(False)

    def __exit__(self, *_: object) -> None:
        self._set(True)

    def _set(self, visible: bool) -> None:
        with self._scene.edit() as change:
            change.set_visible(self._instance, visible)


def ghosts(
    seen: list[NDArray[np.float64]], without: list[NDArray[np.float64]], truth: list[Reference]
) -> dict[str, Any]:
    """Return the ghosts of an object in frames in which it has left pixels, by how many frames ago it did."""
    age = np.full(seen[0].shape[:2], -1)
    found: dict[int, list[tuple[float, float, int]]] = {number: [] for number in range(1, AGES + 1)}
    for frame, plain, should in zip(seen, without, truth, strict=True):
        assert should.covered is not None
        age = np.where(should.covered, 0, np.where(age >= 0, age + 1, -1))
        for number, held in found.items():
            where = age == number
            if where.any():
                left = ghost(frame, plain, where)
                held.append((left.most, left.mean, int(where.sum())))
    ages = []
    for held in found.values():
        count = sum(pixels for *_, pixels in held)
        ages.append(
            (
                max((most for most, *_ in held), default=0.0),
                sum(mean * pixels for _, mean, pixels in held) / max(count, 1),
            )
        )
    return {"ghost_max": ages[AFTER - 1][0], "ghost_mean": ages[AFTER - 1][1], "ghost_ages": ages}


def _times(subject: Subject, effort: Effort) -> list[dict[str, Any]]:
    """Return the times of passes of each mode."""
    drawn, software, rows = subject.on(scenes.still().scene), is_software(subject), []
    for name, values in modes_of(effort.everything):
        with drawn.open(scenes.settings_of(subject, **values), {"color"}) as renderer:
            views = _drifting(scenes.before_wall(), drawn.scene)
            for _ in range(effort.warm_up + 1):
                len(renderer.render(next(views)).timings)
            frames = min(effort.frames, SLOW_TIMED) if software else effort.frames
            times = times_of(renderer, views, GROUPS, frames, software)
        row: dict[str, Any] = {"mode": name}
        for group in GROUPS:
            row[f"{group}_ms"], row[f"{group}_noise_ms"] = times[group]
        rows.append(row)
    return rows


def _drifting(view: View, scene: Scene) -> Iterator[View]:
    """Yield views that no two frames share, much less than a pixel apart."""
    number = 0
    while True:
        number += 1
        yield moved_view(view, scene, number * 1e-3)
