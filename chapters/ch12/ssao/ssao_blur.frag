// One of the two passes of the blur: eleven taps along an axis of the picture, each of which counts if it is of the pixel's
// own surface.
//
// Depth is affine over the picture on any plane, perspective or not. So the pixel and one of its neighbours say what depth
// a tap would have on the plane through both; of the two neighbours the one counts that is nearer in depth, since the
// other may be beyond an edge. A tap of another distance is of another surface.
//
#include "places.glsl"

layout(BIND(1, 0, 3)) uniform sampler2D visibility;
layout(BIND(1, 1, 4)) uniform sampler2D depth;

// One compiled module is both passes: the step from tap to tap, in pixels, is a constant of the pipeline.
layout(constant_id = 0) const int STEP_X = 1;
layout(constant_id = 1) const int STEP_Y = 0;
layout(constant_id = 2) const float DISTANCE_TOLERANCE = 0.003;  // in length scales of the scene
const ivec2 STEP_OF_TAPS = ivec2(STEP_X, STEP_Y);

layout(location = 0) out float out_visibility;

float depth_at(ivec2 pixel) {
    ivec2 last = textureSize(depth, 0) - 1;
    return all(equal(pixel, clamp(pixel, ivec2(0), last))) ? texelFetch(depth, pixel, 0).r : 0.0;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float own = depth_at(pixel);
    float found = texelFetch(visibility, pixel, 0).r;
    if (own == 0.0) {
        out_visibility = found;
        return;
    }
    float before = depth_at(pixel - STEP_OF_TAPS), after = depth_at(pixel + STEP_OF_TAPS);
    float backward = before == 0.0 ? 1e30 : own - before;
    float forward = after == 0.0 ? 1e30 : after - own;
    float slope = abs(backward) < abs(forward) ? backward : forward;
    slope = abs(slope) < 1e30 ? slope : 0.0;
    float sum = 0.0, weights = 0.0;
    for (int offset = -5; offset <= 5; ++offset) {
        ivec2 at = pixel + offset * STEP_OF_TAPS;
        float d = depth_at(at), expected = own + slope * float(offset);
        if (d == 0.0 || expected <= 0.0) {  // outside, sky, or beyond the plane's horizon
            continue;
        }
        float weight = blur_weight(offset);
        weight *= same_surface(distance_of(d), distance_of(expected), DISTANCE_TOLERANCE * frame.eye.w);
        sum += weight * texelFetch(visibility, at, 0).r;
        weights += weight;
    }
    out_visibility = sum / weights;  // the pixel itself has counted in full
}
