"""Pages of the site that show a file of the repository with the colours of its syntax, or list a folder."""

from __future__ import annotations

from html import escape
from pathlib import Path

from common.names import visible
from common.paths import ROOT
from tools.diff.files import Source
from tools.diff.page import allowed, highlighted
from tools.diff.style import SCRIPT, STYLE

LARGEST = 400_000
"""Bytes of a file that is shown."""
HIDDEN = {"__pycache__", "out"}

_OWN_STYLE = """
.code .l { grid-template-columns: 5ch 1fr; } .l:target { background: var(--add); }
.l a { color: var(--soft); text-decoration: none; text-align: right; padding-right: 1ch; user-select: none; }
"""

_FOLLOWS = """try {
  const root = new URL(document.currentScript.dataset.root, location).pathname;
  const chosen = JSON.parse(localStorage.getItem(root + ".__palette"));
  if (chosen) document.documentElement.dataset.theme = chosen.color.scheme === "slate" ? "dark" : "light";
} catch { /* without a memory of what was chosen the system's colours stay */ }"""


def following(html: str, root: str) -> str:
    """Return a page that is light or dark as the reader chose on the pages of mkdocs; `root` leads to their folder.

    The policy of a page that has one, as a difference, allows the script that does it.
    """
    head, end, body = html.partition("</head>")
    head = head.replace(allowed(SCRIPT), allowed(SCRIPT, _FOLLOWS))
    return f'{head}<script data-root="{root}">{_FOLLOWS}</script>{end}{body}'


def is_shown(path: Path) -> bool:
    """Whether a file or folder is listed: no caches, nothing hidden."""
    return path.name not in HIDDEN and not path.name.startswith(".") and path.suffix != ".pyc"


def page(path: str, data: bytes) -> str:
    """Return the page of a file; of one that is no text, or very long, a sentence."""
    source = Source(path, data)
    if source.text is None or len(data) > LARGEST:
        body = f"<p>{len(data):,} bytes that are no text to be read.</p>"
    else:
        lines = "".join(
            f'<div class="l" id="L{number}"><a href="#L{number}">{number}</a><code>{line}</code></div>'
            for number, line in enumerate(highlighted(source), start=1)
        )
        body = f'<div class="code">{lines}</div>'
    return _whole(path, f"<p>{escape(visible(source.sentence))}</p>{body}")


def folder_page(path: str, links: dict[str, str]) -> str:
    """Return the page of a folder; `links` has where each name in it leads, "" where nowhere."""
    rows = "".join(
        f"<tr><td>{_name(name, to)}</td><td>{escape(_sentence(ROOT / path / name))}</td></tr>"
        for name, to in links.items()
    )
    head = '<tr><th scope="col">file</th><th scope="col">what it is</th></tr>'
    return _whole(
        path, f'<nav aria-label="Files"><table><thead>{head}</thead><tbody>{rows}</tbody></table></nav>'
    )


def _name(name: str, to: str) -> str:
    return f'<a href="{escape(_shown(to))}">{escape(name)}</a>' if to else escape(name)


def _sentence(path: Path) -> str:
    """Return what a file says it is; "" for a folder, and for what is no text."""
    return Source(path.name, path.read_bytes()).sentence if path.is_file() else ""


def _shown(link: str) -> str:
    """Return a link as it is in HTML; mkdocs turns only those of its own pages."""
    return link.removesuffix(".md") + ".html" if link.endswith(".md") else link


def _whole(path: str, body: str) -> str:
    home = "../" * path.count("/") + ("../" if not (ROOT / path).is_dir() else "../../")
    return following(
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><title>{escape(path)}</title>'
        f"<style>{STYLE}{_OWN_STYLE}</style></head><body><main>"
        f'<p><a href="{home}index.html">Strata</a></p><h1>{escape(path)}</h1>{body}</main></body></html>\n',
        home,
    )
