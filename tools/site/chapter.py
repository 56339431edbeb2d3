"""The pages of one chapter: its text and pictures, what it changes, its frame graph, time against error, and work."""

from __future__ import annotations

import hashlib
import posixpath
import re
from collections.abc import Callable
from functools import partial
from html import escape
from pathlib import Path

import chapters
from common.paths import ROOT, cache_dir, matched, write_whole
from tools.cli.console import Steps
from tools.diff.lesson import Comparison, compare
from tools.diff.page import page as diff_page
from tools.diff.pictures import Pictures, draw
from tools.diff.sides import tree_of
from tools.frames import graph
from tools.frames.svg import svg
from tools.run.run import Request
from tools.site.code import following
from tools.site.draft import Draft
from tools.site.figures import plot
from tools.site.glossary import linked
from tools.site.pairs import overlays
from tools.site.parts import split
from tools.site.records import lacks, records_of

GRAPH_SIZE = (640, 360)
DISCUSSED = {4: ("atrium", "aperture=2"), 5: ("cloth",)}
"""The scene and the settings of the frame that the text of a chapter is about; the atrium for others."""
KIND_OF = {
    "software": "Mesa's software driver",
    "discrete": "a graphics card",
    "integrated": "an integrated GPU",
}
PRESETS_OF_WORK = 4


def add(draft: Draft, number: int, drawing: bool = True) -> None:
    """Add the pages of a chapter, with what they show; `drawing` False leaves out what needs a device."""
    path = f"chapters/{chapters.folder_name(number)}/README.md"
    page = f"chapters/{chapters.folder_name(number)}.md"
    parts = []
    if (ROOT / path).is_file():
        text = (ROOT / path).read_text("utf-8")
        lesson = linked(draft, draft.localised(text, path, page), page)
        parts = [with_figures(draft, lesson, page), _gallery(draft, text, path, page)]
    else:
        title = _title(number)
        parts = [
            f"# Chapter {number}{title}",
            draft.lack(page, f"the text of the lesson: {path} is missing."),
        ]
    parts += [
        _section("One over the other", overlays(draft, number, page)),
        _section("Lines that changed", _changes(draft, number, page, drawing)),
        _section("The frame as a graph", _graph(draft, number, page, drawing)),
        _section("Time against error", _plots(draft, number, page)),
        _section(
            "What a frame does",
            draft.attempt(page, "the work of a frame", partial(_work, draft, number, page)),
        ),
    ]
    made = split(number, "\n\n".join(part for part in parts if part) + "\n")
    draft.pages |= made.pages
    draft.split[page] = made


def _title(number: int) -> str:
    """Return ": " and the title of a chapter; "" if it cannot be imported, which the home page says."""
    try:
        return f": {chapters.title_of(number)}"
    except Exception:
        return ""


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}" if body else ""


# --- pictures ---------------------------------------------------------------------------------------------------------


def with_figures(draft: Draft, text: str, page: str) -> str:
    """Return a page's text with its figures in it: there they follow the switch of the page's colour scheme."""

    def drawing(found: re.Match[str]) -> str:
        place = posixpath.normpath(posixpath.join(posixpath.dirname(page), found[1]))
        shape = draft.files.get(place, b"").decode().strip()
        return f'<div class="figure">{shape}</div>' if 'class="strata-figure"' in shape else found[0]

    return re.sub(r"^!\[[^\]]*\]\(([^)\s]+\.svg)\)$", drawing, text, flags=re.MULTILINE)


def _gallery(draft: Draft, text: str, path: str, page: str) -> str:
    """Return all pictures of a lesson side by side, each leading to the file; the text has said what they are."""
    found = dict.fromkeys(re.findall(r"!\[([^\]]+)\]\(([^)]+docs/pictures/[^)]+\.(?:png|jpg|webp))\)", text))
    cells = []
    for words, target in found:
        link = draft.file(posixpath.normpath(posixpath.join(posixpath.dirname(path), target)), page)
        if link:
            cells.append(f'<a href="{link}"><img src="{link}" alt="{escape(words)}" loading="lazy"></a>')
    return _section("Gallery", f'<div class="gallery">{"".join(cells)}</div>') if len(cells) > 1 else ""


# --- what changed -----------------------------------------------------------------------------------------------------


def _changes(draft: Draft, number: int, page: str, drawing: bool) -> str:
    if number - 1 not in chapters.available():
        return "This is the first chapter: everything in it is new.\n" if number == 1 else ""

    def make() -> str:
        made = compare(tree_of(str(number - 1)), tree_of(str(number)))
        place = page.replace(".md", "-diff.html")
        draft.files[place] = _diff_page(draft, made, page, drawing)
        link = posixpath.basename(place)
        rows = "".join(
            f"<tr><td>{escape(made.where(file))}</td><td>{escape(made.status(file))}</td>"
            f'<td class="number">{file.insertions}</td><td class="number">{file.deletions}</td></tr>'
            for file in made.ideas
        )
        heads = "".join(f'<th scope="col">{name}</th>' for name in ("file", "what", "lines in", "lines out"))
        return (
            f"{made.totals()} [From chapter {number - 1} to chapter {number}, line by line]({link}): arrow keys step "
            f"through it, *p* makes it large for a lecture.\n\n"
            f"<details><summary>Files in the order of reading</summary><table><thead><tr>{heads}</tr></thead>"
            f"<tbody>{rows}</tbody></table></details>\n"
        )

    return draft.attempt(page, f"the difference to chapter {number - 1}", make)


def _diff_page(draft: Draft, made: Comparison, page: str, drawing: bool) -> bytes:
    def make() -> tuple[bytes, bool]:
        with Steps(enabled=False) as steps:
            pictures = draw(made, steps) if drawing else Pictures()
        for problem in pictures.problems:
            draft.lack(page, f"pictures of passes before and after. {problem}")
        return following(diff_page(made, pictures), "../").encode(), drawing and not pictures.problems

    assert made.a.number is not None and made.b.number is not None
    tools = matched(("tools/diff/*.py", "tools/site/chapter.py", "tools/site/code.py"))
    return _kept("diff.html", [*_files(made.a.number), *_files(made.b.number), *tools], make)


def _files(number: int) -> list[Path]:
    """Return all files that the frame of a chapter may depend on."""
    folders = (chapters.folder_of(number), ROOT / "shaders", ROOT / "common", ROOT / "backends")
    return [
        path for folder in folders for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc"
    ]


def _kept(suffix: str, inputs: list[Path], make: Callable[[], tuple[bytes, bool]]) -> bytes:
    """Return what was made from the same files before, or make it; it is kept if the second of its values says so."""
    found = hashlib.sha256()
    for path in sorted(inputs):
        found.update(f"{path.relative_to(ROOT).as_posix()}\0".encode() + path.read_bytes())
    folder = cache_dir("site")
    kept = folder / f"{found.hexdigest()[:32]}-{suffix}" if folder else None
    if kept is not None and kept.is_file():
        return kept.read_bytes()
    data, whole = make()
    if whole and kept is not None:
        write_whole(kept, data)
    return data


# --- the frame graph --------------------------------------------------------------------------------------------------


def _graph(draft: Draft, number: int, page: str, drawing: bool) -> str:
    folder = chapters.folder_of(number)
    if not (folder / graph.GRAPH).is_file():
        return ""
    if not drawing:
        return draft.lack(page, "the frame graph: nothing was to be drawn.")

    def make() -> str:
        place = page.replace(".md", "-graph.svg")

        def drawn() -> tuple[bytes, bool]:
            scene, *overrides = DISCUSSED.get(number, ("atrium",))
            request = Request(number, scene=scene, size=GRAPH_SIZE, headless=True, overrides=tuple(overrides))
            compiled, device = graph.compiled(number, request)
            return svg(
                compiled, f"Chapter {number}, {', '.join((scene, *overrides))}, {device}"
            ).encode(), True

        draft.files[place] = _kept("graph.svg", [*_files(number), *matched(("tools/frames/*.py",))], drawn)
        link = posixpath.basename(place)
        return (
            f"Drawn by `./strata graph {number} --svg graph.svg`, which also prints it as text and JSON.\n\n"
            f'<div class="graph" tabindex="0" data-search-exclude>{draft.files[place].decode()}</div>\n\n'
            f"Names and sizes appear under the pointer. [The drawing is a file of its own]({link}), too.\n"
        )

    return draft.attempt(page, "the frame graph", make)


# --- measurements -----------------------------------------------------------------------------------------------------


def _plots(draft: Draft, number: int, page: str) -> str:
    figures = []
    for name, made in records_of(number).items():
        link = draft.file(f"docs/benchmarks/{name}", page)
        drawn = draft.attempt(page, f"the plot of {name}", partial(plot.figure, made, name))
        figures.append(f'<div>{drawn}<p><a href="{link}">The record with all its numbers</a></p></div>')
    unread = lacks(draft, page, number)
    if not figures:
        command = f"./strata bench {number} --record"
        return unread + draft.lack(page, f"measurements of chapter {number}: `{command}` makes them.")
    return f'<div class="plots">{"".join(figures)}</div>\n\n{unread}\n'


def _work(draft: Draft, number: int, page: str) -> str:
    """Return the counters of a frame by preset, from the first record: they do not depend on the device's speed."""
    for made in records_of(number).values():
        presets = [point for point in made["points"] if point["kind"] == "preset"][:PRESETS_OF_WORK]
        if not presets:
            continue
        names = [name for name in presets[-1]["work"] if any(point["work"].get(name) for point in presets)]
        heads = " | ".join(plot.cell(point["name"]) for point in presets)
        rows = "\n".join(
            f"| {plot.cell(name.replace('_', ' '))} | "
            + " | ".join(f"{point['work'].get(name, 0):,}" for point in presets)
            + " |"
            for name in names
        )
        scene, (width, height) = plot.cell(made["scene"]["name"]), made["size"]
        origin = plot.cell(plot.origin(made))
        return (
            f"Counted in a frame of {scene} at {width}x{height}; what is zero in every preset is left out. "
            f"{origin}\n\n| counter | {heads} |\n|---|{'---:|' * len(presets)}\n{rows}\n"
        )
    return draft.lack(page, f"the work of a frame: no record of chapter {number} has it.")
