"""`strata doctor`: a working machine, one without a driver, and drivers that crash, hang or hide behind each other."""

from __future__ import annotations

import contextlib
import functools
import io
import json
import os
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import chapters
from backends.features import FEATURES
from backends.selftest import run
from common.lessons import Lesson, Needs
from common.paths import ROOT
from tools.doctor import doctor
from tools.doctor.tables import show

KEYS = {
    "works",
    "problem",
    "auto",
    "install",
    "strata",
    "packages",
    "vulkan",
    "opengl",
    "display",
    "compilers",
    "environment",
    "plan",
    "shadowed",
    "advice",
}
KEYS_WITHIN = {
    "auto": {"backend", "reason"},
    "vulkan": {"loader", "layers", "drivers", "devices", "chosen", "problem"},
    "opengl": {"version", "renderer", "vendor", "problem", "device"},
}


LOADER = find_library("vulkan") is not None
WHY_NO_VULKAN = (
    "no Vulkan 1.3 device was found (the loader found no driver)"
    if LOADER
    else "no Vulkan loader was found on this machine"
)


def strata(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run the command line as a user does, in another folder."""
    return subprocess.run(
        [sys.executable, "-P", "-m", "chapters", *words],
        env={**run.child_environment(), "COLUMNS": "160", **environment},
        cwd="/" if sys.platform != "win32" else None,
        capture_output=True,
        text=True,
        timeout=60,
    )


def examined(selftest: bool = False) -> tuple[int, dict[str, Any]]:
    """Return exit code and report of `strata doctor --json` in this process."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        code = doctor.run(json=True, selftest=selftest)
    return code, json.loads(printed.getvalue())


def shown(report: dict[str, Any]) -> str:
    console = Console(file=io.StringIO(), width=160)
    show(report, console)
    return console.file.getvalue()  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def healthy(vulkan_instance) -> dict[str, Any]:
    """The report of this machine, where the exit code is 0."""
    code, report = examined()
    assert code == 0, report["problem"]
    return report


# --- a machine that works -----------------------------------------------------------------------------------


@pytest.mark.feature("cli/doctor")
def test_the_report_names_loader_device_layers_and_compilers(healthy, vulkan_instance) -> None:
    assert healthy.keys() == KEYS
    for key, within in KEYS_WITHIN.items():
        assert healthy[key].keys() == within, key
    assert healthy["display"].keys() - {"problem"} == {"kind", "detail"}
    plan_keys = {"title", "runs", "problem", "choices"}
    assert all(plan.keys() == plan_keys for plan in healthy["plan"].values())
    assert healthy["works"] is True
    assert healthy["problem"] is None
    assert healthy["install"] is None
    assert healthy["strata"]["root"] == str(ROOT)
    assert healthy["strata"]["python"] == ".".join(map(str, sys.version_info[:3]))
    assert healthy["packages"]["numpy"]
    vulkan = healthy["vulkan"]
    assert vulkan["loader"]["version"].startswith("1.")
    devices = vulkan_instance.devices()
    assert [device["name"] for device in vulkan["devices"]] == [device.name for device in devices]
    assert [device["driver"] for device in vulkan["devices"]] == [device.driver for device in devices]
    assert set(vulkan["layers"]) >= set(vulkan_instance.layers)
    assert any("problem" not in compiler for compiler in healthy["compilers"])
    chosen = vulkan["devices"][vulkan["chosen"]]
    assert chosen["unfit"] is None
    assert set(chosen["features"]) | chosen["why_not"].keys() == FEATURES.keys()


def test_every_chapter_has_a_plan(healthy) -> None:
    assert list(healthy["plan"]) == [chapters.folder_name(number) for number in chapters.available()]
    for number in chapters.available():
        plan = healthy["plan"][chapters.folder_name(number)]
        needs = chapters.lesson(number).needs
        assert {choice["feature"] for choice in plan["choices"]} == needs.required | needs.optional
        for choice in plan["choices"]:
            assert choice["path"] == FEATURES[choice["feature"]][0 if choice["native"] else 1]
            assert choice["reason"]


def test_the_tables_show_what_the_report_says(healthy) -> None:
    text = shown(healthy)
    chosen = healthy["vulkan"]["devices"][healthy["vulkan"]["chosen"]]
    by_gl = healthy["auto"]["backend"] == "gl"
    used = healthy["opengl"]["device"] if by_gl else chosen
    assert text.startswith(f"Strata draws on {used['name']}")
    taken = "OpenGL" if by_gl else "Vulkan"
    assert text.splitlines()[1] == f"--backend auto takes {taken}: {healthy['auto']['reason']}."
    assert f"How the chapters run here, by {taken}" in text
    for part in (chosen["driver"], healthy["vulkan"]["loader"]["version"], "ch01", "anisotropy", "numpy"):
        assert part in text
    for feature, reason in chosen["why_not"].items():
        assert feature in text
        assert (
            feature in chosen["advertised"] or reason.split(":")[0] in text
        )  # else its verdict stands there


def test_a_first_cell_that_repeats_is_left_empty(healthy) -> None:
    """The table of what is here, of a device's features, and of the chapters' plans."""
    number = healthy["vulkan"]["chosen"]
    device = healthy["vulkan"]["devices"][number] | {
        "advertised": ["fp64"],
        "broken": {},
        "why_not": {},
        "verdicts": {"fp64": {"first use": "ok", "second use": "ok"}},
    }
    taken = [{"feature": name, "path": "a path", "reason": "a reason"} for name in ("feature a", "feature b")]
    compiler = healthy["compilers"][0]
    text = shown(
        healthy
        | {
            "environment": {"STRATA_A": "1", "VK_B": "2"},
            "compilers": [compiler | {"path": "/compiler/a"}, compiler | {"path": "/compiler/b"}],
            "vulkan": healthy["vulkan"] | {"devices": [device], "chosen": device["number"]},
            "opengl": healthy["opengl"] | {"device": None},
            "auto": {"backend": "vulkan", "reason": "a reason"},
            "plan": {"ch01": {"runs": True, "problem": None, "choices": taken}},
        }
    )
    lines = text.splitlines()

    def first_cell(part: str) -> str:
        (line,) = [line for line in lines if part in line]
        return line.partition("  ")[0].strip()

    for once, again, label in (
        ("STRATA_A=1", "VK_B=2", "environment"),
        ("/compiler/a", "/compiler/b", "GLSL compiler"),
        ("first use", "second use", "fp64"),
        ("feature a", "feature b", "ch01"),
    ):
        assert first_cell(once) == label and first_cell(again) == ""


# --- a machine with OpenGL alone ----------------------------------------------------------------------------


@pytest.mark.feature("cli/doctor")
@pytest.mark.runs_on("gl")
@pytest.mark.skipif(sys.platform != "linux", reason="drivers are found in other ways there")
def test_opengl_alone_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    if "problem" in doctor.ask("gl"):
        pytest.skip("no OpenGL 4.5")
    monkeypatch.delenv("STRATA_DEVICE", raising=False)
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setenv("VK_DRIVER_FILES", "/nonexistent")
    code, report = examined()
    assert code == 0
    assert report["works"] is True
    assert report["problem"] is None
    assert report["auto"]["backend"] == "gl"
    assert WHY_NO_VULKAN in report["auto"]["reason"]
    assert report["vulkan"]["chosen"] is None
    device = report["opengl"]["device"]
    assert set(device["features"]) | device["why_not"].keys() == FEATURES.keys()
    for number in chapters.available():
        entry = report["plan"][chapters.folder_name(number)]
        needs = chapters.lesson(number).needs
        assert entry["runs"]
        assert {choice["feature"] for choice in entry["choices"]} == needs.required | needs.optional
        for choice in entry["choices"]:
            assert choice["native"] == (choice["feature"] in device["features"])
    text = shown(report)
    assert text.startswith(f"Strata draws on {device['name']}")
    assert text.splitlines()[1].startswith("--backend auto takes OpenGL: ")
    assert report["opengl"]["device"]["kind"] != "software" or "so Strata draws with OpenGL" in text
    assert "cannot draw" not in text
    assert "does not run" not in text


GPU = {"name": "A card", "kind": "discrete"}
SOFTWARE = {"name": "llvmpipe", "kind": "software"}


@pytest.mark.parametrize(
    ("vulkan", "gl", "gpu", "backend"),
    [
        (GPU, GPU, True, "vulkan"),
        (SOFTWARE, GPU, True, "gl"),  # an old card: hardware before software
        (SOFTWARE, SOFTWARE, True, "vulkan"),
        (SOFTWARE, GPU, False, "vulkan"),
        (None, SOFTWARE, False, "gl"),
        (None, None, True, None),
    ],
)
def test_the_backend_is_the_one_that_auto_takes(
    monkeypatch: pytest.MonkeyPatch, vulkan: Any, gl: Any, gpu: bool, backend: str | None
) -> None:
    monkeypatch.setattr(doctor.choice, "decide", functools.partial(doctor.choice.decide, gpu=lambda: gpu))
    found = doctor.automatic({}, vulkan, {}, gl)
    assert (found and found.backend) == backend
    assert doctor.automatic({"refused": True}, None, {}, gl) is None  # STRATA_DEVICE names no device here


# --- machines that do not -----------------------------------------------------------------------------------

NOTHING = {"VK_DRIVER_FILES": "/nonexistent", "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent"}


@pytest.mark.feature("cli/doctor")
@pytest.mark.skipif(sys.platform != "linux", reason="drivers are found in other ways there")
@pytest.mark.needs("glcontext")
def test_without_a_driver_it_says_so_and_what_to_install() -> None:
    done = strata("doctor", **NOTHING)
    assert done.returncode == 2
    lines = done.stdout.splitlines()
    said = f"Strata cannot draw here: {WHY_NO_VULKAN}; no OpenGL 4.5"
    assert lines[0].startswith(said)
    assert "VK_DRIVER_FILES is set, and what it names does not exist (/nonexistent): unset it." in lines[1]
    assert any("Strata needs Vulkan 1.3" in line for line in lines[2:])
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="drivers are found in other ways there")
def test_without_a_driver_the_report_is_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in NOTHING.items():
        monkeypatch.setenv(name, value)
    code, report = examined(selftest=True)
    assert code == 2
    assert report.keys() == KEYS
    assert report["works"] is False
    assert report["install"]
    if LOADER:
        assert report["vulkan"]["loader"]["version"]  # the loader itself is there
    assert report["vulkan"]["chosen"] is None
    assert report["environment"]["VK_DRIVER_FILES"] == "/nonexistent"
    assert all(plan["problem"] == "no device works" for plan in report["plan"].values())


def test_a_device_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch, vulkan_instance) -> None:
    monkeypatch.setenv("STRATA_DEVICE", "no such card")
    code, report = examined()
    assert code == 2
    assert "matches 'no such card'" in shown(report).splitlines()[0]


CHILD = """
import os, signal, sys, time
print('{"loader": {"name": "x", "path": "/x", "version": "1.3.1"}}', flush=True)
print('the driver says hello', flush=True)
print('{"device": {"number": 0}}\\n{"device": {"number": 1}}', flush=True)
if sys.argv[1] == "crash":
    os.kill(os.getpid(), signal.SIGSEGV)
if sys.argv[1] == "hang":
    time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals")
@pytest.mark.parametrize(
    ("end", "problem"),
    [
        ("crash", "what asks for it crashed (signal 11, SIGSEGV)"),
        ("hang", "what asks for it hung (stopped after 1.5 s)"),
        ("well", None),
    ],
)
def test_what_was_said_before_a_crash_is_kept(tmp_path: Path, end: str, problem: str | None) -> None:
    script = tmp_path / "child.py"
    script.write_text(CHILD)
    answers = doctor.ask(end, 1.5 if end == "hang" else 20.0, (sys.executable, "-S", str(script)))
    assert answers["loader"]["version"] == "1.3.1"
    assert answers["devices"] == [{"number": 0}, {"number": 1}]
    assert answers.get("problem") == problem


def test_nothing_at_all_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every question fails; the report is whole, the tables print, and the first line is a sentence."""

    def fail(*_: object) -> Any:
        raise RuntimeError("odd machine")

    monkeypatch.setattr(doctor, "ask", lambda what: {"problem": f"{what} crashed"})
    for name in ("_what_to_install", "_strata", "driver_manifests", "hidden_package", "libraries"):
        monkeypatch.setattr(doctor, name, fail)
    report = doctor.report()
    assert report.keys() == KEYS
    assert json.loads(json.dumps(report)) == report
    assert shown(report).startswith("Strata cannot draw here: vulkan crashed; gl crashed.\n")


# --- plans, self-tests, advice ------------------------------------------------------------------------------

DEVICE: dict[str, Any] = {
    "number": 0,
    "name": "Test GPU",
    "driver": "testdriver 1",
    "build": "00",
    "kind": "discrete",
    "api": "1.3.0",
    "unfit": None,
    "extensions": 3,
    "queues": [{"family": 0, "queues": 1, "kinds": ["graphics", "compute"]}],
    "advertised": ["fp64", "sparse"],
    "features": ["sparse"],
    "why_not": {"fp64": "its self-test failed (arithmetic): wrong: half", "bindless": "the driver lacks X"},
    "broken": {"fp64/arithmetic": "wrong: half", "sparse/attachment": "wrong: rows"},
    "limits": {},
    "verdicts": None,
}


def test_a_plan_takes_the_fallback_of_what_failed(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = {
        1: Needs(optional=frozenset({"fp64", "sparse"})),
        2: Needs(required=frozenset({"bindless"})),
        3: None,
    }

    def lesson(number: int) -> Lesson:
        if needs[number] is None:
            raise SyntaxError("half a file")
        return Lesson(number, "A lesson", needs=needs[number])

    monkeypatch.setattr(chapters, "available", lambda: (1, 2, 3))
    monkeypatch.setattr(chapters, "lesson", lesson)
    plan = doctor.plans(doctor.capabilities_of(DEVICE))
    by_feature = {choice["feature"]: choice for choice in plan["ch01"]["choices"]}
    assert by_feature["sparse"]["native"]
    assert by_feature["fp64"]["path"] == "32-bit floats"
    assert "wrong: half" in by_feature["fp64"]["reason"]
    assert not plan["ch02"]["runs"]
    assert "the driver lacks X" in plan["ch02"]["problem"]
    assert plan["ch03"]["problem"] == "it cannot be imported: SyntaxError: half a file"


def test_a_device_that_failed_is_tried_again_when_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not chosen as long as its verdicts say that it crashed."""
    unfit = {**DEVICE, "unfit": "its self-test failed (drawing/pulled): crashed"}
    tried: list[bool] = []

    def ask(what: str) -> dict[str, Any]:
        if what != "vulkan":
            return {"problem": "none"}
        return (
            {"devices": [DEVICE], "chosen": 0} if True in tried else {"devices": [unfit], "problem": "unfit"}
        )

    monkeypatch.setattr(doctor, "ask", ask)
    monkeypatch.setattr(run, "judge_device", lambda *_, again: tried.append(again))
    monkeypatch.setattr(doctor.trial, "judge", lambda *_: None)
    assert not doctor.report()["works"]
    assert doctor.report(selftest=True)["works"]


def test_selftest_tries_what_is_advertised_and_asks_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    tried: list[tuple[Any, ...]] = []
    after = {**DEVICE, "verdicts": {"fp64": {"arithmetic": "wrong: half"}, "sparse": {"sampled": "ok"}}}

    def ask(what: str) -> dict[str, Any]:
        asked.append(what)
        return {"devices": [after if tried else DEVICE], "chosen": 0} if what == "vulkan" else {}

    def judge_device(backend, identity, number, advertised, told, again):
        tried.append((backend, identity.device, identity.driver, number, tuple(advertised), again))
        told("fp64/arithmetic", "")
        told("fp64/arithmetic", "wrong: half")

    monkeypatch.setattr(doctor, "ask", ask)
    monkeypatch.setattr(run, "judge_device", judge_device)
    monkeypatch.setattr(doctor.trial, "judge", lambda *_: None)
    heard: list[str] = []
    report = doctor.report(selftest=True, progress=lambda what, part: heard.append(what))
    assert tried[0] == ("vulkan", "Test GPU", "testdriver 1", 0, ("fp64", "sparse"), True)
    assert not any(again for *_, again in tried[1:])
    assert asked.count("vulkan") >= 2
    assert "trying fp64/arithmetic (Vulkan)" in heard
    rows = [line.split() for line in shown(report).splitlines()]
    assert ["fp64", "arithmetic", "wrong:", "half"] in rows
    assert ["sparse", "attachment", "wrong:", "rows"] in rows
    assert ["sampled", "works"] in rows
    assert ["bindless", "missing:", "the", "driver", "lacks", "X"] in rows


@pytest.mark.parametrize(
    ("driver", "features", "newer"),
    [
        ("llvmpipe Mesa 22.3.6 (LLVM 15.0.6)", sorted(doctor.MESA_25 - {"sparse", "ray-query"}), 2),
        ("llvmpipe Mesa 24.2.8", sorted(doctor.MESA_25), 0),
        ("llvmpipe Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)", [], 0),
        ("radv Mesa 22.3.6", [], 0),
        ("NVIDIA 580.1", [], 0),
    ],
)
def test_what_a_newer_mesa_adds(driver: str, features: list[str], newer: int) -> None:
    found = doctor.mesa_adds(driver, features)
    assert len(found) == newer
    assert set(found) <= {"sparse", "ray-query"}


def test_the_newer_mesa_has_what_the_table_says(healthy) -> None:
    device = healthy["vulkan"]["devices"][healthy["vulkan"]["chosen"]]
    if not device["driver"].startswith("llvmpipe Mesa 25.0"):
        pytest.skip("the table was read off the software driver of Mesa 25.0")
    assert set(device["advertised"]) == doctor.MESA_25


# --- what is hidden -----------------------------------------------------------------------------------------


def test_a_second_package_is_found_wherever_it_stands(tmp_path: Path) -> None:
    other = tmp_path / "common"
    other.mkdir()
    (other / "__init__.py").write_text("")
    own = str(ROOT)
    assert doctor.hidden_package("common", [own]) == []
    assert doctor.hidden_package("common", [own, own]) == []
    assert doctor.hidden_package("common", []) == []
    behind = doctor.hidden_package("common", [own, str(tmp_path)])
    assert len(behind) == 1
    assert behind[0].startswith(f"A second package 'common' lies at {other.resolve()}")
    before = doctor.hidden_package("common", [str(tmp_path), own])
    assert len(before) == 1
    assert "hides Strata's own" in before[0]


@pytest.mark.skipif(sys.platform != "linux", reason="where the loaders of Linux lie")
def test_a_second_loader_and_drivers_are_found(tmp_path: Path) -> None:
    library = tmp_path / "libvulkan.so.1"
    library.write_bytes(b"")
    (tmp_path / "vulkan" / "icd.d").mkdir(parents=True)
    manifest = tmp_path / "vulkan" / "icd.d" / "a.json"
    manifest.write_text("{}")
    assert str(library) in doctor.libraries({"LD_LIBRARY_PATH": f"/nonexistent:{tmp_path}"})
    assert str(manifest) in doctor.driver_manifests({"XDG_DATA_HOME": str(tmp_path)})
    assert doctor.driver_manifests({"VK_DRIVER_FILES": "/a.json:/b.json"}) == ["/a.json", "/b.json"]
    found = {
        "environment": {"LD_LIBRARY_PATH": str(tmp_path), "LIBGL_ALWAYS_SOFTWARE": "1"},
        "vulkan": {"loader": {"path": "/usr/lib/libvulkan.so.1.3"}},
    }
    sentences = doctor.shadowed(found)
    assert any(str(library) in sentence for sentence in sentences)
    assert any(sentence.startswith("LIBGL_ALWAYS_SOFTWARE=1 is set") for sentence in sentences)


def test_variables_that_matter_are_shown_and_others_are_not(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in os.environ if doctor.VARIABLES.match(name)]:
        monkeypatch.delenv(name)
    names = ("VK_LAYER_PATH", "STRATA_DEVICE", "LIBGL_DEBUG", "MESA_LOADER_DRIVER_OVERRIDE", "LP_NUM_THREADS")
    for name in (*names, "HOME2", "SECRET_TOKEN"):
        monkeypatch.setenv(name, "value")
    monkeypatch.setattr(doctor, "ask", lambda what: {})
    monkeypatch.setattr(doctor, "_what_to_install", lambda: "")
    assert set(doctor.report()["environment"]) == set(names)
