// What studies with rays share: the eye, the ray of each pixel, and what is found there. The host's part is seen.py.

#include "camera_ray.glsl"

layout(BIND(0, 0, 0), std140) uniform Eye_ {
    mat4 view_from_clip;
    mat4 world_from_view;
    uvec4 size;  // of the picture; z: 1 for an orthographic view; w: a number of the study's own
} eye;

struct Pixel {
    vec4 color;  // linear; w: t of the hit, or -1
    uvec4 what;  // of the study's own
};
layout(BIND(0, 1, 1), std430) writeonly buffer Pixels_ { Pixel pixels[]; };

bool in_picture(uvec2 pixel) { return all(lessThan(pixel, eye.size.xy)); }

CameraRay ray_of(uvec2 pixel) {
    return camera_ray((vec2(pixel) + 0.5) / vec2(eye.size.xy), eye.view_from_clip, eye.world_from_view, eye.size.z != 0u);
}

void found_at(uvec2 pixel, vec4 color, uvec4 what) { pixels[pixel.y * eye.size.x + pixel.x] = Pixel(color, what); }
