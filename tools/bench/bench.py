"""`strata bench N`: time, error and work of a chapter's settings, its start, and its worst case of stability."""

from __future__ import annotations

import datetime
import json
import os
import platform
import re
import subprocess
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import chapters
from chapters import scenes
from common.errors import UserError
from common.paths import ROOT, write_whole
from common.reports.benches import Effort
from common.scene import stability
from common.settings import flat
from tools.bench import pipelines as bench_pipelines
from tools.bench import points as bench_points
from tools.bench import prepared as bench_prepared
from tools.bench import prepass, scale, start
from tools.bench import readback as bench_readback
from tools.bench import threads as bench_threads
from tools.bench import truth as bench_truth
from tools.bench.lessons import bench
from tools.bench.lessons import loads as bench_loads
from tools.bench.lessons.parts import DRAWN, FOG, HISTORY, PARTS, RATES, SHADOWS, TRACING, parts_of
from tools.bench.points import Subject
from tools.bench.report import can_plot, plot, show
from tools.cli.console import Steps, err, out, say
from tools.run.record import STDOUT, naming
from tools.run.run import open_device

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
    only: Sequence[str] = (),
    truth: str = bench_truth.OWN,
) -> int:
    """Measure a chapter or a fork and say what came out; return the exit code.

    `json_path` and `plot_path` get the record and its plot; `record` keeps both in `docs/benchmarks` too, among those
    of the device. `only` names the PARTS that are measured, all by default. `truth` is what pictures of settings are
    held to. Raises UserError for a wrong argument, before anything is measured.
    """
    api = chapters.choose_backend(backend)
    bench_truth.check(truth, record, only)
    parts = parts_of(which, api, only or judged_parts(truth))
    check_paths(json_path, plot_path)
    if json_path is not None and plot_path is not None and json_path.absolute() == plot_path.absolute():
        raise UserError(f"--json and --plot both name {json_path}: the record and the plot are two files.")
    if plot_path is not None and not DRAWN.intersection(parts):
        raise UserError(f"--plot {plot_path}: of {' and '.join(parts)} there is nothing to draw.")
    check_plot(plot_path)
    check_record(record, quick, only)
    if record and not isinstance(which, int):
        raise UserError(
            "--record keeps records of the project's own chapters: write that of a fork by --json FILE."
        )
    with Steps() as steps:
        effort = bench_points.QUICK if quick else bench_points.FULL
        made = measure(which, backend, scene, size, effort, steps, parts, truth)
    made["quick"] = quick
    if record:
        for written in keep(made):
            say(f"Wrote {written}")
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


def judged_parts(truth: str) -> Sequence[str]:
    """Return the parts that are measured by default where pictures are held to a truth; all where it is their own."""
    return () if truth == bench_truth.OWN else ("settings",)


def check_paths(*paths: Path | None) -> None:
    """Raise UserError for a file that cannot be written, since its folder is not there."""
    for path in paths:
        if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
            raise UserError(f"{path} cannot be written: name a file in a folder that exists.")


def check_plot(path: Path | None) -> None:
    """Raise UserError for a plot that cannot be drawn, or that has no format."""
    if path is None:
        return
    if path.suffix.lower() not in PLOTS:
        raise UserError(f"--plot {path}: write one of {', '.join(PLOTS)}.")
    if not can_plot():
        raise UserError("--plot needs the package matplotlib: run `pip install matplotlib`, or leave it out.")


def check_record(record: bool, quick: bool, only: Sequence[str]) -> None:
    """Raise UserError where --record would keep what is no record."""
    if record and quick:
        raise UserError("A quick look is no record: leave out --quick, or --record.")
    if record and only:
        raise UserError("A part is no record: leave out --only, or --record.")


def keep(made: dict[str, Any]) -> list[Path]:
    """Keep a record among those of its device, with its plot where matplotlib is; return the files."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = path_of(made)
    write_record(path, made)
    if not can_plot():
        return [path]
    plot(path.with_suffix(".png"), made)
    return [path, path.with_suffix(".png")]


def path_of(made: dict[str, Any]) -> Path:
    """Return where a record is kept: under the class of its device, or where another device has that, its name too."""
    path = record_path(made["chapter"], made["device"]["class"])
    try:
        other = read_record(path)["device"]["name"] if path.is_file() else made["device"]["name"]
    except (UserError, KeyError, TypeError):  # a record that nobody can read is none to spare
        return path
    if _plain(other) == _plain(made["device"]["name"]):
        return path
    return path.with_stem(f"{path.stem}-{_plain(made['device']['name'])}")


def _plain(device: str) -> str:
    """Return a device's name as part of a file's: "llvmpipe (LLVM 15.0.6, 256 bits)" is "llvmpipe" in every version."""
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"\(.*?\)", "", device).lower()).strip("-") or "device"


def record_path(number: int, device_class: str) -> Path:
    """Return where the record of a chapter on the first device of a class is kept."""
    return FOLDER / f"{chapters.folder_name(number)}-{device_class}.json"


def read_record(path: Path) -> dict[str, Any]:
    """Return a record; raise UserError if it is none, or of another format."""
    made = read_object(path)
    if made.get("format") != FORMAT:
        raise UserError(f"{path} is a record of format {made.get('format')}, not {FORMAT}: measure again.")
    return made


def read_object(path: Path) -> dict[str, Any]:
    """Return the object that a file of JSON holds; raise UserError if it holds none."""
    try:
        made: dict[str, Any] = dict(json.loads(path.read_text("utf-8")))
    except (OSError, ValueError, TypeError, RecursionError) as error:
        said = error.strerror if isinstance(error, OSError) else None
        raise UserError(f"{path} is no record of a bench: {said or error}.") from None
    return made


def write_record(path: Path, made: dict[str, Any]) -> None:
    """Write a record, whole or not at all."""
    try:
        write_whole(path.absolute(), (json.dumps(made, indent=1) + "\n").encode())
    except OSError as error:
        raise UserError(f"{path} cannot be written: {error.strerror or error}.") from None


def measure(
    which: chapters.Whole,
    backend: str,
    scene: str,
    size: tuple[int, int],
    effort: Effort,
    steps: Steps,
    parts: Collection[str] = tuple(PARTS),
    truth: str = bench_truth.OWN,
) -> dict[str, Any]:
    """Return the record of one bench of `parts`."""
    steps("load", 0.0)
    loaded = scenes.load(scene)
    load_before = os.getloadavg()[0] if hasattr(os, "getloadavg") else None

    def within(begin: float, end: float, what: str = "") -> Callable[[str, float], None]:
        """Return how a part of the bench reports: its own 0 to 1 is `begin` to `end` of the whole."""
        return lambda name, part: steps(f"{what} {name}".strip(), begin + (end - begin) * part)

    found: list[bench_points.Point] = []
    starts, prepared, grown, pipelines, threads, cases = {}, [], [], None, None, []
    facts: dict[str, Any] = {"preset": "reference", "samples_per_pixel": effort.samples**2}
    loads: list[dict[str, Any]] = []
    readback: dict[str, Any] | None = None
    framed: dict[str, Any] = {}
    if "start" in parts:
        steps("start, cold and warm", 0.02)
        starts = start.cold_and_warm(which, backend, scene, size, effort.starts)
    if "pipelines" in parts:
        pipelines = bench_pipelines.measure(which, size, effort, within(0.1, 0.15, "pipelines,"))
    if "loads" in parts:
        loads = bench_loads.measure(which, backend, size, effort, within(0.15, 0.25, "load"))
    with ExitStack() as stack:
        device = open_device(stack, backend)
        capabilities = device.capabilities
        subject = Subject(which, backend, loaded, size, device)
        if "settings" in parts:
            found, held_to = bench_points.sweep(subject, effort, within(0.25, 0.4), truth)
            facts = held_to.facts
        if "prepared" in parts:
            prepared = bench_prepared.sweeps(subject, effort, within(0.4, 0.6, "prepare"))
        if "scales" in parts:
            grown = scale.scales(subject, effort, within(0.6, 0.7))
        if "threads" in parts:
            threads = bench_threads.measure(subject, effort, within(0.7, 0.75))
        if "readback" in parts:
            readback = bench_readback.measure(device, effort, within(0.75, 0.76, "read back"))
        if "graph" in parts:
            framed["graph"] = bench("graph").measure(subject, effort, within(0.76, 0.8))
        if "prepass" in parts:
            framed["prepass"] = prepass.measure(subject, effort, within(0.8, 0.85, "pre-pass,"))
        if "gbuffer" in parts:
            framed["gbuffer"] = bench("gbuffer").measure(
                subject, effort, within(0.85, 0.87, "G-buffer,"), scene
            )
        if "cloth" in parts:
            framed["cloth"] = bench("cloth").measure(subject, effort, within(0.87, 0.89, "cloth,"))
        if "drift" in parts:
            framed["drift"] = bench("drift").measure(subject, effort, within(0.89, 0.9, "cloth left alone,"))
        if "async" in parts:
            framed["async"] = bench("async_compute").measure(subject, effort, within(0.9, 0.92, "queues,"))
        if "pacing" in parts:
            framed["pacing"] = bench("pacing").measure(subject, effort, within(0.92, 0.93))
        if "culling" in parts:
            framed["culling"] = bench("stages").measure(subject, effort, within(0.93, 0.95, "culling,"))
        if "ideal" in parts:
            framed["ideal"] = bench("visible_set").measure(subject, effort, within(0.95, 0.96))
        if "meshlets" in parts:
            framed["meshlets"] = bench("meshlet_sizes").measure(subject, effort, within(0.96, 0.97))
        if "lods" in parts:
            framed["lods"] = bench("levels").measure(subject, effort, within(0.97, 0.975))
        if "lights" in parts:
            framed["lights"] = bench("lights").measure(subject, effort, within(0.975, 0.976))
        if "surfaces" in parts:
            framed["surfaces"] = bench("visibility").measure(subject, effort, within(0.976, 0.977))
        if "occlusion" in parts:
            framed["occlusion"] = bench("occlusion").measure(subject, effort, within(0.977, 0.978))
        if "transparency" in parts:
            framed["transparency"] = bench("transparency").measure(subject, effort, within(0.978, 0.979))
        if "hdr" in parts:
            framed["hdr"] = bench("hdr").measure(subject, effort, within(0.979, 0.98))
        for part, module in (SHADOWS | RATES | FOG | HISTORY | TRACING).items():
            if part in parts:
                framed[part] = bench(module).measure(subject, effort, within(0.98, 0.98, f"{part},"))
        if "stability" in parts:
            steps("stability", 0.98)
            cases = bench_points.stability_cases(subject, effort)
    defaults = flat(chapters.settings_class(which)())
    points = [point.record(defaults) for point in found]
    for point in points:
        point["front"] = bench_points.on_front(point, points)
    made = {
        "format": FORMAT,
        **naming(which),
        "title": chapters.title_of(which),
        "parts": [part for part in PARTS if part in parts],
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
        "reference": facts,
        "points": points,
        "prepared": prepared,
        "start_s": starts,
        "scales": grown,
        "pipelines": pipelines,
        "threads": threads,
        "loads": loads,
        "readback": readback,
        **framed,
        "stability": None,
    }
    if cases:
        worst = max(cases, key=lambda case: case["pixels_changed"])
        made["stability"] = {"bound": stability.BOUND, "worst": worst, "cases": cases}
    return made


def commit() -> str:
    """Return the commit of the clone, with "+" after it if files differ from it.

    A copy without its own history, as one carried to another machine, takes what the environment's STRATA_COMMIT says.
    """
    if said := os.environ.get("STRATA_COMMIT"):
        return said

    def git(*words: str) -> str:
        run = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
        return run.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=12", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
