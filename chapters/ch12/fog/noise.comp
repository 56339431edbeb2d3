// Makes the volume of noise, once: seven octaves from four periods on, and two texels an invocation. Octaves with more than
// half as many periods as there are texels would need a larger volume; at texel centres they are 0 or alias.

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

#include "gradient_noise.glsl"

layout(BIND(0, 0, 4), std430) buffer Fog_tables_ { uint fog_tables[]; };

#include "fog/noise.glsl"

const int OCTAVES = 7;
const uint FREQUENCY = 4u;

void main() {
    ivec3 first = ivec3(gl_GlobalInvocationID) * ivec3(2, 1, 1);
    if (any(greaterThanEqual(first, ivec3(NOISE_SIZE)))) {
        return;
    }
    vec2 pair;
    for (int k = 0; k < 2; ++k) {
        vec3 uvw = (vec3(first + ivec3(k, 0, 0)) + 0.5) / float(NOISE_SIZE);
        pair[k] = octaves_of_noise(uvw, FREQUENCY, OCTAVES, 0u);
    }
    fog_tables[NOISE_PLACE + (noise_index(first) >> 1)] = packHalf2x16(pair);
}
