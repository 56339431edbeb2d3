"""`strata carry --check`: names what was repaired in one chapter alone, and nothing in an ordinary history."""

from __future__ import annotations

import pytest

from common.errors import UserError
from tests.support.clones import PASS, Clone
from tools.snapshots import carry, carry_check
from tools.snapshots.exceptions import read_exceptions

pytestmark = pytest.mark.feature("tools/carry")
FORWARD = "passes/forward.py"


@pytest.fixture(scope="module")
def four(tmp_path_factory):
    return Clone(tmp_path_factory.mktemp("four"), count=4)


@pytest.fixture
def clone(four, tmp_path):
    return four.copy(tmp_path / "clone")


def said(clone):
    return [
        f"{fault.broken}/{fault.path}:{fault.line} {fault.text}" for fault in carry_check.faults(clone.root)
    ]


def mend(clone, *numbers, old="line 5\n", new="line five\n"):
    for number in numbers:
        clone.edit(f"ch{number:02d}/{FORWARD}", old, new)
    return clone.commit(f"mend {numbers}")


def test_a_line_repaired_in_one_chapter_is_named_in_each_later_one(clone, capsys):
    sha = mend(clone, 2)
    assert said(clone) == [f"ch03/{FORWARD}:5 line 5", f"ch04/{FORWARD}:5 line 5"]
    assert carry_check.run(clone.root) == 1
    printed = capsys.readouterr()
    assert printed.out.splitlines()[0] == (
        f"chapters/ch03/{FORWARD}:5 is as ch02 was before {sha[:12]} (mend (2,)): line 5"
    )
    assert f"`strata carry ch02 {FORWARD} --base {sha[:12]}~1`" in printed.err


def test_what_it_tells_to_do_helps(clone):
    sha = mend(clone, 2)
    assert carry.start(clone.root, 2, [FORWARD], base=f"{sha}~1") == 0
    assert said(clone) == []
    clone.commit("carried")
    assert said(clone) == []


def test_a_commit_that_only_rearranged_code_repaired_nothing(clone):
    sha = mend(clone, 2)
    listed = clone.root.parent / ".git-blame-ignore-revs"
    listed.write_text(f"# Chapters: another order\n{'0' * 40}\n", "utf-8")
    assert len(said(clone)) == 2, "another commit is listed"
    listed.write_text(f"# Chapters: another order\n{sha}\n", "utf-8")
    assert said(clone) == []


def test_a_chapter_in_between_does_not_hide_a_later_one(clone):
    mend(clone, 2, 3)
    assert said(clone) == [f"ch04/{FORWARD}:5 line 5"]


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("line 5\n", "", "5 line 5"),
        ("line 5\n", "line 5\nbarrier\n", "6 lines are missing in front of it"),
        ("line 1\n", "line one\n", "1 line 1"),
        ("line 20\n", "line twenty\n", "20 line 20"),
        ("line 5\nline 6\n", "line 56\n", "5 line 5"),
    ],
)
def test_lines_removed_inserted_and_at_the_ends(clone, old, new, place):
    mend(clone, 3, old=old, new=new)
    assert said(clone) == [f"ch04/{FORWARD}:{place}"]


def test_a_repair_is_found_although_a_lesson_changed_other_lines(clone):
    clone.edit(f"ch04/{FORWARD}", "line 1\n", "lesson\nlesson\nline 1\n")
    clone.commit("lesson 4")
    mend(clone, 3)
    assert said(clone) == [f"ch04/{FORWARD}:7 line 5"]


# --- what is no fault -------------------------------------------------------------------------------------------------


def test_ordinary_lessons_are_none(clone):
    """A chapter made by copying, changed in many commits, whose predecessor was mended before."""
    mend(clone, 4)
    clone.write(f"ch05/{FORWARD}", clone.read(f"ch04/{FORWARD}"))
    clone.commit("begin chapter 5")
    clone.edit(f"ch05/{FORWARD}", "line 9\n", "line 9 with a lesson\n")
    clone.commit("lesson")
    clone.edit(f"ch05/{FORWARD}", "line 9 with a lesson\n", "line 9 with a better lesson\n")
    clone.commit("the lesson better")
    assert said(clone) == []


def test_a_chapter_copied_from_before_the_repair_begins_with_its_copy(clone):
    """Whether it is in step is for the snapshot tests to say."""
    mend(clone, 4)
    clone.write(f"ch05/{FORWARD}", PASS)
    clone.commit("begin chapter 5")
    assert said(clone) == []


def test_lines_of_the_lesson_are_its_own_business(clone):
    clone.edit(f"ch04/{FORWARD}", "line 5\n", "line 5, of lesson 4\n")
    clone.commit("lesson 4")
    mend(clone, 3)
    assert said(clone) == []


def test_lines_that_a_lesson_had_changed_then_may_be_what_it_wants_now(clone):
    clone.edit(f"ch04/{FORWARD}", "line 5\n", "line 5, of lesson 4\n")
    clone.edit(f"ch04/{FORWARD}", "line 15\n", "lesson\n")
    clone.commit("lesson 4")
    mend(clone, 3)
    clone.edit(f"ch04/{FORWARD}", "line 5, of lesson 4\n", "line 5\n")
    assert said(clone) == []


def test_an_equal_line_elsewhere_is_none(clone):
    """A lesson drops a line that stands in another place, too; mending it here says nothing about there."""
    for number in (3, 4):
        clone.edit(f"ch{number:02d}/{FORWARD}", "line 5\n", "return None\n")
    clone.edit(f"ch04/{FORWARD}", "return None\n", "return picture\n")
    clone.edit(f"ch04/{FORWARD}", "line 15\n", "return None\n")
    clone.commit("lessons")
    mend(clone, 3, old="return None\n", new="return self\n")
    assert said(clone) == []


def test_a_function_put_into_both_is_none_wherever_an_alignment_lets_it_begin(clone):
    """With the empty line before it, or with the one after it: a lesson's next line decides which."""
    for number in (3, 4):
        clone.edit(f"ch{number:02d}/{FORWARD}", "line 5\nline 6\n", "return\n\n")
    clone.edit(f"ch04/{FORWARD}", "line 7\n", "lesson\n")
    clone.commit("lessons")
    put = {"old": "return\n\n", "new": "return\n\ndef f\nbody\n\n"}
    mend(clone, 3, **put)
    assert said(clone) == [f"ch04/{FORWARD}:6 lines are missing in front of it"]
    mend(clone, 4, **put)
    assert said(clone) == []


def test_a_repair_taken_back_is_none(clone):
    clone.edit(f"ch04/{FORWARD}", "line 15\n", "lesson\n")
    mend(clone, 3)
    clone.edit(f"ch03/{FORWARD}", "line five\n", "line 5\n")
    clone.commit("back")
    assert said(clone) == []


def test_each_chapter_has_its_own_init_readme_and_studies(clone):
    for name in ("__init__.py", "README.md", "studies/one.py", "__pycache__/a.py"):
        for number in (3, 4):
            clone.write(f"ch{number:02d}/{name}", PASS)
        clone.commit("begin")
        clone.edit(f"ch03/{name}", "line 5\n", "line five\n")
        clone.commit("change")
    assert said(clone) == []


def test_a_removed_or_binary_file_has_no_lines(clone):
    for number in (3, 4):
        clone.write(f"ch{number:02d}/a.bin", b"\0\n1\n2\n")
    clone.commit("tables")
    clone.write("ch03/a.bin", b"\0\n1\n3\n")
    (clone.root / f"ch03/{FORWARD}").unlink()
    clone.commit("change")
    assert said(clone) == []


def test_what_is_wanted_is_written_down(clone):
    sha = mend(clone, 3)
    entry = f'[[not_carried]]\ncommit = "{sha[:10]}"\nfile = "{FORWARD}"\nchapter = "ch04"\nreason = "why"\n'
    clone.write("exceptions.toml", entry)
    assert said(clone) == []
    clone.write("exceptions.toml", entry.replace("ch04", "ch05"))
    assert len(said(clone)) == 1


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("=", "is no TOML"),
        ("[[other]]\n", "'other' is neither"),
        ('[[not_carried]]\ncommit = "12345678"\n', "each entry has commit, file, chapter, reason"),
        ('[[snapshot]]\nchapter = "ch02"\nrule = "size"\nreason = " "\n', "is no text"),
        ('[[not_carried]]\ncommit = "HEAD"\nfile = "a"\nchapter = "ch02"\nreason = "b"\n', "is no hash"),
        ('[[snapshot]]\nchapter = "ch02"\nrule = "size"\nreason = "a"\n' * 4, "has 4 exceptions .* 3 may be"),
    ],
)
def test_a_wrong_exception_is_one_sentence(clone, text, why):
    clone.write("exceptions.toml", text)
    with pytest.raises(UserError, match=why):
        read_exceptions(clone.root)


def test_a_clone_without_its_history_says_so(clone, tmp_path, capsys):
    mend(clone, 3)
    for depth, code in ((1, 0), (9, 1)):
        folder = tmp_path / f"depth{depth}"
        clone.git("clone", "-q", "--depth", str(depth), f"file://{clone.folder.as_posix()}", str(folder))
        assert carry_check.run(folder / "chapters") == code
        assert ("Older commits were left out" in capsys.readouterr().err) == (depth == 1)


def test_without_git_it_is_one_sentence(clone, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    with pytest.raises(UserError, match="install git"):
        carry_check.run(clone.root)
