"""What a generated picture was made from, as one hash: when it is another one, the picture is out of date.

docs/records/pictures.json   of each picture the hash of its inputs and of itself, with device, commit and date

A hash covers the code of the chapters that drew a picture, the shared shaders that it names, and the scene. It leaves
out comments, docstrings and blank lines, which change no pixel, and what is in common/ and backends/, which would make
all pictures stale with every change: those are held by the tests of chapters, and by drawing all pictures anew
(`./strata test docs --long`).
"""

from __future__ import annotations

import ast
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import chapters
from common.paths import ROOT, write_whole
from tools.diff.sentences import SHADERS

RECORD = ROOT / "docs" / "records" / "pictures.json"
CODE = (*SHADERS, ".py", ".json")
BESIDE = {"README.md", "studies", "benches", "exercises", "__pycache__"}
"""What is in a chapter's folder and not in its frame."""
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)


def chapter(number: int) -> list[Path]:
    """Return the files of a chapter's frame, and those of the shared shaders that they name."""
    folder = chapters.folder_of(number)
    own = [path for path in folder.rglob("*") if not BESIDE & {*path.relative_to(folder).parts}]
    return _with_shaders(path for path in own if path.suffix in CODE)


def _with_shaders(own: Iterable[Path]) -> list[Path]:
    """Return files with the shared shaders whose names they contain, and those that these include.

    Shared shaders of whole stages are always among them: the backends name those. So a shader that a later chapter adds
    makes no picture of an earlier one stale.
    """
    shared = {path.name: path for path in (ROOT / "shaders").rglob("*") if path.suffix in SHADERS}
    found = {*own}
    new = found | {path for path in shared.values() if path.suffix != ".glsl"}
    while new:
        found |= new
        new = {shared[name] for path in new for name in _named(path) & shared.keys()} - found
    return [*found]


@cache
def _named(path: Path) -> frozenset[str]:
    """Return the names of shaders that a file contains."""
    text = path.read_text("utf-8", "replace") if path.is_file() else ""
    return frozenset(name for name in re.findall(r"[\w]+\.\w+", text) if name[name.index(".") :] in SHADERS)


def study(number: int, name: str) -> list[Path]:
    """Return the files of a study, with those beside it that studies share."""
    folder = chapters.folder_of(number) / "studies"
    found = [*folder.glob("*"), *(folder / name.replace("-", "_")).rglob("*")]
    return _with_shaders(path for path in found if path.suffix in CODE)


def scene(name: str) -> list[Path]:
    """Return the files of a scene that is in the repository, or the generators of one that is not."""
    scene_name = name.partition(":")[0]
    files = [path for path in (ROOT / "assets" / "models" / scene_name).rglob("*") if path.is_file()]
    return files or [*(ROOT / "assets").glob(f"{scene_name}*.py")]


def digest(files: Iterable[Path]) -> str:
    """Return the hash of files, 20 letters; of code, without what changes nothing. A missing file counts as empty."""
    found = hashlib.sha256()
    for path in sorted(set(files)):
        found.update(f"{path.relative_to(ROOT).as_posix()}\0{_content(path)}\0".encode())
    return found.hexdigest()[:20]


@cache
def _content(path: Path) -> str:
    return _hashed(path.suffix, path.read_bytes() if path.is_file() else b"")


@cache  # most files are the same bytes in several chapters
def _hashed(suffix: str, data: bytes) -> str:
    if suffix == ".py":
        with suppress(SyntaxError):  # a file that is being edited is another one, whatever it says
            data = code_of(data.decode()).encode()
    elif suffix in SHADERS:
        data = " ".join(_COMMENT.sub(" ", data.decode()).split()).encode()
    elif suffix in (".json", ".gltf"):  # line ends may be those of the system
        data = data.replace(b"\r\n", b"\n")
    return hashlib.sha256(data).hexdigest()


def code_of(text: str) -> str:
    """Return Python's code without docstrings, blank lines and lines that are comments, in every version of Python."""
    lines = text.splitlines()
    inside: set[int] = (
        set()
    )  # lines of longer texts: what looks like a comment there may be a shader's #define
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            assert node.end_lineno is not None
            lines[node.lineno - 1 : node.end_lineno] = [""] * (node.end_lineno - node.lineno + 1)
        elif isinstance(node, ast.Constant | ast.JoinedStr) and node.end_lineno != node.lineno:
            inside.update(range(node.lineno, node.end_lineno or node.lineno))
    kept = (
        line for number, line in enumerate(lines) if number in inside or not line.lstrip().startswith("#")
    )
    return "\n".join(line.rstrip() for line in kept if line.strip())


def read() -> dict[str, dict[str, Any]]:
    """Return the record: path of each picture from the clone's root -> what it was made from. {} without a record."""
    try:
        found: dict[str, dict[str, Any]] = json.loads(RECORD.read_text("utf-8"))["pictures"]
    except (OSError, ValueError, KeyError):
        return {}
    return found


def write(pictures: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the record, whole or not at all, in the order of names."""
    RECORD.parent.mkdir(parents=True, exist_ok=True)
    write_whole(RECORD, (json.dumps({"pictures": dict(sorted(pictures.items()))}, indent=1) + "\n").encode())


def entry(path: Path, inputs: str, head: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the record holds of a picture that was just written; `head` is device, commit and date."""
    return {"inputs": inputs, "file": hashlib.sha256(path.read_bytes()).hexdigest()[:20], **head}


def stale(wanted: Mapping[str, str], found: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return path -> why, of each picture that is not what its inputs would give now.

    `wanted` has the hash of the inputs of every picture that there should be, `found` is the record.
    """
    why = {}
    for name, inputs in wanted.items():
        path, known = ROOT / name, found.get(name)
        if not path.is_file():
            why[name] = "is missing"
        elif known is None:
            why[name] = "is in no record"
        elif known["file"] != hashlib.sha256(path.read_bytes()).hexdigest()[:20]:
            why[name] = "is not the file that was made"
        elif known["inputs"] != inputs:
            why[name] = "is older than what it is made from"
    return why
