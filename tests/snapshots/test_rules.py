"""Each rule of snapshots on small trees: what keeps it, what breaks it, and what is said then."""

from __future__ import annotations

import re

import pytest

from common.errors import UserError
from tools.snapshots import rules
from tools.snapshots.rules import RULES, check, names_of

CODE = "".join(f"def function_{number}():\n    return {number}\n" for number in range(100))
"""200 lines."""

SKY = '"""The sky."""\n\nfrom .. import settings\n\nBLUE = 1\n\n\ndef sky():\n    return BLUE\n'
SETTINGS = 'class Settings:\n    """Knobs."""\n\n    msaa: int = 1\n    _cache = 0\n'


class Trees:
    """Two chapters, the second a copy of the first; `lesson` writes what one says about itself."""

    def __init__(self, root):
        self.root = root
        for number in (1, 2):
            self.lesson(number)
            self.write(number, "README.md", f"# Chapter {number}\n")
            self.write(number, "passes/sky.py", SKY)
            self.write(number, "big.py", CODE)
            self.write(number, "settings.py", SETTINGS)
            self.write(number, "shading/sky.frag", "void main() {}\n")

    def lesson(self, number, **more):
        more.setdefault("adds", (f"feature of {number}",))
        said = "".join(f", {name}={value!r}" for name, value in more.items())
        text = f"from common.lessons import Lesson\n\nLESSON = Lesson({number}, 'Chapter {number}'{said})\n"
        self.write(number, "__init__.py", text)

    def write(self, number, name, text):
        path = self.root / f"ch{number:02d}" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, newline="")

    def edit(self, number, name, old, new):
        text = (self.root / f"ch{number:02d}" / name).read_text()
        assert old in text
        self.write(number, name, text.replace(old, new))

    def new(self, number, name="passes/new.py", lines=100):
        """A new file in which the lesson is; inserted lines for deleted ones."""
        self.write(number, name, "".join(f"NEW_{line} = {line}\n" for line in range(lines)))

    def broken(self):
        return [(one.chapter, one.rule) for one in check(self.root)]

    def said(self):
        return " ".join(one.text for one in check(self.root))


@pytest.fixture
def trees(tmp_path):
    return Trees(tmp_path)


def test_a_copy_keeps_all_rules(trees):
    assert trees.broken() == []


def test_a_folder_that_does_not_say_what_it_is_is_no_chapter_yet(trees):
    trees.write(3, "logic/tasks.py", '"""Made before the copy of chapter 2."""\n')
    assert [chapter.number for chapter in rules.read_chapters(trees.root)] == [1, 2]
    assert check(trees.root) == []


def test_new_files_are_free(trees):
    trees.new(2)
    trees.write(2, "shaders/new.frag", "void main() {}\n")
    trees.write(2, "studies/one.py", SKY)
    assert trees.broken() == []


# --- touched ----------------------------------------------------------------------------------------------------------


def test_a_file_that_differs_is_told_of(trees):
    trees.new(2)
    trees.edit(2, "passes/sky.py", "BLUE = 1", "BLUE = 2")
    assert trees.broken() == [("ch02", "touched")]
    assert trees.said() == (
        "ch02 differs from ch01 in passes/sky.py, and neither LESSON.reading nor LESSON.plumbing tells of that; "
        "for experiments use `strata fork 2 my-ch02`."
    )
    trees.lesson(2, reading=("passes/sky.py",))
    assert trees.broken() == []
    trees.lesson(2, plumbing={"passes/sky.py": "it is bluer"})
    assert trees.broken() == []


def test_line_ends_and_shaders_count_as_bytes(trees):
    trees.write(2, "shading/sky.frag", "void main() {}\r\n")
    assert ("ch02", "touched") in trees.broken()


@pytest.mark.parametrize(
    ("name", "what"), [("big.py", "is as it was"), ("new.py", "is new"), ("no", "is not there")]
)
def test_plumbing_that_did_not_change_is_named(trees, name, what):
    trees.new(2, "new.py")
    trees.lesson(2, plumbing={name: "because"})
    assert trees.broken() == [("ch02", "touched")] and what in trees.said()


def test_plumbing_has_reasons():
    from common.lessons import Lesson

    with pytest.raises(ValueError, match="plumbing without a reason"):
        Lesson(2, "Two", plumbing={"a.py": " "})


# --- named, relative --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "# as in ch01",
        "# Chapter 1 does",
        "# chapter 1.",
        "# ./strata run 1",
        "# strata.cmd bench 01",
        "# ch1/x",
    ],
)
def test_no_file_names_its_own_chapter(trees, text):
    for number in (1, 2):
        trees.edit(number, "big.py", "def function_0()", f"{text}\ndef function_0()")
    assert trees.broken() == [("ch01", "named")]
    assert "ch01/big.py:1 says" in trees.said()


@pytest.mark.parametrize(
    "text", ["# chapter 12", "# ch10", "# strata run N", "# chapter 1.5", "# each1", "# chapter 8"]
)
def test_other_chapters_may_be_named(trees, text):
    for number in (1, 2):
        trees.edit(number, "big.py", "def function_0()", f"{text}\ndef function_0()")
    assert trees.broken() == []


@pytest.mark.parametrize(
    "line",
    [
        "import chapters.ch01.settings",
        "from chapters.ch01 import settings",
        "from chapters import ch01",
        "from ...ch01 import settings",
        "from ... import ch01",
    ],
)
def test_imports_stay_inside(trees, line):
    trees.write(2, "studies/one.py", "from .. import settings\n")
    trees.write(2, "passes/new.py", f"{line}\n")
    assert ("ch02", "relative") in trees.broken() and "ch02/passes/new.py:1 imports" in trees.said()


def test_imports_of_the_foundation_are_free(trees):
    trees.write(
        2,
        "passes/new.py",
        "import tools.run.run\nfrom common import paths\nfrom .. import settings\nfrom . import sky\n",
    )
    assert trees.broken() == []


# --- monotone ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "old", "new", "lacks"),
    [
        ("passes/sky.py", "def sky()", "def heaven()", "passes/sky.py:sky"),
        ("passes/sky.py", "BLUE = 1", "BLACK = 1", "passes/sky.py:BLUE"),
        ("settings.py", "msaa: int", "samples: int", "settings.py:Settings.msaa"),
        ("settings.py", "class Settings", "class Knobs", "settings.py:Settings"),
    ],
)
def test_public_names_and_knobs_stay_unless_replaced(trees, file, old, new, lacks):
    trees.new(2)
    trees.edit(2, file, old, new)
    trees.lesson(2, reading=(file,))
    assert trees.broken() == [("ch02", "monotone")] and f"by the lack of {lacks}" in trees.said()
    for replaces in ((lacks,), (file,)):
        trees.lesson(2, reading=(file,), replaces=replaces)
        assert trees.broken() == []


def test_a_file_stays_unless_replaced(trees):
    trees.new(2)
    (trees.root / "ch02" / "passes" / "sky.py").unlink()
    assert trees.broken() == [("ch02", "monotone")]
    trees.lesson(2, replaces=("passes/sky.py",))
    assert trees.broken() == []


def test_private_names_are_free():
    assert names_of(
        "a.py", b"import os\nfrom x import y\n_A = 1\nB: int = 1\nC, D = 1, 2\nclass _E: pass\n"
    ) == {"B", "C", "D"}
    for path in ("settings.py", "shading/settings.py"):
        assert names_of(path, SETTINGS.encode()) == {"Settings", "Settings.msaa"}
    assert names_of("shading/sky.py", SETTINGS.encode()) == {"Settings"}


def test_features_are_added_once_and_replaced_by_name(trees):
    trees.lesson(2, adds=("feature of 1",))
    assert trees.broken() == [("ch02", "monotone")] and "once more" in trees.said()
    trees.lesson(2, replaces=("feature of 1",))
    assert trees.broken() == []
    trees.lesson(2, replaces=("feature of 7",))
    assert trees.broken() == [("ch02", "monotone")] and "there was no such" in trees.said()


# --- counts -----------------------------------------------------------------------------------------------------------


def test_deletions_are_few_against_insertions(trees):
    trees.lesson(2, reading=("big.py",))
    text = CODE.replace("return 1\n", "return 111\n")  # 1 deleted, 1 inserted
    trees.write(2, "big.py", text)
    assert trees.broken() == [("ch02", "deletions")]
    assert "by 1 deleted lines for 1 inserted ones, 1.00 of them" in trees.said()
    trees.new(2, lines=5)  # 1 of 6: 0.17
    assert trees.broken() == [("ch02", "deletions")]
    trees.new(2, lines=6)  # 1 of 7: 0.14
    assert trees.broken() == []


def test_lines_deleted_alone_are_too_many(trees):
    trees.lesson(2, reading=("big.py",))
    trees.write(
        2,
        "big.py",
        CODE.replace("    return 1\n", "    return 1\n", 1).replace("():\n    return 5\n", "(): return 5\n"),
    )
    assert trees.broken() == [("ch02", "deletions")]


def test_existing_files_change_by_at_most_400_lines_of_python(trees):
    trees.lesson(2, reading=("big.py", "shading/sky.frag"))
    trees.write(2, "big.py", CODE + "".join(f"MORE_{line} = {line}\n" for line in range(400)))
    trees.write(2, "shading/sky.frag", "void main() {}\n" + "// more\n" * 300)
    assert trees.broken() == []
    trees.write(2, "big.py", CODE + "".join(f"MORE_{line} = {line}\n" for line in range(401)))
    assert trees.broken() == [("ch02", "size")] and "most in big.py 401" in trees.said()


def test_new_files_are_short(trees):
    trees.new(2, lines=400)
    assert trees.broken() == []
    trees.new(2, lines=401)
    assert trees.broken() == [("ch02", "long")]


def test_no_code_moves(trees):
    block = "".join(f"def function_{number}():\n    return {number}\n" for number in range(4))
    trees.write(2, "big.py", CODE.replace(block, ""))
    trees.new(2)
    trees.edit(2, "passes/new.py", "NEW_0 = 0\n", block + "NEW_0 = 0\n")
    trees.lesson(2, reading=("big.py",), replaces=("big.py",))
    assert trees.broken() == [("ch02", "moved")]
    assert "by 8 lines that went from big.py:1 to passes/new.py:1" in trees.said()
    trees.edit(2, "passes/new.py", "def function_2():\n", "def function_two():\n")
    assert trees.broken() == []


def test_code_that_changes_its_place_in_a_file_counts_as_deleted(trees):
    block = "".join(f"def function_{number}():\n    return {number}\n" for number in range(4))
    trees.write(2, "big.py", CODE.replace(block, "") + block)
    trees.new(2)
    trees.lesson(2, reading=("big.py",))
    assert trees.broken() == []
    trees.new(2, lines=10)
    assert trees.broken() == [("ch02", "deletions")]


def test_only_code_is_counted(trees):
    trees.write(2, "new.md", CODE * 3)
    for number in (1, 2):
        trees.write(number, "notes.md", CODE)
    trees.write(2, "notes.md", CODE.replace("return", "give"))
    trees.lesson(2, reading=("notes.md",))
    assert trees.broken() == []


# --- exceptions -------------------------------------------------------------------------------------------------------


def test_an_exception_excuses_one_rule_of_one_chapter(trees):
    trees.edit(2, "passes/sky.py", "BLUE = 1", "BLUE = 2")
    assert trees.broken() == [("ch02", "touched"), ("ch02", "deletions")]
    entry = '[[snapshot]]\nchapter = "ch02"\nrule = "{}"\nreason = "the sky is the lesson"\n'
    (trees.root / "exceptions.toml").write_text(entry.format("deletions"))
    assert trees.broken() == [("ch02", "touched")]
    (trees.root / "exceptions.toml").write_text(entry.format("deletions") + entry.format("size"))
    assert trees.broken() == [("ch02", "touched"), ("ch02", "size")]
    assert "excuses ch02 from 'size', which it keeps" in trees.said()


def test_an_exception_from_no_rule_is_one_sentence(trees):
    (trees.root / "exceptions.toml").write_text(
        '[[snapshot]]\nchapter = "ch02"\nrule = "sise"\nreason = "a"\n'
    )
    with pytest.raises(UserError, match=r"there is no rule 'sise'; did you mean 'size'\?"):
        check(trees.root)


def test_the_rules_are_those_of_the_docstring():
    told = re.findall(r"^ {0,4}([a-z]+) {2,}", rules.__doc__, re.M)
    assert tuple(told) == RULES
