"""What a reference is a picture of, as hashes: equal contents share what is traced, whatever their names are."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

import chapters
from common.errors import SceneError
from common.paths import ROOT
from common.scene import Image, Scene
from common.settings import flat
from common.view.camera import View
from tools.reference.settings import TRACER, keyed

UNSEEN = {
    "name",
    "names",
    "mesh_names",
    "path",
    "cameras",
    "extras",
    "edited",
    "warnings",
    "revision",
    "ev100",
}
"""Fields of a scene and its parts that no path depends on; the view has the exposure."""

INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"', re.MULTILINE)

ENTRIES = ("paths/paths.comp", "paths/paths.rgen", "rays/hit.rahit", "rays/hit.rchit", "rays/*.rmiss")
"""The shaders with which the path tracer begins; what they include follows."""


def facts_of(
    scene: Scene,
    view: View,
    time: float,
    size: tuple[int, int],
    backend: str,
    settings: Any,
    hashed: str | None = None,
) -> dict[str, str]:
    """Return what the sums of paths depend on, by words of a sentence; `settings` are those of the path tracer.

    `hashed` is the `scene_hash`, where that is known already. The device is none of it: sums may go on on another one,
    and name all that had a part in them.
    """
    values = {name: value for name, value in flat(settings).items() if keyed(name)}
    camera = [
        view.world_from_view.astype("<f8").tobytes().hex(),
        repr(view.projection),
        float(view.ev100).hex(),
    ]
    return {
        "scene": hashed or scene_hash(scene),
        "camera": _short(" ".join(camera).encode()),
        "time": float(time).hex(),
        "size": f"{size[0]}x{size[1]}",
        "setting": json.dumps(values, sort_keys=True),
        "backend": backend,
        "version of the path tracer": tracer_hash(),
    }


def file_name(facts: dict[str, str]) -> str:
    """Return the name of the file in the cache for what has these facts."""
    return f"{_short(json.dumps(facts, sort_keys=True).encode())}.npz"


def scene_hash(scene: Scene) -> str:
    """Return a hash of all of a scene that can be seen, its environment and its decoded images included."""
    hashed = hashlib.blake2b(digest_size=16)
    _feed(hashed, scene)
    return hashed.hexdigest()


def _feed(hashed: Any, value: Any) -> None:
    """Add a value to a hash. Each begins with its type and its length, so no two values give the same bytes."""
    if isinstance(value, Image):
        try:
            value = value.decode()
        except SceneError as error:  # the renderer decides what becomes of it
            value = str(error)
    if isinstance(value, np.ndarray):
        hashed.update(f"array {value.dtype.descr} {value.shape};".encode())
        hashed.update(np.ascontiguousarray(value).data.cast("B") if value.size else b"")
    elif is_dataclass(value) and not isinstance(value, type):
        hashed.update(f"{type(value).__name__};".encode())
        for part in fields(value):
            if part.name not in UNSEEN:
                hashed.update(f"{part.name};".encode())
                _feed(hashed, getattr(value, part.name))
    elif isinstance(value, dict):
        _feed(hashed, [part for item in sorted(value.items()) for part in item])
    elif isinstance(value, list | tuple):
        hashed.update(f"list {len(value)};".encode())
        for part in value:
            _feed(hashed, part)
    else:
        text = repr(value).encode()
        hashed.update(b"%d:%s;" % (len(text), text))


def tracer_hash() -> str:
    """Return a hash of the texts of the path tracer: its shaders, what they include, and what fills its tables."""
    chapter = chapters.folder_of(TRACER)
    entries = [path for pattern in ENTRIES for path in sorted(chapter.glob(pattern))]
    files = included(entries, (chapter, ROOT / "shaders")) | {*(chapter / "paths").glob("*.py")}
    hashed = hashlib.blake2b(digest_size=16)
    for path in sorted(files):
        _feed(hashed, [path.relative_to(ROOT).as_posix(), path.read_text("utf-8")])
    return hashed.hexdigest()


def included(entries: Iterable[Path], roots: tuple[Path, ...]) -> set[Path]:
    """Return shaders and all that they include, whatever is defined; an include is beside its file or below a root."""
    found: set[Path] = set()
    waiting = list(entries)
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.add(path)
        for name in INCLUDE.findall(path.read_text("utf-8")):
            places = (root / name for root in (path.parent, *roots))
            waiting += [place for place in places if place.is_file()][:1]
    return found


def _short(data: bytes) -> str:
    return hashlib.blake2b(data, digest_size=16).hexdigest()
