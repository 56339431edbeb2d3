"""`strata fork`: what a fork holds, where one is refused, and what is said of a broken record."""

from __future__ import annotations

import json

import pytest

from chapters import folders
from common.errors import UserError
from tools.diff.diff import difference
from tools.snapshots.forks import BASE, base_files, is_fork, make_fork, own_files, read_fork
from tools.snapshots.trees import read_tree

pytestmark = pytest.mark.feature("tools/fork")


@pytest.fixture
def root(tmp_path):
    """Two chapters in a clone, the first with a study."""
    for name in ("ch01", "ch02"):
        folder = tmp_path / "clone" / "chapters" / name
        (folder / "passes").mkdir(parents=True)
        (folder / "__init__.py").write_text(f'"""{name}."""\n')
        (folder / "passes" / "sky.py").write_bytes(b"blue = 1\r\n")
        (folder / "__pycache__").mkdir()
        (folder / "__pycache__" / "x.pyc").write_bytes(b"\0")
    (tmp_path / "clone" / "chapters" / "ch01" / "studies").mkdir()
    (tmp_path / "clone" / "chapters" / "ch01" / "studies" / "one.py").write_text("1\n")
    return tmp_path / "clone" / "chapters"


def fork_of(root, folder, number=1, **more):
    return make_fork(number, folder, root=root, clone=root.parent, **more)


def test_a_fork_is_a_byte_copy_with_its_base(root, tmp_path):
    made = fork_of(root, tmp_path / "deep" / "mine")
    assert is_fork(made.folder) and read_fork(made.folder) == made
    assert own_files(made) == base_files(made) == read_tree(root / "ch01")
    assert "studies/one.py" not in own_files(made) and made.commit is None
    assert sorted(path.name for path in made.folder.iterdir()) == sorted(
        [BASE, "__init__.py", "fork.json", "passes"]
    )


def test_a_fork_that_nobody_changed_is_no_difference(root, tmp_path):
    made = fork_of(root, tmp_path / "mine")
    assert difference(root / "ch01", made.folder).changed == ()


def test_what_it_says_to_type_can_be_typed(strata, tmp_path):
    """A folder with a space in its name stands in quotes."""
    code, _, err = strata("fork", 1, "my copy")
    assert code == 0 and (tmp_path / "my copy" / "renderer.py").is_file()
    assert '`strata run "my copy"`' in err and '`strata fork --update "my copy"`' in err


def test_studies_come_when_asked_for(root, tmp_path):
    assert "studies/one.py" in own_files(fork_of(root, tmp_path / "mine", studies=True))


def test_a_fork_in_the_clone_is_hidden_from_its_checks(root):
    made = fork_of(root, root.parent / "my-ch01")
    assert (made.folder / ".gitignore").read_text() == "*\n"


@pytest.mark.parametrize("place", ["chapters/mine", "chapters", "tests/a/b", ".", "common/../backends/x"])
def test_a_fork_is_refused_inside_the_project(root, place):
    with pytest.raises(UserError, match="is inside the project"):
        fork_of(root, root.parent / place / ("" if place != "chapters" else "ch01_mine"))


def test_a_place_that_is_taken_is_refused(root, tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").write_text("x")
    fork_of(root, tmp_path / "mine")
    for name, why in (
        ("file", "is a file"),
        ("full", "has files in it"),
        ("mine", "is a fork already"),
        ("mine/again", "is inside the fork"),
    ):
        with pytest.raises(UserError, match=why):
            fork_of(root, tmp_path / name)
    (tmp_path / "empty").mkdir()
    assert is_fork(fork_of(root, tmp_path / "empty").folder)


def test_a_chapter_that_is_not_there_is_refused(root, tmp_path):
    with pytest.raises(UserError, match="There is no chapter 7"):
        fork_of(root, tmp_path / "mine", number=7)
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize("change", [{"chapter": "one"}, {"made_of": None}, {"conflicts": 3}, None])
def test_a_broken_record_is_one_sentence(root, tmp_path, change):
    made = fork_of(root, tmp_path / "mine")
    record = json.loads((made.folder / "fork.json").read_text())
    text = "{" if change is None else json.dumps(record | change)
    (made.folder / "fork.json").write_text(text)
    with pytest.raises(UserError, match="cannot be read as the record of a fork"):
        read_fork(made.folder)


@pytest.mark.parametrize(
    ("format_", "says"),
    [(1, "commit abc of Strata.* draw with it in a clone of that"), (99, "update this clone")],
)
def test_a_record_of_another_format_is_refused(root, tmp_path, format_, says):
    """By what merges, and by what imports and draws: a fork names files of the project that may have moved."""
    made = fork_of(root, tmp_path / "mine")
    record = json.loads((made.folder / "fork.json").read_text())
    (made.folder / "renderer.py").write_text("")
    for read in (read_fork, folders.read):
        read(made.folder)
    (made.folder / "fork.json").write_text(json.dumps(record | {"format": format_, "commit": "abc"}))
    for read in (read_fork, folders.read):
        with pytest.raises(UserError, match=says):
            read(made.folder)


def test_what_is_no_fork_says_how_to_make_one(tmp_path):
    with pytest.raises(UserError, match="is not there; `strata fork 1 nowhere` makes one"):
        read_fork(tmp_path / "nowhere")
    with pytest.raises(UserError, match="is no fork"):
        read_fork(tmp_path)


def test_a_base_that_was_changed_is_noticed(root, tmp_path):
    made = fork_of(root, tmp_path / "mine")
    (made.base / "passes" / "sky.py").write_text("red = 1\n")
    with pytest.raises(UserError, match="is not what the fork was made of"):
        base_files(made)
