// What blended objects need of shadow maps, whose depth no pass writes: an invocation for each object and light, by the
// object's box. It asks for too much, and never for too little.

layout(local_size_x = 64) in;

#include "scene/scene.glsl"
#include "shadows/choice.glsl"
#define NEEDS_BINDING 0
#include "page_table/report.glsl"

bool is_seen(vec3 centre, float radius) {
    mat4 rows = transpose(frame.steady_clip_from_world);
    for (int i = 0; i < 4; ++i) {
        vec4 plane = rows[3] + (i % 2 == 0 ? 1.0 : -1.0) * rows[i / 2];
        if (dot(plane.xyz, centre) + plane.w < -radius * length(plane.xyz)) {
            return false;
        }
    }
    return true;
}

void main() {
    uint number = gl_GlobalInvocationID.x, light = gl_GlobalInvocationID.y, word = shadow_of[light];
    if (number >= frame.instance_count || word == 0u) {
        return;
    }
    Instance instance = instance_of(number);
    bool blended = (shadow_blended[instance.material >> 5] >> (instance.material & 31u) & 1u) != 0u;
    vec3 centre = instance.bounds_centre.xyz, extent = instance.bounds_extent.xyz;
    float radius = length(extent);
    if (!blended || (instance.flags & INSTANCE_VISIBLE) == 0u || !is_seen(centre, radius)) {
        return;
    }
    int first = int(word & 0xffffffu) - 1, end = first + int(word >> 24);
    bool of_sun = lights[light].kind == LIGHT_DIRECTIONAL;
    if (of_sun) {
        end -= 1;  // the coarse face
    } else {
        ShadowFace coarse = shadow_faces[first + SHADOW_COARSE];
        float away = length(centre - coarse.origin.xyz);
        if (away - radius > coarse.ends.x) {
            return;
        }
        // A pixel of width w at distance d from a light covers (w / d)^2 steradians (rule.py).
        float ahead = -(frame.view_from_world * vec4(centre, 1.0)).z - radius;
        float pixel = pixel_at(max(ahead, max(frame.near, 0.05 * coarse.ends.x)));
        float texels = sqrt(4.0 * PI / 6.0) * min(away + radius, coarse.ends.x) / max(pixel, 1e-30);
        need_resolution(lamp_of(first), min(texels, MOST_TEXELS));
    }
    for (int face = first; face < end; ++face) {
        ShadowFace seen = shadow_faces[face];
        if (seen.place.z == 0u) {
            seen = shadow_faces[face + SHADOW_COARSE];
        }
        vec3 p = in_face(seen, centre);
        vec3 size = vec3(
            dot(abs(seen.right.xyz), extent), dot(abs(seen.down.xyz), extent), dot(abs(seen.ahead.xyz), extent)
        );
        vec2 low = p.xy - size.xy, high = p.xy + size.xy;
        if (seen.ahead.w != 0.0) {
            float near = p.z - size.z, far = p.z + size.z;
            if (far <= seen.origin.w) {
                continue;
            }
            near = max(near, seen.origin.w);
            low = min(low / near, low / far);
            high = max(high / near, high / far);
        }
        vec2 scale = vec2(seen.right.w, seen.down.w) / float(seen.place.z);
        float margin = (seen.ends.y + 2.0) / float(seen.place.z);
        need_tiles(face, low * scale + 0.5 - margin, high * scale + 0.5 + margin);
    }
}
