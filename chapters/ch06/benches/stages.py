"""Time and work of each stage of culling, on each path that draws: `strata bench 6 --only culling`.

The city is drawn from the level of its streets while the camera walks. All ways to draw are open at once and take turns
in each view, so that other load of the machine meets all alike. Times of a way are medians over its views of the
median of each view. The stages are those of the setting `culling`, which each include the ones before. The first way,
whole meshes without any test, is what chapter 5 draws.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject
from common.reports.tables import table
from common.settings import knobs

from . import pyramid as bench_pyramid
from .streets import (
    CULLING,
    KNOB,
    Walker,
    city,
    frames_of,
    medium,
    part,
    paths,
    picture_size,
    solid_triangles,
    street_views,
)

WAYS = (
    ("classic", "off"),
    ("classic", "occlusion"),
    ("compute", "frustum"),
    ("compute", "cone"),
    ("compute", "occlusion"),
    ("mesh", "occlusion"),
)
"""(geometry, culling) of the ways that are compared, where the device has them."""

COUNTERS = (
    *("instances_tested", "instances_outside", "instances_hidden"),
    *("meshlets_tested", "meshlets_outside", "meshlets_away", "meshlets_hidden"),
    *("units_drawn", "units_late", "units_dropped", "triangles_drawn", "triangles_late", "draw_calls"),
)


def name_of(geometry: str, culling: str) -> str:
    """Return how tables and plots call a way, by the values of its settings: "compute, occlusion"."""
    return f"{geometry}, {culling}"


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record of a chapter that culls; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    step("the city", 0.0)
    name, scene = city(subject, effort)
    size = picture_size(subject, effort)
    views = street_views(subject, effort, scene)
    warm_up, frames = frames_of(subject, effort)
    drawn = subject.on(scene, size)
    walkers: dict[tuple[str, str], Walker] = {}
    wanted = [way for way in WAYS if way[0] in ("classic", *paths(subject))]
    with ExitStack() as stack:
        for number, (geometry, culling) in enumerate(wanted):
            step(name_of(geometry, culling), 0.1 + 0.3 * number / len(wanted))
            settings = medium(subject, geometry=geometry, culling=culling)
            walkers[geometry, culling] = Walker(stack.enter_context(drawn.open(settings, {"color"})))
        for number, view in enumerate(views):
            for place, walker in enumerate(walkers.values()):
                step(view, 0.4 + 0.5 * (number + place / len(walkers)) / len(views))
                walker.walk(view, warm_up, frames)
        rows = [_row(way, walker, scene) for way, walker in walkers.items()]
    first = walkers[wanted[0]].times("gpu")
    for row, walker in zip(rows, walkers.values(), strict=True):
        faster = [first[view] / max(took, 1e-9) for view, took in walker.times("gpu").items()]
        row["times_faster"], row["times_faster_least"] = float(np.median(faster)), min(faster)
    return {
        "scene": name,
        "instances": len(scene.instances),
        "size": list(size),
        "views": views,
        "frames": frames,
        "ways": rows,
        "pyramid": bench_pyramid.measure(subject, effort, lambda what, done: step(what, 0.9 + 0.1 * done)),
    }


def _row(way: tuple[str, str], walker: Walker, scene: Any) -> dict[str, Any]:
    """Return the figures of a way; `views` holds the ms of culling and geometry, and the triangles, of each view."""
    work = {"triangles_drawn": solid_triangles(scene), **walker.counts(COUNTERS)}
    row: dict[str, Any] = {"way": name_of(*way), "geometry": way[0], "culling": way[1]}
    for name in ("gpu", "frame", "wall", "python"):
        row[f"{name}_ms"], row[f"{name}_noise_ms"] = walker.time(name)
    triangles = {
        view: work.get("triangles_drawn", solid_triangles(scene)) for view, (*_, work) in walker.work.items()
    }
    views = {
        view: {"ms": round(took, 4), "triangles": triangles[view]}
        for view, took in walker.times("gpu").items()
    }
    return {**row, "passes_ms": walker.passes(), "work": work, "views": views}


# --- results ----------------------------------------------------------------------------------------------------------


def left(work: dict[str, int]) -> list[int]:
    """Return the instances in view and not hidden; their meshlets, those in view, facing, and not hidden."""
    if "instances_tested" not in work:
        return []
    in_view = work["instances_tested"] - work["instances_outside"]
    inside = work["meshlets_tested"] - work["meshlets_outside"]
    facing = inside - work["meshlets_away"]
    seen = in_view - work["instances_hidden"], facing - work["meshlets_hidden"]
    return [in_view, seen[0], work["meshlets_tested"], inside, facing, seen[1]]


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as tables, and its sentences."""
    width, height = record["size"]
    where = f"{record['scene']}, {len(record['views'])} street views, {width}x{height}"
    shown = table(
        f"Geometry and culling in {where}",
        *(
            "way",
            ">select ms",
            ">draw ms",
            ">±",
            ">times",
            ">frame ms",
            ">wall ms",
            ">Python ms",
            ">triangles",
        ),
    )
    for row in record["ways"]:
        selecting = part(row["passes_ms"], CULLING)
        shown.add_row(
            row["way"],
            f"{selecting:.3f}",
            f"{row['gpu_ms'] - selecting:.3f}",
            f"{row['gpu_noise_ms']:.3f}",
            f"{row['times_faster']:.2f}",
            f"{row['frame_ms']:.3f}",
            f"{row['wall_ms']:.3f}",
            f"{row['python_ms']:.3f}",
            f"{row['work']['triangles_drawn']:,}",
        )
    to.print(shown)
    tested = [row for row in record["ways"] if left(row["work"])]
    if tested:
        shown = table(
            f"What each test leaves of {record['instances']:,} instances and of their meshlets",
            *("way", ">in view", ">seen", ">meshlets", ">in view", ">facing", ">seen", ">drawn", ">late"),
        )
        for row in tested:
            counts = [*left(row["work"]), row["work"]["units_drawn"], row["work"]["units_late"]]
            shown.add_row(row["way"], *(f"{count:,}" for count in counts))
        to.print(shown)
    bench_pyramid.show(record["pyramid"], to)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    rows = {row["way"]: row for row in record["ways"]}
    first, lines = record["ways"][0], []
    culled = [row for row in record["ways"] if row["culling"] == "occlusion"]
    for row in culled:
        noisy = abs(first["gpu_ms"] - row["gpu_ms"]) <= first["gpu_noise_ms"] + row["gpu_noise_ms"]
        lines.append(
            f"{row['way']}: selecting and drawing takes {row['gpu_ms']:.3f} ms, chapter 5's draws "
            f"{first['gpu_ms']:.3f} ms: {row['times_faster']:.2f} times as fast in the median of the views, "
            f"{row['times_faster_least']:.2f} times in the worst" + (", within the noise." if noisy else ".")
        )
    mesh, compute = (rows.get(name_of(path, "occlusion")) for path in ("mesh", "compute"))
    if mesh is not None and compute is not None:
        ratio = mesh["gpu_ms"] / max(compute["gpu_ms"], 1e-9)
        lines.append(f"Mesh shaders take {ratio:.2f} times the time of the compute path.")
    if culled:
        least = min(culled, key=lambda row: int(row["work"]["triangles_drawn"]))
        share = least["work"]["triangles_drawn"] / max(first["work"]["triangles_drawn"], 1)
        more = least["python_ms"] - first["python_ms"]
        lines.append(
            f"{least['way']}: {share:.2%} of the triangles are drawn; Python takes {more:+.3f} ms more a frame."
        )
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time of culling and of drawing in each way as bars, and the triangles beside them."""
    rows = record["ways"]
    place = np.arange(len(rows))
    culling = np.array([part(row["passes_ms"], CULLING) for row in rows])
    total = np.array([row["gpu_ms"] for row in rows])
    axes.bar(place, culling, 0.6, color="C1", label="selecting")
    axes.bar(
        place, np.maximum(total - culling, 0), 0.6, culling, color="C0", label="drawing",
        yerr=[row["gpu_noise_ms"] for row in rows], capsize=2,
    )  # fmt: skip
    for x, row in zip(place, rows, strict=True):
        top = (x, row["gpu_ms"] + row["gpu_noise_ms"])
        faster = f"x {row['times_faster']:.1f}"
        axes.annotate(faster, top, textcoords="offset points", xytext=(0, 4), ha="center", fontsize=8)
    axes.set_xticks(place, [row["way"].replace(", ", "\n") for row in rows], fontsize=7)
    axes.set_ylabel("GPU ms of selecting and drawing")
    beside = axes.twinx()
    beside.plot(
        place, [row["work"]["triangles_drawn"] for row in rows], "kD", ms=5, label="triangles (right)"
    )
    beside.set_yscale("log")
    beside.set_ylabel("triangles drawn")
    width, height = record["size"]
    axes.set_title(f"Stages of culling, {record['scene']}, {width}x{height}", fontsize=10)
    handles, labels = (one + other for one, other in zip(
        axes.get_legend_handles_labels(), beside.get_legend_handles_labels(), strict=True
    ))  # fmt: skip
    axes.legend(handles, labels, fontsize=8)
