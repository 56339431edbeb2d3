"""What kinds of figures there are, times, errors and counters, and how each is read from a row of a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

FACTS = frozenset(
    {
        *("samples", "instances", "lights", "textures", "textures_resident"),
        *("passes_skipped", "recorded_parts", "recording_threads"),
        *("transient_bytes_alone", "transient_bytes_bound", "cloths_at_rest"),
        *("cloth_particles", "bytes", "decoded_bytes", "visible"),
        *("instances_tested", "instances_outside", "instances_hidden", "instances_coarser"),
        *("meshlets_outside", "meshlets_away", "meshlets_hidden"),
    }
)
"""Counters of which more is neither better nor worse."""

CODE = 1.001 / 255
"""The largest difference of two pictures may change by one code of what is shown: it is a single pixel's."""

Key = tuple[str, str, str]
"""Part, point and name."""


@dataclass(frozen=True)
class Figure:
    """One number of a record; `kind` is "time", "error", "work" or "fact".

    `noise` and `least` are of times; `slack` is what an error or a counter may change by and mean nothing. `within` are
    the times of which it is the sum.
    """

    kind: str
    value: float
    noise: float | None = None
    least: float | None = None
    slack: float = 0.0
    within: Mapping[str, float] = field(default_factory=dict)


Row = tuple[str, dict[str, Figure | None]]
"""A point, and its figures by name."""


def _number(value: Any) -> float | None:
    if value is None or isinstance(value, bool):
        return None
    if not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def times_of(one: Mapping[str, Any], *names: str, within: str = "") -> dict[str, Figure | None]:
    """Return times; the first of them owns what the record calls noise without saying of what."""
    found: dict[str, Figure | None] = {}
    for place, name in enumerate(names):
        stem, _, unit = name.rpartition("_")
        value = _number(one.get(name))
        spread = []
        for word in ("noise", "least"):
            own = one.get(f"{stem}_{word}_{unit}" if stem else f"{word}_{unit}")
            spread.append(_number(own if own is not None or place else one.get(f"{word}_{unit}")))
        noise, least = spread
        parts = (
            {name: float(part) for name, part in one.get(within, {}).items()} if within and not place else {}
        )
        found[name] = None if value is None else Figure("time", value, noise, least, within=parts)
    return found


def errors_of(errors: Mapping[str, Any] | None, before: str = "") -> dict[str, Figure | None]:
    """Return errors, those of a group with `before` and its name in front; what is no number is left out."""
    found: dict[str, Figure | None] = {}
    for name, given in (errors or {}).items():
        if isinstance(given, Mapping):
            found |= errors_of(given, f"{before}{name} ")
        elif (value := _number(given)) is not None:
            found[f"{before}{name}"] = Figure("error", value, slack=CODE if name == "max_abs" else 0.0)
    return found


def work_of(counts: Mapping[str, Any], *names: str) -> dict[str, Figure | None]:
    """Return counters, all of them or those of `names`."""
    found: dict[str, Figure | None] = {}
    for name in names or counts:
        if (value := _number(counts.get(name))) is not None:
            found[name] = Figure("fact" if name in FACTS else "work", value)
    return found


def point_of(*words: Any) -> str:
    """Return the name of a point."""
    return ", ".join(str(word) for word in words)
