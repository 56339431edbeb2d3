"""The plot of `strata bench --all --truth path-tracer`: presets of all chapters, time against error to the truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.errors import UserError
from tools.bench.figures.below import write_below
from tools.bench.truth import axis


def plot_all(path: Path, records: Sequence[dict[str, Any]]) -> None:
    """Draw the presets of all chapters in one plot, time against error; below it, what they leave out by design."""
    import matplotlib
    from matplotlib.figure import Figure

    made = [record for record in records if record["points"]]
    if not made:
        raise UserError(f"--plot {path}: there is nothing to draw.")
    measure = (
        "flip"
        if all(p["error"]["flip"] is not None for one in made for p in one["points"])
        else "relative_mse"
    )
    figure = Figure(figsize=(9, 7), layout="constrained")
    axes = figure.add_subplot()
    colors = matplotlib.colormaps["turbo"]
    last_chapter = max(int(record["chapter"]) for record in made)
    notes: dict[str, list[int]] = {}
    for record in made:
        points = [point for point in record["points"] if point["kind"] == "preset"]
        name = f"chapter {record['chapter']}, {record['backend']}"
        style = {"gl": "--"}.get(record["backend"], "-")
        points.sort(key=lambda point: point["gpu_ms"])
        times, values = [p["gpu_ms"] for p in points], [p["error"][measure] for p in points]
        color = colors((record["chapter"] - 0.5) / last_chapter)
        axes.plot(times, values, style, marker="o", markersize=4, linewidth=0.8, label=name, color=color)
        last = points[-1]
        axes.annotate(
            f"{record['chapter']} {last['name']}",
            (last["gpu_ms"], last["error"][measure]),
            textcoords="offset points",
            xytext=(5, 4),
            fontsize=7,
            color=color,
        )
        chapters_here = notes.setdefault(
            record["reference"]["by_design"].partition(" draws by design ")[2], []
        )
        if record["chapter"] not in chapters_here:
            chapters_here.append(record["chapter"])
    width, height = made[0]["size"]
    axes.set_xscale("log")
    axes.set_xlabel(f"GPU time, ms a frame at {width}x{height}")
    axes.set_ylabel(f"{'mean FLIP' if measure == 'flip' else 'relative MSE'} {axis(made[0]['reference'])}")
    axes.set_title(f"{made[0]['scene']['name']}, {made[0]['device']['name']}", fontsize=10)
    axes.legend(fontsize=7, ncols=2)
    write_below(
        figure,
        [
            f"By design chapter{'s' * (len(which) > 1)} {', '.join(map(str, which))}: {note}"
            for note, which in notes.items()
            if note
        ],
    )
    try:
        figure.savefig(path)
    except (OSError, ValueError) as error:
        raise UserError(f"--plot {path} cannot be written: {error}.") from None
