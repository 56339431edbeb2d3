"""`strata assets shrink`: textures as small PNGs, and the materials of .mtl files as records that name them.

What is written stands in `common.materials.convert` and `common.materials.records`. A second run with the same sources
writes nothing.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.markup import escape

from common.errors import UserError
from common.materials import records
from common.materials.convert import SUFFIXES, Converted, TextureRequest, convert_textures, pictures_in
from common.materials.importer import import_materials, read_mtl
from common.materials.merge import merged
from common.materials.records import MaterialList
from common.materials.textures import convert_materials
from common.reports.tables import table
from tools.cli.console import Steps, out, say, shown

MATERIALS = "scene.materials"
"""The file of the records of all .mtl files."""


def shrink(sources: Sequence[Path], folder: Path, most: int, data: bool) -> int:
    """Convert `sources` into `folder`, print what became of each texture, and return the exit code, 0.

    With `data` the codes of pictures and folders are averaged as they are; the textures of an .mtl file are known by
    their roles. Raises UserError: a source that is not there or of no such kind, or where `folder` cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise UserError(f"{shown(str(folder))} is a file: name a folder for the textures.")
    paths = [Path(os.path.abspath(path)) for path in sources]
    root = _root(paths)
    pictured = [path if path.is_dir() else path.parent for path in paths if not _is_library(path)]
    if any(one.resolve() == folder.resolve() for one in pictured):
        raise UserError(
            f"{shown(str(folder))} has sources in it, and the next run might shrink what this one writes: "
            "name another folder, which may be inside it."
        )
    pictures: list[str] = []
    libraries: list[MaterialList] = []
    for path in paths:
        if path.is_dir():
            pictures += [_below(root, path, name) for name in pictures_in(path, folder)]
        elif _is_library(path):
            libraries.append(_library(path, root))
        else:
            pictures.append(_below(root, path.parent, path.name))
    if not pictures and not libraries:
        raise UserError(
            f"There is no picture in {shown(', '.join(map(str, sources)))}: {', '.join(SUFFIXES)} are some."
        )
    requests = [TextureRequest(name, kind="data" if data else "color") for name in pictures]
    with Steps() as steps:
        first: Any = steps.of("converting pictures", 0.0, 0.5)
        done = list(convert_textures(requests, root, folder, most, first).values())
        if libraries:
            second: Any = steps.of("converting textures of materials", 0.5, 1.0)
            materials, more = convert_materials(merged(libraries).materials, root, folder, most, second)
            done += more
            _write(folder / MATERIALS, materials)
    _show(done, folder)
    if libraries:
        out.print(f"{MATERIALS} has {len(materials.records)} materials.")
    return 0


def _root(paths: Sequence[Path]) -> Path:
    """Return the folder to which all names are relative: the one that all sources are in. Raises UserError."""
    for path in paths:
        if not path.exists():
            raise UserError(
                f"There is no {shown(str(path))}: name a picture, a folder of pictures, or an .mtl file."
            )
        if not path.is_dir() and path.suffix.lower() not in (*SUFFIXES, ".mtl"):
            raise UserError(
                f"{shown(str(path))} is neither a folder nor an .mtl file nor a picture ({', '.join(SUFFIXES)})."
            )
    try:
        return Path(os.path.commonpath([path if path.is_dir() else path.parent for path in paths]))
    except ValueError:
        raise UserError("The sources are on different drives: convert those of each on its own.") from None


def _is_library(path: Path) -> bool:
    return path.suffix.lower() == ".mtl" and not path.is_dir()


def _below(root: Path, folder: Path, name: str) -> str:
    """Return a name that counts from `folder` as one that counts from `root`; an absolute one stays what it is."""
    if not name or name.startswith("/") or name[1:2] == ":":
        return name
    return (folder.relative_to(root) / name).as_posix()


def _library(path: Path, root: Path) -> MaterialList:
    """Return the materials of an .mtl file, whose textures count from `root`, and say what of it was left out."""
    found, warnings = read_mtl(path)
    for warning in warnings:
        say(warning)
    made = import_materials(found)
    return MaterialList(made.records, tuple(_below(root, path.parent, name) for name in made.textures))


def _write(path: Path, materials: MaterialList) -> None:
    data = records.to_bytes(materials)
    try:
        if path.read_bytes() == data:
            return
    except OSError:
        pass  # it is new, or writing says what is wrong with it
    records.write_material_file(path, materials)


def _show(done: Sequence[Converted], folder: Path) -> None:
    found = table(f"Textures in {shown(str(folder))}", "texture", "file", ">size", "")
    for one in done:
        names = [name for name in (one.request.name, one.request.opacity) if name]
        state = "placeholder" if one.placeholder else "written" if one.written else "as it was"
        size = f"{one.size[0]} x {one.size[1]}"
        found.add_row(escape(shown(" + ".join(names))), one.file, size, state)
    if done:
        out.print(found)
    for note in dict.fromkeys(one.note for one in done if one.note):
        say(note)
    written = sum(one.written for one in done)
    out.print(f"{written} of {len(done)} textures were written.")
