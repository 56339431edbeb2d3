"""Cost and gain of a frame graph: memory and barriers, and the times of compiling, recording and resubmitting.

A graph is compiled when the structure of a frame changes, and recorded when something in it changes; all other frames
submit the recording again. So each of the three has a time of its own here. To add passes, the bench inserts copies of
the chapter's tone curve between the curve and its input: small passes that cost the GPU little.

The time of `render`, from its call to its return, has a separate part for the driver. On Vulkan that is vkQueueSubmit2,
on OpenGL all calls of the frame, which are made again in each frame. The GPU is idle before each call. The processor's
last work is the same for all: a frame of another renderer. Otherwise a long frame would slow the call after it, since
the caches serve other work during the wait. Nothing moves in the scene of these frames: the evaluation of animations
takes its time with any frame, graph or not.
"""

from __future__ import annotations

import copy
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rich.console import Console

from backends.contract import Access, Renderer
from common.reports.benches import Effort, Subject, middle, moved_view
from common.reports.tables import table
from common.settings import knobs, preset, replaced
from common.view.camera import View

KNOB = "graph"
"""The setting that chooses the passes of a frame; a chapter without it has no frame graph."""

GRAPHS: dict[str, dict[str, Any]] = {
    "deferred with a lens": {"graph": "deferred", "aperture": 2.8},
    "deferred": {"graph": "deferred"},
    "forward": {"graph": "forward"},
}
"""Frames whose graphs are measured, and their settings."""

CHAINS = (20, 100, 1000)
"""Passes of graphs that are compiled without being drawn: each pass reads the output of the one before it."""

PASSES = (5, 50)
"""Passes of the frames whose CPU time is measured."""

SCENE, SIZE = "cornell", (64, 36)
"""Scene and size of these frames: drawing them takes little from a processor that a software driver shares."""

WAYS = {
    "sent again": (True, False),
    "sent again, camera moves": (True, True),
    "recorded anew": (False, False),
}
"""Kinds of frames: whether a recording is submitted again, and whether the camera moves."""

REPEATED = "tonemap"
"""The pass whose copies are added."""

ROUNDS = 20
"""Frames of each kind for one frame of a sweep."""


def measure(
    subject: Subject,
    effort: Effort,
    step: Callable[[str, float], None],
    chains: Sequence[int] = CHAINS,
    passes: Sequence[int] = PASSES,
) -> dict[str, Any] | None:
    """Return the record of a chapter with a frame graph; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    graphs = []
    for number, (name, values) in enumerate(GRAPHS.items()):
        step(f"graph of {name}", 0.3 * number / len(GRAPHS))
        graphs.append(_graph(subject, effort, name, values))
    compiled = []
    for number, count in enumerate(chains):
        step(f"compiling {count:,} passes", 0.3 + 0.2 * number / len(chains))
        compiled.append(_chain(subject, effort, count))
    frames = _frames(subject, effort, lambda what, part: step(what, 0.5 + 0.5 * part), passes)
    return {"graphs": graphs, "chains": compiled, **frames}


def _settings(subject: Subject, values: dict[str, Any]) -> Any:
    medium: Any = preset(subject.settings_class, "medium")
    return replaced(medium, **values)


# --- compiling --------------------------------------------------------------------------------------------------------


def _graph(subject: Subject, effort: Effort, name: str, values: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the graph of one frame of the bench's scene and size."""
    with subject.open(_settings(subject, values), {"color"}) as renderer:
        drawn: Any = renderer
        graph = drawn.graph
        times = _timed(drawn._compiled, 3 * max(effort.frames, 3))
        return {
            "name": name,
            "settings": values,
            **graph.counts(),
            "transient_bytes_bound": graph.memory.bound,
            "left_out": dict(graph.left_out),
            **_named("compile_ms", times, 1e3),
        }


def _chain(subject: Subject, effort: Effort, count: int) -> dict[str, Any]:
    node = subject.module("graph.types").Node
    compile_graph = subject.module("graph.frame_graph").compile_graph
    nodes = [
        node(
            f"pass {number}",
            (Access(f"image {number - 1}", "sampled"),) if number else (),
            (Access(f"image {number}", "color", format="rgba8"),),
        )
        for number in range(count)
    ]
    output = f"image {count - 1}"
    times = _timed(lambda: compile_graph(nodes, subject.size, {output}), max(effort.frames, 3))
    return {"passes": count, **_named("compile_ms", times, 1e3)}


def _timed(call: Callable[[], Any], times: int) -> list[float]:
    """Return the seconds of each of several calls, after one that does not count."""
    seconds = []
    for _ in range(times + 1):
        began = clock.perf_counter()
        call()
        seconds.append(clock.perf_counter() - began)
    return seconds[1:]


def _named(name: str, seconds: Sequence[float], factor: float) -> dict[str, float]:
    """Return the median as `name`, and beside it half the distance of the quartiles, and the least value."""
    what, _, unit = name.rpartition("_")
    scaled = [factor * value for value in seconds]
    median, noise = middle(scaled)
    return {name: median, f"{what}_noise_{unit}": noise, f"{what}_least_{unit}": min(scaled, default=median)}


# --- frames -----------------------------------------------------------------------------------------------------------


@dataclass
class _Run:
    """A renderer with a number of passes, whose frames are drawn in one of the WAYS, and their times in seconds."""

    passes: int
    way: str
    renderer: Renderer
    view: View
    whole: list[float] = field(default_factory=list)
    driver: list[float] = field(default_factory=list)

    def frame(self, turn: float) -> None:
        """Draw a frame and wait for it; keep its times if it was recorded or submitted again as its way requires."""
        again, moves = WAYS[self.way]
        view = moved_view(self.view, self.renderer.scene, turn) if moves else self.view
        with _driver(self.renderer) as driver:
            began = clock.perf_counter()
            frame = self.renderer.render(view)
            took = clock.perf_counter() - began
        if frame.work["recorded"] != again:
            self.whole.append(took)
            self.driver.append(sum(driver))
        sum(frame.timings.values())  # waits for the GPU

    def point(self) -> dict[str, Any]:
        """Return the figures of the frames."""
        own = [whole - driver for whole, driver in zip(self.whole, self.driver, strict=True)]
        return {
            "passes": self.passes,
            "way": self.way,
            "frames": len(own),
            **_named("render_us", self.whole, 1e6),
            **_named("driver_us", self.driver, 1e6),
            **_named("own_us", own, 1e6),
        }


@contextmanager
def _driver(renderer: Any) -> Iterator[list[float]]:
    """Yield a list of the seconds of each call that hands a frame to the driver."""
    vulkan = renderer.capabilities.backend == "vulkan"
    owner, name = (renderer.device.fn, "vkQueueSubmit2") if vulkan else (renderer._frames, "submit")
    called = getattr(owner, name)
    seconds: list[float] = []

    def timed(*arguments: Any) -> Any:
        began = clock.perf_counter()
        try:
            return called(*arguments)
        finally:
            seconds.append(clock.perf_counter() - began)

    setattr(owner, name, timed)
    try:
        yield seconds
    finally:
        setattr(owner, name, called)


def _frames(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], passes: Sequence[int]
) -> dict[str, Any]:
    runs: list[_Run] = []
    still = subject.on(subject.load(SCENE), SIZE)
    with ExitStack() as stack:
        for count in passes:
            for way, (again, _) in WAYS.items():
                step(f"frames of {count} passes", 0.5 * len(runs) / (len(WAYS) * len(passes)))
                renderer = stack.enter_context(still.open(_settings(subject, {"resubmit": again}), {"color"}))
                repeat(renderer, count)
                runs.append(_Run(len(renderer.passes), way, renderer, subject.view(renderer)))
        view = subject.view(runs[0].renderer)
        drawn = stack.enter_context(still.open(_settings(subject, {}), {"color"}))
        before = _Run(len(drawn.passes), "sent again", drawn, view)
        for run in (*runs, before):  # first each slot is recorded, and the driver compiles shaders
            for turn in range(4):
                run.frame(turn / 4)
            run.whole.clear()
            run.driver.clear()
        random = np.random.default_rng(1)
        rounds = ROUNDS * max(effort.frames, 1)
        for turn in range(rounds):
            if turn % ROUNDS == 0:
                step("frames, recorded and sent again", 0.5 + 0.5 * turn / rounds)
            for number in random.permutation(len(runs)):
                before.frame(0.0)
                runs[number].frame(1.0 + turn)
        points = [run.point() for run in runs]
    return {
        "scene": SCENE,
        "size": list(SIZE),
        "backend": subject.device.capabilities.backend,
        "frames": points,
    }


def repeat(renderer: Any, count: int) -> None:
    """Insert copies of `REPEATED`, in a row before it, until a renderer has `count` passes."""
    original = next(gpu_pass for gpu_pass in renderer.passes if gpu_pass.name == REPEATED)
    read = renderer._plan.nodes[REPEATED].reads[0].resource
    for number in range(count - len(renderer.passes)):
        written = f"toned_{number}"
        gpu_pass = copy.copy(original)
        gpu_pass.name = f"{REPEATED} {number}"
        gpu_pass.reads = (Access(read, "sampled"),)
        gpu_pass.writes = (replace(original.writes[0], resource=written),)
        renderer.insert_pass(gpu_pass, {REPEATED: {read: written}})
        read = written


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as tables, and its sentences."""
    shown = table(
        "Frame graphs: memory of what lives within a frame",
        *("frame", ">passes", ">left out", ">barriers", ">layouts", ">MB alone", ">MB", ">least"),
    )
    for graph in record["graphs"]:
        shown.add_row(
            graph["name"],
            *(str(graph[name]) for name in ("passes", "passes_skipped", "barriers", "transitions")),
            *(f"{graph[f'transient_bytes{end}'] / 1e6:.2f}" for end in ("_alone", "", "_bound")),
        )
    to.print(shown)
    shown = table("Compiling a graph", "graph", ">passes", ">ms", ">±")
    for graph in (*record["graphs"], *record["chains"]):
        times = (f"{graph[name]:.2f}" for name in ("compile_ms", "compile_noise_ms"))
        shown.add_row(graph.get("name", "a chain"), f"{graph['passes']:,}", *times)
    to.print(shown)
    shown = table(
        "From the call of render to its return, us",
        *(">passes", "frames", ">all", ">±", f">{_driver_name(record)}", ">±", ">the rest", ">±"),
    )
    for point in record["frames"]:
        cells = [
            f"{point[f'{name}{end}_us']:.0f}"
            for name in ("render", "driver", "own")
            for end in ("", "_noise")
        ]
        shown.add_row(str(point["passes"]), point["way"], *cells)
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def _driver_name(record: dict[str, Any]) -> str:
    return "vkQueueSubmit2" if record["backend"] == "vulkan" else "OpenGL's calls"


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    best = max(record["graphs"], key=lambda graph: _saved(graph))
    lines = [
        f"Sharing memory saves {_saved(best):.1%} in the frame {best['name']}, and no arrangement saves more than "
        f"{1 - best['transient_bytes_bound'] / best['transient_bytes_alone']:.1%}."
        if _saved(best) > 0
        else "No two images of these frames can share memory: all are needed at the same time."
    ]
    for way in WAYS:
        points = [point for point in record["frames"] if point["way"] == way and point["frames"]]
        if len(points) > 1:
            few, many = points[0], points[-1]
            each = (many["own_us"] - few["own_us"]) / max(many["passes"] - few["passes"], 1)
            lines.append(
                f"Frames {way}: {few['own_us']:.0f} us beside the driver with {few['passes']} passes, "
                f"{many['own_us']:.0f} us with {many['passes']}; {each:.2f} us for each pass more."
            )
    return lines


def _saved(graph: dict[str, Any]) -> float:
    alone = graph["transient_bytes_alone"]
    return 1 - graph["transient_bytes"] / alone if alone else 0.0


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the times of frames without the driver, and of compiling, against the number of passes."""
    for number, way in enumerate(WAYS):
        points = [point for point in record["frames"] if point["way"] == way]
        _line(axes, points, "own_us", f"C{number}", f"frames {way}", "-" + "os^"[number])
    _line(axes, record["chains"], "compile_ms", "C3", "compiling a chain", "-D")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("number of passes")
    axes.set_ylabel("ms on the CPU, without the driver")
    axes.set_title("What a frame graph costs", fontsize=10)
    axes.legend(fontsize=8)


def _line(axes: Any, points: list[dict[str, Any]], name: str, colour: str, label: str, form: str) -> None:
    what, _, unit = name.rpartition("_")
    factor = {"us": 1e-3, "ms": 1.0}[unit]
    axes.errorbar(
        [point["passes"] for point in points],
        [factor * point[name] for point in points],
        [factor * point[f"{what}_noise_{unit}"] for point in points],
        fmt=form,
        color=colour,
        label=label,
        capsize=2,
        ms=4,
    )
