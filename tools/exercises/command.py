"""`strata exercise` and `strata check`: list, begin, hint at, check and solve the exercises of a chapter."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rich.markdown import Markdown
from rich.markup import escape
from rich.syntax import Syntax

from chapters import folders
from common.errors import UserError
from common.reports.tables import table
from tools.cli.console import out, quoted, say
from tools.exercises import KINDS, Exercise, answers, checking, find, of_chapter
from tools.exercises.patches import difference, files_of, start_of, states
from tools.lessons import progress
from tools.snapshots import forks
from tools.snapshots.trees import Tree, put, write_files

RECORD = ".exercise.json"
TASK = "EXERCISE.md"
OWN = (TASK, answers.FILE)
"""Files of an exercise that are not the chapter's."""


@dataclass(frozen=True)
class Begun:
    """An exercise in a reader's folder; `hints` of it were shown."""

    exercise: Exercise
    folder: Path
    text: str
    hints: int = 0


def run(
    number: int,
    name: str | None,
    *,
    into: Path | None = None,
    hint: bool = False,
    solution: bool = False,
) -> int:
    """List a chapter's exercises, tell what one of them asks, or make a folder with it; return 0."""
    if name is None:
        if into is not None or hint or solution:
            raise UserError(f"Name an exercise, too; `strata exercise {number}` lists them.")
        show_all(number)
        return 0
    exercise = find(number, name)
    if into is not None:
        begin(exercise, into, solved=solution)
    elif solution:
        show_solution(exercise)
    elif hint:
        for count, text in enumerate(exercise.hints, 1):
            out.print(f"{count}. {text}", markup=False, soft_wrap=True)
    else:
        out.print(Markdown(task_text(exercise)))
        say(f"`strata exercise {exercise.spoken} --into {name}` makes a folder to work in.")
    return 0


def show_all(number: int) -> None:
    """Print the exercises of a chapter; raise UserError if it has none."""
    found = of_chapter(number)
    if not found:
        raise UserError(f"Chapter {number} has no exercises yet.")
    made = table(f"Exercises of chapter {number}", "name", "kind", "what it is about")
    for exercise in found:
        made.add_row(exercise.name, exercise.kind, escape(exercise.title))
    out.print(made)
    for kind, sentence in KINDS.items():
        if any(one.kind == kind for one in found):
            out.print(f"{kind}: {sentence}.", soft_wrap=True)
    out.print(
        f"\n`strata exercise {found[0].spoken}` tells what one asks; with `--into DIR` it makes a folder to work in, "
        "and `strata check DIR` says what is not right yet.",
        soft_wrap=True,
    )


PLACE = "FOLDER"
"""What stands in texts for the folder that the reader works in."""


def task_text(exercise: Exercise, folder: str = PLACE) -> str:
    """Return what an exercise asks, as Markdown, with its commands for `folder`."""
    task = exercise.task.strip().replace(PLACE, folder)
    return f"# {exercise.title}\n\n*Chapter {exercise.chapter}, {exercise.kind}*\n\n{task}\n"


def on_one_line(text: str) -> str:
    """Return a text without its line ends: the terminal has its own."""
    return " ".join(text.split())


def begin(exercise: Exercise, folder: Path, *, solved: bool = False) -> None:
    """Make a fork of the chapter with the start of an exercise in it, or with its solution."""
    both, shown = states(exercise), quoted(str(folder))
    files: Tree = dict(both.solution if solved else both.start)
    files[TASK] = task_text(exercise, shown).encode()
    if exercise.kind == "predict":
        files[answers.FILE] = (
            solved_answers(exercise, shown) if solved else answers.questions_file(exercise, shown)
        )
    fork = forks.make_fork(exercise.chapter, folder)
    base = files_of(exercise.chapter)
    write_files(
        fork.folder, {name: files.get(name) for name in {*base, *files} if files.get(name) != base.get(name)}
    )
    keep(Begun(exercise, fork.folder, str(folder)))
    out.print(f"{folder} has {'the solution' if solved else 'the exercise'}.", markup=False, soft_wrap=True)
    if not solved:
        what = (
            f"{folder / answers.FILE} has the questions" if exercise.kind == "predict" else "change its files"
        )
        say(
            f"{folder / TASK} says what to do; {what}, and `strata check {shown}` says what is not right yet."
        )


def solved_answers(exercise: Exercise, folder: str) -> bytes:
    """Return the file of a prediction with the run's answers."""
    text = answers.questions_file(exercise, folder).decode()
    for name, answer in answers.recorded(exercise).items():
        text = text.replace(f'\n{name} = ""', f"\n{name} = {json.dumps(answer)}")
    return text.encode()


def keep(begun: Begun) -> None:
    """Write down which exercise a folder has."""
    told = {"chapter": begun.exercise.chapter, "name": begun.exercise.name, "hints": begun.hints}
    put(begun.folder, RECORD, (json.dumps(told) + "\n").encode())


def begun_in(text: str) -> Begun:
    """Return the exercise in a folder; raise UserError if there is none in it."""
    folder = Path(text).expanduser().resolve()
    path = folder / RECORD
    if not folder.is_dir():
        raise UserError(f"There is no folder {text}; `strata exercise 1 NAME --into {text}` makes one.")
    if not path.is_file():
        raise UserError(
            f"{text} is no folder of an exercise; `strata exercise 1` lists those of chapter 1, and "
            "`strata exercise 1 NAME --into DIR` makes one."
        )
    try:
        told: dict[str, Any] = json.loads(path.read_text("utf-8"))
        chapter, name, hints = int(told["chapter"]), str(told["name"]), int(told["hints"])
    except (OSError, ValueError, KeyError, TypeError):
        raise UserError(f"{path} cannot be read: make the exercise again in a new folder.") from None
    return Begun(find(chapter, name), folder, text, hints)


def check(text: str, *, hint: bool = False, solution: bool = False) -> int:
    """Say what is not right yet in the folder of an exercise, and return 1; 0 if all is right.

    `hint` gives one more hint instead, `solution` all there is to know.
    """
    begun = begun_in(text)
    exercise = begun.exercise
    if hint:
        return next_hint(begun)
    if solution:
        show_solution(exercise)
        return 0
    if exercise.kind == "predict":
        wrong = answers.judge(exercise, begun.folder / answers.FILE, str(Path(text) / answers.FILE))
    else:
        which = folders.read(begun.folder, text)
        wrong = checking.check(exercise, which)
    if wrong is not None:
        out.print(f"Not right yet. {wrong.replace(PLACE, quoted(text))}", markup=False, soft_wrap=True)
        say(f"`strata check {quoted(text)} --hint` helps.")
        return 1
    out.print(f"All right. {on_one_line(exercise.lesson)}", markup=False, soft_wrap=True)
    show_reasons(exercise)
    try:
        progress.add(solved=[f"{exercise.chapter}/{exercise.name}"])
    except UserError as error:  # a home that cannot be written must not make a right solution wrong
        say(str(error))
    else:
        say("`strata next` shows what comes next.")
    return 0


def next_hint(begun: Begun) -> int:
    """Show one more hint than last time; return 0."""
    hints = begun.exercise.hints
    shown = min(begun.hints + 1, len(hints))
    for number in range(shown):
        out.print(f"{number + 1}. {hints[number]}", markup=False, soft_wrap=True)
    keep(replace(begun, hints=shown))
    left = len(hints) - shown
    more = f"{left} more: ask again." if left else "That was the last one; --solution shows the rest."
    say(more)
    return 0


def show_solution(exercise: Exercise) -> None:
    """Print what changes from the start to the solution, or the answers with their reasons."""
    if exercise.kind == "predict":
        for name, answer in answers.recorded(exercise).items():
            out.print(f"{name} = {json.dumps(answer)}", markup=False, soft_wrap=True)
    else:
        both = states(exercise)
        patch = difference(both.start, both.solution)
        if out.is_terminal:
            out.print(Syntax(patch, "diff", word_wrap=True, background_color="default"))
        else:  # a patch of which lines were broken is none
            out.print(patch, markup=False, soft_wrap=True)
    out.print(on_one_line(exercise.lesson), markup=False, soft_wrap=True)
    show_reasons(exercise)


def show_reasons(exercise: Exercise) -> None:
    """Print why a prediction's answers are what they are."""
    for question in exercise.questions:
        out.print(f"- {question.name}: {question.why}", markup=False, soft_wrap=True)


def remake(number: int, name: str, word: str) -> int:
    """Make a patch of an exercise from a fork ("start=FORK", "solution=FORK"), or its answers from a run ("answers").

    For those who write exercises; return 0.
    """
    exercise = find(number, name)
    what, _, fork = word.partition("=")
    if what == "answers" and not fork:
        if exercise.kind != "predict":
            raise UserError(f"{exercise.spoken} is no prediction: it has a start and a solution.")
        made, on = checking.measure(exercise)
        put(exercise.folder, answers.RECORDED, answers.recorded_file(made, on))
    elif what in ("start", "solution") and fork:
        files = forks.own_files(forks.read_fork(Path(fork)))
        own = {path: content for path, content in files.items() if path not in OWN}
        before = files_of(number) if what == "start" else start_of(exercise)
        put(exercise.folder, f"{what}.patch", difference(before, own).encode())
    else:
        raise UserError(f"{word!r} is none of start=FORK, solution=FORK and answers.")
    say(f"Made the {what} of {exercise.spoken} again.")
    return 0
