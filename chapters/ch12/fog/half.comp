// The fog before the surface of each second pixel in each second row, with the depth of the surface.

layout(local_size_x = 8, local_size_y = 8) in;

#define FOG_WRITTEN
#include "scene/scene.glsl"
#include "fog/apply.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D depth;

void main() {
    ivec2 place = ivec2(gl_GlobalInvocationID.xy), size = ivec2(frame.size.xy), pixel = min(2 * place, size - 1);
    if (any(greaterThanEqual(place, (size + 1) / 2))) {
        return;
    }
    float d = texelFetch(depth, pixel, 0).r, ahead = fog.range.z;
    vec2 uv = (vec2(pixel) + 0.5) * frame.size.zw;
    if (d > 0.0) {
        vec4 in_view = frame.view_from_clip * vec4(uv * 2.0 - 1.0, d, 1.0);
        ahead = min(-in_view.z / in_view.w, ahead);
    }
    uint at = fog.places.z + uint(place.y) * fog.places.w + uint(place.x);
    fog_store[at] = uvec4(halves_of(fog_to(uv, ahead)), floatBitsToUint(ahead), 0u);
}
