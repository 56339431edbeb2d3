"""The fastest execution of a cloth: one thread, a work group, or a dispatch for each stage, by number of particles.

All three give the same bits. A work group keeps its cloth in one processor of the GPU and needs one dispatch for all
substeps. A dispatch for each stage uses all processors, and waits between stages. So it is faster from some number of
particles on. The chapter's "auto" changes over at its own number, `LARGEST_GROUP`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.settings import flat

from .sheet import cloth_of, level_sheet, medium_of, opened, states, timed_step

EDGES = (8, 16, 32, 64, 128, 256)
"""Vertices along an edge of the sheets; software leaves out the last, of which a step takes it seconds."""

QUICK_EDGES = (32,)

EXECUTIONS = ("thread", "group", "dispatch")

MOST = {"thread": 1024}
"""Particles of the largest sheet to measure by an execution whose steps would take seconds."""

WARM_UP, STEPS = 2, 8
"""Frames before the measured ones, the first without motion, and measured frames of one step each."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any]:
    """Return the ms of a step of cloth by execution and number of particles, and where the chapter changes over.

    Each point draws some frames of one step each. `same` is whether all executions gave the same bits.
    """
    points: list[dict[str, Any]] = []
    same = True
    software = subject.device.capabilities.kind == "software"
    edges = EDGES[: -1 if software else None] if effort.everything else QUICK_EDGES
    for number, edge in enumerate(edges):
        scene, truth = level_sheet(edge), None
        for execution in EXECUTIONS:
            if edge * edge > MOST.get(execution, edge * edge):
                continue
            step(f"{edge * edge:,} particles, {execution}", number / len(edges))
            with opened(subject, scene, medium_of(subject, cloth_execution=execution)) as renderer:
                drawn: Any = renderer
                dt = drawn.techniques["cloth"].cloth.frames.steps.dt
                times = [timed_step(subject, renderer, frame, dt) for frame in range(WARM_UP + STEPS)][
                    WARM_UP:
                ]
                (state,) = states(renderer)
            truth = state if truth is None else truth
            same = same and np.array_equal(state.positions, truth.positions)
            median, noise = middle(times)
            points.append(
                {"execution": execution, "particles": edge * edge, "gpu_ms": median, "noise_ms": noise}
            )
    return {
        "substeps": flat(medium_of(subject))["cloth_substeps"],
        "goes_over": cloth_of(subject, "dispatches").LARGEST_GROUP,
        "same": same,
        "points": points,
    }


# --- results ----------------------------------------------------------------------------------------------------------


def _by_particles(record: dict[str, Any]) -> dict[int, dict[str, dict[str, Any]]]:
    by_particles: dict[int, dict[str, dict[str, Any]]] = {}
    for point in record["points"]:
        by_particles.setdefault(point["particles"], {})[point["execution"]] = point
    return by_particles


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and its sentences."""
    shown = table(
        f"GPU ms of a step of {record['substeps']} substeps, by what runs the cloth",
        *(">particles", *(f">{execution}" for execution in EXECUTIONS)),
    )
    for particles, row in _by_particles(record).items():
        cells = [
            f"{row[execution]['gpu_ms']:.3f} ±{row[execution]['noise_ms']:.3f}" if execution in row else "-"
            for execution in EXECUTIONS
        ]
        shown.add_row(f"{particles:,}", *cells)
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    rows = _by_particles(record)
    faster = None
    for particles, row in reversed(rows.items()):  # from the most particles down
        if row["dispatch"]["gpu_ms"] >= row["group"]["gpu_ms"]:
            break
        faster = particles
    limit = f"the chapter goes over beyond {record['goes_over']:,}."
    first = (
        f"A dispatch for each stage is faster than a work group from {faster:,} particles on; {limit}"
        if faster
        else f"A dispatch for each stage is not faster than a work group with {max(rows):,} particles; {limit}"
    )
    same = "All of them come to the same bits." if record["same"] else "They do not come to the same bits."
    return [first, same]


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time of a step against the number of particles."""
    for number, execution in enumerate(EXECUTIONS):
        points = [point for point in record["points"] if point["execution"] == execution]
        axes.errorbar(
            [point["particles"] for point in points],
            [point["gpu_ms"] for point in points],
            [point["noise_ms"] for point in points],
            fmt="-" + "osD"[number],
            color=f"C{number}",
            label=execution,
            capsize=2,
            ms=4,
        )
    axes.axvline(record["goes_over"], color="0.6", lw=0.8, ls="--", label="where the chapter goes over")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xlabel("particles of the cloth")
    axes.set_ylabel(f"GPU ms of a step of {record['substeps']} substeps")
    axes.set_title("What runs a cloth", fontsize=10)
    axes.legend(fontsize=8)
