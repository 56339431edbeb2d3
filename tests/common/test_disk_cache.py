"""The cache stays below its size: what was not needed for longest goes, what was needed today stays."""

from __future__ import annotations

import os
import time

from common.files.disk_cache import DAY_S, mark_read, prune

NOW = time.time()


def entry(folder, name, days, size=100):
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (NOW - days * DAY_S, NOW - days * DAY_S))
    return path


def test_the_oldest_go_first_and_only_as_many_as_it_takes(tmp_path):
    for days in (9, 2, 5, 3):
        entry(tmp_path, f"{days}", days)
    assert prune(tmp_path, 250) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["2", "3"]
    assert prune(tmp_path, 250) == 0


def test_what_was_needed_today_stays_however_large(tmp_path):
    entry(tmp_path, "new", 0.5, 1000)
    entry(tmp_path, "old", 3)
    assert prune(tmp_path, 0) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["new"]


def test_what_a_killed_program_was_writing_goes_a_day_later(tmp_path):
    entry(tmp_path, ".abandoned.x1", 1.5)
    entry(tmp_path, ".being-written.x2", 0.01)
    entry(tmp_path, "entry", 30)
    assert prune(tmp_path, 10**9) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == [".being-written.x2", "entry"]


def test_reading_keeps_an_entry(tmp_path):
    kept, lost = entry(tmp_path, "kept", 30), entry(tmp_path, "lost", 20)
    mark_read(kept)
    assert prune(tmp_path, 100) == 1
    assert kept.exists()
    assert not lost.exists()
    recent = entry(tmp_path, "recent", 0.5)
    before = recent.stat().st_mtime
    mark_read(recent)
    assert recent.stat().st_mtime == before  # once a day is enough: the disk is not written at every start


def test_links_folders_and_missing_places_are_left_alone(tmp_path):
    (tmp_path / "folder").mkdir()
    target = entry(tmp_path / "folder", "target", 30)
    (tmp_path / "link").symlink_to(target)
    assert prune(tmp_path, 0) == 0
    assert target.exists()
    assert prune(tmp_path / "none", 0) == 0
    mark_read(tmp_path / "none")
