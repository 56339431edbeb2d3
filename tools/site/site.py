"""`strata docs`: the site, built from the texts, pictures and records of the project by mkdocs-material.

Pages are put together here (`draft`, `chapter`, `tables`), mkdocs makes HTML of them, and `check`
reads what came out. What cannot be made costs its place on a page and a sentence, never the site.
"""

from __future__ import annotations

import importlib
import itertools
import json
import logging
import os
import shutil
import sys
import tempfile
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import chapters
from common.errors import UserError
from common.paths import ROOT, temporary_folder
from tools.cli.console import Steps, say
from tools.cli.stopping import prompt_stop
from tools.site import chapter, inputs, moved, notebook
from tools.site import check as site_check
from tools.site.draft import TEXTS, Draft, reason
from tools.site.figures import canvas
from tools.site.parts import relinked
from tools.site.tables import filled

DEFAULT = ROOT / "out" / "site"
MARK = ".strata-site"
"""A file in every built site: a folder that has it may be replaced."""
TRIES = 10
"""How often a build takes the place of one that another build put there in the same moment."""
OWN = ROOT / "docs" / "site"
ASSETS = ("site.css", "site.js", "iframe-worker.js")
PAGES = {
    "index.md": "Strata",
    "setup.md": "Setting up",
    "accuracy.md": "Accuracy",
    "speed.md": "Speed",
    "features.md": "Features and tests",
    "glossary.md": "Glossary",
    "maintaining.md": "For maintainers",
}
"""The pages of docs/site, with their names in the menu."""
MENU_TEXTS = {
    "CONTRIBUTING.md": "Contributing",
    "CHANGELOG.md": "Changes by chapter",
    "docs/benchmarks/README.md": "Reading the records",
    "NOTICE.md": "Packages and licences",
}


@dataclass(frozen=True)
class Built:
    """A site: its folder, what it lacks, and what is wrong with its pages, as sentences."""

    folder: Path
    lacks: tuple[str, ...]
    faults: tuple[str, ...]


def run(folder: Path | None, *, serve: bool, check: bool, port: int, drawing: bool = True) -> int:
    """Build the site, say what it lacks, and with `check` fail on that; with `serve` show it until Ctrl-C."""
    target = Path(
        os.path.realpath(folder or DEFAULT)
    )  # behind a link its folder is replaced, and the link stays
    check_target(target)
    with prompt_stop():
        built = build(target, drawing=drawing)
    for sentence in (*built.lacks, *built.faults):
        say(f"strata: {sentence}")
    stale = late_pictures() if check else []
    for sentence in stale:
        say(f"strata: {sentence}")
    say(f"Wrote {built.folder}{os.sep}index.html: {page_count(built.folder)} pages.")
    if serve:
        _serve(built.folder, port)
    return 1 if check and (built.lacks or built.faults or stale) else 0


def check_target(target: Path) -> None:
    """Raise UserError where no site may be written: a folder that holds something else is not replaced."""
    if target.is_symlink():
        raise UserError(f"{target} is a link that leads to itself: name a folder for the site.")
    if target.exists() and not target.is_dir():
        raise UserError(f"{target} is no folder: name one for the site.")
    if target.is_dir() and any(target.iterdir()) and not (target / MARK).is_file():
        raise UserError(f"{target} holds something else than a site: name an empty folder, or a new one.")
    above = next(one for one in target.parents if one.exists())
    if not os.access(above, os.W_OK):
        raise UserError(f"{target} cannot be written: {above} is read-only.")


def page_count(folder: Path) -> int:
    """Return how many pages of HTML are in a folder."""
    return sum(1 for _ in folder.rglob("*.html"))


def draft_of(numbers: Collection[int], drawing: bool = True, steps: Steps | None = None) -> Draft:
    """Return all pages and files of the site, with those chapters; `drawing` False opens no device."""
    draft = Draft(tuple(numbers))
    for page, title in PAGES.items():
        draft.add_text(f"docs/site/{page}", page, title)
        draft.pages[page] = filled(draft, draft.pages[page], page)
    for path, title in MENU_TEXTS.items():
        draft.add_text(path, TEXTS[path], title)
    for place, number in enumerate(numbers):
        if steps is not None:
            steps(f"chapter {number}", 0.1 + 0.6 * place / len(numbers))
        chapter.add(draft, number, drawing)
    notebook.add(draft, drawing)
    draft.pages = relinked(draft.pages, draft.split)
    moved.add(draft)
    for name in ASSETS:
        if (OWN / name).is_file():
            draft.files[f"assets/{name}"] = (OWN / name).read_bytes()
        else:
            draft.lack("every page", f"docs/site/{name} is missing.")
            draft.files[f"assets/{name}"] = b""
    draft.files["assets/site.css"] += canvas.SCHEMES.encode()
    return draft


def build(target: Path, numbers: Collection[int] | None = None, drawing: bool = True) -> Built:
    """Write the site to a folder, whole or not at all; raise UserError without mkdocs-material.

    Then the pages are there as Markdown, in the same folder; but a site of HTML that is there stays.
    """
    found = find_spec("material") is not None and find_spec("mkdocs") is not None
    if not found and (target / "index.html").is_file():
        raise UserError(
            f"The site in {target} stays as it was, since mkdocs-material is not installed: ./strata --extras docs "
            "brings it. Into another folder the pages can be written as Markdown."
        )
    with Steps() as steps, temporary_folder() as scratch:
        steps("tables", 0.0)
        draft = draft_of(chapters.available() if numbers is None else numbers, drawing, steps)
        source, made = scratch / "source", scratch / "site"
        write_draft(draft, source)
        if found:
            steps("mkdocs", 0.7)
            render(draft, source, made)
            faults = site_check.faults(made)
        else:
            shutil.copytree(source, made)
        (made / MARK).write_text("Made by ./strata docs; it may be deleted.\n", "utf-8")
        replace(target, made)
    if not found:
        raise UserError(
            f"The pages are in {target} as Markdown only, since mkdocs-material is not installed: "
            "./strata --extras docs brings it."
        )
    return Built(target, tuple(draft.lacks), tuple(faults))


def write_draft(draft: Draft, folder: Path) -> None:
    """Write pages and files as mkdocs reads them."""
    contents = {**draft.files, **{path: text.encode() for path, text in draft.pages.items()}}
    for path, data in contents.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(data)


def render(draft: Draft, source: Path, made: Path) -> None:
    """Let mkdocs make HTML of a folder of Markdown."""
    file = source.parent / "mkdocs.yml"
    file.write_text(json.dumps(configuration(draft, source, made)), "utf-8")  # JSON is YAML
    for name in ("mkdocs", "MARKDOWN"):
        logging.getLogger(name).setLevel(logging.ERROR)  # links are examined in what comes out
    os.environ["NO_MKDOCS_2_WARNING"] = "true"
    config, building = (importlib.import_module(f"mkdocs.{name}") for name in ("config", "commands.build"))
    building.build(config.load_config(str(file)))
    for name in ("404.html", "sitemap.xml", "sitemap.xml.gz"):  # for a site that knows its own address
        (made / name).unlink(missing_ok=True)


def configuration(draft: Draft, source: Path, made: Path) -> dict[str, object]:
    """Return mkdocs' settings: nothing comes from another machine, and pages can be opened without a server."""
    lessons = []
    for page, split in sorted(draft.split.items()):
        title = draft.pages[page].lstrip().partition("\n")[0].lstrip("# ")
        # A page's title is its name here: those that every chapter has say of which they are.
        heads = {part: draft.pages[part].lstrip("# ").partition(" {")[0] for part in split.titles}
        overview = {f"{title.partition(':')[0]}: overview": page}
        lessons.append({title: [overview, *({head: part} for part, head in heads.items())]})
    front = [{PAGES[page]: page} for page in ("index.md", "setup.md")]
    measured = [{PAGES[page]: page} for page in ("accuracy.md", "speed.md", "features.md")]
    texts = [{title: TEXTS[path]} for path, title in MENU_TEXTS.items()]
    schemes = [
        {
            "media": f"(prefers-color-scheme: {media})",
            "scheme": scheme,
            "primary": "indigo",
            "toggle": {"icon": icon, "name": f"Switch to {other}"},
        }
        for media, scheme, icon, other in (
            ("light", "default", "material/weather-night", "dark"),
            ("dark", "slate", "material/weather-sunny", "light"),
        )
    ]
    return {
        "site_name": "Strata",
        "site_description": "How a modern real-time renderer is built, in fifteen chapters that run.",
        "docs_dir": str(source),
        "site_dir": str(made),
        "use_directory_urls": False,
        "theme": {
            "name": "material",
            "font": False,
            "palette": schemes,
            "features": ["navigation.indexes", "navigation.top", "navigation.footer", "content.code.copy"],
        },
        "extra": {"generator": False, "polyfills": ["assets/iframe-worker.js"]},
        "extra_css": ["assets/site.css"],
        "extra_javascript": ["assets/site.js"],
        "plugins": ["search", "offline"],  # the search of pages that are opened without a server
        "markdown_extensions": [
            "attr_list",
            "md_in_html",
            "tables",
            {"toc": {"permalink": True, "toc_depth": 3}},
            {"pymdownx.highlight": {"anchor_linenums": False}},
            "pymdownx.superfences",
        ],
        "nav": [
            *front,
            {"Chapters": lessons},
            {notebook.TITLE: notebook.PAGE},
            {PAGES["glossary.md"]: "glossary.md"},
            {"The project": [*measured, {PAGES["maintaining.md"]: "maintaining.md"}, *texts]},
        ],
    }


def replace(target: Path, made: Path) -> None:
    """Put a built folder in the place of the one before; raise UserError where the disk refuses.

    Whoever looks sees one of the two, but for the moment between two renames; of builds at once the last one stays.
    """
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as beside:
            new = Path(beside, "new")
            shutil.copytree(made, new)
            for place in itertools.count():
                old = Path(beside, f"old{place}")
                try:
                    with suppress(FileNotFoundError):
                        os.replace(target, old)
                    os.replace(new, target)
                    return
                except BaseException as error:  # Ctrl-C, too
                    if old.exists() and not target.exists():
                        os.replace(old, target)
                        raise
                    if place == TRIES or not isinstance(error, OSError):
                        raise
    except OSError as error:
        raise UserError(f"{target} cannot be written: {error.strerror or error}.") from None


# --- showing it -------------------------------------------------------------------------------------------------------


class _Quiet(SimpleHTTPRequestHandler):
    """Gives out files without a line for each."""

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing."""


def server(folder: Path, port: int) -> ThreadingHTTPServer:
    """Return a server on the loopback address that has not begun; port 0 takes a free one. Raises UserError."""
    try:
        return ThreadingHTTPServer(("127.0.0.1", port), partial(_Quiet, directory=str(folder)))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(
            f"--port {port} cannot be used ({reason}): name another, or 0 for a free one."
        ) from None


def _serve(folder: Path, port: int) -> None:
    """Show a folder until Ctrl-C."""
    with server(folder, port) as serving:
        say(f"The site is at http://127.0.0.1:{serving.server_address[1]}/; Ctrl-C ends it.")
        serving.serve_forever(poll_interval=0.1)


# --- pictures that are out of date ------------------------------------------------------------------------------------


def late_pictures() -> list[str]:
    """Return a sentence for each picture that is out of date; a chapter that cannot be imported costs one for all."""
    try:
        stale = stale_pictures()
    except Exception as error:
        return [f"Which pictures are out of date cannot be told, since {reason(error)}."]
    return [f"{path} {why}: python docs/pictures.py --stale makes it anew." for path, why in stale.items()]


def stale_pictures() -> dict[str, str]:
    """Return the pictures of the repository that are out of date, each with why."""
    return inputs.stale(pictures_program().wanted(), inputs.read())


def pictures_program() -> Any:
    """Return docs/pictures.py as a module."""
    name = "strata_docs_pictures"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "pictures.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # its dataclasses look themselves up there
        spec.loader.exec_module(module)
    return sys.modules[name]
