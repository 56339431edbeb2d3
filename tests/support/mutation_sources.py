"""The files that are mutated: generated ones that are always here, and real models where `STRATA_ASSETS` has them."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import numpy as np

import assets
from common.errors import UnsupportedError
from common.images import write_image
from common.paths import asset_dir, temporary_folder
from tests.common.gltf.builder import everything, pack_glb

MAX_MODEL_BYTES = 1 << 20
"""Models with more bytes are left out: a copy of each mutation is written, and small files reach the same code."""


@dataclass(frozen=True)
class Source:
    """Files of one scene by name; `main` is the one that is opened."""

    main: str
    files: dict[str, bytes]


def _everything(form: str) -> Source:
    gltf = everything()
    if form == "glb":
        return Source("scene.glb", {"scene.glb": gltf.glb()})
    with temporary_folder() as folder:
        gltf.write(folder, form)
        return _read(folder / "scene.gltf")


def _pictures() -> Source:
    """The file with everything, its pictures beside it: names of files to go wrong."""
    gltf = everything()
    files = {}
    for number, entry in enumerate(gltf.json["images"]):
        view = gltf.json["bufferViews"][entry.pop("bufferView")]
        name = f"picture {number}.{entry.pop('mimeType').removeprefix('image/')}"
        files[name] = bytes(gltf.data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
        entry |= {"name": f"picture {number}", "uri": name.replace(" ", "%20")}
    gltf.json["buffers"] = [{"byteLength": len(gltf.data), "uri": "scene.bin"}]
    return Source("scene.gltf", {"scene.gltf": gltf.text().encode(), "scene.bin": bytes(gltf.data), **files})


def _read(main: Path) -> Source:
    """Return a scene with the files that its document names."""
    document, _ = split(main.read_bytes())
    names = [
        unquote(entry["uri"])
        for kind in ("buffers", "images")
        for entry in document.get(kind) or []
        if not entry.get("uri", "data:").startswith("data:")
    ]
    return Source(main.name, {name: (main.parent / name).read_bytes() for name in [main.name, *names]})


OBJ = """\
mtllib room.mtl
o floor
v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v 0 1.5 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 1 0
usemtl stone
f 1/1/1 2/2/1 3/3/1 4/4/1
usemtl glass
s off
f -5//1 -4//1 -1//1
f 2 3 5
"""

MTL = """\
newmtl stone
Kd 0.6 0.5 0.4
Ks 0.04 0.04 0.04
Ns 30
map_Kd stone.png
newmtl glass
Kd 0.1 0.2 0.9
d 0.3
Ke 2 2 1
"""


def _obj() -> Source:
    return Source("room.obj", {"room.obj": OBJ.encode(), "room.mtl": MTL.encode()})


def _panorama(suffix: str) -> Source:
    pixels = np.random.default_rng(1).random((16, 32, 3), np.float32) * 100
    with temporary_folder() as folder:
        path = folder / f"sky{suffix}"
        write_image(path, pixels)
        return Source(path.name, {path.name: path.read_bytes()})


GENERATED: dict[str, Callable[[], Source]] = {
    "everything.glb": lambda: _everything("glb"),
    "everything.gltf": lambda: _everything("gltf"),
    "everything.data": lambda: _everything("data"),
    "pictures": _pictures,
    "cornell": lambda: _read(assets.locate("cornell")),
    "spheres": lambda: _read(assets.locate("spheres")),
    "cloth": lambda: _read(assets.locate("cloth")),
    "atrium": lambda: _read(assets.locate("atrium")),
    "room.obj": _obj,
    "sky.hdr": lambda: _panorama(".hdr"),
    "sky.exr": lambda: _panorama(".exr"),
}

WEIGHTS = {
    "everything.glb": 16,
    "everything.gltf": 10,
    "everything.data": 4,
    "pictures": 10,
    "cornell": 6,
    "spheres": 4,
    "cloth": 6,
    "atrium": 1,
    "room.obj": 5,
    "sky.hdr": 2,
    "sky.exr": 1,
}
"""How often a file is drawn, against 1 for each model made elsewhere."""


@cache
def load(name: str) -> Source:
    """Return a source by its name; raises FileNotFoundError for a model that is not here."""
    if name in GENERATED:
        return GENERATED[name]()
    folder = asset_dir()
    if folder is None:
        raise FileNotFoundError(
            f"{name} is a model made elsewhere: STRATA_ASSETS names the folder that has it."
        )
    return _read(_main(folder / "models" / name))


def _main(folder: Path) -> Path:
    return next(path for path in sorted(folder.iterdir()) if path.suffix in (".gltf", ".glb"))


@cache
def names() -> dict[str, int]:
    """Return the names of all sources that are here, each with its weight."""
    weights = dict(WEIGHTS)
    try:
        load("sky.exr")
    except UnsupportedError:  # the package that writes EXR is optional
        del weights["sky.exr"]
    folder = asset_dir()
    for model in sorted((folder / "models").iterdir()) if folder else []:
        if sum(path.stat().st_size for path in model.rglob("*") if path.is_file()) <= MAX_MODEL_BYTES:
            weights[model.name] = 1
    return weights


def is_gltf(name: str) -> bool:
    """Whether a source is a glTF model: neither Wavefront nor a panorama."""
    return name not in ("room.obj", "sky.hdr", "sky.exr")


def split(data: bytes) -> tuple[dict, bytes | None]:
    """Return the document and the binary chunk of a whole .gltf or .glb file."""
    if data[:4] != b"glTF":
        return json.loads(data), None
    (size,) = struct.unpack_from("<I", data, 12)
    chunk = data[28 + size :] if len(data) > 28 + size else None
    return json.loads(data[20 : 20 + size]), chunk


def join(text: bytes, chunk: bytes | None, binary: bool) -> bytes:
    """Return the file of a document's text: a .glb with its chunk if `binary`, else the text."""
    return pack_glb(text, chunk or b"") if binary else text
