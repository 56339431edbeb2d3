// Study line-canvas, vertices: a line is two triangles, as wide in the picture as asked for.

#include "transform.glsl"

// Vulkan and OpenGL know lines, but leave to each driver which pixels one covers, and how wide it may be. A rectangle of
// two triangles is the same everywhere. Six vertices read the same two ends.
struct End {
    float x, y, z;  // a vec3 would be padded to 16 bytes
    uint color;
};

layout(BIND(0, 0, 0), std140) uniform Frame_ {
    mat4 clip_from_world;
    vec4 picture;  // half its size, half the width of a line, pixels
} frame;

layout(BIND(0, 1, 1), std430) readonly buffer Canvas_ {
    End ends[];
};

layout(location = 0) flat out vec3 out_color;

const int CORNERS[6] = int[](0, 1, 2, 2, 1, 3);

vec4 clip_of(End end) {
    return matrix_times(frame.clip_from_world, vec4(end.x, end.y, end.z, 1.0));
}

void main() {
    int line = VERTEX_ID / 6;
    int corner = CORNERS[VERTEX_ID % 6];  // bit 1: which end; bit 0: which side
    End chosen = ends[2 * line];
    vec4 a = clip_of(chosen);
    vec4 b = clip_of(ends[2 * line + 1]);
    out_color = unpackUnorm4x8(chosen.color).rgb;
    // An end behind the camera has no place in the picture. The GPU cuts triangles off there, but only after their corners
    // were moved apart; so lines are cut first, where they pass the near plane (z = w, with reversed z).
    float beyond_a = a.w - a.z, beyond_b = b.w - b.z;
    if (beyond_a < 0.0 && beyond_b < 0.0) {
        gl_Position = vec4(0.0, 0.0, 2.0, 1.0);  // in front of the near plane, all of it
        return;
    }
    if (beyond_a < 0.0) a = mix(a, b, beyond_a / (beyond_a - beyond_b));
    if (beyond_b < 0.0) b = mix(b, a, beyond_b / (beyond_b - beyond_a));
    vec2 along = (b.xy / b.w - a.xy / a.w) * frame.picture.xy;  // pixels
    float len = length(along);
    along = len > 0.0 ? along / len : vec2(1.0, 0.0);
    vec2 aside = vec2(-along.y, along.x) * ((corner & 1) == 0 ? -1.0 : 1.0);
    vec4 end = (corner & 2) == 0 ? a : b;
    // Half a width beyond each end: then two lines that meet leave no gap.
    vec2 moved = (aside + ((corner & 2) == 0 ? -along : along)) * frame.picture.z / frame.picture.xy;
    gl_Position = vec4(end.xy + moved * end.w, end.zw);
}
