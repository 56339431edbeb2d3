"""Every exercise: its patches fit today's chapter, its start fails, its solution passes, its run repeats itself."""

from __future__ import annotations

import zlib
from contextlib import nullcontext
from dataclasses import replace
from functools import cache

import pytest

import chapters
from chapters.folders import Folder
from common.errors import UnsupportedError
from tools.exercises import FOLDER, KINDS, answers, checking, of_chapter
from tools.exercises.patches import OutOfDate, apply, difference, files_of, states
from tools.snapshots.trees import write_files

ALL = [one for number in chapters.available() for one in of_chapter(number)]
CODE = [one for one in ALL if one.kind != "predict"]
PREDICTIONS = [one for one in ALL if one.kind == "predict"]

both = cache(states)
"""Start and solution of an exercise, made once."""

pytestmark = pytest.mark.feature("tools/exercises")


def named(exercises):
    return [pytest.param(one, id=one.spoken.replace(" ", "-")) for one in exercises]


def on_backends(exercises, turn):
    """An exercise of the newest chapter on each of its backends, one of a chapter before on one of them, by turns.

    `--long` has all of them.
    """
    found = []
    for one in exercises:
        backends = one.backends or ("",)
        mine = (zlib.crc32(one.spoken.encode()) + turn) % len(backends)
        for number, backend in enumerate(backends):
            rare = number != mine and one.chapter != chapters.available()[-1]
            name = f"{one.spoken.replace(' ', '-')}-{backend or 'cpu'}"
            found.append(pytest.param(one, backend, id=name, marks=[pytest.mark.long] * rare))
    return found


@pytest.fixture
def opener(request):
    """Gives the devices that this module shares."""
    fixtures = {"vulkan": "vulkan_device", "gl": "gl_context"}
    return lambda backend: nullcontext(request.getfixturevalue(fixtures[backend]) if backend else None)


def verdict(exercise, backend, tree, folder, opener):
    write_files(folder, tree)
    one = replace(exercise, backends=(backend,) if backend else ())
    if one.validated and backend == "vulkan" and not opener(backend).enter_result.instance.validates:
        pytest.skip("the validation layers are not installed")
    try:
        return checking.check(one, Folder(folder.resolve()), opener)
    except UnsupportedError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize(("exercise", "backend"), on_backends(CODE, turn=0))
def test_the_start_fails_and_says_why_in_a_sentence(exercise, backend, tmp_path, opener):
    wrong = verdict(exercise, backend, both(exercise).start, tmp_path, opener)
    with opener(backend) as device:
        checking.complaints(
            device
        )  # of the fault: two threads in one pool are seen by the layers, too, if they meet
    assert wrong is not None, "nothing is wrong at the start"
    assert wrong.endswith((".", "?")) and "\n" not in wrong


@pytest.mark.parametrize(("exercise", "backend"), on_backends(CODE, turn=1))
def test_the_solution_passes(exercise, backend, tmp_path, opener):
    assert verdict(exercise, backend, both(exercise).solution, tmp_path, opener) is None


@pytest.mark.parametrize("exercise", named(PREDICTIONS))
def test_the_recorded_answers_are_those_of_a_run_today(exercise, opener):
    kept = answers.recorded(exercise)
    assert kept.keys() == {one.name for one in exercise.questions}
    for question in exercise.questions:
        assert answers.malformed(question, kept[question.name]) is None

    def wrong():
        found, _ = checking.measure(exercise, opener)
        assert found.keys() == kept.keys()
        return [
            one.name for one in exercise.questions if not answers.right(one, found[one.name], kept[one.name])
        ]

    # Some answers compare times, which other programs spoil: three times in a row they do not.
    first = wrong()
    assert not first or not wrong() or not wrong(), first


@pytest.mark.parametrize("exercise", named(ALL))
def test_an_exercise_is_whole(exercise):
    """Patches are what its kind needs, and texts are there."""
    held = {path.name for path in exercise.folder.iterdir() if path.is_file()}
    needed = {
        "predict": {"recorded.toml"},
        "repair": {"start.patch"},
        "extend": {"solution.patch"},
    }[exercise.kind]
    assert held - {"start.patch"} >= {"exercise.toml", "check.py"} | (needed - {"start.patch"})
    assert ("start.patch" in held) >= (exercise.kind == "repair")
    assert len(exercise.hints) >= 2
    assert "strata check FOLDER" in exercise.task
    assert exercise.lesson.strip() and exercise.title
    assert bool(exercise.questions) == (exercise.kind == "predict")


@pytest.mark.parametrize("exercise", named(CODE))
def test_patches_are_small(exercise):
    """A fault is a few lines, a feature some tens."""
    lines = difference(both(exercise).start, both(exercise).solution).splitlines()
    changed = [line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---")]
    assert 1 <= len(changed) <= (12 if exercise.kind == "repair" else 80)


@pytest.mark.parametrize("number", chapters.available())
def test_a_chapter_has_one_of_each_kind(number):
    """At least three, and the README's section names each of them with its command."""
    found = of_chapter(number)
    assert {one.kind for one in found} == KINDS.keys()
    assert len({one.order for one in found}) == len(found)
    readme = chapters.FOLDER / chapters.folder_name(number) / "README.md"
    if not readme.is_file() and not chapters.lesson(number).adds:
        pytest.skip(f"chapter {number} has no README yet")
    section = readme.read_text("utf-8").partition("\n## Exercises\n")[2].partition("\n## ")[0]
    for one in found:
        assert f"strata exercise {one.spoken}" in section, one.spoken


# --- drift, on a chapter that changed ---


def test_a_patch_that_does_not_fit_any_more_is_named_with_what_to_do():
    exercise = next(one for one in CODE if one.kind == "repair")
    touched = [
        name for name, content in both(exercise).start.items() if files_of(exercise.chapter)[name] != content
    ]
    changed = {**files_of(exercise.chapter), touched[0]: b'"""Another file."""\n'}
    with pytest.raises(OutOfDate) as caught:
        states(exercise, changed)
    said = str(caught.value)
    assert exercise.spoken in said and touched[0] in said and "--remake start=FORK" in said


def test_a_patch_still_fits_where_lines_only_moved():
    before = {"a.py": b"".join(b"line %d\n" % n for n in range(20))}
    after = {"a.py": before["a.py"].replace(b"line 10\n", b"another\n")}
    patch = difference(before, after).encode()
    moved = {"a.py": b"first\nsecond\n" + before["a.py"]}
    assert apply(moved, patch) == {"a.py": b"first\nsecond\n" + after["a.py"]}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ({"a/b.py": b"1\n"}, {"a/b.py": b"1\n", "c d.py": b"2\n"}),
        ({"a.py": b"1\n", "b.py": b"2\n"}, {"b.py": b"2\n"}),
        ({"a.py": b"1\n"}, {"a.py": "å\n".encode()}),
    ],
    ids=["new", "removed", "letters"],
)
def test_a_difference_applied_is_the_other_side(before, after):
    assert apply(before, difference(before, after).encode()) == after


def test_nothing_lies_among_the_exercises_that_is_none():
    found = {path.parent for path in FOLDER.glob("ch*/*/*")} | set(FOLDER.glob("ch*/*"))
    assert {path for path in found if path.name != "__pycache__" and path.parent.name != "__pycache__"} == {
        one.folder for one in ALL
    }
