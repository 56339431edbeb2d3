"""Forks: a folder anywhere on disk with a copy of a chapter is run, shown, measured and tested as a chapter is."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import chapters
from chapters import folders, scenes, studies
from chapters.__main__ import is_readers
from chapters.folders import Folder
from common.errors import UserError
from common.images import read_image
from common.paths import ROOT
from tools.bench import points, prepared
from tools.ledger.testing import pytest_arguments
from tools.run.live import Live
from tools.run.run import validation
from tools.snapshots.forks import make_fork

pytestmark = pytest.mark.feature("tools/fork")

SIZE = (24, 16)
SMALL = ("--size", "24x16", "--scene", "cornell")
EDITED = (
    "post/tonemap.frag",
    "void main() {",
    "void main() {\n    if (gl_FragCoord.x < 9.0) { out_color = vec4(1); return; }",
)
"""A change of a shader that any picture shows: the left of it is white."""


def copied(folder: Path, number: int = 1) -> Path:
    """Return a new fork of a chapter, without studies and without fork.json."""
    ignored = shutil.ignore_patterns("__pycache__", "studies", "README.md")
    shutil.copytree(chapters.FOLDER / chapters.folder_name(number), folder, ignore=ignored)
    return folder


def edit(fork: Path, file: str, before: str, after: str) -> None:
    """Change one place in a file of a fork."""
    text = (fork / file).read_text("utf-8")
    assert text.count(before) == 1
    (fork / file).write_text(text.replace(before, after), "utf-8", newline="")


@pytest.fixture
def fork(tmp_path) -> Path:
    """A fork of chapter 1 in a folder with a space and letters beyond ASCII; `strata` runs two folders above it."""
    return copied(tmp_path / "wörk" / "my ch01")


NAME = "wörk/my ch01"


# --- what a word means ------------------------------------------------------------------------------------------------


def test_numbers_studies_and_folders_are_told_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mine, digit = copied(tmp_path / "mine"), copied(tmp_path / "1")
    assert [chapters.parse(text) for text in ("1", "01", "ch01", 1)] == [1, 1, 1, 1]
    assert chapters.parse("1/first-triangle") == "1/first-triangle"
    assert chapters.parse("./1") == chapters.parse(Path("1")) == Folder(digit.resolve())
    for text in ("mine", "./mine", "mine/", str(mine), mine, "../" + tmp_path.name + "/mine"):
        assert chapters.parse(text) == Folder(mine.resolve())
    monkeypatch.chdir(mine)
    here = chapters.parse(".")
    assert here == Folder(mine.resolve()) and here.spoken == "mine" and str(here) == "."
    assert chapters.parse(chapters.FOLDER / "ch01") == chapters.parse(f"{chapters.FOLDER}/ch01/") == 1
    assert chapters.parse(here) is here


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("my ch1", "There is no chapter 'my ch1'; did you mean 'my ch01'?"),
        ("./my ch1", "There is no folder ./my ch1; did you mean 'my ch01'?"),
        ("nowhere/at/all", "There is no folder nowhere/at/all."),
        ("empty", "empty holds no copy of a chapter: it has no __init__.py and no renderer.py."),
        (
            "my ch01/renderer.py",
            "my ch01/renderer.py is a file: name the folder that holds the copy of a chapter.",
        ),
        ("1/my ch01", "Chapter 1 has no study 'my ch01'"),
    ],
)
def test_what_is_no_folder_of_a_chapter_is_said(text, says, fork, monkeypatch):
    (fork.parent / "empty").mkdir()
    monkeypatch.chdir(fork.parent)
    with pytest.raises(UserError) as caught:
        chapters.parse(text)
    assert str(caught.value).startswith(says)


def test_a_fork_without_its_lesson_says_so(fork, strata):
    (fork / "__init__.py").write_text("'''Nothing.'''\n")
    code, _, err = strata("list", NAME)
    assert code == 2
    assert err == (
        f"strata: {fork.resolve() / '__init__.py'} has no LESSON: a copy of a chapter keeps that of the chapter, "
        "with its number.\n"
    )


def test_a_study_of_a_fork_is_named_by_the_fork_or_by_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("mine", "3"):
        make_fork(1, tmp_path / name, studies=True)
    for text in (
        "mine/first-triangle",
        "mine/First_Triangle",
        "./mine/studies/first_triangle/",
        Path("mine/first-triangle"),
    ):
        assert chapters.parse(text) == "mine/first-triangle"
    assert studies.split("mine/first-triangle") == (Folder((tmp_path / "mine").resolve()), "first-triangle")
    assert studies.chapter("mine/first-triangle") == 1
    digit = chapters.parse("./3/first-triangle")
    assert studies.split(digit) == (Folder((tmp_path / "3").resolve()), "first-triangle"), "not chapter 3"
    assert chapters.parse(chapters.FOLDER / "ch01" / "studies" / "first_triangle") == "1/first-triangle"
    copied(tmp_path / "bare")
    for text, says in (
        ("mine/first-triange", "Fork mine has no study 'first-triange'; did you mean 'first-triangle'?"),
        (
            "bare/first-triangle",
            "Fork bare has no study 'first-triangle'; `strata fork 1 DIR --studies` makes a fork",
        ),
        ("mine/renderer.py", "mine/renderer.py is a file"),
        ("mine/shading", "mine/shading holds no copy of a chapter"),
    ):
        with pytest.raises(UserError) as caught:
            chapters.parse(text)
        assert str(caught.value).startswith(says)


# --- commands ---------------------------------------------------------------------------------------------------------


def test_a_copy_draws_what_its_chapter_draws_and_an_edit_shows(fork, strata, tmp_path):
    pictures = []
    for which, out in (("1", "a.png"), (NAME, "b.png")):
        code, _, err = strata("run", which, *SMALL, "--out", out)
        assert code == 0, err
        pictures.append(read_image(tmp_path / out)[..., :3])
    assert f"Fork {NAME}, cornell, 24x16, " in err
    assert np.array_equal(*pictures)
    edit(fork, *EDITED)
    assert strata("run", NAME, *SMALL, "--json", "r.json")[0] == 0
    edited = read_image(tmp_path / "out" / "my-ch01-cornell.png")[..., :3]
    assert (edited[:, :9] == 255).all()
    assert np.array_equal(edited[:, 9:], pictures[0][:, 9:])
    record = json.loads((tmp_path / "r.json").read_text())
    assert (record["chapter"], record["fork"]) == (1, str(fork.resolve()))


def test_a_folder_with_the_name_of_a_chapter_is_named_so_that_commands_find_it(strata, tmp_path):
    for words, run in ((("1/first-triangle", "3"), "./3/first-triangle"), (("1", "ch01"), "./ch01")):
        code, _, err = strata("fork", *words)
        assert code == 0 and f"`strata run {run}` draws with it" in err
        assert chapters.parse(run) is not None
    (tmp_path / ".base").mkdir()
    for name in folders.NEEDED:
        (tmp_path / ".base" / name).write_text("")
    assert ".base" not in folders.beside()


def test_a_study_of_one_api_says_why_that_one_is_used():
    found = chapters.decide_backend("auto", "4/barriers")
    assert (found.backend, found.reason) == ("vulkan", "Vulkan, the only API of this study")
    assert chapters.decide_backend("vulkan", "4/barriers").reason == "asked for"


def test_an_empty_word_is_no_folder(monkeypatch, fork):
    monkeypatch.chdir(fork)
    for text in ("", " "):
        with pytest.raises(UserError, match="There is no chapter"):
            chapters.parse(text)


def test_a_study_of_a_fork_is_updated_with_the_fork(strata, tmp_path):
    make_fork(1, tmp_path / "mine", studies=True)
    code, _, err = strata("fork", "--update", "mine/first-triangle")
    assert code == 2 and "mine is one: `strata fork --update mine` takes it whole" in err


@pytest.mark.parametrize("word", ["4/memory", "mine/memory", "mine/studies/memory"])
def test_a_study_is_no_word_of_strata_test(tmp_path, monkeypatch, word):
    monkeypatch.chdir(tmp_path)
    make_fork(4, tmp_path / "mine", studies=True)
    with pytest.raises(UserError, match="is a study, and this is about whole chapters"):
        pytest_arguments([word])


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_study_is_forked_and_an_edit_of_its_shader_shows(strata, tmp_path, backend, request):
    request.getfixturevalue("vulkan_instance" if backend == "vulkan" else "gl_context")
    code, out, err = strata("fork", "1/first-triangle", "my-ch01")
    place = tmp_path / "my-ch01" / "studies" / "first_triangle"
    assert code == 0 and f"The study first-triangle is in {place}." in out
    assert "`strata run my-ch01/first-triangle` draws with it" in err
    words = ("--size", "24x16", "--backend", backend)

    def drawn(which, name):
        code, _, err = strata("run", which, *words, "--out", name)
        assert code == 0 and f"Study {which}, " in err
        return read_image(tmp_path / name)

    theirs = drawn("1/first-triangle", "theirs.png")
    assert np.array_equal(drawn("my-ch01/first-triangle", "mine.png"), theirs)
    (fragment,) = place.glob("*.frag")
    text = fragment.read_text("utf-8")
    fragment.write_text(text.replace("void main() {", "void main() {\n    if (true) discard;"), "utf-8")
    assert not np.array_equal(drawn("my-ch01/first-triangle", "edited.png"), theirs)
    assert np.array_equal(drawn("1/first-triangle", "theirs.png"), theirs)
    assert str(place) in strata("list", "my-ch01/first-triangle")[1]
    listed = strata("list", "my-ch01")[1]
    assert "./strata run my-ch01/NAME" in listed and "first-triangle" in listed
    code, _, err = strata("fork", "my-ch01/first-triangle", "other")
    assert code == 2 and "my-ch01/first-triangle is a copy of a chapter" in err


def test_two_forks_in_one_process_are_two_packages(fork, tmp_path):
    other = copied(tmp_path / "other")
    edit(other, "shading/settings.py", '0.02, "linear grey', '0.5, "linear grey')
    whole = [1, fork, other]
    assert [chapters.settings_class(chapters.parse(which))().shading.background for which in whole] == [
        0.02,
        0.02,
        0.5,
    ]
    renderers = [chapters.renderer_module(chapters.parse(which), "gl").Renderer for which in whole]
    assert len({*renderers}) == 3
    again = Folder(other.resolve(), "another name for it")
    assert chapters.renderer_module(again, "gl").Renderer is renderers[2]
    texts = [Path(sys.modules[one.__module__].__file__).parent for one in renderers]
    assert texts == [chapters.FOLDER / "ch01", fork.resolve(), other.resolve()]


def test_a_path_opens_from_python(vulkan_device, fork):
    scene = scenes.load("cornell")
    with chapters.open(fork, "vulkan", scene=scene, size=SIZE, device=vulkan_device) as renderer:
        picture = renderer.render(chapters.view_of(renderer)).image("color")
        assert renderer.shader_files and any(path.is_relative_to(fork) for path in renderer.shader_files)
        assert not any(path.is_relative_to(chapters.FOLDER) for path in renderer.shader_files)
    with chapters.open(1, "vulkan", scene=scene, size=SIZE, device=vulkan_device) as renderer:
        assert np.array_equal(renderer.render(chapters.view_of(renderer)).image("color"), picture)


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_saved_shader_of_a_fork_is_drawn(fork, backend, vulkan_device, gl_context):
    device = vulkan_device if backend == "vulkan" else gl_context
    said: list[str] = []
    timer = iter(range(10**6))  # seconds: no look is too early
    opener = partial(chapters.open, fork, backend, scene=scenes.load("cornell"), size=SIZE, device=device)
    with Live(timer=lambda: next(timer), tell=said.append) as live, opener() as renderer:
        before = renderer.render(chapters.view_of(renderer)).image("color")
        assert not live.follow(renderer)
        edit(fork, *EDITED)
        assert any(live.follow(renderer) for _ in range(4))
        after = renderer.render(chapters.view_of(renderer)).image("color")
    assert "tonemap.frag: 1 pipeline built anew" in said[0]
    assert (after[:, :9] == 255).all() and np.array_equal(after[:, 9:], before[:, 9:])


def test_a_fork_is_listed_with_its_own_files_knobs_and_views(fork, strata):
    text = (fork / "renderer.py").read_text("utf-8")
    (fork / "renderer.py").write_text(text.replace('"""', '"""Mine alone. ', 1), "utf-8")
    edit(fork, "shading/settings.py", '0.02, "linear grey', '0.125, "linear grey')
    code, out, err = strata("list", NAME)
    assert code == 0, err
    assert out.startswith(f"Fork {NAME}: ")
    assert "Mine alone." in out and "Studies" not in out
    code, out, err = strata("list", NAME, "--settings")
    assert code == 0, err
    assert f"Settings of fork {NAME}" in out and "0.125" in out
    code, out, err = strata("list", NAME, "--views")
    assert code == 0, err
    assert f'./strata run "{NAME}" --view name' in out


def test_a_frame_of_a_fork_is_a_page(fork, strata, tmp_path):
    code, out, err = strata("frame", NAME, *SMALL, "--out", "page", "--json", "f.json", "--view", "normal")
    assert code == 0, err
    assert "A frame of the fork my ch01" in out
    assert "<h1>A frame of the fork my ch01: cornell</h1>" in (tmp_path / "page" / "index.html").read_text(
        "utf-8"
    )
    record = json.loads((tmp_path / "f.json").read_text())
    assert (record["chapter"], record["fork"]) == (1, str(fork.resolve()))


def test_a_bench_of_a_fork_starts_and_measures_the_fork(fork, strata, tmp_path, monkeypatch):
    """Least of all that can be measured: one frame of one preset."""
    every = points.points
    monkeypatch.setattr(points, "QUICK", replace(points.QUICK, warm_up=0, frames=1, samples=1))
    monkeypatch.setattr(points, "points", lambda kind: every(kind)[:1])
    monkeypatch.setattr(points, "stability_cases", lambda *_: [{"case": "none", "pixels_changed": 0.0}])
    monkeypatch.setattr(prepared, "sweeps", lambda *_: [])
    with (fork / "renderer.py").open("a", encoding="utf-8") as file:
        file.write("with Path(__file__).with_name('started').open('a') as file:\n    file.write('x')\n")
    code, out, err = strata("bench", NAME, "--quick", *SMALL, "--json", "b.json")
    assert code == 0, err
    assert "Fork my ch01: cornell, 24x16" in out
    assert (fork / "started").read_text() == "xxx", "a cold start, a warm one, and the process that measures"
    record = json.loads((tmp_path / "b.json").read_text())
    assert (record["chapter"], record["fork"]) == (1, str(fork.resolve()))
    code, _, err = strata("bench", NAME, "--record")
    assert code == 2 and "write that of a fork by --json FILE." in err


def test_a_preset_that_was_measured_holds_until_a_file_is_saved(fork):
    folder = chapters.parse(fork)
    before = folder.state()
    assert folder.state() == before
    later = time.time_ns() + 10**9
    os.utime(fork / "shading" / "sky.py", ns=(later, later))
    assert folder.state() != before


# --- validation and errors --------------------------------------------------------------------------------------------


def test_calls_of_a_fork_are_checked_unless_told_otherwise(fork, strata, vulkan_instance, gl_context):
    folder = chapters.parse(fork)
    assert validation(folder, False, True, "gl") is True
    assert validation(folder, False, False, "gl") is False
    assert validation(1, False, True, "gl") is False
    assert validation(1, True, True, "gl") is True
    with pytest.raises(UserError, match="cannot both be meant"):
        validation(folder, True, False, "gl")
    if not vulkan_instance.validates:
        pytest.skip("no validation layers")
    # The picture is read by the last pass as if it were still drawn to.
    edit(
        fork,
        "renderer.py",
        'image_barrier(hdr.handle, hdr.aspect, "color", "sampled"), self._start("color", "color")',
        'image_barrier(hdr.handle, hdr.aspect, "color", "color"), self._start("color", "color")',
    )
    words = ("run", NAME, *SMALL, "--backend", "vulkan", "--set", "msaa=1", "--out", "a.png")
    code, _, err = strata(*words)
    line = next(
        n
        for n, text in enumerate((fork / "post" / "fullscreen.py").read_text("utf-8").splitlines(), 1)
        if "draw_fullscreen" in text
    )
    assert code == 1 and "VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL" in err
    assert f"called from {fork.resolve() / 'post' / 'fullscreen.py'}:{line} in pass tonemap: error: " in err
    assert strata(*words, "--no-validate")[0] == 0


FAULTS = {
    "a name that is not there": (
        "post/tonemap.py",
        "\nclass ",
        "\nabsent\n\n\nclass ",
        "NameError: name 'absent'",
        "absent",
    ),
    "half a line": (
        "post/tonemap.py",
        "\nclass ",
        "\ndef (\n\n\nclass ",
        "SyntaxError: invalid syntax",
        "def (",
    ),
    "a division in a frame": (
        "post/fullscreen.py",
        "        commands.draw_fullscreen(pipeline)",
        "        1 / 0",
        "ZeroDivisionError: division by zero",
        "1 / 0",
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_a_fork_shows_the_fork_s_lines_alone(name, fork, strata):
    file, before, after, says, line = FAULTS[name]
    edit(fork, file, before, after)
    words = ("run", NAME, *SMALL, "--backend", "vulkan", "--out", "a.png", "--no-validate")
    code, _, err = strata(*words)
    assert code == 1
    first, *rest = err.splitlines()
    assert first.startswith(f"strata: {says}")
    shown = [text for text in rest if text.lstrip().startswith('File "')]
    assert shown and all(f'File "{fork.resolve()}' in text for text in shown)
    assert str(Path(file)) in shown[-1] and line in "\n".join(rest)
    whole = strata(*words, "-v")[2]
    assert (
        str(ROOT / "tools" / "run" / "run.py") in whole
        or str(ROOT / "tools" / "cli" / "commands.py") in whole
    )


def test_a_wrong_shader_of_a_fork_is_named_with_its_line(fork, strata):
    edit(fork, "post/tonemap.frag", "void main() {", "void main() {\n    float x = nowhere;")
    code, _, err = strata("run", NAME, *SMALL, "--backend", "vulkan", "--out", "a.png", "--no-validate")
    assert code == 1
    lines = (fork / "post" / "tonemap.frag").read_text("utf-8").splitlines()
    number = lines.index("    float x = nowhere;") + 1
    assert err.startswith(f"strata: {fork.resolve() / 'post' / 'tonemap.frag'}:{number}: error: 'nowhere'")
    assert "Traceback" not in err and 'File "' not in err


def test_a_fork_beside_the_project_s_folders_is_the_reader_s_code(tmp_path, monkeypatch):
    monkeypatch.setattr("chapters.__main__.ROOT", tmp_path)
    files = (
        "my-ch01/renderer.py",
        "chapters/ch01/renderer.py",
        "tools/run/run.py",
        "common/a.py",
        ".venv/site-packages/a.py",
    )
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text("")
    assert [is_readers(tmp_path / file) for file in files] == [True, True, False, False, False]


# --- tests ------------------------------------------------------------------------------------------------------------


def test_a_fork_is_tested_by_the_tests_of_its_chapter(fork, monkeypatch):
    monkeypatch.chdir(fork.parent)
    expected = ["tests/ch01", "tests/stability/test_ch01.py", f"--chapter={fork.resolve()}"]
    assert pytest_arguments(["my ch01", "-x"]) == pytest_arguments(["./my ch01", "-x"]) == [*expected, "-x"]
    assert pytest_arguments(["-k", "my ch01"]) == ["-k", "my ch01"]
    with pytest.raises(UserError, match=r"There are no tests called 'my ch1'; did you mean 'my ch01'\?$"):
        pytest_arguments(["my ch1"])


def test_tests_run_on_the_fork_and_leave_no_results_of_the_project(fork, tmp_path, vulkan_instance):
    edit(fork, "scene/packing.py", "    return -(centers @ view", "    return (centers @ view")
    panes = "test_three_panes_of_glass_blend_from_back_to_front[vulkan-red-green-blue-from behind]"
    done = subprocess.run(
        [
            *(sys.executable, "-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--chapter={fork}"),
            f"tests/ch01/test_materials.py::ch01-fork::{panes}",
        ],
        cwd=ROOT,
        env={**os.environ, "STRATA_CACHE": str(tmp_path / "cache"), "CI": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert f"FAILED tests/ch01/test_materials.py::ch01-fork::{panes}" in done.stdout
    assert "\nch01 " in done.stdout, "a fork has its chapter's budget"
    assert not (tmp_path / "cache" / "tests" / "results.json").exists()
