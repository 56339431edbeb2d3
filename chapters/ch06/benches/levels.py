"""What levels of detail save, and what error they make in the picture: `strata bench 6 --only lods`.

The setting `lod_pixels` is how many pixels a coarser level of a mesh may be off in the picture. The city is drawn with
several values of it, from its streets and from above, where meshes are small in the picture. All renderers are open at
once and take turns in each view, while the camera moves. Then each view is drawn once more while it stands still, and
the picture is compared with that of 0 pixels, where every mesh is drawn in full.
"""

from __future__ import annotations

import textwrap
import time as clock
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from common.errors import UserError
from common.paths import cache_dir
from common.reports.benches import Array, Effort, Subject, middle
from common.reports.metrics import flip_mean
from common.reports.tables import table
from common.scene import Scene
from common.settings import knobs

from .streets import (
    LEAST_WARM_UP,
    QUICK_SCENE,
    Walker,
    frames_of,
    medium,
    picture_size,
    street_views,
    view_at,
)

KNOB = "lod_pixels"
"""The setting; a chapter without it draws every mesh in full."""

SCENE = "city:100K"
"""The city of full effort: making levels of detail of a larger one takes minutes."""

PIXELS, QUICK_PIXELS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0), (0.0, 1.0, 8.0)
"""Values of the setting; the others are compared with the first, which draws every mesh in full."""

ABOVE = ("bird", "roof")
"""How the names of views from above begin, those from the greatest height first."""

VIEWS, QUICK_VIEWS = 2, 1
"""Views from the streets, and as many from above."""

TURNS = 2
"""How often each renderer walks through a view; every second turn goes through the renderers in the other order."""

COUNTERS = (
    *("instances_tested", "instances_outside", "instances_hidden", "instances_coarser"),
    *("units_drawn", "triangles_drawn"),
)


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record of a chapter that has levels of detail; None for others.

    Without the package `meshoptimizer` the record has no rows, and `skipped` says why. `build_s` are the seconds of
    making the levels, None where they were kept from an earlier run.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    step("the city", 0.0)
    name = SCENE if effort.everything else QUICK_SCENE
    scene = subject.load(name)
    step("levels of detail", 0.02)
    try:
        build_s = made_in(subject, scene)
    except UserError as error:  # the package is an extra
        return {"scene": name, "skipped": f"Levels of detail were not measured: {error}.", "rows": []}
    drawn = subject.on(scene, picture_size(subject, effort))
    views = chosen_views(subject, effort, scene)
    warm_up, frames = frames_of(subject, effort)
    pixels = PIXELS if effort.everything else QUICK_PIXELS
    settings = [medium(subject, culling="occlusion", lod_pixels=value) for value in pixels]
    walkers: list[Walker] = []
    with ExitStack() as stack:
        for number, setting in enumerate(settings):
            step(f"{pixels[number]:g} pixels", 0.2 + 0.2 * number / len(settings))
            walkers.append(Walker(stack.enter_context(drawn.open(setting, {"color"}))))
        for walker in walkers:  # drivers compile at the first draw
            walker.walk(views[0], warm_up, 0)
        for number, view in enumerate(views):
            for turn in range(TURNS):
                step(view, 0.4 + 0.3 * (number + turn / TURNS) / len(views))
                for walker in walkers if turn % 2 == 0 else reversed(walkers):
                    walker.walk(view, warm_up, frames)
    rows, truth = [], None
    for number, setting in enumerate(settings):
        step(f"error of {pixels[number]:g} pixels", 0.7 + 0.3 * number / len(settings))
        pictures = _pictures(drawn, setting, views)
        truth = pictures if truth is None else truth
        rows.append(_row(pixels[number], walkers[number], walkers[0], errors_between(pictures, truth)))
    return {
        "scene": name,
        "skipped": "",
        "size": list(drawn.size),
        "views": views,
        "frames": TURNS * frames,
        "build_s": build_s,
        "rows": rows,
    }


def chosen_views(subject: Subject, effort: Effort, scene: Scene) -> list[str]:
    """Return the names of the views of an effort: some at street level, then as many from above."""
    count = VIEWS if effort.everything else QUICK_VIEWS
    streets = street_views(subject, effort, scene)
    names = [camera.name for camera in scene.cameras]
    above = [name for prefix in ABOVE for name in names if name.startswith(prefix)]
    return [*streets[:: max(len(streets) // count, 1)][:count], *above[:count]]


def made_in(subject: Subject, scene: Scene) -> float | None:
    """Make the levels of a scene and return the seconds that took; None where they were in the cache.

    Raises:
        UserError: levels are not in the cache, and the package `meshoptimizer` is not installed.
    """
    folder = cache_dir(subject.module("meshlets.chains").FOLDER)
    kept, began = _names(folder), clock.perf_counter()
    subject.module("meshlets.scene").levels_of(scene)
    took = clock.perf_counter() - began
    return took if folder is None or _names(folder) - kept else None


def _names(folder: Path | None) -> set[str]:
    return set() if folder is None else {path.name for path in folder.iterdir()}


def _pictures(drawn: Subject, settings: Any, views: Sequence[str]) -> list[tuple[Array, Array]]:
    """Return what each view shows when it stands still: (H, W, 3) uint8, and (H, W) uint32 the instance ids."""
    pictures = []
    with drawn.open(settings, {"color", "instance_id"}) as renderer:
        for view in views:
            still = view_at(drawn.scene, view, drawn.size)
            for _ in range(LEAST_WARM_UP + 1):
                frame = renderer.render(still, 0.0)
            pictures.append((frame.image("color"), frame.image("instance_id")))
    return pictures


def errors_between(
    pictures: Sequence[tuple[Array, Array]], truth: Sequence[tuple[Array, Array]]
) -> list[dict[str, float | None]]:
    """Return for each view the mean FLIP, None without its package, and the part of pixels with another instance."""
    return [
        {"flip": _flip(shown, shown_in_full), "ids_differ": float((ids != ids_in_full).mean())}
        for (shown, ids), (shown_in_full, ids_in_full) in zip(pictures, truth, strict=True)
    ]


def _flip(picture: Array, truth: Array) -> float | None:
    try:
        return flip_mean(picture, truth)
    except UserError:  # the package is an extra
        return None


def _row(
    pixels: float, walker: Walker, full: Walker, errors: list[dict[str, float | None]]
) -> dict[str, Any]:
    """Return the figures of a value of the setting; `full` is the walker of 0 pixels, `errors` are those of each view.

    `time_ratio` is the time as a multiple of that of 0 pixels, the median over the views; its noise is the sum of the
    relative noises of both times. Counters of a view are those of its last frame. `error` is the mean over the views.
    """
    views: dict[str, dict[str, Any]] = {}
    for view, error in zip(walker.frames, errors, strict=True):
        (took, noise), (took_full, noise_full) = (
            middle([frame["gpu"] for frame in one.frames[view]]) for one in (walker, full)
        )
        ratio = took / max(took_full, 1e-9)
        relative = 0.0 if walker is full else noise / max(took, 1e-9) + noise_full / max(took_full, 1e-9)
        work, work_full = (one.work[view][-1] for one in (walker, full))
        views[view] = {
            "ms": took,
            "noise_ms": noise,
            "time_ratio": ratio,
            "time_ratio_noise": ratio * relative,
            "triangles": work["triangles_drawn"],
            "triangles_ratio": work["triangles_drawn"] / max(work_full["triangles_drawn"], 1),
            "coarser": work["instances_coarser"],
            **error,
        }
    gpu_ms, noise_ms = walker.time("gpu")
    work, work_full = (one.counts(COUNTERS) for one in (walker, full))
    seen = views.values()
    flips = [one["flip"] for one in seen if one["flip"] is not None]
    return {
        "pixels": pixels,
        "gpu_ms": gpu_ms,
        "noise_ms": noise_ms,
        "time_ratio": float(np.median([one["time_ratio"] for one in seen])),
        "time_ratio_noise": float(np.median([one["time_ratio_noise"] for one in seen])),
        "triangles_ratio": work["triangles_drawn"] / max(work_full["triangles_drawn"], 1),
        "work": work,
        "error": {
            "flip": float(np.mean(flips)) if flips else None,
            "ids_differ": float(np.mean([one["ids_differ"] for one in seen])),
        },
        "views": views,
    }


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as tables, and its sentences."""
    rows = record["rows"]
    if rows:
        width, height = record["size"]
        shown = table(
            f"Levels of detail in {record['scene']}, {len(record['views'])} views, {width}x{height}",
            *(">pixels", ">GPU ms", ">times", ">±", ">triangles", ">times", ">coarser", ">FLIP", ">ids %"),
        )
        for row in rows:
            work, flip = row["work"], row["error"]["flip"]
            shown.add_row(
                f"{row['pixels']:g}",
                f"{row['gpu_ms']:.3f}",
                f"{row['time_ratio']:.2f}",
                f"{row['time_ratio_noise']:.2f}",
                f"{work['triangles_drawn']:,}",
                f"{row['triangles_ratio']:.2f}",
                f"{work['instances_coarser']:,}",
                "-" if flip is None else f"{flip:.4f}",
                f"{100 * row['error']['ids_differ']:.3f}",
            )
        to.print(shown)
        shown = table(
            "Times the time and times the triangles of 0 pixels, by view",
            *("view", *(f">{row['pixels']:g} pixels" for row in rows[1:])),
        )
        for view in record["views"]:
            of_view = [row["views"][view] for row in rows[1:]]
            cells = [f"{one['time_ratio']:.2f} / {one['triangles_ratio']:.2f}" for one in of_view]
            shown.add_row(view, *cells)
        to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    if record["skipped"]:
        return [record["skipped"]]
    lines = []
    for row in record["rows"][1:]:
        noisy = abs(1 - row["time_ratio"]) <= row["time_ratio_noise"]
        ratios = [one["triangles_ratio"] for one in row["views"].values()]
        flip = row["error"]["flip"]
        lines.append(
            f"lod_pixels={row['pixels']:g}: selecting and drawing takes {row['time_ratio']:.2f} times the time of "
            f"lod_pixels=0 in the median of the views{', within the noise' if noisy else ''}; "
            f"{row['triangles_ratio']:.2f} times the triangles are drawn ({min(ratios):.2f} to {max(ratios):.2f}); "
            + ("" if flip is None else f"mean FLIP is {flip:.4f}; ")
            + f"{row['error']['ids_differ']:.3%} of the pixels show another instance."
        )
    if any(row["error"]["flip"] is None for row in record["rows"]):
        lines.append("FLIP was not measured: it needs the package flip-evaluator.")
    if record["build_s"] is not None:
        lines.append(f"Making the levels of detail took {record['build_s']:.1f} s; the cache keeps them.")
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time and the error by the pixels that a level may be off; the triangles are written at the times."""
    axes.set_title(f"Levels of detail, {record['scene']}", fontsize=10)
    rows = record["rows"]
    if not rows:
        axes.set_xticks([])
        axes.set_yticks([])
        words = "\n".join(textwrap.wrap(record["skipped"], 60))
        axes.text(0.5, 0.5, words, ha="center", va="center", transform=axes.transAxes, fontsize=9)
        return
    width, height = record["size"]
    axes.set_title(f"Levels of detail, {record['scene']}, {width}x{height}", fontsize=10)
    place = np.arange(len(rows))
    ratio = np.array([row["time_ratio"] for row in rows])
    noise = np.array([row["time_ratio_noise"] for row in rows])
    axes.errorbar(place, ratio, noise, fmt="-o", color="C0", label="time", capsize=2)
    triangles = [row["triangles_ratio"] for row in rows]
    axes.plot(place, triangles, ":D", color="C2", ms=4, label="triangles")
    axes.set_ylim(0, 1.15 * max(*(ratio + noise), *triangles))
    axes.set_xticks(place, [f"{row['pixels']:g}" for row in rows])
    axes.set_xlabel("pixels that a level may be off (lod_pixels)")
    axes.set_ylabel("times those of lod_pixels=0")
    beside = axes.twinx()
    for name, label, mark in (
        ("flip", "mean FLIP (right)", "s"),
        ("ids_differ", "other instance (right)", "^"),
    ):
        values = [row["error"][name] for row in rows]
        if None not in values:
            beside.plot(place, values, "--" + mark, color="C3" if name == "flip" else "C1", ms=4, label=label)
    beside.set_ylabel("error: mean FLIP, part of the pixels")
    beside.set_ylim(bottom=0)
    handles, labels = (one + other for one, other in zip(
        axes.get_legend_handles_labels(), beside.get_legend_handles_labels(), strict=True
    ))  # fmt: skip
    axes.legend(handles, labels, fontsize=8, loc="center left")
