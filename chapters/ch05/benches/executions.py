"""What runs a cloth fastest: one thread, a work group, or a dispatch for each stage, by its number of particles.

All three give the same bits. A work group keeps its cloth in one processor of the GPU and needs one dispatch for all
substeps; a dispatch for each stage uses all processors, and waits between stages. So there is a number of particles
from which on the second is faster, and where nobody says how, the chapter goes over at one that it names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table

from .sheet import cloth_of, level_sheet, medium_of, opened, states, timed_step

EDGES = (8, 16, 32, 64, 128, 256)
"""Vertices along an edge of the sheets; software leaves out the last, of which a step takes it seconds."""

QUICK_EDGES = (32,)

EXECUTIONS = ("thread", "group", "dispatch")

MOST = {"thread": 1024}
"""Particles of the largest sheet that is measured, where more would take seconds a step."""

WARM_UP, STEPS = 2, 8
"""Frames before those that count, of which the first moves nothing, and frames of a step each that do."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any]:
    """Return the ms of a step of cloth by execution and number of particles, and where the chapter goes over.

    Each point draws some frames of one step each. `same` says whether all executions came to the same bits.
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
                times = [timed_step(subject, renderer, made, dt) for made in range(WARM_UP + STEPS)][WARM_UP:]
                (state,) = states(renderer)
            truth = state if truth is None else truth
            same = same and np.array_equal(state.positions, truth.positions)
            median, noise = middle(times)
            points.append(
                {"execution": execution, "particles": edge * edge, "gpu_ms": median, "noise_ms": noise}
            )
    return {
        "substeps": medium_of(subject).cloth_substeps,
        "goes_over": cloth_of(subject, "dispatches").LARGEST_GROUP,
        "same": same,
        "points": points,
    }


# --- what came out ----------------------------------------------------------------------------------------------------


def _by_particles(made: dict[str, Any]) -> dict[int, dict[str, dict[str, Any]]]:
    found: dict[int, dict[str, dict[str, Any]]] = {}
    for one in made["points"]:
        found.setdefault(one["particles"], {})[one["execution"]] = one
    return found


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and what it says."""
    shown = table(
        f"GPU ms of a step of {made['substeps']} substeps, by what runs the cloth",
        *(">particles", *(f">{one}" for one in EXECUTIONS)),
    )
    for particles, row in _by_particles(made).items():
        cells = [
            f"{row[one]['gpu_ms']:.3f} ±{row[one]['noise_ms']:.3f}" if one in row else "-"
            for one in EXECUTIONS
        ]
        shown.add_row(f"{particles:,}", *cells)
    to.print(shown)
    for line in sentences(made):
        to.print(line, soft_wrap=True)


def sentences(made: dict[str, Any]) -> list[str]:
    """Return what the figures say, as sentences."""
    rows = _by_particles(made)
    faster = None
    for particles, row in reversed(rows.items()):  # from here on to the most particles
        if row["dispatch"]["gpu_ms"] >= row["group"]["gpu_ms"]:
            break
        faster = particles
    said = f"the chapter goes over beyond {made['goes_over']:,}."
    first = (
        f"A dispatch for each stage is faster than a work group from {faster:,} particles on; {said}"
        if faster
        else f"A dispatch for each stage is not faster than a work group with {max(rows):,} particles; {said}"
    )
    same = "All of them come to the same bits." if made["same"] else "They do not come to the same bits."
    return [first, same]


def plot(axes: Any, made: dict[str, Any]) -> None:
    """Draw the time of a step against the number of particles."""
    for number, execution in enumerate(EXECUTIONS):
        points = [one for one in made["points"] if one["execution"] == execution]
        axes.errorbar(
            [one["particles"] for one in points],
            [one["gpu_ms"] for one in points],
            [one["noise_ms"] for one in points],
            fmt="-" + "osD"[number],
            color=f"C{number}",
            label=execution,
            capsize=2,
            ms=4,
        )
    axes.axvline(made["goes_over"], color="0.6", lw=0.8, ls="--", label="where the chapter goes over")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    axes.set_xlabel("particles of the cloth")
    axes.set_ylabel(f"GPU ms of a step of {made['substeps']} substeps")
    axes.set_title("What runs a cloth", fontsize=10)
    axes.legend(fontsize=8)
