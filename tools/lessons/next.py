"""`strata next`: where the reader is, what comes next, and which exercises are solved."""

from __future__ import annotations

from rich.markup import escape

import chapters
from common.errors import UserError
from common.files.shader_files import shown_path
from common.reports.tables import table
from tools.cli.console import out, say
from tools.exercises import of_chapter
from tools.lessons import progress
from tools.lessons.progress import Progress
from tools.lessons.sections import Part, all_parts


def run(
    chapter: int | None = None, *, done: bool = False, everything: bool = False, forget: bool = False
) -> int:
    """Show the section that comes next, or all of them; return 0.

    With a `chapter` the reader goes to it; with `done` the present section counts as read first. `forget` deletes what
    is known about the reader.
    """
    if forget:
        progress.forget()
        say("Nothing is known about what you have read and solved.")
        return 0
    if chapter is not None:
        known = progress.add(chapter=chapter)
    elif done:
        here = current(progress.load())
        if here is None:
            raise UserError("All sections are done already: `strata next N` goes to chapter N.")
        known = progress.add(read=[here.key])
    else:
        known = progress.load()
    if everything:
        show_all(known)
    else:
        show(known, chapter)
    return 0


def is_done(part: Part, known: Progress) -> bool:
    """Whether a section's exercise is solved, or the section was marked as read."""
    return f"{part.chapter}/{part.section.exercise}" in known.solved or part.key in known.read


def current(known: Progress) -> Part | None:
    """Return the first open section from the reader's chapter on, then of earlier chapters; None if all are done."""
    open_parts = [part for part in all_parts() if not is_done(part, known)]
    later = [part for part in open_parts if part.chapter >= known.chapter]
    return next(iter(later or open_parts), None)


def show(known: Progress, chapter: int | None = None) -> None:
    """Print the reader's section: what to read, to run and to solve, and what follows."""
    here = current(known)
    if here is None:
        out.print("You have done all sections. `strata next --all` lists them.", markup=False)
        return
    if chapter is not None and here.chapter != chapter:
        out.print(f"All sections of chapter {chapter} are done.", markup=False)
    section, lesson = here.section, chapters.lesson(here.chapter)
    out.print(f"[bold]Chapter {here.chapter}: {escape(lesson.title)}[/bold]")
    out.print(
        f"Section {here.number} of {here.count}: {section.title}, {section.minutes} minutes\n", markup=False
    )
    place = shown_path(here.folder)
    lines = [("read", f'{place}/README.md, the part "{section.title}"')]
    lines += [("files" * (i == 0), f"{place}/{name}") for i, name in enumerate(section.files)]
    lines += [("run", f"./strata {section.run}"), ("solve", f"./strata exercise {here.exercise} --into DIR")]
    for word, text in lines:
        out.print(f"  {word:5}  {text}", markup=False, soft_wrap=True)
    own = of_chapter(here.chapter)
    solved = [one.name for one in own if f"{here.chapter}/{one.name}" in known.solved]
    out.print(
        f"\nSolved in this chapter: {len(solved)} of {len(own)} exercises{listed(solved)}.", markup=False
    )
    after = following(here, known)
    then = f", and {after.section.title!r} follows" if after else ""
    say(f"Solving the exercise ends the section{then}; `strata next --done` goes on without it.")


def listed(names: list[str]) -> str:
    """Return names in brackets behind a space; "" for none."""
    return f" ({', '.join(names)})" if names else ""


def following(here: Part, known: Progress) -> Part | None:
    """Return the open section after this one."""
    parts = all_parts()
    return next((part for part in parts[parts.index(here) + 1 :] if not is_done(part, known)), None)


def show_all(known: Progress) -> None:
    """Print all sections with their state, and the solved exercises of each chapter."""
    here = current(known)
    made = table("The sections of all chapters", "chapter", "section", "minutes", "exercise", "state")
    for part in all_parts():
        state = "solved" if f"{part.chapter}/{part.section.exercise}" in known.solved else "read"
        made.add_row(
            str(part.chapter),
            escape(part.section.title),
            str(part.section.minutes),
            part.section.exercise,
            state if is_done(part, known) else "you are here" if part == here else "",
        )
    out.print(made)
    for number in chapters.available():
        own = of_chapter(number)
        solved = [one.name for one in own if f"{number}/{one.name}" in known.solved]
        out.print(
            f"Chapter {number}: {len(solved)} of {len(own)} exercises solved{listed(solved)}.", markup=False
        )
