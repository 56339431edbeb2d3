"""Tables, sentences and the plot of the bench of rays, from its record."""

from __future__ import annotations

from typing import Any

from rich.console import Console

from common.reports.tables import table

EMBREE = "embree"

BVH = "bvh"

COMPARED = (("differ", "d"), ("ties", "d"), ("t_error", ".1e"), ("t_within", ".2%"))
"""Columns of agreement with Embree, and how they are printed."""


def show(record: dict[str, Any], to: Console) -> None:
    """Print tables of speeds, of agreement with Embree, and of builds and refits, and the results as sentences."""
    shown = table(
        "Millions of rays a second, times Embree's",
        *("scene", "rays", "way", ">M/s", ">±", ">x"),
    )
    embree = {(row["scene"], row["rays"]): row["mrays"] for row in record["rows"] if row["way"] == EMBREE}
    for row in record["rows"]:
        beside = embree.get((row["scene"], row["rays"]))
        times = "-" if beside is None else f"{row['mrays'] / beside:.2f}"
        speed = f"{row['mrays']:.3g}", f"{row['mrays_noise']:.1g}"
        shown.add_row(row["scene"], row["rays"], row["way"], *speed, times)
    to.print(shown)
    compared = [row for row in record["rows"] if row["equal"] is not None]
    if compared:
        shown = table(
            "Hits against Embree's, off edges: rays that hit others, and errors of t",
            *("scene", "rays", "way", ">hits", ">other", ">ties", ">t", ">< 1e-5"),
        )
        for row in compared:
            agree = (format(row[name], form) for name, form in COMPARED)
            shown.add_row(row["scene"], row["rays"], row["way"], f"{row['hits']:.1%}", *agree)
        to.print(shown)
    shown = table(
        "Builds and refits, ms by the clock", "scene", "structure", "what", ">triangles", ">ms", ">±", ">MiB"
    )
    for row in record["builds"]:
        size = "-" if row["bytes"] is None else f"{row['bytes'] / 2**20:.1f}"
        shown.add_row(row["scene"], row["way"], "build", f"{row['triangles']:,}", *_ms(row), size)
    for row in record["refits"]:
        shown.add_row(row["scene"], row["way"], row["what"], "", *_ms(row), "")
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def _ms(row: dict[str, Any]) -> tuple[str, str]:
    return f"{row['ms']:.3g}", f"{row['noise_ms']:.1g}"


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    lines = [f"Left out: {what}." for what in record["missing"]]
    if record["software"]:
        lines.append(
            "The driver traces on all cores of the processor; Embree and the builds in numpy use one."
        )
    speeds = {(row["scene"], row["rays"], row["way"]): row["mrays"] for row in record["rows"]}
    for scene, rays in dict.fromkeys((scene, rays) for scene, rays, _ in speeds):
        ours = speeds[scene, rays, BVH]
        parts = [
            f"{ours / speed:.2f}x of {way}"
            for (other, kind, way), speed in speeds.items()
            if (other, kind) == (scene, rays) and way != BVH
        ]
        if parts:
            lines.append(f"{scene}, {rays} rays: our BVH traces {ours:.3g} M/s, {', '.join(parts)}.")
    compared = [row for row in record["rows"] if row["equal"] is not None]
    if compared:
        rays = sum(row["count"] for row in compared)
        lines.append(
            f"Of {rays:,} rays {sum(row['differ'] for row in compared)} hit another triangle than Embree says, off "
            f"edges and at another t; t differs by {max(row['t_error'] for row in compared):.1e} at most, "
            "relatively, and by less than 1e-5 for "
            f"{min(row['t_within'] for row in compared):.3%} of the rays or more; in parts of the scene's size by "
            f"{max(row['t_of_size'] for row in compared):.1e} at most."
        )
    times = {(row["scene"], row["way"]): row for row in record["builds"]}
    for (scene, way), row in times.items():
        beside = times.get((scene, EMBREE))
        if way == BVH and beside is not None:
            lines.append(
                f"{scene}: numpy builds {row['triangles']:,} triangles and {row['instances']:,} instances in "
                f"{row['ms']:.3g} ms, {row['ms'] / beside['ms']:.2f}x of Embree, which has all instances as "
                "triangles."
            )
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the speed of each way as bars, a group for each scene and kind of rays."""
    rows = {(row["scene"], row["rays"], row["way"]): row for row in record["rows"]}
    groups = list(dict.fromkeys((scene, rays) for scene, rays, _ in rows))
    ways = list(dict.fromkeys(way for _, _, way in rows))
    wide = 0.8 / len(ways)
    for number, way in enumerate(ways):
        places = [place + (number - (len(ways) - 1) / 2) * wide for place in range(len(groups))]
        values = [rows[scene, rays, way]["mrays"] for scene, rays in groups]
        errors = [rows[scene, rays, way]["mrays_noise"] for scene, rays in groups]
        axes.bar(places, values, wide, yerr=errors, label=way)
    axes.set_xticks(range(len(groups)), [f"{scene}\n{rays}" for scene, rays in groups], fontsize=7)
    axes.set_ylabel("million rays a second")
    axes.set_title("Rays by each way", fontsize=10)
    axes.legend(fontsize=7)
