"""What `strata compare` says: what differs, the table of time, error and work, and the record for JSON."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from common.reports.tables import table
from tools.compare.measure import ErrorMap, Errors, Measured
from tools.compare.sides import BACKEND_NAMES, Picture, Side
from tools.run.record import naming, strata_version

if TYPE_CHECKING:
    from tools.compare.compare import Request

FORMAT = 1
"""Of the record."""
WIDEST_HEAD = 14
"""Letters of a side that fit above its column in a terminal of 80."""


def described(side: Side) -> str:
    """Return what a side is: "chapter 1 on Vulkan, medium"."""
    if isinstance(side, Picture):
        return side.spoken
    off = f", without {', '.join(side.without)}" if side.without else ""
    return f"{side.spoken} on {BACKEND_NAMES[side.backend]}, {side.quality}{off}"


def differences(a: Measured, b: Measured) -> str:
    """Return one sentence on what differs between the two sides."""
    one, other = a.side, b.side
    if isinstance(one, Picture) or isinstance(other, Picture):
        if (
            isinstance(one, Picture)
            and isinstance(other, Picture)
            and one.path.resolve() == other.path.resolve()
        ):
            return "Nothing differs between A and B: both are the same file."
        return f"A is {described(one)}; B is {described(other)}."
    parts = []
    if one.which != other.which:
        plain = isinstance(one.which, int) and isinstance(other.which, int)
        pair = (one.which, other.which) if plain else (one.spoken, other.spoken)
        parts.append(f"the {'chapter' if plain else 'code'} differs: {pair[0]}, {pair[1]}")
    if one.backend != other.backend:
        parts.append(f"the backend differs: {BACKEND_NAMES[one.backend]}, {BACKEND_NAMES[other.backend]}")
    if one.without != other.without:
        off = [" and ".join(side.without) or "nothing" for side in (one, other)]
        parts.append(f"done without: {off[0]}, {off[1]}")
    parts += _settings_differ(one.settings, other.settings)
    paths = [{choice.feature: choice.path for choice in side.plan.choices} for side in (a, b)]
    parts += [
        f"{feature} is {paths[0][feature]}, {paths[1][feature]}"
        for feature in paths[0]
        if feature in paths[1] and paths[0][feature] != paths[1][feature]
    ]
    for name, side, mine, others in (("A", one, paths[0], paths[1]), ("B", other, paths[1], paths[0])):
        # What a device gives less of than the preset wishes: the setting does not say what is drawn.
        wishes = [feature for feature in mine if feature not in others and hasattr(side.settings, feature)]
        parts += [f"{feature} of {name} is {mine[feature]} here" for feature in wishes]
    if not parts:
        return f"Nothing differs between A and B: both are {described(one)}."
    # A name of a setting stays as it is written; a sentence begins with a capital letter.
    first = capital(parts[0]) if parts[0].startswith(("the ", "done ")) else parts[0]
    return "; ".join([first, *parts[1:]]) + "."


def _settings_differ(one: Any, other: Any) -> list[str]:
    """Return "msaa: 1, 4" for each setting that differs, and the names of those that one side alone has."""
    first, second = asdict(one), asdict(other)
    parts = [
        f"{name}: {_value(first[name])}, {_value(second[name])}"
        for name in first
        if name in second and first[name] != second[name]
    ]
    for letter, mine, others in (("A", first, second), ("B", second, first)):
        alone = [name for name in mine if name not in others]
        if alone:
            parts.append(f"{letter} alone has the settings {', '.join(alone)}")
    return parts


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:g}" if isinstance(value, float) else str(value)


def capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def map_text(shown: ErrorMap) -> str:
    """Return what the colours of a map mean."""
    if shown.kind == "flip":
        how = "at several exposures" if shown.of == "linear" else "when both are shown in turn"
        return f"FLIP: what an eye sees, {how}"
    unit = "linear light" if shown.of == "linear" else "1 is white"
    return f"Largest difference of a channel, {unit}"


def verdict(found: Errors) -> str:
    """Return how far B is from A, as one or two sentences."""
    bad = [f"{count} pixels of {name}" for name, count in zip("AB", found.not_finite, strict=True) if count]
    extra = f" {capital(' and '.join(bad))} are not finite (NaN or infinity)." if bad else ""
    if found.same:
        return f"Both pictures are the same to the bit.{extra}"
    if found.pixels_changed == 0:
        return f"No pixel changed by more than 1/255.{extra}"
    return f"{found.pixels_changed:.3%} of the pixels changed by more than 1/255.{extra}"


# --- the table and the record -----------------------------------------------------------------------------------------


def figures_table(where: str, a: Measured, b: Measured, found: Errors) -> Table:
    """Return time, error and work as one table."""
    shown = table(f"{where}: B against A", "", *_heads(a.side, b.side), ">B : A")
    for name, one, other, noise in times(a, b):
        cells = [
            "-" if value is None else f"{value:.2f}" + (f" ±{spread:.2f}" if spread is not None else "")
            for value, spread in zip((one, other), noise, strict=True)
        ]
        ratio = f"{other / one:.2f}" if one and other is not None else "-"
        shown.add_row(name, *cells, ratio)
    shown.add_section()
    for name, value in figures(found):
        shown.add_row(name, "", value, "")
    shown.add_section()
    counters = work_that_differs(a, b)
    for name, first, second in counters:
        shown.add_row(f"work: {name}", *("-" if n is None else str(n) for n in (first, second)), "")
    if not counters and a.record and b.record:
        shown.add_row("work", "the same", "the same", "")
    elif not counters:
        shown.add_row("work", "-", "-", "")
    return shown


def _heads(a: Side, b: Side) -> list[str]:
    """Return the heads of the columns of A and B, with what they are where that is short."""
    sides = zip("AB", (a, b), strict=True)
    return [f">{name}: {side.text}" if len(side.text) <= WIDEST_HEAD else f">{name}" for name, side in sides]


Row = tuple[str, float | None, float | None, tuple[float | None, float | None]]


def times(a: Measured, b: Measured) -> list[Row]:
    """Return (name, milliseconds of A, of B, their spread) for each pass, the GPU, the CPU and the whole frame."""
    records = a.record, b.record
    passes = list(records[0].get("passes_ms", ()))
    before = 0
    for name in records[1].get("passes_ms", ()):  # in the order of the frame, also where B alone has a pass
        if name not in passes:
            passes.insert(before, name)
        before = passes.index(name) + 1
    rows: list[Row] = []
    for name in passes:
        pair = [one.get("passes_ms", {}).get(name) for one in records]
        rows.append((f"{name}, GPU ms", pair[0], pair[1], (None, None)))
    # Without timestamps a record has the wall clock in place of the GPU's time.
    timed = [one if one.get("passes_ms") else {} for one in records]
    noise = timed[0].get("noise_ms"), timed[1].get("noise_ms")
    rows.append(("all passes, GPU ms", timed[0].get("gpu_ms"), timed[1].get("gpu_ms"), noise))
    for name, key in (("recording, CPU ms", "cpu_ms"), ("frame until done, ms", "wall_ms")):
        rows.append((name, records[0].get(key), records[1].get(key), (None, None)))
    return rows


def figures(found: Errors) -> list[tuple[str, str]]:
    """Return the errors of B as (name, text)."""

    def number(value: float | None, form: str) -> str:
        return "-" if value is None else "infinite" if math.isinf(value) else format(value, form)

    unit = "of linear light" if found.of == "linear" else "of 1"
    rows = [
        ("error: relative MSE of linear light", number(found.relative_mse, ".3g")),
        (f"error: largest difference {unit}", number(found.max_abs, ".4g")),
        ("error: FLIP" + (" (HDR)" if found.of == "linear" else "") + ", mean", number(found.flip, ".4g")),
        ("error: pixels changed by over 1/255", f"{found.pixels_changed:.3%}"),
    ]
    if any(found.not_finite):
        rows.append(("pixels not finite in A, B", "{}, {}".format(*found.not_finite)))
    return rows


def work_that_differs(a: Measured, b: Measured) -> list[tuple[str, int | None, int | None]]:
    """Return (counter, A's, B's) where they differ; None where a side does not count it."""
    first, second = (one.record.get("work", {}) for one in (a, b))
    if not first or not second:
        return []
    names = dict.fromkeys([*first, *second])
    return [(n, first.get(n), second.get(n)) for n in names if first.get(n) != second.get(n)]


def record(
    request: Request,
    scene: str | None,
    a: Measured,
    b: Measured,
    found: Errors,
    differ: str,
    size: tuple[int, int],
    target: Path,
) -> dict[str, Any]:
    """Return everything as JSON has it; what is infinite or cannot be said is null. `scene` is None for two files."""
    known = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value
        for key, value in asdict(found).items()
    }
    return {
        "format": FORMAT,
        "strata": strata_version(),
        "differs": differ,
        "scene": scene,
        "environment": None if scene is None else request.environment,
        "camera": request.camera,
        "size": list(size),
        "time": request.time,
        "frames": request.frames,
        "fps": request.fps,
        "A": _side_record(a),
        "B": _side_record(b),
        "error": known,
        "work_that_differs": {name: [one, other] for name, one, other in work_that_differs(a, b)},
        "picture": str(target),
    }


def _side_record(one: Measured) -> dict[str, Any]:
    side = one.side
    if isinstance(side, Picture):
        return {"text": side.text, "kind": "file", "path": str(side.path)}
    found = one.capabilities
    return {
        "text": side.text,
        "kind": {int: "chapter", str: "study"}.get(type(side.which), "fork"),
        **naming(side.which),
        "backend": side.backend,
        "device": {"name": found.device, "driver": found.driver, "kind": found.kind},
        "quality": side.quality,
        "without": list(side.without),
        "plan": [asdict(choice) for choice in one.plan.choices],
        **{key: value for key, value in one.record.items() if key not in ("name", "kind", "error")},
        "settings": asdict(side.settings),
    }
