"""Tables, sentences and the plot of the bench of paths, from its record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Console

from common.reports.tables import table

INDEPENDENT = "scalar_rgb"
"""The variant of Mitsuba that others are compared with."""


def slope_of(samples: Sequence[int], errors: Sequence[float]) -> float:
    """Return the slope of the straight line through log(error) over log(samples), by least squares."""
    known = [(n, error) for n, error in zip(samples, errors, strict=True) if error > 0.0]
    if len(known) < 2:
        return 0.0
    x, y = np.log(np.array(known, np.float64)).T
    return float(np.polyfit(x, y, 1)[0])


def show(record: dict[str, Any], to: Console) -> None:
    """Print tables of errors and of speeds, and the results as sentences."""
    sequences = list(record["slopes"])
    shown = table("Relative RMS error by paths through a pixel", ">paths", *(f">{it}" for it in sequences))
    errors = {(row["sequence"], row["samples"]): row["error"] for row in record["errors"]}
    for samples in sorted({samples for _, samples in errors}):
        shown.add_row(f"{samples:,}", *(f"{errors[it, samples]:.2e}" for it in sequences))
    to.print(shown)
    shown = table(
        "Millions of paths a second, and the noise of one picture",
        *("scene", "by", ">M/s", ">±", ">noise", ">x time"),
    )
    for row in record["speeds"]:
        beside = other(record, row)
        times = "-" if beside is None else f"{time_for_error(row) / time_for_error(beside):.2f}"
        speed = f"{row['mpaths']:.3g}", f"{row['mpaths_noise']:.1g}"
        shown.add_row(row["scene"], row["by"], *speed, f"{row['noise']:.3f}", times)
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def other(record: dict[str, Any], row: dict[str, Any]) -> dict[str, Any] | None:
    """Return the row of Mitsuba for the scene of a row, or None."""
    rows = [it for it in record["speeds"] if (it["scene"], it["by"]) == (row["scene"], INDEPENDENT)]
    return rows[0] if rows else None


def time_for_error(row: dict[str, Any]) -> float:
    """Return the time that a picture of a fixed error takes, in arbitrary units: that of one by its variance."""
    return float(row["ms"] * row["noise"] ** 2)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = [f"Left out: {what}." for what in record["missing"]]
    lines += [
        f"With {sequence} the error falls as paths^{slope:.3f}."
        for sequence, slope in record["slopes"].items()
    ]
    for row in record["speeds"]:
        beside = other(record, row)
        if beside is None or beside is row:
            continue
        lines.append(
            f"{row['scene']}, {row['by']}: {row['mpaths'] / beside['mpaths']:.2f}x the paths a second of Mitsuba's "
            f"{INDEPENDENT}, and {time_for_error(row) / time_for_error(beside):.2f}x its time for the same error; "
            f"the mean light is {row['light'] / beside['light']:.3f}x."
        )
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the errors over the number of paths, a line for each sequence."""
    for sequence in record["slopes"]:
        rows = [row for row in record["errors"] if row["sequence"] == sequence]
        axes.loglog(
            [row["samples"] for row in rows], [row["error"] for row in rows], "o-", ms=3, label=sequence
        )
    axes.set_xlabel("paths through a pixel")
    axes.set_ylabel("relative RMS error")
    axes.set_title("Errors of traced paths", fontsize=10)
    axes.legend(fontsize=7)
