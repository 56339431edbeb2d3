"""`strata explain`: a term of the glossary, a feature with its tests, or a setting with its range, by its name.

What can be explained is gathered as `Thing`s. A word may mean several of them, and then all are shown.
"""

from __future__ import annotations

import ast
import difflib
import re
import textwrap
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from rich.markup import escape
from rich.text import Text

import chapters
from chapters import studies
from common.errors import UserError
from common.paths import ROOT
from common.settings import Knob, flat, knobs, preset
from tools.cli.console import out
from tools.ledger import features, glossary, results
from tools.ledger.features import Feature
from tools.ledger.glossary import Entry, normal

VARIABLES = {
    "STRATA_ASSETS": "The folder of models and environments made elsewhere, for tests; ../shared/assets without it.",
    "STRATA_CACHE": "The folder for all that can be made again: compiled shaders, scenes, measurements; "
    "without it the user's own cache folder.",
    "STRATA_COMMIT": "The commit that records name, where a copy of the project has no history of its own.",
    "STRATA_DEVICE": "The Vulkan device to take, by a part of its name or its number in the list of ./strata doctor.",
    "STRATA_FEATURES": "The ledger of features, a table with their titles, where somebody has it; "
    "../shared/features.tsv without it.",
    "STRATA_STATE": "The folder for what you have read and solved in the lessons; without it one of the user's own.",
    "STRATA_VERDICTS": "The folder for what was found out about drivers when they were tried; the folder "
    "selftest of the cache without it.",
}
"""What the environment can say to the program."""
NEAR = 6
"""So many near names are suggested."""


@dataclass(frozen=True)
class Thing:
    """Something that has a name here; `keys` are the normal forms under which it is found, `show` prints it."""

    kind: str
    name: str
    keys: frozenset[str]
    show: Callable[[], None]


def run(words: Sequence[str]) -> int:
    """Print what is known by a name, or without one all names; return the exit code."""
    word = " ".join(" ".join(words).split())
    if words and not word:
        raise UserError("Explain what? ./strata explain lists what there is.")
    if not word:
        show_names()
        return 0
    key = normal(word)
    things = [*_named(), *(_features() if may_be_a_feature(key) else ())]
    found = [thing for thing in things if key in thing.keys]
    if not any(thing.kind == "term" for thing in found):  # "timeline" is a part of "timeline semaphore"
        found += [thing for thing in things if thing.kind == "term" and key in normal(thing.name).split()]
    if not found:
        raise UserError(f"Nothing here is called {word!r}{nearest(word, everything())}")
    for index, thing in enumerate(found):
        if index:
            out.print()
        thing.show()
    return 0


def nearest(word: str, things: Iterable[Thing]) -> str:
    """Return how a sentence about an unknown word ends: near names first, then those that have it as a part."""
    names = {key: thing.name for thing in things for key in sorted(thing.keys)}
    key = normal(word)
    near = difflib.get_close_matches(key, names, n=NEAR, cutoff=0.7)
    parts = {one: re.split(r"[ /]", one) for one in names}
    close = difflib.get_close_matches(
        key, {part for of_one in parts.values() for part in of_one}, n=2, cutoff=0.75
    )
    with_it, with_near = (
        [one for one, of_one in parts.items() if {*some} & {*of_one}] for some in ([key], close)
    )
    chosen = [repr(name) for name in dict.fromkeys(names[one] for one in (*with_it, *near, *with_near))][
        :NEAR
    ]
    if not chosen:
        return ": ./strata explain lists what there is."
    *most, last = chosen
    return f"; did you mean {', '.join(most)} or {last}?" if most else f"; did you mean {last}?"


# --- what there is ----------------------------------------------------------------------------------------------------


def everything() -> list[Thing]:
    """Return all that can be explained: terms, settings, lessons' parts, variables, features and their areas."""
    return [*_named(), *_features()]


def _named() -> list[Thing]:
    return [*_terms(), *_settings(), *_parts(), *_variables()]


def may_be_a_feature(key: str) -> bool:
    """Whether any test has a name in quotes as that of a feature or an area; to find all of them takes a second."""
    slug = key.replace(" ", "-")
    wanted = (f'"{slug}"', f'/{slug}"', f'"{slug}/')
    texts = (path.read_text("utf-8") for path in features.TESTS.rglob("test_*.py"))
    return any(one in text for text in texts for one in wanted)


def _terms() -> list[Thing]:
    return [
        Thing("term", entry.name, frozenset(map(normal, entry.forms)), partial(show_term, entry))
        for entry in glossary.read().values()
    ]


def _settings() -> list[Thing]:
    return [
        Thing(
            "setting",
            name,
            frozenset({normal(name)}),
            partial(show_setting, name, owners),
        )
        for name, owners in settings().items()
    ]


@cache
def settings() -> dict[str, dict[str, Knob]]:
    """Return for each setting by name who has it, "5" or "5/torus-knot", with what is known of it there."""
    found: dict[str, dict[str, Knob]] = defaultdict(dict)
    own = [str(number) for number in chapters.available()]
    beside = [f"{number}/{name}" for number in chapters.available() for name in studies.available(number)]
    for which in (*own, *beside):
        for name, record in knobs(chapters.settings_class(chapters.parse(which))).items():
            found[name][which] = record
    return dict(found)


def _features() -> list[Thing]:
    found, areas = [], defaultdict[str, list[str]](list)
    for feature in features.features(features.ledger()):
        area, _, name = feature.slug.partition("/")
        areas[area].append(feature.slug)
        keys = frozenset({normal(feature.slug), normal(name)})
        found.append(Thing("feature", feature.slug, keys, partial(show_feature, feature)))
    whole = [
        Thing("area", area, frozenset({normal(area)}), partial(show_area, area, slugs))
        for area, slugs in sorted(areas.items())
    ]
    return [*found, *whole]


def _parts() -> list[Thing]:
    found = []
    for number in chapters.available():
        for part in chapters.lesson(number).adds:
            bare = re.sub(r"^(an?|the) ", "", part)
            keys = frozenset({normal(part), normal(bare)})
            found.append(Thing("part", part, keys, partial(show_part, number, part)))
    return found


def _variables() -> list[Thing]:
    return [
        Thing("variable", name, frozenset({normal(name)}), partial(show_variable, name)) for name in VARIABLES
    ]


# --- how it is shown --------------------------------------------------------------------------------------------------


def head(name: str, what: str) -> None:
    """Print the line above all that is said of a thing."""
    text = Text(filled(f"{name}, {what}", 0))
    text.stylize("bold", 0, len(name))
    out.print(text, soft_wrap=True)


def line(text: str, indent: int = 2) -> None:
    """Print a paragraph."""
    out.print(filled(text, indent), markup=False, soft_wrap=True)


def filled(text: str, indent: int) -> str:
    """Return a paragraph broken between words; what is longer than a line, as an id of a test, stays whole."""
    space = " " * indent
    return textwrap.fill(
        text,
        out.width,
        initial_indent=space,
        subsequent_indent=space,
        break_long_words=False,
        break_on_hyphens=False,
    )


def in_words(owners: Sequence[str]) -> str:
    """Return whose it is: "chapters 3 to 5; study 1/phong". Chapters in a row are one."""
    numbers = [int(which) for which in owners if "/" not in which]
    rows: list[list[int]] = []
    for number in numbers:
        if rows and number == rows[-1][-1] + 1:
            rows[-1].append(number)
        else:
            rows.append([number])
    said = [str(row[0]) if len(row) == 1 else f"{row[0]} to {row[-1]}" for row in rows]
    beside = [which for which in owners if "/" in which]
    words = []
    if said:
        words.append(f"chapter{'s' * (len(numbers) > 1)} {', '.join(said)}")
    if beside:
        words.append(f"{'studies' if len(beside) > 1 else 'study'} {', '.join(beside)}")
    return "; ".join(words)


def show_term(entry: Entry) -> None:
    """Print an entry of the glossary, with the line of the README that introduces it."""
    head(entry.name, f"a term of chapter {entry.chapter}")
    line(entry.says)
    if entry.unit:
        line(f"Unit: {entry.unit}.")
    if entry.also:
        line(f"Also called {', '.join(entry.also)}.")
    readme = chapters.folder_of(entry.chapter) / "README.md"
    text = readme.read_text("utf-8") if readme.is_file() else ""
    for use in glossary.first_uses(text, [entry]):
        line(f"{readme.relative_to(ROOT).as_posix()}:{text.count(chr(10), 0, use.start) + 1}")


def show_setting(name: str, owners: dict[str, Knob]) -> None:
    """Print what is known of a setting; where chapters and studies mean different things by it, each by itself."""
    alike: dict[Knob, list[str]] = defaultdict(list)
    for which, record in owners.items():
        alike[record].append(which)
    for index, (record, found) in enumerate(alike.items()):
        if index:
            out.print()
        head(name, f"a setting of {in_words(found)}")
        line(f"{record.doc[:1].upper()}{record.doc[1:].rstrip('.')}.")
        unit = f" Unit: {record.unit}." if record.unit else ""
        line(f"Values: {record.range_text()}. Default: {text_of(record.default)}.{_truest(record)}{unit}")
        newest = [one for one in found if "/" not in one][-1:] or found[-1:]
        if values := preset_values(name, newest[0]):
            line(f"Presets of {in_words(newest)}: {values}.")
        line(f"Set by --set {name}=VALUE, or in the panel of the window; by no environment variable.")
        line(f"./strata run {newest[0]} --set {name}={text_of(record.default)}")


def _truest(record: Knob) -> str:
    return "" if record.reference is None else f" The truest is {text_of(record.reference)}."


def text_of(value: object) -> str:
    """Return a value as it is typed."""
    return ("on" if value else "off") if isinstance(value, bool) else f"{value}"


def preset_values(name: str, which: str) -> str:
    """Return what each preset of a chapter makes of a setting, "low 1, high 4"; "" where all do the same."""
    kind = chapters.settings_class(chapters.parse(which))
    values = {one: text_of(flat(preset(kind, one))[name]) for one in getattr(kind, "PRESETS", ())}
    return ", ".join(f"{one} {value}" for one, value in values.items()) if len({*values.values()}) > 1 else ""


def show_feature(feature: Feature) -> None:
    """Print the tests that hold a feature, by file, what became of them, and whom they are about."""
    count = len(feature.tests)
    held = f"{count} test{'s' * (count != 1)} hold{'s' * (count == 1)}" if count else "no test holds yet"
    head(feature.slug, f"a feature that {held}")
    if feature.row:
        line(f"{feature.row.title}.")
    if owners := owners_of(feature):
        line(f"In {in_words(owners)}.")
    record = results.newest(results.read(), results.read(results.own_path()))
    states = features.states(feature, record).items()
    went = "; ".join(f"{results.BACKENDS[backend]}: {results.said(counts)}" for backend, counts in states)
    line(f"Last results: {went}." if went else "No results are kept: ./strata test runs the tests.")
    files: dict[str, list[str]] = defaultdict(list)
    for test in feature.tests:
        path, _, name = test.name.partition("::")
        files[path].append(name)
    for path, names in files.items():
        line(path)
        says = sentences(ROOT / path)
        for name in names:
            line(name, 4)
            if says.get(name):
                line(says[name], 6)


def sentences(path: Path) -> dict[str, str]:
    """Return the first sentence that each function of a file says of itself; "" where it says nothing."""
    tree = ast.parse(path.read_text("utf-8"))
    found = {
        node.name: ast.get_docstring(node) or ""
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
    }
    return {
        name: re.split(r"(?<=[.])\s", " ".join(text.split()), maxsplit=1)[0] for name, text in found.items()
    }


def owners_of(feature: Feature) -> list[str]:
    """Return the chapters that a feature belongs to, and the studies that show it."""
    beside = [
        f"{number}/{name}"
        for number in chapters.available()
        for name, study in studies.available(number).items()
        if feature.slug in study.features
    ]
    return [*map(str, feature.chapters), *beside]


def show_area(area: str, slugs: Sequence[str]) -> None:
    """Print the features of an area."""
    head(area, f"an area of {len(slugs)} feature{'s' * (len(slugs) > 1)}")
    line(", ".join(slugs))


def show_part(number: int, part: str) -> None:
    """Print which chapter adds something."""
    head(part, f"what chapter {number} adds")
    line(f"{chapters.title_of(number)}: ./strata list {number} shows the lesson.")


def show_variable(name: str) -> None:
    """Print what an environment variable is for."""
    head(name, "an environment variable")
    line(VARIABLES[name])


def show_names() -> None:
    """Print all names, by what they are."""
    by_chapter: dict[int, list[str]] = defaultdict(list)
    for entry in glossary.read().values():
        by_chapter[entry.chapter].append(entry.name)
    for number, names in sorted(by_chapter.items()):
        _list(f"Terms of chapter {number}", names)
    found = settings()
    _list(
        "Settings of chapters",
        [name for name, owners in found.items() if any("/" not in one for one in owners)],
    )
    _list(
        "Settings of studies", [name for name, owners in found.items() if all("/" in one for one in owners)]
    )
    _list("Features that tests hold, by area", [thing.name for thing in _features() if thing.kind == "area"])
    for number in chapters.available():
        _list(f"What chapter {number} adds", chapters.lesson(number).adds)
    _list("Environment variables", VARIABLES)
    out.print("./strata explain NAME tells more of each; an area, what features it has.")


def _list(title: str, names: Iterable[str]) -> None:
    out.print(f"[bold]{escape(title)}[/bold]")
    line(", ".join(names))
    out.print()
