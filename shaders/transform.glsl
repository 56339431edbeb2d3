// From object space to clip space, written once: every pass that draws the same vertex must get the same bits, or a
// depth test for equality would fail. So the result is `precise`, and whoever includes this declares gl_Position invariant.

// `world_from_object` has the rows of the affine matrix as its columns, relative to the scene's origin.
vec3 transform_point(mat3x4 world_from_object, vec3 point) {
    precise vec3 result = vec4(point, 1.0) * world_from_object;
    return result;
}

vec3 transform_vector(mat3x4 world_from_object, vec3 vector) {
    return vec4(vector, 0.0) * world_from_object;
}

// Two steps, not one product of matrices: the camera's distance to the origin leaves before the projection multiplies it.
vec4 clip_position(mat4 clip_from_view, mat4 view_from_world, vec3 world) {
    precise vec4 view = view_from_world * vec4(world, 1.0);
    precise vec4 clip = clip_from_view * view;
    return clip;
}
