"""The table of a shader that is compiled here, against the lines that its text calls for."""

from __future__ import annotations

from typing import Any

from backends import shader_text
from backends.vulkan.shaders.compiler import compile_shader
from tools.exercises.checking import Given

SHADER = """
layout(set = 2, binding = 10) uniform usampler2D textures_uint[];
layout(set = 2, binding = 10) uniform sampler2D textures_2d[];
layout(set = 1, binding = 2) uniform sampler2D shadows[4];
layout(set = 0, binding = 7, rgba8) uniform writeonly image2D target;
layout(set = 0, binding = 3, std430) readonly buffer Lights_ { uvec4 count; vec4 lights[]; };
layout(set = 0, binding = 4, std430) readonly buffer Table_ { vec4 entries[3]; };
layout(set = 0, binding = 0, std140) uniform Frame_ { mat4 m; vec4 eye; } frame;
layout(local_size_x = 1) in;
void main() {
    vec4 sum = frame.eye + lights[count.x] + entries[count.y] + texelFetch(shadows[count.z & 3u], ivec2(0), 0);
    sum += texelFetch(textures_2d[nonuniformEXT(count.w)], ivec2(0), 0);
    sum += vec4(texelFetch(textures_uint[nonuniformEXT(count.w)], ivec2(0), 0));
    imageStore(target, ivec2(0), sum);
}
"""
WANTED = [
    "set 0 binding 0: uniform Frame_, 80 bytes",
    "set 0 binding 3: storage Lights_, 16 bytes and more",
    "set 0 binding 4: storage Table_, 48 bytes",
    "set 0 binding 7: image target",
    "set 1 binding 2: texture shadows[4]",
    "set 2 binding 10: texture textures_2d[]",
    "set 2 binding 10: texture textures_uint[]",
]


def check(given: Given) -> None:
    """Compare line by line, and an empty module at last."""
    rows: Any = getattr(given.module("pipelines.spirv.set_table"), "rows", None)
    given.need(callable(rows), "pipelines/spirv/set_table.py has no function rows yet.")
    parse = given.module("pipelines.spirv.parser").parse
    extensions = ("GL_EXT_nonuniform_qualifier",)
    code = compile_shader(shader_text.build_text(SHADER, "comp", "vulkan", extensions=extensions))
    lines = list(rows(parse(code)))
    given.need(
        len(lines) == len(WANTED),
        f"A shader with {len(WANTED)} resources has {len(lines)} lines in the table.",
    )
    for line, wanted in zip(lines, WANTED, strict=True):
        given.need(line == wanted, f'The line "{line}" should be "{wanted}".')
    empty = "layout(local_size_x = 1) in; void main() {}"
    nothing = rows(parse(compile_shader(shader_text.build_text(empty, "comp", "vulkan"))))
    given.need(list(nothing) == [], "A shader without resources has lines in the table.")
