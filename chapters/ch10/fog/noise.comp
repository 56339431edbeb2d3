// Makes the volume of noise, once: seven octaves from four periods on, and eight texels an invocation. Octaves with more
// than half as many periods as there are texels would need a larger volume; at texel centres they are 0 or alias.

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

#define FOG_WRITTEN
#include "scene/scene.glsl"
#include "gradient_noise.glsl"
#include "fog/noise.glsl"

const int OCTAVES = 7;
const uint FREQUENCY = 4u;

void main() {
    ivec3 first = ivec3(gl_GlobalInvocationID) * ivec3(8, 1, 1);
    if (any(greaterThanEqual(first, ivec3(NOISE_SIZE)))) {
        return;
    }
    uvec4 words = uvec4(0u);
    for (int i = 0; i < 8; i += 2) {
        vec2 pair;
        for (int k = 0; k < 2; ++k) {
            vec3 uvw = (vec3(first + ivec3(i + k, 0, 0)) + 0.5) / float(NOISE_SIZE);
            pair[k] = octaves_of_noise(uvw, FREQUENCY, OCTAVES, 0u);
        }
        words[i >> 1] = packHalf2x16(pair);
    }
    fog_store[fog.places.x + (noise_index(first) >> 3)] = words;
}
