// The lens of the frame's camera: the circle of confusion of a depth, by the settings that are compiled in.

#include "scene/scene.glsl"
#include "circle_of_confusion.glsl"

// The inverse of the distance ahead of the camera. With reversed z and no far plane, depth is near / distance.
float per_distance(float depth) {
    return depth / frame.near;
}

// The signed radius in pixels of a circle of confusion, in a picture of `rows` rows. `middle` is the depth in the middle of the picture, which is in
// focus where no distance is set. An orthographic view has parallel rays, and a lens that makes such sees all sharp.
float radius_of(float depth, float middle, float rows) {
    if (frame.orthographic != 0u) {
        return 0.0;
    }
    float per_focus = FOCUS_DISTANCE > 0.0 ? 1.0 / FOCUS_DISTANCE : per_distance(middle);
    float focal_px = 0.5 * rows * abs(frame.steady_clip_from_view[1].y);
    float blur = blur_per_diopter(focal_px, rows, SENSOR_HEIGHT, F_NUMBER, per_focus);
    return circle_of_confusion(per_distance(depth), per_focus, blur, LARGEST_RADIUS * rows);
}
