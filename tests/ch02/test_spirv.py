"""The SPIR-V parser: what declarations become, where members of blocks lie, and what becomes of damaged bytes."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest

from backends import shader_text
from backends.vulkan.shaders.compiler import compile_shader
from chapters.ch02.pipelines.spirv.declared import mismatch
from chapters.ch02.pipelines.spirv.parser import parse
from chapters.ch02.pipelines.spirv.words import SpirvError, instructions, words_of
from common import layouts
from common.errors import ShaderError
from tests.support.timing import least_time, timed

parser = pytest.mark.feature("reflection/spirv-parser")


def compiled(text, stage="comp", extensions=()):
    return compile_shader(shader_text.build_text(text, stage, "vulkan", extensions=extensions))


def reflected(text, stage="comp", extensions=(), specialization=None):
    return parse(compiled(text, stage, extensions), specialization)


# --- a module assembled by hand: nothing but the specification stands behind it ---


def instruction(opcode, *operands):
    return [(len(operands) + 1) << 16 | opcode, *operands]


def text_words(text):
    raw = text.encode() + b"\0"
    raw += b"\0" * (-len(raw) % 4)
    return struct.unpack(f"<{len(raw) // 4}I", raw)


def assembled(*parts, bound=100, magic=0x07230203, order="<"):
    words = [magic, 0x00010600, 0, bound, 0, *(word for part in parts for word in part)]
    return struct.pack(f"{order}{len(words)}I", *words)


ENTRY = instruction(15, 5, 1, *text_words("main"))  # OpEntryPoint GLCompute %1 "main"
SAMPLED = (
    instruction(22, 10, 32),  # %10 = OpTypeFloat 32
    instruction(25, 11, 10, 1, 0, 0, 0, 1, 0),  # %11 = OpTypeImage %10 2D, sampled
    instruction(27, 12, 11),  # %12 = OpTypeSampledImage %11
    instruction(32, 13, 0, 12),  # %13 = OpTypePointer UniformConstant %12
    instruction(59, 13, 14, 0),  # %14 = OpVariable %13 UniformConstant
)
MARKS = (
    instruction(5, 14, *text_words("map")),
    instruction(71, 14, 34, 3),  # OpDecorate %14 DescriptorSet 3
    instruction(71, 14, 33, 7),  # OpDecorate %14 Binding 7
)


@parser
@pytest.mark.parametrize("order", "<>")
def test_a_module_by_hand_in_either_byte_order(order):
    module = parse(assembled(ENTRY, *MARKS, *SAMPLED, order=order))
    (entry,), (found,) = module.entries, module.resources
    assert (entry.stage, entry.name, entry.local_size) == ("comp", "main", None)
    assert (found.set, found.binding, found.kind, found.count, found.name, found.type) == (
        3,
        7,
        "texture",
        1,
        "map",
        "sampler2D",
    )
    assert (module.version, module.bound) == ((1, 6), 100)


@parser
def test_decorations_come_before_what_they_decorate_or_behind():
    assert parse(assembled(ENTRY, *MARKS, *SAMPLED)) == parse(assembled(*SAMPLED, *MARKS, ENTRY))


BAD = {
    "empty": (b"", "begins with 5 words, and here are only 0"),
    "not words": (assembled(ENTRY)[:-1], "bytes are no whole number of them"),
    "header alone, cut": (assembled()[:16], "begins with 5 words, and here are only 4"),
    "magic": (assembled(ENTRY, magic=0x07230204), "begins with 0x07230204 in place of 0x07230203"),
    "text": (b"#version 450\nvoid main() {}\n", "This is no SPIR-V"),
    "cut": (assembled(ENTRY, *MARKS, *SAMPLED)[:-4], "is cut off: the instruction at word"),
    "cut in a function": (assembled(ENTRY, instruction(54, 2, 3, 0, 4), [5 << 16 | 61, 1]), "is cut off"),
    "no words": (assembled(ENTRY, [0, 0]), "at word 10 of the SPIR-V says that it has no words"),
    "no entry point": (assembled(*MARKS, *SAMPLED), "has no entry point"),
    "id over bound": (assembled(ENTRY, *MARKS, *SAMPLED, bound=14), "uses the id 14"),
    "id 0": (assembled(ENTRY, instruction(22, 0, 32)), "uses the id 0"),
    "twice": (assembled(ENTRY, *SAMPLED, instruction(22, 10, 64)), "declares the id 10 twice"),
    "too short": (assembled(ENTRY, instruction(71, 14)), "with opcode 71, is too short"),
    "open name": (assembled(instruction(15, 5, 1, 0x61616161)), "A name in the SPIR-V has no end"),
    "unknown stage": (assembled(instruction(15, 6, 1, *text_words("main"))), "execution model 6"),
    "no binding": (assembled(ENTRY, MARKS[0], *SAMPLED), "The texture 'map' has no binding"),
    "no pointer": (
        assembled(ENTRY, *MARKS, instruction(59, 13, 14, 0)),
        "type 13, which it does not declare",
    ),
    "a type too short": (
        assembled(ENTRY, *MARKS, SAMPLED[0], instruction(25, 11, 10, 1), *SAMPLED[2:]),
        "A type in the SPIR-V lacks a part",
    ),
    "nested": (
        assembled(
            ENTRY,
            *MARKS,
            instruction(30, 20),
            *(instruction(30, number, number - 1) for number in range(21, 3000)),
            instruction(32, 13, 2, 2999),
            instruction(59, 13, 14, 2),
            bound=4000,
        ),
        "are nested too deeply",
    ),
    "itself": (assembled(ENTRY, instruction(30, 10, 10)), "uses the type 10 before it declares it"),
}


@parser
@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_sentence(name):
    code, sentence = BAD[name]
    with pytest.raises(SpirvError) as caught:
        parse(code)
    said = str(caught.value)
    assert sentence in said
    assert said.endswith(".") and "\n" not in said and len(said) < 200


def test_a_damaged_module_raises_nothing_else():
    """Every word of a real module replaced in turn by small and large numbers: a result or a SpirvError."""
    code = compiled(KINDS, "comp", KINDS_EXTENSIONS)
    body = len(code) // 4
    chooser = random.Random(3)
    refused = 0
    for at in range(5, body, 3):
        value = chooser.choice([0, 1, 2, 7, 30, 0xFFFF, 0x0002001E, 0xFFFFFFFF, chooser.randrange(2**32)])
        damaged = code[: 4 * at] + struct.pack("<I", value) + code[4 * at + 4 :]
        try:
            parse(damaged)
        except SpirvError:
            refused += 1
    assert refused > body / 30


@parser
def test_every_length_of_a_module_is_refused_or_whole():
    code = compiled("layout(local_size_x = 4) in; void main() {}")
    whole = {4 * at for at, _, _ in instructions(words_of(code))} | {len(code)}
    for length in range(len(code)):
        if length in whole:
            continue
        with pytest.raises(SpirvError):
            parse(code[:length])


# --- every kind of declaration ---

KINDS_EXTENSIONS = (
    "GL_EXT_nonuniform_qualifier",
    "GL_EXT_ray_query",
    "GL_EXT_texture_buffer",
    "GL_EXT_scalar_block_layout",
)
KINDS = """
layout(local_size_x = 8, local_size_y = 4, local_size_z = 2) in;
layout(set = 0, binding = 0, std140) uniform Constants { mat4 matrix; vec3 direction; float strength; } constants;
layout(set = 0, binding = 1, std430) buffer Words { uint count; uint words[]; };
layout(set = 0, binding = 2) uniform sampler2DArrayShadow shadows[3];
layout(set = 0, binding = 3) uniform texture3D volume;
layout(set = 0, binding = 4) uniform sampler nearest;
layout(set = 0, binding = 5, rgba16f) uniform writeonly image2D target;
layout(set = 0, binding = 6) uniform usamplerBuffer texels;
layout(set = 0, binding = 7, r32i) uniform iimageBuffer counters;
layout(set = 0, binding = 8) uniform accelerationStructureEXT world;
layout(set = 1, binding = 10) uniform sampler2D flat_textures[];
layout(set = 1, binding = 10) uniform sampler3D deep_textures[];
layout(set = 1, binding = 10) uniform usampler2D whole_textures[];
layout(set = 1, binding = 11, r32ui) uniform uimage2D grids[4][2];
void main() {
    words[count] = texelFetch(texels, 0).x + uint(imageLoad(counters, 0).x) + imageLoad(grids[1][1], ivec2(0)).x;
    float f = texture(shadows[1], vec4(0)) + texture(sampler3D(volume, nearest), vec3(0)).x + constants.strength;
    f += texture(flat_textures[nonuniformEXT(count)], vec2(0)).x;
    f += texture(deep_textures[nonuniformEXT(count)], vec3(0)).x;
    f += float(texture(whole_textures[nonuniformEXT(count)], vec2(0)).x);
    imageStore(target, ivec2(0), vec4(f));
    rayQueryEXT query;
    rayQueryInitializeEXT(query, world, 0u, 255u, vec3(0), 0.0, vec3(1), 1.0);
}
"""


@parser
def test_every_kind_of_binding():
    module = reflected(KINDS, "comp", KINDS_EXTENSIONS)
    assert [(r.set, r.binding, r.kind, r.count, r.name, r.type) for r in module.resources] == [
        (0, 0, "uniform", 1, "constants", "Constants"),
        (0, 1, "storage", 1, "", "Words"),
        (0, 2, "texture", 3, "shadows", "sampler2DArrayShadow"),
        (0, 3, "sampled image", 1, "volume", "texture3D"),
        (0, 4, "sampler", 1, "nearest", "sampler"),
        (0, 5, "image", 1, "target", "image2D"),
        (0, 6, "uniform texels", 1, "texels", "utextureBuffer"),
        (0, 7, "storage texels", 1, "counters", "iimageBuffer"),
        (0, 8, "acceleration structure", 1, "world", "accelerationStructureEXT"),
        (1, 10, "texture", 0, "flat_textures", "sampler2D"),
        (1, 10, "texture", 0, "deep_textures", "sampler3D"),
        (1, 10, "texture", 0, "whole_textures", "usampler2D"),
        (1, 11, "image", 8, "grids", "uimage2D"),
    ]
    assert module.entries[0].local_size == (8, 4, 2)
    assert module.resources[0].block.size == 80
    assert module.resources[1].block.size == 4, "an array without an end needs no byte"


@parser
def test_input_attachments_and_old_storage_buffers():
    text = """
    layout(input_attachment_index = 0, set = 2, binding = 1) uniform subpassInput before;
    layout(location = 0) out vec4 color;
    void main() { color = subpassLoad(before); }
    """
    (found,) = reflected(text, "frag").resources
    assert (found.set, found.binding, found.kind, found.type) == (2, 1, "input attachment", "subpassInput")
    # Before SPIR-V 1.3 a storage buffer was a uniform with the decoration BufferBlock (3).
    declared = (instruction(30, 10), instruction(32, 13, 2, 10), instruction(59, 13, 14, 2))
    for decoration, kind in ((2, "uniform"), (3, "storage")):
        (found,) = parse(assembled(ENTRY, *MARKS, instruction(71, 10, decoration), *declared)).resources
        assert found.kind == kind


@parser
def test_opcodes_and_models_above_255():
    """A mesh shader's body has 5295, an acceleration structure is 5341; with 8 bits they would be 175 and 221."""
    text = """
    layout(local_size_x = 32) in;
    layout(triangles, max_vertices = 3, max_primitives = 1) out;
    void main() { SetMeshOutputsEXT(3, 1); gl_PrimitiveTriangleIndicesEXT[0] = uvec3(0, 1, 2); }
    """
    code = compiled(text, "mesh", ("GL_EXT_mesh_shader",))
    assert 5295 in {opcode for _, opcode, _ in instructions(words_of(code))}
    (entry,) = parse(code).entries
    assert (entry.stage, entry.local_size) == ("mesh", (32, 1, 1))
    for model, stage in ((5267, "task"), (5268, "mesh"), (5364, "task"), (5313, "rgen"), (5318, "rcall")):
        assert parse(assembled(instruction(15, model, 1, *text_words("main")))).entries[0].stage == stage


# --- layouts, by the rules of GLSL (specification 4.60, section 7.6.2.2) ---

RULES = """
struct Inner { vec3 a; float b; mat3 c; };
layout(set = 0, binding = 0, LAYOUT) LAYOUT_KIND Block {
    float first; vec3 second; float third[3]; mat4x3 matrix; layout(row_major) mat2x3 turned; Inner inner[2]; vec2 last;
} block;
layout(set = 0, binding = 1) buffer Out { float result; };
layout(local_size_x = 1) in;
void main() { result = block.first + block.last.x; }
"""
# name: (offset, size); std140 rounds arrays and structs up to 16 bytes, std430 does not, scalar packs by components.
EXPECTED = {
    "std140": {
        "first": (0, 4),
        "second": (16, 12),
        "third": (32, 48),
        "matrix": (80, 64),
        "turned": (144, 48),
    },
    "std430": {
        "first": (0, 4),
        "second": (16, 12),
        "third": (28, 12),
        "matrix": (48, 64),
        "turned": (112, 24),
    },
    "scalar": {"first": (0, 4), "second": (4, 12), "third": (16, 12), "matrix": (28, 48), "turned": (76, 24)},
}
EXPECTED["std140"] |= {"inner": (192, 128), "last": (320, 8)}
EXPECTED["std430"] |= {"inner": (144, 128), "last": (272, 8)}
EXPECTED["scalar"] |= {"inner": (100, 104), "last": (204, 8)}


@parser
@pytest.mark.parametrize("rule", EXPECTED)
def test_members_lie_where_the_rules_say(rule):
    text = RULES.replace("LAYOUT_KIND", "uniform" if rule == "std140" else "buffer").replace("LAYOUT", rule)
    block = reflected(text, extensions=("GL_EXT_scalar_block_layout",)).resources[0].block
    assert {m.name: (m.offset, m.size) for m in block.members} == EXPECTED[rule]
    by_name = {member.name: member for member in block.members}
    assert block.size == by_name["last"].offset + 8
    assert (by_name["third"].counts, by_name["third"].strides) == ((3,), (16 if rule == "std140" else 4,))
    assert (by_name["matrix"].type, by_name["turned"].type) == ("mat4x3", "mat2x3")
    assert [by_name[name].row_major for name in ("matrix", "turned")] == [False, True]
    inner = {m.name: (m.offset, m.size) for m in by_name["inner"].members}
    packed = rule == "scalar"
    assert inner == {"a": (0, 12), "b": (12, 4), "c": (16, 36 if packed else 48)}


@parser
def test_push_constants():
    text = """
    layout(push_constant) uniform Push { layout(offset = 16) vec4 color; uint which[2]; };
    layout(location = 0) out vec4 result;
    void main() { result = color * float(which[1]); }
    """
    push = reflected(text, "frag").push
    assert (push.name, push.size) == ("Push", 40)
    assert [(m.name, m.type, m.offset, m.size, m.counts) for m in push.members] == [
        ("color", "vec4", 16, 16, ()),
        ("which", "uint", 32, 8, (2,)),
    ]


def test_records_of_the_host_fit_their_blocks_and_others_do_not():
    text = (
        "layout(set = 0, binding = 0, std140) uniform Frame {\n"
        + layouts.glsl("FrameConstants")
        + "} frame;\n"
        "struct Instance {\n" + layouts.glsl("Instance") + "};\n"
        "layout(set = 0, binding = 1, std430) buffer Instances { Instance instances[]; };\n"
        "layout(local_size_x = 1) in;\nvoid main() { instances[0].mesh = frame.frame_index; }"
    )
    frame, instances = (one.block for one in reflected(text).resources)
    assert mismatch(frame.members, layouts.dtype("FrameConstants")) == ""
    (array,) = instances.members
    record = layouts.dtype("Instance")
    assert mismatch(array.members, record, array.strides[0]) == ""
    wrong = {
        "is at byte 0 of the block and at byte 16": [("pad", "f4", 4), *record.descr],
        "is no field of the record": record.descr[:-1],
        "is no member of the block": [*record.descr, ("more", "f4")],
    }
    for sentence, fields in wrong.items():
        assert sentence in mismatch(array.members, np.dtype(fields), array.strides[0])
    assert "bytes apart" in mismatch(array.members, record, array.strides[0] + 16)
    half = np.dtype([(name, "f2" if name == "flags" else record[name]) for name in record.names])
    assert "has 4 bytes in the block and 2 in the record" in mismatch(array.members, half)


# --- specialization constants ---

SPECIAL = """
layout(constant_id = 3) const int count = 4;
layout(constant_id = 1) const float scale = 0.25;
layout(constant_id = 2) const bool wanted = true;
layout(constant_id = 9) const uint mask = 4294967295u;
layout(constant_id = 12) const double exact = 0.1;
layout(local_size_x_id = 5, local_size_y = 2) in;
layout(set = 0, binding = 0) uniform sampler2D maps[count];
layout(set = 0, binding = 1) buffer Out { double result; };
void main() { result = texture(maps[0], vec2(scale)).x * exact + double(wanted ? mask : 0u); }
"""


@parser
def test_specialization_constants_have_ids_types_and_defaults():
    module = reflected(SPECIAL)
    assert [(one.id, one.name, one.type, one.size, one.default) for one in module.constants] == [
        (1, "scale", "float", 4, 0.25),
        (2, "wanted", "bool", 4, True),
        (3, "count", "int", 4, 4),
        (5, "", "uint", 4, 1),
        (9, "mask", "uint", 4, 2**32 - 1),
        (12, "exact", "double", 8, 0.1),
    ]
    assert module.resources[0].count == 4
    assert module.entries[0].local_size == (1, 2, 1)
    other = reflected(SPECIAL, specialization={3: 7, 5: 64})
    assert other.resources[0].count == 7
    assert other.entries[0].local_size == (64, 2, 1)


def test_constants_are_encoded_as_the_driver_reads_them():
    by_name = {one.name: one for one in reflected(SPECIAL).constants}
    assert by_name["scale"].encoded(0.5) == struct.pack("<f", 0.5)
    assert by_name["wanted"].encoded(True) == b"\1\0\0\0"
    assert by_name["count"].encoded(-2) == struct.pack("<i", -2)
    assert by_name["mask"].encoded(2**32 - 1) == b"\xff" * 4
    assert by_name["exact"].encoded(0.1) == struct.pack("<d", 0.1)
    for name, value in (("count", 2**31), ("mask", -1), ("count", 0.5), ("scale", 1e39)):
        with pytest.raises(ShaderError, match=f"'{name}' is .* it cannot be"):
            by_name[name].encoded(value)


@parser
def test_an_array_whose_length_is_computed_is_refused_by_name():
    text = SPECIAL.replace("maps[count]", "maps[count * 2]")
    with pytest.raises(SpirvError, match="The length of 'maps' is computed from specialization constants"):
        reflected(text)
    with pytest.raises(SpirvError, match="The array 'maps' has 0 elements"):
        reflected(SPECIAL, specialization={3: 0})


@pytest.mark.alone
def test_parsing_is_quick():
    code = compiled(KINDS, "comp", KINDS_EXTENSIONS)
    assert least_time(timed(lambda: parse(code), calls=5), 0.05, fewest=1) < 0.05
