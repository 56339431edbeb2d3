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

from bootstrap import environment, graphics, machine, offline, run
from bootstrap.environment import COMPLETE, FOUND, NOTHING, Environment, SetupError
from bootstrap.graphics import Device, Graphics
from bootstrap.machine import VALIDATION_LAYER, Machine
from bootstrap.plan import Plan, Step

STEP = Step("The driver.", ("touch", "driver"))
FAILING = Step("Something far away.", ("cat", "/nowhere/at/all"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which the steps of these tests work."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def works() -> Plan:
    """What is decided after the steps of a plan where all is well."""
    return Plan("nothing")


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
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "source").touch()
    back = Step("Take that back.", ("rm", "source"))
    risky = replace(FAILING, instead=back, otherwise="The older one is taken.")
    plan = run.carry_out(Plan("run", (risky, STEP), blocks="graphics"), works)
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
    answer(monkeypatch, text)
    plan = run.carry_out(Plan("ask", (STEP,), missing=("No device.",), blocks="graphics"), works)
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
    assert run.carry_out(plan, works) is plan
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


@pytest.mark.parametrize("blocks", ["graphics", "nothing"])
def test_what_was_installed_counts_only_if_the_program_draws_with_it(folder: Path, blocks: str) -> None:
    still = Plan(
        "print", (STEP,), missing=("No OpenGL 4.5 was found (libGL.so.1 is missing).",), blocks=blocks
    )  # type: ignore[arg-type]
    plan = run.carry_out(Plan("run", (STEP,), blocks="graphics"), lambda: still)
    assert (plan.steps, plan.blocks) == ((), blocks)
    assert plan.missing[0] == (
        "Everything was installed, and still: No OpenGL 4.5 was found (libGL.so.1 is missing)."
    )


def test_an_installation_that_fails_does_not_stop_a_machine_that_draws(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "in_ci", lambda: False)
    plan = run.carry_out(Plan("run", (FAILING, STEP), blocks="nothing"), works)
    assert plan.blocks == "nothing"
    assert "cat /nowhere/at/all` failed" in plan.missing[0]
    assert not (folder / "driver").exists()
    with pytest.raises(SetupError):
        run.carry_out(Plan("run", (FAILING, STEP), blocks="graphics"), works)
    monkeypatch.setattr(machine, "in_ci", lambda: True)  # there each thing that is missing is a failure
    with pytest.raises(SetupError):
        run.carry_out(Plan("run", (FAILING, STEP), blocks="nothing"), works)


# --- From the machine to the end ---


UBUNTU = Machine(distribution="ubuntu", managers=("apt-get",))
DRAWS_NOTHING = Graphics()
BY_VULKAN = Graphics(
    vulkan=Device("software", "llvmpipe"), auto="vulkan", layers=frozenset({VALIDATION_LAYER})
)
IN_SOFTWARE = Graphics(gl=Device("software", "llvmpipe"), auto="gl")
BY_CARD = Graphics(gl=Device("discrete", "a card"), auto="gl")
SetUp = Callable[..., list[str]]


@pytest.fixture
def clone(tmp_path: Path) -> Environment:
    return Environment(tmp_path)


@pytest.fixture
def set_up(clone: Environment, monkeypatch: pytest.MonkeyPatch) -> SetUp:
    """A set-up of a clone on a machine that is described; returns what was done, and installs nothing.

    `found` are the program's answers, the first before anything is installed; the last one is repeated.
    """

    def go(described: Machine, found: Graphics | list[Graphics], *words: str) -> list[str]:
        done: list[str] = []
        answers = [found] if isinstance(found, Graphics) else list(found)

        def ask(*_: object) -> Graphics:
            done.append("ask")
            return answers.pop(0) if len(answers) > 1 else answers[0]

        def make(made: Environment, everything: bool, *_: object) -> None:
            done.append("all" if everything else "core")
            python, extent = made.python, "all" if everything else "core"
            python.parent.mkdir(parents=True, exist_ok=True)
            python.touch()
            made.folder.joinpath(environment.STAMP).write_text(f"{made.root}\n{extent}\n{made.stamp()[2]}\n")

        monkeypatch.setattr(graphics, "ask", ask)
        monkeypatch.setattr(machine, "describe", lambda packages, answer: replace(described, graphics=answer))
        monkeypatch.setattr(machine, "in_ci", lambda: described.ci)
        monkeypatch.setattr(run, "make", make)
        monkeypatch.setattr(
            run, "perform", lambda step, prefix: done.append(" ".join((*prefix, *step.command)))
        )
        options, rest = run.parse(list(words))
        run.set_up(clone, options, rest[0])
        return done

    return go


def test_where_graphics_work_only_the_environment_is_made(
    set_up: SetUp, clone: Environment, capsys: pytest.CaptureFixture[str]
) -> None:
    assert set_up(replace(UBUNTU, root=True), BY_VULKAN, "run", "1") == ["core", "ask"]
    assert capsys.readouterr().err.splitlines() == [
        "strata: Looking at the graphics drivers of this machine.",
        "strata: Strata is set up; this happens once.",
    ]
    assert clone.stamp()[1:] == ("core", FOUND)
    assert set_up(UBUNTU, BY_VULKAN, "run", "1") == []  # what was found is believed
    assert set_up(UBUNTU, BY_VULKAN, "--extras", "run", "1") == ["all"]
    assert set_up(UBUNTU, BY_VULKAN, "--yes", "run", "1") == ["ask"]


@pytest.mark.parametrize("first", [DRAWS_NOTHING, IN_SOFTWARE], ids=["nothing", "software"])
@pytest.mark.parametrize("words", [(), ("--yes",)], ids=["unasked", "yes"])
def test_a_container_gets_its_driver_after_the_program_was_asked_and_the_program_is_asked_again(
    set_up: SetUp,
    clone: Environment,
    capsys: pytest.CaptureFixture[str],
    first: Graphics,
    words: tuple[str, ...],
) -> None:
    done = set_up(replace(UBUNTU, root=True), [first, BY_VULKAN], *words, "run", "1")
    assert done[:3] == ["core", "ask", "apt-get update"]
    assert "mesa-vulkan-drivers" in done[3]
    assert done[4:] == ["ask"]
    assert clone.stamp()[2] == FOUND
    assert "still" not in capsys.readouterr().err


def test_an_installation_that_brings_no_device_is_said_and_offered_again_at_the_next_start(
    set_up: SetUp, clone: Environment
) -> None:
    container = replace(UBUNTU, root=True)
    for _ in range(2):
        with pytest.raises(SetupError, match=r"Everything was installed, and still: No Vulkan 1\.3 device"):
            set_up(container, DRAWS_NOTHING, "run", "1")
        assert clone.stamp()[2] == NOTHING
    assert set_up(container, DRAWS_NOTHING, "list") == []  # a command that draws nothing needs no look
    assert set_up(container, BY_VULKAN, "run", "1") == ["ask"]  # a driver that came by other ways
    assert clone.stamp()[2] == FOUND


def test_without_a_driver_the_offer_is_refused_once_and_made_again(
    set_up: SetUp, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    at_terminal = replace(UBUNTU, sudo=True, terminal=True)
    for _ in range(2):
        answer(monkeypatch, "n\n")
        with pytest.raises(SetupError, match="Nothing was installed"):
            set_up(at_terminal, DRAWS_NOTHING, "run", "1")
        assert "[y/N]" in capsys.readouterr().err


def test_an_offer_that_is_refused_leaves_opengl_and_is_not_made_again(
    set_up: SetUp, clone: Environment, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    at_terminal = replace(UBUNTU, sudo=True, terminal=True)
    answer(monkeypatch, "n\n")
    assert set_up(at_terminal, IN_SOFTWARE, "run", "1") == ["core", "ask"]
    said = capsys.readouterr().err
    assert "so Strata draws with OpenGL's software driver (llvmpipe)" in said
    assert said.index("[y/N]") < said.index("Nothing was installed")
    assert clone.stamp()[2] == FOUND
    assert set_up(at_terminal, IN_SOFTWARE, "run", "1") == []


def test_a_card_that_draws_by_opengl_costs_one_sentence_and_yes_installs(
    set_up: SetUp, capsys: pytest.CaptureFixture[str]
) -> None:
    container = replace(UBUNTU, root=True)
    assert set_up(container, BY_CARD, "run", "1") == ["core", "ask"]
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("strata: Strata draws with OpenGL here (a card); Vulkan 1.3 would add")
    assert "--yes" in last
    assert set_up(container, [BY_CARD, BY_VULKAN], "--yes", "run", "1")[1] == "apt-get update"
    assert set_up(container, BY_CARD, "--yes", "run", "1")[-1] == "ask"
    assert "Everything was installed, and still: No Vulkan 1.3 device was found" in capsys.readouterr().err


def test_ci_looks_for_drivers_in_an_environment_that_was_set_up_outside_of_it(
    set_up: SetUp, clone: Environment
) -> None:
    container = replace(UBUNTU, root=True)
    assert set_up(container, BY_CARD, "--extras", "test") == ["all", "ask"]
    assert clone.stamp()[1:] == ("all", FOUND)
    in_ci = replace(container, ci=True)
    done = set_up(in_ci, [BY_CARD, BY_VULKAN], "test")
    assert done[:2] == ["ask", "apt-get update"]
    assert "mesa-vulkan-drivers" in done[2]
    assert clone.stamp()[1:] == ("all", COMPLETE)
    assert set_up(in_ci, BY_VULKAN, "test") == []
    assert set_up(container, BY_VULKAN, "test") == []  # and outside of CI it is enough as well


@pytest.mark.parametrize("command", ["run", "bench", "test"])
def test_a_user_without_rights_gets_the_commands_and_the_end(set_up: SetUp, command: str) -> None:
    with pytest.raises(SetupError) as caught:
        set_up(UBUNTU, DRAWS_NOTHING, command)
    text = str(caught.value)
    assert text.startswith("No Vulkan 1.3 device was found")
    assert ", as root:" in text
    assert "apt-get update" in text.splitlines()
    with pytest.raises(SetupError, match="\nsudo apt-get update\n"):
        set_up(replace(UBUNTU, sudo=True), DRAWS_NOTHING, command)


@pytest.mark.parametrize("command", ["list", "docs", "--help"])
def test_what_needs_no_device_goes_on_and_says_the_commands(
    set_up: SetUp, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert set_up(UBUNTU, DRAWS_NOTHING, command) == ["core", "ask"]
    assert "apt-get update" in capsys.readouterr().err


def test_doctor_itself_says_what_is_missing(set_up: SetUp, capsys: pytest.CaptureFixture[str]) -> None:
    assert set_up(UBUNTU, DRAWS_NOTHING, "doctor") == ["core", "ask"]
    assert "apt-get" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (DRAWS_NOTHING, "no OpenGL 4.5 was found; Strata needs Vulkan 1.3 or OpenGL 4.5"),
        (IN_SOFTWARE, "so Strata draws with OpenGL's software driver (llvmpipe)"),
        (BY_CARD, "Vulkan 1.3 would add"),
    ],
    ids=["nothing", "software", "a card"],
)
def test_no_install_changes_nothing_and_says_in_one_line_what_is_missing(
    set_up: SetUp, capsys: pytest.CaptureFixture[str], found: Graphics, said: str
) -> None:
    assert set_up(replace(UBUNTU, root=True), found, "--no-install", "run", "1") == ["core", "ask"]
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3  # the first two say that it looks, and that Strata is set up
    assert said in lines[2]
    assert "./strata --yes run 1 installs" in lines[2]


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
    set_up: SetUp, capsys: pytest.CaptureFixture[str]
) -> None:
    container = replace(UBUNTU, root=True)
    assert set_up(container, DRAWS_NOTHING, "--from", "b.zip", "list") == ["core", "ask"]
    said = capsys.readouterr().err
    assert "\napt-get update\n" in said
    assert said.rstrip().endswith(offline.SYSTEM_PACKAGES)
    with pytest.raises(SetupError, match=r"No Vulkan 1.3 device(.|\n)*A bundle brings Python packages alone"):
        set_up(container, DRAWS_NOTHING, "--from", "b.zip", "run", "1")
    with_yes = set_up(container, [DRAWS_NOTHING, BY_VULKAN], "--yes", "--from", "b.zip", "run", "1")
    assert with_yes[:2] == ["ask", "apt-get update"]
    capsys.readouterr()
    assert set_up(container, BY_VULKAN, "--from", "b.zip", "run", "1") == []
    assert "A bundle brings" not in capsys.readouterr().err


def test_a_python_that_cannot_make_an_environment_is_helped_first_and_else_stops_every_command(
    set_up: SetUp,
) -> None:
    bare = replace(UBUNTU, can_make_venv=False)
    with pytest.raises(SetupError, match=r"apt-get .* python3\.11-venv"):
        set_up(bare, BY_VULKAN, "list")
    with pytest.raises(SetupError, match=r"apt-get .* python3\.11-venv"):
        set_up(replace(bare, root=True), BY_VULKAN, "--no-install", "list")
    done = set_up(replace(bare, root=True), BY_VULKAN, "list")
    assert done[1].endswith("python3.11-venv")
    assert done[2:] == ["core", "ask"]


def test_main_tells_the_error_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(clone: Environment, options: argparse.Namespace, command: str) -> None:
        raise SetupError("The disk is full; make room.")

    monkeypatch.setattr(run, "set_up", fail)
    monkeypatch.setattr(run, "start", lambda rest: pytest.fail("Strata was started all the same"))
    assert run.main(["run", "1"]) == 2
    assert capsys.readouterr().err == "strata: The disk is full; make room.\n"


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (
            PermissionError(13, "Permission denied", "/x/site.py"),
            "The set-up stopped at /x/site.py: Permission denied; change that and start again.",
        ),
        (OSError(28, "No space left on device"), "No space left on device; change that and start again."),
        (
            subprocess.CalledProcessError(1, ["/x/.venv/bin/python", "-I"]),
            "is broken (/x/.venv/bin/python failed): delete it and start again.",
        ),
    ],
    ids=["permission", "full disk", "broken environment"],
)
def test_what_the_system_refuses_is_told_in_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception, sentence: str
) -> None:
    def fail(clone: Environment, options: argparse.Namespace, command: str) -> None:
        raise error

    monkeypatch.setattr(run, "set_up", fail)
    assert run.main(["run", "1"]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1


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
        (clone.folder / environment.STAMP).write_text(f"{home}\ncore\nfound\n")
    calls: list[str] = []
    monkeypatch.setattr(environment, "works", lambda python: flaw not in ("nothing there", "broken python"))
    monkeypatch.setattr(environment, "_create", lambda clone: calls.append("create"))
    monkeypatch.setattr(environment, "_rehome", lambda clone: calls.append("rehome"))
    monkeypatch.setattr(environment, "install", lambda *arguments: calls.append("install"))
    monkeypatch.setattr(environment, "_site_packages", lambda clone: packages_folder)
    environment.make(clone, False, False, lambda text: None)
    assert calls == [*(["create"] if anew else []), *(["rehome"] if flaw == "moved" else []), "install"]
    known = FOUND if flaw in ("moved", "older lock") else ""  # drivers stay what they are
    assert clone.stamp() == (str(tmp_path), "core", known)
    assert not (clone.folder / environment.UNFINISHED).exists()


def test_a_folder_that_cannot_be_written_is_said_in_a_sentence(tmp_path: Path) -> None:
    clone = Environment(tmp_path)
    clone.folder.write_text("a file in the way")
    with pytest.raises(SetupError, match=r"its folder .venv cannot be written .*; put the clone"):
        environment.make(clone, False, False, lambda text: None)


def test_a_python_works_that_is_new_enough_and_has_pip(tmp_path: Path) -> None:
    works = environment.works
    assert works(Path(sys.executable))
    assert not works(tmp_path / "missing")
    broken = tmp_path / "python"
    broken.symlink_to("/nowhere/python3")  # as after an upgrade of the system's Python
    assert not works(broken)
    old = tmp_path / "old"
    old.write_text("#!/bin/sh\nexit 1\n")
    old.chmod(0o755)
    assert not works(old)
