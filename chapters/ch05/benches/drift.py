"""Energy and length of a cloth over thousands of substeps, without damping, air, weight and contact.

Nothing takes energy from this cloth, so each loss or gain comes from the method. With symplectic Euler and velocity
Verlet the energy oscillates without a trend, by an amount that depends on the step alone (h omega, with omega the
fastest swing). XPBD, an implicit method, loses energy, and faster with longer steps. Very short steps are another
matter in float32: a constraint then moves a particle by less than the last bit of its position. The motion is lost, and
threads do not pull any more. The same substeps in float64 show it.

The bench measures the twin in numpy, in float32 unless stated otherwise. It does the operations of the GPU, one by one:
a renderer has no cloth without weight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject
from common.reports.tables import table
from common.scene.sheets import cloth, cloth_scene_of
from common.settings import knobs

from . import measures
from .sheet import KNOB, cloth_of
from .twin import Twin

SUBSTEPS, QUICK_SUBSTEPS = 10_000, 1_000

EDGE = 4
"""Vertices along an edge: numpy's time depends on its number of calls."""

SPEED = 0.3
"""Standard deviation of each particle's velocity at the beginning, in metres a second along each axis."""

SAMPLES = 1000
"""Samples of energy and stretch."""

KEPT = 100
"""Most samples in the record, as a curve that a logarithmic axis shows evenly."""


@dataclass(frozen=True)
class Case:
    """A method, the length of its steps, the part of all substeps that shows its behaviour, and its precision."""

    name: str
    steps: dict[str, Any]
    h_omega: float
    part: float = 1.0
    dtype: Any = np.float32


_XPBD = {"method": "xpbd"}
CASES = (
    Case("euler", {"method": "springs", "integrator": "euler"}, 0.02),
    Case("verlet", {"method": "springs", "integrator": "verlet"}, 0.2),
    Case("XPBD", _XPBD, 2.0, 0.1),
    Case("XPBD", _XPBD, 0.2, 0.4),
    Case("XPBD", _XPBD, 0.02, 0.2),
    Case("XPBD", _XPBD, 0.02, 0.2, np.float64),
)


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], substeps: int | None = None
) -> dict[str, Any] | None:
    """Return the record of a chapter that has cloth; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    substeps = substeps or (SUBSTEPS if effort.everything else QUICK_SUBSTEPS)
    scene = cloth_scene_of(cloth(EDGE, EDGE, pins=[0, EDGE - 1], damping_per_s=0), size=(EDGE, EDGE))
    sheet = cloth_of(subject, "scene").cloth_scene(scene).cloths[0]
    points = []
    for number, case in enumerate(CASES):
        step(f"{case.name}, h omega {case.h_omega:g}", number / len(CASES))
        points.append(_drift(subject, sheet, case, max(int(substeps * case.part), 10)))
    return {"particles": len(sheet.positions), "substeps": substeps, "points": points}


def _drift(subject: Subject, sheet: Any, case: Case, count: int) -> dict[str, Any]:
    types = cloth_of(subject, "types")
    omega = cloth_of(subject, "steps").greatest_omega(sheet)
    no_forces = types.Forces(gravity=(0.0, 0.0, 0.0), air_density=0.0)
    steps = types.Steps(dt=case.h_omega / omega, substeps=1, **case.steps)
    twin = Twin(sheet, steps, no_forces, dtype=case.dtype)
    noise = np.random.default_rng(1).normal(size=sheet.positions.shape) * SPEED
    twin.state.velocities = np.where(sheet.held[:, None], 0.0, noise).astype(case.dtype)
    first = measures.energy(sheet, twin.state, no_forces).total
    interval = max(count // SAMPLES, 1)
    energies, stretches = [], []
    for _ in range(count // interval):
        twin.advance(interval)
        energies.append(measures.energy(sheet, twin.state, no_forces).total / first)
        stretches.append(measures.stretch(sheet, twin.state).rms)
    samples = np.unique(np.geomspace(1, len(energies), KEPT).astype(int)) - 1
    return {
        "name": case.name,
        "precision": np.dtype(case.dtype).name,
        "h_omega": case.h_omega,
        "substeps": count,
        "seconds": count * steps.dt,
        "strays": float(np.abs(np.array(energies) - 1.0).max()),
        "energy_trend": _trend(energies),
        "energy_last": energies[-1],
        "stretch_rms": float(np.mean(stretches)),
        "stretch_greatest": max(stretches),
        "stretch_trend": _trend(stretches),
        "curve": [[(k + 1) * interval, energies[k], stretches[k]] for k in samples.tolist()],
    }


def _trend(values: list[float]) -> float:
    """Return the mean of the second half, minus that of the first."""
    half = len(values) // 2
    return float(np.mean(values[half:]) - np.mean(values[:half]))


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and its sentences."""
    shown = table(
        f"Cloth of {record['particles']} particles left alone: parts of its first energy, rms stretch",
        *("method", "bits", ">h omega", ">substeps", ">strays", ">trend", ">left", ">stretch", ">trend"),
    )
    for point in record["points"]:
        shown.add_row(
            point["name"],
            point["precision"].removeprefix("float"),
            f"{point['h_omega']:g}",
            f"{point['substeps']:,}",
            f"{point['strays']:.2%}",
            f"{point['energy_trend']:+.2%}",
            f"{point['energy_last']:.1%}",
            f"{point['stretch_rms']:.2%}",
            f"{point['stretch_trend']:+.2%}",
        )
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    springs = [point for point in record["points"] if point["name"] != "XPBD"]
    xpbd = [point for point in record["points"] if point["name"] == "XPBD"]
    kept = " and ".join(
        f"springs with {point['name']} at h omega {point['h_omega']:g} {point['strays']:.2%}"
        for point in springs
    )
    left = ", ".join(
        f"{point['energy_last']:.1%} after {point['substeps']:,} of h omega {point['h_omega']:g} in "
        f"{point['precision']}"
        for point in xpbd
    )
    return [f"From its first energy strays the cloth by at most: {kept}.", f"XPBD has of it left: {left}."]


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the energy that is left against the substeps, and dotted the stretch."""
    stretched = axes.twinx()
    for number, point in enumerate(record["points"]):
        substeps, energy, stretch = (list(column) for column in zip(*point["curve"], strict=True))
        label = f"{point['name']}, h$\\omega$ = {point['h_omega']:g}, {point['precision']}"
        axes.plot(substeps, energy, "-", color=f"C{number}", lw=1.4, label=label)
        stretched.plot(substeps, stretch, ":", color=f"C{number}", lw=0.8)
    stretched.set_ylim(bottom=0)
    stretched.set_ylabel("dotted: rms stretch of the threads")
    axes.set_ylim(bottom=0)
    axes.set_xscale("log")
    axes.set_xlabel("substeps")
    axes.set_ylabel("energy, of that at the beginning")
    axes.set_title("Cloth left alone", fontsize=10)
    axes.legend(fontsize=8)
