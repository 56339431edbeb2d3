"""Three-way merge of files and folders: each rule on the smallest case, held to what a person would write down."""

from __future__ import annotations

import pytest

from common.errors import UserError
from tools.snapshots.merging import (
    Labels,
    has_markers,
    line_ends,
    merge_file,
    merge_trees,
    renames,
    show_conflict,
    writes,
)

pytestmark = pytest.mark.feature("tools/carry")

BASE = b"one\ntwo\nthree\nfour\nfive\nsix\n"
FIXED = BASE.replace(b"two", b"TWO")
LESSON = BASE.replace(b"six\n", b"six\nseven\n")
BOTH = b"one\nTWO\nthree\nfour\nfive\nsix\nseven\n"


def crlf(content: bytes) -> bytes:
    return content.replace(b"\n", b"\r\n")


def test_changes_in_different_places_go_together():
    merged = merge_file(BASE, LESSON, FIXED)
    assert (merged.content, merged.conflicts) == (BOTH, 0)


def test_the_same_place_is_a_conflict_with_all_three_versions():
    merged = merge_file(BASE, BASE.replace(b"two", b"deux"), FIXED, Labels("here", "before", "fix"))
    expected = (
        b"one\n<<<<<<< here\ndeux\n||||||| before\ntwo\n=======\nTWO\n>>>>>>> fix\nthree\nfour\nfive\nsix\n"
    )
    assert (merged.content, merged.conflicts) == (expected, 1)
    assert has_markers(merged.content)
    assert show_conflict(merged.content, around=0)[0] == "    2 <<<<<<< here"


def test_two_places_are_two_conflicts():
    ours = BASE.replace(b"two", b"deux").replace(b"six", b"seize")
    theirs = FIXED.replace(b"six", b"SIX")
    assert merge_file(BASE, ours, theirs).conflicts == 2


@pytest.mark.parametrize("ends", [crlf, bytes])
def test_line_ends_are_kept(ends):
    assert merge_file(ends(BASE), ends(LESSON), ends(FIXED)).content == ends(BOTH)


@pytest.mark.parametrize(
    ("base", "ours", "theirs", "kept"),
    [
        (bytes, crlf, bytes, crlf),
        (crlf, bytes, crlf, bytes),
        (bytes, bytes, crlf, crlf),
        (crlf, bytes, bytes, bytes),
    ],
)
def test_line_ends_are_ours_unless_theirs_changed_them(base, ours, theirs, kept):
    merged = merge_file(base(BASE), ours(LESSON), theirs(FIXED))
    assert (merged.content, merged.conflicts) == (kept(BOTH), 0)


def test_a_file_that_differs_in_line_ends_alone_takes_the_change():
    assert merge_file(BASE, crlf(BASE), FIXED).content == crlf(FIXED)


def test_mixed_line_ends_are_merged_byte_by_byte():
    mixed = crlf(BASE[:8]) + BASE[8:]
    assert line_ends(mixed) is None
    assert merge_file(mixed, mixed + b"seven\n", mixed.replace(b"five", b"FIVE")).content == (
        mixed.replace(b"five", b"FIVE") + b"seven\n"
    )


def test_a_last_line_without_an_end_stays_so():
    merged = merge_file(BASE[:-1], BASE[:-1].replace(b"one", b"1"), BASE[:-1].replace(b"four", b"4"))
    assert merged.content == b"1\ntwo\nthree\n4\nfive\nsix"


def test_a_binary_file_is_equal_or_a_conflict():
    assert merge_file(b"\0a", b"\0a", b"\0b").content == b"\0b"
    merged = merge_file(b"\0a", b"\0c", b"\0b")
    assert (merged.content, merged.conflicts, merged.binary) == (b"\0c", 1, True)


def test_a_users_own_style_of_conflicts_changes_nothing(tmp_path, monkeypatch):
    (tmp_path / "config").write_text("[merge]\n\tconflictStyle = merge\n")
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", str(tmp_path / "config"))
    assert b"|||||||" in merge_file(b"a\n", b"b\n", b"c\n").content


def test_without_git_only_a_real_merge_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert merge_file(BASE, BASE, FIXED).content == FIXED
    with pytest.raises(UserError, match="needs git, and there is none on the PATH: install git"):
        merge_file(BASE, LESSON, FIXED)


def test_a_title_underlined_is_no_conflict():
    assert not has_markers(b"Title\n=======\n\n<<<<<<<x\n")
    assert has_markers(b"a\n>>>>>>> b\n")


def only(steps):
    (step,) = steps
    return step


@pytest.mark.parametrize(
    ("base", "ours", "theirs", "kind", "content"),
    [
        (BASE, BASE, FIXED, "taken", FIXED),
        (BASE, LESSON, FIXED, "merged", BOTH),
        (BASE, FIXED, FIXED, "already", FIXED),
        (BASE, BOTH, FIXED, "already", BOTH),
        (BASE, None, FIXED, "absent", None),
        (BASE, BASE, None, "removed", None),
        (BASE, LESSON, None, "conflict", LESSON),
        (BASE, None, None, "already", None),
        (None, None, FIXED, "added", FIXED),
        (None, FIXED, FIXED, "already", FIXED),
        (b"\0a", b"\0b", b"\0c", "conflict", b"\0b"),
    ],
)
def test_what_becomes_of_a_file(base, ours, theirs, kind, content):
    trees = [{"x": given} if given is not None else {} for given in (base, ours, theirs)]
    step = only(merge_trees(*trees))
    assert (step.kind, step.content) == (kind, content)
    expected = {} if content == ours else {"x": content}
    assert writes([step]) == expected


def test_a_file_added_on_both_sides_shows_both():
    step = only(merge_trees({}, {"x": b"a\n"}, {"x": b"b\n"}))
    assert step.kind == "conflict" and step.marked


def test_what_theirs_did_not_change_is_left_alone():
    assert merge_trees({"x": BASE}, {"x": LESSON, "y": b""}, {"x": BASE}) == []


def test_a_file_renamed_in_theirs_is_merged_under_its_new_name():
    steps = merge_trees({"x": BASE}, {"x": LESSON}, {"y": FIXED})
    assert writes(steps) == {"x": None, "y": BOTH}
    assert steps[1].source == ("x", "y")


def test_a_file_renamed_in_ours_takes_the_change():
    assert writes(merge_trees({"x": BASE}, {"y": LESSON}, {"x": FIXED})) == {"y": BOTH}


def test_a_file_renamed_in_both_keeps_our_name():
    assert writes(merge_trees({"x": BASE}, {"mine": LESSON}, {"y": FIXED})) == {"mine": BOTH}
    assert writes(merge_trees({"x": BASE}, {"y": LESSON}, {"y": FIXED})) == {"y": BOTH}


def test_a_rename_onto_another_file_is_a_conflict_and_both_stay():
    steps = merge_trees(
        {"x": BASE, "y": b"1\n"}, {"x": BASE, "y": b"1\n", "z": b"2\n"}, {"y": b"1\n", "z": FIXED}
    )
    step = only(steps)
    assert (step.kind, step.path, writes(steps)) == ("conflict", "x", {})
    assert "renames this file to z" in step.sentence


def test_of_several_like_files_the_most_like_one_is_the_renamed_one():
    after = {"far": BASE.replace(b"two", b"2").replace(b"six", b"6"), "near": LESSON, "other": b"1\n2\n"}
    assert renames({"x": BASE}, after) == {"x": "near"}
    assert renames({"x": BASE}, {"other": b"1\n2\n"}) == {}
    assert renames({"x": b""}, {"y": b""}) == {}


def test_a_new_file_of_the_lesson_is_no_renamed_one_if_base_knows_it():
    step = only(merge_trees({"x": BASE}, {"y": BASE}, {"x": FIXED}, known={"x", "y"}))
    assert step.kind == "absent"
