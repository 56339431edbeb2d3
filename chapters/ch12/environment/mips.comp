// One level of a cube map's mip chain from the level above: each texel is the mean of four, weighted by
// their solid angles, so that every level sends out the same light as the first.

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 size;   // x: texels along an edge of the target
};
PUSH(Push, push)

layout(BIND(0, 0, 0)) uniform samplerCube source;  // the level above alone
layout(BIND(0, 1, 0), FORMAT) uniform writeonly imageCube target;

#include "environment.glsl"
#include "half.glsl"

void main() {
    uvec3 id = gl_GlobalInvocationID;
    if (any(greaterThanEqual(id.xy, push.size.xx))) {
        return;
    }
    vec4 sum = vec4(0.0);
    for (uint i = 0u; i < 4u; ++i) {
        vec2 texel = vec2(id.xy * 2u + uvec2(i & 1u, i >> 1)) + 0.5;
        vec3 d = normalize(cube_direction(id.z, texel / float(2u * push.size.x)));
        // Read at its centre, a texel is itself: no device's rounding of filter weights comes in.
        sum += cube_texel_solid_angle(d, 1.0) * vec4(textureLod(source, d, 0.0).rgb, 1.0);
    }
    imageStore(target, ivec3(id), vec4(nearest_half(sum.rgb / sum.a), 1.0));
}
