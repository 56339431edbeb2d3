// Rays through a lens: a thin one, whose opening is a disc. What is as far ahead as the focus is sharp; the light of other points
// spreads over the circle of shaders/circle_of_confusion.glsl, which has the same lens.

#ifdef LENS
// The distance ahead of the camera that is in focus: that of the settings, or of what the middle of the picture shows. 0 where
// there is nothing, or rays are parallel: then all is sharp.
float focus_ahead() {
    if (frame.orthographic != 0u || FOCUS_DISTANCE > 0.0) {
        return frame.orthographic != 0u ? 0.0 : FOCUS_DISTANCE;
    }
    CameraRay middle = camera_ray(vec2(0.5), frame.view_from_clip, frame.world_from_view, false);
    Hit hit = trace_path(Ray(middle.origin, path_begin(0u), middle.direction, FAR), true);
    return hit.instance == NO_HIT ? 0.0 : hit.t * -dot(middle.direction, normalize(frame.world_from_view[2].xyz));
}

// The ray of a place in the picture through a point of the lens, which `u` draws.
CameraRay through_lens(CameraRay seen, float focus, vec2 u) {
    if (focus <= 0.0) {
        return seen;
    }
    // 1/f = 1/v + 1/s, with the image at v behind the lens, and an opening of the diameter f / F_NUMBER.
    float v = 0.5 * SENSOR_HEIGHT * abs(frame.steady_clip_from_view[1].y);
    float radius = 0.5 * v / ((1.0 + v / focus) * F_NUMBER);
    float r = radius * sqrt(u.x), phi = TURN * u.y;
    mat3 camera = mat3(frame.world_from_view);
    vec3 aside = normalize(camera[0]) * (r * cos(phi)) + normalize(camera[1]) * (r * sin(phi));
    vec3 sharp = seen.direction * (focus / -dot(seen.direction, normalize(camera[2])));
    return CameraRay(seen.origin + aside, normalize(sharp - aside));
}
#endif
