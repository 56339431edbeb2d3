// Sums light along each column, from the eye on: an invocation for a column, since each slice needs those before it.

#define FOG_WRITTEN
#include "scene/scene.glsl"
#include "medium.glsl"
#include "grid.glsl"
#include "finite.glsl"
#include "records.glsl"

layout(BIND(1, 0, 3)) uniform sampler3D fog_light;

void main() {
    ivec3 froxel = ivec3(gl_GlobalInvocationID);
    if (!is_froxel(froxel)) {
        return;
    }
    float stretch = ray_stretch(froxel_uv(froxel), frame.steady_clip_from_view);
    vec4 before = vec4(0.0, 0.0, 0.0, 1.0);
    for (uint z = 0u; z < fog.size.z; ++z) {
        froxel.z = int(z);
        vec4 here = texelFetch(fog_light, froxel, 0);
        write_record(froxel, before, here);
        float end = slice_depth(float(z + 1u) / float(fog.size.z), fog.range.x, fog.range.y);
        float metres = (end - slice_begin(z, fog.size.z, fog.range.x, fog.range.y)) * stretch;
        before = through_segment(before, here.rgb, here.a, metres);
        before.rgb = finite_color(before.rgb);
    }
}
