"""Materials of other programs as material records: what an asset file says, and what only its names say.

Every format has its own words for how much is seen through a surface: opacity or dissolve, where 1 is opaque, and
transparency, as a number or a colour, where 0 is. All of them become the one `opacity` of a record, 1 for opaque, by
`opacity_of`, and nothing behind it turns the number round again. The importer of the 3D Graphics Rendering Cookbook
(chapter 7), whose table of fields this follows, stores 1 - opacity under a name that its renderer multiplies alpha
with, so that opaque surfaces vanish; and it snaps a *transparency* of 95 % to 0, so that what hardly shows is solid.

What a file leaves unsaid its author has often put into a name, as in "Bottle_Glass_Green": see `RULES`.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from common.errors import SceneError
from common.materials.merge import TextureNames
from common.materials.records import MATERIAL_HEIGHT_MAP, MATERIAL_TRANSPARENT, MaterialList, new_records
from common.mesh.file import read_bytes
from common.mesh.obj import roughness_of_exponent, statements
from common.names import visible

OPAQUE_FROM = 0.95
"""An opacity from here on is 1: exporters round, and a blended surface costs sorting, overdraw and its place in the
depth pre-pass, for 5 % that are invisible."""

MASKED = 0.5
"""The alpha test of a material that has a map of opacity, or a colour of transparency."""

LARGEST = float(np.finfo(np.float32).max) / 2
"""What is larger may be infinite as float32, or when it is added to another one."""

ROLES = ("occlusion", "emissive", "diffuse", "metallic_roughness", "normals", "height", "opacity")
"""What a source material may have a texture for."""


@dataclass(frozen=True)
class SourceMaterial:
    """A material as an asset file describes it. What is None the file does not say.

    Colours are linear, (3,) or (4,) numbers. `opacity` is 1 for opaque; `transparency` is the colour of what comes
    through from behind, black for opaque. `textures` are file names by role (`ROLES`), none or "" where there is none.
    """

    name: str = ""
    ambient: Sequence[float] | None = None
    diffuse: Sequence[float] | None = None
    emissive: Sequence[float] | None = None
    opacity: float | None = None
    transparency: Sequence[float] | None = None
    metallic: float | None = None
    roughness: float | None = None
    textures: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Rule:
    """What a word in a name stands for: a threshold of alpha in any case, the rest where the file does not say it."""

    alpha_test: float | None = None
    opacity: float | None = None
    metallic: float | None = None
    roughness: float | None = None


RULES = {
    "glass": Rule(alpha_test=0.75, opacity=0.1),
    "bottle": Rule(alpha_test=0.54, opacity=0.4),
    "metal": Rule(metallic=1.0, roughness=0.1),
}
"""By word of a material's name. Of several the later one is followed: "GlassBottle" is a bottle."""

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words_of(name: str) -> set[str]:
    """Return the words in a name in small letters, plurals without their s too: of "GreenBottles01" green and bottle.

    Words and not parts of them: fibreglass is not seen through.
    """
    words = {word.lower() for word in _WORD.findall(name)}
    return words | {word.removesuffix("s") for word in words} | {word.removesuffix("es") for word in words}


def opacity_of(source: SourceMaterial) -> float:
    """Return the opacity of a record, from 0 for invisible to 1 for opaque.

    It is the opacity that the file states. Where it states none, it is 1 minus the largest component of the colour of
    transparency: formats that have both derive one from the other, and what counted twice would be too clear. Where
    there is neither the name decides, and else it is 1. From `OPAQUE_FROM` on it is 1, by whatever way it was stated.
    """
    if source.opacity is not None:
        opacity = float(source.opacity)
    elif source.transparency is not None:
        opacity = 1.0 - max(source.transparency[:3])
    else:
        opacity = next((rule.opacity for rule in _rules(source) if rule.opacity is not None), 1.0)
    # As float32, in which most files have it: 0.95 is a little less there.
    return 1.0 if np.float32(opacity) >= np.float32(OPAQUE_FROM) else max(opacity, 0.0)


def _rules(source: SourceMaterial) -> list[Rule]:
    """Return what the name stands for, the rule to follow first."""
    words = words_of(source.name)
    return [rule for word, rule in reversed(RULES.items()) if word in words]


def import_materials(sources: Iterable[SourceMaterial]) -> MaterialList:
    """Return the records of materials, and the textures that they name, each once.

    | record         | from                                                                                       |
    |----------------|--------------------------------------------------------------------------------------------|
    | emissive       | ambient plus emissive, component by component; its alpha at most 1                         |
    | albedo         | diffuse; its alpha at most 1                                                               |
    | roughness      | x and y the roughness                                                                      |
    | metallic       | metallic                                                                                   |
    | opacity        | `opacity_of`; MATERIAL_TRANSPARENT is set where it is below 1                              |
    | alpha_test     | that of the name; else 0.5 with an opacity map, or a transparency that is not opaque; else 0 |
    | normal slot    | normals, else height, and then MATERIAL_HEIGHT_MAP says so                                 |
    | opacity slot   | opacity, in the same list of names as all others, so that merging cannot forget it         |

    Each clamp is of the field that it is for: the book's third one writes to another.

    Raises:
        SceneError: a number of a material is not finite, or it has a texture of an unknown role.
    """
    sources = list(sources)
    names = TextureNames()
    records = new_records(len(sources))
    for number, source in enumerate(sources):
        _check(source, number)
        _fill(records[number], source, names)
    return MaterialList(records, tuple(names))


def _fill(record: np.void, source: SourceMaterial, names: TextureNames) -> None:
    rules = _rules(source)
    ambient, emissive = _rgba(source.ambient, (0, 0, 0, 0)), _rgba(source.emissive, (0, 0, 0, 0))
    record["emissive"] = _alpha_at_most_1([a + e for a, e in zip(ambient, emissive, strict=True)])
    record["albedo"] = _alpha_at_most_1(_rgba(source.diffuse, (1, 1, 1, 1)))
    roughness = _stated(source.roughness, [rule.roughness for rule in rules], 1.0)
    record["roughness"] = (roughness, roughness, 0, 0)
    record["metallic"] = _stated(source.metallic, [rule.metallic for rule in rules], 0.0)
    opacity = opacity_of(source)
    record["opacity"] = opacity
    if opacity < 1.0:
        record["flags"] |= MATERIAL_TRANSPARENT

    textures = source.textures
    masked = bool(textures.get("opacity")) or (source.transparency is not None and opacity < 1.0)
    by_name = [rule.alpha_test for rule in rules if rule.alpha_test is not None]
    record["alpha_test"] = by_name[0] if by_name else MASKED if masked else 0.0
    normals = textures.get("normals", "")
    if not normals and textures.get("height"):
        record["flags"] |= MATERIAL_HEIGHT_MAP
    # In the order of the slots, which is that in which new names are numbered.
    record["occlusion_texture"] = names.add(textures.get("occlusion", ""))
    record["emissive_texture"] = names.add(textures.get("emissive", ""))
    record["albedo_texture"] = names.add(textures.get("diffuse", ""))
    record["metallic_roughness_texture"] = names.add(textures.get("metallic_roughness", ""))
    record["normal_texture"] = names.add(normals or textures.get("height", ""))
    record["opacity_texture"] = names.add(textures.get("opacity", ""))


def _rgba(color: Sequence[float] | None, default: Sequence[float]) -> list[float]:
    """Return a colour with its alpha, which is 1 where it has three components."""
    return list(default) if color is None else [*map(float, color), 1.0][:4]


def _alpha_at_most_1(color: Sequence[float]) -> tuple[float, ...]:
    return (*color[:3], min(color[3], 1.0))


def _stated(stated: float | None, by_name: Sequence[float | None], default: float) -> float:
    """Return what is stated, else what the name says, else the default; within 0 to 1."""
    stated_values = (value for value in (stated, *by_name, default) if value is not None)
    return min(max(float(next(stated_values)), 0.0), 1.0)


def _check(source: SourceMaterial, number: int) -> None:
    what = f"material {number}" + (f" ({source.name[:80]})" if source.name else "")
    for name in ("ambient", "diffuse", "emissive", "transparency"):
        color = getattr(source, name)
        if color is not None and (len(color) not in (3, 4) or not all(abs(c) <= LARGEST for c in color)):
            raise SceneError(f"{what} has no three or four finite numbers as its {name} colour: correct them")
    for name in ("opacity", "metallic", "roughness"):
        value = getattr(source, name)
        if value is not None and not math.isfinite(value):
            raise SceneError(f"{what} has a number that is not finite as its {name}: correct it")
    if unknown := set(source.textures) - set(ROLES):
        raise SceneError(
            f"{what} has a texture as its {sorted(unknown)[0]!r}, which is none of {', '.join(ROLES)}"
        )


# --- Wavefront .mtl ---

_MAPS = {
    "map_ke": "emissive",
    "map_kd": "diffuse",
    "norm": "normals",
    "map_kn": "normals",
    "bump": "height",
    "map_bump": "height",
    "map_d": "opacity",
}
_OPTIONS = {"-blendu", "-blendv", "-boost", "-texres", "-clamp", "-bm", "-imfchan", "-type", "-cc"}
"""Options of a map with one argument."""
_VECTORS = {"-o", "-s", "-t"}
"""Those with one to three numbers; -mm has two."""


def read_mtl(path: str | os.PathLike[str]) -> tuple[list[SourceMaterial], list[str]]:
    """Return the materials of a Wavefront library, and in sentences what of it was left out.

    Raises SceneError: the file cannot be read, or has no material.
    """
    text = read_bytes(path).decode("utf-8-sig", "replace")  # names may be in any old code page
    materials, warnings = parse_mtl(text, Path(path).name)
    if not materials:
        raise SceneError(f"{path} has no material: name a library, a text with newmtl in it")
    return materials, warnings


def parse_mtl(text: str, name: str = "the library") -> tuple[list[SourceMaterial], list[str]]:
    """Return the materials in the text of a library called `name`, and in sentences what of it was left out.

    d is the opacity, Tr is 1 - d. Ka is left out: it is how much of a viewer's ambient light a surface reflects, is 1
    in most files, and as emission everything would glow. So is Tf, the colour of what passes, which is 1 1 1 for opaque
    materials too.
    """
    materials: list[SourceMaterial] = []
    left_out: set[str] = set()
    warnings: list[str] = []
    for line, keyword, words in statements(text):
        role = _MAPS.get(keyword.lower(), "")
        if keyword == "newmtl":
            materials.append(SourceMaterial(visible(" ".join(words))))
        elif not materials:
            continue
        elif role:
            file = map_name(words)
            if file:
                materials[-1] = replace(materials[-1], textures={**materials[-1].textures, role: file})
            else:
                warnings.append(f"Line {line} of {name[:80]} names no file for {keyword} and was left out.")
        elif keyword.lower().startswith("map_") or keyword in ("disp", "decal", "refl"):
            left_out.add(keyword[:20])
        elif keyword in ("Kd", "Ke", "d", "Tr", "Ns", "Pr", "Pm"):
            try:
                materials[-1] = _with(materials[-1], keyword, [float(word) for word in words])
            except (ValueError, IndexError):
                warnings.append(f"Line {line} of {name[:80]} has no numbers for {keyword} and was left out.")
    if left_out:
        warnings.append(f"Textures of {name[:80]} ({', '.join(sorted(left_out))}) were left out.")
    return materials, [visible(text) for text in warnings]


def _with(source: SourceMaterial, keyword: str, numbers: list[float]) -> SourceMaterial:
    if not all(abs(number) <= LARGEST for number in numbers):  # nor is one that is none
        raise ValueError
    if keyword in ("Kd", "Ke"):
        red, green, blue = (max(value, 0.0) for value in numbers[:3])
        color = (red, green, blue)
        return replace(source, diffuse=color) if keyword == "Kd" else replace(source, emissive=color)
    if keyword == "Ns":
        return replace(source, roughness=roughness_of_exponent(max(numbers[0], 0.0)))
    if keyword == "Pr":
        return replace(source, roughness=numbers[0])
    if keyword == "Pm":
        return replace(source, metallic=numbers[0])
    return replace(source, opacity=1.0 - numbers[0] if keyword == "Tr" else numbers[0])


def map_name(words: Sequence[str]) -> str:
    """Return the file that the words of a map statement name, behind its options; "" for none."""
    rest = list(words)
    while rest and rest[0] in {*_OPTIONS, *_VECTORS, "-mm"}:
        option = rest.pop(0)
        most = 3 if option in _VECTORS else 2 if option == "-mm" else 1
        taken = 0
        while rest and taken < most and (option in _OPTIONS or _is_number(rest[0])):
            rest.pop(0)
            taken += 1
    return " ".join(rest).replace("\\", "/")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
