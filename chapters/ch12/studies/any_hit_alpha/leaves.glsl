// Study any-hit-alpha: the ray of a pixel, the card or the ground that it hits, and a ray from there to the light.

#include "studies/eye.glsl"
#ifdef RAYS_PIPELINE  // the any-hit shader has `accept` then
#include "rays/pipeline.glsl"
#else
#include "leaf.glsl"
#include "rays/bvh/traverse.glsl"
#endif
#include "palette.glsl"

layout(BIND(0, 4, 4), std430) readonly buffer Normals_ { vec4 normals[]; };  // of cards

const vec3 TO_LIGHT = vec3(0.4558, 0.7975, 0.3960);
const vec3 SKY = vec3(0.35, 0.5, 0.8);

void run(uvec3 id) {
    if (!in_picture(id.xy)) {
        return;
    }
    CameraRay ray = ray_of(id.xy);
    Hit hit = trace(Ray(ray.origin, 0.0, ray.direction, 1e30), 0xFFu, 0u);
    if (hit.instance == NO_HIT) {
        found_at(id.xy, vec4(SKY, -1.0), uvec4(NO_HIT));
        return;
    }
    bool ground = hit.instance != 0u;
    uint card = hit.primitive >> 1;
    vec3 position = ray.origin + hit.t * ray.direction;
    vec3 normal = ground ? vec3(0.0, 1.0, 0.0) : normals[card].xyz;
    normal = dot(normal, ray.direction) > 0.0 ? -normal : normal;
    float facing = dot(normal, TO_LIGHT);
    // Metres that are enough at this size; rays/picture.glsl has what holds at any.
    bool lit = facing > 0.0 && !occluded(Ray(position + 1e-4 * normal, 0.0, TO_LIGHT, 1e30), 0xFFu, 0u);
    uint hash = scrambled(card + 1u);
    vec3 leaf = mix(vec3(0.05, 0.22, 0.03), vec3(0.5, 0.35, 0.05), float(hash & 255u) / 255.0 * 0.8);
    vec3 color = ground ? vec3(0.5, 0.46, 0.4) : leaf;
    found_at(id.xy, vec4(color * (0.3 + (lit ? 0.9 * facing : 0.0)), hit.t), uvec4(hit.instance, hit.primitive, uint(lit), 0u));
}
