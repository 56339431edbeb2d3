"""The launcher itself, started as a user starts it: first, again, from elsewhere, twice at once, interrupted."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bootstrap.environment import UNFINISHED, Environment
from tests.launcher.clone import DRAWS, DRAWS_NOTHING, Clone, make_environment
from tests.support.timing import least_times, timed, until

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has strata.cmd, which needs cmd.exe")


def told(done: subprocess.CompletedProcess[str]) -> dict[str, Any]:
    """Return what the clone's command line printed."""
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def link_to(target: Path | str, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.symlink_to(target)
    return path


# --- Later uses ---


def test_later_use_is_silent_and_hands_the_words_over_as_they_are(finished: Clone) -> None:
    words = ["run", "1", "--set", "name=a b", "", "*", "$HOME", "--yes"]  # after a command, --yes is not ours
    done = finished.start(*words)
    assert told(done)["arguments"] == words
    assert done.stderr == ""


def test_the_folder_of_the_user_stays_and_its_modules_are_not_taken(finished: Clone, tmp_path: Path) -> None:
    (tmp_path / "tiny.py").write_text("VERSION = 'the wrong one'")
    foreign = tmp_path / "foreign"
    shutil.copytree(tmp_path, foreign)
    answer = told(finished.start("list", folder=tmp_path, PYTHONHOME="/nowhere", PYTHONPATH=str(foreign)))
    assert answer["folder"] == str(tmp_path)
    assert answer["tiny"] == 1
    assert answer["python"] == str(finished.python)


@pytest.mark.parametrize(
    "way", ["absolute", "relative", "found on PATH", "folder", "link to link", "relative link", "run by sh"]
)
def test_the_clone_is_found(finished: Clone, tmp_path: Path, way: str) -> None:
    launcher, folder = finished.root / "strata", tmp_path
    if way == "folder":
        launcher = link_to(finished.root, tmp_path / "other name") / "strata"
    elif way == "link to link":
        first = link_to(launcher, tmp_path / "one" / "first link")
        launcher = link_to(first, tmp_path / "second")
    elif way == "relative link":
        launcher = link_to(os.path.relpath(launcher, tmp_path / "a b"), tmp_path / "a b" / "strata")
    if way == "relative":
        done = finished.start("list", launcher="./strata")
        folder = finished.root
    elif way == "found on PATH":
        path = f"{finished.root}{os.pathsep}{os.environ['PATH']}"
        done = subprocess.run(
            ["/usr/bin/env", "strata", "list"],
            cwd=tmp_path,
            env=finished.environment(PATH=path),
            capture_output=True,
            text=True,
            check=False,
        )
    elif way == "run by sh":
        done = finished.start("strata", "list", launcher="/bin/sh")
        folder = finished.root
    else:
        done = finished.start("list", launcher=launcher, folder=tmp_path)
    answer = told(done)
    assert (answer["python"], answer["folder"]) == (str(finished.python), str(folder))
    assert done.stderr == ""


def test_the_exit_code_passes_and_nothing_stands_between(finished: Clone) -> None:
    assert finished.start("fail").returncode == 7
    # The same process: signals and the terminal are the command line's own.
    with subprocess.Popen(
        [finished.root / "strata", "list"], env=finished.environment(), stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert json.loads(process.stdout.read())["process"] == process.pid


@pytest.mark.alone
def test_later_use_adds_less_than_50_ms(finished: Clone) -> None:
    direct = [finished.python, "-P", "-m", "chapters", "list"]
    launched = [finished.root / "strata", "list"]

    def running(command: list[Any]) -> Callable[[], float]:
        def run() -> None:
            subprocess.run(
                command, cwd=finished.root, env=finished.environment(), capture_output=True, check=True
            )

        return timed(run, clock=time.perf_counter)

    def holds(least: dict[str, float]) -> bool:
        return least["launched"] - least["direct"] < 0.05

    measures = {"direct": running(direct), "launched": running(launched)}
    least = least_times(measures, holds, fewest=4, seconds=8.0)  # a busy machine manages a round a second
    assert holds(least), least


# --- What makes a set-up necessary again ---


@pytest.mark.parametrize(
    ("flaw", "ready", "ready_in_ci"),
    [
        ("none", True, False),
        ("has all extras", True, False),
        ("looked at in CI", True, True),
        ("core alone, looked at in CI", True, False),
        ("nothing draws", False, False),
        ("never looked at", False, False),
        ("a stamp of two lines", False, False),
        ("another lock", False, False),
        ("no lock", False, False),
        ("moved", False, False),
        ("no stamp", False, False),
        ("half a stamp", False, False),
        ("no python", False, False),
    ],
)
def test_launcher_and_bootstrap_ask_the_same_question(
    finished: Clone, tmp_path: Path, flaw: str, ready: bool, ready_in_ci: bool
) -> None:
    root = (tmp_path / "a clone").resolve()
    (root / "bootstrap").mkdir(parents=True)
    (root / ".venv" / "bin").mkdir(parents=True)
    shutil.copy2(finished.root / "strata", root)
    shutil.copy2(finished.root / "requirements.lock", root)
    shutil.copy2(finished.root / "requirements.lock", root / ".venv")
    (root / "bootstrap" / "__main__.py").write_text("print('set up')")
    clone = Clone(root, finished.wheels)
    clone.python.write_text("#!/bin/sh\necho start")
    clone.python.chmod(0o755)
    lines = {
        "moved": "/elsewhere\ncore\nfound\n",
        "has all extras": f"{root}\nall\nfound\n",
        "looked at in CI": f"{root}\nall\ncomplete\n",
        "core alone, looked at in CI": f"{root}\ncore\ncomplete\n",
        "nothing draws": f"{root}\nall\nnothing\n",
        "never looked at": f"{root}\nall\n\n",
        "a stamp of two lines": f"{root}\nall\n",
        "half a stamp": f"{root}\n",
    }
    clone.stamp.write_text(lines.get(flaw, f"{root}\ncore\nfound\n"))
    if flaw == "no stamp":
        clone.stamp.unlink()
    elif flaw == "no python":
        clone.python.unlink()
    elif flaw == "no lock":
        (root / ".venv" / "requirements.lock").unlink()
    elif flaw == "another lock":
        clone.write_lock(2)
    answers = (clone.start("list").stdout, clone.start("list", CI="true").stdout)
    assert answers == tuple("start\n" if yes else "set up\n" for yes in (ready, ready_in_ci))
    environment = Environment(root)
    both = (environment.ready(everything=False, ci=False), environment.ready(everything=True, ci=True))
    assert both == (ready, ready_in_ci)
    assert clone.start("--no-install", "list").stdout == "set up\n"


def test_where_nothing_draws_each_command_that_draws_looks_again_until_something_does(own: Clone) -> None:
    own.stamp.write_text(f"{own.root}\ncore\nnothing\n")
    before = own.times_asked()
    own.answers(DRAWS_NOTHING)
    assert own.start("list").stderr == ""  # it draws nothing, and asks nothing
    assert own.start("run", "1", "--help").stderr == ""
    assert own.times_asked() == before
    for more in (1, 2):
        done = own.start("--no-install", "run", "1")
        assert "libvulkan.so.1 is missing" in done.stderr
        assert told(done)["arguments"] == ["run", "1"]
        assert own.times_asked() == before + more
    own.answers(DRAWS)
    assert "No Vulkan" not in own.start("run", "1").stderr
    assert own.times_asked() == before + 3
    assert own.start("run", "1").stderr == ""
    assert own.times_asked() == before + 3


def test_a_stamp_of_an_earlier_commit_is_believed_for_packages_and_graphics_are_looked_at_once(
    own: Clone,
) -> None:
    own.stamp.write_text(f"{own.root}\ncore\n")
    before = own.times_asked()
    first = own.start("list")
    assert told(first)["tiny"] == 1
    assert "Installing" not in first.stderr
    assert own.start("list").stderr == ""
    assert own.times_asked() == before + 1


def test_a_new_lock_is_installed_once(own: Clone) -> None:
    own.write_lock(2)
    first = own.start("list")
    assert told(first)["tiny"] == 2
    assert "Installing" in first.stderr
    assert "Looking at" not in first.stderr  # drivers do not change with a package of ours
    assert own.start("list").stderr == ""


def test_a_package_that_was_tampered_with_is_refused_and_the_old_ones_stay(own: Clone) -> None:
    before = own.stamp.read_bytes()
    own.write_lock(2)
    lock = own.root / "requirements.lock"
    lock.write_text(lock.read_text().replace("sha256:", "sha256:0000")[:-4])
    failed = own.start("list")
    assert failed.returncode == 2
    assert "could not be installed" in failed.stderr
    assert "Traceback" not in failed.stderr
    assert own.stamp.read_bytes() == before
    own.write_lock(1)
    assert told(own.start("list"))["tiny"] == 1


def test_continuous_integration_gets_all_extras(own: Clone) -> None:
    small = [own.python, "-c", "import small"]
    assert subprocess.run(small, capture_output=True, check=False).returncode == 1
    done = own.start("--no-install", "list", CI="true")
    told(done)
    assert subprocess.run(small, capture_output=True, check=False).returncode == 0
    assert own.start("list", CI="true").stderr == ""
    own.stamp.write_text(
        f"{own.root}\nall\nfound\n"
    )  # all extras, set up by hand: drivers of CI were not looked for
    assert "Looking at the graphics drivers" in own.start("--no-install", "list", CI="true").stderr
    own.write_lock(2)  # once installed, all of them are kept up to date
    assert "up to 2 Python packages" in own.start("list").stderr


def test_a_moved_clone_is_put_right_without_network(moved: Clone, tmp_path: Path) -> None:
    nowhere = (tmp_path / "nowhere").as_uri()
    first = moved.start("list", PIP_FIND_LINKS=nowhere)
    assert told(first)["python"] == str(moved.python)
    assert "was moved" in first.stderr
    tool = moved.python.parent / "tiny-tool"
    assert subprocess.run([tool], capture_output=True, check=False).returncode != 126  # its #! line is right
    assert str(moved.root) in tool.read_text()
    assert moved.start("list", PIP_FIND_LINKS=nowhere).stderr == ""


def test_an_environment_whose_python_this_user_may_not_read_costs_a_sentence(own: Clone) -> None:
    with tempfile.TemporaryDirectory() as name:  # not tmp_path, which pytest keeps to its owner
        place = Path(name)
        place.chmod(0o755)
        shutil.copytree(own.root, place / "clone", symlinks=True)
        (place / "closed").mkdir()
        python = place / "clone" / ".venv" / "bin" / "python"
        python.unlink()
        python.symlink_to(place / "closed" / "python")
        (place / "closed").chmod(0)
        before = sorted(path.name for path in (place / "clone" / ".venv").rglob("*"))
        code = (
            f"import os, sys; sys.path.insert(0, {str(place / 'clone')!r}); from bootstrap import run\n"
            "os.seteuid(65534) if os.geteuid() == 0 else None  # root may read everything\n"
            "sys.exit(run.main(['--no-install', 'list']))"
        )
        command = [sys.executable, "-I", "-c", code]
        done = subprocess.run(
            command, env=own.environment(), cwd="/", capture_output=True, text=True, check=False
        )
        (place / "closed").chmod(0o755)
        assert done.returncode == 2
        assert done.stderr.startswith("strata: This user may not read the Python of this clone's environment")
        assert f"{place / 'closed' / 'python'}" in done.stderr
        assert done.stderr.count("\n") == 1
        assert sorted(path.name for path in (place / "clone" / ".venv").rglob("*")) == before


# --- First uses ---


def begin(clone: Clone) -> subprocess.Popen[str]:
    """Start a first use as a terminal does, in a group of processes of its own, and do not wait."""
    return subprocess.Popen(
        [clone.root / "strata", "--no-install", "list"],
        cwd=clone.root,
        env=clone.environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A shell's background jobs ignore Ctrl-C, and so would their children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def interrupt(clone: Clone) -> tuple[int, str]:
    """Begin a first use, press Ctrl-C while it works in `.venv`; return its exit code and what it said."""
    with begin(clone) as cut:
        until((clone.root / ".venv" / UNFINISHED).exists)
        os.killpg(cut.pid, signal.SIGINT)
        _, said = cut.communicate(timeout=60)
    return cut.returncode, said


def test_an_interrupted_first_use_says_so_and_leaves_its_mark(clone: Clone) -> None:
    code, said = interrupt(clone)
    assert code == 130
    assert said.splitlines()[-1].startswith("strata: Stopped;")
    assert "Traceback" not in said
    assert (clone.root / ".venv" / UNFINISHED).exists()
    assert not clone.stamp.exists()


@pytest.mark.long  # seconds, of which Python's venv takes nearly all; every run of CI begins with a first use
def test_the_use_after_an_interrupted_one_makes_the_environment_anew(clone: Clone) -> None:
    interrupt(clone)
    left_over = clone.root / ".venv" / "half a package"
    left_over.touch()
    done = clone.start("--no-install", "list")
    assert told(done)["tiny"] == 1
    assert "is not whole and is made anew" in done.stderr
    assert not left_over.exists()
    assert not (clone.root / ".venv" / UNFINISHED).exists()
    assert clone.start("list").stderr == ""


def test_of_two_first_uses_at_once_one_sets_up_and_both_succeed(clone: Clone) -> None:
    make_environment(clone)
    with begin(clone) as one, begin(clone) as other:
        ends = [process.communicate(timeout=60) for process in (one, other)]
    assert [one.returncode, other.returncode] == [0, 0], ends
    assert all(json.loads(out)["tiny"] == 1 for out, _ in ends)
    errors = [error for _, error in ends]
    assert sum("Installing" in error for error in errors) == 1
    assert sum("waiting" in error for error in errors) == 1


@pytest.mark.parametrize("uv", [False, True])
def test_without_a_python_that_is_new_enough_uv_is_asked_or_the_user_told(
    clone: Clone, tmp_path: Path, uv: bool
) -> None:
    programs = tmp_path / "bin"
    for tool in ("sh", "readlink", "cmp", "cat"):
        found = shutil.which(tool)
        assert found is not None
        link_to(found, programs / tool)
    old = programs / "python3"
    old.write_text("#!/bin/sh\nexit 1\n")  # as Python 3.10 answers the question for its version
    old.chmod(0o755)
    if uv:
        fake = programs / "uv"
        fake.write_text('#!/bin/sh\nfor word; do echo "$word"; done\n')
        fake.chmod(0o755)
    done = clone.start("run", "1", PATH=str(programs))
    if uv:
        words = done.stdout.splitlines()
        assert words[:5] == ["run", "--quiet", "--no-project", "--python", ">=3.11"]
        assert words[-3:] == [str(clone.root / "bootstrap" / "__main__.py"), "run", "1"]
    else:
        assert done.returncode == 2
        assert "needs Python 3.11 or newer" in done.stderr
    assert not (clone.root / ".venv").exists()
