"""Files are written whole, to where their links lead; the cache is where the user said."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from common import images, paths
from common.errors import UserError
from common.paths import START, cache_dir, cache_problem, user_cache, write_whole

posix = pytest.mark.skipif(sys.platform == "win32", reason="links and pipes are those of POSIX")


@posix
def test_a_link_stays_a_link_and_its_target_is_written(tmp_path):
    (tmp_path / "below").mkdir()
    target, link, second = tmp_path / "below" / "real.png", tmp_path / "a.png", tmp_path / "b.png"
    link.symlink_to("below/real.png")
    second.symlink_to(link)
    for data, path in ((b"first", link), (b"second", second)):  # the target is not there, and then it is
        write_whole(path, data)
        assert link.is_symlink() and second.is_symlink()
        assert target.read_bytes() == data and not target.is_symlink()
    assert [path.name for path in (tmp_path / "below").iterdir()] == ["real.png"]


@posix
def test_a_failed_write_through_a_link_leaves_the_old_file(tmp_path, monkeypatch):
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(paths.os, "replace", full)
    with pytest.raises(OSError):
        write_whole(tmp_path / "link", b"new")
    assert (tmp_path / "real").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "real"]


@posix
def test_a_link_into_a_missing_folder_is_refused_before_the_work(tmp_path):
    (tmp_path / "a.png").symlink_to("nowhere/real.png")
    with pytest.raises(UserError, match=r"no folder .*nowhere"):
        images.check_writable(tmp_path / "a.png")


@posix
def test_a_pipe_is_written_to_in_place(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_whole(tmp_path / "pipe", b"whole")
    assert os.read(reader, 100) == b"whole"
    os.close(reader)
    assert (tmp_path / "pipe").is_fifo()


@posix
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("new", ""),
        ("there", ""),
        ("null", ""),
        ("to new", ""),
        ("pipe", "it is a pipe, a socket or a device, not a regular file"),
        ("to pipe", "it is a pipe, a socket or a device, not a regular file"),
        ("folder", "it is a folder"),
        ("loop", "Too many levels of symbolic links"),
        ("missing/a", "there is no folder "),
        ("to missing", "there is no folder "),
        ("there/a", "Not a directory"),
        ("x" * 1000, "File name too long"),
        ("x" * 246, "its name is longer than 245 bytes"),
        ("x" * 245, ""),
        ("\u65e5" * 82, "its name is longer than 245 bytes"),
    ],
)
def test_what_takes_no_file_is_told_before_the_work(tmp_path, name, says):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "there").write_text("mine")
    (tmp_path / "folder").mkdir()
    links = {
        "to pipe": "pipe",
        "to new": "new",
        "to missing": "missing/a",
        "loop": "loop",
        "null": os.devnull,
    }
    for link, target in links.items():
        (tmp_path / link).symlink_to(target)
    before = sorted(os.walk(tmp_path))
    problem = paths.write_problem(tmp_path / name)
    assert problem.startswith(says) and bool(problem) == bool(says)
    assert sorted(os.walk(tmp_path)) == before


@posix
def test_a_folder_shows_by_an_attempt_whether_it_takes_files(tmp_path, monkeypatch):
    assert paths.folder_problem(tmp_path) == "" == paths.folder_problem(tmp_path / "new" / "newer")
    (tmp_path / "file").write_text("mine")
    for place in ("file", "file/below"):
        assert paths.folder_problem(tmp_path / place) == f"{tmp_path / 'file'} is no folder"

    def refused(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(paths.tempfile, "TemporaryFile", refused)
    for place in (tmp_path, tmp_path / "new"):
        assert paths.folder_problem(place) == f"no file can be made in {tmp_path} (Permission denied)"
    assert paths.write_problem(tmp_path / "file") == f"no file can be made in {tmp_path} (Permission denied)"
    assert (tmp_path / "file").read_text() == "mine" and len([*tmp_path.iterdir()]) == 1


def test_the_cache_is_in_the_home_or_counts_from_the_folder_of_the_start(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.setenv("STRATA_CACHE", "~/x")
    assert user_cache() == tmp_path / "x"
    assert cache_dir("made") == tmp_path / "x" / "made" and cache_problem() == ""
    monkeypatch.setenv("STRATA_CACHE", "relative/y")
    monkeypatch.chdir(tmp_path)
    assert user_cache() == Path(START) / "relative" / "y"


def test_a_cache_that_is_none_is_explained(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path / "file"))
    assert cache_dir("any") is None
    assert cache_problem().startswith(f"{tmp_path / 'file'} cannot be written (")


def test_a_pattern_that_matches_nothing_is_an_error(tmp_path):
    for name in ("b.py", "a.py", "c.txt"):
        (tmp_path / name).write_text("")
    (tmp_path / "folder.py").mkdir()
    found = paths.matched(("c.txt", "*.py", "a.*"), tmp_path)
    assert [path.name for path in found] == ["a.py", "b.py", "c.txt"]
    with pytest.raises(FileNotFoundError, match=r"matches old/\*\.py"):
        paths.matched(("*.py", "old/*.py"), tmp_path)
