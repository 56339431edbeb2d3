"""The cost of lighting a market, by what selects the lights of a pixel: `strata bench 7 --only lights`.

The market is drawn with several numbers of lamps, with each kind of light list, with both loops where the device adds
in subgroups, and lit by a full-screen triangle and by compute. Renderers of one number of lamps are open at once and
take turns in each view. Two views of the chapter count the lights that reach each pixel, and those that it evaluates.
Pictures are compared with brute force to the bit.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, difference, middle
from common.reports.tables import table
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.settings import knobs, preset, replaced
from common.view.camera import View, view_of_scene

KNOB = "light_lists"
"""The setting; a chapter without it evaluates all lights."""

COUNTS, QUICK_COUNTS = (33, 256, 1000, 2400, 4095), (33, 256)
"""Lamps of the market, which has a moon as well; a software driver draws those up to SOFTWARE_MOST."""

SOFTWARE_MOST = 2400

FEW_FRAMES, SLOW_MS = 3, 100.0
"""Frames that are measured where one takes longer than this."""

WAYS = (
    ("brute", "plain", "deferred"),
    ("bins", "plain", "deferred"),
    ("tiles", "plain", "deferred"),
    ("brute", "plain", "compute"),
    ("bins", "plain", "compute"),
    ("tiles", "plain", "compute"),
    ("clusters", "plain", "compute"),
    ("clusters", "scalarised", "compute"),
    ("clusters", "plain", "deferred"),
    ("clusters", "scalarised", "deferred"),
)
"""(light_lists, light_loop, graph) of the ways that are compared."""

CAMERAS, FEW_CAMERAS = 6, 2
"""Views of a measurement, and of a software driver and a quick look."""

LARGE = (1920, 1080)
"""Size of the pictures on a GPU, unless the bench's is larger."""

BUILD, LIGHT = "light_lists", ("lighting", "lighting_compute")
"""The pass that builds the lists, and those that light."""


def name_of(lists: str, loop: str, graph: str) -> str:
    """Return how tables and plots call a way: "clusters, scalarised, compute"."""
    return ", ".join([lists, *([loop] if loop != "plain" else []), graph])


def is_software(subject: Subject) -> bool:
    """Whether the subject's device is a software driver."""
    return bool(subject.device.capabilities.kind == "software")


def picture_size(subject: Subject, effort: Effort) -> tuple[int, int]:
    """Return the size of the pictures: on a GPU and at full effort at least LARGE."""
    size = subject.size
    small = size[0] * size[1] < LARGE[0] * LARGE[1]
    return LARGE if effort.everything and small and not is_software(subject) else size


def views_of(scene: Scene, size: tuple[int, int], count: int) -> dict[str, View]:
    """Return the first views of a scene by the names of their cameras."""
    pose = evaluate_pose(scene, 0.0)
    names = [camera.name for camera in scene.cameras][:count]
    return {name: view_of_scene(scene, pose, name, size[0] / size[1]) for name in names}


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record of a chapter with light lists; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    software = is_software(subject)
    counts = [
        n for n in (COUNTS if effort.everything else QUICK_COUNTS) if not software or n <= SOFTWARE_MOST
    ]
    size = picture_size(subject, effort)
    rows = []
    for number, count in enumerate(counts):
        step(f"{count} lamps", number / len(counts))
        rows.append(_with_lamps(subject, effort, count, size))
    return {"scene": "market", "size": list(size), "frames": effort.frames, "rows": rows}


def _with_lamps(subject: Subject, effort: Effort, count: int, size: tuple[int, int]) -> dict[str, Any]:
    """Return the figures of one number of lamps: work, and the time of each way."""
    scene = subject.load(f"market:lights={count}")
    few = is_software(subject) or not effort.everything
    views = views_of(scene, size, FEW_CAMERAS if few else CAMERAS)
    drawn = subject.on(scene, size)
    ways = [way for way in WAYS if way[1] == "plain" or "subgroups" in subject.device.capabilities.features]
    if is_software(subject):  # its time stamps do not wait for dispatches
        ways = [way for way in ways if way[2] == "deferred"]
    times: dict[str, dict[str, list[float]]] = {name_of(*way): {} for way in ways}
    pictures: dict[str, list[np.ndarray]] = {}
    with ExitStack() as stack:
        renderers = {}
        for lists, loop, graph in ways:
            settings = _settings(subject, light_lists=lists, light_loop=loop, graph=graph)
            renderers[name_of(lists, loop, graph)] = stack.enter_context(
                drawn.open(settings, {"color_linear"})
            )
        for view in views.values():
            for name, renderer in renderers.items():
                _draw(renderer, view, effort, times[name])
                frame = renderer.render(view)
                pictures.setdefault(name, []).append(frame.image("color_linear").copy())
    work = _work(drawn, scene, views)
    rows = []
    for lists, loop, graph in ways:
        name = name_of(lists, loop, graph)
        brute = pictures[name_of("brute", "plain", graph)]
        differ = sum(
            int(difference(one, other)["pixels_differ"])
            for one, other in zip(pictures[name], brute, strict=True)
        )
        row: dict[str, Any] = {"way": name, "lists": lists, "graph": graph, "pixels_differ": differ}
        for what in ("build", "light"):
            row[f"{what}_ms"], row[f"{what}_noise_ms"] = middle(times[name][what])
        row["gpu_ms"] = row["build_ms"] + row["light_ms"]
        rows.append(row)
    for row in rows:
        brute_row = next(it for it in rows if it["lists"] == "brute" and it["graph"] == row["graph"])
        row["times_faster"] = brute_row["gpu_ms"] / max(row["gpu_ms"], 1e-9)
    return {"lights": count, "views": [*views], "work": work, "ways": rows}


def _settings(subject: Subject, **values: Any) -> Any:
    """Return the settings of the chapter's `medium`, with these values changed."""
    return replaced(preset(subject.settings_class, "medium"), **values)


def _draw(renderer: Any, view: View, effort: Effort, times: dict[str, list[float]]) -> None:
    """Draw frames of a view, and keep the times of building lists and of lighting."""
    for _ in range(2):  # a renderer's first frame takes longer than others
        began = clock.perf_counter()
        len(renderer.render(view).timings)  # waits for the frame
    warm_up, frames = effort.warm_up, effort.frames
    if (clock.perf_counter() - began) * 1e3 > SLOW_MS:  # brute force takes up to a second
        warm_up, frames = 1, min(frames, FEW_FRAMES)
    for number in range(warm_up + frames):
        began = clock.perf_counter()
        passes = renderer.render(view).timings
        wall = (clock.perf_counter() - began) * 1e3
        if number >= warm_up:
            # A device without timestamps leaves the wall clock.
            light = sum(passes.get(name, 0.0) for name in LIGHT) if passes else wall
            times.setdefault("build", []).append(passes.get(BUILD, 0.0))
            times.setdefault("light", []).append(light)


def _work(drawn: Subject, scene: Scene, views: dict[str, View]) -> dict[str, float]:
    """Return the medians over lit pixels of the lights in range, and of those evaluated, by the kind of list."""
    found: dict[str, float] = {}
    for lists, shown in (
        ("brute", "light-count"),
        *((it, "lights-evaluated") for it in ("bins", "tiles", "clusters")),
    ):
        settings = _settings(drawn, view=shown, light_lists=lists, color_format="rgba32f")
        with drawn.open(settings, {"color_linear", "depth"}) as renderer:
            counts = []
            for view in views.values():
                frame = renderer.render(view)
                counts.append(frame.image("color_linear")[..., 0][frame.image("depth") > 0])
        every = np.concatenate(counts)
        if lists == "brute":
            reached = every
            found["in_range"] = float(np.median(every[every > 0])) if (every > 0).any() else 0.0
        else:
            lit = reached > 0
            found[lists] = float(np.median(every[lit])) if lit.any() else 0.0
            found[f"{lists}_mean"] = float(every[lit].mean()) if lit.any() else 0.0
    found["in_range_mean"] = float(reached[reached > 0].mean()) if (reached > 0).any() else 0.0
    return found


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as tables, and its sentences."""
    width, height = record["size"]
    shown = table(
        f"Lights that a lit pixel of {record['scene']} evaluates (medians), {width}x{height}",
        *(">lamps", ">in range", ">clusters", ">tiles", ">bins", ">brute force"),
    )
    for row in record["rows"]:
        work = row["work"]
        shown.add_row(
            f"{row['lights']:,}",
            *(f"{work[name]:.0f}" for name in ("in_range", "clusters", "tiles", "bins")),
            f"{row['lights']:,}",
        )
    to.print(shown)
    timed = table(
        "GPU ms of building lists and of lighting", ">lamps", "way", ">build", ">light", ">±", ">times"
    )
    for row in record["rows"]:
        for way in row["ways"]:
            timed.add_row(
                f"{row['lights']:,}",
                way["way"],
                f"{way['build_ms']:.3f}",
                f"{way['light_ms']:.3f}",
                f"{way['light_noise_ms']:.3f}",
                f"{way['times_faster']:.2f}",
            )
    to.print(timed)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = []
    for row in record["rows"]:
        ways = {way["way"]: way for way in row["ways"]}
        best = max(row["ways"], key=lambda way: float(way["times_faster"]))
        work = row["work"]
        lines.append(
            f"{row['lights']:,} lamps: {work['in_range']:.0f} reach a lit pixel in the median, and clusters name "
            f"{work['clusters']:.0f}; {best['way']} is {best['times_faster']:.1f} times as fast as brute force."
        )
        wrong = [name for name, way in ways.items() if way["pixels_differ"]]
        if wrong:
            lines.append(f"{row['lights']:,} lamps: {', '.join(wrong)} differ from brute force.")
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time of lists and lighting over the number of lamps, a line for each way."""
    lights = [row["lights"] for row in record["rows"]]
    for number, way in enumerate(record["rows"][0]["ways"]):
        took = [row["ways"][number]["gpu_ms"] for row in record["rows"]]
        style = "--" if way["graph"] == "deferred" else "-"
        axes.plot(lights, took, style, marker="o", ms=3, label=way["way"])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("lamps")
    axes.set_ylabel("GPU ms of lists and lighting")
    width, height = record["size"]
    axes.set_title(f"Light lists, {record['scene']}, {width}x{height}", fontsize=10)
    axes.legend(fontsize=7)
