"""Old addresses of source files lead to the new ones, with the number of the line."""

from __future__ import annotations

import chapters
from common.paths import ROOT
from tools.site import moved
from tools.site.check import faults, read
from tools.site.draft import Draft


def test_each_entry_leads_from_a_file_that_is_gone_to_one_that_is_here() -> None:
    table = moved.table()
    for old, new in table["repository"].items():
        assert (ROOT / new).is_file(), new
        assert not (ROOT / old).exists(), old
    folders = [chapters.folder_of(number) for number in chapters.available()]
    for old, new in table["chapters"].items():
        assert any((folder / new).is_file() for folder in folders), new
        assert not any((folder / old).exists() for folder in folders), old


def test_an_old_address_leads_to_the_page_of_the_file(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(
        moved,
        "table",
        lambda: {
            "chapters": {"logic/a.py": "scene/b.py", "logic/none.py": "scene/none.py"},
            "repository": {"common/old.py": "common/view/clock.py", "tools/x.py": "tools/y.py"},
        },
    )
    draft = Draft((1,))
    draft.files = {
        "source/chapters/ch01/scene/b.py.html": b"<html lang='en'>",
        "source/common/view/clock.py.html": b"<html lang='en'>",
    }
    moved.add(draft)
    added = draft.files.keys() - {"source/chapters/ch01/scene/b.py.html", "source/common/view/clock.py.html"}
    assert added == {"source/chapters/ch01/logic/a.py.html", "source/common/old.py.html"}
    text = draft.files["source/chapters/ch01/logic/a.py.html"].decode()
    assert ("a", {"href": "../scene/b.py.html"}) in read(text).tags
    assert 'content="0; url=../scene/b.py.html"' in text and "location.hash" in text
    for place, data in draft.files.items():
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes(data)
    assert faults(tmp_path) == []


def test_a_page_that_is_there_stays(monkeypatch) -> None:
    monkeypatch.setattr(moved, "table", lambda: {"chapters": {}, "repository": {"a.py": "b.py"}})
    draft = Draft(())
    draft.files = {"source/a.py.html": b"own", "source/b.py.html": b""}
    moved.add(draft)
    assert draft.files["source/a.py.html"] == b"own"
