"""`strata new`: the next chapter, which begins as a byte copy of the last one.

Only two files are written anew: `__init__.py`, in which the chapter says what it is, and README.md, the lesson, with
the headings that every lesson has. Studies stay where they are.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from pathlib import Path

import chapters
from common.errors import UserError
from common.lessons import Lesson
from tools.cli.console import out, say
from tools.snapshots.history import History
from tools.snapshots.trees import lesson_of, numbers, put, read_tree

HEADINGS = {
    "What you will see": "one paragraph and a picture that the chapter draws",
    "Before you start": "the chapters, the mathematics and the device that this one needs",
    "The idea": "the technique, from the question to the formula, with its source",
    "Reading order": "the files of LESSON.reading with a sentence each, new ones first",
    "What changed": "against the chapter before: files, what is replaced, and why",
    "Try it": "commands with their pictures",
    "Time and error": "the figure of `strata bench`, and how to read it",
    "When it goes wrong": "mistakes that everybody makes here, and how they look",
    "Exercises": "at least three: predict, repair, extend",
    "Further reading": "papers, talks and code, with a sentence each",
}
"""The headings of a chapter's README.md in their order, and what belongs under each."""

GAP = "<!-- to write: "
"""How a place begins that is still empty."""

OWN = ("__init__.py", "README.md", "lecture.toml")


def run(root: Path, title: str | None = None, *, force: bool = False) -> int:
    """Make the chapter behind the last one of `root`, and say what to do next; return 0.

    Raises UserError if the last one is not finished or chapters/ differs from the last commit, unless `force`, and
    where all chapters are there.
    """
    number, folder = list(numbers(root).items())[-1]
    if number >= chapters.COUNT:
        raise UserError(f"All {chapters.COUNT} chapters are here: {folder.name} is the last.")
    if title is not None and not title.strip():
        raise UserError("--title is empty: say what the chapter is about, or leave it out.")
    if not force:
        refuse_unfinished(folder)
        refuse_changes(root)
    made = make(root, folder, number + 1, " ".join((title or f"Chapter {number + 1}").split()).rstrip("."))
    out.print(
        f"{root.name}/{made.name} is {root.name}/{folder.name} to the byte, without its studies and benches.",
        markup=False,
    )
    say(f"""Next:
  1. Commit it, so that everything after this is the lesson.
  2. {root.name}/{made.name}/__init__.py: say what it is, what it adds, what to read. README.md: write the lesson.
  3. A new feature is a new file; other files stay as they are. `strata diff {number} {number + 1}` shows the lesson.
  4. `strata run {number + 1}` draws what chapter {number} draws, until it does more; `strata test snapshots` holds
     the two in step.""")
    return 0


def make(root: Path, last: Path, number: int, title: str) -> Path:
    """Copy the folder `last` to chapter `number`, whole or not at all, and return the new folder."""
    place = root / chapters.folder_name(number)
    temporary = Path(tempfile.mkdtemp(dir=root, prefix=f".{place.name}."))
    try:
        for name, content in read_tree(last).items():
            if name not in OWN:
                put(temporary, name, content)
        put(temporary, "__init__.py", init(number, title, lesson_of(last)).encode())
        put(temporary, "README.md", readme(number, title).encode())
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o777 & ~umask)  # mkdtemp makes folders for one user alone
        temporary.rename(place)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return place


def init(number: int, title: str, last: Lesson) -> str:
    """Return the `__init__.py` of a new chapter: it needs what the last one needs, and adds nothing yet."""
    required, optional = _names(last.needs.required), _names(last.needs.optional)
    shown = json.dumps(title, ensure_ascii=False)
    sentence = title.replace("\\", "\\\\").replace('"""', "'''")
    return f'''"""Chapter {number}: {sentence}."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number={number},
    title={shown},
    adds=(),
    needs=Needs(required=frozenset({required}), optional=frozenset({optional})),
    reading=("renderer.py",),
)
'''


def _names(names: frozenset[str]) -> str:
    listed = ", ".join(json.dumps(name) for name in sorted(names))
    return f"{{{listed}}}" if listed else ""


def readme(number: int, title: str) -> str:
    """Return the README.md of a new chapter: headings, and under each what belongs there."""
    parts = [f"# Chapter {number}: {title}\n"]
    parts += [f"## {heading}\n\n{GAP}{what} -->\n" for heading, what in HEADINGS.items()]
    return "\n".join(parts)


def refuse_unfinished(folder: Path) -> None:
    """Raise UserError if a chapter is not finished: its lesson says nothing, or its README has gaps."""
    lesson, readme_path = lesson_of(folder), folder / "README.md"
    text = readme_path.read_text("utf-8") if readme_path.is_file() else ""
    missing = [name for name in lesson.reading if not (folder / name).is_file()]
    why = (
        "has no README.md"
        if not text
        else f"has a README.md with a place still to be written: {text.partition(GAP)[2].partition(' -->')[0]}"
        if GAP in text
        else "adds nothing (LESSON.adds)"
        if not lesson.adds
        else f"tells to read {missing[0]}, which is not there"
        if missing
        else ""
    )
    if why:
        raise UserError(
            f"{folder.name} is not finished: it {why}. The next chapter begins as its copy, "
            "so finish it first, or take --force."
        )


def refuse_changes(root: Path) -> None:
    """Raise UserError if something in chapters/ is not committed."""
    try:
        changed = History(root).changed()
    except UserError as error:
        raise UserError(f"{str(error).rstrip('.')}; --force makes the copy nevertheless.") from None
    if changed:
        more = f" and {len(changed) - 1} more" if len(changed) > 1 else ""
        raise UserError(
            f"{root.name}/{changed[0]}{more} is not committed: commit or put it aside, "
            "so that the new chapter's first commit is a copy and nothing else, or take --force."
        )
