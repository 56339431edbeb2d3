"""`strata test`: pytest over the areas asked for, and in CI the static checks before it."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys

from chapters.console import say
from common.errors import UserError
from common.names import suggest
from common.paths import ROOT

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


def run(words: list[str], *, long: bool, bless: bool, static: bool) -> int:
    """Run what was asked for; return 0 when all passed, 1 when something failed, 2 for a wrong request.

    `words` are areas of tests/ (ch01, common, ...), paths below it, and pytest's own arguments, in any order.
    """
    arguments = pytest_arguments(words)
    in_ci = os.environ.get("CI") == "true"
    failed = static_checks() if static or in_ci else []
    arguments += ["--long"] * long + ["--bless"] * bless
    # A process of its own: pytest rewrites assertions at import, and here much is imported already.
    done = subprocess.run([sys.executable, "-P", "-m", "pytest", *arguments], cwd=ROOT, check=False)
    if failed:
        say(f"strata: static checks failed: {', '.join(failed)}.")
    if done.returncode == 5:
        raise UserError("No test matches: ./strata test --collect-only lists them.")
    return 1 if failed or done.returncode == 1 else done.returncode


def areas() -> list[str]:
    """Return the folders of tests/ that hold tests."""
    return sorted(
        {path.relative_to(ROOT / "tests").parts[0] for path in (ROOT / "tests").glob("*/**/test_*.py")}
    )


def pytest_arguments(words: list[str]) -> list[str]:
    """Return pytest's arguments: an area becomes its paths, a chapter its own tests and its stability's.

    Raises UserError for the name of an area that does not exist.
    """
    known, arguments = areas(), []
    for index, word in enumerate(words):
        after_option = index > 0 and words[index - 1] in WITH_VALUE
        if word.startswith("-") or after_option or "/" in word or "::" in word or word.endswith(".py"):
            arguments.append(word)
            continue
        name = f"ch{int(word):02d}" if word.isascii() and word.isdigit() else word
        if name not in known:
            raise UserError(f"There are no tests called {word!r}{suggest(name, known)}.")
        arguments.append(f"tests/{name}")
        stability = ROOT / "tests" / "stability" / f"test_{name}.py"
        if stability.is_file():
            arguments.append(stability.relative_to(ROOT).as_posix())
    return arguments


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
