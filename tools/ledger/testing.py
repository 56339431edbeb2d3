"""`strata test`: pytest over the areas asked for, and in CI the static checks before it."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import chapters
from chapters import folders
from common.errors import UserError
from common.names import suggest
from common.paths import ROOT
from tools.cli.console import say

CHECKS = {
    "ruff": (("-m", "ruff", "check", "."), ("-m", "ruff", "format", "--check", "--diff", "--quiet", ".")),
    "mypy": (("-m", "mypy"),),
    "importlinter": (("-c", "from importlinter.cli import lint_imports_command as lint; lint()"),),
}
"""Module of each tool -> Python's arguments for each of its runs."""


WITH_VALUE = {
    *("-k", "-m", "-n", "-o", "-p", "-r", "-c", "-W"),
    *("--tb", "--maxfail", "--durations", "--deselect", "--ignore", "--basetemp", "--junitxml", "--color"),
}
"""Options of pytest whose next word is their value, when it is not written behind "="."""


def run(
    words: list[str],
    *,
    long: bool = False,
    bless: bool = False,
    static: bool = False,
    record: bool = False,
    chapter: str | None = None,
) -> int:
    """Run what was asked for; return 0 when all passed, 1 when something failed, 2 for a wrong request.

    `words` are areas of tests/ (ch01, common, ...), paths below it, folders of forks, and pytest's own arguments.
    `chapter`, a number or the folder of a fork, is for a first test of that one alone.
    """
    if chapter is not None and (long or bless or record):
        raise UserError(
            "--chapter is a first test, which ends early: leave it out for --long, --bless and --record."
        )
    arguments = pytest_arguments(words) if chapter is None else first_arguments(chapter, words)
    if bless and any(is_fork(word) for word in words):
        raise UserError(
            "--bless makes goldens of the project's own chapters: leave it out, or leave out the fork."
        )
    if record and any(is_fork(word) for word in words):
        raise UserError(
            "--record keeps results of the project's own chapters: leave it out, or leave out the fork."
        )
    in_ci = os.environ.get("CI") == "true"
    failed = static_checks() if static or in_ci else []
    arguments += ["--long"] * long + ["--bless"] * bless + ["--record"] * record
    # A process of its own: pytest rewrites assertions at import, and here much is imported already.
    done = subprocess.run([sys.executable, "-P", "-m", "pytest", *arguments], cwd=ROOT, check=False)
    if failed:
        say(f"strata: static checks failed: {', '.join(failed)}.")
    if done.returncode == 5:
        raise UserError("No test matches: ./strata test --collect-only lists them.")
    return 1 if failed or done.returncode == 1 else done.returncode


def run_mutants(count: int, words: list[str], *, seed: str | None, jobs: int | None, record: bool) -> int:
    """Try mutants of the code (tests/support/mutants.py); return 0 whatever became of them, 2 for a wrong request.

    `words` are areas, folders and files of tests: these alone try mutants, and these are of lines that they run.
    """
    options = [
        f"--mutants={count}",
        *([f"--seed={seed}"] if seed else []),
        *([f"--jobs={jobs}"] if jobs else []),
    ]
    command = [sys.executable, "-P", "-m", "tests.support.mutants", *options, *["--record"] * record, *words]
    with subprocess.Popen(command, cwd=ROOT) as process:
        try:
            return process.wait()
        except KeyboardInterrupt:
            process.terminate()  # it ends its own processes, for which `subprocess.run` leaves it no time
            raise


def areas() -> list[str]:
    """Return the folders of tests/ that hold tests, and the files beside them: "panel" is tests/test_panel.py."""
    found = {path.relative_to(ROOT / "tests").parts[0] for path in (ROOT / "tests").glob("*/**/test_*.py")}
    return sorted(found | {path.stem.removeprefix("test_") for path in (ROOT / "tests").glob("test_*.py")})


def path_of(area: str) -> str:
    """Return the folder or the file of an area that is no chapter."""
    return f"tests/{area}" if (ROOT / "tests" / area).is_dir() else f"tests/test_{area}.py"


def _refuse_study(word: str) -> None:
    """Raise UserError for "4/memory" and "my-ch04/memory": a study is tested with its chapter."""
    path = folders.path_of(word)
    owner = path.parent if path is not None else None
    if owner is not None and owner.name == "studies":
        owner = owner.parent
    if re.fullmatch(r"(?:ch)?\d+/[\w-]+", word, re.ASCII) or (owner is not None and folders.is_copy(owner)):
        chapters.parse_chapter(word)


def pytest_arguments(words: list[str]) -> list[str]:
    """Return pytest's arguments: an area becomes its paths, a chapter what is tested of it (see `chapter_arguments`).

    Raises UserError for the name of an area that does not exist.
    """
    known = sorted({*areas(), *(chapters.folder_name(number) for number in chapters.available())})
    arguments: list[str] = []
    for index, word in enumerate(words):
        after_option = index > 0 and words[index - 1] in WITH_VALUE
        if not word.startswith("-") and not after_option and is_fork(word):
            fork = chapters.parse_chapter(word)
            arguments += [path for path in chapter_arguments(fork) if path not in arguments]
            continue
        if not word.startswith("-") and not after_option and not (ROOT / word.partition("::")[0]).exists():
            _refuse_study(word)
        if word.startswith("-") or after_option or "/" in word or "::" in word or word.endswith(".py"):
            arguments.append(word)
            continue
        name = f"ch{int(word):02d}" if word.isascii() and word.isdigit() else word
        if name not in known:
            full = re.sub(r"\Ach(\d)\Z", r"ch0\1", name)  # nearer to ch01 than to ch10
            near = suggest(full, [*known, *folders.beside()])
            raise UserError(f"There are no tests called {word!r}{near}{'' if near.endswith('?') else '.'}")
        chapter = re.fullmatch(r"ch(\d\d)", name)
        paths = chapter_arguments(int(chapter[1])) if chapter else [path_of(name)]
        arguments += [path for path in paths if path not in arguments]
    return arguments


def first_arguments(chapter: str, words: list[str]) -> list[str]:
    """Return pytest's arguments for a first test of a chapter or a fork; `words` are arguments of pytest.

    Raises UserError for an area or a path among them.
    """
    which = chapters.parse_chapter(chapter)
    number = which if isinstance(which, int) else which.lesson.number
    for index, word in enumerate(words):
        if not word.startswith("-") and not (index > 0 and words[index - 1] in WITH_VALUE):
            raise UserError(
                f"--chapter {chapter} is a first test of one chapter: leave out {word!r}, or leave out --chapter."
            )
    paths = chapter_arguments(which)
    own = f"tests/{chapters.folder_name(number)}"
    # Of chapters before it those files that have tests of the core: to read all of them would take half of the time.
    core = [
        file.relative_to(ROOT).as_posix()
        for path in paths
        if path != own and not path.startswith("--")
        for file in sorted((ROOT / path).rglob("test_*.py") if (ROOT / path).is_dir() else [ROOT / path])
        if re.search(r"mark\.(core|newest)\b", file.read_text("utf-8"))
    ]
    return [own, *core, paths[-1], "--first", "-x", *words]


def is_fork(word: str) -> bool:
    """Whether a word names a folder with a copy of a chapter."""
    return not word.isdigit() and (Path(word).expanduser() / folders.NEEDED[-1]).is_file()


def chapter_arguments(which: chapters.Whole) -> list[str]:
    """Return pytest's arguments for one chapter: its own tests, those of the chapters before it, and stability's.

    A fork has those of its chapter.
    """
    number = which if isinstance(which, int) else which.lesson.number
    names = [chapters.folder_name(n) for n in range(1, number + 1)]
    paths = [f"tests/{name}" for name in names] + [f"tests/stability/test_{name}.py" for name in names]
    return [
        *(path for path in paths if (ROOT / path).exists()),
        f"--chapter={which if isinstance(which, int) else which.path}",
    ]


def static_checks() -> list[str]:
    """Run the static checks and return the names of those that failed; raise UserError where they are not installed."""
    missing = [name for name in CHECKS if importlib.util.find_spec(name) is None]
    if missing:
        raise UserError(f"{', '.join(missing)} is not installed: ./strata --extras test --static brings it.")
    failed = []
    for name, commands in CHECKS.items():
        say(f"strata: checking with {name}")
        for command in commands:
            if subprocess.run([sys.executable, *command], cwd=ROOT, check=False).returncode:
                failed.append(name)
    return list(dict.fromkeys(failed))
