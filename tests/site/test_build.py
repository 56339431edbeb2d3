"""The site as it is built: its pages, what is said of what it lacks, and which folders it takes."""

from __future__ import annotations

import json
import os
import re
from concurrent.futures import ThreadPoolExecutor
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import chapters
from common.errors import UserError
from common.paths import ROOT
from tools.bench import bench
from tools.diff.style import DARK, LIGHT
from tools.run import notebooks
from tools.run.shown import Picture
from tools.site import chapter, notebook, pairs, site, tables
from tools.site import draft as site_draft
from tools.site.draft import TEXTS, Draft

VOID = {
    *("img", "source", "input", "br", "link", "meta", "hr", "wbr"),
    *("line", "path", "circle", "polyline", "rect", "use"),
}


def pages(built: site.Built) -> dict[str, str]:
    """Return the pages that mkdocs made."""
    own = ("source/", "chapters/ch01-diff")
    found = {path.relative_to(built.folder).as_posix(): path for path in built.folder.rglob("*.html")}
    return {name: path.read_text("utf-8") for name, path in found.items() if not name.startswith(own)}


class Balance(HTMLParser):
    """Finds the first tag that is closed by another one's end."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.wrong = ""

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID or self.wrong:
            return
        if not self.open or self.open.pop() != tag:
            self.wrong = f"</{tag}> at line {self.getpos()[0]}"


@pytest.mark.feature("tools/site")
def test_no_page_has_a_fault(built) -> None:
    assert built.faults == ()


def test_every_page_is_there_and_whole(built) -> None:
    found = pages(built)
    assert {*site.PAGES} | {"chapters/ch01.md", "changelog.md", "contributing.md", "records.md"} <= {
        name.removesuffix(".html") + ".md" for name in found
    }
    for name, text in found.items():
        parser = Balance()
        parser.feed(re.sub(r"<script\b.*?</script>", "", text, flags=re.DOTALL))
        assert parser.wrong == "", name


def test_nothing_is_asked_of_another_machine(built) -> None:
    for path in built.folder.rglob("*.css"):
        assert not re.search(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", path.read_text("utf-8")), path.name
    for name, text in pages(built).items():
        assert "fonts.g" not in text and "cdn" not in text.lower(), name


@pytest.mark.feature("tools/site")
def test_a_chapter_s_pages_have_all_its_parts(built) -> None:
    found = pages(built)
    for part, name in (
        ("gallery", "pictures"),
        ("one-over-the-other", "pictures"),
        ("lines-that-changed", "code"),
        ("time-against-error", "measured"),
        ("what-a-frame-does", "measured"),
    ):
        assert f'id="{part}"' in found[f"chapters/ch01-{name}.html"]
    text = found["chapters/ch01-pictures.html"] + found["chapters/ch01-measured.html"]
    assert text.count('<figure class="overlay"') == len(pairs.pairs_of(1))
    records = chapter.records_of(1)
    assert text.count('<figure class="plot"') == len(records) >= 2
    points = sum(len(made["points"]) for made in records.values())
    assert text.count('<g class="point ') == points
    work = next(iter(records.values()))["points"][0]["work"]
    assert f'<td>draws</td>\n<td style="text-align: right;">{work["draws"]:,}</td>' in text


@pytest.mark.feature("tools/site")
def test_the_figures_of_a_pair_are_those_of_its_record(built) -> None:
    text = pages(built)["chapters/ch01-pictures.html"]
    for pair in pairs.pairs_of(1):
        record = pairs.read()[pair.name]
        figure = next(part for part in text.split("</figure>") if f"pairs/{pair.name}.png" in part)
        assert f'data-changed="{record["error"]["pixels_changed"]}"' in figure and record["verdict"] in figure
        for file in pairs.files_of(pair):
            assert (built.folder / "pictures" / "pairs" / file.name).read_bytes() == file.read_bytes()


@pytest.mark.feature("tools/site")
def test_a_chapter_that_changes_something_has_its_difference() -> None:
    draft = Draft((1, 2))
    shown = chapter._changes(draft, 2, "chapters/ch02.md", drawing=False)
    assert "line by line](ch02-diff.html)" in shown and draft.lacks == []
    assert b"From chapter 1 to chapter 2" in draft.files["chapters/ch02-diff.html"]


def test_what_is_made_once_is_kept_until_a_file_changes(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("STRATA_CACHE", str(tmp_path))
    monkeypatch.setattr(chapter, "ROOT", tmp_path)
    made = []

    def make() -> tuple[bytes, bool]:
        made.append(1)
        return b"%d" % len(made), len(made) != 1  # the first one is not whole

    source = tmp_path / "a.py"
    source.write_bytes(b"x = 1")
    assert [chapter._kept("x", [source], make) for _ in range(3)] == [b"1", b"2", b"2"]
    source.write_bytes(b"x = 2")
    assert chapter._kept("x", [source], make) == b"3"


def test_a_chapter_that_fails_to_draw_leaves_the_rest_of_its_page(plain, monkeypatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("the device is lost")

    monkeypatch.setattr(chapter.graph, "compiled", broken)
    monkeypatch.setattr(chapter, "cache_dir", lambda name: None)
    monkeypatch.setattr(chapter, "_changes", lambda *_: "changes")
    with_graph = [n for n in chapters.available() if (chapters.folder_of(n) / chapter.graph.GRAPH).is_file()]
    if not with_graph:
        pytest.skip("no chapter has a graph")
    number = with_graph[0]
    draft = Draft((number,))
    chapter.add(draft, number)
    page = f"chapters/{chapters.folder_name(number)}"
    assert draft.lacks == [f"{page}.md: the frame graph, since the device is lost."]
    assert "What a frame does" in draft.pages[f"{page}-measured.md"]
    assert "Not here: the frame graph" in draft.pages[f"{page}-pictures.md"]


def test_a_chapter_without_records_says_which_command_makes_them(plain, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    monkeypatch.setattr(pairs, "RECORD", tmp_path / "pairs.json")
    (tmp_path / "ch01-odd.json").write_text(json.dumps({"format": 1}), "utf-8")
    draft = Draft((1,))
    chapter.add(draft, 1, drawing=False)
    said = " ".join(draft.lacks)
    assert "./strata bench 1 --record" in said and "docs/pictures.py pairs/" in said


def test_a_page_without_its_text_is_named_and_the_others_are_there(plain, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(site, "OWN", tmp_path)
    monkeypatch.setitem(TEXTS, "CHANGELOG.md", "changelog.md")
    monkeypatch.setattr(site_draft, "ROOT", tmp_path)
    monkeypatch.setattr(chapter, "add", lambda *_: None)
    draft = site.draft_of([1], drawing=False)
    assert {*site.PAGES, "changelog.md"} <= {*draft.pages}
    assert "speed.md: its text: docs/site/speed.md is missing." in draft.lacks
    assert draft.pages["changelog.md"].startswith("# Changes by chapter\n\n<p class")
    assert "every page: docs/site/site.js is missing." in draft.lacks and draft.files["assets/site.js"] == b""


def test_pictures_of_a_project_that_cannot_be_imported_are_one_sentence(monkeypatch) -> None:
    def broken() -> None:
        raise ModuleNotFoundError("No module named 'nowhere'")

    monkeypatch.setattr(site, "stale_pictures", broken)
    assert site.late_pictures() == [
        "Which pictures are out of date cannot be told, since No module named 'nowhere'."
    ]


# --- where it goes ----------------------------------------------------------------------------------------------------


def test_a_folder_with_something_else_is_left_alone(tmp_path) -> None:
    (tmp_path / "thesis.txt").write_text("mine", "utf-8")
    with pytest.raises(UserError, match="something else than a site"):
        site.check_target(tmp_path)
    with pytest.raises(UserError, match="is no folder"):
        site.check_target(tmp_path / "thesis.txt")
    (tmp_path / site.MARK).write_text("", "utf-8")
    site.check_target(tmp_path)


def test_a_second_build_takes_the_place_of_the_first(built, out) -> None:
    site.replace(out, built.folder)
    (out / "old.html").write_text("", "utf-8")
    site.replace(out, built.folder)
    assert (out / "index.html").is_file() and not (out / "old.html").exists()
    assert [path.name for path in out.parent.iterdir()] == ["site"]


def test_builds_at_once_leave_one_whole_site_and_nothing_else(built, out) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    (out.parent / f".{out.name}.new").mkdir()
    (out.parent / f".{out.name}.new" / "thesis.txt").write_text("", "utf-8")
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: site.replace(out, built.folder), range(8)))
    there = {path.relative_to(built.folder) for path in built.folder.rglob("*")}
    assert {path.relative_to(out) for path in out.rglob("*")} == there
    assert {path.name for path in out.parent.iterdir()} == {out.name, f".{out.name}.new"}
    assert (out.parent / f".{out.name}.new" / "thesis.txt").is_file(), "somebody's own"


def test_a_disk_that_refuses_leaves_the_site_of_before(built, out, monkeypatch) -> None:
    site.replace(out, built.folder)
    move = os.replace

    def refuse(source, target) -> None:
        if Path(source).name == "new":
            raise PermissionError(13, "Permission denied")
        move(source, target)

    monkeypatch.setattr(site.os, "replace", refuse)
    with pytest.raises(UserError, match="cannot be written: Permission denied"):
        site.replace(out, built.folder)
    assert (out / "index.html").is_file() and [path.name for path in out.parent.iterdir()] == [out.name]


def test_ctrl_c_between_the_renames_leaves_the_site_of_before(built, out, monkeypatch) -> None:
    site.replace(out, built.folder)
    move = os.replace

    def interrupt(source, target) -> None:
        move(source, target)
        if Path(source) == out:
            raise KeyboardInterrupt

    monkeypatch.setattr(site.os, "replace", interrupt)
    with pytest.raises(KeyboardInterrupt):
        site.replace(out, built.folder)
    assert (out / "index.html").is_file() and [path.name for path in out.parent.iterdir()] == [out.name]


def test_a_link_to_itself_is_refused(out) -> None:
    out.parent.mkdir(parents=True)
    out.symlink_to(out)
    with pytest.raises(UserError, match="leads to itself"):
        site.run(out, serve=False, check=False, port=0)
    assert out.is_symlink()


def test_behind_a_link_the_folder_is_replaced_and_the_link_stays(out, monkeypatch) -> None:
    (out.parent / "real").mkdir(parents=True)
    out.symlink_to(out.parent / "real", target_is_directory=True)
    monkeypatch.setattr(site, "draft_of", lambda *_: Draft(pages={"index.md": "# a"}))
    monkeypatch.setattr(site, "find_spec", lambda name: None)
    with pytest.raises(UserError, match="as Markdown only"):
        site.run(out, serve=False, check=False, port=0)
    assert out.is_symlink() and (out / "index.md").is_file()


def test_without_mkdocs_a_site_that_is_there_stays(built, out, monkeypatch) -> None:
    site.replace(out, built.folder)
    before = (out / "index.html").read_bytes()
    monkeypatch.setattr(site, "find_spec", lambda name: None)
    monkeypatch.setattr(site, "draft_of", lambda *_: Draft(pages={"index.md": "# a"}))
    with pytest.raises(UserError, match=r"stays as it was.*\./strata --extras docs"):
        site.build(out)
    assert (out / "index.html").read_bytes() == before and not (out / "index.md").exists()


def test_without_mkdocs_the_pages_are_left_as_markdown(out, monkeypatch) -> None:
    monkeypatch.setattr(site, "find_spec", lambda name: None)
    monkeypatch.setattr(site, "draft_of", lambda *_: Draft(pages={"index.md": "# a"}))
    with pytest.raises(UserError, match=r"Markdown only.*\./strata --extras docs"):
        site.build(out, [1])
    assert (out / "index.md").read_text("utf-8") == "# a"


def test_a_port_in_use_is_one_sentence(tmp_path) -> None:
    with site.server(tmp_path, 0) as first, pytest.raises(UserError, match="--port"):
        site.server(tmp_path, first.server_address[1])


def test_the_command_refuses_before_it_builds(strata, tmp_path) -> None:
    (tmp_path / "a.txt").write_text("", "utf-8")
    code, _, said = strata("docs", str(tmp_path))
    assert code == 2 and "something else than a site" in said and "Traceback" not in said


# --- texts ------------------------------------------------------------------------------------------------------------


def test_every_chapter_has_its_section_in_the_change_log() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    for number in chapters.available():
        assert f"## Chapter {number}: {chapters.title_of(number)}\n" in text


@pytest.mark.parametrize("colors", [LIGHT, DARK], ids=["light", "dark"])
def test_pages_of_code_have_contrast(colors) -> None:
    """WCAG 2.1, 1.4.3: at least 4.5 to 1, for every kind of text on the paper that it stands on."""
    for name in ("text", "soft", "link", "k", "s", "c", "m", "f", "p"):
        assert contrast(colors[name], colors["back"]) >= 4.5, name


def test_colours_of_plots_stand_out() -> None:
    """WCAG 2.1, 1.4.11: what is drawn has at least 3 to 1."""
    style = (ROOT / "docs" / "site" / "site.css").read_text("utf-8")
    rule = r"^(\[data-md-color-scheme=slate\] )?\.plot \.(?:preset|knob) \w+ {[^}]*?(?:fill|stroke): (#\w{6})"
    found = re.findall(rule, style, re.MULTILINE)
    assert len(found) == 4
    for dark, color in found:
        assert contrast(color, "#1e2129" if dark else "#ffffff") >= 3.0


def contrast(a: str, b: str) -> float:
    """Return the ratio of WCAG 2.1 of two colours "#rrggbb"."""
    light, dark = sorted((luminance(a), luminance(b)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(color: str) -> float:
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.long
@pytest.mark.needs("material")
def test_the_whole_site_is_built_in_time_and_lacks_no_drawing(out) -> None:
    import time

    began = time.perf_counter()
    made = site.build(out)
    assert time.perf_counter() - began < 90.0
    assert made.faults == ()
    assert [text for text in made.lacks if "strata test" not in text] == []


def test_the_notebook_s_page_has_its_cells_and_the_file(built) -> None:
    text = pages(built)["notebook.html"]
    assert (built.folder / "notebook.ipynb").read_bytes() == (
        ROOT / "examples" / "notebook.ipynb"
    ).read_bytes()
    assert 'href="notebook.ipynb"' in text and text.count("<h2") >= 5 and "compared" in text
    assert "what its cells show: nothing was to be drawn" in text  # here; else the next test's


def test_what_cells_show_is_below_them_and_their_pictures_are_files(monkeypatch) -> None:
    def ran(cells: list[notebooks.Cell]) -> None:
        first = next(cell for cell in cells if cell.kind == "code")
        picture = Picture(np.full((2, 3, 3), 9, np.uint8), "a little one")
        first.shown = ["<pre>a\n\nb\n</pre>", picture.html(), picture.html()]

    monkeypatch.setattr(notebooks, "run", ran)
    draft = Draft((1,))
    notebook.add(draft)
    (shown,) = re.findall('<div class="shown" .*', draft.pages["notebook.md"])
    assert '"><pre>a&#10;&#10;b&#10;</pre><figure' in shown and shown.endswith("</div>")
    assert re.findall('src="([^"]+)"', shown) == ["notebook/1.png", "notebook/2.png"]
    assert draft.files["notebook/2.png"].startswith(b"\x89PNG") and draft.lacks == []


def test_a_notebook_without_text_has_a_heading(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(notebook, "ROOT", tmp_path)
    (tmp_path / notebook.PATH).parent.mkdir()
    (tmp_path / notebook.PATH).write_text('{"cells": []}', "utf-8")
    draft = Draft((1,))
    notebook.add(draft)
    assert draft.pages[notebook.PAGE].startswith("# In a notebook")


@pytest.mark.parametrize(
    "text", [None, "{x", "{}", "[" * 100_000, '{"cells": [{"cell_type": "code"}]}', "[]"]
)
def test_a_notebook_that_is_none_costs_its_page_alone(tmp_path, monkeypatch, text) -> None:
    monkeypatch.setattr(notebook, "ROOT", tmp_path)
    if text is not None:
        (tmp_path / notebook.PATH).parent.mkdir()
        (tmp_path / notebook.PATH).write_text(text, "utf-8")
    draft = Draft((1,))
    notebook.add(draft)
    assert len(draft.lacks) == 1 and "the notebook, since" in draft.lacks[0]
    assert draft.pages[notebook.PAGE].startswith("# In a notebook") and not draft.files


def test_records_of_pairs_that_are_none_are_none(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(pairs, "RECORD", tmp_path / "pairs.json")
    for text in ("[]", '{"pairs": []}', "[" * 100_000, "{", '{"a": 1}'):
        pairs.RECORD.write_text(text, "utf-8")
        assert pairs.read() == {}


def test_what_a_record_says_is_text_and_no_html(tmp_path, monkeypatch) -> None:
    """Records may be other people's."""
    made = json.loads((bench.FOLDER / "ch01-software.json").read_text("utf-8"))
    for words in (made["device"], made["scene"], made["stability"]["worst"], *made["points"]):
        for name, value in words.items():
            if isinstance(value, str) and name not in ("class", "kind"):
                words[name] = f"<script>|{value}"
    made["commit"] = "<script>|"
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    monkeypatch.setattr(chapters, "available", lambda: (1,))
    (tmp_path / "ch01-software.json").write_text(json.dumps(made), "utf-8")
    draft = Draft((1,))
    monkeypatch.setattr(draft, "file", lambda path, page: path)
    for text in (
        tables.speed_table(draft, "speed.md"),
        tables.starts_table(draft, "speed.md"),
        tables.stability_table(draft, "accuracy.md"),
        chapter._plots(draft, 1, "chapters/ch01.md"),
        chapter._work(draft, 1, "chapters/ch01.md"),
    ):
        assert "&lt;script&gt;" in text and "<script" not in text
        rows = [line for line in text.splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in rows[:3]}) <= 1, "a table of as many columns in each row"


def test_a_notebook_that_fails_costs_what_it_shows(monkeypatch) -> None:
    def fails(cells: list[notebooks.Cell]) -> None:
        raise UserError("No device can draw here.")

    monkeypatch.setattr(notebooks, "run", fails)
    draft = Draft((1,))
    notebook.add(draft)
    assert draft.lacks == ["notebook.md: what its cells show, since No device can draw here."]
    assert (
        "chapters.open(1" in draft.pages["notebook.md"] and 'class="shown"' not in draft.pages["notebook.md"]
    )
