// Which face of a light answers for a point, and which texels of it.

// The place of a point in a face, in texels.
vec2 texel_of(ShadowFace face, vec3 p) {
    vec2 scale = vec2(face.right.w, face.down.w) / (face.ahead.w != 0.0 ? p.z : 1.0);
    return p.xy * scale + 0.5 * float(face.place.z);
}

// Whether the filter at a point stays inside a face of a directional light.
bool covers(ShadowFace face, vec3 position) {
    vec3 p = in_face(face, position);
    vec2 from_middle = abs(p.xy * vec2(face.right.w, face.down.w));
    return all(lessThanEqual(from_middle, vec2(0.5 * float(face.place.z) - face.ends.y))) && p.z <= face.ends.x;
}

// Whether all taps of the filter at a point have memory, and one more on each side: sums may be rounded otherwise there.
bool is_held(ShadowFace face, vec3 position) {
#ifdef SHADOW_COARSE
    vec3 p = in_face(face, position);
    ivec2 texel = ivec2(floor(texel_of(face, vec3(p.xy, max(p.z, face.origin.w)))));
    int radius = int(face.ends.y);
    return is_resident(face, texel - radius, texel + radius);
#else
    return true;
#endif
}

// The face of a light in which a point lies, or -1: the light casts no shadow there. With memory by need a face whose
// tiles are missing leaves its place to a coarser one: the next cascade, or the coarse face, which always has its page.
int face_of(uint light, vec3 position) {
    uint word = shadow_of[light], count = word >> 24;
    int first = int(word & 0xffffffu) - 1;
    if (word == 0u) {
        return -1;
    }
    if (lights[light].kind == LIGHT_DIRECTIONAL) {  // the finest of the cascades that reach as far
        for (int face = first; face < first + int(count); ++face) {
            if (covers(shadow_faces[face], position) && is_held(shadow_faces[face], position)) {
                return face;
            }
        }
        return -1;
    }
#ifdef SHADOW_COARSE
    vec3 origin = shadow_faces[first + SHADOW_COARSE].origin.xyz;
#else
    vec3 origin = shadow_faces[first].origin.xyz;
#endif
    int face = count == 6u ? first + int(cube_face(position - origin)) : first;
#ifdef SHADOW_COARSE
    if (!is_held(shadow_faces[face], position)) {
        face += SHADOW_COARSE;
    }
#endif
    return face;
}
