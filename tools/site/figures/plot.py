"""Time against error as a drawing of a page: SVG with every number of the record in it, a table, and no library."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Any

from tools.bench.points import measure_of

WIDTH, HEIGHT = 480, 340
LEFT, RIGHT, TOP, BOTTOM = 70, 24, 16, 52
NAMES = {"flip": "mean FLIP", "relative_mse": "relative MSE of light"}


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return round numbers, 1, 2 or 5 times a power of ten apart, from below `low` to above `high`."""
    if high <= low:
        high = low + (abs(low) or 1.0)
    step = 10.0 ** math.floor(math.log10((high - low) / most))
    factor = next(factor for factor in (1, 2, 5, 10) if (high - low) / (factor * step) <= most)
    step *= factor
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [round(index * step, 12) for index in range(first, last + 1)]


def figure(made: dict[str, Any], file: str) -> str:
    """Return the figure of a record's settings, as HTML; `file` is the record's name.

    Every point carries its numbers as the record has them, in attributes: data-name, data-kind, data-ms, data-noise,
    data-flip, data-mse, data-max. Raises KeyError for a record without points.
    """
    points: list[dict[str, Any]] = made["points"]
    if not points:
        raise KeyError("points")
    measure = measure_of(points)
    device = made["device"]
    ends = [(p["gpu_ms"] - p["noise_ms"], p["gpu_ms"] + p["noise_ms"]) for p in points]
    across = ticks(max(min(low for low, _ in ends), 0.0), max(high for _, high in ends))
    up = ticks(min(p["error"][measure] for p in points), max(p["error"][measure] for p in points))

    def x(value: float) -> float:
        return LEFT + (value - across[0]) / (across[-1] - across[0]) * (WIDTH - LEFT - RIGHT)

    def y(value: float) -> float:
        return HEIGHT - BOTTOM - (value - up[0]) / (up[-1] - up[0]) * (HEIGHT - TOP - BOTTOM)

    front = sorted((p["gpu_ms"], p["error"][measure]) for p in points if p["front"])
    line = " ".join(f"{x(a):.1f},{y(b):.1f}" for a, b in front)
    size = f"{made['size'][0]}x{made['size'][1]}"
    label = f"Time against error of chapter {made['chapter']} on {device['name']}"
    parts = [
        *_grid(across, up, x, y),
        f'<text class="axis" x="{WIDTH / 2}" y="{HEIGHT - 10}">GPU time, ms a frame at {size}</text>',
        f'<text class="axis" transform="translate(14 {HEIGHT / 2}) rotate(-90)">{NAMES[measure]}</text>',
        f'<polyline class="front" points="{line}"/>',
        *_points(points, lambda p: (x(p["gpu_ms"]), y(p["error"][measure])), x),
    ]
    return (
        f'<figure class="plot" data-record="{escape(file)}" data-measure="{measure}">'
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="group" aria-label="{escape(label)}">{"".join(parts)}</svg>'
        f'<p class="hover" aria-live="polite">Point at a mark, or reach it by the tab key: its numbers stand here.</p>'
        f"<figcaption>{escape(label)}: dots are presets, crosses one knob turned alone; the line joins what nothing "
        f"beats in time and error. {escape(origin(made))}</figcaption>{_table(points)}</figure>"
    )


def origin(made: dict[str, Any]) -> str:
    """Return where a record comes from: device, driver, commit and date."""
    device = made["device"]
    return f"{device['name']}, {device['driver']}, commit {made['commit'][:12]}, {made['date'][:10]}."


def cell(text: Any) -> str:
    """Return what a record says, as text in a table: records may be other people's."""
    return escape(str(text)).replace("|", "&#124;")


def short(value: float) -> str:
    """Return a number with three digits that count, and no exponent: 187, 11.2, 0.012."""
    digits = 2 - math.floor(math.log10(abs(value))) if value else 0
    return f"{value:.{min(max(digits, 0), 6)}f}"


def _points(points: Sequence[dict[str, Any]], place: Any, across: Any) -> list[str]:
    """Return all points: presets lie over knobs, and each has its name where no other name is."""
    found: list[str] = []
    taken: list[tuple[float, float, float]] = []
    for point in sorted(points, key=lambda one: one["kind"] == "preset"):
        x, y = place(point)
        name = ""
        if point["kind"] == "preset":
            wide = 8.0 * len(point["name"])
            spots = [(dx, dy) for dy in (-10, 20, -26, 36) for dx in (9.0, -9.0 - wide)]
            boxes = [(x + dx, y + dy, wide) for dx, dy in spots]
            free = [box for box in boxes if box[0] > LEFT and box[0] + wide < WIDTH and not _hits(box, taken)]
            box = (free or boxes)[0]
            taken.append(box)
            name = f'<text x="{box[0] - x:.1f}" y="{box[1] - y:.1f}">{escape(point["name"])}</text>'
        found.append(_point(point, x, y, across, name))
    return found


def _hits(box: tuple[float, float, float], others: Sequence[tuple[float, float, float]]) -> bool:
    """Whether a name, (left, base line, width), lies over another one."""
    x, y, wide = box
    return any(abs(y - v) < 15 and x < u + w and u < x + wide for u, v, w in others)


def _grid(across: list[float], up: list[float], x: Any, y: Any) -> list[str]:
    bottom, right = HEIGHT - BOTTOM, WIDTH - RIGHT
    found = []
    for value in across:
        found.append(f'<line class="grid" x1="{x(value):.1f}" x2="{x(value):.1f}" y1="{TOP}" y2="{bottom}"/>')
        found.append(f'<text class="tick" x="{x(value):.1f}" y="{bottom + 18}">{value:g}</text>')
    for value in up:
        found.append(f'<line class="grid" x1="{LEFT}" x2="{right}" y1="{y(value):.1f}" y2="{y(value):.1f}"/>')
        found.append(f'<text class="tick up" x="{LEFT - 8}" y="{y(value) + 4:.1f}">{value:g}</text>')
    return found


def said(point: dict[str, Any]) -> str:
    """Return a point's numbers as a sentence."""
    error = point["error"]
    flip = "" if error["flip"] is None else f", FLIP {error['flip']:.4f}"
    return (
        f"{point['name']}: {short(point['gpu_ms'])} ms ± {short(point['noise_ms'])}{flip}, relative MSE "
        f"{error['relative_mse']:.2g}, largest difference {error['max_abs']:.2f} of 1"
    )


def _point(point: dict[str, Any], x: float, y: float, across: Any, name: str) -> str:
    error = point["error"]
    numbers = {
        "name": point["name"],
        "kind": point["kind"],
        "ms": point["gpu_ms"],
        "noise": point["noise_ms"],
        "flip": error["flip"],
        "mse": error["relative_mse"],
        "max": error["max_abs"],
    }
    data = " ".join(
        f'data-{name}="{escape(str(value))}"' for name, value in numbers.items() if value is not None
    )
    spread = across(point["gpu_ms"] + point["noise_ms"]) - x
    words = escape(said(point))
    shape = (
        '<circle r="6"/>'
        if point["kind"] == "preset"
        else '<path d="M-5-5 5 5M-5 5 5-5"/><circle class="hit" r="8"/>'
    )
    return (
        f'<g class="point {point["kind"]}" tabindex="0" role="img" aria-label="{words}" {data} '
        f'transform="translate({x:.1f} {y:.1f})"><title>{words}</title>'
        f'<line class="noise" x1="{-spread:.1f}" x2="{spread:.1f}"/>{shape}'
        f"{name}</g>"
    )


def _table(points: Sequence[dict[str, Any]]) -> str:
    rows = []
    for p in points:
        error = p["error"]
        flip = "-" if error["flip"] is None else f"{error['flip']:.4f}"
        cells = (
            short(p["gpu_ms"]),
            short(p["noise_ms"]),
            f"{error['relative_mse']:.2g}",
            f"{error['max_abs']:.2f}",
        )
        numbers = "".join(f'<td class="number">{cell}</td>' for cell in (*cells, flip))
        rows.append(f'<tr><th scope="row">{escape(p["name"])}</th><td>{p["kind"]}</td>{numbers}</tr>')
    heads = ("setting", "", "GPU ms", "±", "rel. MSE", "max", "FLIP")
    head = "".join(f'<th scope="col">{name}</th>' if name else "<td></td>" for name in heads)
    return (
        '<details><summary>The same as a table</summary><div class="wide" tabindex="0" role="group" '
        'aria-label="Table of the plot"><table><thead><tr>'
        f"{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div></details>"
    )
