"""What threads bring to recording: the time that passes take to be recorded, by number of threads and of draws.

Every draw is a call of its own here (multi-draw is off), or there would be nothing to share. All points are open at
once and every round goes through all of them in an order of its own, as in `tools.bench.scale`; the GPU is waited
for after each frame. Times are those on the clock: what threads spare is waiting, not work.
"""

from __future__ import annotations

import statistics
import time as clock
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rich.console import Console

import chapters
from backends.contract import Renderer
from common.reports.benches import Effort, difference, recorded_anew
from common.reports.tables import table
from common.scene.crowds import crowd
from common.settings import preset
from tools.bench.points import Subject
from tools.run.run import open_device

WITHOUT = ("multi-draw",)
DRAWS = (1000, 10_000)
MATERIALS = 64
LEAST_FRAMES = 9
"""Of a point, also in a quick look: the median of fewer moves with every interruption."""


@dataclass
class _Run:
    """One point: a renderer that is open, and what its frames took."""

    draws: int
    threads: int
    renderer: Renderer
    recording: float = 0.0
    samples: list[tuple[float, float]] = field(default_factory=list)
    error: dict[str, float] = field(default_factory=dict)
    work: dict[str, int] = field(default_factory=dict)

    def time_recording(self) -> None:
        """Let the renderer tell how long its passes take to be recorded, from label to label."""
        renderer: Any = self.renderer
        # Where a frame is a graph, its executor goes through all passes; else the renderer runs each of them.
        graph = hasattr(renderer, "graph")
        owner, name = (renderer._api.executor, "record") if graph else (renderer, "_run")
        run = getattr(owner, name)

        def timed(*arguments: Any) -> None:
            began = clock.perf_counter()
            run(*arguments)
            self.recording += (clock.perf_counter() - began) * 1e3

        setattr(owner, name, timed)

    def frame(self) -> Any:
        """Return a frame that is over, and keep what it took."""
        self.recording = 0.0
        frame = self.renderer.render(chapters.view_of(self.renderer))
        self.samples.append((self.recording, frame.cpu_ms))
        self.work = dict(frame.work)
        sum(frame.timings.values())  # waits for the GPU
        return frame

    def point(self) -> dict[str, Any]:
        """Return what the record holds: medians, and half the distance of the quartiles."""
        found: dict[str, Any] = {"draws": self.draws, "threads": self.threads}
        for name, values in zip(("record", "cpu"), zip(*self.samples, strict=True), strict=True):
            low, high = np.percentile(values, (25, 75))
            found[f"{name}_ms"] = statistics.median(values)
            found[f"{name}_noise_ms"] = float(high - low) / 2
        parts, calls = self.work["recorded_parts"], self.work["draw_calls"]
        return {**found, "parts": parts, "draw_calls": calls, "error": self.error}


def measure(
    subject: Subject,
    effort: Effort,
    step: Callable[[str, float], None],
    draws: Sequence[int] = DRAWS,
) -> dict[str, Any] | None:
    """Return the record of recording with the numbers of threads in `Settings.THREADS`; None where there are none."""
    settings_class = chapters.settings_class(subject.chapter)
    wanted: tuple[int, ...] = getattr(settings_class, "THREADS", ())
    if not wanted:
        return None
    anew = recorded_anew(preset(settings_class, "medium"))
    runs: list[_Run] = []
    with ExitStack() as stack:
        device = open_device(stack, subject.backend, without=WITHOUT)
        for count in draws:
            scene = crowd(count, MATERIALS)
            for threads in wanted:
                step(f"{count:,} draws, {threads} threads", 0.5 * len(runs) / (len(draws) * len(wanted)))
                renderer = stack.enter_context(
                    chapters.open(
                        subject.chapter,
                        subject.backend,
                        scene=scene,
                        size=subject.size,
                        settings=replace(anew, recording_threads=threads),
                        without=WITHOUT,
                        outputs={"color", "color_linear"},
                        device=device,
                    )
                )
                runs.append(_Run(count, threads, renderer))
        truths: dict[int, np.ndarray] = {}
        for run in runs:
            for _ in range(max(effort.warm_up, 2)):
                frame = run.frame()
            picture = frame.image("color_linear")
            run.error = difference(picture, truths.setdefault(run.draws, picture))
            run.samples.clear()
            run.time_recording()
        random = np.random.default_rng(1)
        rounds = max(effort.frames * min(effort.rounds, 3), LEAST_FRAMES)
        for turn in range(rounds):
            step("frames with more and more threads", 0.5 + 0.5 * turn / rounds)
            for one in random.permutation(len(runs)):
                runs[one].frame()
        points = [run.point() for run in runs]
    return {"frames": rounds, "without": list(WITHOUT), "points": points}


# --- what the points say ----------------------------------------------------------------------------------------------


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and what it says."""
    shown = table(
        "Recording a call for each draw",
        *(">draws", ">threads", ">parts", ">record ms", ">±", ">times", ">frame ms", ">±"),
    )
    for point in made["points"]:
        shown.add_row(
            f"{point['draws']:,}",
            _named(point["threads"]),
            str(point["parts"]),
            f"{point['record_ms']:.2f}",
            f"{point['record_noise_ms']:.2f}",
            f"{point['record_ms'] / _alone(made, point)['record_ms']:.2f}",
            f"{point['cpu_ms']:.2f}",
            f"{point['cpu_noise_ms']:.2f}",
        )
    to.print(shown)
    for line in sentences(made):
        to.print(line, soft_wrap=True)


def _named(threads: int) -> str:
    return f"1 + {threads}" if threads else "1"


def _alone(made: dict[str, Any], point: dict[str, Any]) -> dict[str, Any]:
    """Return the point with as many draws and no threads beside the renderer's."""
    found: dict[str, Any] = next(
        one for one in made["points"] if one["draws"] == point["draws"] and not one["threads"]
    )
    return found


def sentences(made: dict[str, Any]) -> list[str]:
    """Return what the figures say, as sentences."""
    most = max(point["draws"] for point in made["points"])
    of_most = [point for point in made["points"] if point["draws"] == most]
    alone = _alone(made, of_most[0])
    best = min((point for point in of_most if point["threads"]), key=lambda point: point["record_ms"])
    times = best["record_ms"] / alone["record_ms"]
    call_us = alone["record_ms"] * 1e3 / alone["draw_calls"]
    said = [
        f"At {most:,} draws the best number of threads beside the renderer's, {best['threads']}, takes {times:.2f} "
        f"times as long as none: a call takes {call_us:.2f} us with all that Python does for it, and only one thread "
        "at a time can run Python (on a build of it that has the lock). What helps is fewer calls: multi-draw makes "
        "these few."
    ]
    worst = max(made["points"], key=lambda point: point["error"]["pixels_differ"])
    if worst["error"]["pixels_differ"]:
        said.append(
            f"The pictures differ: with {worst['threads']} threads in {worst['error']['pixels_differ']:,} pixels."
        )
    else:
        said.append("With every number of threads the picture is the same to the bit.")
    return said
