// How much of a light reaches a point past the casters between them: percentage-closer filtering of its shadow map.
//
// The filter compares first and averages the answers (Reeves, Salesin and Cook, "Rendering Antialiased Shadows with Depth
// Maps", SIGGRAPH 1987). All lengths of the bias are in texels at the point: a texel covers a length that grows with the
// distance from the light.

#ifdef SHADOWS
const float SHADOW_LEAST_FACING = 0.01;  // cosine beyond which slopes count no more: 89.4 degrees

float shadow_stored(ShadowFace face, ivec2 texel) {
    texel = clamp(texel, ivec2(0), ivec2(int(face.place.z) - 1));
    return imageLoad(shadow_pages, page_texel(face, texel)).r;
}

// The part of the taps that is lit. `normal` is of unit length and towards the light.
float face_factor(ShadowFace face, vec3 position, vec3 normal) {
    vec3 p = in_face(face, position);
    bool perspective = face.ahead.w != 0.0;
    if (p.z <= face.origin.w) {
        return 1.0;  // nearer than any caster
    }
    int radius = int(face.ends.y) - 1;  // of the kernel, read from memory: a loop that is unrolled compiles long
    vec2 scale = vec2(face.right.w, face.down.w);  // texels for each metre
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
    float bias = footprint * (SHADOW_CONSTANT + SHADOW_SLOPE * slope);
    vec2 gradient = n.xy / (scale * facing);  // metres of depth for each texel
    if (perspective) {
        gradient = -n.xy / (scale * p.z * facing * length(p));
    }
#elif SHADOW_BIAS == 1
    float bias = footprint * (SHADOW_CONSTANT + (SHADOW_SLOPE + 1.4143 * (float(radius) + 0.5)) * slope);
    const vec2 gradient = vec2(0.0);
#else
    const float bias = 0.0;
    const vec2 gradient = vec2(0.0);
#endif
    ivec2 middle = ivec2(floor(at));
    float lit = 0.0;
    for (int y = -radius; y <= radius; ++y) {
        for (int x = -radius; x <= radius; ++x) {
            ivec2 texel = middle + ivec2(x, y);
            float change = dot(gradient, vec2(texel) + 0.5 - at);
            float stored = shadow_stored(face, texel);
            bool nearer = perspective ? stored * (1.0 / p.z + change) < 1.0 - bias / p.z : stored < p.z + change - bias;
            lit += nearer ? 0.0 : 1.0;
        }
    }
    return lit / float((2 * radius + 1) * (2 * radius + 1));
}

// Whether the filter at a point stays inside a face of a directional light.
bool covers(ShadowFace face, vec3 position) {
    vec3 p = in_face(face, position);
    vec2 from_middle = abs(p.xy * vec2(face.right.w, face.down.w));
    return all(lessThanEqual(from_middle, vec2(0.5 * float(face.place.z) - face.ends.y))) && p.z <= face.ends.x;
}

// The face of a light in which a point lies, or -1: the light casts no shadow there.
int face_of(uint light, vec3 position) {
    uint word = shadow_of[light], count = word >> 24;
    int first = int(word & 0xffffffu) - 1;
    if (word == 0u) {
        return -1;
    }
    if (lights[light].kind == LIGHT_DIRECTIONAL) {  // the finest of the cascades that reach as far
        for (int face = first; face < first + int(count); ++face) {
            if (covers(shadow_faces[face], position)) {
                return face;
            }
        }
        return -1;
    }
    return count == 6u ? first + int(cube_face(position - shadow_faces[first].origin.xyz)) : first;
}

float shadow_factor(uint light, vec3 position, vec3 normal) {
    int face = face_of(light, position);
    return face < 0 ? 1.0 : face_factor(shadow_faces[face], position, normal);
}
#else
float shadow_factor(uint light, vec3 position, vec3 normal) { return 1.0; }
#endif
