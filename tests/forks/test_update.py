"""`strata fork --update`: later fixes of a chapter come into a fork, and what its reader changed stays."""

from __future__ import annotations

import pytest

from common.errors import UserError
from tests.support.clones import PASS, Clone
from tools.snapshots import trees
from tools.snapshots.fork_update import update
from tools.snapshots.forks import make_fork, own_files, read_fork
from tools.snapshots.trees import read_tree

pytestmark = pytest.mark.feature("tools/fork")
FORWARD = "passes/forward.py"


@pytest.fixture
def clone(tmp_path, monkeypatch):
    """Two chapters without any history, and no git repository around them."""
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    return Clone(tmp_path / "clone", count=2, git=False)


@pytest.fixture
def fork(clone, tmp_path):
    return make_fork(1, tmp_path / "mine", root=clone.root, clone=clone.folder)


def mine(fork, name, content):
    (fork.folder / name).parent.mkdir(exist_ok=True)
    (fork.folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def everything(fork):
    return {path: path.read_bytes() for path in fork.folder.rglob("*") if path.is_file()}


def test_a_fix_comes_and_what_the_reader_changed_stays(clone, fork, capsys):
    mine(fork, FORWARD, PASS.replace("line 15\n", "my line\n"))
    mine(fork, "passes/mine.py", "mine = 1\n")
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    clone.edit("ch01/passes/sky.py", "sky 5\n", "sky five\n")
    clone.write("ch01/passes/new.py", "new = 1\n")
    assert update(fork.folder, root=clone.root) == 0
    files = own_files(fork)
    assert files[FORWARD].decode() == PASS.replace("line 15\n", "my line\n").replace(
        "line 5\n", "line five\n"
    )
    assert files["passes/sky.py"] == clone.read("ch01/passes/sky.py")
    assert files["passes/new.py"] == b"new = 1\n" and files["passes/mine.py"] == b"mine = 1\n"
    assert read_tree(fork.base) == read_tree(clone.root / "ch01")
    said = capsys.readouterr()
    assert "passes/forward.py: your lines and the chapter's, merged" in said.out
    assert "3 files written, no conflict" in said.err
    assert update(fork.folder, root=clone.root) == 0
    assert "is up to date" in capsys.readouterr().err


def test_updates_follow_each_other(clone, fork):
    for number in (5, 9, 13):
        clone.edit(f"ch01/{FORWARD}", f"line {number}\n", f"LINE {number}\n")
        mine(fork, FORWARD, (fork.folder / FORWARD).read_text().replace(f"line {number + 2}\n", "my line\n"))
        assert update(fork.folder, root=clone.root) == 0
    text = (fork.folder / FORWARD).read_text()
    assert text.count("LINE") == 3 and text.count("my line") == 3


def test_a_conflict_is_shown_and_waits_to_be_resolved(clone, fork, capsys):
    mine(fork, FORWARD, PASS.replace("line 5\n", "my line\n"))
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    clone.edit("ch01/passes/sky.py", "sky 5\n", "sky five\n")
    assert update(fork.folder, root=clone.root) == 1
    said = capsys.readouterr()
    assert "    5 <<<<<<< yours" in said.out and "take the four marker lines out" in said.out
    assert "1 with a conflict" in said.err
    assert (fork.folder / "passes/sky.py").read_bytes() == clone.read("ch01/passes/sky.py")
    assert read_fork(fork.folder).conflicts == (FORWARD,)
    with pytest.raises(UserError, match=r"passes/forward.py has conflict markers"):
        update(fork.folder, root=clone.root)
    mine(fork, FORWARD, PASS.replace("line 5\n", "my line, five\n"))
    assert update(fork.folder, root=clone.root) == 0
    assert read_fork(fork.folder).conflicts == ()
    assert "my line, five" in (fork.folder / FORWARD).read_text()


def test_removed_renamed_and_binary_files(clone, fork):
    mine(fork, "passes/sky.py", PASS.replace("line", "sky").replace("sky 15\n", "my sky\n"))
    mine(fork, FORWARD, PASS.replace("line 15\n", "my line\n"))
    (clone.root / f"ch01/{FORWARD}").rename(clone.root / "ch01/passes/ahead.py")
    (clone.root / "ch01/passes/sky.py").unlink()
    clone.write("ch01/table.bin", b"\0\1")
    assert update(fork.folder, root=clone.root) == 1  # the sky has lines of the reader's
    files = own_files(fork)
    assert b"my line" in files["passes/ahead.py"] and FORWARD not in files
    assert b"my sky" in files["passes/sky.py"] and files["table.bin"] == b"\0\1"
    assert read_fork(fork.folder).conflicts == ()  # nothing in a file is to be resolved
    mine(fork, "table.bin", b"\0\2")
    clone.write("ch01/table.bin", b"\0\3")
    assert update(fork.folder, root=clone.root) == 1
    assert own_files(fork)["table.bin"] == b"\0\2"
    assert (fork.base / "table.bin").read_bytes() == b"\0\3"


def test_what_the_reader_removed_or_renamed_stays_so(clone, fork):
    (fork.folder / FORWARD).rename(fork.folder / "passes/ahead.py")
    (fork.folder / "passes/sky.py").unlink()
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    clone.edit("ch01/passes/sky.py", "sky 5\n", "sky five\n")
    assert update(fork.folder, root=clone.root) == 0
    assert sorted(own_files(fork)) == ["__init__.py", "passes/ahead.py"]
    assert b"line five" in own_files(fork)["passes/ahead.py"]


def test_line_ends_of_the_reader_stay(clone, fork):
    mine(fork, FORWARD, PASS.replace("line 15\n", "my line\n").replace("\n", "\r\n"))
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    assert update(fork.folder, root=clone.root) == 0
    content = own_files(fork)[FORWARD]
    assert b"line five\r\n" in content and b"my line\r\n" in content and content.count(b"\r") == 20


def test_a_dry_run_writes_nothing(clone, fork, capsys):
    mine(fork, FORWARD, PASS.replace("line 5\n", "my line\n"))
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    before = everything(fork)
    assert update(fork.folder, root=clone.root, dry_run=True) == 1
    assert everything(fork) == before
    assert "Nothing was written; 1 file would be, 1 with a conflict" in capsys.readouterr().err


def test_where_one_file_cannot_be_written_none_is(clone, fork, monkeypatch):
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    clone.edit("ch01/passes/sky.py", "sky 5\n", "sky five\n")
    before = everything(fork)
    real, calls = trees.write_whole, []

    def refusing(path, data):
        calls.append(path)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        real(path, data)

    monkeypatch.setattr(trees, "write_whole", refusing)
    with pytest.raises(UserError, match=r"No space left on device\); nothing was changed"):
        update(fork.folder, root=clone.root)
    assert everything(fork) == before


def test_ended_between_two_files_the_next_update_does_the_rest(clone, fork, monkeypatch):
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    clone.edit("ch01/passes/sky.py", "sky 5\n", "sky five\n")
    mine(fork, FORWARD, clone.read(f"ch01/{FORWARD}"))  # one file was written, base and record were not
    assert update(fork.folder, root=clone.root) == 0
    assert read_tree(clone.root / "ch01") == own_files(fork)


def test_without_git_a_fork_without_changes_of_its_own_is_updated(clone, fork, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    clone.edit(f"ch01/{FORWARD}", "line 5\n", "line five\n")
    assert update(fork.folder, root=clone.root) == 0
    mine(fork, FORWARD, (fork.folder / FORWARD).read_text().replace("line 15\n", "my line\n"))
    clone.edit(f"ch01/{FORWARD}", "line 9\n", "line nine\n")
    with pytest.raises(UserError, match="needs git, and there is none on the PATH"):
        update(fork.folder, root=clone.root)


def test_studies_are_updated_where_they_were_copied(clone, tmp_path):
    clone.write("ch01/studies/one.py", "one = 1\n")
    fork = make_fork(1, tmp_path / "all", root=clone.root, clone=clone.folder, studies=True)
    without = make_fork(1, tmp_path / "few", root=clone.root, clone=clone.folder)
    clone.write("ch01/studies/one.py", "one = 2\n")
    assert update(fork.folder, root=clone.root) == 0 and update(without.folder, root=clone.root) == 0
    assert own_files(fork)["studies/one.py"] == b"one = 2\n"
    assert "studies/one.py" not in own_files(without)


def test_a_chapter_that_is_gone_is_one_sentence(clone, tmp_path):
    fork = make_fork(2, tmp_path / "mine", root=clone.root, clone=clone.folder)
    (clone.root / "ch02").rename(clone.root / "gone")
    with pytest.raises(UserError, match="is a fork of chapter 2, which is not in"):
        update(fork.folder, root=clone.root)


def test_the_command_line(strata, tmp_path, monkeypatch):
    code, out, err = strata("fork", "1", "my-ch01")
    assert code == 0 and "is chapter 1, yours to change" in out and "--update my-ch01" in err
    assert read_tree(tmp_path / "my-ch01")["renderer.py"]
    assert strata("fork", "--update", "my-ch01")[0] == 0
    for words, said in (
        (("fork", "1", "my-ch01"), "is a fork already"),
        (("fork", "99", "x"), "There is no chapter 99"),
        (("fork", "1"), "Name a chapter and a folder"),
        (("fork", "--update", "nowhere"), "is not there"),
        (("fork", "1", "x", "--update", "my-ch01"), "takes nothing else"),
        (("fork", "1", "x", "--dry-run"), "is for"),
        (("fork", "my-ch01", "x"), "my-ch01 is a copy of a chapter"),
    ):
        code, _, err = strata(*words)
        assert code == 2 and said in err, err
