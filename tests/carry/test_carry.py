"""`strata carry`: a fix goes through fourteen chapters, stops, goes on, and is taken back, on synthetic clones."""

from __future__ import annotations

import stat
import subprocess
import sys

import pytest

from bootstrap.environment import try_lock
from common.errors import UserError
from common.paths import ROOT
from tests.support.clones import PASS, Clone
from tools.snapshots import carry, carry_state, trees
from tools.snapshots.carry_state import place

pytestmark = pytest.mark.feature("tools/carry")
FORWARD = "passes/forward.py"
FIX = PASS.replace("line 5\n", "line five\n")


@pytest.fixture(scope="module")
def fifteen(tmp_path_factory):
    """Fifteen chapters; lessons 4 and 9 have added lines of their own to the file that will be mended."""
    made = Clone(tmp_path_factory.mktemp("fifteen"), git=False)
    for number in range(4, 16):
        made.edit(f"ch{number:02d}/{FORWARD}", "line 15\n", "line 15\nof lesson 4\n")
    for number in range(9, 16):
        made.edit(f"ch{number:02d}/{FORWARD}", "line 20\n", "line 20\nof lesson 9\n")
    made.begin()
    return made


@pytest.fixture
def clone(fifteen, tmp_path):
    return fifteen.copy(tmp_path / "clone")


def state_of(clone):
    return {name for name in clone.files() if name.startswith(".strata/") and not name.endswith(".lock")}


def test_a_fix_goes_through_fourteen_chapters(clone, capsys):
    before = clone.files()
    clone.write(f"ch01/{FORWARD}", FIX)
    assert carry.start(clone.root, 1, [FORWARD]) == 0
    for number in range(1, 16):
        name = f"chapters/ch{number:02d}/{FORWARD}"
        expected = before[name].replace(b"line 5\n", b"line five\n")
        assert clone.files()[name] == expected
    untouched = {name for name in before if not name.endswith(FORWARD)}
    assert all(clone.files()[name] == before[name] for name in untouched)
    assert not state_of(clone)
    said = capsys.readouterr()
    assert "ch03  passes/forward.py: takes it: the file was the same" in said.out
    assert "ch09  passes/forward.py: merged with its own lines" in said.out
    assert "14 files written" in said.err


def test_chapters_are_taken_by_number_and_gaps_are_passed(tmp_path):
    clone = Clone(tmp_path, count=1)
    for name in ("ch2", "ch10", "ch03", "ch01_mine"):
        clone.write(f"{name}/{FORWARD}", PASS)
    clone.commit("more")
    clone.write(f"ch01/{FORWARD}", FIX)
    fix = carry._fix(clone.root, 1, [FORWARD], "HEAD")
    assert [landing.folder for landing in carry.plan(clone.root, 1, fix)] == ["ch2", "ch03", "ch10"]


@pytest.fixture
def conflict(clone):
    """From chapter 6 on a lesson has changed the line that the fix changes."""
    for number in range(6, 16):
        clone.edit(f"ch{number:02d}/{FORWARD}", "line 5\n", "line 5 of lesson 6\n")
    clone.write(f"ch03/{FORWARD}", FIX)
    return clone


def resolve(clone, number, text="line five of lesson 6\n"):
    name = f"ch{number:02d}/{FORWARD}"
    lines = clone.read(name).decode().splitlines(keepends=True)
    begin = next(i for i, line in enumerate(lines) if line.startswith("<<<<<<<"))
    end = next(i for i, line in enumerate(lines) if line.startswith(">>>>>>>"))
    clone.write(name, "".join([*lines[:begin], text, *lines[end + 1 :]]))


def test_a_conflict_stops_there_and_the_markers_are_explained(conflict, capsys):
    before = conflict.files()
    assert carry.start(conflict.root, 3, [FORWARD]) == 1
    said = capsys.readouterr()
    assert "chapters/ch06/passes/forward.py, 1 place:" in said.out
    for line in ("    5 <<<<<<< ch06", "    6 line 5 of lesson 6", "   10 line five"):
        assert line in said.out
    assert "take the four marker lines out" in said.out
    assert "stopped at ch06" in said.err
    assert b"line five" in conflict.read(f"ch05/{FORWARD}")
    assert conflict.files()[f"chapters/ch07/{FORWARD}"] == before[f"chapters/ch07/{FORWARD}"]
    assert state_of(conflict) == {".strata/carry.json"}


def test_it_goes_on_once_the_conflict_is_resolved_and_meets_it_only_once(conflict):
    carry.start(conflict.root, 3, [FORWARD])
    with pytest.raises(UserError, match=r"ch06/passes/forward.py still has conflict markers"):
        carry.resume(conflict.root)
    with pytest.raises(UserError, match=r"A carry from ch03 is not finished"):
        carry.start(conflict.root, 3, [FORWARD])
    resolve(conflict, 6)
    assert carry.resume(conflict.root) == 0
    for number in range(7, 16):
        content = conflict.read(f"ch{number:02d}/{FORWARD}")
        assert b"line five of lesson 6\n" in content and b"<<<<" not in content
        assert (b"of lesson 9" in content) == (number >= 9)
    assert not state_of(conflict)
    with pytest.raises(UserError, match="No carry is waiting"):
        carry.resume(conflict.root)


def test_two_conflicts_stop_twice_and_one_abort_takes_all_back(conflict):
    for number in range(12, 16):
        conflict.edit(f"ch{number:02d}/{FORWARD}", "line 5 of lesson 6\n", "line 5 of lesson 12\n")
    before = conflict.files()
    assert carry.start(conflict.root, 3, [FORWARD]) == 1
    resolve(conflict, 6)
    assert carry.resume(conflict.root) == 1
    assert b"<<<<<<< ch12" in conflict.read(f"ch12/{FORWARD}")
    assert carry.abort(conflict.root) == 0
    assert {n: c for n, c in conflict.files().items() if ".strata" not in n} == before
    with pytest.raises(UserError, match="nothing to take back"):
        carry.abort(conflict.root)


def test_a_conflict_resolved_by_leaving_the_file_ends_its_way(conflict):
    before = conflict.files()
    carry.start(conflict.root, 3, [FORWARD])
    resolve(conflict, 6, "line 5 of lesson 6\n")
    assert carry.resume(conflict.root) == 0
    assert conflict.files()[f"chapters/ch07/{FORWARD}"] == before[f"chapters/ch07/{FORWARD}"]


def test_abort_refuses_to_lose_what_was_changed_since(conflict):
    carry.start(conflict.root, 3, [FORWARD])
    conflict.edit(f"ch04/{FORWARD}", "line 1\n", "line 1, changed since\n")
    with pytest.raises(UserError, match=r"ch04/passes/forward.py was changed after the carry wrote it"):
        carry.abort(conflict.root)
    assert b"changed since" in conflict.read(f"ch04/{FORWARD}")


def test_a_dry_run_writes_nothing(conflict, capsys):
    before = conflict.files()
    assert carry.start(conflict.root, 3, [FORWARD], dry_run=True) == 1
    assert conflict.files() == before
    said = capsys.readouterr()
    assert "ch05  passes/forward.py: takes it" in said.out and "<<<<<<< ch06" in said.out
    assert "it would stop at ch06" in said.err
    conflict.write(f"ch03/{FORWARD}", PASS.replace("line 18\n", "line eighteen\n"))
    assert carry.start(conflict.root, 3, [FORWARD], dry_run=True) == 0
    assert "Nothing was written; 12 files would be" in capsys.readouterr().err


def test_a_dry_run_may_look_ahead_of_a_waiting_carry(conflict):
    carry.start(conflict.root, 3, [FORWARD])
    resolve(conflict, 6)
    before = conflict.files()
    assert carry.resume(conflict.root, dry_run=True) == 0
    assert conflict.files() == before


def test_new_removed_and_renamed_files_are_carried(clone):
    clone.write("ch02/passes/new.py", "new = 1\n")
    (clone.root / "ch02/passes/sky.py").unlink()
    (clone.root / f"ch02/{FORWARD}").rename(clone.root / "ch02/passes/ahead.py")
    clone.edit("ch02/passes/ahead.py", "line 5\n", "line five\n")
    assert carry.start(clone.root, 2, ["passes"]) == 0
    for number in range(3, 16):
        names = sorted(path.name for path in (clone.root / f"ch{number:02d}/passes").iterdir())
        assert names == ["ahead.py", "new.py"]
        content = clone.read(f"ch{number:02d}/passes/ahead.py")
        assert b"line five\n" in content and (b"of lesson 9" in content) == (number >= 9)


def test_both_names_of_a_renamed_file_go_when_one_is_given(clone, capsys):
    (clone.root / f"ch02/{FORWARD}").rename(clone.root / "ch02/passes/ahead.py")
    assert carry.start(clone.root, 2, ["passes/ahead.py"]) == 0
    assert not (clone.root / f"ch15/{FORWARD}").exists()
    assert b"of lesson 9" in clone.read("ch15/passes/ahead.py")
    assert "ch04  passes/ahead.py: merged with its own lines" in capsys.readouterr().out


def test_a_file_that_a_lesson_removed_or_renamed(clone, capsys):
    for number in range(7, 16):
        (clone.root / f"ch{number:02d}/{FORWARD}").rename(clone.root / f"ch{number:02d}/passes/ahead.py")
    for number in range(11, 16):
        (clone.root / f"ch{number:02d}/passes/ahead.py").unlink()
    clone.write(f"ch01/{FORWARD}", FIX)
    assert carry.start(clone.root, 1, [FORWARD]) == 0
    assert b"line five" in clone.read("ch10/passes/ahead.py")
    said = capsys.readouterr().out
    assert "ch11  passes/ahead.py: left out: there is no such file any more" in said
    assert "ch12" not in said


def test_a_file_like_the_removed_one_that_was_there_before_is_no_renamed_one(clone):
    for number in range(5, 16):
        clone.write(f"ch{number:02d}/passes/like.py", PASS)
    for number in range(7, 16):
        (clone.root / f"ch{number:02d}/{FORWARD}").unlink()
    clone.write(f"ch01/{FORWARD}", FIX)
    assert carry.start(clone.root, 1, [FORWARD]) == 0
    assert clone.read("ch07/passes/like.py") == PASS.encode()


def test_removing_what_a_lesson_changed_is_a_question_without_markers(clone, capsys):
    (clone.root / f"ch01/{FORWARD}").unlink()
    assert carry.start(clone.root, 1, [FORWARD]) == 1
    assert "remove it or keep it" in capsys.readouterr().out
    assert not (clone.root / f"ch03/{FORWARD}").exists()
    (clone.root / f"ch04/{FORWARD}").unlink()
    assert carry.resume(clone.root) == 1  # lesson 9 changed it once more
    assert not (clone.root / f"ch08/{FORWARD}").exists()
    assert carry.resume(clone.root) == 0
    assert (clone.root / f"ch15/{FORWARD}").exists()


def test_binary_files_are_taken_whole_or_asked_about(clone):
    for number in range(1, 16):
        clone.write(f"ch{number:02d}/table.bin", b"\0\1" if number < 8 else b"\0\2")
    clone.commit("tables")
    clone.write("ch01/table.bin", b"\0\3")
    assert carry.start(clone.root, 1, ["table.bin"]) == 1
    assert (clone.read("ch07/table.bin"), clone.read("ch08/table.bin")) == (b"\0\3", b"\0\2")
    clone.write("ch08/table.bin", b"\0\4")
    assert carry.resume(clone.root) == 0
    assert clone.read("ch15/table.bin") == b"\0\4"


def test_line_ends_of_each_chapter_are_kept(clone):
    crlf = clone.read(f"ch05/{FORWARD}").replace(b"\n", b"\r\n")
    clone.write(f"ch05/{FORWARD}", crlf)
    clone.write(f"ch01/{FORWARD}", FIX)
    assert carry.start(clone.root, 1, [FORWARD]) == 0
    assert clone.read(f"ch05/{FORWARD}") == crlf.replace(b"line 5\r", b"line five\r")
    assert b"\r" not in clone.read(f"ch06/{FORWARD}")


def test_a_chapter_that_has_the_fix_already_passes_it_on(clone, capsys):
    clone.write(f"ch01/{FORWARD}", FIX)
    clone.write(f"ch02/{FORWARD}", FIX)
    clone.edit(f"ch05/{FORWARD}", "line 5\n", "line five\n")
    assert carry.start(clone.root, 1, [FORWARD]) == 0
    assert b"line five" in clone.read(f"ch03/{FORWARD}") and b"line five" in clone.read(f"ch06/{FORWARD}")
    assert "ch05  passes/forward.py: has it already" in capsys.readouterr().out


def test_what_the_stopped_chapter_has_already_goes_on_behind_it(conflict):
    conflict.edit("ch03/passes/sky.py", "sky 2\n", "sky two\n")
    conflict.edit("ch06/passes/sky.py", "sky 2\n", "sky two\n")
    assert carry.start(conflict.root, 3, ["passes"]) == 1
    resolve(conflict, 6)
    assert carry.resume(conflict.root) == 0
    assert b"sky two\n" in conflict.read("ch07/passes/sky.py")


def test_a_fix_that_is_committed_is_carried_from_the_commit_before(clone):
    clone.write(f"ch01/{FORWARD}", FIX)
    clone.commit("mend")
    with pytest.raises(UserError, match="--base HEAD~1"):
        carry.start(clone.root, 1, [FORWARD])
    assert carry.start(clone.root, 1, [FORWARD], base="HEAD~1") == 0
    assert b"line five" in clone.read(f"ch15/{FORWARD}")


def test_files_are_named_as_one_sees_them(clone, monkeypatch):
    clone.write(f"ch03/{FORWARD}", FIX)
    monkeypatch.chdir(clone.root / "ch03" / "passes")
    for text in ("forward.py", FORWARD, f"chapters/ch03/{FORWARD}", str(clone.root / "ch03" / FORWARD), "."):
        assert set(carry._fix(clone.root, 3, [text], "HEAD").theirs) == {FORWARD}


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (["passes/forwrad.py"], "did you mean 'passes/forward.py'"),
        (["../ch04/passes/forward.py"], "is not in ch03"),
        (["passes/sky.py"], "is as it is in HEAD"),
        (["studies/one.py"], "studies are not copied"),
        (["benches/one.py"], "benches are not copied"),
        ([], "Which files. In ch03 this differs from HEAD: passes/forward.py"),
    ],
)
def test_a_wrong_file_is_one_sentence(clone, files, said):
    clone.write(f"ch03/{FORWARD}", FIX)
    with pytest.raises(UserError, match=said):
        carry.start(clone.root, 3, files)
    assert not state_of(clone)


def test_a_wrong_base_or_chapter_is_one_sentence(clone):
    with pytest.raises(UserError, match="git rev-parse failed"):
        carry.start(clone.root, 3, [FORWARD], base="nowhere")
    with pytest.raises(UserError, match="There is no chapter 33"):
        carry.start(clone.root, 33, [FORWARD])


def test_the_last_chapter_carries_to_nobody(clone, capsys):
    clone.edit(f"ch15/{FORWARD}", "line 5\n", "line five\n")
    assert carry.start(clone.root, 15, [FORWARD]) == 0
    assert "There is no chapter behind ch15" in capsys.readouterr().err


def test_a_fix_with_markers_in_it_is_refused(clone):
    clone.write(f"ch03/{FORWARD}", "<<<<<<< a\n=======\n>>>>>>> b\n")
    with pytest.raises(UserError, match="has conflict markers: resolve them first"):
        carry.start(clone.root, 3, [FORWARD])


def test_without_a_repository_or_without_git_it_is_one_sentence(tmp_path, monkeypatch):
    clone = Clone(tmp_path, count=2, git=False)
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    with pytest.raises(UserError, match="is in no git repository with a commit"):
        carry.start(clone.root, 1, [FORWARD])
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    with pytest.raises(UserError, match="needs git, and there is none on the PATH: install git"):
        carry.start(clone.root, 1, [FORWARD])


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such bit")
def test_a_program_stays_one(clone):
    (clone.root / f"ch02/{FORWARD}").chmod(0o755)
    clone.write(f"ch01/{FORWARD}", FIX)
    carry.start(clone.root, 1, [FORWARD])
    assert stat.S_IMODE((clone.root / f"ch02/{FORWARD}").stat().st_mode) == 0o755


def test_two_carries_at_once(clone):
    clone.write(f"ch01/{FORWARD}", FIX)
    with carry_state.alone(clone.root):
        code = (
            "import sys; from pathlib import Path; from tools.snapshots import carry\n"
            f"carry.start(Path(sys.argv[1]), 1, [{FORWARD!r}])"
        )
        done = subprocess.run(
            [sys.executable, "-c", code, str(clone.root)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        assert "Another `strata carry` is at work" in done.stderr
    assert clone.read(f"ch02/{FORWARD}") == PASS.encode()
    assert carry.start(clone.root, 1, [FORWARD]) == 0


def test_a_lock_ends_with_its_holder(clone):
    with carry_state.alone(clone.root), open(place(clone.root).with_suffix(".lock"), "ab") as stream:
        assert not try_lock(stream.fileno())
    with carry_state.alone(clone.root):
        pass


def test_a_chapter_that_cannot_be_written_changes_nothing(clone, monkeypatch):
    clone.write(f"ch01/{FORWARD}", FIX)
    before = clone.files()
    real = trees.write_whole

    def refusing(path, data):
        if path.parent.parent.name == "ch09":
            raise PermissionError(13, "Permission denied", str(path))
        real(path, data)

    monkeypatch.setattr(trees, "write_whole", refusing)
    with pytest.raises(UserError, match=r"ch09/passes/forward.py cannot be written \(Permission denied\)"):
        carry.start(clone.root, 1, [FORWARD])
    assert {n: c for n, c in clone.files().items() if ".strata" not in n} == before
    assert not state_of(clone)


def test_ctrl_c_while_it_writes_changes_nothing(clone, monkeypatch):
    clone.write(f"ch01/{FORWARD}", FIX)
    (clone.root / "ch01/passes/sky.py").unlink()
    before = clone.files()
    real = trees.put

    def stopped(folder, name, content):
        real(folder, name, content)
        if name.startswith("ch07/"):
            monkeypatch.setattr(trees, "put", real)
            raise KeyboardInterrupt

    monkeypatch.setattr(trees, "put", stopped)
    with pytest.raises(KeyboardInterrupt):
        carry.start(clone.root, 1, ["passes"])
    assert {n: c for n, c in clone.files().items() if ".strata" not in n} == before
    assert not state_of(clone)


def test_ended_in_the_middle_of_writing_it_can_be_taken_back(clone, monkeypatch):
    clone.write(f"ch01/{FORWARD}", FIX)
    before = clone.files()

    def half(root, files):
        trees.put(root, f"ch02/{FORWARD}", files[f"ch02/{FORWARD}"])
        raise SystemExit

    monkeypatch.setattr(carry, "write_files", half)
    monkeypatch.setattr(carry, "save", _save_only_states)
    with pytest.raises(SystemExit):
        carry.start(clone.root, 1, [FORWARD])
    monkeypatch.undo()
    assert clone.read(f"ch02/{FORWARD}") == FIX.encode()
    with pytest.raises(UserError, match="was ended while it wrote"):
        carry.resume(clone.root)
    assert carry.abort(clone.root) == 0
    assert {n: c for n, c in clone.files().items() if ".strata" not in n} == before


def _save_only_states(root, state):
    """As the process that was ended: what comes behind the writing is not done."""
    if state is not None:
        carry_state.save(root, state)


def test_a_broken_state_is_one_sentence(clone):
    place(clone.root).parent.mkdir()
    for text in ("{", "[]", '{"format": 9}'):
        place(clone.root).write_text(text)
        with pytest.raises(UserError, match="cannot be read, so the carry"):
            carry.resume(clone.root)
