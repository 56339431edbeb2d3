// The motion of the camera: where each pixel's surface was in the frame before, if the surface itself stands still.
//
// A surface is (direction, 1) divided by its distance: the projection's inverse gives this form without a division. The
// sky is infinitely far, so its last component is zero and the camera's translation does not move it.
//
// Both projections begin at the point's offset from the camera, and the camera's own shift is the difference of two places.
// So a camera far from the origin costs no digits.

#include "scene/scene.glsl"
#include "transform.glsl"
#include "motion/reprojection.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D depth;

layout(location = 0) out vec2 out_motion;

// Returns x, y and w of the clip coordinates of a point, by a camera at `eye`. `offset` (xyz) is the point's offset from
// the camera of this frame, times `w`.
vec3 seen_by(mat4 clip_from_view, mat4 view_from_world, vec3 eye, vec3 offset, float w) {
    precise vec3 from_eye = offset + (frame.eye.xyz - eye) * w;
    vec3 in_view = matrix_times(view_from_world, vec4(from_eye, 0.0)).xyz;
    return matrix_times(clip_from_view, vec4(in_view, w)).xyw;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float d = texelFetch(depth, pixel, 0).r;
    if (d == 0.0 && frame.orthographic != 0u) {  // the whole picture shows one direction of the sky: it shifts nowhere
        out_motion = vec2(0.0);
        return;
    }
    vec2 ndc = (vec2(pixel) + 0.5) * (2.0 * frame.size.zw) - 1.0;  // with jitter, as the depth was drawn
    vec4 in_view = matrix_times(frame.view_from_clip, vec4(ndc, d, 1.0));
    float w = d == 0.0 ? 0.0 : in_view.w;
    vec3 offset = matrix_times(frame.world_from_view, vec4(in_view.xyz, 0.0)).xyz;
    vec3 now = seen_by(frame.steady_clip_from_view, frame.view_from_world, frame.eye.xyz, offset, w);
    vec3 before = seen_by(
        frame.previous_steady_clip_from_view, frame.previous_view_from_world, frame.previous_eye.xyz, offset, w
    );
    out_motion = motion_between(now, before);
}
