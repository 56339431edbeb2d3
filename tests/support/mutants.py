"""`strata test --mutants N`: change one token of the product at a time, and see whether a test notices.

The mutants are drawn by a seed, which is the commit's hash unless another word is given: half of them change an
operator, half a constant. Each is tried in a copy of the clone below out/mutants/, by the tests that run its line
(mutant_map.py), as many as fit in the time. The map of tests and lines is made first where it is missing.

    killed       a test fails with the mutant, and the same tests pass without it
    time-out     the tests take 60 s, and without the mutant less than half of that: it counts as killed
    too slow     the tests take 60 s, and without the mutant about as long, or fail without it too: nothing is known
    survived     all tests pass, or no test runs the line
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import queue
import random
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backends import choice
from backends.selftest import verdicts
from common.errors import StrataError, UnsupportedError, UserError
from common.names import suggest
from common.paths import ROOT, asset_dir, write_whole
from tests.support import mutant_glsl, mutant_texts, mutant_trees
from tests.support.mutant_map import LATER, Map, blobs, choose, entry, nearest, tiers
from tests.support.mutant_texts import Mutant
from tests.support.mutant_trees import Ran, Tree
from tools.cli import console
from tools.ledger.testing import areas, path_of
from tools.snapshots.history import git

PRODUCT = ("backends", "chapters", "common", "tools")
SHADERS = ("shaders",)
"""Folders that hold shaders alone."""
APART = ("chapters/exercises/",)
"""Folders whose code is changed on purpose already."""
NAMED = ("tools/",)
"""Folders whose code has mutants only where files of tests are named: much of it places words and lines of drawings."""
LIMIT_S = 60.0
ROUNDS = 6
"""Runs of tests for a mutant that none of them notices, each within the limit."""
AT_ONCE = 12
"""Files of tests that are measured by one process, at most."""
MEASURE_S = 1500.0
"""For that process: such files take up to five minutes, and twice as long while their lines are traced."""
ATTEMPTS = 6
"""To try a mutant, without the tests that turned out to fail without it."""
FORMAT = 1


@dataclass(frozen=True)
class Verdict:
    """What became of a mutant: "killed", "time-out", "too slow" or "survived", by what, and in how many seconds."""

    mutant: Mutant
    result: str
    by: str
    seconds: float
    text: str
    """The line of the mutant, as it is without it."""

    @property
    def killed(self) -> bool:
        return self.result in ("killed", "time-out")


def _before(name: str) -> str:
    """Return the same file of the chapter before, whether or not there is one; "" of a file of no chapter."""
    chapter = re.match(r"chapters/ch(\d\d)/", name)
    return f"chapters/ch{int(chapter[1]) - 1:02}/{name[chapter.end() :]}" if chapter else ""


class Workshop:
    """A clone, its map of tests and lines, and the copies in which its mutants are tried."""

    def __init__(
        self, root: Path, jobs: int, product: Sequence[str] = PRODUCT, limit_s: float = LIMIT_S
    ) -> None:
        """Raise UserError where the clone has changes that no commit has."""
        self.root, self.product, self.limit_s = root, product, limit_s
        changed = git("status", "--porcelain", "-z", folder=root).decode("utf-8", "replace").split("\0")[0]
        if changed:
            raise UserError(f"Mutants are made of a commit, and {changed[3:]} differs from it: commit first.")
        self.commit = git("rev-parse", "HEAD", folder=root).decode().strip()
        self.folder = root / "out" / "mutants"
        self.folder.mkdir(parents=True, exist_ok=True)
        self.map = Map(self.folder / "map.jsonl", root, self.commit)
        self.devices: dict[str, str] = {}
        self.cache = self.folder / "cache"
        self.cache.mkdir(exist_ok=True)
        self._sound: set[str] = set()
        self._all = [Tree(root, self.folder / f"tree-{number}", self.commit) for number in range(jobs)]
        self._trees: queue.SimpleQueue[Tree] = queue.SimpleQueue()
        for tree in self._all:
            self._trees.put(tree)
        self._pool = ThreadPoolExecutor(jobs)
        shaders = os.environ.get("MESA_SHADER_CACHE_DIR") or self.folder / "mesa"
        assets = asset_dir()
        self._environment = {"MESA_SHADER_CACHE_DIR": str(shaders)}
        if assets is not None:
            self._environment["STRATA_ASSETS"] = str(assets.resolve())

    def stop(self) -> None:
        """End all runs that are under way, and begin no others."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        for tree in self._all:
            tree.stop()

    # --- the map ------------------------------------------------------------------------------------------------------

    def measure(self, files: Sequence[str]) -> None:
        """Bring the map up to date for these files of tests."""
        missing = self.map.missing(files)
        if not missing:
            return
        console.say(f"strata: measuring which lines the tests of {len(missing)} files run")
        size = min(AT_ONCE, -(-len(missing) // len(self._all)))
        shares = [missing[i : i + size] for i in range(0, len(missing), size)]
        there = blobs(self.root, self.commit)
        done = 0
        running = [self._pool.submit(self._in_parts, share) for share in shares]
        for ended in as_completed(running):  # what is known is kept, whatever else is still under way
            for share, ran in ended.result():
                done += len(share)
                failed = ran.failed
                told = f", without {counted(failed)} that failed" if failed else ""
                if not measured(ran):
                    why = f"it took {MEASURE_S:g} s" if ran.code is None else f"pytest ended with {ran.code}"
                    console.say(f"strata: not measured: {share[0]}: {why}, last in {ran.last or ran.broken}")
                    continue
                with self.map.path.open("a", encoding="utf-8") as stream:
                    for file in share:
                        tests = (one for one in ran.tests if one["id"].partition("::")[0] == file)
                        stream.write(entry(file, there[file], self.commit, ran.devices, tests))
                console.say(f"strata: measured {done} of {len(missing)} files in {ran.seconds:.0f} s{told}")
        self.map.read()

    def _in_parts(self, files: list[str]) -> list[tuple[list[str], Ran]]:
        """Measure files in one process; where a file ends that process, each file in one of its own."""
        ran = self._measured(files)
        if measured(ran) or len(files) == 1:
            return [(files, ran)]
        return [([file], self._measured([file])) for file in files]

    def _measured(self, files: Sequence[str]) -> Ran:
        tree = self._trees.get()
        try:
            return tree.run(files, MEASURE_S, self.cache, cover=self.product, environment=self._environment)
        finally:
            self._trees.put(tree)

    # --- mutants ------------------------------------------------------------------------------------------------------

    def sources(self) -> list[str]:
        """Return the files that mutants are made of.

        A file that a chapter carries on unchanged is left out: its tests run in the first chapter that has it, and the
        map of lines knows them by that file alone.
        """
        blob = blobs(self.root, self.commit)
        names = sorted(name for name in blob if blob[name] != blob.get(_before(name)))
        below = tuple(f"{part}/" for part in (*self.product, *SHADERS))
        kinds = (".py", *mutant_glsl.SUFFIXES)
        return [
            name
            for name in names
            if name.endswith(kinds) and name.startswith(below) and not name.startswith(APART)
        ]

    def draw(self, count: int, seed: str, chosen: Sequence[str] = ()) -> list[Mutant]:
        """Return mutants, drawn by the seed; where files of tests are `chosen`, of lines that their tests run."""
        groups: dict[bool, list[Mutant]] = {False: [], True: []}
        for file in self.sources():
            if not chosen and file.startswith(NAMED):
                continue
            if chosen and file not in {
                one for name in chosen if name in self.map.files for one in self.map.files[name].ran
            }:
                continue
            text = self.text(file)
            find = mutant_texts.mutants if file.endswith(".py") else mutant_glsl.mutants
            for one in find(text, file):
                groups[bool(mutant_texts.OPERATOR.fullmatch(one.before))].append(one)
        chance = random.Random(seed)
        drawn: list[Mutant] = []
        for group in groups.values():
            chance.shuffle(group)
        while len(drawn) < count and any(groups.values()):
            kind = chance.random() < 0.5
            one = (groups[kind] or groups[not kind]).pop()
            if not chosen or tiers(self.map, one, self.text(one.file), chosen):
                drawn.append(one)
        return drawn

    def text(self, file: str) -> str:
        """Return a file of the commit: in the clone it may be edited meanwhile."""
        return self.map.text(self.commit, file)

    def try_all(self, mutants: Sequence[Mutant], chosen: Sequence[str] = ()) -> Iterable[Verdict]:
        """Yield what becomes of each mutant, as it is known."""
        # The choice of tests asks git and keeps what it said: in one thread.
        tasks = [(one, self.rounds(one, chosen)) for one in mutants]
        running = [self._pool.submit(self._try, *task) for task in tasks]
        return (one.result() for one in as_completed(running))

    def rounds(self, mutant: Mutant, chosen: Sequence[str] = ()) -> list[list[str]]:
        """Return the tests of a mutant, the nearest first, in runs that each fit in the time."""
        near, tried = nearest(self.map, mutant, self.text(mutant.file), chosen), set[str]()
        found: list[list[str]] = []
        while len(found) < ROUNDS:
            ids = choose([{id_: test for id_, test in tests.items() if id_ not in tried} for tests in near])
            if not ids:
                break
            found.append(ids)
            tried |= {*ids}
        return found

    def _try(self, mutant: Mutant, rounds: list[list[str]]) -> Verdict:
        """Run the tests of a mutant until one of them notices it."""
        began = time.perf_counter()
        text = self.text(mutant.file)
        line = text.splitlines()[mutant.line - 1].strip()
        tree = self._trees.get()
        try:
            result, by, changed = "survived", "not covered", mutant_texts.applied(text, mutant)
            for ids in rounds:
                result, by = self._outcome(tree, mutant, changed, ids)
                if result in ("killed", "time-out"):
                    break
            else:
                if rounds[1:] and result == "survived":
                    by = counted([one for ids in rounds for one in ids])
        finally:
            self._trees.put(tree)
        return Verdict(mutant, result, by, time.perf_counter() - began, line)

    def _outcome(self, tree: Tree, mutant: Mutant, text: str, ids: list[str]) -> tuple[str, str]:
        """Return the result for a mutant, and by which test."""
        ids = list(ids)
        for _ in range(ATTEMPTS):
            if not ids:
                break
            with tree.changed(mutant.file, text):
                ran = self._run(tree, ids)
            self.devices |= ran.devices
            if ran.unknown:  # ids with a value that the mutant changes, or of a chapter that skips the test
                ids = [one for one in ids if one not in ran.unknown]
                continue
            if ran.code in (0, 5):
                return "survived", counted(ran.tests) if ran.tests else "not covered"
            if ran.code is None:
                plain = self._plain(tree, ids)
                if plain.code == 0 and plain.seconds < self.limit_s / 2:
                    return "time-out", f"in {ran.last}; without the mutant {plain.seconds:.0f} s"
                return "too slow", f"{counted(ids)}, without the mutant {plain.seconds:.0f} s"
            killer = next(iter(ran.failed), "") or ran.broken or ran.last
            if not killer:  # pytest did not come to any test
                plain = self._plain(tree, ids[:1])
                if plain.code not in (0, 5):
                    raise StrataError(f"pytest cannot run in {tree.root}:\n{plain.output[-2000:]}")
                return "killed", "a module that every test imports"
            if killer in self._sound or killer not in ids:
                return "killed", killer
            plain = self._plain(tree, ids[: ids.index(killer) + 1])
            if plain.code in (0, 5):
                self._sound.add(killer)
                return "killed", killer
            ids = [one for one in ids if one not in plain.failed and one != killer]
        if ids:
            return (
                "too slow",
                f"after {ATTEMPTS} attempts, each with a test that fails without the mutant, too",
            )
        return "survived", "not covered"

    def _plain(self, tree: Tree, ids: Sequence[str]) -> Ran:
        """Run tests without the mutant.

        A file that is the same in two chapters is tested in the earlier one alone, so the tests of the later one exist
        only while a mutant tells the files apart: those of the earlier one stand for them.
        """
        ran = self._run(tree, ids)
        if ran.unknown:
            earlier = (LATER.sub("", one) if one in ran.unknown else one for one in ids)
            ran = self._run(tree, list(dict.fromkeys(earlier)))
        return ran

    def _run(self, tree: Tree, ids: Sequence[str]) -> Ran:
        """Run tests within the limit."""
        return tree.run(ids, self.limit_s, self.cache, environment=self._environment)


def measured(ran: Ran) -> bool:
    """Return whether pytest came to its end: all passed, some failed, or there were no tests."""
    return ran.code in (0, 1, 5)


def counted(tests: Sequence[object]) -> str:
    """Return "1 test", "2 tests"."""
    return f"{len(tests)} test{'s' * (len(tests) != 1)}"


def test_files(root: Path, words: Sequence[str]) -> list[str]:
    """Return the files of tests of some areas, files and folders; of all where there are no words."""
    found: list[Path] = []
    for word in words or ["tests"]:
        path = root / word
        if word.startswith("-") or "::" in word:
            raise UserError(f"--mutants takes areas, folders and files of tests: leave out {word!r}.")
        if "/" not in word and word != "tests":
            name = f"ch{int(word):02d}" if word.isascii() and word.isdigit() else word
            if name not in areas():
                raise UserError(
                    f"There are no tests called {word!r}{suggest(name, areas())}".rstrip(".") + "."
                )
            path = root / path_of(name)
        if not path.exists():
            raise UserError(f"There is no {word}: --mutants takes areas, folders and files of tests.")
        found += sorted(path.rglob("test_*.py")) if path.is_dir() else [path]
    return list(dict.fromkeys(one.resolve().relative_to(root.resolve()).as_posix() for one in found))


# --- what is said and kept --------------------------------------------------------------------------------------------


def show(verdicts: Sequence[Verdict], reasons: Callable[[Verdict], str]) -> None:
    """Print the table of mutants: a line for each, whatever its length, so that a test's id can be copied."""
    rows = [("result", "seconds", "where", "change", "by")]
    for one in verdicts:
        by = f"{one.by}: {reasons(one)}" if reasons(one) else one.by
        where = f"{one.mutant.file}:{one.mutant.line}"
        rows.append((one.result, f"{one.seconds:.1f}", where, one.mutant.change, console.shown(by)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for result, seconds, where, change, by in rows:
        cells = (
            result.ljust(widths[0]),
            seconds.rjust(widths[1]),
            where.ljust(widths[2]),
            change.ljust(widths[3]),
            by,
        )
        console.out.print("  ".join(cells), markup=False, soft_wrap=True)
    words = ("killed", "time-out", "survived", "too slow")
    counts = {word: sum(one.result == word for one in verdicts) for word in words}
    said = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    console.out.print(f"{len(verdicts)} mutants: {said or 'none'}.", markup=False)


def key(entry_: dict[str, Any]) -> tuple[str, ...]:
    """Return what a survivor is known by when its line has moved."""
    return tuple(str(entry_[name]) for name in ("file", "text", "before", "after"))


def survivor(verdict: Verdict, reason: str) -> dict[str, Any]:
    """Return the entry of a survivor in the record."""
    mutant = verdict.mutant
    return {
        "file": mutant.file,
        "line": mutant.line,
        "before": mutant.before,
        "after": mutant.after,
        "text": verdict.text,
        "tests": verdict.by,
        "reason": reason,
    }


def read_record(path: Path) -> dict[str, Any]:
    """Return the record; {} where there is none."""
    try:
        found: dict[str, Any] = json.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise UserError(f"{path} is no JSON: {error}.") from None
    return found


def reasons_of(record: dict[str, Any]) -> dict[tuple[str, ...], dict[str, Any]]:
    """Return the survivors of a record that have a reason."""
    survivors = [*record.get("survivors", []), *record.get("known", [])]
    return {key(one): one for one in survivors if one["reason"]}


def new_record(
    verdicts: Sequence[Verdict], before: dict[str, Any], root: Path, head: dict[str, Any]
) -> dict[str, Any]:
    """Return the record of a run; reasons that were written into the one before stay while their lines do."""
    reasons = reasons_of(before)
    survivors = []
    for one in (verdict for verdict in verdicts if verdict.result == "survived"):
        found = survivor(one, "")
        found["reason"] = reasons.pop(key(found), found)["reason"]
        survivors.append(found)
    known = [one for one in reasons.values() if _stands(root / one["file"], one["text"])]
    counts = {
        "n": len(verdicts),
        "killed": sum(one.killed for one in verdicts),
        "timeouts": sum(one.result == "time-out" for one in verdicts),
        "too_slow": sum(one.result == "too slow" for one in verdicts),
    }
    return {"format": FORMAT, **head, **counts, "survivors": survivors, "known": known}


def _stands(path: Path, text: str) -> bool:
    return path.is_file() and text in (line.strip() for line in path.read_text("utf-8").splitlines())


def run(count: int, seed: str, record: bool, words: Sequence[str], shop: Workshop) -> list[Verdict]:
    """Make the map, try the mutants, print the table, and keep the record where that is asked for."""
    files = test_files(shop.root, words)
    shop.measure(files)
    seed = seed or shop.commit
    chosen = files if words else ()
    drawn = shop.draw(count, seed, chosen)
    verdicts: list[Verdict] = []
    for one in shop.try_all(drawn, chosen):
        verdicts.append(one)
        where = f"{one.mutant.file}:{one.mutant.line}"
        console.say(f"strata: {len(verdicts)} of {len(drawn)}: {where} {one.mutant.change}: {one.result}")
    verdicts.sort(key=lambda one: drawn.index(one.mutant))
    path = shop.root / "docs" / "records" / "mutants.json"
    before = read_record(path)
    known = reasons_of(before)
    show(verdicts, lambda one: known.get(key(survivor(one, "")), {"reason": ""})["reason"])
    if record:
        head = {
            "when": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "commit": shop.commit,
            "seed": seed,
            "devices": dict(sorted((shop.map.devices | shop.devices).items())),
        }
        made = new_record(verdicts, before, shop.root, head)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, (json.dumps(made, indent=1, ensure_ascii=False) + "\n").encode())
        console.out.print(
            f"{path.relative_to(shop.root).as_posix()} has the survivors: give each a reason, or a test."
        )
    return verdicts


def main(arguments: Sequence[str]) -> int:
    """Run the command; return 0 whatever became of the mutants."""
    parser = argparse.ArgumentParser(prog="strata test")
    parser.add_argument("--mutants", type=int, required=True)
    parser.add_argument("--seed", default="")
    parser.add_argument("--jobs", type=int, default=0)
    parser.add_argument("--record", action="store_true")
    given, words = parser.parse_known_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        mutant_trees.require()
        jobs = given.jobs or os.cpu_count() or 1
        shop = Workshop(ROOT, jobs)
        try:
            for api in ("vulkan", "gl"):
                with suppress(UnsupportedError):
                    choice.probe(api)
            mutant_trees.link_copy(verdicts.folder(), shop.cache / verdicts.folder().name)
            run(given.mutants, given.seed, given.record, words, shop)
        finally:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)  # a second one would leave processes behind
            shop.stop()
    except StrataError as error:
        console.say(f"strata: {error}")
        return error.exit_code
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
