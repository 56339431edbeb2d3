"""What the formats of the G-buffer cost and lose: bytes a pixel, GPU time, and how far pictures are from finer ones.

Each format draws the same scenes from the same view. Its error is told twice: against the finest format, which is what
storing a surface in fewer bits loses, and against the forward path, which stores nothing, so that all that the deferred
path does in another way is in it too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from rich.console import Console

from common.reports.benches import Effort, Subject, difference, errors, middle
from common.reports.tables import table
from common.settings import knobs, preset

KNOB, FINEST, FORWARD = "gbuffer_format", "full", "forward"
SCENES = {"spheres": "sky", "cornell": "none"}
"""What is drawn beside the bench's own scene, and the environments: mirrors of a sky, and a closed box."""

PASSES = ("gbuffer", "lighting")
"""Those that write the G-buffer and read it."""


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
        """Keep the picture, and what the targets are made of."""
        with self.subject.open(self.settings, {"color", "color_linear"}) as renderer:
            drawn: Any = renderer
            self.picture = self.subject.settled_picture(renderer)
            step = next((one for one in drawn.graph.steps if one.name == PASSES[0]), None)
            if step is None:  # the forward path stores no surface
                return
            size_of: Any = self.subject.module("graph.frame_graph").bytes_of
            for target in (*step.colors, step.depth):
                self.formats[target.resource] = drawn.graph.resources[target.resource].format
            self.bytes = sum(map(size_of, self.formats.values()))

    def record(self, others: dict[str, _Point]) -> dict[str, Any]:
        """Return what the JSON holds; `others` are what it is compared with, by their formats."""
        passes = {name: middle([one.get(name, 0.0) for one in self.rounds])[0] for name in PASSES}
        used, noise = middle([sum(one.get(name, 0.0) for name in PASSES) for one in self.rounds])
        return {
            "format": self.format,
            "formats": self.formats,
            "bytes": self.bytes,
            "gpu_ms": used,
            "noise_ms": noise,
            "passes_ms": passes,
            "frame_ms": middle([one["gpu"] for one in self.rounds])[0],
            "error": {name: _error(self.picture, other.picture) for name, other in others.items()},
        }


def _error(got: Any, truth: Any) -> dict[str, float | None]:
    """Return how far a picture is from another; `max_abs` is that of what is shown, `max_linear` of light, in nits."""
    linear = difference(got[0], truth[0])
    return {
        **errors(got, truth),
        "max_linear": linear["max_abs"],
        "pixels_differ": linear["pixels_differ"],
    }


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], name: str
) -> list[dict[str, Any]]:
    """Return a record for the bench's scene, called `name`, and for each of SCENES; [] where there is no G-buffer."""
    settings_class = subject.settings_class
    if KNOB not in knobs(settings_class):
        return []
    held = {name: ("none", subject)}
    for other, around in SCENES.items() if effort.everything else ():
        if other != name:
            held[other] = around, subject.on(subject.load(other, around))
    choices = [str(choice) for choice in knobs(settings_class)[KNOB].choices or ()]
    medium: Any = preset(settings_class, "medium")
    every: dict[str, dict[str, _Point]] = {}
    for number, (scene_name, (_, drawn)) in enumerate(held.items()):
        step(f"errors on {scene_name}", 0.5 * number / len(held))
        settings = {one: replace(medium, graph="deferred", msaa=1, **{KNOB: one}) for one in choices}
        settings[FORWARD] = replace(medium, graph=FORWARD, msaa=1)
        every[scene_name] = {one: _Point(drawn, one, how) for one, how in settings.items()}
        for point in every[scene_name].values():
            point.look()
    timed = [point for found in every.values() for point in found.values()]
    for turn in range(effort.rounds):
        for number, point in enumerate(timed):
            step(f"time of {point.format}", 0.5 + 0.5 * (turn + number / len(timed)) / effort.rounds)
            point.rounds += point.subject.measure(point.settings, effort)[0]
    return [
        {
            "scene": scene_name,
            "environment": held[scene_name][0],
            "forward_ms": middle([one["gpu"] for one in found[FORWARD].rounds])[0],
            "points": [
                found[one].record({truth: found[truth] for truth in (FINEST, FORWARD)}) for one in choices
            ],
        }
        for scene_name, found in every.items()
    ]


# --- what came out ----------------------------------------------------------------------------------------------------


def show(made: list[dict[str, Any]], to: Console) -> None:
    """Print the records as one table."""
    shown = table(
        f"Formats of the G-buffer: bytes a pixel, GPU ms of {' and '.join(PASSES)}",
        *("scene", "format", ">bytes", ">GPU ms", "against", ">rel. MSE", ">max", ">FLIP"),
    )
    for one in made:
        for point in one["points"]:
            time = f"{point['gpu_ms']:.2f} ±{point['noise_ms']:.2f}"
            named = [one["scene"], point["format"], str(point["bytes"]), time]
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


def plot(axes: Any, made: list[dict[str, Any]]) -> None:
    """Draw the error to the forward path by format, the smallest first, and dotted beside it the GPU's time."""
    times = axes.twinx()
    for number, one in enumerate(made):
        points = sorted(one["points"], key=lambda point: int(point["bytes"]))
        named = [f"{point['format']}, {point['bytes']} bytes" for point in points]
        # A logarithm has no zero: what is equal stands at the lower edge.
        values = [max(point["error"][FORWARD]["relative_mse"], 1e-12) for point in points]
        axes.plot(named, values, "o-", color=f"C{number}", label=one["scene"], ms=4)
        took, noise = ([point[name] for point in points] for name in ("gpu_ms", "noise_ms"))
        times.errorbar(named, took, noise, fmt="s:", color=f"C{number}", capsize=2, ms=3)
    axes.set_yscale("log")
    axes.set_ylabel(f"relative MSE against the {FORWARD} path")
    times.set_ylim(bottom=0)
    times.set_ylabel(f"dotted: GPU ms of {' and '.join(PASSES)}")
    axes.set_title("Formats of the G-buffer", fontsize=10)
    axes.legend(fontsize=8)
