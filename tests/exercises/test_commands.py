"""`strata exercise` and `strata check` as a reader types them, and what they say to a wrong word."""

from __future__ import annotations

import json
import shutil
import sys

import numpy as np
import pytest

from chapters.folders import Folder
from common.images import read_image
from tools.exercises import answers, command, find, of_chapter
from tools.exercises.patches import difference, files_of, states
from tools.lessons import progress
from tools.snapshots.forks import is_fork, own_files, read_fork
from tools.snapshots.trees import digest, read_tree

pytestmark = pytest.mark.feature("tools/exercises")

CPU = "opcode-in-a-byte"
"""An exercise whose check needs no device."""


def test_a_chapter_lists_its_exercises(strata):
    code, out, err = strata("exercise", "1")
    assert (code, err) == (0, "")
    for one in of_chapter(1):
        assert one.name in out and one.kind in out


def test_the_way_through_a_repair(strata, tmp_path):
    """Begin, check, hints one by one, mend, check again; the fork knows its chapter and can be updated."""
    code, out, err = strata("exercise", 2, CPU, "--into", "mine")
    assert (code, out) == (0, "mine has the exercise.\n") and "strata check mine" in err
    folder = tmp_path / "mine"
    assert is_fork(folder) and read_fork(folder).number == 2
    task = (folder / "EXERCISE.md").read_text("utf-8")
    assert "`strata check mine`" in task and "OpTypeAccelerationStructureKHR" not in task
    code, out, err = strata("check", "mine")
    assert code == 1 and out.startswith("Not right yet. A module with an acceleration structure")
    assert out.count("\n") == 1 and "--hint" in err
    hints = find(2, CPU).hints
    for shown in (1, 2, 3, 3):
        code, out, err = strata("check", "mine", "--hint")
        assert code == 0 and out.splitlines() == [f"{n}. {hint}" for n, hint in enumerate(hints[:shown], 1)]
    assert "last one" in err
    (broken,) = [
        path for path in folder.glob("pipelines/spirv/*.py") if b"first & 0xFF," in path.read_bytes()
    ]
    broken.write_bytes(broken.read_bytes().replace(b"0xFF,", b"0xFFFF,"))
    for name in [name for name in sys.modules if name.startswith(Folder(folder).package)]:
        del sys.modules[name]  # a check in another process would read the files anew
    code, out, err = strata("check", folder)
    assert code == 0 and out.startswith("All right. The opcode is the low half")
    assert err == "`strata next` shows what comes next.\n"
    assert progress.load().solved == {f"2/{CPU}"}


def test_a_solution_that_is_piped_is_a_patch(strata, monkeypatch):
    """However narrow the terminal is: no line of it may be broken."""
    monkeypatch.setenv("COLUMNS", "40")
    both = states(find(2, "set-table"))
    assert difference(both.start, both.solution) in strata("exercise", 2, "set-table", "--solution")[1]


def test_a_solution_can_be_shown_and_begun_with(strata, tmp_path):
    code, shown, _ = strata("exercise", 2, CPU, "--solution")
    assert code == 0 and "+        opcode, count = first & 0xFFFF, first >> 16" in shown
    assert strata("exercise", 2, CPU, "--solution", "--into", "done")[0] == 0
    assert strata("check", "done")[0] == 0
    assert strata("check", "done", "--solution")[1] == shown
    own = {
        name: text for name, text in own_files(read_fork(tmp_path / "done")).items() if name != command.TASK
    }
    assert own == states(find(2, CPU)).solution


def test_an_exercise_without_a_folder_tells_what_it_asks(strata):
    code, out, err = strata("exercise", 1, "half-a-mirror")
    assert code == 0 and "a scale of -1" in out and "--into" in err
    code, out, _ = strata("exercise", 1, "half-a-mirror", "--hint")
    assert code == 0 and out.startswith("1. ")


def test_the_way_through_a_prediction(strata, tmp_path):
    """Unanswered, nonsense, wrong, right; the numbers are not given away."""
    strata("exercise", 1, "four-samples", "--into", "mine")
    file = tmp_path / "mine" / answers.FILE
    text = file.read_text("utf-8")
    said = strata("check", "mine")
    assert said[0] == 1 and "passes has no answer yet" in said[1]
    right = answers.recorded(find(1, "four-samples"))
    assert text.count(' = ""\n') == len(right)

    def answered(**changes):
        given = {**right, **changes}
        file.write_text("\n".join(f"{name} = {json.dumps(value)}" for name, value in given.items()), "utf-8")
        return strata("check", "mine")

    code, out, _ = answered(time="rather long")
    assert code == 1 and '"about as long"' in out
    code, out, _ = answered(passes=4, greys=9)
    assert code == 1 and out.startswith(
        "Not right yet. The run says otherwise about passes and greys. The other 3"
    )
    assert str(right["passes"]) not in out.replace("The other 3", "")
    code, out, _ = answered(changed=right["changed"] * 1.3)
    assert code == 0 and "- changed: " in out
    code, _, err = answered(pases=3)
    assert code == 2 and "did you mean 'passes'" in err
    file.write_text("passes = three", "utf-8")
    code, _, err = strata("check", "mine")
    assert code == 2 and "cannot be read" in err
    file.unlink()
    assert strata("check", "mine")[0] == 2
    assert strata("exercise", 1, "four-samples", "--solution", "--into", "done")[0] == 0
    assert strata("check", "done")[0] == 0


@pytest.mark.needs("moderngl", "glcontext")
def test_a_check_names_the_backend_that_is_wrong(strata, tmp_path):
    """A fault in what both read is first seen on Vulkan; one that was mended there alone, on OpenGL."""
    strata("exercise", 1, "half-a-mirror", "--into", "mine")
    assert strata("check", "mine")[1].startswith("Not right yet. Vulkan: ")
    strata("exercise", 1, "half-a-mirror", "--solution", "--into", "done")
    path = tmp_path / "done" / "pipelines" / "gl.py"
    before, after = (
        "FRONT_FACES[front]",
        'FRONT_FACES["clockwise" if front != "clockwise" else "counter_clockwise"]',
    )
    text = path.read_text("utf-8")
    assert text.count(before) == 1
    path.write_text(text.replace(before, after), "utf-8")
    assert strata("check", "done")[1].startswith("Not right yet. OpenGL: ")


def test_what_a_reader_broke_besides_is_shown_by_its_own_lines(strata, tmp_path):
    strata("exercise", 2, CPU, "--into", "mine")
    path = tmp_path / "mine" / "pipelines" / "spirv" / "parser.py"
    path.write_text(path.read_text("utf-8") + "\nbroken = nothing\n", "utf-8")
    code, _, err = strata("check", "mine")
    assert code == 1 and "NameError" in err and "broken = nothing" in err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("exercise", "1", "half-a-miror"), "has no exercise 'half-a-miror'; did you mean 'half-a-mirror'?"),
        (("exercise", "1", "nothing-like-it"), "`strata exercise 1` lists them"),
        (("exercise", "99"), "There is no chapter 99"),
        (("exercise", "1/one-light"), "is a study"),
        (("exercise", "1", "--into", "x"), "Name an exercise, too"),
        (("exercise", "1", "reinhard", "--into", "taken"), "has files in it"),
        (("exercise", "1", "reinhard", "--hint", "--solution"), "--hint stands alone"),
        (("exercise", "1", "reinhard", "--remake", "answers"), "is no prediction"),
        (("exercise", "1", "reinhard", "--remake", "middle=taken"), "is none of start=FORK"),
        (("exercise", "1", "reinhard", "--remake", "start=taken"), "is no fork"),
        (("check", "taken"), "taken is no folder of an exercise"),
        (("check", "nowhere"), "There is no folder nowhere"),
        (("check", "taken", "--hint", "--solution"), "One at a time"),
        (("check", "spoiled"), "cannot be read"),
        (("check", "old"), "has no exercise 'gone'"),
    ],
)
def test_a_wrong_word_is_answered_in_a_sentence(strata, tmp_path, words, said):
    for name, record in (
        ("taken", None),
        ("spoiled", "{"),
        ("old", '{"chapter": 1, "name": "gone", "hints": 0}'),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text("x")
        if record:
            (tmp_path / name / command.RECORD).write_text(record)
    code, out, err = strata(*words)
    assert (code, out) == (2, "") and said in err and err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["old", "spoiled", "taken"]


def test_a_chapter_without_exercises_says_so(strata, monkeypatch, tmp_path):
    monkeypatch.setattr(command, "of_chapter", lambda number: [])
    code, _, err = strata("exercise", "1")
    assert code == 2 and err == "strata: Chapter 1 has no exercises yet.\n"


def test_authors_make_patches_from_forks(strata, monkeypatch, tmp_path):
    """What was made again from a fork gives the same states; the task's own files are no part of it."""
    exercise = find(2, CPU)
    copied = tmp_path / "exercise"
    shutil.copytree(exercise.folder, copied)
    strata("exercise", 2, CPU, "--into", "mine")
    (copied / "start.patch").write_bytes(b"")
    monkeypatch.setattr(
        command, "find", lambda number, name: type(exercise)(**{**vars(exercise), "folder": copied})
    )
    code, _, err = strata("exercise", 2, CPU, "--remake", "start=mine")
    assert code == 0, err
    assert (copied / "start.patch").read_bytes() == (exercise.folder / "start.patch").read_bytes()


def test_nothing_of_it_touches_the_chapters(strata):
    before = digest(files_of(2)), digest(read_tree(find(2, CPU).folder))
    strata("exercise", 2, CPU, "--into", "mine")
    strata("check", "mine", "--hint")
    strata("check", "mine")
    assert (digest(files_of(2)), digest(read_tree(find(2, CPU).folder))) == before


def test_the_commands_of_four_samples_answer_its_questions(strata, tmp_path):
    """The square in the folder is the one that was measured: as many pixels change, to as many values."""
    exercise = find(1, "four-samples")
    expected = answers.recorded(exercise)
    (tmp_path / "square.gltf").write_bytes(states(exercise).start["square.gltf"])
    pictures = []
    for samples in (1, 4):
        shown = (
            "--scene",
            "square.gltf",
            "--size",
            "64x64",
            "--set",
            "background=0",
            "--set",
            f"msaa={samples}",
        )
        assert strata("run", 1, *shown, "--headless", "--out", f"{samples}.png")[0] == 0
        pictures.append(read_image(tmp_path / f"{samples}.png")[..., 0].astype(int))
    assert (np.abs(pictures[1] - pictures[0]) > 1).sum() == expected["changed"]
    assert len(np.unique(pictures[1])) == expected["greys"]
