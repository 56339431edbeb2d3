"""Figures of what the bench itself measures of every chapter: settings, starts, scales, pipelines, threads."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from tools.bench.figures.kinds import Figure, Row, errors_of, point_of, times_of, work_of

OF_BOUND = 0.1
"""The pixels of a case of stability may change by so much of the bound."""


def _settings(made: dict[str, Any]) -> Iterator[Row]:
    for one in made["points"]:
        times = times_of(one, "gpu_ms", "wall_ms", "cpu_ms", within="passes_ms")
        yield one["name"], times | errors_of(one["error"]) | work_of(one["work"])


def _prepared(made: dict[str, Any]) -> Iterator[Row]:
    for swept in made["prepared"]:
        for one in swept["points"]:
            times = times_of(one, "gpu_ms", within="parts_ms")
            yield point_of(swept["name"], one["name"]), times | errors_of(one["error"])


def _start(made: dict[str, Any]) -> Iterator[Row]:
    for state, one in made["start_s"].items():
        total = Figure(
            "time", float(one["total"]), within={k: v for k, v in one.items() if k not in NO_STEPS}
        )
        yield state, {"total_s": total, **work_of(one, "shaders_compiled")}


NO_STEPS = frozenset({"total", "shaders_compiled"})
"""What a start has beside the seconds of its steps."""


def _stability(made: dict[str, Any]) -> Iterator[Row]:
    held = made["stability"] or {"bound": 0.0, "cases": []}
    for one in held["cases"]:
        yield (
            one["case"],
            {"pixels_changed": Figure("error", float(one["pixels_changed"]), slack=OF_BOUND * held["bound"])},
        )


def _scales(made: dict[str, Any]) -> Iterator[Row]:
    for scale in made.get("scales", ()):
        for one in scale["points"]:
            times = times_of(one, "python_ms", "record_ms", "gpu_ms")
            yield (
                point_of(scale["name"], one["count"], one["side"]),
                times | errors_of(one["error"]) | work_of(one["work"]),
            )


def _pipelines(made: dict[str, Any]) -> Iterator[Row]:
    if held := made.get("pipelines"):
        yield "all", errors_of(held["error"]) | work_of(held, "pipelines")
        for state, one in held["states"].items():
            yield state, times_of(one, "ms")


def _threads(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("threads") or {"points": ()})["points"]:
        figure = times_of(one, "record_ms", "cpu_ms") | errors_of(one["error"]) | work_of(one, "draw_calls")
        yield point_of(f"{one['draws']} draws", f"{one['threads']} threads"), figure


def _readback(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("readback") or {"points": ()})["points"]:
        yield one["kind"], times_of(one, "ms")


def _prepass(made: dict[str, Any]) -> Iterator[Row]:
    for one in (made.get("prepass") or {"points": ()})["points"]:
        point = point_of(one["path"], f"{one['layers']} layers", "with it" if one["prepass"] else "without")
        yield (
            point,
            times_of(one, "gpu_ms", within="passes_ms") | errors_of(one["error"]) | work_of(one, "shaded"),
        )


PARTS = {
    "settings": _settings,
    "prepared": _prepared,
    "start": _start,
    "stability": _stability,
    "scales": _scales,
    "pipelines": _pipelines,
    "threads": _threads,
    "readback": _readback,
    "prepass": _prepass,
}
"""How the points of these parts are found in a record."""
