"""The page of `strata diff`: one file with everything in it, to be read on a phone or stepped through in a lecture."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from html import escape
from itertools import groupby

from pygments.lexer import Lexer
from pygments.lexers.graphics import GLShaderLexer
from pygments.lexers.python import PythonLexer
from pygments.lexers.special import TextLexer
from pygments.token import Comment, Keyword, Name, Number, String, _TokenType

from common.errors import UserError
from common.names import visible
from tools.diff.diff import FileDifference, Hunk, Line
from tools.diff.files import Source, sources
from tools.diff.lecture import Stop, lecture, themes
from tools.diff.lesson import Comparison, count, pass_of
from tools.diff.pictures import SIZE, Pictures
from tools.diff.style import LECTURE, SCRIPT, STYLE
from tools.diff.terminal import MINOR, SIGNS, heading

WIDEST = 110
"""Columns that large type makes room for; longer lines are wrapped."""

KINDS: tuple[tuple[_TokenType, str], ...] = (
    (Comment.Preproc, "p"),
    (Comment, "c"),
    (Keyword, "k"),
    (String, "s"),
    (Number, "m"),
    (Name.Function, "f"),
    (Name.Class, "f"),
    (Name.Decorator, "p"),
    (Name.Builtin, "k"),
)
"""Which token of pygments gets which colour of the page; what is not here has that of text."""


def page(made: Comparison, pictures: Pictures, stops: Sequence[Stop] = ()) -> str:
    """Return the whole page as HTML. With the stops of a lecture it begins with these, and a key shows the rest."""
    anchors = {file.path: f"file-{n}" for n, file in enumerate((*made.ideas, *made.plumbing), start=1)}
    homes = _homes((*made.ideas, *made.plumbing))
    ideas = [_file(made, file, anchors[file.path], pictures, homes) for file in made.ideas]
    folded = []
    for why, files in made.folded():
        inside = "".join(_file(made, file, anchors[file.path], pictures, homes) for file in files)
        numbers = _counts(sum(f.insertions for f in files), sum(f.deletions for f in files))
        summary = f"Folded, {escape(why)}: {len(files)} {'file' if len(files) == 1 else 'files'}, {numbers}"
        folded.append(f"<details><summary>{summary}</summary>{inside}</details>")
    title = escape(visible(made.title))
    problems = "".join(f'<p class="note">{escape(visible(text))}</p>' for text in pictures.problems)
    # Nothing from anywhere else, and no script but ours: a source that is shown could not run.
    csp = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; {allowed(SCRIPT)}"
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{csp}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{title}</title><style>{STYLE}{LECTURE + themes() if stops else ''}</style></head>"
            f'<body class="{"lecture" if stops else ""}">',
            '<a class="skip" href="#main">To the difference</a>',
            _bar(bool(stops)) if made.tree.changed or stops else "",
            _lecture(made, stops) if stops else "",
            f'<header class="top"><h1>{title}</h1><p>{escape(made.nothing or made.totals())}</p>{problems}',
            _contents(made, anchors) if made.tree.changed else "",
            '</header><main id="main">',
            *ideas,
            *folded,
            "</main>",
            f"<script>{SCRIPT}</script>" if made.tree.changed or stops else "",
            "</body></html>\n",
        ]
    )


def allowed(*scripts: str) -> str:
    """Return what a page's policy says of the scripts in it, and thus of none that a source brings."""
    digests = (base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts)
    return "script-src" + "".join(f" 'sha256-{digest}'" for digest in digests)


def _lecture(made: Comparison, stops: Sequence[Stop]) -> str:
    files = sources(made.b.folder)
    changed = {
        file.new.path: file for file in made.tree.changed if file.new is not None and file.old is not None
    }

    def read(path: str) -> Source:
        if path not in files:
            raise UserError(f"The lecture names {path}, which {made.b.name} does not have.")
        return files[path]

    def added(path: str) -> frozenset[int]:
        file = changed.get(path)
        lines = [line for hunk in file.hunks for line in hunk.lines] if file else []
        return frozenset(line.new for line in lines if line.mark == "+" and line.new is not None)

    return lecture(stops, read, highlighted, added)


def _bar(lecture: bool) -> str:
    of_lecture = (
        '<button id="full" aria-pressed="false">Full difference<span class="key"> (f)</span></button>'
        '<button id="notes" aria-pressed="false">Notes<span class="key"> (n)</span></button>'
    )
    return (
        '<div class="bar" role="group" aria-label="Stepping through">'
        '<button id="present" aria-pressed="false">Large type<span class="key"> (p)</span></button>'
        '<button id="back" aria-label="Step back">&#8592;</button>'
        '<button id="on" aria-label="Step on">&#8594;</button>'
        '<button id="theme">Light or dark<span class="key"> (d)</span></button>'
        f"{of_lecture if lecture else ''}"
        '<span class="place" id="place" role="status">Arrow keys step, Esc ends.</span></div>'
    )


def _contents(made: Comparison, anchors: dict[str, str]) -> str:
    rows = [
        f'<tr><td><a href="#{anchors[file.path]}">{escape(visible(made.where(file)))}</a></td>'
        f'<td class="what">{escape(made.status(file))}</td>'
        f'<td class="counts">{_counts(file.insertions, file.deletions)}</td></tr>'
        for file in (*made.ideas, *made.plumbing)
    ]
    head = (
        '<tr><th scope="col">file</th><th scope="col">what</th><th scope="col" class="counts">lines</th></tr>'
    )
    return f'<nav aria-label="Files"><table><thead>{head}</thead><tbody>{"".join(rows)}</tbody></table></nav>'


def _counts(insertions: int, deletions: int) -> str:
    plus, minus = count(insertions, deletions).split()
    return f'<span class="plus">{plus}</span> <span class="minus">{minus}</span>'


def _file(
    made: Comparison, file: FileDifference, anchor: str, pictures: Pictures, homes: dict[str, str]
) -> str:
    where = escape(visible(made.where(file)))
    functions = "".join(
        f"<li>{SIGNS[one.status]} {one.kind} <code>{escape(one.name)}</code> {_counts(one.insertions, one.deletions)}"
        f"{'' if one.status == 'changed' else f' {one.status}'}</li>"
        for one in file.functions
        if file.status not in ("new", "removed") or one.kind not in MINOR
    )
    lines = {side: highlighted(source) for side, source in (("old", file.old), ("new", file.new)) if source}
    imports = () if file.imports_only else tuple(hunk for hunk in file.hunks if hunk.imports_only)
    told = [hunk for hunk in file.hunks if hunk not in imports]
    hunks = [
        _hunk(made, file, hunk, lines, f"part {n} of {len(told)}") for n, hunk in enumerate(told, start=1)
    ]
    if imports:
        inside = "".join(_hunk(made, file, hunk, lines, "imports") for hunk in imports)
        hunks.append(f"<details><summary>Folded: imports</summary>{inside}</details>")
    return "\n".join(
        [
            f'<section id="{anchor}" aria-labelledby="{anchor}-name"><h2 id="{anchor}-name">{where}'
            f' <span class="soft">{escape(made.status(file))}</span> <span class="counts">'
            f"{_counts(file.insertions, file.deletions)}</span></h2>",
            f'<p class="sentence">{escape(visible(file.sentence))}</p>' if file.sentence else "",
            *(f'<p class="note">{escape(visible(note))}</p>' for note in made.notes(file)),
            f'<ul class="functions">{functions}</ul>' if functions else "",
            _before_after(made, file, pictures, homes),
            *hunks,
            "</section>",
        ]
    )


def _homes(files: Sequence[FileDifference]) -> dict[str, str]:
    """Return beside which file the pictures of each pass stand: its first one, those of OpenGL last."""
    found: dict[str, str] = {}
    for file in sorted(files, key=lambda file: file.path.startswith("gl/")):
        found.setdefault(pass_of(file), file.path)
    return found


def _before_after(made: Comparison, file: FileDifference, pictures: Pictures, homes: dict[str, str]) -> str:
    """Return the pictures of a file's pass, if that is the file beside which they stand."""
    name = pass_of(file)
    if homes.get(name) != file.path or name not in pictures.passes:
        return ""
    before, after = pictures.passes[name]
    figures = []
    for data, side in ((before, made.a), (after, made.b)):
        if data is None:
            words = f"No picture of it by {escape(visible(side.name))}."
            figures.append(f"<figure><figcaption>{words}</figcaption></figure>")
            continue
        image = base64.b64encode(data).decode()
        figures.append(
            f'<figure><img src="data:image/png;base64,{image}" width="{SIZE[0]}" height="{SIZE[1]}"'
            f' alt="What the pass {escape(name)} of {escape(visible(side.name))} writes">'
            f"<figcaption>{escape(visible(side.name))}</figcaption></figure>"
        )
    same = "; both are the same to the bit" if before is not None and before == after else ""
    label = f"The pass {name}, before and after{same}"
    return (
        f'<div class="step" tabindex="0" role="group" aria-label="{escape(label)}"><p class="where">{escape(label)}</p>'
        f'<div class="pictures">{"".join(figures)}</div></div>'
    )


def _hunk(made: Comparison, file: FileDifference, hunk: Hunk, lines: dict[str, list[str]], label: str) -> str:
    beside = made.versions and file.old is not None and file.new is not None
    widest = min(max(len(line.text.expandtabs(4)) for line in hunk.lines), WIDEST) + 8
    label = f"{made.where(file)}, {label}" + (f", in {hunk.within}" if hunk.within else "")
    body = _beside(hunk, lines) if beside else "".join(_line(line, lines) for line in hunk.lines)
    columns = f"--side:{widest};--columns:{2 * widest if beside else widest}"
    return (
        f'<div class="step" tabindex="0" role="group" aria-label="{escape(visible(label))}" style="{columns}">'
        f'<p class="where">{escape(visible(heading(hunk).removeprefix("@@ ")))}</p>'
        f'<div class="code">{body}</div></div>'
    )


def _beside(hunk: Hunk, lines: dict[str, list[str]]) -> str:
    """Return two columns: runs of unchanged rows, and runs of changed ones, each as one row of the grid."""
    found = []
    for same, rows in groupby(hunk.rows(), key=lambda row: row[0] is row[1]):
        pairs = [*rows]
        left = "".join(_line(row[0], lines, "old") for row in pairs if row[0] is not None)
        right = "".join(_line(row[1], lines, "new") for row in pairs if row[1] is not None)
        kind = "pair both" if same else "pair"
        found.append(f'<div class="{kind}"><div>{left}</div><div>{right}</div></div>')
    return "".join(found)


def _line(line: Line, lines: dict[str, list[str]], side: str = "") -> str:
    side = side or ("old" if line.mark == "-" else "new")
    number = line.old if side == "old" else line.new
    assert number is not None
    kind = {"+": "l add", "-": "l del", " ": "l"}[line.mark]
    return (
        f'<div class="{kind}"><span>{number}</span><span class="mark">{line.mark}</span>'
        f"<code>{lines[side][number - 1]}</code></div>"
    )


def highlighted(source: Source) -> list[str]:
    """Return the lines of a file as HTML, with the syntax's colours; every character of it is escaped."""
    return _highlighted(source.suffix, source.is_code, "\n".join(source.lines))


@cache  # a site shows the same text as a file, as the new side of a difference and as the old one of the next
def _highlighted(suffix: str, is_code: bool, whole: str) -> list[str]:
    made = [""]
    for kind, text in lexer_of(suffix, is_code).get_tokens(whole):
        name = _kind(kind)
        for place, part in enumerate(text.split("\n")):
            if place:
                made.append("")
            if part:
                shown = escape(visible(part, keep="\t"))
                made[-1] += f'<span class="{name}">{shown}</span>' if name and part.strip() else shown
    return made


@cache
def lexer_of(suffix: str, is_code: bool) -> Lexer:
    """Return what splits a file into tokens, and leaves out none of its characters."""
    kind = PythonLexer if suffix == ".py" else GLShaderLexer if is_code else TextLexer
    return kind(stripnl=False, ensurenl=False)


@cache
def _kind(token: _TokenType) -> str:
    return next((name for kind, name in KINDS if token in kind), "")
