// What the opaque surfaces of a picture need of shadow maps: an invocation for each pixel.
//
// The pixels of a block of 2x2 within one slice of depth are a cluster. A lamp needs as many texels for each steradian as
// the cluster has pixels in its solid angle as seen from the lamp (rule.py), at most over all clusters. And each pixel needs
// the tiles that its filter reads. With larger blocks more lamps are inside of a cluster, and ask for the most.

layout(local_size_x = 8, local_size_y = 8) in;

#include "scene/scene.glsl"
#include "clusters/walk.glsl"
#include "shadows/choice.glsl"

#ifdef SAMPLES
layout(BIND(1, 0, 3)) uniform sampler2DMS depth;
#else
layout(BIND(1, 0, 3)) uniform sampler2D depth;
#define SAMPLES 1
#endif
#define NEEDS_BINDING 1
#include "page_table/report.glsl"

shared vec4 places[64];  // xyz: the surface of a pixel, w: its slice of depth, from 1 on; 0 for none

vec3 position_of(ivec2 pixel, float d, out float ahead) {
    vec2 ndc = (vec2(pixel) + 0.5) * (2.0 * frame.size.zw) - 1.0;
    vec4 in_view = frame.view_from_clip * vec4(ndc, d, 1.0);
    vec3 p = in_view.xyz / in_view.w;
    ahead = max(-p.z, 1e-30);
    return (frame.world_from_view * vec4(p, 1.0)).xyz;
}

// Four slices for each factor of 2 in depth. An orthographic view may look at a depth of 0.
float slice_of(float ahead) { return 4096.0 + floor(4.0 * log2(ahead)); }

// The sphere around the cluster of an invocation, and its number of pixels.
vec4 cluster_sphere(float ahead, out float pixels) {
    vec4 own = places[gl_LocalInvocationIndex];
    vec3 low = own.xyz, high = own.xyz;
    pixels = 0.0;
    for (uint i = 0u; i < 4u; ++i) {
        vec4 place = places[(gl_LocalInvocationIndex & ~9u) | (i & 1u) | (i & 2u) << 2];
        if (place.w == own.w) {
            low = min(low, place.xyz);
            high = max(high, place.xyz);
            pixels += 1.0;
        }
    }
    return vec4(0.5 * (low + high), 0.5 * length(high - low) + 0.7072 * pixel_at(ahead));
}

// Texels along a face for as many in the solid angle of a sphere as it has pixels. The solid angle of a sphere is
// 2 pi (1 - sqrt(1 - s)) with s = (r / d)^2, here without the difference of equal numbers.
// A sphere with the light inside has no solid angle. No point of it is farther from the light than its far side, where a
// pixel of width w at distance d covers (w / d)^2 steradians.
float texels_for(vec4 sphere, float pixels, float ahead, vec3 light) {
    vec3 away = sphere.xyz - light;
    float distance2 = max(dot(away, away), 1e-30), s = sphere.w * sphere.w / distance2;
    float solid_angle = 2.0 * PI * s / (1.0 + sqrt(max(1.0 - s, 0.0)));
    if (s >= 1.0) {
        float wide = pixel_at(ahead) / (sqrt(distance2) + sphere.w);
        solid_angle = pixels * wide * wide;
    }
    return min(sqrt(4.0 * PI * pixels / (6.0 * max(solid_angle, 1e-30))), MOST_TEXELS);
}

void need_of(uint light, vec3 position, vec4 sphere, float pixels, float ahead) {
    uint word = shadow_of[light], count = word >> 24;
    int face = int(word & 0xffffffu) - 1;
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
        vec3 origin = shadow_faces[face + SHADOW_COARSE].origin.xyz;
        need_resolution(lamp_of(face), texels_for(sphere, pixels, ahead, origin));
        face += count == 6u ? int(cube_face(position - origin)) : 0;
        seen = shadow_faces[face];
        if (seen.place.z == 0u) {
            seen = shadow_faces[face + SHADOW_COARSE];
        }
    }
    vec3 p = in_face(seen, position);
    if (p.z > seen.origin.w) {
        float size = float(seen.place.z);
        vec2 texel = texel_of(seen, p);
        need_tiles(face, (texel - seen.ends.y - 2.0) / size, (texel + seen.ends.y + 2.0) / size);
    }
}

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    bool inside = all(lessThan(pixel, ivec2(frame.size.xy)));
    float ahead = 0.0, pixels = 0.0;
    vec4 sphere = vec4(0.0);
    for (int i = 0; i < SAMPLES; ++i) {
        float d = inside ? texelFetch(depth, pixel, i).r : 0.0;
        bool valid = d > 0.0;
        vec3 position = valid ? position_of(pixel, d, ahead) : vec3(0.0);
        barrier();
        places[gl_LocalInvocationIndex] = vec4(position, valid ? slice_of(ahead) : 0.0);
        barrier();
        if (valid) {
            sphere = cluster_sphere(ahead, pixels);
            LightWalk walk = first_light(position, vec2(pixel));
            for (uint light; next_light(walk, light);) {
                vec3 to_light;
                if (shadow_of[light] != 0u) {
                    vec3 received = exposed_illuminance(light, position, to_light);
                    if (max(received.r, max(received.g, received.b)) > 0.0) {
                        need_of(light, position, sphere, pixels, ahead);
                    }
                }
            }
        }
    }
}
