"""What a shader expects of its host, as SPIR-V says it and as OpenGL's driver does: against the host's own tables."""

from __future__ import annotations

import re

import pytest

from backends import shader_text
from backends.gl import program_interface
from backends.gl.programs import Programs
from backends.shader_interface import Field, Slot, misfit
from backends.vulkan.shaders import spirv_interface
from backends.vulkan.shaders.compiler import compile_all
from chapters.ch01.pipelines.vulkan import CHAPTER
from common import layouts
from tests.support.timing import least_time, timed

EVERYTHING = {"SHADED": 1, "LIT": 1, "TEXTURED": 1, "NORMAL_MAP": 1, "ENVIRONMENT": 1, "ENERGY": 0}
FILES = ("shading/forward.vert", "shading/forward.frag")


def sources(backend, defines=EVERYTHING, files=FILES):
    return [
        shader_text.build(
            CHAPTER / file, backend, roots=(CHAPTER,), defines=defines, snippets=layouts.SNIPPETS
        )
        for file in files
    ]


@pytest.fixture(scope="module")
def of_vulkan():
    return spirv_interface.interface_of(
        dict(zip(("vert", "frag"), compile_all(sources("vulkan")), strict=True))
    )


@pytest.fixture(scope="module")
def of_gl(gl_context):
    programs = Programs(gl_context)
    try:
        return program_interface.interface_of(gl_context, programs.get(sources("gl")).handle)
    finally:
        programs.close()


def offsets(slot, prefix):
    return {one.name.removeprefix(prefix): one.offset for one in slot.fields if one.name.startswith(prefix)}


def table(name):
    dtype = layouts.dtype(name)
    return {field: dtype.fields[field][1] for field in dtype.names}, dtype.itemsize


def test_blocks_have_the_bytes_of_the_hosts_tables(of_vulkan, of_gl):
    expected, size = table("FrameConstants")
    for slot, prefix in (
        (of_vulkan["set 0, binding 0"], ""),
        (of_gl["uniform block, binding 0"], "Frame_."),
    ):
        found = {name: at for name, at in offsets(slot, prefix).items() if name in expected}
        assert found == {name: expected[name] for name in found}
        assert len(found) > 30
        assert slot.size == size
    expected, size = table("Instance")
    for slot in (of_vulkan["set 0, binding 1"], of_gl["storage block, binding 0"]):
        found = offsets(slot, "instances[].")
        assert {name: expected[name] for name in found if name in expected} == {
            name: at for name, at in found.items() if name in expected
        }
        assert len(found) >= 8
        assert str(size) in " ".join(one.kind for one in slot.fields)


def test_both_see_the_same_textures_inputs_and_outputs(of_vulkan, of_gl):
    def kinds(interface, what):
        return {
            (slot.name, slot.kind) for place, slot in interface.items() if re.search(what, place + slot.kind)
        }

    for what in ("sampler", "vertex input", "output"):
        assert kinds(of_vulkan, what) == kinds(of_gl, what) != set(), what
    assert ("normal_map", "sampler2D") in kinds(of_vulkan, "sampler")
    assert ("environment_radiance", "samplerCube") in kinds(of_gl, "sampler")


def test_a_buffer_reference_is_an_address_of_8_bytes():
    text = """
    #extension GL_EXT_buffer_reference : require
    layout(buffer_reference, std430) readonly buffer Words { uint words[]; };
    layout(push_constant) uniform Push { Words at; uint count; } push;
    layout(set = 0, binding = 0, std430) buffer Sum { uint sum; };
    layout(local_size_x = 1) in;
    void main() { for (uint i = 0; i < push.count; i++) sum += push.at.words[i]; }
    """
    source = shader_text.build_text(text, "comp", "vulkan")
    push = spirv_interface.interface_of({"comp": compile_all([source])[0]})["push constants"]
    assert [(one.name, one.offset, one.kind) for one in push.fields] == [
        ("at", 0, "reference"),
        ("count", 8, "uint"),
    ]
    with_last = text.replace("Words at; uint count;", "uint count; Words at;")
    source = shader_text.build_text(with_last, "comp", "vulkan")
    push = spirv_interface.interface_of({"comp": compile_all([source])[0]})["push constants"]
    assert push.size == 16, "4 bytes, 4 of padding, and the address"


def test_types_are_read_as_glsl_writes_them(tmp_path):
    text = """
    layout(set = 1, binding = 2) uniform usampler2DArray layers[3];
    layout(set = 1, binding = 3, rgba8) uniform writeonly image2D target;
    layout(set = 1, binding = 4) uniform sampler2DShadow shadow;
    struct Inner { vec3 a; float b; mat3 c; };
    layout(set = 0, binding = 1, std430) buffer Block { ivec2 first; Inner inner[2]; double d; uint rest[]; } block;
    layout(push_constant) uniform Push { layout(offset = 16) vec4 at; } push;
    layout(local_size_x = 1) in;
    void main() {
        block.rest[0] = texelFetch(layers[1], ivec3(0), 0).x;
        imageStore(target, block.first, push.at * texture(shadow, vec3(0.0)));
    }
    """
    source = shader_text.build_text(text, "comp", "vulkan")
    found = spirv_interface.interface_of({"comp": compile_all([source])[0]})
    shown = {place: (slot.name, slot.kind, slot.size) for place, slot in found.items()}
    # std430 by its rules: vec3 on 16 bytes, a matrix's columns too, so Inner has 64; the double lies on 8.
    assert shown == {
        "push constants": ("push", "block of push constants", 32),
        "set 0, binding 1": ("block", "storage block", 16 + 2 * 64 + 8),
        "set 1, binding 2": ("layers", "sampler2DArray of u[3]", 0),
        "set 1, binding 3": ("target", found["set 1, binding 3"].kind, 0),
        "set 1, binding 4": ("shadow", "sampler2DShadow", 0),
    }
    assert shown["set 1, binding 3"][1].startswith("image2D in format ")
    fields = {one.name: (one.offset, one.kind) for one in found["set 0, binding 1"].fields}
    assert (
        fields
        == {
            "first": (0, "ivec2"),
            "inner": (16, "struct[2] every 64 bytes"),
            "inner[].a": (16, "vec3"),
            "inner[].b": (28, "float"),
            "inner[].c": (32, "mat3 in columns of 16 bytes"),
            "d": (144, "double"),
            "rest": (152, "uint[] every 4 bytes"),
        }
        or fields["inner"][1] != "struct[2] every 64 bytes"
    )


BLOCK = Slot("materials", "storage block", 96, (Field("a", 0, "vec4"), Field("b", 16, "vec3")))
MISFITS = {
    "nothing": (BLOCK, ""),
    "a name": (Slot("others", "storage block", 96, (Field("x", 0, "vec4"), Field("y", 16, "vec3"))), ""),
    "kind": (Slot("materials", "sampler2D"), "it was a storage block and is a sampler2D"),
    "size": (Slot("materials", "storage block", 112, BLOCK.fields), "size went from 96 to 112 bytes"),
    "offset": (
        Slot("materials", "storage block", 96, (BLOCK.fields[0], Field("b", 32, "vec3"))),
        "the field at byte 16, 'b', is now at byte 32",
    ),
    "type": (
        Slot("materials", "storage block", 96, (BLOCK.fields[0], Field("b", 16, "vec4"))),
        "the field 'b' was a vec3 and is a vec4",
    ),
    "more": (
        Slot("materials", "storage block", 96, (*BLOCK.fields, Field("c", 32, "int"))),
        "the field 'c' is new",
    ),
    "less": (Slot("materials", "storage block", 96, BLOCK.fields[:1]), "the field 'b' is gone"),
}


@pytest.mark.parametrize("how", MISFITS)
def test_every_kind_of_difference_has_its_sentence(how):
    now, sentence = MISFITS[how]
    found = misfit({"binding 3": BLOCK}, {"binding 3": now})
    assert sentence in found
    assert bool(found) == bool(sentence)
    if found:
        assert found.startswith("binding 3 'materials': ")


def test_what_is_no_longer_used_is_no_harm_and_what_is_new_is():
    assert misfit({"binding 3": BLOCK}, {}) == ""
    assert "is new" in misfit({}, {"binding 3": BLOCK})
    assert misfit({}, {"binding 3": BLOCK}, [("binding 3", BLOCK)]) == ""


@pytest.mark.alone
def test_reading_an_interface_is_quick(of_vulkan):
    codes = dict(zip(("vert", "frag"), compile_all(sources("vulkan")), strict=True))
    reading = timed(lambda: spirv_interface.interface_of(codes), calls=5)
    assert least_time(reading, 0.05, fewest=1) < 0.05
