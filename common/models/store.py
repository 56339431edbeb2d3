"""Where models of others and the reader's own are kept, and which of them a name means.

What was fetched lies in the user's cache, one folder per model, beside a list of the paths that the reader gave names
to. All of it can be deleted: models are fetched again, and names are given again.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from pathlib import Path

from common.errors import SceneError, UserError
from common.models.manifest import LICENCES, Model, PinnedFile, find, read_manifest
from common.paths import cache_dir, cache_problem, user_cache, write_whole

NOTICE = "NOTICE.txt"
"""The file beside a fetched model that says whose it is."""
OWN = "own.json"
"""The file with the reader's own models: name to path."""


def place() -> Path:
    """Return the folder of models (not created)."""
    return user_cache() / "models"


def writable_place() -> Path:
    """Return the folder of models, created if need be; raises UserError where nothing can be written."""
    folder = cache_dir("models")
    if folder is None:
        raise UserError(f"{cache_problem()}; STRATA_CACHE names another folder.")
    return folder


def folder_of(model: Model) -> Path:
    """Return where the files of a well-known model lie: another folder for other bytes."""
    return place() / f"{model.name}-{model.identity}"


def is_here(model: Model) -> bool:
    """Whether every file of a model is here, by name and size: a file has its name only once its bytes were checked."""
    return all(_size(folder_of(model) / file.name) == file.size for file in model.files)


def is_whole(path: Path, file: PinnedFile) -> bool:
    """Whether a file is there and has the bytes that the manifest pins; all of it is read."""
    return _size(path) == file.size and sha256_of(path) == file.sha256


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size if path.is_file() else None
    except OSError:
        return None


def own_models() -> dict[str, Path]:
    """Return the reader's own models by name; raises UserError if their list cannot be read."""
    path = place() / OWN
    try:
        listed = json.loads(path.read_text("utf-8"))
        if not isinstance(listed, dict) or not all(isinstance(text, str) for text in listed.values()):
            raise ValueError
    except FileNotFoundError:
        return {}
    except (OSError, ValueError):
        raise UserError(
            f"The list of your models, {path}, cannot be read: remove it, and add them again."
        ) from None
    return {name: Path(text) for name, text in listed.items()}


def keep_own(name: str, path: Path) -> Path | None:
    """Let `name` mean a file from now on; return what it meant before, or None."""
    listed = own_models()
    known = _spelled(name, listed)
    before = listed.pop(known) if known is not None else None
    listed[name] = Path(os.path.abspath(path))
    _write(listed)
    return before if before != listed[name] else None


def remove(name: str) -> str:
    """Forget one of the reader's own models, or delete the files of a fetched one; return what was done, a sentence.

    Raises UserError where there is nothing of that name.
    """
    listed = own_models()
    known = _spelled(name, listed)
    if known is not None:
        path = listed.pop(known)
        _write(listed)
        return f"{known} means nothing any more; {path} stays where it is."
    model = find(name, read_manifest())
    if model is None or not folder_of(model).is_dir():
        raise UserError(f"There is nothing of {name} to remove; ./strata assets list shows what is here.")
    shutil.rmtree(folder_of(model))
    return f"The files of {model.name} were removed."


def _write(listed: dict[str, Path]) -> None:
    texts = {name: str(path) for name, path in sorted(listed.items())}
    write_whole(writable_place() / OWN, (json.dumps(texts, indent=1) + "\n").encode())


def _spelled(name: str, listed: dict[str, Path]) -> str | None:
    return next((known for known in listed if known.lower() == name.lower()), None)


def locate(name: str) -> Path | None:
    """Return the file that a name means: of the reader's own, or of a well-known model; None if it means neither.

    Nothing is ever fetched here. Raises UserError where the file is not there: with what brings it.
    """
    listed = own_models()
    known = _spelled(name, listed)
    if known is not None:
        if not listed[known].is_file():
            raise SceneError(
                f"Your model {known} was {listed[known]}, which is gone: ./strata assets add PATH names another."
            )
        return listed[known]
    model = find(name, read_manifest())
    if model is None:
        return None
    if not is_here(model):
        raise SceneError(
            f"{model.name} is a model of others that is not here yet: ./strata assets get {model.name} shows its "
            f"licence and fetches it ({in_bytes(model.size)})."
        )
    return folder_of(model) / model.main


def names() -> list[str]:
    """Return all names that `locate` knows."""
    return [*own_models(), *read_manifest()]


def in_bytes(count: int) -> str:
    """Return a number of bytes in words of three digits: 1.66 kB, 223 kB, 3.02 MB."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= 0.9995 * scale:
            return f"{count / scale:#.3g} {unit}".replace(". ", " ")
    return f"{count} byte{'' if count == 1 else 's'}"


def write_notice(model: Model) -> None:
    """Write author, licence and source of a model beside its files, where they belong."""
    address, asks = LICENCES[model.licence]
    lines = (
        f"{model.name}: {model.title}",
        f"By {model.author}, {model.year}. {model.licence} ({asks}), {address}",
        f"From {model.repository} at commit {model.commit}, {model.folder}; unchanged.",
    )
    write_whole(folder_of(model) / NOTICE, ("\n".join(lines) + "\n").encode())
