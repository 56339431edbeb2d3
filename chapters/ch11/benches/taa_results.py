"""Tables, sentences and the plot of the bench of temporal anti-aliasing, from its record."""

from __future__ import annotations

import math
from typing import Any

from rich.console import Console

from common.reports.tables import table

OFF, FULL = "off", "full"
"""The modes that others are compared with: none, and the defaults."""

SHORT = {
    "atrium, still": "atrium",
    "market, still": "market",
    "atrium, pan": "a. pan",
    "market, pan": "m. pan",
    "rotating": "turns",
    "disocclusion": "passes",
    "disocclusion, checks": "checks",
    "flickering": "lamp",
}
"""What a case is called above a column: a table has room in 80 columns."""


def show(record: dict[str, Any], to: Console) -> None:
    """Print a table of PSNR, one of what only a sequence shows, and the results as sentences."""
    width, height = record["size"]
    rows = {(row["case"], row["mode"]): row for row in record["rows"]}
    names = list(dict.fromkeys(case for case, _ in rows))
    modes = list(dict.fromkeys(mode for _, mode in rows))
    for some in (names[:4], names[4:]):  # all of them would need more than 80 columns
        shown = table(
            f"PSNR in dB over {record['frames']} frames of {width}x{height} against 64 samples a pixel",
            "",
            *(f">{SHORT.get(name, name)}" for name in some),
        )
        for mode in modes:
            cells = [rows.get((name, mode), {}).get("psnr") for name in some]
            if any(value is not None for value in cells):
                shown.add_row(mode, *(_cell(value, ".1f") for value in cells))
        if some:
            to.print(shown)
    unit = "by the clock" if record["clock"] else "on the GPU"
    times = {row["mode"]: row for row in record["times"]}
    shown = table(
        f"Flicker and ghosts in codes of 255, MTF50 in cycles per pixel, ms {unit}",
        *("", ">flicker", ">rest", ">ghost", ">mean", ">MTF50", ">taa", ">±", ">motion"),
    )
    for mode in modes:
        found = [rows[name, mode] for name in names if (name, mode) in rows]
        worst = {
            name: max((row[name] for row in found if row[name] is not None), default=None)
            for name in ("flicker", "flicker_rest", "ghost_max", "ghost_mean", "mtf50")
        }
        sharpest = any(row["sharpest"] for row in found)
        time = times.get(mode, {})
        shown.add_row(
            mode,
            _cell(worst["flicker"], ".2f"),
            _cell(worst["flicker_rest"], ".2g"),
            _cell(worst["ghost_max"], ".1f"),
            _cell(worst["ghost_mean"], ".2f"),
            "inf" if sharpest else _cell(worst["mtf50"], ".2f"),
            *(_cell(time.get(name), form) for name, form in TIMES),
        )
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


TIMES = (("taa_ms", ".3g"), ("taa_noise_ms", ".1g"), ("motion_ms", ".3g"))


def _cell(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    rows = {(row["case"], row["mode"]): row for row in record["rows"]}
    lines = ["Flicker and ghosts are those of the worst case of each mode."]
    for case in dict.fromkeys(case for case, _ in rows):
        off, whole = rows.get((case, OFF)), rows.get((case, FULL))
        if off is None or whole is None:
            continue
        if whole["psnr_rest"] is not None and off["psnr_rest"] is not None:
            lines.append(
                f"{case}: after {whole['rest']} frames the picture is {whole['psnr_rest']:.1f} dB, "
                f"{whole['psnr_rest'] - off['psnr_rest']:+.1f} dB against none, and flickers by "
                f"{whole['flicker_rest']:.2g} codes."
            )
        if whole["ghost_max"] is not None:
            lines.append(
                f"{case}: {record['after']} frames later the ghost is {whole['ghost_max']:.1f} codes at most, "
                f"{whole['ghost_mean']:.2f} in the mean."
            )
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the PSNR of each frame, with the defaults and without, a colour for each case."""
    rows = {(row["case"], row["mode"]): row for row in record["rows"]}
    for case in dict.fromkeys(case for case, _ in rows):
        values = [math.nan if one is None else one for one in rows[case, FULL]["psnr_frames"]]
        (line,) = axes.plot(range(1, len(values) + 1), values, "-", label=case)
        values = [math.nan if one is None else one for one in rows[case, OFF]["psnr_frames"]]
        axes.plot(range(1, len(values) + 1), values, ":", color=line.get_color())
    axes.set_xlabel("frame; dotted: without")
    axes.set_ylabel("PSNR in dB")
    axes.set_title("Error over time of taa=full, {}x{}".format(*record["size"]), fontsize=10)
    axes.legend(fontsize=7)
