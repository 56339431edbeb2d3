// The light that each froxel sends to the eye, per metre: from the lights of its cluster through their shadows, dimmed by
// the medium on the way, and from everywhere alike.

#include "scene/scene.glsl"
#include "clusters/walk.glsl"
#include "shadows/factor.glsl"
#include "medium.glsl"
#include "phase.glsl"
#include "grid.glsl"

layout(BIND(1, 0, 3)) uniform sampler3D fog_medium;
layout(BIND(1, RESULT_BINDING, 0), FORMAT) uniform writeonly image3D fog_light;
#ifdef REPORTS
#define NEEDS_BINDING (RESULT_BINDING + 1)
#ifdef TABLES_BINDING
#define NEEDS_BLOCK 5
#endif
#include "page_table/report.glsl"
#endif

// The optical depth between two points, in closed form. Noise counts by its mean, which is 1.
float optical_depth(vec3 start, vec3 end) {
    float mean = fog.constant.a + fog.height.a * height_mean(start.y, end.y, fog.shape.x, fog.shape.y);
    for (uint i = 0u; i < fog.size.w; ++i) {
        mean += fog.boxes[i].center.w * box_mean(start, end, fog.boxes[i].center.xyz, fog.boxes[i].half_size.xyz);
    }
    return distance(start, end) * mean;
}

// The way from a point to the sun ends at the box around the scene, metres.
float way_out(vec3 position, vec3 direction) {
    vec3 size = max(abs(direction), 1e-20);
    vec3 ways = (fog.bounds.xyz - position * sign(direction)) / size;
    return max(min(ways.x, min(ways.y, ways.z)), 0.0);
}

#ifdef LIT
// One tap: a froxel is wider than the kernel, and filters follow.
float sees_light(uint light, vec3 position, vec3 to_light) {
#ifdef SHADOWS
    int number = face_of(light, position);
    if (number < 0) {
        return 1.0;
    }
    ShadowFace face = shadow_faces[number];
    vec3 p = in_face(face, position);
    if (p.z <= face.origin.w) {
        return 1.0;
    }
    Receiver receiver = receiver_of(face, p, to_light, 0);
    float stored;
    return hides(face, receiver, ivec2(floor(receiver.at)), stored) ? 0.0 : 1.0;
#else
    return 1.0;
#endif
}

#ifdef REPORTS
// Reports the tiles that a froxel reads, as surfaces do (page_table/need.comp), and a resolution at which it has a texel.
void report_use(uint light, vec3 position, float radius) {
    uint word = shadow_of[light], count = word >> 24;
    int face = int(word & 0xffffffu) - 1;
    if (word == 0u) {
        return;
    }
    ShadowFace seen;
    if (lights[light].kind == LIGHT_DIRECTIONAL) {
        int end = face + int(count) - 1;  // but for the coarse one
        while (face < end && !covers(shadow_faces[face], position)) {
            face += 1;
        }
        if (face == end) {
            return;
        }
        seen = shadow_faces[face];
    } else {
        vec3 away = position - shadow_faces[face + SHADOW_COARSE].origin.xyz;
        float s = radius * radius / max(dot(away, away), 1e-30);  // the sine of half the froxel's angle, squared
        float solid_angle = 2.0 * PI * s / (1.0 + sqrt(max(1.0 - s, 0.0)));
        need_resolution(lamp_of(face), sqrt(4.0 * PI / (6.0 * max(solid_angle, 1e-30))));
        face += count == 6u ? int(cube_face(away)) : 0;
        seen = shadow_faces[face];
        if (seen.place.z == 0u) {
            seen = shadow_faces[face + SHADOW_COARSE];
        }
    }
    vec3 p = in_face(seen, position);
    if (p.z > seen.origin.w) {
        vec2 texel = texel_of(seen, p);
        float size = float(seen.place.z);
        need_tiles(face, (texel - seen.ends.y - 2.0) / size, (texel + seen.ends.y + 2.0) / size);
    }
}
#endif

// Half the diagonal of a froxel, metres, `view` being a point of it in view space.
float radius_of(ivec3 froxel, vec3 view) {
    float w = float(froxel.z + 1) / float(fog.size.z);
    float thick = slice_depth(w, fog.range.x, fog.range.y)
        - slice_begin(uint(froxel.z), fog.size.z, fog.range.x, fog.range.y);
    vec3 next = view_from_volume(froxel_uv(froxel) + 1.0 / vec2(fog.size.xy), -view.z, frame.steady_clip_from_view);
    return 0.5 * length(vec3(next.xy - view.xy, thick));
}

#ifdef REPORTS
bool in_medium(vec3 position) {
    bool inside = fog.constant.a + fog.height.a > 0.0;
    for (uint i = 0u; i < fog.size.w; ++i) {
        FogBox box = fog.boxes[i];
        inside = inside || box.center.w * box_density(position, box.center.xyz, box.half_size.xyz) > 0.0;
    }
    return inside;
}

// A froxel reports what its far end reads, in all frames: its near end is that of the froxel before. Tiles that only the
// random depths of some frames ask for would come and go, and a view would never rest.
void report_froxel(ivec3 froxel) {
    float depth = slice_sample(uint(froxel.z), 1.0, fog.size.z, fog.range.x, fog.range.y);
    vec3 view = view_from_volume(froxel_uv(froxel), depth, frame.steady_clip_from_view);
    vec3 position = world_of(view);
    if (!in_medium(position)) {
        return;
    }
    float radius = radius_of(froxel, view);
    LightWalk walk = first_light(position, froxel_uv(froxel) * frame.size.xy);
    for (uint i; next_light(walk, i);) {
        vec3 to_light;
        vec3 received = illuminance(lights[i], position, radius * radius, to_light);
        if (max(received.r, max(received.g, received.b)) > 0.0) {
            report_use(i, position, radius);
        }
    }
}
#endif

// `leaving` is the direction to the eye, `radius` half the froxel: nearer lights are not told apart, and 1/r^2 is finite.
vec3 light_of(uint number, vec3 position, vec3 leaving, float radius) {
    Light light = lights[number];
    light.color *= exposure();
    vec3 to_light;
    vec3 received = illuminance(light, position, radius * radius, to_light);
    if (!(max(received.r, max(received.g, received.b)) > 0.0)) {
        return vec3(0.0);
    }
    float visible = sees_light(number, position, to_light);
    if (visible == 0.0) {
        return vec3(0.0);
    }
    bool far_away = light.kind == LIGHT_DIRECTIONAL;
    vec3 end = far_away ? position + to_light * way_out(position, to_light) : light.position;
    float phase = henyey_greenstein(one_minus_cosine(-to_light, leaving), fog.range.w);
    return received * (visible * phase * exp(-optical_depth(position, end)));
}
#endif

void main() {
    ivec3 froxel = ivec3(gl_GlobalInvocationID);
    if (!is_froxel(froxel)) {
        return;
    }
#if defined(REPORTS) && defined(LIT)
    if (shadow_asks[2].x != 0u) {  // the frame tells its report to the CPU
        report_froxel(froxel);
    }
#endif
    vec4 medium = texelFetch(fog_medium, froxel, 0);
    vec3 light = vec3(0.0);
    if (max(medium.r, max(medium.g, medium.b)) > 0.0) {
        vec3 view = froxel_sample(froxel);
        vec3 position = world_of(view);
        vec3 leaving = frame.orthographic != 0u ? vec3(0.0, 0.0, 1.0) : -normalize(view);
        leaving = mat3(frame.world_from_view) * leaving;
        light = (frame.ambient.rgb + fog.ambient.rgb) * exposure();
#ifdef LIT
        float radius = radius_of(froxel, view);
        LightWalk walk = first_light(position, froxel_uv(froxel) * frame.size.xy);
        for (uint i; next_light(walk, i);) {
            light += light_of(i, position, leaving, radius);
        }
#endif
    }
    light *= medium.rgb;
    light = clamp(mix(light, vec3(0.0), isnan(light)), 0.0, LARGEST_LIGHT);
    imageStore(fog_light, froxel, stored(vec4(light, medium.a)));
}
