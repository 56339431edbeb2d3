// From a panorama to the six faces of a cube map: each texel is the mean of points spread over it,
// weighted by their solid angles.
//
// With at least as many points as the panorama has pixels there, no pixel is passed over: a sun that covers one of them
// arrives.

#include "environment.glsl"
#include "half.glsl"
#include "finite.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 size;   // x: texels along an edge of the cube, y: points along an edge of a texel
};
PUSH(Push, push)

layout(BIND(0, 0, 0)) uniform sampler2D panorama;
layout(BIND(0, 1, 0), FORMAT) uniform writeonly imageCube target;

void main() {
    uvec3 id = gl_GlobalInvocationID;
    if (any(greaterThanEqual(id.xy, push.size.xx))) {
        return;
    }
    vec4 sum = vec4(0.0);
    for (uint y = 0u; y < push.size.y; ++y) {
        for (uint x = 0u; x < push.size.y; ++x) {
            vec2 inside = (vec2(x, y) + 0.5) / float(push.size.y);
            vec3 d = normalize(cube_direction(id.z, (vec2(id.xy) + inside) / float(push.size.x)));
            sum += cube_texel_solid_angle(d, 1.0) * vec4(textureLod(panorama, panorama_uv(d), 0.0).rgb, 1.0);
        }
    }
    imageStore(target, ivec3(id), vec4(nearest_half(finite_color(sum.rgb / sum.a)), 1.0));
}
