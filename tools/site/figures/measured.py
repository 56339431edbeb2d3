"""The figures of what was measured, one for each claim, from the records in docs/benchmarks."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from common.paths import ROOT
from tools.site.figures.canvas import Canvas
from tools.site.figures.charts import Axis, Curve, bars, curves, number

FOLDER = ROOT / "docs" / "benchmarks"
RECORDS = {
    "ch01-presets": "ch01-software",
    "ch01-environment-levels": "ch01-software",
    "ch02-draws": "ch02-discrete",
    "ch02-pipelines": "ch02-discrete",
    "ch03-threads": "ch03-discrete",
    "ch03-loads": "ch03-loads-nvidia-h200",
    "ch04-graph-costs": "ch04-discrete",
    "ch04-prepass": "ch04-discrete",
    "ch05-small-steps": "ch05-discrete",
    "ch05-executions": "ch05-discrete",
    "ch05-energy": "ch05-discrete",
    "ch05-overlap": "ch05-discrete",
}
"""The record that each figure is drawn from."""


def path_of(name: str) -> Path:
    """Return the file of a figure's record."""
    return FOLDER / f"{RECORDS[name]}.json"


@cache
def _record(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path_of(name).read_text("utf-8"))
    return found


def _origin(name: str, size: bool = True) -> str:
    record = _record(name)
    device = record["device"]["name"].partition(" (")[0]
    pixels = ", {}x{}".format(*record["size"]) if size else ""
    return f"{device}{pixels}; docs/benchmarks/{RECORDS[name]}.json"


def _faster(ratio: float) -> str:
    return f"{number(float(f'{ratio:.2g}'))} times faster"


def presets() -> Canvas:
    """Error over time of the presets, and of what the anisotropy and the samples do by themselves."""
    points = {one["name"]: one for one in _record("ch01-presets")["points"]}

    def curve(title: str, names: dict[str, str]) -> Curve:
        at = [(points[name]["gpu_ms"], points[name]["error"]["flip"]) for name in names]
        return Curve(title, at, words=tuple(names.values()))

    return curves(
        "Four samples a pixel remove a third of the error, for half as much time again",
        Axis("GPU time of a frame, ms"),
        Axis("FLIP against 16 samples a pixel, mean"),
        [
            curve("presets", {name: name for name in ("low", "medium", "high")}),
            curve("medium, msaa", {"medium": "", "msaa=4": "4"}),
        ],
        _origin("ch01-presets"),
    )


def environment_levels() -> Canvas:
    """Error over time of the prepared environment, by its size and by the detail of its blurred levels."""
    (part,) = _record("ch01-environment-levels")["prepared"]
    points = {one["name"]: one for one in part["points"]}

    def curve(title: str, names: list[str], words: list[str]) -> Curve:
        at = [(points[name]["gpu_ms"], points[name]["error"]["relative_mse"]) for name in names]
        return Curve(title, at, words=words)

    size = [f"environment_size={n}" for n in (64, 128)] + ["medium", "environment_size=512"]
    detail = [f"environment_detail={n}" for n in ("1.0", "0.7", "0.5")] + [
        "medium",
        "environment_detail=0.25",
    ]
    return curves(
        "Size and detail of the environment's levels decide time and error",
        Axis("GPU time, once before the first frame, ms", log=True),
        Axis("relative MSE", log=True),
        [
            curve("environment_size", size, ["64", "128", "256", "512"]),
            curve("environment_detail", detail, ["1.0", "0.7", "0.5", "", "0.25"]),
        ],
        _origin("ch01-environment-levels"),
    )


def draws() -> Canvas:
    """Python's time of a frame over the number of draws."""
    (scale,) = [one for one in _record("ch02-draws")["scales"] if one["name"] == "draws"]
    names = {
        "chapter 1": "chapter 1",
        "without multi-draw": "a call per draw",
        "all features": "multi-draw",
    }
    shown = [
        Curve(title, [(one["count"], one["python_ms"]) for one in scale["points"] if one["side"] == side])
        for side, title in names.items()
    ]
    return curves(
        "With multi-draw Python's time does not depend on the number of draws",
        Axis("number of draws", log=True),
        Axis("Python's time of a frame, ms", log=True),
        shown,
        _origin("ch02-draws"),
    )


def pipelines() -> Canvas:
    """Time to build the pipelines of a renderer, by what the cache holds."""
    found = _record("ch02-pipelines")["pipelines"]
    names = {"cold": "no cache", "disk": "cache from disk", "memory": "cache in memory"}
    rows = [
        (
            name,
            found["states"][state]["ms"],
            "" if state == "cold" else _faster(found["states"][state]["times_faster"]),
        )
        for state, name in names.items()
    ]
    return bars(
        f"A pipeline cache on disk saves most of the driver's work: {found['pipelines']} pipelines",
        "ms",
        [("", rows)],
        _origin("ch02-pipelines", size=False),
    )


def threads() -> Canvas:
    """Time to record 10,000 draws, by the number of further threads that record."""
    points = [one for one in _record("ch03-threads")["threads"]["points"] if one["draws"] == 10_000]
    rows = [
        ("one thread" if not one["threads"] else f"and {one['threads']} more", one["record_ms"], "")
        for one in points
    ]
    return bars(
        "In Python more threads record 10,000 draws more slowly",
        "ms",
        [("", rows)],
        _origin("ch03-threads", size=False) + ", 16 cores",
    )


def loads() -> Canvas:
    """Time of a load to the last byte on the device, by scene and by what the cache holds."""
    ways = {"plain": "no cache", "cached": "cache", "blocks": "cache of blocks", "least": "without texels"}
    groups = []
    for one in _record("ch03-loads")["loads"]:
        times = {way: 1e3 * one["ways"][way]["load_s"] for way in ways}
        rows = [
            (name, times[way], "" if way == "plain" else _faster(times["plain"] / times[way]))
            for way, name in ways.items()
        ]
        groups.append((one["scene"], rows))
    return bars(
        "A cached scene loads in a fraction of the time", "ms", groups, _origin("ch03-loads", size=False)
    )


def graph_costs() -> Canvas:
    """CPU time of a frame of the graph, by how much of the work is done again."""
    found = _record("ch04-graph-costs")["graph"]
    names = {
        "recorded anew": "recorded anew",
        "sent again, camera moves": "camera moves",
        "sent again": "nothing changes",
    }
    groups = []
    for count in sorted({one["passes"] for one in found["frames"]}):
        ways = {one["way"]: one["own_us"] / 1e3 for one in found["frames"] if one["passes"] == count}
        groups.append((f"{count} passes", [(name, ways[way], "") for way, name in names.items()]))
    compiling = [(f"{one['passes']} passes", one["compile_ms"], "") for one in found["chains"][:2]]
    return bars(
        "A compiled frame that is submitted again costs the least",
        "ms",
        [("compiling, once", compiling), *groups],
        _origin("ch04-graph-costs", size=False),
    )


def prepass() -> Canvas:
    """GPU time of a frame over the layers that cover the picture, with and without a depth pre-pass."""
    found = _record("ch04-prepass")["prepass"]["points"]
    shown = [
        Curve(
            f"{path}{', with pre-pass' if first else ''}",
            [
                (one["layers"], one["gpu_ms"])
                for one in found
                if (one["path"], one["prepass"]) == (path, first)
            ],
            dashed=path == "deferred",
        )
        for path in ("forward", "deferred")
        for first in (False, True)
    ]
    return curves(
        "A depth pre-pass pays on the forward path from the second layer on",
        Axis("layers that cover the picture"),
        Axis("GPU time of a frame, ms", log=True),
        shown,
        _origin("ch04-prepass"),
    )


def small_steps() -> Canvas:
    """Error of a hanging sheet over the time of a step: substeps against iterations, and springs."""
    found = _record("ch05-small-steps")["cloth"]["points"]
    names = {
        "XPBD, substeps": ("XPBD, substeps", "substeps"),
        "XPBD, iterations": ("XPBD, iterations", "iterations"),
        "springs, euler": ("springs, Euler", ""),
    }
    shown = []
    for kind, (title, word) in names.items():
        of_kind = [one for one in found if one["kind"] == kind]
        points = [(one["gpu_ms"], 1e3 * one["rms_m"]) for one in of_kind]
        shown.append(Curve(title, points, words=[str(one[word]) for one in of_kind] if word else ()))
    return curves(
        "Substeps reduce the error of cloth faster than iterations do",
        Axis("GPU time of a step, ms", log=True),
        Axis("rms error of positions, mm", log=True),
        shown,
        _origin("ch05-small-steps", size=False),
    )


def executions() -> Canvas:
    """GPU time of a step over the size of the cloth, for the three ways to run it."""
    found = _record("ch05-executions")["cloth"]["executions"]["points"]
    shown = [
        Curve(way, [(one["particles"], one["gpu_ms"]) for one in found if one["execution"] == way])
        for way in ("thread", "group", "dispatch")
    ]
    return curves(
        "One work group is fastest for a small cloth, dispatches for a large one",
        Axis("particles", log=True),
        Axis("GPU time of a step with 16 substeps, ms", log=True),
        shown,
        _origin("ch05-executions", size=False),
    )


def energy() -> Canvas:
    """Energy of a sheet left alone, over its substeps."""
    found = _record("ch05-energy")["drift"]["points"]
    names = {
        ("verlet", "float32", 0.2): "Verlet, 0.2",
        ("XPBD", "float32", 0.2): "XPBD, 0.2",
        ("XPBD", "float32", 0.02): "XPBD, 0.02",
        ("XPBD", "float64", 0.02): "XPBD, 0.02, float64",
    }
    shown = []
    for (name, precision, step), title in names.items():
        (one,) = [p for p in found if (p["name"], p["precision"], p["h_omega"]) == (name, precision, step)]
        shown.append(Curve(title, [(row[0], row[1]) for row in one["curve"]], marks=False))
    return curves(
        "XPBD loses energy; with tiny steps in float32 it gains energy from rounding",
        Axis("substeps", log=True),
        Axis("energy, of that at the beginning; the numbers of curves are h omega"),
        shown,
        _origin("ch05-energy", size=False),
    )


def overlap() -> Canvas:
    """Time from frame to frame with compute on the graphics queue and on its own, beside the parts."""
    groups = []
    for one in _record("ch05-overlap")["async"]["scenes"]:
        rows = [
            ("drawing alone", one["off"]["drawing_ms"], ""),
            ("compute alone", one["off"]["compute_ms"], ""),
            ("one queue", one["off"]["frame_ms"], ""),
            ("two queues", one["on"]["frame_ms"], _faster(one["ratio"])),
        ]
        groups.append((one["scene"], rows))
    return bars(
        "On a queue of its own, compute runs beside the drawing", "ms", groups, _origin("ch05-overlap")
    )


FIGURES: dict[str, Callable[[], Canvas]] = {
    "ch01-presets": presets,
    "ch01-environment-levels": environment_levels,
    "ch02-draws": draws,
    "ch02-pipelines": pipelines,
    "ch03-threads": threads,
    "ch03-loads": loads,
    "ch04-graph-costs": graph_costs,
    "ch04-prepass": prepass,
    "ch05-small-steps": small_steps,
    "ch05-executions": executions,
    "ch05-energy": energy,
    "ch05-overlap": overlap,
}
