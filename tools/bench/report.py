"""What a bench found, as tables and as a plot."""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rich.console import Console

from common.errors import UserError
from common.images.small_pictures import encode_small
from common.paths import write_whole
from common.reports.tables import table
from tools.bench import pipelines, prepass, readback, scale, threads, truth
from tools.bench import points as bench_points
from tools.bench.figures.below import write_below
from tools.bench.lessons import bench
from tools.cli.console import out

FRAME_PARTS = {
    "graph": "graph",
    "prepass": "",
    "gbuffer": "gbuffer",
    "cloth": "cloth",
    "drift": "drift",
    "async": "async_compute",
    "pacing": "pacing",
    "culling": "stages",
    "ideal": "visible_set",
    "meshlets": "meshlet_sizes",
    "lods": "levels",
    "lights": "lights",
    "surfaces": "visibility",
    "occlusion": "occlusion",
    "transparency": "transparency",
    "hdr": "hdr",
    "memory": "shadow_memory",
    "filters": "shadow_filters",
    "cascades": "shadow_cascades",
    "caching": "shadow_caching",
    "casters": "shadow_casters",
    "rates": "rates",
    "constants": "constants",
    "fog": "fog",
    "taa": "taa",
    "rays": "rays",
    "paths": "paths",
}
"""The parts of chapters whose frame is a graph, and the benches of lessons that show and draw them."""


def shows(part: str) -> Any:
    """Return the module that shows and draws a part of `FRAME_PARTS`."""
    return bench(FRAME_PARTS[part]) if FRAME_PARTS[part] else prepass


def show(made: dict[str, Any], to: Console = out) -> None:
    """Print a record: tables of all that was measured."""
    width, height = made["size"]
    where = f"{made['scene']['name']}, {width}x{height}, {made['device']['name']}"
    name = f"Fork {Path(made['fork']).name}" if "fork" in made else f"Chapter {made['chapter']}"
    if made["points"] or made["prepared"]:
        to.print(truth.sentence(made["reference"]), soft_wrap=True, markup=False)
    else:
        to.print(f"{name}: {made['device']['name']}")
    if made["points"]:
        _show_points(to, f"{name}: {where}", made["points"])
    for one in made["prepared"]:
        title = f"Before the first frame: {one['name']}, {one['scene']} in {one['environment']}"
        _show_points(to, title, one["points"])
    for one in made.get("scales", ()):
        scale.show(one, to)
    if made.get("pipelines"):
        pipelines.show(made["pipelines"], to)
    if made.get("threads"):
        threads.show(made["threads"], to)
    bench("loads").show(made.get("loads", []), to)
    if made.get("readback"):
        readback.show(made["readback"], to)
    for part in FRAME_PARTS:
        if made.get(part):
            shows(part).show(made[part], to)
    _show_starts(to, made["start_s"])
    if made["stability"]:
        worst = made["stability"]["worst"]
        to.print(
            f"Stability: worst when {worst['case']}, {worst['pixels_changed']:.3%} of the pixels change "
            f"(at most {made['stability']['bound']:.1%} may).",
            soft_wrap=True,
        )
    if made["rounds"] < 2:
        to.print(
            "This was a quick look: what lies close together may be noise. Without --quick more is measured.",
            soft_wrap=True,
        )
        return
    for points in (made["points"], *(one["points"] for one in made["prepared"])):
        for preset, better in bench_points.dominated(points):
            to.print(f"The preset {preset} is slower and less true than {better}.")


def _show_starts(to: Console, starts: dict[str, dict[str, float]]) -> None:
    for state, times in starts.items():
        parts = ", ".join(
            f"{name} {value:.2f} s"
            for name, value in times.items()
            if name not in ("total", "shaders_compiled")
        )
        to.print(
            f"Start, {state}: {times['total']:.2f} s to the picture ({parts}); "
            f"{times['shaders_compiled']:.0f} shaders compiled.",
            soft_wrap=True,
        )


def _show_points(to: Console, title: str, points: list[dict[str, Any]]) -> None:
    """Print a table of points; a star marks those of the Pareto front, which no other beats in time and error."""
    walls = "wall_ms" in points[0]
    columns = ("setting", "", ">GPU ms", ">±", *([">wall ms"] if walls else []), ">rel. MSE", ">max", ">FLIP")
    shown = table(title, *columns)
    for point in points:
        error = point["error"]
        shown.add_row(
            point["name"],
            "*" if point["front"] else "",
            f"{point['gpu_ms']:.2f}",
            f"{point['noise_ms']:.2f}",
            *([f"{point['wall_ms']:.2f}"] if walls else []),
            f"{error['relative_mse']:.2g}",
            f"{error['max_abs']:.3f}",
            "-" if error["flip"] is None else f"{error['flip']:.4f}",
        )
    to.print(shown)


DOTS = (100, 85, 72, 60)
"""Pixels of a plot's inch that are tried, the most first."""


def can_plot() -> bool:
    """Whether matplotlib is there."""
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None


def plot(path: Path, made: dict[str, Any]) -> None:
    """Draw a panel for each part: time against error with the Pareto front; what things cost; building pipelines.

    Below them stands what the chapter leaves out by design, if errors are against light that is traced.
    """
    from matplotlib.figure import Figure

    panels: list[Callable[[Any, Any], None]] = []
    if made["points"]:
        panels.append(partial(_plot_settings, made))
    panels += [partial(_plot_prepared, one) for one in made["prepared"]]
    panels += [partial(_plot_scale, one) for one in made.get("scales", ())]
    if made.get("pipelines"):
        panels.append(partial(_plot_pipelines, made["pipelines"]))
    if any(one["ways"] for one in made.get("loads", ())):
        panels.append(partial(_plot_loads, made["loads"]))
    for part in FRAME_PARTS:
        if made.get(part):
            panels.append(partial(_plot_alone, shows(part).plot, made[part]))
            if part == "cloth":
                panels.append(partial(_plot_alone, bench("executions").plot, made[part]["executions"]))
    columns = min(len(panels), 3)
    rows = -(-len(panels) // columns)
    figure = Figure(figsize=(1 + 6 * columns, 4.8 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    for number, draw in enumerate(panels):
        draw(figure, grid[number // columns, number % columns])
    write_below(figure, [made["reference"].get("by_design", "")] if made["points"] else [])
    try:
        if path.suffix.lower() == ".png":
            _write_png(path, figure)
        else:
            figure.savefig(path)
    except (OSError, ValueError) as error:
        raise UserError(f"--plot {path} cannot be written: {error}.") from None


def _write_png(path: Path, figure: Any) -> None:
    """Write a plot as a small file: records have one each, for every device. Many panels get fewer pixels each."""
    data: bytes | None = None
    for dots in DOTS:
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=dots)
        with Image.open(stream) as drawn:
            data = encode_small(np.asarray(drawn.convert("RGB")))
        if data is not None:
            break
    write_whole(path.absolute(), data or stream.getvalue())


def _plot_settings(made: dict[str, Any], figure: Any, cell: Any) -> None:
    axes = figure.add_subplot(cell)
    width, height = made["size"]
    _plot_points(axes, made["points"])
    axes.set_xlabel(f"GPU time, ms a frame at {width}x{height}")
    between = "\n" if "truth" in made["reference"] else " "  # one line would be longer than the panel is high
    axes.set_ylabel(f"{axes.get_ylabel()}{between}{truth.axis(made['reference'])}")
    axes.set_title(f"{made['scene']['name']}, {made['device']['name']}", fontsize=10)


def _plot_prepared(one: dict[str, Any], figure: Any, cell: Any) -> None:
    axes = figure.add_subplot(cell)
    _plot_points(axes, one["points"])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(f"GPU time, ms once before the first frame ({one['name']})")
    axes.set_title(f"{one['scene']} in {one['environment']}", fontsize=10)


def _plot_pipelines(one: dict[str, Any], figure: Any, cell: Any) -> None:
    pipelines.plot(figure.add_subplot(cell), one)


def _plot_loads(made: list[dict[str, Any]], figure: Any, cell: Any) -> None:
    bench("loads").plot(figure.add_subplot(cell), made)


def _plot_alone(draw: Callable[[Any, Any], None], one: Any, figure: Any, cell: Any) -> None:
    draw(figure.add_subplot(cell), one)


def _plot_scale(one: dict[str, Any], figure: Any, cell: Any) -> None:
    above, below = cell.subgridspec(2, 1, height_ratios=(5, 1))
    axes = figure.add_subplot(above)
    scale.plot(axes, figure.add_subplot(below, sharex=axes), one)


def _plot_points(axes: Any, points: list[dict[str, Any]]) -> None:
    """Draw presets as dots, knobs turned alone as crosses, and the front that no setting lies below."""
    measure_name = bench_points.measure_of(points)
    front = sorted((p["gpu_ms"], p["error"][measure_name]) for p in points if p["front"])
    axes.plot(*zip(*front, strict=True), "-", color="0.7", label="Pareto front", zorder=0)
    for kind, mark in (("knob", "x"), ("preset", "o")):
        chosen = [p for p in points if p["kind"] == kind]
        times = [p["gpu_ms"] for p in chosen]
        values = [p["error"][measure_name] for p in chosen]
        noise = [p["noise_ms"] for p in chosen]
        axes.errorbar(times, values, xerr=noise, fmt=mark, label=f"{kind}s", capsize=2)
        for point, x, y in zip(chosen, times, values, strict=True):
            size = 9 if kind == "preset" else 6
            axes.annotate(point["name"], (x, y), textcoords="offset points", xytext=(5, 4), fontsize=size)
    axes.set_ylabel("mean FLIP" if measure_name == "flip" else "relative MSE")
    axes.legend()
