"""The rules of snapshots, held by the chapters of this clone; what they are is in `tools/snapshots/rules.py`."""

from __future__ import annotations

import pytest

import chapters
from tools.snapshots.exceptions import read_exceptions
from tools.snapshots.rules import check


@pytest.fixture(scope="module")
def broken():
    return check(chapters.FOLDER)


@pytest.mark.parametrize("number", chapters.available())
def test_a_chapter_changes_what_its_lesson_says(broken, number):
    said = [str(one) for one in broken if one.chapter == chapters.folder_name(number)]
    if said:
        pytest.fail("\n".join(said), pytrace=False)


def test_exceptions_are_of_chapters_that_are_here(broken):
    here = [chapters.folder_name(number) for number in chapters.available()]
    assert all(one.chapter in here for one in broken)
    assert all(one.chapter in here for one in read_exceptions(chapters.FOLDER).not_carried)
