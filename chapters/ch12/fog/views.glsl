// What views show of fog at a surface.

#if VIEW == VIEW_FOG_SLICES
vec3 shown_slice() {
#ifdef FOG
    vec3 view = (frame.view_from_world * vec4(in_position, 1.0)).xyz;
    float w = slice_coordinate(-view.z, fog.range.x, fog.range.y);
    uint slice = min(uint(max(w, 0.0) * float(fog.size.z)), fog.size.z);
    return w > 1.0 ? vec3(0.1) : id_color(slice);
#else
    return vec3(0.4);
#endif
}
#endif

#if VIEW == VIEW_FOG_TRANSMITTANCE
vec3 shown_transmittance() {
#ifdef FOG
    return vec3(fog_before(in_position).a);
#else
    return vec3(1.0);
#endif
}
#endif
