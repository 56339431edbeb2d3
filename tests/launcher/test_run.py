"""How a plan is carried out: done, asked about, shown or taken back. All commands touch the test's folder alone."""

from __future__ import annotations

import argparse
import io
import subprocess
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from bootstrap import environment, machine, offline, probe, run
from bootstrap.environment import Environment, SetupError
from bootstrap.machine import Machine
from bootstrap.plan import Plan, Step

STEP = Step("The driver.", ("touch", "driver"))
FAILING = Step("Something far away.", ("cat", "/nowhere/at/all"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the steps of these tests work."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def device(monkeypatch: pytest.MonkeyPatch, version: list[int] | None) -> None:
    monkeypatch.setattr(probe, "ask", lambda what: {"version": version} if version else {})


def answer(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))


# --- Words before the command ---


@pytest.mark.parametrize(
    ("words", "given", "rest"),
    [
        ([], [], []),
        (["run", "1"], [], ["run", "1"]),
        (["--yes", "run", "1"], ["yes"], ["run", "1"]),
        (["--no-install", "--latest", "list"], ["no_install", "latest"], ["list"]),
        (["--extras"], ["extras"], []),
        (["run", "--yes"], [], ["run", "--yes"]),
        (["--help"], [], ["--help"]),
        (["--from", "a b.zip", "run", "1"], ["from"], ["run", "1"]),
        (["--yes", "--from=a b.zip", "--extras", "list"], ["yes", "extras", "from"], ["list"]),
        (["run", "--from", "x"], [], ["run", "--from", "x"]),
    ],
)
def test_our_options_stand_before_the_command(words: list[str], given: list[str], rest: list[str]) -> None:
    options, left = run.parse(words)
    assert [name for name, value in vars(options).items() if value] == given
    assert left == rest
    assert vars(options)["from"] in (None, "a b.zip")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--from"], "--from needs the file of a bundle"),
        (["--yes", "--from="], "--from needs the file of a bundle"),
        (["--from", "", "run"], "--from needs the file of a bundle"),
        (["--from", "b.zip", "--latest", "run"], "leave one of them out"),
        (["--from", "no such file", "run"], "There is no file no such file"),
    ],
)
def test_a_bundle_that_is_named_wrongly_is_said(
    capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    assert run.main(words) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1


# --- One step ---


def test_a_command_is_done_and_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run.perform(STEP, ())
    assert (folder / "driver").exists()
    assert capsys.readouterr().err == "strata: The driver.\n  $ touch driver\n"


def test_a_file_is_written_as_the_prefixed_user(folder: Path) -> None:
    run.perform(Step("A source.", file=(str(folder / "a source"), "Types: deb\n")), ("env",))
    assert (folder / "a source").read_text() == "Types: deb\n"


def test_a_failure_ends_the_set_up_with_the_programs_own_words() -> None:
    with pytest.raises(SetupError, match=r"cat /nowhere/at/all` failed; \./strata --no-install") as caught:
        run.perform(FAILING, ())
    assert "No such file" in str(caught.value)
    with pytest.raises(SetupError, match="no-such-program"):
        run.perform(Step("Not there.", ("no-such-program",)), ())


def test_a_failure_that_is_allowed_is_passed_over() -> None:
    run.perform(replace(FAILING, may_fail=True), ())


def test_what_stands_in_for_a_failure_is_done_and_the_plan_goes_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    device(monkeypatch, [1, 3])
    (folder / "source").touch()
    back = Step("Take that back.", ("rm", "source"))
    risky = replace(FAILING, instead=back, otherwise="The older one is taken.")
    plan = run.carry_out(Plan("run", (risky, STEP), blocks="graphics"))
    assert plan == Plan("nothing")
    assert not (folder / "source").exists()
    assert (folder / "driver").exists()
    assert "The older one is taken." in capsys.readouterr().err


# --- A whole plan ---


@pytest.mark.parametrize(
    ("text", "done"), [("y\n", True), ("YES\n", True), ("\n", False), ("no\n", False), ("", False)]
)
def test_asking_shows_all_commands_with_reasons_and_takes_anything_but_yes_for_no(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], text: str, done: bool
) -> None:
    device(monkeypatch, [1, 3])
    answer(monkeypatch, text)
    plan = run.carry_out(Plan("ask", (STEP,), missing=("No device.",), blocks="graphics"))
    said = capsys.readouterr().err
    assert (
        said.index("No device.")
        < said.index("# The driver.")
        < said.index("\ntouch driver\n")
        < said.index("[y/N]")
    )
    assert (folder / "driver").exists() == done
    assert plan.blocks == ("nothing" if done else "graphics")


@pytest.mark.parametrize("mode", ["print", "nothing"])
def test_what_is_only_shown_is_not_done(folder: Path, mode: str) -> None:
    plan = Plan(mode, (STEP,), blocks="graphics")  # type: ignore[arg-type]
    assert run.carry_out(plan) is plan
    assert list(folder.iterdir()) == []


def test_what_is_shown_can_be_copied_into_a_shell_as_it_is(folder: Path) -> None:
    text = "Types: deb\n\n it's a $line that `goes` on\n"
    back = Step("Take that back.", ("rm", "gone"))
    steps = (
        Step("A file; it's needed (now).", file=(str(folder / "a source"), text)),
        Step("A file to take back.", file=("gone", "")),
        replace(FAILING, instead=back),
        STEP,
    )
    shown = run.explain(Plan("print", steps, ("env",), missing=("No device.",), notes=("A note.",)))
    block = shown.split(":\n\n", 1)[1].rsplit("\n\nA note.", 1)[0]
    subprocess.run(["/bin/sh", "-c", block], stderr=subprocess.DEVNULL, check=True)
    assert (folder / "a source").read_text() == text
    assert sorted(path.name for path in folder.iterdir()) == ["a source", "driver"]


@pytest.mark.parametrize("version", [None, [1, 2]])
def test_an_installation_that_brings_no_device_is_said(
    folder: Path, monkeypatch: pytest.MonkeyPatch, version: list[int] | None
) -> None:
    device(monkeypatch, version)
    plan = run.carry_out(Plan("run", (STEP,), blocks="graphics"))
    assert plan.blocks == "graphics"
    assert "still no device offers Vulkan 1.3" in plan.missing[0]


# --- From the machine to the end ---


@pytest.fixture
def set_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """A set-up of an empty clone on a machine that is described; returns what was made, and installs nothing."""
    clone = Environment(tmp_path)

    def go(described: Machine, *words: str) -> list[str]:
        made: list[str] = []
        monkeypatch.setattr(machine, "describe", lambda packages: described)
        monkeypatch.setattr(machine, "in_ci", lambda: described.ci)
        monkeypatch.setattr(run, "make", lambda *arguments: made.append("all" if arguments[1] else "core"))
        monkeypatch.setattr(
            run, "perform", lambda step, prefix: made.append(" ".join((*prefix, *step.command)))
        )
        options, rest = run.parse(list(words))
        run.set_up(clone, options, rest[0])
        return made

    return go


UBUNTU = Machine(distribution="ubuntu", managers=("apt-get",))
WORKING = replace(UBUNTU, vulkan=(1, 3))
SetUp = Callable[..., list[str]]


def test_where_graphics_work_only_the_environment_is_made(
    set_up: SetUp, capsys: pytest.CaptureFixture[str]
) -> None:
    assert set_up(replace(WORKING, root=True), "run", "1") == ["core"]
    assert capsys.readouterr().err.splitlines() == [
        "strata: Looking at this machine, once.",
        "strata: Strata is set up; this happens once.",
    ]
    assert set_up(WORKING, "--extras", "run", "1") == ["all"]


def test_a_container_is_completed_before_the_environment_is_made(
    set_up: SetUp, monkeypatch: pytest.MonkeyPatch
) -> None:
    device(monkeypatch, [1, 3])
    made = set_up(replace(UBUNTU, root=True, ci=True), "test")
    assert made[0] == "apt-get update"
    assert "mesa-vulkan-drivers" in made[1]
    assert made[2:] == ["all"]


@pytest.mark.parametrize("command", ["run", "bench", "test"])
def test_a_user_without_rights_gets_the_commands_and_the_end(set_up: SetUp, command: str) -> None:
    with pytest.raises(SetupError) as caught:
        set_up(UBUNTU, command)
    text = str(caught.value)
    assert text.startswith("No Vulkan device was found")
    assert ", as root:" in text
    assert "apt-get update" in text.splitlines()
    with pytest.raises(SetupError, match="\nsudo apt-get update\n"):
        set_up(replace(UBUNTU, sudo=True), command)


@pytest.mark.parametrize("command", ["list", "docs", "--help"])
def test_what_needs_no_device_goes_on_and_says_the_commands(
    set_up: SetUp, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert set_up(UBUNTU, command) == ["core"]
    assert "apt-get update" in capsys.readouterr().err


def test_doctor_itself_says_what_is_missing(set_up: SetUp, capsys: pytest.CaptureFixture[str]) -> None:
    assert set_up(UBUNTU, "doctor") == ["core"]
    assert "apt-get" not in capsys.readouterr().err


def test_no_install_goes_on_without_a_device(set_up: SetUp) -> None:
    assert set_up(replace(UBUNTU, root=True), "--no-install", "run", "1") == ["core"]


@pytest.fixture
def any_bundle(monkeypatch: pytest.MonkeyPatch) -> None:
    """In place of any bundle one that has nothing."""

    class Nothing:
        def packages(self, say: Callable[[str], None]) -> AbstractContextManager[None]:
            return nullcontext()

        def place_the_rest(self, say: Callable[[str], None]) -> None:
            pass

    monkeypatch.setattr(offline, "opened", lambda *arguments: nullcontext(Nothing()))


@pytest.mark.usefixtures("any_bundle")
def test_with_a_bundle_the_system_is_changed_only_for_yes(
    set_up: SetUp, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    container = replace(UBUNTU, root=True)
    assert set_up(container, "--from", "b.zip", "list") == ["core"]
    said = capsys.readouterr().err
    assert "\napt-get update\n" in said
    assert said.rstrip().endswith(offline.SYSTEM_PACKAGES)
    with pytest.raises(SetupError, match=r"No Vulkan device(.|\n)*A bundle brings Python packages alone"):
        set_up(container, "--from", "b.zip", "run", "1")
    device(monkeypatch, [1, 3])
    assert set_up(container, "--yes", "--from", "b.zip", "run", "1")[0] == "apt-get update"
    capsys.readouterr()
    assert set_up(replace(WORKING, root=True), "--from", "b.zip", "run", "1") == ["core"]
    assert "A bundle brings" not in capsys.readouterr().err


def test_a_python_that_cannot_make_an_environment_stops_every_command(set_up: SetUp) -> None:
    with pytest.raises(SetupError, match=r"apt-get .* python3\.11-venv"):
        set_up(replace(WORKING, can_make_venv=False), "list")


def test_main_tells_the_error_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(clone: Environment, options: argparse.Namespace, command: str) -> None:
        raise SetupError("The disk is full; make room.")

    monkeypatch.setattr(run, "set_up", fail)
    monkeypatch.setattr(run, "start", lambda rest: pytest.fail("Strata was started all the same"))
    assert run.main(["run", "1"]) == 2
    assert capsys.readouterr().err == "strata: The disk is full; make room.\n"


# --- The folder .venv ---


@pytest.mark.parametrize(
    ("flaw", "anew"),
    [
        ("nothing there", True),
        ("cut off", True),
        ("broken python", True),
        ("made by hand", False),
        ("moved", False),
        ("older lock", False),
    ],
)
def test_an_environment_is_made_anew_only_where_it_is_not_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, flaw: str, anew: bool
) -> None:
    clone = Environment(tmp_path)
    (tmp_path / "requirements.lock").write_text("# [core]\n")
    packages_folder = tmp_path / "site"
    packages_folder.mkdir()
    if flaw != "nothing there":
        clone.folder.mkdir()
    if flaw == "cut off":
        (clone.folder / environment.UNFINISHED).touch()
    if flaw in ("moved", "older lock"):
        home = tmp_path if flaw == "older lock" else "/elsewhere"
        (clone.folder / environment.STAMP).write_text(f"{home}\ncore\n")
    calls: list[str] = []
    monkeypatch.setattr(environment, "_works", lambda python: flaw not in ("nothing there", "broken python"))
    monkeypatch.setattr(environment, "_create", lambda clone: calls.append("create"))
    monkeypatch.setattr(environment, "_rehome", lambda clone: calls.append("rehome"))
    monkeypatch.setattr(environment, "install", lambda *arguments: calls.append("install"))
    monkeypatch.setattr(environment, "_site_packages", lambda clone: packages_folder)
    environment.make(clone, False, False, lambda text: None)
    assert calls == [*(["create"] if anew else []), *(["rehome"] if flaw == "moved" else []), "install"]
    assert clone.stamp() == (str(tmp_path), "core")
    assert not (clone.folder / environment.UNFINISHED).exists()


def test_a_folder_that_cannot_be_written_is_said_in_a_sentence(tmp_path: Path) -> None:
    clone = Environment(tmp_path)
    clone.folder.write_text("a file in the way")
    with pytest.raises(SetupError, match=r"its folder .venv cannot be written .*; put the clone"):
        environment.make(clone, False, False, lambda text: None)


def test_a_python_works_that_is_new_enough_and_has_pip(tmp_path: Path) -> None:
    works = environment._works
    assert works(Path(sys.executable))
    assert not works(tmp_path / "missing")
    broken = tmp_path / "python"
    broken.symlink_to("/nowhere/python3")  # as after an upgrade of the system's Python
    assert not works(broken)
    old = tmp_path / "old"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    assert not works(old)
