// The ray of a place in the picture: through the inverse matrices, so that whatever shifts or scales the picture is in it.

struct CameraRay {
    vec3 origin;     // the eye; for an orthographic view, on its near plane
    vec3 direction;  // of length 1
};

// `uv` is 0 to 1 from the upper left corner; a pixel's centre is (pixel + 0.5) / size. In view space the eye is 0: the
// division by w comes before anything is rotated, and the place of the eye never meets the direction. (A clip position
// that is taken to the world at once would have the eye subtracted from it again, with its roundings.)
CameraRay camera_ray(vec2 uv, mat4 view_from_clip, mat4 world_from_view, bool orthographic) {
    vec4 near = view_from_clip * vec4(2.0 * uv - 1.0, 1.0, 1.0);  // the near plane has depth 1
    vec3 view = near.xyz / near.w;
    if (orthographic) {
        return CameraRay((world_from_view * vec4(view, 1.0)).xyz, -normalize(world_from_view[2].xyz));
    }
    return CameraRay(world_from_view[3].xyz, normalize(mat3(world_from_view) * normalize(view)));
}
