// What the views of shadows show.

#if VIEW == VIEW_SHADOW_FACTOR
// The part of the light that arrives, of all that would arrive without casters. `view` points to the eye.
float shown_shadow(vec3 view) {
    float all = 0.0, arrives = 0.0;
#if defined(LIT) && defined(SHADED)
    float length2 = dot(in_normal, in_normal);
    vec3 n = length2 > 0.0 ? in_normal * inversesqrt(length2) : view;
#ifdef DOUBLE_SIDED
    n = gl_FrontFacing ? n : -n;
#endif
    LightWalk walk = first_light(in_position, gl_FragCoord.xy);
    for (uint i; next_light(walk, i);) {
        vec3 to_light;
        vec3 received = exposed_illuminance(i, in_position, to_light) * max(dot(n, to_light), 0.0);
        float light = min(max(received.r, max(received.g, received.b)), 1e30);
        if (light > 0.0) {
            all += light;
            arrives += light * shadow_factor(i, in_position, n);
        }
    }
#endif
    return all > 0.0 ? arrives / all : 0.0;
}
#endif

#if VIEW == VIEW_CASCADE
vec3 shown_cascade() {
#if defined(LIT) && defined(SHADOWS)
    int face = light_count.y > 0u ? face_of(0u, in_position) : -1;
    if (face >= 0) {
        int cascade = face + 1 - int(shadow_of[0] & 0xffffffu);
        return 0.25 + 0.75 * vec3(cascade == 0 || cascade == 3, cascade == 1 || cascade == 3, cascade == 2);
    }
#endif
    return vec3(0.25);
}
#endif

#if VIEW >= VIEW_RESIDENCY && VIEW <= VIEW_REDRAWN_PAGES
// What there is of the map of the light that gives most to the point.
vec3 shown_map() {
    const vec3 NO_MAP = vec3(0.25);
#if defined(LIT) && defined(SHADOWS)
    float most = 0.0;
    int number = -1;
    LightWalk walk = first_light(in_position, gl_FragCoord.xy);
    for (uint i; next_light(walk, i);) {
        vec3 to_light;
        vec3 received = exposed_illuminance(i, in_position, to_light);
        float light = max(received.r, max(received.g, received.b));
        if (light > most) {
            most = light;
            number = face_of(i, in_position);
        }
    }
    if (number < 0) {
        return NO_MAP;
    }
    ShadowFace face = shadow_faces[number];
    ivec2 texel = ivec2(floor(texel_of(face, in_face(face, in_position))));
    texel = clamp(texel, ivec2(0), ivec2(int(face.place.z) - 1)) + ivec2(face.ends.zw);
    uint page = page_word(face, texel >> SHADOW_TILE_LOG2);
#if VIEW == VIEW_RESIDENCY
    return id_color(page & ~SHADOW_COPIED);
#elif VIEW == VIEW_SHADOW_RESOLUTION
    uint size = face.place.z;
    return size < 128u ? vec3(0.2, 0.4, 1.0) : size < 256u ? vec3(0.2, 0.8, 0.3) : size < 512u ? vec3(0.9, 0.8, 0.2)
         : size < 1024u ? vec3(1.0, 0.5, 0.1) : vec3(1.0);
#else
    return (page & SHADOW_COPIED) != 0u ? vec3(1.0, 0.6, 0.1) : vec3(0.3, 0.6, 1.0);
#endif
#else
    return NO_MAP;
#endif
}
#endif
