"""Loops whose length is a constant of the pipeline, a define, or a number: `strata bench 9 --only constants`.

The kernel of the study `9/constant-loop` has all three ways. In frames, `shadow_loop` chooses for the loop over the
texels of a shadow's filter, and `ssao_steps` is the constant length of the loop over the points of a ray. What a new
value costs is the time of building a pipeline: with a specialization constant from SPIR-V that is there, with a define
from the text of GLSL.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, difference, middle
from common.reports.tables import table
from common.settings import knobs

from ..pipelines.compute_description import ComputeDescription
from ..studies.constant_loop import LONGEST, TAPS, Settings, kernel
from .pass_times import is_software, times_of
from .rates import SLOW_FRAMES, drifting, settings_of

KNOB = "shadow_loop"
"""The setting; a chapter without it has no specialization constants."""

STUDY = "9/constant-loop"
STUDY_SIZE = (64, 64)

ELEMENTS, QUICK_ELEMENTS = 1 << 16, 1 << 12
"""Means that a dispatch computes: a software driver needs 0.1 ms for the fewer ones with 16 taps."""

CONSTANTS = ("specialization", "define")
WAYS = ("pushed", *CONSTANTS)
"""What the loop takes its length from."""

BUILDS, QUICK_BUILDS = 24, 4
"""Pipelines that are built in each way."""

SCENE = "atrium"

KERNELS, QUICK_KERNELS = (1, 3, 5, 7, 13), (3,)
LOOPS = ("record", "constant")
STEPS, QUICK_STEPS = (1, 2, 4, 8, 16), (4,)

LEAST_WARM_UP = LEAST_ROUNDS = 3

SHADED, OCCLUDED = "lighting", "ssao"
"""The passes that have the loops."""

Step = Callable[[str, float], None]


def measure(subject: Subject, effort: Effort, step: Step) -> dict[str, Any] | None:
    """Return the record; None for a chapter without specialization constants.

    `loops` has the time of a dispatch for each number of taps and way, `builds` the time from a description to its
    pipeline, `frames` the time of passes. `pixels_differ` is against the other way to loop with the same kernel.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    step("loops", 0.0)
    elements = ELEMENTS if effort.everything and not is_software(subject) else QUICK_ELEMENTS
    loops, builds = _study(subject, elements, effort)
    return {
        "elements": elements,
        "clock": is_software(subject),
        "scene": SCENE,
        "size": list(subject.size),
        "loops": loops,
        "builds": builds,
        "frames": _frames(subject, effort, step),
    }


# --- the kernel of the study ------------------------------------------------------------------------------------------


def _study(
    subject: Subject, elements: int, effort: Effort
) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the rows of loops and of builds."""
    study = subject.study(STUDY, STUDY_SIZE)
    # Lengths that no earlier run is likely to have built, so that no cache of the driver on disk has their code.
    lengths = np.random.default_rng(clock.time_ns()).permutation(np.arange(17, LONGEST)).tolist()
    times: dict[tuple[int, str], list[float]] = {(taps, way): [] for taps in TAPS for way in WAYS}
    builds: dict[str, list[float]] = {way: [] for way in CONSTANTS}
    with ExitStack() as stack:
        ways = {way: Settings(elements=elements, constant=way) for way in CONSTANTS}
        opened = {way: stack.enter_context(study.open(settings, {"color"})) for way, settings in ways.items()}
        warm_up = max(effort.warm_up, LEAST_WARM_UP)
        for number in range(warm_up + effort.frames):  # in turn, so that a busy moment hits no way alone
            for way, renderer in opened.items():
                stamps = renderer.render(study.view(renderer)).timings
                for taps in TAPS if number >= warm_up else ():
                    times[taps, "pushed"].append(stamps[f"pushed {taps}"])
                    times[taps, way].append(stamps[f"constant {taps}"])
        for _ in range(BUILDS if effort.everything else QUICK_BUILDS):
            for way, renderer in opened.items():
                builds[way].append(_built(renderer, kernel(ways[way], lengths.pop())))
    return (
        [{"taps": taps, "way": way, **_middle(found)} for (taps, way), found in times.items()],
        [{"way": way, **_middle(found), "pipelines": len(found)} for way, found in builds.items()],
    )


def _middle(found: list[float]) -> dict[str, float]:
    ms, noise = middle(found)
    return {"ms": ms, "noise_ms": noise}


def _built(renderer: Any, described: ComputeDescription) -> float:
    """Return the ms that a pipeline takes."""
    began = clock.perf_counter()
    renderer.pipelines.get([described])
    return (clock.perf_counter() - began) * 1e3


# --- in frames --------------------------------------------------------------------------------------------------------


def _frames(subject: Subject, effort: Effort, step: Step) -> list[dict[str, Any]]:
    """Return the rows of the loop over a shadow's kernel, and of that over the points of a ray of ambient occlusion."""
    ways: list[tuple[str, dict[str, dict[str, Any]]]] = []
    for texels in KERNELS if effort.everything else QUICK_KERNELS:
        alike = {f"kernel {texels}, {loop}": {"shadow_kernel": texels, "shadow_loop": loop} for loop in LOOPS}
        ways.append((SHADED, alike))
    for steps in STEPS if effort.everything else QUICK_STEPS:
        rays = {"ssao": "normals", "ssao_steps": steps, "ssao_blur": False}
        ways.append((OCCLUDED, {f"{steps} steps": rays}))
    drawn = subject.on(replace(subject.load(SCENE), animations=[]))
    rows: list[dict[str, Any]] = []
    for number, (measured, alike) in enumerate(ways):
        step(" and ".join(alike), (1 + number) / (1 + len(ways)))
        rows += _alike(drawn, measured, alike, effort)
    return rows


def _alike(
    drawn: Subject, measured: str, alike: dict[str, dict[str, Any]], effort: Effort
) -> list[dict[str, Any]]:
    """Return the rows of settings that have one picture. They are measured in turn, in some rounds."""
    software = is_software(drawn)
    frames = min(effort.frames, SLOW_FRAMES) if software else effort.frames
    with ExitStack() as stack:
        opened = {
            name: stack.enter_context(
                drawn.open(settings_of(drawn, graph="deferred", **values), {"color", "color_linear"})
            )
            for name, values in alike.items()
        }
        pictures = [drawn.settled_picture(renderer)[0] for renderer in opened.values()]
        views = {name: drifting(drawn.view(renderer), drawn.scene) for name, renderer in opened.items()}
        times: dict[str, list[float]] = {name: [] for name in opened}
        for _ in range(LEAST_ROUNDS if software else max(effort.rounds, LEAST_ROUNDS)):
            for name, renderer in opened.items():
                len(renderer.render(next(views[name])).timings)  # waits for the frame
                found = times_of(renderer, views[name], {"pass": (measured,)}, frames, software)
                times[name].append(found["pass"][0])
    rows = []
    for picture, (name, found_ms) in zip(pictures, times.items(), strict=True):
        differ = difference(picture, pictures[0])["pixels_differ"] if picture is not pictures[0] else None
        rows.append({"pass": measured, "name": name, **_middle(found_ms), "pixels_differ": differ})
    return rows


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the times of loops, of passes and of builds, and what they say."""
    shown = table(
        f"A loop of N steps, {record['elements']:,} means, microseconds",
        *(">N", *(word for way in WAYS for word in (f">{way}", ">±"))),
    )
    for taps in TAPS:
        rows = {row["way"]: row for row in record["loops"] if row["taps"] == taps}
        times = (f"{1e3 * rows[way][name]:.3g}" for way in WAYS for name in ("ms", "noise_ms"))
        shown.add_row(str(taps), *times)
    to.print(shown)
    width, height = record["size"]
    how = "by the clock" if record["clock"] else "on the GPU"
    shown = table(
        f"Loops in frames, {record['scene']}, {width}x{height}, ms {how}", "pass", "", ">ms", ">±", ">differ"
    )
    for row in record["frames"]:
        differ = "" if row["pixels_differ"] is None else str(row["pixels_differ"])
        shown.add_row(row["pass"], row["name"], f"{row['ms']:.3g}", f"{row['noise_ms']:.2g}", differ)
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    loops = {(row["taps"], row["way"]): float(row["ms"]) for row in record["loops"]}
    gains = {taps: loops[taps, "pushed"] / max(loops[taps, "specialization"], 1e-6) for taps in TAPS}
    best = max(gains, key=lambda taps: gains[taps])
    text, module = (
        next(row for row in record["builds"] if row["way"] == way) for way in ("define", "specialization")
    )
    return [
        f"The constant gains most with {best} steps, where the pushed number takes {gains[best]:.2f} times as long.",
        f"A pipeline for a new value takes {module['ms']:.1f} ms (±{module['noise_ms']:.1f}) with a specialization "
        f"constant, and {text['ms']:.1f} ms (±{text['noise_ms']:.1f}) with a define.",
    ]


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time of loops over their length, relative to the number that is pushed."""
    pushed = {row["taps"]: row["ms"] for row in record["loops"] if row["way"] == "pushed"}
    for way in CONSTANTS:
        rows = [row for row in record["loops"] if row["way"] == way]
        axes.plot(
            [row["taps"] for row in rows],
            [row["ms"] / max(pushed[row["taps"]], 1e-9) for row in rows],
            "o-",
            ms=4,
            label=way,
        )
    axes.axhline(1.0, color="0.6", lw=0.8)
    axes.set_xscale("log", base=2)
    axes.set_xlabel("steps of the loop")
    axes.set_ylabel("time / time of the pushed length")
    axes.set_title("Constant loops", fontsize=10)
    axes.legend(fontsize=8)
