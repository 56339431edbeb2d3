"""`strata list`: chapters, lessons, knobs, scenes, and the features that tests hold."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from typing import Any

from rich.markup import escape

import chapters
from chapters import studies
from chapters.console import out, say
from chapters.sentences import first_sentence
from chapters.tables import table
from chapters.views import views_of
from common.errors import UserError
from common.paths import ROOT, cache_dir
from common.settings import describe, preset
from common.shader_files import shown_path

RESULTS = "features.json"
"""Name of the file, in the user's cache, in which a test run leaves what became of each feature's tests."""


def run(
    chapter: str | None,
    *,
    settings: bool = False,
    views: bool = False,
    scenes: bool = False,
    features: bool = False,
) -> int:
    """Print what was asked for; return the exit code."""
    if settings or views:
        if chapter is None:
            option = "--settings" if settings else "--views"
            raise UserError(f"{option} needs a chapter: ./strata list 1 {option}")
        if settings:
            show_settings(chapters.parse(chapter))
        else:
            show_views(chapters.parse_chapter(chapter))
    elif scenes:
        show_scenes()
    elif features:
        show_features()
    elif chapter is not None:
        which = chapters.parse(chapter)
        studies.show(which) if isinstance(which, str) else show_lesson(which)
    else:
        show_chapters()
    return 0


def show_chapters() -> None:
    """Print the chapters that are here."""
    made = table("Chapters", ">N", "title", "what it adds")
    for number in chapters.available():
        lesson = chapters.lesson(number)
        made.add_row(str(number), lesson.title, ", ".join(lesson.adds))
    out.print(made)
    out.print("./strata run N draws with one, ./strata list N shows its lesson.")


def show_lesson(which: chapters.Whole) -> None:
    """Print what a chapter, or that of a fork, teaches and in which order its files are read."""
    lesson = chapters.lesson(which)
    folder = chapters.folder_of(which)
    out.print(f"[bold]{escape(studies.spoken(which))}: {escape(lesson.title)}[/bold]\n")
    out.print("Adds:  " + escape(", ".join(lesson.adds)), soft_wrap=True)
    if lesson.replaces:
        out.print("Replaces:  " + escape(", ".join(lesson.replaces)), soft_wrap=True)
    needs = [
        *(f"{name} (required)" for name in sorted(lesson.needs.required)),
        *sorted(lesson.needs.optional),
    ]
    out.print("Uses:  " + escape(", ".join(needs) or "nothing beyond Vulkan 1.3"), soft_wrap=True)
    out.print("Gives:  " + ", ".join(chapters.outputs_of(which)))
    if isinstance(which, int):
        studies.show_all(which)
    shown = shown_path(folder) if isinstance(which, int) else which.spoken
    first = f"Read {shown}/README.md first, then" if (folder / "README.md").is_file() else f"Read in {shown}"
    made = table(escape(first), "file", "what it is")
    for name in lesson.reading:
        made.add_row(name, first_sentence(folder / name))
    out.print()
    out.print(made)


def decapitalised(text: str) -> str:
    """Return what begins a sentence as it stands within one; names keep their letters."""
    return text[:1].lower() + text[1:]


def show_settings(which: chapters.Which) -> None:
    """Print every knob of a chapter, a study or a fork, with the presets' values."""
    kind: Any = chapters.settings_class(which)
    presets = list(getattr(kind, "PRESETS", ()))
    if not describe(kind):
        out.print(f"{studies.spoken(which)} has no settings: there is nothing for --set.")
        return
    made = table(
        escape(f"Settings of {decapitalised(studies.spoken(which))}: --set name=value"),
        "name",
        "default",
        "range",
        "unit",
        "meaning",
    )
    for row in describe(kind):
        made.add_row(*(escape(text) for text in row))
    out.print(made)
    if not presets:
        return
    compared = table("Presets: --quality name (what differs)", "name", *presets)
    values = {name: preset(kind, name) for name in presets}
    for row in describe(kind):
        shown = [f"{getattr(values[name], row.name)}" for name in presets]
        if len(set(shown)) > 1:
            compared.add_row(row.name, *shown)
    out.print(compared)


def show_views(which: chapters.Whole) -> None:
    """Print what a chapter or a fork shows in place of the picture."""
    word = f'"{which}"' if " " in str(which) else which
    title = f"Views of {decapitalised(studies.spoken(which))}: ./strata run {word} --view name"
    made = table(escape(title), "name", "what it shows")
    for name, sentence in views_of(which).items():
        made.add_row(name, escape(sentence))
    out.print(made)


def show_scenes() -> None:
    """Print the scenes that the project makes itself."""
    import assets

    made = table(
        "Scenes: --scene name, or the path of a .gltf, .glb or .obj file",
        "name",
        ">triangles",
        "what it exercises",
    )
    for info in assets.SCENES.values():
        for size, triangles in info.sizes.items():
            default = size == info.default_size
            name = info.name if default else f"{info.name}:{size}"
            note = info.exercises if default else "the same, made on first use and kept"
            made.add_row(name, f"{triangles:,}", note)
    out.print(made)


def show_features() -> None:
    """Print each feature that some test holds, how many tests there are, and how they went when last run here."""
    tests = features_in_tests()
    results = last_results()
    made = table("Features that tests hold", "feature", ">tests", "last run here")
    for slug in sorted(tests):
        made.add_row(slug, str(tests[slug]), verdict(results.get("features", {}).get(slug)))
    out.print(made)
    if not results:
        say("No results yet: ./strata test writes them.")
    else:
        say(f"Last results: {results['when']}, commit {results['commit']}, {results['device']}.")


def features_in_tests() -> dict[str, int]:
    """Return how many test functions name each feature of the ledger."""
    found: dict[str, int] = defaultdict(int)
    for path in (ROOT / "tests").rglob("test_*.py"):
        for mark in re.finditer(r"mark\.feature\(([^)]*)\)", path.read_text("utf-8")):
            for slug in re.findall(r"[\"']([\w-]+/[\w-]+)[\"']", mark[1]):
                found[slug] += 1
    return dict(found)


def last_results() -> dict[str, Any]:
    """Return what the last test run left, or nothing."""
    folder = cache_dir("tests")
    try:
        found: dict[str, Any] = json.loads((folder / RESULTS).read_text("utf-8")) if folder else {}
    except (OSError, ValueError):
        return {}
    return found


def verdict(counts: dict[str, int] | None) -> str:
    """Return {"passed": 3, "skipped": 1} as words; a feature with a failing test has failed."""
    if not counts:
        return "not run"
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()) if count)
