"""`strata assets`: models of others fetched under their licence, the reader's own examined and given a name."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.markup import escape

import assets
from common.errors import SceneError, UserError
from common.models import store
from common.models.manifest import LICENCES, MANIFEST, SOURCES, Model, find, is_name, read_manifest
from common.models.store import in_bytes
from common.names import suggest
from common.reports.tables import table
from tools.assets.fetch import fetch, unfinished
from tools.cli.console import Steps, err, out, quoted, say
from tools.cli.stopping import prompt_stop

if TYPE_CHECKING:
    from common.gltf.extensions import ExtensionUse
    from tools.assets.check import Examination

NARROW = 72
"""Columns of a terminal below which the list leaves out what a model is."""


def show() -> int:
    """Print the models that can be fetched, with their licences and which are here, and the reader's own."""
    columns = ("name", ">size", "here", "licence", "what it is")
    fitting = columns if out.width >= NARROW else columns[:-1]
    made = table("Models of others: ./strata assets get NAME", *fitting)
    for model in read_manifest().values():
        kept = unfinished(model)
        here = "yes" if store.is_here(model) else f"{in_bytes(kept)} of it" if kept else ""
        row = (model.name, in_bytes(model.size), here, model.licence, escape(model.title))
        made.add_row(*row[: len(fitting)])
    for column in made.columns[:4]:
        column.no_wrap = True  # a name in two halves cannot be copied
    out.print(made)
    own = store.own_models()
    if own:
        mine = table("Your own: ./strata assets add PATH", "name", "file")
        for name, path in own.items():
            mine.add_row(name, escape(str(path)) + ("" if path.is_file() else " (gone)"))
        out.print(mine)
    out.print(
        f"Kept in {store.place()}; ./strata run 1 --scene NAME draws one.", soft_wrap=True, markup=False
    )
    return 0


def get(
    names: Sequence[str],
    yes: bool = False,
    manifest: Path = MANIFEST,
    sources: Mapping[str, str] = SOURCES,
    pause_s: float = 1.0,
) -> int:
    """Fetch models after showing what they are and under which licence, and asking unless `yes`.

    What is here already is not asked about, and nothing of it is fetched. The path of each model is printed. Returns
    1 if the reader declined. Raises UserError as `fetch.fetch` does, for an unknown name, and where nobody can
    be asked.
    """
    models = read_manifest(manifest, sources)
    for model in [_known(name, models) for name in names]:
        folder = store.folder_of(model)
        if all(store.is_whole(folder / file.name, file) for file in model.files):
            say(f"{model.name} is here already.")
            if not (folder / store.NOTICE).is_file():
                store.write_notice(model)
        elif not _agreed(model, yes):
            say("Nothing was fetched.")
            return 1
        else:
            _fetch(model, sources, pause_s)
        out.print(str(folder / model.main), markup=False, soft_wrap=True)
    return 0


def _known(name: str, models: Mapping[str, Model]) -> Model:
    model = find(name, models)
    if model is None:
        raise UserError(f"There is no model {name!r} to fetch{suggest(name, models, 4)}")
    return model


def _agreed(model: Model, yes: bool) -> bool:
    """Show what would be fetched, and return whether to."""
    address, asks = LICENCES[model.licence]
    count = f"{len(model.files)} files, " if len(model.files) > 1 else ""
    kept = unfinished(model)
    say(f"{model.name}: {model.title} ({count}{in_bytes(model.size)})")
    say(f"  by       {model.author}, {model.year}")
    say(f"  licence  {model.licence}: {asks}")
    say(f"           {address}")
    say(f"  from     {model.repository} at {model.commit[:12]}, {model.folder}")
    say(f"  to       {store.folder_of(model)}{f' ({in_bytes(kept)} of it are here)' if kept else ''}")
    if yes:
        return True
    if not (sys.stdin is not None and sys.stdin.isatty() and err.is_terminal):
        raise UserError(
            f"There is no terminal to ask at: ./strata assets get {model.name} --yes agrees to {model.licence}."
        )
    err.print("Fetch it under this licence? [y/N] ", end="", markup=False)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _fetch(model: Model, sources: Mapping[str, str], pause_s: float) -> None:
    def kept() -> str:
        return f"{in_bytes(unfinished(model))} are kept, and the same command goes on from there."

    try:
        # A read that waits for the server is not always ended by Ctrl-C: never on Windows, and elsewhere not if the
        # signal comes just before it.
        with prompt_stop(kept), Steps() as steps:
            steps("fetching", 0.0)
            advance: Any = steps.of("fetching", 0.0, 1.0)
            came = fetch(model, advance, sources, pause_s)
    except KeyboardInterrupt:
        say(kept())
        raise
    store.write_notice(model)
    say(f"Fetched {in_bytes(came)}; ./strata run 1 --scene {model.name} draws it.")


def add(path: Path, name: str | None = None) -> int:
    """Examine a model, print what was found, and let `name` mean it; return 2 if it cannot be drawn.

    Without a name it is that of the file. Raises UserError: there is no such file, or the name is taken or none.
    """
    from chapters import scenes  # with the loaders, which fetching needs not
    from tools.assets.check import examine

    file = scenes.find(str(path))
    chosen = _name_for(file, name)
    with Steps() as steps:
        advance: Any = steps.of("loading", 0.0, 1.0)
        found = examine(file, advance)
    report(found)
    if found.refusal:
        say(f"strata: {found.refusal}")
        return SceneError.exit_code
    before = store.keep_own(chosen, file)
    if before is not None:
        say(f"{chosen} was {before} before.")
    say(f"{chosen} means this file from now on: ./strata run 1 --scene {chosen}")
    return 0


def _name_for(file: Path, name: str | None) -> str:
    """Return the name under which a file is kept; raises UserError if it is none, or another scene's."""
    chosen = (
        name if name is not None else "".join(c if c.isascii() and c.isalnum() else "-" for c in file.stem)
    )
    advice = f"./strata assets add {quoted(str(file))} --name NAME gives it another"
    if not is_name(chosen):
        raise UserError(
            f"{chosen!r} is no name for a model, which begins with a letter and has letters, digits, - and _: {advice}."
        )
    if chosen.lower() in assets.SCENES:
        raise UserError(f"{chosen} is a scene of Strata's own: {advice}.")
    if find(chosen, read_manifest()) is not None:
        raise UserError(f"{chosen} is a model that `strata assets get` fetches: {advice}.")
    return chosen


def report(found: Examination) -> None:
    """Print what an examination found."""
    from tools.assets.check import NOTHING_DRAWN

    if found.contents:
        made = table(found.path.name, "what", "how much")
        for row in found.contents:
            made.add_row(row[0], escape(row[1]))
        out.print(made)
    if found.extensions:
        made = table("Extensions that it uses", "name", "by", "what Strata draws")
        for use in found.extensions:
            made.add_row(*(escape(text) for text in (use.name, _users(use), _drawn(use))))
        out.print(made)
    whole = not found.losses and all(use.supported for use in found.extensions)
    if found.contents and whole and NOTHING_DRAWN not in found.hints:
        out.print("All of it is drawn as the file has it.")
    for title, sentences in (("Left out, or made up", found.losses), ("Good to know", found.hints)):
        if sentences:
            out.print(f"{title}:")
            for sentence in sentences:
                out.print(f"- {sentence}", markup=False, soft_wrap=True)


def _users(use: ExtensionUse) -> str:
    if not use.uses:
        return "" if use.supported else "nothing in it"
    return ", ".join(f"{count} of {part}" for part, count in use.uses.items())


def _drawn(use: ExtensionUse) -> str:
    if use.supported:
        return "all of it"
    return f"nothing, since it is required: {use.advice}" if use.required else use.instead


def remove(name: str) -> int:
    """Forget the name of one of the reader's own models, or delete a fetched one."""
    say(store.remove(name))
    return 0
