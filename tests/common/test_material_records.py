"""Material records: bytes by hand, every field read by shaders of both APIs, and files that come back as they were."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

import chapters
from common.errors import SceneError
from common.materials import records as records
from common.materials.records import (
    FIELDS,
    NO_TEXTURE,
    RECORD_DTYPE,
    SLOTS,
    MaterialList,
    from_bytes,
    new_records,
    read_material_file,
    to_bytes,
    write_material_file,
)
from tests.support.kernels import kernels_on

packed = pytest.mark.feature("materials/packed-record")

BY_HAND = struct.Struct("<4f4f4ffffI6Q")
"""Three colours, three numbers, the flags, six slots of 64 bits."""
MEMBERS = (
    *(f"floatBitsToUint(m.{name}.{part})" for name in ("emissive", "albedo", "roughness") for part in "xyzw"),
    *(f"floatBitsToUint(m.{name})" for name in ("opacity", "alpha_test", "metallic")),
    "m.flags",
    *(
        f"m.{name}_texture.{part}"
        for name in ("occlusion", "emissive", "albedo", "metallic_roughness", "normal", "opacity")
        for part in "xy"
    ),
    "uint(has_texture(m.occlusion_texture))",
    "uint(has_texture(m.opacity_texture))",
    "MATERIAL_CAST_SHADOW | MATERIAL_RECEIVE_SHADOW << 8 | MATERIAL_TRANSPARENT << 16 | MATERIAL_HEIGHT_MAP << 24",
)
NAMES = ("a.png", "textures/b.png", "", "größe/木材.png", "\udcff.png", "a b\n.png", "a.png")


def numbered(count: int) -> np.ndarray:
    """Records whose every number differs from every other one; slots use both of their words."""
    made = new_records(count)
    rng = np.random.default_rng(7)
    for field in FIELDS:
        shape = made[field.name].shape
        if field.type == "uvec2":
            made[field.name] = rng.integers(0, 2**64, shape, np.uint64)
        elif field.type == "uint":
            made[field.name] = rng.integers(0, 2**32, shape, np.uint32)
        else:
            made[field.name] = rng.standard_normal(shape)
    made["occlusion_texture"][0] = NO_TEXTURE
    made["opacity_texture"][1] = NO_TEXTURE + (1 << 32)  # a handle of OpenGL may have such a low word
    made["opacity_texture"][2] = 2**64 - 1  # a -1 of 64 bits is not the guard
    return made


def read_back(device, path, made: np.ndarray) -> np.ndarray:
    """Return (M, members) uint32 what a compute shader reads of the records on a device."""
    stores = "\n".join(
        f"    found[i * {len(MEMBERS)}u + {number}u] = {member};" for number, member in enumerate(MEMBERS)
    )
    path.write_text(
        "layout(local_size_x = 64) in;\n"
        + records.glsl()
        + "layout(BIND(0, 0, 0), std430) readonly buffer Materials { MaterialRecord materials[]; };\n"
        + "layout(BIND(0, 1, 1), std430) writeonly buffer Found { uint found[]; };\n"
        + "void main() {\n    uint i = gl_GlobalInvocationID.x;\n"
        + "    if (i >= uint(materials.length())) return;\n    MaterialRecord m = materials[i];\n"
        + f"{stores}\n}}\n"
    )
    target = np.zeros((len(made), len(MEMBERS)), np.uint32)
    with kernels_on(device, chapters.package_of(chapters.available()[-1])) as kernels:
        return kernels.run(kernels.pipeline(path), [made.view(np.uint32), target], (len(made), 1, 1))[1]


def check(found: np.ndarray, made: np.ndarray) -> None:
    words = [struct.unpack("<28I", BY_HAND.pack(*flat(record))) for record in made]
    assert np.array_equal(found[:, :28], words)
    assert found[:, 28].tolist() == [0] + [1] * (len(made) - 1)
    assert found[:, 29].tolist() == [1] * len(made)
    assert set(found[:, 30].tolist()) == {0x08040201}


def flat(record: np.void) -> list[float]:
    return [number for field in FIELDS for number in np.ravel(record[field.name]).tolist()]


@packed
def test_vulkan_reads_every_field_as_the_host_wrote_it(vulkan_device, tmp_path):
    made = numbered(70)
    check(read_back(vulkan_device, tmp_path / "read.comp", made), made)


@packed
def test_opengl_reads_every_field_as_the_host_wrote_it(gl_context, tmp_path):
    made = numbered(70)
    check(read_back(gl_context, tmp_path / "read.comp", made), made)


@packed
def test_the_record_is_112_bytes_in_the_order_of_the_table():
    assert RECORD_DTYPE.itemsize == BY_HAND.size == 112 == 7 * 16
    made = new_records(1)
    plain = (0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 1, 0, 0, 3, *[0xFFFFFFFF] * 6)
    assert made.tobytes() == BY_HAND.pack(*plain)
    for number, field in enumerate(FIELDS):
        made = np.zeros(1, RECORD_DTYPE)
        made[field.name] = 1
        ones = [0] * len(plain)
        first = (0, 4, 8, *range(12, 22))[number]
        ones[first : first + (4 if field.type == "vec4" else 1)] = [1] * (4 if field.type == "vec4" else 1)
        assert made.tobytes() == BY_HAND.pack(*ones), field.name
    assert list(SLOTS) == ["occlusion", "emissive", "albedo", "metallic_roughness", "normal", "opacity"]


def some() -> MaterialList:
    made = new_records(4)
    rng = np.random.default_rng(3)
    for name in ("emissive", "albedo", "roughness", "opacity", "alpha_test", "metallic"):
        made[name] = rng.random(made[name].shape)
    made["emissive"][0] = (1e30, -0.0, 5e-45, np.finfo(np.float32).max)
    made["flags"] = (0, 1, 7, 2**32 - 1)
    for column, name in enumerate(SLOTS.values()):
        made[name][1:] = (column, 6 - column, NO_TEXTURE)
    return MaterialList(made, NAMES)


@packed
def test_a_file_and_its_names_come_back_exactly(tmp_path):
    path = tmp_path / "äß.materials"
    write_material_file(path, some())
    back = read_material_file(path)
    assert back.textures == NAMES
    assert back.records.dtype == RECORD_DTYPE and back.records.tobytes() == some().records.tobytes()
    assert to_bytes(back) == path.read_bytes() and list(tmp_path.iterdir()) == [path]
    assert back.resolved()[1]["normal"] == NAMES[4] and set(back.resolved()[3].values()) == {""}
    empty = MaterialList(new_records(0))
    assert to_bytes(from_bytes(to_bytes(empty))) == to_bytes(empty) and len(to_bytes(empty)) == 32


@packed
def test_the_bytes_of_a_file_are_those_of_the_format():
    made = new_records(1)
    made["albedo_texture"] = 1
    data = to_bytes(MaterialList(made, ("ä", "b.png")))
    record = BY_HAND.pack(
        0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 0, 0, 1, 0, 0, 3, *[0xFFFFFFFF] * 2, 1, *[0xFFFFFFFF] * 3
    )
    names = b"\x02\0\0\0\xc3\xa4\x05\0\0\0b.png"
    head = b"STRATAMT" + struct.pack("<4I", 1, 1, 2, len(names))
    checksum = zlib.crc32(head + bytes(8) + record + names)
    assert data == head + struct.pack("<2I", checksum, 0) + record + names


DATA = to_bytes(some())


def changed(offset: int, value: int, kind: str = "<I", data: bytes = DATA) -> bytes:
    """Return bytes with another number and the checksum that fits."""
    made = bytearray(data)
    struct.pack_into(kind, made, offset, value)
    struct.pack_into("<I", made, 24, 0)
    struct.pack_into("<I", made, 24, zlib.crc32(made))
    return bytes(made)


@packed
@pytest.mark.parametrize(
    ("data", "fault"),
    [
        (b"", "is no material file of Strata"),
        (b"STRATABL" + DATA[8:], "is no material file of Strata"),
        (DATA[:5], "is cut short: 5 bytes"),
        (DATA[:31], "is cut short: 31 bytes"),
        (DATA[:-1], "and its header speaks of"),
        (DATA + b"\0", "and its header speaks of"),
        (changed(8, 2), "has version 2, and 1 is needed"),
        (changed(12, 2**32 - 1), "and its header speaks of 481036337"),
        (changed(16, 6), "are not 6 names"),
        (changed(16, 2**32 - 1), "are not 4294967295 names"),
        (changed(32 + 4 * 112, 6), "are not 7 names"),
        (changed(32 + 4 * 112, 2**32 - 1), "are not 7 names"),
        (changed(32 + 4 * 112 + 4, 0xFF, "<B"), "are not 7 names"),
        (DATA[:40] + b"\x01" + DATA[41:], "is damaged: its checksum"),
        (changed(32 + 112 + 64, 7, "<Q"), "material 1 has a slot for occlusion that names none of the 7"),
        (
            changed(32 + 112 + 104, 2**64 - 1, "<Q"),
            "material 1 has a slot for opacity that names none of the 7",
        ),
        (changed(32 + 112 + 80, 2**32, "<Q"), "material 1 has a slot for albedo that names none"),
        (changed(32 + 16, 0x7FC00000), "material 0 has no finite albedo"),
        (changed(32 + 224 + 48, 0x3F800001), "material 2 has a value of opacity outside 0 to 1"),
    ],
)
def test_what_is_no_whole_file_is_refused_in_a_sentence(tmp_path, data, fault):
    path = tmp_path / "a.materials"
    path.write_bytes(data)
    with pytest.raises(SceneError) as caught:
        read_material_file(path)
    text = str(caught.value)
    assert text.startswith(f"{path} ") and fault in text and "\n" not in text
    assert text.endswith("write it again, or name another file")


def test_no_byte_can_change_unseen():
    for offset in range(len(DATA)):
        with pytest.raises(SceneError):
            from_bytes(DATA[:offset] + bytes([DATA[offset] ^ 1]) + DATA[offset + 1 :])


@packed
def test_handles_and_widened_guards_are_not_written(tmp_path):
    """What is no place in the list of names means something to one run of one program alone."""
    for slot in (2**64 - 1, 1 << 40, 1):
        made = new_records(1)
        made["normal_texture"] = slot
        with pytest.raises(
            ValueError, match="material 0 has a slot for normal that names none of the 1 textures"
        ):
            write_material_file(tmp_path / "a", MaterialList(made, ("a.png",)))
        with pytest.raises(ValueError, match="material 0 has a slot for normal"):
            MaterialList(made, ("a.png",)).resolved()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(SceneError, match=r"b.materials cannot be written: No such file"):
        write_material_file(tmp_path / "a" / "b.materials", some())
    with pytest.raises(SceneError, match=r"b.materials cannot be read: No such file"):
        read_material_file(tmp_path / "b.materials")
