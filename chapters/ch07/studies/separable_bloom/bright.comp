// Study separable-bloom: texels of weighted luminance below the threshold become black, others pass unchanged.

#define ACCESS writeonly
#include "texels.glsl"
#include "finite.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

void main() {
    uint at = gl_GlobalInvocationID.y * SIDE + gl_GlobalInvocationID.x;
    vec3 color = finite_color(from[at].rgb);  // one infinity would spread over the whole picture
    float weighted = dot(color, vec3(0.33, 0.34, 0.33));
    to[at] = vec4(weighted < THRESHOLD ? vec3(0.0) : color, 1.0);
}
