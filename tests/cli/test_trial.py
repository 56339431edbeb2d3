"""A chapter is tried on a driver before its first use: what crashes, hangs or draws something else is not taken."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import chapters
from backends import choice
from backends.choice import Choice
from backends.selftest import run, verdicts
from backends.selftest.verdicts import UNCHECKED, Identity
from common.errors import UnsupportedError
from tools.doctor import trial

VULKAN, GL = Identity("a card", "driver 1", "00"), Identity("llvmpipe", "Mesa 1", "OpenGL")


class Tried:
    """Drivers on which chapters end as `ends` says, by (backend, chapter); `asked` are those that were tried."""

    def __init__(self) -> None:
        self.ends: dict[tuple[str, int], str] = {}
        self.asked: list[tuple[str, int]] = []

    def judge_all(self, backend, number, uses, told=None, *, timeout_s, child):
        use = uses[0]
        key = backend, int(use.partition("/")[0].removeprefix("chapter-"))
        self.asked.append(key)
        feature, _, what = use.partition("/")
        return {feature: {what: self.ends.get(key, "ok")}}


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Tried:
    """Both backends there, Vulkan on a graphics card, and nothing known of them yet."""
    made = Tried()
    kinds = {"vulkan": ("discrete", VULKAN.device), "gl": ("software", GL.device)}
    monkeypatch.setenv("STRATA_VERDICTS", str(tmp_path / "verdicts"))
    monkeypatch.setattr(verdicts, "_unkept", {})
    monkeypatch.setattr(run, "judge_all", made.judge_all)
    monkeypatch.setattr(choice, "probe", lambda backend: kinds[backend])
    monkeypatch.setattr(choice, "identities", {"vulkan": VULKAN, "gl": GL})
    trial.problem_of.cache_clear()
    yield made
    trial.problem_of.cache_clear()


def again() -> None:
    """What another process finds."""
    trial.problem_of.cache_clear()


def test_a_chapter_is_tried_once_for_a_driver(tried: Tried) -> None:
    for _ in range(2):
        assert chapters.decide_backend("auto", 1) == Choice("vulkan", "Vulkan on a card")
        again()
    assert chapters.choose_backend("auto", 2) == "vulkan"
    assert tried.asked == [("vulkan", 1), ("vulkan", 2)]


def test_auto_takes_the_other_backend_and_says_why(tried: Tried) -> None:
    tried.ends["vulkan", 2] = "crashed (signal 11, SIGSEGV)"
    found = chapters.decide_backend("auto", 2)
    assert found.backend == "gl"
    assert found.reason == (
        "OpenGL's software driver (llvmpipe), since chapter 2 does not run by Vulkan on a card: "
        "its trial crashed (signal 11, SIGSEGV) (./strata doctor --selftest tries it again)"
    )
    assert chapters.choose_backend("auto", 1) == "vulkan"


def test_a_backend_that_was_asked_for_is_refused_with_the_reason(tried: Tried) -> None:
    tried.ends["vulkan", 2] = "hung (stopped after 60 s)"
    tried.ends["gl", 3] = "wrong: black"
    with pytest.raises(
        UnsupportedError, match=r"^Chapter 2 does not run by Vulkan .*: its trial hung \(stopped"
    ):
        chapters.choose_backend("vulkan", 2)
    with pytest.raises(
        UnsupportedError, match=r"^Chapter 3 does not run by OpenGL .*: its trial wrong: black"
    ):
        chapters.choose_backend("gl", 3)
    assert chapters.choose_backend("gl", 2) == "gl"


def test_where_no_backend_is_left_the_sentence_names_both(tried: Tried) -> None:
    tried.ends["vulkan", 4] = "crashed (signal 11, SIGSEGV)"
    tried.ends["gl", 4] = "hung (stopped after 60 s)"
    with pytest.raises(UnsupportedError) as caught:
        chapters.choose_backend("auto", 4)
    text = str(caught.value)
    assert "by Vulkan on a card: its trial crashed" in text
    assert "by OpenGL on llvmpipe: its trial hung" in text
    assert text.endswith("(./strata doctor --selftest tries it again).")


def test_a_failure_is_void_once_the_chapter_changed_and_a_success_is_not(
    tried: Tried, monkeypatch: pytest.MonkeyPatch
) -> None:
    tried.ends["vulkan", 1] = "crashed (signal 11, SIGSEGV)"
    chapters.choose_backend("auto", 1)
    chapters.choose_backend("auto", 2)
    before = len(tried.asked)
    again()
    assert chapters.choose_backend("auto", 1) == "gl"
    assert len(tried.asked) == before  # both verdicts are kept
    tried.ends.clear()
    monkeypatch.setattr(trial, "_files", lambda number: "other files")
    again()
    assert chapters.choose_backend("auto", 1) == "vulkan"
    assert chapters.choose_backend("auto", 2) == "vulkan"
    assert tried.asked[before:] == [("vulkan", 1)]


def test_what_could_not_be_tried_is_taken_and_tried_again(tried: Tried) -> None:
    tried.ends["vulkan", 1] = f"{UNCHECKED}: no compiler"
    for _ in range(2):
        assert chapters.choose_backend("auto", 1) == "vulkan"
        again()
    assert tried.asked == [("vulkan", 1)] * 2


def test_a_study_is_not_tried_and_goes_by_what_is_known_of_its_chapter(tried: Tried) -> None:
    tried.ends["vulkan", 1] = "crashed (signal 11, SIGSEGV)"
    assert chapters.choose_backend("auto", "1/first-triangle") == "vulkan"
    assert tried.asked == []
    assert chapters.choose_backend("auto", 1) == "gl"
    assert chapters.choose_backend("auto", "1/first-triangle") == "gl"


def test_studies_and_devices_alone_are_not_tried(monkeypatch: pytest.MonkeyPatch, vulkan_instance) -> None:
    asked: list[int] = []
    monkeypatch.setattr(trial, "problem_of", lambda number, backend: asked.append(number) or "")
    chapters.choose_backend("auto", "1/first-triangle")
    chapters.choose_backend("vulkan")
    assert asked == []
    chapters.choose_backend("vulkan", 1)
    assert asked == [1]


# --- the frame --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_the_newest_chapter_passes_its_trial_in_a_child(backend: str, vulkan_instance) -> None:
    """The child of a real trial says ok for the newest chapter, on either backend."""
    number = chapters.available()[-1]
    found = run.judge_all(
        backend, 0, [f"chapter-{number}/frame"], timeout_s=trial.TIMEOUT_S, child=trial.CHILD
    )
    assert found == {f"chapter-{number}": {"frame": "ok"}}


@pytest.mark.parametrize(
    ("file", "before", "after", "seen"),
    [
        ("post/tonemap.frag", "out_color =", "discard; out_color =", "a red square under a lamp"),
        (
            "shading/forward.frag",
            "vec4 base = material.base_color;",
            "vec4 base = vec4(0.5);",
            "a texture of light",
        ),
    ],
)
def test_a_chapter_that_draws_something_else_fails(
    tmp_path: Path, file: str, before: str, after: str, seen: str, vulkan_instance
) -> None:
    """In a copy of the clone in which one shader is wrong."""
    from common.paths import ROOT

    for name in ("common", "backends", "chapters", "shaders"):
        (tmp_path / name).mkdir()
        shutil.copytree(
            ROOT / name,
            tmp_path / name,
            dirs_exist_ok=True,
            ignore=shutil.ignore_patterns("__pycache__", "ch0[2-9]"),
        )
    shader = tmp_path / "chapters" / "ch01" / file
    text = shader.read_text()
    assert before in text
    shader.write_text(text.replace(before, after, 1))
    child = run.child_environment()
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tools.doctor.trial", "vulkan", "0", "chapter-1/frame"],
        env={**child, "PYTHONPATH": os.pathsep.join([str(tmp_path), child["PYTHONPATH"]])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
    )
    verdict = json.loads(done.stdout.splitlines()[-1])["verdict"]
    assert verdict.startswith(f"wrong: {seen}"), verdict + done.stderr
