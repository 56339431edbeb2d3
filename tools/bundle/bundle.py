"""`strata bundle FILE`: pack the clone, packages, site and models into one file for machines without a network.

What the file looks like, and how it is read, is in `bootstrap.bundle`. The clone is packed twice over: its files as
they are, so that the receiver needs no git, and the history of their commit as git packs it, so that the receiver who
has git gets a repository (`strata carry` and `new` need one).
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import sys
import tarfile
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from bootstrap.bundle import (
    CHUNK_BYTES,
    CLONE,
    FORMAT,
    HISTORY,
    MAIN,
    MANIFEST,
    MODELS,
    SITE,
    SYSTEMS,
    WHEELS,
    Entry,
    Target,
    inside,
    this_system,
)
from bootstrap.packages import LOCK, canonical, locked, names_in
from common.errors import UserError
from common.names import suggest
from common.paths import ROOT, WholeFile, temporary_folder
from tools.bundle import wheels
from tools.bundle.models import model_of
from tools.cli.console import Steps, out, quoted, say, shown
from tools.cli.stopping import prompt_stop
from tools.site import site
from tools.snapshots.history import History, git

MOMENT = (1980, 1, 1, 0, 0, 0)
"""The time of every file in the archive, the first that zip knows: equal contents make equal bundles."""
PACKED = (".whl", ".bundle", ".png", ".jpg", ".jpeg", ".glb", ".gz")
"""Endings of files that would not get smaller."""

ENTRY = '''\
"""This archive is a bundle of Strata: `python3 FILE FOLDER` unpacks the clone that is in it."""

import os
import sys

if sys.version_info < (3, 11):
    sys.exit("strata: Strata needs Python 3.11 or newer, and this is %d.%d." % sys.version_info[:2])
file = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(file, "clone"))
from pathlib import Path

from bootstrap.offline import main

sys.exit(main(Path(file), sys.argv[1:]))
'''


@dataclass(frozen=True)
class Part:
    """A file to be packed: its name in the bundle, its bytes or where they lie, and whether it is a program."""

    name: str
    source: bytes | Path
    program: bool = False


def run(
    file: Path,
    systems: Sequence[str] = (),
    pythons: Sequence[str] = (),
    everything: bool = False,
    with_site: bool = False,
    models: Sequence[str] = (),
    root: Path = ROOT,
) -> int:
    """Write a bundle and say what is in it and what is not; raise UserError where one cannot be made."""
    file = file.absolute()
    check_file(file)
    wanted = pairs(systems, pythons)
    history = History(root)
    parts = [*model_parts(models, root)]
    if with_site:
        site.run(None, serve=False, check=False, port=0)
    with prompt_stop(), Steps() as steps, temporary_folder() as scratch:
        steps("the clone", 0.0)
        parts += clone_parts(root, history, scratch)
        parts += site_parts(root)
        targets = []
        for place, (system, python) in enumerate(wanted):
            steps(f"packages for {system} with Python {python}", 0.1 + 0.8 * place / len(wanted))
            folder = scratch / f"{system}-{python}"
            folder.mkdir()
            lock = git("show", f"{history.head}:./{LOCK}", folder=root).decode()
            found = wheels.fetch(system, python, lock, everything, folder)
            refuse_without_core(system, python, lock, found.lacks)
            names = tuple(wheel.name for wheel in found.wheels)
            targets.append(Target(system, python, "all" if everything else "core", names, found.lacks))
            parts += [Part(WHEELS + wheel.name, wheel) for wheel in found.wheels]
        steps("writing", 0.9)
        digest = write(file, history.head, targets, parts)
    for target in targets:
        if target.lacks:
            say(
                f"strata: For {target} there are no wheels of {', '.join(target.lacks)}: they are not packed."
            )
    report(file, digest, history, targets, parts)
    return 0


def check_file(file: Path) -> None:
    """Raise UserError where no bundle can be written; nothing is replaced."""
    if file.exists() or file.is_symlink():
        raise UserError(f"{file} exists: name another file for the bundle, or remove that one.")
    if not file.parent.is_dir():
        raise UserError(f"{file} cannot be written: there is no folder {file.parent}.")
    if not os.access(file.parent, os.W_OK):
        raise UserError(f"{file} cannot be written: {file.parent} is read-only.")


def pairs(systems: Sequence[str], pythons: Sequence[str]) -> list[tuple[str, str]]:
    """Return the systems and Pythons that packages are fetched for; raise UserError for one that is unknown."""
    for name in systems:
        if name not in (*SYSTEMS, this_system()):
            raise UserError(f"--for: there is no system {name!r}{suggest(name, SYSTEMS)}.".replace("?.", "?"))
    for version in pythons:
        if not re.fullmatch(r"3\.[1-9]\d*", version) or int(version[2:]) < 11:
            raise UserError(f"--python {version}: Strata runs on Python 3.11 and newer, so name one as 3.12.")
    own = "{}.{}".format(*sys.version_info[:2])
    return [
        (s, p) for s in dict.fromkeys(systems or [this_system()]) for p in dict.fromkeys(pythons or [own])
    ]


def refuse_without_core(system: str, python: str, lock: str, lacks: Sequence[str]) -> None:
    """Raise UserError where packages have no wheels without which `--from` refuses the bundle."""
    core = {canonical(name) for name in names_in(locked(lock, everything=False))}
    missing = [name for name in lacks if canonical(name) in core]
    if missing:
        raise UserError(
            f"For {system} with Python {python} there are no wheels of {', '.join(missing)}, without which Strata does "
            "not run: name another Python or system."
        )


def clone_parts(root: Path, history: History, scratch: Path) -> list[Part]:
    """Return the files of the last commit, and its history; what is not committed is said and not packed."""
    changed = history.changed()
    if changed:
        more = f" and {len(changed) - 8} more" if len(changed) > 8 else ""
        say(f"strata: Not committed and so not packed as it is: {', '.join(changed[:8])}{more}.")
    parts = []
    with tarfile.open(fileobj=io.BytesIO(git("archive", "--format=tar", history.head, folder=root))) as tar:
        for member in tar:
            if member.isdir():
                continue
            content = tar.extractfile(member) if member.isfile() else None
            if content is None:
                raise UserError(
                    f"{member.name} is a link, which a bundle cannot hold: commit a file in its place."
                )
            parts.append(Part(CLONE + member.name, content.read(), bool(member.mode & 0o100)))
    why = "the clone is a part of another repository" if history.prefix else "this clone is shallow"
    if history.prefix or history.shallow:
        say(f"strata: The history is not packed, since {why}.")
        return parts
    packed = scratch / HISTORY
    # One thread: which delta is found would depend on their race.
    git("-c", "pack.threads=1", "bundle", "create", "--quiet", packed, "HEAD", folder=root)
    return [*parts, Part(HISTORY, packed)]


def site_parts(root: Path) -> list[Part]:
    """Return the files of the built site; none, and a sentence, where it was not built."""
    folder = root / "out" / "site"
    if not (folder / site.MARK).is_file():
        say("strata: The site is not packed, since it was not built: --site builds it first.")
        return []
    if not (folder / "index.html").is_file():  # what is left where mkdocs-material is missing
        say("strata: The site is not packed, since it is Markdown alone: ./strata --extras docs builds it.")
        return []
    return [Part(SITE + p.relative_to(folder).as_posix(), p) for p in folder.rglob("*") if p.is_file()]


def model_parts(models: Iterable[str], root: Path) -> list[Part]:
    """Return the files of models; raise UserError for one that is not there."""
    parts: dict[str, Part] = {}
    for text in models:
        model = model_of(text, root)
        if not model.files:
            say(f"strata: {text} is part of the clone anyway.")
        for name in model.missing:
            say(f"strata: {text} names the file {name}, which is missing and so not packed.")
        for name, path in sorted(model.files.items()):
            part = Part(f"{MODELS}{model.name}/{name}", path)
            if parts.setdefault(part.name, part) != part:
                raise UserError(
                    f"--models: two models are called {model.name}: pack one of them, or rename it."
                )
    return list(parts.values())


def write(file: Path, commit: str, targets: Sequence[Target], parts: Iterable[Part]) -> str:
    """Write a bundle, whole or not at all, and return the file's SHA-256 in hexadecimal."""
    by_name = {part.name: part for part in parts}
    by_name[MAIN] = Part(MAIN, ENTRY.encode())
    for name in by_name:
        if not inside(name):
            raise UserError(f"{name} cannot be packed: not every system can have a file of that name.")
    try:
        whole = WholeFile(file)
        try:
            with zipfile.ZipFile(whole.stream, "w") as archive:
                entries = {name: add(archive, by_name[name]) for name in sorted(by_name)}
                manifest = {
                    "format": FORMAT,
                    "commit": commit,
                    "targets": [asdict(target) for target in targets],
                    "files": {name: asdict(entry) for name, entry in entries.items()},
                }
                add(archive, Part(MANIFEST, json.dumps(manifest, indent=1).encode()))
            whole.keep()
        finally:
            whole.drop()
    except OSError as error:
        raise UserError(f"{file} cannot be written: {error.strerror or error}.") from None
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def add(archive: zipfile.ZipFile, part: Part) -> Entry:
    """Write one file to the archive and return what the manifest says of it."""
    info = zipfile.ZipInfo(part.name, MOMENT)
    info.create_system = 3  # Unix, on every system: there the mode is read by other programs that unpack
    info.external_attr = (0o100755 if part.program else 0o100644) << 16
    info.compress_type = zipfile.ZIP_STORED if part.name.endswith(PACKED) else zipfile.ZIP_DEFLATED
    digest, size = hashlib.sha256(), 0
    source = part.source.open("rb") if isinstance(part.source, Path) else io.BytesIO(part.source)
    with source, archive.open(info, "w", force_zip64=True) as stream:
        while chunk := source.read(CHUNK_BYTES):
            digest.update(chunk)
            size += len(chunk)
            stream.write(chunk)
    return Entry(size, digest.hexdigest(), part.program)


def report(
    file: Path, digest: str, history: History, targets: Sequence[Target], parts: Sequence[Part]
) -> None:
    """Say what was written, and what to do with it."""
    names = {part.name for part in parts}
    lines = [f"Wrote {file}: {file.stat().st_size / 1e6:.1f} MB, SHA-256 {digest}."]
    with_history = ", with its history" if HISTORY in names else ""
    lines.append(f"  The clone at commit {history.head[:10]}{with_history}.")
    lines += [f"  {len(target.wheels)} packages for {target} ({target.packages})." for target in targets]
    if any(name.startswith(SITE) for name in names):
        lines.append("  The site.")
    models = sorted({name.split("/")[1] for name in names if name.startswith(MODELS)})
    if models:
        lines.append(f"  Models: {', '.join(models)}.")
    lines.append("There, in the folder of that file (on Windows: py, and strata.cmd):")
    lines.append(f"  python3 {quoted(file.name)} strata")
    lines.append(f"  cd strata && ./strata --from {quoted('../' + file.name)} run 1")
    out.print(shown("\n".join(lines)), markup=False, soft_wrap=True)
