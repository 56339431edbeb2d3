"""`strata bench N`: time, error and work of a chapter's settings, its start, and its worst case of stability."""

from __future__ import annotations

import datetime
import json
import os
import platform
import subprocess
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich.console import Console

import chapters
from chapters import bench_points, bench_prepared, bench_start, scenes
from chapters.bench_points import Effort, Subject
from chapters.console import Steps, err, out, say
from chapters.record import STDOUT, naming
from chapters.run import open_device
from chapters.tables import table
from common import stability
from common.errors import UserError
from common.paths import ROOT, write_whole

FORMAT = 2
"""Of the record; readers refuse another."""

FOLDER = ROOT / "docs" / "benchmarks"
PLOTS = (".png", ".svg", ".pdf")


def run(
    which: chapters.Whole,
    backend: str = "auto",
    scene: str = scenes.DEFAULT,
    size: tuple[int, int] = (640, 360),
    quick: bool = False,
    json_path: Path | None = None,
    plot_path: Path | None = None,
    record: bool = False,
) -> int:
    """Measure a chapter or a fork and say what came out; return the exit code.

    `json_path` and `plot_path` get the record and its plot; `record` keeps both in `docs/benchmarks`, under the class
    of the device. Raises UserError for a wrong argument, before anything is measured.
    """
    chapters.choose_backend(backend)
    for path in (json_path, plot_path):
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            raise UserError(f"{path} cannot be written: name a file in a folder that exists.")
    if json_path is not None and plot_path is not None and json_path.absolute() == plot_path.absolute():
        raise UserError(f"--json and --plot both name {json_path}: the record and the plot are two files.")
    if plot_path is not None and plot_path.suffix.lower() not in PLOTS:
        raise UserError(f"--plot {plot_path}: write one of {', '.join(PLOTS)}.")
    if record and quick:
        raise UserError("A quick look is no record: leave out --quick, or --record.")
    if record and not isinstance(which, int):
        raise UserError(
            "--record keeps records of the project's own chapters: write that of a fork by --json FILE."
        )
    if plot_path is not None and not can_plot():
        raise UserError("--plot needs the package matplotlib: run `pip install matplotlib`, or leave it out.")
    with Steps() as steps:
        made = measure(which, backend, scene, size, bench_points.QUICK if quick else bench_points.FULL, steps)
    made["quick"] = quick
    if record:
        FOLDER.mkdir(parents=True, exist_ok=True)
        json_path = json_path or record_path(made["chapter"], made["device"]["class"])
        if can_plot():
            plot_path = plot_path or json_path.with_suffix(".png")
    printed = json_path == STDOUT
    if printed:
        print(json.dumps(made, indent=1))
    elif json_path is not None:
        write_record(json_path, made)
    if plot_path is not None:
        plot(plot_path, made)
    show(made, err if printed else out)
    for path in (json_path, plot_path):
        if path is not None and path != STDOUT:
            say(f"Wrote {path}")
    return 0


def record_path(number: int, device_class: str) -> Path:
    """Return where the record of a chapter on a class of devices is kept."""
    return FOLDER / f"{chapters.folder_name(number)}-{device_class}.json"


def read_record(path: Path) -> dict[str, Any]:
    """Return a record; raise UserError if it is none, or of another format."""
    try:
        made: dict[str, Any] = dict(json.loads(path.read_text("utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise UserError(f"{path} is no record of a bench: {error}.") from None
    if made.get("format") != FORMAT:
        raise UserError(f"{path} is a record of format {made.get('format')}, not {FORMAT}: measure again.")
    return made


def write_record(path: Path, made: dict[str, Any]) -> None:
    """Write a record, whole or not at all."""
    try:
        write_whole(path.absolute(), (json.dumps(made, indent=1) + "\n").encode())
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None


def measure(
    which: chapters.Whole, backend: str, scene: str, size: tuple[int, int], effort: Effort, steps: Steps
) -> dict[str, Any]:
    """Return the record of one bench."""
    steps("load", 0.0)
    loaded = scenes.load(scene)
    load_before = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    defaults = vars(chapters.settings_class(which)())
    steps("start, cold and warm", 0.05)
    starts = bench_start.cold_and_warm(which, backend, scene, size, effort.starts)
    with ExitStack() as stack:
        device = open_device(stack, backend)
        capabilities = device.capabilities
        subject = Subject(which, backend, loaded, size, device)
        found = bench_points.sweep(subject, effort, lambda what, part: steps(what, 0.15 + 0.5 * part))
        points = [point.record(defaults) for point in found]
        for point in points:
            point["front"] = bench_points.on_front(point, points)
        prepared = bench_prepared.sweeps(
            subject, effort, lambda what, part: steps(f"prepare {what}", 0.65 + 0.25 * part)
        )
        steps("stability", 0.9)
        cases = bench_points.stability_cases(subject, effort)
    return {
        "format": FORMAT,
        **naming(which),
        "title": chapters.title_of(which),
        "backend": capabilities.backend,
        "device": {
            "name": capabilities.device,
            "driver": capabilities.driver,
            "class": capabilities.kind,
            "api_version": ".".join(map(str, capabilities.api_version)),
        },
        "system": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
        "python": platform.python_version(),
        "load_before": load_before,
        "commit": commit(),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "scene": {
            "name": scene,
            "instances": len(loaded.instances),
            "triangles": loaded.triangle_count,
        },
        "size": list(size),
        "cache_state": f"shaders and driver warm, {effort.warm_up} frames before each round",
        "frames": effort.frames,
        "rounds": effort.rounds,
        "reference": {"preset": "reference", "samples_per_pixel": effort.samples**2},
        "points": points,
        "prepared": prepared,
        "start_s": starts,
        "stability": {
            "bound": stability.BOUND,
            "worst": max(cases, key=lambda case: case["pixels_changed"]),
            "cases": cases,
        },
    }


def commit() -> str:
    """Return the commit of the clone, with "+" after it if files differ from it.

    A copy without history, as one carried to another machine, takes what the environment's STRATA_COMMIT says.
    """

    def git(*words: str) -> str:
        run = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
        return run.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return os.environ.get("STRATA_COMMIT", "unknown")


def show(made: dict[str, Any], to: Console = out) -> None:
    """Print a record as tables."""
    width, height = made["size"]
    where = f"{made['scene']['name']}, {width}x{height}, {made['device']['name']}"
    to.print(f"Errors are against the reference at {made['reference']['samples_per_pixel']} samples a pixel.")
    name = f"Fork {Path(made['fork']).name}" if "fork" in made else f"Chapter {made['chapter']}"
    _show_points(to, f"{name}: {where}", made["points"])
    for one in made["prepared"]:
        title = f"Before the first frame: {one['name']}, {one['scene']} in {one['environment']}"
        _show_points(to, title, one["points"])
    for state, times in made["start_s"].items():
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
    worst = made["stability"]["worst"]
    to.print(
        f"Stability: worst when {worst['case']}, {worst['pixels_changed']:.3%} of the pixels change "
        f"(at most {made['stability']['bound']:.1%} may).",
        soft_wrap=True,
    )
    if made["rounds"] < 2:
        to.print(
            "Each was measured in one round: what lies close together may be noise. Without --quick there are more.",
            soft_wrap=True,
        )
        return
    for points in (made["points"], *(one["points"] for one in made["prepared"])):
        for name, better in bench_points.dominated(points):
            to.print(f"The preset {name} is slower and less true than {better}.")


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


def can_plot() -> bool:
    """Whether matplotlib is there."""
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None


def plot(path: Path, made: dict[str, Any]) -> None:
    """Draw time against error, with the Pareto front: of frames, and beside it of what is made before the first."""
    from matplotlib.figure import Figure

    count = 1 + len(made["prepared"])
    figure = Figure(figsize=(1 + 6 * count, 4.8), layout="constrained")
    panels = figure.subplots(1, count, squeeze=False)[0]
    width, height = made["size"]
    spp = made["reference"]["samples_per_pixel"]
    _plot_points(panels[0], made["points"])
    panels[0].set_xlabel(f"GPU time, ms a frame at {width}x{height}")
    panels[0].set_ylabel(f"{panels[0].get_ylabel()} against the reference at {spp} samples a pixel")
    panels[0].set_title(f"{made['scene']['name']}, {made['device']['name']}", fontsize=10)
    for axes, one in zip(panels[1:], made["prepared"], strict=True):
        _plot_points(axes, one["points"])
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel(f"GPU time, ms once before the first frame ({one['name']})")
        axes.set_title(f"{one['scene']} in {one['environment']}", fontsize=10)
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise UserError(f"--plot {path} cannot be written: {error}.") from None


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
