"""Cost and loss of the G-buffer's formats: bytes a pixel, GPU time, and errors against finer pictures.

Each format draws the same scenes from the same view. Its error has two references. The error against the finest format
is the loss of storing a surface in fewer bits. The forward path stores no surface: the error against it contains all
other differences of the deferred path, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console

from common.reports.benches import Effort, Subject, difference, errors, middle
from common.reports.tables import table
from common.settings import knobs, preset, replaced

KNOB, FINEST, FORWARD = "gbuffer_format", "full", "forward"
SCENES = {"spheres": "sky", "cornell": "none"}
"""Scenes beside the bench's own, and their environments: mirrors of a sky, and a closed box."""

PASSES = ("gbuffer", "lighting")
"""The passes that write the G-buffer and read it."""


@dataclass
class _Point:
    """One format on one scene, and the GPU milliseconds of its frames."""

    subject: Subject
    format: str
    settings: Any
    formats: dict[str, str] = field(default_factory=dict)
    bytes: int = 0
    picture: Any = None
    rounds: list[dict[str, float]] = field(default_factory=list)

    def look(self) -> None:
        """Keep the picture, and the formats and bytes of the targets."""
        with self.subject.open(self.settings, {"color", "color_linear"}) as renderer:
            drawn: Any = renderer
            self.picture = self.subject.settled_picture(renderer)
            step = next((candidate for candidate in drawn.graph.steps if candidate.name == PASSES[0]), None)
            if step is None:  # the forward path stores no surface
                return
            size_of: Any = self.subject.module("graph.frame_graph").bytes_of
            for target in (*step.colors, step.depth):
                self.formats[target.resource] = drawn.graph.resources[target.resource].format
            self.bytes = sum(map(size_of, self.formats.values()))

    def record(self, truths: dict[str, _Point]) -> dict[str, Any]:
        """Return the JSON of the point; `truths` are the points to compare it with, by their formats."""
        passes = {name: middle([timings.get(name, 0.0) for timings in self.rounds])[0] for name in PASSES}
        used, noise = middle([sum(timings.get(name, 0.0) for name in PASSES) for timings in self.rounds])
        return {
            "format": self.format,
            "formats": self.formats,
            "bytes": self.bytes,
            "gpu_ms": used,
            "noise_ms": noise,
            "passes_ms": passes,
            "frame_ms": middle([timings["gpu"] for timings in self.rounds])[0],
            "error": {name: _error(self.picture, truth.picture) for name, truth in truths.items()},
        }


def _error(got: Any, truth: Any) -> dict[str, float | None]:
    """Return the error of a picture; `max_abs` is that of the shown picture, `max_linear` that of light, in nits."""
    linear = difference(got[0], truth[0])
    return {
        **errors(got, truth),
        "max_linear": linear["max_abs"],
        "pixels_differ": linear["pixels_differ"],
    }


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], name: str
) -> list[dict[str, Any]]:
    """Return a record for the bench's scene, called `name`, and for each of SCENES; [] without a G-buffer."""
    settings_class = subject.settings_class
    if KNOB not in knobs(settings_class):
        return []
    scenes = {name: ("none", subject)}
    for other, around in SCENES.items() if effort.everything else ():
        if other != name:
            scenes[other] = around, subject.on(subject.load(other, around))
    choices = [str(choice) for choice in knobs(settings_class)[KNOB].choices or ()]
    medium: Any = preset(settings_class, "medium")
    by_scene: dict[str, dict[str, _Point]] = {}
    for number, (scene_name, (_, drawn)) in enumerate(scenes.items()):
        step(f"errors on {scene_name}", 0.5 * number / len(scenes))
        settings = {entry: replaced(medium, graph="deferred", msaa=1, **{KNOB: entry}) for entry in choices}
        settings[FORWARD] = replaced(medium, graph=FORWARD, msaa=1)
        by_scene[scene_name] = {entry: _Point(drawn, entry, how) for entry, how in settings.items()}
        for point in by_scene[scene_name].values():
            point.look()
    timed = [point for by_format in by_scene.values() for point in by_format.values()]
    for turn in range(effort.rounds):
        for number, point in enumerate(timed):
            step(f"time of {point.format}", 0.5 + 0.5 * (turn + number / len(timed)) / effort.rounds)
            point.rounds += point.subject.measure(point.settings, effort)[0]
    return [
        {
            "scene": scene_name,
            "environment": scenes[scene_name][0],
            "forward_ms": middle([entry["gpu"] for entry in by_format[FORWARD].rounds])[0],
            "points": [
                by_format[entry].record({truth: by_format[truth] for truth in (FINEST, FORWARD)})
                for entry in choices
            ],
        }
        for scene_name, by_format in by_scene.items()
    ]


# --- results ----------------------------------------------------------------------------------------------------------


def show(records: list[dict[str, Any]], to: Console) -> None:
    """Print the records as one table."""
    shown = table(
        f"Formats of the G-buffer: bytes a pixel, GPU ms of {' and '.join(PASSES)}",
        *("scene", "format", ">bytes", ">GPU ms", "against", ">rel. MSE", ">max", ">FLIP"),
    )
    for record in records:
        for point in record["points"]:
            time = f"{point['gpu_ms']:.2f} ±{point['noise_ms']:.2f}"
            named = [record["scene"], point["format"], str(point["bytes"]), time]
            for truth, error in point["error"].items():
                if truth == point["format"]:
                    continue
                shown.add_row(
                    *named,
                    truth,
                    f"{error['relative_mse']:.1e}",
                    f"{error['max_abs']:.4f}",
                    "-" if error["flip"] is None else f"{error['flip']:.5f}",
                )
                named = [""] * len(named)
    to.print(shown)


def plot(axes: Any, records: list[dict[str, Any]]) -> None:
    """Draw the error against the forward path by format, the smallest first, and dotted the time of the GPU."""
    times = axes.twinx()
    for number, record in enumerate(records):
        points = sorted(record["points"], key=lambda point: int(point["bytes"]))
        named = [f"{point['format']}, {point['bytes']} bytes" for point in points]
        # A logarithmic axis has no zero: equal pictures stand at the lower edge.
        values = [max(point["error"][FORWARD]["relative_mse"], 1e-12) for point in points]
        axes.plot(named, values, "o-", color=f"C{number}", label=record["scene"], ms=4)
        took, noise = ([point[name] for point in points] for name in ("gpu_ms", "noise_ms"))
        times.errorbar(named, took, noise, fmt="s:", color=f"C{number}", capsize=2, ms=3)
    axes.set_yscale("log")
    axes.set_ylabel(f"relative MSE against the {FORWARD} path")
    times.set_ylim(bottom=0)
    times.set_ylabel(f"dotted: GPU ms of {' and '.join(PASSES)}")
    axes.set_title("Formats of the G-buffer", fontsize=10)
    axes.legend(fontsize=8)
