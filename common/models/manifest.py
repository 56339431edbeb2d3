"""The manifest of well-known models: where each comes from, under which licence, and what its bytes are.

`assets/wellknown.toml` pins a model by a commit and every file of it by size and SHA-256, so that any change of
the bytes, on the server or on the way, is noticed.
"""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

from common.errors import UserError
from common.names import suggest
from common.paths import ROOT

MANIFEST = ROOT / "assets" / "wellknown.toml"
SUFFIXES = (".gltf", ".glb")
SOURCES: Mapping[str, str] = MappingProxyType(
    {"github": "https://raw.githubusercontent.com/{repository}/{commit}/{path}"}
)
"""The address of a file by the type of its source: that which a browser, too, would load it from."""

LICENCES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "CC0-1.0": (
            "https://creativecommons.org/publicdomain/zero/1.0/legalcode",
            "dedicated to the public: no condition",
        ),
        "CC-BY-4.0": (
            "https://creativecommons.org/licenses/by/4.0/legalcode",
            "name the author wherever you show it or pass it on, and what you changed",
        ),
    }
)
"""By SPDX identifier: where the text is, and in a few words what it asks for."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")
_FORMS = {
    "name": _NAME,
    "title": re.compile(r"\S.*"),
    "source": re.compile(r"\S+"),
    "repository": re.compile(r"[\w.-]+/[\w.-]+"),
    "commit": re.compile(r"[0-9a-f]{40}"),
    "folder": re.compile(r"[^/\\]+(/[^/\\]+)*"),
    "main": re.compile(r"\S.*"),
    "author": re.compile(r"\S.*"),
    "licence": re.compile(r"\S+"),
}
_SHA256 = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class PinnedFile:
    """One file of a model: its name below the model's folder, its bytes and their SHA-256, hexadecimal."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True)
class Model:
    """A model of others: what it is, whose, under which licence (SPDX), and the files of it at a commit."""

    name: str
    title: str
    source: str
    repository: str
    commit: str
    folder: str
    main: str
    author: str
    year: int
    licence: str
    files: tuple[PinnedFile, ...]

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(file.size for file in self.files)

    @property
    def identity(self) -> str:
        """A short hash of what the files are: equal bytes have the same folder, others another."""
        lines = (f"{file.name}\n{file.size}\n{file.sha256}\n" for file in self.files)
        return hashlib.sha256("".join(lines).encode()).hexdigest()[:12]

    def url(self, file: PinnedFile, sources: Mapping[str, str] = SOURCES) -> str:
        """Return the address of a file."""
        path = quote(f"{self.folder}/{file.name}")
        return sources[self.source].format(repository=self.repository, commit=self.commit, path=path)


def is_name(text: str) -> bool:
    """Whether a model may be called so: such a word is no path."""
    return _NAME.fullmatch(text) is not None


def read_manifest(path: Path = MANIFEST, sources: Mapping[str, str] = SOURCES) -> dict[str, Model]:
    """Return the models of a manifest by name, in its order.

    Raises UserError, which says what is wrong with which model: a type of source that is not one of `sources`, a
    missing or an unknown entry, a hash or a commit that is none, a file that would lie outside of the model's folder.
    """
    try:
        entries = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        raise UserError(f"The manifest of models {path} cannot be read: {reason}.") from None
    listed = entries.pop("model", [])
    if entries or not isinstance(listed, list):
        raise UserError(f"The manifest of models {path} holds something else than [[model]].")
    models: dict[str, Model] = {}
    for number, entry in enumerate(listed):
        model = _model(entry, f"The manifest {path.name}, model {number + 1}", sources)
        if find(model.name, models) is not None:
            raise UserError(f"The manifest {path.name} has two models called {model.name}.")
        models[model.name] = model
    return models


def find(name: str, models: Mapping[str, Model]) -> Model | None:
    """Return the model of that name, however its letters are written, or None."""
    return next((model for model in models.values() if model.name.lower() == name.lower()), None)


def _model(entry: Any, place: str, sources: Mapping[str, str]) -> Model:
    if not isinstance(entry, dict):
        raise UserError(f"{place}: this is no table.")
    if isinstance(entry.get("name"), str):
        place = f"{place} ({entry['name']})"
    wanted = {*_FORMS, "year", "files"}
    for key in sorted(wanted ^ entry.keys()):
        raise UserError(f"{place}: {key} {'is missing' if key in wanted else 'is no entry of a model'}.")
    for key, form in _FORMS.items():
        if not isinstance(entry[key], str) or not form.fullmatch(entry[key]):
            raise UserError(f"{place}: {key} = {entry[key]!r} is none.")
    if entry["source"] not in sources:
        raise UserError(
            f"{place}: there is no type of source {entry['source']!r}{suggest(entry['source'], sources)}."
        )
    if entry["licence"] not in LICENCES:
        raise UserError(
            f"{place}: the licence {entry['licence']!r} is not known{suggest(entry['licence'], LICENCES)}."
        )
    if type(entry["year"]) is not int:
        raise UserError(f"{place}: year = {entry['year']!r} is none.")
    if _escapes(entry["folder"]):
        raise UserError(f"{place}: folder = {entry['folder']!r} leads out of the repository.")
    files = _files(entry["files"], place)
    if entry["main"] not in {file.name for file in files}:
        raise UserError(f"{place}: main = {entry['main']!r} is not among the files.")
    if not entry["main"].lower().endswith(SUFFIXES):
        raise UserError(f"{place}: main = {entry['main']!r} is no {' or '.join(SUFFIXES)} file.")
    return Model(**{**entry, "files": files})


def _files(entries: Any, place: str) -> tuple[PinnedFile, ...]:
    if not isinstance(entries, list) or not entries:
        raise UserError(f"{place}: files is not a list of files.")
    files = []
    for entry in entries:
        if not isinstance(entry, dict) or entry.keys() != {"name", "size", "sha256"}:
            raise UserError(f"{place}: a file has name, size and sha256, not {entry!r}.")
        name, size, sha256 = entry["name"], entry["size"], entry["sha256"]
        if not isinstance(name, str) or _escapes(name):
            raise UserError(f"{place}: the file {name!r} would lie outside of the model's folder.")
        if type(size) is not int or size <= 0:
            raise UserError(f"{place}: size = {size!r} of {name} is no number of bytes.")
        if not isinstance(sha256, str) or not _SHA256.fullmatch(sha256):
            raise UserError(f"{place}: sha256 = {sha256!r} of {name} is none.")
        files.append(PinnedFile(name, size, sha256))
    if len({file.name.lower() for file in files}) < len(files):
        raise UserError(f"{place}: a file is named twice.")
    return tuple(files)


def _escapes(name: str) -> bool:
    """Whether a path, on whatever system, is anything else than one that goes down from where it begins."""
    path = PurePosixPath(name)
    return (
        not name
        or any(c in name for c in "\\:\0")
        or path.is_absolute()
        or str(path) != name
        or ".." in path.parts
    )
