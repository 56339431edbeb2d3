// Study edited-draws, fragments: a lamp above, and the colour of the material or of a number.

#include "palette.glsl"

layout(location = 0) in vec3 in_normal;
layout(location = 1) flat in vec3 in_color;
layout(location = 2) flat in uint in_number;
layout(location = 0) out vec4 out_color;

void main() {
    vec3 normal = normalize(in_normal);
#if OPEN
    normal = gl_FrontFacing ? normal : -normal;  // an open mesh is seen from both sides
#endif
    vec3 color = SHOW == 0 ? in_color : id_color(in_number);
    out_color = vec4(color * (0.35 + 0.65 * max(dot(normal, normalize(vec3(0.4, 0.8, 0.45))), 0.0)), 1.0);
}
