// What is in each froxel: scattering in three channels and extinction, per metre, of the sum of all media.

#include "scene/scene.glsl"
#include "medium.glsl"
#include "grid.glsl"
#ifdef NOISE_SIZE
#define FROXELS
#include "fog/noise.glsl"
#endif

layout(BIND(1, RESULT_BINDING, 0), FORMAT) uniform writeonly image3D fog_medium;

void main() {
    ivec3 froxel = ivec3(gl_GlobalInvocationID);
    if (!is_froxel(froxel)) {
        return;
    }
    vec3 position = world_of(froxel_sample(froxel));
    vec4 medium = vec4(fog.constant.rgb, 1.0) * fog.constant.a;
    medium += vec4(fog.height.rgb, 1.0) * (fog.height.a * height_density(position.y, fog.shape.x, fog.shape.y));
    for (uint i = 0u; i < fog.size.w; ++i) {
        FogBox box = fog.boxes[i];
        medium += vec4(box.albedo.rgb, 1.0) * (box.center.w * box_density(position, box.center.xyz, box.half_size.xyz));
    }
#ifdef NOISE_SIZE
    medium *= noise_factor(position);
#endif
    imageStore(fog_medium, froxel, stored(medium));
}
