"""What the depth pre-pass costs and gains: GPU time with and without it, against layers that lie behind one another.

Each layer covers the whole picture and is drawn before those in front of it, so without a pre-pass every pixel is
shaded once for each layer. With it only depth is written for all of them, and one is shaded. On the forward path
shading means all lights; on the deferred path it means what a surface is, and light comes once for each pixel in any
case.

The pre-pass may change no bit of the picture: each pair is compared. How many fragments were shaded the GPU counts
itself, where it has pipeline statistics; else the number is what the scene was made for.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console

import chapters
from backends.contract import Renderer
from backends.fragments import fragments
from common.reports.benches import Effort, difference, middle
from common.reports.tables import table
from common.scene.crowds import layers
from common.settings import knobs, preset, replaced
from tools.bench.points import Subject

PATHS = {"forward": "forward", "deferred": "gbuffer"}
"""The graphs that are measured, and the pass of each that shades the layers."""

PREPASS = "depth_prepass"
"""The setting, which is called as the pass that it asks for; a chapter without it has none."""

LAYERS = (1, 2, 4, 8, 16)

LEAST_FRAMES = 5
"""Of a point, also in a quick look."""


@dataclass
class _Run:
    """One point: a renderer that is open, and the GPU milliseconds of its frames by pass."""

    path: str
    layers: int
    prepass: bool
    renderer: Renderer
    frames: list[dict[str, float]] = field(default_factory=list)
    shaded: int = 0
    counted: bool = False
    error: dict[str, float] = field(default_factory=dict)

    def frame(self) -> Any:
        """Return a frame that is over, and keep its times."""
        frame = self.renderer.render(chapters.view_of(self.renderer))
        self.frames.append(dict(frame.timings))
        return frame

    def point(self) -> dict[str, Any]:
        """Return what the record holds."""
        whole, noise = middle([sum(frame.values()) for frame in self.frames])
        return {
            "path": self.path,
            "layers": self.layers,
            "prepass": self.prepass,
            "gpu_ms": whole,
            "noise_ms": noise,
            "passes_ms": {name: middle([one[name] for one in self.frames])[0] for name in self.frames[0]},
            "shaded": self.shaded,
            "counted": self.counted,
            "error": self.error,
        }


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], lamps: int = 32
) -> dict[str, Any] | None:
    """Return the record of LAYERS lit by `lamps`, of a chapter that has a depth pre-pass; None for others."""
    settings_class = chapters.settings_class(subject.chapter)
    if PREPASS not in knobs(settings_class):
        return None
    counts = LAYERS if effort.everything else (LAYERS[0], LAYERS[len(LAYERS) // 2])
    medium: Any = preset(settings_class, "medium")
    runs: list[_Run] = []
    with ExitStack() as stack:
        for count in counts:
            scene = layers(count, lamps)
            drawn = Subject(subject.chapter, subject.backend, scene, subject.size, subject.device)
            for path in PATHS:
                truth = None
                for prepass in (False, True):
                    step(f"{count} layers, {path}", 0.4 * len(runs) / (4 * len(counts)))
                    settings = replaced(medium, graph=path, depth_prepass=prepass, msaa=1)
                    renderer = stack.enter_context(drawn.open(settings, {"color", "color_linear"}))
                    run = _Run(path, count, prepass, renderer)
                    for _ in range(max(effort.warm_up, 2)):
                        frame = run.frame()
                    picture = frame.image("color_linear")
                    truth = picture if truth is None else truth
                    run.error = difference(picture, truth)
                    run.shaded, run.counted = _shaded(run, subject.size)
                    run.frames.clear()
                    runs.append(run)
        random = np.random.default_rng(1)
        rounds = max(3 * effort.rounds, LEAST_FRAMES)
        for turn in range(rounds):
            step("frames of more and more layers", 0.4 + 0.6 * turn / rounds)
            for one in random.permutation(len(runs)):
                runs[one].frame()
        points = [run.point() for run in runs]
    width, height = subject.size
    return {"frames": rounds, "lamps": lamps, "pixels": width * height, "points": points}


def _shaded(run: _Run, size: tuple[int, int]) -> tuple[int, bool]:
    """Return how often the fragment shader of the shading pass ran in a frame, and whether the GPU counted it."""
    renderer: Any = run.renderer
    if not renderer.device.has("pipeline-statistics"):
        return size[0] * size[1] * (1 if run.prepass else run.layers), False
    made = next(one for one in renderer.passes if one.name == PATHS[run.path])
    with fragments(renderer.device) as (counting, read):
        record = made.record

        def counted(commands: Any) -> None:
            with counting(commands):
                record(commands)

        made.record = counted
        renderer._frames.forget()
        try:
            run.frame()
            return read(), True
        finally:
            del made.record
            renderer._frames.forget()


# --- what came out ----------------------------------------------------------------------------------------------------


def show(made: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and what it says."""
    shown = table(
        f"Depth pre-pass against overdraw, {made['lamps']} lamps, GPU ms a frame",
        *("path", ">layers", ">without", ">with", ">depth", ">gain", ">shaded", ">with"),
    )
    for without, within in _pairs(made):
        shown.add_row(
            without["path"],
            str(without["layers"]),
            *(f"{one['gpu_ms']:.2f} ±{one['noise_ms']:.2f}" for one in (without, within)),
            f"{within['passes_ms'].get(PREPASS, 0.0):.2f}",
            f"{_gain(without, within):.2f}",
            *(f"{one['shaded'] / made['pixels']:.2f}" for one in (without, within)),
        )
    to.print(shown)
    for line in sentences(made):
        to.print(line, soft_wrap=True)


def _pairs(made: dict[str, Any]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return the points without and with the pre-pass, by path and number of layers."""
    points = {(one["path"], one["layers"], one["prepass"]): one for one in made["points"]}
    keys = sorted({key[:2] for key in points}, key=lambda key: (list(PATHS).index(key[0]), key[1]))
    return [(points[(*key, False)], points[(*key, True)]) for key in keys]


def _gain(without: dict[str, Any], within: dict[str, Any]) -> float:
    """Return how many times as long a frame takes without the pre-pass; NaN where the GPU told no times."""
    return without["gpu_ms"] / within["gpu_ms"] if within["gpu_ms"] > 0 else float("nan")


def sentences(made: dict[str, Any]) -> list[str]:
    """Return what the figures say, as sentences."""
    said = []
    for path in dict.fromkeys(one["path"] for one in made["points"]):
        pairs = [pair for pair in _pairs(made) if pair[0]["path"] == path]
        (few, few_with), (many, many_with) = pairs[0], pairs[-1]
        pays: int | None = None
        for without, within in reversed(pairs):  # from here on to the most layers
            if without["gpu_ms"] - within["gpu_ms"] <= without["noise_ms"] + within["noise_ms"]:
                break
            pays = without["layers"]
        said.append(
            f"On the {path} path the pre-pass makes a frame of {_layers(few['layers'])} "
            f"{_gain(few, few_with):.2f} times as fast and one of {_layers(many['layers'])} "
            f"{_gain(many, many_with):.2f} times; it "
            + (f"pays from {_layers(pays)} on." if pays else "does not pay by more than the noise.")
        )
    worst = max(made["points"], key=lambda one: one["error"]["pixels_differ"])
    if worst["error"]["pixels_differ"]:
        said.append(
            f"The pictures differ: {worst['path']} with {_layers(worst['layers'])} in "
            f"{worst['error']['pixels_differ']:,} pixels."
        )
    else:
        said.append("With the pre-pass and without it the picture is the same to the bit.")
    if not all(one["counted"] for one in made["points"]):
        said.append(
            "This device counts no fragments: the number of those shaded is what the scene was made for."
        )
    return said


def _layers(count: int) -> str:
    return f"{count} layer" + "s" * (count != 1)


def plot(axes: Any, made: dict[str, Any]) -> None:
    """Draw GPU time against layers, for both paths with the pre-pass and without."""
    for number, path in enumerate(PATHS):
        for place, (label, line) in enumerate((("without", ":"), ("with", "-"))):
            points = [pair[place] for pair in _pairs(made) if pair[0]["path"] == path]
            axes.errorbar(
                [one["layers"] for one in points],
                [one["gpu_ms"] for one in points],
                [one["noise_ms"] for one in points],
                fmt=line + "os"[number],
                color=f"C{number}",
                label=f"{path}, {label} pre-pass",
                capsize=2,
                ms=4,
            )
    axes.set_xscale("log", base=2)
    counts = sorted({one["layers"] for one in made["points"]})
    axes.set_xticks(counts, map(str, counts))
    axes.set_yscale("log")
    axes.set_xlabel("layers that cover the whole picture")
    axes.set_ylabel("GPU ms a frame")
    axes.set_title(f"Depth pre-pass under {made['lamps']} lamps", fontsize=10)
    axes.legend(fontsize=8)
