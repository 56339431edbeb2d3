"""Blended surfaces in three ways, by their number: the time of their passes, and how far they are from sorted layers.

The scene has panes of glass in all directions that pierce one another, so no order of objects is right. The error of
a picture is its distance to that of lists, which tests hold to sorted compositing in double precision.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.benches import Effort, Subject, errors, middle
from common.reports.tables import table
from common.scene import Scene
from common.settings import knobs, preset, replaced

from ..studies.depth_peeling.glass import panes_on_floor

KNOB = "transparency"
"""The setting; a chapter without it has sorted objects alone."""

WAYS = ("lists", "sorted", "weighted")
"""The values of the setting; the first one is the truth."""

PANES, QUICK_PANES = (8, 32, 128, 512), (8,)
"""Numbers of panes."""

SIZE, QUICK_SIZE = (1280, 720), (160, 90)

NODES = 256.0
"""Layers a pixel that the pool holds: enough for all of these scenes, as far as a buffer may be so large."""

LEAST_WARM_UP = 3


def crossing(count: int) -> Scene:
    """Return `count` panes in all directions about the origin, each of another colour and opacity."""
    rng = np.random.default_rng(count)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    for matrix in matrices:
        matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(0.2, 0.8)
        matrix[:3, 3] = rng.uniform(-0.7, 0.7, 3)
    colors = np.column_stack([rng.uniform(0.05, 0.95, (count, 3)), rng.uniform(0.2, 0.8, count)])
    return panes_on_floor(matrices, colors)


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return a row for each number of panes and each way; None for a chapter without the setting.

    `ms` is the time of all passes of blended surfaces, 0 on a device without timestamps. `layers` is their mean number
    over all pixels. `overflow` says whether the pool was too small for them: then lists are no truth. `mean_error` is
    relative to the mean light of the truth.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    size = SIZE if effort.everything else QUICK_SIZE
    counts = PANES if effort.everything else QUICK_PANES
    settings = replaced(
        preset(subject.settings_class, "medium"),
        graph="deferred",
        color_format="rgba32f",
        transparency_nodes=NODES,
        culling="off",
    )
    rows: list[dict[str, Any]] = []
    for number, count in enumerate(counts):
        drawn, truth = subject.on(crossing(count), size), None
        for place, way in enumerate(WAYS):
            step(f"{count} panes, {way}", (number + place / len(WAYS)) / len(counts))
            with drawn.open(replaced(settings, transparency=way), {"color", "color_linear"}) as renderer:
                view = drawn.view(renderer)
                times: list[float] = []
                for _ in range(LEAST_WARM_UP + effort.frames):
                    frame = renderer.render(view)
                    times.append(_pass_ms(frame.timings))
                work = dict(frame.work)
                picture = drawn.settled_picture(renderer)
            if truth is None:
                truth, layers = picture, work["transparent_fragments"]
                overflow = bool(work["transparent_overflow"])
            ms, noise = middle(times[LEAST_WARM_UP:])
            rows.append(
                {
                    "panes": count,
                    "way": way,
                    "layers": layers / (size[0] * size[1]),
                    "overflow": overflow,
                    "ms": ms,
                    "noise_ms": noise,
                    "mean_error": float(np.abs(picture[0] - truth[0]).mean() / truth[0].mean()),
                    "error": errors(picture, truth),
                }
            )
    return {"size": list(size), "rows": rows}


def _pass_ms(timings: dict[str, float]) -> float:
    """Return the time of the passes of blended surfaces."""
    return sum(took for name, took in timings.items() if name.startswith("transparent"))


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print times and errors as a table."""
    shown = table(
        "Blended surfaces, {}x{}; errors against sorted layers".format(*record["size"]),
        *(">panes", ">layers a pixel", "way", ">GPU ms", ">±", ">mean error", ">relative MSE", ">FLIP"),
    )
    for row in record["rows"]:
        error = row["error"]
        shown.add_row(
            str(row["panes"]),
            f"{row['layers']:.2f}" + (" (too many)" if row["overflow"] else ""),
            row["way"],
            f"{row['ms']:.3f}",
            f"{row['noise_ms']:.3f}",
            f"{100 * row['mean_error']:.2f} %",
            f"{error['relative_mse']:.2e}",
            "-" if error["flip"] is None else f"{error['flip']:.4f}",
        )
    to.print(shown)


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the time of each way over the mean number of layers."""
    for way in WAYS:
        rows = [row for row in record["rows"] if row["way"] == way]
        axes.plot([row["layers"] for row in rows], [row["ms"] for row in rows], "o-", label=way, ms=4)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("layers a pixel, mean")
    axes.set_ylabel("GPU ms of blended surfaces")
    axes.legend(fontsize=8)
