"""The file of a sweep: what it may say, and the references that follow from it.

    chapter = [1, 12]
    scene = "cornell"
    size = "320x180"
    seed = [0, 1]
    settings = [{}, {path_bounces = 2}]

    [[reference]]
    camera = ["", "1,0.5,3:0,0.8,0"]

Each key has a value or a list of values, and there is a reference for each combination. Keys before the first
`[[reference]]` hold for all of these, unless one says otherwise; without any, they are the only references.
"""

from __future__ import annotations

import itertools
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import chapters
from chapters import studies
from common.errors import UserError
from common.files.regular_files import read_regular
from common.names import suggest
from tools.reference.command import PICTURES, Request
from tools.run.run import parse_size

MOST_REFERENCES = 10_000
MOST_BYTES = 1 << 20
TABLE = "sweep.csv"


def is_text(value: Any) -> bool:
    """Whether a value is a text."""
    return isinstance(value, str)


def is_whole(value: Any) -> bool:
    """Whether a value is a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_chapter(value: Any) -> bool:
    """Whether a value can name a chapter."""
    return is_text(value) or is_whole(value)


def is_knobs(value: Any) -> bool:
    """Whether a value is a table of knobs."""
    return isinstance(value, dict) and all(isinstance(one, str | int | float) for one in value.values())


KEYS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "chapter": (is_chapter, "the number of a chapter"),
    "scene": (is_text, "a name or a file in quotes"),
    "environment": (is_text, 'a file, "sky" or "none"'),
    "camera": (is_text, 'a text as for --camera, or "" for the first camera'),
    "size": (is_text, 'a size such as "640x360"'),
    "time": (is_number, "a number of seconds"),
    "ev": (is_number, "a number"),
    "filter": (is_text, '"box" or "centre"'),
    "seed": (is_whole, "a whole number"),
    "settings": (is_knobs, "a table such as {path_bounces = 2}"),
    "error": (is_number, "a number"),
    "paths": (is_whole, "a whole number"),
}
"""What a reference may say -> whether a value is of the right kind, and what to write; in the order of files' names."""

NEEDED = ("chapter", "scene")
ALONE = {"name", "format"}
"""Keys without lists: the name of the files of a [[reference]], and the kind of all pictures."""


@dataclass(frozen=True)
class Entry:
    """One combination: where the file says it, its values by key, and the name of its files without suffix."""

    where: str
    values: Mapping[str, Any]
    name: str


@dataclass(frozen=True)
class Sweep:
    """What a file asks for; `suffix` is that of all pictures."""

    path: Path
    entries: tuple[Entry, ...]
    suffix: str

    def counts(self) -> str:
        """Return how many values each key has, where it has several: "2 scenes, 3 cameras"."""
        words = []
        for key in KEYS:
            found = _distinct(entry.values.get(key) for entry in self.entries)
            if found > 1:
                plural = {"settings": "settings", "error": "errors", "paths": "numbers of paths"}
                words.append(f"{found} {plural.get(key, key + 's')}")
        return ", ".join(words)


def read(path: Path) -> Sweep:
    """Return what a file asks for. Raises UserError, which names the file and the key."""
    try:
        data = read_regular(path, MOST_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UserError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from None
    if len(data) > MOST_BYTES:
        raise UserError(f"{path} is no sweep: it has more than {MOST_BYTES} bytes.")
    try:
        told = tomllib.loads(data.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        reason = "it nests too deeply" if isinstance(error, RecursionError) else str(error)
        raise UserError(f"{path} is no TOML: {reason}.") from None
    own = told.pop("reference", None)
    if own is not None and not (isinstance(own, list) and all(isinstance(one, dict) for one in own)):
        raise UserError(f"{path}: reference must be tables, each below a line [[reference]].")
    suffix = _suffix(path, told.pop("format", "exr"))
    shared = _checked(path, "", told)
    if "name" in shared and own:
        raise UserError(
            f"{path}: name before the first [[reference]] would be that of all: move it below one."
        )
    entries: list[Entry] = []
    for number, table in enumerate([{}] if own is None else own, 1):
        where = f"[[reference]] {number}: " if own is not None else ""
        entries += _combined(path, where, shared | _checked(path, where, table), len(entries))
    if not entries:
        raise UserError(f"{path} asks for no reference: `reference` is an empty list.")
    return Sweep(path, _named(path, entries), suffix)


def _suffix(path: Path, value: Any) -> str:
    known = [suffix[1:] for suffix in PICTURES]
    if value not in known:
        raise UserError(f"{path}: format = {_shown(value)} is none of {', '.join(known)}.")
    return f".{value}"


def _checked(path: Path, where: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with a list for each key. Raises UserError for a wrong key, an empty list or a wrong value."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if key == "name":
            if not (is_text(value) and re.fullmatch(r"\w[\w.+-]{0,199}", value)):
                raise UserError(
                    f"{path}: {where}name = {_shown(value)} is no name of files: write letters, digits, and . + - _."
                )
            found[key] = value
            continue
        if key not in KEYS:
            known = [*KEYS, "name"] if where else [*KEYS, "format", "reference"]
            near = suggest(key, known)
            raise UserError(
                f"{path}: {where}there is no key {key!r}{near}" + ("" if near.endswith("?") else ".")
            )
        is_right, form = KEYS[key]
        values = value if isinstance(value, list) else [value]
        if not values:
            raise UserError(f"{path}: {where}{key} is an empty list: then there is no reference.")
        for one in values:
            if not is_right(one):
                raise UserError(f"{path}: {where}{key} = {_shown(one)} is wrong: write {form}.")
        found[key] = values
    return found


def _combined(path: Path, where: str, table: Mapping[str, Any], before: int) -> list[Entry]:
    """Return an entry for each combination of the values of a table; the last key varies fastest."""
    for key in NEEDED:
        if key not in table:
            raise UserError(f"{path}: {where}{key} is missing: each reference needs a chapter and a scene.")
    keys = [key for key in KEYS if key in table]
    count = math.prod(len(table[key]) for key in keys)
    if before + count > MOST_REFERENCES:
        raise UserError(
            f"{path}: {where}there would be {before + count} references; a sweep has at most {MOST_REFERENCES}."
        )
    combinations = itertools.product(*(table[key] for key in keys))
    return [
        Entry(where, dict(zip(keys, values, strict=True)), str(table.get("name", "")))
        for values in combinations
    ]


def _named(path: Path, entries: Sequence[Entry]) -> tuple[Entry, ...]:
    """Return entries with names of files, which have the values that vary. Raises UserError where two have one name."""
    varying = [
        key for key in KEYS if key not in NEEDED and _distinct(entry.values.get(key) for entry in entries) > 1
    ]
    named: dict[str, Entry] = {}
    for entry in entries:
        values = entry.values
        name = entry.name
        if not name:
            begin = studies.picture_name(_chapter(path, entry), values["scene"])
            parts = [
                f"{key}-{_word(values[key])}" for key in varying if values.get(key) not in (None, "", {})
            ]
            name = "-".join([begin, *parts])[:200]
        other = named.setdefault(name.casefold(), Entry(entry.where, values, name))
        if other.values is not values:
            raise UserError(
                f"{path}: two references would be written to {name}: {_told(other)}; and {_told(entry)}. "
                "Leave one out, or give them names: name = ... below a [[reference]] each."
            )
    return tuple(named.values())


def _told(entry: Entry) -> str:
    return entry.where + ", ".join(f"{key} = {_shown(value)}" for key, value in entry.values.items())


def _word(value: Any) -> str:
    """Return a value as a part of a file's name."""
    text = "-".join(f"{key}-{one}" for key, one in value.items()) if isinstance(value, dict) else str(value)
    return re.sub(r"[^\w.]+", "-", text).strip("-.") or "0"


def _shown(value: Any) -> str:
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "..."


def _distinct(values: Any) -> int:
    return len({json.dumps(value, sort_keys=True, default=str) for value in values})


def _chapter(path: Path, entry: Entry) -> chapters.Whole:
    try:
        return chapters.parse_chapter(entry.values["chapter"])
    except UserError as error:
        raise UserError(
            f"{path}: {entry.where}chapter = {_shown(entry.values['chapter'])}: {error}"
        ) from None


def request_of(sweep: Sweep, entry: Entry, folder: Path, **options: Any) -> Request:
    """Return what an entry asks for, as `strata reference` would be asked. Raises UserError."""
    values = entry.values
    given = {key: values[key] for key in ("scene", "environment", "filter", "seed", "paths") if key in values}
    for key in ("time", "error"):
        if key in values:
            given[key] = float(values[key])
    if "size" in values:
        try:
            given["size"] = parse_size(values["size"])
        except UserError as error:
            raise UserError(f"{sweep.path}: {entry.where}{plain(error)}") from None
    return Request(
        chapter=_chapter(sweep.path, entry),
        ev100=float(values["ev"]) if "ev" in values else None,
        camera=values.get("camera") or None,
        overrides=tuple(f"{key}={_override(value)}" for key, value in values.get("settings", {}).items()),
        out=folder / f"{entry.name}{sweep.suffix}",
        **given,
        **options,
    )


def _override(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def plain(error: Exception) -> str:
    """Return a sentence on options of the command as one on keys: without the dashes before their names."""
    return re.sub(
        rf"--({'|'.join(KEYS)}|set)\b", lambda match: match[1].replace("set", "settings"), str(error)
    )


def told(entry: Entry) -> str:
    """Return which reference an entry is, for the beginning of a sentence."""
    return f"{entry.where}{entry.name}"
