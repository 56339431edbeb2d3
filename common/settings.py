"""Knobs of a renderer: dataclass fields that carry their meaning, unit and range, and are set by text.

    @dataclass
    class Settings:
        PRESETS: ClassVar[dict[str, dict[str, object]]] = {"low": {"samples": 1}, "medium": {}}
        samples: int = knob(4, "Rays per pixel", minimum=1, maximum=64)

The type of a knob is the type of its default: bool, int, float or str.

Settings with many knobs are nested by subject. A group is a dataclass of the knobs of one subject, and is defined
beside it; the settings are a dataclass of groups:

    @dataclass
    class ClothSettings:
        substeps: int = knob(16, "Parts of a step", minimum=1, maximum=64, flat="cloth_substeps")

    @dataclass(init=False)
    class Settings(Grouped):
        cloth: ClothSettings = group(ClothSettings)

Code reads `settings.cloth.substeps`. Command lines, JSON and records use the flat name: `--set cloth_substeps=8` and
`Settings(cloth_substeps=8)`. The flat name of a knob is its own name unless `flat` says otherwise; a knob `enabled` has
the name of its group, so that `--set cloth=off` switches the subject off.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

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

    A `live` one is read in every frame: it can be set in the settings of a renderer that is open. `flat` is the name
    from outside where it is not that of the field; `path` is where settings hold the value, such as "cloth.substeps".
    """

    default: Value
    doc: str
    unit: str = ""
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[Value, ...] | None = None
    reference: Value | None = None
    live: bool = False
    flat: str = ""
    path: str = ""

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

    `knobs` are values of its settings, by flat name, which replace those of the preset. Counts above `most` are left
    out; `why` says so, as the end of a sentence.
    """

    chapter: int | None = None
    without: tuple[str, ...] = ()
    most: int | None = None
    why: str = ""
    knobs: tuple[tuple[str, Value], ...] = ()

    @property
    def name(self) -> str:
        """How tables and plots call it: "chapter 1", "without bindless", "culling=off", "all features"."""
        words = [f"chapter {self.chapter}"] if self.chapter is not None else []
        words += [f"without {feature}" for feature in self.without]
        words += [f"{name}={value}" for name, value in self.knobs]
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
    flat: str = "",
) -> Any:
    """Return a dataclass field with a documented value; raises ValueError if its own default is out of range.

    Returns Any, as `dataclasses.field` does for a type checker: the annotation of the field says the type.
    """
    allowed = tuple(choices) if choices else None
    record = Knob(default, doc, unit, minimum, maximum, allowed, reference, live, flat)
    for value in (default, reference):
        problem = None if value is None else _problem(record, value)
        if problem:
            raise ValueError(f"knob {doc!r}: {value!r} {problem}")
    return dataclasses.field(default=default, metadata={"knob": record})


def group(kind: type) -> Any:
    """Return a field of `Grouped` settings that holds the knobs of one subject."""
    return dataclasses.field(default_factory=kind, metadata={"group": kind})


class Grouped:
    """Base of settings that are nested by subject; a class of them is a `@dataclass(init=False)`."""

    ORDER: ClassVar[str] = ""
    """Flat names, in the order of tables and records; knobs that are not named follow, group by group."""

    def __init__(self, **values: Any) -> None:
        """Take the values of knobs by their flat names, or whole groups; raise SettingError for another name.

        Both at once are refused: `loading` may be the name of a knob and of a group.
        """
        kinds = _groups(type(self))
        groups = {name: value for name, value in values.items() if isinstance(value, kinds.get(name, ()))}
        if groups and len(groups) < len(values):
            raise SettingError(
                "settings take groups or single knobs, not both: use replaced(settings, name=value)"
            )
        for name, kind in kinds.items():
            setattr(self, name, copy.copy(groups[name]) if name in groups else kind())
        if not groups:
            _set(self, values)

    def __setattr__(self, name: str, value: Any) -> None:
        """Refuse what is no group, and no knob beside the groups: code reads the knobs of a group there."""
        kinds, known = _groups(type(self)), knobs(self)
        if not isinstance(value, kinds.get(name, ())) and (name not in known or known[name].path != name):
            raise SettingError(f"settings cannot be given {name!r}{_instead(type(self), name)}")
        super().__setattr__(name, value)

    if not TYPE_CHECKING:  # a type checker refuses these names itself

        def __getattr__(self, name: str) -> Any:
            raise AttributeError(f"settings have no attribute {name!r}{_instead(type(self), name)}")


def knobs(settings: Any) -> dict[str, Knob]:
    """Return the knobs of a settings class or instance, by flat name, in their order."""
    return dict(_knobs(settings if isinstance(settings, type) else type(settings)))


@cache
def _knobs(kind: type) -> dict[str, Knob]:
    """Return the knobs of a class; raises ValueError where two have the same flat name."""
    named: dict[str, Knob] = {}
    for field in dataclasses.fields(kind):
        inner = field.metadata.get("group")
        prefix = f"{field.name}." if inner else ""
        for member in dataclasses.fields(inner) if inner else (field,):
            record = member.metadata.get("knob")
            if not isinstance(record, Knob):
                continue
            name = record.flat or member.name
            if name in named:
                raise ValueError(f"two knobs of {kind.__name__} have the name {name!r}")
            named[name] = dataclasses.replace(record, flat=name, path=prefix + member.name)
    first = [name for name in getattr(kind, "ORDER", "").split() if name in named]
    return {name: named[name] for name in (*first, *(name for name in named if name not in first))}


def _groups(kind: type) -> dict[str, type]:
    return {
        field.name: field.metadata["group"] for field in dataclasses.fields(kind) if "group" in field.metadata
    }


def _instead(kind: type, name: str) -> str:
    """Return where settings hold what is asked for by flat name, or a near match, as the end of a sentence."""
    known = knobs(kind)
    return f": it is settings.{known[name].path}" if name in known else suggest(name, _groups(kind))


def _set(settings: Any, values: dict[str, Any]) -> None:
    """Set knobs by flat name; raises SettingError for a name that is none, before any is set."""
    known = knobs(settings)
    for name in values:
        _check_name(name, settings)
    for name, value in values.items():
        place, _, own = known[name].path.rpartition(".")
        setattr(attrgetter(place)(settings) if place else settings, own, value)


def _check_name(name: str, settings: Any) -> None:
    """Raise SettingError where no knob has this flat name."""
    known = knobs(settings)
    if name in known:
        return
    paths = {record.path: flat_name for flat_name, record in known.items()}
    inside = [flat_name for path, flat_name in paths.items() if path.startswith(f"{name}.")]
    if name in paths:
        near = f"; did you mean {paths[name]!r}?"
    elif inside:
        near = f": it is a group, which has {', '.join(inside)}."
    else:
        near = suggest(name, known) or ": there is none to set here."
    raise SettingError(f"there is no setting {name!r}{near}")


def flat(settings: Any) -> dict[str, Any]:
    """Return the values of all knobs by flat name, in the order of tables and records."""
    return {name: attrgetter(record.path)(settings) for name, record in knobs(settings).items()}


def replaced(settings: S, **values: Any) -> S:
    """Return a copy of settings with other values of knobs, by flat name; raises SettingError for another name."""
    for name in values:
        _check_name(name, settings)
    if not isinstance(settings, Grouped):
        changes = {knobs(settings)[name].path: value for name, value in values.items()}
        return dataclasses.replace(settings, **changes)  # type: ignore[type-var]
    changed = copy.deepcopy(settings)
    _set(changed, values)
    return changed


def set_live(settings: S, wanted: S) -> bool:
    """Take the values of `wanted` over where some differ, and all that do are `live`; return whether that was so."""
    known, now = knobs(settings), flat(settings)
    others = {name: value for name, value in flat(wanted).items() if value != now[name]}
    if not others or not all(known[name].live for name in others):
        return False
    _set(settings, others)
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
        _check_name(name, settings)
        changes[name] = parse(name, known[name], text.strip())
    return replaced(settings, **changes)


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
    return replaced(settings_class(), **{**values, **presets[name]})
