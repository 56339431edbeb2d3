"""The CPU's cost of pacing: waits and submissions of a frame, by timelines and by fences.

The study `5/timeline-or-fences` runs the same two submissions a frame in each of its ways. The ways take turns, so that
other load of the machine meets all alike. Before a frame begins the GPU is done with all submissions, so a wait costs
only its call. The time of a frame without such waits is the renderer's own `cpu_ms`.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.settings import knobs

from ..studies.timeline_or_fences import WAYS, Settings

KNOB = "async_compute"
"""The setting; frames of a chapter without it are not paced by timelines."""

STUDY = "5/timeline-or-fences"
SIZE = (64, 64)
WARM_UP = 8
"""Frames before the measured ones, in which Python creates structs and the driver compiles shaders."""

COUNTED = ("objects", "cpu_waits", "queue_waits", "calls")
"""Counts of a frame, the same for all frames after the first ones."""


FRAMES, QUICK_FRAMES = 300, 30


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None]
) -> list[dict[str, Any]] | None:
    """Return the result of `measure_pacing` for a chapter with timelines; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    return measure_pacing(subject, FRAMES if effort.everything else QUICK_FRAMES, step)


def measure_pacing(
    subject: Subject, frames: int = 300, step: Callable[[str, float], None] | None = None
) -> list[dict[str, Any]]:
    """Return for each way its name, its counts, and the microseconds of "wait" and "submit".

    "wait_us" is the median over `frames`, "wait_noise_us" the noise from `middle`. One frame in twenty stays below
    "wait_best_us": a software driver draws on the same cores and disturbs the others. `step` gets the progress.
    """
    study = subject.study(STUDY, SIZE)
    times: dict[str, list[tuple[float, float]]] = {way: [] for way in WAYS}
    counts: dict[str, dict[str, int]] = {}
    with ExitStack() as stack:
        opened = {way: stack.enter_context(study.open(Settings(way=way), set())) for way in WAYS}
        for number in range(WARM_UP + frames):
            first = number % len(WAYS)  # the order of the ways changes, too
            for way in (*WAYS[first:], *WAYS[:first]):
                renderer = opened[way]
                subject.device.wait_idle()
                work = renderer.render(study.view(renderer), number / 60).work
                if number >= WARM_UP:
                    times[way].append((work["wait_ns"] / 1e3, work["submit_ns"] / 1e3))
                counts[way] = {name: work[name] for name in COUNTED}
            if step is not None:
                step("pacing", (number + 1) / (WARM_UP + frames))
    return [_record(way, times[way]) | counts[way] for way in WAYS]


def _record(way: str, times: list[tuple[float, float]]) -> dict[str, Any]:
    record: dict[str, Any] = {"way": way}
    for place, name in enumerate(("wait", "submit")):
        values = [frame[place] for frame in times]
        record[f"{name}_us"], record[f"{name}_noise_us"] = middle(values)
        record[f"{name}_best_us"] = float(np.percentile(values, 5))
    return record


# --- results ----------------------------------------------------------------------------------------------------------


def show(records: list[dict[str, Any]], to: Console) -> None:
    """Print the record as a table, and its sentences."""
    shown = table(
        "Pacing two submissions a frame: us of the CPU, the GPU done before",
        *("way", ">wait", ">±", ">best", ">submit", ">±", ">best", ">objects", ">calls"),
    )
    for record in records:
        times = (
            f"{record[f'{name}{end}_us']:.1f}"
            for name in ("wait", "submit")
            for end in ("", "_noise", "_best")
        )
        shown.add_row(record["way"], *times, str(record["objects"]), str(record["calls"]))
    to.print(shown)
    to.print(sentence(records), soft_wrap=True)


def sentence(records: list[dict[str, Any]]) -> str:
    """Return the results as a sentence."""
    by_way = {record["way"]: record for record in records}
    usual, best = (
        {way: record[f"wait{end}_us"] + record[f"submit{end}_us"] for way, record in by_way.items()}
        for end in ("", "_best")
    )
    return (
        f"Waiting and submitting take {usual['timelines']:.0f} us a frame with timelines (at best "
        f"{best['timelines']:.0f}), and {usual['fences']:.0f} us with fences and binary semaphores (at best "
        f"{best['fences']:.0f})."
    )


def plot(axes: Any, records: list[dict[str, Any]]) -> None:
    """Draw the times of waiting and submitting in each way."""
    names = [record["way"] for record in records]
    below = np.zeros(len(records))
    for name in ("wait", "submit"):
        values = [record[f"{name}_us"] for record in records]
        noise = [record[f"{name}_noise_us"] for record in records]
        axes.bar(names, values, 0.6, below, yerr=noise, label=name, capsize=2)
        below = below + values
    axes.set_ylabel("us of the CPU a frame")
    axes.set_title("What pacing costs", fontsize=10)
    axes.legend(fontsize=8)
