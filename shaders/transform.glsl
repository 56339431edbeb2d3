// From object space to clip space, written once: every pass that draws the same vertex must get the same bits, or a
// depth test for equality would fail. So the result is `precise`, and shaders that include this declare gl_Position invariant.
//
// The sums are written out. A product of a matrix and a vector leaves their order to the compiler, and compilers differ:
// Mesa's adds from the last column for SPIR-V and from the first for GLSL text. Written out, both backends agree to the bit.

// `world_from_object` has the rows of the affine matrix as its columns, relative to the scene's origin.
vec3 transform_vector(mat3x4 world_from_object, vec3 vector) {
    precise vec3 result = vec3(world_from_object[0].x, world_from_object[1].x, world_from_object[2].x) * vector.x
                        + vec3(world_from_object[0].y, world_from_object[1].y, world_from_object[2].y) * vector.y
                        + vec3(world_from_object[0].z, world_from_object[1].z, world_from_object[2].z) * vector.z;
    return result;
}

vec3 transform_point(mat3x4 world_from_object, vec3 point) {
    precise vec3 result = transform_vector(world_from_object, point)
                        + vec3(world_from_object[0].w, world_from_object[1].w, world_from_object[2].w);
    return result;
}

vec4 matrix_times(mat4 matrix, vec4 vector) {
    precise vec4 result =
        matrix[0] * vector.x + matrix[1] * vector.y + matrix[2] * vector.z + matrix[3] * vector.w;
    return result;
}

// Two steps, not one product of matrices: the camera's distance to the origin leaves before the projection multiplies it.
vec4 clip_position(mat4 clip_from_view, mat4 view_from_world, vec3 world) {
    precise vec4 clip = matrix_times(clip_from_view, matrix_times(view_from_world, vec4(world, 1.0)));
    return clip;
}
