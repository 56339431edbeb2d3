"""`strata new`: the next chapter begins as a byte copy of one that is finished."""

from __future__ import annotations

import pytest

from common.errors import StrataError, UserError
from tests.support.clones import Clone
from tools.snapshots import new_chapter
from tools.snapshots.trees import lesson_of, read_tree

INIT = '''"""Chapter 1."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=1,
    title="One",
    adds=("a",),
    needs=Needs(required=frozenset({"r"}), optional=frozenset({"b", "a"})),
    reading=("passes/sky.py",),
)
'''


@pytest.fixture
def clone(tmp_path):
    made = Clone(tmp_path, count=1)
    made.write("ch01/__init__.py", INIT)
    made.write("ch01/README.md", "# One\n")
    made.write("ch01/studies/one.py", "1\n")
    made.write("ch01/benches/one.py", "1\n")
    made.write("ch01/table.bin", b"\0\r\n")
    made.commit("finished")
    return made


def test_a_new_chapter_is_a_byte_copy_with_a_lesson_to_write(clone, capsys):
    assert new_chapter.run(clone.root, ' The "second"\n – chapter.') == 0
    old, new = read_tree(clone.root / "ch01"), read_tree(clone.root / "ch02", studies=True)
    own = {"__init__.py", "README.md"}
    assert not [name for name in new if name.endswith("one.py")]
    assert {name: new[name] for name in set(new) - own} == {name: old[name] for name in set(old) - own}
    lesson = lesson_of(clone.root / "ch02")
    assert (lesson.number, lesson.title) == (2, 'The "second" – chapter')
    assert lesson.needs == lesson_of(clone.root / "ch01").needs and lesson.adds == ()
    text = new["README.md"].decode()
    assert [line[3:] for line in text.splitlines() if line.startswith("## ")] == list(new_chapter.HEADINGS)
    assert "strata diff 1 2" in capsys.readouterr().err
    assert [path.name for path in clone.root.iterdir() if path.name.startswith(".")] == []


def test_it_is_refused_until_the_last_one_is_finished(clone):
    new_chapter.run(clone.root)
    clone.commit("begin")
    with pytest.raises(
        UserError, match=r"ch02 is not finished: it has a README.md with a place still to be written"
    ):
        new_chapter.run(clone.root)
    clone.write("ch02/README.md", "# Two\n")
    with pytest.raises(UserError, match=r"adds nothing \(LESSON.adds\)"):
        new_chapter.run(clone.root)
    clone.edit("ch02/__init__.py", "adds=()", 'adds=("b",)')
    with pytest.raises(UserError, match=r"tells to read renderer.py, which is not there"):
        new_chapter.run(clone.root)
    clone.write("ch02/renderer.py", "")
    with pytest.raises(UserError, match=r"is not committed: commit or put it aside"):
        new_chapter.run(clone.root)
    clone.commit("finished")
    (clone.root / "ch02" / "README.md").unlink()
    with pytest.raises(UserError, match=r"has no README.md"):
        new_chapter.run(clone.root)
    assert new_chapter.run(clone.root, force=True) == 0
    assert (clone.root / "ch03" / "passes" / "sky.py").is_file()


@pytest.mark.parametrize("title", ['a """ b', "C:\\new", "it's", 'x"', "{number}"])
def test_any_title_is_told_as_it_is(title, clone):
    new_chapter.run(clone.root, title)
    assert lesson_of(clone.root / "ch02").title == title


def test_all_fifteen_are_enough(clone):
    clone.write("ch15/__init__.py", INIT)
    with pytest.raises(UserError, match="All 15 chapters are here"):
        new_chapter.run(clone.root)


def test_an_empty_title_and_a_clone_without_history_are_one_sentence(clone, monkeypatch, tmp_path):
    with pytest.raises(UserError, match="--title is empty"):
        new_chapter.run(clone.root, " ")
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    with pytest.raises(UserError, match=r"install git.*; --force makes the copy nevertheless"):
        new_chapter.run(clone.root)
    assert new_chapter.run(clone.root, force=True) == 0


@pytest.mark.parametrize(
    ("text", "why"), [("1 / 0\n", "does not run: ZeroDivisionError"), ("", "has no LESSON")]
)
def test_a_chapter_that_says_nothing_is_named(clone, text, why):
    clone.write("ch01/__init__.py", text)
    with pytest.raises(StrataError, match=why):
        lesson_of(clone.root / "ch01")
