"""How the set-up asks the program what this machine draws with, and what the program answers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from backends import answer, choice
from bootstrap import graphics
from bootstrap.graphics import Device, Graphics, why_not
from common.errors import UnsupportedError
from common.paths import ROOT
from tests.launcher.clone import DRAWS, DRAWS_NOTHING

on_linux = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="drivers are found in other ways there"
)

# --- The question ---


def asked(code: str, **more: Any) -> Graphics:
    return graphics.ask(sys.executable, question=("-c", code), **more)


def test_an_answer_is_read_after_whatever_a_driver_printed() -> None:
    found = asked(f"print('a driver says hello'); print({json.dumps(json.dumps(DRAWS))})")
    assert found.vulkan == Device("software", "a processor")
    assert (found.auto, found.in_hardware) == ("vulkan", False)
    assert found.layers == {"VK_LAYER_KHRONOS_validation"}
    none = graphics.read(DRAWS_NOTHING)
    assert (none.auto, none.in_hardware) == ("", False)
    assert none.gl == Device(problem="No OpenGL 4.5 was found.", libraries=("libGL.so.1",))


@pytest.mark.parametrize(
    ("kind", "hardware"),
    [("discrete", True), ("integrated", True), ("virtual", True), ("other", True), ("software", False)],
)
def test_a_card_is_what_auto_takes_for_one(kind: str, hardware: bool) -> None:
    # The rule of `backends.choice`: whatever is not software is preferred to a software driver of Vulkan.
    devices = {"vulkan": ("software", "llvmpipe"), "gl": (kind, "a card")}
    chosen = choice.decide("auto", devices.__getitem__, lambda: True)
    assert (chosen.backend == "gl") == hardware
    assert Graphics(gl=Device(kind, "a card"), auto="gl").in_hardware == hardware


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("import os; os.abort()", "ended with exit code -6 and no word of why"),
        ("import no_such_module", "and ModuleNotFoundError: No module named 'no_such_module'"),
        ("print('not an answer')", "ended with exit code 0"),
        ("print('{\"vulkan\": {}}')", "ended with exit code 0"),
        ("print('[]')", "ended with exit code 0"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
def test_a_program_that_fails_is_no_answer(code: str, why: str) -> None:
    assert why in asked(code).unanswered


def test_a_program_that_hangs_is_stopped_and_the_user_hears_what_is_waited_for() -> None:
    heard: list[str] = []
    found = asked("import time; time.sleep(60)", say=heard.append, timeout_s=1.0, patience_s=0.2)
    assert found.unanswered == "no answer came within 1 s"
    assert heard == ["Waiting for the answers of the graphics drivers."]


def test_a_python_that_is_not_there_is_no_answer(tmp_path: Path) -> None:
    assert "did not start (No such file" in graphics.ask(tmp_path / "python").unanswered


def test_a_device_that_the_user_picked_is_not_in_the_question(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STRATA_DEVICE", "no such card")
    code = (
        f"import os, json; assert 'STRATA_DEVICE' not in os.environ; print({json.dumps(json.dumps(DRAWS))})"
    )
    assert asked(code).unanswered == ""


def test_missing_libraries_are_the_reason_where_there_are_any() -> None:
    device = Device(
        problem="No Vulkan loader was found on this machine: ./strata doctor says what to install."
    )
    assert why_not(device, "Vulkan 1.3 device") == "No Vulkan loader was found on this machine"
    one = Device(problem="x", libraries=("libGL.so.1",))
    assert why_not(one, "OpenGL 4.5") == "No OpenGL 4.5 was found (libGL.so.1 is missing)"
    two = Device(problem="x", libraries=("libEGL.so.1", "libGL.so.1"))
    assert why_not(two, "OpenGL 4.5") == "No OpenGL 4.5 was found (libEGL.so.1 and libGL.so.1 are missing)"


# --- The program's answer ---

NO_VULKAN = {"VK_DRIVER_FILES": "/nowhere.json"}
NO_OPENGL = {"__EGL_VENDOR_LIBRARY_FILENAMES": "/nowhere.json"}


def python(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    command = [sys.executable, "-P", *words]
    return subprocess.run(
        command, cwd="/", env=environment, capture_output=True, text=True, check=False, timeout=60
    )


EACH_COMMAND = """
import json
from backends.choice import choose, probe
from common.errors import UnsupportedError
found = {}
for backend in ("vulkan", "gl"):
    try:
        found[backend] = dict(zip(("kind", "name"), probe(backend)))
    except UnsupportedError as error:
        found[backend] = {"problem": str(error)}
try:
    found["chosen"] = choose()
except UnsupportedError:
    found["chosen"] = ""
print(json.dumps(found))
"""
"""What a command does that is to draw with `--backend auto`."""


@on_linux
@pytest.mark.parametrize(
    "taken",
    [{}, NO_VULKAN, {**NO_VULKAN, **NO_OPENGL}],
    ids=["all", "no Vulkan", "nothing"],
)
def test_the_answer_is_what_every_command_would_choose(taken: dict[str, str]) -> None:
    told = json.loads(python("-m", "backends.answer", **taken).stdout)
    alone = json.loads(python("-c", EACH_COMMAND, **taken).stdout)
    for backend in ("vulkan", "gl"):
        missing = told[backend].pop("libraries", None)
        assert (missing is not None) == ("problem" in alone[backend])
        # What is missing behind libraries that are there is the driver.
        assert not missing or (backend == "vulkan" and not answer.layers())
        assert told[backend] == alone[backend]
    assert told["auto"].get("backend", "") == alone["chosen"]
    assert told["auto"].keys() == ({"backend", "reason", "kind", "name"} if alone["chosen"] else {"problem"})


@on_linux
def test_the_layers_are_those_that_an_instance_finds(vulkan_instance: Any) -> None:
    assert sorted(answer.layers()) == sorted(vulkan_instance.layers)


CHILD = """
import os, signal, sys, time
print('{"layers": ["a layer"]}', flush=True)
print('the driver says hello', flush=True)
if sys.argv[1] == "well":
    print('{"kind": "discrete", "name": "a card"}', flush=True)
if sys.argv[1] == "crash":
    os.kill(os.getpid(), signal.SIGSEGV)
if sys.argv[1] == "hang":
    time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
@pytest.mark.parametrize(
    ("end", "found"),
    [
        ("well", {"kind": "discrete", "name": "a card"}),
        ("crash", {"problem": "its driver crashed, exit code -11"}),
        ("hang", {"problem": "its driver hung for 1 s"}),
        ("silence", {"problem": "it gave no answer"}),
    ],
)
def test_a_vulkan_driver_that_ends_badly_is_no_device_and_its_layers_are_kept(
    end: str, found: dict[str, str]
) -> None:
    told = answer.ask_vulkan((sys.executable, "-c", CHILD, end), 1.0 if end == "hang" else 20.0)
    assert told.pop("layers") == ["a layer"]
    if "problem" in found:
        found = {
            "problem": f"No Vulkan 1.3 device was found ({found['problem']}): ./strata doctor says what to install."
        }
    assert told == found


@on_linux
def test_the_program_opens_libegl_and_libgl_by_name_and_each_is_named_where_it_is_missing(
    monkeypatch: pytest.MonkeyPatch, gl_context: Any
) -> None:
    for library, variable in answer.GL_LIBRARIES.items():
        with pytest.MonkeyPatch.context() as one:
            one.setenv(variable, "libno-such-library.so")
            choice.probe.cache_clear()
            with pytest.raises(UnsupportedError):  # glcontext needs it, though all else is there
                choice.probe("gl")
        choice.probe.cache_clear()
        short = library.removeprefix("lib").removesuffix(".so.1")
        with pytest.MonkeyPatch.context() as one:
            one.setattr(
                answer, "find_library", lambda name, short=short: None if name == short else f"lib{name}.so.1"
            )
            one.setattr(answer.ctypes, "CDLL", _refuse)
            assert answer.missing_libraries("gl") == [library]
    assert answer.missing_libraries("gl") == []
    monkeypatch.setattr(
        "backends.vulkan.api.loader_names", lambda system, variables: ["libno-such-loader.so"]
    )
    assert answer.missing_libraries("vulkan") == ["libvulkan.so.1"]


def _refuse(name: str) -> None:
    raise OSError(name)
