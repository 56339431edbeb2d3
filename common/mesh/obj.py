"""Wavefront OBJ files as scenes: polygons made triangles, one mesh per object and material, plain colours of an .mtl.

OBJ has no nodes, units or physical materials, so what it cannot say is chosen: metres, y up, and a roughness from the
Phong exponent. Curves, lines, points and textures are left out, and named in the scene's warnings.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from common.errors import SceneError
from common.gltf.container import map_file, read_uri
from common.gltf.geometry.completion import flat_normals, smooth_normals
from common.gltf.geometry.pools import Pools
from common.gltf.geometry.surface import Surface
from common.gltf.refusal import Refusal, refuse
from common.names import shortened, visible
from common.scene import NUMBER_LIMIT, Float32, Instances, Material, Nodes, Scene

MAX_BYTES = 2**30
"""Size of a file; what is larger takes minutes to parse as text."""

_WIDTHS = {"v": 3, "vt": 2, "vn": 3}
_IGNORED = {"s", "g", "mg", "vp", "shadow_obj", "trace_obj", "bevel", "c_interp", "d_interp", "lod"}


@dataclass
class _Part:
    """Triangles with one name and material: corners (3 T, 3) of places in v, vt and vn, -1 where there is none."""

    name: str
    material: str
    corners: list[tuple[int, int, int]] = field(default_factory=list)


@dataclass
class _File:
    arrays: dict[str, Float32]
    parts: list[_Part]
    libraries: list[tuple[int, str]]
    left_out: set[str]


def load_obj(path: str | os.PathLike[str]) -> Scene:
    """Load an OBJ file; polygons become fans of triangles, in the order of the file.

    Raises:
        SceneError: the file is missing, or a line of it cannot be used. One sentence with file, line, fault and advice.
    """
    path = Path(path)
    try:
        return _scene(path)
    except Refusal as refusal:
        raise SceneError(shortened(visible(f"{path}: {refusal}"))) from None


def _scene(path: Path) -> Scene:
    file = _parse(_text(map_file(path)))
    warnings = [f"Statements {', '.join(sorted(file.left_out))} were left out."] if file.left_out else []
    known = {"": Material(name="default", metallic=0.0)}
    for number, library in file.libraries:
        known |= _materials(path.parent, library, number, warnings)
    used = list(dict.fromkeys(part.material for part in file.parts if part.corners))
    for name in used:
        if name not in known:
            warnings.append(f"The material {name[:80]} is in no library and became the default.")
    pools = Pools()
    for part in file.parts:
        if part.corners:
            pools.add(_surface(file.arrays, np.array(part.corners)), used.index(part.material), part.name)
    count = len(pools.rows)
    root = Nodes(
        parent=np.full(1, -1, np.int32),
        translation=np.zeros((1, 3)),
        rotation=np.array([(0.0, 0.0, 0.0, 1.0)]),
        scale=np.ones((1, 3)),
        matrix=np.eye(4)[None],
        has_matrix=np.zeros(1, bool),
        names=[visible(path.stem)],
    )
    vertices: dict[str, Any] = pools.vertices()
    return Scene(
        name=visible(path.stem),
        path=path,
        **vertices,
        indices=pools.indices(),
        meshes=pools.meshes(),
        mesh_names=pools.names,
        materials=[known.get(name, known[""]) for name in used],
        images=[],
        nodes=root,
        instances=Instances(np.zeros(count, np.int32), np.arange(count, dtype=np.int32)),
        lights=[],
        cameras=[],
        animations=[],
        deformations=[],
        warnings=[visible(text) for text in warnings],
    )


def _text(data: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> str:
    if len(data) > MAX_BYTES:
        refuse("", f"has {len(data)} bytes, more than {MAX_BYTES}", "convert it to .glb")
    # Names may be in any old code page; everything that is read as a number is ASCII.
    return data.tobytes().decode("utf-8-sig", "replace")


def statements(text: str) -> Iterator[tuple[int, str, list[str]]]:
    """Yield (number, keyword, words) of lines that say something; a backslash at the end carries on with the next.

    The texts of .obj and .mtl files alike.
    """
    words: list[str] = []
    for number, line in enumerate(text.split("\n"), 1):
        content = line.partition("#")[0].rstrip()
        words = words + content.removesuffix("\\").split()
        if content.endswith("\\"):
            continue
        if words:
            yield number, words[0], words[1:]
            words = []


def _parse(text: str) -> _File:
    values: dict[str, list[list[str]]] = {name: [] for name in _WIDTHS}
    numbers: dict[str, list[int]] = {name: [] for name in _WIDTHS}
    parsed = _File({}, [], [], set())
    parts: dict[tuple[str, str], _Part] = {}
    name, material = "", ""
    for number, keyword, words in statements(text):
        if keyword in values:
            values[keyword].append(words)
            numbers[keyword].append(number)
        elif keyword == "f":
            part = parts.setdefault((name, material), _Part(name or f"mesh {len(parts)}", material))
            counts = (len(values["v"]), len(values["vt"]), len(values["vn"]))
            corners = [_corner(word, counts, number) for word in words]
            if len(corners) < 3:
                refuse(f"line {number}", f"is a face of {len(corners)} corners")
            for second in range(1, len(corners) - 1):
                part.corners += (corners[0], corners[second], corners[second + 1])
        elif keyword == "o":
            name = visible(" ".join(words))
        elif keyword == "usemtl":
            material = visible(" ".join(words))
        elif keyword == "mtllib":
            parsed.libraries.append((number, " ".join(words)))
        elif keyword not in _IGNORED:
            parsed.left_out.add(keyword[:20])
    if not any(values.values()) and not parsed.libraries and not parts and parsed.left_out:
        refuse("", "has no vertex and no face, so it is no OBJ file", "check the file")
    parsed.arrays = {key: _numbers(rows, numbers[key], _WIDTHS[key]) for key, rows in values.items()}
    parsed.parts = list(parts.values())
    return parsed


def _numbers(rows: list[list[str]], lines: list[int], width: int) -> Float32:
    """Return (N, width) float32; numbers beyond `width` (weights, colours) are not read, a missing v of vt is 0."""
    try:
        short = ["0"] if width == 2 else []
        values = np.array([row[:width] if len(row) >= width else row + short for row in rows], np.float64)
        values = values.reshape(len(rows), width)
        good = (np.abs(values) <= NUMBER_LIMIT).all(axis=1)  # a NaN is not
        if good.all():
            return values.astype(np.float32)
        place = int(np.argmin(good))
    except ValueError:
        place = next(index for index, row in enumerate(rows) if not _is_row(row, width))
    return refuse(f"line {lines[place]}", f"has no {width} finite numbers below 1e18")


def _is_row(row: Sequence[str], width: int) -> bool:
    try:
        return len([float(word) for word in row[:width]]) >= (1 if width == 2 else width)
    except ValueError:
        return False


def _corner(word: str, counts: tuple[int, int, int], line: int) -> tuple[int, int, int]:
    """Return the places in v, vt and vn of "v", "v/vt", "v//vn" or "v/vt/vn"; negative numbers count from the end."""

    def wrong() -> NoReturn:
        refuse(f"line {line}", f"has a face with the corner {word[:40]!r}, which names no vertex before it")

    places = []
    fields = word.split("/")
    if len(fields) > 3:
        wrong()
    for text, count in zip((*fields, "", "")[:3], counts, strict=True):
        if not text:
            places.append(-1)
            continue
        try:
            number = int(text)
        except ValueError:
            wrong()
        place = number - 1 if number > 0 else count + number
        if number == 0 or not 0 <= place < count:
            wrong()
        places.append(place)
    if places[0] < 0:
        wrong()
    return places[0], places[1], places[2]


def _surface(arrays: dict[str, Float32], corners: np.ndarray[tuple[int, int], np.dtype[np.int64]]) -> Surface:
    """Return a surface with one vertex per distinct corner, in the order of first use."""
    distinct, first, inverse = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.uint32)
    rank[order] = np.arange(len(order), dtype=np.uint32)
    distinct, indices = distinct[order], rank[inverse.reshape(-1)]
    uv = None
    if (distinct[:, 1] >= 0).any():
        uv = np.zeros((len(distinct), 2), np.float32)
        has = distinct[:, 1] >= 0
        uv[has] = arrays["vt"][distinct[has, 1]]
        uv[has, 1] = 1 - uv[has, 1]  # v runs up the picture in OBJ, down in glTF
    surface = Surface(arrays["v"][distinct[:, 0]], indices, uv0=uv)
    has = distinct[:, 2] >= 0
    if not has.any():
        surface = surface.take(indices, np.arange(len(indices), dtype=np.uint32))
        return replace(surface, normals=flat_normals(surface.positions))
    normals = np.zeros((len(distinct), 3), np.float32)
    normals[has] = arrays["vn"][distinct[has, 2]]
    usable = (np.abs(normals).max(axis=1) > 1e-15)[:, None]
    smooth = smooth_normals(surface.positions, surface.indices)
    return replace(surface, normals=np.where(usable, normals, smooth))


def _materials(folder: Path, name: str, line: int, warnings: list[str]) -> dict[str, Material]:
    """Return the materials of a library; one that is missing only costs its colours."""
    try:
        text = _text(read_uri(name, folder, f"line {line}"))
    except Refusal as refusal:
        warnings.append(f"The material library was not read: {refusal}")
        return {}
    materials: dict[str, Material] = {}
    current = ""
    skipped = set()
    for number, keyword, words in statements(text):
        if keyword == "newmtl":
            current = visible(" ".join(words))
            materials[current] = Material(name=current, metallic=0.0)
        elif keyword.startswith(("map_", "bump", "disp", "norm", "refl")):
            skipped.add(keyword[:20])
        elif current and keyword in ("Kd", "Ke", "d", "Tr", "Ns", "Pr", "Pm"):
            try:
                numbers = [min(max(float(word), 0.0), NUMBER_LIMIT) for word in words]
                materials[current] = _with(materials[current], keyword, numbers)
            except (ValueError, IndexError):
                warnings.append(
                    f"Line {number} of {name[:80]} has no numbers for {keyword} and was left out."
                )
    if skipped:
        warnings.append(f"Textures of {name[:80]} ({', '.join(sorted(skipped))}) were left out.")
    return materials


def _with(material: Material, keyword: str, numbers: list[float]) -> Material:
    """Return a material with one statement of an .mtl applied; `numbers` are not negative."""
    clamped = min(numbers[0], 1.0)
    if keyword == "Kd":
        red, green, blue = (min(value, 1.0) for value in numbers[:3])
        return replace(material, base_color=(red, green, blue, material.base_color[3]))
    if keyword == "Ke":
        return replace(material, emissive=(numbers[0], numbers[1], numbers[2]))
    if keyword in ("d", "Tr"):
        alpha = clamped if keyword == "d" else 1.0 - clamped
        mode = "blend" if alpha < 1.0 else "opaque"
        color = (*material.base_color[:3], alpha)
        return replace(material, base_color=color, alpha_mode=mode)  # type: ignore[arg-type]
    if keyword == "Pr":
        return replace(material, roughness=clamped)
    if keyword == "Pm":
        return replace(material, metallic=clamped)
    return replace(material, roughness=roughness_of_exponent(numbers[0]))


def roughness_of_exponent(exponent: float) -> float:
    """Return the roughness that a Phong exponent (Ns, at least 0) stands for.

    A Phong lobe of exponent n is about as wide as GGX of alpha = sqrt(2 / (n + 2)), and alpha = roughness^2 (Walter et
    al. 2007, section 5.2).
    """
    return float((2 / (exponent + 2)) ** 0.25)
