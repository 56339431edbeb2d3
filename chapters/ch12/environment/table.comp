// The BRDF in light that is the same from everywhere: A, B and W of shaders/ibl.glsl for every cosine and roughness.
//
// Half vectors are drawn as the view sees them; then Fresnel's w and the masking of the light are all that is left of the
// integrand. The light that the diffuse part sends back needs directions of its own, drawn with the cosine as density.

#include "sampling.glsl"
#include "ggx_sampling.glsl"
#include "ibl.glsl"
#include "half.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

struct Push {
    uvec4 size;   // x: columns and rows, y: samples
};
PUSH(Push, push)

layout(BIND(0, 0, 0), FORMAT) uniform writeonly image2D target;

void main() {
    uvec2 id = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(id, push.size.xx))) {
        return;
    }
    vec2 point = table_point(id, push.size.x);
    float alpha = point.y * point.y;
    vec3 v = vec3(sqrt(max(1.0 - point.x * point.x, 0.0)), 0.0, point.x);
    float inverse_count = 1.0 / float(push.size.y);
    vec3 sum = vec3(0.0);
    for (uint i = 0u; i < push.size.y; ++i) {
        vec2 u = hammersley(i, inverse_count) + 0.5 * inverse_count;
        vec3 h = sample_ggx(u, v, alpha);
        float v_dot_h = max(dot(v, h), 0.0);
        float n_dot_l = 2.0 * v_dot_h * h.z - v.z;
        if (n_dot_l > 0.0) {
            float w = schlick_weight(v_dot_h);
            sum.xy += masking_ggx(n_dot_l, alpha) * vec2(1.0 - w, w);
        }
        vec3 l = sample_cosine(u);
        sum.z += schlick_weight(sqrt(max(0.5 + 0.5 * dot(v, l), 0.0)));
    }
    imageStore(target, ivec2(id), vec4(nearest_half(sum * inverse_count), 1.0));
}
