"""Clones to start: one that was never started, one that is set up, and a copy of that at another place."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.launcher.clone import Clone, make_clone, make_environment


@pytest.fixture
def clone(tmp_path: Path) -> Clone:
    """A clone that was never started."""
    return make_clone(tmp_path)


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Clone:
    """A clone that is set up; all tests share it and leave it as it is."""
    clone = make_clone(tmp_path_factory.mktemp("finished"))
    make_environment(clone)
    done = clone.start("--no-install", "list")
    assert done.returncode == 0, done.stderr
    return clone


@pytest.fixture
def moved(finished: Clone, tmp_path: Path) -> Clone:
    """A set-up clone of this test's own, at another place than where it was set up."""
    shutil.copytree(finished.root, tmp_path / "a clone", symlinks=True)
    return Clone((tmp_path / "a clone").resolve(), finished.wheels)


@pytest.fixture
def own(moved: Clone) -> Clone:
    """A set-up clone of this test's own that was, by its stamp, always where it is."""
    moved.stamp.write_text(f"{moved.root}\ncore\nfound\n")
    return moved
