// The light that a diffuse surface receives, for every normal: irradiance / pi, the mean of the radiance with the cosine
// as weight. It is summed over all texels of one level of the source, each with its solid angle.
//
// The cosine is so wide that a coarse level is enough, and a sun that is one bright texel counts with its exact weight;
// random directions would meet it by chance.

#include "environment.glsl"
#include "half.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 size;   // texels along an edge: x: of the target, y: of the level that is read; z: that level
};
PUSH(Push, push)

layout(BIND(0, 0, 0)) uniform samplerCube source;
layout(BIND(0, 1, 0), FORMAT) uniform writeonly imageCube target;

void main() {
    uvec3 id = gl_GlobalInvocationID;
    if (any(greaterThanEqual(id.xy, push.size.xx))) {
        return;
    }
    vec3 n = normalize(cube_direction(id.z, (vec2(id.xy) + 0.5) / float(push.size.x)));
    float edge = float(push.size.y);
    vec4 sum = vec4(0.0);
    for (uint face = 0u; face < 6u; ++face) {
        for (uint y = 0u; y < push.size.y; ++y) {
            vec4 row = vec4(0.0);  // summed by rows: float32 would lose the last of many thousand numbers in one sum
            for (uint x = 0u; x < push.size.y; ++x) {
                vec3 d = normalize(cube_direction(face, (vec2(x, y) + 0.5) / edge));
                float weight = max(dot(n, d), 0.0) * cube_texel_solid_angle(d, edge);
                if (weight > 0.0) {
                    row += weight * vec4(textureLod(source, d, float(push.size.z)).rgb, 1.0);
                }
            }
            sum += row;
        }
    }
    imageStore(target, ivec3(id), vec4(nearest_half(sum.rgb / sum.a), 1.0));
}
