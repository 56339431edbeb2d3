"""Knobs of a renderer: dataclass fields that carry their meaning, unit and range, and are set by text.

    @dataclass
    class Settings:
        PRESETS: ClassVar[dict[str, dict[str, object]]] = {"low": {"samples": 1}, "medium": {}}
        samples: int = knob(4, "Rays per pixel", minimum=1, maximum=64)

The type of a knob is the type of its default: bool, int, float or str.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from common.errors import SettingError
from common.names import suggest

if TYPE_CHECKING:
    from common.scene import Scene

S = TypeVar("S")
Value = bool | int | float | str


class AtMost(int):
    """A number that a preset wishes for: the device gives as much of it as it can. A plain int is meant exactly."""


_BOOLS = {
    "true": True,
    "on": True,
    "yes": True,
    "1": True,
    "false": False,
    "off": False,
    "no": False,
    "0": False,
}


@dataclasses.dataclass(frozen=True)
class Knob:
    """What is known about one setting; `reference` is the value that gives the truest picture.

    A `live` one is read in every frame: it can be set in the settings of a renderer that is open.
    """

    default: Value
    doc: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[Value, ...] | None = None
    reference: Value | None = None
    live: bool = False

    def range_text(self) -> str:
        """Return the values allowed, for a table and for messages."""
        if self.choices:
            return " | ".join(map(str, self.choices))
        if isinstance(self.default, bool):
            return "on | off"
        if isinstance(self.default, str):
            return "any text"
        if self.minimum is not None and self.maximum is not None:
            return f"{self.minimum:g} to {self.maximum:g}"
        if self.minimum is not None:
            return f"at least {self.minimum:g}"
        if self.maximum is not None:
            return f"at most {self.maximum:g}"
        return "any number"


@dataclasses.dataclass(frozen=True)
class Sweep:
    """Knobs of what is made once, before the first frame: which to turn, on what, and what the result is held to."""

    name: str
    scene: str
    environment: str
    knobs: dict[str, tuple[Value, ...]]
    truth: dict[str, Value]  # values of the same knobs beyond those of any preset


@dataclasses.dataclass(frozen=True)
class Side:
    """A way to draw what grows: a chapter (None: the one that is measured) without some features.

    Counts above `most` are left out; `why` says so, as the end of a sentence.
    """

    chapter: int | None = None
    without: tuple[str, ...] = ()
    most: int | None = None
    why: str = ""

    @property
    def name(self) -> str:
        """How tables and plots call it: "chapter 1", "without bindless", "all features"."""
        words = [f"chapter {self.chapter}"] if self.chapter is not None else []
        words += [f"without {feature}" for feature in self.without]
        return ", ".join(words) or "all features"


@dataclasses.dataclass(frozen=True)
class Scale:
    """Something that scenes have more or less of, of which a chapter says what it costs: `scene(n)` has n of it.

    `counts` are measured, in a quick look those of `quick`. The last of `sides` is the chapter as it is; its time from
    `flat_from` things on is held against that of more.
    """

    name: str
    scene: Callable[[int], Scene]
    counts: tuple[int, ...]
    quick: tuple[int, ...]
    sides: tuple[Side, ...]
    flat_from: int = 10


class Row(NamedTuple):
    """One setting as a line of a table: all of it text."""

    name: str
    default: str
    range: str
    unit: str
    doc: str


def knob(
    default: Any,
    doc: str,
    unit: str = "",
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[Value] | None = None,
    reference: Any = None,
    live: bool = False,
) -> Any:
    """Return a dataclass field with a documented value; raises ValueError if its own default is out of range.

    Returns Any, as `dataclasses.field` does for a type checker: the annotation of the field says the type.
    """
    record = Knob(default, doc, unit, minimum, maximum, tuple(choices) if choices else None, reference, live)
    for value in (default, reference):
        problem = None if value is None else _problem(record, value)
        if problem:
            raise ValueError(f"knob {doc!r}: {value!r} {problem}")
    return dataclasses.field(default=default, metadata={"knob": record})


def knobs(settings: Any) -> dict[str, Knob]:
    """Return the knobs of a settings class or instance, by name, in their order."""
    found = {field.name: field.metadata.get("knob") for field in dataclasses.fields(settings)}
    return {name: record for name, record in found.items() if isinstance(record, Knob)}


def set_live(settings: S, wanted: S) -> bool:
    """Take the values of `wanted` over where some differ, and all that do are `live`; return whether that was so."""
    known = knobs(settings)
    others = {name for name in vars(wanted) if getattr(wanted, name) != getattr(settings, name)}
    if not others or not all(name in known and known[name].live for name in others):
        return False
    for name in others:
        setattr(settings, name, getattr(wanted, name))
    return True


def apply_overrides(settings: S, overrides: Iterable[str]) -> S:
    """Return a copy of `settings` with texts "key=value" applied in order.

    Raises SettingError for a text without "=", an unknown name (with the near match), a value that is not of
    the knob's type, and one out of its range.
    """
    changes: dict[str, Value] = {}
    known = knobs(settings)
    for override in overrides:
        name, separator, text = override.partition("=")
        name = name.strip().replace("-", "_")
        if not separator:
            raise SettingError(f"setting {override!r} has no value: write {name or 'name'}=value")
        if name not in known:
            near = suggest(name, known) or ": there is none to set here."
            raise SettingError(f"there is no setting {name!r}{near}")
        changes[name] = parse(name, known[name], text.strip())
    return dataclasses.replace(settings, **changes)  # type: ignore[type-var]


def parse(name: str, record: Knob, text: str) -> Value:
    """Return `text` as the type of a knob; raises SettingError if it is not one of its values."""
    try:
        value = _convert(record, text)
    except ValueError:
        kind = {bool: "on or off", int: "a whole number", float: "a number"}[type(record.default)]
        raise SettingError(f"setting {name} must be {kind}, not {text!r}") from None
    problem = _problem(record, value)
    if problem:
        near = suggest(text, map(str, record.choices)) if isinstance(value, str) and record.choices else ""
        if near.endswith("?"):
            raise SettingError(f"setting {name} cannot be {text!r}{near}")
        raise SettingError(f"setting {name} {problem}, not {text!r}")
    return value


def _convert(record: Knob, text: str) -> Value:
    if isinstance(record.default, bool):
        if text.lower() not in _BOOLS:
            raise ValueError(text)
        return _BOOLS[text.lower()]
    if isinstance(record.default, int):
        return int(text, 0)
    if isinstance(record.default, float):
        return float(text)
    return text


def _problem(record: Knob, value: Value) -> str | None:
    """Return what is wrong with a value of the right type, as the middle of a sentence, or None."""
    if record.choices and value not in record.choices:
        return f"must be one of {', '.join(map(str, record.choices))}"
    if isinstance(value, str | bool):
        return None
    low = -math.inf if record.minimum is None else record.minimum
    high = math.inf if record.maximum is None else record.maximum
    if math.isnan(value) or not low <= value <= high:
        return f"must be {record.range_text()}"
    return None


def describe(settings_class: type | Any) -> list[Row]:
    """Return one row for each knob: name, default, range, unit, meaning."""
    rows = []
    for name, record in knobs(settings_class).items():
        default = (
            ("on" if record.default else "off") if isinstance(record.default, bool) else f"{record.default}"
        )
        rows.append(Row(name, default, record.range_text(), record.unit, record.doc))
    return rows


def preset(settings_class: type[S], name: str) -> S:
    """Return the settings of a preset: the defaults, changed by the class's `PRESETS[name]`.

    "reference" takes each knob's `reference` value first, where it has one. Raises SettingError for an
    unknown preset.
    """
    presets: dict[str, dict[str, Any]] = getattr(settings_class, "PRESETS", {})
    if name not in presets:
        raise SettingError(f"there is no preset {name!r}{suggest(name, presets)}")
    values: dict[str, Any] = {}
    if name == "reference":
        truest = {key: record.reference for key, record in knobs(settings_class).items()}
        values = {key: value for key, value in truest.items() if value is not None}
    return settings_class(**{**values, **presets[name]})
