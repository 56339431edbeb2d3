// From object space to clip space, written once: every pass that draws the same vertex must get the same bits, or a
// depth test for equality would fail. So the result is `precise`, and whoever includes this declares gl_Position invariant.

// `rows` are the three rows of world_from_object, relative to the scene's origin.
vec3 transform_point(vec4 rows[3], vec3 point) {
    precise vec3 result = vec3(
        dot(rows[0].xyz, point) + rows[0].w, dot(rows[1].xyz, point) + rows[1].w, dot(rows[2].xyz, point) + rows[2].w);
    return result;
}

vec3 transform_vector(vec4 rows[3], vec3 vector) {
    return vec3(dot(rows[0].xyz, vector), dot(rows[1].xyz, vector), dot(rows[2].xyz, vector));
}

// Two steps, not one product of matrices: the camera's distance to the origin leaves before the projection multiplies it.
vec4 clip_position(mat4 clip_from_view, mat4 view_from_world, vec3 world) {
    precise vec4 view = view_from_world * vec4(world, 1.0);
    precise vec4 clip = clip_from_view * view;
    return clip;
}
