// Study tessellation, geometry: passes each small triangle on, with barycentric coordinates, which are 0 at its edges.

layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;

layout(location = 0) in vec3 in_position[];
layout(location = 1) in vec3 in_normal[];
layout(location = 2) in float in_level[];

layout(location = 0) out vec3 out_normal;
layout(location = 1) out float out_level;
layout(location = 2) noperspective out vec3 out_weights;
invariant gl_Position;

#if RECORDED
layout(BIND(0, 1, 0), std430) buffer Record_ {
    uvec4 count;
    vec4 corners[];  // three for each triangle; w: the number of the patch
};
#endif

void main() {
#if RECORDED
    uint first = 3u * atomicAdd(count.x, 1u);
#endif
    for (int i = 0; i < 3; ++i) {
        gl_Position = gl_in[i].gl_Position;
        out_normal = in_normal[i];
        out_level = in_level[i];
        out_weights = vec3(i == 0, i == 1, i == 2);
        EmitVertex();
#if RECORDED
        if (first + uint(i) < uint(corners.length())) {
            corners[first + uint(i)] = vec4(in_position[i], float(gl_PrimitiveIDIn));
        }
#endif
    }
}
