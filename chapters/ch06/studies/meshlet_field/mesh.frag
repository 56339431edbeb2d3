// Studies of meshlets, fragments: a colour for each instance, under a lamp above.

#include "palette.glsl"

layout(location = 0) in vec3 in_normal;
layout(location = 1) flat in uint in_instance;
layout(location = 0) out vec4 out_color;

void main() {
    float lit = max(dot(normalize(in_normal), normalize(vec3(0.4, 0.8, 0.45))), 0.0);
    out_color = vec4(id_color(in_instance) * (0.3 + 0.7 * lit), 1.0);
}
