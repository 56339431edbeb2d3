// How much of a light reaches a point past the casters between them: percentage-closer filtering of its shadow map.
//
// The filter compares first and averages the answers (Reeves, Salesin and Cook, "Rendering Antialiased Shadows with Depth
// Maps", SIGGRAPH 1987). All lengths of the bias are in texels at the point: a texel covers a length that grows with the
// distance from the light.

#ifdef SHADOWS
#include "shadows/choice.glsl"

// Texels on each side of the kernel. If it is below 0 they are read from the face: a loop that is unrolled runs faster, and
// takes longer to compile.
layout(constant_id = 9) const int SHADOW_RADIUS = -1;

const float SHADOW_LEAST_FACING = 0.01;  // cosine beyond which slopes count no more: 89.4 degrees

float shadow_stored(ShadowFace face, ivec2 texel) {
    texel = clamp(texel, ivec2(0), ivec2(int(face.place.z) - 1));
    return imageLoad(shadow_pages, page_texel(face, texel)).r;
}

// A point as a face sees it.
struct Receiver {
    vec3 p;         // metres along the axes of the face
    vec2 scale;     // texels for each metre
    vec2 at;        // its place, in texels
    vec2 gradient;  // of the plane's depth, or in a perspective projection of its inverse, for each texel
    float bias;     // metres
};

// `normal` is of unit length and towards the light, `radius` that of the kernel in texels.
Receiver receiver_of(ShadowFace face, vec3 p, vec3 normal, int radius) {
    bool perspective = face.ahead.w != 0.0;
    vec2 scale = vec2(face.right.w, face.down.w);
    vec3 ray = vec3(0.0, 0.0, 1.0);
    if (perspective) {
        scale /= p.z;
        ray = normalize(p);
    }
    vec2 at = p.xy * scale + 0.5 * float(face.place.z);
    float footprint = 1.0 / min(scale.x, scale.y);
    vec3 n = vec3(dot(face.right.xyz, normal), dot(face.down.xyz, normal), dot(face.ahead.xyz, normal));
    float facing = clamp(-dot(n, ray), SHADOW_LEAST_FACING, 1.0);
    float slope = sqrt(1.0 - facing * facing) / facing;
#if SHADOW_BIAS == 0
    // The plane of the surface at the centre of each tap. Depth was rasterised at centres, too, so a plane is compared with
    // itself. The depth of a plane is an affine function of the texel; in a perspective projection its inverse is.
    float bias = footprint * (shadow_filter.x + shadow_filter.y * slope);
    vec2 gradient = perspective ? -n.xy / (scale * p.z * facing * length(p)) : n.xy / (scale * facing);
#elif SHADOW_BIAS == 1
    // The depth of the plane at the corner of the kernel, to first order: where it is nearer, it changes by less than that.
    float change = length(n.xy) * ray.z / facing;
    float bias = footprint * (shadow_filter.x + shadow_filter.y * slope + 1.4143 * (float(radius) + 0.5) * change);
    const vec2 gradient = vec2(0.0);
#else
    const float bias = 0.0;
    const vec2 gradient = vec2(0.0);
#endif
    return Receiver(p, scale, at, gradient, bias);
}

// Whether a caster lies before the receiver at a texel; `stored` is its depth.
bool hides(ShadowFace face, Receiver receiver, ivec2 texel, out float stored) {
    float change = dot(receiver.gradient, vec2(texel) + 0.5 - receiver.at), depth = receiver.p.z;
    stored = shadow_stored(face, texel);
    return face.ahead.w != 0.0 ? stored * (1.0 / depth + change) < 1.0 - receiver.bias / depth
                               : stored < depth + change - receiver.bias;
}

#ifdef SHADOW_SOFT
// Percentage-closer soft shadows (Fernando, "Percentage-Closer Soft Shadows", SIGGRAPH sketches 2005): the mean depth of
// what hides the light near the point says how wide its image is, through a hole at that depth, in texels.
float soft_factor(ShadowFace face, Receiver receiver, float most) {
    const int STEPS = 3;
    bool perspective = face.ahead.w != 0.0;
    float depth = receiver.p.z, nearest = max(face.origin.w, 0.02 * depth), stored;
    // The radius of the image of the light, for each unit of 1 / depth, or of depth.
    float width = perspective ? shadow_filter.z * frame.eye.w * face.right.w : shadow_filter.w * min(receiver.scale.x, receiver.scale.y);
    float widest = width * (perspective ? 1.0 / nearest - 1.0 / depth : depth);
    float search = clamp(widest, 1.0, most), sum = 0.0, hidden = 0.0;
    for (int y = -STEPS; y <= STEPS; ++y) {
        for (int x = -STEPS; x <= STEPS; ++x) {
            if (hides(face, receiver, ivec2(floor(receiver.at + vec2(x, y) * search / float(STEPS))), stored)) {
                sum += stored;
                hidden += 1.0;
            }
        }
    }
    if (hidden == 0.0) {
        return 1.0;
    }
    float mean = sum / hidden;
    float radius = clamp(width * (perspective ? 1.0 / mean - 1.0 / depth : depth - mean), 0.5, most);
    // Taps in steps of at most a texel, within a disc.
    int taps = int(ceil(radius));
    float lit = 0.0, all = 0.0;
    for (int y = -taps; y <= taps; ++y) {
        for (int x = -taps; x <= taps; ++x) {
            vec2 offset = vec2(x, y) * (radius / float(taps));
            if (dot(offset, offset) <= radius * radius) {
                lit += hides(face, receiver, ivec2(floor(receiver.at + offset)), stored) ? 0.0 : 1.0;
                all += 1.0;
            }
        }
    }
    return lit / all;
}
#endif

// The part of the light that reaches a point: the mean over the taps of the filter.
float face_factor(ShadowFace face, vec3 position, vec3 normal) {
    vec3 p = in_face(face, position);
    if (p.z <= face.origin.w) {
        return 1.0;  // nearer than any caster
    }
    int radius = SHADOW_RADIUS < 0 ? int(face.ends.y) - 1 : SHADOW_RADIUS;
    Receiver receiver = receiver_of(face, p, normal, radius);
#ifdef SHADOW_SOFT
    return soft_factor(face, receiver, float(radius));
#else
    float lit = 0.0, stored;
    for (int y = -radius; y <= radius; ++y) {
        for (int x = -radius; x <= radius; ++x) {
            lit += hides(face, receiver, ivec2(floor(receiver.at)) + ivec2(x, y), stored) ? 0.0 : 1.0;
        }
    }
    return lit / float((2 * radius + 1) * (2 * radius + 1));
#endif
}

float shadow_factor(uint light, vec3 position, vec3 normal) {
    int face = face_of(light, position);
    return face < 0 ? 1.0 : face_factor(shadow_faces[face], position, normal);
}
#else
float shadow_factor(uint light, vec3 position, vec3 normal) { return 1.0; }
#endif
