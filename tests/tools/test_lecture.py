"""The lectures: 10 to 15 stops for each chapter, at lines that exist, and a key that shows the whole difference."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

import chapters
from common.errors import UserError
from tools.diff.files import sources
from tools.diff.lecture import FEWEST, MOST, Stop, first_line, lecture, picture_of, stops_of

LECTURES = [number for number in chapters.available() if number > 1]


@pytest.mark.parametrize("number", LECTURES)
def test_every_stop_is_at_lines_that_exist(number):
    folder = chapters.folder_of(number)
    stops, files = stops_of(folder), sources(folder)
    assert FEWEST <= len(stops) <= MOST
    assert len({stop.title for stop in stops}) == len(stops)
    assert sum(bool(stop.picture) for stop in stops) >= 3
    for stop in stops:
        assert stop.title and len(stop.notes.split()) >= 5 and (stop.file or stop.picture), stop
        assert picture_of(stop) or not stop.picture
        if stop.file:
            text = files[stop.file].text
            assert text is not None and 3 <= stop.lines <= 30
            assert first_line(stop, text) + stop.lines <= len(text.split("\n")), stop


@pytest.mark.parametrize("number", LECTURES)
def test_every_stop_is_about_the_chapter(number):
    """A file of a stop is new or changed in this chapter."""
    before, after = (sources(chapters.folder_of(one)) for one in (number - 1, number))
    for stop in stops_of(chapters.folder_of(number)):
        if stop.file:
            assert stop.file not in before or before[stop.file].data != after[stop.file].data, stop.file


def test_a_line_that_is_gone_or_there_twice_is_named():
    stop = Stop("Names", "Some notes.", "a.py", "def f(", 3)
    assert first_line(stop, "x\ndef f(a):\n") == 1
    for text, count in (("x\n", 0), ("def f(a):\ndef f(b):\n", 2)):
        with pytest.raises(UserError, match=rf"'Names': {count} lines of a\.py begin with"):
            first_line(stop, text)
    with pytest.raises(UserError, match=r"no picture none\.svg"):
        picture_of(replace(stop, picture="none.svg"))


def test_text_of_a_stop_is_text():
    shown = lecture([Stop("<b>", "a & b <script>")], None, None, None)
    assert "<b>" not in shown and "<script>" not in shown and "a &amp; b" in shown


def test_the_page_has_the_lecture_and_the_whole_difference(strata, tmp_path):
    assert strata("diff", 3, 4, "--lecture", "--no-pictures", "--html", "a.html")[0] == 0
    page = (tmp_path / "a.html").read_text("utf-8")
    stops = stops_of(chapters.folder_of(4))
    assert '<body class="lecture">' in page and 'id="full"' in page and 'id="notes"' in page
    before, _, after = page.partition('<main id="main">')
    assert len(re.findall(r'aria-label="stop \d+', before)) == len(stops)
    assert "graph/types.py" in after and after.count('class="step"') > 50
    assert '"l add"' not in before  # all of these files are new
    assert strata("diff", 3, 4, "--no-pictures", "--html", "b.html")[0] == 0
    assert 'id="lecture"' not in (tmp_path / "b.html").read_text("utf-8")


def test_new_lines_of_a_file_that_was_there_are_marked(strata, tmp_path):
    assert strata("diff", 1, 2, "--lecture", "--no-pictures", "--html", "a.html")[0] == 0
    before = (tmp_path / "a.html").read_text("utf-8").partition('<main id="main">')[0]
    assert '"l add"' in before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("3", "5", "--lecture", "--html", "a.html"), "the one before it"),
        (("3", "4", "--lecture"), "--html FILE"),
        (("3", "4", "--lecture", "--only", "gl", "--html", "a.html"), "leave --only out"),
        (("3", "4", "--lecture", "--stat", "--html", "a.html"), "leave --stat out"),
        (("3", "4", "--lecture", "--all", "--html", "a.html"), "leave --all out"),
        (("3@gl", "4@gl", "--lecture", "--html", "a.html"), "leave the @ of both sides out"),
    ],
)
def test_a_lecture_on_something_else_is_refused(strata, words, said):
    code, _, err = strata("diff", *words)
    assert code == 2 and said in err and "Traceback" not in err


def test_a_chapter_without_a_lecture_or_with_a_damaged_one_says_so(tmp_path):
    with pytest.raises(UserError, match="no lecture"):
        stops_of(tmp_path)
    for text in ("", "stops = 3", "[[stops]]\ntitle = 'a'", "[[stops"):
        (tmp_path / "lecture.toml").write_text(text, "utf-8")
        with pytest.raises(UserError, match="cannot be read"):
            stops_of(tmp_path)
