"""What is drawn again, and what that costs: `strata bench 8 --only caching`.

The market has 256 lamps and a moon. It is drawn at rest, while one lamp moves, along a walk of the camera, and with a
cut in each frame. A renderer without shadows draws the same frames in turn: the rest of a frame's time is its time.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import STEP, Effort, Subject, middle, moved_view
from common.reports.tables import table
from common.scene import Scene
from common.settings import knobs, replaced
from common.view.camera import View

from ..shadows.faces import UNUSED
from .shadow_scenes import (
    KNOB,
    is_software,
    move_lights,
    picture_size,
    settings_of,
    view_at,
    with_loose_lights,
)

SCENE, QUICK_SCENE = "market:lights=256", "market:lights=32"

STATES = ("rest", "lamp", "walk", "cut")

SPOKEN = {
    "rest": "at rest",
    "lamp": "a lamp moves",
    "walk": "a walk",
    "cut": "cuts",
}

FRAMES, SOFTWARE_FRAMES, QUICK_FRAMES = 120, 40, 4
"""Frames of a state."""

MOST_CUTS = 4
"""Frames of the last state on a software driver, which draws all maps in each of them."""

WARM_UP = 6
"""Frames at rest before each state."""

PASS = "shadows"
"""The beginning of the names of passes and counters."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record; None for a chapter without shadow maps.

    Of each state, `gpu_ms` is the time of the passes of shadows, `python_ms` that of `prepare` of their technique, and
    `cpu_ms` how much longer Python takes for the frame with shadows than without. Each has its median, and the mean
    and the most over all frames. `work` has the means of the counters of shadows, `most_faces` the most faces that a
    frame draws.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    name = SCENE if effort.everything else QUICK_SCENE
    scene = with_loose_lights(subject.load(name))
    drawn = subject.on(scene, picture_size(subject))
    settings = settings_of(drawn, color_format="rgba16f")
    frames = QUICK_FRAMES
    if effort.everything:
        frames = SOFTWARE_FRAMES if is_software(subject) else FRAMES
    rows = []
    with ExitStack() as stack:
        step(name, 0.0)
        on, off = (
            stack.enter_context(drawn.open(replaced(settings, shadows=shadows), {"color"}))
            for shadows in ("on", "off")
        )
        watch = _Watch(on.techniques[PASS])
        for number, state in enumerate(STATES):
            step(SPOKEN[state], (number + 0.1) / (len(STATES) + 0.1))
            for view in [drawn.view(on)] * WARM_UP:
                len(on.render(view).timings), len(off.render(view).timings)  # waits for the frames
            few = min(frames, MOST_CUTS) if state == "cut" and is_software(subject) else frames
            rows.append(_row(state, _drawn(on, off, watch, _views(state, drawn, on, few))))
    lamps = sum(light.kind != "directional" for light in scene.lights)
    return {"scene": name, "lamps": lamps, "size": list(drawn.size), "rows": rows}


class _Watch:
    """Measures `prepare` of a technique."""

    def __init__(self, technique: Any) -> None:
        self.ms = 0.0
        self._prepare = technique.prepare
        technique.prepare = self._measured

    def _measured(self, frame: Any) -> Any:
        began = clock.perf_counter()
        written = self._prepare(frame)
        self.ms = (clock.perf_counter() - began) * 1e3
        return written


def _views(state: str, drawn: Subject, renderer: Any, frames: int) -> Iterator[View]:
    """Yield the views of a state; before each, move what moves in it."""
    view, scene = drawn.view(renderer), drawn.scene
    other = view_at(scene, scene.cameras[-1].name if scene.cameras else None, drawn.size)
    lamp = _lamp(scene, renderer)
    for number in range(frames):
        if state == "lamp" and lamp is not None:
            there = (1 if number % 2 else -1) * STEP * scene.length_scale
            move_lights(scene, [lamp], (there, 0.0, 0.0))
        if state == "walk":
            yield moved_view(view, scene, number + 1)
        elif state == "cut":
            yield replace(view if number % 2 else other, cut=True)
        else:
            yield view


def _lamp(scene: Scene, renderer: Any) -> int | None:
    """Return the number of a lamp that has a map, the one with the most texels; None if there is none."""
    faces = renderer.techniques[PASS].faces
    used = faces[(faces["light"] != UNUSED) & (faces["perspective"] != 0.0)]
    if not len(used):
        return None
    record = int(used["light"][used["size"].argmax()])
    # Records have the directional lights first, the others in the order of the scene.
    order = np.argsort([light.kind != "directional" for light in scene.lights], kind="stable")
    return int(order[record])


def _drawn(on: Any, off: Any, watch: _Watch, views: Iterator[View]) -> list[dict[str, Any]]:
    """Return what each frame took."""
    found = []
    for view in views:
        frame, plain = on.render(view), off.render(view)
        passes = frame.timings
        found.append(
            {
                "gpu": sum(took for name, took in passes.items() if name.startswith(PASS)),
                "python": watch.ms,
                "cpu": frame.cpu_ms - plain.cpu_ms,
                "work": {
                    name: count for name, count in frame.work.items() if name.startswith(PASS.rstrip("s"))
                },
            }
        )
    return found


def _row(state: str, frames: list[dict[str, Any]]) -> dict[str, Any]:
    row: dict[str, Any] = {"state": state, "frames": len(frames)}
    for name in ("gpu", "python", "cpu"):
        times = [frame[name] for frame in frames]
        row[f"{name}_ms"], row[f"{name}_noise_ms"] = middle(times)
        row[f"{name}_mean_ms"], row[f"{name}_most_ms"] = float(np.mean(times)), float(np.max(times))
    names = frames[0]["work"]
    row["work"] = {name: float(np.mean([frame["work"].get(name, 0) for frame in frames])) for name in names}
    row["most_faces"] = max(frame["work"]["shadow_faces_drawn"] for frame in frames)
    return row


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the states as a table."""
    width, height = record["size"]
    shown = table(
        f"What is drawn again, {record['scene']}, {width}x{height}",
        *("", ">frames", ">faces", ">most", ">GPU ms", ">most", ">prepare", ">Python", ">±"),
    )
    for row in record["rows"]:
        shown.add_row(
            SPOKEN[row["state"]],
            str(row["frames"]),
            f"{row['work']['shadow_faces_drawn']:.1f}",
            str(row["most_faces"]),
            f"{row['gpu_mean_ms']:.1f}",
            f"{row['gpu_most_ms']:.1f}",
            *(f"{row[name]:.3f}" for name in ("python_ms", "cpu_ms", "cpu_noise_ms")),
        )
    to.print(shown)
    to.print(
        "Faces and the time of the GPU are means of a frame. Python is how many ms longer it takes with shadows than "
        "without, and prepare is what their technique takes of it, in ms; both are medians.",
        soft_wrap=True,
    )


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the mean and the most faces that a frame draws as bars."""
    states = [SPOKEN[row["state"]] for row in record["rows"]]
    places = np.arange(len(states))
    mean = [row["work"]["shadow_faces_drawn"] for row in record["rows"]]
    axes.bar(places - 0.2, mean, 0.4, label="mean")
    axes.bar(places + 0.2, [row["most_faces"] for row in record["rows"]], 0.4, label="most")
    axes.set_yscale("symlog", linthresh=1)
    axes.set_xticks(places, states, fontsize=8)
    axes.set_ylabel("faces that a frame draws")
    axes.set_title(f"Caching, {record['scene']}", fontsize=10)
    axes.legend(fontsize=8)
