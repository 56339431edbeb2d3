"""`strata list`: chapters, lessons, knobs, views and scenes; features are in `list_features`."""

from __future__ import annotations

from typing import Any

from rich.markup import escape

import chapters
from chapters import studies
from common.errors import UserError
from common.files.shader_files import shown_path
from common.reports.tables import table
from common.settings import describe, flat, knobs, preset
from tools.cli.console import out, quoted
from tools.diff.sentences import first_sentence
from tools.ledger import list_features
from tools.run.views import views_of


def run(
    chapter: str | None,
    *,
    settings: bool = False,
    views: bool = False,
    scenes: bool = False,
    features: bool = False,
    find: str = "",
    tests: bool = False,
    as_json: bool = False,
) -> int:
    """Print what was asked for; return the exit code. `find`, `tests` and `as_json` are about features alone."""
    if features:
        return list_features.run(chapter, find, tests=tests, as_json=as_json)
    for option, given in (("--find", find), ("--tests", tests), ("--json", as_json)):
        if given:
            raise UserError(f"{option} goes with --features: ./strata list --features {option}")
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
    elif chapter is not None:
        which = chapters.parse(chapter)
        show_study(which) if isinstance(which, str) else show_lesson(which)
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
    show_studies(which)
    shown = shown_path(folder) if isinstance(which, int) else which.spoken
    first = f"Read {shown}/README.md first, then" if (folder / "README.md").is_file() else f"Read in {shown}"
    made = table(escape(first), "file", "what it is")
    for name in lesson.reading:
        made.add_row(name, first_sentence(folder / name))
    out.print()
    out.print(made)


def show_studies(which: chapters.Whole) -> None:
    """Print the studies of a chapter or a fork with their ideas, in teaching order."""
    if studies.available(which):
        typed = quoted(f"{which}/NAME")
        made = table(escape(f"Studies, the way in: ./strata run {typed}"), "name", "its idea")
        for name, about in studies.available(which).items():
            made.add_row(name, about.idea)
        out.print()
        out.print(made)


def show_study(which: str) -> None:
    """Print what a study is about, where its files are, and what it can be asked for."""
    owner, name = studies.split(which)
    about = studies.study(which)
    place = studies.folder(owner) / name.replace("-", "_")
    out.print(f"[bold]Study {which}: {escape(about.title)}[/bold]\n")
    out.print(escape(about.idea), soft_wrap=True)
    files = sorted(path.name for path in place.iterdir() if path.is_file())
    out.print(f"Read:  {shown_path(place)}: {', '.join(files)}", soft_wrap=True)
    out.print(f"Gives:  {', '.join(about.outputs)}", soft_wrap=True)
    if knobs(studies.settings_class(which)):
        out.print(
            f"Knobs:  {', '.join(knobs(studies.settings_class(which)))} (./strata list {which} --settings)"
        )


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
    values = {name: flat(preset(kind, name)) for name in presets}
    for row in describe(kind):
        shown = [f"{values[name][row.name]}" for name in presets]
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
    out.print("./strata assets list shows models of others by name, and your own.")
