// The motion of a vertex: clip coordinates now, and how far they have shifted since the frame before, both without jitter.
//
// Fragments interpolate these two and divide then, since positions in the picture are not linear over a triangle. A shift
// that is zero at all vertices stays exactly zero.

const vec4 OUTSIDE = vec4(2.0, 2.0, 2.0, 1.0);  // a triangle with all vertices here is clipped

bool moves(Instance instance) { return (instance.flags & (INSTANCE_MOVED | INSTANCE_DEFORMING)) != 0u; }

// Returns a vertex's position in the frame before; deforming vertices have it in the page of that frame's slot.
vec3 previous_position(uint first, uint vertex) {
#ifdef PREVIOUS_WORDS
    uint at = first + 3u * vertex;
    return uintBitsToFloat(uvec3(previous_words[at], previous_words[at + 1u], previous_words[at + 2u]));
#else
    return fetch3(first, vertex);
#endif
}

vec3 clip_now(vec3 world) {
    return clip_position(frame.steady_clip_from_view, frame.view_from_world, world).xyw;
}

vec3 clip_shift(vec3 now, Instance instance, uint first, uint vertex) {
    vec3 world = transform_point(instance.previous_world_from_object, previous_position(first, vertex));
    precise vec3 shift =
        clip_position(frame.previous_steady_clip_from_view, frame.previous_view_from_world, world).xyw - now;
    return shift;
}
