"""How large meshlets should be: `strata bench 6 --only meshlets`.

Small meshlets fit what is visible more closely; large ones are fewer to test, and share more of their vertices. The
city is cut into meshlets of several sizes, and each is drawn with all tests while the camera walks through its streets.
All sizes are open at once and take turns in each view.
"""

from __future__ import annotations

import copy
import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject
from common.reports.tables import table
from common.settings import knobs

from .stages import COUNTERS
from .streets import KNOB, Walker, city, frames_of, medium, paths, picture_size, street_views

SIZES = ((32, 62), (64, 124), (128, 250))
"""The most vertices and triangles of a meshlet. With twice the vertices, 3 T + 2 local indices fill whole words."""


def measure(
    subject: Subject, effort: Effort, step: Callable[[str, float], None]
) -> list[dict[str, Any]] | None:
    """Return a record for each size and path, of a chapter that has meshlets; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    step("the city", 0.0)
    name, scene = city(subject, effort)
    size = picture_size(subject, effort)
    views = street_views(subject, effort, scene)
    warm_up, frames = frames_of(subject, effort)
    build = subject.module("meshlets.build").build_meshlets
    keep = subject.module("meshlets.scene").keep_meshlets
    rows: list[dict[str, Any]] = []
    walkers: list[Walker] = []
    with ExitStack() as stack:
        for number, limits in enumerate(SIZES):
            step(f"meshlets of {limits[0]} vertices", 0.05 + 0.35 * number / len(SIZES))
            began = clock.perf_counter()
            meshlets = build(scene, *limits)
            cut = {"build_s": clock.perf_counter() - began, **_figures(scene, meshlets, limits)}
            own = copy.copy(scene)  # meshlets belong to a scene
            keep(own, meshlets)
            for path in paths(subject):
                settings = medium(subject, geometry=path, culling="occlusion")
                renderer = stack.enter_context(subject.on(own, size).open(settings, {"color"}))
                walkers.append(Walker(renderer))
                rows.append({"scene": name, "path": path, **cut})
        for number, view in enumerate(views):
            step(view, 0.4 + 0.6 * number / len(views))
            for walker in walkers:
                walker.walk(view, warm_up, frames)
        for row, walker in zip(rows, walkers, strict=True):
            row["gpu_ms"], row["noise_ms"] = walker.time("gpu")
            row["work"] = walker.counts(COUNTERS)
    return rows


def _figures(scene: Any, meshlets: Any, limits: tuple[int, int]) -> dict[str, Any]:
    """Return the number of meshlets, how full they are, and their bytes.

    `fill` is the mean part of the limit of triangles, `vertex_fill` that of vertices. `share` is the part of the
    unique triangles that lie in meshlets: smaller meshlets leave fewer meshes whole.
    """
    records = meshlets.records
    total = int(scene.meshes["index_count"].sum(dtype=np.int64)) // 3
    triangles = int((records["counts"] >> 8).sum(dtype=np.int64))
    vertices = int((records["counts"] & 255).sum(dtype=np.int64))
    count = max(len(records), 1)
    return {
        "vertices": limits[0],
        "triangles": limits[1],
        "meshlets": len(records),
        "fill": triangles / (count * limits[1]),
        "vertex_fill": vertices / (count * limits[0]),
        "share": triangles / max(total, 1),
        "bytes": int(records.nbytes + meshlets.words.nbytes),
    }


# --- results ----------------------------------------------------------------------------------------------------------


def show(rows: list[dict[str, Any]], to: Console) -> None:
    """Print the records as a table, and their sentences."""
    if not rows:
        return
    shown = table(
        f"Meshlets of several sizes, {rows[0]['scene']}: ms of the passes that select and draw",
        *(">limits", "path", ">meshlets", ">full %", ">MB", ">build s", ">GPU ms", ">±", ">drawn"),
        ">triangles",
    )
    for row in rows:
        shown.add_row(
            f"{row['vertices']}/{row['triangles']}",
            row["path"],
            f"{row['meshlets']:,}",
            f"{100 * row['vertex_fill']:.0f}/{100 * row['fill']:.0f}",
            f"{row['bytes'] / 1e6:.1f}",
            f"{row['build_s']:.2f}",
            f"{row['gpu_ms']:.3f}",
            f"{row['noise_ms']:.3f}",
            f"{row['work']['units_drawn']:,}",
            f"{row['work']['triangles_drawn']:,}",
        )
    to.print(shown)
    for line in sentences(rows):
        to.print(line, soft_wrap=True)


def sentences(rows: list[dict[str, Any]]) -> list[str]:
    """Return the results as sentences."""
    lines = []
    for path in dict.fromkeys(row["path"] for row in rows):
        own = [row for row in rows if row["path"] == path]
        best = min(own, key=lambda row: float(row["gpu_ms"]))
        others = "; ".join(
            f"with {row['vertices']} x {row['gpu_ms'] / best['gpu_ms']:.2f}" for row in own if row is not best
        )
        lines.append(f"{path}: {best['vertices']} vertices are the fastest ({others}).")
    small, *_, large = sorted(rows, key=lambda row: int(row["vertices"]))
    ratio = large["work"]["triangles_drawn"] / max(small["work"]["triangles_drawn"], 1)
    lines.append(
        f"Meshlets of {large['vertices']} vertices draw {ratio:.2f} times the triangles of those of "
        f"{small['vertices']}, and are {large['meshlets'] / max(small['meshlets'], 1):.2f} times as many."
    )
    return lines


def plot(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Draw the time of each path, and the triangles drawn, by the most vertices of a meshlet."""
    for number, path in enumerate(dict.fromkeys(row["path"] for row in rows)):
        own = [row for row in rows if row["path"] == path]
        axes.errorbar(
            [row["vertices"] for row in own],
            [row["gpu_ms"] for row in own],
            [row["noise_ms"] for row in own],
            fmt="-" + "os"[number],
            color=f"C{number}",
            label=path,
            capsize=2,
        )
    beside = axes.twinx()
    own = [row for row in rows if row["path"] == rows[0]["path"]]
    vertices = [row["vertices"] for row in own]
    beside.plot(
        vertices,
        [row["work"]["triangles_drawn"] for row in own],
        "k:D", ms=4, label="triangles (right)",
    )  # fmt: skip
    beside.set_ylabel("triangles drawn")
    beside.set_ylim(bottom=0)
    axes.set_xscale("log", base=2)
    axes.set_xticks(vertices, [str(number) for number in vertices])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("most vertices of a meshlet")
    axes.set_ylabel("GPU ms of selecting and drawing")
    axes.set_title(f"The size of meshlets, {rows[0]['scene']}", fontsize=10)
    axes.legend(fontsize=8)
