"""What becomes of a cloth's energy and length over thousands of substeps, without damping, air, weight and contact.

Nothing takes energy from this cloth, so a method that loses or gains some does it by itself. Symplectic Euler and
velocity Verlet let the energy go to and fro by an amount that depends on the step alone (h omega, with omega the
fastest swing) and have no trend; XPBD, an implicit method, loses energy, and the faster the longer its steps. Very
short steps are another matter in float32: by what a constraint moves a particle then is less than the last bit of its
position, and is lost, so that threads do not pull any more. The same substeps in float64 show it.

What is measured is the twin in numpy, in float32 if nothing else is said, which does what the GPU does, operation for
operation: a renderer has no cloth without weight.
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
"""Vertices along an edge: numpy's time is that of its calls."""

SPEED = 0.3
"""Metres a second, the standard deviation of each particle's velocity at the beginning, along each axis."""

SAMPLES = 1000
"""Of energy and stretch."""

KEPT = 100
"""Of them in the record, at most, as a curve that a logarithmic axis shows evenly."""


@dataclass(frozen=True)
class Case:
    """A method, how long its steps are, which part of all substeps shows what it does, and its bits."""

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
    nothing = types.Forces(gravity=(0.0, 0.0, 0.0), air_density=0.0)
    steps = types.Steps(dt=case.h_omega / omega, substeps=1, **case.steps)
    twin = Twin(sheet, steps, nothing, dtype=case.dtype)
    noise = np.random.default_rng(1).normal(size=sheet.positions.shape) * SPEED
    twin.state.velocities = np.where(sheet.held[:, None], 0.0, noise).astype(case.dtype)
    first = measures.energy(sheet, twin.state, nothing).total
    every = max(count // SAMPLES, 1)
    energies, stretches = [], []
    for _ in range(count // every):
        twin.advance(every)
        energies.append(measures.energy(sheet, twin.state, nothing).total / first)
        stretches.append(measures.stretch(sheet, twin.state).rms)
    kept = np.unique(np.geomspace(1, len(energies), KEPT).astype(int)) - 1
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
        "curve": [[(k + 1) * every, energies[k], stretches[k]] for k in kept.tolist()],
    }


def _trend(values: list[float]) -> float:
    """Return by how much the mean of the second half is above that of the first."""
    half = len(values) // 2
    return float(np.mean(values[half:]) - np.mean(values[:half]))


# --- what came out ----------------------------------------------------------------------------------------------------


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record as a table."""
    shown = table(
        f"Cloth of {made['particles']} particles left alone: parts of its first energy, rms stretch",
        *("method", "bits", ">h omega", ">substeps", ">strays", ">trend", ">left", ">stretch", ">trend"),
    )
    for one in made["points"]:
        shown.add_row(
            one["name"],
            one["precision"].removeprefix("float"),
            f"{one['h_omega']:g}",
            f"{one['substeps']:,}",
            f"{one['strays']:.2%}",
            f"{one['energy_trend']:+.2%}",
            f"{one['energy_last']:.1%}",
            f"{one['stretch_rms']:.2%}",
            f"{one['stretch_trend']:+.2%}",
        )
    to.print(shown)
    for line in sentences(made):
        to.print(line, soft_wrap=True)


def sentences(made: dict[str, Any]) -> list[str]:
    """Return what the figures say, as sentences."""
    springs = [one for one in made["points"] if one["name"] != "XPBD"]
    xpbd = [one for one in made["points"] if one["name"] == "XPBD"]
    kept = " and ".join(
        f"springs with {one['name']} at h omega {one['h_omega']:g} {one['strays']:.2%}" for one in springs
    )
    left = ", ".join(
        f"{one['energy_last']:.1%} after {one['substeps']:,} of h omega {one['h_omega']:g} in {one['precision']}"
        for one in xpbd
    )
    return [f"From its first energy strays the cloth by at most: {kept}.", f"XPBD has of it left: {left}."]


def plot(axes: Any, made: dict[str, Any]) -> None:
    """Draw the energy that is left against the substeps, and dotted the stretch."""
    stretched = axes.twinx()
    for number, one in enumerate(made["points"]):
        substeps, energy, stretch = (list(column) for column in zip(*one["curve"], strict=True))
        label = f"{one['name']}, h$\\omega$ = {one['h_omega']:g}, {one['precision']}"
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
