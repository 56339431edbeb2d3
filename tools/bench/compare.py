"""`strata bench --compare OLD NEW`: what became worse from one record to the other, by more than noise.

A figure is a time, an error or a count of work (`tools.bench.figures`). Times move from run to run: how far, the
records say themselves, and a change counts that is larger than what both tell. Where a record is of another device,
driver or system, or of other settings, a change is said and is nobody's fault.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.names import suggest
from tools.bench import bench, compare_show
from tools.bench.all_chapters import KIND, NAMES
from tools.bench.figures import Figure, Key, figures, settings
from tools.bench.lessons.parts import PARTS
from tools.bench.points import ERROR_NOISE
from tools.cli.console import err, out, say
from tools.run.record import STDOUT

NOISES = 3.0
"""A time changed if it moved by more than so many times the noise of both records together. Noise is half the distance
of the quartiles, two thirds of a standard deviation where times are spread evenly to both sides."""

LEAST = 0.05
"""Nor does a smaller change count, whatever the noise: clocks of processors and GPUs drift by that."""

LEAST_QUICK = 0.25
"""The same where a record is a quick look."""

LEAST_UNKNOWN = 0.5
"""The same where a record does not say how noisy a time is: how long loads and starts take."""


BUSY = 2
"""A machine was busy with more than so many programs for each processor: a bench in software is about one by itself."""


@dataclass(frozen=True)
class Change:
    """One figure that is another one beyond noise; `verdict` is "worse", "better" or "other"."""

    key: Key
    old: Figure
    new: Figure
    verdict: str


@dataclass
class Comparison:
    """Two records of one chapter held against each other.

    `blames` has the kinds of figures that the code can be blamed for: none where device, driver or system differ, no
    times where the machine was busy. `apart` says, in sentences, what the records have not in common; `only_old` and
    `only_new` are figures that one record lacks.
    """

    chapter: str
    backend: str
    compared: int = 0
    blames: frozenset[str] = frozenset({"time", "error", "work"})
    apart: list[str] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    only_old: list[tuple[str, str, str]] = field(default_factory=list)
    only_new: list[tuple[str, str, str]] = field(default_factory=list)

    @property
    def regressions(self) -> list[Change]:
        """What is worse, and nothing but the code can be blamed for."""
        return [one for one in self.changes if one.verdict == "worse" and one.old.kind in self.blames]


@dataclass
class Whole:
    """All that two files have to say: a comparison for each bench, benches that one lacks, and those that fail now."""

    old: Path
    new: Path
    notes: list[str] = field(default_factory=list)
    comparisons: list[Comparison] = field(default_factory=list)
    failing: list[str] = field(default_factory=list)

    @property
    def regressions(self) -> int:
        """How many figures and benches are worse."""
        return len(self.failing) + sum(len(one.regressions) for one in self.comparisons)

    @property
    def compared(self) -> int:
        """How many figures both files have."""
        return sum(one.compared for one in self.comparisons)

    @property
    def in_vain(self) -> bool:
        """Whether there is no figure that both have and that counts: no answer, and so none that all is well."""
        return not self.compared


def run(old: Path, new: Path, json_path: Path | None = None, only: Sequence[str] = ()) -> int:
    """Compare two records, say what came out, and return 1 if anything is worse, 2 if nothing was compared, else 0.

    `json_path` gets it as JSON. `only` names the PARTS that count. Raises UserError for what is no record of a bench.
    """
    bench.check_paths(json_path)
    for part in only:
        if part not in PARTS:
            raise UserError(
                f"--only {part}: a bench has no such part{suggest(part, PARTS, len(PARTS))}.".replace(
                    "?.", "?"
                )
            )
    found = compare_files(old, new, only)
    if json_path == STDOUT:
        print(json.dumps(compare_show.record(found), indent=1))
    elif json_path is not None:
        bench.write_record(json_path, compare_show.record(found))
    compare_show.show(found, err if json_path == STDOUT else out)
    if json_path is not None and json_path != STDOUT:
        say(f"Wrote {json_path}")
    return 1 if found.regressions else 2 if found.in_vain else 0


def compare_files(old: Path, new: Path, only: Sequence[str] = ()) -> Whole:
    """Return what two files have to say of each other; raise UserError for what is no record, or another kind of it."""
    found, formats = Whole(old, new), []
    read = [bench.read_object(path) for path in (old, new)]
    for path, made in zip((old, new), read, strict=True):
        if not isinstance(made.get("format"), int) or ("points" not in made and made.get("kind") != KIND):
            raise UserError(f"{path} is no record of a bench: `strata bench N --json FILE` writes one.")
        formats.append(made["format"])
    if formats[0] != formats[1]:
        raise UserError(
            f"{old} is a record of format {formats[0]} and {new} of format {formats[1]}: nothing in them can be "
            "compared, measure again."
        )
    if formats[0] != bench.FORMAT:
        raise UserError(
            f"{old} and {new} are records of format {formats[0]}, not {bench.FORMAT}: measure again, both."
        )
    kinds = [made.get("kind") == KIND for made in read]
    sides = [f"commit {str(made.get('commit'))[:13]} of {str(made.get('date'))[:16]}" for made in read]
    found.notes.append(f"From {sides[0]} to {sides[1]}.")
    if kinds[0] != kinds[1]:
        single, every = (new, old) if kinds[0] else (old, new)
        raise UserError(
            f"{single} is the record of one bench and {every} of every chapter's: compare two of a kind."
        )
    if kinds[0]:
        _compare_all(found, read[0], read[1], only)
        return found
    found.comparisons.append(_checked(found, read[0], read[1], only))
    return found


def _compare_all(found: Whole, old: dict[str, Any], new: dict[str, Any], only: Sequence[str]) -> None:
    """Compare the benches that both have; say which one lacks, and which fail now."""
    sides: list[dict[tuple[Any, Any], dict[str, Any]]] = []
    fails: list[dict[tuple[Any, Any], str]] = []
    for path, made in ((found.old, old), (found.new, new)):
        try:
            sides.append({(one["chapter"], one["backend"]): one for one in made["records"]})
            fails.append({(one["chapter"], one["backend"]): str(one["why"]) for one in made["failures"]})
        except (KeyError, TypeError, AttributeError) as error:
            raise _broken(path, error) from None
    for key in sorted({*sides[0], *sides[1], *fails[0], *fails[1]}, key=str):
        name = f"Chapter {key[0]} on {NAMES.get(key[1], key[1])}"
        before, after = (side.get(key) for side in sides)
        if before is not None and after is not None:
            found.comparisons.append(_checked(found, before, after, only))
        elif before is not None and key in fails[1]:
            found.failing.append(f"{name} fails in {found.new}: {fails[1][key]}")
        elif after is not None and key in fails[0]:
            found.notes.append(f"{name} failed in {found.old}, and is measured again.")
        elif before is not None or after is not None:
            found.notes.append(f"{name} is only in {found.old if before is not None else found.new}.")
        else:
            places = [
                str(path) for path, failed in zip((found.old, found.new), fails, strict=True) if key in failed
            ]
            found.notes.append(f"{name} fails in {' and in '.join(places)}.")


def _checked(found: Whole, old: dict[str, Any], new: dict[str, Any], only: Sequence[str]) -> Comparison:
    """Return the comparison of two records; raise UserError for one that is not whole, and for two chapters."""
    numbers = []
    for path, made in ((found.old, old), (found.new, new)):
        try:
            compare(made, made, only)  # reads all that a comparison needs
            numbers.append(made["chapter"])
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise _broken(path, error) from None
    if numbers[0] != numbers[1]:
        raise UserError(
            f"{found.old} is of chapter {numbers[0]} and {found.new} of chapter {numbers[1]}: name two records of one, "
            "or hold chapters against each other by `strata compare`."
        )
    return compare(old, new, only)


def _broken(path: Path, error: Exception) -> UserError:
    what = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
    return UserError(f"{path} is no whole record of a bench: {what}.")


# --- two records of one chapter ---------------------------------------------------------------------------------------


def _surroundings(made: dict[str, Any]) -> dict[str, str]:
    """Return what a figure may be another one for, though the code is the same."""
    device = made["device"]
    return {
        "device": str(device["name"]),
        "driver": str(device["driver"]),
        "backend": NAMES.get(made["backend"], str(made["backend"])),
        "system": str(made["system"]),
    }


def _picture(made: dict[str, Any]) -> str:
    """Return what was drawn, in words."""
    scene, (width, height) = made["scene"], made["size"]
    return f"{scene['name']} ({scene['triangles']:,} triangles) at {width}x{height}"


def compare(old: dict[str, Any], new: dict[str, Any], only: Sequence[str] = ()) -> Comparison:
    """Return the comparison of two records of one chapter."""
    name = f"{new['chapter']}" + (f", fork {Path(new['fork']).name}" if "fork" in new else "")
    found = Comparison(name, NAMES.get(new["backend"], str(new["backend"])))
    sides = _surroundings(old), _surroundings(new)
    for word, said in sides[0].items():
        if said != sides[1][word]:
            found.blames = frozenset()
            found.apart.append(f"The {word} is another one: {said}, and now {sides[1][word]}.")
    found.apart += _said(old, new)
    if busy := _busy(old, new):
        found.blames -= {"time"}
        found.apart.append(busy)
    if _picture(old) != _picture(new):
        found.apart.append(
            f"The pictures are other ones, so nothing is compared: {_picture(old)}, and now {_picture(new)}."
        )
        return found
    left_out = set(_other_points(old, new, found))
    same_truth = old["reference"] == new["reference"]
    if not same_truth:
        found.apart.append(
            "The references have other numbers of samples: errors of settings and of what is prepared are not compared."
        )

    def counts(key: Key, one: Figure) -> bool:
        of_truth = one.kind == "error" and key[0] in ("settings", "prepared")
        return (not only or key[0] in only) and key[:2] not in left_out and (same_truth or not of_truth)

    before = {key: one for key, one in figures(old).items() if counts(key, one)}
    after = {key: one for key, one in figures(new).items() if counts(key, one)}
    both = [key for key in before if key in after]
    least = LEAST_QUICK if old.get("quick") or new.get("quick") else LEAST
    for key in both:
        verdict = judged(before[key], after[key], least)
        if verdict:
            found.changes.append(Change(key, before[key], after[key], verdict))
    found.compared = len(both)
    found.only_old = joined([key for key in before if key not in after], both)
    found.only_new = joined([key for key in after if key not in before], both)
    return found


def _other_points(old: dict[str, Any], new: dict[str, Any], found: Comparison) -> list[tuple[str, str]]:
    """Return the points whose settings are others now, which is said."""
    before, after = settings(old), settings(new)
    other = [key for key in before if key in after and before[key] != after[key]]
    for part, point in other:
        sides = before[part, point], after[part, point]
        names = [name for name in {**sides[0], **sides[1]} if sides[0].get(name) != sides[1].get(name)]
        found.apart.append(
            f"Of {part}, {point} has other settings now ({', '.join(names)}) and is not compared."
        )
    return other


def _said(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Return what else should be known of two records, as sentences: nothing that excuses a change."""
    said = []
    if old.get("fork") != new.get("fork"):
        names = [
            f"the fork {Path(one['fork']).name}" if "fork" in one else "the chapter" for one in (old, new)
        ]
        said.append(f"The code is another one: {names[0]}, and now {names[1]}.")
    if old.get("python") != new.get("python"):
        said.append(f"Python is another one: {old.get('python')}, and now {new.get('python')}.")
    if bool(old.get("quick")) != bool(new.get("quick")):
        said.append(
            f"The {'first' if old.get('quick') else 'second'} record is a quick look, the other is not."
        )
    if str(new["date"]) < str(old["date"]):
        said.append("The first record is the later one: are the files the wrong way round?")
    return said


def _busy(old: dict[str, Any], new: dict[str, Any]) -> str:
    """Return in a sentence that the machine had other things to do before a record, or ""."""
    found = []
    for place, one in (("first", old), ("second", new)):
        load, processors = one.get("load_before"), re.search(r"(\d+) CPU", str(one["system"]))
        if isinstance(load, int | float) and processors and load > BUSY * int(processors[1]):
            found.append(f"the {place} (load {load:.1f} on {processors[1]} processors)")
    return (
        f"The machine was busy before {' and '.join(found)}: no time is called a regression, measure when it is quiet."
        if found
        else ""
    )


def judged(old: Figure, new: Figure, least: float = LEAST) -> str:
    """Return "worse", "better" or "other" for a figure that changed beyond noise, else "".

    A time has to move by more than NOISES times the noise of both, and by more than `least` of the smaller one; where
    both records know their quickest frame, that has to move by as much: a busy machine slows most frames, and seldom
    all. An error has to move by more than ERROR_NOISE and its slack; a count is exact. No number, as NaN or infinity,
    is worse than any number.
    """
    numbers = math.isfinite(old.value), math.isfinite(new.value)
    if not all(numbers):
        return "" if numbers[0] == numbers[1] else ("worse" if numbers[0] else "better")
    change = new.value - old.value
    smaller = min(abs(old.value), abs(new.value))
    if old.kind == "time":
        bound = NOISES * ((old.noise or 0.0) + (new.noise or 0.0))
        if not all(one.noise is not None and math.isfinite(one.noise) for one in (old, new)):
            bound, least = 0.0, LEAST_UNKNOWN
        moved = abs(change) > max(bound, least * smaller)
        if moved and old.least is not None and new.least is not None:
            rise = (new.least - old.least) * math.copysign(1.0, change)
            moved = rise > least * min(old.least, new.least)
    else:
        moved = abs(change) > max(old.slack, ERROR_NOISE * smaller if old.kind == "error" else 0.0)
    if not moved:
        return ""
    return "other" if old.kind == "fact" else ("worse" if change > 0 else "better")


def joined(keys: Iterable[Key], both: Iterable[Key]) -> list[tuple[str, str, str]]:
    """Return figures that only one record has as (part, point, names), short.

    The point is "" where the records share nothing of the part, and the names are "" where they share nothing of the
    point.
    """
    shared = {key[:2] for key in both}
    parts = {part for part, _ in shared}
    found: dict[tuple[str, str], list[str]] = {}
    for part, point, name in keys:
        if part not in parts:
            found.setdefault((part, ""), [])
        elif (part, point) not in shared:
            found.setdefault((part, point), [])
        else:
            found.setdefault((part, point), []).append(name)
    return [(part, point, ", ".join(names)) for (part, point), names in found.items()]
