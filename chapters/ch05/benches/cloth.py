"""Error and stretch of cloth against its GPU time, for several divisions of a step.

A level sheet, held at two corners, falls and swings for a second. It touches nothing, since two simulations of contact
soon diverge. Each step of the chapter is cut into more and more *substeps*, or corrects the same distances in more and
more *iterations*. Macklin and others ("Small steps in physics simulation", 2019) found that substeps bring more for the
same time. Springs have no iterations, and are not stable without some substeps.

The truth is the twin in numpy, in float64, with springs and velocity Verlet: all methods here converge to the same
motion as their steps become shorter. Its steps are 16 times shorter than springs need. So its own error (of first
order, by damping and air) is a sixteenth of theirs. An error is the distance of a particle from its true place, at the
end of each quarter of the time. The time of a step is that of the pass on the GPU, including normals and vertices, in
frames that simulate one step each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.scene import Scene
from common.settings import flat, knobs

from . import executions as bench_executions
from .measures import stretch
from .sheet import KNOB, cloth_of, level_sheet, medium_of, opened, states, timed_step
from .twin import Twin

READINGS = 4
"""Readings of the state, one at the end of each part of the time."""

KINDS = ("XPBD, substeps", "XPBD, iterations", "springs, verlet", "springs, euler")
"""The curves: XPBD by substeps of one iteration each, and by iterations of one substep; springs by substeps."""


@dataclass(frozen=True)
class Sweep:
    """The extent of the bench: vertices along an edge, steps, parts of a step, and substeps of the truth."""

    edge: int
    steps: int
    numbers: tuple[int, ...]
    truth: int


FULL = Sweep(edge=17, steps=60, numbers=(1, 2, 4, 8, 16, 32), truth=256)
QUICK = Sweep(edge=9, steps=12, numbers=(8,), truth=64)


@dataclass
class _Run:
    """One point: its settings, and its results."""

    kind: str
    settings: dict[str, Any]
    substeps: int = 0
    iterations: int = 1
    times: list[float] = field(default_factory=list)
    states: list[Any] = field(default_factory=list)

    def record(self, sheet: Any, truth: Sequence[Any], stretch: Callable[..., Any]) -> dict[str, Any]:
        """Return the figures: errors and stretch are the greatest or the mean over all readings."""
        far = [
            np.linalg.norm(state.positions.astype(np.float64) - true_state.positions, axis=1)
            for state, true_state in zip(self.states, truth, strict=True)
        ]
        median, noise = middle(self.times)
        return {
            "kind": self.kind,
            "substeps": self.substeps,
            "iterations": self.iterations,
            "gpu_ms": median,
            "noise_ms": noise,
            "rms_m": float(np.sqrt(np.mean(np.square(far)))),
            "greatest_m": float(np.max(far)),
            "stretch": max(stretch(sheet, state).greatest for state in self.states),
        }


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], sweep: Sweep | None = None
) -> dict[str, Any] | None:
    """Return the record of a chapter that has cloth; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    sweep = sweep or (FULL if effort.everything else QUICK)
    scene, dt = level_sheet(sweep.edge), flat(medium_of(subject))["cloth_step"]
    sheet, truth = _truth(subject, scene, sweep, dt, lambda part: step("the float64 twin", 0.3 * part))
    points: dict[tuple[str, int, int], dict[str, Any]] = {}
    runs = _runs(sweep)
    for number, run in enumerate(runs):
        step(f"steps cut by {run.kind}", 0.3 + 0.3 * number / len(runs))
        _simulate(subject, scene, sweep, run)
        # Springs get at least as many substeps as they need, so some points coincide.
        points.setdefault((run.kind, run.substeps, run.iterations), run.record(sheet, truth, stretch))
    executions = bench_executions.measure(subject, effort, lambda what, part: step(what, 0.6 + 0.4 * part))
    return {
        "particles": len(sheet.positions),
        "springs": len(sheet.springs),
        "seconds": sweep.steps * dt,
        "truth_substeps": sweep.truth,
        "truth_stretch": max(stretch(sheet, state).greatest for state in truth),
        "points": list(points.values()),
        "executions": executions,
    }


def _runs(sweep: Sweep) -> list[_Run]:
    runs = [_Run(KINDS[0], {"cloth_substeps": number}) for number in sweep.numbers]
    runs += [_Run(KINDS[1], {"cloth_substeps": 1, "cloth_iterations": number}) for number in sweep.numbers]
    for kind, integrator in zip(KINDS[2:], ("verlet", "euler"), strict=True):
        springs = {"cloth_method": "springs", "cloth_integrator": integrator}
        numbers = (1, *sweep.numbers[-2:]) if len(sweep.numbers) > 2 else (1,)
        runs += [_Run(kind, {"cloth_substeps": number, **springs}) for number in numbers]
    return runs


def _truth(
    subject: Subject, scene: Scene, sweep: Sweep, dt: float, step: Callable[[float], None]
) -> tuple[Any, list[Any]]:
    """Return the cloth, and its true state at each reading."""
    types = cloth_of(subject, "types")
    sheet = cloth_of(subject, "scene").cloth_scene(scene).cloths[0]
    cut = types.Steps(dt, sweep.truth, method="springs", integrator="verlet")
    twin = Twin(sheet, cut)
    readings = []
    for number in range(1, sweep.steps + 1):
        step(number / sweep.steps)
        state = twin.advance()
        if number % (sweep.steps // READINGS) == 0:
            readings.append(types.State(state.positions.copy(), state.velocities.copy()))
    return sheet, readings


def _simulate(subject: Subject, scene: Scene, sweep: Sweep, run: _Run) -> None:
    """Draw the frames of a run: the first before anything moves, then one for each step."""
    settings = medium_of(subject, **{"cloth_method": "xpbd", **run.settings})
    with opened(subject, scene, settings) as renderer:
        drawn: Any = renderer
        cut = drawn.techniques["cloth"].cloth.frames.steps
        run.substeps, run.iterations = cut.substeps, cut.iterations
        timed_step(subject, renderer, 0, cut.dt)
        for number in range(1, sweep.steps + 1):
            run.times.append(timed_step(subject, renderer, number, cut.dt))
            if number % (sweep.steps // READINGS) == 0:
                run.states.append(states(renderer)[0])


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as tables, and its sentences."""
    shown = table(
        f"A step of cloth of {record['particles']:,} particles; for {record['seconds']:.3g} s, errors to the "
        "float64 twin",
        *("cut by", ">parts", ">GPU ms", ">±", ">rms mm", ">max mm", ">stretch"),
    )
    for point in record["points"]:
        shown.add_row(
            point["kind"],
            str(point["substeps"] * point["iterations"]),
            f"{point['gpu_ms']:.3f}",
            f"{point['noise_ms']:.3f}",
            f"{point['rms_m'] * 1e3:.3g}",
            f"{point['greatest_m'] * 1e3:.3g}",
            f"{point['stretch']:.1%}",
        )
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)
    bench_executions.show(record["executions"], to)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    curves = [[point for point in record["points"] if point["kind"] == kind] for kind in KINDS[:2]]
    small, many = (max(curve, key=lambda point: point["substeps"] * point["iterations"]) for curve in curves)
    return [
        f"{small['substeps']} substeps of 1 iteration take {small['gpu_ms'] / many['gpu_ms']:.2f} times the time of 1 "
        f"substep of {many['iterations']} iterations, and leave {small['rms_m'] / many['rms_m']:.2g} of its error; "
        f"threads are stretched by {small['stretch']:.1%} at most, there by {many['stretch']:.1%}, in truth by "
        f"{record['truth_stretch']:.1%}."
    ]


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the error against the time of a step, a curve for each way to cut it, and dotted the stretch."""
    from matplotlib.ticker import LogLocator, NullLocator

    stretched = axes.twinx()
    for number, kind in enumerate(KINDS):
        points = [point for point in record["points"] if point["kind"] == kind]
        times = [point["gpu_ms"] for point in points]
        axes.errorbar(
            times,
            [point["rms_m"] * 1e3 for point in points],
            xerr=[point["noise_ms"] for point in points],
            fmt="-" + "osD^"[number],
            color=f"C{number}",
            label=kind,
            capsize=2,
            ms=4,
        )
        stretched.plot(
            times, [point["stretch"] for point in points], ":" + "osD^"[number], color=f"C{number}", ms=2
        )
        for point in points if number < 2 else ():
            parts, place = point["substeps"] * point["iterations"], (point["gpu_ms"], point["rms_m"] * 1e3)
            axes.annotate(str(parts), place, textcoords="offset points", xytext=(4, 4), fontsize=7)
    stretched.axhline(record["truth_stretch"], color="0.6", lw=0.8, ls="--")
    stretched.set_yscale("log")
    stretched.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    stretched.yaxis.set_minor_locator(NullLocator())
    stretched.yaxis.set_major_formatter("{x:.0%}")
    stretched.set_ylabel("dotted: greatest stretch of a thread (dashed: in truth)")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("GPU ms of a step")
    axes.set_ylabel("rms error in mm against the float64 twin")
    axes.set_title(f"Cloth of {record['particles']:,} particles, {record['seconds']:.3g} s", fontsize=10)
    axes.legend(fontsize=8)
