"""The answers of a prediction: the file in which a reader writes them, and how they are held to the recorded run."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from common.errors import UserError
from common.names import suggest
from tools.exercises import Answer, Exercise, Question

FILE, RECORDED = "answer.toml", "recorded.toml"


def questions_file(exercise: Exercise, folder: str) -> bytes:
    """Return the file with the questions, as an exercise begins; `folder` is how commands name its folder."""
    parts = [
        f"# {exercise.title}\n# Write what you expect behind each name before you look; then: strata check {folder}"
    ]
    for number, question in enumerate(exercise.questions, 1):
        parts.append(f'\n# {number}. {question.text}\n# {question.form}\n{question.name} = ""')
    return ("\n".join(parts) + "\n").encode()


def judge(exercise: Exercise, file: Path, shown: str) -> str | None:
    """Return which of the answers in a file, which the user calls `shown`, is missing or wrong; None if all are right.

    Raises UserError where the file cannot be read, or answers something that was not asked.
    """
    given = read(exercise, file, shown)
    expected = recorded(exercise)
    for question in exercise.questions:
        answer = given.get(question.name, "")
        if answer == "":
            return f"{question.name} has no answer yet: {question.text} Write {question.form} into {shown}."
        if problem := malformed(question, answer):
            return f"{question.name} = {json.dumps(answer)} is no answer: {problem}."
    wrong = [one.name for one in exercise.questions if not right(one, given[one.name], expected[one.name])]
    if not wrong:
        return None
    rest = f" The other {len(given) - len(wrong)} are right." if len(given) > len(wrong) else ""
    return f"The run says otherwise about {' and '.join(wrong)}.{rest}"


def read(exercise: Exercise, path: Path, shown: str) -> dict[str, Any]:
    """Return what a reader answered."""
    if not path.is_file():
        raise UserError(
            f"{shown} is gone: `strata exercise {exercise.spoken} --into NEW-FOLDER` makes another one."
        )
    try:
        given = tomllib.loads(path.read_text("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(
            f'{shown} cannot be read: {error}; a text stands in quotes, as name = "text".'
        ) from None
    names = [question.name for question in exercise.questions]
    for name in given:
        if name not in names:
            raise UserError(f"{shown}: nobody asked for {name!r}{suggest(name, names)}.".replace("?.", "?"))
    return given


def malformed(question: Question, answer: Any) -> str | None:
    """Return why something can be no answer to a question, None if it can be one."""
    if question.choices:
        return None if answer in question.choices else f"write {question.form}"
    number = isinstance(answer, int | float) and not isinstance(answer, bool) and math.isfinite(answer)
    return None if number else "write a number, without quotes"


def right(question: Question, answer: Answer, expected: Answer) -> bool:
    """Whether an answer agrees with the run."""
    if isinstance(answer, str) or isinstance(expected, str):
        return answer == expected
    return abs(answer - expected) <= question.within * abs(expected) + 1e-9


def recorded(exercise: Exercise) -> dict[str, Answer]:
    """Return the answers of a prediction as its run gave them."""
    told = tomllib.loads((exercise.folder / RECORDED).read_text("utf-8"))
    found: dict[str, Answer] = told["answers"]
    return found


def recorded_file(answers: Mapping[str, Answer], made_on: str) -> bytes:
    """Return the file that keeps a run's answers."""
    lines = [f"{name} = {json.dumps(answer)}" for name, answer in answers.items()]
    return "\n".join(
        [
            "# What the run of `measure` in check.py said: `strata exercise N NAME --remake answers` makes it again.",
            f"made_on = {json.dumps(made_on)}",
            "",
            "[answers]",
            *lines,
            "",
        ]
    ).encode()
