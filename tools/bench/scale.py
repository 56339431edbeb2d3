"""What a thing more costs: time of a frame against the number of objects or materials, for a chapter and its rivals.

All points are opened before any is measured, and every round goes through all of them, in an order of its own: a busy
moment of the machine hits none of them alone, and none always follows one that leaves the caches full. The camera
moves from round to round, and the GPU is waited for after each frame, so that the next one's time holds no waiting.

`cpu_ms` is how long `render` took. A driver in software draws on the same processors, and its threads interrupt
Python's: so `python_ms` is the processor time that Python's own thread spent in it, with what the driver does within
the calls, and `record_ms` the part of that in which passes recorded their draws. Every point is held to the picture of
the others at its count: it must be the same.
"""

from __future__ import annotations

import statistics
import sys
import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console

import chapters
from backends.contract import Frame, Renderer
from common.reports.benches import Effort, difference, moved_view
from common.reports.tables import table
from common.scene import Scene
from common.settings import Scale, Side, preset, replaced
from common.view.camera import View
from tools.bench.points import Subject, forward_path
from tools.run.run import open_device

if sys.platform == "win32":  # its clock of a thread's time has steps of 16 ms
    _processor = clock.perf_counter
else:
    _processor = clock.thread_time

TIMES = ("cpu", "python", "record", "gpu")
"""What is measured of each frame, in ms."""

LEAST_FRAMES = 9
"""Of a point, also in a quick look: the median of fewer moves with every interruption."""

SLOW_S = 1.0
"""A point whose frames take longer gets no more than LEAST_FRAMES of them."""


@dataclass
class _Run:
    """One point: a side that is open at a count, and what it took."""

    side: Side
    count: int
    renderer: Renderer
    open_s: float
    recording: float = 0.0
    frame_s: float = 0.0  # from the call to the end on the GPU, of the last frame
    samples: list[tuple[float, ...]] = field(default_factory=list)  # in the order of TIMES
    error: dict[str, float] = field(default_factory=dict)
    work: dict[str, int] = field(default_factory=dict)

    def frame(self, view: View) -> Frame:
        """Return a frame that is over, and keep what it took."""
        self.recording = 0.0
        began = _processor()
        on_the_clock = clock.perf_counter()
        frame = self.renderer.render(view)
        python = _processor() - began
        self.samples.append((frame.cpu_ms, python * 1e3, self.recording * 1e3, sum(frame.timings.values())))
        self.frame_s = clock.perf_counter() - on_the_clock
        self.work = dict(frame.work)
        return frame

    def time_recording(self) -> None:
        """Let every pass tell how long it records."""
        for made in self.renderer.passes:

            def timed(*arguments: Any, record: Callable[..., None] = made.record) -> None:
                began = _processor()
                record(*arguments)
                self.recording += _processor() - began

            made.record = timed

    def point(self) -> dict[str, Any]:
        """Return what the record holds: medians, half the distance of the quartiles, the least."""
        found: dict[str, Any] = {"side": self.side.name, "count": self.count, "open_s": round(self.open_s, 3)}
        found["frames"] = len(self.samples)
        for name, values in zip(TIMES, zip(*self.samples, strict=True), strict=True):
            low, high = np.percentile(values, (25, 75))
            found[f"{name}_ms"] = statistics.median(values)
            found[f"{name}_noise_ms"] = float(high - low) / 2
            found[f"{name}_least_ms"] = min(values)
        return {**found, "error": self.error, "work": self.work}


def scales(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> list[dict[str, Any]]:
    """Return one record for each scale that the settings of the subject's chapter name."""
    wanted: tuple[Scale, ...] = getattr(chapters.settings_class(subject.chapter), "SCALES", ())
    return [
        _scale(subject, effort, one, lambda what, part: step(what, (number + part) / len(wanted)))  # noqa: B023
        for number, one in enumerate(wanted)
    ]


def _scale(
    subject: Subject, effort: Effort, scale: Scale, step: Callable[[str, float], None]
) -> dict[str, Any]:
    counts = scale.counts if effort.everything else scale.quick
    runs: list[_Run] = []
    skipped: list[dict[str, Any]] = []
    with ExitStack() as stack:
        devices: dict[tuple[str, ...], Any] = {(): subject.device}
        for number, count in enumerate(counts):
            scene = scale.scene(count)
            for side in scale.sides:
                why = _why_not(side, count, subject.device)
                if why:
                    skipped.append({"side": side.name, "count": count, "why": why})
                    continue
                step(f"{side.name} at {count:,} {scale.name}", 0.6 * number / len(counts))
                if side.without not in devices:
                    devices[side.without] = open_device(stack, subject.backend, without=side.without)
                runs.append(_open(stack, subject, side, count, scene, devices[side.without]))
        truths: dict[int, np.ndarray] = {}
        for run in runs:  # every slot is filled and every pipeline compiled before a time counts
            for turn in range(max(effort.warm_up, 2)):
                frame = run.frame(_view(run.renderer, turn))
            picture = frame.image("color_linear")
            truth = truths.setdefault(run.count, picture)
            run.error = difference(picture, truth)
        for run in runs:
            run.samples.clear()
            run.time_recording()
        random = np.random.default_rng(1)
        rounds = max(effort.frames * min(effort.rounds, 3), LEAST_FRAMES)
        for turn in range(rounds):
            step(f"frames with more and more {scale.name}", 0.6 + 0.4 * turn / rounds)
            for one in random.permutation(len(runs)):
                if turn >= LEAST_FRAMES and runs[one].frame_s > SLOW_S:
                    continue
                runs[one].frame(_view(runs[one].renderer, turn + one / len(runs)))
    points = [run.point() for run in runs]
    made = {"name": scale.name, "frames": rounds, "skipped": skipped, "points": points}
    return {**made, "ratios": ratios(points, scale.sides[-1].name, scale.flat_from)}


def _why_not(side: Side, count: int, device: Any) -> str:
    """Return why a side is not measured at a count, as the end of a sentence, or ""."""
    if side.most is not None and count > side.most:
        return side.why
    lacking = [feature for feature in side.without if feature not in device.capabilities.features]
    return f"this device has no {' and no '.join(lacking)} in any case" if lacking else ""


def _open(stack: ExitStack, subject: Subject, side: Side, count: int, scene: Scene, device: Any) -> _Run:
    which = subject.chapter if side.chapter is None else side.chapter
    began = clock.perf_counter()
    renderer = stack.enter_context(
        chapters.open(
            which,
            subject.backend,
            scene=scene,
            size=subject.size,
            settings=replaced(
                forward_path(preset(chapters.settings_class(which), "medium")), **dict(side.knobs)
            ),
            without=side.without,
            outputs={"color", "color_linear"},
            device=device,
        )
    )
    return _Run(side, count, renderer, clock.perf_counter() - began)


def _view(renderer: Renderer, turn: float) -> View:
    return moved_view(chapters.view_of(renderer), renderer.scene, turn)


# --- what the points say ----------------------------------------------------------------------------------------------


def ratios(points: list[dict[str, Any]], side: str, flat_from: int) -> dict[str, Any]:
    """Return how the time of `side` compares: with that of the others, and at most things with that at few.

    `times` says, at the largest count that another was measured at, how many times the time of `side` it takes: for all
    that Python does for a frame, for recording alone (None where `side` sends what it once recorded again), and on the
    GPU. `grown` is the Python time of `side` at each
    count above `flat_from` by that at the least of them.
    """
    own = {point["count"]: point for point in points if point["side"] == side}
    times: dict[str, dict[str, float | None]] = {}
    for point in points:  # later ones have more of it
        if point["side"] != side and point["count"] in own:
            beside = own[point["count"]]
            times[point["side"]] = {"count": point["count"]} | {
                name: _by(point[name], beside[name]) for name in ("python_ms", "record_ms", "gpu_ms")
            }
            if not beside["record_ms"]:
                times[point["side"]]["record_ms"] = None
    few, *more = [count for count in sorted(own) if count >= flat_from] or [0]
    grown = {str(count): _by(own[count]["python_ms"], own[few]["python_ms"]) for count in more}
    return {"side": side, "times": times, "from": few, "grown": grown}


def _by(time: float, other: float) -> float:
    """Return a ratio of times; infinite where a clock was too coarse to see the other."""
    return time / other if other > 0 else float("inf")


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record of one scale: a table of Python's times and one of the GPU's, and what they say."""
    name, points = made["name"], made["points"]
    sides = list(dict.fromkeys(point["side"] for point in points))
    for title, key in (("Python ms a frame", "python"), ("GPU ms a frame", "gpu")):
        shown = table(f"{title} by number of {name}", f">{name}", *(f">{side}" for side in sides))
        for count in dict.fromkeys(point["count"] for point in points):
            found = {point["side"]: point for point in points if point["count"] == count}
            shown.add_row(f"{count:,}", *(_cell(found.get(side), key) for side in sides))
        to.print(shown)
    for side in dict.fromkeys(one["side"] for one in made["skipped"]):
        left_out = [one for one in made["skipped"] if one["side"] == side]
        counts = ", ".join(f"{one['count']:,}" for one in left_out)
        to.print(f"Not measured: {side} at {counts}, since {left_out[0]['why']}.", soft_wrap=True)
    for line in sentences(made):
        to.print(line, soft_wrap=True)


def sentences(made: dict[str, Any]) -> list[str]:
    """Return what a scale's figures say, as sentences."""
    name, points, found = made["name"], made["points"], made["ratios"]
    side, said = found["side"], []
    again = any(ratio["record_ms"] is None for ratio in found["times"].values())
    for other, ratio in found["times"].items():
        said.append(
            f"At {ratio['count']:,} {name}, {other} takes {ratio['python_ms']:.3g} times the Python time of {side} "
            "for a frame"
            + ("." if again else f", and {ratio['record_ms']:.3g} times for recording its draws.")
        )
    if again:
        said.append(f"With {side} no draw is recorded in these frames: what was recorded once is sent again.")
    if found["grown"]:
        most = max(found["grown"], key=int)
        furthest = max(found["grown"].values(), key=lambda ratio: abs(ratio - 1))
        noise = max(p["python_noise_ms"] / p["python_ms"] for p in points if p["side"] == side)
        said.append(
            f"From {found['from']:,} to {int(most):,} {name}, the Python time of a frame with {side} changes by "
            f"{furthest - 1:+.1%} at most; half of all frames lie within {noise:.1%} of the median."
        )
    said += _against_others(points, side, name)
    worst = max(points, key=lambda point: (point["error"]["pixels_differ"], point["error"]["max_abs"]))
    if worst["error"]["pixels_differ"]:
        said.append(
            f"The pictures differ: {worst['side']} at {worst['count']:,} {name} by up to "
            f"{worst['error']['max_abs']:.2g} in {worst['error']['pixels_differ']:,} pixels."
        )
    else:
        said.append(f"At every number of {name}, all pictures are the same to the bit.")
    return said


def _against_others(points: list[dict[str, Any]], side: str, name: str) -> list[str]:
    """Return how much more Python time `side` takes than other chapters that are measured at all of its counts."""
    own, said = {point["count"]: point for point in points if point["side"] == side}, []
    for other in dict.fromkeys(point["side"] for point in points):
        found = {point["count"]: point for point in points if point["side"] == other}
        if other == side or not other.startswith("chapter") or found.keys() != own.keys() or len(own) < 2:
            continue
        more = {count: own[count]["python_ms"] - found[count]["python_ms"] for count in own}
        best = {count: own[count]["python_least_ms"] - found[count]["python_least_ms"] for count in own}
        most = max(more, key=lambda count: more[count])
        noise = max(np.hypot(own[count]["python_noise_ms"], found[count]["python_noise_ms"]) for count in own)
        said.append(
            f"From {min(own):,} to {max(own):,} {name}, a frame with {side} takes "
            f"{statistics.median(more.values()):+.3f} ms more Python time than with {other} in the median of the "
            f"counts, at most {more[most]:+.3f} ms (at {most:,}; of the quickest frames {max(best.values()):+.3f} ms); "
            f"the noise of a difference is {noise:.3f} ms."
        )
    return said


def _cell(point: dict[str, Any] | None, key: str) -> str:
    return "-" if point is None else f"{point[f'{key}_ms']:.2f} ±{point[f'{key}_noise_ms']:.2f}"


def plot(axes: Any, below: Any, made: dict[str, Any]) -> None:
    """Draw a scale's times against its counts into `axes`, and below it the error of each point, which should be 0."""
    points = made["points"]
    for number, side in enumerate(dict.fromkeys(point["side"] for point in points)):
        found = [point for point in points if point["side"] == side]
        counts = [point["count"] for point in found]
        colour, mark = f"C{number}", "os^D"[number % 4]
        for key, line, label in (("python", "-", side), ("gpu", ":", None)):
            times = [point[f"{key}_ms"] for point in found]
            noise = [point[f"{key}_noise_ms"] for point in found]
            axes.errorbar(counts, times, noise, fmt=line + mark, color=colour, label=label, capsize=2, ms=4)
        below.plot(counts, [point["error"]["max_abs"] for point in found], mark, color=colour, ms=4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylabel("ms a frame: solid Python, dotted GPU")
    axes.set_title(f"What {made['name']} cost", fontsize=10)
    axes.legend(fontsize=8)
    below.set_ylim(-1, max(1, 1.1 * max(point["error"]["max_abs"] for point in points)))
    below.axhline(0, color="0.7", zorder=0)
    below.set_xlabel(f"number of {made['name']}")
    below.set_ylabel("max. error", fontsize=8)
