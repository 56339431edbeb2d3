"""The exercises of the chapters: what there is, and what each of them asks.

    chapters/exercises/ch01/codes-as-light/
      exercise.toml    kind, title, task, hints, what there is to learn from it
      start.patch      what makes the fault or the gap, against the chapter; without it the chapter is the start
      solution.patch   against the start; without it the chapter is the solution
      check.py         what is right when it is solved: `check(given)`, of a prediction `measure(given)`
      recorded.toml    of a prediction: the answers, from a run that `measure` repeats

They stand beside the chapters and not in them, since a chapter is copied to the next one and its exercises are not.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import chapters
from common.errors import UserError
from common.names import suggest

FOLDER = chapters.FOLDER / "exercises"
KINDS = {
    "predict": "write down what happens, then let it run",
    "repair": "find a fault that real renderers had",
    "extend": "add a small feature",
}
"""The kinds, in teaching order, and what the reader does."""

Answer = str | int | float


@dataclass(frozen=True)
class Question:
    """One question of a prediction, answered by one of `choices` or by a number, right `within` a part of it."""

    name: str
    text: str
    why: str
    choices: tuple[str, ...] = ()
    within: float = 0.0

    @property
    def form(self) -> str:
        """What an answer looks like."""
        if self.choices:
            return "one of " + ", ".join(f'"{choice}"' for choice in self.choices)
        return f"a number, right within {self.within:.0%}" if self.within else "a number"


@dataclass(frozen=True)
class Exercise:
    """One exercise. `lesson` is said when it is solved; on `backends` (none: no device is needed) it is checked.

    `validated`: it is about what the validation layers say, so without them it cannot be checked.
    """

    chapter: int
    name: str
    folder: Path
    order: int
    kind: str
    title: str
    task: str
    hints: tuple[str, ...]
    lesson: str
    backends: tuple[str, ...] = ("vulkan", "gl")
    validated: bool = False
    questions: tuple[Question, ...] = ()

    @property
    def spoken(self) -> str:
        """How it is called in commands: "1 codes-as-light"."""
        return f"{self.chapter} {self.name}"


def of_chapter(number: int, root: Path = FOLDER) -> list[Exercise]:
    """Return the exercises of a chapter, in teaching order."""
    folders = (root / chapters.folder_name(number)).glob("*/exercise.toml")
    return sorted((read(number, path.parent) for path in folders), key=lambda one: (one.order, one.name))


def find(number: int, name: str, root: Path = FOLDER) -> Exercise:
    """Return one exercise; raise UserError if there is none of this name."""
    known = {one.name: one for one in of_chapter(number, root)}
    if not known:
        raise UserError(f"Chapter {number} has no exercises yet.")
    if name not in known:
        near = suggest(name, known)
        raise UserError(
            f"Chapter {number} has no exercise {name!r}{near}"
            + ("" if near.endswith("?") else f"; `strata exercise {number}` lists them.")
        )
    return known[name]


def read(number: int, folder: Path) -> Exercise:
    """Return the exercise in a folder; raise ValueError where its exercise.toml lacks something."""
    told: dict[str, Any] = tomllib.loads((folder / "exercise.toml").read_text("utf-8"))
    questions = tuple(
        Question(**{**one, "choices": tuple(one.get("choices", ()))}) for one in told.pop("questions", ())
    )
    for name in ("hints", "backends"):
        if name in told:
            told[name] = tuple(told[name])
    try:
        made = Exercise(number, folder.name, folder, questions=questions, **told)
    except TypeError as error:
        raise ValueError(f"{folder / 'exercise.toml'}: {error}") from None
    if made.kind not in KINDS:
        raise ValueError(f"{folder / 'exercise.toml'}: there is no kind {made.kind!r}")
    return made
