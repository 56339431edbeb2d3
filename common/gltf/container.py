"""From a path or URI to bytes: .gltf and .glb containers, data URIs, files in the scene's folder, no others.

Files are memory-mapped, so that bytes which no accessor names are never read from disk.
"""

from __future__ import annotations

import base64
import binascii
import difflib
import itertools
import mmap
import os
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from common.files.regular_files import NOT_REGULAR, leads_outside, open_regular
from common.gltf.refusal import refuse

Bytes = NDArray[np.uint8]

Opened = Callable[[str], None]
"""Called with the name of a file, relative to the scene's folder, before it is opened."""

MAX_JSON_BYTES = 512 * 2**20
"""A parsed JSON text takes about ten times its size; what is larger belongs into a binary buffer anyway."""

MAX_ENTRIES = 1000
"""Names of a folder that are looked at for one near a missing file's."""

_GLB_MAGIC = b"glTF"
_GLB_HEADER = struct.Struct("<4sII")  # magic, version, length of the file
_CHUNK_HEADER = struct.Struct("<I4s")  # length of the data, type
_SCHEME = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*:")


@dataclass(frozen=True)
class Container:
    """A scene file taken apart: its JSON text and, of a .glb, the binary chunk (None where there is none)."""

    folder: Path
    text: Bytes
    binary: Bytes | None


def map_file(path: Path, place: str = "") -> Bytes:
    """Return the bytes of a file as a read-only view of mapped memory.

    Raises:
        Refusal: there is no such file, it is no regular file, or it cannot be read.
    """
    try:
        with open_regular(path) as stream:
            # The size may be zero, which mmap refuses; np.memmap does as well.
            if os.fstat(stream.fileno()).st_size == 0:
                return np.zeros(0, np.uint8)
            return np.frombuffer(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ), np.uint8)
    except IsADirectoryError:
        refuse(
            place,
            f"{'names a folder, ' + path.name if place else 'is a folder'}",
            "name a file in it" if place else "name the .gltf or .glb in it",
        )
    except (FileNotFoundError, UnicodeEncodeError):  # the latter: no file can have this name
        if place:
            advice = f"put it beside the scene{_near(path)}"
            refuse(place, f"names the file {path.name}, which is missing", advice)
        refuse("", "there is no such file", f"check the path{_near(path)}")
    except (OSError, ValueError) as error:  # ValueError: a null character in the name
        if isinstance(error, OSError) and error.strerror == NOT_REGULAR:
            refuse(place, f"{path.name} is not a regular file", "give a file")
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        refuse(place, f"cannot be read ({reason})", "check the file's name and its permissions")


def _near(path: Path) -> str:
    """Return how advice goes on where the folder of a missing file has one of nearly its name (another case, say)."""
    try:
        with os.scandir(path.parent) as entries:
            names = {entry.name.lower(): entry.name for entry in itertools.islice(entries, MAX_ENTRIES)}
    except OSError:
        return ""
    near = difflib.get_close_matches(path.name.lower(), names, n=1, cutoff=0.75)
    return f", or name {names[near[0]]!r}, which is there" if near else ""


def open_container(path: Path) -> Container:
    """Open a scene file; a .glb is recognised by its first bytes, not by its name.

    Raises:
        Refusal: the file is missing, a folder, empty, too large, or a .glb whose chunks do not fit into it.
    """
    data = map_file(path)
    if len(data) == 0:
        refuse("", "the file is empty", "export it again")
    if data[:4].tobytes() != _GLB_MAGIC:
        _bound_json(len(data))
        return Container(path.parent, data, None)
    return _open_glb(data, path.parent)


def _open_glb(data: Bytes, folder: Path) -> Container:
    if len(data) < _GLB_HEADER.size:
        refuse(
            "the header of the .glb",
            f"needs 12 bytes and the file has {len(data)}",
            "export or download it again",
        )
    _, version, length = _GLB_HEADER.unpack(data[: _GLB_HEADER.size].tobytes())
    if version != 2:
        refuse("the header of the .glb", f"says version {version}", "export it as glTF 2.0")
    if length > len(data):
        refuse("the .glb", f"is cut short: {len(data)} of {length} bytes", "export or download it again")
    chunks: dict[bytes, Bytes] = {}
    offset = _GLB_HEADER.size
    for number in range(
        2
    ):  # JSON first, then at most one binary chunk; more are for extensions (glTF 2.0, 4.4.3)
        if offset + _CHUNK_HEADER.size > length:
            break
        size, kind = _CHUNK_HEADER.unpack(data[offset : offset + _CHUNK_HEADER.size].tobytes())
        offset += _CHUNK_HEADER.size
        if offset + size > length:
            refuse(
                f"chunk {number} of the .glb",
                f"is cut short: {length - offset} of {size} bytes",
                "export it again",
            )
        chunks.setdefault(kind, data[offset : offset + size])
        offset += size
    text = chunks.get(b"JSON")
    if text is None:
        refuse("the .glb", "has no JSON chunk", "export it again")
    _bound_json(len(text))
    return Container(folder, text, chunks.get(b"BIN\0"))


def _bound_json(size: int) -> None:
    if size > MAX_JSON_BYTES:
        refuse("the JSON", f"has {size} bytes, more than {MAX_JSON_BYTES}", "store its data in a .bin file")


def read_uri(uri: str, folder: Path, place: str, opened: Opened | None = None) -> Bytes:
    """Return the bytes that a URI of a buffer or image names: a data URI, or a file in `folder` or below it.

    `opened` is told each name under which a file is looked for, before it is.

    Raises:
        Refusal: the URI leaves the scene's folder, has another scheme, is badly coded, or names no readable
            file.
    """
    if uri[:5].lower() == "data:":
        return _read_data_uri(uri, place)
    advice = "put the file beside the scene and name it by a relative path"
    shown = uri if len(uri) <= 80 else uri[:77] + "..."
    if _SCHEME.match(uri):
        refuse(place, f"names {shown!r}, and only files in the scene's own folder are loaded", advice)
    # A name with a literal percent sign is stored as "%25" by careful exporters and as "%" by others.
    names = dict.fromkeys((unquote(uri), uri))
    for name in names:
        parts = name.replace("\\", "/").split("/")
        if name[:1] in ("/", "\\") or ".." in parts or _SCHEME.match(name):
            refuse(place, f"names {shown!r}, which is outside the scene's folder", advice)
    if opened is not None:
        for name in names:
            opened(name)
    paths = [folder / name for name in names]
    path = next((path for path in paths if _exists(path)), paths[0])
    if leads_outside(path, folder):
        refuse(place, f"names {shown!r}, a link that leads outside the scene's folder", advice)
    return map_file(path, place)


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _read_data_uri(uri: str, place: str) -> Bytes:
    header, comma, payload = uri.partition(",")
    if not comma:
        refuse(place, "is a data URI without a comma")
    if not payload.isascii():
        refuse(place, "is a data URI with characters that are not ASCII")
    if not header.lower().endswith(";base64"):
        return np.frombuffer(unquote_to_bytes(payload), np.uint8)
    try:
        coded = payload if "%" not in payload else unquote(payload)
        return np.frombuffer(base64.b64decode(coded, validate=True), np.uint8)
    except (binascii.Error, ValueError) as error:
        refuse(place, f"is not valid base64 ({error})")
