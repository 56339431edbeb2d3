// An invocation a light: where the light reaches, as the camera sees it.

layout(local_size_x = LIST_GROUP) in;

#include "clusters/records.glsl"
#include "clusters/bounds.glsl"

void main() {
    uint number = gl_GlobalInvocationID.x;
    if (number == 0u) {
        for (uint i = 0u; i < 4u; ++i) {
            light_lists[i] = pushed.header[i];
        }
    }
    if (number >= local_lights()) {
        return;
    }
    Light light = lights[light_count.y + number];
    float reach = reach_of(light);
    vec3 apex = (frame.view_from_world * vec4(light.position, 1.0)).xyz;
    float away = length(light.position) + length(frame.eye.xyz);
    vec3 middle = apex;
    float radius = widened(reach, away);
    vec2 interval = vec2(-apex.z - radius, -apex.z + radius);
    if (light.kind == LIGHT_SPOT) {
        float cosine = clamp(-light.cone.y / light.cone.x, 0.0, 1.0);
        vec2 sphere = cone_sphere(cosine, reach);
        vec3 axis = (frame.view_from_world * vec4(light.direction, 0.0)).xyz;
        middle = apex + sphere.x * axis;
        radius = widened(sphere.y, away + sphere.x);
        interval = vec2(max(interval.x, -middle.z - radius), min(interval.y, -middle.z + radius));
    }
    Bound bound;
    bound.interval = interval;
    float centre = 0.5 * (interval.x + interval.y);
    uint bits = floatBitsToUint(centre);
    bound.code = (bits & 0x80000000u) != 0u ? ~bits : bits | 0x80000000u;  // integers in the order of the floats
    if (frame.orthographic != 0u) {
        bound.direction = vec3(middle.xy, 0.0);
        bound.angle = vec2(radius, 0.0);
    } else {
        float distance = length(middle);
        bool around = distance <= radius;  // the eye is inside: the light may reach every pixel
        float sine = around ? 0.0 : radius / distance;
        bound.direction = around ? vec3(0.0) : middle / distance;
        // With these numbers the test of tiles.comp is 0 >= -8 (cosine + sine) for any tile.
        bound.angle = around ? vec2(-8.0, 8.0) : vec2(sqrt(max(1.0 - sine * sine, 0.0)), sine);
    }
    store_bound(first_found(pushed.header.x) + uint(LIST_BOUND) * number, bound);
}
