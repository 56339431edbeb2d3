"""What is found wrong in pages, each on the smallest page that has it."""

from __future__ import annotations

import pytest

from tools.site.check import faults

GOOD = '<html lang="en"><body><h1 id="top">a</h1><a href="b/c.html#here">c</a>'
GOOD += '<img src="p.png" alt="a picture"></body></html>'
OTHER = '<html lang="en"><body><p id="here"></p><a href="../a.html#top">a</a>'
OTHER += '<a href="https://example.org">e</a></body></html>'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "b").mkdir()
    (tmp_path / "a.html").write_text(GOOD, "utf-8")
    (tmp_path / "b" / "c.html").write_text(OTHER, "utf-8")
    (tmp_path / "p.png").write_bytes(b"")
    return tmp_path


def test_good_pages_have_no_fault(folder) -> None:
    assert faults(folder) == []


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("b/c.html#here", "b/d.html", "links to b/d.html, which is not there."),
        ("#here", "#there", "and there is no such place on that page."),
        ('alt="a picture"', 'alt=" "', "without words"),
        ('alt="a picture"', "", "without words"),
        ("p.png", "q.png", "links to q.png, which is not there."),
        ("p.png", "https://example.org/p.png", "loads https://example.org/p.png from another machine."),
        ("<body>", '<head><script src="//cdn.example.org/x.js"></script></head>', "from another machine."),
        (
            "<body>",
            '<head><link href="x.css" rel="stylesheet"></head>',
            "links to x.css, which is not there.",
        ),
        (' lang="en"', "", "does not say its language."),
    ],
)
def test_each_fault_is_found(folder, old: str, new: str, said: str) -> None:
    assert old in GOOD
    (folder / "a.html").write_text(GOOD.replace(old, new), "utf-8")
    (found,) = faults(folder)
    assert found.startswith("a.html ") and said in found


def test_scripts_and_comments_are_not_read_as_pages(folder) -> None:
    text = GOOD.replace(
        "<body>", "<body><script>const x = '<img src=1>';</script><!-- <a href='gone'> --><style>a{}</style>"
    )
    (folder / "a.html").write_text(text, "utf-8")
    assert faults(folder) == []
