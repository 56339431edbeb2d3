void camera_ray(mat4 view_from_clip, mat4 world_from_view, vec2 ndc, bool orthographic, out vec3 origin, out vec3 direction) {
    vec4 near = view_from_clip * vec4(ndc, 1.0, 1.0);
    vec3 at = near.xyz / near.w;
    origin = (world_from_view * vec4(orthographic ? vec3(at.xy, 0.0) : vec3(0.0), 1.0)).xyz;
    direction = normalize(mat3(world_from_view) * (orthographic ? vec3(0.0, 0.0, -1.0) : at));
}
