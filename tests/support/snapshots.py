"""Runs the tests of a chapter for every later chapter too, since what chapter N can do, chapter N+1 can do.

A file in tests/chNN, or tests/stability/test_chNN.py, is collected once more for every chapter after NN: its imports
of `chapters.chNN` then lead to the later chapter, and the fixture `chapter` opens it. The ids say which it is:

    tests/ch01/test_materials.py::test_x[vulkan]          chapter 1
    tests/ch01/test_materials.py::ch02::test_x[vulkan]    the same test for chapter 2

Of these further runs

- a test marked `core` is always part. Each lesson has three to five: what they draw, every later chapter has to draw;
- a test marked `newest` is part for the newest chapter, in which the work is done, and for forks;
- a test marked `until(NN, why)` ends with chapter NN: the lesson after it replaces what is tested;
- a test of modules that are the same, byte for byte, in a chapter for which it ran is left out;
- a test that draws and bears no mark runs with `--long` alone; one that draws nothing always runs.

For the newest chapter and for forks a core test runs in all of its variants. For a chapter between its own and the
newest it runs in one, by turns: three chapters in a row have all three. `--long` and a first test run all of them.

To pytest, `--chapter=2` means the tests for one chapter alone (to `strata test` a first test: first.py beside this),
and `--chapter=FOLDER` those for a fork: a copy of a chapter, of which the ids say `::ch02-fork::`. It gets all tests
that were written for its chapter, and of those of chapters before it what any later chapter gets; modules that are the
same as the chapter's count as other ones.
"""

from __future__ import annotations

import ast
import re
import sys
import zlib
from collections import Counter, defaultdict
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from _pytest.assertion.rewrite import rewrite_asserts

import chapters
from chapters.folders import Folder
from common.errors import UserError
from tests.support import contents

DEVICES = {"chapter", "variant", "vulkan_instance", "vulkan_device", "gl_context"}
"""Fixtures of tests that draw; `variant` counts where a test is run once per variant."""

REASONS = {
    "same": "of modules that are the same as in an earlier chapter (a test runs once per distinct content)",
    "long": "that draw and are not in the core (--long runs them)",
    "newest": "that run for the newest chapter (--long runs them)",
    "replaced": "of what a later lesson replaces",
}


@dataclass(frozen=True)
class Subject:
    """What is tested: a chapter, as the package that holds it."""

    number: int
    package: str
    folder: Path
    which: Any = None
    """What `chapters.open` takes; None of a package that is no chapter."""

    @property
    def is_fork(self) -> bool:
        """Whether it is a reader's copy."""
        return isinstance(self.which, Folder)

    @property
    def label(self) -> str:
        """How ids name it: "ch02", "ch02-fork"."""
        return chapters.folder_name(self.number) + "-fork" * self.is_fork


def official() -> tuple[Subject, ...]:
    """Return the chapters that are here."""
    return tuple(subject_of(number) for number in chapters.available())


def subject_of(which: chapters.Whole) -> Subject:
    """Return a chapter or a fork as what is tested."""
    number = which if isinstance(which, int) else which.lesson.number
    return Subject(number, chapters.package_of(which), chapters.folder_of(which), which)


def chosen(words: Iterable[str]) -> list[Subject]:
    """Return what `--chapter` asks for; raise UsageError where there is none such."""
    try:
        return [subject_of(chapters.parse_chapter(word)) for word in words]
    except UserError as error:
        raise pytest.UsageError(f"--chapter: {error}") from None


def first_chapter(path: Path) -> int | None:
    """Return the number of the chapter that a file's tests were written for: 1 for tests/ch01/test_x.py and for
    tests/stability/test_ch01.py; None for tests of no chapter."""
    if path.parent.name == "stability":
        found = re.fullmatch(r"test_ch(\d\d)", path.stem)
    else:
        found = re.fullmatch(r"ch(\d\d)", path.parent.name)
    return int(found[1]) if found else None


def tested(node: pytest.Collector | pytest.Item) -> Subject:
    """Return the chapter or the fork that a test runs for."""
    module = node.getparent(LaterModule)
    if module is not None:
        return module.subject
    plugin: Snapshots = node.config.pluginmanager.getplugin("strata-snapshots")
    return plugin.written_for(node.path)


# --- the same file for another chapter --------------------------------------------------------------------------------


class _Renamed(ast.NodeTransformer):
    """Replaces the name of a package in imports, in attributes and in texts, but for what no later chapter has."""

    def __init__(self, old: str, new: str) -> None:
        self._old, self._new = old, new
        (self._parent, _, self._last), self._new_last = old.rpartition("."), new.rpartition(".")[2]
        self._own = tuple(f"{old}.{name}" for name in contents.STAR)
        self._in_text = re.compile(rf"\b{re.escape(old)}\b(?!\.(?:{'|'.join(contents.STAR)})\b)")

    def _name(self, name: str) -> str:
        below = name[len(self._old) :]
        if name.startswith(self._own):
            return name
        return self._new + below if name.startswith(self._old) and below[:1] in ("", ".") else name

    def visit_ImportFrom(self, node: ast.ImportFrom) -> ast.AST:
        if node.level == 0 and node.module:
            if node.module == self._parent:
                for alias in node.names:
                    if alias.name == self._last:
                        alias.name, alias.asname = self._new_last, alias.asname or self._last
            node.module = self._name(node.module)
        return node

    def visit_Import(self, node: ast.Import) -> ast.AST:
        for alias in node.names:
            alias.name = self._name(alias.name)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if node.attr == self._last and isinstance(node.value, ast.Name) and node.value.id == self._parent:
            node.attr = self._new_last
            return node
        return self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if isinstance(node.value, str):
            node.value = self._in_text.sub(self._new, node.value)
        return node


def load_for(path: Path, old: str, new: str, name: str, config: pytest.Config | None) -> ModuleType:
    """Return the module of a test file, run anew as `name`, in which package `old` stands for `new`.

    Assertions tell their values as in any test file.
    """
    source = path.read_bytes()
    tree = _Renamed(old, new).visit(ast.parse(source, filename=str(path)))
    rewrite_asserts(tree, source, str(path), config)
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        exec(compile(tree, str(path), "exec", dont_inherit=True), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    return module


class LaterModule(pytest.Module):
    """A file of tests, for a chapter after the one that it was written for, or for a fork."""

    subject: Subject
    written_for: Subject

    def _getobj(self) -> ModuleType:
        place = self.path.relative_to(self.config.rootpath).with_suffix("").parts
        name = f"{'.'.join(place)}@{self.subject.label}"
        try:
            module = load_for(self.path, self.written_for.package, self.subject.package, name, self.config)
        except ImportError as error:
            if self.subject.is_fork:
                raise  # pytest shows the fork's lines
            raise self.CollectError(
                f"{self.nodeid}: {error}. Where {self.subject.label} replaces what this file tests, mark it: "
                'pytestmark = pytest.mark.until(NUMBER, "why").'
            ) from error
        self.config.pluginmanager.consider_module(module)
        return module


class LaterChapters(pytest.File):
    """A file of tests, with a module for each further chapter; beside it stands the file's usual module."""

    def collect(self) -> Iterator[LaterModule]:
        plugin: Snapshots = self.config.pluginmanager.getplugin("strata-snapshots")
        last = _file_ends_with(self.path)
        for subject in plugin.further(self.path):
            if last is not None and subject.number > last:
                plugin.left_out["files"] += 1
                continue
            if plugin.leaves_all(self.path, subject):
                continue
            name = subject.label
            module = LaterModule.from_parent(self, path=self.path, name=name, nodeid=f"{self.nodeid}::{name}")
            module.subject, module.written_for = subject, plugin.written_for(self.path)
            yield module


# --- which of them run ------------------------------------------------------------------------------------------------


def ends_with(marks: Iterable[pytest.Mark]) -> int | None:
    """Return the last chapter for which a test with these marks runs; raise UsageError for a mark without a reason."""
    numbers = []
    for mark in marks:
        if len(mark.args) != 2 or not isinstance(mark.args[0], int) or not str(mark.args[1]).strip():
            raise pytest.UsageError(
                f"pytest.mark.until{mark.args}: write until(1, 'why a later chapter differs')."
            )
        numbers.append(mark.args[0])
    return min(numbers, default=None)


def _file_ends_with(path: Path) -> int | None:
    """Return what `pytestmark = pytest.mark.until(...)` of a file says, before anything of it is imported."""
    for node in contents.syntax(path).body:
        if isinstance(node, ast.Assign) and any(getattr(t, "id", None) == "pytestmark" for t in node.targets):
            for call in ast.walk(node.value):
                if isinstance(call, ast.Call) and getattr(call.func, "attr", None) == "until":
                    number: int = ast.literal_eval(call.args[0])
                    return number
    return None


def draws(item: pytest.Item) -> bool:
    """Whether a test needs a device."""
    used = {*getattr(item, "fixturenames", ())} - {"variant"}
    varied = "variant" in getattr(getattr(item, "callspec", None), "params", {})
    return varied or bool(used & DEVICES)


def turn_of(test: str, chapter: int) -> int:
    """Return a number that tells in which variant a test runs for a chapter: the same in every process."""
    return zlib.crc32(test.encode()) + chapter


def _chapter(item: pytest.Item) -> int:
    """Return the chapter that a test runs for, 0 for a test of no chapter."""
    module = item.getparent(LaterModule)
    return module.subject.number if module is not None else first_chapter(item.path) or 0


class Snapshots:
    """The pytest plugin: collects a chapter's tests for later chapters, and leaves out what need not run."""

    def __init__(
        self, all_: Iterable[Subject], chosen: Iterable[Subject] = (), long: bool = False, full: bool = False
    ) -> None:
        """`all_` are all chapters, `chosen` those to test, forks among them (none: all).

        All that are tested count as the newest where it is `full`.
        """
        self._all = {subject.number: subject for subject in all_}
        self.chosen = sorted({*chosen} or self._all.values(), key=lambda one: (one.number, one.label))
        self._long, self._full = long, full
        self._own: defaultdict[Path, list[pytest.Item]] = defaultdict(list)
        self.left_out: Counter[str] = Counter()

    def is_newest(self, subject: Subject) -> bool:
        """Whether a chapter runs core tests in all variants, and what is marked `newest`."""
        return self._long or self._full or subject.is_fork or subject.number == max(self._all)

    def takes_turns(self, item: pytest.Item) -> bool:
        """Whether a test is a core test that runs for a later chapter, in one variant alone."""
        module = item.getparent(LaterModule)
        is_core = item.get_closest_marker("core") is not None
        return module is not None and is_core and not self.is_newest(module.subject)

    def variants_for(self, definition: pytest.Item, names: Sequence[str]) -> Sequence[str]:
        """Return those of the variants of a test in which it runs for its chapter."""
        if not self.takes_turns(definition):
            return names
        path = definition.path
        turn = turn_of(f"{path.parent.name}/{path.name}::{definition.name}", tested(definition).number)
        return (names[turn % len(names)],)

    def written_for(self, path: Path) -> Subject:
        """Return the chapter that a file of tests was written for; raise ValueError if it is about none."""
        number = first_chapter(path)
        if number is None and path.parent.name == "reference":  # which runs for its own chapter alone
            number = first_chapter(path.parents[1] / "stability" / path.name)
        if number is None:
            raise ValueError(f"{path} is about no chapter")
        return self._all[number]

    def further(self, path: Path) -> list[Subject]:
        """Return the chapters and forks for which a file of tests runs besides its own chapter."""
        first = self.written_for(path)
        return [one for one in self.chosen if one.number >= first.number and one != first]

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(
        self, file_path: Path, parent: pytest.Collector
    ) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
        found = yield
        first = first_chapter(file_path)
        if first is None or first not in self._all or not found:
            return found
        found = found if self._all[first] in self.chosen else []
        if self.further(file_path):
            found.append(LaterChapters.from_parent(parent, path=file_path))
        return found

    def pytest_itemcollected(self, item: pytest.Item) -> None:
        """Note the tests of a file's own chapter: they come before those for later chapters."""
        if item.getparent(LaterModule) is None:
            self._own[item.path].append(item)

    def leaves_all(self, path: Path, subject: Subject) -> bool:
        """Whether no test of a file would be kept for a further chapter; its own tests, which are known, tell.

        The module of such a file need not be made: with twelve chapters that is half of the time of collecting.
        """
        reasons = [self._why_not(item, subject) for item in self._own[path]]
        if not reasons or not all(reasons):
            return False
        self.left_out.update(reasons)
        return True

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Leave out what need not run, and bring the tests of one chapter together.

        pytest sorts tests of one file by the parameters that their module shares, and takes all modules of a file for
        one: a device would be opened anew for nearly every test.
        """
        kept, left = [], []
        for item in items:
            module = item.getparent(LaterModule)
            why = self._why_not(item, module.subject) if module is not None else ""
            self.left_out[why] += bool(why)
            (left if why else kept).append(item)
        if left:
            config.hook.pytest_deselected(items=left)
        items[:] = sorted(kept, key=_chapter)

    def _why_not(self, item: pytest.Item, subject: Subject) -> str:
        """Return which of the REASONS there is to leave a test out for a further chapter; "" if there is none."""
        last = ends_with(item.iter_markers("until"))
        if last is not None and subject.number > last:
            return "replaced"
        if item.get_closest_marker("core") or subject.number == self.written_for(item.path).number:
            return ""
        if item.get_closest_marker("newest"):
            return "" if self.is_newest(subject) else "newest"
        if self._same_before(item.path, subject):
            return "same"
        return "long" if draws(item) and not self._long else ""

    def _same_before(self, path: Path, subject: Subject) -> bool:
        first = self.written_for(path)
        if subject.is_fork:
            return False
        mine = contents.digest(path, first.package, subject.folder)
        before = (one for n, one in self._all.items() if first.number <= n < subject.number)
        return any(contents.digest(path, first.package, one.folder) == mine for one in before)

    def summary(self) -> list[str]:
        """Return a sentence for each reason for which tests were left out."""
        counts = {kind: f"{self.left_out[kind]} tests" for kind in REASONS if self.left_out[kind]}
        if self.left_out["files"]:
            tests = f"{counts['replaced']} and " if "replaced" in counts else ""
            counts["replaced"] = f"{tests}{self.left_out['files']} whole files"
        return [
            f"later chapters: without {counts[kind]} {REASONS[kind]}." for kind in REASONS if kind in counts
        ]


def add_options(parser: pytest.Parser) -> None:
    """Add `--chapter`."""
    parser.addoption(
        "--chapter",
        action="append",
        default=[],
        metavar="N|DIR",
        help="of the tests of chapters, run those for this chapter or fork alone (several times: for these)",
    )
