"""The rules that keep the snapshots in step: what a chapter may change against the one before it.

    touched     a file that differs is in LESSON.reading, or in LESSON.plumbing with the reason why it had to follow;
                and what is in LESSON.plumbing does differ
    named       no file names the number of its own chapter, except __init__.py, README.md and lecture.toml
    relative    imports inside a chapter are relative and do not leave it
    monotone    files, public names of modules, fields of Settings and features stay, unless LESSON.replaces names
                them: "a feature", "shading/sky.py", "shading/sky.py:SkyPass", "settings.py:Settings.msaa"
    deletions   deleted lines are at most 0.15 of the inserted ones, those of new files included
    size        at most 400 lines of Python change inside files that existed before; a replaced one counts once
    long        a new file has at most 400 lines
    moved       no code goes from one file to another

Lines are those of Python and GLSL files. `__init__.py`, README.md and lecture.toml are each chapter's own; `studies/`
and `benches/` are outside of all this. Exceptions, at most three in all chapters, stand with their reasons in
`exceptions.toml`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from common.errors import UserError
from common.lessons import Lesson
from common.names import suggest
from tools.diff.diff import TreeDifference, tree_difference
from tools.diff.files import Source
from tools.snapshots.exceptions import read_exceptions
from tools.snapshots.trees import Tree, belongs, lesson_of, numbers, read_tree

RULES = ("touched", "named", "relative", "monotone", "deletions", "size", "long", "moved")
OWN = ("__init__.py", "README.md", "lecture.toml")
"""Files of which each chapter has its own."""

DELETIONS = 0.15
CHANGED_LINES = 400
LONGEST = 400
MOVED_LINES = 8
"""So many lines in a row, blank ones aside, that vanish in one file and appear in another are moved code."""


@dataclass(frozen=True)
class Broken:
    """One rule that a chapter does not keep; `text` says where and what to do."""

    chapter: str
    rule: str
    text: str

    def __str__(self) -> str:
        return f"[{self.rule}] {self.text}"


@dataclass(frozen=True)
class Chapter:
    """The files of one chapter, and its lesson."""

    number: int
    name: str
    lesson: Lesson
    files: Tree

    @cached_property
    def shared(self) -> Tree:
        """The files that the next chapter begins with."""
        return {name: content for name, content in self.files.items() if name not in OWN and belongs(name)}


def read_chapters(root: Path) -> list[Chapter]:
    """Return the chapters of `root` in order; a folder without `__init__.py` is none yet."""
    return [
        Chapter(number, folder.name, lesson_of(folder), read_tree(folder, studies=True))
        for number, folder in numbers(root).items()
        if (folder / "__init__.py").is_file()
    ]


def check(root: Path) -> list[Broken]:
    """Return what is broken in `root`, exceptions aside; an exception that nobody needs is broken, too.

    Raises UserError if the exceptions cannot be read.
    """
    found: list[Broken] = []
    known: list[Chapter] = []
    for chapter in read_chapters(root):
        found += check_alone(chapter)
        if known:
            found += check_step(known, chapter)
        known.append(chapter)
    excused = set()
    for one in read_exceptions(root).snapshot:
        if one.rule not in RULES:
            raise UserError(
                f"{root}/exceptions.toml: there is no rule {one.rule!r}{suggest(one.rule, RULES)}"
            )
        excused.add((one.chapter, one.rule))
    for chapter_name, rule in sorted(excused - {(one.chapter, one.rule) for one in found}):
        text = f"exceptions.toml excuses {chapter_name} from {rule!r}, which it keeps: take the entry out"
        found.append(Broken(chapter_name, rule, text))
        excused.discard((chapter_name, rule))
    return [one for one in found if (one.chapter, one.rule) not in excused]


def check_alone(chapter: Chapter) -> list[Broken]:
    """Return what a chapter breaks by itself."""
    found = []
    digits = rf"0?{chapter.number}(?!\d|\.\d)"
    named = re.compile(rf"\bch{digits}|\b[Cc]hapter {digits}|\bstrata(?:\.cmd)? \w+ {digits}")
    for path, content in chapter.files.items():
        place = f"{chapter.name}/{path}"
        if not Source(path, content).is_code:
            continue
        text = content.decode("utf-8", "replace")
        for line, words in enumerate(text.splitlines() if path in chapter.shared else (), start=1):
            if match := named.search(words):
                said = (
                    f"{place}:{line} says {match[0]!r}; the next chapter begins as a copy, where that is wrong: "
                    "write 'this chapter', or N for its number"
                )
                found.append(Broken(chapter.name, "named", said))
        for line, name in leaving(path, text) if path.endswith(".py") else ():
            said = f"{place}:{line} imports {name}: a chapter imports itself by dots, and no other chapter"
            found.append(Broken(chapter.name, "relative", said))
    return found


@cache  # most files are the same in all chapters
def leaving(path: str, text: str) -> tuple[tuple[int, str], ...]:
    """Return line and name of every import in a chapter's module that names a chapter, or goes up out of it."""
    return tuple(_leaving(path, text))


def _leaving(path: str, text: str) -> Iterator[tuple[int, str]]:
    depth = len(path.split("/"))
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = node.module or ""
            if node.level > depth:
                yield node.lineno, "." * node.level + module
            absolute = "chapters." if module == "chapters" else f"{module}."
            names = [] if node.level else [f"{absolute}{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            if re.match(r"chapters\.ch\d", name):
                yield node.lineno, name


def check_step(before: list[Chapter], after: Chapter) -> list[Broken]:
    """Return what `after` breaks against the last of `before`, which are all chapters before it."""
    last = before[-1]
    made = tree_difference(_sources(last), _sources(after))
    told = [*touched(last, after), *monotone(before, after), *lines(made)]
    fork = f"for experiments use `strata fork {after.number} my-{after.name}`"
    return [
        Broken(after.name, rule, f"{after.name} differs from {last.name} {text}; {fork}.")
        for rule, text in told
    ]


def _sources(chapter: Chapter) -> dict[str, Source]:
    return {path: Source(path, content) for path, content in chapter.shared.items()}


def touched(last: Chapter, after: Chapter) -> Iterator[tuple[str, str]]:
    """Yield (rule, text) of files that differ and are not told of, and of those that are told of and do not."""
    plumbing = after.lesson.plumbing
    differ = {
        path
        for path, content in last.shared.items()
        if path in after.shared and after.shared[path] != content
    }
    untold = sorted(differ - set(after.lesson.reading) - set(plumbing))
    if untold:
        yield (
            "touched",
            f"in {', '.join(untold)}, and neither LESSON.reading nor LESSON.plumbing tells of that",
        )
    for path in sorted(set(plumbing) - differ):
        what = "is as it was" if path in last.shared else "is new" if path in after.shared else "is not there"
        yield "touched", f"in LESSON.plumbing, which names {path}, and that {what}"


def monotone(before: list[Chapter], after: Chapter) -> Iterator[tuple[str, str]]:
    """Yield (rule, text) of what is gone without LESSON.replaces, and of entries there that name nothing."""
    last, replaced = before[-1], set(after.lesson.replaces)
    features = {slug for chapter in before for slug in chapter.lesson.adds}
    features -= {name for chapter in before for name in chapter.lesson.replaces}
    had = {path: names_of(path, content) for path, content in last.shared.items()}
    for slug in after.lesson.adds:
        if slug in features:
            yield "monotone", f"in LESSON.adds, which adds {slug!r} once more"
    gone = []
    for path, names in had.items():
        if path not in replaced and path not in after.shared:
            gone.append(path)
        elif path not in replaced:
            for name in sorted(names - names_of(path, after.shared[path])):
                if not {f"{path}:{name}", f"{path}:{name.partition('.')[0]}"} & replaced:
                    gone.append(f"{path}:{name}")
    if gone:
        yield "monotone", f"by the lack of {', '.join(gone)}, and LESSON.replaces does not tell of that"
    there = features | set(had) | {f"{path}:{name}" for path, names in had.items() for name in names}
    for name in sorted(replaced - there):
        yield (
            "monotone",
            f"in LESSON.replaces, which names {name!r}, and there was no such file, name or feature",
        )


@cache
def names_of(path: str, content: bytes) -> frozenset[str]:
    """Return the public names that a module defines; in a `settings.py` knobs and groups, too, as "Settings.msaa"."""
    if not path.endswith(".py"):
        return frozenset()
    found = set()
    for node in ast.parse(content).body:
        for name in _defined(node):
            found.add(name)
            if isinstance(node, ast.ClassDef) and path.rpartition("/")[2] == "settings.py":
                found |= {f"{name}.{field}" for part in node.body for field in _defined(part)}
    return frozenset(name for name in found if not any(part.startswith("_") for part in name.split(".")))


def _defined(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        return [node.name]
    targets = (
        node.targets
        if isinstance(node, ast.Assign)
        else [node.target]
        if isinstance(node, ast.AnnAssign)
        else []
    )
    return [name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)]


def lines(made: TreeDifference) -> Iterator[tuple[str, str]]:
    """Yield (rule, text) of steps that delete or change too much, of new files that are too long, of moved code."""
    deleted, inserted = made.deletions, made.insertions
    if deleted > DELETIONS * inserted:
        part = f"{deleted / inserted:.2f} of them" if inserted else "and none is inserted"
        yield (
            "deletions",
            f"by {deleted} deleted lines for {inserted} inserted ones, {part}, and {DELETIONS} may be",
        )
    python = {
        file.path: max(file.insertions, file.deletions)
        for file in made.of_status("changed", "renamed")
        if file.source.suffix == ".py"
    }
    if sum(python.values()) > CHANGED_LINES:
        where = ", ".join(
            f"{path} {python[path]}" for path in sorted(python, key=lambda path: -python[path])[:3]
        )
        yield (
            "size",
            f"by {sum(python.values())} lines of Python in files that existed before (most in {where}), "
            f"and {CHANGED_LINES} may be",
        )
    for file in made.of_status("new"):
        if file.source.is_code and file.insertions > LONGEST:
            yield "long", f"by the new file {file.path} of {file.insertions} lines, and {LONGEST} may be"
    for move in made.moves:
        if move.old_path != move.new_path and move.lines >= MOVED_LINES:
            places = f"{move.old_path}:{move.old_line} to {move.new_path}:{move.new_line}"
            yield "moved", f"by {move.lines} lines that went from {places}"
