"""When a change of a file counts: after the last step of saving it, once, and together with its neighbours."""

from __future__ import annotations

import os

import pytest

from common.files import shader_files
from common.files.shader_files import load, pinned, refreshed
from tools.run.live import RETURNS_S, SETTLED_S, Watcher


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def folder(tmp_path):
    for name in "abc":
        (tmp_path / name).write_text(name)
    return tmp_path


@pytest.fixture
def watched(folder):
    """A watcher of a, b, c and of a file that is not there, with its clock."""
    clock = Clock()
    watcher = Watcher(clock)
    watcher.watch({folder / name for name in "abcd"})
    return watcher, clock


def polls(watcher, clock, seconds, step=0.01):
    """Return [(time, names)] of what is found in the next seconds."""
    found, end = [], clock.now + seconds
    while clock.now < end:
        clock.now += step
        if paths := watcher.poll():
            found.append((clock.now, {path.name for path in paths}))
    return found


def test_a_change_is_found_once_after_it_settled(folder, watched):
    watcher, clock = watched
    assert polls(watcher, clock, 1.0) == []
    (folder / "a").write_text("changed")
    began = clock.now
    ((when, names),) = polls(watcher, clock, 1.0)
    assert names == {"a"}
    assert SETTLED_S <= when - began <= SETTLED_S + 0.03
    assert began < watcher.noticed <= began + 0.011


def test_a_file_that_is_still_being_written_is_waited_for(folder, watched):
    watcher, clock = watched
    for count in range(1, 9):
        (folder / "a").write_text("x" * count)
        assert polls(watcher, clock, 0.8 * SETTLED_S) == []
    assert [names for _, names in polls(watcher, clock, 1.0)] == [{"a"}]


def test_a_file_that_is_emptied_and_then_written_is_one_change(folder, watched):
    watcher, clock = watched
    (folder / "a").write_text("")
    assert polls(watcher, clock, 0.8 * RETURNS_S) == []
    (folder / "a").write_text("all of it")
    assert [names for _, names in polls(watcher, clock, 1.0)] == [{"a"}]


def test_a_file_that_is_removed_and_comes_back_as_it_was_is_a_change_once(folder, watched):
    watcher, clock = watched
    (folder / "a").rename(folder / "a.saved")
    assert polls(watcher, clock, 0.8 * RETURNS_S) == []
    (folder / "a.saved").rename(folder / "a")
    assert len(polls(watcher, clock, 1.0)) <= 1, "its time of change is another one, its text may be"
    (folder / "a").unlink()
    assert [names for _, names in polls(watcher, clock, 2.0)] == [{"a"}]
    (folder / "a").write_text("a")
    assert [names for _, names in polls(watcher, clock, 2.0)] == [{"a"}]


def test_files_saved_together_are_found_together(folder, watched):
    watcher, clock = watched
    (folder / "a").write_text("changed")
    assert polls(watcher, clock, 0.8 * SETTLED_S) == []
    (folder / "b").write_text("changed")
    assert [names for _, names in polls(watcher, clock, 1.0)] == [{"a", "b"}]


def test_a_file_that_never_rests_holds_nobody_up_for_ever(folder, watched):
    watcher, clock = watched
    (folder / "a").write_text("changed")
    found = []
    for count in range(200):
        (folder / "b").write_text("x" * (count + 2))
        found += polls(watcher, clock, 0.02)
    assert found[0][1] == {"a"}
    assert found[0][0] <= 2 * RETURNS_S + 0.1


def test_a_file_that_appears_and_one_that_is_renamed_over_another(folder, watched):
    watcher, clock = watched
    (folder / "d").write_text("d")
    assert [names for _, names in polls(watcher, clock, 1.0)] == [{"d"}]
    (folder / "new").write_text("b")
    state = (folder / "b").stat()
    os.utime(folder / "new", ns=(state.st_atime_ns, state.st_mtime_ns))
    os.replace(folder / "new", folder / "b")
    assert [names for _, names in polls(watcher, clock, 1.0)] == [{"b"}], "same size, same time, another file"


def test_a_file_saved_between_its_reading_and_the_first_look_is_found(folder):
    clock = Clock()
    watcher = Watcher(clock)
    with pinned():
        load(folder / "a")
        assert not shader_files.is_there(folder / "d")
        (folder / "a").write_text("changed")
        (folder / "d").write_text("new")
        watcher.watch({folder / "a", folder / "d"})
        assert [names for _, names in polls(watcher, clock, 1.0)] == [{"a", "d"}]


def test_pinned_files_keep_their_text_until_they_are_refreshed(folder):
    path = folder / "a"
    with pinned():
        assert load(path).lines == ("a",)
        path.unlink()
        assert load(path).lines == ("a",)
        path.write_text("b")
        with pytest.raises(ZeroDivisionError), refreshed([path]):
            assert len(load(path).lines) / (load(path).lines != ("b",))
        assert load(path).lines == ("a",)
        with refreshed([path]):
            assert load(path).lines == ("b",)
        assert load(path).lines == ("b",)
    path.write_text("c")
    assert load(path).lines == ("c",)


def test_edits_of_one_size_within_a_tick_of_the_clock_are_told_apart(folder):
    path = folder / "a"
    with pinned():
        for number in range(100):
            path.write_text(f"{number:03}")
            with refreshed([path]):
                assert load(path).lines == (f"{number:03}",)
