// Averages neighbours within a slice, with weights exp(-(r / 4)^2) and a radius of 2: extinction is averaged with light, so
// that a surface that is dimmed by fog has the light of that fog. At the borders the weights that are left sum to 1.

#include "scene/scene.glsl"
#include "grid.glsl"

layout(BIND(1, 0, 3)) uniform sampler3D fog_light;
layout(BIND(1, 1, 0), FORMAT) uniform writeonly image3D fog_smooth;

const int RADIUS = 2;
const float SIGMA = 4.0;

void main() {
    ivec3 froxel = ivec3(gl_GlobalInvocationID);
    if (!is_froxel(froxel)) {
        return;
    }
    vec4 sum = vec4(0.0);
    float weights = 0.0;
    for (int y = -RADIUS; y <= RADIUS; ++y) {
        for (int x = -RADIUS; x <= RADIUS; ++x) {
            ivec3 tap = froxel + ivec3(x, y, 0);
            if (all(greaterThanEqual(tap, ivec3(0))) && is_froxel(tap)) {
                float weight = exp(-float(x * x + y * y) / (SIGMA * SIGMA));
                sum += weight * texelFetch(fog_light, tap, 0);
                weights += weight;
            }
        }
    }
    imageStore(fog_smooth, froxel, stored(sum / weights));
}
