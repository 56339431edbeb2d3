"""What the self-tests of mesh shaders draw: numbered squares of 4x4 pixels, 8 in a row."""

from __future__ import annotations

import numpy as np

EXTENSIONS = ("GL_EXT_mesh_shader",)
SIZE = (32, 32)

MESH = """
layout(local_size_x = 4) in;
layout(triangles, max_vertices = 4, max_primitives = 2) out;
#ifdef TASKS
struct Payload { uint tiles[8]; };
taskPayloadSharedEXT Payload payload;
#endif
layout(location = 0) perprimitiveEXT out uint number[];
void main() {
    uint i = gl_LocalInvocationIndex;
#ifdef TASKS
    uint tile = payload.tiles[gl_WorkGroupID.x];
#else
    uint tile = gl_WorkGroupID.y * 8u + gl_WorkGroupID.x;
#endif
    SetMeshOutputsEXT(4, 2);
    vec2 corner = vec2(tile % 8u, tile / 8u) + vec2(i & 1u, i >> 1u);
    gl_MeshVerticesEXT[i].gl_Position = vec4(corner / 4.0 - 1.0, 0.5, 1.0);
    if (i < 2u) {
        gl_PrimitiveTriangleIndicesEXT[i] = i == 0u ? uvec3(0, 1, 2) : uvec3(2, 1, 3);
        number[i] = tile + 1u;
    }
}
"""
"""Draws square `tile`: the number of the workgroup, or with TASKS the one in the payload."""

FRAGMENT = """
layout(location = 0) perprimitiveEXT in flat uint number;
layout(location = 0) out uint color;
void main() { color = number; }
"""


def expected(count: int) -> np.ndarray:
    """Return (32, 32) uint32: the squares 0 to count - 1 hold their number plus 1, the others 0."""
    tile = np.add.outer(8 * (np.arange(32) // 4), np.arange(32) // 4).astype(np.uint32)
    return np.where(tile < count, tile + 1, 0).astype(np.uint32)
