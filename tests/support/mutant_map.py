"""Which tests run which lines: the map that mutants are tried by, and the choice of tests for one of them.

    out/mutants/map.jsonl    one line for each file of tests, the last one counts:
        {"file": "tests/common/test_names.py", "blob": "1a2b...", "at": "3c4d...", "devices": {...},
         "tests": [{"id": ..., "setup": 0.1, "seconds": 0.2, "lines": {"common/names.py": "3-7,9"}}]}

A file of tests is measured anew when its text has changed since. Files of the product may change: their lines are
followed from the text that they had at the commit `at`, and a new line counts as its function's other lines do.
Tests that did not pass while they were measured are left out, since they can notice nothing.
"""

from __future__ import annotations

import ast
import difflib
import json
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from tests.support.mutant_texts import Mutant
from tools.snapshots.history import call, git

BUDGET_S = 45.0
"""For the tests of one mutant, as long as they took while they were measured."""
FILE_S = 0.3
"""To collect one more file of tests."""
HASHES = frozenset({"tests/site/test_pictures.py::test_no_picture_is_out_of_date"})
"""Tests that compare hashes of the product's files. They fail with every mutant, and check nothing that it does."""
WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")
RARE = 0.5
"""A word that a larger part of the tests have does not choose among them."""
LATER = re.compile(r"(?<=\.py)::(ch\d\d)(?=::)")
"""What an id says of a test that runs for a later chapter than its own."""


@dataclass(frozen=True)
class Test:
    """One test that passed: its seconds without its set-up, those of the set-up, and how many lines it runs in all."""

    id: str
    setup: float
    seconds: float
    lines: int

    @property
    def file(self) -> str:
        return self.id.partition("::")[0]

    @property
    def group(self) -> tuple[str, str]:
        """The tests that share the fixtures of a module: those of a file, a chapter and a variant."""
        later = LATER.search(self.id)
        variant = re.search(r"\[(vulkan|without-all|gl|deferred)\b", self.id)
        return f"{self.file}::{later[1] if later else ''}", variant[1] if variant else ""


@dataclass
class Measured:
    """The entry of one file of tests."""

    blob: str
    at: str
    devices: Mapping[str, str]
    tests: list[Test] = field(default_factory=list)
    ran: dict[str, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))
    """File of the product -> id of a test -> the lines that the test runs in it, as they are written."""


def entry(
    file: str, blob: str, at: str, devices: Mapping[str, str], tests: Iterable[Mapping[str, Any]]
) -> str:
    """Return the line of the map for a file of tests."""
    kept = [
        {
            "id": one["id"],
            "setup": round(one["setup"], 3),
            "seconds": round(one["seconds"], 3),
            "lines": one["lines"],
        }
        for one in tests
        if one["outcome"] == "passed"
    ]
    return json.dumps({"file": file, "blob": blob, "at": at, "devices": devices, "tests": kept}) + "\n"


def numbers(text: str) -> set[int]:
    """Return the lines that "3-7,9" names."""
    found: set[int] = set()
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        found.update(range(int(first), int(last or first) + 1))
    return found


class Map:
    """The map as far as it holds for the commit `head` of the clone `root`."""

    def __init__(self, path: Path, root: Path, head: str) -> None:
        self.path, self.root, self.head = path, root, head
        self.files: dict[str, Measured] = {}
        self.read()
        self.old_line = cache(self._old_line)
        self.text = cache(self._text)

    def read(self) -> None:
        """Read the file of the map, without what does not hold any more."""
        there = blobs(self.root, self.head)
        self.files.clear()
        for line in self.path.read_text("utf-8").splitlines() if self.path.is_file() else []:
            try:
                one = json.loads(line)
            except ValueError:  # the run was ended while it wrote
                continue
            if there.get(one["file"]) != one["blob"]:
                continue
            found = Measured(one["blob"], one["at"], one["devices"])
            for test in one["tests"]:
                if test["id"] in HASHES:
                    continue
                count = sum(len(numbers(lines)) for lines in test["lines"].values() if lines != "*")
                found.tests.append(Test(test["id"], test["setup"], test["seconds"], count))
                for file, lines in test["lines"].items():
                    found.ran[file][test["id"]] = lines
            self.files[one["file"]] = found

    def missing(self, wanted: Iterable[str]) -> list[str]:
        """Return those of some files of tests that are still to be measured."""
        return [file for file in wanted if file not in self.files]

    def covering(self, file: str, lines: Collection[int], chosen: Collection[str] = ()) -> dict[str, Test]:
        """Return by id the tests that run one of these lines of a file; of all files of tests, or of those chosen."""
        found: dict[str, Test] = {}
        for name, measured in self.files.items():
            if file not in measured.ran or (chosen and name not in chosen):
                continue
            followed = self.old_line(measured.at, file)
            old = {place for line in lines if (place := followed(line)) is not None}
            ids = {test for test, text in measured.ran[file].items() if text == "*" or old & _numbers(text)}
            # A shader is read when a module's fixture opens a chapter, and drawn with by all tests of the module.
            groups = set() if file.endswith(".py") else {one.group for one in measured.tests if one.id in ids}
            found |= {one.id: one for one in measured.tests if one.id in ids or one.group in groups}
        return found

    def _old_line(self, at: str, file: str) -> Callable[[int], int | None]:
        """Return what leads from a line of a file now to the line that it was at another commit."""
        before, now = (self.text(commit, file) for commit in (at, self.head))
        if before == now:
            return lambda line: line
        lines: dict[int, int] = {}
        matcher = difflib.SequenceMatcher(None, before.splitlines(), now.splitlines(), autojunk=False)
        for old, new, count in matcher.get_matching_blocks():
            lines.update((new + i + 1, old + i + 1) for i in range(count))
        return lines.get

    def _text(self, commit: str, file: str) -> str:
        """Return a file of a commit; "" where it has none."""
        done = call("cat-file", "blob", f"{commit}:{file}", folder=self.root)
        return "" if done.returncode else done.stdout.decode("utf-8", "replace")

    def named(self, file: str, chosen: Collection[str] = ()) -> dict[str, Test]:
        """Return by id the tests of the files that are named after a file of the product, or that name it."""
        *folders, name = Path(file).with_suffix("").parts
        module, package = ".".join((*folders, name)), ".".join(folders)
        by_name = re.compile(
            rf"\b{re.escape(module)}\b|from {re.escape(package)} import .*\b{re.escape(name)}\b"
        )
        return {
            test.id: test
            for one, measured in self.files.items()
            if (not chosen or one in chosen)
            and (
                f"{Path(one).stem}_".startswith(f"test_{name}_") or by_name.search(self.text(self.head, one))
            )
            for test in measured.tests
        }

    @property
    def devices(self) -> dict[str, str]:
        """What the tests drew with when they were measured."""
        return {name: device for one in self.files.values() for name, device in one.devices.items()}


_numbers = cache(numbers)


def blobs(root: Path, commit: str) -> dict[str, str]:
    """Return the hash of each file of a commit."""
    text = git("ls-tree", "-r", "-z", commit, folder=root).decode("utf-8", "surrogateescape")
    rows = (row.partition("\t") for row in text.split("\0") if row)
    return {name: head.split()[2] for head, _, name in rows}


def tiers(found: Map, mutant: Mutant, text: str, chosen: Collection[str] = ()) -> list[dict[str, Test]]:
    """Return the tests that may notice a mutant, the nearest ones first; [] if no test runs its line.

    `text` is that of the file. What runs at import is noticed by the tests of what uses it.
    """
    wanted: list[Collection[int]] = []
    if mutant.function is None:
        wanted += [mutant.uses, _in_functions(text), range(1, text.count("\n") + 2)]
    else:
        wanted.append(range(mutant.span[0], mutant.span[1] + 1))
    tests = [found.covering(mutant.file, lines, chosen) for lines in wanted]
    if mutant.function is not None and not tests[0] and _is_new(found, mutant):
        tests.append(found.covering(mutant.file, range(mutant.function[0], mutant.function[1] + 1), chosen))
    if mutant.function is None:
        tests.append(found.named(mutant.file, chosen))
    if twin := first_of_equals(found, mutant.file):
        tests += [for_chapter(found.covering(twin, lines, chosen), mutant.file) for lines in wanted]
    return [one for one in tests if one]


def nearest(found: Map, mutant: Mutant, text: str, chosen: Collection[str] = ()) -> list[dict[str, Test]]:
    """Return the same tests, and before them those of these that are about the mutant, by their words.

    Hundreds of tests run a line of a renderer. Those that say what it must do most often have its words, as the name of
    a knob or of the function, and stand in a file that is named after the mutant's file, or names it.
    """
    found_tiers = tiers(found, mutant, text, chosen)
    named = found.named(mutant.file, chosen)
    every = {name: test for tests in found_tiers for name, test in tests.items()}
    there = {name: test for name, test in every.items() if LATER.sub("", name) in named}
    about = words_of(mutant, text)
    saying = {name: test for name, test in every.items() if about & _words(found, name)}
    if len(saying) > RARE * len(every):
        saying = {}  # a word that most tests have tells nothing
    both = {name: test for name, test in saying.items() if name in there}
    return [tests for tests in (both, saying, there) if tests] + found_tiers


def words_of(mutant: Mutant, text: str) -> set[str]:
    """Return the words that tests of a mutant have: those of its string, and the name of its function."""
    found = {word for word in WORD.findall(mutant.before) if mutant.before[:1] in "\"'"}
    if mutant.function is not None and mutant.file.endswith(".py"):
        kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
        found |= {
            one.name.strip("_")
            for one in ast.walk(ast.parse(text))
            if isinstance(one, kinds) and one.body[0].lineno <= mutant.line <= (one.end_lineno or 0)
        }
    return {word for word in found if len(word) > 3}


def _words(found: Map, test: str) -> frozenset[str]:
    """Return the words of a test's function, with its decorators."""
    name = re.search(r"::(test\w+)", test)
    return _words_of_file(found, test.partition("::")[0]).get(name[1] if name else "", frozenset())


@cache
def _words_of_file(found: Map, file: str) -> dict[str, frozenset[str]]:
    """Return the words of each test of a file, with those of the file's values and functions that it names."""
    text = found.text(found.head, file)
    lines = text.splitlines()
    own: dict[str, set[str]] = {}
    for one in ast.parse(text).body:
        targets = (
            one.targets
            if isinstance(one, ast.Assign)
            else [one.target]
            if isinstance(one, ast.AnnAssign)
            else []
        )
        names = [target.id for target in targets if isinstance(target, ast.Name)]
        marks: list[ast.expr] = []
        if isinstance(one, ast.FunctionDef):
            names, marks = [one.name], one.decorator_list
        begin = min([one.lineno, *(mark.lineno for mark in marks)])
        said = {part.strip("_") for part in WORD.findall("\n".join(lines[begin - 1 : one.end_lineno]))}
        own |= dict.fromkeys(names, said)
    return {
        name: frozenset(said.union(*(own[other] for other in said & own.keys())))
        for name, said in own.items()
        if name.startswith("test")
    }


def _is_new(found: Map, mutant: Mutant) -> bool:
    """Whether a statement was not there when any test that runs its file was measured."""
    commits = {one.at for one in found.files.values() if mutant.file in one.ran}
    span = range(mutant.span[0], mutant.span[1] + 1)
    return bool(commits) and all(
        found.old_line(at, mutant.file)(line) is None for at in commits for line in span
    )


def first_of_equals(found: Map, file: str) -> str:
    """Return the file of the earliest chapter that has the same text as this one of a later chapter; "" for none.

    Tests of a module run once for each content. A mutant is another content: the tests of its equal run for it.
    """
    return _equals(found.root, found.head).get(file, "")


@cache
def _equals(root: Path, head: str) -> dict[str, str]:
    there = blobs(root, head)
    first: dict[tuple[str, str], str] = {}
    found = {}
    for file in sorted(there):
        parts = re.fullmatch(r"chapters/ch\d\d/(.*)", file)
        if parts and (earlier := first.setdefault((parts[1], there[file]), file)) != file:
            found[file] = earlier
    return found


def for_chapter(tests: Mapping[str, Test], file: str) -> dict[str, Test]:
    """Return tests of an earlier chapter as they run for the chapter of a file, whether or not they do."""
    label = file.split("/")[1]
    found = {}
    for test in tests.values():
        name, _, rest = LATER.sub("", test.id).partition("::")
        if name.split("/")[1] > label:
            continue
        id_ = f"{name}::{label}::{rest}"
        found[id_] = Test(id_, test.setup, test.seconds, test.lines)
    return found


@cache
def _in_functions(text: str) -> frozenset[int]:
    """Return the lines of a text that are inside of functions."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef)
    bodies = (
        (one.body[0].lineno, one.end_lineno or 0)
        for one in ast.walk(ast.parse(text))
        if isinstance(one, kinds)
    )
    return frozenset(line for first, last in bodies for line in range(first, last + 1))


def choose(nearest: Sequence[Mapping[str, Test]], budget_s: float = BUDGET_S) -> list[str]:
    """Return the ids of the tests for one mutant, in their order, which fit in the time.

    Of each file that test comes first that runs the fewest lines; then the fastest ones. Tests of one module stay
    together, so that its fixtures are made once.
    """
    kept: dict[str, Test] = {}
    setups: dict[tuple[str, str], float] = {}
    begun: set[object] = set()  # files and modules among the kept ones
    spent = 0.0
    for tests in nearest:
        for test in tests.values():
            setups[test.group] = max(test.setup, setups.get(test.group, 0.0))
        near = sorted(tests.values(), key=lambda test: (test.lines, test.seconds, test.id))
        firsts: dict[str, Test] = {}
        for test in near:
            firsts.setdefault(test.file, test)
        fast = sorted(near, key=lambda test: (test.seconds, test.lines, test.id))
        for test in (*firsts.values(), *fast):
            if test.id in kept:
                continue
            cost = test.seconds + FILE_S * (test.file not in begun)
            cost += setups[test.group] * (test.group not in begun)
            if spent + cost <= budget_s:
                kept[test.id] = test
                begun |= {test.file, test.group}
                spent += cost
    order = {group: place for place, group in reversed([*enumerate(test.group for test in kept.values())])}
    return [test.id for test in sorted(kept.values(), key=lambda test: order[test.group])]
