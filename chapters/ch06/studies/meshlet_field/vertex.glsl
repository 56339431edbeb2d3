// Studies of meshlets: a vertex of an instance, for vertex shaders and mesh shaders alike.

layout(BIND(0, 2, 1), std430) readonly buffer Vertices_ {
    float numbers[];  // three floats for each position, then three for each normal
};

struct Vertex {
    vec4 clip;
    vec3 normal;
};

Vertex vertex_of(Instance instance, uint number) {
    uint p = 3u * number, n = p + uint(numbers.length()) / 2u;
    mat3x4 world_from_object = instance.world_from_object;
    vec3 world = transform_point(world_from_object, vec3(numbers[p], numbers[p + 1u], numbers[p + 2u]));
    // Objects are turned and scaled alike in all directions: normals stay perpendicular.
    vec3 normal = transform_vector(world_from_object, vec3(numbers[n], numbers[n + 1u], numbers[n + 2u]));
    return Vertex(clip_position(view.clip_from_view, view.drawn_from_world, world), normal);
}
