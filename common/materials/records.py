"""Material records of 112 bytes that the host, Vulkan and OpenGL read alike, and the file of a list of them.

One table gives the numpy dtype and the GLSL struct, so that they cannot disagree; the order of the fields is that of
the material description in the 3D Graphics Rendering Cookbook, chapter 7. A slot for a texture has 64 bits, since
OpenGL may keep a bindless handle in it and Vulkan an index into one array. Shaders read it as a uvec2, low word first:
the bytes are those of a 64-bit integer, no device has to have such integers, and OpenGL makes a sampler of just that.

Two words that are often taken for each other have one meaning each:

    opacity     1 is opaque and 0 is invisible: what a blended surface's colour is multiplied with. Never the opposite.
    alpha_test  fragments whose alpha, that of the albedo colour times its texture, is below it are discarded; 0 is no
                test. The opacity is no part of that alpha.

An empty slot holds NO_TEXTURE, 32 ones, in all 64 bits of it: a -1 that is widened to 64 bits has 32 ones more, passes
a comparison with the guard, and reads a texture that is not there. Such a slot is refused here as any other number is
that names no texture of the list.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError
from common.mesh.file import read_bytes
from common.paths import write_whole

NO_TEXTURE = 0xFFFFFFFF
"""The content of an empty slot."""

MATERIAL_CAST_SHADOW = 1
MATERIAL_RECEIVE_SHADOW = 2
MATERIAL_TRANSPARENT = 4  # its opacity is below 1
MATERIAL_HEIGHT_MAP = 8  # the texture in the slot for normals holds heights

FLAGS = {name: value for name, value in globals().items() if name.startswith("MATERIAL_")}
"""The bits of `flags`, by the name that both languages use."""


@dataclass(frozen=True)
class RecordField:
    """One field of a record: its GLSL type, its name, what a new record has in it, and what it means."""

    type: str
    name: str
    default: Any
    doc: str


FIELDS = (
    RecordField("vec4", "emissive", (0, 0, 0, 0), "rgb: light that it gives off, linear"),
    RecordField("vec4", "albedo", (1, 1, 1, 1), "rgb: linear colour; a: alpha, times that of its texture"),
    RecordField(
        "vec4", "roughness", (1, 1, 0, 0), "x, y: along tangent and bitangent, equal unless anisotropic"
    ),
    RecordField("float", "opacity", 1, "1 is opaque, 0 is invisible"),
    RecordField("float", "alpha_test", 0, "a smaller alpha is discarded; 0 is no test"),
    RecordField("float", "metallic", 0, "1 is a metal"),
    RecordField("uint", "flags", MATERIAL_CAST_SHADOW | MATERIAL_RECEIVE_SHADOW, "bit mask, MATERIAL_*"),
    RecordField("uvec2", "occlusion_texture", NO_TEXTURE, "r: ambient occlusion"),
    RecordField("uvec2", "emissive_texture", NO_TEXTURE, "rgb: factor of emissive"),
    RecordField("uvec2", "albedo_texture", NO_TEXTURE, "rgba: factor of albedo"),
    RecordField("uvec2", "metallic_roughness_texture", NO_TEXTURE, "g: roughness, b: metallic, as in glTF"),
    RecordField("uvec2", "normal_texture", NO_TEXTURE, "rgb: normal, or heights with MATERIAL_HEIGHT_MAP"),
    RecordField(
        "uvec2", "opacity_texture", NO_TEXTURE, "for converters: it goes into the alpha of the albedo"
    ),
)
"""The fields in the order of their bytes. Each begins at a multiple of its alignment, so std430 pads nothing."""

_NUMPY: dict[str, tuple[Any, ...]] = {
    "vec4": ("<f4", 4),
    "float": ("<f4",),
    "uint": ("<u4",),
    "uvec2": ("<u8",),
}
RECORD_DTYPE = np.dtype([(field.name, *_NUMPY[field.type]) for field in FIELDS])

SLOTS = {
    field.name.removesuffix("_texture"): field.name for field in FIELDS if field.name.endswith("_texture")
}
"""The field of each role that a texture may have, in the order of their bytes."""

MAGIC = b"STRATAMT"
VERSION = 1
HEADER = struct.Struct("<8s6I")
"""Magic, version, count of materials, count of names, bytes of names, CRC-32 of the file with 0 in its place, 0."""
_CHECKSUM_AT = 24


@dataclass(frozen=True, eq=False)
class MaterialList:
    """Materials and the textures that they name: `records` (M,) RECORD_DTYPE, whose slots are places in `textures`.

    An empty name means no texture, as an empty slot does.
    """

    records: np.ndarray
    textures: tuple[str, ...] = ()

    def resolved(self) -> list[dict[str, str]]:
        """Return the file name in each slot of each material by its role, "" where there is none.

        Raises ValueError where a slot is no place in the list.
        """
        if fault := fault_of(self.records, len(self.textures)):
            raise ValueError(fault)
        names = [record[list(SLOTS.values())].item() for record in self.records]
        return [
            {
                role: "" if slot == NO_TEXTURE else self.textures[slot]
                for role, slot in zip(SLOTS, slots, strict=True)
            }
            for slots in names
        ]


def new_records(count: int) -> np.ndarray:
    """Return (count,) RECORD_DTYPE of white, rough, opaque materials without textures that cast and take shadows."""
    records = np.zeros(count, RECORD_DTYPE)
    for field in FIELDS:
        records[field.name] = field.default
    return records


def glsl() -> str:
    """Return GLSL: struct MaterialRecord, its constants, and has_texture(slot).

    It is for a storage block of layout std430, in which an array of them has a stride of 112 bytes.
    """
    members = "".join(f"    {field.type} {field.name};  // {field.doc}\n" for field in FIELDS)
    flags = "".join(f"const uint {name} = {value}u;\n" for name, value in FLAGS.items())
    return (
        f"struct MaterialRecord {{\n{members}}};\n"
        f"{flags}"
        f"const uvec2 NO_TEXTURE = uvec2({NO_TEXTURE:#x}u, 0u);\n"
        "bool has_texture(uvec2 slot) { return slot != NO_TEXTURE; }\n"
    )


def fault_of(records: np.ndarray, texture_count: int) -> str:
    """Return what is wrong with records whose textures are `texture_count`, or ""."""
    floats = [field.name for field in FIELDS if field.type in ("float", "vec4")]
    checks: list[tuple[NDArray[np.bool_], str]] = [
        (~np.isfinite(records[name]).all(axis=tuple(range(1, records[name].ndim))), f"has no finite {name}")
        for name in floats
    ]
    for name in ("opacity", "alpha_test", "metallic"):
        value = records[name]
        checks.append((~((value >= 0) & (value <= 1)), f"has a value of {name} outside 0 to 1"))
    for role, name in SLOTS.items():
        wrong = (records[name] != NO_TEXTURE) & (records[name] >= texture_count)
        checks.append((wrong, f"has a slot for {role} that names none of the {texture_count} textures"))
    for wrong, fault in checks:
        if wrong.any():
            return f"material {int(np.argmax(wrong))} {fault}"
    return ""


# --- the file ---


def to_bytes(materials: MaterialList) -> bytes:
    """Return the bytes of a file: header, records, then each name as its length and its UTF-8.

    Equal lists give equal bytes. Raises ValueError where a record is wrong: a list from `read_material_file`,
    `import_materials` or `merged` has none such, one whose slots hold handles of OpenGL has.
    """
    if fault := fault_of(materials.records, len(materials.textures)):
        raise ValueError(fault)
    # File names that are no UTF-8 come from the system with lone surrogates, and are to come back as they were.
    coded = [name.encode("utf-8", "surrogatepass") for name in materials.textures]
    names = b"".join(struct.pack("<I", len(text)) + text for text in coded)
    body = materials.records.astype(RECORD_DTYPE, copy=False).tobytes() + names
    counts = (VERSION, len(materials.records), len(coded), len(names))
    checksum = zlib.crc32(body, zlib.crc32(HEADER.pack(MAGIC, *counts, 0, 0)))
    return HEADER.pack(MAGIC, *counts, checksum, 0) + body


def from_bytes(data: bytes, name: str = "the material file") -> MaterialList:
    """Return the list in the bytes of a file; `name` begins the sentence of an error.

    Raises:
        SceneError: the bytes are no material file, are cut short or damaged, or a slot names no texture.
    """

    def refused(fault: str) -> SceneError:
        return SceneError(f"{name} {fault}: write it again, or name another file")

    if data[: len(MAGIC)] != MAGIC[: len(data)] or not data:
        raise refused("is no material file of Strata")
    if len(data) < HEADER.size:
        raise refused(f"is cut short: {len(data)} bytes, fewer than the {HEADER.size} of its header")
    _, version, count, name_count, name_bytes, checksum, _ = HEADER.unpack_from(data)
    if version != VERSION:
        raise refused(f"has version {version}, and {VERSION} is needed")
    end = HEADER.size + count * RECORD_DTYPE.itemsize
    if len(data) != end + name_bytes:
        raise refused(f"has {len(data)} bytes, and its header speaks of {end + name_bytes}")
    whole = bytearray(data)
    whole[_CHECKSUM_AT : _CHECKSUM_AT + 4] = bytes(4)
    if zlib.crc32(whole) != checksum:
        raise refused("is damaged: its checksum is not that of its bytes")
    names = _names(data[end:], name_count)
    if names is None:
        raise refused(f"is damaged: its last {name_bytes} bytes are not {name_count} names")
    records = np.frombuffer(data, RECORD_DTYPE, count, HEADER.size)
    if fault := fault_of(records, name_count):
        raise refused(f"is damaged: {fault}")
    return MaterialList(records, names)


def _names(data: bytes, count: int) -> tuple[str, ...] | None:
    """Return `count` names that fill `data` to its end, or None."""
    names, at = list[str](), 0
    while at + 4 <= len(data) and len(names) < count:
        (length,) = struct.unpack_from("<I", data, at)
        if at + 4 + length > len(data):
            return None
        try:
            names.append(data[at + 4 : at + 4 + length].decode("utf-8", "surrogatepass"))
        except UnicodeDecodeError:
            return None
        at += 4 + length
    return tuple(names) if at == len(data) and len(names) == count else None


def write_material_file(path: str | os.PathLike[str], materials: MaterialList) -> None:
    """Write a list of materials; a reader sees the old file or the new one, never a part.

    Raises SceneError where the file cannot be written, ValueError as `to_bytes` does.
    """
    try:
        write_whole(Path(path), to_bytes(materials))
    except OSError as error:
        raise SceneError(f"{path} cannot be written: {error.strerror or error}") from None


def read_material_file(path: str | os.PathLike[str]) -> MaterialList:
    """Return the list in a file, checked so that no slot leads outside it.

    Raises:
        SceneError: the file cannot be read, or as `from_bytes` does.
    """
    return from_bytes(read_bytes(path), str(path))


def slots_of(records: np.ndarray) -> NDArray[np.uint64]:
    """Return the slots (M, 6) of records, by the order of `SLOTS`; a copy."""
    return np.stack([records[name] for name in SLOTS.values()], axis=1)


def with_slots(records: np.ndarray, slots: NDArray[np.uint64] | Sequence[Sequence[int]]) -> np.ndarray:
    """Return records with other slots (M, 6)."""
    changed = records.copy()
    for column, name in enumerate(SLOTS.values()):
        changed[name] = np.asarray(slots, np.uint64).reshape(-1, len(SLOTS))[:, column]
    return changed
