"""Which files a model is made of: what `strata bundle --models` packs."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

from bootstrap.bundle import inside
from chapters import scenes
from common.errors import SceneError, UserError
from common.files.regular_files import leads_outside
from common.gltf.container import open_container

PAPERS = ("licen", "notice", "readme", "copying")
"""How the names of files begin that travel with a model, since somebody made it."""


@dataclass(frozen=True)
class Model:
    """A model's name, its files by their paths from its folder, and the names of files that are not there."""

    name: str
    files: dict[str, Path]
    missing: tuple[str, ...] = ()


def model_of(text: str, root: Path) -> Model:
    """Return the model that `text` means, as `--scene` takes it; without files where the clone has them anyway.

    Raises UserError: there is no such model, it cannot be read, or it has files outside its folder.
    """
    path = scenes.find(text).absolute()
    name = re.sub(r"[^\w.-]", "_", path.stem)
    if path.is_relative_to(root / "assets"):
        return Model(name, {})
    files, missing = {path.name: path}, []
    for uri in names_in(path):
        found = next((one for one in (unquote(uri), uri) if (path.parent / one).is_file()), None)
        if found is None:
            missing.append(uri)
        elif not inside(found) or leads_outside(path.parent / found, path.parent):
            raise UserError(
                f"{path} names the file {uri}, which cannot be packed: it is outside the model's folder."
            )
        else:
            files[found] = path.parent / found
    for beside in path.parent.iterdir():
        if beside.is_file() and beside.name.lower().startswith(PAPERS):
            files[beside.name] = beside
    return Model(name, files, tuple(missing))


def names_in(path: Path) -> Iterator[str]:
    """Yield the names of the other files that a model needs, as they stand in it."""
    try:
        if path.suffix.lower() == ".obj":
            for line in path.read_text("utf-8", "replace").splitlines():
                words = line.split()
                if words[:1] == ["mtllib"]:
                    yield " ".join(words[1:])
            return
        document = json.loads(open_container(path).text.tobytes())
        for kind in ("buffers", "images"):
            for entry in document.get(kind, ()):
                uri = entry.get("uri", "")
                if uri and uri[:5].lower() != "data:":
                    yield str(uri)
    except SceneError as error:
        raise UserError(f"{path}: {error}") from None
    except (ValueError, AttributeError, TypeError):
        raise UserError(f"{path} is no glTF that can be read: export it again.") from None
