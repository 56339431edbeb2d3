// Where forward.frag leaves a blended surface that is composited later. LISTS: in the list of its pixel, and only if the
// pool is too small for all layers of the frame, as without lists, in two targets of weighted blending.

#include "transparency/weights.glsl"
#ifdef LISTS
#define POOL_SET 3
#define KEYS
#include "transparency/pool.glsl"
#endif

layout(early_fragment_tests) in;

layout(location = 0) out vec4 out_sum;     // rgb are added, and what is there of a is multiplied by 1 - a
layout(location = 1) out vec4 out_weight;  // r is added

void store_layer(vec3 color, float alpha) {
    alpha = alpha >= 0.0 ? min(alpha, 1.0) : 0.0;  // NaN becomes 0
#ifdef LISTS
    if (pool.overflow == 0u) {
        uint place = atomicAdd(pool.words[pixel_number(uvec2(gl_FragCoord.xy))], 1u);
        if (place < pool.capacity) {
            keys[place] = uvec4(floatBitsToUint(gl_FragCoord.z), in_instance, uint(gl_PrimitiveID), place);
            colors[place] = vec4(color, alpha);
        }
        discard;
    }
#endif
    float ahead = dot(frame.world_from_view[2].xyz, frame.eye.xyz - in_position);
    float weight = alpha * layer_weight(alpha, max(ahead, 0.0), frame.eye.w);
    out_sum = vec4(color * weight, alpha);
    out_weight = vec4(weight, 0.0, 0.0, alpha);
}
