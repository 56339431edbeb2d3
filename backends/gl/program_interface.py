"""What a linked program expects of its host, asked from the driver: bindings, blocks, vertex inputs, outputs.

Only for comparing an edited shader with the one before. OpenGL lists what a program uses and leaves the rest out.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context
from backends.shader_interface import Field, Interface, Slot

_NAMES = {
    **dict(zip(range(0x1404, 0x1407), ("int", "uint", "float"), strict=True)),
    **dict(zip(range(0x8B50, 0x8B53), ("vec2", "vec3", "vec4"), strict=True)),
    **dict(zip(range(0x8B53, 0x8B56), ("ivec2", "ivec3", "ivec4"), strict=True)),
    **dict(zip(range(0x8B56, 0x8B5A), ("bool", "bvec2", "bvec3", "bvec4"), strict=True)),
    **dict(zip(range(0x8B5A, 0x8B5D), ("mat2", "mat3", "mat4"), strict=True)),
    **dict(zip(range(0x8B5D, 0x8B61), ("sampler1D", "sampler2D", "sampler3D", "samplerCube"), strict=True)),
    **dict(zip(range(0x8B61, 0x8B63), ("sampler1DShadow", "sampler2DShadow"), strict=True)),
    **dict(
        zip(range(0x8B65, 0x8B6B), ("mat2x3", "mat2x4", "mat3x2", "mat3x4", "mat4x2", "mat4x3"), strict=True)
    ),
    **dict(zip(range(0x8DC6, 0x8DC9), ("uvec2", "uvec3", "uvec4"), strict=True)),
    0x8DC1: "sampler2DArray",
    0x8DC4: "sampler2DArrayShadow",
    0x8DC5: "samplerCubeShadow",
    0x900C: "samplerCubeArray",
    0x9108: "sampler2DMS",
}
"""Types by their number in `gl.xml`; another one is shown by its number."""

_IMAGES = range(0x904C, 0x906D)  # image1D to uimage2DMSArray
_PER_BLOCK = {
    gl.GL_UNIFORM_BLOCK: ("uniform block", gl.GL_UNIFORM),
    gl.GL_SHADER_STORAGE_BLOCK: ("storage block", gl.GL_BUFFER_VARIABLE),
}


def interface_of(context: Context, program: int) -> Interface:
    """Return what a linked program expects of its host. The context is current."""
    slots = {}
    for interface, (kind, members) in _PER_BLOCK.items():
        fields = _fields(context, program, members)
        for index, (binding, size) in enumerate(
            _resources(context, program, interface, gl.GL_BUFFER_BINDING, gl.GL_BUFFER_DATA_SIZE)
        ):
            inside = tuple(sorted(fields.get(index, []), key=lambda member: (member.offset, member.kind)))
            name = _name(context, program, interface, index)
            slots[f"{kind}, binding {binding}"] = Slot(name, kind, size, inside)
    for interface, what in ((gl.GL_PROGRAM_INPUT, "vertex input"), (gl.GL_PROGRAM_OUTPUT, "output")):
        for index, (location, type_) in enumerate(
            _resources(context, program, interface, gl.GL_LOCATION, gl.GL_TYPE)
        ):
            if location >= 0:  # not gl_VertexID and its like
                slots[f"{what} {location}"] = Slot(_name(context, program, interface, index), _kind(type_))
    return dict(sorted({**slots, **_units(context, program)}.items()))


def _units(context: Context, program: int) -> Interface:
    """Return the textures and images of a program, by their units."""
    slots = {}
    values = gl.ffi.new("GLint[1]")
    for index, (location, type_, count) in enumerate(
        _resources(context, program, gl.GL_UNIFORM, gl.GL_LOCATION, gl.GL_TYPE, gl.GL_ARRAY_SIZE)
    ):
        if location < 0:
            continue  # a member of a block
        context.fn.glGetUniformiv(program, location, values)
        what = "image unit" if type_ in _IMAGES else "texture unit"
        kind = _kind(type_) + (f"[{count}]" if count > 1 else "")
        slots[f"{what} {values[0]}"] = Slot(_name(context, program, gl.GL_UNIFORM, index), kind)
    return slots


def _fields(context: Context, program: int, interface: int) -> dict[int, list[Field]]:
    """Return the members of all blocks of a kind, by the number of their block."""
    members: dict[int, list[Field]] = {}
    asked = [gl.GL_BLOCK_INDEX, gl.GL_OFFSET, gl.GL_TYPE, gl.GL_ARRAY_SIZE, gl.GL_ARRAY_STRIDE]
    asked.append(gl.GL_MATRIX_STRIDE)
    storage = interface == gl.GL_BUFFER_VARIABLE
    asked += [gl.GL_TOP_LEVEL_ARRAY_STRIDE] if storage else []
    for index, (block, offset, type_, count, stride, columns, *outer) in enumerate(
        _resources(context, program, interface, *asked)
    ):
        if block < 0:
            continue
        kind = _kind(type_)
        if stride > 0:
            kind += f"[{count or ''}] every {stride} bytes"
        if columns > 0:
            kind += f" in columns of {columns} bytes"
        if outer and outer[0] > 0:
            kind += f" in elements of {outer[0]} bytes"
        members.setdefault(block, []).append(Field(_name(context, program, interface, index), offset, kind))
    return members


def _kind(type_: int) -> str:
    return _NAMES.get(type_, f"type 0x{type_:04x}")


def _resources(context: Context, program: int, interface: int, *asked: int) -> Iterator[tuple[Any, ...]]:
    """Yield the asked properties of each resource of a kind."""
    fn, count = context.fn, gl.ffi.new("GLint[1]")
    fn.glGetProgramInterfaceiv(program, interface, gl.GL_ACTIVE_RESOURCES, count)
    properties, out = gl.ffi.new("GLenum[]", list(asked)), gl.ffi.new("GLint[]", len(asked))
    for index in range(count[0]):
        fn.glGetProgramResourceiv(program, interface, index, len(asked), properties, len(asked), gl.NULL, out)
        yield tuple(out)


def _name(context: Context, program: int, interface: int, index: int) -> str:
    raw = gl.ffi.new("char[256]")
    context.fn.glGetProgramResourceName(program, interface, index, 256, gl.NULL, raw)
    return gl.text(raw).removesuffix("[0]").replace("[0]", "[]")
